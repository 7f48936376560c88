"""JSON Schemas (draft 2020-12) of what the planner publishes and takes under `smv_planner/CELL/...`.

Fields may come to be added; none that is here goes away within format 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from smv_planner.daemon.documents import FORMAT
from smv_planner.daemon.orders import ORDERS
from smv_planner.model.system import Kind
from smv_planner.runner.decision import Cause, Purpose
from smv_planner.runner.situation import Phase, Status, WishKind

Schema = dict[str, Any]

TEXT: Schema = {"type": "string"}
NUMBER: Schema = {"type": "number"}
COUNT: Schema = {"type": "integer", "minimum": 0}
YES: Schema = {"type": "boolean"}
TEXTS: Schema = {"type": "array", "items": TEXT}
VALUE: Schema = {"type": ["boolean", "integer", "string"]}
VALUES: Schema = {"type": "object", "additionalProperties": VALUE}
COUNTS: Schema = {"type": "object", "additionalProperties": COUNT}


def _object(**fields: Schema) -> Schema:
    return {"type": "object", "properties": fields, "required": list(fields)}


def _list(item: Schema) -> Schema:
    return {"type": "array", "items": item}


DATA: dict[str, Schema] = {
    "decision": _object(
        actions=_list(_object(name=TEXT, reached=YES, what=TEXT, ordinary=YES, seconds=NUMBER, reason=TEXT)),
    ),
    "fired": _object(transition=TEXT),
    "instruct": _object(transition=TEXT),
    "intention": _object(intention=TEXT, state=TEXT),
    "measured": {"type": "object", "properties": {"effects": TEXTS}},
    "operation": _object(operation=TEXT, state=TEXT),
}
"""What events of these kinds are about; other kinds, and other fields, are for people to read."""


def schemas() -> dict[str, Schema]:
    """One for each kind of document, by the last part of its key.

    `order` is for what goes in, and `accepted` what comes back; `missed` is how events are asked for at their key, and
    `events` the answer.
    """
    event = _document("event", number={**COUNT, "minimum": 1}, event=TEXT, text=TEXT, data={"type": "object"})
    event["allOf"] = [_with_data(word, data) for word, data in DATA.items()]
    return {
        "situation": _document(
            "situation",
            phase=_word(Phase),
            state={"type": "object", "additionalProperties": {"type": ["boolean", "integer", "string", "null"]}},
            resources=_each(
                _object(
                    status={"enum": ["live", "lost", "unheard"]},
                    boot=_or_null(TEXT),
                    epoch=_or_null(COUNT),
                    mirrors=YES,
                )
            ),
            intentions=_each({**_object(status=_word(Status)), "properties": {"status": _word(Status), "reason": TEXT}}),
            executing=TEXTS,
            failed={"type": "object", "additionalProperties": TEXT},
            disabled=TEXTS,
            lost=TEXTS,
            broken=TEXTS,
            planning={"enum": [*(cause.value for cause in Cause), None]},
            halted=_or_null(TEXT),
            stuck=_or_null(TEXT),
        ),
        "plan": _document(
            "plan",
            operations=_list(_object(name=TEXT, after=_list(COUNT), state={"enum": ["waiting", "executing", "done"]})),
            purpose={"enum": [*(purpose.value for purpose in Purpose), None]},
            steps=_list(_object(transition=TEXT, kind=_word(Kind), changes=VALUES, after=_list(COUNT), done=YES)),
        ),
        "operator": _document(
            "operator",
            requests=_list(
                _object(
                    request=TEXT,
                    kind=_word(WishKind),
                    answer={"enum": ["confirm", "approve"]},
                    text=TEXT,
                    transition=_or_null(TEXT),
                    values=VALUES,
                    confirmed=YES,
                )
            ),
        ),
        "event": event,
        "missed": {**_titled("missed"), "type": "object", "properties": {"planner": TEXT, "after": {"type": "integer"}}},
        "events": {**_titled("events"), **_list(event)},
        "health": _document(
            "health",
            healthy=YES,
            wrong=TEXTS,
            waiting=TEXTS,
            phase=_word(Phase),
            connected=YES,
            halted=_or_null(TEXT),
            worker_starts=COUNT,
            ticks=COUNT,
            tick_age=NUMBER,
            missed=COUNT,
            counts=COUNTS,
            rejected=COUNTS,
        ),
        "order": {**_titled("order"), "oneOf": [_order(word, field) for word, (_, field) in ORDERS.items()]},
        "accepted": {**_titled("accepted"), "oneOf": [_accepted(word, field) for word, (_, field) in ORDERS.items()]},
    }


def _with_data(word: str, data: Schema) -> Schema:
    """If it is an event of this kind, it has such data."""
    kind: Schema = {"type": "object", "properties": {"event": {"const": word}}}
    return {"if": kind, "then": {"type": "object", "properties": {"data": data}}}


def _order(word: str, field: str | None) -> Schema:
    schema = _object(order={"const": word}, **_needed(field))
    return {**schema, "properties": {"format": {"const": FORMAT}, **schema["properties"]}, "additionalProperties": False}


def _accepted(word: str, field: str | None) -> Schema:
    return _object(format={"const": FORMAT}, kind={"const": "accepted"}, order={"const": word}, **_needed(field))


def _needed(field: str | None) -> dict[str, Schema]:
    """What an order says besides its word."""
    if field is None:
        return {}
    return {field: {**VALUES, "minProperties": 1} if field == "values" else TEXT}


def _document(kind: str, **fields: Schema) -> Schema:
    head: dict[str, Schema] = {
        "format": {"const": FORMAT},
        "kind": {"const": kind},
        "cell": TEXT,
        "model": TEXT,
        "planner": TEXT,
        "epoch": COUNT,
        "at": NUMBER,
    }
    return {**_titled(kind), **_object(**head, **fields)}


def _titled(kind: str) -> Schema:
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": kind}


def _each(item: Schema) -> Schema:
    return {"type": "object", "additionalProperties": item}


def _or_null(schema: Schema) -> Schema:
    return {**schema, "type": [schema["type"], "null"]}


def _word(words: Sequence[Any] | Any) -> Schema:
    return {"enum": [word.value for word in words]}
