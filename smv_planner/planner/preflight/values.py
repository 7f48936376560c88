"""Values that nobody produces, variables that nobody changes, resources that nobody can help."""

from __future__ import annotations

from collections.abc import Container, Iterator
from functools import cached_property

from smv_planner.lazy import dataclass
from smv_planner.model import ltl
from smv_planner.model.domains import Bool, Value, show_value
from smv_planner.model.expressions import TRUE, Const, Equal, Expr, Named, Var, equality, negation, nodes
from smv_planner.model.model import Model
from smv_planner.model.semantics import may_fire
from smv_planner.model.system import Any, Assignment, Kind, VariableKind
from smv_planner.planner.preflight.finding import Finding, Scene, quoted

EVERY_KIND = tuple(Kind)


@dataclass(frozen=True)
class Values:
    """Who assigns what. Whether a guard can hold is judged by itself: invariants do not matter here."""

    scene: Scene
    model: Model

    @cached_property
    def _assignments(self) -> tuple[tuple[Kind, Expr, Assignment], ...]:
        """By what kind of step, when, and what. An operation without a goal promises its effects, and assigns nothing."""
        model = self.model
        found = [(t.kind, may_fire(self.scene.system, t), action) for t in model.transitions for action in t.actions]
        for operation in model.operations:
            ends = (outcome.effects for outcome in operation.outcomes if outcome.goal is not None)
            found += [(Kind.OPERATION, operation.guard, a) for actions in (operation.on_start, *ends) for a in actions]
        found += [(Kind.OPERATION, TRUE, action) for intention in model.intentions for action in intention.actions]
        return tuple(found)

    def produced(self, name: str, value: Value, kinds: Container[Kind] = EVERY_KIND) -> bool:
        """Whether some step of one of the kinds can change the variable to the value."""
        return any(self._gives(when, action, value) for when, action in self._to(name, kinds))

    def assigned(self, name: str, kinds: Container[Kind] = EVERY_KIND) -> bool:
        """Whether there is a step of one of the kinds that assigns the variable."""
        return any(self._to(name, kinds))

    def _to(self, name: str, kinds: Container[Kind]) -> Iterator[tuple[Expr, Assignment]]:
        return ((when, action) for kind, when, action in self._assignments if kind in kinds and action.variable == name)

    def _gives(self, when: Expr, action: Assignment, value: Value) -> bool:
        given = TRUE if isinstance(action.value, Any) else equality(action.value, Const(value))
        return self.scene.possible(when, given, negation(equality(Var(action.variable), Const(value))))


def never_changes(values: Values) -> Iterator[Finding]:
    """Variables that keep their initial value, as far as a plan can know."""
    for variable in values.model.variables:
        message, hint = {
            VariableKind.MEASURED: ("no effect changes it: no plan can expect its sensor to say anything else", "add an effect"),
            VariableKind.GOAL: ("no transition commands it", "add a transition, or remove it"),
            VariableKind.ESTIMATED: ("no transition changes it", "add a transition, or remove it"),
            VariableKind.DECISION: ("no transition and no operation with a goal changes it", "add one, or measure it by 'from'"),
        }[variable.kind]
        kinds = (Kind.EFFECT,) if variable.kind is VariableKind.MEASURED else EVERY_KIND
        if not values.assigned(variable.name, kinds):
            yield Finding(
                "warning",
                "never-changes",
                "variable",
                variable.name,
                f"'{variable.name}' is always {show_value(variable.initial)}: {message}",
                hint,
            )


def never_produced(values: Values) -> Iterator[Finding]:
    """Values that are mentioned, and which no variable ever has; those of variables that never change are told already."""
    mentioned: dict[tuple[str, Value], dict[tuple[str, str], None]] = {}
    for kind, name, expr in conditions(values.model):
        for variable, value in _mentions(values, expr):
            mentioned.setdefault((variable, value), {})[kind, name] = None
    for (variable, value), where in mentioned.items():
        if not _can_have(values, variable, value):
            kind, name = next(iter(where))
            names = [name for _, name in where]
            matters = quoted(names[:3]) if len(names) <= 3 else f"'{names[0]}', '{names[1]}' and {len(names) - 2} more"
            yield Finding(
                "warning",
                "never-produced",
                kind,
                name,
                f"'{variable}' never becomes {show_value(value)}: nothing assigns that, which matters to {matters}",
                "correct the value, or add the transition that leads to it",
            )


def _can_have(values: Values, name: str, value: Value) -> bool:
    if name not in values.scene.system.index:
        copies = {copy.name: copy.value for copy in values.model.copies}
        return values.scene.possible(equality(copies[name], Const(value)))
    variable = values.scene.system.variables[values.scene.system.index[name]]
    return value == variable.initial or not values.assigned(name) or values.produced(name, value)


def _mentions(values: Values, expr: Expr) -> Iterator[tuple[str, Value]]:
    copies = {copy.name for copy in values.model.copies}
    for node in nodes(expr):
        match node:
            case Equal(Var(name) | Named(name, _), Const(value)) | Equal(Const(value), Var(name) | Named(name, _)):
                if name in values.scene.system.index or name in copies:
                    yield name, value
            case Var(name) if isinstance(values.scene.system.domains[name], Bool):
                yield from ((name, value) for value in (False, True))


def conditions(model: Model) -> Iterator[tuple[str, str, Expr]]:
    """Every guard, invariant and goal, and whose it is."""
    for transition in model.transitions:
        yield "transition", transition.name, transition.guard
    for invariant in model.invariants:
        yield "invariant", invariant.name, invariant.predicate
    for operation in model.operations:
        goals = [outcome.goal for outcome in operation.outcomes if outcome.goal is not None]
        yield from (("operation", operation.name, expr) for expr in (operation.guard, *goals))
    for intention in model.intentions:
        formula = ltl.atoms(intention.formula) if intention.formula is not None else ()
        yield from (("intention", intention.name, expr) for expr in (intention.start, intention.goal, *formula))


def no_maintenance(model: Model) -> Iterator[Finding]:
    """Resources that no maintenance transition belongs to or changes."""
    owner = {variable.name: variable.resource for variable in model.variables}
    maintenance = [transition for transition in model.transitions if transition.kind is Kind.MAINTENANCE]
    helped = {t.resource for t in maintenance} | {owner[name] for t in maintenance for name in t.assigned}
    for resource in model.resources:
        if resource.name not in helped:
            yield Finding(
                "warning",
                "no-maintenance",
                "resource",
                resource.name,
                f"'{resource.name}' has no maintenance transition: when it fails, no plan can ask a person for help",
                "add a transition of kind 'maintenance' that brings it back",
            )
