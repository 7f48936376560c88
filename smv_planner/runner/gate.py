"""The last look at a command before it leaves (Simplex: a simple, verified monitor behind a complex planner).

Whatever the runner and the planners believe, no goal value passes that is out of its domain, that changes for a resource
which is not there to obey, or that brings the station, or lets it slide, into a forbidden state.
"""

from __future__ import annotations

from collections.abc import Mapping

from smv_planner.model.domains import Value
from smv_planner.runner.decision import Following, Purpose
from smv_planner.runner.situation import Phase, Situation, Station


def refused(station: Station, now: Situation, resource: str, values: Mapping[str, Value], excused: bool) -> str | None:
    """Why new goal values of a resource must not be sent; None if they may.

    `excused` are values that no plan has asked for: those of automatic transitions, which nothing may hold back, and those
    of a device that was moved by hand.
    """
    interface = station.interfaces[resource]
    if set(values) != set(interface.goals):
        return f"the goal state of '{resource}' is not whole"
    for name, value in values.items():
        if value not in interface.goals[name]:
            return f"{value!r} is no value of '{name}'"
    if now.phase is Phase.FENCED_OUT or now.phase is Phase.LISTENING or now.phase is Phase.STOPPED:
        return f"nothing may be sent while {now.phase.value}"
    if now.phase is Phase.JOINING:
        view = now.hubs[resource]
        if view.state is not None and dict(view.state.mirror) != dict(values):
            return f"'{resource}' has not taken on the new epoch yet"
        return None
    if excused:
        return None
    if resource in now.lost:
        return f"'{resource}' is not there to obey"
    told = now.hubs[resource].commanded
    held = tuple(told.get(v.name, value) for v, value in zip(station.system.variables, now.state, strict=True))
    broken = station.broken(now.state) - station.broken(held) - _lifted(now.following)
    if broken:
        return f"'{min(broken)}' would be violated, or could be without any further command"
    return None


def _lifted(following: Following | None) -> frozenset[str]:
    return following.lifted if following and following.purpose is Purpose.EXIT else frozenset()
