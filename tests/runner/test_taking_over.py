"""Planners and hubs that die, begin anew and come back."""

from __future__ import annotations

from dataclasses import replace

from rig import TWO_ARMS, Rig
from small_stations import edited

from smv_planner.protocol import hub as hubs
from smv_planner.protocol.messages import GoalMessage
from smv_planner.runner.events import Began, Heard
from smv_planner.runner.situation import Phase


def _succeeded(rig: Rig, text: str, deaf: str | None = None) -> Rig:
    """Another planner takes over with what the first one knew, when hubs have begun anew."""
    later = Rig(text)
    later.now, later.at = replace(rig.now, phase=Phase.STOPPED), 10.0
    later.deaf = {deaf} if deaf else set()
    later.do(Began(10.0, "q"))
    return later


def test_a_hub_that_was_silent_when_the_planner_began_comes_back_after_its_time() -> None:
    text = edited(TWO_ARMS, ("silent_after: 1 s", "silent_after: 1 s\n    reenable: after 1 s"))
    later = _succeeded(Rig(text).begin(), text)
    later.wait(2.0, silent=("right",))
    later.answer_all()
    assert later.now.phase is Phase.RUNNING
    assert "right" in later.now.lost
    told = len(later.sent("right"))
    later.wait(20.0)
    assert "right" not in later.now.lost
    assert len(later.sent("right")) > told


def test_hubs_that_have_not_spoken_are_lost_in_declared_order() -> None:
    more = [f"arm_{number}" for number in range(8)]
    idle = "".join(f"  {name}: {{template: arm}}\n" for name in more)
    rig = Rig(edited(TWO_ARMS, ("  right: {template: arm}\n", "  right: {template: arm}\n" + idle)))
    rig.wait(2.0, silent=tuple(more))
    assert list(rig.now.lost) == more


def test_a_hub_that_dies_while_the_planner_joins_does_not_hold_it_up() -> None:
    later = _succeeded(Rig().begin(), TWO_ARMS, deaf="right")
    later.wait(0.4)
    assert later.now.phase is Phase.JOINING
    later.wait(60.0, silent=("right",))
    assert later.now.phase is Phase.RUNNING
    assert "right" in later.now.lost


def test_a_hub_that_speaks_but_never_obeys_does_not_hold_up_joining() -> None:
    rig = Rig()
    rig.deaf.add("right")
    rig.wait(60.0)
    assert rig.now.phase is Phase.RUNNING
    assert "right" in rig.now.lost


def test_a_resource_that_only_people_may_count_on_again_stays_lost_when_the_planner_begins_anew() -> None:
    rig = Rig(edited(TWO_ARMS, ("silent_after: 1 s", "silent_after: 1 s\n    reenable: manual"))).begin()
    rig.wait(2.0, silent=("left",))
    rig.answer_all().wait(2.0)
    rig.answer_all()
    assert "left" in rig.now.lost
    rig.do(Began(rig.at, "p"))
    rig.wait(1.0)
    rig.answer_all()
    assert rig.now.phase is Phase.RUNNING
    assert "left" in rig.now.lost


def test_a_hub_that_has_never_spoken_is_waited_for_and_named():
    rig = Rig()
    rig.wait(5.0, silent=("right",))
    assert rig.now.phase is Phase.JOINING
    assert rig.now.asked is None
    assert [text for text in rig.notes("alarm") if "'right'" in text] == rig.notes("alarm")
    assert len(rig.notes("alarm")) == 1
    rig.wait(1.0)
    assert rig.now.phase is Phase.RUNNING
    assert rig.now.stuck is None


def test_an_epoch_that_nobody_can_have_reached_is_not_outdone():
    rig = Rig()
    rig.hubs["right"] = replace(rig.hubs["right"], obeyed=_goal_of_another(rig, epoch=2**53 - 1))
    rig.wait(5.0)
    assert rig.now.epoch == 1
    assert "right" in rig.now.lost


def test_a_single_forged_message_does_not_silence_a_planner_for_good():
    rig = Rig().begin()
    forged = replace(rig.hubs["left"], obeyed=_goal_of_another(rig, epoch=77))
    _, message = hubs.report(forged, rig.measured["left"], rig.at)
    rig.do(Heard(rig.at, message))
    assert rig.now.phase is Phase.FENCED_OUT
    rig.hubs["left"] = replace(rig.hubs["left"], seq=forged.seq + 1)
    rig.wait(8.0)
    assert rig.now.phase is Phase.RUNNING
    assert rig.now.epoch == 2


def test_a_planner_that_a_newer_one_has_taken_over_from_stays_silent():
    rig = Rig().begin()
    rig.hubs["left"] = replace(rig.hubs["left"], obeyed=_goal_of_another(rig, epoch=77))
    rig.wait(60.0)
    assert rig.now.phase is Phase.FENCED_OUT


def _goal_of_another(rig, epoch):
    interface = rig.station.interfaces["left"]
    values = {"left.to": "home", "right.to": "home"}
    return GoalMessage(interface.cell, "left", epoch, 1, "other", interface.model, values)


def test_what_has_waited_while_a_listening_planner_slept_is_not_believed() -> None:
    """It would take over with what hubs obeyed long ago, and command it again (seed 1288 of the simulation)."""
    first = Rig()
    waiting = [Heard(20.0, hubs.report(hub, first.measured[name], 0.0)[1]) for name, hub in first.hubs.items()]
    first.begin().wait(2.0)
    assert first.value("left.to") == "out"  # commanded while the other sleeps
    second = Rig(planner="q")
    second.hubs, second.measured, second.at = first.hubs, first.measured, 20.0
    for late in waiting:
        second.do(late)
    assert not second.sent("left")
    second.wait(1.0)
    assert second.now.phase is Phase.RUNNING
    assert not second.now.lost
    assert {goal.values["left.to"] for goal in second.sent("left")} == {"out"}
