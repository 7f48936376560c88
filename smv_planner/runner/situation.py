"""All that the runner knows at one moment, and the model as the runner reads it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from functools import cached_property, lru_cache
from math import inf
from typing import TypeVar

from smv_planner.lazy import dataclass, field
from smv_planner.model.domains import Value
from smv_planner.model.expressions import Expr, meaning, variables_of
from smv_planner.model.ltl import Formula, atoms, holds
from smv_planner.model.model import Intention, Model, Resource
from smv_planner.model.semantics import Steps, ready
from smv_planner.model.system import Kind, State, System, Transition, Variable, VariableKind
from smv_planner.planner.operations import footprints, operation_state, operation_system, tasks
from smv_planner.planner.stage import Execution, stage_system
from smv_planner.planner.widening import Widened
from smv_planner.protocol.interface import Interface, interfaces
from smv_planner.protocol.view import HubView
from smv_planner.runner.decision import Cause, Course, Following

Judge = Callable[[State], Value]
"""A predicate on states, compiled."""


class Phase(StrEnum):
    """How far a planner has come in taking over."""

    STOPPED = "stopped"
    LISTENING = "listening"  # which epoch is the newest, and what does each hub mirror?
    JOINING = "joining"  # holding under the new epoch until all live hubs obey it
    RUNNING = "running"
    FENCED_OUT = "fenced_out"  # a newer planner has taken over: nothing is sent any more


class Status(StrEnum):
    """The state of an intention (Def. 6), with what may happen to it from outside or by errors."""

    INITIAL = "initial"
    EXECUTING = "executing"
    FINISHED = "finished"
    PAUSED = "paused"
    CANCELLED = "cancelled"
    ERROR = "error"


@dataclass(frozen=True, slots=True)
class Pursuit:
    """An intention: `owed` is what remains of `formula U goal` from the present decision state on."""

    status: Status = Status.INITIAL
    owed: Formula | None = None
    reason: str = ""


class WishKind(StrEnum):
    MAINTENANCE = "maintenance"  # do this, then confirm
    APPROVAL = "approval"  # agree to a step out of a forbidden state
    SUBSTITUTE = "substitute"  # agree to the plan that replaces a failed one
    RETRY = "retry"  # agree to try again what has failed too often


@dataclass(frozen=True, slots=True)
class Wish:
    """Something the operator was asked for. `step` is a position in the plan; `confirmed_at` when the operator said done."""

    kind: WishKind
    text: str
    step: int | None = None
    transition: str | None = None
    confirmed_at: float | None = None


@dataclass(frozen=True, slots=True)
class Asked:
    """The question that is with the planners; `blamed` are operations whose failure it may be."""

    revision: int
    cause: Cause
    at: float
    recheck: bool = False
    blamed: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Situation:
    """`state` has what is believed of every variable; goal variables have what is commanded.

    `heard` are resources whose measured variables are known. `lost`, `timers` and `disabled` say since when. `doubts`
    are commands that lost hubs have not mirrored: they obey either these or what they mirror. `failed` are
    tasks in error with the reason, `spent` those that failed too often, `failures` counts per operation. `broken` are
    the invariants violated, as widened. `sequence` numbers what each hub is told, `published` what it was sent.
    `cause` is why the planners have to be asked, `asked` what they were asked.
    """

    at: float
    state: State
    phase: Phase = Phase.STOPPED
    epoch: int = 0
    planner: str = ""
    since: float = 0.0
    hubs: Mapping[str, HubView] = field(default_factory=dict)
    sequence: Mapping[str, int] = field(default_factory=dict)
    published: Mapping[str, int] = field(default_factory=dict)
    sent_at: float = 0.0
    heard: frozenset[str] = frozenset()
    lost: Mapping[str, float] = field(default_factory=dict)
    doubts: Mapping[str, Mapping[str, Value]] = field(default_factory=dict)
    timers: Mapping[str, float] = field(default_factory=dict)
    disabled: Mapping[str, float] = field(default_factory=dict)
    intentions: Mapping[str, Pursuit] = field(default_factory=dict)
    executing: tuple[Execution, ...] = ()
    course: Course | None = None
    following: Following | None = None
    failed: Mapping[str, str] = field(default_factory=dict)
    failed_at: Mapping[str, float] = field(default_factory=dict)
    spent: frozenset[str] = frozenset()
    failures: Mapping[str, int] = field(default_factory=dict)
    ran: tuple[str, ...] = ()
    broken: frozenset[str] = frozenset()
    cause: Cause | None = None
    blamed: frozenset[str] = frozenset()
    asked: Asked | None = None
    revision: int = 0
    not_before: float = 0.0
    troubles: int = 0
    recheck: bool = False
    rechecked: float = -inf
    wishes: Mapping[str, Wish] = field(default_factory=dict)
    wished: int = 0
    halted: str | None = None
    stuck: str | None = None
    rejected: Mapping[str, int] = field(default_factory=dict)

    def but(self, **changes: object) -> Situation:
        """The same with some fields changed: `dataclasses.replace` takes four times as long, and this is asked all the time."""
        assert changes.keys() <= Situation.__dataclass_fields__.keys(), changes.keys()
        new = object.__new__(Situation)
        new.__dict__.update(self.__dict__)
        new.__dict__.update(changes)
        return new

    def wanted(self) -> list[str]:
        """The intentions that are pursued."""
        return [name for name, pursuit in self.intentions.items() if pursuit.status is Status.EXECUTING]


@dataclass(frozen=True, eq=False)
class Station:
    """A model with everything that the runner works out once: who is measured where, compiled guards, widened invariants.

    `widened` are the invariants of the model's own system.
    """

    model: Model
    widened: tuple[Widened, ...]
    cell: str = "cell"

    @cached_property
    def system(self) -> System:
        return self.model.system

    @cached_property
    def interfaces(self) -> Mapping[str, Interface]:
        """Of the resources that have a hub: those with measured or goal variables."""
        return {name: one for name, one in interfaces(self.model, self.cell).items() if one.goals or one.measured}

    @cached_property
    def resources(self) -> Mapping[str, Resource]:
        return {resource.name: resource for resource in self.model.resources}

    @cached_property
    def intentions(self) -> Mapping[str, Intention]:
        return {intention.name: intention for intention in self.model.intentions}

    @cached_property
    def starts(self) -> Mapping[str, Judge]:
        return {i.name: meaning(i.start, self.system.index) for i in self.model.intentions}

    @cached_property
    def allowed(self) -> Mapping[str, Judge]:
        """The widened invariants, as predicates on states."""
        return {w.declared.name: meaning(w.invariant.predicate, self.system.index) for w in self.widened}

    @cached_property
    def effects(self) -> tuple[Transition, ...]:
        return tuple(t for t in self.model.transitions if t.kind is Kind.EFFECT)

    @cached_property
    def enabled(self) -> Mapping[str, Judge]:
        """When each effect that has a time limit is enabled."""
        return {t.name: meaning(ready(self.system, t), self.system.index) for t in self.effects if t.within is not None}

    @cached_property
    def effects_on(self) -> Mapping[str, tuple[Transition, ...]]:
        """The effects that assign a measured variable of a resource."""
        owner = self.system.resources
        return {name: tuple(t for t in self.effects if name in {owner[v] for v in t.assigned}) for name in self.interfaces}

    @cached_property
    def measured(self) -> Mapping[str, tuple[Variable, ...]]:
        return self._of(VariableKind.MEASURED)

    @cached_property
    def goals(self) -> Mapping[str, tuple[Variable, ...]]:
        return self._of(VariableKind.GOAL)

    def _of(self, kind: VariableKind) -> dict[str, tuple[Variable, ...]]:
        return {n: tuple(v for v in self.model.variables if v.resource == n and v.kind is kind) for n in self.interfaces}

    @cached_property
    def owners(self) -> Mapping[str, frozenset[str]]:
        """The resources whose variables an operation has to do with."""
        owner, variables = self.system.resources, footprints(self.model)
        return {
            task.operation.name: frozenset(r for v in variables[task.name] if (r := owner.get(v)) is not None)
            for task in tasks(self.model)
        }

    @cached_property
    def tied(self) -> Mapping[str, tuple[str, ...]]:
        """For each controlled transition the resources whose goals it depends on: by its guard, or because an invariant
        speaks of them and of what it assigns."""
        owner, goals = self.system.resources, {v.name for v in self.system.variables if v.kind is VariableKind.GOAL}
        read = [variables_of(w.invariant.predicate) for w in self.widened]
        tied = {}
        for transition in self.system.transitions:
            if transition.kind is Kind.CONTROLLED:
                used = transition.used.union(*(names for names in read if names & transition.assigned))
                tied[transition.name] = tuple(sorted({r for v in used & goals if (r := owner[v]) is not None}))
        return tied

    @cached_property
    def matters(self) -> frozenset[str]:
        """The variables that planning may have to do with, directly or by what else they make possible."""
        model = self.model
        exprs = [w.invariant.predicate for w in self.widened] + [copy.value for copy in model.copies]
        for intention in model.intentions:
            exprs += [intention.start, intention.goal, *(atoms(intention.formula) if intention.formula else ())]
        names = {name for expr in exprs for name in variables_of(expr)}.union(*footprints(model).values())
        names |= {v.name for v in model.variables if v.kind is not VariableKind.MEASURED}
        names = names.union(*(t.used for t in model.transitions if t.kind is not Kind.EFFECT))
        while more := {v for t in self.effects if t.assigned & names for v in t.used} - names:
            names |= more
        return frozenset(names)

    @property
    def decision_index(self) -> Mapping[str, int]:
        """Where each decision variable and measured copy stands in `decisions`."""
        return operation_system(self.model).index

    def decisions(self, state: State) -> State:
        """The state as the operation planner sees it."""
        return operation_state(self.model, state)

    def steps(self, executing: Sequence[Execution]) -> Steps:
        """The automatic transitions and the completions of executing operations."""
        known = self._stage
        if known is None or known[0] is not executing:  # most of the time nothing begins or ends
            known = self.__dict__["_stage"] = executing, _steps(stage_system(self.model, executing))
        return known[1]

    @cached_property
    def _stage(self) -> tuple[Sequence[Execution], Steps] | None:
        return None

    def broken(self, state: State) -> frozenset[str]:
        """The invariants that do not hold in a state, as widened."""
        return _recalled(self._broken, state, lambda: frozenset(name for name, holds in self.allowed.items() if not holds(state)))

    def begun(self, state: State) -> tuple[str, ...]:
        """The effects with a time limit that are enabled in a state."""
        return _recalled(self._begun, state, lambda: tuple(name for name, enabled in self.enabled.items() if enabled(state)))

    def met(self, owed: Formula, state: State) -> bool:
        """Whether nothing more has to happen for what is owed."""
        known = self._met.get(id(owed))  # formulas are long to compare, and asked about again with every tick
        if known is None or known[0] is not owed or known[1] is not state:
            if len(self._met) >= RECALLED:
                self._met.clear()
            answer = holds(owed, (self.decisions(state),), self.decision_index)
            known = self._met[id(owed)] = owed, state, answer
        return known[2]

    @cached_property
    def _met(self) -> dict[int, tuple[Formula, State, bool]]:
        return {}

    @cached_property
    def _broken(self) -> dict[State, frozenset[str]]:
        return {}

    @cached_property
    def _begun(self) -> dict[State, tuple[str, ...]]:
        return {}

    def holds(self, predicate: Expr, state: State) -> bool:
        """Whether a predicate holds in a state; compiled when it is asked for the first time."""
        judge = self._judges.get(predicate)
        if judge is None:
            judge = self._judges[predicate] = meaning(predicate, self.system.index)
        return bool(judge(state))

    @cached_property
    def _judges(self) -> dict[Expr, Judge]:
        return {}


RECALLED = 1000
"""States for which it is remembered what holds in them. A station stands in the same one for many ticks."""

T = TypeVar("T")


def _recalled(known: dict[State, T], state: State, judged: Callable[[], T]) -> T:
    found = known.get(state)
    if found is None:
        if len(known) >= RECALLED:
            known.clear()
        found = known[state] = judged()
    return found


@lru_cache(maxsize=64)
def _steps(system: System) -> Steps:
    return Steps(system, system.transitions)


def at_rest(station: Station, at: float = 0.0) -> Situation:
    """Before anything has happened: estimated and decision variables have their initial values, measured ones are unknown."""
    return Situation(at=at, state=station.system.initial, intentions={name: Pursuit() for name in station.intentions})
