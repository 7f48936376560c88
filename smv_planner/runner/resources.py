"""Resources that are there or not: hubs that are silent, stuck or ruled by somebody else are lost, and may come back."""

from __future__ import annotations

from collections.abc import Mapping

from smv_planner.model.domains import Value
from smv_planner.model.semantics import fire
from smv_planner.model.system import Policy, VariableKind
from smv_planner.protocol import view as hubs
from smv_planner.runner import goals
from smv_planner.runner.decision import Cause
from smv_planner.runner.situation import Phase
from smv_planner.runner.turn import Turn

LISTEN = 1.0
"""Seconds after which a hub that has said nothing yet counts as silent, if its resource has no `silent_after`."""

PLACES = 1000
"""Of a device that could be in more states than these nobody says that it may go back."""


def watch(turn: Turn) -> None:
    """Who is silent, stuck or disobedient is lost, and regained when that is over."""
    for name, view in turn.now.hubs.items():
        if name in turn.now.lost:
            may_regain(turn, name)
            continue
        resource = turn.station.resources[name]
        joining = turn.now.phase is Phase.JOINING
        limit = resource.silent_after or (LISTEN if joining else None)
        if limit is not None and hubs.silent(view, turn.now.at, limit):
            lose(turn, name, f"has been silent for {limit:g} s")
        elif stuck := hubs.stuck(view, resource.mirror_within):
            lose(turn, name, f"does not mirror '{stuck[0]}'")
        elif joining and not obeys(turn, view) and turn.now.at - turn.now.since > resource.mirror_within:
            lose(turn, name, "does not obey")


def obeys(turn: Turn, view: hubs.HubView) -> bool:
    """Whether a hub obeys this planner in this epoch."""
    return hubs.fenced(view, turn.now.epoch, turn.now.planner)


def is_silent(turn: Turn, name: str) -> bool:
    """Whether a hub has said nothing for longer than its resource may."""
    limit = turn.station.resources[name].silent_after or LISTEN
    return hubs.silent(turn.now.hubs[name], turn.now.at, limit)


def is_live(turn: Turn, variable: str) -> bool:
    """Whether sensors tell the value: it is measured, and its hub is there."""
    at = turn.system.index[variable]
    resource = turn.system.variables[at].resource
    return turn.system.variables[at].kind is VariableKind.MEASURED and resource not in turn.now.lost


def adopt_mirror(turn: Turn, name: str) -> None:
    """Goal variables as the hub obeys them: at a start, and when it comes back."""
    state = turn.now.hubs[name].state
    assert state is not None
    turn.believe({**state.measured, **state.mirror})
    turn.set(heard=turn.now.heard.union([name]))
    if turn.now.phase is not Phase.LISTENING:
        goals.tell(turn, name, state.mirror)


def lose(turn: Turn, name: str, why: str) -> None:
    turn.set(lost={**turn.now.lost, name: turn.now.at})
    _take_back(turn, name)
    turn.note("lost", f"'{name}' {why}", resource=name)
    if turn.now.phase is Phase.RUNNING:
        if turn.under_way:
            turn.need(Cause.LOST)
        turn.look_again()


def _take_back(turn: Turn, name: str) -> None:
    """A command that a lost hub has not mirrored: it is asked to stay with what it mirrors, and it may obey either.

    A silent one may have obeyed long since. Where its device could now be, going back may be forbidden; then the command stands.
    """
    view = turn.now.hubs[name]
    if view.state is None or not view.commanded or dict(view.commanded) == dict(view.state.mirror):
        return
    mirrored, doubted = view.state.mirror, view.commanded
    if is_silent(turn, name) and not _may_go_back(turn, name, mirrored):
        doubted = mirrored
    else:
        goals.command_by_hand(turn, mirrored)
    turn.set(doubts={**turn.now.doubts, name: doubted})


def _may_go_back(turn: Turn, name: str, to: Mapping[str, Value]) -> bool:
    """Whether a device may be told so wherever its effects have taken it."""
    station, system = turn.station, turn.system
    own = [effect for effect in station.effects if effect.resource == name]
    reached, waiting = {turn.now.state}, [turn.now.state]
    while waiting and len(reached) <= PLACES:
        state = waiting.pop()
        told = tuple(to.get(v.name, value) for v, value in zip(system.variables, state, strict=True))
        if not station.broken(told) <= station.broken(state):
            return False
        following = {after for effect in own for after in fire(system, effect, state)} - reached
        reached |= following
        waiting += following
    return not waiting


def may_regain(turn: Turn, name: str) -> None:
    """A lost resource counts again when it speaks, obeys and mirrors, as its policy says."""
    now, resource, view = turn.now, turn.station.resources[name], turn.now.hubs[name]
    if view.state is None or is_silent(turn, name) or not obeys(turn, view):
        return
    if hubs.stuck(view, resource.mirror_within) and view.commanded:
        return
    if view.state.goal_seq < now.sequence[name]:  # it has not taken the last command, even if that is what it mirrors
        return
    if resource.reenable.policy is Policy.MANUAL:
        return
    if resource.reenable.policy is Policy.AFTER and now.at - now.lost[name] < (resource.reenable.after or 0.0):
        return
    regain(turn, name)


def regain(turn: Turn, name: str) -> None:
    turn.set(
        lost={n: at for n, at in turn.now.lost.items() if n != name},
        doubts={n: values for n, values in turn.now.doubts.items() if n != name},
    )
    adopt_mirror(turn, name)
    turn.note("back", f"'{name}' is back", resource=name)
    turn.look_again()
    if turn.under_way:
        turn.need(Cause.RESUMED)
