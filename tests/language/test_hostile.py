"""Texts made to break a reader: each is refused with a mistake, and soon."""

from __future__ import annotations

import time

import pytest
from language.marked import DEVICE

from smv_planner.errors import ModelError, UsageError
from smv_planner.language import formula, load, loads, predicate

SOON = 5.0
"""Seconds of processor time. They take tenths at most; a slow machine is not what is tested."""

MIB = 1 << 20
HEAD = "smv_planner: 1\nname: x\n"


def table(section, entries):
    return f"{section}:\n" + "".join(f"  {each}\n" for each in entries)


def variables(count):
    return HEAD + "decision:\n" + "".join(f"  v{n}: {{domain: bool, initial: true}}\n" for n in range(count))


def transitions(count):
    return DEVICE + table("transitions", [f"t{n}: {{kind: controlled, actions: {{state: seen}}}}" for n in range(count)])


def doubling(times):
    return DEVICE + table("predicates", ["p0: d.lock", *(f"p{n}: p{n - 1} and p{n - 1}" for n in range(1, times + 1))])


TEXTS = {
    "a bomb of aliases": ("a: &a [x, x]\n" + "".join(f"b{n}: &b{n} [*a, *a, *a]\n" for n in range(100)), "'&a' is a YAML anchor"),
    "a bomb of merge keys": (HEAD + "x: {<<: {a: b}}\n" * 2000, "merge keys ('<<') are not allowed"),
    "100 000 lists": ("[" * 100_000, "nested more than 32 levels deep"),
    "100 000 mappings": ("{" * 100_000, "nested more than 32 levels deep"),
    "100 000 dashes": ("- " * 100_000, "nested more than 32 levels deep"),
    "100 000 keys of keys": ("? " * 100_000, "nested more than 32 levels deep"),
    "a scalar of 5 MB": ("a: " + "x" * 5 * MIB, "the text is larger than 1048576 bytes"),
    "just too many bytes": ("#" + "ä" * (MIB // 2), "the text is larger than 1048576 bytes"),
    "1 MiB of one word": ("x" * MIB, "this is not a scenario"),
    "1 MiB of signs": ("ab:%@!{}[]" * (MIB // 10), "this is not a scenario"),
    "1 MiB of NUL": ("\0" * MIB, "the character U+0000 is not allowed"),
    "1 MiB of quotes": ("'" * MIB, "this is not a scenario"),
    "100 001 entries": (HEAD + table("predicates", (f"p{n}: d" for n in range(50_001))), "more than 100000 entries"),
    "the same key 50 000 times": (HEAD + "k: x\n" * 50_000, "'k' is here twice"),
    "50 000 unknown keys in a line": (HEAD + "resources: {" + "k: x, " * 20_000 + "}", "'k' is here twice"),
    "5 000 unknown names": (DEVICE + table("invariants", (f"i{n}: x{n}" for n in range(5_000))), "unknown variable 'x0'"),
    "a name for many to resemble": (
        variables(4000) + table("invariants", (f"i{n}: w{n}" for n in range(4000))),
        "unknown variable 'w0'",
    ),
    "a circle of 5 000": (
        DEVICE + table("predicates", [*(f"p{n}: not p{n + 1}" for n in range(1, 5000)), "p5000: p1"]),
        "'p1' is defined by itself: p1 -> p2 -> p3 -> p4 -> ... -> p4999 -> p5000 -> p1",
    ),
    "100 in each other's circles": (
        DEVICE + table("predicates", [f"p{n}: {' and '.join(f'p{m}' for m in range(100))}" for n in range(100)]),
        "'p0' is defined by itself: p0 -> p0",
    ),
    "5 000 predicates on each other": (
        DEVICE + table("predicates", [*(f"p{n}: not p{n + 1}" for n in range(1, 5000)), "p5000: d.lock"]),
        "the expression has more than 64 levels, predicates written out",
    ),
    "predicates that double 64 times": (doubling(64), "the expression has more than 10000 parts, predicates written out"),
    "large predicates used often": (
        DEVICE + table("predicates", [f"p: {' or '.join(['d.lock'] * 4000)}", *(f"q{n}: p or home" for n in range(1000))]),
        "all expressions together have more than 2000000 parts, predicates written out",
    ),
    "5 001 variables": (variables(5001), "there are 5001 variables; the limit is 5000"),
    "a domain of 30 000 words": (
        HEAD + f"decision:\n  v: {{domain: [{', '.join(f'w{n}' for n in range(30_000))}], initial: w0}}",
        "this domain has 30000 values; the limit is 1024",
    ),
    "wrong parts of one block scalar": (
        DEVICE + "invariants:\n  i: >\n" + "    zz and\n" * 4000 + "    zz\n",
        "unknown variable 'zz' in the invariant 'i'",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("text", "message"), TEXTS.values(), ids=TEXTS)
def test_a_hostile_text_is_refused_soon(text, message):
    start = time.process_time()
    with pytest.raises(ModelError) as caught:
        loads(text)
    assert time.process_time() - start < SOON
    assert any(mistake.message.startswith(message) for mistake in caught.value.mistakes)
    assert len(caught.value.mistakes) <= 1001
    assert len(str(caught.value)) < MIB


def test_a_file_without_end_is_not_read_to_its_end(tmp_path):
    with (tmp_path / "model.yaml").open("wb") as file:
        file.truncate(1 << 40)
    with pytest.raises(ModelError, match="the file is larger than 1048576 bytes"):
        load(tmp_path)


@pytest.mark.parametrize("text", [variables(5000), doubling(11)], ids=["5 000 variables", "predicates that double 11 times"])
def test_what_is_just_within_the_limits_is_a_model(text):
    assert loads(text)


MODEL = loads(DEVICE)
EXPRESSIONS = {
    "parentheses": ("(" * 40_000 + "d.lock" + ")" * 40_000, "nested more than 64 levels deep"),
    "not": ("not " * 10_000 + "d.lock", "nested more than 64 levels deep"),
    "minus": ("-" * 10_000 + "d.wear == 0", "nested more than 64 levels deep"),
    "100 000 terms": ("d.wear" + " + d.wear" * 100_000 + " == 3", "the expression is longer than 100000 characters"),
    "33 000 terms": ("1" + "+1" * 33_000 + " == 3", "the expression is too long"),
    "3 000 terms": ("d.wear" + " + d.wear" * 3_000 + " == 3", "the expression has more than "),
    "implications": ("d.lock" + " -> d.lock" * 4_000, "the expression has more than "),
    "equivalences": ("d.lock" + " <-> d.lock" * 4_000, "the expression has more than "),
    "one long name": ("d" * 90_000, f"'{'d' * 40}...' is longer than 200 characters"),
    "one long number": ("1" * 90_000, f"'{'1' * 40}...' is longer than 200 characters"),
    "dashes in a name": ("a-" * 40_000 + "a", f"'{'a-' * 20}...' is longer than 200 characters"),
    "dots in a name": ("a." * 40_000 + "a", f"'{'a.' * 20}...' is longer than 200 characters"),
    "a quote without end": ("'" + "a" * 90_000, "this ' is never closed"),
    "one value often": (f"d.pos in {{{', '.join(['closed'] * 9_000)}}}", "the expression has more than "),
    "9 000 unknown names": ("x" + " or x" * 9_000, "unknown variable 'x'"),
}
FORMULAS = {
    "until": ("d.lock" + " U d.lock" * 4_000, "the expression has more than "),
    "not until": ("not (d.lock" + " U d.lock" * 4_000 + ")", "the expression has more than "),
    "globally": ("G " * 40_000 + "d.lock", "nested more than 64 levels deep"),
    "weak until, which says its right side twice": (
        "not " + "(d.lock W " * 60 + "d.lock" + ")" * 60,
        "the expression has more than 10000 parts",
    ),
    "equivalences, which say both sides twice": (
        "(" * 60 + "G d.lock" + " <-> F d.lock)" * 60,
        "the expression has more than 10000 parts",
    ),
}


@pytest.mark.parametrize(("text", "message"), EXPRESSIONS.values(), ids=EXPRESSIONS)
@pytest.mark.parametrize("read", [predicate, formula])
def test_a_hostile_expression_is_refused_soon(read, text, message):
    refused_soon(read, text, message)


@pytest.mark.parametrize(("text", "message"), FORMULAS.values(), ids=FORMULAS)
def test_a_hostile_formula_is_refused_soon(text, message):
    refused_soon(formula, text, message)


def refused_soon(read, text, message):
    start = time.process_time()
    with pytest.raises(UsageError) as caught:
        read(MODEL, text)
    assert time.process_time() - start < SOON
    assert caught.value.mistakes[0].message.startswith(message)


@pytest.mark.parametrize(
    "text",
    [
        "(" * 63 + "d.lock" + ")" * 63,
        "not " * 62 + "d.lock",
        "d.lock" + " and d.lock" * 4_999,
        "d.wear" + " + d.wear" * 60 + " == 3",
        "d.lock" + " -> d.lock" * 30,
    ],
)
def test_an_expression_just_within_the_limits_is_read(text):
    assert predicate(MODEL, text)
