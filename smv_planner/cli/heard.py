"""What planners say, read with care: anybody on the network may have said it.

A document is taken if it is as its schema says, so that nobody who shows one has to look again.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, NoReturn

from smv_planner.daemon.schema import Schema, schemas

MOST = 1e15
"""Numbers beyond are none that a planner says."""


def document(payload: bytes, kind: str) -> dict[str, Any] | None:
    """A document of this kind, or None if it is none."""
    found = _read(payload)
    return found if fits(found, _schemas()[kind]) else None


def documents(payload: bytes, kind: str) -> list[dict[str, Any]] | None:
    """Several in an array, or None if one of them is none."""
    found = _read(payload)
    return found if fits(found, {"type": "array", "items": _schemas()[kind]}) else None


def fits(value: Any, schema: Schema) -> bool:
    """Whether a value is as one of our own schemas says, which use few of the words that there are."""
    match schema:
        case {"const": const}:
            return type(value) is type(const) and bool(value == const)
        case {"enum": words}:
            return any(type(value) is type(word) and value == word for word in words)
        case {"oneOf": schemas}:
            return sum(fits(value, each) for each in schemas) == 1
        case {"if": condition, "then": schema}:
            return not fits(value, condition) or fits(value, schema)
    types = schema["type"] if isinstance(schema["type"], list) else [schema["type"]]
    if not any(_TYPES[each](value) for each in types) or not all(fits(value, each) for each in schema.get("allOf", ())):
        return False
    match value:
        case dict():
            return _members_fit(value, schema)
        case list():
            return all(fits(each, schema["items"]) for each in value) if "items" in schema else True
        case int() | float():
            return bool(schema.get("minimum", -MOST) <= value <= schema.get("maximum", MOST))
    return True


def _members_fit(value: Mapping[str, Any], schema: Schema) -> bool:
    own, others = schema.get("properties", {}), schema.get("additionalProperties", True)
    if not all(name in value for name in schema.get("required", ())) or len(value) < schema.get("minProperties", 0):
        return False
    for name, each in value.items():
        if name in own:
            if not fits(each, own[name]):
                return False
        elif others is not True and (others is False or not fits(each, others)):
            return False
    return True


_TYPES: Mapping[str, Callable[[Any], bool]] = {
    "null": lambda value: value is None,
    "boolean": lambda value: type(value) is bool,
    "integer": lambda value: type(value) is int,
    "number": lambda value: type(value) in (int, float),
    "string": lambda value: type(value) is str,
    "array": lambda value: type(value) is list,
    "object": lambda value: type(value) is dict,
}


@cache
def _schemas() -> dict[str, Schema]:
    return schemas()


def _read(payload: bytes) -> Any:
    try:
        return json.loads(payload, parse_constant=_refuse)
    except (ValueError, RecursionError):
        return None


def _refuse(text: str) -> NoReturn:
    raise ValueError(text)
