"""A second opinion on SMV text: its own lexer, which knows nothing of how the text was made."""

from __future__ import annotations

import re
from collections import Counter

TOKEN = re.compile(
    r"(?P<comment>--[^\n]*)|(?P<word>[A-Za-z_][A-Za-z0-9_$#-]*)|(?P<number>[0-9]+)"
    r"|(?P<sign>:=|\.\.|->|!=|>=|<=|[-:;,{}()!&|=<>+?])|(?P<space>[ \n]+)"
)
SECTIONS = ("MODULE", "VAR", "IVAR", "FROZENVAR", "DEFINE", "ASSIGN", "INIT", "TRANS", "INVAR", "LTLSPEC")
KEYWORDS = frozenset((*SECTIONS, "main", "boolean", "init", "next", "case", "esac", "TRUE", "FALSE", "X", "F", "G", "U", "V"))


def tokens(text: str) -> list[tuple[str, str]]:
    """Kinds and texts, without spaces. Fails on anything that SMV could read in another way."""
    assert text.isascii()
    assert "\r" not in text
    assert "\t" not in text
    found, at = [], 0
    while at < len(text):
        token = TOKEN.match(text, at)
        assert token, f"no token of ours: {text[at : at + 40]!r}"
        assert token.lastgroup
        if token.lastgroup != "space":
            found.append((token.lastgroup, token[0]))
        at = token.end()
    return found


def words(text: str) -> Counter[str]:
    """How often each word occurs outside comments."""
    return Counter(token for kind, token in tokens(text) if kind == "word")


def comments(text: str) -> list[str]:
    return [token for kind, token in tokens(text) if kind == "comment"]


def balanced(text: str) -> bool:
    """Whether all brackets and `case` are closed in order."""
    partner = {")": "(", "}": "{", "esac": "case"}
    waiting: list[str] = []
    for _, token in tokens(text):
        if token in partner.values():
            waiting.append(token)
        elif token in partner and (not waiting or waiting.pop() != partner[token]):
            return False
    return not waiting


def depth(text: str) -> int:
    """How deep brackets nest."""
    now = most = 0
    for _, token in tokens(text):
        now += (token in ("(", "{")) - (token in (")", "}"))
        most = max(most, now)
    return most
