"""A station of real processes on loopback: router, hubs, planners, operator, and somebody who watches from outside."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import smv_planner as sp
from bridge import keys
from bridge.errors import LinkError
from bridge.link import Link, LinkConfig, open_link
from bridge.router import RouterConfig, free_endpoint, router
from smv_planner.cli import outcome
from smv_planner.cli.asking import Events
from smv_planner.cli.main import command
from smv_planner.model.domains import Value, show_value

ROOT = Path(__file__).parents[2]
ASSEMBLY = ROOT / "scenarios" / "assembly_station"
PATIENCE = 90.0
"""Seconds for what takes one or two on a machine that has nothing else to do."""

load = cache(sp.load)


def health(*words: str) -> int:
    """What `smv-planner health WORDS` exits with, in this process."""
    return outcome.run(command, ["health", *words])


def until(true: Callable[[], Any], what: str, patience: float = PATIENCE) -> Any:
    ends = time.monotonic() + patience
    while not (found := true()):
        assert time.monotonic() < ends, f"it has not come to pass: {what}"
        time.sleep(0.01)
    return found


@contextmanager
def routed() -> Iterator[str]:
    """The endpoint of a router."""
    endpoint = free_endpoint()
    with router(RouterConfig(listen=(endpoint,))):
        yield endpoint


@dataclass
class Running:
    """A process of ours; what it says is in the file `said`."""

    child: subprocess.Popen[bytes]
    said: Path

    @property
    def text(self) -> str:
        return self.said.read_text(encoding="utf-8")

    def send(self, number: signal.Signals) -> None:
        self.child.send_signal(number)

    def end(self, number: signal.Signals = signal.SIGTERM) -> int:
        self.send(number)
        return self.child.wait(PATIENCE)


@dataclass
class Station:
    """Everything about one cell. `events` are all that were heard from its planners, in order."""

    endpoint: str
    folder: Path
    scenario: Path
    cell: str
    link: Link
    stack: ExitStack
    set: Mapping[str, Value] = field(default_factory=dict)
    started: int = 0

    def __post_init__(self) -> None:
        self.model = load(self.scenario)
        self.events: list[dict[str, Any]] = []
        self._new = Events(self.link, self.cell)

    def start(
        self, *words: str, environment: Mapping[str, str] | None = None, prepare: Callable[[], None] | None = None
    ) -> Running:
        """`smv-planner WORDS` as a process of its own."""
        self.started += 1
        said = self.folder / f"{self.started}-{words[0]}.log"
        command = [sys.executable, "-m", "smv_planner", *words, "--connect", self.endpoint, "--cell", self.cell]
        with said.open("wb") as out:
            child = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=out,
                cwd=self.folder,
                env={**os.environ, **(environment or {})},
            )
        running = Running(child, said)
        self.stack.callback(child.wait)
        self.stack.callback(child.kill)
        return running

    def hubs(self, *words: str, pace: float = 10.0) -> Running:
        found = self.start("emulate", str(self.scenario), "--pace", f"{pace:g}", *self._set(), *words)
        until(lambda: "hubs of cell" in found.text, "hubs run")
        return found

    def planner(self, *words: str, journal: str = "journal", **how: Any) -> Running:
        folder = str(self.folder / journal)
        plain = ("--journal", folder, "--second-opinion", "none", "--log-format", "json")
        return self.start("run", str(self.scenario), *plain, *self._set(), *words, **how)

    def operator(self) -> Running:
        return self.start("operator", str(self.scenario), "--auto", "0.3")

    def _set(self) -> list[str]:
        return [word for name, value in self.set.items() for word in ("--set", f"{name}={show_value(value)}")]

    def heard(self) -> list[dict[str, Any]]:
        self.events += self._new.new()
        return self.events

    def tell(self, hub: str, *words: str) -> dict[str, Any]:
        told = json.dumps({"tell": words}).encode()
        found: dict[str, Any] = json.loads(self.link.ask(keys.behaviour(self.cell, hub), told, timeout=PATIENCE))
        return found

    def say(self, key: Callable[[str], str], order: Mapping[str, Any] | None = None) -> dict[str, Any] | None:
        """What the planner answers; None if it does not."""
        try:
            payload = json.dumps(order).encode() if order else b""
            found: dict[str, Any] = json.loads(self.link.ask(key(self.cell), payload, timeout=2.0))
        except LinkError:
            return None
        return found

    def situation(self) -> dict[str, Any] | None:
        return self.say(keys.situation)

    def phase(self, phase: str) -> dict[str, Any]:
        """The situation as soon as a planner says that it is in this phase."""

        def reached() -> dict[str, Any] | None:
            now = self.situation()
            return now if now and now["phase"] == phase else None

        found: dict[str, Any] = until(reached, phase)
        return found


@contextmanager
def station(
    endpoint: str, folder: Path, cell: str, scenario: Path = ASSEMBLY, given: Mapping[str, Value] | None = None
) -> Iterator[Station]:
    with ExitStack() as stack:
        link = stack.enter_context(open_link(LinkConfig((endpoint,)), wait=PATIENCE))
        yield Station(endpoint, folder, scenario, cell, link, stack, given or {})


@contextmanager
def observed(station: Station) -> Iterator[Callable[[], dict[str, Any]]]:
    """An observer of its own process while the context lasts; what it gives is called for its findings."""
    command: Sequence[str] = [sys.executable, str(Path(__file__).with_name("observer.py"))]
    child = subprocess.Popen(
        [*command, station.endpoint, station.cell, str(station.scenario)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    try:
        assert child.stdout
        assert child.stdout.readline() == b"watching\n"

        def findings() -> dict[str, Any]:
            told, _ = child.communicate(b"", timeout=PATIENCE)
            found: dict[str, Any] = json.loads(told)
            return found

        yield findings
    finally:
        child.kill()
        child.wait()
