"""What fails, and when it counts again: effects that do not come in time, and operations that end in error (section 6.2)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from smv_planner.model.domains import Value
from smv_planner.model.model import OnError
from smv_planner.model.system import Policy
from smv_planner.planner.operations import footprints, tasks, tasks_of
from smv_planner.runner import intentions, monitor, operator
from smv_planner.runner.decision import Cause, Decision
from smv_planner.runner.events import Withdraw
from smv_planner.runner.situation import Asked, Wish, WishKind
from smv_planner.runner.turn import Turn


def watch_effects(turn: Turn) -> None:
    """Count on no effect whose time is up, and try again what has been in error for long enough."""
    timers = monitor.clocks(turn.station, turn.now)
    if timers != turn.now.timers:
        turn.set(timers=timers)
    for name in monitor.overdue(turn.station, turn.now):
        turn.set(
            disabled={**turn.now.disabled, name: turn.now.at},
            timers={n: at for n, at in turn.now.timers.items() if n != name},
        )
        effect = turn.system.transition[name]
        turn.note("timeout", f"'{name}' has not happened within {effect.within:g} s", transition=name)
        following = turn.now.following
        if turn.thinking or (following and following.waits_for(name)):
            turn.need(Cause.TIMEOUT, concerned(turn, effect.resource or ""))
    for name, since in turn.now.disabled.items():
        policy = turn.system.transition[name].reenable
        if policy.policy is Policy.AFTER and turn.now.at - since >= (policy.after or 0.0):
            enable_again(turn, [name])
    for name, since in turn.now.failed_at.items():
        operation = next(t.operation for t in tasks(turn.model) if t.name == name)
        if operation.reenable.policy is Policy.AFTER and turn.now.at - since >= (operation.reenable.after or 0.0):
            allow_again(turn, [name])


def used_up(turn: Turn, asked: Asked, decision: Decision) -> bool:
    """Count failures: an operation that had to be planned again once too often is in error (section 6.2)."""
    again = any(a.name.startswith("TP") and a.reached for a in decision.actions)
    if asked.cause not in (Cause.DEVIATION, Cause.TIMEOUT) or not again:
        return False
    before = {execution.task.operation.name for execution in turn.now.executing}
    tried = [e for e in decision.executing if e.task.operation.name in before & asked.blamed]
    failures = dict(turn.now.failures)
    spent: dict[str, str] = {}
    for execution in tried:
        operation = execution.task.operation
        failures[operation.name] = failures.get(operation.name, 0) + 1
        if operation.retries is not None and failures[operation.name] > operation.retries:
            spent |= {task.name: f"failed {failures[operation.name]} times" for task in tasks_of(operation)}
    turn.set(failures=failures)
    if not spent:
        return False
    fail(turn, spent)
    turn.set(
        spent=turn.now.spent.union(spent),
        executing=tuple(e for e in turn.now.executing if e.task.name not in spent),
        course=None,
        following=None,
    )
    after_error(turn, spent, {})
    turn.need(asked.cause)
    return True


def fail(turn: Turn, failed: Mapping[str, str]) -> None:
    """Operations' tasks are in error from now on, with the reason."""
    for name, why in failed.items():
        turn.note("operation", f"'{name}' is in error: {why}", operation=name, state="error")
    at = dict.fromkeys(failed, turn.now.at)
    turn.set(failed={**turn.now.failed, **failed}, failed_at={**turn.now.failed_at, **at})


def after_error(turn: Turn, failed: Iterable[str], lost: Iterable[str]) -> None:
    """`on_error`: go on with a substitute, ask for approval first, or halt (section 7)."""
    by_task = {task.name: task.operation for task in tasks(turn.model)}
    said = {name: by_task[name].on_error for name in failed}  # what the scenario says for all is in these already
    said |= {name: turn.station.resources[name].on_error for name in lost}
    names = ", ".join(f"'{name}'" for name in said)
    if OnError.HALT in said.values():
        turn.set(halted=f"{names} failed")
        turn.note("alarm", f"{names} failed: halted until told to proceed")
    elif OnError.ASK in said.values() and not turn.now.halted:
        turn.set(halted=f"{names} failed")
        operator.ask(turn, Wish(WishKind.SUBSTITUTE, f"{names} failed. Go on with what replaces it?"))


def change_seen(turn: Turn, changes: Mapping[str, Value]) -> None:
    """What may be tried again because something that it depends on has changed."""
    effects = [n for n in turn.now.disabled if turn.system.transition[n].reenable.policy is Policy.ON_CHANGE]
    enable_again(turn, [n for n in effects if not turn.system.transition[n].used.isdisjoint(changes)])
    failed = [t for t in tasks(turn.model) if t.name in turn.now.failed and t.operation.reenable.policy is Policy.ON_CHANGE]
    allow_again(turn, [t.name for t in failed if not footprints(turn.model)[t.name].isdisjoint(changes)])


def enable_again(turn: Turn, effects: Sequence[str]) -> None:
    if effects:
        turn.set(disabled={n: at for n, at in turn.now.disabled.items() if n not in effects})
        turn.note("enabled", f"counting on {', '.join(effects)} again", transitions=tuple(effects))
        turn.look_again()


def allow_again(turn: Turn, failed: Sequence[str]) -> None:
    """Take tasks out of their error state; what was given up because of them goes on."""
    if not failed:
        return
    operations = {t.operation.name for t in tasks(turn.model) if t.name in failed}
    turn.set(
        failed={n: why for n, why in turn.now.failed.items() if n not in failed},
        failed_at={n: at for n, at in turn.now.failed_at.items() if n not in failed},
        spent=turn.now.spent.difference(failed),
        failures={n: count for n, count in turn.now.failures.items() if n not in operations},
    )
    for request, wish in turn.now.wishes.items():
        if wish.kind is WishKind.RETRY and wish.transition in failed:
            operator.granted(turn, request)
            turn.out.append(Withdraw(request))
    turn.note("possible", f"{', '.join(failed)} may be tried again", operations=tuple(failed))
    intentions.revive(turn)


def concerned(turn: Turn, resource: str) -> list[str]:
    """The executing operations that a resource has to do with; all if none has."""
    running = [execution.task.operation.name for execution in turn.now.executing]
    return [name for name in running if resource in turn.station.owners[name]] or running
