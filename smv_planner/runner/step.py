"""The transition runner (Machines 2021, section 4.1): what happens next, given what is known and what has just happened.

An event is taken in; then automatic transitions are taken until none is enabled, controlled ones as far as the plan and
its order allow, operations and intentions begin and end; and if what is believed does not fit the plan any more, the
planners are asked. While they think nothing new is commanded, and what was commanded is repeated.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace

from smv_planner.model.domains import Value
from smv_planner.model.expressions import Expr, meaning
from smv_planner.model.ltl import ALWAYS_FALSE, progressed
from smv_planner.model.model import OnError
from smv_planner.model.semantics import fire
from smv_planner.model.system import Any, Kind, Policy, State, Transition, VariableKind
from smv_planner.planner.operations import footprints, tasks, tasks_of
from smv_planner.planner.stage import Execution, goal_of
from smv_planner.protocol import view as hubs
from smv_planner.protocol.messages import GoalMessage, StateMessage
from smv_planner.runner import gate, monitor
from smv_planner.runner.decision import Cause, Decision, Following, Purpose, Request, Wanted
from smv_planner.runner.events import (
    Activate,
    Answered,
    Approve,
    Ask,
    Assign,
    Began,
    Cancel,
    Confirm,
    Consent,
    Event,
    Heard,
    Instruct,
    Note,
    Order,
    Ordered,
    Output,
    Pause,
    Proceed,
    Reenable,
    Send,
    Tick,
    Withdraw,
)
from smv_planner.runner.recovery import promised
from smv_planner.runner.situation import Asked, Phase, Pursuit, Situation, Station, Status, Wish, WishKind

LISTEN = 1.0
"""Seconds after which a hub that has said nothing yet counts as silent, if its resource has no `silent_after`."""

SETTLING = 1000
"""So many automatic steps in a row mean that a model does not settle."""

UNSETTLED = "automatic transitions do not settle"

CONFIRMED = 5.0
"""Seconds in which sensors have to show what the operator says was done."""

PATIENCE = (0.5, 30.0)
"""Seconds until a question that could not be decided is put again: at first, doubled each time, and at most."""

ASLEEP = 2.0
"""Seconds without any event after which the runner has slept: what it believes is from before, and so is its plan."""

LEAP = 1_000_000
"""No planner begins so often: an epoch so far ahead of ours is nobody's, and would leave none for us."""

OUTVOTED = 5.0
"""Seconds after which a planner that was fenced out, but whom all hubs obey all the same, takes that for a forgery."""

OVERDUE = 60.0
"""Seconds until a question that nobody answers is put again."""

RAN = 1000
"""So many operations that have run are remembered, for prescribed sequences."""

RECHECK = 1.0
"""Seconds between two looks at what is in error, at least."""

_GRAVITY = (Cause.PROGRESS, Cause.RESUMED, Cause.CHANGED, Cause.DEVIATION, Cause.TIMEOUT, Cause.LOST, Cause.FORBIDDEN)


def step(station: Station, situation: Situation, event: Event) -> tuple[Situation, tuple[Output, ...]]:
    """The situation after an event, and what is to be done about it."""
    turn = _Turn(station, situation.but(at=event.at))
    if situation.phase in (Phase.JOINING, Phase.RUNNING) and event.at - situation.at > max(ASLEEP, 10 * station.model.period):
        turn.note("alarm", f"nothing has happened for {event.at - situation.at:.1f} s: joining anew")
        turn.begin(situation.planner)
    match event:
        case Began(_, planner):
            turn.begin(planner)
        case Tick():
            pass
        case Heard(_, message):
            if not turn.hear(message):
                return turn.now, tuple(turn.out)  # the usual case: nothing new
        case Answered(_, revision, decision):
            turn.answered(revision, decision)
        case Ordered(_, order):
            turn.ordered(order)
    turn.advance()
    return turn.now, tuple(turn.out)


class _Turn:
    """One event being worked off: the situation so far, and the outputs so far."""

    def __init__(self, station: Station, now: Situation) -> None:
        self.station, self.model, self.system = station, station.model, station.system
        self.now = now
        self.out: list[Output] = []
        self.told: set[str] = set()  # resources whose goals change by automatic transitions, or by the operator's doing

    def set(self, **changes: object) -> None:
        self.now = self.now.but(**changes)

    def note(self, kind: str, text: str, **data: object) -> None:
        self.out.append(Note(kind, text, data))

    def need(self, cause: Cause, blamed: Iterable[str] = ()) -> None:
        """The planners have to be asked; the gravest cause counts."""
        known = self.now.cause
        if known is None or _GRAVITY.index(cause) > _GRAVITY.index(known):
            self.set(cause=cause)
        if blamed:
            self.set(blamed=self.now.blamed.union(blamed))

    @property
    def thinking(self) -> bool:
        """Whether the planners think about how to go on; a mere look at what is in error holds nothing up."""
        return self.now.asked is not None and not self.now.asked.recheck

    def look_again(self) -> None:
        """Something has changed that may make possible what was not."""
        if not self.now.recheck:
            self.set(recheck=True)
        following = self.now.following
        if self.now.broken and not (following and following.purpose is Purpose.EXIT):
            self.need(Cause.FORBIDDEN)

    # --- taking over ----------------------------------------------------------------------------------------

    def begin(self, planner: str) -> None:
        """Nothing of an earlier reign is taken for granted but what only the planner can know."""
        at = self.now.at
        views = {name: hubs.HubView(heard_at=at) for name in self.station.interfaces}
        by_hand = [n for n in self.now.lost if self.station.resources[n].reenable.policy is Policy.MANUAL]
        self.set(
            phase=Phase.LISTENING,
            planner=planner,
            since=at,
            hubs=views,
            sequence={},
            published={},
            lost=dict.fromkeys(by_hand, at),
            doubts={},
            timers={},
            disabled=dict.fromkeys(self.now.disabled, at),
            following=None,
            asked=None,
            cause=Cause.RESUMED if self.now.wanted() else None,
            blamed=frozenset(),
            broken=frozenset(),
            not_before=at,
            recheck=True,
        )
        self.keep_wishes(None)
        self.note("began", f"planner {planner} listens", planner=planner)

    def take_over(self) -> None:
        """From listening to holding under a new epoch, and from there to running."""
        now, at = self.now, self.now.at
        if now.phase is Phase.LISTENING:
            silent = {n for n, view in now.hubs.items() if view.state is None}
            if all(self.is_silent(name) for name in silent):
                claimed = [view.state.epoch for view in now.hubs.values() if view.state]
                epoch = max([now.epoch, *(one for one in claimed if one <= now.epoch + LEAP)]) + 1
                self.set(phase=Phase.JOINING, epoch=epoch, since=at, sequence=dict.fromkeys(now.hubs, 0), published={})
                for name in silent - set(now.lost):
                    self.lose(name, "has not spoken since the planner began")
                for name in now.hubs:
                    if name not in silent:
                        self.adopt_mirror(name)
                self.note("joining", f"epoch {epoch}: holding until all hubs obey", epoch=epoch)
        elif now.phase is Phase.JOINING:
            living = [view for name, view in now.hubs.items() if name not in now.lost]
            unknown = [name for name in now.hubs if name not in now.heard]
            if unknown and now.stuck is None and now.at - now.since > LISTEN:
                waits = f"nothing is known of {', '.join(map(repr, unknown))}, which has never spoken: waiting for it"
                self.set(stuck=waits)
                self.note("alarm", waits, resources=tuple(unknown))
            if not unknown and all(map(self.rules, living)):
                self.set(phase=Phase.RUNNING, since=at, stuck=None)
                self.note("running", f"epoch {now.epoch}: {len(living)} of {len(now.hubs)} hubs obey", epoch=now.epoch)
                if now.executing:
                    self.need(Cause.RESUMED)

    def is_silent(self, name: str) -> bool:
        limit = self.station.resources[name].silent_after or LISTEN
        return hubs.silent(self.now.hubs[name], self.now.at, limit)

    def adopt_mirror(self, name: str) -> None:
        """Goal variables as the hub obeys them: at a start, and when it comes back (DESIGN: holding)."""
        state = self.now.hubs[name].state
        assert state is not None
        self.believe({**state.measured, **state.mirror})
        self.set(heard=self.now.heard.union([name]))
        if self.now.phase is not Phase.LISTENING:
            self.tell(name, state.mirror)

    def tell(self, name: str, values: Mapping[str, Value]) -> None:
        """From now on, these goals are asked of a hub."""
        view = self.now.hubs[name]
        if dict(values) != dict(view.commanded) or not self.now.sequence[name]:
            number = self.now.sequence[name] + 1
            view = hubs.command(view, values, self.now.at)
            self.set(hubs={**self.now.hubs, name: view}, sequence={**self.now.sequence, name: number})

    def superseded(self, name: str) -> bool:
        """Another planner rules this hub: give way, or claim a newer epoch if both claimed the same at once."""
        now = self.now
        view = now.hubs[name]
        if now.phase not in (Phase.JOINING, Phase.RUNNING) or not hubs.superseded(view, now.epoch, now.planner):
            return False
        assert view.state is not None
        if view.state.epoch > now.epoch + LEAP:
            if name not in now.lost:
                self.lose(name, f"claims to obey epoch {view.state.epoch}, which nobody can have reached")
            return False
        if view.state.epoch == now.epoch and now.phase is Phase.JOINING and now.planner > view.state.planner:
            self.set(epoch=now.epoch + 1, since=now.at, sequence=dict.fromkeys(now.hubs, 0), published={})
            self.note("joining", f"epoch {now.epoch + 1}: '{view.state.planner}' claims {now.epoch}", epoch=now.epoch + 1)
            return True
        self.set(phase=Phase.FENCED_OUT, since=now.at, following=None, asked=None, cause=None)
        self.keep_wishes(None)
        text = f"planner {view.state.planner} has taken over with epoch {view.state.epoch}; nothing is sent any more"
        self.note("alarm", text, planner=view.state.planner, epoch=view.state.epoch)
        return True

    def outvoted(self) -> bool:
        """Whether nobody but a single message has ever said that another planner has taken over."""
        return self.now.at - self.now.since > OUTVOTED and all(
            self.rules(view) and not self.is_silent(name) for name, view in self.now.hubs.items()
        )

    # --- hearing --------------------------------------------------------------------------------------------

    def hear(self, message: StateMessage) -> bool:
        """Take in a state message; False if it says nothing new."""
        now, name = self.now, message.resource
        old = now.hubs.get(name)
        if old is None:
            return False
        view, heard = hubs.hear(old, message, now.at)
        if not heard.believed:
            count = now.rejected.get(heard.value, 0) + 1
            self.set(hubs={**now.hubs, name: view}, rejected={**now.rejected, heard.value: count})
            return False
        known = old.state
        self.set(hubs={**now.hubs, name: view})
        if self.superseded(name):
            return True
        if now.phase not in (Phase.JOINING, Phase.RUNNING):
            return True
        if name not in now.heard or now.phase is Phase.JOINING or (name in now.lost and not view.commanded):
            self.adopt_mirror(name)
            return True
        if heard is hubs.Heard.REBOOTED:
            self.note("rebooted", f"the hub of '{name}' has restarted", resource=name)
            self.adopt_mirror(name)
            self.need(Cause.DEVIATION, self.concerned(name))
            return True
        if name in now.lost:
            self.measure(name, message.measured)
            self.may_regain(name)
            return True
        if known is not None and known.measured == message.measured:
            return known.mirror != message.mirror or bool(hubs.stuck(view, self.station.resources[name].mirror_within))
        self.measure(name, message.measured)
        return True

    def measure(self, name: str, values: Mapping[str, Value]) -> None:
        """Believe what is measured, and find out whether it was planned (section 4.1)."""
        before = self.now.state
        self.believe(values)
        after = self.now.state
        if before == after:
            return
        changes = self.system.changes(before, after)
        following = self.now.following
        waiting = [following.plan.trace.path[at] for at in following.ready()] if following else []
        row = monitor.explained(self.station, name, before, after, waiting)
        observed = [effect for effect in row or () if effect in self.now.disabled]
        planned = row is not None and self.follow(row)
        # What an effect accounts for that is counted on may have happened without the operator.
        mended = not planned and (row is None or bool(observed)) and self.by_operator(changes)
        if observed and not mended:
            self.set(disabled={n: at for n, at in self.now.disabled.items() if n not in observed})
            self.look_again()
        self.change_seen(changes)
        if row and planned:
            self.note("measured", f"{name}: {', '.join(row)}", resource=name, effects=row, changes=changes, explained="planned")
        elif mended:
            self.note("measured", f"{name}: the operator's doing", resource=name, changes=changes, explained="maintenance")
        elif row:
            self.note("measured", f"{name}: {', '.join(row)}", resource=name, effects=row, changes=changes, explained="enabled")
            self.deviation(name, changes)
        else:
            text = ", ".join(f"{variable} = {value}" for variable, value in changes.items())
            self.note("measured", f"{name}: no effect explains {text}", resource=name, changes=changes, explained="no effect")
            self.deviation(name, changes)

    def deviation(self, name: str, changes: Mapping[str, Value]) -> None:
        """What no plan waits for was measured. A question that is open is about a state that is no more."""
        if self.station.matters.isdisjoint(changes):
            return
        if self.now.following or self.now.executing or self.thinking:
            self.need(Cause.DEVIATION, self.concerned(name))
        elif self.now.asked:
            self.set(asked=None)
        if self.now.failed or self.now.broken or self.in_error():
            self.look_again()

    def in_error(self) -> list[str]:
        return [name for name, pursuit in self.now.intentions.items() if pursuit.status is Status.ERROR]

    def follow(self, row: Sequence[str]) -> bool:
        """Tick off a row of effects in the plan; False if one of them is not what the plan waits for."""
        following = self.now.following
        if following is None:
            return False
        for effect in row:
            at = next((at for at in following.ready() if following.plan.trace.path[at] == effect), None)
            if at is None:
                return False
            following = replace(following, done=following.done.union([at]))
        self.set(following=following)
        if self.thinking:  # about a state that is no more, though nothing is wrong
            self.need(Cause.PROGRESS)
        return True

    def by_operator(self, changes: Mapping[str, Value]) -> bool:
        """Whether the changes belong to maintenance that the operator was asked for.

        As soon as sensors show it, commands are what it makes of them: what was pushed away must not come back, and what
        was taken off must not be held on to, before the operator has said that all is done.
        """
        for wish in self.now.wishes.values():
            if wish.kind is WishKind.MAINTENANCE and wish.step is not None and self.now.following:
                target = self.target(self.now.following, wish.step)
                if all(name in target for name in changes):
                    now = self.system.named(self.now.state)
                    if all(now[name] == value for name, value in target.items() if self.is_live(name)):
                        self.command_by_hand({name: value for name, value in target.items() if self.is_goal(name)})
                    return True
        return False

    def command_by_hand(self, values: Mapping[str, Value]) -> None:
        """Goals that change because a device was moved by hand, even of a resource that is not there to obey.

        Whoever moves it sees what it does: there is no doubt about it any more.
        """
        self.believe(values)
        moved = {resource for name in values if (resource := self.system.resources[name]) is not None}
        self.told |= moved
        self.set(doubts={name: doubted for name, doubted in self.now.doubts.items() if name not in moved})

    def believe(self, values: Mapping[str, Value]) -> None:
        """Put values into the state; everything that depends on decision variables follows."""
        state = list(self.now.state)
        for name, value in values.items():
            state[self.system.index[name]] = value
        self.reach(tuple(state))

    def reach(self, state: State) -> None:
        """The next state; what the intentions owe moves on when a decision variable changes.

        An effect that is not enabled here starts anew when it is, even if that is at once (section 4.1).
        """
        before = self.now.state
        if state == before:
            return
        owed = [n for n, p in self.now.intentions.items() if p.owed is not None]
        timers = {name: since for name, since in self.now.timers.items() if self.station.enabled[name](state)}
        self.set(state=state, timers=timers)
        if not owed:
            return
        old, new = self.station.decisions(before), self.station.decisions(state)
        if old != new:
            index = self.station.decision_index
            pursuits = dict(self.now.intentions)
            for name in owed:
                formula = pursuits[name].owed
                assert formula is not None
                pursuits[name] = replace(pursuits[name], owed=progressed(formula, old, index))
            self.set(intentions=pursuits)

    def concerned(self, resource: str) -> list[str]:
        """The executing operations that a resource has to do with; all if none has."""
        running = [execution.task.operation.name for execution in self.now.executing]
        return [name for name in running if resource in self.station.owners[name]] or running

    # --- resources that are there or not --------------------------------------------------------------------

    def watch_hubs(self) -> None:
        for name, view in self.now.hubs.items():
            if name in self.now.lost:
                self.may_regain(name)
                continue
            resource = self.station.resources[name]
            joining = self.now.phase is Phase.JOINING
            limit = resource.silent_after or (LISTEN if joining else None)
            if limit is not None and hubs.silent(view, self.now.at, limit):
                self.lose(name, f"has been silent for {limit:g} s")
            elif stuck := hubs.stuck(view, resource.mirror_within):
                self.lose(name, f"does not mirror '{stuck[0]}'")
            elif joining and not self.rules(view) and self.now.at - self.now.since > resource.mirror_within:
                self.lose(name, "does not obey")

    def rules(self, view: hubs.HubView) -> bool:
        """Whether a hub obeys this planner in this epoch."""
        return hubs.fenced(view, self.now.epoch, self.now.planner)

    def lose(self, name: str, why: str) -> None:
        self.set(lost={**self.now.lost, name: self.now.at})
        self.take_back(name)
        self.note("lost", f"'{name}' {why}", resource=name)
        if self.now.phase is Phase.RUNNING:
            if self.now.following or self.now.executing or self.thinking:
                self.need(Cause.LOST)
            self.look_again()

    def take_back(self, name: str) -> None:
        """A command that a lost hub has not mirrored: it is asked to stay with what it mirrors, and it may obey either."""
        view = self.now.hubs[name]
        if view.state is None or not view.commanded or dict(view.commanded) == dict(view.state.mirror):
            return
        self.command_by_hand(view.state.mirror)
        self.set(doubts={**self.now.doubts, name: view.commanded})

    def may_regain(self, name: str) -> None:
        """A lost resource counts again when it speaks, obeys and mirrors, as its policy says."""
        now, resource, view = self.now, self.station.resources[name], self.now.hubs[name]
        if view.state is None or self.is_silent(name) or not self.rules(view):
            return
        if hubs.stuck(view, resource.mirror_within) and view.commanded:
            return
        if view.state.goal_seq < now.sequence[name]:  # it has not taken the last command, even if that is what it mirrors
            return
        if resource.reenable.policy is Policy.MANUAL:
            return
        if resource.reenable.policy is Policy.AFTER and now.at - now.lost[name] < (resource.reenable.after or 0.0):
            return
        self.regain(name)

    def regain(self, name: str) -> None:
        self.set(
            lost={n: at for n, at in self.now.lost.items() if n != name},
            doubts={n: values for n, values in self.now.doubts.items() if n != name},
        )
        self.adopt_mirror(name)
        self.note("back", f"'{name}' is back", resource=name)
        self.look_again()
        if self.now.following or self.now.executing or self.thinking:
            self.need(Cause.RESUMED)

    # --- effects that do not come ---------------------------------------------------------------------------

    def watch_effects(self) -> None:
        timers = monitor.clocks(self.station, self.now)
        if timers != self.now.timers:
            self.set(timers=timers)
        for name in monitor.overdue(self.station, self.now):
            self.set(
                disabled={**self.now.disabled, name: self.now.at},
                timers={n: at for n, at in self.now.timers.items() if n != name},
            )
            effect = self.system.transition[name]
            self.note("timeout", f"'{name}' has not happened within {effect.within:g} s", transition=name)
            following = self.now.following
            if self.thinking or (following and any(following.plan.trace.path[at] == name for at in _remaining(following))):
                self.need(Cause.TIMEOUT, self.concerned(effect.resource or ""))
        for name, since in self.now.disabled.items():
            policy = self.system.transition[name].reenable
            if policy.policy is Policy.AFTER and self.now.at - since >= (policy.after or 0.0):
                self.enable_again([name])
        for name, since in self.now.failed_at.items():
            operation = next(t.operation for t in tasks(self.model) if t.name == name)
            if operation.reenable.policy is Policy.AFTER and self.now.at - since >= (operation.reenable.after or 0.0):
                self.allow_again([name])

    def change_seen(self, changes: Mapping[str, Value]) -> None:
        """What may be tried again because something that it depends on has changed."""
        effects = [n for n in self.now.disabled if self.system.transition[n].reenable.policy is Policy.ON_CHANGE]
        self.enable_again([n for n in effects if not self.system.transition[n].used.isdisjoint(changes)])
        failed = [t for t in tasks(self.model) if t.name in self.now.failed and t.operation.reenable.policy is Policy.ON_CHANGE]
        self.allow_again([t.name for t in failed if not footprints(self.model)[t.name].isdisjoint(changes)])

    def enable_again(self, effects: Sequence[str]) -> None:
        if effects:
            self.set(disabled={n: at for n, at in self.now.disabled.items() if n not in effects})
            self.note("enabled", f"counting on {', '.join(effects)} again", transitions=tuple(effects))
            self.look_again()

    def allow_again(self, failed: Sequence[str]) -> None:
        """Take tasks out of their error state; what was given up because of them goes on."""
        if not failed:
            return
        operations = {t.operation.name for t in tasks(self.model) if t.name in failed}
        self.set(
            failed={n: why for n, why in self.now.failed.items() if n not in failed},
            failed_at={n: at for n, at in self.now.failed_at.items() if n not in failed},
            spent=self.now.spent.difference(failed),
            failures={n: count for n, count in self.now.failures.items() if n not in operations},
        )
        for request, wish in self.now.wishes.items():
            if wish.kind is WishKind.RETRY and wish.transition in failed:
                self.granted(request)
                self.out.append(Withdraw(request))
        self.note("possible", f"{', '.join(failed)} may be tried again", operations=tuple(failed))
        self.revive()

    def revive(self) -> None:
        """Intentions in error go on."""
        ended = self.in_error()
        for name in ended:
            self.pursue(name, replace(self.now.intentions[name], status=Status.EXECUTING, reason=""))
        if ended or self.now.stuck:
            self.set(stuck=None)
            self.need(Cause.RESUMED)

    # --- orders from outside --------------------------------------------------------------------------------

    def ordered(self, order: Order) -> None:
        match order:
            case Activate(name) if name in self.now.intentions:
                self.activate(name)
            case Pause(name) if name in self.now.intentions:
                if self.now.intentions[name].status in (Status.EXECUTING, Status.ERROR):
                    self.pursue(name, replace(self.now.intentions[name], status=Status.PAUSED, reason=""))
                    self.set(course=None)
                    self.need(Cause.CHANGED)
            case Cancel(name):
                self.cancel(name)
            case Assign(values):
                self.assign(values)
            case Confirm(request):
                self.confirm(request)
            case Approve(request):
                self.approve(request)
            case Reenable(name):
                self.reenable(name)
            case Proceed():
                self.set(halted=None)
                self.note("proceed", "going on")

    def activate(self, name: str) -> None:
        pursuit = self.now.intentions[name]
        if pursuit.status is Status.EXECUTING:
            return
        if pursuit.status in (Status.PAUSED, Status.ERROR) and pursuit.owed != ALWAYS_FALSE:
            self.pursue(name, replace(pursuit, status=Status.EXECUTING, reason=""))
        else:
            self.begin_intention(name)
        self.need(Cause.PROGRESS)

    def begin_intention(self, name: str) -> None:
        """An intention starts, and with it the sequence that it prescribes."""
        sequences = [self.station.intentions[name].sequence, None if self.now.wanted() else self.model.sequence]
        anew = {operation for sequence in sequences if sequence for operation in sequence.operations}
        self.set(ran=tuple(operation for operation in self.now.ran if operation not in anew))
        self.pursue(name, Pursuit(Status.EXECUTING, promised(self.model, name)))

    def cancel(self, name: str) -> None:
        if name in self.now.intentions:
            if self.now.intentions[name].status is not Status.INITIAL:
                self.pursue(name, Pursuit(Status.CANCELLED))
                self.set(course=None)
                self.need(Cause.CHANGED)
        elif any(execution.task.operation.name == name for execution in self.now.executing):
            self.set(executing=tuple(e for e in self.now.executing if e.task.operation.name != name), course=None, following=None)
            self.note("operation", f"'{name}' is cancelled", operation=name, state="initial")
            self.need(Cause.CHANGED)

    def assign(self, values: Mapping[str, Value]) -> None:
        """Decision and estimated variables may be changed from outside at any time (Def. 6)."""
        mine = (VariableKind.DECISION, VariableKind.ESTIMATED)
        own = {v.name: v for v in self.model.variables if v.kind in mine}
        accepted = {name: value for name, value in values.items() if name in own and value in own[name].domain}
        refused = [name for name in values if name not in accepted]
        if refused:
            self.note("refused", f"{', '.join(refused)}: not a decision or estimated variable, or not a value of it")
        before = self.now.state
        self.believe(accepted)
        if self.now.state != before:
            changes = self.system.changes(before, self.now.state)
            self.note("assigned", ", ".join(f"{n} = {v}" for n, v in changes.items()), changes=changes)
            self.need(Cause.CHANGED)
            self.look_again()

    def reenable(self, name: str) -> None:
        if name in self.now.disabled:
            self.enable_again([name])
        elif name in self.now.lost:
            if self.now.hubs[name].state is not None and not self.is_silent(name):
                self.regain(name)
        elif name in self.now.intentions and self.now.intentions[name].status is Status.ERROR:
            self.pursue(name, replace(self.now.intentions[name], status=Status.EXECUTING, reason=""))
            self.need(Cause.RESUMED)
        else:
            self.allow_again(
                [t.name for t in tasks(self.model) if name in (t.name, t.operation.name) and t.name in self.now.failed]
            )

    # --- the operator ---------------------------------------------------------------------------------------

    def wish(self, wish: Wish) -> None:
        """Ask the operator, once."""
        if any(known == replace(wish, confirmed_at=known.confirmed_at) for known in self.now.wishes.values()):
            return
        number = self.now.wished + 1
        request = f"{self.now.epoch}.{number}"
        self.set(wished=number, wishes={**self.now.wishes, request: wish})
        if wish.transition is not None and wish.kind is WishKind.MAINTENANCE:
            self.out.append(Instruct(request, wish.transition, wish.text))
        else:
            self.out.append(Consent(request, wish.text))

    def granted(self, request: str) -> None:
        self.set(wishes={name: wish for name, wish in self.now.wishes.items() if name != request})

    def keep_wishes(self, following: Following | None) -> None:
        """What the operator was asked for stays asked if the new plan has it too; the rest is withdrawn."""
        kept = {}
        steps = {following.plan.trace.path[at]: at for at in reversed(following.ready())} if following else {}
        for request, wish in self.now.wishes.items():
            if wish.kind is WishKind.RETRY or (wish.kind is WishKind.SUBSTITUTE and self.now.halted):
                kept[request] = wish
            elif wish.kind is WishKind.MAINTENANCE and wish.transition in steps:
                kept[request] = replace(wish, step=steps[wish.transition])
            else:
                self.out.append(Withdraw(request))
        self.set(wishes=kept)

    def confirm(self, request: str) -> None:
        """Done, says the operator. Confirming twice, or what is no longer wanted, changes nothing."""
        wish = self.now.wishes.get(request)
        if wish is None or wish.kind is not WishKind.MAINTENANCE:
            return
        if wish.confirmed_at is None:
            self.set(wishes={**self.now.wishes, request: replace(wish, confirmed_at=self.now.at)})
            self.note("confirmed", f"{wish.transition}", transition=wish.transition)

    def approve(self, request: str) -> None:
        wish, following = self.now.wishes.get(request), self.now.following
        if wish is None or wish.kind is WishKind.MAINTENANCE:
            return
        self.granted(request)
        self.note("approved", wish.text)
        match wish.kind:
            case WishKind.APPROVAL if following and wish.step is not None:
                self.set(following=replace(following, approved=following.approved.union([wish.step])))
            case WishKind.SUBSTITUTE:
                self.set(halted=None)
            case WishKind.RETRY:
                self.allow_again([name for name in self.now.spent if wish.transition in (None, name)])

    def performed(self) -> bool:
        """Maintenance that was confirmed, and that sensors show where there are any: it is done (section 4.5)."""
        following = self.now.following
        if following is None or self.thinking:
            return False
        for request, wish in self.now.wishes.items():
            if wish.kind is not WishKind.MAINTENANCE or wish.confirmed_at is None or wish.step is None:
                continue
            target = self.target(following, wish.step)
            now = self.system.named(self.now.state)
            unseen = [n for n, value in target.items() if self.is_live(n) and now[n] != value]
            if not unseen:
                self.granted(request)
                if wish.step not in following.ready() or not self.was_possible(following, wish.step):
                    self.note("unseen", f"'{wish.transition}' was confirmed, but it is not its time any more")
                    self.need(Cause.DEVIATION)
                    return True
                self.command_by_hand({n: value for n, value in target.items() if not self.is_live(n)})
                self.set(following=replace(following, done=following.done.union([wish.step])))
                self.look_again()
                text = f"'{wish.transition}' is done"
                self.note("fired", text, transition=wish.transition, by="operator", changes=dict(target))
                return True
            if self.now.at - wish.confirmed_at > CONFIRMED:
                self.granted(request)
                self.note("unseen", f"'{wish.transition}' was confirmed, but '{unseen[0]}' is {now[unseen[0]]}")
                self.wish(replace(wish, confirmed_at=None))
                return True
        return False

    def was_possible(self, following: Following, at: int) -> bool:
        """Whether a maintenance step's guard held before the sensors showed that it was done."""
        plan, system = following.plan, following.plan.problem.system
        before, target = plan.trace.states[at], self.target(following, at)
        state = list(self.now.state)
        for name in target:
            if self.is_live(name) or self.is_goal(name):
                state[system.index[name]] = before[system.index[name]]
        return bool(fire(system, system.transition[plan.trace.path[at]], tuple(state)))

    def target(self, following: Following, at: int) -> Mapping[str, Value]:
        """What a maintenance step of the plan makes of the variables it assigns."""
        trace, system = following.plan.trace, following.plan.problem.system
        transition = system.transition[trace.path[at]]
        fixed = {a.variable: trace.states[at + 1][system.index[a.variable]] for a in transition.actions}
        return fixed

    def at_work(self) -> bool:
        """Whether sensors show what the operator was asked to do before he has said that he is done: then all wait for him."""
        following, now = self.now.following, self.now.state
        if following is None:
            return False
        for wish in self.now.wishes.values():
            if wish.kind is not WishKind.MAINTENANCE or wish.confirmed_at is not None or wish.step is None:
                continue
            before, system = following.plan.trace.states[wish.step], following.plan.problem.system
            live = {n: value for n, value in self.target(following, wish.step).items() if self.is_live(n)}
            shown = all(now[self.system.index[n]] == value for n, value in live.items())
            if shown and any(before[system.index[n]] != value for n, value in live.items()):
                return True
        return False

    def is_live(self, variable: str) -> bool:
        """Whether sensors tell the value: it is measured, and its hub is there."""
        at = self.system.index[variable]
        resource = self.system.variables[at].resource
        return self.system.variables[at].kind is VariableKind.MEASURED and resource not in self.now.lost

    def is_goal(self, variable: str) -> bool:
        return self.system.variables[self.system.index[variable]].kind is VariableKind.GOAL

    # --- the planners ---------------------------------------------------------------------------------------

    def answered(self, revision: int, decision: Decision) -> None:
        """Take a decision, unless something has happened since the question (DESIGN: stale answers are dropped)."""
        asked = self.now.asked
        if asked is None or asked.revision != revision:
            return
        self.set(asked=None)
        if self.now.cause is not None:
            self.note("stale", "the answer came too late: asking again")
            if asked.recheck:
                self.look_again()
            else:
                self.need(asked.cause, asked.blamed)
            return
        if decision.actions:
            told = "; ".join(f"{a.name} {'ok' if a.reached else 'no plan'} ({a.what})" for a in decision.actions)
            self.note("decision", told, cause=asked.cause.value, actions=decision.actions)
        if decision.undecided is not None:
            wait = min(PATIENCE[0] * 2**self.now.troubles, PATIENCE[1])
            self.set(not_before=self.now.at + wait, troubles=self.now.troubles + 1)
            self.note("alarm", f"no decision: {decision.undecided}; asking again in {wait:g} s")
            if asked.recheck:
                self.look_again()
            else:
                self.need(asked.cause, asked.blamed)
            return
        self.set(troubles=0)
        if asked.recheck:
            self.adopt_recheck(decision)
        elif not self.used_up(asked, decision):
            self.adopt(decision, asked.cause)

    def adopt_recheck(self, decision: Decision) -> None:
        """What was in error is possible again, or with the operator's help if nothing else goes on."""
        if decision.possible:
            self.allow_again(decision.possible)
        elif decision.reachable:
            for name in decision.reachable:
                self.pursue(name, replace(self.now.intentions[name], status=Status.EXECUTING, reason=""))
            self.need(Cause.RESUMED)
        elif decision.following is not None and not (self.now.following or self.now.executing):
            self.adopt(decision, Cause.RESUMED)
        elif decision.stuck and not (self.now.stuck or self.now.wanted()):  # a planner that began anew says it again
            why = "; ".join(f"'{name}': {self.now.intentions[name].reason}" for name in self.in_error())
            self.set(stuck=why or decision.stuck)
            self.note("alarm", why or decision.stuck)

    def used_up(self, asked: Asked, decision: Decision) -> bool:
        """Count failures: an operation that had to be planned again once too often is in error (section 6.2)."""
        again = any(a.name.startswith("TP") and a.reached for a in decision.actions)
        if asked.cause not in (Cause.DEVIATION, Cause.TIMEOUT) or not again:
            return False
        before = {execution.task.operation.name for execution in self.now.executing}
        tried = [e for e in decision.executing if e.task.operation.name in before & asked.blamed]
        failures = dict(self.now.failures)
        spent: dict[str, str] = {}
        for execution in tried:
            operation = execution.task.operation
            failures[operation.name] = failures.get(operation.name, 0) + 1
            if operation.retries is not None and failures[operation.name] > operation.retries:
                spent |= {task.name: f"failed {failures[operation.name]} times" for task in tasks_of(operation)}
        self.set(failures=failures)
        if not spent:
            return False
        self.fail(spent)
        self.set(
            spent=self.now.spent.union(spent),
            executing=tuple(e for e in self.now.executing if e.task.name not in spent),
            course=None,
            following=None,
        )
        self.after_error(spent, {})
        self.need(asked.cause)
        return True

    def fail(self, failed: Mapping[str, str]) -> None:
        for name, why in failed.items():
            self.note("operation", f"'{name}' is in error: {why}", operation=name, state="error")
        at = dict.fromkeys(failed, self.now.at)
        self.set(failed={**self.now.failed, **failed}, failed_at={**self.now.failed_at, **at})

    def adopt(self, decision: Decision, cause: Cause) -> None:
        """Follow a decision."""
        self.keep_wishes(decision.following)
        self.fail(decision.failed)
        for name, why in decision.given_up.items():
            self.pursue(name, replace(self.now.intentions[name], status=Status.ERROR, reason=why))
        before = {execution.task.operation.name for execution in self.now.executing}
        after = {execution.task.operation.name for execution in decision.executing}
        for name in sorted(before - after):
            self.note("operation", f"'{name}' goes back to initial", operation=name, state="initial")
        for execution in decision.executing:
            if execution.task.operation.name not in before:
                self.note("operation", f"'{execution.task.name}' starts", operation=execution.task.name, state="executing")
        self.set(executing=decision.executing, course=decision.course, following=decision.following, stuck=decision.stuck)
        if decision.following is not None:
            self.begin_operations(decision, before)
        if decision.stuck:
            self.note("alarm", decision.stuck)
            for name in sorted(self.now.spent):
                self.wish(Wish(WishKind.RETRY, f"Operation '{name}' {self.now.failed[name]}. Try again?", transition=name))
        replaced = cause is Cause.LOST and any(not action.ordinary for action in decision.actions)
        self.after_error(decision.failed, self.now.lost if replaced or decision.failed else {})

    def begin_operations(self, decision: Decision, running: Collection[str]) -> None:
        """What starting operations assigns (`on_start`): the plan begins there."""
        assert decision.following is not None
        begun = self.system.named(decision.following.plan.problem.initial)
        new = [e.task.operation for e in decision.executing if e.task.operation.name not in running]
        assigned = [action.variable for operation in new for action in operation.on_start]
        self.believe({name: begun[name] for name in assigned if name in begun})

    def after_error(self, failed: Iterable[str], lost: Iterable[str]) -> None:
        """`on_error`: go on with a substitute, ask for approval first, or halt (section 7)."""
        by_task = {task.name: task.operation for task in tasks(self.model)}
        said = {name: by_task[name].on_error for name in failed}  # what the scenario says for all is in these already
        said |= {name: self.station.resources[name].on_error for name in lost}
        names = ", ".join(f"'{name}'" for name in said)
        if OnError.HALT in said.values():
            self.set(halted=f"{names} failed")
            self.note("alarm", f"{names} failed: halted until told to proceed")
        elif OnError.ASK in said.values() and not self.now.halted:
            self.set(halted=f"{names} failed")
            self.wish(Wish(WishKind.SUBSTITUTE, f"{names} failed. Go on with what replaces it?"))

    def ask(self) -> None:
        """Put what is needed to the planners. A look at what is in error comes last, and gives way to everything else."""
        now = self.now
        if now.asked and now.at - now.asked.at > OVERDUE:
            self.note("alarm", f"question {now.asked.revision} was never answered")
            if now.asked.recheck:
                self.look_again()
            else:
                self.need(now.asked.cause, now.asked.blamed)
            self.set(asked=None)
            now = self.now
        if now.phase is not Phase.RUNNING or now.at < now.not_before or self.thinking:
            return
        if now.cause is not None:
            if now.asked:
                self.look_again()
            self.put(Asked(now.revision + 1, now.cause, now.at, blamed=now.blamed))
            self.set(cause=None, blamed=frozenset())
        elif now.recheck and not now.asked and now.at - now.rechecked >= RECHECK:
            self.set(recheck=False, rechecked=now.at)
            if set(now.failed) - now.spent or self.in_error():
                self.put(Asked(now.revision + 1, Cause.RESUMED, now.at, recheck=True))

    def put(self, asked: Asked) -> None:
        request = replace(self.request(asked.cause), recheck=asked.recheck)
        self.set(revision=asked.revision, asked=asked)
        self.out.append(Ask(asked.revision, request))

    def request(self, cause: Cause) -> Request:
        now = self.now

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

    # --- advancing ------------------------------------------------------------------------------------------

    def advance(self) -> None:
        """Everything that follows from the situation as it is now."""
        if self.now.phase is Phase.FENCED_OUT and self.outvoted():
            self.note("alarm", "all hubs obey this planner all the same: joining anew")
            self.begin(self.now.planner)
        if self.now.phase in (Phase.LISTENING, Phase.JOINING):
            self.take_over()
        if self.now.phase in (Phase.JOINING, Phase.RUNNING):
            self.watch_hubs()
        if self.now.phase is Phase.RUNNING:
            for _ in range(SETTLING):
                if not (self.performed() or self.automatic() or self.progress() or self.command()):
                    break
            else:
                self.set(halted=UNSETTLED)
                self.note("alarm", f"{UNSETTLED}: halted after {SETTLING} steps")
            self.watch_effects()
            self.ask()
        if self.now.phase in (Phase.JOINING, Phase.RUNNING):
            self.send()

    def automatic(self) -> bool:
        """Take the automatic transition that is due, if any."""
        held = self.now.halted or self.at_work()  # then no operation ends; what is always taken, is
        due = self.station.steps(() if held else self.now.executing).automatic(self.now.state)
        if due is None or self.now.halted == UNSETTLED:
            return False
        transition, state = due
        before = self.now.state
        self.reach(state)
        changes = self.system.changes(before, state)
        self.told |= {r for name in changes if self.is_goal(name) and (r := self.system.resources[name]) is not None}
        self.note("fired", f"{transition.name}", transition=transition.name, by="automatic", changes=changes)
        following = self.now.following
        if following and not self.follow([transition.name]):
            self.need(Cause.DEVIATION)
        return True

    def progress(self) -> bool:
        """Operations that are done, intentions that begin or end, invariants that are broken or hold again."""
        if not (self.now.halted or self.at_work()) and (self.operations_end() or self.intentions_move()):
            return True
        broken = self.station.broken(self.now.state)
        if broken != self.now.broken:
            self.guard_invariants(broken)
        following = self.now.following
        if following and following.finished and not self.thinking:
            self.set(following=None)
            if following.purpose is Purpose.EXIT or self.now.executing:
                self.need(Cause.RESUMED)
        self.see_what_may_start()
        return False

    def see_what_may_start(self) -> None:
        """Operations that were waiting for their guard."""
        now = self.now
        if now.course is None or now.executing or now.following or now.asked or now.cause or now.halted or now.broken:
            return
        if any(self.holds(now.course.plan.tasks[at].operation.guard) for at in now.course.ready()):
            self.need(Cause.PROGRESS)

    def guard_invariants(self, broken: frozenset[str]) -> None:
        self.set(broken=broken)
        if broken:
            names = ", ".join(f"'{name}'" for name in sorted(broken))
            following = self.now.following
            if following and following.purpose is Purpose.EXIT and broken <= following.lifted:
                return
            self.note("alarm", f"forbidden: {names} violated, or about to be", invariants=tuple(sorted(broken)))
            self.set(executing=(), course=None)
            self.need(Cause.FORBIDDEN)
        else:
            self.note("allowed", "all invariants hold again")
            self.need(Cause.RESUMED)

    def operations_end(self) -> bool:
        for execution in self.now.executing:
            ended = self.ended_as(execution)
            if ended is None:
                continue
            operation = execution.task.operation
            course = self.now.course.ended(operation.name) if self.now.course else None
            others = tuple(e for e in self.now.executing if e is not execution)
            names = [task.name for task in tasks_of(operation)]
            revived = any(name in self.now.failed for name in names)
            self.set(
                executing=others,
                course=course,
                ran=(*self.now.ran, operation.name)[-RAN:],
                failures={n: count for n, count in self.now.failures.items() if n != operation.name},
                failed={n: why for n, why in self.now.failed.items() if n not in names},
            )
            self.note("operation", f"'{ended}' is done", operation=ended, state="initial")
            if not others:
                self.set(following=None)
            self.need(Cause.PROGRESS)
            if revived:
                self.revive()
            self.look_again()
            return True
        return False

    def ended_as(self, execution: Execution) -> str | None:
        """The outcome that an operation has ended with, when its post-condition is reached."""
        for task in tasks_of(execution.task.operation):
            one = replace(execution, task=task)
            if self.holds(goal_of(self.model, one)):
                return task.name
        return None

    def holds(self, predicate: Expr) -> bool:
        judge = self.station.judges.get(predicate)
        if judge is None:
            judge = self.station.judges[predicate] = meaning(predicate, self.system.index)
        return bool(judge(self.now.state))

    def intentions_move(self) -> bool:
        for name, pursuit in self.now.intentions.items():
            starts = self.station.starts[name](self.now.state)
            match pursuit.status:
                case Status.INITIAL if starts:
                    self.begin_intention(name)
                    self.need(Cause.PROGRESS)
                    return True
                case Status.FINISHED | Status.CANCELLED if not starts:
                    self.pursue(name, Pursuit())
                    return True
                case Status.EXECUTING | Status.ERROR if pursuit.owed is not None and self.reached(pursuit):
                    self.finish(name)
                    return True
        return False

    def reached(self, pursuit: Pursuit) -> bool:
        """Whether nothing more has to happen for `formula U goal`."""
        assert pursuit.owed is not None
        return self.station.met(pursuit.owed, self.now.state)

    def finish(self, name: str) -> None:
        """The goal is reached: the intention's actions are applied (Def. 6)."""
        self.pursue(name, Pursuit(Status.FINISHED))
        values = {
            action.variable: meaning(action.value, self.system.index)(self.now.state)
            for action in self.station.intentions[name].actions
            if not isinstance(action.value, Any)
        }
        outside = [variable for variable, value in values.items() if value not in self.system.domains[variable]]
        if outside:
            self.note("refused", f"what '{name}' does in the end would leave the domain of '{outside[0]}'")
        self.believe({variable: value for variable, value in values.items() if variable not in outside})
        self.look_again()
        following = self.now.following
        if self.now.executing or self.now.wanted():
            self.need(Cause.PROGRESS)
        elif following is None or following.purpose is not Purpose.EXIT:
            self.set(course=None, following=None)

    def pursue(self, name: str, pursuit: Pursuit) -> None:
        self.set(intentions={**self.now.intentions, name: pursuit})
        text = f"'{name}' is {pursuit.status.value}" + (f": {pursuit.reason}" if pursuit.reason else "")
        self.note("intention", text, intention=name, state=pursuit.status.value)

    def command(self) -> bool:
        """Take the next controlled step that the plan allows; ask the operator for what is his (sections 4.1, 4.5)."""
        now, following = self.now, self.now.following
        if following is None or self.thinking or now.cause is not None or now.halted or self.at_work():
            return False
        if now.broken and following.purpose is not Purpose.EXIT:
            return False
        plan = following.plan
        for at in following.ready():
            transition = plan.problem.system.transition[plan.trace.path[at]]
            if transition.kind is Kind.MAINTENANCE:
                text = transition.instruction or f"Do '{transition.name}' and acknowledge."
                self.wish(Wish(WishKind.MAINTENANCE, text, at, transition.name))
            elif transition.kind is Kind.CONTROLLED and self.obeyed(transition) and self.beyond_doubt(transition):
                if following.purpose is Purpose.EXIT and at not in following.approved:
                    self.wish(
                        Wish(WishKind.APPROVAL, f"'{transition.name}' on the way out of a forbidden state", at, transition.name)
                    )
                    continue
                if self.take(following, at, transition):
                    return True
                self.need(Cause.DEVIATION)
                return False
        return False

    def obeyed(self, transition: Transition) -> bool:
        """Whether the hubs that a transition commands are there and obey this planner, and those it depends on have followed.

        A plan gives commands one after the other, and a network does not: what an earlier one asked of another hub may
        still be on its way, and the two together forbidden.
        """
        for name in sorted({r for v in transition.assigned if (r := self.system.resources[v]) is not None}):
            view = self.now.hubs.get(name)
            if view is not None and (name in self.now.lost or not self.rules(view)):
                return False
        return all(name in self.now.lost or self.mirrors(name) for name in self.station.tied.get(transition.name, ()))

    def beyond_doubt(self, transition: Transition) -> bool:
        """Whether a step is allowed, too, if lost hubs obey the commands that they have not mirrored."""
        now = self.now
        if not now.doubts:
            return True
        doubted = {variable: value for values in now.doubts.values() for variable, value in values.items()}
        state = tuple(doubted.get(v.name, value) for v, value in zip(self.system.variables, now.state, strict=True))
        after = fire(self.system, self.system.transition[transition.name], state)
        if all(self.station.broken(one) <= self.station.broken(state) for one in after):
            return True
        if now.stuck is None:
            names = ", ".join(f"'{name}'" for name in now.doubts)
            why = f"'{transition.name}' has to wait: {names} may have got a command that makes it forbidden"
            self.set(stuck=why)
            self.note("alarm", why)
        return False

    def mirrors(self, name: str) -> bool:
        """Whether a hub says that it obeys everything that is asked of it now."""
        state = self.now.hubs[name].state
        return state is not None and dict(state.mirror) == self.goal_state(name)

    def take(self, following: Following, at: int, transition: Transition) -> bool:
        """Fire a controlled transition as the plan has it; False if that is not possible in the present state."""
        plan = following.plan
        chosen = self.target(following, at)
        free = [a.variable for a in transition.actions if isinstance(a.value, Any)]
        system = plan.problem.system
        for state in fire(system, transition, self.now.state):
            if all(state[system.index[name]] == chosen[name] for name in free):
                break
        else:
            return False
        lifted = following.lifted if following.purpose is Purpose.EXIT else frozenset()
        if self.station.broken(state) - lifted:
            return False
        changes = self.system.changes(self.now.state, state)
        self.reach(state)
        self.set(following=replace(following, done=following.done.union([at])))
        self.note("fired", transition.name, transition=transition.name, by="controlled", changes=changes)
        return True

    # --- sending --------------------------------------------------------------------------------------------

    def send(self) -> None:
        """Goal states: at once when they change, and all of them every period."""
        before = self.now
        periodic = before.at - before.sent_at >= self.model.period - 1e-9
        for name in before.hubs:
            # What a hub that has not spoken yet was told in an earlier reign is no reason to tell it so again.
            if name not in before.heard or before.hubs[name].state is None:
                continue
            values, told = self.goal_state(name), before.hubs[name].commanded
            if values != told:
                refused = gate.refused(self.station, before, name, values, name in self.told)
                if refused is None:
                    self.tell(name, values)
                elif before.sequence[name]:
                    self.note("gate", f"'{name}' keeps its command: {refused}", resource=name)
            new = self.now.sequence[name] != before.published.get(name, 0)
            if self.now.sequence[name] and (new or periodic):
                interface, told = self.station.interfaces[name], self.now.hubs[name].commanded
                number, planner = self.now.sequence[name], before.planner
                message = GoalMessage(interface.cell, name, before.epoch, number, planner, interface.model, told)
                self.out.append(Send(message))
        if periodic or self.now.sequence != before.published:
            self.set(published=self.now.sequence, sent_at=before.at if periodic else before.sent_at)

    def goal_state(self, name: str) -> dict[str, Value]:
        return {v.name: self.now.state[self.system.index[v.name]] for v in self.station.goals[name]}


def _remaining(following: Following) -> list[int]:
    return [at for at in range(len(following.plan.trace.path)) if at not in following.done]
