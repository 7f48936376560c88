"""E1 to E9 with real processes on loopback come out as in simulation, and an observer from outside sees nothing wrong."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from daemon import played
from daemon.played import playing
from daemon.stations import ASSEMBLY, load, observed, routed

from smv_planner.simulate.script import cases

CASES = {name: case for name, (_, case) in cases(ASSEMBLY, load).items() if name in {f"e{n}" for n in range(1, 10)}}
QUICK = ("e2", "e4", "e9")
"""A forbidden state and the way out; an effect that never comes, with the operator's help; one that fails and is tried again."""

PACE = 8.0
DYING = 3.0
"""How many times as fast as in simulation. Silence takes its two seconds at any pace, in which robots must not get too far."""

ENOUGH = 100
"""So many goal messages are the least that an observer has to see before its word counts."""


@pytest.fixture(scope="module")
def endpoint() -> Iterator[str]:
    with routed() as where:
        yield where


def differences(name: str, endpoint: str, folder: Path) -> list[str]:
    """What came otherwise than declared, and what the observer saw."""
    folder.mkdir()
    pace = DYING if any(each.dead for each in CASES[name].when) else PACE
    with playing(endpoint, folder, CASES[name], pace) as (here, staged), observed(here) as findings:
        different = played.differences(here, staged)
        found = findings()
    if found["seen"].get("goal", 0) < ENOUGH:
        different.append(f"the observer saw only {found['seen']}")
    return different + found["wrong"]


def test_some_cases_at_once_come_out_as_in_simulation(endpoint: str, tmp_path: Path) -> None:
    with ThreadPoolExecutor() as several:
        found = {name: several.submit(differences, name, endpoint, tmp_path / name) for name in QUICK}
    assert {name: one.result() for name, one in found.items()} == {name: [] for name in QUICK}


@pytest.mark.long
@pytest.mark.parametrize("name", [name for name in sorted(CASES) if name not in QUICK])
def test_a_case_comes_out_as_in_simulation(name: str, endpoint: str, tmp_path: Path) -> None:
    assert differences(name, endpoint, tmp_path / name) == []
