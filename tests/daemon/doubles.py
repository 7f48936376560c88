"""Stand-ins for what the daemon's loop meets: a network in memory, a disk that may be full, planners that are asked later."""

from __future__ import annotations

import errno
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from bridge.errors import LinkError
from bridge.link import LatestMailbox, Mailbox
from smv_planner.daemon.planners import Reply
from smv_planner.runner.decision import Decision, Request
from smv_planner.simulate.process import MemoryDisk


@dataclass
class MemoryLink:
    """What was published, in order; what is put into `arrive` is heard."""

    log: list[tuple[str, str]]
    published: list[tuple[str, bytes]] = field(default_factory=list)
    answers: dict[str, Callable[[bytes], bytes]] = field(default_factory=dict)
    connected: bool = True
    broken: bool = False

    def publish(self, key: str, payload: bytes) -> None:
        if self.broken:
            raise LinkError("no router")
        self.log.append(("publish", key))
        self.published.append((key, payload))

    def latest(self, *keys: str, depth: int = 1, wake: Callable[[], None] | None = None) -> Mailbox:
        self.mailbox = LatestMailbox(depth, wake)
        return self.mailbox

    def arrive(self, key: str, payload: bytes) -> None:
        self.mailbox.put(key, payload)

    def answer(self, key: str, function: Callable[[bytes], bytes]) -> None:
        self.answers[key] = function

    def ask(self, key: str, payload: bytes = b"", timeout: float = 2.0) -> bytes:
        return self.answers[key](payload)

    def alive(self, key: str) -> None:
        pass

    def present(self, keys: str, timeout: float = 1.0) -> tuple[str, ...]:
        return ()

    def close(self) -> None:
        pass

    def __enter__(self) -> MemoryLink:
        return self

    def __exit__(self, *_: Any) -> None:
        pass


class LoggedDisk(MemoryDisk):
    """Says when something is safe; a `full` one takes nothing."""

    def __init__(self, log: list[tuple[str, str]] | None = None) -> None:
        super().__init__()
        self.log = [] if log is None else log
        self.full = False

    def create(self, name: str) -> None:
        self._room()
        super().create(name)

    def append(self, name: str, data: bytes) -> None:
        self._room()
        super().append(name, data)
        self.log.append(("write", name))

    def sync(self, name: str) -> None:
        self.log.append(("sync", name))

    def _room(self) -> None:
        if self.full:
            raise OSError(errno.ENOSPC, "No space left on device")


@dataclass
class LaterPlanners:
    """What was asked; whoever tests puts replies in."""

    asked: list[tuple[int, Request]] = field(default_factory=list)
    come: list[Reply] = field(default_factory=list)
    starts: int = 1

    def ask(self, revision: int, request: Request) -> None:
        self.asked.append((revision, request))

    def answer(self, decide: Callable[[Request], Decision]) -> None:
        revision, request = self.asked[-1]
        self.come.append((revision, decide(request)))

    def replies(self) -> list[Reply]:
        found, self.come = self.come, []
        return found

    def close(self) -> None:
        pass
