"""The mirror monitor: whether every commanded field comes back in the state messages of its resource (FAIM 5.3).

It belongs to nobody whom it watches. It listens to goals and states alike and judges each field alone: a field has to be
mirrored within `limit` seconds after it was commanded, and stay so.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from smv_planner.model.domains import Value
from smv_planner.protocol.messages import GoalMessage, StateMessage


@dataclass(frozen=True, slots=True)
class Watched:
    """One resource. `differs_since` has the fields whose mirror is not what is commanded, and since when that is so."""

    goal: GoalMessage | None = None
    state: StateMessage | None = None
    differs_since: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Unmirrored:
    resource: str
    name: str
    commanded: Value
    mirrored: Value | None
    since: float


@dataclass(frozen=True, slots=True)
class Mirrors:
    """Everything heard so far. `late` are the fields that were told of, once until they are mirrored again."""

    limit: float = 1.0
    resources: Mapping[str, Watched] = field(default_factory=dict)
    late: frozenset[tuple[str, str]] = frozenset()


def hear(mirrors: Mirrors, message: GoalMessage | StateMessage, at: float) -> Mirrors:
    """A goal of an older reign changes nothing: hubs refuse it, and rightly so."""
    name = name_of(message)
    watched = mirrors.resources.get(name, Watched())
    match message:
        case GoalMessage():
            now = watched.goal
            if now and (message.epoch, message.seq) < (now.epoch, now.seq):
                return mirrors
            told = {each for each, value in message.values.items() if now is None or now.values.get(each) != value}
            watched = replace(watched, goal=message)
            return _with(mirrors, name, _compared(watched, at, told))
        case StateMessage():
            return _with(mirrors, name, _compared(replace(watched, state=message), at, set()))


def name_of(message: GoalMessage | StateMessage) -> str:
    """By which name a resource is watched: several cells may have one of the same name."""
    return f"{message.cell}/{message.resource}"


def judge(mirrors: Mirrors, at: float) -> tuple[Mirrors, tuple[Unmirrored, ...]]:
    """What has just become late, in the order in which resources were heard and fields declared."""
    found = []
    late = set()
    for resource, watched in mirrors.resources.items():
        for name, since in watched.differs_since.items():
            if at - since <= mirrors.limit or watched.goal is None:
                continue
            late.add((resource, name))
            if (resource, name) not in mirrors.late:
                mirrored = watched.state.mirror.get(name) if watched.state else None
                found.append(Unmirrored(resource, name, watched.goal.values[name], mirrored, since))
    return replace(mirrors, late=frozenset(late)), tuple(found)


def _compared(watched: Watched, at: float, told: set[str]) -> Watched:
    """`told` are the fields that have just got another command: they have their time again."""
    goal = watched.goal.values if watched.goal else {}
    mirror = watched.state.mirror if watched.state else {}
    since = {
        name: at if name in told else watched.differs_since.get(name, at)
        for name, value in goal.items()
        if name not in mirror or mirror[name] != value or type(mirror[name]) is not type(value)
    }
    return replace(watched, differs_since=since)


def _with(mirrors: Mirrors, resource: str, watched: Watched) -> Mirrors:
    return replace(mirrors, resources={**mirrors.resources, resource: watched})
