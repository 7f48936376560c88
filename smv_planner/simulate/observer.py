"""Who watches a simulated station and trusts nobody: what must never happen, judged by code that the runner does not use.

It knows the model, its widened invariants, what is true of the devices, every byte on the wire, and which decisions were
handed to a process. What only the planner can know, estimated and decision variables, it has from the planner. The names of
the rules are those of `facts of reliability`, section 3:

I1  no commanded joint state is forbidden, nor can it slide into one, but on an approved way out of forbidden states
I2  a controlled transition was enabled in what was last heard, and what was last heard is what is believed
I3  it is a step of the plan decided on last, in its order, and nobody is thinking about another
I4  the bytes say what was meant, to the hub that they are for
I5  commands to a hub are numbered upwards within an epoch, epochs upwards, and the event is in the journal before
I6  no new command for a resource that is silent, or that does not do as it is told
I7  the kernel accepts the plan, for this model
I10 nothing grows without bound
true  what hubs obey and devices do violates no invariant, unless people's hands or words, or a lie, have made it so
fence  no two planners' commands are obeyed together
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

from smv_planner.check import CheckedPlan, check_plan
from smv_planner.lazy import dataclass, field
from smv_planner.model.domains import Value
from smv_planner.model.expressions import meaning
from smv_planner.model.semantics import fire
from smv_planner.model.system import Kind, State, System, Transition, VariableKind
from smv_planner.protocol.messages import GoalMessage, StateMessage, decode_goal
from smv_planner.runner import events
from smv_planner.runner.decision import Following, Purpose
from smv_planner.runner.events import Answered, Approve, Ask, Confirm, Event, Instruct, Note, Ordered, Output, Send
from smv_planner.runner.situation import Phase, Situation, Station
from smv_planner.simulate.process import Process
from smv_planner.simulate.world import Watch, World

SLACK = 0.5
"""Seconds that a planner may take to see that a resource has gone: two periods, and a little."""


@dataclass(frozen=True, slots=True)
class Violation:
    at: float
    rule: str
    text: str

    def __str__(self) -> str:
        return f"{self.at:.3f} {self.rule}: {self.text}"


@dataclass
class Heard:
    """The newest that has reached a process from one hub, and since when it mirrors something else than it was told."""

    message: StateMessage
    sent_at: float
    at: float
    differs: dict[str, tuple[Value, float]] = field(default_factory=dict)


@dataclass
class Reign:
    """What was seen of one process."""

    heard: dict[str, Heard] = field(default_factory=dict)
    published: dict[str, GoalMessage] = field(default_factory=dict)
    following: Following | None = None
    done: set[int] = field(default_factory=set)
    approved: set[int] = field(default_factory=set)
    explained: set[str] = field(default_factory=set)
    automatic: set[str] = field(default_factory=set)
    instructed: dict[str, str] = field(default_factory=dict)
    confirmed: set[str] = field(default_factory=set)
    enabled: dict[str, float] = field(default_factory=dict)
    question: int = 0
    written: int = 0


class Observer(Watch):
    """`violations` is what was seen; `counts` how much was looked at, so that nobody mistakes silence for innocence."""

    def __init__(self, station: Station) -> None:
        self.station, self.system = station, station.system
        self.violations: list[Violation] = []
        self.counts: Counter[str] = Counter()
        self.excused = 0.0
        self._widened = {w.declared.name: meaning(w.invariant.predicate, self.system.index) for w in station.widened}
        self._declared = {i.name: meaning(i.predicate, self.system.index) for i in station.model.invariants}
        self._reigns: dict[int, Reign] = {}
        self._epochs: dict[int, int] = {}
        self._obeyed: dict[str, tuple[str, tuple[int, int]]] = {}
        self._accepted: dict[int, CheckedPlan] = {}
        self._judged: dict[State, frozenset[str]] = {}
        self._true: dict[str, object] = {}
        self._sent_at: dict[tuple[str, str, int], float] = {}
        self.world: World | None = None

    def watching(self, world: World) -> World:
        self.world = world
        world.watch = self
        return world

    @property
    def _at(self) -> float:
        return self.world.at if self.world else 0.0

    def excuse(self, seconds: float = 30.0) -> None:
        """Somebody does something that no model knows of; for a while the planner is not to blame for what is true."""
        self.excused = max(self.excused, self._at + seconds)

    handled = excuse

    def complain(self, rule: str, text: str) -> None:
        self.violations.append(Violation(self._at, rule, text))

    def _reign(self, process: Process) -> Reign:
        found = self._reigns.get(id(process))
        if found is None:
            found = self._reigns[id(process)] = Reign(written=process.written)
        return found

    # --- what reaches a process

    def reported(self, message: StateMessage) -> None:
        self._sent_at[message.resource, message.boot, message.seq] = self._at

    def heard(self, process: Process, message: StateMessage) -> None:
        known, sent_at = self._reign(process).heard, self._sent_at[message.resource, message.boot, message.seq]
        old = known.get(message.resource)
        if old is None or sent_at > old.sent_at:
            known[message.resource] = Heard(message, sent_at, self._at, self._differing(process, message, old))

    def _differing(self, process: Process, message: StateMessage, old: Heard | None) -> dict[str, tuple[Value, float]]:
        told = self._reign(process).published.get(message.resource)
        if told is None or (old and old.message.boot != message.boot):
            return {}
        differs = {}
        for name, value in told.values.items():
            if message.mirror[name] != value:
                mirrored, since = old.differs.get(name, (None, 0.0)) if old else (None, 0.0)
                differs[name] = (message.mirror[name], since if mirrored == message.mirror[name] else self._at)
        return differs

    # --- what a process makes of it

    def turned(self, process: Process, event: Event, before: Situation, outputs: tuple[Output, ...]) -> None:
        reign, after = self._reign(process), process.situation
        self.counts["turns"] += 1
        match event:
            case events.Heard(_, message):
                self.heard(process, message)
            case Ordered(_, Confirm(request)) if request in reign.instructed:
                reign.confirmed.add(request)
        self.clocks(reign, before, after)
        self.decided(reign, event, before, after)
        if isinstance(event, events.Tick):
            self.bounded(after)
        if all(isinstance(output, Send) for output in outputs):
            return
        state = self.believed(reign, event, before, after)
        for output in outputs:
            match output:
                case Ask(revision):
                    reign.question = revision
                case Instruct(request, transition):
                    reign.instructed[request] = transition
                case Note("timeout"):
                    self.timed_out(reign, str(output.data["transition"]))
                case Note("fired"):
                    state = self.fired(process, reign, output, state, after, before)
                case Note("measured"):
                    self.tick_off(reign, output.data.get("effects") or ())
                    if output.data.get("explained") == "maintenance":  # the goals of what is moved by hand go with it
                        reign.explained.update(*(self.system.transition[t].assigned for t in reign.instructed.values()))
                case Note("assigned"):
                    state = self.changed(state, output.data["changes"])
                case _:
                    pass

    def decided(self, reign: Reign, event: Event, before: Situation, after: Situation) -> None:
        match event:
            case Answered(_, revision, decision) if revision == reign.question:
                reign.question = 0
                new = decision.following
                if new is not None and after.following is not None and after.following.plan is new.plan:  # not a stale one
                    reign.following, reign.done, reign.approved = new, set(new.done), set(new.approved)
                    self.certified(new.plan)
                    self.counts_on(new, before)
            case Ordered(_, Approve(request)) if request in before.wishes:
                step = before.wishes[request].step
                if step is not None:
                    reign.approved.add(step)

    def counts_on(self, following: Following, before: Situation) -> None:
        """A plan counts on nothing that was known not to happen when it was decided on."""
        path = following.plan.trace.path
        late = [name for at, name in enumerate(path) if at not in following.done and name in before.disabled]
        if late:
            self.complain("I7", f"a plan counts on '{late[0]}', which has timed out")

    def clocks(self, reign: Reign, before: Situation, after: Situation) -> None:
        """Since when each effect has been enabled in what is believed."""
        if after.phase is not Phase.RUNNING:
            reign.enabled.clear()
        elif after.state is not before.state or before.phase is not Phase.RUNNING:
            state, system = after.state, self.system
            now = [e.name for e in self.station.effects if e.within is not None and fire(system, e, state)]
            reign.enabled = {name: reign.enabled.get(name, self._at) for name in now}

    def timed_out(self, reign: Reign, name: str) -> None:
        within, since = self.system.transition[name].within, reign.enabled.get(name)
        assert within is not None
        if since is None or self._at - since < within - 1e-6:
            self.complain("I2", f"'{name}' is said to be late, {self._at - (since or self._at):.2f} s after it became possible")

    def by_hand(self, reign: Reign, name: str) -> None:
        """What a person does is done when it was asked for and confirmed, once."""
        for request in sorted(reign.confirmed):
            if reign.instructed[request] == name:
                reign.confirmed.remove(request)
                del reign.instructed[request]
                return
        self.complain("I3", f"'{name}' counts as done, and nobody has confirmed it")

    def certified(self, plan: CheckedPlan) -> None:
        if id(plan) in self._accepted:
            return
        self._accepted[id(plan)] = plan
        self.counts["plans"] += 1
        system = plan.problem.system
        if (system.base or system) is not self.system:
            self.complain("I7", "a plan for another model")
        elif not isinstance(check_plan(plan.problem, plan.trace), CheckedPlan):
            self.complain("I7", "the kernel refuses a plan that was adopted")

    def believed(self, reign: Reign, event: Event, before: Situation, after: Situation) -> State:
        """What is to be believed before the turn's own steps: measured values as last heard, the rest as it was."""
        values = list(before.state)
        for name, heard in reign.heard.items():
            if name not in after.heard:
                continue
            back = name in before.lost and name not in after.lost
            adopted = name not in before.heard or before.phase is not Phase.RUNNING or back
            rebooted = before.hubs[name].state is not None and before.hubs[name].state.boot != heard.message.boot  # type: ignore[union-attr]
            for variable, value in heard.message.measured.items():
                at = self.system.index[variable]
                if name in after.lost:
                    values[at] = after.state[at]
                else:
                    values[at] = value
                    if after.state[at] != value and after.phase is Phase.RUNNING:
                        self.complain("I2", f"'{variable}' was last heard to be {value}, and is believed to be {after.state[at]}")
            if adopted or rebooted:
                for variable, value in heard.message.mirror.items():
                    values[self.system.index[variable]] = value
        return tuple(values)

    def fired(self, process: Process, reign: Reign, note: Note, state: State, after: Situation, before: Situation) -> State:
        """One step that the runner says it has taken."""
        name, by = str(note.data["transition"]), note.data["by"]
        changes: Mapping[str, Value] = note.data["changes"]  # type: ignore[assignment]
        self.counts[f"{by} steps"] += 1
        reign.explained.update(changes)
        if by == "automatic":
            reign.automatic.update(changes)
        transition = self._transition(reign, name)
        if by == "controlled":
            self.allowed_to(process, reign, name, transition, state, changes, after, before)
        elif by == "operator":
            self.by_hand(reign, name)
        self.tick_off(reign, [name])
        return self.changed(state, changes)

    def _transition(self, reign: Reign, name: str) -> Transition | None:
        systems: list[System] = [self.system]
        if reign.following:
            systems.insert(0, reign.following.plan.problem.system)
        return next((s.transition[name] for s in systems if name in s.transition), None)

    def allowed_to(
        self,
        process: Process,
        reign: Reign,
        name: str,
        transition: Transition | None,
        state: State,
        changes: Mapping[str, Value],
        after: Situation,
        before: Situation,
    ) -> None:
        assert transition is not None
        target = self.changed(state, changes)
        # What only the planner knows may have moved in the same turn.
        told = self._with_own(state, after.state)
        if target not in fire(self.system, transition, state) and self.changed(told, changes) not in fire(
            self.system, transition, told
        ):
            self.complain("I2", f"'{name}' is not enabled in what was last heard, or does something else")
        automatic = [t.name for t in self.station.model.transitions if t.kind.automatic and fire(self.system, t, told)]
        if automatic:
            self.complain("I2", f"'{name}' is taken before '{automatic[0]}', which is automatic")
        if transition.kind is not Kind.CONTROLLED:
            self.complain("I3", f"'{name}' is {transition.kind.value}, and not for the runner to take")
        following = reign.following
        at = self.next_of(reign, name)
        if following is None or at is None:
            self.complain("I3", f"'{name}' is no step that the plan decided on last waits for")
        elif following.purpose is Purpose.EXIT and at not in reign.approved:
            self.complain("I1", f"'{name}' on the way out of a forbidden state was not approved")
        asked = before.asked if before.asked and after.asked and before.asked.revision == after.asked.revision else None
        if asked and not asked.recheck:  # a mere look at what is in error holds nothing up
            self.complain("I3", f"'{name}' while the planners are thinking")
        broken = self.forbidden(target)
        if broken and (following is None or following.purpose is not Purpose.EXIT or broken - following.lifted):
            self.complain("I1", f"'{name}' leads to where {', '.join(sorted(broken))} is violated or may be")
        for resource in {r for v in changes if (r := self.system.resources[v]) is not None}:
            self.available(process, reign, resource, f"'{name}'")

    def next_of(self, reign: Reign, name: str) -> int | None:
        following = reign.following
        if following is None:
            return None
        plan = following.plan
        for at, step in enumerate(plan.trace.path):
            if at not in reign.done and step == name and reign.done.issuperset(plan.after[at]):
                return at
        return None

    def tick_off(self, reign: Reign, names: object) -> None:
        assert isinstance(names, (list, tuple))
        for name in names:
            at = self.next_of(reign, name)
            if at is not None:
                reign.done.add(at)

    def available(self, process: Process, reign: Reign, resource: str, what: str) -> None:
        """I6, judged by what has reached the process, not by what it makes of it."""
        heard, limits = reign.heard.get(resource), self.station.resources[resource]
        if heard is None:
            self.complain("I6", f"{what} commands '{resource}', which has said nothing")
            return
        if limits.silent_after is not None and self._at - heard.at > limits.silent_after + SLACK:
            self.complain("I6", f"{what} commands '{resource}', silent for {self._at - heard.at:.2f} s")
        for variable, (_, since) in heard.differs.items():
            if heard.at - since > limits.mirror_within + SLACK:
                self.complain("I6", f"{what} commands '{resource}', which does not mirror '{variable}'")
        message = heard.message
        # A hub that has just started obeys nobody; whoever speaks to it first rules it.
        if message.epoch and (message.epoch, message.planner) != (process.situation.epoch, process.name):
            self.complain("fence", f"{what} commands '{resource}', which obeys {message.planner or 'nobody'} ({message.epoch})")

    def bounded(self, now: Situation) -> None:
        model, system = self.station.model, self.system
        sizes = {
            "timers": (len(now.timers), len(system.transitions)),
            "disabled": (len(now.disabled), len(system.transitions)),
            "lost": (len(now.lost), len(model.resources)),
            "failed": (len(now.failed), sum(len(o.outcomes) for o in model.operations)),
            "wishes": (len(now.wishes), len(system.transitions) + 3 * len(model.operations)),
            "executing": (len(now.executing), len(model.operations)),
            "rejected": (len(now.rejected), 20),
        }
        for name, (size, limit) in sizes.items():
            if size > limit:
                self.complain("I10", f"{size} {name}")

    # --- what enters the network

    def published(self, process: Process, message: GoalMessage, payload: bytes) -> None:
        reign, name = self._reign(process), message.resource
        self.counts["messages"] += 1
        newer = [other for other, heard in reign.heard.items() if heard.message.epoch > message.epoch]
        if newer:
            self.complain("fence", f"epoch {message.epoch} goes on though '{newer[0]}' was heard to obey a newer one")
        old = reign.published.get(name)
        if old == message:
            return
        reign.published[name] = message
        if decode_goal(payload, self.station.interfaces[name]) != message:
            self.complain("I4", f"the bytes for '{name}' are not the message")
        if old and (message.epoch, message.seq) <= (old.epoch, old.seq):
            self.complain("I5", f"'{name}' got ({message.epoch}, {message.seq}) after ({old.epoch}, {old.seq})")
        if old is None or message.epoch != old.epoch:
            self.new_epoch(process, message.epoch)
        if process.journal is not None and process.written <= reign.written:
            self.complain("I5", f"'{name}' was told something before it was in the journal")
        heard = reign.heard.get(name)
        if heard and dict(heard.message.mirror) == dict(message.values):
            return  # holding
        if old and old.epoch == message.epoch and dict(old.values) == dict(message.values):
            return
        mirrored = heard.message.mirror if heard else {}
        differs = {variable for variable, value in message.values.items() if mirrored.get(variable) != value}
        if (old is None or old.epoch != message.epoch) and not differs <= reign.automatic:  # those wait for nobody
            self.complain("I3", f"the first command of an epoch to '{name}' is not what it mirrors")
        self.counts["commands"] += 1
        for variable, value in message.values.items():
            asked = old is not None and old.values[variable] == value
            if not asked and variable not in reign.explained and variable in differs:
                self.complain("I3", f"'{variable}' is commanded to be {value}, and no step was taken that asks for it")
        reign.explained.difference_update(message.values)
        reign.automatic.difference_update(message.values)
        self.alone(process, message)

    def new_epoch(self, process: Process, epoch: int) -> None:
        """Processes with the same journal come one after the other, and so do their epochs."""
        key = id(process.disk) if process.disk is not None else id(process)
        if process.situation.epoch != epoch:
            self.complain("I5", f"a message of epoch {epoch} in epoch {process.situation.epoch}")
        last, owner = self._reigning.get(key, (0, 0))
        if owner != id(process) and epoch <= last:
            self.complain("I5", f"a new process publishes in epoch {epoch} after {last}")
        self._reigning[key] = (max(epoch, last), id(process))

    @property
    def _reigning(self) -> dict[int, tuple[int, int]]:
        if not hasattr(self, "_reigning_"):
            self._reigning_: dict[int, tuple[int, int]] = {}
        return self._reigning_

    def alone(self, process: Process, message: GoalMessage) -> None:
        """Once a planner changes a command, no hub that is there obeys an older one."""
        assert self.world is not None
        for name, emulator in self.world.hubs.items():
            obeyed = emulator.hub.obeyed
            older = obeyed is not None and obeyed.epoch < message.epoch
            if older and name not in process.situation.lost and name not in self.world.down:
                boot = self._reign(process).heard[name].message.boot if name in self._reign(process).heard else ""
                if boot == emulator.hub.boot:
                    self.complain("fence", f"epoch {message.epoch} commands while '{name}' obeys {obeyed.epoch}")  # type: ignore[union-attr]

    def finished(self, process: Process) -> None:
        self._reign(process).written = process.written

    # --- what is true

    def moved(self, name: str) -> None:
        assert self.world is not None
        emulator = self.world.hubs[name]
        hub, measured = emulator.hub, emulator.device.measured
        known = hub.boot, hub.epoch, hub.goal, measured
        if self._true.get(name) == known:
            return
        self._true[name] = known
        boot, last = self._obeyed.get(name, ("", (0, 0)))
        number = (hub.epoch, hub.obeyed.seq) if hub.obeyed else (0, 0)
        if boot == hub.boot and number < last:
            self.complain("fence", f"'{name}' goes back from goal {last} to {number}")
        self._obeyed[name] = hub.boot, number
        broken = self.truly_broken()
        if not broken or self._at < self.excused:
            self.counts["true states excused" if broken else "true states allowed"] += 1
        else:
            self.complain("true", f"{', '.join(broken)} violated by what hubs obey and devices do")

    def truly_broken(self) -> list[str]:
        """The declared invariants that do not hold of what hubs obey and devices measure."""
        assert self.world is not None
        values = self.world.truth()
        known = self.world.situation.state
        state = tuple(values.get(v.name, old) for v, old in zip(self.system.variables, known, strict=True))
        return [name for name, holds in self._declared.items() if not holds(state)]

    # --- states

    def forbidden(self, state: State) -> frozenset[str]:
        found = self._judged.get(state)
        if found is None:
            found = self._judged[state] = frozenset(name for name, holds in self._widened.items() if not holds(state))
        return found

    def changed(self, state: State, changes: object) -> State:
        assert isinstance(changes, Mapping)
        values = list(state)
        for name, value in changes.items():
            values[self.system.index[name]] = value
        return tuple(values)

    def _with_own(self, state: State, after: State) -> State:
        own = (VariableKind.ESTIMATED, VariableKind.DECISION)
        return tuple(b if v.kind in own else a for v, a, b in zip(self.system.variables, state, after, strict=True))
