"""YAML as a small tree of text with places, and nothing else of YAML.

Scalars stay text: what `on`, `010` or `1.0` means is decided later, by the type that is declared. Aliases, anchors,
tags, merge keys, several documents and duplicate keys are refused; size, depth and number of nodes are bounded before
anything is built. Works on the parser's events, without recursion.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterator
from functools import cached_property, lru_cache
from typing import NamedTuple

import yaml

from smv_planner.errors import Mistake, Place
from smv_planner.lazy import dataclass, field, replace

MAX_BYTES = 1 << 20
MAX_DEPTH = 32
MAX_NODES = 100_000
MAX_MISTAKES = 1_000

_LOADER: type[yaml.SafeLoader] = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_LINE_BREAK = re.compile(r"\r\n|\r|\n")
_FORBIDDEN = re.compile(  # control characters, other line breaks, marks that turn the reading direction, non-characters
    "[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069\ufeff\ufffe\uffff\ud800-\udfff]"
)


@dataclass(frozen=True)
class Source:
    """A text and the name of the file that it is from."""

    file: str
    text: str

    @cached_property
    def _lines(self) -> tuple[list[int], list[str]]:
        """Where each line starts, and what it says."""
        starts = [0, *(match.end() for match in _LINE_BREAK.finditer(self.text))]
        return starts, _LINE_BREAK.split(self.text)

    def place(self, start: int, length: int = 1) -> Place:
        starts, lines = self._lines
        line = bisect_right(starts, start) - 1
        return Place(self.file, line + 1, start - starts[line] + 1, max(1, length), lines[line])


class Span(NamedTuple):
    """Where a node stands in its source. `style` is the quote or the block sign of a scalar, `{` or `[` in flow style."""

    source: Source
    start: int
    end: int
    style: str = ""
    instance: Instance | None = None


class Instance(NamedTuple):
    """What `expand` knows of a node: which of many it belongs to, in words, and where the parts of its text are from.

    Names in it are looked up with `prefix` before them first.
    """

    note: str = ""
    prefix: str = ""
    parts: tuple[Part, ...] = ()


class Part(NamedTuple):
    """From the character `start` on, a text is that of `node` from `offset` on, or stands for `length` characters of it."""

    start: int
    node: Scalar
    offset: int
    length: int = 0


class Scalar(NamedTuple):
    """A word, a number, an expression: text. `plain` is false if it was quoted. Nodes made in Python have no span."""

    text: str
    plain: bool
    span: Span | None = None


class Mapping(NamedTuple):
    """Names with what they stand for. `dropped` are the keys of entries that were refused."""

    entries: tuple[tuple[Scalar, Node], ...]
    dropped: tuple[str, ...] = ()
    span: Span | None = None


class Sequence(NamedTuple):
    items: tuple[Node, ...]
    span: Span | None = None


class Broken(NamedTuple):
    """Something that was refused; the mistake is noted already."""

    span: Span | None = None


Node = Scalar | Mapping | Sequence | Broken


def place(node: Node, offset: int | None = None, length: int = 1) -> Place | None:
    """Where a node stands, or the part of a scalar's value that begins at `offset`."""
    if node.span is None:
        return None
    span, instance = node.span, node.span.instance
    if offset is not None and instance and instance.parts:
        return _origin(instance.parts, offset, length)
    if offset is None or not isinstance(node, Scalar):
        where = span.source.place(span.start, span.end - span.start)
    else:
        start = _position(node.text, span, offset)
        where = span.source.place(span.start if start is None else start, length)
    return replace(where, instance=instance.note) if instance else where


def _origin(parts: tuple[Part, ...], offset: int, length: int) -> Place | None:
    """Where the characters of a text that was put together come from."""
    first = parts[max(0, bisect_right(parts, offset, key=lambda part: part.start) - 1)]
    last = parts[max(0, bisect_right(parts, offset + length - 1, key=lambda part: part.start) - 1)]
    start = first.offset + (0 if first.length else max(0, offset - first.start))
    if last.node is not first.node:
        return place(first.node, start, max(1, len(first.node.text) - start))
    end = last.offset + (last.length or offset + length - last.start)
    return place(first.node, start, max(1, end - start))


def _position(value: str, span: Span, offset: int) -> int | None:
    """Where in the source a scalar's value has its character at `offset`; None if it is written with escapes.

    However YAML folds and indents lines, the visible characters of the value are those of the text, in order.
    """
    text, start = span.source.text, span.start
    if span.style == '"' and "\\" in text[start : span.end]:
        return None
    if span.style in ("|", ">"):
        header = _LINE_BREAK.search(text, start)
        start = header.end() if header else start
    elif span.style:
        start += 1
    if text.startswith(value, start):
        return start + offset
    before = sum(map(len, value[:offset].split()))
    written = _visible(span, start)
    if offset >= len(value.rstrip()):
        return written[before - 1] + 1 if 0 < before <= len(written) else start
    return written[before] if before < len(written) else start


@lru_cache(maxsize=4)
def _visible(span: Span, start: int) -> list[int]:
    """Where the visible characters of a scalar stand, from `start` on."""
    one = re.compile(r"''|\S" if span.style == "'" else r"\S")
    return [match.start() for match in one.finditer(span.source.text, start, span.end)]


def parse(source: Source) -> tuple[Node | None, list[Mistake]]:
    """The tree of a text, and what is wrong with it as YAML. There is no tree if it cannot be read to its end."""
    refused = _refused(source)
    if refused:
        return None, [refused]
    reading = _Reading(source)
    try:
        if not all(reading.takes(event) for event in yaml.parse(source.text, Loader=_LOADER)):
            return None, reading.mistakes
    except yaml.YAMLError as error:
        return None, [*reading.mistakes, _syntax(source, error, reading.flow)]
    if reading.root is None:
        return None, [Mistake("there is nothing in this file", "a scenario starts with 'smv_planner: 1'", source.place(0))]
    return reading.root, reading.mistakes


def _refused(source: Source) -> Mistake | None:
    """What rules a text out before it is read."""
    if len(source.text) > MAX_BYTES or len(source.text.encode(errors="replace")) > MAX_BYTES:
        return Mistake(f"the text is larger than {MAX_BYTES} bytes", None, Place(source.file, 1, 1))
    bad = _FORBIDDEN.search(source.text)
    if bad:
        code = f"U+{ord(bad.group()):04X}"
        return Mistake(f"the character {code} is not allowed", "remove it", source.place(bad.start()))
    return None


@dataclass(slots=True)
class _Open:
    """A mapping or a sequence whose end has not come yet."""

    span: Span
    mapping: bool
    items: list[Node] = field(default_factory=list)
    entries: dict[str, tuple[Scalar, Node]] = field(default_factory=dict)
    dropped: list[str] = field(default_factory=list)
    key: Node | None = None

    def closed(self, end: int) -> Node:
        span = Span(self.span.source, self.span.start, max(end, self.span.start), self.span.style)
        if self.mapping:
            return Mapping(tuple(self.entries.values()), tuple(self.dropped), span)
        return Sequence(tuple(self.items), span)


class _Reading:
    """The tree so far, while events come in."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self.mistakes: list[Mistake] = []
        self.root: Node | None = None
        self._open: list[_Open] = []
        self._nodes = 0
        self._documents = 0

    @property
    def flow(self) -> bool:
        """Whether a `{` or `[` is open."""
        return any(each.span.style for each in self._open)

    def takes(self, event: yaml.Event) -> bool:
        """Take one event; False if reading has to end here."""
        assert event.start_mark
        assert event.end_mark
        start, end = event.start_mark.index, event.end_mark.index
        match event:
            case yaml.DocumentStartEvent():
                self._documents += 1
                if self._documents > 1:
                    self._wrong("a second document starts here", "a scenario is one document", start, 3)
                    return False
            case yaml.AliasEvent():
                self._wrong(f"'*{event.anchor}' is a YAML alias, and aliases are not allowed", _quote("*"), start, end - start)
                self._add(Broken(Span(self.source, start, end)))
            case yaml.ScalarEvent():
                self._add(self._scalar(event, start, end))
            case yaml.MappingStartEvent() | yaml.SequenceStartEvent():
                self._marked(event, start)
                mapping = isinstance(event, yaml.MappingStartEvent)
                self._open.append(_Open(Span(self.source, start, end, self.source.text[start:end].strip()[:1]), mapping))
            case yaml.MappingEndEvent() | yaml.SequenceEndEvent():
                self._add(self._open.pop().closed(end))
        self._nodes += isinstance(event, yaml.NodeEvent)
        if len(self.mistakes) >= MAX_MISTAKES:
            return False
        if len(self._open) > MAX_DEPTH or self._nodes > MAX_NODES:
            deep = len(self._open) > MAX_DEPTH
            self._wrong(f"nested more than {MAX_DEPTH} levels deep" if deep else f"more than {MAX_NODES} entries", None, start)
            return False
        return True

    def _scalar(self, event: yaml.ScalarEvent, start: int, end: int) -> Node:
        style = event.style if event.style in ("'", '"', "|", ">") else ""
        if self._marked(event, start):
            return Broken(Span(self.source, start, end, style))
        return Scalar(event.value, not style, Span(self.source, start, end, style))

    def _marked(self, event: yaml.NodeEvent, start: int) -> bool:
        """Whether a node carries an anchor or a tag, which is refused."""
        if event.anchor is not None:
            self._wrong(f"'&{event.anchor}' is a YAML anchor, and anchors are not allowed", _quote("&"), start)
            return True
        if getattr(event, "tag", None) is not None:
            self._wrong("a leading '!' is a YAML tag, and tags are not allowed", _quote("!"), start)
            return True
        return False

    def _add(self, node: Node) -> None:
        if not self._open:
            self.root = node
            return
        inner = self._open[-1]
        if not inner.mapping:
            inner.items.append(node)
        elif inner.key is None:
            inner.key = node
        else:
            key, inner.key = inner.key, None
            if isinstance(key, Scalar) and key.text not in inner.entries and not (key.plain and key.text == "<<"):
                inner.entries[key.text] = (key, node)
            else:
                inner.dropped.append(key.text if isinstance(key, Scalar) else "")
                self._refuse_key(key, inner)

    def _refuse_key(self, key: Node, inner: _Open) -> None:
        assert key.span
        at, length = key.span.start, key.span.end - key.span.start
        if isinstance(key, Scalar) and key.text in inner.entries:
            first = place(inner.entries[key.text][0])
            assert first
            self._wrong(f"'{key.text}' is here twice", f"the first is in line {first.line}", at, length)
        elif isinstance(key, Scalar):
            self._wrong("merge keys ('<<') are not allowed", "write the entries out", at, length)
        elif not isinstance(key, Broken):
            self._wrong("expected a name before ':'", "quote an expression that starts with '{' or '['", at, length)

    def _wrong(self, message: str, hint: str | None, start: int, length: int = 1) -> None:
        self.mistakes.append(Mistake(message, hint, self.source.place(start, length)))


def _quote(sign: str) -> str:
    return f"quote an expression that starts with '{sign}'"


def _syntax(source: Source, error: yaml.YAMLError, flow: bool) -> Mistake:
    mark = getattr(error, "problem_mark", None) or getattr(error, "context_mark", None)
    where = source.place(mark.index if mark else 0)
    problem = " ".join(filter(None, [getattr(error, "context", None), getattr(error, "problem", None) or "not readable"]))
    return Mistake(f"this is not YAML: {problem}", next(_cures(where, flow), None), where)


def _cures(where: Place, flow: bool) -> Iterator[str]:
    """What probably helps, the likeliest first."""
    line, column = where.source, where.column - 1
    signs = [match[1] for match in re.finditer(r"(?:^|[:,{\[-])\s*([!&*|>%@`'\"{\[])", line[: column + 1])]
    if "\t" in line[: column + 1]:
        yield "indent with spaces, not with tabs"
    if signs and not (flow and signs[-1] in "{["):
        yield f"quote the whole expression if it starts with {signs[-1]}"
    if flow:
        yield "in flow style, quote an expression that holds { [ or ,"
    if line.count(": ") > 1:
        yield "quote a text that holds ': '"
