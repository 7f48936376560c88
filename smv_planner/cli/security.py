"""`smv-planner security acl`: who may say what, for a Zenoh router."""

from __future__ import annotations

import argparse
import json

from smv_planner import language
from smv_planner.cli import outcome
from smv_planner.cli.network import cell_of

NAMES = """\
common names in certificates:
  smv-planner         the planner           smv-operator        who gives orders and confirms
  hub-RESOURCE        the hub of a resource smv-watch           who only looks on"""


def add_security_commands(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("what", choices=["acl"], help="acl: Zenoh's 'access_control' as JSON, default deny")
    parser.add_argument("scenario", metavar="SCENARIO", help="a scenario file, or a folder that holds model.yaml")
    parser.add_argument("--cell", metavar="NAME", help="which installation (default: the scenario's name)")


def run_security(asked: argparse.Namespace) -> int:
    from bridge.access import access_control

    model = language.load(asked.scenario)
    cell = cell_of(asked, model)
    print(json.dumps(access_control(cell, [resource.name for resource in model.resources]), indent=1))
    return outcome.REACHED
