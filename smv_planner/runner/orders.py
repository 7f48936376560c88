"""Orders from outside: whoever operates the station may want something at any time."""

from __future__ import annotations

from collections.abc import Mapping

from smv_planner.lazy import replace
from smv_planner.model.domains import Value
from smv_planner.model.ltl import ALWAYS_FALSE
from smv_planner.model.system import VariableKind
from smv_planner.planner.operations import tasks
from smv_planner.runner import failures, intentions, operator, resources
from smv_planner.runner.decision import Cause
from smv_planner.runner.events import Activate, Approve, Assign, Cancel, Confirm, Order, Pause, Proceed, Reenable
from smv_planner.runner.situation import Pursuit, Status, WishKind
from smv_planner.runner.turn import Turn


def obey(turn: Turn, order: Order) -> None:
    match order:
        case Activate(name) if name in turn.now.intentions:
            _activate(turn, name)
        case Pause(name) if name in turn.now.intentions:
            if turn.now.intentions[name].status in (Status.EXECUTING, Status.ERROR):
                intentions.pursue(turn, name, replace(turn.now.intentions[name], status=Status.PAUSED, reason=""))
                turn.set(course=None)
                turn.need(Cause.CHANGED)
        case Cancel(name):
            _cancel(turn, name)
        case Assign(values):
            _assign(turn, values)
        case Confirm(request):
            _confirm(turn, request)
        case Approve(request):
            _approve(turn, request)
        case Reenable(name):
            _reenable(turn, name)
        case Proceed():
            turn.set(halted=None)
            turn.note("proceed", "going on")


def _activate(turn: Turn, name: str) -> None:
    pursuit = turn.now.intentions[name]
    if pursuit.status is Status.EXECUTING:
        return
    if pursuit.status in (Status.PAUSED, Status.ERROR) and pursuit.owed != ALWAYS_FALSE:
        intentions.resume(turn, name)
    else:
        intentions.begin(turn, name)
    turn.need(Cause.PROGRESS)


def _cancel(turn: Turn, name: str) -> None:
    if name in turn.now.intentions:
        if turn.now.intentions[name].status is not Status.INITIAL:
            intentions.pursue(turn, name, Pursuit(Status.CANCELLED))
            turn.set(course=None)
            turn.need(Cause.CHANGED)
    elif any(execution.task.operation.name == name for execution in turn.now.executing):
        turn.set(executing=tuple(e for e in turn.now.executing if e.task.operation.name != name), course=None, following=None)
        turn.note("operation", f"'{name}' is cancelled", operation=name, state="initial")
        turn.need(Cause.CHANGED)


def _assign(turn: Turn, values: Mapping[str, Value]) -> None:
    """Decision and estimated variables may be changed from outside at any time (Def. 6)."""
    mine = (VariableKind.DECISION, VariableKind.ESTIMATED)
    own = {v.name: v for v in turn.model.variables if v.kind in mine}
    accepted = {name: value for name, value in values.items() if name in own and value in own[name].domain}
    refused = [name for name in values if name not in accepted]
    if refused:
        turn.note("refused", f"{', '.join(refused)}: not a decision or estimated variable, or not a value of it")
    before = turn.now.state
    turn.believe(accepted)
    if turn.now.state != before:
        changes = turn.system.changes(before, turn.now.state)
        turn.note("assigned", ", ".join(f"{n} = {v}" for n, v in changes.items()), changes=changes)
        turn.need(Cause.CHANGED)
        turn.look_again()


def _confirm(turn: Turn, request: str) -> None:
    """Done, says the operator. Confirming twice, or what is no longer wanted, changes nothing."""
    wish = turn.now.wishes.get(request)
    if wish is None or wish.kind is not WishKind.MAINTENANCE:
        return
    if wish.confirmed_at is None:
        turn.set(wishes={**turn.now.wishes, request: replace(wish, confirmed_at=turn.now.at)})
        turn.note("confirmed", f"{wish.transition}", transition=wish.transition)


def _approve(turn: Turn, request: str) -> None:
    wish, following = turn.now.wishes.get(request), turn.now.following
    if wish is None or wish.kind is WishKind.MAINTENANCE:
        return
    operator.granted(turn, request)
    turn.note("approved", wish.text)
    match wish.kind:
        case WishKind.APPROVAL if following and wish.step is not None:
            turn.set(following=replace(following, approved=following.approved.union([wish.step])))
        case WishKind.SUBSTITUTE:
            turn.set(halted=None)
        case WishKind.RETRY:
            failures.allow_again(turn, [name for name in turn.now.spent if name == wish.transition])


def _reenable(turn: Turn, name: str) -> None:
    if name in turn.now.disabled:
        failures.enable_again(turn, [name])
    elif name in turn.now.lost:
        if turn.now.hubs[name].state is not None and not resources.is_silent(turn, name):
            resources.regain(turn, name)
    elif name in turn.now.intentions and turn.now.intentions[name].status is Status.ERROR:
        intentions.resume(turn, name)
        turn.need(Cause.RESUMED)
    else:
        failures.allow_again(
            turn, [t.name for t in tasks(turn.model) if name in (t.name, t.operation.name) and t.name in turn.now.failed]
        )
