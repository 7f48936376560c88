"""A small file beside the journal that says how the daemon is: for who asks on the same machine and no other planner.

It is written whole each second and when something changes, and is believed as long as it says. So whatever stops the loop is
noticed, a full disk included, and a router is not needed to find out.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

FILE = "status.json"
EVERY = 1.0

_MATTERS = ("planner", "epoch", "phase", "wrong", "waiting")


class Status:
    """What is written. The clock is that of the machine, which all its processes share."""

    def __init__(self, folder: str, counts: float, clock: Callable[[], float] = time.monotonic) -> None:
        """`counts` seconds after its time the next one is missing."""
        self._file = Path(folder) / FILE
        self._counts, self._clock = EVERY + counts, clock
        self._told: tuple[Any, ...] = ()
        self._due = clock()
        self.clear()  # of the process before

    def tell(self, health: Mapping[str, Any]) -> None:
        """Called each tick. What cannot be written grows old, which says enough."""
        now, told = self._clock(), tuple(health[name] for name in _MATTERS)
        if now < self._due and told == self._told:
            return
        self._due, self._told = now + EVERY, told
        unfinished = self._file.with_suffix(".unfinished")
        with suppress(OSError):
            unfinished.write_text(json.dumps({**health, "written": now, "counts_for": self._counts}), encoding="ascii")
            os.replace(unfinished, self._file)

    def clear(self) -> None:
        with suppress(OSError):
            self._file.unlink(missing_ok=True)


def found(folder: str | os.PathLike[str], clock: Callable[[], float] = time.monotonic) -> dict[str, Any] | None:
    """What the daemon says that has its journal there, with `wrong` as it looks from here; None if it never ran or has ended.

    It is `current` if it still counts.
    """
    try:
        said: dict[str, Any] = json.loads((Path(folder) / FILE).read_text(encoding="ascii"))
        age, counts = clock() - said.pop("written"), float(said.pop("counts_for"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, AttributeError, TypeError) as error:
        return unwell(f"the status in '{folder}' cannot be read: {error}")
    said["current"] = 0 <= age <= counts
    if not said["current"]:  # less than nothing: the machine has been started anew
        old = f"it said so {age:.1f} s ago" if age > 0 else "it said so before this machine was started"
        said["wrong"] = [*said["wrong"], f"nothing new is heard of the planner, {old}: it was killed, hangs, or cannot write"]
        said["healthy"], said["waiting"] = False, []
    said["tick_age"] = round(said["tick_age"] + max(0.0, age), 3)
    return said


def unwell(why: str) -> dict[str, Any]:
    """What is to be said of a daemon that says nothing itself."""
    return {"healthy": False, "current": False, "waiting": [], "wrong": [why]}


def all_below(folder: str | os.PathLike[str]) -> dict[str, dict[str, Any]]:
    """What the daemons say that run and have their journals in folders of this one, by folder; if none runs, those that died."""
    places = sorted(file.parent for file in Path(folder).glob(f"*/{FILE}"))
    told = {str(place): said for place in places if (said := found(place)) is not None}
    return {place: said for place, said in told.items() if said["current"]} or told
