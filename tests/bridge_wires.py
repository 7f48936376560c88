"""A link without a network, and hubs on it, for tests that need no router."""

from __future__ import annotations

import fnmatch
import time
from collections.abc import Callable
from typing import Self

from bridge.errors import LinkError
from bridge.link import LatestMailbox, Mailbox

PATIENCE = 30.0
"""Seconds until a test gives up; what it waits for takes milliseconds on an idle machine."""


class Network:
    """What one link publishes, all others hear at once."""

    def __init__(self) -> None:
        self.links: list[MemoryLink] = []
        self.answers: dict[str, Callable[[bytes], bytes]] = {}

    def link(self) -> MemoryLink:
        link = MemoryLink(self)
        self.links.append(link)
        return link


class MemoryLink:
    connected = True

    def __init__(self, network: Network) -> None:
        self._network = network
        self._boxes: list[tuple[tuple[str, ...], LatestMailbox]] = []

    def publish(self, key: str, payload: bytes) -> None:
        for link in self._network.links:
            if link is not self:
                link.hear(key, payload)

    def hear(self, key: str, payload: bytes) -> None:
        for keys, box in self._boxes:
            if any(fnmatch.fnmatchcase(key, pattern) for pattern in keys):
                box.put(key, payload)

    def latest(self, *keys: str, depth: int = 1, wake: Callable[[], None] | None = None) -> Mailbox:
        box = LatestMailbox(depth, wake)
        self._boxes.append((keys, box))
        return box

    def answer(self, key: str, function: Callable[[bytes], bytes]) -> None:
        self._network.answers[key] = function

    def ask(self, key: str, payload: bytes = b"", timeout: float = 2.0) -> bytes:
        if key not in self._network.answers:
            raise LinkError(f"nobody answers at '{key}'")
        return self._network.answers[key](payload)

    def alive(self, key: str) -> None:
        pass

    def present(self, keys: str, timeout: float = 1.0) -> tuple[str, ...]:
        return ()

    def close(self) -> None:
        self._network.links.remove(self)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def until(true: Callable[[], object], repeat: Callable[[], object] = lambda: None) -> None:
    """Keep doing something until it has come to pass."""
    ends = time.monotonic() + PATIENCE
    while not true():
        assert time.monotonic() < ends, "it has not come to pass"
        repeat()
        time.sleep(0.005)
