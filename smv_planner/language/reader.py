"""Nodes -> Document, and the report of what is wrong where.

One function reads everything, led by the shapes of `document`. What cannot be read becomes `UNREADABLE`, once reported;
everything else is read on, and nobody says anything more about that part.
"""

from __future__ import annotations

import re
from collections.abc import Mapping as AnyMapping
from collections.abc import Sequence as AnySequence
from typing import Any

from smv_planner.errors import Mistake, Place, did_you_mean
from smv_planner.language.document import EXPANDED, MAX_NAME
from smv_planner.language.shapes import Choice, ListOf, OneOf, Record, Shape, Table, Text, Truth, Whole, called
from smv_planner.language.strict_yaml import MAX_DEPTH, MAX_MISTAKES, Broken, Mapping, Node, Scalar, Sequence, place
from smv_planner.lazy import fields, is_dataclass, replace

Path = tuple[str, ...]
"""The way from the root of a document to one of its parts, as keys."""

MAX_COMPARED = 100_000

UNREADABLE: Any = type("Unreadable", (), {"__repr__": lambda self: "UNREADABLE"})()
"""Stands in a document for a part that could not be read and has been reported."""

_QUOTED = re.compile(r"'[^']*'|\{[^}]*\}")
_WHOLE = re.compile(r"0|-?[1-9][0-9]{0,9}")
_TRUE_OR_FALSE = {"true": True, "false": False}
_ALMOST_TRUTH = {"on": True, "yes": True, "True": True, "TRUE": True, "off": False, "no": False, "False": False, "FALSE": False}


class Report:
    """Where every part of a document stands, and what is wrong with it so far."""

    def __init__(self, mistakes: list[Mistake]) -> None:
        self.nodes: dict[Path, Node] = {}
        self.keys: dict[Path, Scalar] = {}
        self.holes: set[Path] = set()
        """Tables of which entries are missing because of a mistake: no name in them counts as unknown."""
        self._found: dict[Mistake, tuple[Path, int]] = dict.fromkeys(mistakes, ((), 0))
        self._left_out = 0
        self._compared = 0

    def wrong(self, path: Path, message: str, hint: str | None = None, at: tuple[int, int] | None = None) -> None:
        """Note a mistake in the value at `path`; `at` is where in the value it starts and ends."""
        if self._full():
            return
        node = self.nodes.get(path)
        where = place(node, at[0], at[1] - at[0]) if node and at else place(node) if node else None
        self._note(path, message, hint, where, at[0] if at else 0)

    def wrong_key(self, path: Path, message: str, hint: str | None = None, key: Scalar | None = None) -> None:
        """Note a mistake in the key before the value at `path`, or in another key of that name."""
        if not self._full():
            node = key or self.keys.get(path) or self.nodes.get(path)
            self._note(path, message, hint, place(node) if node else None, -1)

    def wrong_in(self, node: Node, message: str, hint: str | None = None, at: tuple[int, int] | None = None) -> None:
        """Note a mistake in a node of a text that is no part of a document yet; `at` is where it starts and ends."""
        if not self._full():
            self._note((), message, hint, place(node, at[0], at[1] - at[0]) if at else place(node), 0)

    def prefix(self, path: Path) -> str:
        """What stands before names in the value at `path` if it is from a template that is used under a name of its own."""
        node = self.nodes.get(path)
        return node.span.instance.prefix if node and node.span and node.span.instance else ""

    def line_of(self, path: Path) -> str | None:
        """A hint where the value at `path` is, if it is in a text."""
        return other_one(self.keys[path]) if path in self.keys else None

    def in_order(self, one: Path, other: Path) -> tuple[Path, Path]:
        """The two in the order of the text, if there is one."""
        a, b = (place(self.keys[path]) if path in self.keys else None for path in (one, other))
        return (other, one) if a and b and (a.line, a.column) > (b.line, b.column) else (one, other)

    def empty(self, path: Path) -> bool:
        """Whether the text has no entries there, not even wrong ones."""
        node = self.nodes.get(path, Scalar("", True))
        return isinstance(node, Scalar) or (isinstance(node, Mapping) and not node.entries and not node.dropped)

    @property
    def full(self) -> bool:
        """Whether there are so many mistakes that no more are noted."""
        return len(self._found) >= MAX_MISTAKES

    def close(self, word: str, known: AnySequence[str]) -> str | None:
        """A 'did you mean' for `word`. Only so many words are compared, for that is slow."""
        self._compared += len(known)
        return closest(word, known) if self._compared <= MAX_COMPARED and len(word) <= MAX_NAME else None

    @property
    def mistakes(self) -> tuple[Mistake, ...]:
        """Every mistake once, in the order of the text."""
        order = {path: at for at, path in enumerate(self.nodes)}

        def key(mistake: Mistake) -> tuple[int, int]:
            if mistake.place:
                return mistake.place.line, mistake.place.column
            path, offset = self._found[mistake]
            return next((order[path[:n]] for n in range(len(path), 0, -1) if path[:n] in order), 0), offset

        found = _once(sorted(self._found, key=key))
        return tuple([*found, Mistake(f"and {self._left_out} mistakes more")] if self._left_out else found)

    def _full(self) -> bool:
        self._left_out += self.full
        return self.full

    def _note(self, path: Path, message: str, hint: str | None, where: Place | None, offset: int) -> None:
        named = message if where or not path else f"{show_path(path)}: {message}"
        self._found.setdefault(Mistake(named, hint, where), (path, offset))


def other_one(node: Node) -> str | None:
    where = place(node)
    return "the other one is in line " + ", ".join(filter(None, (str(where.line), where.instance))) if where else None


def _once(mistakes: AnySequence[Mistake]) -> list[Mistake]:
    """Mistakes at one place that differ in the names of instances only, as one."""
    alike: dict[object, list[Mistake]] = {}
    for each in mistakes:
        where = each.place
        names = _QUOTED.sub("", each.message) if where and where.instance else each
        alike.setdefault((names, where and replace(where, instance="")), []).append(each)
    return [_with_more(first, len(rest)) for first, *rest in alike.values()]


def _with_more(first: Mistake, more: int) -> Mistake:
    if not more or not first.place:
        return first
    instances = f"{first.place.instance}, and in {more} more instance" + ("s" if more > 1 else "")
    return replace(first, place=replace(first.place, instance=instances))


def show_path(path: Path) -> str:
    return ".".join(path)


def node_of(value: object, depth: int = 0) -> Node:
    """A document written in Python as the nodes that its YAML would give: text as if it were quoted."""
    if is_dataclass(value) and depth < MAX_DEPTH:
        pairs = [(each.name.rstrip("_"), getattr(value, each.name)) for each in fields(value)]
        return Mapping(tuple((Scalar(key, True), node_of(part, depth + 1)) for key, part in pairs if part is not None))
    if isinstance(value, AnyMapping) and depth < MAX_DEPTH:
        return Mapping(tuple((Scalar(str(key), True), node_of(part, depth + 1)) for key, part in value.items()))
    if isinstance(value, list | tuple) and depth < MAX_DEPTH:
        return Sequence(tuple(node_of(part, depth + 1) for part in value))
    if isinstance(value, bool):
        return Scalar(str(value).lower(), True)
    if value is None:
        return Scalar("", True)
    return Scalar(str(value), not isinstance(value, str))


def read(node: Node, shape: Shape, path: Path, report: Report) -> Any:
    """What a node says, as the document wants it, or `UNREADABLE`."""
    report.nodes[path] = node
    if isinstance(node, Broken):
        report.holes.add(path)
        return UNREADABLE
    shapes = shape.shapes if isinstance(shape, OneOf) else (shape,)
    fitting = [each for each in shapes if _fits(node, each)]
    if not fitting:
        _misfit(node, shape, path, report)
        return UNREADABLE
    match fitting[0], node:
        case Record() as record, Mapping() | Scalar():
            return _record(node, record, path, report)
        case Table(key, value), Mapping() | Scalar():
            return _table(node, key, value, path, report)
        case ListOf(item), Sequence(items):
            return [read(each, item, (*path, str(at)), report) for at, each in enumerate(items)]
        case Text() as text, Scalar():
            return _text(node, text, path, report)
        case Truth(), Scalar(word):
            return _TRUE_OR_FALSE[word]
        case Whole(low, high), Scalar(digits) if low <= int(digits) <= high:
            return int(digits)
        case Choice(words), Scalar(word) if word in words:
            return word
    _misfit(node, shape, path, report)
    return UNREADABLE


def _fits(node: Node, shape: Shape) -> bool:
    """Whether a node is of the kind that a shape wants; what it says may still be wrong."""
    match shape, node:
        case (Record() | Table(), Mapping()) | (ListOf(), Sequence()) | (Text(), Scalar()):
            return True
        case Table() | Record(), Scalar("", plain):
            return plain  # a key with nothing behind it: no entries
        case Truth(), Scalar(word, plain):
            return plain and word in _TRUE_OR_FALSE
        case Whole(), Scalar(word, plain):
            return plain and _WHOLE.fullmatch(word) is not None
        case Choice(words), Scalar(word):
            return word in words
    return False


def _misfit(node: Node, shape: Shape, path: Path, report: Report) -> None:
    report.holes.add(path)
    shapes = shape.shapes if isinstance(shape, OneOf) else (shape,)
    hint = None
    match node:
        case Scalar(word, plain):
            found = f"not '{shorten(word)}'" if word or not plain else "but there is nothing"
            if any(isinstance(each, Choice) for each in shapes):
                words = tuple(word for each in shapes if isinstance(each, Choice) for word in each.words)
                hint = report.close(word, words)
            elif not plain and (word in _TRUE_OR_FALSE or _WHOLE.fullmatch(word)):
                hint = "write it without quotes"
            elif word in _ALMOST_TRUTH and Truth() in shapes:
                hint = f"write {str(_ALMOST_TRUTH[word]).lower()}"
        case Mapping() | Sequence():
            found = "not a mapping" if isinstance(node, Mapping) else "not a list"
            if node.span and node.span.style and any(isinstance(each, Text) for each in shapes):
                hint = f"quote an expression that starts with '{node.span.style}'"
            if isinstance(node, Mapping) and any(key.text == "foreach" for key, _ in node.entries):
                hint = "write {all: ..., foreach: ...} or {any: ..., foreach: ...}"
    report.wrong(path, f"expected {called(shape)}, {found}", hint)


def _text(node: Scalar, text: Text, path: Path, report: Report) -> Any:
    word = bare(node.text) if text.pattern else node.text
    wrong = _misnamed(word, text)
    if wrong:
        report.wrong(path, f"'{shorten(node.text)}' {wrong}", text.hint)
        return UNREADABLE
    return word


def _misnamed(word: str, text: Text) -> str | None:
    """What keeps a word from being a text of this kind."""
    if not text.pattern:
        return None
    if len(word) > MAX_NAME:
        return f"is longer than {MAX_NAME} characters"
    return None if re.fullmatch(text.pattern, word) else f"is not {text.called}"


def bare(name: str) -> str:
    """A name without the backticks that may stand around it."""
    return name[1:-1] if len(name) > 2 and name[0] == name[-1] == "`" else name


def _record(node: Mapping | Scalar, shape: Record, path: Path, report: Report) -> Any:
    entries = _entries(node, path, report)
    shapes = {each.key: each for each in shape.entries}
    present = {key.text for key, _ in entries}
    values = {}
    for key, value in entries:
        inner = (*path, key.text)
        report.keys[inner] = key
        if key.text in shapes:
            values[shapes[key.text].attribute] = read(value, shapes[key.text].shape, inner, report)
        else:
            known = (*shapes, *EXPANDED.get(shape.made, ()))
            hint = report.close(key.text, [each for each in (*known, "foreach", "where") if each != key.text])
            if value == Scalar("", True, value.span) and node.span and node.span.style:
                hint = "in flow style, quote an expression that holds a comma"
            report.wrong_key(inner, f"unknown key '{shorten(key.text)}'", hint or "known here: " + ", ".join(known))
            meant = next((name for name in shapes if hint and f"'{name}'" in hint), "")
            if meant not in present:
                report.holes.add((*path, meant) if meant else path)
    for each in shape.entries:
        if each.required and each.attribute not in values:
            values[each.attribute] = UNREADABLE
            if (*path, each.key) not in report.holes:
                report.wrong_key(path, f"'{each.key}' is missing" + (f" in '{path[-1]}'" if path else ""))
    return shape.made(**values)


def _table(node: Mapping | Scalar, key_shape: Text, shape: Shape, path: Path, report: Report) -> Any:
    values = {}
    for key, value in _entries(node, path, report):
        name = bare(key.text) if key_shape.pattern else key.text
        inner = (*path, name)
        if name in values:
            report.wrong_key(inner, f"'{name}' is here twice", report.line_of(inner), key)
            continue
        report.keys[inner] = key
        wrong = _misnamed(name, key_shape)
        if wrong:
            report.wrong_key(inner, f"'{shorten(key.text)}' {wrong}", key_shape.hint)
        else:
            values[name] = read(value, shape, inner, report)
    return values


def _entries(node: Mapping | Scalar, path: Path, report: Report) -> tuple[tuple[Scalar, Node], ...]:
    if isinstance(node, Scalar):
        return ()
    report.holes.update((*path, key) if key else path for key in node.dropped)
    return node.entries


def closest(word: str, known: AnySequence[str]) -> str | None:
    """A hint which of the known names is meant: one that only misses its resource, or one that is spelt alike."""
    longer = next((name for name in known if name.endswith("." + word)), None)
    return f"did you mean '{longer}'?" if longer else did_you_mean(word, known)


def shorten(text: str, most: int = 40) -> str:
    return text if len(text) <= most else text[: most - 3] + "..."
