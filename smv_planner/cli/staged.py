"""An execution case played on real processes: what it tells happens to emulated hubs and to the planner when its time has come.

Delays of the case are divided by the pace at which the devices run. How long planners think, and after how long a hub counts
as silent, is not: at a high pace a case may go another way than in virtual time.
"""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from typing import Any

from bridge import keys
from bridge.link import Link
from smv_planner.cli.asking import Events
from smv_planner.errors import Mistake, UsageError
from smv_planner.lazy import dataclass, field, fields
from smv_planner.model.domains import Value, show_value
from smv_planner.model.expressions import meaning
from smv_planner.model.model import Model
from smv_planner.model.system import VariableKind
from smv_planner.plant.serve import tell
from smv_planner.protocol.interface import interfaces
from smv_planner.protocol.messages import StateMessage, decode_state
from smv_planner.runner.decision import Action
from smv_planner.runner.events import Note
from smv_planner.simulate.play import Record
from smv_planner.simulate.script import Case, Entry

UNKNOWN = ("well", "lying", "restart", "activate", "pause", "cancel", "reenable", "proceed", "operator", "planner_killed")
"""What entries may say and cannot be done here."""


@dataclass
class Staged:
    """`record` has what came of it so far. Raises UsageError for a case that needs more than can be done here."""

    link: Link
    cell: str
    model: Model
    case: Case
    pace: float
    record: Record = field(default_factory=Record)

    def __post_init__(self) -> None:
        asked = [word for each in self.case.when for word in UNKNOWN if getattr(each, word)]
        if asked:
            raise UsageError([Mistake(f"'{asked[0]}' of case '{self.case.name}' can be played in virtual time only")])
        self._hubs = {keys.state(self.cell, name): each for name, each in interfaces(self.model, self.cell).items()}
        self._states = self.link.latest(*self._hubs)
        self._events = Events(self.link, self.cell)
        self._values: dict[str, Value] = {}
        self._due: list[tuple[float, Entry]] = []
        self.coming = list(self.case.when)
        for each in [*self.coming]:
            if each.after is None and each.once is None:
                self._begin(each)

    @property
    def over(self) -> bool:
        """All that was told has happened, and the intentions are as declared."""
        wanted = self.case.then.intentions
        there = all(self.record.intentions.get(name, "initial") == status for name, status in wanted.items())
        return there and not self.coming and not self._due

    def look(self) -> Sequence[dict[str, Any]]:
        """Take in what has happened, and do what is due; the new events."""
        events = self._events.new()
        for event in events:
            self.record.take(_note(event))
        for key, payload in self._states.drain():
            message = decode_state(payload, self._hubs[key]) if key in self._hubs else None
            if isinstance(message, StateMessage):
                self._values.update({**message.measured, **message.mirror})
        for each in [*self.coming]:
            if each.after in self.record.seen or self._once(each):
                self._begin(each)
        for due, each in [*self._due]:
            if time.monotonic() >= due:
                self._due.remove((due, each))
                self._happen(each)
        return events

    def _once(self, each: Entry) -> bool:
        if each.once is None or not self._values:
            return False
        system = self.model.system
        return bool(meaning(each.once, system.index)(tuple(self._values.get(v.name, v.initial) for v in system.variables)))

    def _begin(self, each: Entry) -> None:
        self.coming.remove(each)
        self._due.append((time.monotonic() + each.delay / self.pace, each))

    def _happen(self, each: Entry) -> None:
        times = "" if each.times is None else f":{each.times}"
        for effect in each.fail:
            self._tell_all(effect, f"fail={effect}{times}")
        for effect, other in each.instead.items():
            self._tell_all(effect, f"instead={effect}:{other}{times}")
        for word, names in (("dead", each.dead), ("silent", each.silent), ("stuck", each.stuck)):
            for name in names:
                tell(self.link, self.cell, name, [word])
        variables = {v.name: v for v in self.model.variables}
        told = {name: value for name, value in each.set.items() if variables[name].kind is not VariableKind.MEASURED}
        for name, value in each.set.items():
            if name not in told:
                tell(self.link, self.cell, str(variables[name].resource), [f"set={name}:{show_value(value)}"])
        if told:
            self.link.ask(keys.order(self.cell), json.dumps({"order": "set", "values": told}).encode(), timeout=10.0)

    def _tell_all(self, effect: str, words: str) -> None:
        """Tell every device in which an effect happens."""
        owner, transition = self.model.system.resources, self.model.system.transition[effect]
        for name in sorted({str(owner[variable]) for variable in transition.assigned}):
            tell(self.link, self.cell, name, [words])


def _note(event: dict[str, Any]) -> Note:
    """An event that was published, as the runner noted it. Its data is as the schema says: `heard` has seen to that."""
    data = dict(event["data"])
    if event["event"] == "decision":
        names = [each.name for each in fields(Action)]
        data["actions"] = tuple(Action(**{name: action[name] for name in names}) for action in data["actions"])
    return Note(event["event"], event["text"], data)
