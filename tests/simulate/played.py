"""The execution cases of the scenarios, and how they are played in tests."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import smv_planner as sp
from smv_planner.model.model import Model
from smv_planner.simulate.planning import planners, station
from smv_planner.simulate.play import Play
from smv_planner.simulate.script import Case, cases

ROOT = Path(__file__).parents[2]
LOAD = cache(sp.load)

CASES: dict[str, tuple[Model, Case]] = {
    f"{folder.name}/{name}": found
    for folder in sorted(path for path in (ROOT / "scenarios").iterdir() if path.is_dir())
    for name, found in cases(folder, LOAD).items()
}
"""Every execution case, by scenario and name."""


def play(name: str, seed: int = 0) -> Play:
    model, case = CASES[name]
    return Play(station(model), case, planners(), seed)
