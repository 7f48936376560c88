"""Goal and state messages, and their only form on the wire: canonical JSON in ASCII.

Decoding trusts nothing. Whatever the bytes are, the answer is a message that fits the interface in every field, or a
`Rejected` with its reason; nothing raises. JSON has more values than we have: fractions, NaN and infinities are refused
while scanning, a Boolean is no number (in Python `True == 1`), and the same key twice is an error, not a choice.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from enum import StrEnum
from typing import Any, NoReturn

from smv_planner.lazy import dataclass
from smv_planner.model.domains import Domain, Value
from smv_planner.protocol.interface import Interface

FORMAT = 1
MAX_BYTES = 64 * 1024
MAX_COUNT = 2**53 - 1
"""Epochs and sequence numbers end here: the last number that a hub in any language reads exactly."""


@dataclass(frozen=True, slots=True)
class GoalMessage:
    """The whole goal state of one resource: what the planner `planner` asks of it in its reign `epoch`.

    `seq` grows with every change; the same message again says only that the planner is still there.
    """

    cell: str
    resource: str
    epoch: int
    seq: int
    planner: str
    model: str
    values: Mapping[str, Value]


@dataclass(frozen=True, slots=True)
class StateMessage:
    """The whole measured state of one resource, and as `mirror` the goal values that its hub obeys now.

    `epoch`, `goal_seq` and `planner` are those of the newest goal message accepted: 0, 0 and "" before any. `boot` is
    new each time the hub starts, and `seq` grows with every message of a boot.
    """

    cell: str
    resource: str
    boot: str
    seq: int
    model: str
    measured: Mapping[str, Value]
    mirror: Mapping[str, Value]
    epoch: int
    goal_seq: int
    planner: str


class Reason(StrEnum):
    """Why a message changes nothing; each is worth a counter. The last four are the hub's, about well-formed goals."""

    OVERSIZE = "oversize"
    MALFORMED = "malformed"  # not one JSON object as documented
    NUMBER = "number"  # a fraction, NaN, an infinity, -0, or more digits than any count has
    REPEATED_KEY = "repeated_key"
    FORMAT = "format"  # another version, or another kind of message
    FIELDS = "fields"  # one is missing, or one is unknown
    TYPE = "type"
    FOREIGN = "foreign"  # of another cell or resource
    MODEL = "model"  # made for another version of the model
    VARIABLES = "variables"  # one is missing, or one is unknown
    DOMAIN = "domain"
    OLD_EPOCH = "old_epoch"  # of a planner that was superseded
    OTHER_PLANNER = "other_planner"  # two planners claim the same epoch: the first stays
    OLD = "old"  # overtaken by a newer message of the same planner
    CONFLICT = "conflict"  # the same sequence number with other values


@dataclass(frozen=True, slots=True)
class Rejected:
    """`detail` is for people and of bounded length."""

    reason: Reason
    detail: str


def encode(message: GoalMessage | StateMessage) -> bytes:
    """The same bytes for the same message, variables in the order of its mappings."""
    match message:
        case GoalMessage():
            fields: dict[str, object] = {
                "format": FORMAT,
                "kind": "goal",
                "cell": message.cell,
                "resource": message.resource,
                "epoch": message.epoch,
                "seq": message.seq,
                "planner": message.planner,
                "model": message.model,
                "values": dict(message.values),
            }
        case StateMessage():
            fields = {
                "format": FORMAT,
                "kind": "state",
                "cell": message.cell,
                "resource": message.resource,
                "boot": message.boot,
                "seq": message.seq,
                "model": message.model,
                "measured": dict(message.measured),
                "mirror": dict(message.mirror),
                "epoch": message.epoch,
                "goal_seq": message.goal_seq,
                "planner": message.planner,
            }
    return _TO_JSON.encode(fields).encode("ascii")


def decode_goal(payload: bytes, interface: Interface) -> GoalMessage | Rejected:
    """What a hub makes of bytes. Its values stand in the order of the interface."""
    try:
        fields = _fields(payload, "goal", _GOAL_FIELDS, interface)
        return GoalMessage(
            interface.cell,
            interface.resource,
            _count(fields, "epoch", 1),
            _count(fields, "seq", 1),
            _identity(fields, "planner"),
            interface.model,
            _values(fields["values"], interface.goals),
        )
    except _Refusal as refusal:
        return refusal.why


def decode_state(payload: bytes, interface: Interface) -> StateMessage | Rejected:
    """What the planner makes of bytes. Its values stand in the order of the interface."""
    try:
        fields = _fields(payload, "state", _STATE_FIELDS, interface)
        epoch = _count(fields, "epoch", 0)
        goal_seq = _count(fields, "goal_seq", 1 if epoch else 0)
        if not epoch and (goal_seq or fields["planner"] != ""):
            _refuse(Reason.FIELDS, "epoch 0 means that no goal was accepted yet")
        return StateMessage(
            interface.cell,
            interface.resource,
            _identity(fields, "boot"),
            _count(fields, "seq", 1),
            interface.model,
            _values(fields["measured"], interface.measured),
            _values(fields["mirror"], interface.goals),
            epoch,
            goal_seq,
            _identity(fields, "planner") if epoch else "",
        )
    except _Refusal as refusal:
        return refusal.why


class _Refusal(Exception):
    def __init__(self, why: Rejected) -> None:
        self.why = why


def _refuse(reason: Reason, detail: str) -> NoReturn:
    raise _Refusal(Rejected(reason, detail if len(detail) <= 200 else f"{detail[:200]}..."))


def _fields(payload: bytes, kind: str, expected: frozenset[str], interface: Interface) -> dict[str, Any]:
    """The members of a message of this kind that is meant for this interface; their values are still unchecked."""
    if len(payload) > MAX_BYTES:
        _refuse(Reason.OVERSIZE, f"{len(payload)} bytes, at most {MAX_BYTES} are read")
    # Counted before parsing, so that no nesting gets near the limits of the interpreter.
    if payload.count(b"{") + payload.count(b"[") > _MAX_BRACKETS:
        _refuse(Reason.MALFORMED, "more brackets than any message has")
    try:
        fields = _FROM_JSON.decode(payload.decode("ascii"))
    except ValueError as error:  # of either decoder
        _refuse(Reason.MALFORMED, str(error))
    if type(fields) is not dict:
        _refuse(Reason.MALFORMED, "not an object")
    if type(fields.get("format")) is not int or fields["format"] != FORMAT or fields.get("kind") != kind:
        _refuse(Reason.FORMAT, f"expected format {FORMAT}, kind '{kind}'")
    if fields.keys() != expected:
        _refuse(Reason.FIELDS, _difference(fields.keys(), expected))
    for name, ours in (("cell", interface.cell), ("resource", interface.resource), ("model", interface.model)):
        if type(fields[name]) is not str:
            _refuse(Reason.TYPE, f"'{name}' is not text")
        if fields[name] != ours:
            _refuse(Reason.MODEL if name == "model" else Reason.FOREIGN, f"{name} {fields[name]!a}, ours is {ours!a}")
    return fields


def _values(found: object, expected: Mapping[str, Domain]) -> dict[str, Value]:
    if type(found) is not dict:
        _refuse(Reason.TYPE, "values are not an object")
    if found.keys() != expected.keys():
        _refuse(Reason.VARIABLES, _difference(found.keys(), expected.keys()))
    for name, domain in expected.items():
        if found[name] not in domain:
            kinds = {type(value) for value in domain.values}
            reason = Reason.DOMAIN if type(found[name]) in kinds else Reason.TYPE
            _refuse(reason, f"'{name}' cannot be {found[name]!a:.80}")
    return {name: found[name] for name in expected}


def _count(fields: Mapping[str, Any], name: str, least: int) -> int:
    number = fields[name]
    if type(number) is not int:
        _refuse(Reason.TYPE, f"'{name}' is not a number")
    if not least <= number <= MAX_COUNT:
        _refuse(Reason.NUMBER, f"'{name}' is {number}, not between {least} and {MAX_COUNT}")
    return number


def _identity(fields: Mapping[str, Any], name: str) -> str:
    word = fields[name]
    if type(word) is not str:
        _refuse(Reason.TYPE, f"'{name}' is not text")
    if not _IDENTITY.fullmatch(word):
        _refuse(Reason.FIELDS, f"'{name}' is not 1 to 64 letters, digits, '_', '.' or '-'")
    return word


def _difference(found: Any, expected: Any) -> str:
    """What is missing and what is unknown, each in an order that does not depend on the process."""
    missing, unknown = sorted(expected - found), sorted(found - expected)
    return f"missing: {missing[:5]}, unknown: {unknown[:5]!a}"


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    members = dict(pairs)
    if len(members) != len(pairs):
        _refuse(Reason.REPEATED_KEY, "a key stands twice in an object")
    return members


def _integer(digits: str) -> int:
    if len(digits) > 17 or digits == "-0":
        _refuse(Reason.NUMBER, f"{digits[:40]} is not a number of ours")
    return int(digits)


def _no_number(text: str) -> NoReturn:
    _refuse(Reason.NUMBER, f"{text[:40]} is not an integer")


_TO_JSON = json.JSONEncoder(ensure_ascii=True, allow_nan=False, separators=(",", ":"))
_FROM_JSON = json.JSONDecoder(object_pairs_hook=_object, parse_int=_integer, parse_float=_no_number, parse_constant=_no_number)
_MAX_BRACKETS = 64
_IDENTITY = re.compile(r"[A-Za-z0-9_.-]{1,64}")
_GOAL_FIELDS = frozenset(["format", "kind", "cell", "resource", "epoch", "seq", "planner", "model", "values"])
_STATE_FIELDS = frozenset(
    ["format", "kind", "cell", "resource", "boot", "seq", "model", "measured", "mirror", "epoch", "goal_seq", "planner"]
)
