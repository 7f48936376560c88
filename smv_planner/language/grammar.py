"""The grammar of expressions and formulas: text -> lark tree, with messages for people.

Nothing is looked up here. The tokens are cut by hand, because what a name may look like and whether `G` is an operator
depend on more than a character; lark's LALR tables, built at the first use, do the rest. Neither recurses.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lark import Lark, Token, Tree

from smv_planner.language.document import LARGEST, MAX_NAME, NAME, NAME_RULE

MAX_LENGTH = 100_000
MAX_TOKENS = 20_000
MAX_DEPTH = 64

_GRAMMAR = """
?implies: iff (_IMPLIES iff)*
?iff: either (_IFF either)*
?either: both (_OR both)*
?both: until (_AND until)*
?until: temporal (BINARY temporal)*
?temporal: comparison | pure
?pure: TEMPORAL temporal -> later | _NOT pure -> negation
?comparison: member (COMPARE member)*
?member: sum | sum _IN _LBRACE unary (_COMMA unary)* _RBRACE
?sum: unary ((PLUS | MINUS) unary)*
?unary: atom | _NOT unary -> negation | MINUS unary -> minus
?atom: NAME | BACKTICKED | QUOTED | NUMBER | BOOLEAN | _LPAR implies _RPAR
%declare _IMPLIES _IFF _OR _AND _NOT _IN BINARY TEMPORAL COMPARE PLUS MINUS
%declare _LBRACE _RBRACE _COMMA _LPAR _RPAR NAME BACKTICKED QUOTED NUMBER BOOLEAN
"""

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


def parse(text: str, temporal: bool) -> Tree[Token] | Token:
    """The tree of an expression, or of a formula if `temporal`. A single operand is its own tree."""
    from lark import UnexpectedToken

    tokens = list(_tokens(text, temporal))
    if not tokens:
        raise NotRead("expected an expression, but there is nothing", 0, len(text))
    if len(tokens) == 1 and tokens[0].type in _OPERANDS:
        return tokens[0]
    try:
        tree: Tree[Token] | Token = _lark().parse(tokens)
    except UnexpectedToken as error:
        raise _syntax(tokens, error.token, error.accepts or error.expected, temporal) from None
    if _depth(tree) > MAX_DEPTH:
        raise NotRead(f"nested more than {MAX_DEPTH} levels deep", 0, len(text), _SIMPLER)
    return tree


def span(node: Tree[Token] | Token) -> tuple[int, int]:
    """Where a part of an expression starts and ends, parentheses around it apart."""
    first, last = node, node
    while not isinstance(first, str):
        first = first.children[0]
    while not isinstance(last, str):
        last = last.children[-1]
    return first.start_pos or 0, last.end_pos or 0


@cache
def _lark() -> Lark:
    from lark import Lark
    from lark.lexer import Lexer

    class Cut(Lexer):
        """Passes on tokens that are cut already."""

        def __init__(self, conf: object) -> None:
            pass

        def lex(self, tokens: Any, *_: Any) -> Iterator[Token]:
            return iter(tokens)

    return Lark(_GRAMMAR, start="implies", parser="lalr", lexer=Cut)


def _tokens(text: str, temporal: bool) -> Iterator[Token]:
    from lark import Token

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
        yield Token(kind, word, start, end_pos=end)
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


def _syntax(tokens: list[Token], wrong: Token, expected: Any, temporal: bool) -> NotRead:
    """What people would call the mistake at the token `wrong`, before which everything was right."""
    at = next((n for n, token in enumerate(tokens) if token is wrong), len(tokens))
    before = tokens[at - 1] if at else None
    ended = at == len(tokens)
    start, end = (tokens[-1].end_pos or 0, (tokens[-1].end_pos or 0) + 1) if ended else (wrong.start_pos or 0, wrong.end_pos or 0)
    found = "" if ended else f", not '{wrong}'"
    after = f" after '{before}'" if before else ""
    hint = _hint(before, None if ended else wrong, temporal)
    if "NAME" in expected:
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
    if ended and unclosed:
        return NotRead(f"this '{unclosed}' is never closed", unclosed.start_pos or 0, unclosed.end_pos or 0)
    if not ended and wrong.type in _CLOSES and (not unclosed or unclosed.type != _CLOSES[wrong.type][1]):
        return NotRead(f"there is no '{_CLOSES[wrong.type][0]}' before this '{wrong}'", start, end)
    if unclosed and unclosed.type == "_LBRACE":
        return NotRead(f"expected ',' or '}}'{after}{found}", start, end)
    if not ended and (wrong.type in _OPERANDS or wrong.type in ("_NOT", "TEMPORAL", "_LPAR")):
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


def _depth(tree: Any) -> int:
    depth, level = 0, [tree]
    while level:
        depth += 1
        level = [child for node in level if not isinstance(node, str) for child in node.children]
    return depth
