"""Expressions over the state: guards, invariants, goals and assigned values.

A small closed set of frozen nodes. What a scenario can write beyond these (`->`, `in`, `!=`, `<=`) is expressed by
them. Conjunctions and disjunctions have any number of parts, so that no text nests deeper than its author nested it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from operator import attrgetter, is_
from typing import Any

from smv_planner.lazy import dataclass
from smv_planner.model.domains import Value, show_value


@dataclass(frozen=True, slots=True)
class Const:
    value: Value


@dataclass(frozen=True, slots=True)
class Var:
    """The value of a state variable, by its full name."""

    name: str


@dataclass(frozen=True, slots=True)
class Not:
    part: Expr


@dataclass(frozen=True, slots=True)
class And:
    parts: tuple[Expr, ...]


@dataclass(frozen=True, slots=True)
class Or:
    parts: tuple[Expr, ...]


@dataclass(frozen=True, slots=True)
class Equal:
    left: Expr
    right: Expr


@dataclass(frozen=True, slots=True)
class Less:
    left: Expr
    right: Expr


@dataclass(frozen=True, slots=True)
class Plus:
    left: Expr
    right: Expr


@dataclass(frozen=True, slots=True)
class Minus:
    left: Expr
    right: Expr


@dataclass(frozen=True, slots=True)
class If:
    condition: Expr
    then: Expr
    otherwise: Expr


@dataclass(frozen=True, slots=True)
class Named:
    """A predicate or a measured copy: the name its author gave it, and what it stands for."""

    name: str
    part: Expr


Expr = Const | Var | Not | And | Or | Equal | Less | Plus | Minus | If | Named

KEYWORDS = frozenset(["and", "or", "not", "in", "true", "false", "any", "G", "F", "X", "U", "R", "W"])
"""Words that a scenario has to quote to use them as a name (`like this`) or as a value ('like this')."""

TRUE = Const(True)
FALSE = Const(False)


def conjunction(parts: Iterable[Expr]) -> Expr:
    """All of `parts`; constants are folded away."""
    kept = _merged(parts, And, unit=TRUE)
    return FALSE if FALSE in kept else kept[0] if len(kept) == 1 else And(kept) if kept else TRUE


def disjunction(parts: Iterable[Expr]) -> Expr:
    """Any of `parts`; constants are folded away."""
    kept = _merged(parts, Or, unit=FALSE)
    return TRUE if TRUE in kept else kept[0] if len(kept) == 1 else Or(kept) if kept else FALSE


def negation(part: Expr) -> Expr:
    match part:
        case Const(value):
            return Const(not value)
        case Not(inner):
            return inner
    return Not(part)


def equality(left: Expr, right: Expr) -> Expr:
    """`left == right`, decided where both are constants or the same expression, and simpler where one is a Boolean."""
    match left, right:
        case Const(a), Const(b):
            return Const(a == b)
        case (Const(value), other) | (other, Const(value)) if type(value) is bool:
            return other if value else negation(other)
        case Const(), _:
            return Equal(right, left)
    return TRUE if left == right else Equal(left, right)


def conjuncts(expr: Expr, positive: bool = True) -> Iterator[Expr]:
    """Parts that all have to hold for `expr` to be `positive`; none if it always is."""
    match expr:
        case Named(_, part):
            yield from conjuncts(part, positive)
        case Not(part):
            yield from conjuncts(part, not positive)
        case Const(value):
            if value is not positive:
                yield FALSE
        case And(parts) if positive:
            for part in parts:
                yield from conjuncts(part)
        case Or(parts) if not positive:
            for part in parts:
                yield from conjuncts(part, False)
        case _:
            yield expr if positive else negation(expr)


def _merged(parts: Iterable[Expr], kind: type[And] | type[Or], unit: Const) -> tuple[Expr, ...]:
    flat: dict[Expr, None] = {}
    for part in parts:
        for inner in part.parts if isinstance(part, kind) else (part,):
            if inner != unit:
                flat.setdefault(inner)
    return tuple(flat)


def parts_of(expr: Expr) -> tuple[Expr, ...]:
    """The direct parts of a node."""
    return _PARTS[type(expr)](expr)


_PARTS: Mapping[type, Callable[[Any], tuple[Expr, ...]]] = {
    Const: lambda node: (),
    Var: lambda node: (),
    Not: lambda node: (node.part,),
    Named: lambda node: (node.part,),
    And: attrgetter("parts"),
    Or: attrgetter("parts"),
    **dict.fromkeys((Equal, Less, Plus, Minus), attrgetter("left", "right")),
    If: attrgetter("condition", "then", "otherwise"),
}
"""A table, for this is asked of every node again and again."""


def nodes(expr: Expr) -> Iterator[Expr]:
    """Every distinct node object of an expression once, whole before its parts."""
    seen: set[int] = set()
    waiting = [expr]
    while waiting:
        node = waiting.pop()
        if id(node) not in seen:
            seen.add(id(node))
            yield node
            waiting.extend(reversed(_PARTS[type(node)](node)))


def variables_of(expr: Expr) -> frozenset[str]:
    """The state variables an expression reads."""
    return frozenset(node.name for node in nodes(expr) if isinstance(node, Var))


def substitute(expr: Expr, values: Mapping[str, Expr]) -> Expr:
    """The expression with variables replaced and constants folded; untouched parts are kept as they are."""
    return rewritten(expr, lambda node: values.get(node.name) if isinstance(node, Var) else None)


def rewritten(expr: Expr, replacement: Callable[[Expr], Expr | None]) -> Expr:
    """The expression with every node replaced for which there is a replacement, and constants folded.

    Untouched parts are kept as they are; a predicate loses its name if what it stands for changes.
    """
    done: dict[int, Expr] = {}

    def of(node: Expr) -> Expr:
        if id(node) not in done:
            replaced = replacement(node)
            done[id(node)] = build(node) if replaced is None else replaced
        return done[id(node)]

    def build(node: Expr) -> Expr:
        return with_parts(node, [of(part) for part in parts_of(node)])

    return of(expr)


def with_parts(node: Expr, new: Sequence[Expr]) -> Expr:
    """A node with other parts, and constants folded; the node itself if they are the ones that it has."""
    if all(map(is_, parts_of(node), new)):
        return node
    match node:
        case Not():
            return negation(new[0])
        case And():
            return conjunction(new)
        case Or():
            return disjunction(new)
        case Equal():
            return equality(*new)
        case If():
            condition, then, otherwise = new
            if isinstance(condition, Const):
                return then if condition.value else otherwise
            return If(condition, then, otherwise)
        case Less() | Plus() | Minus():
            folded = type(node)(*new)
            return Const(meaning(folded, {})(())) if all(isinstance(part, Const) for part in new) else folded
    return new[0]


Meaning = Callable[[tuple[Value, ...]], Value]
"""What an expression is worth in a state."""


def meaning(expr: Expr, index: Mapping[str, int]) -> Meaning:
    """What an expression is worth in a state, where `index` says at which position each variable stands."""
    done: dict[int, Meaning] = {}

    def of(node: Expr) -> Meaning:
        if id(node) not in done:
            done[id(node)] = build(node)
        return done[id(node)]

    def build(node: Expr) -> Meaning:
        match node:
            case Const(value):
                return lambda s: value
            case Var(name):
                at = index[name]
                return lambda s: s[at]
            case Named(_, part):
                return of(part)
            case Not(part):
                inner = of(part)
                return lambda s: not inner(s)
            case And(parts):
                return _all_of(tuple(of(part) for part in parts))
            case Or(parts):
                return _any_of(tuple(of(part) for part in parts))
            case Equal(Var(name), Const(value)):
                at = index[name]
                return lambda s: s[at] == value
            case Equal(left, right):
                a, b = of(left), of(right)
                return lambda s: a(s) == b(s)
            case Less(left, right):
                a, b = of(left), of(right)
                return lambda s: a(s) < b(s)  # type: ignore[operator]
            case Plus(left, right):
                a, b = of(left), of(right)
                return lambda s: a(s) + b(s)  # type: ignore[operator]
            case Minus(left, right):
                a, b = of(left), of(right)
                return lambda s: a(s) - b(s)  # type: ignore[operator]
            case If(condition, then, otherwise):
                c, a, b = of(condition), of(then), of(otherwise)
                return lambda s: a(s) if c(s) else b(s)

    return of(expr)


def _all_of(parts: tuple[Meaning, ...]) -> Meaning:
    def hold(s: tuple[Value, ...]) -> bool:
        for part in parts:  # noqa: SIM110 - all() of a generator takes twice as long
            if not part(s):
                return False
        return True

    return hold


def _any_of(parts: tuple[Meaning, ...]) -> Meaning:
    def holds(s: tuple[Value, ...]) -> bool:
        for part in parts:  # noqa: SIM110 - any() of a generator takes twice as long
            if part(s):
                return True
        return False

    return holds


def show(expr: Expr) -> str:
    """An expression in the language of scenarios, for people to read."""
    return _show(rewritten(expr, _cases_of), 0)


def _cases_of(node: Expr) -> Expr | None:
    """A comparison with a value that depends on conditions, case by case: the language has no `if`."""
    match node:
        case Equal(If(condition, then, otherwise), other) | Equal(other, If(condition, then, otherwise)):
            first, second = (rewritten(equality(value, other), _cases_of) for value in (then, otherwise))
            when = rewritten(condition, _cases_of)
            return disjunction([conjunction([when, first]), conjunction([negation(when), second])])
    return None


def _show(expr: Expr, inside: int) -> str:
    """`inside` is how tightly the surrounding operator binds; a looser expression gets parentheses."""
    match expr:
        case Const(value):
            return f"'{value}'" if value in KEYWORDS else show_value(value)
        case Var(name) | Named(name, _):
            return f"`{name}`" if name in KEYWORDS else name
        case Not(Equal(left, right)):
            text, binds = f"{_show(left, 4)} != {_show(right, 4)}", 3
        case Not(Less(left, right)):
            text, binds = f"{_show(left, 4)} >= {_show(right, 4)}", 3
        case Not(part):
            text, binds = f"not {_show(part, 5)}", 5
        case And(parts):
            text, binds = " and ".join(_show(part, 2) for part in parts), 2
        case Or(parts):
            text, binds = " or ".join(_show(part, 1) for part in parts), 1
        case Equal(left, right):
            text, binds = f"{_show(left, 4)} == {_show(right, 4)}", 3
        case Less(left, right):
            text, binds = f"{_show(left, 4)} < {_show(right, 4)}", 3
        case Plus(left, right):
            text, binds = f"{_show(left, 4)} + {_show(right, 5)}", 4
        case Minus(left, right):
            text, binds = f"{_show(left, 4)} - {_show(right, 5)}", 4
        case If(condition, then, otherwise):
            text, binds = f"{_show(condition, 1)} ? {_show(then, 1)} : {_show(otherwise, 1)}", 0
    return f"({text})" if binds < inside else text
