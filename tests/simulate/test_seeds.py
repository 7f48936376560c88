"""Stations under drawn trouble: nothing forbidden happens, and once the trouble is over they come to their end."""

from __future__ import annotations

import os
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest
from simulate import bugs, seeds

from smv_planner.simulate.answers import Memory
from smv_planner.simulate.campaign import Campaign

ENOUGH = ("TP w/ETO", "TP w/RTO", "OP w/DO", "TP w/MT", "lost", "back", "rebooted", "stale", "timeout", "instruct")
"""Recovery that many seeds together have to go through."""

FOUND = (
    ("assembly_station", 1048),
    ("assembly_station", 1288),
    ("assembly_station", 1318),
    ("assembly_station", 1496),
    ("assembly_station", 1933),
    ("nutrunner", 33),
)
"""Seeds of long campaigns that showed a mistake, of the runner, of who watches it or of the model."""


@pytest.mark.parametrize("first", [0, 20])
def test_nothing_forbidden_happens_at_the_assembly_station(first: int) -> None:
    edges: Counter[str] = Counter()
    for report in seeds.reports("assembly_station", range(first, first + 20)):
        assert report.failures == []
        assert report.seconds >= 100
        edges.update(report.edges)
    assert [edge for edge in ENOUGH if not edges[edge]] == []


@pytest.mark.parametrize("scenario", ["door", "nutrunner"])
def test_nothing_forbidden_happens_elsewhere(scenario: str) -> None:
    for report in seeds.reports(scenario, range(30)):
        assert report.failures == []


@pytest.mark.parametrize(("scenario", "seed"), FOUND)
def test_what_a_seed_once_found_it_finds_no_more(scenario: str, seed: int) -> None:
    assert seeds.campaign(scenario, seed).run().failures == []


def test_the_same_seed_gives_the_same_bytes_whatever_was_asked_before() -> None:
    fresh = Memory(seeds.memory("nutrunner").model, seeds.memory("nutrunner").planners)
    for seed in range(3):
        first = seeds.campaign("nutrunner", seed).run()
        again = Campaign(seeds.station("nutrunner"), fresh, seed).run()
        assert first.fingerprint == again.fingerprint
    assert first.fingerprint != seeds.campaign("nutrunner", 4).run().fingerprint


def test_the_same_seed_gives_the_same_bytes_in_every_process() -> None:
    said = set()
    for hash_seed in ("1", "2"):
        environment = {**os.environ, "PYTHONHASHSEED": hash_seed}
        command = [sys.executable, str(Path(seeds.__file__)), "door", "0", "1", "2"]
        said.add(subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout)
    assert len(said) == 1


def test_what_was_decided_before_is_not_thought_about_again() -> None:
    memory = Memory(seeds.memory("nutrunner").model, seeds.memory("nutrunner").planners)
    Campaign(seeds.station("nutrunner"), memory, 5).run()
    asked = len(memory.known)
    before = memory.hits
    Campaign(seeds.station("nutrunner"), memory, 5).run()
    assert len(memory.known) == asked
    assert memory.hits > before


QUICK = {
    "published before it is in the journal",
    "a hub obeys an old epoch",
    "a torn record is read as a whole one",
    "an overtaken state is believed",
}


@pytest.mark.parametrize("bug", [bug for bug in bugs.BUGS if bug.name in QUICK], ids=lambda bug: bug.name)
def test_a_planted_bug_is_found(bug: bugs.Bug, tmp_path: Path) -> None:
    assert bugs.finds(bugs.run(bugs.planted(bug, tmp_path), bug.finder), bug.finder)


@pytest.mark.long
@pytest.mark.parametrize("bug", bugs.BUGS, ids=lambda bug: bug.name)
def test_every_planted_bug_is_found_and_without_it_nothing_is(bug: bugs.Bug, tmp_path: Path) -> None:
    found = bugs.run(bugs.planted(bug, tmp_path), bug.finder)
    assert bugs.finds(found, bug.finder), found.stdout[-2000:] + found.stderr[-2000:]
    clean = bugs.run(bugs.ROOT, bug.finder)
    assert clean.returncode == 0, clean.stdout[-2000:] + clean.stderr[-2000:]


@pytest.mark.long
@pytest.mark.parametrize("first", range(1000, 2000, 100))
def test_a_thousand_seeds(first: int) -> None:
    for report in seeds.reports("assembly_station", range(first, first + 100)):
        assert report.failures == []
