"""What can happen to the runner, and what it wants done: values that cross between the pure core and the world.

Every event carries `at`, in seconds of a clock that only whoever drives the runner reads. Folding the events of a journal
through `step` gives the same situation again.
"""

from __future__ import annotations

from collections.abc import Mapping

from smv_planner.lazy import dataclass, field
from smv_planner.model.domains import Value
from smv_planner.protocol.messages import GoalMessage, StateMessage
from smv_planner.runner.decision import Decision, Request

# --- what happens ---------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Began:
    """A planner takes over: first it listens, then it holds under a new epoch until all live hubs obey it."""

    at: float
    planner: str


@dataclass(frozen=True, slots=True)
class Tick:
    """Time has passed."""

    at: float


@dataclass(frozen=True, slots=True)
class Heard:
    """A hub's state message has come in."""

    at: float
    message: StateMessage


@dataclass(frozen=True, slots=True)
class Answered:
    """The planners have decided about the question with this revision."""

    at: float
    revision: int
    decision: Decision


@dataclass(frozen=True, slots=True)
class Ordered:
    """Somebody outside wants something."""

    at: float
    order: Order


Event = Began | Tick | Heard | Answered | Ordered

# --- what somebody outside may want ---------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Activate:
    """Start an intention whatever its start predicate says, or let a paused one go on."""

    intention: str


@dataclass(frozen=True, slots=True)
class Pause:
    intention: str


@dataclass(frozen=True, slots=True)
class Cancel:
    """Give up an intention, or an operation that executes."""

    name: str


@dataclass(frozen=True, slots=True)
class Assign:
    """New values of decision or estimated variables; measured and goal variables belong to the hubs."""

    values: Mapping[str, Value]


@dataclass(frozen=True, slots=True)
class Confirm:
    """The operator has done what was asked for under this id."""

    request: str


@dataclass(frozen=True, slots=True)
class Approve:
    """The operator agrees to what was asked under this id."""

    request: str


@dataclass(frozen=True, slots=True)
class Reenable:
    """Try again what was given up: an effect that timed out, an operation or an intention in error."""

    name: str


@dataclass(frozen=True, slots=True)
class Proceed:
    """Go on after a halt."""


Order = Activate | Pause | Cancel | Assign | Confirm | Approve | Reenable | Proceed

# --- what the runner wants done -------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Send:
    """Publish a resource's whole goal state."""

    message: GoalMessage


@dataclass(frozen=True, slots=True)
class Ask:
    """Put a question to the planners; the answer comes back as `Answered`. A later question makes this one void."""

    revision: int
    request: Request


@dataclass(frozen=True, slots=True)
class Instruct:
    """Ask the operator to do something; `transition` is the maintenance transition that describes it."""

    request: str
    transition: str
    text: str


@dataclass(frozen=True, slots=True)
class Consent:
    """Ask the operator to agree to something before it is done."""

    request: str
    text: str


@dataclass(frozen=True, slots=True)
class Withdraw:
    """What was asked of the operator is no longer wanted."""

    request: str


@dataclass(frozen=True, slots=True)
class Note:
    """Something people may want to know; `kind` is one word, `data` names what it is about."""

    kind: str
    text: str
    data: Mapping[str, object] = field(default_factory=dict)


Output = Send | Ask | Instruct | Consent | Withdraw | Note
