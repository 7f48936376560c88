"""Progress on standard error for whatever takes longer than a second."""

from __future__ import annotations

import sys
import time

QUIET = 1.0
"""Seconds before anything is shown."""


class Progress:
    """Called with what is being done. On a terminal one line that renews itself, elsewhere a line now and then."""

    def __init__(self) -> None:
        self._began = time.monotonic()
        self._live = sys.stderr.isatty()
        self._every = 0.1 if self._live else 5.0
        self._next = self._began + QUIET
        self._width = 0

    def __call__(self, text: str) -> None:
        now = time.monotonic()
        if now < self._next:
            return
        self._next = now + self._every
        line = f"{now - self._began:.0f} s: {text}"
        if self._live:
            print(f"\r{line:<{self._width}}", end="", file=sys.stderr, flush=True)
            self._width = len(line)
        else:
            print(line, file=sys.stderr, flush=True)

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        if self._width:
            print(f"\r{'':<{self._width}}\r", end="", file=sys.stderr, flush=True)
