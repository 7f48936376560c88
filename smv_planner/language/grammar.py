"""The grammar of expressions and formulas: text -> tree, with messages for people.

Nothing is looked up here. The tokens are cut by hand, because what a name may look like and whether `G` is an operator
depend on more than a character. The tree is built in one pass over them with a stack of what has begun, so nothing
recurses. The grammar is written down in tests/language/test_grammar.py, where lark holds this parser to it: to import lark
and to build its tables would take longer than to read a scenario.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from smv_planner.language.document import LARGEST, MAX_NAME, NAME, NAME_RULE
from smv_planner.lazy import dataclass

MAX_LENGTH = 100_000
MAX_TOKENS = 20_000
MAX_DEPTH = 64

_JOINS = {
    "_IMPLIES": (1, "implies"), "_IFF": (2, "iff"), "_OR": (3, "either"), "_AND": (4, "both"), "BINARY": (5, "until"),
    "COMPARE": (7, "comparison"), "PLUS": (9, "sum"), "MINUS": (9, "sum"),
}  # fmt: skip
"""How tightly operators bind, and what they make of all that stands between those of one tightness."""

_BRACKET, _PREFIXED_LATER, _MEMBER, _PREFIXED = 0, 6, 8, 10
"""How tightly what is no such operator binds: `G` takes comparisons with it, `not` and the sign one operand."""

_SIGNS = {
    "<->": "_IFF", "->": "_IMPLIES", "==": "COMPARE", "!=": "COMPARE", "<=": "COMPARE", ">=": "COMPARE", "<": "COMPARE",
    ">": "COMPARE", "=": "COMPARE", "!": "_NOT", "&": "_AND", "|": "_OR", "+": "PLUS", "-": "MINUS", "(": "_LPAR",
    ")": "_RPAR", "{": "_LBRACE", "}": "_RBRACE", ",": "_COMMA",
}  # fmt: skip
_WORDS = {"and": "_AND", "or": "_OR", "not": "_NOT", "in": "_IN", "true": "BOOLEAN", "false": "BOOLEAN"}
_TEMPORAL = {"G": "TEMPORAL", "F": "TEMPORAL", "X": "TEMPORAL", "U": "BINARY", "R": "BINARY", "W": "BINARY"}
_OPERANDS = frozenset({"NAME", "BACKTICKED", "QUOTED", "NUMBER", "BOOLEAN"})
_CLOSES = {"_RPAR": ("(", "_LPAR"), "_RBRACE": ("{", "_LBRACE")}
_WRITE = {
    "&&": "write 'and' or '&'", "||": "write 'or' or '|'", "=>": "write '->'", "AND": "write 'and'", "OR": "write 'or'",
    "NOT": "write 'not'", "IN": "write 'in'", "<>": "write '!='", "=!": "write '!='", "IMPLIES": "write '->'",
}  # fmt: skip

_SIMPLER = "name parts of the expression as predicates"

_TOKEN = re.compile(
    r"""\s+ | (?P<word>\w+(?:-+\w+)*(?:\.\w+(?:-+\w+)*)*) | (?P<QUOTED>'[^']*') | (?P<BACKTICKED>`[^`]*`)
    | (?P<sign><->|->|==|!=|<=|>=|[-=<>!&|+(){},]) | (?P<other>.)""",
    re.VERBOSE | re.DOTALL,
)
_NAME = re.compile(NAME)


class NotRead(Exception):
    """A text that is no expression: what is wrong, from where to where, and what to do about it."""

    def __init__(self, message: str, start: int, end: int, hint: str | None = None) -> None:
        super().__init__(message)
        self.message, self.start, self.end, self.hint = message, start, end, hint


class Token(str):
    """A word or sign of the text, of a type, from `start` to `end`."""

    __slots__ = ("end", "start", "type")

    type: str
    start: int
    end: int

    def __new__(cls, type: str, text: str, start: int, end: int) -> Token:
        token = super().__new__(cls, text)
        token.type, token.start, token.end = type, start, end
        return token


@dataclass(frozen=True, slots=True)
class Tree:
    """Part of an expression: what kind, of what. Of the operators those are children that could be others."""

    data: str
    children: list[Tree | Token]


Node = Tree | Token


def parse(text: str, temporal: bool) -> Node:
    """The tree of an expression, or of a formula if `temporal`. A single operand is its own tree."""
    tokens = list(_tokens(text, temporal))
    if not tokens:
        raise NotRead("expected an expression, but there is nothing", 0, len(text))
    try:
        tree = tree_of(tokens)
    except Unexpected as error:
        raise _syntax(tokens, error.at, error.wants_operand, temporal) from None
    if _depth(tree) > MAX_DEPTH:
        raise NotRead(f"nested more than {MAX_DEPTH} levels deep", 0, len(text), _SIMPLER)
    return tree


class Unexpected(Exception):
    """The token at `at`, or the end, cannot follow on those before it; whether an operand could."""

    def __init__(self, at: int, wants_operand: bool) -> None:
        super().__init__(at, wants_operand)
        self.at, self.wants_operand = at, wants_operand


@dataclass(slots=True)
class _Begun:
    """Something that waits for its last child. `kind` is the kind of tree, or the token type of an open bracket."""

    level: int
    kind: str
    children: list[Node]


def tree_of(tokens: list[Token]) -> Node:
    """The tree of a text that is cut already. Raises Unexpected at the first token that nothing after it could make right."""
    begun: list[_Begun] = []
    node: Node | None = None  # the operand that has just been read; None where one is wanted
    last = ""
    for at, token in enumerate(tokens):
        node = _operand(begun, token, last, at) if node is None else _operator(begun, node, token, last, at)
        last = token.type
    if node is None:
        raise Unexpected(len(tokens), last != "_IN")
    node = _ended(begun, node, _BRACKET)
    if begun:
        raise Unexpected(len(tokens), wants_operand=False)
    return node


def _operand(begun: list[_Begun], token: Token, last: str, at: int) -> Node | None:
    """Take a token where an operand is wanted: it is one, or begins one."""
    match token.type:
        case "_LBRACE" if last == "_IN":
            begun.append(_Begun(_BRACKET, "_LBRACE", []))
        case _ if last == "_IN":
            raise Unexpected(at, wants_operand=False)
        case kind if kind in _OPERANDS:
            return token
        case "_LPAR":
            begun.append(_Begun(_BRACKET, "_LPAR", []))
        case "_NOT":
            begun.append(_Begun(_PREFIXED, "negation", []))
        case "MINUS":
            begun.append(_Begun(_PREFIXED, "minus", [token]))
        case "TEMPORAL" if _may_be_timed(begun):
            begun.append(_Begun(_PREFIXED_LATER, "later", [token]))
        case _:
            raise Unexpected(at, wants_operand=True)
    return None


def _operator(begun: list[_Begun], node: Node, token: Token, last: str, at: int) -> Node | None:
    """Take a token that follows on an operand: it joins that to another one, or closes a bracket."""
    kind = token.type
    level, joined = (_MEMBER, "member") if kind == "_IN" else _JOINS.get(kind, (_BRACKET, ""))
    node = _ended(begun, node, level)
    bracket = begun[-1].kind if begun and begun[-1].level == _BRACKET else ""
    if joined and bracket != "_LBRACE" and not (last == "_RBRACE" and level >= _MEMBER):
        if not begun or begun[-1].level != level:
            begun.append(_Begun(level, joined, []))
        begun[-1].children += [node] if kind.startswith("_") else [node, token]
        return None
    match kind, bracket:
        case "_RPAR", "_LPAR":
            begun.pop()
            return node
        case "_COMMA", "_LBRACE":
            begun[-1].children.append(node)
            return None
        case "_RBRACE", "_LBRACE":
            values = [*begun.pop().children, node]
            return Tree("member", [*begun.pop().children, *values])
    raise Unexpected(at, wants_operand=False)


def _ended(begun: list[_Begun], node: Node, level: int) -> Node:
    """The operand, after all that binds more tightly than `level` has ended with it."""
    while begun and begun[-1].level > level:
        ended = begun.pop()
        node = Tree(ended.kind, [*ended.children, node])
    return node


def _may_be_timed(begun: list[_Begun]) -> bool:
    """Whether a temporal operator may stand here: not below a comparison, a sum or a sign."""
    outer = next((each for each in reversed(begun) if each.kind != "negation"), None)
    return outer is None or (outer.kind != "_LBRACE" and outer.level <= _PREFIXED_LATER)


def span(node: Node) -> tuple[int, int]:
    """Where a part of an expression starts and ends, parentheses around it apart."""
    first, last = node, node
    while not isinstance(first, str):
        first = first.children[0]
    while not isinstance(last, str):
        last = last.children[-1]
    return first.start, last.end


def _tokens(text: str, temporal: bool) -> Iterator[Token]:
    if len(text) > MAX_LENGTH:
        raise NotRead(f"the expression is longer than {MAX_LENGTH} characters", 0, len(text))
    keywords = _WORDS | _TEMPORAL if temporal else _WORDS
    depth = count = prefixes = 0
    for match in _TOKEN.finditer(text):
        if match.lastgroup is None:
            continue
        start, end, word = match.start(), match.end(), match.group()
        kind = _SIGNS.get(word) or keywords.get(word) or match.lastgroup
        if kind == "word":
            kind = _kind_of(word, start, end)
        if kind == "other" or (kind == "BACKTICKED" and not _NAME.fullmatch(word[1:-1])):
            raise _odd(word, start, end)
        yield Token(kind, word, start, end)
        count += 1
        depth += (kind in ("_LPAR", "_LBRACE")) - (kind in ("_RPAR", "_RBRACE"))
        prefixes = prefixes + 1 if kind in ("_NOT", "MINUS", "TEMPORAL") else 0
        if max(depth, prefixes) > MAX_DEPTH:
            raise NotRead(f"nested more than {MAX_DEPTH} levels deep", start, end, _SIMPLER)
        if count > MAX_TOKENS:
            raise NotRead("the expression is too long", 0, len(text), _SIMPLER)


def _kind_of(word: str, start: int, end: int) -> str:
    if len(word) > MAX_NAME:
        raise NotRead(f"'{word[:40]}...' is longer than {MAX_NAME} characters", start, end)
    if _NAME.fullmatch(word):
        return "NAME"
    if word.isdecimal() and word.isascii() and (word == "0" or word[0] != "0"):
        if int(word) > LARGEST:
            raise NotRead(f"{word[:40]} is too large", start, end, f"the largest number is {LARGEST}")
        return "NUMBER"
    hint = "a name needs a letter between dots"
    if re.fullmatch(r"[0-9]+-[0-9]+", word):
        hint = f"write {word.replace('-', ' - ')}"
    elif re.fullmatch(r"0[0-9]+", word):
        hint = f"write {word.lstrip('0') or '0'}"
    elif re.fullmatch(r"[0-9]+\.[0-9]+", word):
        hint = "numbers are whole"
    raise NotRead(f"'{word}' is neither a name nor a number", start, end, hint)


def _odd(word: str, start: int, end: int) -> NotRead:
    if word[0] == "`" and len(word) > 1:
        return NotRead(f"{word[:40]} is not a name", start, end, NAME_RULE)
    if word in "'`":
        return NotRead(f"this {word} is never closed", start, end)
    hint = "write values in single quotes" if word == '"' else "there is no such operator" if word in "*/%^?:;~@#$\\[]" else None
    return NotRead(f"unexpected '{word}'" if word.isprintable() else f"unexpected character U+{ord(word):04X}", start, end, hint)


def _syntax(tokens: list[Token], at: int, wants_operand: bool, temporal: bool) -> NotRead:
    """What people would call the mistake at a token, before which everything was right."""
    wrong = tokens[at] if at < len(tokens) else None
    before = tokens[at - 1] if at else None
    start, end = (tokens[-1].end, tokens[-1].end + 1) if wrong is None else (wrong.start, wrong.end)
    found = "" if wrong is None else f", not '{wrong}'"
    after = f" after '{before}'" if before else ""
    hint = _hint(before, wrong, temporal)
    if wants_operand:
        if before and before.type in ("COMPARE", "PLUS", "MINUS", "_LBRACE", "_COMMA"):
            what = "a value"
        else:
            what = "a condition" if before else "an expression"
        if what == "a value" and (wrong in _WORDS or wrong in _TEMPORAL):
            hint = f"quote it if it is a value, '{wrong}', or a name, `{wrong}`"
        return NotRead(f"expected {what}{after}{found}", start, end, hint)
    if before is not None and before.type == "_IN":
        return NotRead(f"expected '{{' after 'in'{found}", start, end, "write in {a, b}")
    unclosed = _unclosed(tokens[:at])
    if wrong is None and unclosed:
        return NotRead(f"this '{unclosed}' is never closed", unclosed.start, unclosed.end)
    if wrong is not None and wrong.type in _CLOSES and (not unclosed or unclosed.type != _CLOSES[wrong.type][1]):
        return NotRead(f"there is no '{_CLOSES[wrong.type][0]}' before this '{wrong}'", start, end)
    if unclosed and unclosed.type == "_LBRACE":
        return NotRead(f"expected ',' or '}}'{after}{found}", start, end)
    if wrong is not None and (wrong.type in _OPERANDS or wrong.type in ("_NOT", "TEMPORAL", "_LPAR")):
        return NotRead(f"expected an operator between '{before}' and '{wrong}'", start, end, hint)
    return NotRead(f"'{wrong}' cannot stand{after}", start, end, hint)


def _hint(before: Token | None, wrong: Token | None, temporal: bool) -> str | None:
    """What to write instead, where two tokens come from another language or belong into a formula."""
    both = f"{before or ''}{wrong or ''}"
    for each in (both, before, wrong):
        if each in _WRITE:
            return _WRITE[each]
        if each in _TEMPORAL and not temporal:
            return f"'{each}' is an operator in formulas only"
    return None


def _unclosed(tokens: list[Token]) -> Token | None:
    open_: list[Token] = []
    for token in tokens:
        if token.type in ("_LPAR", "_LBRACE"):
            open_.append(token)
        elif token.type in _CLOSES and open_:
            open_.pop()
    return open_[-1] if open_ else None


def _depth(tree: Node) -> int:
    depth, level = 0, [tree]
    while level:
        depth += 1
        level = [child for node in level if isinstance(node, Tree) for child in node.children]
    return depth
