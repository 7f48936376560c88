"""One seed: a station under trouble, then in peace, watched all the time.

While there is trouble nothing forbidden may happen (safety). Then the trouble stops, somebody re-enables what was given
up, and what was intended has to be reached (liveness). A seed that did too little has shown nothing, and fails.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TypeVar

from smv_planner.emulation import emulator as emulators
from smv_planner.emulation.behaviour import Behaviour, Instead
from smv_planner.emulation.draw import Draw
from smv_planner.lazy import dataclass, field, replace
from smv_planner.model.domains import Value
from smv_planner.model.system import Policy, VariableKind
from smv_planner.runner.decision import Action, Decision, Request
from smv_planner.runner.events import Activate, Approve, Assign, Cancel, Confirm, Order, Pause, Proceed, Reenable
from smv_planner.runner.records import record
from smv_planner.runner.recovery import recover
from smv_planner.runner.situation import Phase, Station, Status, WishKind
from smv_planner.simulate.answers import Memory, failing, lying
from smv_planner.simulate.faults import Swarm, Trouble, next_time, swarm
from smv_planner.simulate.network import CALM
from smv_planner.simulate.observer import Observer, Violation
from smv_planner.simulate.operator import Operator
from smv_planner.simulate.process import MemoryDisk, Moment, Process
from smv_planner.simulate.world import World

TROUBLE = 100.0
"""Seconds of trouble; twice as many if it takes them until the seed has done enough."""

PEACE = 400.0
"""Seconds after which the station must have come to its end."""

GIVES_UP = 3
"""So often somebody looks at a station that says why it is stuck, before he clears the work away."""

FAULTS = 100
STEPS = 10
"""What a seed has to see and to do at least."""


DECEIVING = {
    Trouble.HUB_FORGETS,
    Trouble.HUB_LIES,
    Trouble.ASSIGNED,
    Trouble.CONFIRMED_FALSELY,
    Trouble.CONFIRMED_AGAIN,
}
"""After these what is believed may be false without anybody having made a mistake."""


@dataclass(frozen=True, slots=True)
class Report:
    """What came of a seed. `edges` counts what recovery did, by the names of Table 1 and of the runner's notes, and `helped`
    what a person did that nobody had asked for."""

    seed: int
    swarm: Swarm
    violations: tuple[Violation, ...]
    faults: Mapping[str, int]
    helped: Mapping[str, int]
    steps: int
    least: int
    edges: Mapping[str, int]
    peaceful: float | None
    seconds: float
    fingerprint: str

    @property
    def failures(self) -> list[str]:
        """Everything that is wrong with it, each with the seed that shows it again."""
        found = [f"seed {self.seed}: {violation}" for violation in self.violations]
        if sum(self.faults.values()) < FAULTS:
            found.append(f"seed {self.seed}: only {sum(self.faults.values())} faults")
        if self.steps < self.least:
            found.append(f"seed {self.seed}: only {self.steps} steps were commanded")
        return found


@dataclass
class Campaign:
    """One run. `memory` may be shared by many."""

    station: Station
    memory: Memory
    seed: int
    set: Mapping[str, Value] = field(default_factory=dict)
    trouble: float = TROUBLE
    peace: float = PEACE
    steps: int = STEPS

    def __post_init__(self) -> None:
        self.draw = Draw(self.seed).of("campaign")
        self.swarm = swarm(self.draw.of("swarm"))
        self.observer = Observer(self.station)
        self.happened: Counter[str] = Counter()
        self.helped: Counter[str] = Counter()
        self.doomed: Moment | None = None
        self.engine: Trouble | None = None
        self.questions = 0
        self.stuck_looks = 0
        self.troubled = True
        self.world = self.observer.watching(
            World(
                self.station,
                self.memory.planners,
                self.seed,
                self.set,
                disk=MemoryDisk(),
                weather=self.swarm.weather,
                kill=self.kill,
                think=self.think,
            )
        )
        for name in self.world.hubs:
            self.behave(name, Behaviour(delay=self.swarm.pace))
        for trouble, rate in self.swarm.rates.items():
            self.again(trouble, rate, 0)
        self.world.later(5.0, self.look_after)

    def run(self) -> Report:
        world = self.world
        world.run(self.trouble)
        world.at = self.trouble  # the last that happened was a little before
        world.run(2 * self.trouble, stop=lambda: self.enough)  # where little goes on, it takes longer to see enough
        self.calm()
        peaceful = world.at
        world.run(peaceful + self.peace, stop=self.finished)
        if not self.finished():
            self.observer.complain("I8", self.unfinished())
        return self.report(world.at - peaceful if self.finished() else None)

    @property
    def done(self) -> int:
        """How many steps were commanded."""
        return self.observer.counts["controlled steps"]

    @property
    def faults(self) -> Counter[str]:
        """What went wrong, at the station and on the network."""
        of_network = {kind: self.world.counts[kind] for kind in ("lost", "twice", "late", "damaged", "cut off")}
        return self.happened + Counter(of_network)

    @property
    def enough(self) -> bool:
        return self.done >= self.steps and self.faults.total() >= FAULTS

    def report(self, peaceful: float | None) -> Report:
        world, edges = self.world, Counter[str]()
        for _, note in world.notes:
            match note.kind:
                case "decision":
                    actions: tuple[Action, ...] = note.data["actions"]  # type: ignore[assignment]
                    edges.update(action.name for action in actions if not action.ordinary)
                case "lost" | "back" | "timeout" | "rebooted" | "stale" | "alarm" | "unseen" | "instruct" | "consent" | "running":
                    edges[note.kind] += 1
                case "measured":
                    edges[f"measured: {note.data['explained']}"] += 1
        return Report(
            self.seed,
            self.swarm,
            tuple(self.observer.violations),
            self.faults,
            self.helped,
            self.done,
            self.steps,
            edges,
            peaceful,
            world.at,
            world.fingerprint,
        )

    # --- the end

    def calm(self) -> None:
        """All trouble is over: everybody runs, hears and tells the truth."""
        self.troubled, world = False, self.world
        world.weather, self.engine, self.doomed = CALM, None, None
        world.operator = Operator()
        world.cut.clear()
        for name in world.hubs:
            world.thaw_hub(name)
            if name in world.down:
                world.restart_hub(name)
            self.behave(name, Behaviour(delay=self.swarm.pace))
            self.repair(name)
        for process in world.processes:
            world.wake(process)
        if not world.process.alive or world.situation.phase is Phase.FENCED_OUT:
            self.reborn(world.process)

    def finished(self) -> bool:
        now = self.world.situation
        return not self.troubled and now.phase is Phase.RUNNING and all(self.at_rest(name) for name in now.intentions)

    def at_rest(self, name: str) -> bool:
        now = self.world.situation
        done = now.intentions[name].status is Status.FINISHED
        return done or (now.intentions[name].status is Status.INITIAL and not self.station.starts[name](now.state))

    def unfinished(self) -> str:
        now = self.world.situation
        what = ", ".join(f"'{name}' is {pursuit.status.value}" for name, pursuit in now.intentions.items())
        wishes = "; ".join(wish.text for wish in now.wishes.values())
        return f"after {self.peace:g} s of peace {what}; {now.phase.value}; stuck: {now.stuck}; asked for: {wishes or 'nothing'}"

    # --- somebody looks after the station

    def look_after(self) -> None:
        """What only a person may do, and new work when all is done.

        He counts on effects again whose policy is `manual`, says again what he said to a planner that died, activates what
        was paused or cancelled, and proceeds after halts. What is in error he leaves to the runner, which looks again itself.
        """
        self.world.later(4.0 + 8.0 * self.draw.unit("looks", str(self.world.at)) if self.troubled else 2.0, self.look_after)
        now = self.world.situation
        if now.phase is not Phase.RUNNING or not self.world.process.alive:
            return
        manual = [n for n in now.disabled if self.station.system.transition[n].reenable.policy is Policy.MANUAL]
        manual += [n for n in now.lost if self.station.resources[n].reenable.policy is Policy.MANUAL]
        for name in manual:
            self.help("re-enabled", Reenable(name))
        for name, pursuit in now.intentions.items():
            if pursuit.status in (Status.PAUSED, Status.CANCELLED):
                self.help("activated", Activate(name))
        for request, wish in now.wishes.items():  # what was said to a process that died is said again
            if wish.kind is not WishKind.MAINTENANCE:
                self.help("approved", Approve(request))
            elif wish.confirmed_at is None and wish.transition is not None:
                self.world.operator_does(request, wish.transition)
        if now.halted:
            self.help("proceeded", Proceed())
        self.stuck_looks = self.stuck_looks + 1 if now.stuck else 0
        if self.stuck_looks >= GIVES_UP or (self.troubled and all(self.at_rest(name) for name in now.intentions)):
            self.start_over()

    def help(self, how: str, order: Order) -> None:
        self.helped[how] += 1
        self.world.order(order)

    def start_over(self) -> None:
        """A new engine, a new seal: what only the planner knows is as at first. A broken promise is given anew."""
        self.stuck_looks = 0
        self.helped["started over" if self.troubled else "started over in peace"] += 1
        own = [v for v in self.station.system.variables if v.kind in (VariableKind.DECISION, VariableKind.ESTIMATED)]
        self.world.order(Assign({v.name: self.set.get(v.name, v.initial) for v in own}))
        for name, pursuit in self.world.situation.intentions.items():
            if pursuit.status is Status.ERROR:
                self.world.order(Cancel(name))

    # --- trouble

    def again(self, trouble: Trouble, rate: float, number: int) -> None:
        draw = self.draw.of(trouble.value, number)

        def happen() -> None:
            if self.troubled:
                self.happened[trouble.value] += self.befall(trouble, draw)
                self.again(trouble, rate, number + 1)

        self.world.later(next_time(rate, draw), happen)

    def befall(self, trouble: Trouble, draw: Draw) -> bool:
        """It happens now, if there is anything that it can happen to."""
        world = self.world
        name = draw_one(tuple(world.hubs), draw.of("hub"))
        ways = {
            Trouble.DEAF: [(p.name, name) for p in world.processes],
            Trouble.UNHEARD: [(name, p.name) for p in world.processes],
        }
        ways[Trouble.CUT_OFF] = ways[Trouble.DEAF] + ways[Trouble.UNHEARD]
        lasts = 0.2 + 4.0 * draw.unit("lasts") ** 2
        if trouble in DECEIVING:
            self.observer.excuse()
        match trouble:
            case Trouble.HUB_CRASHES | Trouble.HUB_FORGETS:
                if name in world.down:
                    return False
                world.crash_hub(name)
                forgetful = trouble is Trouble.HUB_FORGETS
                world.later(lasts, lambda: self.restart(name, forgetful))
            case Trouble.HUB_FREEZES:
                world.freeze_hub(name)
                world.later(lasts, lambda: world.thaw_hub(name))
            case Trouble.HUB_STUCK:
                self.for_a_while(name, lasts, stuck=True)
            case Trouble.HUB_SILENT:
                self.for_a_while(name, lasts, silent=True)
            case Trouble.HUB_LIES:
                measured = self.station.measured[name]
                if not measured:
                    return False
                variable = draw_one(measured, draw.of("lie"))
                self.for_a_while(name, lasts, lying={variable.name: draw_one(variable.domain.values, draw.of("value"))})
            case Trouble.DEAF | Trouble.UNHEARD | Trouble.CUT_OFF:
                for sender, receiver in ways[trouble]:
                    world.cut_off(sender, receiver)
                    world.later(lasts, lambda way=(sender, receiver): world.mend(*way))  # type: ignore[misc]
            case Trouble.EFFECT_FAILS | Trouble.EFFECT_LATE | Trouble.EFFECT_UNEXPECTED:
                return self.spoil_effect(trouble, name, draw)
            case Trouble.PLANNER_STOPS:
                process = world.process
                if process.stopped is not None or not process.alive:
                    return False
                process.stopped = []
                world.later(lasts * 2, lambda: world.wake(process))
            case Trouble.PLANNER_KILLED:
                self.doomed = draw_one(tuple(Moment), draw.of("moment"))
            case Trouble.PLANNER_TWICE:
                self.reborn(world.process, beside=True)
            case Trouble.ENGINE_FAILS | Trouble.ENGINE_LATE | Trouble.ENGINE_LIES | Trouble.ENGINE_REPEATS:
                self.engine = trouble
                world.later(lasts, self.repair_engine)
            case Trouble.ASSIGNED:
                own = [v for v in self.station.system.variables if v.kind is VariableKind.DECISION]
                if not own:
                    return False
                decided = draw_one(own, draw.of("variable"))
                self.order(Assign({decided.name: draw_one(decided.domain.values, draw.of("value"))}))
            case Trouble.PAUSED | Trouble.CANCELLED:
                intention = draw_one(tuple(self.station.intentions), draw.of("intention"))
                self.order(Pause(intention) if trouble is Trouble.PAUSED else Cancel(intention))
            case Trouble.OPERATION_CANCELLED:
                if not world.situation.executing:
                    return False
                self.order(Cancel(draw_one(world.situation.executing, draw.of("operation")).task.operation.name))
            case Trouble.CONFIRMED_FALSELY:
                open_ = [r for r, wish in world.situation.wishes.items() if wish.kind is WishKind.MAINTENANCE]
                if not open_:
                    return False
                self.order(Confirm(draw_one(open_, draw.of("wish"))))
            case Trouble.CONFIRMED_AGAIN:
                asked = [note.data["request"] for _, note in world.notes[-200:] if note.kind == "instruct"]
                if not asked:
                    return False
                self.order(Confirm(str(draw_one(asked, draw.of("request")))))
            case Trouble.OPERATOR_SLOW:
                world.operator = replace(world.operator, delay=1.0 + 10.0 * draw.unit("delay"))
        return True

    def order(self, order: Order) -> None:
        self.world.order(order)

    def behave(self, name: str, behaviour: Behaviour) -> None:
        self.world.hubs[name] = emulators.behaving(self.world.hubs[name], behaviour)

    def for_a_while(self, name: str, lasts: float, **changes: object) -> None:
        now = self.world.hubs[name].device.behaviour
        self.behave(name, replace(now, **changes))  # type: ignore[arg-type]
        well = {change: getattr(Behaviour(), change) for change in changes}
        self.world.later(lasts, lambda: self.behave(name, replace(self.world.hubs[name].device.behaviour, **well)))

    def restart(self, name: str, forgetful: bool) -> None:
        if name in self.world.down:
            behaviour = self.world.hubs[name].device.behaviour
            self.behave(name, replace(behaviour, forgetful=forgetful))
            self.world.restart_hub(name)
            self.behave(name, behaviour)

    def repair(self, name: str) -> None:
        """What does not happen because it has failed gets another chance."""
        emulator = self.world.hubs[name]
        self.world.hubs[name] = replace(emulator, device=replace(emulator.device, begun=(), seen=None))

    def spoil_effect(self, trouble: Trouble, name: str, draw: Draw) -> bool:
        device = self.world.hubs[name].device
        effects = [e for e in device.effects if e.expected]
        if not effects:
            return False
        effect, behaviour = draw_one(effects, draw.of("effect")).name, device.behaviour
        match trouble:
            case Trouble.EFFECT_FAILS:
                self.world.later(20.0 * draw.unit("repaired"), lambda: self.repair(name))
                behaviour = replace(behaviour, failing={**behaviour.failing, effect: 1})
            case Trouble.EFFECT_LATE:
                behaviour = replace(behaviour, delays={**behaviour.delays, effect: 1.0 + draw.unit("how late")})
            case _:
                others = [e.name for e in device.effects if e.name != effect]
                if not others:
                    return False
                told = Instead(draw_one(others, draw.of("other")), times=1)
                behaviour = replace(behaviour, instead={**behaviour.instead, effect: told})
        self.behave(name, behaviour)
        return True

    # --- the planner

    def kill(self, process: Process, moment: Moment) -> bool:
        if self.doomed is not moment or process is not self.world.process:
            return False
        self.doomed = None
        world = self.world
        world.later(0.3 + 2.0 * self.draw.unit("dead", str(world.at)), lambda: self.reborn(process, moment=moment))
        return True

    def reborn(self, old: Process, beside: bool = False, moment: Moment | None = None) -> None:
        """A new process: in place of a dead one with its journal, or beside one that lives, with a copy of it."""
        if old is not self.world.process:
            return
        disk = old.disk
        assert isinstance(disk, MemoryDisk)
        if not beside:
            old.alive = False  # a journal has one writer
        else:
            disk = MemoryDisk({name: bytearray(data) for name, data in disk.files.items()})
        name = f"planner-{len(self.world.processes) + 1}"
        told = self.world.start_planner(name, disk)
        if moment is not None and moment is not Moment.WRITTEN and record(told) != record(old.situation):
            self.observer.complain("I9", f"{name} makes something else of the journal than what happened")

    def repair_engine(self) -> None:
        self.engine = None

    def think(self, request: Request) -> tuple[Decision, tuple[float, ...]]:
        self.questions += 1
        draw = self.draw.of("thinks", self.questions)
        seconds, more = 0.005 + 0.1 * draw.unit("seconds") ** 2, 4.0 * draw.unit("more")
        model, planners = self.station.model, self.memory.planners
        match self.engine:
            case Trouble.ENGINE_FAILS:
                return recover(model, request, failing(planners)), (seconds,)
            case Trouble.ENGINE_LIES:
                return recover(model, request, lying(planners, draw)), (seconds,)
            case Trouble.ENGINE_LATE:
                return self.memory(request), (seconds + more,)
            case Trouble.ENGINE_REPEATS:
                return self.memory(request), (seconds, seconds + more)
        return self.memory(request), (seconds,)


T = TypeVar("T")


def draw_one(things: Sequence[T], draw: Draw) -> T:
    return things[int(draw.unit() * len(things))]
