"""The grammar of expressions, written down: lark, which reads it, finds the same trees and the same mistakes as our parser."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from itertools import product
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from lark import Lark, UnexpectedToken
from lark import Token as LarkToken
from lark.lexer import Lexer

from smv_planner.language.grammar import Node, Token, Tree, Unexpected, tree_of

GRAMMAR = """
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

WORDS = {
    "a": "NAME", "b": "NAME", "`c`": "BACKTICKED", "'v'": "QUOTED", "1": "NUMBER", "true": "BOOLEAN", "(": "_LPAR", ")": "_RPAR",
    "{": "_LBRACE", "}": "_RBRACE", ",": "_COMMA", "not": "_NOT", "and": "_AND", "or": "_OR", "in": "_IN", "->": "_IMPLIES",
    "<->": "_IFF", "U": "BINARY", "R": "BINARY", "G": "TEMPORAL", "X": "TEMPORAL", "==": "COMPARE", "<": "COMPARE",
    "+": "PLUS", "-": "MINUS",
}  # fmt: skip

Seen = tuple[str, object]
"""A tree, or where it breaks off and whether an operand was wanted there."""


class Cut(Lexer):
    """Passes on tokens that are cut already."""

    def __init__(self, conf: object) -> None:
        pass

    def lex(self, tokens: Any, *_: Any) -> Iterator[LarkToken]:
        return iter(tokens)


@cache
def lark() -> Lark:
    return Lark(GRAMMAR, start="implies", parser="lalr", lexer=Cut)


def by_lark(words: list[str]) -> Seen:
    tokens = [LarkToken(WORDS[word], word, at, end_pos=at + 1) for at, word in enumerate(words)]
    try:
        return "tree", shape(lark().parse(tokens))  # type: ignore[arg-type]
    except UnexpectedToken as error:
        at = next((at for at, token in enumerate(tokens) if token is error.token), len(tokens))
        return "breaks off", (at, "NAME" in (error.accepts or error.expected))


def by_us(words: list[str]) -> Seen:
    tokens = [Token(WORDS[word], word, at, at + 1) for at, word in enumerate(words)]
    try:
        return "tree", shape(tree_of(tokens))
    except Unexpected as error:
        return "breaks off", (error.at, error.wants_operand)


def shape(node: Node | Any) -> object:
    return str(node) if isinstance(node, str) else (str(node.data), [shape(child) for child in node.children])


PIECES = st.sampled_from(list(WORDS)).map(lambda word: [word])
OPERANDS = st.sampled_from(["a", "b", "1", "'v'", "true"]).map(lambda word: [word])


def larger(smaller: st.SearchStrategy[list[str]]) -> st.SearchStrategy[list[str]]:
    operators = st.sampled_from(["and", "or", "->", "<->", "U", "R", "==", "<", "+", "-"])
    return st.one_of(
        st.tuples(smaller, operators, smaller).map(lambda parts: [*parts[0], parts[1], *parts[2]]),
        st.tuples(st.sampled_from(["not", "-", "G", "X"]), smaller).map(lambda parts: [parts[0], *parts[1]]),
        smaller.map(lambda part: ["(", *part, ")"]),
        st.tuples(smaller, smaller, smaller).map(lambda parts: [*parts[0], "in", "{", *parts[1], ",", *parts[2], "}"]),
    )


LIKELY = st.recursive(OPERANDS, larger, max_leaves=12)
"""Mostly expressions; what binds differently than it was put together may be none."""


@settings(max_examples=1000, deadline=None)
@given(LIKELY, st.integers(0, 40), st.one_of(st.none(), PIECES))
@example(["not", "G", "a", "==", "b", "U", "-", "b", "in", "{", "1", ",", "a", "}", "+", "1"], 40, None)
def test_lark_finds_the_same_tree_or_the_same_mistake(words: list[str], at: int, planted: list[str] | None) -> None:
    text = words if planted is None else [*words[:at], *planted, *words[at:]]
    assert by_us(text) == by_lark(text), " ".join(text)


@pytest.mark.parametrize("length", [1, 2, 3])
def test_lark_agrees_on_everything_short(length: int) -> None:
    one_of_a_kind = list({kind: word for word, kind in WORDS.items() if kind not in ("BACKTICKED", "QUOTED", "BOOLEAN")}.values())
    found = {"tree": 0, "breaks off": 0}
    for words in product(one_of_a_kind, repeat=length):
        ours = by_us(list(words))
        assert ours == by_lark(list(words)), " ".join(words)
        found[ours[0]] += 1
    assert all(found.values())


def test_a_tree_may_be_as_deep_as_it_likes() -> None:
    words = ["("] * 10_000 + ["a"] + [")"] * 10_000
    assert by_us(words) == ("tree", "a")
    assert isinstance(tree_of([Token("_NOT", "not", 0, 3)] * 10_000 + [Token("NAME", "a", 0, 1)]), Tree)
