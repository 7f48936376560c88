"""A scenario that has changed while the daemon runs: what differs, and what of the situation still means something."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from smv_planner.lazy import replace
from smv_planner.model.model import Model
from smv_planner.runner.recovery import promised
from smv_planner.runner.situation import Pursuit, Situation, Status


def changes(old: Model, new: Model) -> Iterator[str]:
    """One line for each thing that is new, gone or different, in declared order."""
    kinds: dict[str, tuple[Sequence[Any], Sequence[Any]]] = {
        "resource": (old.resources, new.resources),
        "variable": (old.variables, new.variables),
        "transition": (old.transitions, new.transitions),
        "invariant": (old.invariants, new.invariants),
        "operation": (old.operations, new.operations),
        "intention": (old.intentions, new.intentions),
    }
    for kind, (before, after) in kinds.items():
        was, now = {one.name: one for one in before}, {one.name: one for one in after}
        for name in now:
            if name not in was:
                yield f"{kind} '{name}' is new"
            elif was[name] != now[name]:
                yield f"{kind} '{name}' is different"
        yield from (f"{kind} '{name}' is gone" for name in was if name not in now)


def moved(new: Model, now: Situation, old: Model) -> Situation:
    """The situation to begin with under a new model: values that still fit, and what was intended.

    Plans, failures and what was asked of the operator belong to the old one.
    """
    values = old.system.named(now.state)
    state = tuple(values[v.name] if v.name in values and values[v.name] in v.domain else v.initial for v in new.system.variables)
    pursuits = {}
    for intention in new.intentions:
        was = now.intentions.get(intention.name, Pursuit())
        match was.status:
            case Status.EXECUTING | Status.PAUSED | Status.ERROR:
                status = Status.PAUSED if was.status is Status.PAUSED else Status.EXECUTING
                pursuits[intention.name] = Pursuit(status, promised(new, intention.name))
            case _:
                pursuits[intention.name] = replace(was, owed=None, reason="")
    return Situation(at=now.at, state=state, epoch=now.epoch, intentions=pursuits, revision=now.revision, wished=now.wished)
