"""`smv-planner demo`: an execution case on real processes on this machine, as a whole station has them.

Router, emulated hubs, planner and operator are processes of their own on free ports. What the case tells happens to them, and
what comes of it is said, until the intentions are as the case declares.
"""

from __future__ import annotations

import argparse
import ctypes
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from bridge.link import LinkConfig, open_link
from bridge.printable import printable
from smv_planner import language
from smv_planner.cli import outcome
from smv_planner.errors import EngineError, Mistake, UsageError
from smv_planner.lazy import dataclass
from smv_planner.model.domains import show_value
from smv_planner.simulate.script import Case, cases, chosen

CELL = "demo"
SHOWN = ("running", "intention", "operation", "lost", "decision", "instruct", "confirmed", "alarm", "possible", "back")
READY, WHOLE = 20.0, 53.0
"""Seconds until everything has to run, and until all has to be over."""

_LIBC = ctypes.CDLL(None)
_PR_SET_PDEATHSIG = 1


def add_demo(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scenario", metavar="SCENARIO", help="a folder that holds model.yaml and cases")
    parser.add_argument("--case", metavar="NAME", required=True, help="an execution case of the folder, as e5 for cases/e5.yaml")
    parser.add_argument(
        "--pace", metavar="FACTOR", type=float, default=10.0, help="devices are so much faster than usual (default: %(default)g)"
    )


def demo(asked: argparse.Namespace) -> int:
    ends = time.monotonic() + WHOLE
    case = _case(Path(asked.scenario), asked.case)
    from bridge.router import free_endpoint
    from smv_planner.cli.staged import Staged

    endpoint = free_endpoint()
    to = ("--connect", endpoint)
    station = (asked.scenario, "--cell", CELL, *to)
    given = tuple(word for name, value in case.given.items() for word in ("--set", f"{name}={show_value(value)}"))
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="smv_planner-demo-")))
        commands: dict[str, Sequence[str]] = {
            "router": ("--listen", endpoint),
            "emulate": (*station, *given, "--pace", f"{asked.pace:g}"),
            "run": (*station, *given, "--journal", str(folder / "journal"), "--second-opinion", "none"),
            "operator": (*station, "--auto", "1"),
        }
        started = [stack.enter_context(_process(folder, name, *words)) for name, words in commands.items()]
        print(f"{case.description}\nrouter, hubs, planner and operator start as processes of their own", flush=True)
        link = stack.enter_context(open_link(LinkConfig((endpoint,)), wait=READY))
        _hubs_there(started, ends)
        staged = Staged(link, CELL, language.load(asked.scenario), case, asked.pace)
        while not staged.over:
            _look_after(started, ends)
            coming = len(staged.coming)
            for event in staged.look():
                _show(event)
            if len(staged.coming) < coming:
                print(f"{'':>11}>>> what the case tells happens now", flush=True)
            time.sleep(0.01)
        done = ", ".join(f"'{name}' is {status}" for name, status in case.then.intentions.items())
        print(f"{done}; recovery: {', '.join(action.name for action in staged.record.recovery) or 'none'}", flush=True)
    return outcome.REACHED


def _case(folder: Path, name: str) -> Case:
    _, case = chosen(cases(folder, language.load), name)
    if not case.then.intentions:
        raise UsageError([Mistake(f"case '{name}' does not say what becomes of intentions", "without that it has no end")])
    return case


def _show(event: dict[str, Any]) -> None:
    if event["event"] in SHOWN:
        print(printable(f"{event['at']:7.2f} s  {event['event']:<10} {event['text'][:150]}"), flush=True)


@dataclass(frozen=True, slots=True)
class Started:
    """A command of ours as a process, and the file with what it says."""

    name: str
    child: subprocess.Popen[bytes]
    said: Path


def _look_after(started: Sequence[Started], ends: float) -> None:
    """Raises EngineError if one has ended, or if it takes too long."""
    if time.monotonic() > ends:
        raise EngineError("the demonstration has not come to its end in time")
    for each in started:
        if each.child.poll() is not None:
            raise EngineError(f"'{each.name}' has ended with {each.child.returncode}: {each.said.read_text()}")


def _hubs_there(started: Sequence[Started], ends: float) -> None:
    """Wait until hubs can be told something."""
    (hubs,) = (each for each in started if each.name == "emulate")
    while "hubs of cell" not in hubs.said.read_text():
        _look_after(started, ends)
        time.sleep(0.05)


@contextmanager
def _process(folder: Path, name: str, *words: str) -> Iterator[Started]:
    """It is gone afterwards, even if nobody is left to end it."""
    said = folder / f"{name}.log"
    with said.open("wb") as out:
        command = [sys.executable, "-P", "-m", "smv_planner", name, *words]  # -P: nothing of the folder where we happen to be
        child = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=out, stderr=out, preexec_fn=_die_with_us)
    try:
        yield Started(name, child, said)
    finally:
        child.terminate()
        try:
            child.wait(3.0)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()


def _die_with_us() -> None:
    _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
