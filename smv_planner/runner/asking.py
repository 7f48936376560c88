"""Questions to the planners, and what becomes of their answers."""

from __future__ import annotations

from collections.abc import Collection

from smv_planner.lazy import replace
from smv_planner.runner import failures, intentions, operator
from smv_planner.runner.decision import Cause, Decision, Request, Wanted
from smv_planner.runner.events import Ask
from smv_planner.runner.situation import Asked, Phase, Status, Wish, WishKind
from smv_planner.runner.turn import Turn

PATIENCE = (0.5, 30.0)
"""Seconds until a question that could not be decided is put again: at first, doubled each time, and at most."""

OVERDUE = 60.0
"""Seconds until a question that nobody answers is put again."""

RECHECK = 1.0
"""Seconds between two looks at what is in error, at least."""


def ask(turn: Turn) -> None:
    """Put what is needed to the planners. A look at what is in error comes last, and gives way to everything else."""
    now = turn.now
    if now.asked and now.at - now.asked.at > OVERDUE:
        turn.note("alarm", f"question {now.asked.revision} was never answered")
        _need_again(turn, now.asked)
        turn.set(asked=None)
        now = turn.now
    if now.phase is not Phase.RUNNING or now.at < now.not_before or turn.thinking:
        return
    if now.cause is not None:
        if now.asked:
            turn.look_again()
        _put(turn, Asked(now.revision + 1, now.cause, now.at, blamed=now.blamed))
        turn.set(cause=None, blamed=frozenset())
    elif now.recheck and not now.asked and now.at - now.rechecked >= RECHECK:
        turn.set(recheck=False, rechecked=now.at)
        if set(now.failed) - now.spent or intentions.in_error(turn):
            _put(turn, Asked(now.revision + 1, Cause.RESUMED, now.at, recheck=True))


def answered(turn: Turn, revision: int, decision: Decision) -> None:
    """Take a decision, unless something has happened since the question."""
    asked = turn.now.asked
    if asked is None or asked.revision != revision:
        return
    turn.set(asked=None)
    if turn.now.cause is not None:
        turn.note("stale", "the answer came too late: asking again")
        _need_again(turn, asked)
        return
    if decision.actions:
        told = "; ".join(f"{a.name} {'ok' if a.reached else 'no plan'} ({a.what})" for a in decision.actions)
        turn.note("decision", told, cause=asked.cause.value, actions=decision.actions)
    if decision.undecided is not None:
        wait = min(PATIENCE[0] * 2**turn.now.troubles, PATIENCE[1])
        turn.set(not_before=turn.now.at + wait, troubles=turn.now.troubles + 1)
        turn.note("alarm", f"no decision: {decision.undecided}; asking again in {wait:g} s")
        _need_again(turn, asked)
        return
    turn.set(troubles=0)
    if asked.recheck:
        _adopt_recheck(turn, decision)
    elif not failures.used_up(turn, asked, decision):
        _adopt(turn, decision, asked.cause)


def _adopt_recheck(turn: Turn, decision: Decision) -> None:
    """What was in error is possible again, or with the operator's help if nothing else goes on."""
    if decision.possible:
        failures.allow_again(turn, decision.possible)
    elif decision.reachable:
        for name in decision.reachable:
            intentions.resume(turn, name)
        turn.need(Cause.RESUMED)
    elif decision.following is not None and not (turn.now.following or turn.now.executing):
        _adopt(turn, decision, Cause.RESUMED)
    elif decision.stuck and not (turn.now.stuck or turn.now.wanted()):  # a planner that began anew says it again
        why = "; ".join(f"'{name}': {turn.now.intentions[name].reason}" for name in intentions.in_error(turn))
        turn.set(stuck=why or decision.stuck)
        turn.note("alarm", why or decision.stuck)


def _adopt(turn: Turn, decision: Decision, cause: Cause) -> None:
    """Follow a decision."""
    operator.keep_wishes(turn, decision.following)
    failures.fail(turn, decision.failed)
    for name, why in decision.given_up.items():
        intentions.pursue(turn, name, replace(turn.now.intentions[name], status=Status.ERROR, reason=why))
    before = {execution.task.operation.name for execution in turn.now.executing}
    after = {execution.task.operation.name for execution in decision.executing}
    for name in sorted(before - after):
        turn.note("operation", f"'{name}' goes back to initial", operation=name, state="initial")
    for execution in decision.executing:
        if execution.task.operation.name not in before:
            turn.note("operation", f"'{execution.task.name}' starts", operation=execution.task.name, state="executing")
    turn.set(executing=decision.executing, course=decision.course, following=decision.following, stuck=decision.stuck)
    if decision.following is not None:
        _begin_operations(turn, decision, before)
    if decision.stuck:
        turn.note("alarm", decision.stuck)
        for name in sorted(turn.now.spent):
            operator.ask(turn, Wish(WishKind.RETRY, f"Operation '{name}' {turn.now.failed[name]}. Try again?", transition=name))
    replaced = cause is Cause.LOST and any(not action.ordinary for action in decision.actions)
    failures.after_error(turn, decision.failed, turn.now.lost if replaced or decision.failed else {})


def _begin_operations(turn: Turn, decision: Decision, running: Collection[str]) -> None:
    """What starting operations assigns (`on_start`): the plan begins there."""
    assert decision.following is not None
    begun = turn.system.named(decision.following.plan.problem.initial)
    new = [e.task.operation for e in decision.executing if e.task.operation.name not in running]
    assigned = [action.variable for operation in new for action in operation.on_start]
    turn.believe({name: begun[name] for name in assigned if name in begun})


def _put(turn: Turn, asked: Asked) -> None:
    request = replace(_request(turn, asked.cause), recheck=asked.recheck)
    turn.set(revision=asked.revision, asked=asked)
    turn.out.append(Ask(asked.revision, request))


def _request(turn: Turn, cause: Cause) -> Request:
    now = turn.now

    def pursued(status: Status) -> tuple[Wanted, ...]:
        pursuits = now.intentions.items()
        return tuple(Wanted(name, p.owed) for name, p in pursuits if p.status is status and p.owed is not None)

    return Request(
        cause=cause,
        state=now.state,
        wanted=pursued(Status.EXECUTING),
        executing=now.executing,
        course=now.course,
        following=now.following,
        disabled=frozenset(now.disabled),
        lost=frozenset(now.lost),
        failed=now.failed,
        spent=now.spent,
        given_up=pursued(Status.ERROR),
        ran=now.ran,
    )


def _need_again(turn: Turn, asked: Asked) -> None:
    """What was asked has not been decided."""
    if asked.recheck:
        turn.look_again()
    else:
        turn.need(asked.cause, asked.blamed)
