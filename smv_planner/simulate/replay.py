"""A journal told again: its events through the same `step`, and its decisions made anew from the same questions.

What an engine answered is in the journal. If the planners come to something else now, that is told; the story goes on with
what is written.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from smv_planner.errors import Mistake, UsageError
from smv_planner.journal import Damaged, Torn, read
from smv_planner.lazy import dataclass, replace
from smv_planner.runner.decision import Decision, Request
from smv_planner.runner.events import Answered, Ask, Note, Output
from smv_planner.runner.records import Known, entry, record
from smv_planner.runner.situation import Situation, Station, at_rest
from smv_planner.runner.step import step

_SEGMENT = re.compile(r"\d{8}\.journal")


@dataclass(frozen=True, slots=True)
class Told:
    """What came of one event. `again` is what the planners decide now about a question that was answered otherwise."""

    situation: Situation
    outputs: tuple[Output, ...] = ()
    answered: Answered | None = None
    again: Decision | None = None

    @property
    def notes(self) -> list[Note]:
        return [output for output in self.outputs if isinstance(output, Note)]


def segments(folder: Path) -> list[Path]:
    """The files of a journal, oldest first. Raises UsageError if there are none."""
    found = sorted(path for path in folder.glob("*.journal") if _SEGMENT.fullmatch(path.name))
    if not found:
        raise UsageError([Mistake(f"there is no journal in '{folder}'", "it is a folder with files as 00000001.journal")])
    return found


def payloads(folder: Path, station: Station) -> tuple[bytes, ...]:
    """The records of a journal's newest segment; a torn end is left out. Raises UsageError if it is not one of this model."""
    *_, newest = segments(folder)
    found = read(newest.read_bytes())
    if isinstance(found, Damaged):
        where = f"from byte {found.offset} on, in record {found.record}: {found.reason}"
        raise UsageError([Mistake(f"'{newest}' is damaged {where}")])
    sound = found.before if isinstance(found, Torn) else found
    if sound.header.model != station.model.hash:
        raise UsageError([Mistake(f"'{newest}' is the journal of another model than '{station.model.name}'")])
    return sound.records


def replay(
    station: Station, known: Known, records: Sequence[bytes], decide: Callable[[Request], Decision] | None = None
) -> Iterator[Told]:
    """Event by event. With `decide`, every decision is made once more."""
    now = at_rest(station)
    asked: dict[int, Request] = {}
    for payload in records:
        match entry(payload, known):
            case Situation() as situation:
                now = situation
                yield Told(now)
            case event:
                again = None
                if isinstance(event, Answered) and decide is not None and event.revision in asked:
                    decision = decide(asked[event.revision])
                    again = None if _same(event, decision) else decision
                now, outputs = step(station, now, event)
                asked |= {output.revision: output.request for output in outputs if isinstance(output, Ask)}
                yield Told(now, outputs, event if isinstance(event, Answered) else None, again)


def _same(answered: Answered, decision: Decision) -> bool:
    """Whether a decision is the one that was recorded, whatever time it took."""
    return record(_timeless(answered)) == record(_timeless(replace(answered, decision=decision)))


def _timeless(answered: Answered) -> Answered:
    actions = tuple(replace(action, seconds=0.0) for action in answered.decision.actions)
    return replace(answered, decision=replace(answered.decision, actions=actions))
