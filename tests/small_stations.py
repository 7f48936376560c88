"""Stations so small that one thing can be seen in them; the runner's tests share them."""

from __future__ import annotations


def edited(text: str, *changes: tuple[str, str]) -> str:
    """A scenario's text with pieces replaced, each of which has to be there."""
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    return text


def without_lift(text: str) -> str:
    """Nobody may lift an arm."""
    kept = [line for line in text.splitlines() if " lift:" not in line]
    assert len(kept) < len(text.splitlines())
    return "\n".join(kept) + "\n"


# Two arms; the operator may lift one that was dropped.
ARMS = """
smv_planner: 1
name: two_arms
templates:
  arm:
    silent_after: 1 s
    variables:
      to: {kind: goal,     domain: [home, out], initial: home}
      at: {kind: measured, domain: [home, out, dropped], initial: home}
    transitions:
      reach:    {kind: controlled, guard: to == home and at == home, actions: {to: out}}
      retreat:  {kind: controlled, guard: to == out and at == out, actions: {to: home}}
      arrives:  {kind: effect, guard: to == out and at == home, actions: {at: out}, within: 2 s}
      returns:  {kind: effect, guard: to == home and at == out, actions: {at: home}, within: 2 s}
      slips:    {kind: effect, guard: to == out and at == out, actions: {at: dropped}, expected: false}
      lift:     {kind: maintenance, guard: at == dropped, actions: {at: home, to: home}, instruction: "Lift the $resource arm."}
resources:
  left:  {template: arm}
  right: {template: arm}
"""

# One of them has work to do.
ONE_WORKS = (
    ARMS
    + """\
decision:
  left_done: {domain: bool, initial: false}
operations:
  work_left: {guard: not left_done, effects: {left_done: true}, goal: left.at == out}
intentions:
  one: {start: not left_done, goal: left_done}
"""
)

# A machine with a switch and a button; a part is worked on in two steps. SEQUENCE stands for what is prescribed.
TWO_STEPS = """
smv_planner: 1
name: two_steps
resources:
  machine:
    variables:
      to:     {kind: goal,     domain: bool, initial: false}
      at:     {kind: measured, domain: bool, initial: false}
      button: {kind: measured, domain: bool, initial: false}
    transitions:
      switch_on:  {kind: controlled, guard: not to, actions: {to: true}}
      switch_off: {kind: controlled, guard: to, actions: {to: false}}
      goes_on:    {kind: effect, guard: to and not at, actions: {at: true}, within: 2 s}
      goes_off:   {kind: effect, guard: not to and at, actions: {at: false}, within: 2 s}
      press:      {kind: effect, guard: not button, actions: {button: true}, expected: false}
decision:
  part:    {domain: [none, raw, half, ready], initial: raw}
  pressed: {domain: bool, from: machine.button}
  swept:   {domain: bool, initial: false}
  dusty:   {domain: bool, initial: false}
operations:
  first:  {guard: part == raw, effects: {part: half}, goal: machine.at}
  second: {guard: part == half, effects: {part: ready}, goal: not machine.at}
  sweep:  {guard: not swept, effects: {swept: true}, goal: not machine.at}
intentions:
  make:  {start: part == raw, goal: part == ready, sequence: SEQUENCE}
  clean: {start: dusty and not swept, goal: swept}
"""

# A device that must not be in `bad`, and a way out of it if its effect is counted on.
BAD_PLACE = """
smv_planner: 1
name: bad_place
resources:
  device:
    silent_after: 1 s
    variables:
      to: {kind: goal,     domain: [here, there], initial: here}
      at: {kind: measured, domain: [here, there, bad], initial: here}
    transitions:
      go:      {kind: controlled, guard: to == here, actions: {to: there}}
      arrives: {kind: effect, guard: to == there and at != there, actions: {at: there}, within: 2 s, reenable: manual}
  lamp:
    variables:
      lit: {kind: measured, domain: bool, initial: false}
decision:
  done: {domain: bool, initial: false}
operations:
  work: {guard: not done, effects: {done: true}, goal: device.at == there}
invariants:
  never: device.at != bad
intentions:
  one: {start: false, goal: done}
"""

# A device that is switched on once, and decision variables about it.
SWITCH = """
smv_planner: 1
name: switch
resources:
  device:
    variables:
      to: {kind: goal,     domain: bool, initial: false}
      at: {kind: measured, domain: bool, initial: false}
    transitions:
      go:      {kind: controlled, guard: not to, actions: {to: true}}
      arrives: {kind: effect, guard: to and not at, actions: {at: true}, within: 2 s}
decision:
  done:    {domain: bool, initial: false}
  visited: {domain: bool, initial: false}
  busy:    {domain: bool, initial: false}
  full:    {domain: {min: 0, max: 1}, initial: 1}
operations:
  work:  {guard: not done, effects: {done: true}, goal: device.at}
  visit: {guard: not visited, effects: {visited: true}, goal: device.to}
intentions:
  one: {start: not done, goal: done}
"""
