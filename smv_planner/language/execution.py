"""What a scenario says about its execution: times, what a hub does alone, and what follows an error.

Planning reads none of it. What is said for a whole scenario or resource is handed down here, so that the model has every
policy where it is asked for.
"""

from __future__ import annotations

from collections.abc import Iterator
from decimal import Decimal

from smv_planner.language import document
from smv_planner.language.document import Scenario
from smv_planner.language.names import World, all_entries, no_value
from smv_planner.language.reader import UNREADABLE, Path
from smv_planner.model.domains import Value
from smv_planner.model.model import OnError, Resource
from smv_planner.model.system import Policy, Reenable, VariableKind

PERIOD = 0.2
MIRROR_WITHIN = 1.0

_SECONDS = {"ms": Decimal("0.001"), "s": Decimal(1), "min": Decimal(60), "h": Decimal(3600)}


def period_of(scenario: Scenario, world: World) -> float:
    """How often goals are sent, in seconds."""
    return duration(scenario.period, ("period",), world) or PERIOD


def resource_of(path: Path, name: str, entry: document.Resource, scenario: Scenario, world: World) -> Resource:
    """The resource, without what is declared in it."""
    deadman = duration(entry.deadman, (*path, "deadman"), world)
    if deadman is not None and 0 < deadman <= _seconds(scenario.period, PERIOD):
        hint = "goals are sent every 'period', which is 200 ms if nothing is said"
        world.report.wrong((*path, "deadman"), "this is over before the next goal is sent", hint)
    if entry.on_deadman not in (None, UNREADABLE) and entry.deadman is None:
        hint = "say after how long: 'deadman: 1 s'"
        world.report.wrong_key((*path, "on_deadman"), "'on_deadman' stands without 'deadman'", hint)
    return Resource(
        name,
        silent_after=duration(entry.silent_after, (*path, "silent_after"), world),
        mirror_within=duration(entry.mirror_within, (*path, "mirror_within"), world) or MIRROR_WITHIN,
        deadman=deadman,
        safe=tuple(_safe(entry, name, (*path, "on_deadman"), world)),
        on_error=on_error(entry.on_error, scenario.on_error),
        reenable=reenable(entry.reenable, scenario.reenable, Policy.ON_CHANGE),
    )


def _safe(entry: document.Resource, resource: str, path: Path, world: World) -> Iterator[tuple[str, Value]]:
    """The goal values that a hub sets when it hears nothing; only its own, for it knows no others."""
    if entry.on_deadman is UNREADABLE or isinstance(entry.on_deadman, str):
        return
    scope = world.scope(path, f"{resource}.", "any")
    seen: dict[str, Path] = {}
    for inner, word, value in all_entries(entry.on_deadman, path):
        name = scope.find(word)
        if name is None:
            if not scope.silent(word):
                own = [each for each in scope.words if (known := scope.find(each)) and known.kind is VariableKind.GOAL]
                world.report.wrong_key(inner, f"unknown variable '{word}'", world.report.close(word, own))
        elif name.kind is None:
            continue
        elif name.kind is not VariableKind.GOAL or not name.full.startswith(f"{resource}."):
            whose = f"is no goal variable of '{resource}'"
            world.report.wrong_key(inner, f"'{name.full}' {whose}", "a hub can only change what it is told")
        elif name.full in seen:
            world.report.wrong_key(inner, f"'{name.full}' is here twice", world.report.line_of(seen[name.full]))
        elif value is not UNREADABLE and name.domain is not None:
            seen[name.full] = inner
            if value in name.domain:
                yield name.full, value
            else:
                no_value(value, name.domain, inner, world)


def on_error(*said: str | None) -> OnError:
    """What the first says that says anything."""
    return OnError(_first(said) or OnError.CONTINUE)


def reenable(*said: str | None) -> Reenable:
    """What the first says that says anything."""
    match (_first(said) or Policy.MANUAL).split(maxsplit=1):
        case [Policy.AFTER, time]:
            return Reenable(Policy.AFTER, _seconds(time, 0))
        case [policy, *_]:
            return Reenable(Policy(policy))
    raise AssertionError


def _first(said: tuple[str | None, ...]) -> str | None:
    found = next((each for each in said if each is not None), None)
    return None if found is UNREADABLE else found


def duration(text: str | None, path: Path, world: World) -> float | None:
    """A time in seconds."""
    if text is None or text is UNREADABLE:
        return None
    seconds = _seconds(text, 0)
    if not seconds:
        world.report.wrong(path, "a duration is longer than nothing")
    return seconds


def _seconds(text: str | None, otherwise: float) -> float:
    if text is None or text is UNREADABLE:
        return otherwise
    unit = text.lstrip("0123456789. ")
    return float(Decimal(text.removesuffix(unit).strip()) * _SECONDS[unit])
