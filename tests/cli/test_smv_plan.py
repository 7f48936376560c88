"""`smv-plan` and `smv-planner` through real processes: outputs, exit codes, errors that help."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PLAN = [sys.executable, "-c", "import sys; from smv_planner.cli.plan import main; sys.exit(main())"]
PLANNER = [sys.executable, "-c", "import sys; from smv_planner.cli.main import main; sys.exit(main())"]
PATIENCE = 60.0
"""Seconds for what takes one or two on a machine that has nothing else to do."""


def run(*arguments: str, command: list[str] = PLAN) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*command, *arguments], capture_output=True, text=True, cwd=ROOT, timeout=120)


def answered(*arguments: str) -> dict:
    done = run(*arguments, "--json")
    return json.loads(done.stdout)


EXPLICIT = ("--engine", "explicit")


def test_a_plan_is_a_table_that_says_it_was_checked():
    done = run("scenarios/door", "--goal", "door.pos == opened", *EXPLICIT)
    assert done.returncode == 0, done.stderr
    assert "reached in 5 steps" in done.stdout
    assert "checked" in done.stdout
    assert "door.unlock " in done.stdout
    assert done.stderr == ""


def test_json_has_the_fixed_members_and_steps_replay_to_the_final_state():
    answer = answered("scenarios/door", "--goal", "door.pos == opened", "--set", "door.wear=1", *EXPLICIT)
    members = "format model question verdict length bound engine checked reason proof initial final steps stages"
    members += " operations culprits violations warnings seconds argument second_opinion"
    assert set(members.split()) <= answer.keys()
    assert (answer["format"], answer["verdict"], answer["length"], answer["checked"]) == (1, "reached", 5, True)
    state = dict(answer["initial"])
    assert state["door.wear"] == 1
    for index, step in enumerate(answer["steps"]):
        assert step["index"] == index
        assert all(other < index for other in step["after"])
        state |= step["changes"]
    assert state == answer["final"]
    assert answer["stages"] == [{"index": 0, "operations": [], "length": 5, "steps": [0, 5]}]


@pytest.mark.parametrize(
    ("arguments", "code", "verdict"),
    [
        (("--goal", "door.shut"), 0, "reached"),
        (("--goal", "door.wear == 3 and door.wear == 2"), 1, "unreachable"),
        (("--goal", "free", "--set", "door.ref=opened"), 1, "invariant_violated"),
        (("--goal", "free", "--bound", "3"), 4, "not_within"),
    ],
)
def test_exit_codes_follow_the_verdict(arguments, code, verdict):
    done = run("scenarios/door", *arguments, *EXPLICIT, "--json")
    assert done.returncode == code
    assert json.loads(done.stdout)["verdict"] == verdict


def test_a_program_that_asks_waits_for_no_import_that_it_does_not_need():
    """Start-up is part of the answer's time: tables for people, SMV text and what only tests use are not loaded."""
    asked = ["scenarios/assembly_station", "--goal", "r1_connector.attached", "--json"]
    code = f"import sys; from smv_planner.cli.plan import command; command({asked!r}); print(*sys.modules, file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert json.loads(done.stdout)["argument"] == "breadth-first search looked at every shorter plan"
    loaded = {module.partition(".")[0] for module in done.stderr.split()}
    assert "yaml" in loaded
    assert not loaded & {"rich", "typer", "pydantic", "jinja2", "lark", "pynusmv", "smv_templates"}


def test_an_answer_says_which_engine_found_it_by_which_argument():
    asked = ("scenarios/door", "--goal", "door.pos == jammed")
    assert "relaxed reachability" in answered(*asked)["argument"]
    assert "property-directed" in answered(*asked, "--engine", "sat")["argument"]
    assert "every state that can follow" in answered(*asked, *EXPLICIT)["argument"]
    assert "auto: relaxed reachability" in run(*asked).stdout
    assert answered("scenarios/door", "--goal", "free", "--set", "door.ref=opened")["argument"] is None  # nobody was asked


def test_a_proof_is_named_and_checked():
    answer = answered("scenarios/door", "--goal", "door.wear == 3 and door.wear == 2", *EXPLICIT)
    assert answer["proof"] == {"kind": "exhausted", "checked": True}
    assert answer["length"] is None


def test_a_violated_start_names_the_invariant_and_the_slide():
    answer = answered("scenarios/door", "--goal", "free", "--set", "door.locked=false", "--set", "door.ref=opened", *EXPLICIT)
    assert answer["violations"] == [{"invariant": "never_move_locked", "now": False, "slide": ["door.relocked"]}]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("scenarios/door", "--goal", "door.poss == opened"), "did you mean 'door.pos'?"),
        (("scenarios/door", "--goal", "door.pos == open"), "door.pos"),
        (("scenarios/door", "--goal", "door.pos =="), "expected"),
        (("scenarios/door", "--goal", "free", "--set", "door.wear=9"), "door.wear"),
        (("scenarios/door", "--goal", "free", "--set", "fresh=true"), "measured copy"),
        (("scenarios/door", "--goal", "free", "--set", "door.wear=1", "--set", "door.wear=1"), "'door.wear' is set twice"),
        (("scenarios/door", "--goal", "free", "--engine", "nusvm"), "did you mean 'nusmv'?"),
        (("scenarios/door", "--goal", "free", "--lift", "never_move"), "never_move_locked"),
        (("scenarios/door", "--goal", "free", "--formula", "door.shut U free R free"), "parentheses"),
        (("scenarios/door", "--goal", "free", "--bound", "-1"), "0 is the least"),
        (("scenarios/door", "--goal", "free", "--bound", "many"), "--bound"),
        (("scenarios/door", "--goal", "free", "--deadline", "0"), "greater than 0"),
        (("scenarios/door", "--goal", "free", "--intention", "inspect_all"), "do not go together"),
        (("scenarios/door", "--intention", "inspect"), "did you mean 'inspect_all'?"),
        ((), "SCENARIO"),
    ],
)
def test_a_wrong_question_is_exit_2_and_says_what_to_do(arguments, message):
    done = run(*arguments)
    assert done.returncode == 2
    assert message in done.stderr
    assert done.stdout == ""
    assert "Traceback" not in done.stderr
    with_json = run(*arguments, "--json")
    assert with_json.returncode == 2
    (*_, problem) = json.loads(with_json.stdout)["problems"]
    assert problem.keys() == {"file", "line", "column", "message", "hint"}


def test_an_invalid_scenario_is_exit_3_with_every_mistake_and_its_place(tmp_path):
    text = (ROOT / "scenarios/door/model.yaml").read_text()
    text = text.replace("lock and not moving", "lokc and not moving").replace("domain: bool, from", "domain: boole, from")
    (tmp_path / "model.yaml").write_text(text)
    done = run(str(tmp_path), "--goal", "free")
    assert done.returncode == 3
    assert "2 problems" in done.stderr
    assert "did you mean 'lock'?" in done.stderr
    assert "^^^^" in done.stderr
    problems = json.loads(run(str(tmp_path), "--goal", "free", "--json").stdout)["problems"]
    assert [problem["line"] for problem in problems] == sorted(problem["line"] for problem in problems)
    assert len(problems) == 2


def test_a_missing_scenario_is_told(tmp_path):
    done = run(str(tmp_path / "nothing"), "--goal", "free")
    assert done.returncode in (2, 3)
    assert "nothing" in done.stderr
    assert "Traceback" not in done.stderr
    (problem,) = json.loads(run(str(tmp_path / "nothing"), "--goal", "free", "--json").stdout)["problems"]
    assert (problem["file"], problem["line"]) == (str(tmp_path / "nothing"), None)


def test_a_deadline_that_passes_is_exit_4():
    done = run(
        "scenarios/dummy_robots", "--goal", "r1.act_pos == at and r2.act_pos == buffer", *EXPLICIT, "--deadline", "0.000001"
    )
    assert done.returncode == 4, done.stdout


def test_the_smv_text_that_was_asked_can_be_kept(tmp_path):
    path = tmp_path / "asked.smv"
    assert run("scenarios/door", "--goal", "free", *EXPLICIT, "--smv", str(path)).returncode == 0
    text = path.read_text(encoding="ascii")
    assert text == run("export", "scenarios/door", "--goal", "free", command=PLANNER).stdout
    assert "LTLSPEC" in text


def test_export_writes_text_and_script(tmp_path):
    done = run("export", "scenarios/door", "--goal", "free", "--output", str(tmp_path / "out"), command=PLANNER)
    assert done.returncode == 0, done.stderr
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"problem.smv", "problem.cmd"}


def test_export_without_a_goal_says_so():
    done = run("export", "scenarios/door", command=PLANNER)
    assert done.returncode == 2
    assert "there is no goal" in done.stderr


def test_help_teaches_and_version_is_short():
    text = run("--help").stdout
    assert all(word in text for word in ("examples:", "exit codes:", "--goal", "--formula", "--set", "--deadline"))
    assert run("--version").stdout.startswith("smv-plan ")


@pytest.mark.usefixtures("interruptible")
def test_an_interrupt_ends_the_search_and_leaves_nothing_behind():
    hard = ["scenarios/dummy_robots", "--goal", "r1.act_pos == away and r1.act_pos == at", "--engine", "nusmv", "--bound", "4000"]
    process = subprocess.Popen(
        [*PLAN, *hard], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    ends = time.monotonic() + PATIENCE
    while not (children := children_of(process.pid)) and process.poll() is None and time.monotonic() < ends:
        time.sleep(0.05)
    time.sleep(1)  # it is at work
    if process.poll() is not None:
        pytest.skip(f"the search ended before it could be interrupted: {process.communicate()}")
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130
    assert "interrupted" in errors
    assert "Traceback" not in errors
    assert children, "the engine was not a child process"
    assert not [child for child in children if alive(child)]


def children_of(parent: int) -> list[int]:
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue
            if int(fields[1]) == parent:
                found.append(int(entry.name))
    return found


def alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return (Path("/proc") / str(process) / "stat").read_text().rpartition(")")[2].split()[0] != "Z"
