"""`smv-planner interface`: what the author of a driver has to know of a scenario."""

from __future__ import annotations

import argparse
import json

from smv_planner import language
from smv_planner.cli import outcome
from smv_planner.cli.network import cell_of
from smv_planner.errors import Mistake, UsageError, did_you_mean


def add_interface(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scenario", metavar="SCENARIO", help="a scenario file, or a folder that holds model.yaml")
    parser.add_argument("resource", metavar="RESOURCE", nargs="?", help="this one (default: an array of all)")
    parser.add_argument("--cell", metavar="NAME", help="which installation (default: the scenario's name)")


def run_interface(asked: argparse.Namespace) -> int:
    from bridge.descriptions import descriptions, written

    model = language.load(asked.scenario)
    found = {name: written(each) for name, each in descriptions(model, cell_of(asked, model)).items()}
    if asked.resource is not None and asked.resource not in found:
        raise UsageError([Mistake(f"there is no resource '{asked.resource}'", did_you_mean(asked.resource, found))])
    print(json.dumps(found[asked.resource] if asked.resource else list(found.values()), indent=2))
    return outcome.REACHED
