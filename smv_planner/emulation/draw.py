"""Chance as a value: a number for every path of names, the same in every process."""

from __future__ import annotations

from hashlib import blake2b

from smv_planner.lazy import dataclass


@dataclass(frozen=True, slots=True)
class Draw:
    """Numbers from a seed. Nothing is used up: who asks for the same path gets the same number, in whatever order."""

    seed: int
    path: tuple[str | int, ...] = ()

    def of(self, *path: str | int) -> Draw:
        """The draws below a path, independent of all others."""
        return Draw(self.seed, (*self.path, *path))

    def unit(self, *path: str | int) -> float:
        """A number from 0 to just below 1, uniform."""
        digest = blake2b(repr((self.seed, *self.path, *path)).encode(), digest_size=8).digest()
        return (int.from_bytes(digest, "big") >> 11) / 2**53
