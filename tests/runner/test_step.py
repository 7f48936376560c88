"""The transition runner, sentence by sentence (Machines 2021, section 4.1)."""

from __future__ import annotations

from dataclasses import replace

from rig import PLANNERS, TWO_ARMS, Rig
from small_stations import edited

from smv_planner.protocol.messages import GoalMessage, StateMessage
from smv_planner.runner.decision import Cause, Decision
from smv_planner.runner.events import (
    Activate,
    Answered,
    Approve,
    Assign,
    Began,
    Cancel,
    Confirm,
    Heard,
    Pause,
    Proceed,
    Reenable,
    Tick,
)
from smv_planner.runner.recovery import recover
from smv_planner.runner.situation import Phase, Status

# --- taking over


def test_nothing_is_sent_before_every_hub_has_spoken_or_is_silent() -> None:
    rig = Rig()
    rig.do(Tick(0.2))
    rig.speak("left")
    assert rig.now.phase is Phase.LISTENING
    assert not rig.sent("left")
    assert not rig.sent("right")


def test_a_planner_holds_what_the_hubs_mirror_not_what_is_initial() -> None:
    rig = Rig()
    rig.hubs["left"] = replace(rig.hubs["left"], resting={"left.to": "out"})
    rig.measured["left"] = {"left.at": "out"}
    rig.speak()
    assert rig.sent("left")[0].values == {"left.to": "out"}
    assert rig.value("left.to") == "out"


def test_the_epoch_is_newer_than_any_that_a_hub_obeys() -> None:
    rig = Rig()
    rig.hubs["right"] = replace(rig.hubs["right"], obeyed=_goal(rig, epoch=41))
    rig.speak()
    assert rig.now.epoch == 42
    assert {message.epoch for message in rig.sent("left")} == {42}


def test_nothing_is_planned_before_all_living_hubs_obey() -> None:
    rig = Rig()
    rig.deaf.add("right")
    rig.speak()
    rig.wait(0.4)
    assert rig.now.phase is Phase.JOINING
    assert rig.now.asked is None
    rig.deaf.clear()
    rig.wait(0.4)
    assert rig.now.phase is Phase.RUNNING
    assert rig.now.asked is not None


def test_a_planner_falls_silent_when_a_newer_one_rules_a_hub() -> None:
    rig = Rig().begin()
    rig.hubs["left"] = replace(rig.hubs["left"], obeyed=_goal(rig, epoch=99))
    rig.speak("left")
    assert rig.now.phase is Phase.FENCED_OUT
    before = len(rig.sent("left")) + len(rig.sent("right"))
    rig.wait(1.0)
    assert len(rig.sent("left")) + len(rig.sent("right")) == before
    assert any("other" in text for text in rig.notes("alarm"))


def test_a_hub_that_never_speaks_is_lost_and_blocks_nobody_else_once_it_is_known() -> None:
    rig = Rig().begin()
    later = Rig()
    later.now = replace(rig.now, phase=Phase.STOPPED)
    later.at = 10.0
    later.do(Began(10.0, "q"))
    later.wait(2.0, silent=("right",))
    assert "right" in later.now.lost
    assert later.now.phase is Phase.RUNNING


# --- following a plan


def test_after_a_restart_a_hub_that_is_silent_is_not_told_what_it_was_told_before() -> None:
    rig = Rig().begin()
    assert rig.sent("right")[-1].values == {"right.to": "out"}
    rig.do(Began(rig.at, "q"))
    before = len(rig.sent("right"))
    rig.wait(4.0, silent=("right",))
    assert rig.now.phase is Phase.RUNNING
    assert "right" in rig.now.lost
    assert len(rig.sent("right")) == before
    rig.wait(0.4)
    assert len(rig.sent("right")) > before


def test_independent_operations_run_at_the_same_time() -> None:
    rig = Rig().begin()
    assert rig.executing == ["work_left", "work_right"]
    assert rig.value("left.to") == rig.value("right.to") == "out"


def test_a_goal_changes_at_once_and_is_repeated_every_period() -> None:
    rig = Rig().begin()
    last = rig.sent("left")[-1]
    assert last.values == {"left.to": "out"}
    rig.wait(1.0)
    again = rig.sent("left")[-5:]
    assert {message.seq for message in again} == {last.seq}
    assert len(again) == 5


def test_a_command_waits_until_the_hubs_that_it_depends_on_mirror_theirs() -> None:
    rig = Rig(TWO_ARMS + "invariants:\n  right_first: left.to == home or right.to == out\n")
    rig.wait(0.4)
    rig.deaf = {"right"}
    rig.answer()
    assert rig.value("right.to") == "out"
    rig.wait(0.4)
    assert rig.value("left.to") == "home", "the message to the right arm got lost: both together would be forbidden"
    rig.deaf = set()
    rig.wait(0.4)
    assert rig.value("left.to") == "out"


def test_a_planned_effect_goes_on_with_the_plan_and_asks_nobody() -> None:
    rig = Rig().begin()
    rig.measure("left.at", "out")
    assert rig.notes("measured")[-1] == "left: left.arrives"
    assert rig.value("left_done") is True
    assert rig.executing == ["work_right"]


def test_an_operation_that_ends_lets_the_others_go_on() -> None:
    rig = Rig().begin()
    rig.measure("left.at", "out")
    rig.answer()
    assert rig.executing == ["work_right"]
    rig.measure("right.at", "out")
    assert rig.now.intentions["both"].status is Status.INITIAL
    assert "'both' is finished" in rig.notes("intention")


def test_what_an_intention_does_in_the_end_is_done() -> None:
    rig = Rig().begin()
    rig.measure("left.at", "out")
    rig.answer()
    rig.measure("right.at", "out")
    assert rig.value("noted") is True


def test_an_effect_of_another_hub_than_planned_leads_to_forward_simulation_only() -> None:
    rig = Rig().begin()
    rig.measure("left.at", "out")
    decision = rig.answer()
    assert [action.name for action in decision.actions] == []


# --- deviations


def test_an_unplanned_effect_makes_the_planners_plan_again() -> None:
    rig = Rig().begin()
    rig.measure("left.at", "dropped")
    assert rig.now.asked is not None
    assert rig.now.asked.cause is Cause.DEVIATION


def test_a_change_that_no_effect_explains_is_said_to_be_one() -> None:
    rig = Rig(left_at="out", left_to="out").begin()
    rig.measure("left.at", "home")
    assert "no effect explains left.at = home" in rig.notes("measured")[-1]


def test_a_late_answer_is_dropped() -> None:
    rig = Rig().begin()
    rig.measure("left.at", "dropped")
    late = rig.question
    rig.measure("left.at", "out")
    decision = recover(rig.station.model, late.request, PLANNERS)
    rig.do(Answered(rig.at, late.revision, decision))
    assert rig.notes("stale")
    assert rig.now.asked is not None
    assert rig.now.asked.revision > late.revision


def test_an_answer_to_another_question_changes_nothing() -> None:
    rig = Rig().begin()
    rig.measure("left.at", "dropped")
    old = rig.question
    before = rig.now
    rig.do(Answered(rig.at, old.revision - 1, recover(rig.station.model, old.request, PLANNERS)))
    assert rig.now == before


def test_an_answer_about_a_state_that_is_no_more_does_not_bring_it_back() -> None:
    rig = Rig()
    rig.wait(0.4)
    question = rig.question
    assert not rig.now.executing
    rig.measure("left.at", "dropped")
    rig.do(Answered(rig.at, question.revision, recover(rig.station.model, question.request, PLANNERS)))
    assert rig.notes("stale")
    assert rig.value("left.at") == "dropped"


def test_while_the_planners_think_nothing_new_is_commanded() -> None:
    rig = Rig().begin()
    rig.measure("left.at", "dropped")
    seq = rig.sent("right")[-1].seq
    rig.wait(1.0)
    assert rig.sent("right")[-1].seq == seq


# --- timeouts


def test_an_effect_that_does_not_come_is_not_counted_on_any_more() -> None:
    rig = Rig().begin()
    rig.wait(2.4)
    assert set(rig.now.disabled) == {"left.arrives", "right.arrives"}
    assert rig.now.asked is not None
    assert rig.now.asked.cause is Cause.TIMEOUT


def test_the_clock_of_an_effect_starts_again_when_its_guard_was_false() -> None:
    rig = Rig().begin()
    rig.wait(1.8)
    rig.measure("left.at", "out")
    rig.measure("left.at", "home")
    rig.wait(1.0)
    assert "left.arrives" not in rig.now.disabled
    assert "right.arrives" in rig.now.disabled


def test_an_effect_that_comes_late_after_all_counts_again() -> None:
    rig = Rig().begin()
    rig.wait(2.4)
    rig.measure("left.at", "out")
    assert "left.arrives" not in rig.now.disabled


def test_a_resource_silent_for_too_long_is_lost_once() -> None:
    rig = Rig().begin()
    rig.measure("left.at", "out")
    rig.answer()
    rig.wait(2.0, silent=("left",))
    assert rig.notes("lost") == ["'left' has been silent for 1 s"]


def test_a_hub_that_speaks_but_does_not_mirror_is_lost() -> None:
    rig = Rig()
    rig.wait(0.4)
    rig.deaf.add("left")
    rig.answer()
    rig.wait(1.6)
    assert "left" in rig.now.lost
    assert rig.notes("lost") == ["'left' does not mirror 'left.to'"]


def test_a_lost_resource_keeps_its_command_and_gets_no_new_one() -> None:
    rig = Rig().begin()
    rig.measure("left.at", "out")
    rig.answer()
    rig.wait(1.4, silent=("left",))
    seq = rig.sent("left")[-1].seq
    rig.order(Assign({"left_done": False}))
    rig.answer_all()
    rig.wait(1.0, silent=("left",))
    assert rig.sent("left")[-1].seq == seq
    assert rig.sent("left")[-1].values == {"left.to": "out"}


def test_a_hub_that_restarts_is_held_to_what_it_mirrors() -> None:
    rig = Rig().begin()
    rig.deaf.add("left")
    _restart(rig, "left", 1)
    assert rig.value("left.to") == "home"
    assert rig.now.asked is not None


# --- orders from outside


def test_a_goal_undone_from_outside_is_reached_again() -> None:
    rig = Rig(told=False)
    rig.wait(0.4)
    rig.order(Assign({"told": True}))
    rig.answer()
    rig.measure("left.at", "out")
    rig.answer()
    rig.order(Assign({"left_done": False}))
    decision = rig.answer()
    assert "OP" in [action.name for action in decision.actions]
    assert "work_left" in rig.executing or rig.value("left_done")


def test_what_belongs_to_hubs_cannot_be_assigned() -> None:
    rig = Rig().begin()
    rig.order(Assign({"left.at": "out", "left.to": "home", "told": False}))
    assert rig.value("left.at") == "home"
    assert rig.value("left.to") == "out"
    assert rig.value("told") is False
    assert rig.notes("refused")


def test_a_paused_intention_stops_its_operations_and_goes_on_later() -> None:
    rig = Rig().begin()
    rig.order(Pause("both"))
    rig.answer()
    assert rig.executing == []
    rig.order(Activate("both"))
    rig.answer()
    assert rig.executing == ["work_left", "work_right"]


def test_a_cancelled_intention_does_not_start_again_by_itself() -> None:
    rig = Rig().begin()
    rig.order(Cancel("both"))
    rig.answer()
    rig.wait(1.0)
    assert rig.now.intentions["both"].status is Status.CANCELLED
    assert rig.executing == []


def test_a_cancelled_operation_goes_back_to_initial_and_is_planned_again() -> None:
    rig = Rig().begin()
    rig.order(Cancel("work_left"))
    assert rig.executing == ["work_right"]
    rig.answer()
    assert sorted(rig.executing) == ["work_left", "work_right"]


# --- errors


def _dropped() -> Rig:
    """Both arms are done but for the left one, which has slipped and needs the operator."""
    rig = Rig().begin()
    rig.measure("left.at", "dropped")
    rig.answer_all()
    rig.measure("right.at", "out")
    rig.answer_all()
    return rig


def test_what_the_operator_has_moved_is_not_sent_back_before_he_says_that_he_is_done() -> None:
    rig = _dropped()
    assert rig.sent("left")[-1].values == {"left.to": "out"}
    rig.measure("left.at", "home")
    assert rig.sent("left")[-1].values == {"left.to": "home"}


def test_nothing_goes_on_under_the_hands_of_the_operator() -> None:
    rig = _dropped()
    rig.measure("left.at", "home")
    rig.wait(10.0)
    assert rig.sent("left")[-1].values == {"left.to": "home"}
    assert rig.now.wishes
    rig.order(Confirm(rig.instructions[-1].request))
    rig.answer_all()
    assert rig.sent("left")[-1].values == {"left.to": "out"}


def test_a_planner_that_starts_anew_asks_the_operator_again() -> None:
    rig = _dropped()
    rig.do(Began(rig.at, "q"))
    rig.wait(1.0)
    rig.answer_all()
    assert [one.transition for one in rig.instructions] == ["left.lift", "left.lift"]
    rig.measure("left.at", "home")
    rig.order(Confirm(rig.instructions[-1].request))
    rig.answer_all()
    rig.measure("left.at", "out")
    rig.answer_all()
    assert "'both' is finished" in rig.notes("intention")


TABLE = """
smv_planner: 1
name: table
resources:
  table:
    variables:
      to: {kind: goal,     domain: {min: 1, max: 3}, initial: 1}
      at: {kind: measured, domain: {min: 1, max: 3}, initial: 1}
    transitions:
      next:  {kind: controlled, guard: to == at and to < 3, actions: {to: to + 1}}
      turns: {kind: effect, guard: to != at, actions: {at: to}, within: 2 s}
decision:
  turned: {domain: bool, initial: false}
operations:
  turn: {guard: not turned, effects: {turned: true}, goal: table.at == 3}
intentions:
  to_the_end: {start: not turned, goal: turned}
"""


def test_an_effect_that_has_happened_and_is_wanted_again_at_once_has_all_its_time_again() -> None:
    rig = Rig(TABLE).begin()
    assert rig.value("table.to") == 2
    rig.wait(1.8)
    rig.measure("table.at", 2)
    assert rig.value("table.to") == 3
    rig.wait(1.8)
    assert not rig.notes("timeout")
    rig.wait(0.6)
    assert rig.notes("timeout")


def test_what_was_commanded_before_may_go_on_while_the_planners_think() -> None:
    """Nothing has gone wrong, so no operation has failed; who thinks for long must not use up its retries."""
    rig = Rig(TABLE).begin()
    rig.do(Began(rig.at, "q"))
    rig.wait(1.0)
    rig.measure("table.at", 2)
    rig.answer()
    assert rig.notes("stale")
    assert rig.question.request.cause is Cause.RESUMED
    rig.answer_all()
    assert rig.value("table.to") == 3
    assert not rig.now.failures


def test_after_its_retries_an_operation_is_in_error_and_only_the_operator_allows_it_again() -> None:
    rig = Rig().begin()
    for times in range(1, 4):
        assert "work_left" in rig.executing
        _restart(rig, "left", times)
        rig.answer_all()
    assert rig.now.failed["work_left"] == "failed 3 times"
    assert rig.now.intentions["both"].status is Status.ERROR
    assert "Try again?" in rig.consents[-1].text
    rig.order(Approve(rig.consents[-1].request))
    rig.answer()
    assert "work_left" in rig.executing


def test_an_arm_that_slips_needs_the_operator_and_sensors_have_to_agree() -> None:
    rig = _dropped()
    assert [one.transition for one in rig.instructions] == ["left.lift"]
    rig.order(Confirm(rig.instructions[-1].request))
    assert rig.value("left.at") == "dropped"
    rig.wait(6.0)
    assert len(rig.instructions) == 2, "asked again: the sensors do not show it"
    rig.measure("left.at", "home")
    rig.order(Confirm(rig.instructions[-1].request))
    rig.order(Confirm(rig.instructions[-1].request))
    rig.speak("left")
    assert rig.value("left.to") == "out"
    rig.measure("left.at", "out")
    rig.answer_all()
    assert "'both' is finished" in rig.notes("intention")


def test_ask_waits_for_approval_of_the_substitute() -> None:
    text = edited(TWO_ARMS, ("name: two_arms", "name: two_arms\non_error: ask"))
    rig = Rig(text).begin()
    rig.measure("left.at", "dropped")
    rig.answer_all()
    assert rig.now.halted
    assert rig.consents
    rig.order(Approve(rig.consents[-1].request))
    assert rig.now.halted is None


def test_halt_stops_until_told_to_proceed() -> None:
    text = edited(TWO_ARMS, ("name: two_arms", "name: two_arms\non_error: halt"))
    rig = Rig(text).begin()
    rig.measure("left.at", "dropped")
    rig.answer_all()
    assert rig.now.halted
    rig.order(Proceed())
    assert rig.now.halted is None


def test_an_effect_may_be_allowed_again_by_hand() -> None:
    rig = Rig().begin()
    rig.wait(2.4)
    rig.answer_all()
    rig.order(Reenable("left.arrives"))
    assert "left.arrives" not in rig.now.disabled


def test_an_undecided_answer_disables_nothing_and_is_asked_again() -> None:
    rig = Rig()
    rig.wait(0.4)
    asked = rig.question
    rig.do(Answered(rig.at, asked.revision, Decision(undecided="out of time")))
    assert not rig.now.failed
    assert rig.now.asked is None
    rig.wait(1.0)
    assert rig.now.asked is not None


def test_a_message_that_was_overtaken_changes_nothing() -> None:
    rig = Rig().begin()
    interface = rig.station.interfaces["left"]
    measured, mirror = {"left.at": "dropped"}, {"left.to": "out"}
    old = StateMessage(interface.cell, "left", "left-1", 1, interface.model, measured, mirror, rig.now.epoch, 1, "p")
    rig.do(Heard(rig.at, old))
    assert rig.value("left.at") == "home"
    assert rig.now.rejected


def _restart(rig: Rig, name: str, times: int) -> None:
    """The hub has forgotten what it was asked."""
    rig.reboot(name, f"{name}-{times + 1}", to="home")
    rig.speak(name)
    rig.speak(name)


def _goal(rig: Rig, epoch: int) -> GoalMessage:
    interface = rig.station.interfaces["left"]
    return GoalMessage(interface.cell, "left", epoch, 1, "other", interface.model, {"left.to": "home", "right.to": "home"})
