"""The JSON Schema accepts every scenario that loads, refuses typical mistakes, and explains every key."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator
from language.marked import DEVICE
from language.test_expand import HEAD, SAME
from language.test_sequence import OPERATIONS, intended

from smv_planner.cli.main import command
from smv_planner.language import loads
from smv_planner.language.document import EXPANDED, Resource, Scenario
from smv_planner.language.expand import TEMPLATE_KEYS
from smv_planner.language.schema import ABOUT, WRITTEN, schema
from smv_planner.language.shapes import ListOf, OneOf, Record, Table
from smv_planner.language.strict_yaml import Mapping, Scalar, Sequence, Source, parse

ROOT = Path(__file__).parents[2]
SCENARIOS = [Path(__file__).with_name("language.yaml"), *sorted(ROOT.glob("scenarios/*/model*.yaml"))]

SCHEMA = Draft202012Validator(schema())

CORE = {r"null|Null|NULL|~|": None, "true|True|TRUE": True, "false|False|FALSE": False}


def as_json(node: Mapping | Sequence | Scalar) -> Any:
    """A text as an editor reads it: by the core schema of YAML 1.2."""
    match node:
        case Mapping(entries):
            return {key.text: as_json(value) for key, value in entries}
        case Sequence(items):
            return [as_json(item) for item in items]
        case Scalar(word, True):
            for pattern, value in CORE.items():
                if re.fullmatch(pattern, word):
                    return value
            if re.fullmatch(r"[-+]?[0-9]+", word):
                return int(word)
            if re.fullmatch(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?", word):
                return float(word)
    return node.text


def refused(text: str) -> list[str]:
    root, mistakes = parse(Source("<text>", text))
    assert not mistakes
    return [f"{'.'.join(map(str, error.path))}: {error.message}" for error in SCHEMA.iter_errors(as_json(root))]


def test_the_schema_is_a_schema():
    Draft202012Validator.check_schema(schema())


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_every_scenario_is_accepted(path):
    assert refused(path.read_text()) == []


@pytest.mark.parametrize(("short", "long"), [pytest.param(short, long, id=name) for name, short, long in SAME])
def test_what_is_to_be_written_out_is_accepted(short, long):
    assert refused(HEAD + short) == []
    assert refused(HEAD + long) == []


@pytest.mark.parametrize(
    "text",
    [
        intended("[locate, {parallel: [tighten_1, [place_2, tighten_2]]}, detach]", ", manual: true"),
        intended("[locate, {parallel: [{foreach: {i: 1..6}, where: $i != 2, do: [place_$i, tighten_$i]}]}]"),
        OPERATIONS + "sequence: [{foreach: {i: 1..6}, do: place_$i}]",
        "smv_planner: 1\nname: empty\nresources:\npredicates:\ntransitions: {}\n",
        HEAD.replace("cell", "läge-2.b")
        + "resources: {a: , '`b`': {variables: {2b.ö: {kind: goal, domain: bool, initial: true}}}}",
        HEAD
        + "templates: {t: {parameters: [min, d], variables: {v: {kind: goal, domain: {min: $min, max: 9}, initial: $min}}}}\n"
        "resources: {r: {use: [{template: t, with: {min: 3, d: {a: [b]}}}]}}",
    ],
    ids=lambda text: text[-50:],
)
def test_other_texts_that_load_are_accepted(text):
    loads(text)
    assert refused(text) == []


MISTAKES = {
    "no version": "name: x",
    "another version": "smv_planner: 2\nname: x",
    "no name": "smv_planner: 1",
    "an unknown section": HEAD + "resorces: {}",
    "a list of resources": HEAD + "resources: [a]",
    "a name with a space": HEAD + "resources: {a b: {}}",
    "a name without a letter": HEAD + "decision: {1.2: {domain: bool, initial: true}}",
    "an unknown key": DEVICE + "transitions: {t: {kind: effect, guards: x}}",
    "no kind": DEVICE + "transitions: {t: {actions: {}}}",
    "an unknown kind": DEVICE + "transitions: {t: {kind: automated}}",
    "a duration without a unit": DEVICE + "transitions: {t: {kind: effect, within: 2}}",
    "a duration in another unit": DEVICE + "transitions: {t: {kind: effect, within: 2 sec}}",
    "yes for true": DEVICE + "transitions: {t: {kind: effect, expected: yes}}",
    "a list of actions": DEVICE + "transitions: {t: {kind: effect, actions: [a]}}",
    "a guard that YAML takes for a mapping": DEVICE + "transitions: {t: {kind: effect, guard: {a}}}",
    "an unknown domain": DEVICE + "  x: {domain: boolean, initial: true}",
    "a domain without an end": DEVICE + "  x: {domain: {min: 1}, initial: 1}",
    "a broken bound": DEVICE + "  x: {domain: {min: 1, max: 1.5}, initial: 1}",
    "a number among words": DEVICE + "  x: {domain: [a, 1], initial: a}",
    "a variable without a domain": HEAD + "resources: {r: {variables: {v: {kind: goal, initial: true}}}}",
    "negative retries": DEVICE + "operations: {o: {effects: {}, retries: -1}}",
    "an outcome without effects": DEVICE + "operations: {o: {outcomes: {a: {goal: d.lock}}}}",
    "an intention without a goal": DEVICE + "intentions: {i: {start: home}}",
    "a sequence of one word": DEVICE + "sequence: a",
    "a misspelt branch": DEVICE + "sequence: [{paralel: [a]}]",
    "a number in a sequence": DEVICE + "sequence: [3]",
    "manual at the top": DEVICE + "manual: true",
    "foreach of a number": DEVICE + "invariants: {i$a: {foreach: 3, is: home}}",
    "foreach up to a number": DEVICE + "invariants: {i$a: {foreach: {a: 3}, is: home}}",
    "foreach without is": DEVICE + "invariants: {i$a: {foreach: {a: 1..3}}}",
    "foreach with do instead of is": DEVICE + "invariants: {i$a: {foreach: {a: 1..3}, do: home}}",
    "all without a list": DEVICE + "predicates: {p: {all: home}}",
    "all and any": DEVICE + "predicates: {p: {all: [home], any: [home]}}",
    "where without foreach": DEVICE + "predicates: {p: {all: [home], were: x}}",
    "a resource in a list of templates": DEVICE + "templates: [a]",
    "a template that uses one": DEVICE + "templates: {t: {use: [a]}}",
    "a parameter with a sign": DEVICE + "templates: {t: {parameters: [a-b]}}",
    "a use without a template": HEAD + "resources: {r: {use: [{with: {}}]}}",
    "a list for parameters": HEAD + "resources: {r: {template: t, with: [a]}}",
}


@pytest.mark.parametrize("text", MISTAKES.values(), ids=MISTAKES)
def test_a_typical_mistake_is_refused(text):
    assert refused(text)


def records(shape, found):
    """Every record in a shape, once."""
    match shape:
        case Record(made) if made not in found:
            found.append(made)
            for each in shape.entries:
                records(each.shape, found)
        case Table(_, inner) | ListOf(inner):
            records(inner, found)
        case OneOf(shapes):
            for each in shapes:
                records(each, found)
    return found


RECORDS = records(Record(Scenario), [])


@pytest.mark.parametrize("made", RECORDS, ids=lambda made: made.__name__)
def test_every_key_that_the_reader_accepts_is_in_the_schema_and_explained(made):
    known = schema() if made is Scenario else schema()["$defs"][made.__name__]
    keys = {entry.key for entry in Record(made).entries} | set(EXPANDED.get(made, ()))
    assert ABOUT[made].keys() == keys
    assert keys <= known["properties"].keys()
    assert all(known["properties"][key]["description"] for key in keys)
    required = {entry.key for entry in Record(made).entries if entry.required}
    assert set(known["required"]) == required | ({"smv_planner"} if made is Scenario else set())


def test_nothing_else_is_explained():
    assert set(ABOUT) == set(RECORDS)
    assert set(TEMPLATE_KEYS) == set(schema()["$defs"]["Template"]["properties"])
    assert set(EXPANDED[Resource][1:]) == set(schema()["$defs"]["Use"]["anyOf"][1]["properties"])
    assert all(f'"{key}"' in json.dumps(schema()) for key in WRITTEN)


def test_one_line_explains_a_key():
    lines = [line for about in (*ABOUT.values(), WRITTEN) for line in about.values()]
    assert all(0 < len(line) <= 120 and line.endswith((".", "'", "}")) for line in lines)


def test_the_command_prints_it(capsys):
    assert command(["schema"]) == 0
    assert json.loads(capsys.readouterr().out) == schema()
