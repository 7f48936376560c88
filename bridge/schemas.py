"""JSON Schemas (draft 2020-12) of what travels between planner and hubs, for programs in other languages.

They say which documents have the right form. That values are in their domains, and that a message is meant for this cell,
resource and model, is in the interface description; that it is new, in the rules of the hub.
"""

from __future__ import annotations

from typing import Any

from smv_planner.protocol.messages import FORMAT, MAX_COUNT

DIALECT = "https://json-schema.org/draft/2020-12/schema"

_IDENTITY = {"type": "string", "pattern": "^[A-Za-z0-9_.-]{1,64}$"}
_WORD = {"type": "string", "minLength": 1}
_VALUES = {
    "type": "object",
    "description": "Full names of variables with their values: all of the resource, and no others.",
    "additionalProperties": {"type": ["boolean", "integer", "string"]},
}
_INTEGER = {"type": "integer"}
_SECONDS = {"type": "number", "exclusiveMinimum": 0}


def schemas() -> dict[str, dict[str, Any]]:
    """By kind of document."""
    return {"goal": _goal(), "state": _state(), "interface": _interface()}


def _goal() -> dict[str, Any]:
    return _document(
        "goal",
        "The whole goal state of one resource, from the planner to its hub: on every change, and repeated every period.",
        {
            "cell": _WORD,
            "resource": _WORD,
            "epoch": _count(1, "The planner's reign. A hub refuses every epoch older than the newest it has obeyed."),
            "seq": _count(1, "Grows with every change within an epoch; the same message again is a sign of life."),
            "planner": {**_IDENTITY, "description": "Who reigns. The first to claim an epoch has it."},
            "model": {**_WORD, "description": "Hash of the scenario that the values belong to."},
            "values": _VALUES,
        },
    )


def _state() -> dict[str, Any]:
    schema = _document(
        "state",
        "The whole measured state of one resource, from its hub: on every change, and repeated every period.",
        {
            "cell": _WORD,
            "resource": _WORD,
            "boot": {**_IDENTITY, "description": "New each time the hub starts."},
            "seq": _count(1, "Grows with every message of a boot."),
            "model": {**_WORD, "description": "Hash of the scenario that the values belong to."},
            "measured": _VALUES,
            "mirror": {
                **_VALUES,
                "description": "The goals that it obeys now, asked for or its deadman reaction.",
            },
            "epoch": _count(0, "Of the newest goal message accepted in this boot; 0 before any."),
            "goal_seq": _count(0, "Of the same message; 0 before any."),
            "planner": {
                "type": "string",
                "pattern": "^[A-Za-z0-9_.-]{0,64}$",
                "description": "Of the same message; empty before any.",
            },
        },
    )
    nobody = {"properties": {"goal_seq": {"const": 0}, "planner": {"const": ""}}}
    somebody = {"properties": {"goal_seq": {"minimum": 1}, "planner": {"minLength": 1}}}
    return {**schema, "if": {"properties": {"epoch": {"const": 0}}}, "then": nobody, "else": somebody}


def _interface() -> dict[str, Any]:
    domain = {
        "oneOf": [
            _object({"type": {"const": "bool"}}, {"initial": {"type": "boolean"}}),
            _object({"type": {"const": "enum"}, "words": {"type": "array", "items": _WORD}}, {"initial": _WORD}),
            _object(
                {"type": {"const": "range"}, "min": {"type": "integer"}, "max": {"type": "integer"}},
                {"initial": {"type": "integer"}},
            ),
        ]
    }
    variables = {"type": "object", "additionalProperties": domain}
    hold = _object({"reaction": {"const": "hold"}, "after": {"anyOf": [_SECONDS, {"type": "null"}]}})
    safe = _object({"reaction": {"const": "safe"}, "after": _SECONDS, "values": _VALUES})
    return _document(
        "interface",
        "What the driver of one resource has to know of a scenario: 'smv-planner interface' writes it.",
        {
            "cell": _WORD,
            "resource": _WORD,
            "model": _WORD,
            "keys": _object({"goal": _WORD, "state": _WORD}),
            "period": {**_SECONDS, "description": "Seconds after which goals and states are repeated."},
            "deadman": {"description": "What the hub does when no planner speaks for 'after' seconds.", "oneOf": [hold, safe]},
            "goals": {**variables, "description": "What is asked of the device, with the values before anybody asked."},
            "measured": {**variables, "description": "What it reports."},
        },
    )


def _document(kind: str, description: str, members: dict[str, Any]) -> dict[str, Any]:
    head: dict[str, Any] = {"format": {"const": FORMAT}, "kind": {"const": kind}}
    return {"$schema": DIALECT, "title": kind, "description": description, **_object({**head, **members})}


def _object(members: dict[str, Any], optional: dict[str, Any] | None = None) -> dict[str, Any]:
    every = {**members, **(optional or {})}
    return {"type": "object", "properties": every, "required": list(members), "additionalProperties": False}


def _count(least: int, description: str) -> dict[str, Any]:
    return {"type": "integer", "minimum": least, "maximum": MAX_COUNT, "description": description}
