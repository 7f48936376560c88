"""A hub obeys whole goals of the newest planner only, and reacts when no planner speaks."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from math import inf

import pytest
from generated_messages import GATE, GOAL, STATE
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from smv_planner.model.domains import Range
from smv_planner.model.model import Resource
from smv_planner.protocol.hub import Hold, Hub, Safe, deadman_of, receive, report, start, tick
from smv_planner.protocol.interface import Interface
from smv_planner.protocol.messages import GoalMessage, Reason, Rejected, decode_goal, decode_state, encode

REST = {"gate.ref": "closed", "gate.lock": True, "gate.speed": 0}
HALT = {"gate.ref": "closed", "gate.lock": True, "gate.speed": 3}
FRESH = start(GATE, "boot-1", 0.0, REST)


def test_a_hub_mirrors_what_it_does_before_anybody_spoke():
    _, state = report(FRESH, STATE.measured, 0.1)
    assert (state.mirror, state.epoch, state.goal_seq, state.planner, state.seq) == (REST, 0, 0, "", 1)
    assert decode_state(encode(state), GATE) == state


def test_a_hub_mirrors_the_goal_that_it_obeys():
    hub = receive(FRESH, GOAL, 0.1)
    hub, first = report(hub, STATE.measured, 0.2)
    hub, second = report(hub, STATE.measured, 0.3)
    assert first == replace(STATE, seq=1)
    assert second == replace(STATE, seq=2)
    assert hub.goal == GOAL.values


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        (replace(GOAL, epoch=2, seq=99), Reason.OLD_EPOCH),
        (replace(GOAL, epoch=2, planner="planner-b"), Reason.OLD_EPOCH),
        (replace(GOAL, seq=99, planner="planner-b"), Reason.OTHER_PLANNER),
        (replace(GOAL, planner="planner-b"), Reason.OTHER_PLANNER),
        (replace(GOAL, seq=16), Reason.OLD),
        (replace(GOAL, values=REST), Reason.CONFLICT),
    ],
)
def test_what_is_overtaken_is_refused_and_is_no_sign_of_life(message, expected):
    hub = receive(FRESH, GOAL, 0.1)
    found = receive(hub, message, 0.2)
    assert isinstance(found, Rejected)
    assert found.reason is expected


def test_a_newer_epoch_is_obeyed_whatever_its_sequence_number():
    newer = replace(GOAL, epoch=4, seq=1, planner="planner-b", values=REST)
    hub = receive(receive(FRESH, GOAL, 0.1), newer, 0.2)
    assert hub.goal == REST
    assert report(hub, STATE.measured, 0.2)[1].planner == "planner-b"
    assert receive(hub, GOAL, 0.3).reason is Reason.OLD_EPOCH


def test_the_same_message_again_says_that_the_planner_is_there():
    hub = receive(FRESH, GOAL, 0.0)
    again = receive(hub, GOAL, 0.4)
    assert replace(again, heard_at=0.0) == hub
    assert not tick(again, 0.8).forsaken
    assert tick(hub, 0.8).forsaken


def test_a_forsaken_hub_holds_what_it_was_told():
    hub = tick(receive(replace(FRESH, deadman=Hold(2.0)), GOAL, 1.0), 3.5)
    assert hub.forsaken
    assert hub.goal == GOAL.values


def test_a_forsaken_hub_falls_back_to_its_safe_values_and_returns_with_its_planner():
    hub = receive(start(GATE, "boot-1", 0.0, REST, Safe(HALT, after=0.5)), GOAL, 1.0)
    assert tick(hub, 1.5).goal == GOAL.values
    hub = tick(hub, 1.6)
    assert hub.goal == HALT
    _, state = report(hub, STATE.measured, 1.6)
    assert (state.mirror, state.epoch, state.goal_seq) == (HALT, 3, 17)  # fenced as before
    assert receive(hub, replace(GOAL, epoch=2), 1.7).reason is Reason.OLD_EPOCH
    hub = receive(hub, GOAL, 1.7)
    assert hub.goal == GOAL.values
    assert tick(hub, 2.3).goal == HALT


def test_what_has_no_safe_value_is_held():
    hub = receive(start(GATE, "boot-1", 0.0, REST, Safe({"gate.speed": 0}, after=0.5)), GOAL, 1.0)
    assert tick(hub, 1.6).goal == {**GOAL.values, "gate.speed": 0}


def test_the_scenario_says_how_a_hub_reacts():
    door = Resource("door")
    assert deadman_of(door) == Hold(inf)
    assert deadman_of(replace(door, deadman=1.0)) == Hold(1.0)
    assert deadman_of(replace(door, deadman=1.0, safe=(("door.ref", "closed"),))) == Safe({"door.ref": "closed"}, 1.0)


def test_a_hub_that_nobody_ever_spoke_to_falls_back_too():
    assert tick(start(GATE, "boot-1", 10.0, REST, Safe(HALT, after=0.5)), 10.6).goal == HALT


def test_a_report_never_mirrors_a_goal_that_is_overdue():
    hub = receive(start(GATE, "boot-1", 0.0, REST, Safe(HALT, after=0.5)), GOAL, 1.0)
    assert report(hub, STATE.measured, 2.0)[1].mirror == HALT


def test_refused_messages_do_not_keep_the_deadman_quiet():
    hub = receive(FRESH, GOAL, 1.0)
    for at in (1.2, 1.4, 1.6):
        assert isinstance(receive(hub, replace(GOAL, epoch=1), at), Rejected)
    assert tick(hub, 1.6).forsaken


AXES = Interface("c", "r", {f"r.{axis}": Range(0, 9999) for axis in "xyz"}, {"r.at": Range(0, 9999)}, "m")
"""Every goal message of these tests has the same number in all variables, so that a mixture shows."""


class Planners(RuleBasedStateMachine):
    """Three planners, each of which believes to be the one, over a network that loses, repeats and reorders."""

    @initialize(safe=st.booleans())
    def begin(self, safe: bool) -> None:
        self.at, self.boots, self.number = 0.0, 1, 0
        self.network: list[bytes] = []
        self.mark: dict[tuple[int, int, str], int] = {}
        self.deadman = Safe(dict.fromkeys(AXES.goals, 0), 0.5) if safe else Hold(0.5)
        self.hub = start(AXES, "1", 0.0, dict.fromkeys(AXES.goals, 0), self.deadman)
        self.reigns = dict.fromkeys("abc", (0, 0))
        self.delivered: list[GoalMessage] = []
        self.obeyed: list[tuple[int, int]] = []

    @rule(name=st.sampled_from("abc"), guess=st.integers(0, 2))
    def take_over(self, name: str, guess: int) -> None:
        """With what it saw of epochs, which may be old: two may claim the same one."""
        self.reigns[name] = max(1, self.hub.epoch + guess - 1, self.reigns[name][0] + 1), 0

    @rule(name=st.sampled_from("abc"))
    def ask_for_something_new(self, name: str) -> None:
        epoch, seq = self.reigns[name]
        if epoch:
            self.number += 1
            self.reigns[name] = epoch, seq + 1
            values = dict.fromkeys(AXES.goals, self.number)
            self.mark[epoch, seq + 1, name] = self.number
            self.network.append(encode(GoalMessage("c", "r", epoch, seq + 1, name, "m", values)))

    @precondition(lambda self: self.network)
    @rule(which=st.integers(0, 30), again=st.booleans())
    def deliver(self, which: int, again: bool) -> None:
        """One of the last thirty, late or in time, and perhaps once more."""
        payload = self.network[-1 - which % len(self.network)]
        if not again:
            self.network.remove(payload)
        message = decode_goal(payload, AXES)
        assert isinstance(message, GoalMessage)
        before = self.hub
        match receive(self.hub, message, self.at):
            case Hub() as after:
                self.hub = after
                self.delivered.append(message)
            case Rejected():
                newer = before.obeyed
                assert newer is not None
                assert (newer.epoch, newer.seq) >= (message.epoch, message.seq) or newer.planner != message.planner
                assert newer.epoch >= message.epoch

    @precondition(lambda self: self.network)
    @rule(which=st.integers(0, 30))
    def lose(self, which: int) -> None:
        self.network.pop(which % len(self.network))

    @rule(seconds=st.sampled_from([0.1, 0.3, 0.7]))
    def wait(self, seconds: float) -> None:
        self.at += seconds
        self.hub = tick(self.hub, self.at)

    @rule()
    def crash(self) -> None:
        self.boots += 1
        self.hub = start(AXES, str(self.boots), self.at, dict.fromkeys(AXES.goals, 0), self.deadman)
        self.delivered, self.obeyed = [], []

    @invariant()
    def obeys_one_whole_goal_of_the_newest_planner(self) -> None:
        [number] = set(self.hub.goal.values())
        if not self.delivered:
            assert (number, self.hub.epoch) == (0, 0)
            return
        newest = max(message.epoch for message in self.delivered)
        reigning = [message for message in self.delivered if message.epoch == newest]
        assert len({message.planner for message in reigning}) == 1
        last = max(reigning, key=lambda message: message.seq)
        assert self.hub.obeyed == last
        if isinstance(self.deadman, Safe) and self.hub.forsaken:
            assert number == 0
        else:
            assert number == self.mark[last.epoch, last.seq, last.planner]

    @invariant()
    def never_goes_back(self) -> None:
        if self.hub.obeyed:
            self.obeyed.append((self.hub.obeyed.epoch, self.hub.obeyed.seq))
        assert all(earlier <= later for earlier, later in pairwise(self.obeyed))

    @invariant()
    def is_forsaken_exactly_when_no_planner_spoke(self) -> None:
        assert self.hub.forsaken == (self.at - self.hub.heard_at > 0.5)

    @invariant()
    def reports_what_it_obeys(self) -> None:
        _, state = report(self.hub, {"r.at": 0}, self.at)
        assert decode_state(encode(state), AXES) == state
        assert state.mirror == self.hub.goal
        assert state.epoch == self.hub.epoch


TestPlanners = Planners.TestCase
TestPlanners.settings = settings(max_examples=150, stateful_step_count=40, deadline=None)
