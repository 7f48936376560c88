"""What goes on as the model says: automatic transitions, operations that end, invariants that break or hold again."""

from __future__ import annotations

from smv_planner.lazy import replace
from smv_planner.planner.operations import tasks_of
from smv_planner.planner.stage import Execution, goal_of
from smv_planner.runner import goals, intentions, operator, plan_steps
from smv_planner.runner.decision import Cause, Purpose
from smv_planner.runner.turn import Turn

UNSETTLED = "automatic transitions do not settle"

RAN = 1000
"""So many operations that have run are remembered, for prescribed sequences."""


def automatic(turn: Turn) -> bool:
    """Take the automatic transition that is due, if any."""
    held = turn.now.halted or operator.at_work(turn)  # then no operation ends; what is always taken, is
    due = turn.station.steps(() if held else turn.now.executing).automatic(turn.now.state)
    if due is None or turn.now.halted == UNSETTLED:
        return False
    transition, state = due
    before = turn.now.state
    turn.reach(state)
    changes = turn.system.changes(before, state)
    turn.excused |= {r for name in changes if goals.is_goal(turn, name) and (r := turn.system.resources[name]) is not None}
    turn.note("fired", f"{transition.name}", transition=transition.name, by="automatic", changes=changes)
    following = turn.now.following
    if following and not plan_steps.follow(turn, [transition.name]):
        turn.need(Cause.DEVIATION)
    return True


def progress(turn: Turn) -> bool:
    """Operations that are done, intentions that begin or end, invariants that are broken or hold again."""
    if not (turn.now.halted or operator.at_work(turn)) and (_operations_end(turn) or intentions.move(turn)):
        return True
    broken = turn.station.broken(turn.now.state)
    if broken != turn.now.broken:
        _guard_invariants(turn, broken)
    following = turn.now.following
    if following and following.finished and not turn.thinking:
        turn.set(following=None)
        if following.purpose is Purpose.EXIT or turn.now.executing:
            turn.need(Cause.RESUMED)
    _see_what_may_start(turn)
    return False


def _operations_end(turn: Turn) -> bool:
    for execution in turn.now.executing:
        ended = _ended_as(turn, execution)
        if ended is None:
            continue
        operation = execution.task.operation
        course = turn.now.course.ended(operation.name) if turn.now.course else None
        others = tuple(e for e in turn.now.executing if e is not execution)
        names = [task.name for task in tasks_of(operation)]
        revived = any(name in turn.now.failed for name in names)
        turn.set(
            executing=others,
            course=course,
            ran=(*turn.now.ran, operation.name)[-RAN:],
            failures={n: count for n, count in turn.now.failures.items() if n != operation.name},
            failed={n: why for n, why in turn.now.failed.items() if n not in names},
        )
        turn.note("operation", f"'{ended}' is done", operation=ended, state="initial")
        if not others:
            turn.set(following=None)
        turn.need(Cause.PROGRESS)
        if revived:
            intentions.revive(turn)
        turn.look_again()
        return True
    return False


def _ended_as(turn: Turn, execution: Execution) -> str | None:
    """The outcome that an operation has ended with, when its post-condition is reached."""
    for task in tasks_of(execution.task.operation):
        one = replace(execution, task=task)
        if turn.station.holds(goal_of(turn.model, one), turn.now.state):
            return task.name
    return None


def _guard_invariants(turn: Turn, broken: frozenset[str]) -> None:
    turn.set(broken=broken)
    if broken:
        names = ", ".join(f"'{name}'" for name in sorted(broken))
        following = turn.now.following
        if following and following.purpose is Purpose.EXIT and broken <= following.lifted:
            return
        turn.note("alarm", f"forbidden: {names} violated, or about to be", invariants=tuple(sorted(broken)))
        turn.set(executing=(), course=None)
        turn.need(Cause.FORBIDDEN)
    else:
        turn.note("allowed", "all invariants hold again")
        turn.need(Cause.RESUMED)


def _see_what_may_start(turn: Turn) -> None:
    """Operations that were waiting for their guard."""
    now = turn.now
    if now.course is None or now.executing or now.following or now.asked or now.cause or now.halted or now.broken:
        return
    if any(turn.station.holds(now.course.plan.tasks[at].operation.guard, now.state) for at in now.course.ready()):
        turn.need(Cause.PROGRESS)
