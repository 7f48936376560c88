"""LTL on runs that end by idling: textbook cases, and the monitor held to the definition."""

from __future__ import annotations

from random import Random

import pytest
from generated import question

from smv_planner.model import ltl
from smv_planner.model.expressions import Var
from smv_planner.model.ltl import Atom, Monitor, Next, Release, Until, always, eventually, holds, negated, weak_until

INDEX = {"p": 0, "q": 1}
P, Q = Atom(Var("p")), Atom(Var("q"))
NEITHER, ONLY_P, ONLY_Q, BOTH = (False, False), (True, False), (False, True), (True, True)


@pytest.mark.parametrize(
    ("formula", "run", "expected"),
    [
        (eventually(P), [NEITHER, ONLY_P, NEITHER], True),
        (eventually(P), [NEITHER, ONLY_Q], False),
        (always(P), [ONLY_P, BOTH], True),
        (always(P), [ONLY_P, NEITHER], False),
        (Until(P, Q), [ONLY_P, ONLY_P, ONLY_Q], True),
        (Until(P, Q), [ONLY_Q], True),
        (Until(P, Q), [ONLY_P, ONLY_P], False),
        (Until(P, Q), [ONLY_P, NEITHER, ONLY_Q], False),
        (weak_until(P, Q), [ONLY_P, ONLY_P], True),
        (Release(P, Q), [ONLY_Q, BOTH, NEITHER], True),
        (Release(P, Q), [ONLY_Q, NEITHER, BOTH], False),
        (Next(P), [NEITHER, ONLY_P], True),
        (Next(P), [ONLY_P], True),  # idling: the next state is the same
        (Next(P), [NEITHER], False),
        (Until(always(P), Q), [ONLY_P, ONLY_Q], False),  # (G p) U q asks p for ever
        (Until(eventually(P), Q), [NEITHER, ONLY_Q, ONLY_P], True),  # F p does not force p before q
        (Until(negated(Q), P), [NEITHER, ONLY_P, ONLY_Q], True),
    ],
)
def test_textbook_cases(formula, run, expected):
    assert holds(formula, run, INDEX) is expected
    assert holds(negated(formula), run, INDEX) is not expected
    assert by_monitor(formula, run, INDEX) is expected


def test_the_monitor_agrees_with_the_definition_on_generated_formulas_and_runs():
    random = Random(1)
    seen = {True: 0, False: 0}
    for seed in range(150):
        problem = question(seed)
        for goal in problem.goals:
            for formula in (goal.until, Until(goal.until, Atom(goal.predicate))):
                run = [
                    tuple(random.choice(v.domain.values) for v in problem.system.variables) for _ in range(random.randint(1, 6))
                ]
                expected = holds(formula, run, problem.system.index)
                assert by_monitor(formula, run, problem.system.index) is expected
                seen[expected] += 1
    assert min(seen.values()) > 50


def test_co_safe_formulas_are_those_without_release():
    assert ltl.co_safe(Until(P, Next(eventually(Q))))
    assert not ltl.co_safe(Until(always(P), Q))
    assert not ltl.co_safe(negated(eventually(P)))


def by_monitor(formula, run, index):
    monitor = Monitor(formula, index)
    ways = {monitor.start}
    for state in run[:-1]:
        ways = {after for way in ways for after in monitor.after(way, state)}
    return any(monitor.met_by_idling(way, run[-1]) for way in ways)
