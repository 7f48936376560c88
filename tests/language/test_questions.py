"""Goals, formulas and settings that someone asks of a model."""

from __future__ import annotations

import pytest
from language.marked import DEVICE, unmarked

from smv_planner.errors import UsageError
from smv_planner.language import formula, loads, predicate, setting
from smv_planner.model.expressions import And, Const, Equal, Named, Var
from smv_planner.model.ltl import Atom, eventually

MODEL = loads(DEVICE + "  away: {domain: [home, out, '1st'], initial: home}\npredicates:\n  ready: home and not d.moving\n")


def test_a_goal_sees_every_full_name():
    goal = predicate(MODEL, "ready and d.moving and home and d.pos == opened")
    assert isinstance(goal, And)
    ready, moving, home, at = goal.parts
    assert ready == Named("ready", MODEL.predicates["ready"])
    assert moving == Named("d.moving", MODEL.predicates["d.moving"])
    assert home == Named("home", MODEL.copies[0].value)
    assert at == Equal(Var("d.pos"), Const("opened"))


def test_a_formula_without_temporal_operators_is_a_condition_on_the_first_state():
    assert formula(MODEL, "d.lock") == Atom(Var("d.lock"))
    assert formula(MODEL, "F d.lock") == eventually(Atom(Var("d.lock")))


def test_a_mistake_names_its_source_and_points_into_the_text():
    with pytest.raises(UsageError) as caught:
        predicate(MODEL, "d.lock and d.pos == opned", source="goal 2")
    assert str(caught.value) == (
        "goal 2:1:21: 'opned' is neither a value of 'd.pos', which is {closed, opened, jammed}, nor a variable "
        "(did you mean 'opened'?)\n"
        "    d.lock and d.pos == opned\n"
        "                        ^^^^^"
    )


def test_every_mistake_of_a_goal_is_reported():
    with pytest.raises(UsageError) as caught:
        predicate(MODEL, "lock and d.wear and d.pos < 2")
    assert [(m.message, m.place and m.place.column) for m in caught.value.mistakes] == [
        ("unknown variable 'lock'", 1),
        ("expected a condition, but 'd.wear' is a number 0..3", 10),
        ("expected a whole number beside '<', but 'd.pos' is {closed, opened, jammed}", 21),
    ]


@pytest.mark.parametrize(
    ("text", "result"),
    [
        ("d.pos=opened", ("d.pos", "opened")),
        ("d.pos == 'opened'", ("d.pos", "opened")),
        ("`d.pos` = opened", ("d.pos", "opened")),
        ("d.lock=false", ("d.lock", False)),
        ("d.wear=3", ("d.wear", 3)),
        ("state=seen", ("state", "seen")),
        ("away='home'", ("away", "home")),
        ("away=1st", ("away", "1st")),
    ],
)
def test_a_setting_is_a_variable_and_its_value(text, result):
    assert setting(MODEL, text) == result


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("«d.poss»=opened", "unknown variable 'd.poss' (did you mean 'd.pos'?)"),
        ("«pos»=opened", "unknown variable 'pos' (did you mean 'd.pos'?)"),
        ("«home»=true", "'home' is a measured copy and cannot be set (set what it is measured from)"),
        ("«d.moving»=true", "'d.moving' is a predicate and cannot be set (set the variables that it reads)"),
        (
            "d.pos=«open»",
            "'open' is neither a value of 'd.pos', which is {closed, opened, jammed}, nor a variable (did you mean 'opened'?)",
        ),
        ("d.pos=«'x'»", "'x' is not a value of 'd.pos', which is {closed, opened, jammed}"),
        ("d.pos=«true»", "'true' is not a value of 'd.pos', which is {closed, opened, jammed}"),
        ("d.lock=«on»", "'on' is neither a value of 'd.lock', which is bool, nor a variable (write true)"),
        ("d.lock=«1»", "'1' is not a value of 'd.lock', which is bool"),
        ("d.wear=«4»", "'4' is not a value of 'd.wear', which is a number 0..3"),
        ("d.wear=«-1»", "'-1' is not a value of 'd.wear', which is a number 0..3"),
        ("d.wear=«1.0»", "'1.0' is neither a name nor a number (numbers are whole)"),
        ("d.wear=«1 + 1»", "expected a value, not an expression"),
        ("d.ref=«d.pos»", "expected a value, not an expression"),
        ("d.ref=«any»", "'any' is for controlled and maintenance transitions only (write the value)"),
        (
            "away=«home»",
            "'home' is a value of 'away' and also the variable 'home' "
            "(write 'home' with quotes for the value, `home` for the variable)",
        ),
        ("d.pos=«»", "expected an expression, but there is nothing"),
        ("«d.pos»", "expected VARIABLE=VALUE"),
        ("«»=3", "unknown variable ''"),
        ("d.pos=opened «x»", "expected an operator between 'opened' and 'x'"),
    ],
)  # fmt: skip
def test_what_is_no_setting_is_explained(text, message):
    plain, [(line, column, length)] = unmarked(text)
    with pytest.raises(UsageError) as caught:
        setting(MODEL, plain)
    [mistake] = caught.value.mistakes
    place = mistake.place
    assert place
    assert (f"{mistake.message} ({mistake.hint})" if mistake.hint else mistake.message) == message
    assert (place.file, place.line, place.column, place.length) == ("--set", line, column, length)
