"""Operations in a prescribed order (Machines 2021, section 6.2), as the runner carries them out."""

from __future__ import annotations

from rig import Rig
from small_stations import TWO_STEPS, edited

from smv_planner.runner.events import Activate, Assign, Pause
from smv_planner.runner.situation import Status

PLANNED = edited(TWO_STEPS, ("SEQUENCE", "[first, second]"))
MANUAL = edited(TWO_STEPS, ("SEQUENCE", "[first, second], manual: true"))

# Nothing but the sequence says what comes first.
UNGUARDED = edited(
    MANUAL,
    ("guard: part == raw, effects: {part: half}", "guard: true, effects: {part: half}"),
    ("guard: part == half, effects: {part: ready}", "guard: true, effects: {part: ready}"),
)


def _work(rig: Rig, rounds: int = 10) -> None:
    """The machine does as it is told."""
    for _ in range(rounds):
        rig.answer_all().wait(0.4)
        rig.answer_all()
        if rig.value("machine.to") != rig.value("machine.at"):
            rig.measure("machine.at", rig.value("machine.to"))


def _started(rig: Rig) -> list[str]:
    return [text for text in rig.notes("operation") if text.endswith("starts")]


def test_a_sequence_is_carried_out_for_a_second_product_as_well() -> None:
    rig = Rig(PLANNED).begin()
    _work(rig)
    assert rig.value("part") == "ready"
    rig.order(Assign({"part": "none"}))
    _work(rig, 2)
    rig.order(Assign({"part": "raw"}))
    _work(rig)
    assert rig.value("part") == "ready"
    assert _started(rig) == ["'first' starts", "'second' starts"] * 2


def test_a_manual_sequence_waits_until_somebody_presses_the_button() -> None:
    rig = Rig(edited(MANUAL, ("first:  {guard: part == raw,", "first:  {guard: part == raw and pressed,"))).begin()
    _work(rig, 3)
    assert rig.now.intentions["make"].status is Status.EXECUTING
    assert not rig.executing
    rig.measure("machine.button", True)
    _work(rig)
    assert rig.value("part") == "ready"


def test_another_intention_is_pursued_without_spoiling_a_manual_sequence() -> None:
    rig = Rig(MANUAL).begin()
    assert rig.executing == ["first"]
    rig.order(Assign({"dusty": True}))
    _work(rig)
    assert rig.value("part") == "ready"
    assert rig.value("swept") is True
    assert _started(rig).count("'first' starts") == 1
    assert not [text for text in rig.notes("intention") if "error" in text]


def test_a_manual_sequence_that_was_paused_goes_on_where_it_stood() -> None:
    rig = Rig(UNGUARDED).begin()
    rig.measure("machine.at", True)
    rig.answer_all()
    assert rig.executing == ["second"]
    rig.order(Pause("make"))
    rig.answer_all()
    assert not rig.executing
    rig.order(Activate("make"))
    rig.answer_all()
    assert rig.executing == ["second"]


def test_what_a_manual_sequence_did_before_a_pause_is_not_done_again_though_the_machine_has_moved() -> None:
    rig = Rig(UNGUARDED).begin()
    rig.measure("machine.at", True)
    rig.answer_all().wait(0.4)
    rig.order(Pause("make"))
    rig.answer_all()
    rig.measure("machine.at", False)
    rig.order(Activate("make"))
    _work(rig)
    assert _started(rig).count("'first' starts") == 1
    assert rig.value("part") == "ready"
