"""A scenario that makes sense: resources, decision variables, operations and intentions (Machines 2021, section 3).

Every name in a `Model` is a full name, every expression is resolved and typed, predicates and measured copies carry
their definition with them. `language` makes models from YAML or from Python values; nothing else does.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from enum import StrEnum
from functools import cached_property

from smv_planner.lazy import dataclass, fields
from smv_planner.model.domains import Domain, Value
from smv_planner.model.expressions import Expr
from smv_planner.model.ltl import Formula
from smv_planner.model.system import MANUAL, Assignment, Invariant, Reenable, System, Transition, Variable


class OnError(StrEnum):
    """What happens with a plan that replaces one after an error (Machines 2021, section 7)."""

    CONTINUE = "continue"
    ASK = "ask"
    HALT = "halt"


@dataclass(frozen=True, slots=True)
class Resource:
    """A device, tool or person (Def. 4). All times are in seconds; `silent_after` makes a resource count as lost.

    Its hub mirrors a command within `mirror_within`. A hub that hears no goals for `deadman` sets what is in `safe`,
    full names of goal variables, and holds the others. `reenable` is when a lost resource counts again.
    """

    name: str
    silent_after: float | None = None
    mirror_within: float = 1.0
    deadman: float | None = None
    safe: tuple[tuple[str, Value], ...] = ()
    on_error: OnError = OnError.CONTINUE
    reenable: Reenable = MANUAL


@dataclass(frozen=True, slots=True)
class Copy:
    """A decision variable that is measured: on the transition level it is `value`, an expression over the state."""

    name: str
    domain: Domain
    value: Expr


@dataclass(frozen=True, slots=True)
class Outcome:
    """One way in which an operation may end: its low-level goal, and its effects on decision variables."""

    name: str | None
    effects: tuple[Assignment, ...]
    goal: Expr | None


@dataclass(frozen=True, slots=True)
class Operation:
    """Def. 5. `synchronised` names the transition whose guard joins the goal and whose actions join the completion.

    `reenable` is when it may be tried again after it was disabled or its `retries` were used up.
    """

    name: str
    guard: Expr
    outcomes: tuple[Outcome, ...]
    on_start: tuple[Assignment, ...] = ()
    synchronised: str | None = None
    retries: int | None = None
    on_error: OnError = OnError.CONTINUE
    reenable: Reenable = MANUAL


@dataclass(frozen=True, slots=True)
class Sequence:
    """Operations and the order in which they run: `after` has for each the positions that it directly waits for.

    Operations that are not in it run freely beside it. If it is `manual` it takes the place of operation planning; only
    then an operation may be in it twice.
    """

    operations: tuple[str, ...]
    after: tuple[tuple[int, ...], ...]
    manual: bool = False


@dataclass(frozen=True, slots=True)
class Intention:
    """Def. 6. `formula` must hold until `goal` is reached."""

    name: str
    start: Expr
    goal: Expr
    formula: Formula | None
    actions: tuple[Assignment, ...]
    sequence: Sequence | None = None


@dataclass(frozen=True, eq=False)
class Model:
    """A whole scenario. `transitions` are in declared order: those of the resources, then the interactions.

    `predicates` and `copies` are kept by name for questions and for people; expressions do not need them. `sequence`
    binds every intention. Goals are sent every `period` seconds. `on_error` is for what belongs to no resource and no
    operation; everywhere else, what the scenario says for all is already in place.
    """

    name: str
    resources: tuple[Resource, ...]
    variables: tuple[Variable, ...]
    copies: tuple[Copy, ...]
    predicates: Mapping[str, Expr]
    transitions: tuple[Transition, ...]
    invariants: tuple[Invariant, ...]
    operations: tuple[Operation, ...]
    intentions: tuple[Intention, ...]
    sequence: Sequence | None = None
    period: float = 0.2
    on_error: OnError = OnError.CONTINUE

    def __getstate__(self) -> dict[str, object]:
        """What was worked out from a model does not travel to another process."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    @cached_property
    def system(self) -> System:
        """The transition planner's system, without completions of operations."""
        return System(self.variables, self.transitions, self.invariants)

    @cached_property
    def hash(self) -> str:
        """The same for the same meaning, in every process: SHA-256 over everything the model says."""
        parts = (self.name, self.resources, self.variables, self.copies, sorted(self.predicates.items()))
        rest = (self.transitions, self.invariants, self.operations, self.intentions, self.sequence)
        execution = (self.period, self.on_error)
        return hashlib.sha256(repr((parts, rest, execution)).encode()).hexdigest()
