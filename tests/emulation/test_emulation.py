"""Emulated devices do what the effects of real scenarios say, and what goes wrong with them goes wrong as told."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import replace
from math import inf
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import smv_planner as sp
from smv_planner.emulation import device as devices
from smv_planner.emulation import emulator as emulators
from smv_planner.emulation.behaviour import Behaviour, Instead
from smv_planner.emulation.draw import Draw
from smv_planner.emulation.emulator import Emulator
from smv_planner.model.domains import Value
from smv_planner.model.model import Model
from smv_planner.protocol.hub import Safe
from smv_planner.protocol.interface import interfaces
from smv_planner.protocol.messages import GoalMessage, Rejected, StateMessage, decode_goal, decode_state, encode

SCENARIOS = Path(__file__).parents[2] / "scenarios"
DOOR, NUTRUNNER, STATION = (sp.load(SCENARIOS / name) for name in ("door", "nutrunner", "assembly_station"))
PERIOD = 0.1
SEEDS = range(20)


class Cell:
    """All hubs of a scenario, and somebody who tells them what to do. Messages are encoded and decoded."""

    def __init__(self, model: Model, seed: int = 1, **behaviours: Behaviour) -> None:
        self.model, self.draw, self.at, self.seq = model, Draw(seed), 0.0, 0
        self.interfaces = interfaces(model, "c")
        self.hubs: dict[str, Emulator] = {
            name: emulators.start(model.system, interface, "boot-1", 0.0, behaviours.get(name, Behaviour()))
            for name, interface in self.interfaces.items()
        }
        self.heard: dict[str, StateMessage] = {}
        self.said: list[bytes] = []

    @property
    def world(self) -> dict[str, Value]:
        return {name: value for hub in self.hubs.values() for name, value in hub.world.items()}

    @property
    def measured(self) -> dict[str, Value]:
        """What the hubs last said, which is all that a planner knows."""
        return {name: value for state in self.heard.values() for name, value in state.measured.items()}

    def tell(self, **changes: Value) -> None:
        """Changes goals; `nutrunner__run_c=True` means nutrunner.run_c."""
        self.ask({name.replace("__", "."): value for name, value in changes.items()})

    def ask(self, changes: Mapping[str, Value]) -> None:
        self.seq += 1
        for name, interface in self.interfaces.items():
            goals = {**self.hubs[name].hub.goal, **{key: changes[key] for key in interface.goals if key in changes}}
            payload = encode(GoalMessage("c", name, 1, self.seq, "p", self.model.hash, goals))
            message = decode_goal(payload, interface)
            assert isinstance(message, GoalMessage)
            after = emulators.receive(self.hubs[name], message, self.at)
            assert isinstance(after, Emulator)
            self.hubs[name] = after

    def run(self, seconds: float) -> Iterator[float]:
        """Periods go by: devices react, hubs report."""
        end = self.at + seconds
        while self.at < end - 1e-9:
            self.at = round(self.at + PERIOD, 6)
            world = self.world
            for name, hub in self.hubs.items():
                hub, state = emulators.report(emulators.advance(hub, world, self.at, self.draw), self.at)
                self.hubs[name] = hub
                if state:
                    self.said.append(encode(state))
                    decoded = decode_state(self.said[-1], self.interfaces[name])
                    assert isinstance(decoded, StateMessage)
                    self.heard[name] = decoded
            yield self.at

    def wait(self, seconds: float) -> dict[str, Value]:
        for _ in self.run(seconds):
            pass
        return self.measured

    def until(self, seconds: float, **expected: Value) -> float:
        """How long it takes until that is measured; infinite if it is not within these seconds."""
        began, wanted = self.at, {name.replace("__", "."): value for name, value in expected.items()}
        for at in self.run(seconds):
            if all(self.measured.get(name) == value for name, value in wanted.items()):
                return at - began
        return inf

    def behave(self, resource: str, **changes: object) -> None:
        hub = self.hubs[resource]
        self.hubs[resource] = emulators.behaving(hub, replace(hub.device.behaviour, **changes))


@pytest.mark.parametrize(
    ("model", "goal"),
    [
        (DOOR, "free"),
        (DOOR, "door.wear == 2 and door.locked"),
        (NUTRUNNER, "bolt_2 == tightened and nutrunner.enabled and robot.parked"),
        (STATION, "r1_camera.found and r1_connector.attached"),
        (STATION, "r2.act_pos == at_bolt_1 and nutrunner.tqr_m"),
    ],
)
def test_devices_carry_a_plan_out(model, goal):
    """Every step of the planner's is told to the hubs, every effect in the plan happens by itself and in its time."""
    answer = sp.plan(model, goal=goal, engine="auto")
    assert answer.length
    cell, effects = Cell(model), 0
    for step in answer.steps:
        transition = model.system.transition[step.transition]
        if step.kind == "effect":
            effects += 1
            spent = cell.until(transition.within, **{name.replace(".", "__"): value for name, value in step.changes.items()})
            assert spent <= transition.within, step
        else:
            cell.ask(step.changes)
    assert effects > 1
    assert {name: answer.final[name] for name in cell.measured} == cell.measured


@pytest.mark.parametrize("seed", SEEDS)
def test_an_effect_takes_its_time_and_no_longer(seed):
    cell = Cell(DOOR, seed)
    cell.tell(door__lock=False)
    assert 0.2 <= cell.until(2, door__locked=False) <= 0.4  # half of 500 ms, give or take a fifth, and a period
    cell.tell(door__ref="opened")
    assert 0.8 <= cell.until(3, door__pos="opened") <= 1.3


def test_times_vary_with_the_seed_and_not_otherwise():
    def spent(seed):
        cell = Cell(STATION, seed)
        cell.tell(r1__ref_pos="at_tool")
        return cell.until(30, r1__act_pos="at_tool")

    assert len({spent(seed) for seed in SEEDS}) > 8
    assert spent(3) == spent(3)


def test_without_a_command_nothing_happens():
    for model in (DOOR, NUTRUNNER, STATION):
        cell = Cell(model)
        before = cell.wait(PERIOD)
        assert cell.wait(60) == before


def test_a_guard_that_becomes_false_calls_the_effect_off():
    cell = Cell(DOOR)
    cell.tell(door__lock=False, door__ref="opened")
    cell.wait(0.5)
    cell.tell(door__ref="closed")
    assert cell.until(10, door__pos="opened") == inf


def test_devices_feel_each_other():
    """The nutrunner reaches its torque on a bolt, that is where the robot is, and nowhere else."""
    cell = Cell(STATION)
    cell.tell(nutrunner__run_c=True)
    assert cell.until(30, nutrunner__tqr_m=True) == inf
    cell.tell(r2__ref_pos="at_bolt_3")
    assert cell.until(30, nutrunner__tqr_m=True) < 30
    assert cell.measured["r2.act_pos"] == "at_bolt_3"


def test_what_is_not_expected_does_not_happen_by_itself():
    for seed in SEEDS:
        cell = Cell(DOOR, seed)
        cell.tell(door__lock=False, door__ref="opened")
        assert cell.until(5, door__pos="jammed") == inf


def test_a_failing_effect_does_not_happen():
    cell = Cell(DOOR, door=Behaviour(failing={"door.unlocked": None}))
    cell.tell(door__lock=False)
    assert cell.until(60, door__locked=False) == inf
    assert cell.hubs["door"].hub.goal["door.lock"] is False  # it is told, and it mirrors that


def test_an_effect_fails_as_often_as_it_is_told():
    cell = Cell(DOOR, door=Behaviour(failing={"door.unlocked": 2}))
    for _ in range(2):
        cell.tell(door__lock=False)
        assert cell.until(5, door__locked=False) == inf
        cell.tell(door__lock=True)
        cell.wait(1)
    cell.tell(door__lock=False)
    assert cell.until(5, door__locked=False) < 1
    assert cell.hubs["door"].device.behaviour.failing == {}


def test_something_else_happens_instead_as_often_as_it_is_told():
    """E9: the nutrunner does not reach its torque, and fails."""
    cell = Cell(STATION, nutrunner=Behaviour(instead={"nutrunner.torque": Instead("nutrunner.fails", times=2)}))
    cell.tell(r1__ref_pos="at_bolt_1")
    cell.until(30, r1__act_pos="at_bolt_1")
    seen = []
    for _ in range(3):
        cell.tell(nutrunner__run_c=True)
        cell.until(20, nutrunner__run_m=True)
        seen.append((cell.measured["nutrunner.tqr_m"], cell.measured["nutrunner.fail_m"]))
        cell.tell(nutrunner__run_c=False)
        assert cell.until(5, nutrunner__run_m=False) < 5
    assert seen == [(False, True), (False, True), (True, False)]


def test_what_cannot_happen_does_not_happen_instead():
    cell = Cell(DOOR, door=Behaviour(instead={"door.unlocked": Instead("door.opens")}))
    cell.tell(door__lock=False)
    assert cell.wait(10) == {"door.pos": "closed", "door.locked": True}


def test_nothing_happens_instead_of_what_was_called_off():
    """The robot leaves the bolt before the torque is due, and nobody looks at the nutrunner meanwhile."""
    told = Behaviour(instead={"nutrunner.torque": Instead("nutrunner.fails")})
    device, on_bolt = devices.emulated(STATION.system, "nutrunner", told), {"r1.ref_pos": "at_bolt_1", "r1.act_pos": "at_bolt_1"}
    device = devices.react(device, {**on_bolt, "nutrunner.run_c": True}, 0.0, Draw(1))
    assert devices.react(device, {**on_bolt, "nutrunner.run_c": True}, 20.0, Draw(1)).measured["nutrunner.fail_m"]
    assert not devices.react(device, {"nutrunner.run_c": True}, 20.0, Draw(1)).measured["nutrunner.fail_m"]


@pytest.mark.parametrize(
    ("camera", "share"),
    [
        (Behaviour(weights={"r1_camera.misses": 1.0}), 0.5),
        (Behaviour(weights={"r1_camera.misses": 0.25}), 0.2),
        (Behaviour(weights={"r1_camera.misses": 1.0, "r1_camera.finds": 0.0}), 1.0),
        (Behaviour(instead={"r1_camera.finds": Instead("r1_camera.misses", chance=0.3)}), 0.3),
    ],
)
def test_alternatives_happen_by_their_weights(camera, share):
    """E8: the camera does not find the tool."""
    cell, missed, rounds = Cell(STATION, r1_camera=camera), 0, 100
    for _ in range(rounds):
        cell.tell(r1_camera__scan=True)
        assert cell.until(10, r1_camera__done=True) < 10
        missed += not cell.measured["r1_camera.found"]
        cell.tell(r1_camera__scan=False)
        assert cell.until(5, r1_camera__done=False) < 5
    assert abs(missed / rounds - share) < 0.15


def test_a_weight_below_one_leaves_a_chance_that_nothing_happens():
    happened = 0
    for seed in range(100):
        cell = Cell(DOOR, seed, door=Behaviour(weights={"door.unlocked": 0.4}))
        cell.tell(door__lock=False)
        happened += cell.until(2, door__locked=False) < inf
    assert 25 < happened < 55


def test_a_late_effect_comes_after_its_time():
    cell = Cell(DOOR, door=Behaviour(delays={"door.unlocked": 4.0}, jitter=0.0))
    cell.tell(door__lock=False)
    assert cell.until(10, door__locked=False) == pytest.approx(2.1)
    cell.tell(door__ref="opened")
    assert cell.until(10, door__pos="opened") == pytest.approx(1.1)  # the others are in time


def test_a_stuck_hub_mirrors_the_old_goal_in_fresh_messages():
    cell = Cell(DOOR)
    cell.tell(door__lock=True)
    cell.wait(0.3)
    before = cell.heard["door"]
    cell.behave("door", stuck=True)
    for _ in range(10):
        cell.tell(door__lock=False)
        cell.wait(0.3)
    after = cell.heard["door"]
    assert (after.mirror, after.epoch, after.goal_seq, after.measured) == (before.mirror, 1, 1, before.measured)
    assert after.seq == before.seq + 30
    assert not cell.hubs["door"].hub.forsaken
    cell.behave("door", stuck=False)
    cell.tell(door__lock=False)
    assert cell.until(2, door__locked=False) < 2


def test_a_silent_hub_goes_on_and_says_nothing():
    cell = Cell(DOOR)
    cell.wait(1)
    before = cell.heard["door"]
    cell.behave("door", silent=True)
    cell.tell(door__lock=False)
    assert cell.wait(5) == before.measured
    assert cell.heard["door"] == before
    cell.behave("door", silent=False)
    assert cell.wait(PERIOD)["door.locked"] is False
    assert cell.heard["door"].seq == before.seq + 1


def test_a_lying_hub_reports_what_is_not():
    cell = Cell(DOOR, door=Behaviour(lying={"door.locked": False}))
    assert cell.wait(1) == {"door.pos": "closed", "door.locked": False}
    assert cell.world["door.locked"] is True
    cell.behave("door", lying={})
    assert cell.wait(1)["door.locked"] is True


@pytest.mark.parametrize("forgetful", [False, True])
def test_a_hub_that_restarts_has_forgotten_whom_it_obeyed(forgetful):
    cell = Cell(DOOR, door=Behaviour(forgetful=forgetful))
    cell.tell(door__lock=False, door__ref="opened")
    cell.wait(3)
    old = cell.heard["door"]
    cell.hubs["door"] = emulators.restart(cell.hubs["door"], "boot-2", cell.at)
    cell.wait(PERIOD)
    new = cell.heard["door"]
    assert (new.boot, new.seq, new.epoch, new.planner) == ("boot-2", 1, 0, "")
    if forgetful:
        assert new.measured == {"door.pos": "closed", "door.locked": True}
        assert new.mirror == {"door.ref": "closed", "door.lock": True}
    else:
        assert (new.measured, new.mirror) == (old.measured, old.mirror)


def test_a_restart_ends_what_was_under_way():
    cell = Cell(DOOR, door=Behaviour(delay=1.0, jitter=0.0))
    cell.tell(door__ref="opened")
    cell.wait(1.5)
    cell.hubs["door"] = emulators.restart(cell.hubs["door"], "boot-2", cell.at)
    assert cell.until(5, door__pos="opened") > 2.0


def test_a_forsaken_device_moves_to_its_safe_values():
    model, interface = DOOR, interfaces(DOOR, "c")["door"]
    safe = Safe({"door.ref": "closed", "door.lock": True}, after=0.5)
    cell = Cell(model)
    cell.hubs["door"] = emulators.start(model.system, interface, "boot-1", 0.0, deadman=safe)
    for _ in range(20):
        cell.tell(door__lock=False, door__ref="opened")
        cell.wait(0.3)
    assert cell.measured == {"door.pos": "opened", "door.locked": False}
    assert cell.wait(4) == {"door.pos": "closed", "door.locked": True}


def test_a_device_obeys_its_hub_whatever_the_world_believes():
    safe = Safe({"door.lock": False}, after=0.5)
    hub = emulators.start(DOOR.system, interfaces(DOOR, "c")["door"], "boot-1", 0.0, deadman=safe)
    for at in (0.6, 1.2):
        hub = emulators.advance(hub, {"door.lock": True}, at, Draw(1))
    assert hub.hub.forsaken
    assert hub.device.measured["door.locked"] is False


def test_an_old_planner_moves_no_device():
    cell = Cell(DOOR)
    cell.tell(door__lock=False)
    old = GoalMessage("c", "door", 1, 0, "p", DOOR.hash, {"door.ref": "closed", "door.lock": True})
    assert isinstance(emulators.receive(cell.hubs["door"], old, 0.0), Rejected)
    assert cell.until(2, door__locked=False) < 2


def test_a_person_pushes_the_door_shut():
    cell = Cell(DOOR, door=Behaviour(instead={"door.opens": Instead("door.jams", times=1)}))
    cell.tell(door__lock=False, door__ref="opened")
    assert cell.until(5, door__pos="jammed") < 5
    cell.tell(door__ref="closed")
    cell.hubs["door"] = emulators.perform(cell.hubs["door"], DOOR.system.transition["door.reset"], cell.world)
    assert cell.wait(PERIOD)["door.pos"] == "closed"
    cell.tell(door__ref="opened")
    assert cell.until(5, door__pos="opened") < 5


def test_a_person_moves_a_robot_while_another_device_stays_as_it_is():
    cell = Cell(STATION)
    cell.tell(r1__ref_pos="scan_tool", r1_connector__lock=True)
    cell.wait(30)
    hang, push = (STATION.system.transition[name] for name in ("r1_connector.hang_tool", "r1.push_home"))
    cell.tell(r1__ref_pos="home", r1_connector__lock=False)
    for name, hub in cell.hubs.items():
        for done in (hang, push):
            hub = emulators.perform(hub, done, cell.world)
        cell.hubs[name] = hub
    after = cell.wait(PERIOD)
    assert (after["r1.act_pos"], after["r1.moving"], after["r1_connector.attached"]) == ("home", False, False)


def test_a_person_cannot_bring_about_what_cannot_be_measured():
    model = sp.loads("""
smv_planner: 1
name: magazine
resources:
  magazine:
    variables:
      ask:   {kind: goal,     domain: bool,             initial: false}
      parts: {kind: measured, domain: {min: 0, max: 2}, initial: 1}
    transitions:
      eject: {kind: controlled, guard: not ask, actions: {ask: true}}
      falls: {kind: effect, guard: ask and parts > 0, actions: {parts: parts - 1}, within: 1 s}
      fill:  {kind: maintenance, actions: {parts: parts + 1}, instruction: "Add a part and acknowledge."}
""")
    device, fill = devices.emulated(model.system, "magazine"), model.system.transition["magazine.fill"]
    found = []
    for _ in range(3):
        found.append(device.measured["magazine.parts"])
        device = devices.perform(device, fill, {})
    assert found == [1, 2, 2]
    at = 0.0
    while device.begun or not at:  # an effect that may happen again does, part by part
        device = devices.react(device, {"magazine.ask": True}, at, Draw(1))
        at = min(device.due, at + 1)
    assert device.measured["magazine.parts"] == 0
    assert device.began == 2


@pytest.mark.parametrize(
    "wrong",
    [
        Behaviour(failing={"door.open": None}),
        Behaviour(delays={"opens": 1.0}),
        Behaviour(weights={"r1.arrives": 1.0}),
        Behaviour(instead={"door.opens": Instead("door.reset")}),
        Behaviour(lying={"door.ref": "opened"}),
        Behaviour(lying={"door.pos": "ajar"}),
        Behaviour(lying={"door.locked": 1}),
    ],
)
def test_a_fault_that_the_device_cannot_have_is_a_mistake(wrong):
    with pytest.raises(sp.UsageError):
        devices.emulated(DOOR.system, "door", wrong)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000))
def test_looking_more_often_changes_nothing(seed):
    """A device may be left alone until something is due or its world changes: the clock may jump."""
    device = devices.emulated(STATION.system, "r1", Behaviour(jitter=0.9))
    world = {"r1.ref_pos": "at_tool"}
    often = rarely = device
    at, draw, moments = 0.0, Draw(seed), [0.0]
    for moment in (tick / 100 for tick in range(3000)):
        often = devices.react(often, world, moment, draw)
    for _ in range(10):
        rarely = devices.react(rarely, world, at, draw)
        if rarely.due == inf:
            break
        assert rarely.due > at
        at = rarely.due
        moments.append(at)
    assert len(moments) == 3  # it sets out, it arrives
    assert often.measured == rarely.measured == {"r1.act_pos": "at_tool", "r1.moving": False}


def test_the_same_seed_says_the_same_bytes():
    def said(seed):
        cell = Cell(STATION, seed, r1_camera=Behaviour(weights={"r1_camera.misses": 1.0}))
        for turn in range(6):
            cell.tell(r1__ref_pos="at_tool" if turn % 2 else "home", r1_camera__scan=turn % 2 == 0)
            cell.wait(8)
        return cell.said

    assert said(1) == said(1)
    assert said(1) != said(2)


def test_draws_are_the_same_in_every_process_and_even():
    code = "from smv_planner.emulation.draw import Draw; print([Draw(7, ('a',)).unit('b', n) for n in range(5)])"
    for hashing in ("0", "1"):
        done = subprocess.run(
            [sys.executable, "-c", code], env={"PYTHONHASHSEED": hashing}, capture_output=True, text=True, check=True
        )
        assert done.stdout.strip() == str([Draw(7).of("a").unit("b", n) for n in range(5)])
    numbers = [Draw(seed).unit("x", n) for seed in range(20) for n in range(500)]
    assert all(0 <= number < 1 for number in numbers)
    for tenth in range(10):
        assert 900 < sum(tenth <= 10 * number < tenth + 1 for number in numbers) < 1100
    assert Draw(1).unit("a", "b") != Draw(1).unit("ab")
    assert Draw(1).unit(1) != Draw(1).unit("1")
