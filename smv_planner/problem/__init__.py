"""What is asked of an engine, and what it may answer: values, no behaviour.

`Problem` goes to an engine, a `Verdict` comes back. Verdicts are values, not exceptions: that there is no plan is an
answer. Nothing here says whether an answer is right; `check` does. A verdict's `argument` is the engine's own word, for
people, on how it came to it; it makes no difference to what the verdict says.
"""

from __future__ import annotations

from functools import cached_property

from smv_planner.lazy import dataclass, field
from smv_planner.model.domains import Value
from smv_planner.model.expressions import Expr, conjunction
from smv_planner.model.ltl import ALWAYS_TRUE, Atom, Formula, Until, all_of
from smv_planner.model.semantics import Steps, settled
from smv_planner.model.system import Invariant, State, System, Transition


@dataclass(frozen=True, slots=True)
class Goal:
    """`until U predicate`, where the predicate counts in settled states only (Machines 2021, section 4.2)."""

    predicate: Expr
    until: Formula = ALWAYS_TRUE


@dataclass(frozen=True)
class Problem:
    """A planning question: from `initial`, reach every goal with usable transitions, inside the allowed states.

    `unusable` names transitions a plan may not use; they still count for the widening of invariants. `allowed` are
    the invariants as widened: every state of a plan satisfies them. `bound` is the longest plan asked for, in steps.
    """

    system: System
    initial: State
    goals: tuple[Goal, ...]
    allowed: tuple[Invariant, ...]
    unusable: frozenset[str] = frozenset()
    bound: int = 100

    @cached_property
    def usable(self) -> tuple[Transition, ...]:
        return tuple(t for t in self.system.transitions if t.name not in self.unusable)

    @cached_property
    def steps(self) -> Steps:
        """What may follow on a state."""
        return Steps(self.system, self.usable)

    @cached_property
    def settled(self) -> Expr:
        return settled(self.system, self.usable)

    @cached_property
    def formula(self) -> Formula:
        """What the plan's run must satisfy. Engines are asked to prove that none does."""
        return all_of(Until(goal.until, Atom(conjunction([goal.predicate, self.settled]))) for goal in self.goals)


@dataclass(frozen=True, slots=True)
class Reached:
    """A trace, as an engine reports it: names of transitions in order, and one state more than those."""

    path: tuple[str, ...]
    states: tuple[State, ...]
    argument: str = field(default="", compare=False)


@dataclass(frozen=True, slots=True)
class NotWithin:
    """No plan of at most `bound` steps; nothing is said about longer ones. All that bounded model checking can say."""

    bound: int
    argument: str = field(default="", compare=False)


@dataclass(frozen=True, slots=True)
class Exhausted:
    """Everything that can happen was looked at: each state with the obligations of the formula that are left there."""

    reached: frozenset[tuple[State, int]]


@dataclass(frozen=True, slots=True)
class Relaxed:
    """What every variable may ever be worth, in the system's order, if no value once reached were ever lost.

    Whatever can happen stays inside these sets, each condition judged part by part; and no goal can be met there.
    """

    values: tuple[tuple[Value, ...], ...]


@dataclass(frozen=True, slots=True)
class Pairs:
    """Facts, a variable with a value each, of which two never hold together; a fact that never holds is apart from itself.

    Whatever can happen keeps them apart, each condition judged by what it leaves of facts that may hold together; and no
    goal can be met where they are.
    """

    apart: tuple[tuple[tuple[str, Value], tuple[str, Value]], ...]


@dataclass(frozen=True, slots=True)
class Clause:
    """Some variable differs from the value given, or one of the formula's obligations (`ltl.Monitor`'s bits) is still owed."""

    differs: tuple[tuple[str, Value], ...]
    owes: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Inductive:
    """Clauses that hold at the start, that every step preserves together, and that no state meeting the goals satisfies."""

    clauses: tuple[Clause, ...]


@dataclass(frozen=True, slots=True)
class Projected:
    """There is no plan even for the variables named alone, whatever the others do; `proof` is about these only."""

    variables: frozenset[str]
    proof: Exhausted | Relaxed | Pairs | Inductive


Proof = Exhausted | Relaxed | Pairs | Inductive | Projected
"""Why there is no plan of any length: an over-approximation of all that can happen, in one of four forms, or of a part."""


@dataclass(frozen=True, slots=True)
class Unreachable:
    """There is no plan of any length, and here is why."""

    proof: Proof
    argument: str = field(default="", compare=False)


@dataclass(frozen=True, slots=True)
class Undecided:
    """No answer: out of time (`deadline`), or the engine broke (then `reason` has its last words)."""

    reason: str
    deadline: bool


Verdict = Reached | NotWithin | Unreachable | Undecided
