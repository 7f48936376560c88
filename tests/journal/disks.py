"""A disk in memory that loses what was not synced when the power is cut, and fails when it is told to."""

from __future__ import annotations

import errno
import random
from collections.abc import Sequence
from dataclasses import dataclass, field


class PowerCut(BaseException):
    """Nobody is there any more to catch it."""


@dataclass
class File:
    data: bytes = b""
    synced: int = 0


@dataclass
class MemoryDisk:
    """`fails` says for the n-th change to the disk what happens at it: an error number, or a power cut."""

    fails: dict[int, int | type[PowerCut]] = field(default_factory=dict)
    files: dict[str, File] = field(default_factory=dict)
    seed: int = 0
    changes: int = 0

    def names(self) -> Sequence[str]:
        return sorted(self.files)

    def read(self, name: str) -> bytes:
        return self.files[name].data

    def create(self, name: str) -> None:
        self._change()
        self.files[name] = File()

    def append(self, name: str, data: bytes) -> None:
        part = self._draw().randint(0, len(data))
        try:
            self._change()
        except BaseException:
            self.files[name].data += data[:part]
            raise
        self.files[name].data += data

    def cut(self, name: str, size: int) -> None:
        self._change()
        file = self.files[name]
        file.data, file.synced = file.data[:size], min(file.synced, size)

    def sync(self, name: str) -> None:
        self._change()
        self.files[name].synced = len(self.files[name].data)

    def rename(self, name: str, to: str) -> None:
        happened = self._draw().random() < 0.5
        try:
            self._change()
        except BaseException:
            if happened:
                self.files[to] = self.files.pop(name)
            raise
        self.files[to] = self.files.pop(name)

    def remove(self, name: str) -> None:
        self._change()
        del self.files[name]

    def close(self) -> None:
        pass

    def after_a_power_cut(self) -> MemoryDisk:
        """What is found when the power is back: of what was not synced some, then nothing, or zeros."""
        draw = self._draw()
        files = {}
        for name, file in self.files.items():
            kept = draw.randint(file.synced, len(file.data))
            zeros = draw.choice([0, len(file.data) - kept])
            files[name] = File(file.data[:kept] + bytes(zeros), kept + zeros)
        return MemoryDisk({}, files, self.seed)

    def _draw(self) -> random.Random:
        return random.Random(f"{self.seed} {self.changes}")

    def _change(self) -> None:
        self.changes += 1
        match self.fails.get(self.changes):
            case int(number):
                raise OSError(number, errno.errorcode[number])
            case kind if kind is not None:
                raise kind
