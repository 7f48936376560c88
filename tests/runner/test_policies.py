"""What operations say about errors for themselves counts, and else what the scenario says for all."""

from __future__ import annotations

import pytest
from rig import TWO_ARMS, Rig

from smv_planner.runner.events import Proceed

LEFT, RIGHT = "goal: left.at == out, retries: 2", "goal: right.at == out, retries: 2"
INDEPENDENT = TWO_ARMS.replace("goal: left_done and right_done", "goal: right_done") + (
    "  left_too: {start: told and not left_done, goal: left_done}\n"
)


def after_the_left_arm_was_dropped(of_all: str, of_left: str) -> Rig:
    """The work of the left arm is in error, and there is a plan for that of the right one."""
    text = INDEPENDENT + (f"on_error: {of_all}\n" if of_all else "")
    rig = Rig(text.replace(LEFT, LEFT + (f", on_error: {of_left}" if of_left else ""))).begin()
    rig.measure("left.at", "dropped")
    rig.wait(0.4)
    while rig.now.asked:
        rig.answer()
    assert "work_left" in rig.now.failed
    return rig


@pytest.mark.parametrize(
    ("of_all", "of_left", "halts"),
    [
        ("", "", False),
        ("continue", "halt", True),
        ("halt", "", True),
        ("halt", "continue", False),
        ("ask", "continue", False),
        ("ask", "", True),
    ],
)
def test_an_operation_is_asked_before_the_scenario(of_all, of_left, halts):
    rig = after_the_left_arm_was_dropped(of_all, of_left)
    assert bool(rig.now.halted) == halts
    assert rig.executing == ["work_right"]


def test_after_a_halt_somebody_says_when_to_go_on():
    rig = after_the_left_arm_was_dropped("halt", "")
    rig.order(Proceed())
    assert not rig.now.halted
