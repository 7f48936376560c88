"""Records <-> bytes of one segment, and what is left of a segment after a crash.

A segment is a magic word, then frames: the length of the payload, a checksum of that length, a checksum of the payload,
the payload. Both checksums go on from those of the frame before, so that no frame can be lost, doubled or moved unseen.

A crash leaves the end of the last frame missing, or zeros in its place where the file had grown already. That, and only
that, is a torn tail: payloads end in a byte that is not zero, and the length has a checksum of its own, so that a
flipped bit cannot pass for one. All else is damage, and is not guessed at.
"""

from __future__ import annotations

import json
from struct import Struct
from zlib import crc32

from smv_planner.lazy import dataclass

MAGIC = b"smvjrnl\n"
FORMAT = 1
MAX_RECORD = 64 * 1024 * 1024

_LENGTH = Struct("<I")
_PREFIX = Struct("<III")


@dataclass(frozen=True, slots=True)
class Header:
    """The first record of a segment. `model` is the hash of the model that all records are about."""

    model: str
    segment: int


@dataclass(frozen=True, slots=True)
class Sound:
    """Every byte is as it was written. `end` is their number, and `checksum` where the next frame goes on."""

    header: Header
    records: tuple[bytes, ...]
    end: int
    checksum: int


@dataclass(frozen=True, slots=True)
class Torn:
    """The last record was being written when everything stopped: `before` is what stands without it."""

    before: Sound


@dataclass(frozen=True, slots=True)
class Damaged:
    """From `offset` on nothing can be believed; the record that begins there is the `record`-th, the header being 0."""

    offset: int
    record: int
    reason: str


Reading = Sound | Torn | Damaged


def frame(payload: bytes, checksum: int) -> tuple[bytes, int]:
    """One record's bytes behind a frame that left `checksum`, and the checksum that it leaves itself."""
    assert 0 < len(payload) <= MAX_RECORD
    assert payload[-1], "a payload ends in a byte that is not zero"
    length = _LENGTH.pack(len(payload))
    of_length = crc32(length, checksum)
    of_payload = crc32(payload, of_length)
    return _PREFIX.pack(len(payload), of_length, of_payload) + payload, of_payload


def opening(header: Header) -> tuple[bytes, int]:
    """The first bytes of a segment, and the checksum that they leave."""
    payload = json.dumps({"format": FORMAT, "model": header.model, "segment": header.segment}).encode("ascii")
    framed, checksum = frame(payload, crc32(MAGIC))
    return MAGIC + framed, checksum


def read(data: bytes) -> Reading:
    """All records of a segment, or what is wrong with it."""
    if not data.startswith(MAGIC):
        return Damaged(0, 0, "this is not the beginning of a journal")
    payloads: list[bytes] = []
    at, checksum = len(MAGIC), crc32(MAGIC)
    written = len(data.rstrip(b"\0"))  # behind it nothing was ever written
    while at < len(data):
        body = at + _PREFIX.size
        if len(data) < body:
            break
        length, of_length, of_payload = _PREFIX.unpack_from(data, at)
        if crc32(_LENGTH.pack(length), checksum) != of_length or not 0 < length <= MAX_RECORD:
            if written < body:
                break
            return Damaged(at, len(payloads), "the length of a record is not what was written")
        if written < body + length:
            break
        payload = data[body : body + length]
        if crc32(payload, of_length) != of_payload:
            return Damaged(at, len(payloads), "a record is not what was written")
        payloads.append(payload)
        at, checksum = body + length, of_payload
    if not payloads:
        return Damaged(len(MAGIC), 0, "there is no header")  # segments get their name when they are complete
    header = _header(payloads[0])
    if isinstance(header, str):
        return Damaged(len(MAGIC), 0, header)
    sound = Sound(header, tuple(payloads[1:]), at, checksum)
    return sound if at == len(data) else Torn(sound)


def _header(payload: bytes) -> Header | str:
    try:
        said = json.loads(payload)
        if said["format"] != FORMAT:
            return f"it has format {said['format']!r}, and this program reads {FORMAT}"
        return Header(str(said["model"]), int(said["segment"]))
    except (ValueError, TypeError, LookupError):
        return "the header does not say what it should"
