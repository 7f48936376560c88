"""Execution cases played with real processes: the same cases, the same outcome declared as in simulation."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from daemon.stations import PATIENCE, Station, station

from bridge import keys
from smv_planner.model.domains import Value, show_value
from smv_planner.model.expressions import meaning
from smv_planner.model.system import VariableKind
from smv_planner.runner.decision import Action
from smv_planner.runner.events import Note
from smv_planner.simulate.play import Record
from smv_planner.simulate.script import Case, Entry


@dataclass
class Played:
    """A case on a station of real processes. What it tells happens when its time has come, `pace` times as fast."""

    station: Station
    case: Case
    pace: float
    record: Record = field(default_factory=Record)

    def __post_init__(self) -> None:
        self._states = self.station.link.latest(keys.state(self.station.cell))
        self._values: dict[str, Value] = {}
        self._taken = 0
        self._coming = list(self.case.when)
        self._due: list[tuple[float, Entry]] = []

    def run(self) -> list[str]:
        """What came otherwise than the case declares."""
        began, wanted = time.monotonic(), self.case.then.intentions
        for each in [*self._coming]:
            if each.after is None and each.once is None:
                self._begin(each)
        while time.monotonic() - began < PATIENCE + self.case.then.within / self.pace:
            self._look()
            over = all(self.record.intentions.get(name, "initial") == status for name, status in wanted.items())
            if over and not self._coming and not self._due:
                break
            time.sleep(0.003)
        return self._differences()

    def _look(self) -> None:
        events = self.station.heard()
        for event in events[self._taken :]:
            self.record.take(note(event))
        self._taken = len(events)
        for _, payload in self._states.drain():
            message = json.loads(payload)
            self._values.update({**message["measured"], **message["mirror"]})
        index = self.station.model.system.index
        for each in [*self._coming]:
            if each.after is not None and each.after in self.record.seen:
                self._begin(each)
            if each.once is not None and self._once(meaning(each.once, index)):
                self._begin(each)
        for due, each in [*self._due]:
            if time.monotonic() >= due:
                self._due.remove((due, each))
                self._happen(each)

    def _once(self, judge: Callable[[tuple[Value, ...]], Any]) -> bool:
        variables = self.station.model.system.variables
        return bool(judge(tuple(self._values.get(v.name, v.initial) for v in variables))) if self._values else False

    def _begin(self, each: Entry) -> None:
        self._coming.remove(each)
        self._due.append((time.monotonic() + each.delay / self.pace, each))

    def _happen(self, each: Entry) -> None:
        times = "" if each.times is None else f":{each.times}"
        for effect in each.fail:
            self._tell_all(effect, f"fail={effect}{times}")
        for effect, other in each.instead.items():
            self._tell_all(effect, f"instead={effect}:{other}{times}")
        for word, names in (("dead", each.dead), ("silent", each.silent), ("stuck", each.stuck)):
            for name in names:
                self.station.tell(name, word)
        kinds = {v.name: v for v in self.station.model.variables}
        told = {name: value for name, value in each.set.items() if kinds[name].kind is not VariableKind.MEASURED}
        for name, value in each.set.items():
            if name not in told:
                self.station.tell(str(kinds[name].resource), f"set={name}:{show_value(value)}")
        if told:
            assert self.station.say(keys.order, {"order": "set", "values": told})
        rest = each.well, each.lying, each.restart, each.activate, each.pause, each.cancel, each.reenable, each.operator
        assert not any(rest), "the player of real processes does not know that"

    def _tell_all(self, effect: str, words: str) -> None:
        transition = self.station.model.system.transition[effect]
        owner = self.station.model.system.resources
        for name in sorted({str(owner[variable]) for variable in transition.assigned}):
            self.station.tell(name, words)

    def _differences(self) -> list[str]:
        then, record = self.case.then, self.record
        situation = self.station.situation()
        assert situation
        # At this pace something may come about while the planners think; then they are simply asked again.
        actions = [action.name for action in record.recovery if action.name != "TP" or "TP" in (then.actions or ())]
        told: dict[str, tuple[object, object]] = {
            "actions": (tuple(actions), then.actions),
            "operator": (tuple(record.operator), then.operator),
            "failed": (tuple(record.failed), then.failed),
            "final": ({name: situation["state"][name] for name in then.final}, then.final),
            "intentions": ({name: record.intentions.get(name, "initial") for name in then.intentions}, then.intentions),
        }
        found = [f"{name} is {got}, not {want}" for name, (got, want) in told.items() if want is not None and got != want]
        started = iter(record.operations)
        if not all(name in started for name in then.operations):
            found.append(f"the operations are not in this order: {record.operations}")
        return found + [f"'when' has not come: {each}" for each in self._coming]


def note(event: dict[str, Any]) -> Note:
    """An event that was published, as the runner noted it."""
    data = dict(event["data"])
    if event["event"] == "decision":
        data["actions"] = tuple(Action(**action) for action in data["actions"])
    return Note(event["event"], event["text"], data)


@contextmanager
def playing(endpoint: str, folder: Path, case: Case, pace: float) -> Iterator[Played]:
    with station(endpoint, folder, f"play_{case.name}", given=case.given) as found:
        played = Played(found, case, pace)
        found.hubs(pace=pace)
        found.operator()
        found.planner()
        yield played
