"""Goals: what each hub is asked to do, from the state that is believed to the message that leaves."""

from __future__ import annotations

from collections.abc import Mapping

from smv_planner.model.domains import Value
from smv_planner.model.system import VariableKind
from smv_planner.protocol import view as hubs
from smv_planner.protocol.messages import GoalMessage
from smv_planner.runner import gate
from smv_planner.runner.events import Send
from smv_planner.runner.turn import Turn


def send(turn: Turn) -> None:
    """Goal states: at once when they change, and all of them every period."""
    before = turn.now
    periodic = before.at - before.sent_at >= turn.model.period - 1e-9
    for name in before.hubs:
        # What a hub that has not spoken yet was told in an earlier reign is no reason to tell it so again.
        if name not in before.heard or before.hubs[name].state is None:
            continue
        values, told = _goal_state(turn, name), before.hubs[name].commanded
        if values != told:
            refused = gate.refused(turn.station, before, name, values, name in turn.excused)
            if refused is None:
                tell(turn, name, values)
            elif before.sequence[name]:
                turn.note("gate", f"'{name}' keeps its command: {refused}", resource=name)
        new = turn.now.sequence[name] != before.published.get(name, 0)
        if turn.now.sequence[name] and (new or periodic):
            interface, told = turn.station.interfaces[name], turn.now.hubs[name].commanded
            number, planner = turn.now.sequence[name], before.planner
            message = GoalMessage(interface.cell, name, before.epoch, number, planner, interface.model, told)
            turn.out.append(Send(message))
    if periodic or turn.now.sequence != before.published:
        turn.set(published=turn.now.sequence, sent_at=before.at if periodic else before.sent_at)


def tell(turn: Turn, name: str, values: Mapping[str, Value]) -> None:
    """From now on, these goals are asked of a hub."""
    view = turn.now.hubs[name]
    if dict(values) != dict(view.commanded) or not turn.now.sequence[name]:
        number = turn.now.sequence[name] + 1
        view = hubs.command(view, values, turn.now.at)
        turn.set(hubs={**turn.now.hubs, name: view}, sequence={**turn.now.sequence, name: number})


def mirrors(turn: Turn, name: str) -> bool:
    """Whether a hub says that it obeys everything that is asked of it now."""
    state = turn.now.hubs[name].state
    return state is not None and dict(state.mirror) == _goal_state(turn, name)


def _goal_state(turn: Turn, name: str) -> dict[str, Value]:
    return {v.name: turn.now.state[turn.system.index[v.name]] for v in turn.station.goals[name]}


def is_goal(turn: Turn, variable: str) -> bool:
    """Whether the value is commanded."""
    return turn.system.variables[turn.system.index[variable]].kind is VariableKind.GOAL


def command_by_hand(turn: Turn, values: Mapping[str, Value]) -> None:
    """Goals that change because a device was moved by hand, even of a resource that is not there to obey.

    Whoever moves it sees what it does: there is no doubt about it any more.
    """
    turn.believe(values)
    moved = {resource for name in values if (resource := turn.system.resources[name]) is not None}
    turn.excused |= moved
    turn.set(doubts={name: doubted for name, doubted in turn.now.doubts.items() if name not in moved})
