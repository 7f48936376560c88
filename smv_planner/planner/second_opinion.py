"""A second engine's verdict beside the first one's: whether they agree, and what to keep where they do not.

Verdicts on one problem are compared, never plans: many plans have the same length. A bounded engine that finds no plan
agrees with a proof that there is none.
"""

from __future__ import annotations

from typing import assert_never

from smv_planner.check import Refused, check_plan, check_proof
from smv_planner.lazy import dataclass
from smv_planner.model.expressions import show
from smv_planner.model.ltl import show_formula
from smv_planner.problem import NotWithin, Problem, Reached, Undecided, Unreachable, Verdict


@dataclass(frozen=True, slots=True)
class Agrees:
    """Both say that there is no plan, or that the shortest has the same length."""


@dataclass(frozen=True, slots=True)
class Differs:
    """One of the two is wrong; `reason` puts both side by side."""

    reason: str


@dataclass(frozen=True, slots=True)
class Silent:
    """One of the two came to no answer, so there is nothing to compare."""

    reason: str


Opinion = Agrees | Differs | Silent


@dataclass(frozen=True, slots=True)
class Says:
    """What an engine says."""

    engine: str
    verdict: Verdict


def compare(one: Says, other: Says) -> Opinion:
    """Hold two answers to the same problem against each other."""
    for says in (one, other):
        if isinstance(says.verdict, Undecided):
            return Silent(f"{says.engine} came to no answer: {says.verdict.reason}")
    if _shortest(one.verdict) == _shortest(other.verdict):
        return Agrees()
    return Differs(f"{_words(one)}, {_words(other)}")


def report(problem: Problem, one: Says, other: Says) -> dict[str, object]:
    """A difference with all that belongs to it, ready for `json.dumps`: the problem, both answers, the checker's word on each."""
    return {
        "initial": problem.system.named(problem.initial),
        "goals": [{"formula": show_formula(goal.until), "goal": show(goal.predicate)} for goal in problem.goals],
        "allowed": [{"name": invariant.name, "predicate": show(invariant.predicate)} for invariant in problem.allowed],
        "unusable": sorted(problem.unusable),
        "bound": problem.bound,
        "answers": [_answer(problem, says) for says in (one, other)],
    }


def _shortest(verdict: Verdict) -> int | None:
    return len(verdict.path) if isinstance(verdict, Reached) else None


def _words(says: Says) -> str:
    match says.verdict:
        case Reached(path):
            return f"{says.engine} says that the shortest plan has {len(path)} step{'' if len(path) == 1 else 's'}"
        case NotWithin(bound):
            return f"{says.engine} says that there is no plan of at most {bound} steps"
        case Unreachable():
            return f"{says.engine} says that there is no plan"
        case Undecided():
            return f"{says.engine} came to no answer"
        case _:
            assert_never(says.verdict)


def _answer(problem: Problem, says: Says) -> dict[str, object]:
    answer: dict[str, object] = {"engine": says.engine, "says": _words(says)}
    match says.verdict:
        case Reached(path, states):
            accepted = check_plan(problem, says.verdict)
            refused = accepted if isinstance(accepted, Refused) else None
            answer |= {"steps": list(path), "states": [problem.system.named(state) for state in states]}
        case Unreachable(proof):
            refused = check_proof(problem, proof)
        case NotWithin() | Undecided():
            return {**answer, "checker": "says nothing: there is neither a plan nor a proof to check"}
    return {**answer, "checker": f"refuses it: {refused.reason}" if refused else "accepts it"}
