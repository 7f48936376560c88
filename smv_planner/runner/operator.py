"""The operator: what he is asked for, and what he has done, by his word and by what sensors show (sections 4.5, 4.6)."""

from __future__ import annotations

from collections.abc import Mapping

from smv_planner.lazy import replace
from smv_planner.model.domains import Value
from smv_planner.model.semantics import fire
from smv_planner.runner import goals, resources
from smv_planner.runner.decision import Cause, Following
from smv_planner.runner.events import Consent, Instruct, Withdraw
from smv_planner.runner.situation import Wish, WishKind
from smv_planner.runner.turn import Turn

CONFIRMED = 5.0
"""Seconds in which sensors have to show what the operator says was done."""


def ask(turn: Turn, wish: Wish) -> None:
    """Ask for something, once."""
    if any(known == replace(wish, confirmed_at=known.confirmed_at) for known in turn.now.wishes.values()):
        return
    number = turn.now.wished + 1
    request = f"{turn.now.epoch}.{number}"
    turn.set(wished=number, wishes={**turn.now.wishes, request: wish})
    if wish.transition is not None and wish.kind is WishKind.MAINTENANCE:
        turn.out.append(Instruct(request, wish.transition, wish.text))
    else:
        turn.out.append(Consent(request, wish.text))


def granted(turn: Turn, request: str) -> None:
    """What was asked under this id is asked no more."""
    turn.set(wishes={name: wish for name, wish in turn.now.wishes.items() if name != request})


def keep_wishes(turn: Turn, following: Following | None) -> None:
    """What the operator was asked for stays asked if the new plan has it too; the rest is withdrawn."""
    kept = {}
    steps = {following.plan.trace.path[at]: at for at in reversed(following.ready())} if following else {}
    for request, wish in turn.now.wishes.items():
        if wish.kind is WishKind.RETRY or (wish.kind is WishKind.SUBSTITUTE and turn.now.halted):
            kept[request] = wish
        elif wish.kind is WishKind.MAINTENANCE and wish.transition in steps:
            kept[request] = replace(wish, step=steps[wish.transition])
        else:
            turn.out.append(Withdraw(request))
    turn.set(wishes=kept)


def performed(turn: Turn) -> bool:
    """Maintenance that was confirmed, and that sensors show where there are any: it is done (section 4.5)."""
    following = turn.now.following
    if following is None or turn.thinking:
        return False
    for request, wish in turn.now.wishes.items():
        if wish.kind is not WishKind.MAINTENANCE or wish.confirmed_at is None or wish.step is None:
            continue
        target = following.target(wish.step)
        now = turn.system.named(turn.now.state)
        unseen = [n for n, value in target.items() if resources.is_live(turn, n) and now[n] != value]
        if not unseen:
            granted(turn, request)
            if wish.step not in following.ready() or not _was_possible(turn, following, wish.step):
                turn.note("unseen", f"'{wish.transition}' was confirmed, but it is not its time any more")
                turn.need(Cause.DEVIATION)
                return True
            goals.command_by_hand(turn, {n: value for n, value in target.items() if not resources.is_live(turn, n)})
            turn.set(following=following.having_done(wish.step))
            turn.look_again()
            text = f"'{wish.transition}' is done"
            turn.note("fired", text, transition=wish.transition, by="operator", changes=dict(target))
            return True
        if turn.now.at - wish.confirmed_at > CONFIRMED:
            granted(turn, request)
            turn.note("unseen", f"'{wish.transition}' was confirmed, but '{unseen[0]}' is {now[unseen[0]]}")
            ask(turn, replace(wish, confirmed_at=None))
            return True
    return False


def _was_possible(turn: Turn, following: Following, at: int) -> bool:
    """Whether a maintenance step's guard held before the sensors showed that it was done."""
    plan, system = following.plan, following.plan.problem.system
    before, target = plan.trace.states[at], following.target(at)
    state = list(turn.now.state)
    for name in target:
        if resources.is_live(turn, name) or goals.is_goal(turn, name):
            state[system.index[name]] = before[system.index[name]]
    return bool(fire(system, system.transition[plan.trace.path[at]], tuple(state)))


def at_work(turn: Turn) -> bool:
    """Whether sensors show what the operator was asked to do before he has said that he is done: then all wait for him."""
    following, now = turn.now.following, turn.now.state
    if following is None:
        return False
    for wish in turn.now.wishes.values():
        if wish.kind is not WishKind.MAINTENANCE or wish.confirmed_at is not None or wish.step is None:
            continue
        before, system = following.plan.trace.states[wish.step], following.plan.problem.system
        live = {n: value for n, value in following.target(wish.step).items() if resources.is_live(turn, n)}
        shown = all(now[turn.system.index[n]] == value for n, value in live.items())
        if shown and any(before[system.index[n]] != value for n, value in live.items()):
            return True
    return False


def did(turn: Turn, changes: Mapping[str, Value]) -> bool:
    """Whether the changes belong to maintenance that the operator was asked for.

    As soon as sensors show it, commands are what it makes of them: what was pushed away must not come back, and what
    was taken off must not be held on to, before the operator has said that all is done.
    """
    for wish in turn.now.wishes.values():
        if wish.kind is WishKind.MAINTENANCE and wish.step is not None and turn.now.following:
            target = turn.now.following.target(wish.step)
            if all(name in target for name in changes):
                now = turn.system.named(turn.now.state)
                if all(now[name] == value for name, value in target.items() if resources.is_live(turn, name)):
                    goals.command_by_hand(turn, {name: value for name, value in target.items() if goals.is_goal(turn, name)})
                return True
    return False
