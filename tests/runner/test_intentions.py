"""Intentions: what they start, what they owe, and what is done in the end (Def. 6)."""

from __future__ import annotations

from rig import Rig
from small_stations import ONE_WORKS, SWITCH, edited

from smv_planner.runner.events import Activate, Assign, Pause
from smv_planner.runner.situation import Status

GOAL = "goal: done}\n"


def test_what_an_intention_does_in_the_end_does_not_leave_a_domain() -> None:
    rig = Rig(edited(SWITCH, (GOAL, "goal: done, actions: {full: full + 1, visited: true}}\n"))).begin()
    rig.measure("device.at", True)
    rig.answer_all()
    assert "'one' is finished" in rig.notes("intention")
    assert rig.value("full") == 1
    assert rig.value("visited") is True, "the rest is done all the same"
    assert any("'full'" in text for text in rig.notes("refused"))


def test_an_operation_whose_start_would_leave_a_domain_does_not_start() -> None:
    rig = Rig(edited(SWITCH, ("goal: device.at}", "goal: device.at, on_start: {full: full + 1}}"))).begin()
    assert rig.value("full") == 1
    assert not rig.executing
    assert rig.now.intentions["one"].status is Status.ERROR


def test_activating_what_is_pursued_already_forgets_nothing_that_is_owed() -> None:
    rig = Rig(edited(SWITCH, (GOAL, "goal: done, formula: busy -> F visited}\n")), busy=True).begin()
    promised = rig.now.intentions["one"].owed
    rig.order(Assign({"busy": False}))
    rig.answer_all()
    owed = rig.now.intentions["one"].owed
    assert owed != promised, "the visit is owed from now on, busy or not"
    rig.order(Activate("one"))
    rig.answer_all()
    assert rig.now.intentions["one"].owed == owed
    rig.measure("device.at", True)
    rig.answer_all()
    assert "'one' is finished" in rig.notes("intention")
    assert rig.value("visited") is True


def test_an_operation_whose_start_breaks_the_formula_of_an_intention_never_starts() -> None:
    text = edited(
        SWITCH,
        ("work:  {guard: not done, effects: {done: true}, goal: device.at}",
         "work:  {guard: not done, effects: {done: true, busy: false}, goal: device.at, on_start: {busy: true}}"),
        (GOAL, "goal: done, formula: not busy}\n"),
    )  # fmt: skip
    rig = Rig(text).begin()
    rig.wait(0.4)
    rig.measure("device.at", True)
    rig.answer_all()
    assert not [text for text in rig.notes("operation") if text.endswith("starts")]
    assert rig.value("busy") is False
    assert rig.now.intentions["one"].status is Status.ERROR


def test_an_intention_that_was_impossible_is_tried_again_when_a_decision_variable_changes() -> None:
    rig = Rig(edited(SWITCH, ("work:  {guard: not done,", "work:  {guard: not done and busy,"))).begin()
    assert rig.now.intentions["one"].status is Status.ERROR
    rig.order(Assign({"busy": True}))
    rig.answer_all().wait(10.0)
    rig.answer_all()
    assert rig.now.intentions["one"].status is Status.EXECUTING
    assert rig.executing == ["work"]


def test_a_new_plan_may_need_an_operation_that_executes_a_second_time() -> None:
    text = edited(
        ONE_WORKS,
        ("decision:\n", "decision:\n  n: {domain: {min: 0, max: 4}, initial: 0}\n"),
        (
            "operations:\n",
            'operations:\n  out:  {guard: "n in {0, 2}", effects: {n: n + 1}, goal: right.at == out}\n'
            '  back: {guard: "n in {1, 3}", effects: {n: n + 1}, goal: right.at == home}\n',
        ),
        ("start: not left_done", "start: false"),
    )
    rig = Rig(text + "  two: {start: n < 4, goal: n == 4}\n").begin()
    assert rig.executing == ["out"]
    rig.order(Pause("two"))
    rig.order(Activate("two"))
    rig.answer_all()
    assert rig.now.intentions["two"].status is Status.EXECUTING
    assert rig.executing == ["out"]


def test_an_operation_that_goes_on_in_a_new_plan_keeps_the_post_condition_it_started_with() -> None:
    text = edited(
        ONE_WORKS,
        (
            "decision:\n",
            "decision:\n  wanted: {domain: {min: 0, max: 2}, initial: 1}\n  got: {domain: {min: 0, max: 2}, initial: 0}\n",
        ),
        ("effects: {left_done: true}", "effects: {left_done: true, got: wanted}"),
    )
    rig = Rig(text).begin()
    assert rig.executing == ["work_left"]
    rig.order(Assign({"wanted": 2}))
    rig.order(Pause("one"))  # so the operations are planned anew
    rig.order(Activate("one"))
    rig.answer_all()
    assert rig.executing == ["work_left"]
    rig.measure("left.at", "out")
    assert rig.value("got") == 1
