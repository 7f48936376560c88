"""The daemon's own word on the same machine, and how long it counts."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from daemon.stations import health

from smv_planner.cli.ask import UNHEALTHY
from smv_planner.daemon.status import EVERY, FILE, Status, found

HEALTH = {
    "planner": "one",
    "epoch": 1,
    "phase": "running",
    "ticks": 5,
    "tick_age": 0.0,
    "wrong": [],
    "waiting": [],
    "healthy": True,
}
COUNTS = 1.0


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


def said(folder: Path, clock: Clock) -> dict[str, Any]:
    told = found(folder, clock)
    assert told
    return told


def test_it_is_written_each_second_and_when_something_changes(tmp_path: Path, clock: Clock) -> None:
    status, written = Status(str(tmp_path), COUNTS, clock), []
    for tick in range(30):
        clock.now += 0.1
        status.tell({**HEALTH, "ticks": tick, "epoch": 1 if tick < 15 else 2})
        written.append(said(tmp_path, clock)["ticks"])
    assert said(tmp_path, clock)["epoch"] == 2
    assert 15 in written
    assert 3 <= len(set(written)) <= 5
    assert [file.name for file in tmp_path.iterdir()] == [FILE], "nothing unfinished stays"


def test_it_counts_until_the_next_one_is_missing(tmp_path: Path, clock: Clock) -> None:
    Status(str(tmp_path), COUNTS, clock).tell({**HEALTH, "waiting": ["stuck: no way"]})
    clock.now += EVERY + 0.9 * COUNTS
    assert said(tmp_path, clock)["healthy"]
    clock.now += 0.2 * COUNTS
    late = said(tmp_path, clock)
    assert not late["healthy"]
    assert "killed" in late["wrong"][0]
    assert not late["waiting"], "nobody knows"
    assert late["tick_age"] == pytest.approx(2.1)
    clock.now = 3.0  # the machine was started anew
    assert not said(tmp_path, clock)["healthy"]


def test_what_is_wrong_with_the_planner_stays_wrong(tmp_path: Path, clock: Clock) -> None:
    Status(str(tmp_path), COUNTS, clock).tell({**HEALTH, "wrong": ["another planner has taken over"], "healthy": False})
    assert said(tmp_path, clock)["wrong"] == ["another planner has taken over"]


def test_who_begins_or_ends_takes_away_what_was_said_before(tmp_path: Path, clock: Clock) -> None:
    status = Status(str(tmp_path), COUNTS, clock)
    status.tell(HEALTH)
    Status(str(tmp_path), COUNTS, clock)
    assert found(tmp_path, clock) is None


def test_where_nothing_can_be_written_the_loop_goes_on(tmp_path: Path, clock: Clock) -> None:
    Status(str(tmp_path / "gone"), COUNTS, clock).tell(HEALTH)


@pytest.mark.parametrize("text", ["", "{}", "[]", "\xff", '{"written": 1}', '{"written": "x", "counts_for": 2}'])
def test_a_file_that_says_nothing_is_not_well(tmp_path: Path, text: str) -> None:
    (tmp_path / FILE).write_text(text, encoding="latin-1")
    assert health("--journal", str(tmp_path)) == UNHEALTHY


def test_where_the_planner_that_is_named_does_not_run_no_other_answers_for_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert health("--journal", str(tmp_path)) == UNHEALTHY
    assert "no planner runs that has its journal in" in capsys.readouterr().out


def test_the_planner_of_this_machine_is_found_without_being_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setenv("SMV_PLANNER_CONNECT", "tcp/127.0.0.1:1")  # nobody answers there
    monkeypatch.chdir(tmp_path)
    assert health() == UNHEALTHY
    for cell, wrong in (("a", []), ("b", ["another planner has taken over"])):
        (tmp_path / "smv_planner" / cell).mkdir(parents=True)
        Status(str(tmp_path / "smv_planner" / cell), COUNTS).tell({**HEALTH, "wrong": wrong, "healthy": not wrong})
        if cell == "a":
            assert health() == 0
    assert health("--cell", "a") == 0
    assert health("--cell", "b") == UNHEALTHY
    assert "station" not in capsys.readouterr().out
    Status(str(tmp_path / "smv_planner" / "a"), COUNTS).tell({**HEALTH, "waiting": ["stuck: no way"]})
    assert health("--cell", "a") == 0, "a planner that knows no way does its work"
    assert "the station waits: stuck: no way" in capsys.readouterr().out
    capsys.readouterr()
    assert health() == 2
    assert "--journal" in capsys.readouterr().err
    assert health("--cell", "a", "--json") == 0
    assert json.loads(capsys.readouterr().out)["planner"] == "one"
    killed = tmp_path / "smv_planner" / "b" / FILE
    killed.write_text(json.dumps({**json.loads(killed.read_text()), "written": 0.0}))
    assert health() == 0, "one that was killed long ago is not in the way of the one that runs"
    assert health("--cell", "a", "--connect", "tcp/127.0.0.1:1") == UNHEALTHY, "that asks the network"
