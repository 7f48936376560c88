"""Whole scenarios: the example of the language, where they come from, many mistakes at once, and Python instead of YAML."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from language.marked import DEVICE, expected, mistakes

from smv_planner.errors import ModelError, UsageError
from smv_planner.language import (
    Bounds,
    Decision,
    Intention,
    Operation,
    Outcome,
    Resource,
    Scenario,
    Transition,
    Variable,
    build,
    load,
    loads,
)
from smv_planner.model.domains import Bool, Enum, Range
from smv_planner.model.expressions import TRUE, Const, Equal, If, Named, Not, Plus, Var, show
from smv_planner.model.system import Any, Assignment, Kind, VariableKind

EXAMPLE = Path(__file__).with_name("language.yaml")
"""The scenario that defines the language."""

RESOURCE = (
    "{variables: ..., predicates: ..., transitions: ..., silent_after: ..., mirror_within: ..., "
    "deadman: ..., on_deadman: ..., on_error: ..., reenable: ...}"
)


def test_the_example_of_the_language_is_a_model():
    model = load(EXAMPLE)
    assert [(v.name, str(v.kind), v.domain, v.initial) for v in model.variables] == [
        ("door.ref", "goal", Enum(("closed", "opened")), "closed"),
        ("door.pos", "measured", Enum(("closed", "opened", "jammed")), "closed"),
        ("door.lock", "goal", Bool(), True),
        ("door.locked", "measured", Bool(), True),
        ("door.wear", "estimated", Range(0, 3), 0),
        ("product.state", "decision", Enum(("waiting", "seen", "done")), "waiting"),
    ]
    assert [(r.name, r.silent_after) for r in model.resources] == [("door", 1.0)]
    assert model.predicates["door.moving"] == Not(Equal(Var("door.ref"), Var("door.pos")))
    moving = Named("door.moving", model.predicates["door.moving"])
    assert [copy.name for copy in model.copies] == ["door_open", "where"]
    assert model.copies[1].value == If(Not(moving), Const("home"), If(moving, Const("busy"), Const("unknown")))
    assert [(i.name, show(i.predicate)) for i in model.invariants] == [("never_move_locked", "not (door.moving and door.locked)")]
    by_name = model.system.transition
    assert [t.name for t in model.transitions][-2:] == ["door.reset", "worn"]
    assert by_name["worn"].actions == (Assignment("door.wear", Plus(Var("door.wear"), Const(1))),)
    assert by_name["worn"].resource is None
    assert (by_name["door.reset"].guard, by_name["door.reset"].kind) == (TRUE, Kind.MAINTENANCE)
    assert by_name["door.reset"].instruction == "Push the door shut and acknowledge."
    assert (by_name["door.unlocked"].within, by_name["door.opens"].within) == (0.5, 2.0)
    assert [t.name for t in model.transitions if not t.expected] == ["door.jams"]
    inspect, grade = model.operations
    assert (inspect.synchronised, inspect.retries, len(inspect.outcomes)) == ("door.relock", 3, 1)
    assert [(o.name, show(o.goal)) for o in grade.outcomes] == [("good", "door.wear == 0"), ("bad", "0 < door.wear")]
    [intention] = model.intentions
    assert show(intention.goal) == "product.state == seen"


def test_automatic_transitions_are_ordered_as_declared():
    text = """\
smv_planner: 1
name: order
transitions:
  z: {kind: automatic, actions: {b.x: true}}
  a: {kind: automatic, actions: {b.x: true}}
resources:
  b: {variables: {x: {kind: goal, domain: bool, initial: true}}, transitions: {t: {kind: automatic, actions: {x: true}}}}
  a: {transitions: {t: {kind: automatic, actions: {b.x: true}}}}
"""
    assert [t.name for t in loads(text).transitions] == ["b.t", "a.t", "z", "a"]


def test_names_of_a_resource_come_first_in_it():
    text = DEVICE.replace("state:", "d.state:") + "  lock: {domain: bool, initial: true}\npredicates: {p: lock, q: d.lock}\n"
    text = text.replace("    transitions:\n", "      l: lock\n      o: ref == opened\n    transitions:\n")
    predicates = loads(text).predicates
    assert predicates["d.l"] == predicates["q"] == Var("d.lock")
    assert predicates["p"] == Var("lock")


def test_the_order_of_sections_does_not_matter():
    head, *sections = DEVICE.split("\nresources:")
    resources, decision = sections[0].split("decision:")
    assert loads(f"{head}\ndecision:{decision}resources:{resources}").hash == loads(DEVICE).hash


ALL_WRONG = """\
smv_planner: 1
name: «b d»
resources:
  d:
    silent_after: «1 sec»
    variables:
      a: {kind: «goals», domain: [x, y], initial: x}
      b: {kind: goal, domain: [x, «x»], initial: «z»}
      c: {kind: goal, domain: «{min: 3, max: 0}», initial: 1}
      e: «5»
      f: {kind: goal, domain: bool, initial: true, «kind»: goal}
    predicates:
      p: a == x and b == x and c == 3 and c < «f» + 1 and e
      q: not p and a ==«»
    transitions:
      t: {kind: controlled, guard: p and q and «r», actions: {a: x, c: 2, e: true, f: «7», «g»: true}}
      u: «[]»
  e: «[]»
predicates:
  s: e.x == y and e.z
  t: «d.t» or «x»
decision:
  v: {domain: bool, from: t, «initial»: true}
operations:
  o: {effects: {v: true, «w»: true}, with: d.u}
  p: {effects: {v: «1»}, with: «d.v»}
"""


def test_everything_wrong_is_reported_at_once_in_the_order_of_the_text():
    plain, found = expected(
        ALL_WRONG,
        "'b d' is not a name (letters, digits, '_' and inner '-', with at least one letter between dots)",
        "'1 sec' is not a duration (write '500 ms', '1.5 s', '1 min' or '1 h')",
        "expected one of measured, goal, estimated, not 'goals' (did you mean 'goal'?)",
        "the value 'x' is here twice",
        "'z' is not in the domain, which is {x}",
        "this domain is empty: min 3 is larger than max 0",
        "expected a mapping {kind: ..., domain: ..., initial: ...}, not '5'",
        "'kind' is here twice (the first is in line 11)",
        "expected a whole number, but 'f' is bool",
        "expected a value after '=='",
        "unknown variable 'r' in the guard of 't'",
        "'7' is not a value of 'd.f', which is bool",
        "unknown variable 'g'",
        "expected a mapping "
        "{kind: ..., guard: ..., actions: ..., within: ..., expected: ..., instruction: ..., reenable: ...}, not a list",
        f"expected a mapping {RESOURCE}, not a list",
        "unknown variable 'd.t' in the predicate 't' (did you mean 'd.q'?)",
        "unknown variable 'x' in the predicate 't'",
        "'v' is a measured copy: 'from' gives its value (remove 'initial')",
        "unknown variable 'w'",
        "'1' is not a value of 'v', which is bool",
        "unknown transition 'd.v' (did you mean 'd.t'?)",
    )
    assert mistakes(plain) == found


def test_a_misspelt_section_does_not_make_its_names_unknown():
    plain, found = expected(
        DEVICE.replace("variables", "«varables»") + "predicates: {p: d.lock and «state.lock»}\n",
        "unknown key 'varables' (did you mean 'variables'?)",
        "unknown variable 'state.lock' in the predicate 'p' (did you mean 'state'?)",
    )
    assert mistakes(plain) == found


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("missing.yaml", "there is no file or folder '{}'"),
        ("empty", "the folder '{}' holds no model.yaml"),
        ("fifo", "'{}' is neither a file nor a folder"),
        ("a\0b", "'{}' cannot be read: embedded null byte"),
    ],
)
def test_a_path_that_leads_nowhere_is_a_wrong_question(tmp_path, name, message):
    (tmp_path / "empty").mkdir()
    os.mkfifo(tmp_path / "fifo")
    path = f"{tmp_path}/{name}"
    with pytest.raises(UsageError) as caught:
        load(path)
    assert [mistake.message for mistake in caught.value.mistakes] == [message.format(path)]


def test_a_folder_is_its_model_file(tmp_path):
    (tmp_path / "model.yaml").write_text(DEVICE, encoding="utf-8")
    assert load(tmp_path).hash == load(str(tmp_path / "model.yaml")).hash == loads(DEVICE).hash


WRITTEN = Scenario(
    name="test",
    resources={
        "d": Resource(
            variables={
                "pos": Variable("measured", ["closed", "opened", "jammed"], initial="closed"),
                "ref": Variable("goal", ["closed", "opened"], initial="closed"),
                "lock": Variable("goal", "bool", initial=True),
                "done": Variable("measured", "bool", initial=False),
                "wear": Variable("estimated", Bounds(0, 3), initial=0),
            },
            predicates={"moving": "ref != pos"},
            transitions={"go": Transition("controlled", actions={"lock": False})},
        )
    },
    decision={"state": Decision(["waiting", "seen"], initial="waiting"), "home": Decision(from_="d.pos == closed")},
)


def test_a_scenario_written_in_python_is_the_same_model():
    assert build(WRITTEN).hash == loads(DEVICE).hash


def test_every_part_of_a_scenario_can_be_written_in_python():
    scenario = Scenario(
        "full",
        resources={"d": Resource({"x": Variable(VariableKind.GOAL, Bounds(0, 3), 0)}, silent_after="500 ms")},
        predicates={"p": "d.x == 0"},
        transitions={
            "t": Transition(Kind.CONTROLLED, guard="p", actions={"d.x": "any"}),
            "u": Transition("automatic", actions={"d.x": 2, "s": "'b'"}),
        },
        decision={"s": Decision(("a", "b"), "a"), "c": Decision(["a", "b"], from_={"a": "p", "otherwise": "b"})},
        invariants={"i": "true"},
        operations={"o": Operation(guard="c == a", outcomes={"w": Outcome({"c": "b"}, goal="p")}, with_="u", retries=2)},
        intentions={"n": Intention(start="p", goal="s == b", formula="F c == a", actions={"s": "a"})},
    )
    model = build(scenario)
    assert [t.actions for t in model.transitions] == [
        (Assignment("d.x", Any()),),
        (Assignment("d.x", Const(2)), Assignment("s", Const("b"))),
    ]
    assert model.operations[0].synchronised == "u"
    assert model.copies[0].value == If(Named("p", Equal(Var("d.x"), Const(0))), Const("a"), Const("b"))


def test_mistakes_in_python_name_the_way_to_them():
    wrong = Scenario(
        name="a b",
        resources={
            "d": Resource(
                variables={"x": Variable("goal", ["a", "b"], initial="c"), "y": Variable("goals", "bool", initial="true")},  # type: ignore[arg-type]
                transitions={"open": Transition("controlled", guard="x == a and z", actions={"x": "b", "q": True})},
            ),
            "e": 5,  # type: ignore[dict-item]
        },
        decision={"v": Decision(initial=1)},
    )
    with pytest.raises(ModelError) as caught:
        build(wrong)
    assert [str(mistake) for mistake in caught.value.mistakes] == [
        "name: 'a b' is not a name (letters, digits, '_' and inner '-', with at least one letter between dots)",
        "resources.d.variables.x.initial: 'c' is not in the domain, which is {a, b}",
        "resources.d.variables.y.kind: expected one of measured, goal, estimated, not 'goals' (did you mean 'goal'?)",
        "resources.d.variables.y.initial: 'true' is not in the domain, which is bool (write true or false, without quotes)",
        "resources.d.transitions.open.guard: unknown variable 'z' in the guard of 'open'",
        "resources.d.transitions.open.actions.q: unknown variable 'q'",
        f"resources.e: expected a mapping {RESOURCE}, not '5'",
        "decision.v: 'domain' is missing in 'v'",
    ]


@pytest.mark.parametrize("value", [None, 5, 1.5, "x", [], {}, [[]], {"a": {}}, object(), True, float("nan"), b"x", {1: 2}])
def test_whatever_python_values_stand_there_wrong_ones_are_model_errors(value):
    for scenario in (
        value,
        Scenario(name=value),
        Scenario("x", resources=value),
        Scenario("x", resources={"d": value}),
        Scenario("x", resources={"d": Resource(variables={"v": value})}),
        Scenario("x", resources={"d": Resource(variables={"v": Variable(value, value, value)})}),
        Scenario("x", transitions={"t": Transition(value, value, value, value, value, value)}),
        Scenario("x", decision={"v": Decision(value, value, value)}),
        Scenario("x", operations={"o": Operation(value, value, value, value, value, value, value)}),
        Scenario("x", intentions={"i": Intention(value, value, value, value)}),
    ):
        try:
            build(scenario)
        except ModelError as error:
            found = error.mistakes
        else:
            found = None
        assert found is None or found


LINES = EXAMPLE.read_text(encoding="utf-8").split("\n")
lines = st.sampled_from(LINES)
PIECES = ["", "x", " ", "{", "}", "'", '"', ": ", "- ", "\n", ",", "!", "&a ", "*a", "|", "\t", "é"]


@st.composite
def mutilated(draw):
    """The example with something cut out, doubled or put in."""
    text = "\n".join(LINES)
    for _ in range(draw(st.integers(1, 3))):
        start = draw(st.integers(0, len(text)))
        end = min(len(text), start + draw(st.integers(0, 30)))
        inner = draw(
            st.sampled_from(["", "x", " ", "{", "}", "'", '"', ": ", "- ", "\n", ",", "!", "&a ", "*a", "|", "\t", "é"]) | lines
        )
        text = text[:start] + inner + text[end:]
    return text


@settings(max_examples=150, deadline=None)
@given(mutilated())
def test_a_mutilated_scenario_is_a_model_or_a_model_error(text):
    assert all(line or not column for _, line, column, _ in mistakes(text))


@settings(max_examples=150, deadline=None)
@given(st.text(max_size=60) | st.lists(lines, max_size=12).map("\n".join) | st.text(":-{}[]'\"ab \n#&*!|>%@", max_size=40))
def test_any_text_is_a_model_or_a_model_error(text):
    assert mistakes(text) or loads(text)
    mistakes("smv_planner: 1\nname: x\n" + text)


@settings(max_examples=60, deadline=None)
@given(data=st.binary(max_size=60))
def test_any_bytes_are_a_model_or_a_model_error(tmp_path_factory, data):
    file = tmp_path_factory.getbasetemp() / "model.yaml"
    file.write_bytes(data)
    with pytest.raises(ModelError):
        load(file)
