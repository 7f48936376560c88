"""Guard extraction: what invariants ask of controlled transitions, as extra guards (Industry 4.0 2020, section 4.5)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import product

from smv_planner.lazy import dataclass
from smv_planner.model.domains import Value
from smv_planner.model.expressions import (
    FALSE,
    TRUE,
    And,
    Const,
    Equal,
    Expr,
    Not,
    Or,
    Var,
    conjunction,
    disjunction,
    negation,
    rewritten,
    variables_of,
)
from smv_planner.model.semantics import ready
from smv_planner.model.system import Any, Kind, Transition
from smv_planner.planner.preflight.finding import Scene


@dataclass(frozen=True, slots=True)
class ExtraGuard:
    """What a transition has to wait for besides its guard, when the planner chooses the values `choice`."""

    transition: str
    choice: Mapping[str, Value]
    guard: Expr


def extra_guards(scene: Scene) -> Iterator[ExtraGuard]:
    """For every controlled transition the weakest condition that keeps its step from a state that invariants forbid.

    It is exact in the states that the invariants allow and the guard admits, and says nothing that these imply.
    """
    for transition in scene.system.transitions:
        if transition.kind is Kind.CONTROLLED:
            yield from _extra_guards(scene, transition)


def _extra_guards(scene: Scene, transition: Transition) -> Iterator[ExtraGuard]:
    fixed = {a.variable: a.value for a in transition.actions if not isinstance(a.value, Any)}
    chosen = {name: Var(name) for name in transition.assigned.difference(fixed)}
    free = sorted(chosen.keys() & variables_of(scene.allowed_after(fixed | chosen)))
    enabled = ready(scene.system, transition)
    for values in product(*(scene.system.domains[name].values for name in free)):
        choice = dict(zip(free, values, strict=True))
        wanted = scene.allowed_after(fixed | chosen | {name: Const(value) for name, value in choice.items()})
        guard = simplified(scene, rewritten(wanted, _variable_first), enabled, scene.allowed)
        if guard != TRUE:
            yield ExtraGuard(transition.name, choice, guard)


def _variable_first(expr: Expr) -> Expr | None:
    """`x == home` for `home == x`, which substitution may leave."""
    match expr:
        case Equal(Const() as value, Var() as variable):
            return Equal(variable, value)
    return None


def simplified(scene: Scene, expr: Expr, *given: Expr) -> Expr:
    """An expression that is worth the same wherever all of `given` hold, without what is not needed there."""
    if not scene.possible(*given, expr):
        return FALSE
    if not scene.possible(*given, negation(expr)):
        return TRUE
    match expr:
        case Not(part):
            return negation(simplified(scene, part, *given))
        case And(parts):
            kept = list(parts)
            for at in range(len(kept)):
                kept[at] = simplified(scene, kept[at], *given, *kept[:at], *kept[at + 1 :])
            return conjunction(kept)
        case Or(parts):
            kept = list(parts)
            for at in range(len(kept)):
                others = [negation(other) for other in (*kept[:at], *kept[at + 1 :])]
                kept[at] = simplified(scene, kept[at], *given, *others)
            return disjunction(kept)
    return expr
