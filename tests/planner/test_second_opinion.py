"""Two engines, one problem: what counts as a difference."""

from __future__ import annotations

import json

import pytest
from generated import question

from smv_planner.engines import ENGINES, Limits, explicit
from smv_planner.planner.second_opinion import Agrees, Differs, Says, Silent, compare, report
from smv_planner.problem import Exhausted, NotWithin, Reached, Undecided, Unreachable, Verdict

SHORT = Reached(("a",), ((0,), (1,)))
DETOUR = Reached(("a", "b"), ((0,), (2,), (1,)))
OTHER = Reached(("c",), ((0,), (1,)))
BOUNDED, PROVED = NotWithin(10), Unreachable(Exhausted(frozenset()))
LATE, BROKEN = Undecided("the deadline passed", deadline=True), Undecided("killed", deadline=False)

LIMITS = Limits(deadline=60, memory=1 << 30, progress=lambda text: None)


def both_ways(one: Verdict, other: Verdict) -> set[type]:
    return {type(compare(Says("a", x), Says("b", y))) for x, y in ((one, other), (other, one))}


@pytest.mark.parametrize(
    ("one", "other"), [(SHORT, SHORT), (SHORT, OTHER), (BOUNDED, BOUNDED), (BOUNDED, PROVED), (PROVED, PROVED)]
)
def test_the_same_length_or_no_plan_on_both_sides_is_agreement(one: Verdict, other: Verdict) -> None:
    assert both_ways(one, other) == {Agrees}


@pytest.mark.parametrize(("one", "other"), [(SHORT, DETOUR), (SHORT, BOUNDED), (SHORT, PROVED)])
def test_another_length_or_a_plan_against_none_is_a_difference(one: Verdict, other: Verdict) -> None:
    assert both_ways(one, other) == {Differs}


@pytest.mark.parametrize("one", [SHORT, BOUNDED, PROVED, LATE])
@pytest.mark.parametrize("silent", [LATE, BROKEN])
def test_who_came_to_no_answer_has_no_opinion(one: Verdict, silent: Verdict) -> None:
    assert both_ways(one, silent) == {Silent}


def test_a_difference_names_both_sides() -> None:
    found = compare(Says("auto", SHORT), Says("nusmv", BOUNDED))
    assert found == Differs("auto says that the shortest plan has 1 step, nusmv says that there is no plan of at most 10 steps")


def test_a_report_has_both_answers_and_what_the_checker_thinks_of_them() -> None:
    problem = question(0)
    right = explicit.ask(problem, LIMITS)
    assert isinstance(right, Reached)
    wrong = Reached(right.path[:-1], right.states[:-1])
    told = json.loads(json.dumps(report(problem, Says("explicit", right), Says("liar", wrong))))
    honest, liar = told["answers"]
    assert honest["steps"] == list(right.path)
    assert (honest["checker"], liar["checker"].partition(":")[0]) == ("accepts it", "refuses it")
    assert told["initial"] == problem.system.named(problem.initial)
    assert told["bound"] == problem.bound
    assert len(told["goals"]) == len(problem.goals)


def test_engines_agree_on_generated_questions() -> None:
    for seed in range(20):
        problem = question(seed)
        one, other = (Says(name, ENGINES[name].ask(problem, LIMITS)) for name in ("auto", "sat"))
        assert compare(one, other) == Agrees(), f"question {seed}"
