"""Plan transitions straight to goals: look at the start, ask, and put the checked plan into an answer."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress

from smv_planner.check import CheckedPlan
from smv_planner.clock import Over
from smv_planner.lazy import dataclass, replace
from smv_planner.model.domains import Value
from smv_planner.model.expressions import conjunction
from smv_planner.model.model import Model
from smv_planner.model.semantics import judge, slide
from smv_planner.model.system import Any, Invariant, Kind, State, System, Transition
from smv_planner.planner.answer import Answer, PlanStep, ProofKind, Stage, Violation
from smv_planner.planner.conflict import Asked, conflict
from smv_planner.planner.culprits import goals_to_blame, named
from smv_planner.planner.decide import NoPlan, Solve, decide
from smv_planner.planner.prompt import needs_late_effects
from smv_planner.planner.widening import Widened
from smv_planner.problem import (
    Exhausted,
    Goal,
    Inductive,
    NotWithin,
    Pairs,
    Problem,
    Projected,
    Proof,
    Relaxed,
    Undecided,
    Unreachable,
)


@dataclass(frozen=True, slots=True)
class Start:
    """Where planning starts, under which widened invariants (without the `lifted` ones), and what may be used.

    Maintenance may be asked for or not; `disabled` transitions (an effect that timed out) and those of `lost` resources
    are not planned on, although they may still happen. `ran` names operations that have run already, each as often as it
    did: a prescribed sequence goes on after them.
    """

    state: State
    widened: tuple[Widened, ...]
    lifted: frozenset[str] = frozenset()
    maintenance: bool = False
    disabled: frozenset[str] = frozenset()
    lost: frozenset[str] = frozenset()
    ran: tuple[str, ...] = ()

    def unusable(self, system: System) -> frozenset[str]:
        """What no plan may use, effects that are not expected included."""
        return frozenset(t.name for t in system.transitions if not self._usable(system, t))

    def _usable(self, system: System, transition: Transition) -> bool:
        if transition.kind is Kind.MAINTENANCE:  # a person can do it even if the resource is lost
            return self.maintenance
        if transition.kind.automatic:  # our own doing, which nothing can hold back
            return True
        touched = {system.resources[name] for name in transition.assigned} | {transition.resource}
        return transition.expected and transition.name not in self.disabled and self.lost.isdisjoint(touched)


def pose(model: Model, begin: Start, goals: Iterable[Goal], bound: int) -> Problem:
    """The problem that an engine is asked to solve."""
    return Problem(
        system=model.system,
        initial=begin.state,
        goals=tuple(goals),
        allowed=tuple(widened.invariant for widened in begin.widened),
        unusable=begin.unusable(model.system),
        bound=bound,
    )


def violations(system: System, state: State, widened: Iterable[Widened]) -> tuple[Violation, ...]:
    """The invariants that a state breaks, or from which the system may slide into breaking them."""
    found = []
    for one in widened:
        if not judge(system, one.invariant.predicate)(state):
            now = not judge(system, one.declared.predicate)(state)
            found.append(Violation(one.declared.name, now, slide=() if now else _slide(system, state, one.declared)))
    return tuple(found)


def _slide(system: System, state: State, invariant: Invariant) -> tuple[str, ...]:
    """The transitions by which a state slides into breaking an invariant; empty if that is too long to find out."""
    try:
        way = slide(system, [state], [invariant.predicate])
    except OverflowError:
        return ()
    assert way, f"the widening of '{invariant.name}' forbids a state that cannot slide"
    return tuple(step[0].name for step in way)


def reach(problem: Problem, blank: Answer, begin: Start, solve: Solve, explain: Solve | None = None) -> Answer:
    """Fill in `blank` with the verdict on a problem; `explain` is asked, often, why there is no plan.

    Raises EngineError if what the engine answers does not stand up to the checker.
    """
    found = violations(problem.system, begin.state, begin.widened)
    if found:
        return violated(blank, found)
    result = decide(problem, solve)
    if isinstance(result, NoPlan):
        found_out = goals_to_blame(problem, result, solve)
        if isinstance(found_out, NoPlan):
            return without_plan(blank, result)
        texts = blank.question.goals or ("all invariants",)
        blank = replace(blank, culprits=named(found_out, texts))
        if explain and isinstance(result.verdict, Unreachable):
            with suppress(Over):  # an answer without causes is an answer all the same
                blank = replace(blank, conflict=conflict(_asked(problem, texts, begin), explain))
        return without_plan(blank, result)
    steps = plan_steps(result)
    return replace(
        blank,
        verdict="reached",
        checked=True,
        steps=steps,
        stages=(Stage(0, (), 0, len(steps)),),
        final=problem.system.named(result.trace.states[-1]),
        warnings=warnings(result),
    )


def _asked(problem: Problem, goals: tuple[str, ...], begin: Start) -> Asked:
    def unusable(disabled: frozenset[str], lost: frozenset[str]) -> frozenset[str]:
        return replace(begin, disabled=disabled, lost=lost).unusable(problem.system)

    return Asked(problem, goals, begin.disabled, begin.lost, unusable)


def leave_forbidden(model: Model, begin: Start, bound: int, blank: Answer, solve: Solve, explain: Solve | None = None) -> Answer:
    """Plan the way out of forbidden states (Machines 2021, section 4.6).

    The invariants violated now, as widened, are lifted; the goal is that all hold again. Maintenance may be asked for,
    nothing is frozen, and an operator has to approve every step.
    """
    found = violations(model.system, begin.state, begin.widened)
    broken = {violation.invariant for violation in found}
    held = tuple(widened for widened in begin.widened if widened.declared.name not in broken)
    goal = Goal(conjunction(widened.invariant.predicate for widened in begin.widened))
    way_out = replace(begin, widened=held, maintenance=True)
    answer = reach(pose(model, way_out, [goal], bound), blank, way_out, solve, explain)
    approve = ("an operator has to approve every step: the plan starts in a forbidden state",) if found else ()
    return replace(answer, violations=found, warnings=(*approve, *answer.warnings))


def violated(blank: Answer, found: tuple[Violation, ...]) -> Answer:
    names = ", ".join(f"'{violation.invariant}'" for violation in found)
    reason = f"the start violates {names}, or may slide into violating it without any command"
    return replace(blank, verdict="invariant_violated", checked=True, violations=found, reason=reason)


def without_plan(blank: Answer, result: NoPlan) -> Answer:
    match result.verdict:
        case Unreachable(proof):
            return replace(blank, verdict="unreachable", proof=proof_kind(proof), checked=True, reason=result.reason)
        case NotWithin():
            return replace(blank, verdict="not_within", reason=result.reason)
        case Undecided(_, deadline):
            return replace(blank, verdict="undecided", reason=result.reason, deadline=deadline)


def proof_kind(proof: Proof) -> ProofKind:
    match proof:
        case Projected(_, part):
            return proof_kind(part)
        case Exhausted():
            return "exhausted"
        case Relaxed():
            return "relaxed"
        case Pairs():
            return "pairs"
        case Inductive():
            return "inductive"


def plan_steps(plan: CheckedPlan, first: int = 0, stage: int = 0, waits_for: tuple[int, ...] = ()) -> tuple[PlanStep, ...]:
    """A checked plan's steps, numbered from `first`; those that wait for none of it wait for the steps `waits_for`."""
    system, trace = plan.problem.system, plan.trace
    steps = []
    for at, (name, after) in enumerate(zip(trace.path, plan.after, strict=True)):
        transition = system.transition[name]
        steps.append(
            PlanStep(
                index=first + at,
                transition=name,
                kind=transition.kind.value,
                after=tuple(first + other for other in after) or waits_for,
                changes=_changes(system, transition, trace.states[at], trace.states[at + 1]),
                stage=stage,
                operation=transition.completes,
                instruction=transition.instruction,
            )
        )
    return tuple(steps)


def _changes(system: System, transition: Transition, before: State, after: State) -> dict[str, Value]:
    """What has a new value, and every value that the planner chose, new or not."""
    chosen = {action.variable for action in transition.actions if isinstance(action.value, Any)}
    changed = system.changes(before, after)
    return {name: value for name, value in system.named(after).items() if name in changed or name in chosen}


def warnings(plan: CheckedPlan) -> tuple[str, ...]:
    late = needs_late_effects(plan.problem, plan.trace)
    return (late,) if late else ()
