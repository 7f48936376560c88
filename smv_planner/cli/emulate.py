"""`smv-planner emulate`: hubs with emulated devices, and telling running ones to fail."""

from __future__ import annotations

import argparse
import json
from contextlib import suppress

from smv_planner import language
from smv_planner.cli import outcome
from smv_planner.cli.network import add_network, cell_of, linked
from smv_planner.cli.question import settings
from smv_planner.emulation.behaviour import Behaviour
from smv_planner.errors import Mistake, UsageError
from smv_planner.plant.told import WORDS

TELLING = "what a hub can be told:\n" + "\n".join(f"  {line}" for line in WORDS.values())

EXAMPLES = """
examples:
  smv-planner emulate scenarios/door
  smv-planner emulate scenarios/door --silent door
  smv-planner emulate scenarios/door --tell door fail=opens:1"""


def add_emulate(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scenario", metavar="SCENARIO", help="a scenario file, or a folder that holds model.yaml")
    parser.add_argument(
        "--hub", metavar="RESOURCE", action="append", default=[], help="emulate this one only; repeatable (default: all)"
    )
    parser.add_argument(
        "--pace",
        metavar="FACTOR",
        type=float,
        default=1.0,
        help="devices are so much faster: at 10, ten times (default: %(default)g)",
    )
    parser.add_argument("--seed", metavar="N", type=int, default=0, help="of everything that is left to chance")
    parser.add_argument(
        "--set",
        metavar="VAR=VALUE",
        action="append",
        default=[],
        help="begin with another value than the initial one; repeatable",
    )
    parser.add_argument("--fail", metavar="EFFECT[:TIMES]", action="append", default=[], help="this effect does not happen")
    for word, what in (("silent", "reports nothing"), ("stuck", "neither obeys nor mirrors new goals"), ("dead", "is gone")):
        parser.add_argument(f"--{word}", metavar="RESOURCE", action="append", default=[], help=f"this hub {what}")
    parser.add_argument(
        "--tell", metavar="WORD", nargs="+", help="tell a hub that runs elsewhere: its resource, then words as below"
    )
    add_network(parser)


def run_emulate(asked: argparse.Namespace) -> int:
    model = language.load(asked.scenario)
    cell = cell_of(asked, model)
    if asked.tell is not None:
        return _tell(asked, cell)
    if not 0.01 <= asked.pace <= 1000:
        raise UsageError([Mistake(f"the pace is {asked.pace}", "it is a factor from 0.01 to 1000")])
    from smv_planner.plant.serve import Emulation

    usual = Behaviour()
    behaviour = Behaviour(delay=usual.delay / asked.pace, leisure=usual.leisure / asked.pace)
    with linked(asked, patient=True) as link:
        plant = Emulation(model, cell, link, tuple(asked.hub), behaviour, asked.seed, settings(model, asked.set))
        for failing in asked.fail:
            plant.fail(failing)
        for word in ("silent", "stuck", "dead"):
            for name in getattr(asked, word):
                plant.tell(name, word)
        print(f"hubs of cell {cell}: {', '.join(plant.names)}", flush=True)
        with suppress(KeyboardInterrupt):  # that is how it ends
            plant.run()
    return outcome.REACHED


def _tell(asked: argparse.Namespace, cell: str) -> int:
    from smv_planner.plant.serve import tell

    name, *words = asked.tell
    if not words:
        raise UsageError([Mistake(f"'{name}' is told nothing", "say what after its name, as in --tell door silent")])
    with linked(asked) as link:
        print(json.dumps(tell(link, cell, name, words), indent=2))
    return outcome.REACHED
