"""Goal and state messages as somebody reads them who has no scenario: well-formed, of whatever resource and model.

Nothing here is acted upon. Hubs and planners decode against their interface (`smv_planner.protocol.messages`).
"""

from __future__ import annotations

import json
from typing import Any, NoReturn

from bridge.link import MAX_BYTES
from smv_planner.model.domains import Value
from smv_planner.protocol.messages import GoalMessage, StateMessage

MAX_BRACKETS = 64
MAX_WORD = 200


def overheard(payload: bytes) -> GoalMessage | StateMessage | None:
    """The message, or None if it is none."""
    if len(payload) > MAX_BYTES or payload.count(b"{") + payload.count(b"[") > MAX_BRACKETS:
        return None
    try:
        found = json.loads(payload.decode("ascii"), parse_float=_refuse, parse_constant=_refuse)
        match found:
            case {"format": 1, "kind": "goal"}:
                return GoalMessage(
                    _word(found, "cell"),
                    _word(found, "resource"),
                    _count(found, "epoch"),
                    _count(found, "seq"),
                    _word(found, "planner"),
                    _word(found, "model"),
                    _values(found, "values"),
                )
            case {"format": 1, "kind": "state"}:
                return StateMessage(
                    _word(found, "cell"),
                    _word(found, "resource"),
                    _word(found, "boot"),
                    _count(found, "seq"),
                    _word(found, "model"),
                    _values(found, "measured"),
                    _values(found, "mirror"),
                    _count(found, "epoch"),
                    _count(found, "goal_seq"),
                    _word(found, "planner"),
                )
    except (ValueError, KeyError):
        return None
    return None


def _word(found: dict[str, Any], name: str) -> str:
    if type(found[name]) is not str or len(found[name]) > MAX_WORD:
        raise ValueError
    word: str = found[name]
    return word


def _count(found: dict[str, Any], name: str) -> int:
    if type(found[name]) is not int or not 0 <= found[name] < 2**53:
        raise ValueError
    count: int = found[name]
    return count


def _values(found: dict[str, Any], name: str) -> dict[str, Value]:
    if type(found[name]) is not dict or not all(type(value) in (bool, int, str) for value in found[name].values()):
        raise ValueError
    values: dict[str, Value] = found[name]
    return values


def _refuse(text: str) -> NoReturn:
    raise ValueError(text)
