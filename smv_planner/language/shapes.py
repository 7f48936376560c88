"""What a document is made of: the shapes that its parts may have.

The dataclasses in `document` say with their type hints what a scenario looks like. `shape_of` turns those hints into
shapes, which the reader checks a text against.
"""

from __future__ import annotations

import types
import typing
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Annotated, Any, Literal, NamedTuple

from smv_planner.lazy import MISSING, fields, is_dataclass


class Text(NamedTuple):
    """Text of one kind: how messages call it, and the pattern that the whole of it matches, if there is one."""

    called: str
    pattern: str = ""
    hint: str | None = None
    reads: Literal["", "condition", "formula"] = ""
    """What the text is read as, if it is an expression."""


class Whole(NamedTuple):
    """A whole number from `low` to `high`."""

    low: int
    high: int


class Truth(NamedTuple):
    """`true` or `false`."""


class Choice(NamedTuple):
    """One of a few words."""

    words: tuple[str, ...]


class ListOf(NamedTuple):
    item: Shape


class Table(NamedTuple):
    """Any number of entries, with keys that the author chooses."""

    key: Text
    value: Shape


class Entry(NamedTuple):
    """One key of a record and the attribute of the dataclass that it becomes."""

    key: str
    attribute: str
    shape: Shape
    required: bool


class Record(NamedTuple):
    """An entry for each field of a dataclass. These are asked for when they are needed: a record may hold itself."""

    made: type

    @property
    def entries(self) -> tuple[Entry, ...]:
        return _entries(self.made)


class OneOf(NamedTuple):
    """The first of several shapes that fits."""

    shapes: tuple[Shape, ...]


Shape = Text | Whole | Truth | Choice | ListOf | Table | Record | OneOf


@cache
def shape_of(hint: Any) -> Shape:
    """The shape that a type hint stands for. `X | None` is the shape of X: what may be left out is a field with a default."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin is Annotated:
        return next(each for each in arguments[1:] if isinstance(each, Text | Whole))
    if origin in (typing.Union, types.UnionType):
        shapes = tuple(shape_of(each) for each in arguments if each is not types.NoneType)
        return shapes[0] if len(shapes) == 1 else OneOf(shapes)
    if origin is Literal:
        return Choice(arguments)
    if origin is Mapping:
        key = shape_of(arguments[0])
        assert isinstance(key, Text)
        return Table(key, shape_of(arguments[1]))
    if origin is Sequence:
        return ListOf(shape_of(arguments[0]))
    if is_dataclass(hint) and isinstance(hint, type):
        return Record(hint)
    assert hint is bool, hint
    return Truth()


@cache
def _entries(made: Any) -> tuple[Entry, ...]:
    hints = typing.get_type_hints(made, include_extras=True)
    return tuple(Entry(each.name.rstrip("_"), each.name, shape_of(hints[each.name]), _required(each)) for each in fields(made))


def _required(each: Any) -> bool:
    return each.default is MISSING and each.default_factory is MISSING


def called(shape: Shape) -> str:
    """What a shape is, in a message: 'expected a name'."""
    match shape:
        case Text(name, _, _):
            return name
        case Whole(low, high):
            return f"a whole number from {low} to {high}"
        case Truth():
            return "true or false"
        case Choice(words):
            return f"'{words[0]}'" if len(words) == 1 else "one of " + ", ".join(words)
        case ListOf(item):
            return f"a list [{called(item)}, ...]"
        case Table(key, _):
            return f"a mapping with {key.called} before each ':'"
        case Record() as record:
            return "a mapping {" + ", ".join(each.key + ": ..." for each in record.entries) + "}"
        case OneOf(shapes):
            return " or ".join(called(each) for each in shapes)
