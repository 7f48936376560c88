"""What the bench asks is what it says: the sizes of the two layouts, and how long the shortest plans are."""

from __future__ import annotations

from itertools import islice

import pytest
from bench.instances import Instance, free, frozen, impossible, layout, mutex, plans, replans, stations

from smv_planner.check import CheckedPlan, check_plan, check_proof
from smv_planner.engines import Limits, auto, explicit
from smv_planner.model.domains import Bool
from smv_planner.model.system import Kind
from smv_planner.problem import Reached, Unreachable

LIMITS = Limits(deadline=120, memory=4 << 30, progress=lambda text: None)

SMALL = ("A1 one bolt", "two bolts", "two phi U goal")
"""Rows that the explicit engine answers in seconds."""


@pytest.mark.parametrize(("name", "transitions", "booleans"), [("A", 71, 87), ("B", 85, 202)])
def test_the_layouts_have_the_sizes_that_are_stated(name: str, transitions: int, booleans: int) -> None:
    system = layout(name).system
    assert sum(t.expected and t.kind is not Kind.MAINTENANCE for t in system.transitions) == transitions
    assert sum(1 if isinstance(v.domain, Bool) else len(v.domain.values) for v in system.variables) == booleans


def length(instance: Instance) -> int | None:
    """Of a plan that the checker accepts; None where the kernel accepts a proof that there is none."""
    match auto.ask(instance.problem, LIMITS):
        case Reached(path) as reached:
            assert isinstance(check_plan(instance.problem, reached), CheckedPlan)
            return len(path)
        case Unreachable(proof):
            assert check_proof(instance.problem, proof) is None
            return None
    pytest.fail("the engine does not decide")


ROWS = {
    "plans": plans,
    "impossible": impossible,
    "B3": lambda: islice(free(), 1),
    "stations": lambda: [stations(3)],
    "mutex": lambda: [mutex(24), mutex(9, entangled=True)],
    "frozen": lambda: [frozen(2)],
}


@pytest.mark.parametrize("row", [pytest.param(row, marks=pytest.mark.long if row == "frozen" else ()) for row in ROWS])
def test_a_shortest_plan_is_as_long_as_stated(row: str) -> None:
    instances = list(ROWS[row]())
    assert {instance.name: length(instance) for instance in instances} == {each.name: each.length for each in instances}


def test_a_search_of_all_states_finds_none_shorter() -> None:
    for instance in plans():
        if instance.name in SMALL:
            found = explicit.ask(instance.problem, LIMITS)
            assert isinstance(found, Reached)
            assert len(found.path) == instance.length


def test_replanning_has_questions_with_and_without_a_plan() -> None:
    verdicts = [auto.ask(problem, LIMITS) for problem in replans(20)]
    assert {type(verdict) for verdict in verdicts} == {Reached, Unreachable}
    assert len({len(verdict.path) for verdict in verdicts if isinstance(verdict, Reached)}) > 5
