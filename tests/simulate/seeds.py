"""Run seeds of a scenario and print what is wrong with them: `python seeds.py SCENARIO SEED...`; exit status 1 if anything is.

Also the way into a run for tests that change the code first, and so need a process of their own.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from functools import lru_cache
from pathlib import Path

import smv_planner as sp
from smv_planner import api
from smv_planner.engines import ENGINES, Limits
from smv_planner.problem import Problem, Verdict
from smv_planner.runner.recovery import Planners
from smv_planner.runner.situation import Station
from smv_planner.simulate.answers import Memory
from smv_planner.simulate.campaign import Campaign, Report

SCENARIOS = Path(__file__).parents[2] / "scenarios"
STEPS = {"assembly_station": 10, "nutrunner": 10, "door": 4}

LIMITS = Limits(deadline=3600, memory=2 << 30, progress=lambda text: None)
"""The deadline is for what hangs: a question takes a second at most, and a busy machine must not decide how a seed goes on."""


def solve(problem: Problem) -> Verdict:
    return ENGINES["auto"].ask(problem, LIMITS)


@lru_cache
def memory(scenario: str) -> Memory:
    model = sp.load(SCENARIOS / scenario / "model.yaml")
    return Memory(model, Planners(solve, api.widened_system))


@lru_cache
def station(scenario: str) -> Station:
    model = memory(scenario).model
    return Station(model, api.widened(model))


def campaign(scenario: str, seed: int) -> Campaign:
    return Campaign(station(scenario), memory(scenario), seed, steps=STEPS[scenario])


def reports(scenario: str, seeds: Iterable[int]) -> Iterator[Report]:
    for seed in seeds:
        yield campaign(scenario, seed).run()


def main(scenario: str, *seeds: str) -> int:
    """Up to the first seed that shows something forbidden."""
    found = False
    for report in reports(scenario, map(int, seeds)):
        print(report.seed, report.fingerprint, *report.failures[:5], sep="\n  ", flush=True)
        found = found or bool(report.failures)
        if report.violations:
            break
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
