"""Prescribed sequences: a constraint on the operation planner, or in its place."""

from __future__ import annotations

from dataclasses import replace

import pytest

import smv_planner as sp
from smv_planner.model.model import Model, Sequence

SCENARIO = """
smv_planner: 1
name: parts
resources:
  lamp:
    variables:
      on: {kind: goal, domain: bool, initial: false}
    transitions:
      switch: {kind: controlled, actions: {on: not on}}
decision:
  a: {domain: bool, initial: false}
  b: {domain: bool, initial: false}
  c: {domain: bool, initial: false}
operations:
  make_a: {guard: not a, effects: {a: true}, goal: lamp.on}
  make_b: {guard: not b, effects: {b: true}, goal: not lamp.on}
  make_c: {guard: not c, effects: {c: true}, goal: lamp.on}
  undo_a: {guard: a, effects: {a: false}, goal: not lamp.on}
intentions:
  all: {start: not a, goal: a and b and c}
  only_c: {start: a and not a, goal: c}
"""


def model(sequence: Sequence | None = None, whole: Sequence | None = None) -> Model:
    plain = sp.loads(SCENARIO)
    first, second = plain.intentions
    return replace(plain, intentions=(replace(first, sequence=sequence), second), sequence=whole)


def order_of(answer: sp.Answer) -> list[str]:
    assert answer.verdict == "reached", answer.reason
    return [operation.operation for operation in answer.operations]


def in_order(*operations: str, manual: bool = False) -> Sequence:
    return Sequence(operations, tuple((at - 1,) if at else () for at in range(len(operations))), manual)


def plan(made: Model, **question: object) -> sp.Answer:
    return sp.plan(made, engine="explicit", **question)  # type: ignore[arg-type]


@pytest.mark.parametrize("order", ["make_a make_b make_c", "make_c make_b make_a", "make_b make_c make_a"])
def test_operations_run_in_the_order_of_their_sequence(order):
    assert order_of(plan(model(in_order(*order.split())))) == order.split()


def test_a_sequence_of_the_whole_scenario_binds_every_intention():
    answer = plan(model(whole=in_order("make_b", "make_c")), intentions=["only_c"])
    assert order_of(answer) == ["make_b", "make_c"]


def test_a_sequence_goes_on_after_what_has_run():
    half = model(in_order("make_a", "make_b", "make_c"))
    at = {"a": True, "c": False}
    assert order_of(plan(half, intentions=["all"], set=at, ran=["make_a"])) == ["make_b", "make_c"]
    assert order_of(plan(half, intentions=["all"], set=at)) == ["undo_a", "make_a", "make_b", "make_c"]


def test_a_manual_sequence_goes_on_after_what_has_run():
    by_hand = in_order("make_a", "undo_a", "make_a", "make_b", "make_c", manual=True)
    left = plan(model(by_hand), intentions=["all"], set={"a": True}, ran=["make_a", "undo_a", "make_a"])
    assert order_of(left) == ["make_b", "make_c"]
    assert order_of(plan(model(by_hand), intentions=["all"], set={"a": True}, ran=["make_a"]))[0] == "undo_a"


def test_what_ran_has_to_be_an_operation():
    with pytest.raises(sp.UsageError, match="no operation 'make_d'"):
        plan(model(in_order("make_a")), ran=["make_d"])


def test_branches_in_parallel_stay_free():
    between = Sequence(("make_a", "make_b", "make_c"), ((), (), (0, 1)))
    assert order_of(plan(model(between)))[-1] == "make_c"


def test_a_sequence_that_cannot_reach_the_goal_is_proved_impossible():
    never = replace(sp.loads(SCENARIO), sequence=in_order("undo_a", "make_a"))
    assert plan(never, intentions=["all"]).verdict == "unreachable"


def test_a_manual_sequence_is_carried_out_as_it_stands():
    by_hand = in_order("make_a", "undo_a", "make_a", "make_b", "make_c", manual=True)
    assert order_of(plan(model(by_hand))) == ["make_a", "undo_a", "make_a", "make_b", "make_c"]


def test_a_manual_sequence_that_misses_its_goal_or_cannot_start_says_so():
    short = plan(model(in_order("make_a", "make_b", manual=True)))
    assert (short.verdict, short.reached) == ("not_within", False)
    assert "without reaching its goal" in (short.reason or "")
    wrong = plan(model(in_order("undo_a", "make_b", manual=True)))
    assert "guard does not hold" in (wrong.reason or "")
