"""Dataclasses that are finished late are those of the standard library in all that the project uses."""

from __future__ import annotations

import copy
import dataclasses
import pickle
import weakref
from types import ModuleType
from typing import Any

import pytest

from smv_planner import lazy


def shapes(of: ModuleType) -> dict[str, Any]:
    @of.dataclass(frozen=True, slots=True)
    class Nothing: ...

    @of.dataclass(frozen=True, slots=True)
    class Slots:
        a: int
        b: tuple[int, ...] = (1, 2)
        c: dict[str, int] = of.field(default_factory=dict)
        d: str = of.field(default="d", compare=False)

        def __str__(self) -> str:
            return f"{self.a} and {self.b}"

    @of.dataclass(frozen=True)
    class Open:
        a: int
        b: tuple[int, ...] = (1, 2)
        c: dict[str, int] = of.field(default_factory=dict)

        def __post_init__(self) -> None:
            object.__setattr__(self, "seen", (self.a, self.b))

    @of.dataclass
    class Changing:
        a: int
        b: int = 2

    @of.dataclass(frozen=True, eq=False, slots=True, weakref_slot=True)
    class Identity:
        a: int

    return {each.__name__: each for each in (Nothing, Slots, Open, Changing, Identity)}


LATE, LIBRARY = shapes(lazy), shapes(dataclasses)
VALUES: dict[str, list[dict[str, Any]]] = {
    "Nothing": [{}],
    "Slots": [{"a": 1}, {"a": 1, "d": "e"}, {"a": 2, "b": ()}, {"a": 1, "c": {"x": 1}}, {"a": True}],
    "Open": [{"a": 1}, {"a": 1, "b": (1, 2)}, {"a": 2}],
    "Changing": [{"a": 1}, {"a": 1, "b": 2}, {"b": 1, "a": 2}],
    "Identity": [{"a": 1}, {"a": 1}],
}
NAMES = list(VALUES)


def outcome(function: Any, *arguments: Any, **named: Any) -> Any:
    try:
        return function(*arguments, **named)
    except Exception as error:
        return type(error), str(error)


@pytest.mark.parametrize("name", NAMES)
def test_values_look_and_compare_the_same(name: str) -> None:
    late, library = ([made(**each) for each in VALUES[name]] for made in (LATE[name], LIBRARY[name]))
    assert [repr(each) for each in late] == [repr(each) for each in library]
    assert [[a == b for b in late] for a in late] == [[a == b for b in library] for a in library]
    assert late[0] != library[0]
    if LIBRARY[name].__hash__ is not object.__hash__:
        assert [outcome(hash, each) for each in late] == [outcome(hash, each) for each in library]


@pytest.mark.parametrize("name", NAMES)
def test_wrong_arguments_are_refused_in_the_same_words(name: str) -> None:
    for arguments, named in [((), {"z": 1}), ((1, 2, 3, 4, 5, 6), {}), ((1,), {"a": 1})]:
        assert isinstance(outcome(LATE[name], *arguments, **named), tuple)
        assert outcome(LATE[name], *arguments, **named) == outcome(LIBRARY[name], *arguments, **named)


@pytest.mark.parametrize("name", NAMES)
def test_the_library_knows_them(name: str) -> None:
    late, library = LATE[name], LIBRARY[name]
    assert dataclasses.is_dataclass(late)
    kept = ("name", "type", "compare", "default", "default_factory", "init", "repr", "hash", "kw_only")
    described = [[[getattr(each, key) for key in kept] for each in dataclasses.fields(made)] for made in (late, library)]
    assert described[0] == described[1]
    assert late.__match_args__ == library.__match_args__
    values = VALUES[name][-1]
    assert dataclasses.asdict(late(**values)) == dataclasses.asdict(library(**values))
    if values:
        assert repr(dataclasses.replace(late(**values), a=7)) == repr(library(**{**values, "a": 7}))
        assert repr(lazy.replace(late(**values), a=7)) == repr(library(**{**values, "a": 7}))


def test_fields_tell_their_defaults() -> None:
    a, b, c, d = lazy.fields(LATE["Slots"])
    assert [each.name for each in (a, b, c, d)] == ["a", "b", "c", "d"]
    assert a.default is a.default_factory is lazy.MISSING
    assert (b.default, d.default, c.default_factory) == ((1, 2), "d", dict)
    assert lazy.is_dataclass(LATE["Open"])
    assert not lazy.is_dataclass(dict)


@pytest.mark.parametrize("name", ["Nothing", "Slots", "Open", "Identity"])
def test_frozen_values_do_not_change(name: str) -> None:
    value = LATE[name](**VALUES[name][0])
    for change in (lambda: setattr(value, "a", 2), lambda: setattr(value, "new", 2), lambda: delattr(value, "a")):
        with pytest.raises(dataclasses.FrozenInstanceError):
            change()
    assert repr(value) == repr(LIBRARY[name](**VALUES[name][0]))


def test_others_change() -> None:
    value = LATE["Changing"](1)
    value.b = 5
    assert value == LATE["Changing"](1, 5)


def test_slots_hold_nothing_else() -> None:
    assert not hasattr(LATE["Slots"](1), "__dict__")
    assert LATE["Slots"].__slots__ == LIBRARY["Slots"].__slots__
    identity = LATE["Identity"](1)
    assert weakref.ref(identity)() is identity


def test_a_factory_makes_each_value_its_own() -> None:
    one, other = LATE["Slots"](1), LATE["Slots"](1)
    one.c["x"] = 1
    assert other.c == {}


def test_what_follows_the_making_is_called() -> None:
    assert LATE["Open"](1, b=(3,)).seen == (1, (3,))


@pytest.mark.parametrize("number", range(2, pickle.HIGHEST_PROTOCOL + 1))
def test_they_travel_between_processes(number: int) -> None:
    for value in (Travelling(1, (2,)), TravellingOpen(1, (2,))):
        assert pickle.loads(pickle.dumps(value, number)) == value
        assert copy.deepcopy(value) == value


def test_patterns_read_them() -> None:
    match Travelling(1, (2,)):
        case Travelling(a, (b,)):
            assert (a, b) == (1, 2)
        case _:
            pytest.fail("no pattern fits")


def test_methods_of_its_own_are_not_overwritten_in_silence() -> None:
    with pytest.raises(AssertionError, match="methods of its own"):

        @lazy.dataclass(frozen=True)
        class Own:
            a: int

            def __repr__(self) -> str:
                return "own"


def test_inherited_fields_are_not_lost_in_silence() -> None:
    with pytest.raises(AssertionError, match="inherits fields"):

        @lazy.dataclass(frozen=True)
        class More(Travelling):
            c: int


@lazy.dataclass(frozen=True, slots=True)
class Travelling:
    a: int
    b: tuple[int, ...]


@lazy.dataclass(frozen=True)
class TravellingOpen:
    a: int
    b: tuple[int, ...]
