"""What an answer about intentions promises holds on the steps that carry it out, not only for the operations."""

from __future__ import annotations

import smv_planner as sp

DOOR = """
smv_planner: 1
name: door
resources:
  door:
    variables:
      ref: {kind: goal,     domain: [closed, opened], initial: closed}
      pos: {kind: measured, domain: [closed, opened], initial: closed}
    transitions:
      open:   {kind: controlled, guard: ref == closed, actions: {ref: opened}}
      close:  {kind: controlled, guard: ref == opened, actions: {ref: closed}}
      opens:  {kind: effect, guard: ref == opened and pos != opened, actions: {pos: opened}}
      closes: {kind: effect, guard: ref == closed and pos != closed, actions: {pos: closed}}
decision:
  door_open: {domain: bool, from: door.pos == opened}
  machine: {domain: [idle, busy], initial: idle}
  part: {domain: [raw, milled, done], initial: raw}
  packed: {domain: bool, initial: false}
"""

MILL = "{guard: part == raw, effects: {part: milled}, goal: door.pos == closed}"


def plan(rest: str, **question: object) -> sp.Answer:
    return sp.plan(sp.loads(DOOR + rest), engine="explicit", **question)  # type: ignore[arg-type]


def operations(answer: sp.Answer) -> list[str]:
    assert answer.verdict == "reached", answer.reason
    return [operation.operation for operation in answer.operations]


def test_a_measured_goal_that_a_later_operation_undoes_is_planned_again():
    answer = plan(
        """
operations:
  open: {guard: not door_open, effects: {door_open: true}}
  mill: {guard: door_open and part == raw, effects: {part: milled}, goal: door.pos == closed}
intentions:
  both: {start: part == raw, goal: part == milled and door_open}
"""
    )
    assert operations(answer) == ["open", "mill", "open"]
    assert answer.final["door.pos"] == "opened"


def test_a_formula_that_only_the_steps_break_is_not_called_reached():
    answer = plan(
        """
operations:
  mill: {guard: part == raw, effects: {part: milled}, goal: door.pos == opened}
intentions:
  quietly: {start: part == raw, goal: part == milled, formula: not door_open}
"""
    )
    assert answer.verdict == "not_within"
    assert answer.culprits == (("quietly",),)


def test_effects_that_take_back_on_start_are_part_of_the_post_condition():
    answer = plan(
        """
operations:
  mill:
    guard: part == raw and machine == idle
    on_start: {machine: busy}
    effects: {machine: idle, part: milled}
    goal: door.pos == opened
  finish:
    guard: part == milled and machine == idle
    on_start: {machine: busy}
    effects: {machine: idle, part: done}
    goal: door.pos == closed
intentions:
  all: {start: part == raw, goal: part == done}
"""
    )
    assert operations(answer) == ["mill", "finish"]
    assert answer.final["machine"] == "idle"
    assert [dict(operation.changes) for operation in answer.operations] == [{"machine": "busy"}] * 2


def test_an_operation_that_changes_nothing_still_has_to_reach_its_goal():
    answer = plan(
        """
operations:
  look: {effects: {}, goal: door.pos == opened}
intentions:
  by_hand: {start: part == raw, goal: part == raw, sequence: [look], manual: true}
"""
    )
    assert operations(answer) == ["look"]
    assert answer.length == 2


def test_a_goal_reached_on_the_way_is_not_asked_for_again():
    """`note` fires behind the operation planner's back, so it plans again when `part` is past `milled`."""
    answer = plan(
        """
transitions:
  note: {kind: automatic, guard: part == done and machine == idle, actions: {machine: busy}}
operations:
  mill:      {guard: part == raw,    effects: {part: milled}, goal: door.pos == opened}
  finish:    {guard: part == milled, effects: {part: done},   goal: door.pos == closed}
  pack:      {guard: part == done and machine == idle, effects: {packed: true}, goal: door.pos == opened}
  pack_late: {guard: part == done and machine == busy, effects: {packed: true}, goal: door.pos == opened}
intentions:
  milled: {start: part == raw, goal: part == milled}
  packed: {start: part == raw, goal: packed}
"""
    )
    assert operations(answer) == ["mill", "finish", "pack_late"]


def test_the_synchronised_transition_may_change_what_it_assigns():
    answer = plan(
        """
transitions:
  tick: {kind: controlled, guard: door.pos == opened, actions: {machine: busy}}
operations:
  mill:  {guard: part == raw, effects: {part: milled}, goal: door.pos == opened, with: tick}
  clear: {guard: machine == busy, effects: {machine: idle}}
intentions:
  all: {start: part == raw, goal: part == milled}
"""
    )
    assert operations(answer) == ["mill"]
    assert answer.final["machine"] == "busy"


def test_without_an_operation_nothing_is_proved_impossible():
    answer = plan(
        f"""
operations:
  mill: {MILL}
intentions:
  all: {{start: part == raw, goal: part == milled}}
""",
        set={"door.ref": "opened", "door.pos": "opened"},
        disable=["door.closes"],
    )
    assert (answer.verdict, answer.disabled) == ("not_within", ("mill",))


def test_an_intention_starts_when_a_due_automatic_step_lets_it():
    answer = plan(
        f"""
transitions:
  arrives: {{kind: automatic, guard: machine == busy, actions: {{machine: idle}}}}
operations:
  mill: {MILL}
intentions:
  when_idle: {{start: machine == idle, goal: part == milled}}
  when_busy: {{start: machine == busy, goal: packed}}
""",
        set={"machine": "busy"},
    )
    assert answer.question.intentions == ("when_idle",)
    assert operations(answer) == ["mill"]
    assert answer.steps[0].transition == "arrives"


def test_an_automatic_transition_cannot_be_left_out():
    rest = """
transitions:
  note: {kind: automatic, guard: door.pos == opened and machine == idle, actions: {machine: busy}}
"""
    question = {"goal": "door.pos == opened and machine == idle", "set": {"door.ref": "opened", "door.pos": "opened"}}
    assert plan(rest, lose=["door"], **question).verdict == "unreachable"


def test_an_operation_that_changes_measured_copies_only_reaches_its_low_level_goal():
    answer = plan(
        """
operations:
  let_in: {guard: not door_open, effects: {door_open: true}, goal: door.pos == opened and door.ref == closed}
intentions:
  enter: {start: not door_open, goal: door_open}
"""
    )
    assert operations(answer) == ["let_in"]
    assert [step.transition for step in answer.steps] == ["door.open", "door.opens", "door.close"]
    assert answer.final["door.ref"] == "closed"
