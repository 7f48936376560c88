"""Trees of expressions -> typed `Expr` and `Formula`: names are looked up, types are checked.

Opposite a variable, a bare word of its domain is the value. A part whose mistake is reported, here or where its
variable is declared, is None; whatever holds such a part is None too, and nothing more is said about it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Literal, NamedTuple, cast

from smv_planner.language.document import LARGEST
from smv_planner.language.grammar import MAX_DEPTH, Node, NotRead, Token, Tree, parse, span
from smv_planner.language.reader import bare, closest, shorten
from smv_planner.lazy import dataclass, field
from smv_planner.model.domains import Bool, Domain, Enum, Range, Value
from smv_planner.model.expressions import FALSE, And, Const, Equal, Expr, Less, Minus, Named, Not, Or, Plus, Var, parts_of
from smv_planner.model.ltl import Atom, Both, Either, Formula, Next, Release, Until, always, eventually, negated, weak_until
from smv_planner.model.system import Any, VariableKind

MAX_NODES = 10_000

_UNTIL: Mapping[str, Callable[[Formula, Formula], Formula]] = {"U": Until, "R": Release, "W": weak_until}
_LATER: Mapping[str, Callable[[Formula], Formula]] = {"G": always, "F": eventually, "X": Next}

Level = Literal["any", "decision", "resource"]
"""Which variables an expression may read: operations and intentions see decision variables, goals of operations do not.

A measured copy is both: operations plan over it, and it stands for an expression over resource variables.
"""


class Typed(NamedTuple):
    """An expression with a domain that holds its values. `size` and `depth` count what predicates stand for."""

    expr: Expr
    domain: Domain
    size: int = 1
    depth: int = 1


class Timed(NamedTuple):
    """A formula with a temporal operator in it."""

    formula: Formula
    size: int
    depth: int


class Name(NamedTuple):
    """What a full name stands for.

    `domain` or `kind` is None if its declaration is wrong; `part`, what a predicate or a copy stands for, if its definition is.
    `resources` and `decisions` are a variable of that kind which a predicate reads, if it reads one.
    """

    full: str
    domain: Domain | None
    kind: VariableKind | Literal["copy", "predicate"] | None
    part: Typed | None = None
    resources: str | None = None
    decisions: str | None = None

    @property
    def variable(self) -> bool:
        return self.kind != "predicate"


_NOBODY = Name("", None, None)
"""Stands opposite a word that may be the value of something which is wrong: the word is not called unknown then."""


@dataclass(frozen=True, eq=False)
class Scope:
    """Every full name, and where an expression stands: the names with `prefix` come first.

    Before them come those with `inner` behind the prefix, in a template that is used under a name of its own. Names that
    begin with one of `quiet` may be missing because of a mistake elsewhere, and are not called unknown.
    """

    names: Mapping[str, Name]
    prefix: str = ""
    level: Level = "any"
    quiet: frozenset[str] = frozenset()
    inner: str = ""

    @property
    def _prefixes(self) -> tuple[str, ...]:
        return (self.prefix + self.inner, self.prefix, "")

    def find(self, word: str) -> Name | None:
        return next((self.names[prefix + word] for prefix in self._prefixes if prefix + word in self.names), None)

    def silent(self, word: str) -> bool:
        return any((prefix + word).startswith(start) for start in self.quiet for prefix in self._prefixes)

    @property
    def words(self) -> tuple[str, ...]:
        """The names as this place may write them."""
        prefixes = [prefix for prefix in dict.fromkeys(self._prefixes) if prefix]
        own = (name.removeprefix(prefix) for prefix in prefixes for name in self.names if name.startswith(prefix))
        return (*own, *self.names)


Complain = Callable[[str, str | None, tuple[int, int]], None]
"""Called with a message, a hint, and where in the text the mistake starts and ends."""


@dataclass(frozen=True, eq=False)
class Asking:
    """One expression on its way: its text, what it may name, whom to tell, and what it was found to be.

    `sizes` gathers how large expressions are, `used` the names that this one uses.
    """

    text: str
    scope: Scope
    complain: Complain
    where: str = ""
    close: Callable[[str, Sequence[str]], str | None] = closest
    sizes: list[int] = field(default_factory=list)
    used: dict[str, Name] = field(default_factory=dict)

    def wrong(self, node: Node, message: str, hint: str | None = None) -> None:
        self.complain(message, hint, span(node))

    def quoted(self, node: Node) -> str:
        """A part of the expression as its author wrote it."""
        start, end = span(node)
        return f"'{shorten(self.text[start:end])}'"


def predicate_of(asking: Asking) -> Typed | None:
    """A condition: a guard, an invariant, a goal."""
    node = _parsed(asking, False)
    return None if node is None else cast("Typed | None", _bounded(node, _condition(node, asking), asking))


def formula_of(asking: Asking) -> Formula | None:
    node = _parsed(asking, True)
    whole = None if node is None else _bounded(node, _condition(node, asking), asking)
    return None if whole is None else _timed(whole).formula


def assigned_of(asking: Asking, target: Name, may_choose: bool) -> Typed | Any | None:
    """What an action assigns to `target`: an expression or, where that is allowed, `any`."""
    node = _parsed(asking, False)
    if node is None or target.domain is None:
        return None
    if _kind(node) == "NAME" and node == "any":
        if not may_choose:
            asking.wrong(node, "'any' is for controlled and maintenance transitions only", "write the value")
        return Any() if may_choose else None
    part = _value(node, target, asking) if _is_value(node, target) else _typed(node, asking, target)
    if part is None:
        return None
    assert isinstance(part, Typed)
    match target.domain, part.domain, part.expr:
        case (Bool(), Bool(), _) | (Range(), Range(), _) | (Enum(), Enum(), _) if _meet(target.domain, part):
            return cast("Typed | None", _bounded(node, part, asking))
    if isinstance(part.expr, Const):
        message = f"{asking.quoted(node)} is not a value of '{target.full}', which is {domain_text(target.domain)}"
    else:
        message = f"{asking.quoted(node)} {_is(part)}, but '{target.full}' is {domain_text(target.domain)}"
    asking.wrong(node, message)
    return None


def _meet(domain: Domain, part: Typed) -> bool:
    """Whether a value of `part` may lie in the domain. Only what an enumeration or a constant says is held against it."""
    match domain, part.domain:
        case Enum(words), Enum(others):
            return not set(words).isdisjoint(others)
        case Range(), Range(low, high) if low == high and isinstance(part.expr, Const):
            return low in domain
    return True


def _parsed(asking: Asking, temporal: bool) -> Node | None:
    try:
        return parse(asking.text, temporal)
    except NotRead as error:
        asking.complain(error.message, error.hint, (error.start, error.end))
        return None


def _bounded(node: Node, whole: Typed | Timed | None, asking: Asking) -> Typed | Timed | None:
    """The whole if it is not too large."""
    asking.sizes.append(whole.size if whole else 0)
    if whole is None or (whole.size <= MAX_NODES and whole.depth <= MAX_DEPTH):
        return whole
    limit = f"more than {MAX_NODES} parts" if whole.size > MAX_NODES else f"more than {MAX_DEPTH} levels"
    asking.wrong(node, f"the expression has {limit}, predicates written out", "simplify it")
    return None


def _kind(node: Node) -> str:
    """The kind of a token, or the rule of a tree."""
    return node.type if isinstance(node, str) else str(node.data)


def _condition(node: Node, asking: Asking) -> Typed | Timed | None:
    part = _typed(node, asking)
    if isinstance(part, Typed) and not isinstance(part.domain, Bool):
        _expected("a condition", part, node, asking)
        return None
    return part


def _number(node: Node, asking: Asking) -> Typed | None:
    part = _typed(node, asking)
    if isinstance(part, Typed) and isinstance(part.domain, Range):
        return part
    _expected("a whole number", part, node, asking)
    return None


def _expected(what: str, part: Typed | Timed | None, node: Node, asking: Asking, hint: str | None = None) -> None:
    if part is not None:
        asking.wrong(node, f"expected {what}, but {asking.quoted(node)} {_is(part)}", hint)


def _is(part: Typed | Timed) -> str:
    if isinstance(part, Timed):
        return "is a temporal formula"
    if isinstance(part.expr, Const):
        return "is " + {Bool: "bool", Range: "a number", Enum: "a value"}[type(part.domain)]
    return f"is {domain_text(part.domain)}"


def domain_text(domain: Domain) -> str:
    match domain:
        case Enum(words) if len(words) > 12:
            return "{" + ", ".join(words[:12]) + ", ...}"
        case Range(low, high):
            return f"a number {low}..{high}"
    return str(domain)


def _typed(node: Node, asking: Asking, opposite: Name | None = None) -> Typed | Timed | None:
    """`opposite` is the variable on the other side of a comparison or an assignment."""
    if isinstance(node, str):
        return _operand(node, asking, opposite)
    parts: Sequence[Node] = node.children
    match _kind(node):
        case "implies":
            return _implication([_condition(part, asking) for part in parts])
        case "iff":
            return _equivalence([_condition(part, asking) for part in parts])
        case "either":
            return _joined([_condition(part, asking) for part in parts], Or, Either)
        case "both":
            return _joined([_condition(part, asking) for part in parts], And, Both)
        case "negation":
            return _negated(parts[0], asking)
        case "until":
            return _until(parts, asking)
        case "later":
            return _later(cast("Token", parts[0]), _condition(parts[1], asking))
        case "comparison":
            return _comparison(parts, asking)
        case "member":
            return _member(parts, asking)
        case "sum":
            return _sum(node, asking)
        case "minus":
            return _minus(node, asking)
    raise AssertionError(node)


def _operand(token: Token, asking: Asking, opposite: Name | None) -> Typed | None:
    match token.type:
        case "BOOLEAN":
            return Typed(Const(token == "true"), Bool())
        case "NUMBER":
            return Typed(Const(int(token)), Range(int(token), int(token)))
        case "QUOTED":
            if opposite is None:
                asking.wrong(token, f"the value {token} has no variable opposite it", "names are quoted with backticks: `name`")
            elif opposite.domain is not None:
                asking.wrong(token, f"{token} is not a value of '{opposite.full}', which is {domain_text(opposite.domain)}")
            return None
    name = asking.scope.find(bare(token))
    if name is None:
        _unknown(token, asking, opposite)
        return None
    asking.used[name.full] = name
    if not _visible(token, name, asking) or name.domain is None:
        return None
    if isinstance(name.kind, VariableKind):
        return Typed(Var(name.full), name.domain)
    part = name.part or Typed(FALSE, name.domain)
    return Typed(Named(name.full, part.expr), name.domain, part.size + 1, part.depth + 1)


def _unknown(token: Token, asking: Asking, opposite: Name | None) -> None:
    word, scope = bare(token), asking.scope
    if scope.silent(word) or (opposite is not None and opposite.domain is None):
        return
    left, _, right = word.rpartition("-")
    words = opposite.domain.words if opposite is not None and isinstance(opposite.domain, Enum) else ()
    truth = {"on": "true", "yes": "true", "off": "false", "no": "false", "True": "true", "False": "false"}.get(word)
    if left and (scope.find(left) or scope.find(word.partition("-")[0])) and (right.isdecimal() or scope.find(right)):
        hint: str | None = f"'-' is part of a name: write {left} - {right}"
    elif truth and opposite is not None and isinstance(opposite.domain, Bool):
        hint = f"write {truth}"
    elif word == "any":
        hint = "'any' is only what a controlled or maintenance transition may assign"
    else:
        hint = asking.close(word, (*words, *scope.words))
    if opposite is not None and opposite.domain is not None:
        which = f"'{opposite.full}', which is {domain_text(opposite.domain)},"
        asking.wrong(token, f"'{word}' is neither a value of {which} nor a variable{asking.where}", hint)
    else:
        asking.wrong(token, f"unknown variable '{word}'{asking.where}", hint)


def _visible(token: Token, name: Name, asking: Asking) -> bool:
    """Whether the expression may read this, given its level."""
    if asking.scope.level == "decision" and name.resources:
        what = f"'{name.full}' is" if name.variable else f"'{name.full}' reads '{name.resources}',"
        hint = "give it a name under 'decision', with 'from'"
        asking.wrong(token, f"{what} a variable of a resource; here only decision variables count", hint)
        return False
    if asking.scope.level == "resource" and name.decisions:
        what = f"'{name.full}' is" if name.variable else f"'{name.full}' reads '{name.decisions}',"
        asking.wrong(token, f"{what} a decision variable; the goal of an operation is over variables of resources")
        return False
    return True


def _size(parts: Iterable[Typed | Timed], more: int = 1) -> int:
    return more + sum(part.size for part in parts)


def _deep(parts: Iterable[Typed | Timed], more: int = 1) -> int:
    return more + max(part.depth for part in parts)


def _timed(part: Typed | Timed) -> Timed:
    return part if isinstance(part, Timed) else Timed(Atom(part.expr), part.size, part.depth)


def _joined(
    parts: Sequence[Typed | Timed | None], kind: type[And] | type[Or], timed: type[Both] | type[Either]
) -> Typed | Timed | None:
    """All or any of several conditions; those without temporal operators become one atom."""
    known = [part for part in parts if part is not None]
    if len(known) < len(parts):
        return None
    plain = [part for part in known if isinstance(part, Typed)]
    whole = Typed(kind(tuple(part.expr for part in plain)), Bool(), _size(plain), _deep(plain)) if len(plain) > 1 else None
    if len(plain) == len(known):
        return whole
    rest = [_timed(part) for part in ([whole] if whole else plain)] + [part for part in known if isinstance(part, Timed)]
    while len(rest) > 1:  # in pairs, so that the formula does not nest deeper than it must
        pairs = zip(rest[::2], rest[1::2], strict=False)
        joined = [Timed(timed(a.formula, b.formula), _size([a, b]), _deep([a, b])) for a, b in pairs]
        rest = joined + rest[2 * len(joined) :]
    return rest[0]


def _not(part: Typed | Timed) -> Typed | Timed:
    if isinstance(part, Timed):
        small = part.size <= MAX_NODES and part.depth <= MAX_DEPTH  # a larger one is refused in the end
        return Timed(negated(part.formula) if small else part.formula, part.size, part.depth)
    return Typed(Not(part.expr), Bool(), part.size + 1, part.depth + 1)


def _negated(node: Node, asking: Asking) -> Typed | Timed | None:
    part = _typed(node, asking)
    if isinstance(part, Typed) and not isinstance(part.domain, Bool):
        _expected("a condition", part, node, asking, "'not' binds tighter than '==': write not (a == b)")
        return None
    return None if part is None else _not(part)


def _implication(parts: Sequence[Typed | Timed | None]) -> Typed | Timed | None:
    whole = parts[-1]
    for part in reversed(parts[:-1]):
        whole = None if part is None or whole is None else _joined([_not(part), whole], Or, Either)
    return whole


def _equivalence(parts: Sequence[Typed | Timed | None]) -> Typed | Timed | None:
    whole = parts[0]
    for part in parts[1:]:
        if part is None or whole is None:
            return None
        if isinstance(part, Typed) and isinstance(whole, Typed):
            whole = Typed(Equal(whole.expr, part.expr), Bool(), _size([whole, part]), _deep([whole, part]))
        elif whole.size + part.size > MAX_NODES:  # it would be written out twice
            return Timed(_timed(whole).formula, 2 * (whole.size + part.size), 1)
        else:
            both = _joined([_not(whole), part], Or, Either), _joined([whole, _not(part)], Or, Either)
            whole = _joined(both, And, Both)
    return whole


def _until(parts: Sequence[Node], asking: Asking) -> Timed | None:
    operators = cast("Sequence[Token]", parts[1::2])
    for each in operators:
        if each != operators[0]:
            message = f"'{operators[0]}' and '{each}' are mixed"
            asking.wrong(each, message, f"put parentheses around one of them: (a {operators[0]} b) {each} c")
            return None
    sides = [_condition(part, asking) for part in parts[::2]]
    if any(side is None for side in sides):
        return None
    whole, *rest = [_timed(side) for side in sides if side is not None]
    for side in rest:  # as in SMV: a U b U c is (a U b) U c
        make = _UNTIL[operators[0]]
        size = _size([whole, side], 2) + (side.size if make is weak_until else 0)
        whole = Timed(make(whole.formula, side.formula), size, _deep([whole, side], 2))
    return whole


def _later(operator: Token, part: Typed | Timed | None) -> Timed | None:
    if part is None:
        return None
    inner = _timed(part)
    return Timed(_LATER[operator](inner.formula), inner.size + 2, inner.depth + 1)


def _comparison(parts: Sequence[Node], asking: Asking) -> Typed | None:
    if len(parts) > 3:
        hint = "write a < b and b < c" if parts[1] != "==" else "write a == b and b == c"
        asking.wrong(parts[3], "comparisons do not chain", hint)
        return None
    left, operator, right = parts
    first, second = _variable(left, asking), _variable(right, asking)
    a: Typed | Timed | None
    b: Typed | Timed | None
    if _is_value(right, first):
        a, b = _typed(left, asking), _value(right, first, asking)
    elif _is_value(left, second):
        a, b = _value(left, second, asking), _typed(right, asking)
    elif isinstance(left, str) and not isinstance(right, str):
        b = _typed(right, asking, first)
        a = _typed(left, asking, _NOBODY if b is None else None)
    else:
        a = _typed(left, asking, second)
        b = _typed(right, asking, _NOBODY if a is None else first)
    return _compared(a, cast("Token", operator), b, (left, right), asking)


def _member(parts: Sequence[Node], asking: Asking) -> Typed | None:
    left, *rest = parts
    a, variable = _typed(left, asking), _variable(left, asking)
    opposite = _NOBODY if a is None else variable
    options = []
    for each in rest:
        b = _value(each, variable, asking) if _is_value(each, variable) else _typed(each, asking, opposite)
        options.append(_compared(a, "==", b, (left, each), asking))
    known = [option for option in options if option is not None]
    if len(known) < len(options):
        return None
    return known[0] if len(known) == 1 else Typed(Or(tuple(each.expr for each in known)), Bool(), _size(known), _deep(known))


def _variable(node: Node, asking: Asking) -> Name | None:
    """The variable or copy that a side of a comparison names."""
    if isinstance(node, str) and node.type in ("NAME", "BACKTICKED"):
        name = asking.scope.find(bare(node))
        return name if name is not None and name.variable else None
    return None


def _is_value(node: Node, variable: Name | None) -> bool:
    """Whether a node is a value, given the variable opposite it."""
    if variable is None or not isinstance(variable.domain, Enum):
        return False
    return _kind(node) == "QUOTED" or (_kind(node) == "NAME" and node in variable.domain.words)


def _value(node: Node, variable: Name | None, asking: Asking) -> Typed | None:
    assert isinstance(node, str)
    assert variable
    assert isinstance(variable.domain, Enum)
    quoted = node.type == "QUOTED"
    word = node[1:-1] if quoted else str(node)
    named = None if quoted else asking.scope.find(word)
    if named is not None and named.variable:
        full = f"`{word}`" if named.full == word else named.full
        message = f"'{word}' is a value of '{variable.full}' and also the variable '{named.full}'"
        asking.wrong(node, message, f"write '{word}' with quotes for the value, {full} for the variable")
        return None
    if word not in variable.domain.words:
        message = f"'{word}' is not a value of '{variable.full}', which is {domain_text(variable.domain)}"
        asking.wrong(node, message, asking.close(word, variable.domain.words))
        return None
    return Typed(Const(word), Enum((word,)))


def _compared(
    a: Typed | Timed | None, operator: str, b: Typed | Timed | None, nodes: tuple[Node, Node], asking: Asking
) -> Typed | None:
    if a is None or b is None:
        return None
    if isinstance(a, Timed) or isinstance(b, Timed):
        _expected("a value", *((a, nodes[0]) if isinstance(a, Timed) else (b, nodes[1])), asking)
        return None
    size, depth = _size([a, b]), _deep([a, b])
    match a.domain, b.domain:
        case Enum(words), Enum(others) if operator in ("==", "=", "!=") and set(words).isdisjoint(others):
            message = f"{asking.quoted(nodes[0])} {_is(a)} and {asking.quoted(nodes[1])} {_is(b)} have no value in common"
            asking.complain(message, None, (span(nodes[0])[0], span(nodes[1])[1]))
            return None
        case (Enum(), Enum()) | (Bool(), Bool()) | (Range(), Range()) if operator in ("==", "="):
            return Typed(Equal(a.expr, b.expr), Bool(), size, depth)
        case (Enum(), Enum()) | (Bool(), Bool()) | (Range(), Range()) if operator == "!=":
            return Typed(Not(Equal(a.expr, b.expr)), Bool(), size + 1, depth + 1)
        case Range(), Range():
            less = Less(a.expr, b.expr) if operator in ("<", ">=") else Less(b.expr, a.expr)
            return Typed(less, Bool(), size, depth) if operator in ("<", ">") else Typed(Not(less), Bool(), size + 1, depth + 1)
    if operator in ("<", "<=", ">", ">="):
        wrong = (b, nodes[1]) if isinstance(a.domain, Range) else (a, nodes[0])
        _expected(f"a whole number beside '{operator}'", *wrong, asking)
        return None
    message = f"cannot compare {asking.quoted(nodes[0])}, which {_is(a)}, with {asking.quoted(nodes[1])}, which {_is(b)}"
    asking.complain(message, None, (span(nodes[0])[0], span(nodes[1])[1]))
    return None


def _sum(node: Tree, asking: Asking) -> Typed | None:
    first, *rest = node.children
    whole = _number(first, asking)
    for sign, each in zip(rest[::2], rest[1::2], strict=True):
        part = _number(each, asking)
        if whole is None or part is None:
            whole = None
            continue
        whole = _added(whole, part, str(sign), node, asking)
    return whole


def _minus(node: Tree, asking: Asking) -> Typed | None:
    part = _number(node.children[1], asking)
    if part is not None and isinstance(part.expr, Const):
        value = -cast(int, part.expr.value)
        return Typed(Const(value), Range(value, value))
    return None if part is None else _added(Typed(Const(0), Range(0, 0)), part, "-", node, asking)


def _added(a: Typed, b: Typed, sign: str, node: Node, asking: Asking) -> Typed | None:
    assert isinstance(a.domain, Range)
    assert isinstance(b.domain, Range)
    expr: Expr
    if sign == "+":
        expr, domain = Plus(a.expr, b.expr), Range(a.domain.low + b.domain.low, a.domain.high + b.domain.high)
    else:
        expr, domain = Minus(a.expr, b.expr), Range(a.domain.low - b.domain.high, a.domain.high - b.domain.low)
    if domain.low < -LARGEST or domain.high > LARGEST:
        asking.wrong(node, f"the result may lie outside -{LARGEST}..{LARGEST}")
        return None
    return Typed(expr, domain, _size([a, b]), _deep([a, b]))


def measured(expr: Expr, domain: Domain) -> Typed:
    """An expression made elsewhere, with its size and depth."""
    done: dict[int, tuple[int, int]] = {}

    def of(node: Expr) -> tuple[int, int]:
        if id(node) not in done:
            inner = [of(part) for part in parts_of(node)]
            done[id(node)] = (1 + sum(size for size, _ in inner), 1 + max((depth for _, depth in inner), default=0))
        return done[id(node)]

    return Typed(expr, domain, *of(expr))


def constant(value: Value) -> Typed:
    match value:
        case bool():
            return Typed(Const(value), Bool())
        case int():
            return Typed(Const(value), Range(value, value))
    return Typed(Const(value), Enum((value,)))
