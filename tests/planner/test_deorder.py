"""Steps stay in the plan's order only where something would go wrong without it."""

from __future__ import annotations

import smv_planner as sp

LAMPS = """
smv_planner: 1
name: lamps
resources:
  $lamp:
    foreach: {lamp: [a, b, c]}
    variables:
      on: {kind: goal, domain: bool, initial: false}
    transitions:
      switch: {kind: controlled, guard: not on, actions: {on: true}}
invariants:
  never_violated: not (a.on and c.on and not c.on)
"""


def order(scenario: str) -> dict[str, set[str]]:
    """For each step of the plan that switches all lamps on the steps that it directly waits for."""
    answer = sp.plan(sp.loads(scenario), "a.on and b.on and c.on", engine="explicit")
    assert answer.verdict == "reached"
    return {step.transition: {answer.steps[at].transition for at in step.after} for step in answer.steps}


def test_an_invariant_that_no_order_violates_keeps_nothing_in_order():
    assert not any(order(LAMPS).values())


def test_only_the_invariant_that_a_looser_order_violates_keeps_its_steps_in_order():
    assert order(LAMPS + "  a_first: b.on -> a.on\n") == {"a.switch": set(), "b.switch": {"a.switch"}, "c.switch": set()}
