"""The transition system that both levels of planning share (Machines 2021, Def. 1-4).

A `System` is flat: variables, transitions and invariants with full names, no resources, no operations. The transition
planner's system comes from the resources; the operation planner's will come from the decision variables.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from functools import cached_property

from smv_planner.lazy import dataclass
from smv_planner.model.domains import Domain, Value
from smv_planner.model.expressions import Expr, Var, nodes

State = tuple[Value, ...]
"""One value per variable of the system, in its order."""


class VariableKind(StrEnum):
    MEASURED = "measured"
    GOAL = "goal"
    ESTIMATED = "estimated"
    DECISION = "decision"


class Kind(StrEnum):
    """How a transition comes about (Def. 4); `operation` is the completion of an operation (Def. 5)."""

    CONTROLLED = "controlled"
    AUTOMATIC = "automatic"
    EFFECT = "effect"
    MAINTENANCE = "maintenance"
    OPERATION = "operation"

    @property
    def automatic(self) -> bool:
        """Fires as soon as it is enabled, before anything else."""
        return self in (Kind.AUTOMATIC, Kind.OPERATION)

    @property
    def uncontrollable(self) -> bool:
        """No planner can hold it back; invariants are widened over these."""
        return self in (Kind.AUTOMATIC, Kind.EFFECT, Kind.OPERATION)

    @property
    def deliberate(self) -> bool:
        """Fires only when a plan says so."""
        return self in (Kind.CONTROLLED, Kind.MAINTENANCE)


class Policy(StrEnum):
    MANUAL = "manual"
    ON_CHANGE = "on_change"
    AFTER = "after"


@dataclass(frozen=True, slots=True)
class Reenable:
    """When something that failed in execution may be tried again: a timed-out effect, a lost resource, an operation.

    `after` is in seconds, and there is one with `Policy.AFTER` only.
    """

    policy: Policy = Policy.MANUAL
    after: float | None = None


MANUAL = Reenable()
"""Only the operator says so."""


@dataclass(frozen=True, slots=True)
class Any:
    """The planner chooses the assigned value."""


@dataclass(frozen=True, slots=True)
class Variable:
    """`initial` is a value of the domain. `resource` is None for decision variables."""

    name: str
    kind: VariableKind
    domain: Domain
    initial: Value
    resource: str | None = None


@dataclass(frozen=True, slots=True)
class Assignment:
    """The variable's new value; expressions read the state before the step."""

    variable: str
    value: Expr | Any


@dataclass(frozen=True, slots=True)
class Transition:
    """A guarded transition (Def. 3). `within` is an effect's timeout in seconds of real time.

    `completes` names the operation whose completion this is. `reenable` is for effects: when a timed-out one counts again.
    """

    name: str
    kind: Kind
    guard: Expr
    actions: tuple[Assignment, ...]
    resource: str | None = None
    within: float | None = None
    expected: bool = True
    instruction: str | None = None
    completes: str | None = None
    reenable: Reenable = MANUAL

    @property
    def assigned(self) -> frozenset[str]:
        return frozenset(action.variable for action in self.actions)

    @property
    def used(self) -> frozenset[str]:
        """Every variable the transition reads or writes."""
        values = [action.value for action in self.actions if not isinstance(action.value, Any)]
        reads = (node.name for expr in (self.guard, *values) for node in nodes(expr) if isinstance(node, Var))
        return self.assigned.union(reads)


@dataclass(frozen=True, slots=True)
class Invariant:
    """A predicate that every state must satisfy."""

    name: str
    predicate: Expr


@dataclass(frozen=True, eq=False)
class System:
    """Variables, transitions in declared order, and invariants. Names are unique within each of the three.

    `base` is a system over the same variables that this one was made from: what is worked out for a transition or a
    predicate is then worked out once for all that share a base.
    """

    variables: tuple[Variable, ...]
    transitions: tuple[Transition, ...]
    invariants: tuple[Invariant, ...]
    base: System | None = None

    def __post_init__(self) -> None:
        assert self.base is None or self.base.variables is self.variables

    @cached_property
    def index(self) -> Mapping[str, int]:
        """At which position of a `State` each variable stands."""
        return self.base.index if self.base else {variable.name: at for at, variable in enumerate(self.variables)}

    @cached_property
    def domains(self) -> Mapping[str, Domain]:
        return self.base.domains if self.base else {variable.name: variable.domain for variable in self.variables}

    @cached_property
    def resources(self) -> Mapping[str, str | None]:
        """Which resource each variable belongs to; None for decision variables."""
        return self.base.resources if self.base else {variable.name: variable.resource for variable in self.variables}

    @cached_property
    def transition(self) -> Mapping[str, Transition]:
        """Transitions by name."""
        return {transition.name: transition for transition in self.transitions}

    @cached_property
    def initial(self) -> State:
        return tuple(variable.initial for variable in self.variables)

    @cached_property
    def memo(self) -> dict[tuple[object, int], tuple[object, object]]:
        """What `semantics.once` has worked out of transitions and predicates; nobody else's business."""
        return self.base.memo if self.base else {}

    def named(self, state: State) -> dict[str, Value]:
        """A state as a mapping, in declared order."""
        return {variable.name: value for variable, value in zip(self.variables, state, strict=True)}

    def changes(self, before: State, after: State) -> dict[str, Value]:
        """The variables whose values differ, with their new values."""
        new = zip(self.variables, before, after, strict=True)
        return {variable.name: value for variable, old, value in new if old != value}
