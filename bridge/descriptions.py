"""What the author of a driver has to know of a scenario: one JSON document per resource.

`smv-planner interface SCENARIO RESOURCE` writes it. A driver in any language needs nothing else of the planner.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from typing import Any

from bridge import keys
from smv_planner.errors import Mistake, UsageError
from smv_planner.model.domains import Bool, Domain, Enum, Range, Value
from smv_planner.model.model import Model
from smv_planner.protocol.hub import Deadman, Hold, Safe, deadman_of
from smv_planner.protocol.interface import Interface, interfaces

FORMAT = 1


@dataclass(frozen=True, slots=True)
class Description:
    """The interface of a resource, the goals it has before any planner spoke, and what its hub does when none speaks."""

    interface: Interface
    initial: Mapping[str, Value]
    deadman: Deadman
    period: float


def descriptions(model: Model, cell: str) -> dict[str, Description]:
    """The description of every resource, by name, in declared order. Raises UsageError for a cell that no key can hold."""
    initial = {variable.name: variable.initial for variable in model.variables}
    resources = {resource.name: resource for resource in model.resources}
    return {
        name: Description(interface, {goal: initial[goal] for goal in interface.goals}, deadman_of(resources[name]), model.period)
        for name, interface in interfaces(model, keys.checked_cell(cell)).items()
    }


def written(description: Description) -> dict[str, object]:
    """The document."""
    ours = description.interface
    return {
        "format": FORMAT,
        "kind": "interface",
        "cell": ours.cell,
        "resource": ours.resource,
        "model": ours.model,
        "keys": {"goal": keys.goal(ours.cell, ours.resource), "state": keys.state(ours.cell, ours.resource)},
        "period": description.period,
        "deadman": _deadman(description.deadman),
        "goals": {name: {**_domain(domain), "initial": description.initial[name]} for name, domain in ours.goals.items()},
        "measured": {name: _domain(domain) for name, domain in ours.measured.items()},
    }


def read(text: str, source: str = "the interface") -> Description:
    """The description that a document holds. Raises UsageError for anything else: it is made by the planner, not by hand."""
    try:
        found = json.loads(text)
        if (found["format"], found["kind"]) != (FORMAT, "interface"):
            raise ValueError(f"it has format {found['format']!r}, kind {found['kind']!r}")
        goals = {str(name): _domain_of(told) for name, told in found["goals"].items()}
        measured = {str(name): _domain_of(told) for name, told in found["measured"].items()}
        cell = keys.checked_cell(found["cell"])
        interface = Interface(cell, str(found["resource"]), goals, measured, str(found["model"]))
        initial = {name: found["goals"][name]["initial"] for name in goals}
        deadman = _deadman_of(found["deadman"])
        _within(initial, goals)
        if isinstance(deadman, Safe):
            _within(deadman.values, goals)
        return Description(interface, initial, deadman, float(found["period"]))
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        said = f"'{error.args[0]}' is missing" if isinstance(error, KeyError) else str(error)
        hint = "'smv-planner interface SCENARIO RESOURCE' writes one"
        raise UsageError([Mistake(f"{source} is no interface description: {said}", hint)]) from error


def _within(values: Mapping[str, Value], goals: Mapping[str, Domain]) -> None:
    for name, value in values.items():
        if value not in goals[name]:
            raise ValueError(f"'{name}' cannot be {value!r}")


def _domain(domain: Domain) -> dict[str, object]:
    match domain:
        case Bool():
            return {"type": "bool"}
        case Enum(words):
            return {"type": "enum", "words": list(words)}
        case Range(low, high):
            return {"type": "range", "min": low, "max": high}


def _domain_of(told: Mapping[str, Any]) -> Domain:
    match told["type"]:
        case "bool":
            return Bool()
        case "enum":
            return Enum(tuple(map(str, told["words"])))
        case "range":
            return Range(int(told["min"]), int(told["max"]))
    raise ValueError(f"there is no domain of type {told['type']!r}")


def _deadman(deadman: Deadman) -> dict[str, object]:
    match deadman:
        case Hold(after):
            return {"reaction": "hold", "after": None if after == inf else after}
        case Safe(values, after):
            return {"reaction": "safe", "after": after, "values": dict(values)}


def _deadman_of(told: Mapping[str, Any]) -> Deadman:
    match told["reaction"]:
        case "hold":
            return Hold(inf if told["after"] is None else float(told["after"]))
        case "safe":
            return Safe(dict(told["values"]), float(told["after"]))
    raise ValueError(f"there is no reaction {told['reaction']!r}")
