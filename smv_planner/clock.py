"""The time that a question has: whatever may take long looks at it, and is left at once when it is up.

Every stage is left by an exception where nothing half done is kept, so that the next question finds what was finished.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

InTime = Callable[[], bool]

_watches: ContextVar[tuple[InTime, ...]] = ContextVar("watches", default=())


class Over(Exception):
    """The time is up."""


@contextmanager
def watched(in_time: InTime) -> Iterator[None]:
    """For as long as this lasts, whoever looks at the clock goes on only if `in_time` says so; and those asked before it."""
    token = _watches.set((*_watches.get(), in_time))
    try:
        yield
    finally:
        _watches.reset(token)


def look() -> None:
    """Raises `Over` if the time is up."""
    for in_time in _watches.get():
        if not in_time():
            raise Over
