"""`simulate`, `replay` and `experiments`: the same seed tells the same story, and a journal tells it again."""

from __future__ import annotations

import json
import os
import pty
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOOR = str(ROOT / "scenarios" / "door")
STATION = str(ROOT / "scenarios" / "assembly_station")
PLANNER = [sys.executable, "-c", "import sys; from smv_planner.cli.main import main; sys.exit(main())"]


def planner(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*PLANNER, *arguments], capture_output=True, text=True, timeout=120, cwd=ROOT, check=False)


def test_a_case_that_comes_out_as_it_declares_exits_with_0_and_tells_its_story() -> None:
    done = planner("simulate", DOOR, "--case", "played_jam")
    assert done.returncode == 0, done.stderr
    assert "Push the door shut and acknowledge." in done.stdout
    assert "planning actions: TP, OP w/DO, TP w/MT" in done.stdout
    assert "the operator was asked for: door.reset" in done.stdout
    assert re.search(r"^resource door +│.*━.*\?", done.stdout, re.MULTILINE)
    assert "\x1b" not in done.stdout


def test_the_same_seed_gives_the_same_bytes_in_every_process() -> None:
    one, again, other = (planner("simulate", DOOR, "--seed", seed, "--json") for seed in ("5", "5", "6"))
    assert one.returncode == 0, one.stderr
    assert one.stdout == again.stdout
    assert one.stdout != other.stdout
    assert json.loads(one.stdout)["intentions"] == {"inspect_all": "finished"}


def test_trouble_is_drawn_from_the_seed_and_the_station_comes_to_its_end() -> None:
    one, again = (planner("simulate", DOOR, "--faults", "20", "--seed", "3", "--json") for _ in range(2))
    assert one.returncode == 0, one.stdout
    assert one.stdout == again.stdout
    assert json.loads(one.stdout)["differences"] == []


def test_a_station_that_is_stopped_on_its_way_exits_with_1() -> None:
    done = planner("simulate", DOOR, "--until", "1")
    assert done.returncode == 1
    assert "'inspect_all' is executing" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--case", "played_jm"], "there is no execution case 'played_jm' (did you mean 'played_jam'?)"),
        (["--case", "played_jam", "--set", "door.wear=1"], "--case and --set do not go together"),
        (["--set", "door.ware=1"], "unknown variable 'door.ware'"),
        (["--engine", "atuo"], "there is no engine 'atuo' (did you mean 'auto'?)"),
        (["--until", "-1"], "--until is -1"),
        (["--speed", "nan"], "--speed is nan"),
        (["--journal", DOOR], "is there already"),
        (["--journal", "/dev/null/journal"], "cannot be used for a journal"),
    ],
)
def test_a_wrong_question_is_refused_with_a_hint(arguments: list[str], told: str) -> None:
    done = planner("simulate", DOOR, *arguments)
    assert done.returncode == 2
    assert told in done.stderr


def test_a_journal_tells_the_story_again_and_the_decisions_come_out_the_same(tmp_path: Path) -> None:
    journal = tmp_path / "journal"
    played = planner("simulate", DOOR, "--case", "played_jam", "--journal", str(journal))
    told = planner("replay", str(journal))
    assert (played.returncode, told.returncode) == (0, 0), told.stderr

    def story(text: str) -> list[str]:
        kinds = ("fired", "measured", "operation", "intention", "decision")
        return [line for line in text.splitlines() if len(line.split()) > 2 and line.split()[2] in kinds]

    assert story(told.stdout) == story(played.stdout)
    assert len(story(told.stdout)) > 20
    assert re.search(r", [1-9]\d* decisions, all the same$", told.stdout, re.MULTILINE)


def test_a_replay_up_to_a_time_says_what_was_going_on(tmp_path: Path) -> None:
    journal = tmp_path / "journal"
    planner("simulate", DOOR, "--case", "played_jam", "--journal", str(journal))
    told = planner("replay", str(journal), "--at", "4")
    assert told.returncode == 0, told.stderr
    assert "waits for the operator (1.1, to be done): Push the door shut and acknowledge." in told.stdout
    assert "intention inspect_all: error" in told.stdout
    assert "6.60 s" not in told.stdout


def test_a_decision_that_was_another_is_told(tmp_path: Path) -> None:
    """The journal says that the planners found nothing, and they find a plan."""
    from smv_planner import api, language
    from smv_planner.journal import Folder, Journal
    from smv_planner.runner.decision import Decision
    from smv_planner.runner.events import Answered
    from smv_planner.runner.records import Known, entry, record
    from smv_planner.simulate.planning import station
    from smv_planner.simulate.replay import payloads

    journal = tmp_path / "journal"
    planner("simulate", DOOR, "--case", "played_inspection", "--journal", str(journal))
    of = station(language.load(DOOR))
    known = Known(of.model, api.widened_system)
    entries = [entry(payload, known) for payload in payloads(journal, of)]
    first = next(at for at, each in enumerate(entries) if isinstance(each, Answered))
    told = entries[first]
    assert isinstance(told, Answered)
    changed = [*entries[:first], Answered(told.at, told.revision, Decision(stuck="nothing to be done"))]
    other = Journal.open(Folder(tmp_path / "other"), of.model.hash).journal
    other.write([record(each) for each in changed])
    other.close()
    done = planner("replay", str(tmp_path / "other"), "--scenario", DOOR)
    assert done.returncode == 1
    assert "decided now: OP; TP" in done.stdout
    assert "1 decisions, 1 otherwise" in done.stdout


def test_where_there_is_no_journal_nothing_is_told(tmp_path: Path) -> None:
    for folder in (tmp_path, tmp_path / "nowhere"):
        told = planner("replay", str(folder))
        assert told.returncode == 2
        assert "there is no journal in" in told.stderr


def test_a_damaged_journal_and_one_of_another_model_are_refused(tmp_path: Path) -> None:
    journal = tmp_path / "journal"
    planner("simulate", DOOR, "--case", "played_inspection", "--journal", str(journal))
    other = planner("replay", str(journal), "--scenario", STATION)
    assert other.returncode == 2
    assert "is the journal of another model" in other.stderr
    (segment,) = journal.glob("*.journal")
    data = bytearray(segment.read_bytes())
    data[len(data) // 2] ^= 1
    segment.write_bytes(data)
    damaged = planner("replay", str(journal))
    assert damaged.returncode == 2
    assert "is damaged from byte" in damaged.stderr


def test_the_live_picture_shows_the_station_and_an_interrupt_leaves_the_terminal_as_it_was() -> None:
    """On a terminal of its own; the picture is drawn at least once before somebody interrupts it."""
    pid, terminal = pty.fork()
    if pid == 0:
        os.chdir(ROOT)
        os.environ["TERM"], os.environ["COLUMNS"] = "xterm", "120"
        os.execv(sys.executable, [*PLANNER, "simulate", STATION, "--case", "e9", "--speed", "5"])
    seen, ends = b"", time.monotonic() + 60
    while b"resource nutrunner" not in seen and time.monotonic() < ends:
        seen += os.read(terminal, 65536)
    os.kill(pid, signal.SIGINT)
    try:
        while data := os.read(terminal, 65536):
            seen += data
    except OSError:  # the other end is closed
        pass
    _, status = os.waitpid(pid, 0)
    assert os.waitstatus_to_exitcode(status) == 130
    text = seen.decode(errors="replace")
    for word in ("assembly_station, e9", "tighten_bolts", "intentions and operations", "r1: ", "resource nutrunner"):
        assert word in text
    assert text.rindex("\x1b[?25h") > text.rindex("\x1b[?25l"), "the cursor is shown again"


@pytest.mark.long
def test_the_experiments_have_the_planning_actions_and_operator_actions_of_table_1() -> None:
    done = planner("experiments", STATION, "--json")
    rows = json.loads(done.stdout)["rows"]
    assert done.returncode == 0
    assert [row["experiment"] for row in rows] == [f"E{number}" for number in range(1, 10)]
    for row in rows:
        assert [each["name"] for each in row["actions"]] == [each["name"] for each in row["paper"]["actions"]]
        assert bool(row["operator"]) == (row["experiment"] in ("E2", "E4", "E6", "E7"))
        assert row["differences"] == []
        assert row["ms"] > 0
