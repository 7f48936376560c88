"""States that an invariant forbids, and the way out of them."""

from __future__ import annotations

from rig import Rig
from small_stations import BAD_PLACE

from smv_planner.runner.decision import Cause, Purpose
from smv_planner.runner.events import Activate, Approve, Reenable, Tick

GUARDED_ROBOT = """
smv_planner: 1
name: guarded_robot
resources:
  door:
    variables:
      open: {kind: measured, domain: bool, initial: false}
  robot:
    variables:
      to: {kind: goal,     domain: [stop, go], initial: stop}
      at: {kind: measured, domain: [still, moving], initial: still}
    transitions:
      start:  {kind: controlled, guard: to == stop and at == still, actions: {to: go}}
      halt:   {kind: automatic, guard: door.open and to == go, actions: {to: stop}}
      starts: {kind: effect, guard: to == go and at == still, actions: {at: moving}, within: 2 s}
      stops:  {kind: effect, guard: to == stop and at == moving, actions: {at: still}, within: 2 s}
decision:
  ran:    {domain: bool, initial: false}
  parked: {domain: bool, initial: false}
operations:
  run:  {guard: not ran, effects: {ran: true}, goal: robot.at == moving}
  park: {guard: ran and not parked, effects: {parked: true}, goal: robot.at == still}
invariants:
  safe: not (door.open and robot.at == moving)
intentions:
  one: {start: not parked, goal: ran}
"""


def test_a_safety_reaction_is_sent_though_the_state_is_forbidden() -> None:
    rig = Rig(GUARDED_ROBOT).begin()
    rig.measure("robot.at", "moving")
    rig.answer_all()
    assert rig.sent("robot")[-1].values == {"robot.to": "go"}
    rig.measure("door.open", True)
    assert rig.notes("alarm")
    assert rig.sent("robot")[-1].values == {"robot.to": "stop"}


WAY_OUT = """
smv_planner: 1
name: way_out
resources:
  device:
    variables:
      to:    {kind: goal,     domain: [here, there], initial: here}
      at:    {kind: measured, domain: [here, there, bad], initial: here}
      raise: {kind: goal,     domain: bool, initial: false}
      high:  {kind: measured, domain: bool, initial: false}
    transitions:
      go:     {kind: controlled, guard: to == here, actions: {to: there}}
      rises:  {kind: effect, guard: to == there and at == bad and not high, actions: {high: true}}
      lift:   {kind: controlled, guard: high and not raise, actions: {raise: true}}
      leaves: {kind: effect, guard: raise and at == bad, actions: {at: there}}
decision:
  risen: {domain: bool, from: device.high}
operations:
  work: {guard: not risen, effects: {risen: true}, goal: device.high}
invariants:
  never: device.at != bad
intentions:
  one: {start: not risen, goal: risen}
"""


def test_the_way_out_goes_on_when_the_intention_is_reached_on_it() -> None:
    rig = Rig(WAY_OUT).begin()
    rig.measure("device.at", "bad")
    rig.answer_all()
    rig.order(Approve(rig.consents[-1].request))
    assert rig.value("device.to") == "there"
    rig.measure("device.high", True)
    rig.answer_all().wait(10.0)
    rig.answer_all()
    assert "'one' is finished" in rig.notes("intention")
    assert rig.now.following is not None
    assert rig.now.following.purpose is Purpose.EXIT
    rig.order(Approve(rig.consents[-1].request))
    assert rig.value("device.raise") is True
    rig.measure("device.at", "there")
    assert not rig.now.broken


def test_a_way_out_is_looked_for_again_when_an_effect_counts_again() -> None:
    rig = Rig(BAD_PLACE, device_to="there")
    rig.wait(3.0)
    assert "device.arrives" in rig.now.disabled
    rig.measure("device.at", "bad")
    rig.answer_all()
    assert rig.now.stuck
    rig.order(Reenable("device.arrives"))
    assert rig.question.request.cause is Cause.FORBIDDEN
    rig.answer_all()
    assert rig.now.stuck is None
    assert rig.now.following is not None
    assert rig.now.following.plan.trace.path == ("device.arrives",)


def test_a_way_out_is_looked_for_again_when_a_resource_is_back() -> None:
    rig = Rig(BAD_PLACE).begin()
    rig.measure("device.at", "bad")
    rig.answer_all().wait(2.0, silent=("device",))
    rig.answer_all()
    assert "device" in rig.now.lost
    assert rig.now.stuck
    rig.wait(2.0)
    assert "device" not in rig.now.lost
    assert rig.question.request.cause is Cause.FORBIDDEN
    rig.answer_all()
    assert rig.now.stuck is None
    assert rig.consents


def test_a_hub_that_begins_anew_in_a_forbidden_state_is_held_to_what_it_mirrors() -> None:
    rig = Rig(BAD_PLACE).begin()
    rig.order(Activate("one"))
    rig.answer_all()
    assert rig.sent("device")[-1].values == {"device.to": "there"}
    rig.reboot("device", "device-2", to="here")
    rig.measured["device"] = {"device.at": "bad"}
    rig.deaf.add("device")
    rig.speak("device")
    rig.deaf.clear()
    rig.at += 0.2
    rig.do(Tick(rig.at))
    assert rig.hubs["device"].goal == {"device.to": "here"}
