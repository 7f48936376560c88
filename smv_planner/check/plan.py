"""Is this trace a plan? Replay, invariants with their slides, the formula, and the partial order."""

from __future__ import annotations

from collections.abc import Iterable

from smv_planner.check.order import Order, certified, is_order, reduced, total_order
from smv_planner.check.slides import may_slide
from smv_planner.check.where import Where
from smv_planner.clock import look
from smv_planner.lazy import dataclass
from smv_planner.model.ltl import truths
from smv_planner.model.system import State
from smv_planner.problem import Problem, Reached


@dataclass(frozen=True, slots=True)
class CheckedPlan:
    """A trace that the kernel has accepted; made by `check_plan` only.

    `after[i]` are the steps that step i directly waits for. `partial` tells that some steps may go in any order.
    """

    problem: Problem
    trace: Reached
    after: tuple[tuple[int, ...], ...]
    partial: bool


@dataclass(frozen=True, slots=True)
class Refused:
    """Why a trace is not a plan, or an argument no proof; or that the kernel cannot tell, for it is `too_large`."""

    reason: str
    too_large: bool = False


def check_plan(problem: Problem, trace: Reached, orders: Iterable[Order] = ()) -> CheckedPlan | Refused:
    """Accept or refuse a trace; the first of `orders` that can be certified becomes the plan's partial order."""
    reason = _broken_replay(problem, trace) or _forbidden(problem, trace.states) or _unmet(problem, trace)
    if reason:
        return Refused(reason)
    total = total_order(len(trace.path))
    for order in orders:
        if not is_order(order, len(trace.path)):
            return Refused("the partial order offered contradicts the order of the steps")
        visited = certified(problem, trace, order)
        if visited is not None and not _forbidden(problem, visited):
            return CheckedPlan(problem, trace, reduced(order), partial=order != total)
    return CheckedPlan(problem, trace, reduced(total), partial=False)


def _broken_replay(problem: Problem, trace: Reached) -> str | None:
    if len(trace.states) != len(trace.path) + 1:
        return f"{len(trace.path)} steps need {len(trace.path) + 1} states, the trace has {len(trace.states)}"
    if len(trace.path) > problem.bound:
        return f"{len(trace.path)} steps are more than the bound of {problem.bound}"
    if trace.states[0] != problem.initial:
        return "the trace does not begin in the initial state"
    for at, name in enumerate(trace.path):
        look()
        before, after = trace.states[at], trace.states[at + 1]
        possible = list(problem.steps.by(before, name))
        if after not in possible:
            return f"step {at}: '{name}' " + ("does not lead to the state given" if possible else "is not possible there")
    if not problem.steps.settled(trace.states[-1]):
        return "the last state is not settled"
    return None


def _forbidden(problem: Problem, states: Iterable[State]) -> str | None:
    """A state that an invariant forbids, or from which the system may slide into one."""
    visited = list(states)
    where = Where(problem.system, visited)
    for invariant in problem.allowed:
        if not where.everywhere(invariant.predicate):
            return f"a state violates the invariant '{invariant.name}'"
    names = {invariant.name for invariant in problem.allowed}
    held = [i.predicate for i in problem.system.invariants if i.name in names]
    try:
        slides = may_slide(problem.system, visited, held)
    except OverflowError:
        return None  # too many to look at: the widened invariants above have to do
    return "the system may slide from a state into violating an invariant" if slides else None


def _unmet(problem: Problem, trace: Reached) -> str | None:
    """The goals and formulas, judged on the whole run (the last state repeats for ever)."""
    if truths(problem.formula, Where(problem.system, trace.states))[0]:
        return None
    return "the run does not satisfy the goals"
