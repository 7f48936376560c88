"""Measured changes against effects: was this planned, was it another enabled effect, or does nothing explain it?

Also the clocks of effects: an effect that is enabled for longer than its `within` has timed out (Machines 2021, 4.1).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence

from smv_planner.model.semantics import fire
from smv_planner.model.system import State, Transition
from smv_planner.runner.situation import Situation, Station

LONGEST = 4
"""So many effects of one resource may lie between two of its messages."""


def explained(station: Station, resource: str, before: State, after: State, first: Sequence[str]) -> tuple[str, ...] | None:
    """The shortest row of enabled effects that accounts for the change of a resource's measured variables, or None.

    Of several rows, one that begins with effects in `first` is preferred. Only what an effect does to this resource counts:
    another resource reports its share itself.
    """
    own = [station.system.index[variable.name] for variable in station.measured[resource]]
    effects = sorted(
        station.effects_on[resource], key=lambda effect: first.index(effect.name) if effect.name in first else len(first)
    )
    target = tuple(after[at] for at in own)
    seen = {tuple(before[at] for at in own)}
    waiting: deque[tuple[State, tuple[str, ...]]] = deque([(before, ())])
    while waiting:
        state, row = waiting.popleft()
        for effect in effects:
            for outcome in fire(station.system, effect, state):
                reached = list(state)
                for at in own:
                    reached[at] = outcome[at]
                share = tuple(reached[at] for at in own)
                if share == target:
                    return (*row, effect.name)
                if share not in seen and len(row) + 1 < LONGEST:
                    seen.add(share)
                    waiting.append((tuple(reached), (*row, effect.name)))
    return None


def clocks(station: Station, now: Situation) -> Mapping[str, float]:
    """Since when each effect with a time limit is enabled; one that is not, or that cannot be observed, has no clock."""
    state, timers, at = now.state, now.timers, now.at
    return {
        name: timers.get(name, at)
        for name in station.begun(state)
        if name not in now.disabled and _observable(station, now, name)
    }


def overdue(station: Station, now: Situation) -> tuple[str, ...]:
    """The effects whose time is up."""
    late = []
    for name, since in now.timers.items():
        within = station.system.transition[name].within
        if within is not None and now.at - since > within:
            late.append(name)
    return tuple(late)


def _observable(station: Station, now: Situation, name: str) -> bool:
    if not now.lost:
        return True
    effect: Transition = station.system.transition[name]
    touched = {station.system.resources[variable] for variable in effect.assigned} | {effect.resource}
    return touched.isdisjoint(now.lost)
