"""What goes wrong, and what is tried again of it (Machines 2021, section 4.6)."""

from __future__ import annotations

from rig import TWO_ARMS, Rig
from small_stations import BAD_PLACE, ONE_WORKS, SWITCH, edited, without_lift

from smv_planner.runner.events import Began
from smv_planner.runner.situation import Phase, Status

HALTS = edited(TWO_ARMS, ("name: two_arms", "name: two_arms\non_error: halt"))


def _failed(text: str) -> Rig:
    """The left arm was dropped, nobody may lift it, and the right one is done."""
    rig = Rig(without_lift(text)).begin()
    rig.measure("left.at", "dropped")
    rig.answer_all()
    rig.measure("right.at", "out")
    rig.answer_all()
    assert rig.now.intentions["both"].status is Status.ERROR
    assert "work_left" in rig.now.failed
    return rig


# --- what is tried again


def test_a_failed_operation_is_possible_again_when_somebody_has_put_things_right() -> None:
    rig = _failed(TWO_ARMS)
    rig.measure("left.at", "home")
    rig.wait(1.2)
    rig.answer_all()
    assert not rig.now.failed
    assert rig.executing == ["work_left"]


def test_a_failed_operation_that_counts_again_on_change_does_so_at_once() -> None:
    rig = _failed(edited(TWO_ARMS, ("goal: left.at == out, retries: 2", "goal: left.at == out, retries: 2, reenable: on_change")))
    rig.measure("left.at", "home")
    assert not rig.now.failed
    rig.answer_all()
    assert rig.executing == ["work_left"]


def test_a_planner_that_begins_anew_says_again_why_nothing_goes_on() -> None:
    rig = _failed(TWO_ARMS)
    why = rig.now.stuck
    assert why is not None
    rig.do(Began(rig.at, "p2"))
    rig.wait(1.4)
    assert rig.now.phase is Phase.RUNNING
    rig.answer_all()
    assert rig.now.stuck == why


FOUR_STEPS = edited(
    ONE_WORKS,
    ("decision:\n", "decision:\n  n: {domain: {min: 0, max: 4}, initial: 0}\n"),
    (
        "operations:\n",
        "operations:\n"
        "  out:        {guard: n == 0, effects: {n: 1}, goal: right.at == out}\n"
        "  back:       {guard: n == 1, effects: {n: 2}, goal: right.at == home}\n"
        "  out_again:  {guard: n == 2, effects: {n: 3}, goal: right.at == out}\n"
        "  back_again: {guard: n == 3, effects: {n: 4}, goal: right.at == home}\n",
    ),
)


def test_a_failed_operation_is_looked_at_again_while_others_work() -> None:
    rig = Rig(without_lift(FOUR_STEPS) + "  two: {start: n < 4, goal: n == 4}\n").begin()
    rig.measure("left.at", "dropped")
    rig.answer_all().wait(0.4)
    rig.answer_all()
    assert rig.now.failed
    assert rig.executing == ["out"]
    rig.measure("left.at", "home")
    rig.answer_all()
    for _ in range(3):
        rig.measure("right.at", rig.value("right.to"))
        rig.answer_all().wait(0.4)
        rig.answer_all()
    assert rig.value("n") == 3
    assert not rig.now.failed
    assert "work_left" in rig.executing


def test_an_effect_between_resources_counts_again_when_something_it_depends_on_changes() -> None:
    text = edited(
        BAD_PLACE,
        (
            "decision:\n",
            "transitions:\n"
            "  helped: {kind: effect, guard: device.to == there and device.at == here, actions: {lamp.lit: true}, "
            "within: 2 s, reenable: on_change}\n"
            "decision:\n",
        ),
    )
    rig = Rig(text, device_to="there")
    rig.wait(3.4)
    assert "helped" in rig.now.disabled
    rig.measure("device.at", "there")
    assert "helped" not in rig.now.disabled


# --- halting


def test_an_operation_that_has_used_up_its_retries_halts_if_the_scenario_says_so() -> None:
    rig = Rig(HALTS).begin()
    for times in range(1, 4):
        rig.reboot("left", f"left-{times + 1}", to="home")
        rig.speak("left", "left")
        rig.answer_all()
    assert "work_left" in rig.now.spent
    assert rig.now.halted


def test_a_lost_resource_halts_if_the_scenario_says_so_even_if_another_can_do_its_work() -> None:
    text = edited(
        ONE_WORKS,
        ("silent_after: 1 s", "silent_after: 1 s\n    on_error: halt"),
        ("goal: left.at == out", "goal: left.at == out or right.at == out"),
    )
    rig = Rig(text).begin()
    (used,) = (name for name in ("left", "right") if rig.value(f"{name}.to") == "out")
    rig.wait(1.6, silent=(used,))
    rig.answer_all().wait(0.4, silent=(used,))
    assert rig.now.lost.keys() == {used}
    assert rig.executing == ["work_left"], "there is a plan without it"
    assert rig.now.halted


def test_automatic_transitions_are_taken_during_a_halt() -> None:
    text = edited(
        HALTS,
        (
            "decision:\n",
            "transitions:\n"
            "  back_off: {kind: automatic, guard: left.at == dropped and right.at == out, actions: {right.to: home}}\n"
            "decision:\n",
        ),
    )
    rig = Rig(text).begin()
    rig.measure("left.at", "dropped")
    rig.answer_all()
    assert rig.now.halted
    rig.measure("right.at", "out")
    rig.answer_all()
    assert rig.now.halted
    assert rig.sent("right")[-1].values == {"right.to": "home"}


def test_a_model_whose_automatic_transitions_do_not_settle_is_halted_and_people_are_told() -> None:
    text = edited(
        SWITCH,
        (
            "operations:\n",
            "transitions:\n"
            "  fill:  {kind: automatic, guard: full == 0, actions: {full: 1}}\n"
            "  spill: {kind: automatic, guard: full == 1, actions: {full: 0}}\n"
            "operations:\n",
        ),
    )
    rig = Rig(text)
    rig.wait(0.6)
    assert rig.now.halted
    assert any("do not settle" in text for text in rig.notes("alarm"))


# --- what is believed of what is lost


def test_what_an_automatic_transition_asks_of_a_lost_resource_is_what_that_is_told() -> None:
    text = edited(
        ONE_WORKS,
        (
            "decision:\n",
            "transitions:\n"
            "  joins: {kind: automatic, guard: right.at == out and left.to == home, actions: {left.to: out}}\n"
            "decision:\n",
        ),
    )
    rig = Rig(text, left_done=True).begin()
    rig.wait(2.0, silent=("left",))
    assert "left" in rig.now.lost
    rig.measured["right"] = {"right.at": "out"}
    rig.wait(0.4, silent=("left",))
    assert "joins" in rig.notes("fired")
    assert rig.now.hubs["left"].commanded == {"left.to": rig.value("left.to")}


def test_a_command_that_a_lost_hub_has_not_mirrored_is_taken_back():
    rig = Rig()
    rig.wait(0.4)
    rig.deaf.add("left")
    rig.answer()
    assert rig.value("left.to") == "out"
    rig.wait(1.6)
    assert "left" in rig.now.lost
    assert rig.value("left.to") == "home"
    assert rig.sent("left")[-1].values == {"left.to": "home"}
    assert rig.now.doubts == {"left": {"left.to": "out"}}
    rig.deaf.clear()
    rig.wait(1.0)
    assert "left" not in rig.now.lost
    assert not rig.now.doubts


def test_no_command_is_taken_back_that_must_not_be_where_a_silent_device_may_have_got_to() -> None:
    """Seed 1496 of the simulation: a robot that had come up from a bolt unheard was sent down again, with the tool at rest."""
    stays = "invariants:\n  stays_out: not (left.to == home and left.at == out)\n"
    text = edited(ONE_WORKS, ("decision:\n", stays + "decision:\n"))
    rig = Rig(text).begin()
    assert rig.value("left.to") == "out"
    rig.wait(2.0, silent=("left",))
    assert "left" in rig.now.lost
    assert {goal.values["left.to"] for goal in rig.sent("left")[-5:]} == {"out"}
    assert rig.now.doubts == {"left": {"left.to": "home"}}
    rig.measured["left"] = {"left.at": "out"}
    rig.wait(1.0)
    assert "left" not in rig.now.lost
    assert not rig.now.doubts
    assert not rig.notes("gate")
