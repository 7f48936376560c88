"""One problem, one decision: an engine answers, and the checker has the last word."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from smv_planner.check import CheckedPlan, Refused, check_plan, check_proof
from smv_planner.check.order import Order
from smv_planner.check.projection import goals_about, of_the_whole
from smv_planner.clock import Over
from smv_planner.errors import EngineError
from smv_planner.lazy import dataclass
from smv_planner.model.expressions import Const, Equal, Var, show
from smv_planner.model.semantics import judge
from smv_planner.model.system import System
from smv_planner.planner.deorder import proposals
from smv_planner.problem import (
    Exhausted,
    Goal,
    Inductive,
    NotWithin,
    Pairs,
    Problem,
    Projected,
    Proof,
    Reached,
    Relaxed,
    Undecided,
    Unreachable,
    Verdict,
)

Solve = Callable[[Problem], Verdict]
"""Puts a problem to an engine."""

Orders = Callable[[Problem, Reached], Iterable[Order]]
"""Partial orders to try for a plan."""


@dataclass(frozen=True, slots=True)
class NoPlan:
    """Why there is none. Only `Unreachable` is certain; `Undecided` says nothing about the problem."""

    verdict: NotWithin | Unreachable | Undecided
    reason: str

    @property
    def decided(self) -> bool:
        """Whether the engine came to an end: what was asked counts as having no plan."""
        return not isinstance(self.verdict, Undecided)


def decide(problem: Problem, solve: Solve, orders: Orders = proposals) -> CheckedPlan | NoPlan:
    """Ask, and have the answer checked. A problem whose start is forbidden is not even asked.

    Raises EngineError if what the engine answers does not stand up to the checker.
    """
    broken = [i.name for i in problem.allowed if not judge(problem.system, i.predicate)(problem.initial)]
    if broken:
        reason = f"nothing keeps '{broken[0]}' from being violated in the state where it would start"
        return NoPlan(Unreachable(Exhausted(frozenset())), reason)
    verdict = solve(problem)
    try:
        return _checked(problem, verdict, orders)
    except Over:
        why = "the deadline passed while the engine's answer was being checked"
        return NoPlan(Undecided(why, deadline=True), why)


def _checked(problem: Problem, verdict: Verdict, orders: Orders) -> CheckedPlan | NoPlan:
    match verdict:
        case Reached():
            checked = check_plan(problem, verdict, orders(problem, verdict))
            if isinstance(checked, Refused):
                raise EngineError(f"the engine answered with a plan that its own trace does not bear out: {checked.reason}")
            return checked
        case Unreachable(proof):
            refused = check_proof(problem, proof)
            if refused and refused.too_large:
                why = f"the engine has an argument that there is no plan, but {refused.reason}"
                return NoPlan(Undecided(why, deadline=False), why)
            if refused:
                raise EngineError(f"the engine claims that there is no plan, but {refused.reason}")
            return NoPlan(verdict, why_never(problem, proof))
        case NotWithin(bound):
            return NoPlan(verdict, f"there is no plan of at most {bound} steps; longer ones were not looked at")
        case Undecided(reason):
            return NoPlan(verdict, reason)


def why_never(problem: Problem, proof: Proof) -> str:
    """A proof of unreachability in words."""
    match proof:
        case Projected(variables, Relaxed() as inner):
            whole = of_the_whole(problem.system, variables, inner)
            assert whole, "the proof has been checked"
            return _never(problem.system, goals_about(problem.goals, variables), whole)
        case Projected(_, inner):
            return why_never(problem, inner)
        case Exhausted(reached):
            return f"all {len(reached)} states that can follow were looked at, and none meets the goal"
        case Relaxed():
            return _never(problem.system, problem.goals, proof)
        case Pairs(apart):
            return f"whatever happens, {len(apart)} pairs of values never hold together, and every way to the goals needs some"
        case Inductive(clauses):
            return f"whatever happens, {len(clauses)} conditions that every step preserves keep the goal from being met"


def _never(system: System, goals: Iterable[Goal], proof: Relaxed) -> str:
    from smv_planner.check.relaxed import out_of_reach

    match out_of_reach(system, goals, proof):
        case [Equal(Var() as variable, Const() as value), *_]:
            return f"even if nothing ever got in the way, '{show(variable)}' can never become {show(value)}"
        case [part, *_]:
            return f"even if nothing ever got in the way, '{show(part)}' can never become true"
        case _:
            return "even if nothing but the invariants ever got in the way, the goals can never be met"
