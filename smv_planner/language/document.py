"""A scenario as its author writes it, one to one: YAML becomes these, and Python can write them directly.

    Scenario(
        name="door",
        resources={"door": Resource(
            variables={"ref": Variable("goal", ["closed", "opened"], initial="closed")},
            transitions={"open": Transition("controlled", guard="ref == closed", actions={"ref": "opened"})},
        )},
    )

Expressions are plain text here; nothing is resolved, and a document may be wrong. `build` says what is. A field whose
name is a Python keyword has `_` behind it (`with_`, `from_`). The type hints are the one description of the language's
shape: the reader follows them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Literal

from smv_planner.language.shapes import Text, Whole
from smv_planner.lazy import dataclass, field

MAX_NAME = 200
LARGEST = 2**31 - 1
"""The largest integer; engines calculate with 32 bits."""

PART = r"(?=[\w-]*[^\W\d_])\w+(?:-+\w+)*"
"""A name without dots: letters, digits, `_` and inner `-`, at least one letter."""
NAME = rf"{PART}(?:\.{PART})*"

NAME_RULE = "letters, digits, '_' and inner '-', with at least one letter between dots"

Name = Annotated[str, Text("a name", NAME, NAME_RULE)]
Word = Annotated[str, Text("a name without dots", PART, NAME_RULE)]
Expression = Annotated[str, Text("an expression", reads="condition")]
Formula = Annotated[str, Text("a formula", reads="formula")]
_DURATION = r"\d{1,9}(?:\.\d{1,9})? ?(?:ms|s|min|h)"
Duration = Annotated[str, Text("a duration", _DURATION, "write '500 ms', '1.5 s', '1 min' or '1 h'")]
_POLICY = rf"manual|on_change|after (?=[0.]*[1-9]){_DURATION}"
Reenable = Annotated[str, Text("a policy", _POLICY, "write 'manual', 'on_change' or 'after 30 s'")]
"""When something that failed may be tried again."""
OnError = Literal["continue", "ask", "halt"]
Prose = Annotated[str, Text("text")]
Count = Annotated[int, Whole(0, 1_000_000)]
Integer = Annotated[int, Whole(-LARGEST, LARGEST)]
Value = bool | Integer | Annotated[str, Text("a value")]
"""A value of a domain. Text is a word of an enumeration, never a Boolean or a number."""
Assigned = Annotated[bool | int | str, Text("an expression", reads="condition")]
"""What an action assigns: an expression, or `any`."""
Actions = Mapping[Name, Assigned]


@dataclass(frozen=True, slots=True)
class Bounds:
    """The whole numbers from `min` to `max`, both included."""

    min: Integer
    max: Integer


Domain = Literal["bool"] | Sequence[Name] | Bounds
"""`bool`, the words of an enumeration, or the bounds of a range."""


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable of a resource: `measured` by it, a `goal` sent to it, or `estimated` by the planner."""

    kind: Literal["measured", "goal", "estimated"]
    domain: Domain
    initial: Value


@dataclass(frozen=True, slots=True)
class Transition:
    """A guarded transition. Without a guard it is always possible.

    `within` (effects) is how long the effect may take; `expected: false` (effects) keeps plans from relying on it;
    `instruction` (maintenance) tells the operator what to do; `reenable` (effects with `within`) is when a timed-out one
    counts again.
    """

    kind: Literal["controlled", "automatic", "effect", "maintenance"]
    guard: Expression | None = None
    actions: Actions = field(default_factory=dict)
    within: Duration | None = None
    expected: bool | None = None
    instruction: Prose | None = None
    reenable: Reenable | None = None


@dataclass(frozen=True, slots=True)
class Resource:
    """A device, tool or person. It counts as lost when it is silent for longer than `silent_after`.

    Its hub mirrors commands within `mirror_within`, and does what `on_deadman` says when it hears no goals for `deadman`.
    """

    variables: Mapping[Name, Variable] = field(default_factory=dict)
    predicates: Mapping[Name, Expression] = field(default_factory=dict)
    transitions: Mapping[Name, Transition] = field(default_factory=dict)
    silent_after: Duration | None = None
    mirror_within: Duration | None = None
    deadman: Duration | None = None
    on_deadman: Literal["hold"] | Mapping[Name, Value] | None = None
    on_error: OnError | None = None
    reenable: Reenable | None = None


@dataclass(frozen=True, slots=True)
class Decision:
    """An abstract variable that operations plan over. With `from` it is a measured copy.

    `from` is an expression (the domain is bool unless it is given) or conditions for values, of which the first that
    holds counts; `otherwise` is the value when none does.
    """

    domain: Domain | None = None
    initial: Value | None = None
    from_: Expression | Mapping[Annotated[str, Text("a value")], Expression] | None = None


@dataclass(frozen=True, slots=True)
class Outcome:
    """One way in which an operation may end."""

    effects: Actions
    goal: Expression | None = None


@dataclass(frozen=True, slots=True)
class Operation:
    """What the operation planner plans: either `effects` (and `goal`), or several `outcomes`, each with its own."""

    guard: Expression | None = None
    effects: Actions | None = None
    goal: Expression | None = None
    outcomes: Mapping[Word, Outcome] | None = None
    with_: Name | None = None
    on_start: Actions = field(default_factory=dict)
    retries: Count | None = None
    on_error: OnError | None = None
    reenable: Reenable | None = None


@dataclass(frozen=True, slots=True)
class Parallel:
    """Branches of a sequence that run side by side: operations, or lists of steps in order."""

    parallel: Sequence[Name | Parallel | Sequence[Name | Parallel]]


Steps = Sequence[Name | Parallel | Sequence[Name | Parallel]]
"""Operations in the order in which they run."""


@dataclass(frozen=True, slots=True)
class Intention:
    """What is wanted: from `start` on, reach `goal`, and let `formula` hold until then.

    The operations of a `sequence` run in its order only; if it is `manual`, it is the plan.
    """

    start: Expression
    goal: Expression
    formula: Formula | None = None
    actions: Actions = field(default_factory=dict)
    sequence: Steps | None = None
    manual: bool | None = None


@dataclass(frozen=True, slots=True)
class Scenario:
    """A whole scenario. `transitions` and `predicates` here belong to no resource, a `sequence` here to every intention."""

    name: Name
    resources: Mapping[Name, Resource] = field(default_factory=dict)
    predicates: Mapping[Name, Expression] = field(default_factory=dict)
    transitions: Mapping[Name, Transition] = field(default_factory=dict)
    decision: Mapping[Name, Decision] = field(default_factory=dict)
    invariants: Mapping[Name, Expression] = field(default_factory=dict)
    operations: Mapping[Name, Operation] = field(default_factory=dict)
    intentions: Mapping[Name, Intention] = field(default_factory=dict)
    sequence: Steps | None = None
    period: Duration | None = None
    on_error: OnError | None = None
    reenable: Reenable | None = None
    smv_planner: Annotated[int, Whole(1, 1)] = 1


EXPANDED: Mapping[type, tuple[str, ...]] = {Scenario: ("templates",), Resource: ("use", "template", "with", "as")}
"""What a text may say besides. `expand` writes it out, so that no document has it."""
