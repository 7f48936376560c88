"""One event being worked off: the situation so far, what is to be done about it so far, and what everything here is made of.

`step` makes a `Turn` and hands it from module to module; nobody keeps it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from smv_planner.lazy import replace
from smv_planner.model.domains import Value
from smv_planner.model.ltl import progressed
from smv_planner.model.system import State
from smv_planner.runner.decision import Cause, Purpose
from smv_planner.runner.events import Note, Output
from smv_planner.runner.situation import Situation, Station

_GRAVITY = (Cause.PROGRESS, Cause.RESUMED, Cause.CHANGED, Cause.DEVIATION, Cause.TIMEOUT, Cause.LOST, Cause.FORBIDDEN)


class Turn:
    """`excused` are resources whose goals change by automatic transitions, or by hand: no plan has asked for it (see `gate`)."""

    def __init__(self, station: Station, now: Situation) -> None:
        self.station, self.model, self.system = station, station.model, station.system
        self.now = now
        self.out: list[Output] = []
        self.excused: set[str] = set()

    def set(self, **changes: object) -> None:
        self.now = self.now.but(**changes)

    def note(self, kind: str, text: str, **data: object) -> None:
        self.out.append(Note(kind, text, data))

    # --- whether the planners have to be asked --------------------------------------------------------------

    def need(self, cause: Cause, blamed: Iterable[str] = ()) -> None:
        """The planners have to be asked; the gravest cause counts."""
        known = self.now.cause
        if known is None or _GRAVITY.index(cause) > _GRAVITY.index(known):
            self.set(cause=cause)
        if blamed:
            self.set(blamed=self.now.blamed.union(blamed))

    def look_again(self) -> None:
        """Something has changed that may make possible what was not."""
        if not self.now.recheck:
            self.set(recheck=True)
        following = self.now.following
        if self.now.broken and not (following and following.purpose is Purpose.EXIT):
            self.need(Cause.FORBIDDEN)

    @property
    def thinking(self) -> bool:
        """Whether the planners think about how to go on; a mere look at what is in error holds nothing up."""
        return self.now.asked is not None and not self.now.asked.recheck

    @property
    def under_way(self) -> bool:
        """Whether anything is being done, or about to be, that a surprise may spoil."""
        return bool(self.now.following or self.now.executing or self.thinking)

    # --- what is believed -----------------------------------------------------------------------------------

    def believe(self, values: Mapping[str, Value]) -> None:
        """Put values into the state; everything that depends on decision variables follows."""
        state = list(self.now.state)
        for name, value in values.items():
            state[self.system.index[name]] = value
        self.reach(tuple(state))

    def reach(self, state: State) -> None:
        """The next state; what the intentions owe moves on when a decision variable changes.

        An effect that is not enabled here starts anew when it is, even if that is at once (section 4.1).
        """
        before = self.now.state
        if state == before:
            return
        owed = [n for n, p in self.now.intentions.items() if p.owed is not None]
        timers = {name: since for name, since in self.now.timers.items() if self.station.enabled[name](state)}
        self.set(state=state, timers=timers)
        if not owed:
            return
        old, new = self.station.decisions(before), self.station.decisions(state)
        if old != new:
            index = self.station.decision_index
            pursuits = dict(self.now.intentions)
            for name in owed:
                formula = pursuits[name].owed
                assert formula is not None
                pursuits[name] = replace(pursuits[name], owed=progressed(formula, old, index))
            self.set(intentions=pursuits)
