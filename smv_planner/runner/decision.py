"""A question of the runner to the planners, and what they decide: values only."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from smv_planner.check import CheckedPlan
from smv_planner.lazy import dataclass, field, replace
from smv_planner.model.domains import Value
from smv_planner.model.ltl import Formula
from smv_planner.model.system import State
from smv_planner.planner.sequences import OperationPlan
from smv_planner.planner.stage import Execution


class Cause(StrEnum):
    """Why something has to be planned."""

    PROGRESS = "progress"  # an intention has started, an operation has ended: nothing is wrong
    RESUMED = "resumed"  # the operator, or somebody from outside, has cleared the way
    CHANGED = "changed"  # decision variables have been changed from outside
    DEVIATION = "deviation"  # something was measured that the plan does not say
    TIMEOUT = "timeout"  # an effect has not come in time
    LOST = "lost"  # a resource is silent, or does not obey
    FORBIDDEN = "forbidden"  # an invariant is violated, or about to be

    @property
    def ordinary(self) -> bool:
        """Whether nothing has gone wrong."""
        return self in (Cause.PROGRESS, Cause.RESUMED)


class Purpose(StrEnum):
    """What a transition plan is for."""

    OPERATIONS = "operations"
    MAINTENANCE = "maintenance"  # an operation that needs the operator's help (section 4.5)
    EXIT = "exit"  # the way out of forbidden states (section 4.6)


@dataclass(frozen=True, slots=True)
class Wanted:
    """An intention that is pursued, and what is still owed of `formula U goal`, over decision variables."""

    intention: str
    owed: Formula


@dataclass(frozen=True, slots=True)
class Course:
    """An operation plan that is being carried out: positions of the tasks that have begun, and of those that are done."""

    plan: OperationPlan
    begun: frozenset[int] = frozenset()
    done: frozenset[int] = frozenset()

    def ready(self) -> tuple[int, ...]:
        """The tasks that wait for nothing."""
        waiting = (at for at in range(len(self.plan.tasks)) if at not in self.begun)
        return tuple(at for at in waiting if self.done.issuperset(self.plan.after[at]))

    def ended(self, operation: str) -> Course:
        """After the operation that has begun under this name is done."""
        ended = (at for at in sorted(self.begun - self.done) if self.plan.tasks[at].operation.name == operation)
        return Course(self.plan, self.begun, self.done.union(list(ended)[:1]))


@dataclass(frozen=True, slots=True)
class Following:
    """A transition plan that is being followed, and the operations it was made for; `done` are its steps so far.

    `lifted` are invariants it was made without, `approved` the steps that the operator has agreed to.
    """

    plan: CheckedPlan
    purpose: Purpose = Purpose.OPERATIONS
    done: frozenset[int] = frozenset()
    lifted: frozenset[str] = frozenset()
    approved: frozenset[int] = frozenset()
    operations: tuple[Execution, ...] = ()

    @property
    def finished(self) -> bool:
        return len(self.done) == len(self.plan.trace.path)

    def ready(self) -> tuple[int, ...]:
        """The steps that wait for nothing, in the plan's total order."""
        waiting = (at for at in range(len(self.plan.trace.path)) if at not in self.done)
        return tuple(at for at in waiting if self.done.issuperset(self.plan.after[at]))

    def having_done(self, at: int) -> Following:
        return replace(self, done=self.done.union([at]))

    def waits_for(self, transition: str) -> bool:
        """Whether the transition is a step that remains."""
        return any(name == transition and at not in self.done for at, name in enumerate(self.plan.trace.path))

    def target(self, at: int) -> Mapping[str, Value]:
        """What a step of the plan makes of the variables it assigns."""
        trace, system = self.plan.trace, self.plan.problem.system
        assigned = [action.variable for action in system.transition[trace.path[at]].actions]
        return {name: trace.states[at + 1][system.index[name]] for name in assigned}


@dataclass(frozen=True, slots=True)
class Request:
    """Everything a decision depends on. `failed` are operations' tasks in error with the reason; `spent` those of them
    that have used up their retries, which only somebody outside may allow again. `ran` are operations that have run, for
    prescribed sequences. `following` is a plan to go on with if it still leads there. `recheck` asks only what has
    become possible again.
    """

    cause: Cause
    state: State
    wanted: tuple[Wanted, ...]
    executing: tuple[Execution, ...] = ()
    course: Course | None = None
    following: Following | None = None
    disabled: frozenset[str] = frozenset()
    lost: frozenset[str] = frozenset()
    failed: Mapping[str, str] = field(default_factory=dict)
    spent: frozenset[str] = frozenset()
    given_up: tuple[Wanted, ...] = ()
    ran: tuple[str, ...] = ()
    recheck: bool = False


@dataclass(frozen=True, slots=True)
class Action:
    """One planning action in the notation of Table 1, as "TP w/ETO", and how it came out.

    `ordinary` tells that nothing had gone wrong when it was taken. `seconds` are real time.
    """

    name: str
    reached: bool
    what: str
    ordinary: bool
    seconds: float = 0.0
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Decision:
    """What the planners have come to.

    `executing` are all operations that execute from now on and `course` what comes after them; `plan` carries them
    out. `failed` are tasks newly in error, `possible` tasks that may be tried again, `given_up` intentions newly in
    error, all with the reason. `undecided` says why there is no decision: nothing is changed then. `stuck` says why
    nothing can be done although something should be.
    """

    actions: tuple[Action, ...] = ()
    executing: tuple[Execution, ...] = ()
    course: Course | None = None
    following: Following | None = None
    failed: Mapping[str, str] = field(default_factory=dict)
    possible: tuple[str, ...] = ()
    reachable: tuple[str, ...] = ()
    given_up: Mapping[str, str] = field(default_factory=dict)
    undecided: str | None = None
    stuck: str | None = None
