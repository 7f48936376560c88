"""One process of the planner: what the daemon does with an event, and every moment at which it may be killed.

The order is the promise (facts of reliability, I5): an event is in the journal before the runner sees it, and so before
anything is published because of it. Whoever starts after a crash folds the journal through the same `step` and arrives
at the same situation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import StrEnum

from smv_planner.journal import Disk, Journal
from smv_planner.lazy import dataclass, field, replace
from smv_planner.runner.events import Event, Output
from smv_planner.runner.records import Known, entry, record
from smv_planner.runner.situation import Situation, Station
from smv_planner.runner.step import step

SEGMENT = 256 * 1024
"""Bytes after which a journal begins anew: small, so that it happens in a run."""


class Moment(StrEnum):
    """Where a process may die while it works off an event."""

    RECEIVED = "received"  # nothing is written
    TORN = "torn"  # the record is being written
    WRITTEN = "written"  # the runner has not seen it
    STEPPED = "stepped"  # nothing is performed
    PERFORMED = "performed"  # one output more is out


class Killed(Exception):
    """The process is gone; nobody in it notices."""


@dataclass
class MemoryDisk:
    """Files that survive the planner's processes. Of the next record written, only the part `torn` gets there."""

    files: dict[str, bytearray] = field(default_factory=dict)
    torn: float = 1.0

    def names(self) -> Sequence[str]:
        return sorted(self.files)

    def read(self, name: str) -> bytes:
        return bytes(self.files[name])

    def create(self, name: str) -> None:
        self.files[name] = bytearray()

    def append(self, name: str, data: bytes) -> None:
        part, self.torn = self.torn, 1.0
        self.files[name] += data[: int(part * len(data))]

    def cut(self, name: str, size: int) -> None:
        del self.files[name][size:]

    def sync(self, name: str) -> None:
        pass

    def rename(self, name: str, to: str) -> None:
        self.files[to] = self.files.pop(name)

    def remove(self, name: str) -> None:
        del self.files[name]

    def close(self) -> None:
        pass


@dataclass
class Process:
    """`kill` is asked at every moment whether the process dies there; `perform` does what the runner wants done."""

    name: str
    station: Station
    known: Known
    situation: Situation
    perform: Callable[[Process, Output], None]
    turned: Callable[[Process, Event, Situation, tuple[Output, ...]], None]
    kill: Callable[[Process, Moment], bool] = lambda process, moment: False
    disk: Disk | None = None
    segment: int = SEGMENT
    alive: bool = True
    written: int = 0
    torn: int = 0

    def __post_init__(self) -> None:
        self.journal: Journal | None = None
        self.stopped: list[Event] | None = None

    def begin(self) -> None:
        """Open the journal, if there is one, and arrive at the situation that it tells of."""
        if self.disk is None:
            return
        opened = Journal.open(self.disk, self.station.model.hash, self.segment)
        self.journal, self.torn = opened.journal, opened.torn
        if not opened.records:
            self.journal.write([record(self.situation)])
        for payload in opened.records:
            match entry(payload, self.known):
                case Situation() as situation:
                    self.situation = situation
                case event:
                    self.situation, _ = step(self.station, self.situation, event)

    def happen(self, event: Event) -> None:
        """Work off an event. While the process is stopped (SIGSTOP) events wait, as they do in the buffers of a socket."""
        if not self.alive:
            return
        if self.stopped is not None:
            self.stopped.append(event)
            return
        try:
            self._happen(event)
        except Killed:
            self.alive = False

    def go_on(self, at: float) -> None:
        """The process runs again; what has waited is worked off now."""
        waiting, self.stopped = self.stopped or [], None
        for event in waiting:
            self.happen(replace(event, at=at))

    def _happen(self, event: Event) -> None:
        self._moment(Moment.RECEIVED)
        self._write(event)
        self._moment(Moment.WRITTEN)
        before = self.situation
        self.situation, outputs = step(self.station, before, event)
        self.turned(self, event, before, outputs)
        self._moment(Moment.STEPPED)
        for output in outputs:
            self.perform(self, output)
            self._moment(Moment.PERFORMED)

    def _write(self, event: Event) -> None:
        if self.journal is None:
            return
        if self.journal.full:
            self.journal.anew([record(self.situation)])
        if self.kill(self, Moment.TORN):
            assert isinstance(self.disk, MemoryDisk)
            self.disk.torn = 0.5
            self.journal.write([record(event)])
            raise Killed
        self.journal.write([record(event)])
        self.written += 1

    def _moment(self, moment: Moment) -> None:
        if self.kill(self, moment):
            raise Killed
