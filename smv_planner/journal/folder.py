"""The journal on disk: a folder of segments, of which the newest counts. One process writes it.

A segment gets its name when it is complete with its header and its first record, and the one before goes when that is
durable: whenever everything stops, one of the two is there. What could not be written is `Unwritten`, and then nobody may
act upon it: the planner holds, and goes on once it has begun a new segment.
"""

from __future__ import annotations

import fcntl
import os
import re
from collections.abc import Sequence
from contextlib import suppress
from typing import Protocol

from smv_planner.errors import SmvPlannerError
from smv_planner.journal.framing import Damaged, Header, Sound, Torn, frame, opening, read
from smv_planner.lazy import dataclass

LIMIT = 16 * 1024 * 1024
"""By how many bytes a segment grows before it is full. While no new one can be begun, by twice as many."""

_NAME = re.compile(r"(\d{8})\.journal")
_UNFINISHED = ".unfinished"


class Refused(SmvPlannerError):
    """The journal cannot be gone on with; the message says what is wrong where, and what to do."""


class Unwritten(SmvPlannerError):
    """The disk did not take it. Nothing may be done that the journal does not hold."""


class Disk(Protocol):
    """What a journal does with files, all in one folder. Everything may raise OSError."""

    def names(self) -> Sequence[str]: ...

    def read(self, name: str) -> bytes: ...

    def create(self, name: str) -> None:
        """An empty file, in place of any of that name."""

    def append(self, name: str, data: bytes) -> None:
        """When this raises, some of the data may stand in the file."""

    def cut(self, name: str, size: int) -> None: ...

    def sync(self, name: str) -> None:
        """What was appended survives a power cut."""

    def rename(self, name: str, to: str) -> None:
        """At once or not at all, and surviving a power cut."""

    def remove(self, name: str) -> None: ...

    def close(self) -> None: ...


@dataclass(frozen=True, slots=True)
class Opened:
    """A journal to go on with. `records` are what its newest segment holds; `torn` bytes were cut off behind them."""

    journal: Journal
    records: tuple[bytes, ...]
    torn: int


class Journal:
    """Writes records behind what `open` has read."""

    def __init__(self, disk: Disk, found: Sound, limit: int) -> None:
        self._disk, self._limit = disk, limit
        self._header, self._begun, self._end, self._checksum = found.header, found.end, found.end, found.checksum
        self._broken: str | None = None

    @classmethod
    def open(cls, disk: Disk, model: str, limit: int = LIMIT) -> Opened:
        """The journal of a folder; an empty one is begun if there is none. Raises Refused or Unwritten."""
        try:
            numbers = sorted(int(known[1]) for name in disk.names() if (known := _NAME.fullmatch(name)))
            if not numbers:
                begun = _prepare(disk, Header(model, 1), ())
                disk.rename(_name(1) + _UNFINISHED, _name(1))
                return Opened(cls(disk, begun, limit), (), 0)
            data = disk.read(_name(numbers[-1]))
            sound = _understood(read(data), _name(numbers[-1]), model, numbers[-1])
            if len(data) > sound.end:
                disk.cut(_name(numbers[-1]), sound.end)
                disk.sync(_name(numbers[-1]))
            journal = cls(disk, sound, limit)
            journal._tidy()
            return Opened(journal, sound.records, len(data) - sound.end)
        except OSError as error:
            raise Unwritten(f"the journal cannot be opened: {error.strerror or error}") from error

    @property
    def full(self) -> bool:
        """Whether it is time to begin anew."""
        return self._end >= self._begun + self._limit or self._broken is not None

    @property
    def broken(self) -> str | None:
        """Why nothing can be written before the journal is begun anew, if that is so."""
        return self._broken

    def write(self, records: Sequence[bytes], durable: bool = True) -> None:
        """Append records. `durable` ones survive a power cut, others only that this process dies.

        After Unwritten some of them may stand in the file, and nothing more goes behind them until `anew`.
        """
        if self._broken:
            raise Unwritten(self._broken)
        framed, checksum = _framed(records, self._checksum)
        if self._end + len(framed) > self._begun + 2 * self._limit:
            raise Unwritten(f"the journal has grown to {self._end} bytes, and no new segment could be begun")
        name = _name(self._header.segment)
        try:
            self._disk.append(name, framed)
            if durable:
                self._disk.sync(name)
        except OSError as error:
            # What a failed fsync has left in the cache counts as written ever after: the file cannot be believed again.
            self._broken = f"the journal cannot be written: {error.strerror or error}"
            raise Unwritten(self._broken) from error
        self._end += len(framed)
        self._checksum = checksum

    def anew(self, snapshot: Sequence[bytes], model: str | None = None) -> None:
        """Begin a new segment with records that stand for all before, from now on for another `model` if one is named.

        Raises Unwritten; then it may be tried again.

        While there was no room for it the old segment goes on. Once it may have its name, nothing else counts.
        """
        header = Header(model or self._header.model, self._header.segment + 1)
        try:
            begun = _prepare(self._disk, header, snapshot)
        except OSError as error:
            raise Unwritten(f"no new segment of the journal can be begun: {error.strerror or error}") from error
        try:
            self._disk.rename(_name(header.segment) + _UNFINISHED, _name(header.segment))
        except OSError as error:
            self._broken = f"the new segment of the journal cannot be named: {error.strerror or error}"
            raise Unwritten(self._broken) from error
        self._header, self._begun, self._end, self._checksum = header, begun.end, begun.end, begun.checksum
        self._broken = None
        self._tidy()

    def close(self) -> None:
        self._disk.close()

    def _tidy(self) -> None:
        """Remove what the newest segment stands for. What stays now goes next time: only the newest is ever read."""
        with suppress(OSError):
            for name in self._disk.names():
                if _NAME.fullmatch(name.removesuffix(_UNFINISHED)) and name != _name(self._header.segment):
                    self._disk.remove(name)


def _prepare(disk: Disk, header: Header, records: Sequence[bytes]) -> Sound:
    """A new segment, complete but for its name."""
    start, checksum = opening(header)
    framed, checksum = _framed(records, checksum)
    unfinished = _name(header.segment) + _UNFINISHED
    disk.create(unfinished)
    disk.append(unfinished, start + framed)
    disk.sync(unfinished)
    return Sound(header, tuple(records), len(start) + len(framed), checksum)


def _framed(records: Sequence[bytes], checksum: int) -> tuple[bytes, int]:
    frames = []
    for record in records:
        framed, checksum = frame(record, checksum)
        frames.append(framed)
    return b"".join(frames), checksum


def _name(segment: int) -> str:
    return f"{segment:08}.journal"


def _understood(reading: Sound | Torn | Damaged, name: str, model: str, segment: int) -> Sound:
    match reading:
        case Damaged(offset, record, reason):
            begun_anew = f"to begin anew, move '{name}' away"
            kept = f"; to give up what follows, keep a copy and cut it there: truncate -s {offset} {name}" if record else ""
            raise Refused(f"{name}: damaged at byte {offset} (record {record}): {reason} ({begun_anew}{kept})")
        case Torn(before):
            sound = before
        case Sound():
            sound = reading
    if sound.header.model != model:
        was = sound.header.model[:12]
        raise Refused(
            f"{name}: it was written for another model ({was}...), not for {model[:12]}... (move it away to begin anew)"
        )
    if sound.header.segment != segment:
        raise Refused(f"{name}: it says that it is segment {sound.header.segment} (somebody has renamed it; give it its name)")
    return sound


class Folder:
    """A folder of a real file system, made if it is not there, for one process at a time."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Raises Refused if another process has it, Unwritten if it cannot be had."""
        self._path = os.fspath(path)
        self._open: dict[str, int] = {}
        try:
            os.makedirs(self._path, exist_ok=True)
            self._folder = os.open(self._path, os.O_RDONLY | os.O_DIRECTORY)
        except OSError as error:
            raise Unwritten(f"'{self._path}' cannot be used for a journal: {error.strerror}") from error
        try:
            fcntl.flock(self._folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            os.close(self._folder)
            raise Refused(f"the journal in '{self._path}' is in use by another process") from error

    def names(self) -> Sequence[str]:
        return sorted(os.listdir(self._folder))

    def read(self, name: str) -> bytes:
        with open(os.open(name, os.O_RDONLY, dir_fd=self._folder), "rb") as file:
            return file.read()

    def create(self, name: str) -> None:
        self._forget(name)
        self._open[name] = os.open(name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND, 0o644, dir_fd=self._folder)

    def append(self, name: str, data: bytes) -> None:
        rest = memoryview(data)
        while rest:
            rest = rest[os.write(self._handle(name), rest) :]

    def cut(self, name: str, size: int) -> None:
        os.ftruncate(self._handle(name), size)

    def sync(self, name: str) -> None:
        os.fsync(self._handle(name))

    def rename(self, name: str, to: str) -> None:
        os.rename(name, to, src_dir_fd=self._folder, dst_dir_fd=self._folder)
        if name in self._open:
            self._forget(to)
            self._open[to] = self._open.pop(name)
        os.fsync(self._folder)

    def remove(self, name: str) -> None:
        self._forget(name)
        os.remove(name, dir_fd=self._folder)

    def close(self) -> None:
        for name in list(self._open):
            self._forget(name)
        os.close(self._folder)

    def _handle(self, name: str) -> int:
        if name not in self._open:
            self._open[name] = os.open(name, os.O_WRONLY | os.O_APPEND, dir_fd=self._folder)
        return self._open[name]

    def _forget(self, name: str) -> None:
        if name in self._open:
            os.close(self._open.pop(name))
