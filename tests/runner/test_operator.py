"""What the operator is asked for, and what he does (Machines 2021, section 4.5)."""

from __future__ import annotations

from rig import TWO_ARMS, Rig
from small_stations import ONE_WORKS, edited

from smv_planner.runner.events import Approve, Assign, Began, Cancel, Confirm, Pause, Reenable, Tick, Withdraw
from smv_planner.runner.situation import Status, WishKind

ASKS = edited(TWO_ARMS, ("name: two_arms", "name: two_arms\non_error: ask"))


def _dropped(text: str = ONE_WORKS) -> Rig:
    """The left arm has slipped, and the operator is asked to lift it."""
    rig = Rig(text).begin()
    rig.measure("left.at", "dropped")
    rig.answer_all()
    if text == TWO_ARMS:
        rig.measure("right.at", "out")
        rig.answer_all()
    return rig


def _lifted(rig: Rig) -> Rig:
    """The operator has lifted the left arm."""
    rig.measure("left.at", "home")
    rig.order(Confirm(rig.instructions[-1].request))
    rig.answer_all().wait(0.4)
    return rig.answer_all()


def _wishes(rig: Rig) -> list[WishKind]:
    return [wish.kind for wish in rig.now.wishes.values()]


# --- asking


def test_whoever_waits_for_approval_still_does_after_planning_anew() -> None:
    rig = _dropped(ASKS)
    assert WishKind.SUBSTITUTE in _wishes(rig)
    consent = rig.consents[-1].request
    rig.measure("right.at", "dropped")
    rig.answer_all()
    assert rig.now.halted
    assert WishKind.SUBSTITUTE in _wishes(rig)
    assert Withdraw(consent) not in rig.out
    rig.order(Approve(consent))
    assert rig.now.halted is None


def test_whoever_waits_for_approval_still_does_after_the_planner_has_begun_anew() -> None:
    rig = _dropped(ASKS)
    rig.do(Began(rig.at, "p"))
    for _ in range(2):
        rig.wait(1.0)
        rig.answer_all()
    assert rig.now.halted
    assert WishKind.SUBSTITUTE in _wishes(rig)


def test_another_mishap_means_another_instruction() -> None:
    rig = _lifted(_dropped(TWO_ARMS))
    assert rig.value("left.to") == "out"
    asked = len(rig.instructions)
    rig.measure("left.at", "dropped")
    rig.answer_all().wait(20.0)
    rig.answer_all()
    assert len(rig.instructions) == asked + 1


def test_a_confirmation_said_again_confirms_nothing_that_was_asked_for_since() -> None:
    rig = _lifted(_dropped(TWO_ARMS))
    first = rig.instructions[-1].request
    rig.measure("left.at", "dropped")
    rig.answer_all().wait(20.0)
    rig.answer_all()
    assert rig.instructions[-1].request != first
    rig.order(Confirm(first))
    assert [wish.confirmed_at for wish in rig.now.wishes.values()] == [None]


def test_what_the_operator_was_asked_to_try_again_is_withdrawn_when_it_is_allowed_otherwise() -> None:
    rig = Rig().begin()
    for times in range(1, 4):
        rig.reboot("left", f"left-{times + 1}", to="home")
        rig.speak("left", "left")
        rig.answer_all()
    assert _wishes(rig) == [WishKind.RETRY]
    rig.order(Reenable("work_left"))
    rig.answer_all().wait(1.0)
    rig.answer_all()
    assert "work_left" in rig.executing
    assert not rig.now.wishes
    assert Withdraw(rig.consents[-1].request) in rig.out


def test_the_operator_is_not_needed_any_more_when_a_lost_resource_is_back() -> None:
    text = edited(ONE_WORKS, ("{kind: maintenance, guard: at == dropped,", "{kind: maintenance,"))
    text += "invariants:\n  one_at_a_time: not (left.at == out and right.at == out)\n"
    rig = Rig(text, right_to="out", right_at="out", left_done=True).begin()
    rig.wait(2.0, silent=("right",))
    rig.order(Assign({"left_done": False}))
    rig.answer_all()
    assert [one.transition for one in rig.instructions] == ["right.lift"]
    for _ in range(2):
        rig.wait(2.0)
        rig.answer_all()
    assert "right" not in rig.now.lost
    assert not rig.now.wishes
    assert rig.value("right.to") == "home", "the arm goes by itself"


def test_an_intention_that_needs_no_help_does_not_wait_for_the_operator() -> None:
    text = edited(
        ONE_WORKS,
        ("decision:\n", "decision:\n  right_done: {domain: bool, initial: true}\n"),
        (
            "operations:\n",
            "operations:\n  work_right: {guard: not right_done, effects: {right_done: true}, goal: right.at == out}\n",
        ),
    )
    rig = _dropped(text + "  two: {start: not right_done, goal: right_done}\n")
    assert rig.instructions
    rig.order(Assign({"right_done": False}))
    rig.answer_all().wait(1.4)
    rig.answer_all()
    assert "work_right" in rig.executing
    rig.measure("right.at", "out")
    rig.answer_all().wait(1.4)
    rig.answer_all()
    assert "'two' is finished" in rig.notes("intention")
    assert _wishes(rig) == [WishKind.MAINTENANCE], "the left arm still waits to be lifted"


# --- doing


def test_what_the_operator_moved_by_hand_stays_where_it_is_when_its_hub_begins_anew() -> None:
    text = edited(
        TWO_ARMS,
        ("guard: at == dropped, actions: {at: home, to: home}", "actions: {at: home, to: home}"),
        ("  work_left:  {guard: not left_done,  effects: {left_done: true},  goal: left.at == out, retries: 2}\n", ""),
        ("is_left_out: {domain: bool, from: left.at == out}", "unused: {domain: bool, initial: false}"),
        ("told and not (left_done and right_done)", "told and not right_done"),
        ("goal: left_done and right_done", "goal: right_done"),
    )
    text += """invariants:
  one_at_a_time: not ((left.at == out or left.to == out) and (right.at == out or right.to == out))
"""
    rig = Rig(text, left_to="out", left_at="out", told=False).begin()
    rig.deaf.add("left")
    rig.wait(2.0, silent=("left",))
    assert "left" in rig.now.lost
    rig.order(Assign({"told": True}))
    rig.answer_all()
    rig.order(Confirm(rig.instructions[-1].request))
    rig.answer_all().wait(0.6, silent=("left",))
    rig.answer_all()
    assert rig.value("left.to") == "home"
    assert rig.sent("left")[-1].values == {"left.to": "home"}, "though nobody may hear it"
    rig.measured["left"] = {"left.at": "home"}
    rig.reboot("left", "left-9", to="home")
    rig.deaf.clear()
    rig.at += 0.2
    rig.do(Tick(rig.at))
    assert rig.hubs["left"].goal == {"left.to": "home"}


def test_maintenance_that_is_confirmed_when_it_is_not_its_time_any_more_is_not_taken() -> None:
    text = edited(
        ONE_WORKS,
        ("at: {kind: measured,", "fixed: {kind: estimated, domain: bool, initial: true}\n      at: {kind: measured,"),
        ("guard: at == dropped, actions", "guard: at == dropped and not fixed, actions"),
        (
            '"Lift the $resource arm."}\n',
            '"Lift the $resource arm."}\n'
            "      fix: {kind: maintenance, guard: at == home and not fixed, actions: {fixed: true}, instruction: Fix it.}\n",
        ),
        ("guard: to == home and at == home,", "guard: to == home and at == home and fixed,"),
        ("guard: to == out and at == home,", "guard: to == out and at == home and fixed,"),
    )
    rig = _lifted(Rig(text, left_fixed=False, left_at="dropped").begin())
    assert [one.transition for one in rig.instructions] == ["left.lift", "left.fix"]
    fix = rig.instructions[-1].request
    rig.measure("left.at", "dropped")
    rig.answer_all()
    rig.order(Confirm(fix))
    rig.wait(0.4)
    assert rig.value("left.fixed") is False
    rig.answer_all()
    assert rig.instructions[-1].transition == "left.lift", "first things first"


# --- orders while the operator is waited for


def test_a_cancelled_intention_does_not_make_use_of_the_operators_work() -> None:
    rig = _dropped(TWO_ARMS)
    lift = rig.instructions[-1].request
    rig.order(Cancel("both"))
    rig.answer_all()
    assert rig.now.intentions["both"].status is Status.CANCELLED
    assert not rig.now.wishes
    assert Withdraw(lift) in rig.out
    rig.measure("left.at", "home")
    rig.order(Confirm(lift))
    rig.answer_all().wait(10.0)
    rig.answer_all()
    assert not rig.executing
    assert not rig.now.wishes
    assert len(rig.instructions) == 1


def test_the_operator_is_still_waited_for_when_the_operation_that_needs_him_is_cancelled_and_its_intention_is_not() -> None:
    rig = _dropped()
    rig.order(Cancel("work_left"))
    rig.answer_all()
    assert _wishes(rig) == [WishKind.MAINTENANCE]
    _lifted(rig)
    assert rig.executing == ["work_left"]
    assert rig.value("left.to") == "out"


def test_an_intention_that_waits_for_the_operator_can_be_paused() -> None:
    rig = _dropped()
    assert rig.instructions
    rig.order(Pause("one"))
    rig.answer_all()
    assert rig.now.intentions["one"].status is Status.PAUSED
    assert not rig.now.wishes
    assert not rig.executing
