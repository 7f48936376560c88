"""What commands need that talk with a planner that runs: which one, and what it says."""

from __future__ import annotations

import argparse
import json
from typing import Any

from bridge import keys
from bridge.link import Link, LinkError
from smv_planner.cli.network import add_network, setting
from smv_planner.errors import Mistake, UsageError


def add_planner(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--cell", metavar="NAME", help="which installation (default: the one whose planner runs, if there is only one)"
    )
    add_network(parser, cell=False)


def cell_of(asked: argparse.Namespace, link: Link) -> str:
    """Raises UsageError if that is not clear, LinkError if there is nobody."""
    named = setting(asked, "cell")
    if named:
        return keys.checked_cell(named)
    running = sorted({key.split("/")[1] for key in link.present(keys.planner("*"))})
    if not running:
        raise LinkError("no planner runs on this network; 'smv-planner run' starts one")
    if len(running) > 1:
        raise UsageError([Mistake("several planners run: " + ", ".join(running), "name one with --cell")])
    return running[0]


def document(link: Link, key: str, payload: bytes = b"") -> Any:
    """What the planner answers. Raises LinkError."""
    return json.loads(link.ask(key, payload, timeout=10.0))
