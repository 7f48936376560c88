"""YAML is hostile: what scalars mean is fixed by the declared type, and what YAML adds to a tree of text is refused."""

from __future__ import annotations

import subprocess
import sys

import pytest
from language.marked import DEVICE, expected, mistakes

from smv_planner.errors import ModelError
from smv_planner.language import load, loads

ENUM = "[on, off, yes, no, null, y, n, True, NaN, e1, in, any, 12e, 0x1F, 0o7, 1_0a, 2001-01-01a]"

TYPINGS = [
    ("true", "bool", True),
    ("false", "bool", False),
    ("True", "bool", None),
    ("TRUE", "bool", None),
    ("on", "bool", None),
    ("off", "bool", None),
    ("yes", "bool", None),
    ("no", "bool", None),
    ("y", "bool", None),
    ("1", "bool", None),
    ("0", "bool", None),
    ('"true"', "bool", None),
    ("'false'", "bool", None),
    ("null", "bool", None),
    ("~", "bool", None),
    ("", "bool", None),
    ("!!bool true", "bool", None),
    ("0", "int", 0),
    ("7", "int", 7),
    ("-7", "int", -7),
    ("+7", "int", None),
    ("-0", "int", None),
    ("007", "int", None),
    ("0o7", "int", None),
    ("0x7", "int", None),
    ("1_0", "int", None),
    ("1.0", "int", None),
    ("1e0", "int", None),
    ("1:30", "int", None),
    (".inf", "int", None),
    (".nan", "int", None),
    ("1e999", "int", None),
    ("99999999999999999999", "int", None),
    ("true", "int", None),
    ('"7"', "int", None),
    ("on", "enum", "on"),
    ("off", "enum", "off"),
    ("yes", "enum", "yes"),
    ("no", "enum", "no"),
    ("null", "enum", "null"),
    ("y", "enum", "y"),
    ("True", "enum", "True"),
    ("NaN", "enum", "NaN"),
    ("e1", "enum", "e1"),
    ("in", "enum", "in"),
    ("any", "enum", "any"),
    ("12e", "enum", "12e"),
    ("0x1F", "enum", "0x1F"),
    ("2001-01-01a", "enum", "2001-01-01a"),
    ('"on"', "enum", "on"),
    ("'off'", "enum", "off"),
    ("true", "enum", None),
    ("1", "enum", None),
]
DOMAINS = {"bool": "bool", "int": "{min: -9, max: 9}", "enum": ENUM}


@pytest.mark.parametrize(("written", "kind", "value"), TYPINGS)
def test_a_scalar_means_what_its_declared_type_says(written, kind, value):
    text = f"smv_planner: 1\nname: x\ndecision:\n  v: {{domain: {DOMAINS[kind]}, initial: {written}}}\n"
    if value is None:
        with pytest.raises(ModelError):
            loads(text)
    else:
        initial = loads(text).variables[0].initial
        assert (type(initial), initial) == (type(value), value)


QUOTE = "quote an expression that starts with"
REFUSED = [
    ("predicates:\n  p: «!d.lock» and home", "a leading '!' is a YAML tag, and tags are not allowed (" + QUOTE + " '!')"),
    ("predicates: {p: «!»d.lock, q: d.lock}", "a leading '!' is a YAML tag, and tags are not allowed (" + QUOTE + " '!')"),
    ("predicates:\n  p: «&»d and home", "'&d' is a YAML anchor, and anchors are not allowed (" + QUOTE + " '&')"),
    ("predicates:\n  p: «*lock»", "'*lock' is a YAML alias, and aliases are not allowed (" + QUOTE + " '*')"),
    ("predicates:\n  «<<»: {p: d.lock}", "merge keys ('<<') are not allowed (write the entries out)"),
    ("predicates:\n  p: d.lock\n  «p»: home", "'p' is here twice (the first is in line 19)"),
    ("predicates:\n  ? «[p]»\n  : home", "expected a name before ':' (quote an expression that starts with '{' or '[')"),
    ("predicates:\n  p: «[home]»", "expected an expression, not a list (" + QUOTE + " '[')"),
    ("predicates:\n  p: «{home}»", "expected an expression, not a mapping (" + QUOTE + " '{')"),
    ("«---»\na: b", "a second document starts here (a scenario is one document)"),
    ("predicates: {p: home, q«»}", "expected an expression, but there is nothing"),
    (
        "transitions:\n  t: {kind: controlled, guard: home, «or d», actions: {d.lock: true}}",
        "unknown key 'or d' (in flow style, quote an expression that holds a comma)",
    ),
]


@pytest.mark.parametrize(("text", "message"), REFUSED)
def test_what_yaml_adds_to_a_tree_of_text_is_refused(text, message):
    plain, found = expected(DEVICE + text + "\n", message)
    assert [each[:3] for each in mistakes(plain)] == [each[:3] for each in found]


UNQUOTED = [
    (
        "transitions:\n  t: {kind: effect, guard: d.pos in «{»closed, opened}, actions: {d.done: true}}",
        "in flow style, quote an expression",
    ),
    ("predicates:\n  p: | «d».lock", "quote the whole expression if it starts with |"),
    ("predicates:\n  p: > «3»", "quote the whole expression if it starts with >"),
    ("predicates: {p: «|»d.lock}", "quote the whole expression if it starts with |"),
    ("predicates:\n  p: &d«.»lock", "quote the whole expression if it starts with &"),
    ("predicates:\n  p: «`»d.lock`", "quote the whole expression if it starts with `"),
    ("predicates:\n  p: «@»d", "quote the whole expression if it starts with @"),
    ("predicates:\n  p: «%»d", "quote the whole expression if it starts with %"),
    ("predicates:\n  p: 'closed' «=»= d.pos", "quote the whole expression if it starts with '"),
    ("predicates:\n  p: {a} «a»nd b", "quote the whole expression if it starts with {"),
    ("predicates:\n  p: home«:» d", "quote a text that holds ': '"),
    ("predicates:\n«\t»p: home", "indent with spaces, not with tabs"),
]


@pytest.mark.parametrize(("text", "hint"), UNQUOTED)
def test_an_expression_that_yaml_cannot_read_unquoted_gets_the_hint_to_quote_it(text, hint):
    plain, [(_, line, column, _)] = expected(DEVICE + text + "\n", hint)
    [(said, at_line, at_column, _)] = mistakes(plain)
    assert said.startswith("this is not YAML: ")
    assert hint in said
    assert (at_line, at_column) == (line, column)


PLACES = [
    'invariants: {i: "home or «x»"}',
    "invariants: {i: 'd.pos == ''closed'' or «x»'}",
    'invariants: {i: «"»d.pos == closed\\u0020or x"}',
    "invariants:\n  i: |\n    home\n    or\n\n      «x»\n    or d.lock",
    "invariants:\n  i: >-\n    home or\n    «x»\n    or d.lock",
    "invariants:\n  i: home\n    or «x»",
    'invariants:\n  i: "home or\n\n    «x»"',
    "invariants:\n  i: >  # a comment\n    home or\n    «x»",
    "# ä 😀\ninvariants: {«ä😀»: home}\n",
]


@pytest.mark.parametrize("text", PLACES)
@pytest.mark.parametrize("line_break", ["\n", "\r\n"])
def test_a_mistake_inside_an_expression_is_found_where_it_is_written(text, line_break):
    plain, [(_, *place)] = expected(DEVICE + text + "\n", "")
    [found] = mistakes(plain.replace("\n", line_break))
    assert list(found[1:3]) == place[:2]


def test_the_end_of_an_expression_is_behind_its_last_character():
    plain, _ = expected(DEVICE + "invariants:\n  i: >\n    home or\n    d.lock ==\n\n")
    assert mistakes(plain) == [("expected a value after '=='", 21, 14, 1)]


@pytest.mark.parametrize(
    ("data", "message", "line", "column"),
    [
        (b"a: \xff\n", "the text is not UTF-8 here", 1, 4),
        (b"a: b\nc: \xc3\x28", "the text is not UTF-8 here", 2, 4),
        ("a: b".encode("utf-16"), "the text is not UTF-8 here", 1, 1),
        (b"a: b\x00", "the character U+0000 is not allowed", 1, 5),
        (b"a: \x1b[31m", "the character U+001B is not allowed", 1, 4),
        ("a: \u202eb".encode(), "the character U+202E is not allowed", 1, 4),
        (b"", "there is nothing in this file", 1, 1),
        (b"# only this\n", "there is nothing in this file", 1, 1),
        (b"- a\n", "this is not a scenario", 1, 1),
        (b"name: x\n", "the key 'smv_planner', the version of the format, is missing", 1, 1),
        (b"name: x\nsmv_planner: 2\nresourcess: 3\n", "'2' is not a version of the format that this program reads", 2, 14),
        (b'smv_planner: "1"\n', "'1' is not a version of the format that this program reads", 1, 14),
        (b"smv_planner: {}\n", "this is not a version of the format that this program reads", 1, 14),
    ],
)
def test_a_file_that_is_no_scenario_is_refused(tmp_path, data, message, line, column):
    file = tmp_path / "model.yaml"
    file.write_bytes(data)
    with pytest.raises(ModelError) as caught:
        load(file)
    [mistake] = caught.value.mistakes
    assert mistake.message == message
    assert mistake.place
    assert (mistake.place.file, mistake.place.line, mistake.place.column) == (str(file), line, column)


def test_a_byte_order_mark_is_no_mistake(tmp_path):
    (tmp_path / "model.yaml").write_bytes(b"\xef\xbb\xbf" + DEVICE.encode())
    assert load(tmp_path).hash == loads(DEVICE).hash == loads("\ufeff" + DEVICE).hash


def test_the_parser_written_in_python_reads_the_same():
    wrong, _ = expected(DEVICE + "invariants:\n  i: >\n   home or\n   «x»\n  j: 'd.pos == ''closd'''\n", "")
    program = (
        "import sys; sys.modules['yaml._yaml'] = None; sys.path[:0] = ['tests', '.']\n"
        "from language.marked import DEVICE, mistakes; from smv_planner.language import loads\n"
        f"import yaml; print(yaml.__with_libyaml__, loads(DEVICE).hash, mistakes({wrong!r}))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == f"False {loads(DEVICE).hash} {mistakes(wrong)}\n"
