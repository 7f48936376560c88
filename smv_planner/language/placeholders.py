"""What `$name` stands for, and the instances that `foreach` makes.

A template's parameter stands for a node of the scenario together with what placeholders in that stand for; nothing of it
is written out before it stands where it belongs. `foreach` gives words. `Writing` bounds how much comes of it.
"""

from __future__ import annotations

import re
from collections import ChainMap
from collections.abc import Iterator, MutableMapping
from collections.abc import Sequence as AnySequence
from itertools import product
from math import prod
from typing import NamedTuple, NoReturn, TypeVar

from smv_planner.errors import ModelError
from smv_planner.language.document import MAX_NAME
from smv_planner.language.grammar import MAX_LENGTH, NotRead, parse
from smv_planner.language.reader import Report, shorten
from smv_planner.language.shapes import Text
from smv_planner.language.strict_yaml import Broken, Instance, Mapping, Node, Part, Scalar, Sequence, Span
from smv_planner.lazy import dataclass, field

MAX_NODES = 200_000
MAX_TEXT = 2_000_000

WORD = re.compile(r"[^\W\d]\w*")
"""The name of a placeholder."""

_PLACEHOLDER = re.compile(r"\$(?:(?P<dollar>\$)|(?P<name>[^\W\d]\w*)|\{(?P<braced>[^{}]*)\})")
_BRACED = re.compile(r"\s*(?P<name>[^\W\d]\w*)\s*(?:(?P<sign>[+-])\s*(?P<number>\d{1,9})\s*)?")
_INTEGER = re.compile(r"-?\d{1,9}")
_RANGE = re.compile(r"\s*(-?\d{1,9})\s*\.\.\s*(-?\d{1,9})\s*")
_OPERATOR = re.compile(r"(==|!=|<=|>=|<|>)")
_ONE_PART = re.compile(r"[\w.-]*|'[^']*'|`[^`]*`|[-=<>!&|+]+")
"""What keeps its meaning without parentheses wherever it is inserted into an expression."""

NOWHERE = Instance()

N = TypeVar("N", Scalar, Mapping, Sequence, Broken, Node)


class Passed(NamedTuple):
    """What a template was given for a parameter, and what placeholders in that stand for."""

    node: Node
    given: Given


Values = MutableMapping[str, Scalar | Passed]


@dataclass(frozen=True, slots=True)
class Given:
    """What placeholders stand for at one place, which instance that is, and which names are looked up first."""

    values: Values = field(default_factory=dict)
    instance: Instance = NOWHERE

    def with_(self, names: AnySequence[str], words: AnySequence[Scalar]) -> Given:
        """Also with these words."""
        pairs = list(zip(names, words, strict=True))
        note = ", ".join([*filter(None, [self.instance.note]), *(f"{name} = {shorten(word.text)}" for name, word in pairs)])
        return Given(ChainMap(dict(pairs), self.values), Instance(note, self.instance.prefix))


def resolved(node: Node, given: Given) -> tuple[Node, Given]:
    """What was passed, if a node is nothing but the placeholder of a parameter."""
    while isinstance(node, Scalar) and (match := _PLACEHOLDER.fullmatch(node.text)):
        value = given.values.get(match["name"] or (match["braced"] or "").strip())
        if not isinstance(value, Passed):
            break
        node, given = value.node, Given(value.given.values, given.instance)
    return node, given


def noted(node: N, given: Given) -> N:
    """A node that knows which instance it belongs to."""
    if node.span is None or not given.instance.note:
        return node
    return node._replace(span=Span(*node.span[:4], given.instance))


def entry(node: Mapping, name: str) -> Node | None:
    return next((value for key, value in node.entries if key.text == name), None)


def quantifier(node: Mapping) -> str:
    """`all` or `any`, if a mapping is a quantified condition and not a table that has such a key; else nothing."""
    words = [key.text for key, _ in node.entries if key.text in ("all", "any")]
    return words[0] if len(words) == 1 and entry(node, "otherwise") is None else ""


def key_of(node: Mapping, name: str) -> Scalar:
    return next(key for key, _ in node.entries if key.text == name)


NOTHING = Given()


class Writing:
    """How much has been written out so far, and whom to tell what is wrong."""

    def __init__(self, report: Report) -> None:
        self.report = report
        self._nodes = self._text = 0

    def wrong(self, node: Node, given: Given, message: str, hint: str | None = None, at: tuple[int, int] | None = None) -> None:
        """Note a mistake in a node, unless it is refused already. Raises ModelError after too many."""
        if not isinstance(node, Broken):
            self.report.wrong_in(noted(node, given), message, hint, at)
        if self.report.full:
            raise ModelError(self.report.mistakes)

    def spend(self, node: Node, given: Given, nodes: int = 1, text: int = 0) -> None:
        """Count what is written out. Raises ModelError when that is too much."""
        self._nodes += nodes
        self._text += text
        if self._nodes > MAX_NODES:
            self._too_large(node, given, f"written out, the scenario has more than {MAX_NODES} entries")
        if self._text > MAX_TEXT:
            self._too_large(node, given, f"written out, the scenario has more than {MAX_TEXT} characters")

    def _too_large(self, node: Node, given: Given, message: str) -> NoReturn:
        self.report.wrong_in(noted(node, given), message, "repeat less")
        raise ModelError(self.report.mistakes)

    def scalar(self, node: Scalar, given: Given, shape: Text | None = None) -> Scalar | Broken:
        """A text with its placeholders replaced. What is inserted into an expression counts as one operand of it."""
        origin = noted(node, given)
        self.spend(node, given, 0, len(node.text))
        if "$" not in node.text:
            return origin
        texts: list[str] = []
        parts: list[Part] = []
        plain, at, start = node.plain, 0, 0
        for match in _PLACEHOLDER.finditer(node.text):
            word = self._word(match, node, given, shape if shape and shape.reads else None)
            if word is None:
                return Broken(origin.span)
            if len(match[0]) == len(node.text):
                plain = word.plain
            before = node.text[start : match.start()]
            parts += [Part(at, origin, start), Part(at + len(before), origin, match.start(), len(match[0]))]
            texts += [before, word.text]
            at, start = at + len(before) + len(word.text), match.end()
        parts.append(Part(at, origin, start))
        text = "".join([*texts, node.text[start:]])
        self.spend(node, given, 0, len(text))
        if origin.span is None:
            return Scalar(text, plain)
        return Scalar(text, plain, Span(*origin.span[:4], given.instance._replace(parts=tuple(parts))))

    def _word(self, match: re.Match[str], node: Scalar, given: Given, shape: Text | None) -> Scalar | None:
        """What one placeholder stands for, in an expression if there is a `shape`."""
        if match["dollar"]:
            return Scalar("$", True)
        inner = _BRACED.fullmatch(match["braced"]) if match["name"] is None else match
        if inner is None:
            self.wrong(node, given, f"'{shorten(match[0])}' is not a placeholder", "write ${name} or ${name+1}", match.span())
            return None
        name = inner["name"]
        while inner is match and name not in given.values and "_" in name and len(name) <= MAX_NAME:  # $a_$b: $a, _ and $b
            name = name.rpartition("_")[0]
        value = given.values.get(name)
        if value is None:
            self._unknown(inner["name"], match, node, given)
            return None
        word = value if isinstance(value, Scalar) else self._inserted(value, match, node, given, shape)
        if word is not None and inner is not match and inner["sign"]:
            if _INTEGER.fullmatch(word.text):
                return Scalar(str(int(word.text) + int(inner["sign"] + inner["number"])), True)
            self.wrong(node, given, f"'${name}' is '{shorten(word.text)}', not a whole number", None, match.span())
            return None
        if word is not None and name != inner["name"]:
            return Scalar(word.text + inner["name"].removeprefix(name), node.plain)
        alone = len(match[0]) == len(node.text) or (isinstance(value, Passed) and isinstance(resolved(*value)[0], Sequence))
        if word is None or alone or not shape or _ONE_PART.fullmatch(word.text):
            return word
        return Scalar(f"({word.text})", False)

    def _inserted(self, value: Passed, match: re.Match[str], node: Scalar, given: Given, shape: Text | None) -> Scalar | None:
        """What was passed, as text. The words of a list are separated by commas, as `in {...}` wants them."""
        passed, inner = resolved(*value)
        inner = Given(inner.values, given.instance)
        match passed:
            case Scalar():
                word = self.scalar(passed, inner, shape)
                return word if isinstance(word, Scalar) else None
            case Sequence():
                words = self.words(passed, inner)
                return None if words is None else Scalar(", ".join(word.text for word in words), True)
            case Mapping() if shape and quantifier(passed):
                whole = self.quantified(passed, shape, inner)
                return whole if isinstance(whole, Scalar) else None
            case Mapping():
                message = f"'{shorten(match[0])}' is a mapping and cannot stand inside a text"
                self.wrong(node, given, message, "let it be the whole value", match.span())
        return None

    def _unknown(self, name: str, match: re.Match[str], node: Scalar, given: Given) -> None:
        known = tuple(given.values)
        longest = max((each for each in known if name.startswith(each)), key=len, default=None)
        hint = self.report.close(name, known)
        if match["name"] and longest:
            hint = f"write ${{{longest}}}{name.removeprefix(longest)}"
        elif not hint:
            known = tuple(f"${each}" for each in known)
            hint = shorten("known here: " + ", ".join(known), 120) if known else "write $$ for a dollar sign"
        self.wrong(node, given, f"unknown placeholder '{shorten(match[0])}'", hint, match.span())

    def quantified(self, node: Mapping, shape: Text, given: Given) -> Scalar | Broken:
        """All or any of several conditions as one expression."""
        word = quantifier(node)
        body, instances = entry(node, word) or Broken(), [given]
        known = (word, "foreach", "where")
        for key, _ in node.entries:
            if key.text not in known:
                self.unknown_key(key, known, given)
        if entry(node, "foreach") is not None:
            found = self.instances(node, given)
            if found is None:
                return Broken(node.span)
            instances = found
        elif not isinstance(resolved(body, given)[0], Sequence):
            self.wrong(node, given, f"'{word}' needs a list or 'foreach'")
            return Broken(node.span)
        conditions: list[Scalar] = []
        wanted = 0
        for inner in instances:
            each, its = resolved(body, inner)
            for item, one in self.items(each, its) if isinstance(each, Sequence) else iter([(each, its)]):
                wanted += 1
                condition = self._condition(item, shape, one)
                conditions += [condition] if condition else []
        return self._joined(conditions, word, node, given) if len(conditions) == wanted else Broken(node.span)

    def _condition(self, node: Node, shape: Text, given: Given) -> Scalar | None:
        """One of several conditions. Alone it has to be one, too: parentheses around it might make one of it."""
        self.spend(node, given)
        if isinstance(node, Mapping) and quantifier(node):
            whole = self.quantified(node, shape, given)
            return whole if isinstance(whole, Scalar) else None
        text = self.scalar(node, given, shape) if isinstance(node, Scalar) else node
        if not isinstance(text, Scalar):
            self.wrong(text, given, f"expected {shape.called}")
            return None
        try:
            parse(text.text, shape.reads == "formula")
        except NotRead as error:
            self.wrong(text, NOTHING, error.message, error.hint, (error.start, error.end))
            return None
        return text

    def _joined(self, conditions: AnySequence[Scalar], word: str, node: Mapping, given: Given) -> Scalar | Broken:
        """Each in parentheses. Of no conditions all hold, and none does."""
        between, nothing = (" and ", "true") if word == "all" else (" or ", "false")
        text = between.join(f"({each.text})" for each in conditions) or nothing
        self.spend(node, given, 0, len(text))
        if len(text) > MAX_LENGTH:
            self.wrong(node, given, f"written out, this is longer than {MAX_LENGTH} characters")
            return Broken(node.span)
        parts: list[Part] = []
        at = 1
        for each in conditions:
            parts.append(Part(at, each, 0))
            at += len(each.text) + len(between) + 2
        return Scalar(
            text, False, node.span and node.span._replace(style="", instance=given.instance._replace(parts=tuple(parts)))
        )

    def items(self, node: Sequence, given: Given, key: str = "is") -> Iterator[tuple[Node, Given]]:
        """The items of a list, not yet written out: those of lists that are passed, and the instances of `{foreach, is}`."""
        for item in node.items:
            self.spend(item, given)
            each, inner = resolved(item, given)
            if isinstance(each, Sequence) and isinstance(item, Scalar):
                yield from self.items(each, inner, key)
            elif isinstance(each, Mapping) and entry(each, "foreach") and not quantifier(each):
                body, instances = self.body(each, key, inner), self.instances(each, inner)
                if body is None or instances is None:
                    yield Broken(each.span), inner
                    continue
                for one in instances:
                    yield from self.items(Sequence((body,), each.span), one, key)
            else:
                yield each, inner

    def words(self, node: Sequence, given: Given) -> list[Scalar] | None:
        """The words of a list; None if it has anything else in it."""
        found = []
        for each, inner in self.items(node, given):  # it counts them
            word = self.scalar(each, inner) if isinstance(each, Scalar) else each
            if not isinstance(word, Scalar):
                self.wrong(word, inner, "expected a word or a number")
                return None
            found.append(word)
        return found

    def body(self, node: Mapping, key: str, given: Given) -> Node | None:
        """What `{foreach: ..., where: ..., is: BODY}` repeats."""
        for each, _ in node.entries:
            if each.text not in ("foreach", "where", key):
                self.unknown_key(each, ("foreach", "where", key), given)
        body = entry(node, key)
        if body is None and not node.dropped:
            hint = f"write {{foreach: ..., {key}: ...}}"
            self.wrong(key_of(node, "foreach"), given, f"'{key}' is missing beside 'foreach'", hint)
        return body

    def unknown_key(self, key: Scalar, known: AnySequence[str], given: Given) -> None:
        hint = self.report.close(key.text, known) or "known here: " + ", ".join(known)
        self.wrong(key, given, f"unknown key '{shorten(key.text)}'", hint)

    def instances(self, node: Mapping, given: Given) -> list[Given] | None:
        """What stands for what in each combination that `foreach` and `where` ask for; None if they are wrong."""
        foreach, inner = resolved(entry(node, "foreach") or Broken(), given)
        where = entry(node, "where")
        if not isinstance(foreach, Mapping) or not foreach.entries:
            self.wrong(foreach, given, "expected {name: 1..9} or {name: [a, b]}")
            return None
        pools: dict[str, AnySequence[Scalar | int]] = {}
        for key, value in foreach.entries:
            pool = self._pool(value, inner)
            why = None if WORD.fullmatch(key.text) else f"'{shorten(key.text)}' cannot be a placeholder"
            if key.text in given.values or key.text == "resource":
                why = f"'${key.text}' has a meaning here already"
            if why:
                self.wrong(key, given, why, "take another name: letters, digits and '_'")
            if pool is None or why:
                return None
            pools[key.text] = pool
        total = prod(map(len, pools.values()))
        if total > MAX_NODES:
            self._too_large(foreach, given, f"these are {total} instances; the limit is {MAX_NODES}")
        found: list[Given] = []
        for combination in product(*pools.values()) if total else ():
            words = [Scalar(str(each), True) if isinstance(each, int) else each for each in combination]
            one = given.with_(tuple(pools), words)
            self.spend(foreach, one, 1, len(one.instance.note))
            holds = where is None or self._where(where, one)
            if holds is None:
                return None
            if holds:
                found.append(one)
        return found

    def _pool(self, node: Node, given: Given) -> AnySequence[Scalar | int] | None:
        """The values of one name of a `foreach`."""
        node, given = resolved(node, given)
        if isinstance(node, Sequence):
            return self.words(node, given)
        text = self.scalar(node, given) if isinstance(node, Scalar) else node
        if not isinstance(text, Scalar) or not (match := _RANGE.fullmatch(text.text)):
            self.wrong(text, given, "expected numbers 1..9 or a list [a, b]")
            return None
        low, high = int(match[1]), int(match[2])
        if high < low - 1:
            self.wrong(text, given, f"{low}..{high} counts downwards", f"write {high}..{low}")
            return None
        return range(low, high + 1)

    def _where(self, node: Node, given: Given) -> bool | None:
        """Whether an instance is wanted; None if that cannot be said."""
        text = self.scalar(node, given) if isinstance(node, Scalar) else node
        if not isinstance(text, Scalar):
            self.wrong(text, given, "expected a comparison", _COMPARE)
            return None
        whole = True
        for part in re.split(r"\band\b", text.text):
            sides = [each.strip() for each in _OPERATOR.split(part)]
            sound = len(sides) == 3 and all(sides)
            holds = _compares(*sides) if sound else None
            if holds is None:
                hint = "only whole numbers are smaller or larger" if sound else _COMPARE
                self.wrong(text, given, f"'{shorten(part.strip())}' is not a comparison", hint)
                return None
            whole = whole and holds
        return whole


_COMPARE = "write $a != $b, or several of == != < <= > >= joined by 'and'"


def _compares(left: str, operator: str, right: str) -> bool | None:
    if _INTEGER.fullmatch(left) and _INTEGER.fullmatch(right):
        a, b = int(left), int(right)
        return {"==": a == b, "!=": a != b, "<": a < b, "<=": a <= b, ">": a > b, ">=": a >= b}[operator]
    return {"==": left == right, "!=": left != right}.get(operator)
