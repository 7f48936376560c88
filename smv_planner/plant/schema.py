"""JSON Schemas (draft 2020-12) of what an emulated hub is told while it runs, and what it says to that.

Real hubs know nothing of it. `behaviour` is asked at `smv/CELL/RESOURCE/behaviour`, `perform` at `smv/CELL/RESOURCE/perform`.
"""

from __future__ import annotations

from typing import Any

from smv_planner.plant.serve import FORMAT, MAX_WORDS
from smv_planner.plant.told import WORDS

Schema = dict[str, Any]

_NAME: Schema = {"type": "string"}
_YES: Schema = {"type": "boolean"}
_VALUES: Schema = {"type": "object", "additionalProperties": {"type": ["boolean", "integer", "string"]}}
_TIMES: Schema = {"type": ["integer", "null"], "minimum": 1, "description": "How often it still happens; null is always."}


def schemas() -> dict[str, Schema]:
    """By kind: what is asked, and what is answered."""
    telling = {"type": "string", "pattern": f"^\\s*({'|'.join(WORDS)})(=|\\s*$)"}
    return {
        "behaviour": _document(
            "behaviour",
            "Have a device behave otherwise from now on, or ask how it does: 'smv-planner emulate --help' has the words.",
            {},
            tell={"type": "array", "maxItems": MAX_WORDS, "items": telling},
        ),
        "behaving": _document(
            "behaving",
            "What an emulated hub says of itself when it was told something.",
            {
                "resource": _NAME,
                "boot": _NAME,
                "goal": _VALUES,
                "forsaken": _YES,
                "measured": _VALUES,
                "behaviour": _object(
                    {},
                    silent=_YES,
                    stuck=_YES,
                    forgetful=_YES,
                    fail={"type": "object", "additionalProperties": _TIMES},
                    instead={"type": "object", "additionalProperties": _NAME},
                    lying=_VALUES,
                ),
                "rejected": {"type": "object", "additionalProperties": {"type": "integer", "minimum": 0}},
            },
        ),
        "perform": _document(
            "perform",
            "Have done by a person what a maintenance transition says; 'chosen' has the values that it leaves open.",
            {"transition": _NAME},
            chosen=_VALUES,
        ),
        "performed": _document("performed", "It is done.", {"performed": _NAME}),
    }


def _document(title: str, description: str, required: Schema, **optional: Schema) -> Schema:
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": title, "description": description}
    return {**head, **_object({"format": {"const": FORMAT}, **required}, **optional)}


def _object(required: Schema, **optional: Schema) -> Schema:
    return {"type": "object", "properties": {**required, **optional}, "required": list(required)}
