"""The import contracts hold, and each of them catches a planted violation."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

PLANTED = {
    "Layers: imports point down": ("smv_planner/model/domains.py", "import smv_planner.planner.reach"),
    "The runner hands an event down": ("smv_planner/runner/goals.py", "import smv_planner.runner.hearing"),
    "The kernel knows the model and the problem alone": ("smv_planner/check/plan.py", "import smv_planner.export.smv"),
    "Pure packages touch no world": ("smv_planner/planner/reach.py", "import subprocess"),
    "A hub knows the model's values and nothing of planning": ("smv_planner/protocol/hub.py", "import smv_planner.problem"),
    "Emulated devices know effects and messages, and nothing of planning": (
        "smv_planner/emulation/device.py",
        "import smv_planner.check",
    ),
    "The emulated plant knows no planning": ("smv_planner/plant/serve.py", "import smv_planner.runner.events"),
    "The journal keeps bytes, whatever they say": ("smv_planner/journal/framing.py", "import smv_planner.model.domains"),
    "The daemon plays no part, neither simulated nor emulated": (
        "smv_planner/daemon/loop.py",
        "import smv_planner.simulate.world",
    ),
    "The bridge knows no planning": ("bridge/__init__.py", "import smv_planner.engines"),
}


def broken_contracts(folder: Path) -> set[str]:
    tool = Path(sys.executable).with_name("lint-imports")
    if not tool.exists():
        pytest.skip("import-linter is not installed")
    environment = {**os.environ, "PYTHONPATH": str(folder)}
    done = subprocess.run([tool, "--no-cache"], cwd=folder, env=environment, capture_output=True, text=True, timeout=120)
    return {line.partition(" BROKEN")[0] for line in done.stdout.splitlines() if " BROKEN" in line}


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    for package in ("smv_planner", "smv_templates", "bridge"):
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    return tmp_path


def test_the_contracts_hold(copy: Path) -> None:
    assert broken_contracts(copy) == set()


@pytest.mark.parametrize("contract", PLANTED)
def test_a_planted_violation_is_caught(copy: Path, contract: str) -> None:
    place, line = PLANTED[contract]
    path = copy / place
    path.write_text(f"{path.read_text()}\n{line}\n")
    assert contract in broken_contracts(copy)


def test_the_code_knows_no_scenario() -> None:
    """Names of scenarios occur in explanations only, not in anything that runs (the help shows scenarios/door)."""
    scenarios = {folder.name for folder in (ROOT / "scenarios").iterdir() if folder.is_dir()} - {"door"}
    for package in ("smv_planner", "smv_templates", "bridge"):
        for path in (ROOT / package).rglob("*.py"):
            words = " ".join(_running_words(ast.parse(path.read_text())))
            assert not [name for name in scenarios if name in words], path


def _running_words(tree: ast.AST) -> Iterator[str]:
    explanations = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in explanations:
            yield node.value
        elif isinstance(node, ast.Name):
            yield node.id
