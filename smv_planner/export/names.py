"""Names in SMV text: a bijection between the names of a scenario and identifiers that mean nothing else.

Every identifier opens with the letter of its sort and an underscore. No reserved word of NuSMV, nuXmv or PSL does, so
no name can collide with one; sorts are disjoint; and the alphabet `[A-Za-z0-9_]` leaves no way to close a section,
open a comment or reach a shell. A name made of plain words keeps them: `r1.pos_m` is `v_r1__pos_m`. Any other name
is z-encoded as a whole behind a second underscore, as GHC does: `pos-3` is `v__poszm3`.
"""

from __future__ import annotations

import re
from enum import StrEnum


class Sort(StrEnum):
    VARIABLE = "v"
    VALUE = "k"
    PREDICATE = "d"
    TRANSITION = "t"
    PROPERTY = "p"
    MODULE = "m"
    INTERNAL = "x"


_PLAIN = re.compile(r"[A-Za-z0-9]+(_[A-Za-z0-9]+)*(\.[A-Za-z0-9]+(_[A-Za-z0-9]+)*)*")
_SHORT = {"z": "zz", "_": "zu", ".": "zd", "-": "zm", "/": "zs"}
_LONG = {code: letter for letter, code in _SHORT.items()}
_CODE = re.compile(r"zx([0-9a-f]{1,6})_|z[zudms]|[A-Za-z0-9]")


def identifier(sort: Sort, name: str) -> str:
    """The SMV identifier of a name; total and injective."""
    if _PLAIN.fullmatch(name):
        return f"{sort}_{name.replace('.', '__')}"
    return f"{sort}__{''.join(map(_encoded, name))}"


def original(text: str) -> tuple[Sort, str]:
    """The sort and the name behind an identifier. Raises ValueError for anything that `identifier` does not produce."""
    try:
        sort = Sort(text[:1])
        name = _decoded(text[3:]) if text[1:3] == "__" else text[2:].replace("__", ".")
    except (ValueError, OverflowError) as problem:
        raise ValueError(f"not an identifier of ours: {text!r}") from problem
    if identifier(sort, name) != text:
        raise ValueError(f"not an identifier of ours: {text!r}")
    return sort, name


def _encoded(letter: str) -> str:
    if letter.isascii() and letter.isalnum() and letter != "z":
        return letter
    return _SHORT.get(letter) or f"zx{ord(letter):x}_"


def _decoded(text: str) -> str:
    letters: list[str] = []
    at = 0
    while at < len(text):
        code = _CODE.match(text, at)
        if code is None:
            raise ValueError(text)
        letters.append(chr(int(code[1], 16)) if code[1] else _LONG.get(code[0], code[0]))
        at = code.end()
    return "".join(letters)


# NuSMV 2.5.4 (each refused as a name by the binary), what 2.6 and nuXmv 2 add, PSL's lexer (some also end in `!`),
# and three names with a meaning of their own. Kept as data: the scheme never consults it, the tests run all of it.
_WORDS = """
    A ABF ABG AF AG ASSIGN AX BU COMPASSION COMPID COMPUTE COMPWFF CONSTANTS CONSTRAINT CTLSPEC CTLWFF DEFINE E EBF EBG
    EF EG EX F FAIRNESS FALSE FROZENVAR G H IN INIT INVAR INVARSPEC ISA IVAR Integer JUSTICE LTLSPEC LTLWFF MAX MDEFINE
    MIN MIRROR MODULE NAME NEXTWFF O PRED PREDICATES PSLSPEC READ Real S SIMPWFF SPEC T TRANS TRUE U V VAR WRITE Word X
    Y Z array bool boolean case count esac extend in init integer mod next of process real resize self signed sizeof
    swconst toint union unsigned uwconst word word1 xnor xor

    CONSTARRAY DISPROVE ELTLSPEC FUN GOTO ITYPE PSLWFF abs max min typeof

    @F~ @O~ Clock PARSYNTH R SAT URGENT VALID X~ Y~ at clock continuous cos discrete exp floor last ln noncontinuous pi
    pow sin since tan time until

    W abort always before before_ eventually eventually! forall forany grsequence inf negedge never next_a next_e
    next_event next_event_a next_event_e or posedge property select sequence until_ whilenot whilenot_ within within_

    _process_selector_ main running
    """
RESERVED = frozenset(_WORDS.split())
