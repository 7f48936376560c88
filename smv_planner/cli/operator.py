"""`smv-planner operator`: what the planner asks of people, and their answers."""

from __future__ import annotations

import argparse
import json
import queue
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

from bridge import keys
from bridge.errors import LinkError
from bridge.link import Link
from bridge.printable import printable
from smv_planner import language
from smv_planner.cli import heard, outcome
from smv_planner.cli.ask import only_request
from smv_planner.cli.asking import PATIENCE
from smv_planner.cli.network import add_network, cell_of, linked
from smv_planner.errors import MistakesError
from smv_planner.model.model import Model

ANSWERS = """\
answers, one a line:
  done [REQUEST]      what was asked for is done (also: confirm)
  approve [REQUEST]   agreed
  list                what is open"""


def add_operator(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scenario", metavar="SCENARIO", help="a scenario file, or a folder that holds model.yaml")
    parser.add_argument(
        "--auto",
        metavar="S",
        type=float,
        nargs="?",
        const=2.0,
        help="for emulated stations: do what is asked for and agree to everything, so many seconds later (default: %(const)s)",
    )
    parser.add_argument("--json", action="store_true", help="requests as JSON, one a line")
    add_network(parser)


def operate(asked: argparse.Namespace) -> int:
    model = language.load(asked.scenario)
    cell = cell_of(asked, model)
    with linked(asked, patient=True) as link:
        desk = Desk(link, cell, asked.json)
        if asked.auto is not None:
            desk.run(lambda: desk.by_itself(model, asked.auto))
        else:
            lines = _lines()
            print(ANSWERS if sys.stdin.isatty() else "", file=sys.stderr, end="\n" if sys.stdin.isatty() else "")
            desk.run(lambda: desk.answers(lines))
    return outcome.REACHED


class Desk:
    """The open requests as they were published last, and since when."""

    def __init__(self, link: Link, cell: str, as_json: bool) -> None:
        self._link, self._cell, self._as_json = link, cell, as_json
        self._mailbox = link.latest(keys.operator(cell))
        self._open: dict[str, dict[str, Any]] = {}
        self._since: dict[str, float] = {}

    def run(self, answer: Callable[[], bool]) -> None:
        """Show what comes and goes, until `answer` says that it is over."""
        going = True
        while going:
            self._mailbox.wait(0.1)
            for _, payload in self._mailbox.drain():
                found = heard.document(payload, "operator")
                if found is not None:
                    self._take(found)
            going = answer()

    def answers(self, lines: queue.Queue[str | None]) -> bool:
        """Work off what was typed; False at its end."""
        while not lines.empty():
            line = lines.get()
            if line is None:
                return False
            match line.split():
                case []:
                    pass
                case ["list"]:
                    for request in self._open.values():
                        self._show("open", request)
                case [("done" | "confirm" | "approve") as word, *rest] if len(rest) <= 1:
                    self._order("approve" if word == "approve" else "confirm", rest[0] if rest else None)
                case _:
                    print(ANSWERS, file=sys.stderr)
        return True

    def by_itself(self, model: Model, delay: float) -> bool:
        """Do what is asked for at emulated devices, and say so."""
        from smv_planner.plant.serve import perform

        for name, request in list(self._open.items()):
            if request["confirmed"] or time.monotonic() - self._since[name] < delay:
                continue
            self._since[name] = time.monotonic()  # if it fails, try again after the delay
            try:
                if request["answer"] == "confirm":
                    perform(self._link, model, self._cell, request["transition"], request["values"])
                self._order(request["answer"], name)
            except (LinkError, MistakesError) as error:
                print(printable(f"not done: {error}"), file=sys.stderr, flush=True)
        return True

    def _take(self, found: dict[str, Any]) -> None:
        wanted = {request["request"]: request for request in found["requests"]}
        for name in [*self._open]:
            if name not in wanted:
                self._show("over", self._open.pop(name))
        for name, request in wanted.items():
            if name not in self._open:
                self._since[name] = time.monotonic()
                self._show("asked", request)
            self._open[name] = request

    def _show(self, what: str, request: dict[str, Any]) -> None:
        if self._as_json:
            print(json.dumps({"what": what, **request}), flush=True)
        else:
            print(printable(f"{what:<6} {request['request']:<8} {request['text']}  [{request['answer']}]"), flush=True)

    def _order(self, word: str, request: str | None) -> None:
        try:
            name = request or only_request({"requests": list(self._open.values())}, word)
            self._link.ask(keys.order(self._cell), json.dumps({"order": word, "request": name}).encode(), timeout=PATIENCE)
        except (LinkError, MistakesError) as error:
            print(printable(f"not taken: {error}"), file=sys.stderr, flush=True)


def _lines() -> queue.Queue[str | None]:
    """What is typed, read in a thread of its own; None at the end."""
    lines: queue.Queue[str | None] = queue.Queue()

    def read() -> None:
        for line in sys.stdin:
            lines.put(line)
        lines.put(None)

    threading.Thread(target=read, name="stdin", daemon=True).start()
    return lines
