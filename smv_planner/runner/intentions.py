"""Intentions: they begin, are pursued, and are finished when nothing more is owed (Def. 6)."""

from __future__ import annotations

from smv_planner.lazy import replace
from smv_planner.model.expressions import meaning
from smv_planner.model.system import Any
from smv_planner.runner.decision import Cause, Purpose
from smv_planner.runner.recovery import promised
from smv_planner.runner.situation import Pursuit, Status
from smv_planner.runner.turn import Turn


def move(turn: Turn) -> bool:
    """Let one intention begin, end, or be ready for another time; False if none does."""
    for name, pursuit in turn.now.intentions.items():
        starts = turn.station.starts[name](turn.now.state)
        match pursuit.status:
            case Status.INITIAL if starts:
                begin(turn, name)
                turn.need(Cause.PROGRESS)
                return True
            case Status.FINISHED | Status.CANCELLED if not starts:
                pursue(turn, name, Pursuit())
                return True
            case Status.EXECUTING | Status.ERROR if pursuit.owed is not None and _reached(turn, pursuit):
                _finish(turn, name)
                return True
    return False


def begin(turn: Turn, name: str) -> None:
    """An intention starts, and with it the sequence that it prescribes."""
    sequences = [turn.station.intentions[name].sequence, None if turn.now.wanted() else turn.model.sequence]
    anew = {operation for sequence in sequences if sequence for operation in sequence.operations}
    turn.set(ran=tuple(operation for operation in turn.now.ran if operation not in anew))
    pursue(turn, name, Pursuit(Status.EXECUTING, promised(turn.model, name)))


def pursue(turn: Turn, name: str, pursuit: Pursuit) -> None:
    turn.set(intentions={**turn.now.intentions, name: pursuit})
    text = f"'{name}' is {pursuit.status.value}" + (f": {pursuit.reason}" if pursuit.reason else "")
    turn.note("intention", text, intention=name, state=pursuit.status.value)


def resume(turn: Turn, name: str) -> None:
    """An intention that was paused, or given up, is pursued again; what it owes is what it owed."""
    pursue(turn, name, replace(turn.now.intentions[name], status=Status.EXECUTING, reason=""))


def revive(turn: Turn) -> None:
    """Intentions in error go on."""
    ended = in_error(turn)
    for name in ended:
        resume(turn, name)
    if ended or turn.now.stuck:
        turn.set(stuck=None)
        turn.need(Cause.RESUMED)


def in_error(turn: Turn) -> list[str]:
    return [name for name, pursuit in turn.now.intentions.items() if pursuit.status is Status.ERROR]


def _reached(turn: Turn, pursuit: Pursuit) -> bool:
    """Whether nothing more has to happen for `formula U goal`."""
    assert pursuit.owed is not None
    return turn.station.met(pursuit.owed, turn.now.state)


def _finish(turn: Turn, name: str) -> None:
    """The goal is reached: the intention's actions are applied (Def. 6)."""
    pursue(turn, name, Pursuit(Status.FINISHED))
    values = {
        action.variable: meaning(action.value, turn.system.index)(turn.now.state)
        for action in turn.station.intentions[name].actions
        if not isinstance(action.value, Any)
    }
    outside = [variable for variable, value in values.items() if value not in turn.system.domains[variable]]
    if outside:
        turn.note("refused", f"what '{name}' does in the end would leave the domain of '{outside[0]}'")
    turn.believe({variable: value for variable, value in values.items() if variable not in outside})
    turn.look_again()
    following = turn.now.following
    if turn.now.executing or turn.now.wanted():
        turn.need(Cause.PROGRESS)
    elif following is None or following.purpose is not Purpose.EXIT:
        turn.set(course=None, following=None)
