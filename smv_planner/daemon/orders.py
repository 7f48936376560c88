"""Orders from outside as JSON: strict on the way in, for anybody on the network may send anything.

An order is an object with `order`, one of the words of `ORDERS`, what that word needs, and `format` if one likes. What
cannot mean anything at the moment is refused with the reason; the runner itself ignores it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from smv_planner.daemon.documents import FORMAT
from smv_planner.errors import Mistake, UsageError, did_you_mean
from smv_planner.model.domains import Value
from smv_planner.model.system import VariableKind
from smv_planner.planner.operations import tasks
from smv_planner.runner.events import Activate, Approve, Assign, Cancel, Confirm, Order, Pause, Proceed, Reenable
from smv_planner.runner.situation import Phase, Situation, Station, WishKind

ORDERS: Mapping[str, tuple[type[Order], str | None]] = {
    "start": (Activate, "intention"),
    "pause": (Pause, "intention"),
    "cancel": (Cancel, "name"),
    "set": (Assign, "values"),
    "confirm": (Confirm, "request"),
    "approve": (Approve, "request"),
    "reenable": (Reenable, "name"),
    "proceed": (Proceed, None),
}
"""For each word what it means, and the one field that it needs besides."""


def said(order: Order) -> dict[str, Any]:
    """An order as JSON."""
    word, name = next((word, name) for word, (kind, name) in ORDERS.items() if kind is type(order))
    if name is None:
        return {"order": word}
    value = getattr(order, name)
    return {"order": word, name: dict(value) if isinstance(value, Mapping) else value}


def meant(payload: bytes, station: Station, now: Situation) -> Order:
    """What is ordered. Raises UsageError if nothing could come of it."""
    try:
        told = json.loads(payload.decode("utf-8"), object_pairs_hook=_once)
    except (ValueError, RecursionError) as error:
        raise refused(f"this is not JSON: {error}") from error
    word = told.get("order") if type(told) is dict else None
    if type(word) is not str or word not in ORDERS:
        raise refused("this is no order", "an object with 'order', one of " + ", ".join(ORDERS))
    kind, name = ORDERS[word]
    form = told.pop("format", FORMAT)
    if type(form) is not int or form != FORMAT:
        raise refused(f"orders of another format are not understood, only of {FORMAT}")
    if told.keys() != {"order", *([name] if name else [])}:
        raise refused(f"'{word}' has other fields", f"it has '{name}' alone" if name else "it has none")
    if now.phase is Phase.FENCED_OUT:
        raise refused("another planner has taken over; ask that one")
    if kind is Assign:
        return Assign(_values(told["values"], station))
    if name is None:
        return Proceed()
    about = told[name]
    if type(about) is not str:
        raise refused(f"'{name}' is not text")
    _check(kind, about, station, now)
    make: Callable[[str], Order] = kind
    return make(about)


def after(payload: bytes, planner: str) -> int:
    """Which events of this planner somebody has, who asks for those after `{"planner": NAME, "after": NUMBER}`.

    Raises UsageError.
    """
    try:
        told = json.loads(payload or b"{}")
        number = told.get("after", 0) if told.get("planner", planner) == planner else 0
    except (ValueError, RecursionError, AttributeError) as error:
        raise refused("this does not say after which event", 'as in {"planner": "planner-1", "after": 12}') from error
    if type(number) is not int:
        raise refused("'after' is no number")
    return number


def _check(kind: type[Order], name: str, station: Station, now: Situation) -> None:
    if kind in (Activate, Pause):
        _known(name, now.intentions, "intention")
    elif kind is Cancel:
        running = [execution.task.operation.name for execution in now.executing]
        _known(name, [*now.intentions, *running], "intention, and no operation that executes, named")
    elif kind is Reenable:
        gone = [*now.disabled, *now.lost, *now.failed]
        operations = [task.operation.name for task in tasks(station.model) if task.name in now.failed]
        _known(name, [*gone, *operations, *now.intentions], "effect, resource, operation or intention given up named")
    else:
        kinds = [WishKind.MAINTENANCE] if kind is Confirm else [each for each in WishKind if each is not WishKind.MAINTENANCE]
        _known(name, [request for request, wish in now.wishes.items() if wish.kind in kinds], "open request")


def _values(said: object, station: Station) -> dict[str, Value]:
    if type(said) is not dict or not said:
        raise refused("'values' is an object of variables and their values")
    mine = (VariableKind.DECISION, VariableKind.ESTIMATED)
    own = {v.name: v for v in station.model.variables if v.kind in mine}
    for name, value in said.items():
        _known(name, own, "decision or estimated variable")
        if value not in own[name].domain:
            raise refused(f"{value!r:.80} is no value of '{name}'", f"its domain is {own[name].domain}")
    return said


def _known(name: str, known: Iterable[str], what: str) -> None:
    names = list(known)
    if name not in names:
        raise refused(f"there is no {what} '{name:.80}'", did_you_mean(name, names) or ", ".join(names[:8]) or "there is none")


def refused(text: str, hint: str | None = None) -> UsageError:
    """To be raised: why something asked from outside is not done."""
    return UsageError([Mistake(text, hint)])


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    members = dict(pairs)
    if len(members) != len(pairs):
        raise ValueError("a key stands twice in an object")
    return members
