"""What README.md shows is true: its Python runs, its commands answer, its scenario loads."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

import smv_planner as sp
from smv_planner.engines import ENGINES

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", README, flags=re.M | re.S)


def commands() -> list[str]:
    lines = "\n".join(blocks("sh")).splitlines()
    return [line.partition("#")[0].strip() for line in lines if line.startswith("smv-plan ")]


def test_the_python_runs(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(ROOT)
    names: dict[str, object] = {}
    for block in blocks("python"):
        exec(compile(block, "README.md", "exec"), names)
    assert capsys.readouterr().out.rstrip().endswith("\n2")


def test_the_scenario_loads() -> None:
    (scenario,) = (block for block in blocks("yaml") if "smv_planner: 1" in block)
    answer = sp.plan(sp.loads(scenario), goal="lamp.lit")
    assert answer.length == 2


@pytest.mark.parametrize("command", commands())
def test_the_commands_answer(command: str) -> None:
    program, *arguments = shlex.split(command)
    run = [sys.executable, "-c", "import sys; from smv_planner.cli.plan import main; sys.exit(main())", *arguments]
    assert program == "smv-plan"
    done = subprocess.run(run, cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert done.returncode in (0, 1, 4), done.stderr
    assert done.stdout


def test_the_table_of_engines_is_complete() -> None:
    assert all(f"`{name}`" in README for name in ENGINES)
