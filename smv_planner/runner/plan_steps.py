"""Steps of the transition plan that is followed: effects are ticked off, controlled ones taken as its order allows."""

from __future__ import annotations

from collections.abc import Sequence

from smv_planner.model.semantics import fire
from smv_planner.model.system import Any, Kind, Transition
from smv_planner.runner import goals, operator, resources
from smv_planner.runner.decision import Cause, Following, Purpose
from smv_planner.runner.situation import Wish, WishKind
from smv_planner.runner.turn import Turn


def follow(turn: Turn, row: Sequence[str]) -> bool:
    """Tick off a row of effects in the plan; False if one of them is not what the plan waits for."""
    following = turn.now.following
    if following is None:
        return False
    for effect in row:
        at = next((at for at in following.ready() if following.plan.trace.path[at] == effect), None)
        if at is None:
            return False
        following = following.having_done(at)
    turn.set(following=following)
    if turn.thinking:  # about a state that is no more, though nothing is wrong
        turn.need(Cause.PROGRESS)
    return True


def command(turn: Turn) -> bool:
    """Take the next controlled step that the plan allows; ask the operator for what is his (sections 4.1, 4.5)."""
    now, following = turn.now, turn.now.following
    if following is None or turn.thinking or now.cause is not None or now.halted or operator.at_work(turn):
        return False
    if now.broken and following.purpose is not Purpose.EXIT:
        return False
    plan = following.plan
    for at in following.ready():
        transition = plan.problem.system.transition[plan.trace.path[at]]
        if transition.kind is Kind.MAINTENANCE:
            text = transition.instruction or f"Do '{transition.name}' and acknowledge."
            operator.ask(turn, Wish(WishKind.MAINTENANCE, text, at, transition.name))
        elif transition.kind is Kind.CONTROLLED and _obeyed(turn, transition) and _beyond_doubt(turn, transition):
            if following.purpose is Purpose.EXIT and at not in following.approved:
                text = f"'{transition.name}' on the way out of a forbidden state"
                operator.ask(turn, Wish(WishKind.APPROVAL, text, at, transition.name))
                continue
            if _take(turn, following, at, transition):
                return True
            turn.need(Cause.DEVIATION)
            return False
    return False


def _obeyed(turn: Turn, transition: Transition) -> bool:
    """Whether the hubs that a transition commands are there and obey this planner, and those it depends on have followed.

    A plan gives commands one after the other, and a network does not: what an earlier one asked of another hub may
    still be on its way, and the two together forbidden.
    """
    for name in sorted({r for v in transition.assigned if (r := turn.system.resources[v]) is not None}):
        view = turn.now.hubs.get(name)
        if view is not None and (name in turn.now.lost or not resources.obeys(turn, view)):
            return False
    return all(name in turn.now.lost or goals.mirrors(turn, name) for name in turn.station.tied.get(transition.name, ()))


def _beyond_doubt(turn: Turn, transition: Transition) -> bool:
    """Whether a step is allowed, too, if lost hubs obey the commands that they have not mirrored."""
    now = turn.now
    if not now.doubts:
        return True
    doubted = {variable: value for values in now.doubts.values() for variable, value in values.items()}
    state = tuple(doubted.get(v.name, value) for v, value in zip(turn.system.variables, now.state, strict=True))
    after = fire(turn.system, turn.system.transition[transition.name], state)
    if all(turn.station.broken(one) <= turn.station.broken(state) for one in after):
        return True
    if now.stuck is None:
        names = ", ".join(f"'{name}'" for name in now.doubts)
        why = f"'{transition.name}' has to wait: {names} may have got a command that makes it forbidden"
        turn.set(stuck=why)
        turn.note("alarm", why)
    return False


def _take(turn: Turn, following: Following, at: int, transition: Transition) -> bool:
    """Fire a controlled transition as the plan has it; False if that is not possible in the present state."""
    plan = following.plan
    chosen = following.target(at)
    free = [a.variable for a in transition.actions if isinstance(a.value, Any)]
    system = plan.problem.system
    for state in fire(system, transition, turn.now.state):
        if all(state[system.index[name]] == chosen[name] for name in free):
            break
    else:
        return False
    lifted = following.lifted if following.purpose is Purpose.EXIT else frozenset()
    if turn.station.broken(state) - lifted:
        return False
    changes = turn.system.changes(turn.now.state, state)
    turn.reach(state)
    turn.set(following=following.having_done(at))
    turn.note("fired", transition.name, transition=transition.name, by="controlled", changes=changes)
    return True
