"""For the author of a driver: a hub, which obeys the newest planner and mirrors what it obeys.

    from bridge.hub import Hub

    with Hub("r1.json") as hub:                 # written by: smv-planner interface SCENARIO r1
        while True:
            goal = hub.wait(0.1)                # as soon as it changes, or after that time
            device.set(goal["r1.ref_pos"])      # safe to repeat: goals are state, not events
            hub.report({"r1.act_pos": device.position(), "r1.moving": device.moving()})

A thread of its own receives, mirrors and repeats; in asyncio, `async with` and `async for goal in hub.goals()` do the same.
What was measured is repeated as long as the driver keeps measuring: after `stale_after` seconds without a report the hub
falls silent, so that a driver that hangs does not look like a device that stands still.
"""

from __future__ import annotations

import asyncio
import threading
import time
import uuid
from collections import Counter
from collections.abc import AsyncIterator, Callable, Mapping
from math import inf
from pathlib import Path
from typing import Self

from bridge.descriptions import Description, read
from bridge.link import Link, LinkConfig, open_link
from bridge.wire import Wire
from smv_planner.errors import Mistake, UsageError
from smv_planner.model.domains import Value
from smv_planner.protocol import hub as automaton
from smv_planner.protocol.messages import Rejected

GAP = 0.005
"""Seconds between two reports, however often something changes."""


class Hub:
    """The hub of one resource.

    `description` is a file, or what was read from one; `goal` is what the device does now, if that is not what the scenario
    begins with. Everything may be called from any thread. Raises UsageError for a wrong description, address or value.
    """

    def __init__(
        self,
        description: Description | str | Path,
        link: LinkConfig | Link | None = None,
        *,
        goal: Mapping[str, Value] | None = None,
        stale_after: float = 1.0,
        wait: float = inf,
    ) -> None:
        described = description if isinstance(description, Description) else _from_file(Path(description))
        self.interface = described.interface
        self._connection = link if link is not None else LinkConfig()
        self._patience = wait
        self._period = described.period
        self._stale_after = stale_after
        resting = {**described.initial, **(goal or {})}
        _check(resting, self.interface.goals, "goal")
        boot = uuid.uuid4().hex
        self._hub = automaton.start(self.interface, boot, time.monotonic(), resting, described.deadman)
        self._measured: Mapping[str, Value] | None = None
        self._measured_at = -inf
        self._reported_at = -inf
        self._urgent = False
        self._told = self._hub.goal
        self._seen: Mapping[str, Value] = {}
        self._lock = threading.Condition()
        self._woken = threading.Event()
        self._closing = False
        self._listeners: list[Callable[[], None]] = []
        self._link: Link | None = None
        self._wire: Wire | None = None
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._serve, name=f"hub {self.interface.resource}", daemon=True)

    @property
    def goal(self) -> Mapping[str, Value]:
        """What to act on now: what the planner asks, or the deadman reaction."""
        with self._lock:
            self._raise()
            self._tick()
            return self._hub.goal

    @property
    def forsaken(self) -> bool:
        """Whether no planner has spoken for so long that the deadman reaction has begun, `hold` or not."""
        with self._lock:
            self._tick()
            return self._hub.forsaken

    @property
    def rejected(self) -> Counter[str]:
        """How many goal messages were refused, by reason."""
        with self._lock:
            return Counter(self._wire.rejected) if self._wire else Counter()

    def report(self, measured: Mapping[str, Value]) -> None:
        """All measured values as they are now. They are sent at once if they changed, and repeated.

        Raises UsageError if one is missing, unknown, or no value of its variable.
        """
        _check(measured, self.interface.measured, "measured value")
        with self._lock:
            self._raise()
            self._urgent |= measured != self._measured
            self._measured, self._measured_at = dict(measured), time.monotonic()
        self._woken.set()

    def wait(self, timeout: float | None = None) -> Mapping[str, Value]:
        """The goal, as soon as it is another one than this returned before, or after the time."""
        with self._lock:
            self._lock.wait_for(lambda: self._failure or self._closing or self._hub.goal != self._seen, timeout)
            self._raise()
            self._seen = self._hub.goal
            return self._seen

    async def goals(self) -> AsyncIterator[Mapping[str, Value]]:
        """The goal now, and again each time it has changed; ends when the hub is closed."""
        loop, changed = asyncio.get_running_loop(), asyncio.Event()

        def listener() -> None:
            if not loop.is_closed():
                loop.call_soon_threadsafe(changed.set)

        last: Mapping[str, Value] | None = None
        self._listeners.append(listener)
        try:
            while not self._closing:
                changed.clear()
                goal = self.goal
                if goal != last:
                    last = goal
                    yield goal
                else:
                    await changed.wait()
        finally:
            self._listeners.remove(listener)

    def open(self) -> Self:
        """Connect, waiting for a router if need be, and begin. Raises LinkError."""
        match self._connection:
            case LinkConfig() as config:
                self._link = open_link(config, self._patience)
            case link:
                self._link = link
        self._wire = Wire(self._link, self.interface, self._woken.set)
        self._thread.start()
        return self

    def close(self) -> None:
        with self._lock:
            self._closing = True
        self._woken.set()
        if self._thread.is_alive():
            self._thread.join()
        self._tell()
        if self._link is not None and isinstance(self._connection, LinkConfig):
            self._link.close()

    def __enter__(self) -> Self:
        return self.open()

    def __exit__(self, *_: object) -> None:
        self.close()

    async def __aenter__(self) -> Self:
        return await asyncio.to_thread(self.open)

    async def __aexit__(self, *_: object) -> None:
        await asyncio.to_thread(self.close)

    def _serve(self) -> None:
        try:
            while not self._closing:
                self._woken.clear()
                pause = self._turn(time.monotonic())
                if self._hub.goal != self._told:
                    self._told = self._hub.goal
                    self._tell()
                self._woken.wait(pause)
        except BaseException as error:
            self._failure = error  # raised where the driver calls: a hub that does not mirror must not go unnoticed
            self._tell()

    def _turn(self, at: float) -> float:
        """Receive, react and report; how long there is nothing to do."""
        assert self._wire
        with self._lock:
            before = self._hub.goal, self._hub.obeyed
            for message in self._wire.goals():
                match automaton.receive(self._hub, message, at):
                    case Rejected() as rejected:
                        self._wire.refuse(rejected)
                    case hub:
                        self._hub = hub
            self._tick(at)
            self._urgent |= (self._hub.goal, self._hub.obeyed) != before
            due = self._reported_at + (GAP if self._urgent else self._period)
            if at < due:
                return due - at
            if self._measured is None or at - self._measured_at > self._stale_after:
                return self._period
            self._hub, message_out = automaton.report(self._hub, self._measured, at)
            self._urgent, self._reported_at = False, at
            self._wire.send(message_out)
            return self._period

    def _tick(self, at: float | None = None) -> None:
        self._hub = automaton.tick(self._hub, time.monotonic() if at is None else at)

    def _tell(self) -> None:
        with self._lock:
            self._lock.notify_all()
        for listener in list(self._listeners):
            listener()

    def _raise(self) -> None:
        if self._failure is not None:
            raise self._failure


def _from_file(path: Path) -> Description:
    try:
        return read(path.read_text(encoding="utf-8"), f"'{path}'")
    except OSError as error:
        raise UsageError([Mistake(f"cannot read '{path}': {error.strerror}")]) from error


def _check(values: Mapping[str, Value], domains: Mapping[str, object], what: str) -> None:
    mistakes = [Mistake(f"the {what} '{name}' is missing") for name in domains if name not in values]
    for name, value in values.items():
        if name not in domains:
            mistakes.append(Mistake(f"there is no {what} '{name}'"))
        elif value not in domains[name]:  # type: ignore[operator]
            mistakes.append(Mistake(f"{value!r} is not a value of '{name}'", f"its domain is {domains[name]}"))
    if mistakes:
        raise UsageError(mistakes)
