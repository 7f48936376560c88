"""How many times faster than the clock a station under drawn trouble is simulated, on one core.

`python -m tests.bench.campaign [SCENARIO ...] [--seeds N]`. *Cold* begins with a model just loaded and decides everything for
the first time; what seeds have in common, the later ones find among what was decided (the hits). *Known* is the same seeds once
more, when nothing is left to decide: what the station itself takes, with all its messages, journals and the observer.
Processor time, so that others on the machine count little, and garbage is looked for as seldom as `smv-planner simulate` does.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterable

import smv_planner as sp
from smv_planner import api, garbage
from smv_planner.runner.recovery import Planners
from smv_planner.runner.situation import Station
from smv_planner.simulate.answers import Memory
from smv_planner.simulate.campaign import Campaign
from tests.simulate.seeds import SCENARIOS, STEPS, solve

SEEDS = 10

GATE = 100.0
"""How many times faster than the clock it has to be, cold."""


def speed(station: Station, memory: Memory, steps: int, seeds: Iterable[int]) -> float:
    """Virtual seconds in a second."""
    began, virtual = time.process_time(), 0.0
    for seed in seeds:
        report = Campaign(station, memory, seed, steps=steps).run()
        assert not report.failures, report.failures
        virtual += report.seconds
    return virtual / (time.process_time() - began)


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("scenarios", metavar="SCENARIO", nargs="*", default=list(STEPS))
    parser.add_argument("--seeds", metavar="N", type=int, default=SEEDS)
    asked = parser.parse_args(arguments)
    garbage.look_seldom()
    met = True
    for scenario in asked.scenarios:
        model = sp.load(SCENARIOS / scenario / "model.yaml")
        memory = Memory(model, Planners(solve, api.widened_system))
        station = Station(model, api.widened(model))
        cold = speed(station, memory, STEPS[scenario], range(asked.seeds))
        decided, hits = len(memory.known), memory.hits
        known = speed(station, memory, STEPS[scenario], range(asked.seeds))
        met = met and cold >= GATE
        print(
            f"{scenario:18} cold {cold:4.0f} times real time ({decided} decided, {hits} hits), known {known:4.0f}; "
            f"gate {GATE:g}: {'met' if cold >= GATE else 'missed'}",
            flush=True,
        )
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
