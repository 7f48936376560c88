"""Every engine gives the explicit one's verdict and length on generated questions; the generator must be worth it."""

from __future__ import annotations

from collections import Counter
from functools import cache

import pytest
from generated import question

from smv_planner.check import CheckedPlan, check_plan, check_proof
from smv_planner.engines import ENGINES, Limits, explicit
from smv_planner.model.ltl import co_safe
from smv_planner.planner.deorder import proposals
from smv_planner.problem import NotWithin, Problem, Reached, Undecided, Unreachable, Verdict

LIMITS = Limits(deadline=3600, memory=4 << 30, progress=lambda text: None)
"""An hour is for what hangs. Question 501 alone keeps the explicit search busy for half a minute, and on a machine that is
busy with other things for some minutes."""

QUICK, THOROUGH = 200, 2000
PORTION = 25
"""Questions per test, so that the work can be shared among cores."""

QUOTAS = {"reached": 80, "unreachable": 40, "needed a lasso": 25, "took 8 or more steps": 15, "planned around an invariant": 5}
"""At least so many of every 200 questions."""


def portions(first: int, last: int) -> list[range]:
    return [range(at, at + PORTION) for at in range(first, last, PORTION)]


def usable(engine: str) -> str:
    reason = ENGINES[engine].available()
    if reason:
        pytest.skip(reason)
    return engine


@pytest.mark.parametrize("engine", [name for name in ENGINES if name != "explicit"])
@pytest.mark.parametrize("seeds", portions(0, QUICK), ids=str)
def test_every_engine_agrees_with_the_explicit_one(engine: str, seeds: range) -> None:
    agree(usable(engine), seeds)


@pytest.mark.long
@pytest.mark.parametrize("engine", [name for name in ENGINES if name != "explicit"])
@pytest.mark.parametrize("seeds", portions(QUICK, THOROUGH), ids=str)
def test_every_engine_agrees_with_the_explicit_one_at_length(engine: str, seeds: range) -> None:
    agree(usable(engine), seeds)


def agree(engine: str, seeds: range) -> None:
    for seed in seeds:
        problem = question(seed)
        answered = ENGINES[engine].ask(problem, LIMITS)
        assert same(summary(engine, answered), expected(seed)), f"question {seed}"
        match answered:
            case Reached():
                accepted = check_plan(problem, answered, proposals(problem, answered))
                assert isinstance(accepted, CheckedPlan), f"question {seed}: {accepted}"
            case Unreachable(proof):
                assert check_proof(problem, proof) is None, f"question {seed}"


Summary = tuple[str, int | None]


@cache
def expected(seed: int) -> Summary:
    """What the explicit engine says, once for all the others."""
    return summary("explicit", explicit.ask(question(seed), LIMITS))


def summary(engine: str, verdict: Verdict) -> Summary:
    """Verdict and length. Who comes to no verdict is named: it may be the one that the others are held to."""
    match verdict:
        case Reached(path):
            return "reached", len(path)
        case Unreachable():
            return "unreachable", None
        case NotWithin():
            return "not within", None
        case Undecided(reason):
            raise AssertionError(f"{engine} did not decide: {reason}")


def same(one: Summary, other: Summary) -> bool:
    """Whether one confirms the other; what one can only deny up to the bound, the other may prove."""
    return one == other or {one[0], other[0]} == {"unreachable", "not within"}


def test_the_generated_questions_are_worth_asking(record_property) -> None:
    counts: Counter[str] = Counter()
    for seed in range(QUICK):
        problem = question(seed)
        counts.update(kinds(problem, explicit.ask(problem, LIMITS)))
    report = ", ".join(f"{counts[kind]} {kind}" for kind in QUOTAS)
    record_property("generated questions", f"of {QUICK} {report}")
    print(f"of {QUICK} generated questions {report}")
    assert all(counts[kind] >= quota for kind, quota in QUOTAS.items()), report


def kinds(problem: Problem, verdict: Verdict) -> list[str]:
    """Which quotas a question counts for. It needed a lasso if it was reached and no finite trace shows that."""
    found = []
    match verdict:
        case Reached(path):
            found.append("reached")
            if not co_safe(problem.formula):
                found.append("needed a lasso")
            if len(path) >= 8:
                found.append("took 8 or more steps")
            if problem.allowed and len(path) > 0:
                found.append("planned around an invariant")
        case Unreachable(proof):
            assert check_proof(problem, proof) is None
            found.append("unreachable")
    return found
