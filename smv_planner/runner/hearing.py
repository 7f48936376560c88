"""Hearing hubs: what a state message means for what is believed, and whether it was planned (section 4.1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from smv_planner.model.domains import Value
from smv_planner.protocol import view as hubs
from smv_planner.protocol.messages import StateMessage
from smv_planner.runner import failures, intentions, monitor, operator, plan_steps, resources, taking_over
from smv_planner.runner.decision import Cause
from smv_planner.runner.situation import Phase
from smv_planner.runner.turn import Turn


def hear(turn: Turn, message: StateMessage) -> bool:
    """Take in a state message; False if it says nothing new."""
    now, name = turn.now, message.resource
    old = now.hubs.get(name)
    if old is None or taking_over.is_deaf(turn):
        return False
    view, heard = hubs.hear(old, message, now.at)
    if not heard.believed:
        count = now.rejected.get(heard.value, 0) + 1
        turn.set(hubs={**now.hubs, name: view}, rejected={**now.rejected, heard.value: count})
        return False
    known = old.state
    turn.set(hubs={**now.hubs, name: view})
    if taking_over.superseded(turn, name):
        return True
    if now.phase not in (Phase.JOINING, Phase.RUNNING):
        return True
    if name not in now.heard or now.phase is Phase.JOINING or (name in now.lost and not view.commanded):
        resources.adopt_mirror(turn, name)
        return True
    if heard is hubs.Heard.REBOOTED:
        turn.note("rebooted", f"the hub of '{name}' has restarted", resource=name)
        resources.adopt_mirror(turn, name)
        turn.need(Cause.DEVIATION, failures.concerned(turn, name))
        return True
    if name in now.lost:
        _measure(turn, name, message.measured)
        resources.may_regain(turn, name)
        return True
    if known is not None and known.measured == message.measured:
        return known.mirror != message.mirror or bool(hubs.stuck(view, turn.station.resources[name].mirror_within))
    _measure(turn, name, message.measured)
    return True


def _measure(turn: Turn, name: str, values: Mapping[str, Value]) -> None:
    """Believe what is measured, and find out whether it was planned (section 4.1)."""
    before = turn.now.state
    turn.believe(values)
    after = turn.now.state
    if before == after:
        return
    changes = turn.system.changes(before, after)
    following = turn.now.following
    waiting = [following.plan.trace.path[at] for at in following.ready()] if following else []
    row = monitor.explained(turn.station, name, before, after, waiting)
    observed = [effect for effect in row or () if effect in turn.now.disabled]
    planned = row is not None and plan_steps.follow(turn, row)
    # What an effect accounts for that is counted on may have happened without the operator.
    mended = not planned and (row is None or bool(observed)) and operator.did(turn, changes)
    if observed and not mended:
        turn.set(disabled={n: at for n, at in turn.now.disabled.items() if n not in observed})
        turn.look_again()
    failures.change_seen(turn, changes)
    if row and planned:
        turn.note("measured", f"{name}: {', '.join(row)}", resource=name, effects=row, changes=changes, explained="planned")
    elif mended:
        turn.note("measured", f"{name}: the operator's doing", resource=name, changes=changes, explained="maintenance")
    elif row:
        turn.note("measured", f"{name}: {', '.join(row)}", resource=name, effects=row, changes=changes, explained="enabled")
        _unplanned(turn, name, changes, row)
    else:
        text = ", ".join(f"{variable} = {value}" for variable, value in changes.items())
        turn.note("measured", f"{name}: no effect explains {text}", resource=name, changes=changes, explained="no effect")
        _unplanned(turn, name, changes)


def _unplanned(turn: Turn, name: str, changes: Mapping[str, Value], row: Sequence[str] = ()) -> None:
    """What no plan waits for was measured. A question that is open is about a state that is no more."""
    if turn.station.matters.isdisjoint(changes):
        return
    if turn.thinking and turn.now.following is None and row and all(turn.system.transition[one].expected for one in row):
        turn.need(Cause.PROGRESS)  # what was commanded before goes on while the planners think: nothing is wrong
    elif turn.under_way:
        turn.need(Cause.DEVIATION, failures.concerned(turn, name))
    elif turn.now.asked:
        turn.set(asked=None)
    if turn.now.failed or turn.now.broken or intentions.in_error(turn):
        turn.look_again()
