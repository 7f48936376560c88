"""Single transitions, and pairs of effects: what never fires, leaves a domain, disagrees."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from types import MappingProxyType

from smv_planner.lazy import replace
from smv_planner.model.expressions import (
    FALSE,
    TRUE,
    Expr,
    Var,
    conjunction,
    disjunction,
    equality,
    negation,
    show,
    substitute,
    variables_of,
)
from smv_planner.model.semantics import may_fire, ready
from smv_planner.model.system import Any, Assignment, Kind, Transition
from smv_planner.planner.preflight.finding import Finding, Scene, Severity, core, never, quoted


def never_fires(scene: Scene) -> Iterator[Finding]:
    """Transitions that fire in no state which the invariants allow, for the first reason that is found.

    Maintenance serves recovery, where invariants are lifted: it may be for forbidden states alone.
    """
    automatic = [transition for transition in scene.system.transitions if transition.kind.automatic]
    idle = {transition.name: negation(ready(scene.system, transition)) for transition in automatic}
    names = list(idle)
    for transition in scene.system.transitions:
        earlier = names[: names.index(transition.name)] if transition.kind.automatic else names
        reason = _reason(scene, transition, [idle[name] for name in earlier])
        if reason is not None:
            severity, why, hint = reason
            yield Finding(severity, "never-fires", "transition", transition.name, f"'{transition.name}' never fires: {why}", hint)


def _reason(scene: Scene, transition: Transition, comes_first: Sequence[Expr]) -> tuple[Severity, str, str] | None:
    enabled = ready(scene.system, transition)
    contradicted = never(scene, transition.guard)
    if contradicted and contradicted.alone:
        return "error", contradicted.why, "correct its guard"
    if not scene.possible(enabled):
        return "warning", "where its guard holds it changes nothing, or would leave a domain", "correct its guard or its actions"
    recovery = transition.kind is Kind.MAINTENANCE
    forbidden = never(scene, enabled)
    if forbidden and not recovery:
        return "warning", forbidden.why, "remove it, or correct the invariants"
    here = (enabled, *comes_first, TRUE if recovery else scene.allowed)
    if not scene.possible(*here):
        return "warning", "wherever it is enabled, an automatic transition fires before it", "correct its guard"
    values = {a.variable: Var(f"{a.variable}@new") if isinstance(a.value, Any) else a.value for a in transition.actions}
    changes = disjunction(negation(equality(value, Var(name))) for name, value in values.items())
    if transition.kind is Kind.CONTROLLED and not scene.possible(*here, changes, scene.allowed_after(values)):
        after = [substitute(invariant.predicate, values) for invariant in scene.invariants]
        blamed = quoted(scene.invariants[at].name for at in core(scene, after, *here, changes))
        return "warning", f"every state to which it could lead is forbidden by {blamed}", "remove it, or correct the invariants"
    return None


def leaves_domain(scene: Scene, operations: Mapping[str, str] = MappingProxyType({})) -> Iterator[Finding]:
    """Assignments whose value may lie outside the domain, where the transition is then disabled.

    Above, transitions stand for `operations`, which are named here.
    """
    for transition in scene.system.transitions:
        for action in transition.actions:
            if isinstance(action.value, Any):
                continue
            inside = may_fire(scene.system, replace(transition, guard=TRUE, actions=(action,)))
            if inside == TRUE:
                continue
            about = variables_of(conjunction([transition.guard, inside]))
            example = scene.evidence(transition.guard, scene.allowed, negation(inside), about=about)
            if example is not None:
                message = f"'{transition.name}' is disabled where '{show(action.value)}' lies outside the domain of "
                message += f"'{action.variable}', which is {scene.system.domains[action.variable]}"
                hint = "say so in its guard, or enlarge the domain"
                kind = "operation" if transition.name in operations else "transition"
                name = operations.get(transition.name, transition.name)
                yield Finding("warning", "leaves-domain", kind, name, message, hint, example)


def effects_disagree(scene: Scene) -> Iterator[Finding]:
    """Expected effects that give a variable different values from the same state."""
    effects = [transition for transition in scene.system.transitions if transition.kind is Kind.EFFECT and transition.expected]
    for one, two in combinations(effects, 2):
        differ = disjunction(_differ(a, b) for a in one.actions for b in two.actions if a.variable == b.variable)
        if differ == FALSE:
            continue
        both = (ready(scene.system, one), ready(scene.system, two))
        example = scene.evidence(*both, differ, scene.allowed, about=one.used | two.used)
        if example is not None:
            names = quoted(sorted(one.assigned & two.assigned))
            message = f"'{one.name}' and '{two.name}' can be expected of the same state, with different values of {names}"
            hint = "fine if either may happen; else let their guards exclude each other, or mark one 'expected: false'"
            yield Finding("warning", "effects-disagree", "transition", two.name, message, hint, example)


def _differ(one: Assignment, two: Assignment) -> Expr:
    assert not isinstance(one.value, Any), "nobody chooses the values of an effect"
    assert not isinstance(two.value, Any), "nobody chooses the values of an effect"
    return negation(equality(one.value, two.value))
