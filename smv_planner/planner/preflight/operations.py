"""Operations that no plan can start or complete, and intentions that cannot be met."""

from __future__ import annotations

from collections.abc import Iterator

from smv_planner.model.expressions import Const, Expr, Var, conjunction, equality, show, variables_of
from smv_planner.model.model import Intention, Operation, Outcome
from smv_planner.model.semantics import ready, settled
from smv_planner.model.system import Any, Assignment, Kind
from smv_planner.planner.operations import Task, abstracted
from smv_planner.planner.preflight.finding import Finding, Scene, Severity, never
from smv_planner.planner.preflight.values import Values

BY_A_PLAN = (Kind.CONTROLLED, Kind.AUTOMATIC, Kind.EFFECT)


def operations(scene: Scene, above: Scene, values: Values) -> Iterator[Finding]:
    """What keeps operations from being planned, started or completed; `above` is the operation planner's level."""
    for operation in values.model.operations:
        yield from _never(scene, operation, "never-starts", f"'{operation.name}' never starts", operation.guard, "warning")
        yield from _changes_nothing(above, values, operation)
        for outcome in operation.outcomes:
            if outcome.goal is not None:
                yield from _never_completes(scene, operation, outcome, outcome.goal)
            else:
                yield from _nobody_completes(values, operation, outcome)


def intentions(scene: Scene, values: Values) -> Iterator[Finding]:
    """Intentions that never start, and goals that hold in no state which the invariants allow."""
    for intention in values.model.intentions:
        yield from _never(scene, intention, "never-starts", f"'{intention.name}' never starts", intention.start, "warning")
        claim = f"the goal of '{intention.name}' never holds"
        yield from _never(scene, intention, "never-reached", claim, intention.goal, "error")


def _never(
    scene: Scene, part: Operation | Intention, rule: str, claim: str, predicate: Expr, severity: Severity
) -> Iterator[Finding]:
    """A claim that rests on a predicate which never holds; an error at any rate if it contradicts itself."""
    why = never(scene, predicate)
    if why is not None:
        kind = "operation" if isinstance(part, Operation) else "intention"
        hint = "correct the condition" if why.alone else "correct the condition, or the invariants"
        yield Finding("error" if why.alone else severity, rule, kind, part.name, f"{claim}: {why.why}", hint)


def _changes_nothing(above: Scene, values: Values, operation: Operation) -> Iterator[Finding]:
    """Operations of which no outcome ever changes anything, so that no operation plan has a use for them."""
    steps = [above.system.transition[Task(operation, outcome).name] for outcome in operation.outcomes]
    if above.possible(abstracted(values.model, operation.guard)) and not any(
        above.possible(ready(above.system, step)) for step in steps
    ):
        message = f"'{operation.name}' is never planned: where its guard holds, its effects change nothing or leave a domain"
        yield Finding("warning", "changes-nothing", "operation", operation.name, message, "correct its guard or its effects")


def _never_completes(scene: Scene, operation: Operation, outcome: Outcome, goal: Expr) -> Iterator[Finding]:
    """Goals that hold in no settled state together with the guard of the synchronised transition (Def. 5)."""
    claim = f"'{operation.name}' never completes" + (f" with the outcome '{outcome.name}'" if outcome.name else "")
    if operation.synchronised:
        goal = conjunction([goal, scene.system.transition[operation.synchronised].guard])
        claim += f", which waits for the guard of '{operation.synchronised}'"
    yield from _never(scene, operation, "never-completes", claim, goal, "error")
    still = settled(scene.system, scene.system.transitions)
    if scene.possible(goal, scene.allowed) and not scene.possible(goal, scene.allowed, still):
        why = "an automatic transition is enabled wherever its goal holds, and goals count in settled states only"
        yield Finding("error", "never-completes", "operation", operation.name, f"{claim}: {why}", "correct the goal")


def _nobody_completes(values: Values, operation: Operation, outcome: Outcome) -> Iterator[Finding]:
    """Effects of an operation without a goal that no transition brings about (Industry 4.0, Example 5)."""
    for effect in outcome.effects:
        if not _brought_about(values, effect):
            wanted = effect.variable if isinstance(effect.value, Any) else show(equality(Var(effect.variable), effect.value))
            yield Finding(
                "error",
                "nobody-completes",
                "operation",
                operation.name,
                f"'{operation.name}' has no goal, and no transition brings about its effect '{wanted}'",
                "give the operation a goal, or add the transition",
            )


def _brought_about(values: Values, effect: Assignment) -> bool:
    """Whether transitions that plans may use can lead to what an effect promises, judged one by one."""
    assert not isinstance(effect.value, Any), "nobody chooses the effects of an operation"
    copies = {copy.name: copy.value for copy in values.model.copies}
    if effect.variable in copies:
        changed = any(values.assigned(name, BY_A_PLAN) for name in variables_of(copies[effect.variable]))
        return changed and values.scene.possible(equality(copies[effect.variable], effect.value), values.scene.allowed)
    if isinstance(effect.value, Const):
        return values.produced(effect.variable, effect.value.value, BY_A_PLAN)
    return values.assigned(effect.variable, BY_A_PLAN)
