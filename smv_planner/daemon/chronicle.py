"""How the daemon uses its journal: nothing leaves before what it follows from is written.

A turn is written as its events. Those that change nothing but when a hub was heard last need not survive a power cut: the
situation without them is one in which hubs seem silent a little earlier, and a planner that begins asks them anew anyway.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

from smv_planner.journal import Disk, Journal, Unwritten
from smv_planner.journal.folder import LIMIT
from smv_planner.lazy import dataclass
from smv_planner.runner.events import Answered, Began, Event, Ordered, Output, Send
from smv_planner.runner.records import Known, record, restored
from smv_planner.runner.situation import Situation, Station


@dataclass
class Chronicle:
    """The journal of one daemon. `trouble` says why the last turn could not be written."""

    journal: Journal
    trouble: str | None = None

    def write(self, before: Situation, after: Situation, events: Sequence[Event], outputs: Sequence[Output]) -> bool:
        """Whether the turn is in the journal; if not, it must not count."""
        try:
            if self.journal.full:
                try:
                    self.journal.anew([record(before)])
                except Unwritten:
                    if self.journal.broken:
                        raise
            self.journal.write([record(event) for event in events], durable=_matters(before, after, events, outputs))
        except Unwritten as error:
            self.trouble = str(error)
            return False
        self.trouble = None
        return True

    def close(self, now: Situation) -> None:
        """Leave one record that stands for all, so that the next start is quick. What stands already will do as well."""
        with suppress(Unwritten):
            self.journal.anew([record(now)])

    def become(self, model: str, begun: Situation) -> None:
        """Go on for another model, with the situation that it begins in. Raises Unwritten."""
        self.journal.anew([record(begun)], model)


def opened(disk: Disk, station: Station, known: Known, begun: Situation, limit: int = LIMIT) -> tuple[Chronicle, Situation, int]:
    """The journal to go on with, what it tells, and how many bytes a crash has torn off. A new one begins with `begun`.

    Raises Refused, Unwritten, Unreadable.
    """
    found = Journal.open(disk, station.model.hash, limit)
    if not found.records:
        found.journal.write([record(begun)])
    return Chronicle(found.journal), restored(station, begun, found.records, known), found.torn


def _matters(before: Situation, after: Situation, events: Sequence[Event], outputs: Sequence[Output]) -> bool:
    """Whether a power cut must not undo it: something came from outside, or more was put out than the same commands again."""
    told = any(isinstance(event, Began | Answered | Ordered) for event in events)
    return told or before.sequence != after.sequence or any(not isinstance(output, Send) for output in outputs)
