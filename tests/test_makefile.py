"""What `make` would do in a clone where nothing is made yet."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def would_do(target: str) -> str:
    if shutil.which("make") is None:
        pytest.skip("there is no make")
    done = subprocess.run(["make", "--dry-run", "--always-make", target], cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_plan_needs_wheels_alone() -> None:
    commands = would_do("run")
    assert "-m venv .venv" in commands
    assert "smv-plan scenarios/" in commands
    assert not [word for word in ("nusmv", "gcc", "[dev", "dev]") if word in commands]


@pytest.mark.parametrize("target", ["nusmv", "setup", "test", "lint", "bench"])
def test_nusmv_is_built_for_those_who_ask_it(target: str) -> None:
    assert "smv_planner/nusmv_build.py --out" in would_do(target)


def test_help_names_every_target() -> None:
    shown = subprocess.run(["make", "--no-print-directory", "help"], cwd=ROOT, capture_output=True, text=True, timeout=60).stdout
    (phony,) = (line for line in (ROOT / "Makefile").read_text().splitlines() if line.startswith(".PHONY:"))
    assert {line.split()[1] for line in shown.splitlines()} == set(phony.split()[1:])
