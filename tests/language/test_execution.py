"""What a scenario says about its execution: who inherits what from whom, and every mistake with its place."""

from __future__ import annotations

from itertools import product

import pytest
from language.marked import expected, mistakes
from language.test_schema import refused

from smv_planner.errors import ModelError
from smv_planner.language import Operation, Resource, Scenario, Transition, Variable, build, loads
from smv_planner.model.model import OnError
from smv_planner.model.system import MANUAL, Policy, Reenable

ON_CHANGE = Reenable(Policy.ON_CHANGE)


def press(of_all="", of_press="", of_sinks="", of_form=""):
    """A scenario with something said at each place where a policy may stand."""
    return f"""\
smv_planner: 1
name: press
{of_all}
resources:
  press:
    {of_press}
    variables:
      ref: {{kind: goal,     domain: [up, down], initial: up}}
      on:  {{kind: goal,     domain: bool,       initial: true}}
      kN:  {{kind: goal,     domain: {{min: 0, max: 9}}, initial: 0}}
      pos: {{kind: measured, domain: [up, down], initial: up}}
    predicates: {{low: pos == down}}
    transitions:
      lower: {{kind: controlled, guard: ref == up, actions: {{ref: down}}}}
      sinks: {{kind: effect, guard: ref == down, actions: {{pos: down}}, within: 2 s, {of_sinks}}}
transitions:
  drops: {{kind: effect, guard: not press.on, actions: {{press.pos: down}}, within: 1 s}}
decision:
  plate: {{domain: [flat, formed], initial: flat}}
operations:
  form: {{guard: plate == flat, effects: {{plate: formed}}, goal: press.low, {of_form}}}
"""


def test_without_a_word_people_decide_and_hubs_hold():
    model = loads(press())
    assert (model.period, model.on_error) == (0.2, OnError.CONTINUE)
    [resource] = model.resources
    assert (resource.mirror_within, resource.deadman, resource.safe) == (1.0, None, ())
    assert (resource.on_error, resource.reenable) == (OnError.CONTINUE, Reenable(Policy.ON_CHANGE))
    [form] = model.operations
    assert (form.on_error, form.reenable) == (OnError.CONTINUE, MANUAL)
    assert {each.reenable for each in model.transitions} == {MANUAL}


@pytest.mark.parametrize(
    ("text", "policy"),
    [
        ("manual", MANUAL),
        ("on_change", ON_CHANGE),
        ("after 30 s", Reenable(Policy.AFTER, 30.0)),
        ("after 500 ms", Reenable(Policy.AFTER, 0.5)),
        ("after 1.5min", Reenable(Policy.AFTER, 90.0)),
        ("after 0.05 s", Reenable(Policy.AFTER, 0.05)),
    ],
)
def test_a_policy_is_one_word_or_a_time(text, policy):
    assert loads(press(f"reenable: {text}")).operations[0].reenable == policy
    assert refused(press(f"reenable: {text}")) == []


POLICIES = [None, "manual", "on_change", "after 3 s"]
SAID = {None: None, "manual": MANUAL, "on_change": ON_CHANGE, "after 3 s": Reenable(Policy.AFTER, 3.0)}


@pytest.mark.parametrize(("of_all", "of_press", "of_sinks"), list(product(POLICIES, repeat=3)))
def test_an_effect_asks_itself_then_its_resource_then_the_scenario(of_all, of_press, of_sinks):
    model = loads(press(*(f"reenable: {each}" if each else "" for each in (of_all, of_press, of_sinks))))
    everywhere = SAID[of_all] or MANUAL
    assert model.resources[0].reenable == (SAID[of_press] or SAID[of_all] or Reenable(Policy.ON_CHANGE))
    assert model.system.transition["press.sinks"].reenable == (SAID[of_sinks] or SAID[of_press] or everywhere)
    assert model.system.transition["drops"].reenable == everywhere
    assert model.system.transition["press.lower"].reenable == MANUAL, "only effects time out"


@pytest.mark.parametrize(("of_all", "of_press", "of_form"), list(product([None, *OnError], repeat=3)))
def test_an_operation_and_a_resource_ask_themselves_then_the_scenario(of_all, of_press, of_form):
    said = [f"on_error: {each}" if each else "" for each in (of_all, of_press, of_form)]
    model = loads(press(said[0], said[1], of_form=said[2]))
    everywhere = of_all or OnError.CONTINUE
    assert model.on_error == everywhere
    assert model.resources[0].on_error == (of_press or everywhere)
    assert model.operations[0].on_error == (of_form or everywhere)


def test_an_operation_does_not_ask_a_resource():
    model = loads(press("reenable: on_change", "reenable: after 3 s", of_form="retries: 2"))
    assert model.operations[0].reenable == ON_CHANGE


def test_a_hub_has_its_times_and_safe_values():
    model = loads(
        press("period: 100 ms", "mirror_within: 500 ms\n    deadman: 150 ms\n    on_deadman: {on: false, press.kN: 3, ref: up}")
    )
    assert model.period == 0.1
    [resource] = model.resources
    assert (resource.mirror_within, resource.deadman) == (0.5, 0.15)
    assert resource.safe == (("press.on", False), ("press.kN", 3), ("press.ref", "up"))


@pytest.mark.parametrize("hold", ["", "\n    on_deadman: hold", "\n    on_deadman:", "\n    on_deadman: {}"])
def test_a_hub_holds_unless_it_is_told_otherwise(hold):
    [resource] = loads(press(of_press="deadman: 1 s" + hold)).resources
    assert (resource.deadman, resource.safe) == (1.0, ())


EVERY_WAY = [
    {"of_all": "period: 201 ms"},
    {"of_all": "on_error: ask"},
    {"of_all": "reenable: on_change"},
    {"of_press": "on_error: ask"},
    {"of_press": "reenable: on_change"},
    {"of_press": "mirror_within: 2 s"},
    {"of_press": "deadman: 1 s"},
    {"of_press": "deadman: 1 s\n    on_deadman: {ref: up}"},
    {"of_press": "deadman: 1 s\n    on_deadman: {ref: down}"},
    {"of_sinks": "reenable: after 1 s"},
    {"of_sinks": "reenable: after 2 s"},
    {"of_form": "on_error: halt"},
    {"of_form": "reenable: on_change"},
]


def test_whatever_is_said_differently_is_another_model():
    texts = [press(**each) for each in [{}, *EVERY_WAY]]
    assert len({loads(text).hash for text in texts}) == len(texts)
    assert [refused(text) for text in texts] == [[]] * len(texts)


def test_saying_what_holds_anyway_is_the_same_model():
    aloud = press(
        "period: 200 ms\non_error: continue",
        "mirror_within: 1 s\n    on_error: continue\n    reenable: on_change",
        "reenable: manual",
        "on_error: continue",
    )
    assert loads(aloud).hash == loads(press()).hash


def test_templates_say_it_once_for_many():
    templates = """\
smv_planner: 1
name: two
templates:
  tool:
    parameters: [rest, again]
    deadman: 1 s
    on_deadman: {told: $rest}
    on_error: ask
    reenable: after $again
    variables:
      told: {kind: goal, domain: bool, initial: false}
      is:   {kind: measured, domain: bool, initial: false}
    transitions:
      does: {kind: effect, guard: told != is, actions: {is: told}, within: 1 s}
"""
    model = loads(
        templates
        + """\
resources:
  a: {template: tool, with: {rest: false, again: 3 s}}
  b:
    use: [{template: tool, as: grip, with: {rest: true, again: 3 s}}, {template: tool, as: turn, with: {rest: false, again: 3 s}}]
"""
    )
    a, b = model.resources
    assert a.safe == (("a.told", False),)
    assert b.safe == (("b.grip.told", True), ("b.turn.told", False))
    assert {(each.on_error, each.deadman) for each in (a, b)} == {(OnError.ASK, 1.0)}
    assert {each.reenable for each in model.transitions} == {Reenable(Policy.AFTER, 3.0)}
    plain, found = expected(
        templates + "resources: {c: {template: tool, «on_deadman»: hold, with: {rest: true, again: 3 s}}}\n",
        "'on_deadman' is here twice (the other one is in line 7, in template 'tool' for resource 'c')",
    )
    assert mistakes(plain) == found


def test_python_says_the_same():
    scenario = Scenario(
        "press",
        resources={
            "r": Resource(
                variables={"x": Variable("goal", "bool", initial=True), "y": Variable("measured", "bool", initial=True)},
                transitions={"e": Transition("effect", "x != y", {"y": "x"}, within="1 s", reenable="after 2 s")},
                deadman="1 s",
                on_deadman={"x": False},
                mirror_within="300 ms",
                on_error="halt",
                reenable="on_change",
            )
        },
        operations={"o": Operation(effects={}, on_error="ask", reenable="after 5 s")},
        period="50 ms",
    )
    model = build(scenario)
    text = """\
smv_planner: 1
name: press
period: 50 ms
resources:
  r:
    variables: {x: {kind: goal, domain: bool, initial: true}, y: {kind: measured, domain: bool, initial: true}}
    transitions: {e: {kind: effect, guard: x != y, actions: {y: x}, within: 1 s, reenable: after 2 s}}
    deadman: 1 s
    on_deadman: {x: false}
    mirror_within: 300 ms
    on_error: halt
    reenable: on_change
operations: {o: {effects: {}, on_error: ask, reenable: after 5 s}}
"""
    assert loads(text).hash == model.hash


@pytest.mark.parametrize("value", [5, 1.5, "x", [], {}, {"x": {}}, {1: 2}, object(), True])
def test_wrong_values_in_python_are_model_errors(value):
    for scenario in (Scenario("x", period=value), Scenario("x", on_error=value), Scenario("x", reenable=value)):
        with pytest.raises(ModelError):
            build(scenario)
    for key in ("mirror_within", "deadman", "on_error", "reenable"):
        with pytest.raises(ModelError):
            build(Scenario("x", resources={"d": Resource(**{key: value})}))


ONE_OF = "expected one of continue, ask, halt"
WRITE = "write 'manual', 'on_change' or 'after 30 s'"
DURATION = "write '500 ms', '1.5 s', '1 min' or '1 h'"
HOLD = "expected 'hold' or a mapping with a name before each ':'"
TOLD = "a hub can only change what it is told"

WRONG = [
    ({"of_all": "on_error: «contnue»"}, f"{ONE_OF}, not 'contnue' (did you mean 'continue'?)"),
    ({"of_press": "on_error: «[ask]»"}, f"{ONE_OF}, not a list"),
    ({"of_form": "on_error: «»"}, f"{ONE_OF}, but there is nothing"),
    (
        {"of_sinks": "«on_error»: ask"},
        "unknown key 'on_error' (known here: kind, guard, actions, within, expected, instruction, reenable)",
    ),
    ({"of_all": "reenable: «never»"}, f"'never' is not a policy ({WRITE})"),
    ({"of_all": "reenable: «30 s»"}, f"'30 s' is not a policy ({WRITE})"),
    ({"of_press": "reenable: «after 30»"}, f"'after 30' is not a policy ({WRITE})"),
    ({"of_form": "reenable: «after 0.0 s»"}, f"'after 0.0 s' is not a policy ({WRITE})"),
    ({"of_sinks": "reenable: «on change»"}, f"'on change' is not a policy ({WRITE})"),
    ({"of_form": "reenable: «[manual]»"}, "expected a policy, not a list (quote an expression that starts with '[')"),
    ({"of_all": "period: «0 s»"}, "a duration is longer than nothing"),
    ({"of_all": "period: «often»"}, f"'often' is not a duration ({DURATION})"),
    ({"of_press": "mirror_within: «0 ms»"}, "a duration is longer than nothing"),
    ({"of_press": "mirror_within: «2»"}, f"'2' is not a duration ({DURATION})"),
    ({"of_press": "deadman: «0 ms»"}, "a duration is longer than nothing"),
    (
        {"of_press": "deadman: «200 ms»"},
        "this is over before the next goal is sent (goals are sent every 'period', which is 200 ms if nothing is said)",
    ),
    (
        {"of_all": "period: 2 s", "of_press": "deadman: «1 s»"},
        "this is over before the next goal is sent (goals are sent every 'period', which is 200 ms if nothing is said)",
    ),
    ({"of_press": "«on_deadman»: {ref: up}"}, "'on_deadman' stands without 'deadman' (say after how long: 'deadman: 1 s')"),
    ({"of_press": "deadman: 1 s\n    on_deadman: «holt»"}, f"{HOLD}, not 'holt' (did you mean 'hold'?)"),
    ({"of_press": "deadman: 1 s\n    on_deadman: {«reff»: up}"}, "unknown variable 'reff' (did you mean 'ref'?)"),
    (
        {"of_press": "deadman: 1 s\n    on_deadman: {ref: «dawn»}"},
        "'dawn' is not in the domain, which is {up, down} (did you mean 'down'?)",
    ),
    (
        {"of_press": "deadman: 1 s\n    on_deadman: {on: «1», kN: «12»}"},
        "'1' is not in the domain, which is bool (write true or false, without quotes)",
        "'12' is not in the domain, which is a number 0..9",
    ),
    (
        {"of_press": "deadman: 1 s\n    on_deadman: {«pos»: up, «low»: true, «plate»: flat}"},
        *(f"'{name}' is no goal variable of 'press' ({TOLD})" for name in ("press.pos", "press.low", "plate")),
    ),
    (
        {"of_press": "deadman: 1 s\n    on_deadman: {ref: up, «press.ref»: up}"},
        "'press.ref' is here twice (the other one is in line 7)",
    ),
    ({"of_press": "deadman: «1»\n    on_deadman: {ref: up}"}, f"'1' is not a duration ({DURATION})"),
]


@pytest.mark.parametrize(("said", "messages"), [pytest.param(case[0], case[1:], id=str(case[0])) for case in WRONG])
def test_a_mistake_is_reported_where_it_is(said, messages):
    plain, found = expected(press(**said), *messages)
    assert mistakes(plain) == found


@pytest.mark.parametrize("kind", ["controlled", "automatic", "maintenance"])
def test_only_effects_are_reenabled(kind):
    plain, found = expected(
        press().replace("  drops:", f"  t: {{kind: {kind}, actions: {{press.ref: up}}, «reenable»: manual}}\n  drops:"),
        f"'reenable' is for effects only, and this one is {kind}",
    )
    assert mistakes(plain) == found


def test_only_what_times_out_is_reenabled():
    plain, found = expected(
        press().replace("within: 1 s", "«reenable»: manual"),
        "'drops' never times out, and 'reenable' says what follows when it did (say 'within', how long it may take)",
    )
    assert mistakes(plain) == found


@pytest.mark.parametrize(
    "said",
    [
        {"of_all": "on_error: stop"},
        {"of_all": "reenable: never"},
        {"of_sinks": "reenable: after 0 s"},
        {"of_press": "deadman: 1"},
        {"of_press": "on_deadman: stop"},
        {"of_press": "on_deadman: [ref]"},
        {"of_form": "on_deadman: hold"},
        {"of_all": "period: 0.1"},
    ],
    ids=str,
)
def test_the_schema_refuses_a_wrong_shape(said):
    assert refused(press(**said))
