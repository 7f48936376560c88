"""`smv-plan --second-opinion`: through real processes, with NuSMV, and with stand-ins that lie or never answer."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from smv_planner.engines import ENGINES

ROOT = Path(__file__).parents[2]
PLAN = [sys.executable, "-c", "import sys; from smv_planner.cli.plan import main; sys.exit(main())"]
QUESTION = ["scenarios/door", "--goal", "door.pos == opened"]

LENIENT = f"""#!{sys.executable}
import re, subprocess, sys
from pathlib import Path

model = Path("problem.smv")
model.write_text(re.sub(r"^TRANS x_step = t_(.*) -> .*;$", r"TRANS TRUE;", model.read_text(), flags=re.M))
subprocess.run([{str(Path(sys.executable).with_name("NuSMV"))!r}, *sys.argv[1:]], check=True)
"""
"""Runs the real NuSMV, but on a model without guards: it finds plans where there are none, and shorter ones than there are."""

BLIND = '#!/bin/sh\nsed -n "s/.*-k \\\\([0-9]*\\\\).*/-- no counterexample found with bound \\\\1/p" problem.cmd\n'
"""Says that there is no plan, whatever the question."""


def run(*arguments: str, folder: Path | None = None, nuxmv: str | None = None) -> subprocess.CompletedProcess[str]:
    """With a folder for temporary files, in which a script may stand in for nuXmv."""
    environment = dict(os.environ)
    if folder is not None:
        (folder / "temporary").mkdir()
        environment["TMPDIR"] = str(folder / "temporary")
    if folder is not None and nuxmv is not None:
        stand_in = folder / "nuXmv"
        stand_in.write_text(nuxmv)
        stand_in.chmod(0o755)
        environment["SMV_PLANNER_NUXMV"] = str(stand_in)
    return subprocess.run([*PLAN, *arguments], cwd=ROOT, env=environment, capture_output=True, text=True, timeout=120)


@pytest.fixture
def _nusmv() -> None:
    if reason := ENGINES["nusmv"].available():
        pytest.skip(reason)


@pytest.mark.usefixtures("_nusmv")
@pytest.mark.parametrize(
    ("arguments", "code"),
    [(QUESTION, 0), ([*QUESTION, "--bound", "3"], 4), (["scenarios/door", "--goal", "door.pos == jammed", "--bound", "9"], 1)],
)
def test_nusmv_is_asked_when_no_other_is_named(arguments: list[str], code: int, tmp_path: Path) -> None:
    done = run(*arguments, "--json", "--second-opinion", folder=tmp_path)
    assert done.returncode == code, done.stdout
    answer = json.loads(done.stdout)
    assert answer["engine"] == "auto"
    assert answer["second_opinion"]["engine"] == "nusmv"
    assert answer["second_opinion"]["agreed"] == answer["second_opinion"]["asked"] >= 1
    assert not list((tmp_path / "temporary").iterdir())


def test_every_question_of_both_levels_is_put_to_both() -> None:
    done = run("scenarios/door", "--json", "--second-opinion", "explicit")
    answer = json.loads(done.stdout)
    assert answer["second_opinion"] == {
        "engine": "explicit",
        "asked": len(answer["stages"]) + 1,
        "agreed": len(answer["stages"]) + 1,
    }


@pytest.mark.usefixtures("_nusmv")
@pytest.mark.parametrize(
    ("lie", "says"), [(LENIENT, "the shortest plan has"), (BLIND, "no plan of at most 100 steps")], ids=["lenient", "blind"]
)
def test_a_difference_is_an_error_with_a_folder_that_reproduces_it(lie: str, says: str, tmp_path: Path) -> None:
    arguments = [*QUESTION, "--json", "--second-opinion", "nuxmv"]
    done = run(*arguments, folder=tmp_path, nuxmv=lie)
    assert done.returncode == 5, done.stdout
    (problem,) = json.loads(done.stdout)["problems"]
    (folder,) = (tmp_path / "temporary").iterdir()
    assert str(folder) in problem["message"]
    assert "auto says that the shortest plan has 5 steps" in problem["message"]
    kept = json.loads((folder / "difference.json").read_text())
    assert shlex.join(["smv-plan", *arguments]) in kept["commands"]
    assert kept["initial"]["door.pos"] == "closed"
    honest, liar = kept["answers"]
    assert (honest["engine"], liar["engine"]) == ("auto", "nuxmv")
    assert honest["checker"] == "accepts it"
    assert liar["checker"] != "accepts it"
    assert says in liar["says"]
    assert len(honest["steps"]) == 5
    again = kept["commands"][-1].replace("NuSMV", str(Path(sys.executable).with_name("NuSMV")))
    reproduced = subprocess.run(shlex.split(again), cwd=folder, capture_output=True, text=True, timeout=60)
    assert "is false" in reproduced.stdout, reproduced


def test_a_second_engine_that_comes_to_no_answer_is_a_warning(tmp_path: Path) -> None:
    done = run(*QUESTION, "--json", "--second-opinion", "nuxmv", folder=tmp_path, nuxmv="#!/bin/sh\nkill -SEGV $$\n")
    assert done.returncode == 0, done.stdout
    answer = json.loads(done.stdout)
    assert (answer["verdict"], answer["second_opinion"]["agreed"], answer["second_opinion"]["asked"]) == ("reached", 0, 1)
    (warning,) = answer["warnings"]
    assert "no second opinion on question 1: nuxmv came to no answer" in warning


def test_the_second_engine_has_to_be_another_one() -> None:
    done = run(*QUESTION, "--engine", "sat", "--second-opinion", "sat")
    assert done.returncode == 2
    assert "name another engine" in done.stderr
