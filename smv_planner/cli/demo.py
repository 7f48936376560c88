"""`smv-planner demo`: a whole station of real processes on this machine, in which a robot dies and the work goes on.

Router, emulated hubs, planner and operator are processes of their own on free ports; here they are started, one robot is
told to die while it holds the tool, and what happens is said, until the bolts are tightened.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bridge import keys
from bridge.link import Link, LinkConfig, open_link
from smv_planner import language
from smv_planner.cli import outcome
from smv_planner.cli.asking import Events
from smv_planner.errors import EngineError

SCENARIO = "scenarios/assembly_station"
CELL = "demo"
GIVEN = (
    *(f"bolt_{n}={'tightened' if n < 4 else 'placed'}" for n in range(1, 7)),
    *("tool_at=r2", "r2_located=true", "r2_connector.attached=true", "r2_connector.lock=true"),
    *("r2.ref_pos=at_bolt_3", "r2.act_pos=at_bolt_3", "nutrunner.run_m=true", "nutrunner.tqr_m=true"),
)
"""r2 has the tool and half of the bolts done."""

DIES, DURING, INTENTION = "r2", "tighten_bolt_5_r2", "tighten_bolts"
SHOWN = ("running", "intention", "operation", "lost", "decision", "instruct", "confirmed", "alarm", "possible", "back")
READY, WHOLE = 20.0, 53.0
"""Seconds until everything has to run, and until all has to be over."""


def add_demo(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scenario", metavar="SCENARIO", nargs="?", default=SCENARIO, help="where the assembly station is")
    parser.add_argument("--pace", metavar="FACTOR", type=float, default=10.0, help="devices are so much faster than usual")


def demo(asked: argparse.Namespace) -> int:
    ends = time.monotonic() + WHOLE
    language.load(asked.scenario)  # a mistake is told once, and not by every process
    from bridge.router import free_endpoint

    endpoint = free_endpoint()
    to = ("--connect", endpoint)
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="smv_planner-demo-")))
        station = (asked.scenario, "--cell", CELL, *to)
        given = tuple(word for value in GIVEN for word in ("--set", value))
        started = [
            stack.enter_context(_process(folder, *words))
            for words in (
                ("router", "--listen", endpoint),
                ("emulate", *station, *given, "--pace", f"{asked.pace:g}"),
                ("run", *station, *given, "--journal", str(folder / "journal"), "--second-opinion", "none"),
                ("operator", *station, "--auto", "1"),
            )
        ]
        print("router, hubs, planner and operator are starting as processes of their own", flush=True)
        link = stack.enter_context(open_link(LinkConfig((endpoint,)), wait=READY))
        return Story(link, started).told(ends)


@dataclass
class Story:
    """What is heard of the planner, and said."""

    link: Link
    started: list[Started]
    lost: bool = False
    told_to_die: bool = False
    finished: bool = False
    actions: list[str] = field(default_factory=list)

    def told(self, ends: float) -> int:
        events = Events(self.link, CELL)
        while not self.finished:
            if time.monotonic() > ends:
                raise EngineError("the demonstration has not come to its end in time")
            for each in self.started:
                if each.child.poll() is not None:
                    raise EngineError(f"'{each.name}' has ended with {each.child.returncode}: {each.said.read_text()}")
            for event in events.new(wait=0.1):
                self.take(event)
        print(f"the bolts are tightened although {DIES} has died; recovery: {', '.join(self.actions)}", flush=True)
        return outcome.REACHED if self.lost else outcome.ENGINE_FAILED

    def take(self, event: dict[str, Any]) -> None:
        kind, data = event["event"], event["data"]
        if kind in SHOWN:
            print(f"{event['at']:7.2f} s  {kind:<10} {event['text'][:150]}", flush=True)
        if kind == "operation" and data == {"operation": DURING, "state": "executing"} and not self.told_to_die:
            self.told_to_die = True
            self.tell("dead")
            print(f"{'':>10} >>> {DIES} dies, with the tool in its hand", flush=True)
        if kind == "decision":
            self.actions += [action["name"] for action in data["actions"] if not action["ordinary"]]
        self.lost |= kind == "lost" and data == {"resource": DIES}
        self.finished |= kind == "intention" and data == {"intention": INTENTION, "state": "finished"}

    def tell(self, word: str) -> None:
        self.link.ask(keys.behaviour(CELL, DIES), json.dumps({"tell": [word]}).encode(), timeout=READY)


@dataclass(frozen=True, slots=True)
class Started:
    """A command of ours as a process, and the file with what it says."""

    name: str
    child: subprocess.Popen[bytes]
    said: Path


@contextmanager
def _process(folder: Path, name: str, *words: str) -> Iterator[Started]:
    """It is gone afterwards."""
    said = folder / f"{name}.log"
    with said.open("wb") as out:
        command = [sys.executable, "-m", "smv_planner", name, *words]
        child = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=out, stderr=out)
    try:
        yield Started(name, child, said)
    finally:
        child.terminate()
        try:
            child.wait(3.0)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()
