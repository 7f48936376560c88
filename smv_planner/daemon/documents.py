"""What the planner tells everybody: its situation, its plan, what it asks of the operator, what has just happened.

JSON in ASCII, each document whole, so that whoever has missed one has the next. `at` is in seconds of the planner's own
clock, which goes on over restarts and stands still in between. `schema.py` says the same as JSON Schemas.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, is_dataclass
from enum import Enum
from typing import Any

from smv_planner.runner.decision import Following
from smv_planner.runner.events import Note
from smv_planner.runner.situation import Situation, Station, Status, Wish, WishKind

FORMAT = 1


def situation(station: Station, now: Situation) -> dict[str, Any]:
    """What is known and believed. A value is null while its hub has not spoken."""
    unheard = {v.name for v in station.system.variables if v.resource in now.hubs and v.resource not in now.heard}
    values = station.system.named(now.state)
    return {
        **head("situation", station, now),
        "phase": now.phase.value,
        "state": {name: None if name in unheard else value for name, value in values.items()},
        "resources": {name: _resource(now, name) for name in now.hubs},
        "intentions": {
            name: {"status": pursuit.status.value, **({"reason": pursuit.reason} if pursuit.status is Status.ERROR else {})}
            for name, pursuit in now.intentions.items()
        },
        "executing": [execution.task.name for execution in now.executing],
        "failed": dict(now.failed),
        "disabled": sorted(now.disabled),
        "lost": sorted(now.lost),
        "broken": sorted(now.broken),
        "planning": now.asked.cause.value if now.asked else None,
        "halted": now.halted,
        "stuck": now.stuck,
    }


def plan(station: Station, now: Situation) -> dict[str, Any]:
    """Both levels: the operations that come, and the steps of the transition plan that is followed."""
    course, following = now.course, now.following
    operations = (
        [
            {
                "name": task.name,
                "after": list(course.plan.after[at]),
                "state": "done" if at in course.done else "executing" if at in course.begun else "waiting",
            }
            for at, task in enumerate(course.plan.tasks)
        ]
        if course
        else []
    )
    return {
        **head("plan", station, now),
        "operations": operations,
        "purpose": following.purpose.value if following else None,
        "steps": _steps(following) if following else [],
    }


def operator(station: Station, now: Situation) -> dict[str, Any]:
    """What the operator is asked for: `confirm` when it is done, or `approve`."""
    return {
        **head("operator", station, now),
        "requests": [
            {
                "request": request,
                "kind": wish.kind.value,
                "answer": "confirm" if wish.kind is WishKind.MAINTENANCE else "approve",
                "text": wish.text,
                "transition": wish.transition,
                "values": _made(now, wish),
                "confirmed": wish.confirmed_at is not None,
            }
            for request, wish in now.wishes.items()
        ],
    }


def waiting(now: Situation) -> list[str]:
    """What has to happen outside the planner before it can go on, or go on with everything."""
    told = [f"{how}: {why}" for how, why in (("halted", now.halted), ("stuck", now.stuck)) if why]
    return told + [f"the operator: {wish.text}" for wish in now.wishes.values() if wish.confirmed_at is None]


def event(station: Station, now: Situation, note: Note, number: int) -> dict[str, Any]:
    """Something that has happened. `number` grows by one each time, so that who misses one knows."""
    return {**head("event", station, now), "number": number, "event": note.kind, "text": note.text, "data": plain(note.data)}


def encoded(document: Mapping[str, Any]) -> bytes:
    return json.dumps(document, ensure_ascii=True, allow_nan=False, separators=(",", ":")).encode("ascii")


def plain(value: Any) -> Any:
    """As JSON has it; dataclasses become objects."""
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, Mapping):
        return {str(name): plain(each) for name, each in value.items()}
    if isinstance(value, tuple | list):
        return [plain(each) for each in value]
    if isinstance(value, frozenset):
        return sorted(plain(each) for each in value)
    return value


def _made(now: Situation, wish: Wish) -> dict[str, Any]:
    """What maintenance makes of the variables that it assigns, where the plan has chosen."""
    following = now.following
    if wish.kind is not WishKind.MAINTENANCE or wish.step is None or following is None:
        return {}
    trace, system = following.plan.trace, following.plan.problem.system
    after = system.named(trace.states[wish.step + 1])
    return {action.variable: after[action.variable] for action in system.transition[trace.path[wish.step]].actions}


def head(kind: str, station: Station, now: Situation) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "kind": kind,
        "cell": station.cell,
        "model": station.model.hash,
        "planner": now.planner,
        "epoch": now.epoch,
        "at": round(now.at, 3),
    }


def _resource(now: Situation, name: str) -> dict[str, Any]:
    view = now.hubs[name]
    return {
        "status": "lost" if name in now.lost else "live" if name in now.heard else "unheard",
        "boot": view.state.boot if view.state else None,
        "epoch": view.state.epoch if view.state else None,
        "mirrors": view.state is not None and (not view.commanded or dict(view.state.mirror) == dict(view.commanded)),
    }


def _steps(following: Following) -> list[dict[str, Any]]:
    trace, system = following.plan.trace, following.plan.problem.system
    return [
        {
            "transition": name,
            "kind": system.transition[name].kind.value,
            "changes": plain(system.changes(before, after)),
            "after": list(following.plan.after[at]),
            "done": at in following.done,
        }
        for at, (name, before, after) in enumerate(zip(trace.path, trace.states, trace.states[1:], strict=False))
    ]
