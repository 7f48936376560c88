"""Document -> Model: every rule of the language that goes beyond names and the shape of a document.

Each part is judged on its own, so that no mistake hides another. What is wrong is noted in the report, and something
harmless takes its place in a model that nobody will see.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping

from smv_planner.errors import ModelError
from smv_planner.language import document
from smv_planner.language.document import Scenario
from smv_planner.language.execution import duration, on_error, period_of, reenable, resource_of
from smv_planner.language.expressions import Level, Name, Typed, assigned_of, formula_of, predicate_of
from smv_planner.language.names import World, all_entries, declared, define, entries, quiet_in
from smv_planner.language.reader import UNREADABLE, Path, Report
from smv_planner.language.sequences import sequence_of
from smv_planner.model.expressions import TRUE, Expr
from smv_planner.model.ltl import Formula
from smv_planner.model.model import Copy, Intention, Model, Operation, Outcome
from smv_planner.model.system import Any, Assignment, Invariant, Kind, Transition, VariableKind

MAX_TRANSITIONS = 20_000
MAX_PARTS = 2_000_000
"""All expressions of a scenario together, predicates written out."""

_MAY_ASSIGN: Mapping[Kind, tuple[VariableKind, ...]] = {
    Kind.EFFECT: (VariableKind.MEASURED,),
    Kind.CONTROLLED: (VariableKind.GOAL, VariableKind.ESTIMATED, VariableKind.DECISION),
    Kind.AUTOMATIC: (VariableKind.GOAL, VariableKind.ESTIMATED, VariableKind.DECISION),
    Kind.MAINTENANCE: tuple(VariableKind),
}


def model_of(scenario: Scenario, report: Report) -> Model:
    """The model that a document describes. Raises ModelError with everything that is wrong."""
    if scenario is UNREADABLE:
        raise ModelError(report.mistakes)
    world = World(report, {}, {}, quiet_in(report.holes), [])
    variables, definitions = declared(scenario, world)
    define(definitions, world)
    transitions = tuple(_transitions(scenario, world))
    model = Model(
        name=scenario.name,
        resources=tuple(resource_of(*each, scenario, world) for each in entries(scenario.resources, ("resources",))),
        variables=variables,
        copies=tuple(_copies(world)),
        predicates={name.full: name.part.expr for name in world.names.values() if name.kind == "predicate" and name.part},
        transitions=transitions,
        invariants=tuple(_invariants(scenario, world)),
        operations=tuple(_operations(scenario, transitions, world)),
        intentions=tuple(_intentions(scenario, world)),
        sequence=sequence_of(scenario.sequence, None, ("sequence",), scenario, world),
        period=period_of(scenario, world),
        on_error=on_error(scenario.on_error),
    )
    if sum(world.sizes) > MAX_PARTS:
        report.wrong((), f"all expressions together have more than {MAX_PARTS} parts, predicates written out", "simplify them")
    if report.mistakes:
        raise ModelError(report.mistakes)
    return model


def _copies(world: World) -> Iterator[Copy]:
    for name in world.names.values():
        if name.kind == "copy" and name.domain is not None and name.part is not None:
            yield Copy(name.full, name.domain, name.part.expr)


def _invariants(scenario: Scenario, world: World) -> Iterator[Invariant]:
    for path, name, text in entries(scenario.invariants, ("invariants",)):
        yield Invariant(name, _predicate(text, path, world))


def _transitions(scenario: Scenario, world: World) -> Iterator[Transition]:
    """In the order in which automatic ones fire: resource by resource, then the interactions."""
    seen: set[str] = set()
    for path, resource, each in entries(scenario.resources, ("resources",)):
        for inner, name, entry in entries(each.transitions, (*path, "transitions")):
            again = (entry.reenable, each.reenable, scenario.reenable)
            yield _transition(entry, f"{resource}.{name}", inner, resource, seen, world, again)
    for path, name, entry in entries(scenario.transitions, ("transitions",)):
        yield _transition(entry, name, path, None, seen, world, (entry.reenable, scenario.reenable))
    if len(seen) > MAX_TRANSITIONS:
        world.report.wrong((), f"there are {len(seen)} transitions; the limit is {MAX_TRANSITIONS}")


def _transition(
    entry: document.Transition,
    full: str,
    path: Path,
    resource: str | None,
    seen: set[str],
    world: World,
    again: tuple[str | None, ...],
) -> Transition:
    """`again` are the policies that may decide when it is re-enabled, the closest first."""
    if full in seen:
        world.report.wrong_key(path, f"there is a transition '{full}' already", "full names of transitions are unique")
    seen.add(full)
    kind = None if entry.kind is UNREADABLE else Kind(entry.kind)
    prefix = f"{resource}." if resource else ""
    for key, given, kinds in (
        ("within", entry.within, (Kind.EFFECT,)),
        ("expected", entry.expected, (Kind.EFFECT,)),
        ("instruction", entry.instruction, (Kind.MAINTENANCE,)),
        ("reenable", entry.reenable, (Kind.EFFECT,)),
    ):
        if given is not None and kind is not None and kind not in kinds:
            what = "effects" if Kind.EFFECT in kinds else "maintenance transitions"
            world.report.wrong_key((*path, key), f"'{key}' is for {what} only, and this one is {kind}")
    if entry.reenable is not None and kind is Kind.EFFECT and entry.within is None:
        message = f"'{path[-1]}' never times out, and 'reenable' says what follows when it did"
        world.report.wrong_key((*path, "reenable"), message, "say 'within', how long it may take")

    def refused(name: Name) -> str | None:
        if _never_assigned(name):
            return _never_assigned(name)
        if name.kind is None or kind is None or name.kind in _MAY_ASSIGN[kind]:
            return None
        allowed = " and ".join(", ".join(_MAY_ASSIGN[kind]).rsplit(", ", 1))
        a = {Kind.EFFECT: "an effect", Kind.AUTOMATIC: "an automatic transition"}.get(kind, f"a {kind} transition")
        return f"{a} assigns {allowed} variables, and '{name.full}' is of kind '{name.kind}'"

    may_choose = kind is None or kind.deliberate
    if world.report.empty((*path, "actions")):
        world.report.wrong_key(path, f"'{path[-1]}' changes nothing", "give it 'actions'")
    return Transition(
        name=full,
        kind=kind or Kind.CONTROLLED,
        guard=_predicate(entry.guard, (*path, "guard"), world, prefix),
        actions=_actions(entry.actions, (*path, "actions"), world, refused, prefix, may_choose=may_choose),
        resource=resource,
        within=duration(entry.within, (*path, "within"), world),
        expected=entry.expected is not False,
        instruction=entry.instruction,
        reenable=reenable(*(again if kind is Kind.EFFECT else ())),
    )


def _actions(
    table: document.Actions | None,
    path: Path,
    world: World,
    refused: Callable[[Name], str | None],
    prefix: str = "",
    level: Level = "any",
    may_choose: bool = False,
) -> tuple[Assignment, ...]:
    """`refused` says why a variable or copy may not be assigned here, if it may not."""
    actions: list[Assignment] = []
    assigned: dict[str, Path] = {}
    scope = world.scope(path, prefix, level)
    for inner, word, text in all_entries(table, path):
        name = scope.find(word)
        if name is None:
            if not scope.silent(word):
                hint = world.report.close(word, [each for each in scope.words if (known := scope.find(each)) and known.variable])
                world.report.wrong_key(inner, f"unknown variable '{word}'", hint)
            name = Name(word, None, None)
        elif why := refused(name):
            world.report.wrong_key(inner, why, "it follows from what it is measured from" if name.kind == "copy" else None)
        if name.full in assigned:
            world.report.wrong_key(inner, f"'{name.full}' is assigned twice", world.report.line_of(assigned[name.full]))
        assigned[name.full] = inner
        if text is UNREADABLE:
            continue
        if value := assigned_of(world.asking(str(text), inner, prefix, level), name, may_choose):
            actions.append(Assignment(name.full, value.expr if isinstance(value, Typed) else value))
    return tuple(actions)


def _never_assigned(name: Name) -> str | None:
    what = {"predicate": "predicate", "copy": "measured copy"}.get(str(name.kind))
    return f"'{name.full}' is a {what} and is not assigned here" if what else None


def _operations(scenario: Scenario, transitions: Iterable[Transition], world: World) -> Iterator[Operation]:
    by_name = {each.name: each for each in transitions}
    for path, name, entry in entries(scenario.operations, ("operations",)):
        yield _operation(entry, name, path, by_name, scenario, world)


def _intentions(scenario: Scenario, world: World) -> Iterator[Intention]:
    for path, name, entry in entries(scenario.intentions, ("intentions",)):
        yield _intention(entry, name, path, scenario, world)


def _operation(
    entry: document.Operation, name: str, path: Path, transitions: Mapping[str, Transition], scenario: Scenario, world: World
) -> Operation:
    with_ = None if entry.with_ is UNREADABLE else entry.with_
    if with_ is not None and with_ not in transitions and not _transitions_missing(with_, world.report.holes):
        world.report.wrong((*path, "with"), f"unknown transition '{with_}'", world.report.close(with_, tuple(transitions)))
    if with_ is not None and with_ in transitions and any(isinstance(action.value, Any) for action in transitions[with_].actions):
        message = f"'{with_}' assigns 'any', and nobody chooses when it happens together with the completion of '{name}'"
        world.report.wrong((*path, "with"), message, "synchronise with a transition that says which value")
    outcomes = tuple(_outcomes(entry, path, world))
    synchronised = transitions[with_].assigned if with_ is not None and with_ in transitions else frozenset()
    for outcome in outcomes:
        for action in outcome.effects:
            if action.variable in synchronised:
                where = (*path, "outcomes", outcome.name) if outcome.name else path
                message = f"'{name}' and the transition '{with_}' that completes with it both assign '{action.variable}'"
                world.report.wrong_key((*where, "effects"), message)
    return Operation(
        name=name,
        guard=_predicate(entry.guard, (*path, "guard"), world, level="decision"),
        outcomes=outcomes,
        on_start=_actions(entry.on_start, (*path, "on_start"), world, _decisions_only, level="decision"),
        synchronised=with_,
        retries=entry.retries,
        on_error=on_error(entry.on_error, scenario.on_error),
        reenable=reenable(entry.reenable, scenario.reenable),
    )


def _transitions_missing(full: str, holes: Iterable[Path]) -> bool:
    """Whether a transition may only seem unknown, because it or the table that it is in was not read."""
    for hole in holes:
        match hole:
            case () | ("resources",) | ("transitions",):
                return True
            case ("resources", resource) | ("resources", resource, "transitions") if full.startswith(f"{resource}."):
                return True
            case ("transitions", name) if full == name:
                return True
            case ("resources", resource, "transitions", name) if full == f"{resource}.{name}":
                return True
    return False


def _outcomes(entry: document.Operation, path: Path, world: World) -> Iterator[Outcome]:
    wrong = world.report.wrong_key
    if entry.outcomes is None:
        if entry.effects is None:
            wrong(path, f"'{path[-1]}' has neither 'effects' nor 'outcomes'")
        yield _outcome(None, entry.effects, entry.goal, path, world)
        return
    for key, given in (("effects", entry.effects), ("goal", entry.goal)):
        if given is not None:
            wrong((*path, key), f"'{key}' stands beside 'outcomes'", "each outcome has its own")
    outcomes = tuple(entries(entry.outcomes, (*path, "outcomes")))
    if world.report.empty((*path, "outcomes")):
        wrong((*path, "outcomes"), "there are no outcomes", "name them, or give 'effects'")
    goals = [each.goal is not None for _, _, each in outcomes]
    for inner, name, each in outcomes:
        if each.goal is None and any(goals):
            wrong(inner, f"'goal' is missing in '{name}'", "either every outcome has one, or none")
        yield _outcome(name, each.effects, each.goal, inner, world)


def _outcome(name: str | None, effects: document.Actions | None, goal: str | None, path: Path, world: World) -> Outcome:
    return Outcome(
        name=name,
        effects=_actions(effects, (*path, "effects"), world, _decisions_and_copies, level="decision"),
        goal=None if goal is None else _predicate(goal, (*path, "goal"), world, level="resource"),
    )


def _decisions_and_copies(name: Name) -> str | None:
    """Effects of operations may name copies: on the operation level these change as predicted."""
    return None if name.kind == "copy" else _decisions_only(name)


def _decisions_only(name: Name) -> str | None:
    if name.kind in (VariableKind.DECISION, None):
        return None
    return _never_assigned(name) or f"only decision variables are assigned here, and '{name.full}' is of kind '{name.kind}'"


def _intention(entry: document.Intention, name: str, path: Path, scenario: Scenario, world: World) -> Intention:
    formula: Formula | None = None
    if entry.formula is not None and entry.formula is not UNREADABLE:
        formula = formula_of(world.asking(entry.formula, (*path, "formula"), level="decision"))
    return Intention(
        name=name,
        start=_predicate(entry.start, (*path, "start"), world),
        goal=_predicate(entry.goal, (*path, "goal"), world, level="decision"),
        formula=formula,
        actions=_actions(entry.actions, (*path, "actions"), world, _decisions_only),
        sequence=sequence_of(entry.sequence, entry.manual, (*path, "sequence"), scenario, world),
    )


def _predicate(text: str | None, path: Path, world: World, prefix: str = "", level: Level = "any") -> Expr:
    """The condition that a text says; a missing one is true."""
    if text is None or text is UNREADABLE:
        return TRUE
    part = predicate_of(world.asking(text, path, prefix, level))
    return part.expr if part else TRUE
