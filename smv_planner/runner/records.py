"""What the journal holds, as JSON: every event the runner was told, and its situation where a journal begins anew.

The dataclasses of `events` and `situation` are the one description of the format: each becomes an object of its fields
without those that have their defaults, and an alternative of a union says as `is` which one it is. Two things are
stored by what they are made from. A task is its name. A plan is its steps and states, its order and the operations it
was made for; the kernel checks it again when it is read, so that not even a journal makes a plan of what is none.
"""

from __future__ import annotations

import json
import types
import typing
from collections.abc import Callable, Iterable, Mapping
from enum import StrEnum
from functools import cache
from typing import Any, NoReturn, TypeVar

from smv_planner.check import Refused, check_plan
from smv_planner.check.order import Order
from smv_planner.errors import SmvPlannerError
from smv_planner.lazy import MISSING, dataclass, fields, is_dataclass, replace
from smv_planner.model.model import Model
from smv_planner.model.system import State, System
from smv_planner.planner.operations import Task, tasks
from smv_planner.problem import Problem, Reached
from smv_planner.runner.decision import Following, Request
from smv_planner.runner.events import Event
from smv_planner.runner.posed import Widen, posed
from smv_planner.runner.situation import Situation, Station
from smv_planner.runner.step import step

Entry = Event | Situation
"""What a record says. A situation stands for everything before it."""


class Unreadable(SmvPlannerError):
    """A record says nothing that this program and this model could have written."""


@dataclass(frozen=True, eq=False)
class Known:
    """What records are read against: the model, and how its invariants are widened."""

    model: Model
    widen: Widen


def record(entry: Entry) -> bytes:
    """The same bytes for the same entry."""
    return _TO_JSON.encode(_codec(Entry).said(entry)).encode("ascii")


def entry(payload: bytes, known: Known) -> Entry:
    """What a record says. Raises Unreadable."""
    return _understood(Entry, payload, known)  # type: ignore[no-any-return]


def question(request: Request) -> bytes:
    """A question to planners in another process."""
    return _TO_JSON.encode(_codec(Request).said(request)).encode("ascii")


def asked(payload: bytes, known: Known) -> Request:
    """What was asked. Raises Unreadable."""
    return _understood(Request, payload, known)  # type: ignore[no-any-return]


def restored(station: Station, begun: Situation, payloads: Iterable[bytes], known: Known) -> Situation:
    """The situation after all that a journal holds; `begun` is the one before anything. What was put out is not put out again."""
    now = begun
    for payload in payloads:
        match entry(payload, known):
            case Situation() as situation:
                now = situation
            case event:
                now, _ = step(station, now, event)
    return now


def _understood(hint: Any, payload: bytes, known: Known) -> Any:
    try:
        return _codec(hint).meant(json.loads(payload, parse_constant=_no_number), known)
    except (ValueError, TypeError, LookupError, RecursionError) as error:
        raise Unreadable(f"this is no record of this model: {type(error).__name__}: {error}") from error


_TO_JSON = json.JSONEncoder(ensure_ascii=True, allow_nan=False, separators=(",", ":"))


def _no_number(word: str) -> NoReturn:
    raise ValueError(f"{word} is no value")


# --- values, led by their type hints --------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Codec:
    """What a value becomes in JSON, and what is meant by that."""

    said: Callable[[Any], Any]
    meant: Callable[[Any, Known], Any]


@cache
def _codec(hint: Any) -> _Codec:
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return _one_of(arguments)
    if origin is tuple and arguments[1:] == (...,):
        item = _codec(arguments[0])
        return _Codec(
            lambda value: [item.said(each) for each in value],
            lambda said, known: tuple(item.meant(each, known) for each in _a(list, said)),
        )
    if origin is tuple:
        items = [_codec(each) for each in arguments]
        return _Codec(
            lambda value: [each.said(part) for each, part in zip(items, value, strict=True)],
            lambda said, known: tuple(each.meant(part, known) for each, part in zip(items, _a(list, said), strict=True)),
        )
    if origin is frozenset:
        item = _codec(arguments[0])
        return _Codec(
            lambda value: [item.said(each) for each in sorted(value)],
            lambda said, known: frozenset(item.meant(each, known) for each in _a(list, said)),
        )
    if origin is Mapping:
        assert arguments[0] is str, hint
        item = _codec(arguments[1])
        return _Codec(
            dict if item.said is _itself else lambda value: {name: item.said(each) for name, each in value.items()},
            lambda said, known: {name: item.meant(each, known) for name, each in _a(dict, said).items()},
        )
    if hint is Task:
        return _Codec(lambda task: task.name, _task)
    if hint is Following:
        return _Codec(_following_said, _following_meant)
    if is_dataclass(hint):
        return _fields_of(hint)
    if hint is float:
        return _Codec(float, lambda said, known: float(_a(float, said)))
    if issubclass(hint, StrEnum):
        return _Codec(str, lambda said, known: hint(said))
    assert hint in (bool, int, str), hint
    return _Codec(_itself, lambda said, known: _a(hint, said))


def _itself(value: Any) -> Any:
    return value


def _one_of(hints: tuple[Any, ...]) -> _Codec:
    """An alternative. Only dataclasses say which one they are: JSON tells the others apart."""
    options = tuple(each for each in hints if each is not types.NoneType)
    one = _codec(options[0]) if len(options) == 1 else _named(options) if is_dataclass(options[0]) else _plain(options)
    if len(options) == len(hints):
        return one
    return _Codec(
        lambda value: None if value is None else one.said(value),
        lambda said, known: None if said is None else one.meant(said, known),
    )


def _named(options: tuple[Any, ...]) -> _Codec:
    names = {each.__name__: each for each in options}

    def meant(said: Any, known: Known) -> Any:
        rest = dict(_a(dict, said))
        return _codec(names[rest.pop("is")]).meant(rest, known)

    return _Codec(lambda value: {"is": type(value).__name__, **_codec(names[type(value).__name__]).said(value)}, meant)


def _plain(options: tuple[Any, ...]) -> _Codec:
    return _Codec(_itself, lambda said, known: _a(options, said))


def _fields_of(made: Any) -> _Codec:
    """An object of the fields that have not their defaults. Fields are looked up late: a formula has formulas in it."""

    @cache
    def described() -> dict[str, tuple[_Codec, Any]]:
        hints = typing.get_type_hints(made)
        return {each.name: (_codec(hints[each.name]), _default(each)) for each in fields(made)}

    def said(value: Any) -> dict[str, Any]:
        found = {}
        for name, (codec, default) in described().items():
            part = getattr(value, name)
            if part != default:
                found[name] = codec.said(part)
        return found

    def meant(said: Any, known: Known) -> Any:
        codecs = described()
        return made(**{name: codecs[name][0].meant(part, known) for name, part in _a(dict, said).items()})

    return _Codec(said, meant)


def _default(field: Any) -> Any:
    if field.default_factory is not MISSING:
        return field.default_factory()
    return field.default


T = TypeVar("T")


def _a(kind: Any, said: T) -> T:
    """`said` itself, if it is of that kind. In JSON true is no number, and 1.0 is no whole one."""
    kinds = kind if isinstance(kind, tuple) else (kind,)
    if type(said) not in kinds:
        raise TypeError(f"expected {' or '.join(each.__name__ for each in kinds)}, not {str(said)[:40]}")
    return said


# --- tasks and plans ------------------------------------------------------------------------------------


def _task(said: Any, known: Known) -> Task:
    return next((task for task in tasks(known.model) if task.name == said), None) or _unknown(f"there is no task '{said}'")


def _unknown(what: str) -> NoReturn:
    raise ValueError(what)


_KEPT = ("purpose", "done", "lifted", "approved", "operations")
"""What a plan that is followed says besides the plan itself."""


@cache
def _kept() -> tuple[tuple[str, _Codec], ...]:
    hints = typing.get_type_hints(Following)
    assert {each.name for each in fields(Following)} == {"plan", *_KEPT}
    return tuple((name, _codec(hints[name])) for name in _KEPT)


def _following_said(following: Following) -> dict[str, Any]:
    plan, problem = following.plan, following.plan.problem
    states = plan.trace.states
    return {
        **{name: codec.said(getattr(following, name)) for name, codec in _kept()},
        "bound": problem.bound,
        "unusable": sorted(problem.unusable),
        "initial": list(states[0]),
        "steps": [
            [name, problem.system.changes(before, after)]
            for name, before, after in zip(plan.trace.path, states, states[1:], strict=False)
        ],
        "after": plan.after,
        "partial": plan.partial,
        "argument": plan.trace.argument,
    }


def _following_meant(said: Any, known: Known) -> Following:
    kept = {name: codec.meant(said[name], known) for name, codec in _kept()}
    initial = _state(known.model.system, said["initial"])
    problem = posed(known.model, known.widen, kept["purpose"], initial, kept["operations"], kept["lifted"])
    problem = replace(problem, unusable=frozenset(said["unusable"]), bound=_a(int, said["bound"]))
    trace = Reached(tuple(name for name, _ in said["steps"]), tuple(_states(problem, said["steps"])), said["argument"])
    after = tuple(tuple(_a(int, each) for each in waits) for waits in said["after"])
    checked = check_plan(problem, trace, [_closed(after)] if said["partial"] else ())
    if isinstance(checked, Refused):
        _unknown(f"the checker refuses its plan: {checked.reason}")
    if (checked.after, checked.partial) != (after, said["partial"]):
        _unknown("the checker refuses the order of its plan")
    return Following(checked, **kept)


def _state(system: System, values: Any) -> State:
    if not all(value in variable.domain for variable, value in zip(system.variables, values, strict=True)):
        _unknown("a state has a value that lies in no domain")
    return tuple(values)


def _states(problem: Problem, steps: Iterable[tuple[str, Mapping[str, Any]]]) -> Iterable[State]:
    state = problem.initial
    yield state
    for _, changes in steps:
        values = list(state)
        for name, value in changes.items():
            values[problem.system.index[name]] = value
        state = _state(problem.system, values)
        yield state


def _closed(after: tuple[tuple[int, ...], ...]) -> Order:
    """For each step all that come before it, from those it directly waits for."""
    order: list[int] = []
    for at, waits in enumerate(after):
        if any(not 0 <= other < at for other in waits):
            _unknown("a step waits for a later one")
        before = 0
        for other in waits:
            before |= order[other] | 1 << other
        order.append(before)
    return tuple(order)
