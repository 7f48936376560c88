"""What a scenario says about errors: who is asked, what halts, when something may be tried again, what an outcome changes."""

from __future__ import annotations

from functools import cache

import pytest
from simulate.played import ROOT

from smv_planner import language
from smv_planner.model.model import Model
from smv_planner.simulate.planning import planners, station
from smv_planner.simulate.play import Play
from smv_planner.simulate.script import case


@cache
def changed(folder: str, old: str, new: str) -> Model:
    """A scenario that differs in one place."""
    text = (ROOT / "scenarios" / folder / "model.yaml").read_text()
    assert text.count(old) == 1
    return language.loads(text.replace(old, new))


def played(model: Model, text: str, seed: int = 0) -> Play:
    play = Play(station(model), case(text, model), planners(), seed)
    assert play.run() == []
    return play


def said(play: Play, kind: str) -> list[tuple[float, str]]:
    return [(at, note.text) for at, note in play.world.notes if note.kind == kind]


# r1 can do the job in place of r2, whose connector is broken (E3)
E3 = """
description: E3
given:
  set: {bolt_1: tightened, bolt_2: tightened, bolt_3: tightened, bolt_4: tightened, bolt_5: tightened, bolt_6: placed,
        r2_located: true, r2.ref_pos: at_tool, r2.act_pos: at_tool}
when: WHEN
then:
  operator: []
  intentions: {tighten_bolts: finished}
  failed: [attach_tool_r2]
  operations: [attach_tool_r2, locate_tool_r1, attach_tool_r1, tighten_bolt_6_r1, detach_tool_r1]
"""
BROKEN = "[{fail: r2_connector.attaches}]"


def policy(said: str) -> Model:
    return changed("assembly_station", "name: assembly_station", f"name: assembly_station\n{said}")


def test_a_substitute_waits_until_the_operator_agrees() -> None:
    play = played(policy("on_error: ask"), E3.replace("WHEN", BROKEN))
    [(asked, text), *_] = said(play, "consent")
    [(agreed, _), *_] = said(play, "approved")
    assert "attach_tool_r2" in text
    moves = [at for at, text in said(play, "fired") if text.startswith(("r1.", "r2."))]
    assert not [at for at in moves if asked <= at < agreed]


def test_nobody_moves_before_the_operator_agrees() -> None:
    never = E3.replace("finished}", "executing}").replace("[attach_tool_r2, locate", "[attach_tool_r2] #")
    text = never.replace("WHEN", "[{fail: r2_connector.attaches, operator: {agrees: false}}, {at: 60 s, set: {filter_1: empty}}]")
    play = played(policy("on_error: ask"), text)
    assert play.world.at > 59
    assert play.world.situation.halted
    assert "r1.move_scan_tool" not in [text for _, text in said(play, "fired")]


def test_after_a_halt_nothing_goes_on_until_somebody_says_so() -> None:
    play = played(policy("on_error: halt"), E3.replace("WHEN", BROKEN.replace("]", ", {at: 100 s, proceed: true}]")))
    moves = [at for at, text in said(play, "fired") if text.startswith(("r1.", "r2."))]
    assert moves
    assert min(moves) >= 100


def test_what_is_tried_again_after_a_while_does_not_keep_the_station_from_going_on() -> None:
    """The broken connector counts again every ten seconds, and fails again whenever it is used."""
    text = (
        E3.replace("WHEN", BROKEN)
        .replace("  failed: [attach_tool_r2]\n", "")
        .replace("  operations:", "  operations: [attach_tool_r2] #")
    )
    play = played(policy("reenable: after 10 s"), text)
    again = [at for at, text in said(play, "enabled")]
    assert again
    assert len(again) < 20


SORTING = """
smv_planner: 1
name: sorting
resources:
  camera:
    silent_after: 2 s
    variables:
      look: {kind: goal, domain: bool, initial: false}
      sees: {kind: measured, domain: [nothing, whole, broken], initial: nothing}
    transitions:
      turn_on:     {kind: controlled, guard: not look and sees == nothing, actions: {look: true}}
      turn_off:    {kind: controlled, guard: look and sees != nothing, actions: {look: false}}
      sees_whole:  {kind: effect, guard: look and sees == nothing, actions: {sees: whole}, within: 2 s}
      sees_broken: {kind: effect, guard: look and sees == nothing, actions: {sees: broken}, within: 2 s}
      forgets:     {kind: effect, guard: not look and sees != nothing, actions: {sees: nothing}, within: 1 s}
decision:
  part: {domain: [new, whole, broken], initial: new}
operations:
  sort:
    guard: part == new
    outcomes:
      whole:  {effects: {part: whole}, goal: camera.sees == whole}
      broken: {effects: {part: broken}, goal: camera.sees == broken}
  replace: {guard: part == broken, effects: {part: new}, goal: camera.sees == nothing and not camera.look}
intentions:
  a_whole_part: {start: part == new, goal: part == whole}
"""


@pytest.mark.parametrize("seed", range(4))
def test_an_operation_may_end_otherwise_than_planned_and_the_plan_goes_on_from_there(seed: int) -> None:
    text = """
description: the first part is broken, whatever the planner hoped
when:
  - {instead: {camera.sees_whole: camera.sees_broken}, times: 1}
  - {after: replace, instead: {camera.sees_broken: camera.sees_whole}}
then:
  operator: []
  intentions: {a_whole_part: finished}
  failed: []
  operations: [sort.whole, replace, sort.whole]
  final: {part: whole}
"""
    play = played(language.loads(SORTING), text, seed)
    assert "sort.complete.broken" in [text for _, text in said(play, "fired")]
