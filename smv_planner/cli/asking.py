"""What commands need that talk with a planner that runs: which one, and what it says."""

from __future__ import annotations

import argparse
import json
import time
from contextlib import suppress
from typing import Any

from bridge import keys
from bridge.errors import LinkError
from bridge.link import Link
from bridge.printable import printable
from smv_planner.cli import heard
from smv_planner.cli.network import add_network, named_cell
from smv_planner.errors import Mistake, UsageError

DEPTH = 1024
PATIENCE = 10.0
AGAIN = 1.0
"""Seconds between two questions for events that have not come."""


def add_planner(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--cell", metavar="NAME", help="which installation (default: the one whose planner runs, if there is only one)"
    )
    add_network(parser, cell=False)


def running_cell(asked: argparse.Namespace, link: Link) -> str:
    """Raises UsageError if that is not clear, LinkError if there is nobody."""
    named = named_cell(asked)
    if named:
        return named
    running = sorted({key.split("/")[1] for key in link.present(keys.planner("*"))})
    if not running:
        raise LinkError("no planner runs on this network; 'smv-planner run' starts one")
    if len(running) > 1:
        raise UsageError([Mistake("several planners run: " + ", ".join(map(printable, running)), "name one with --cell")])
    return running[0]


def document(link: Link, key: str, kind: str) -> dict[str, Any]:
    """What the planner says when it is asked. Raises LinkError."""
    found = heard.document(link.ask(key, timeout=PATIENCE), kind)
    if found is None:
        raise LinkError(f"what is answered at '{key}' is no document of a planner")
    return found


class Events:
    """What planners say has happened, each event once and in order, also those that were lost on the way.

    Only the next number is believed as it comes. After a gap the planner is asked, so that nobody hides what happens
    behind a number that no planner has reached.
    """

    def __init__(self, link: Link, cell: str) -> None:
        self._link, self._cell = link, cell
        self._mailbox = link.latest(keys.event(cell), depth=DEPTH)
        self._last: dict[str, int] = {}
        self._asked_at = 0.0

    def new(self, wait: float = 0.0) -> list[dict[str, Any]]:
        """Those since; `wait` is how many seconds to wait for one."""
        self._mailbox.wait(wait)
        fresh: list[dict[str, Any]] = []
        said = [heard.document(payload, "event") for _, payload in self._mailbox.drain()]
        for event in [each for each in said if each is not None]:
            planner, number = event["planner"], event["number"]
            if number > self._last.get(planner, 0) + 1:  # a reason to ask, and no more: anybody may have said it
                fresh += self._missed(planner)
            if number == self._last.get(planner, 0) + 1:
                fresh += self._first_time(event)
        if time.monotonic() - self._asked_at > AGAIN:
            fresh += self._missed(next(reversed(self._last), ""))
        return fresh

    def _missed(self, planner: str) -> list[dict[str, Any]]:
        """What a planner has to tell besides; another one tells all that it has."""
        self._asked_at = time.monotonic()
        fresh: list[dict[str, Any]] = []
        with suppress(LinkError):
            while True:
                after = json.dumps({"planner": planner, "after": self._last.get(planner, 0)}).encode()
                told = heard.documents(self._link.ask(keys.event(self._cell), after, timeout=PATIENCE), "event") or []
                new = [event for each in told for event in self._first_time(each)]
                fresh += new
                if not new:
                    return fresh
                planner = new[-1]["planner"]
        return fresh

    def _first_time(self, event: dict[str, Any]) -> list[dict[str, Any]]:
        planner = event["planner"]
        if event["number"] <= self._last.get(planner, 0):
            return []
        self._last.pop(planner, None)  # the newest planner stands last
        self._last[planner] = event["number"]
        return [event]
