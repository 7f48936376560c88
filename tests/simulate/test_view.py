"""What people are shown of a run."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from simulate.played import CASES, play

from smv_planner.simulate.play import Play
from smv_planner.simulate.view import Timelines, abilities, plan_lines, purpose, waits


@cache
def until(name: str, seconds: float) -> tuple[Play, Timelines]:
    """A case up to some time."""
    played = play(name)
    lines = Timelines(played.station)

    def look() -> bool:
        lines.see(played.world.situation)
        return played.over()

    played.world.run(seconds, look)
    return played, lines


def test_a_resource_is_at_work_from_its_command_until_its_effect() -> None:
    """In E4, r2 goes up from bolt 5 at 0.45 s and is there at 11.43 s."""
    _, lines = until("assembly_station/e4", 11.0)
    drawn = dict(lines.drawn(10.0, 10, 1.0))
    assert drawn["resource r2"] == "━━━━━━━━━━"
    assert "resource r1" not in drawn, "it has nothing to do"


def test_a_column_shows_the_gravest_of_what_was_in_it() -> None:
    _, lines = until("assembly_station/e4", 60.0)
    drawn = dict(lines.drawn(60.0, 6, 10.0))
    assert drawn["intention tighten_bolts"] == "━━━━!!"
    assert drawn["resource r2_connector"].strip().endswith("?")


def test_lines_follow_the_time_when_there_is_no_room_for_all() -> None:
    _, lines = until("assembly_station/e4", 60.0)
    assert all(len(line) == 20 for _, line in lines.drawn(50.0, 20, 1.0))
    assert lines.axis(50.0, 20, 1.0) == "30        40"


def test_what_is_waited_for_is_told_with_its_time() -> None:
    played, _ = until("assembly_station/e4", 5.0)
    assert waits(played.station, played.world.situation) == ["r2.arrives: 3.7 s of 20 s"]


def test_the_operator_is_waited_for_by_what_he_was_asked() -> None:
    played, _ = until("assembly_station/e4", 50.0)
    now = played.world.situation
    assert purpose(now.following) == "plan with the operator's help"
    assert plan_lines(now.following)[0] == "▸ r2_connector.hang_tool (operator)"
    assert waits(played.station, now)[0].startswith("the operator (1.1, to be done): Remove the nutrunner from r2 by hand")


def test_abilities_are_the_predicates_that_hold() -> None:
    played, _ = until("assembly_station/e4", 0.3)
    held = abilities(played.station, played.world.situation)
    assert held["r1"] == ("still", "out_of_reach")
    assert held["r2"] == ("still", "at_the_bolts", "over_engine")
    assert held["nutrunner"] == ("ended",)


def test_a_planner_that_begins_says_so() -> None:
    played, _ = until("assembly_station/e4", 0.1)
    assert waits(played.station, played.world.situation) == ["the planner is listening"]
    halted = replace(played.world.situation, halted="'x' failed")
    assert "halted: 'x' failed" in waits(played.station, halted)


def test_every_scenario_that_is_executed_has_cases() -> None:
    assert {name.split("/")[0] for name in CASES} >= {"assembly_station", "door", "engine_line"}
