"""While the planners think, the world goes on: what happens meanwhile is neither lost nor held against anybody."""

from __future__ import annotations

from rig import PLANNERS, TWO_ARMS, Rig
from small_stations import ONE_WORKS, edited

from smv_planner.runner.events import Answered, Ask, Proceed, Tick
from smv_planner.runner.recovery import recover


def _late(rig: Rig, question: Ask) -> None:
    """The answer to a question, whatever has happened since it was put."""
    rig.do(Answered(rig.at, question.revision, recover(rig.station.model, question.request, PLANNERS)))


def test_a_plan_made_before_a_resource_was_lost_is_not_followed() -> None:
    rig = Rig(ONE_WORKS)
    rig.wait(0.4)
    question = rig.question
    rig.wait(2.0, silent=("left",))
    assert "left" in rig.now.lost
    _late(rig, question)
    rig.wait(10.0, silent=("left",))
    assert rig.now.following is None
    rig.answer_all()
    assert rig.now.failed.keys() == {"work_left"}


def test_a_plan_made_before_an_effect_timed_out_is_not_followed() -> None:
    rig = Rig(ONE_WORKS, left_to="out")
    rig.wait(0.4)
    question = rig.question
    rig.wait(3.0)
    assert "left.arrives" in rig.now.disabled
    _late(rig, question)
    rig.wait(10.0)
    assert rig.now.following is None
    rig.answer_all()
    assert rig.now.failed.keys() == {"work_left"}


def test_a_question_that_nobody_answers_is_put_again() -> None:
    rig = Rig()
    rig.wait(0.4)
    first = rig.question
    rig.wait(120.0)
    assert rig.question.revision > first.revision
    assert rig.question.request.cause is first.request.cause
    rig.answer_all()
    assert rig.executing == ["work_left", "work_right"]


THREE_STOPS = """
smv_planner: 1
name: three_stops
templates:
  cart:
    variables:
      to: {kind: goal,     domain: [a, b, c], initial: a}
      at: {kind: measured, domain: [a, b, c], initial: a}
    transitions:
      to_b: {kind: controlled, guard: to == a and at == a, actions: {to: b}}
      to_c: {kind: controlled, guard: to == b and at == b, actions: {to: c}}
      at_b: {kind: effect, guard: to == b and at == a, actions: {at: b}, within: 2 s}
      at_c: {kind: effect, guard: to == c and at == b, actions: {at: c}, within: 2 s}
resources: {left: {template: cart}, right: {template: cart}}
decision:
  left_half: {domain: bool, initial: false}
  left_done: {domain: bool, initial: false}
  right_done: {domain: bool, initial: false}
operations:
  left_to_b:  {guard: not left_half, effects: {left_half: true}, goal: left.at == b}
  left_to_c:  {guard: left_half and not left_done, effects: {left_done: true}, goal: left.at == c}
  right_to_c: {guard: not right_done, effects: {right_done: true}, goal: right.at == c, retries: 0}
intentions:
  all: {start: not right_done, goal: left_done and right_done}
"""


def test_a_planned_effect_that_comes_while_the_planners_think_is_no_failure() -> None:
    rig = Rig(THREE_STOPS).begin()
    assert rig.executing == ["left_to_b", "right_to_c"]
    rig.measure("left.at", "b")
    assert rig.now.asked, "the left cart's first operation is done"
    rig.measure("right.at", "b")
    rig.answer_all()
    assert not rig.now.failures
    assert not rig.now.spent
    assert sorted(rig.executing) == ["left_to_c", "right_to_c"]


def test_a_flickering_sensor_that_no_plan_has_to_do_with_does_not_make_every_answer_late() -> None:
    text = edited(
        ONE_WORKS,
        (
            "resources:\n",
            """resources:
  eye:
    variables:
      sees: {kind: measured, domain: bool, initial: false}
    transitions:
      comes: {kind: effect, guard: not sees, actions: {sees: true}}
      goes:  {kind: effect, guard: sees, actions: {sees: false}}
""",
        ),
    )
    rig = Rig(text)
    rig.wait(0.4)
    for sees in [True, False] * 5:
        if rig.now.asked:
            question = rig.question
            rig.measure("eye.sees", sees)
            _late(rig, question)
        else:
            rig.measure("eye.sees", sees)
    assert rig.executing == ["work_left"]
    assert rig.value("left.to") == "out"
    assert not rig.notes("stale")


def test_an_effect_that_came_while_the_planner_slept_has_not_timed_out() -> None:
    rig = Rig(edited(ONE_WORKS, ("goal: left.at == out}", "goal: left.at == out, retries: 0}"))).begin()
    rig.wait(0.6)
    rig.at += 10.0
    rig.measured["left"] = {"left.at": "out"}  # long since; the messages that say so wait in a queue
    rig.do(Tick(rig.at))
    rig.speak()
    rig.answer_all()
    assert not rig.notes("timeout")
    assert not rig.notes("lost")
    rig.wait(0.4)
    rig.answer_all()
    assert rig.value("left_done") is True
    assert not rig.now.failures


def test_going_on_after_a_halt_while_the_planners_think_does_nothing_twice() -> None:
    text = edited(
        TWO_ARMS,
        ("name: two_arms", "name: two_arms\non_error: halt"),
        (
            "decision:\n",
            """transitions:
  counts: {kind: automatic, guard: right.at == out and not seen, actions: {seen: true, how_often: how_often + 1}}
decision:
  seen:      {domain: bool, initial: false}
  how_often: {domain: {min: 0, max: 5}, initial: 0}
""",
        ),
    )
    rig = Rig(text).begin()
    rig.measure("left.at", "dropped")
    rig.answer_all()
    assert rig.now.halted
    rig.measure("right.at", "out")
    question = rig.question
    rig.order(Proceed())
    _late(rig, question)
    rig.answer_all()
    assert rig.now.halted is None
    assert rig.value("how_often") == 1
    assert rig.notes("fired").count("counts") == 1
