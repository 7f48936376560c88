"""Distances in small parts of a system: never too far, and no other plan is found with them than without."""

from collections.abc import Iterator

import pytest
from engines.questions import ask, is_, up
from generated import question

from smv_planner.engines.auto import patterns
from smv_planner.engines.auto.search import Estimate, Paused, Search, Tables
from smv_planner.engines.auto.session import session_of
from smv_planner.model.domains import Range
from smv_planner.model.ltl import ALWAYS_TRUE
from smv_planner.problem import Problem, Reached


def guided(seeds: range, widely: bool) -> Iterator[tuple[Problem, Tables, Estimate, Reached]]:
    """Questions that have a plan and goals of which something is known, with the plan found by search alone."""
    for seed in seeds:
        problem = question(seed)
        session = session_of(problem.system)
        ground, tables = session.variant(problem.allowed)
        estimate = session.guide(ground).estimate(problem, widely)
        if estimate is not None and tables.allows(ground.packing.pack(problem.initial)):
            for found in Search(tables, problem).explore():
                if isinstance(found, Reached) and found.path:
                    yield problem, tables, estimate, found


@pytest.mark.parametrize("widely", [False, True], ids=["quick", "wide"])
@pytest.mark.parametrize("seeds", [range(at, at + 60) for at in range(0, 120, 60)], ids=str)
def test_no_distance_is_estimated_to_be_more_than_a_plan_takes(seeds: range, widely: bool) -> None:
    far = 0
    for problem, tables, estimate, plan in guided(seeds, widely):
        plain = [goal.until for goal in problem.goals] == [ALWAYS_TRUE]  # else a goal may be met on the way and lost again
        for at, state in enumerate(plan.states if plain else plan.states[:1]):
            steps = estimate(tables.packing.pack(state), -1)
            assert steps <= len(plan.path) - at
            far += steps > 1
    assert far > 20


@pytest.mark.parametrize("widely", [False, True], ids=["quick", "wide"])
@pytest.mark.parametrize("seeds", [range(at, at + 60) for at in range(0, 120, 60)], ids=str)
def test_the_plan_is_the_one_found_without_leaving_out_what_is_too_far(seeds: range, widely: bool) -> None:
    fewer = 0
    for problem, tables, estimate, plan in guided(seeds, widely):
        search = Search(tables, problem)
        remaining = search.remaining(estimate)
        *_, found = search.explore(within=(remaining, len(plan.path)))
        assert found == plan
        *paused, beyond = search.explore(within=(remaining, len(plan.path) - 1))
        assert isinstance(beyond, Paused)
        assert beyond.depth == len(plan.path)
        fewer += bool(paused)
    assert fewer > 10


def test_what_has_too_many_states_says_nothing_and_is_not_measured_again_and_again(monkeypatch: pytest.MonkeyPatch) -> None:
    measured = []
    monkeypatch.setattr(
        patterns.Distances, "_measure", lambda self, real=patterns.Distances._measure: measured.append(1) or real(self)
    )
    for states, steps in ((10, range(9, 0, -1)), (5, [1] * 9)):
        problem = ask({"n": (Range(0, 9), 0)}, [up], is_("n", 9))
        monkeypatch.setattr(patterns, "STATES", states)
        ground, tables = session_of(problem.system).variant(())
        estimate = session_of(problem.system).guide(ground).estimate(problem, False)
        assert estimate is not None
        assert [estimate(tables.packing.pack((n,)), -1) for n in range(9)] == list(steps)
    assert len(measured) == 1
