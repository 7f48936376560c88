"""What a finding is, and the questions that all rules ask."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from typing import Literal, Protocol

from smv_planner.lazy import dataclass
from smv_planner.model.domains import Value
from smv_planner.model.expressions import And, Const, Expr, Var, conjunction, equality, show, substitute, variables_of
from smv_planner.model.system import Invariant, State, System


class Solver(Protocol):
    """Answers questions about predicates: on all domains there are, and with names that `domains` knows."""

    def satisfiable(self, *predicates: Expr) -> bool:
        """Whether some state satisfies all the predicates."""

    def example(self, *predicates: Expr) -> Mapping[str, Value] | None:
        """What the variables that predicates read are worth in some state that satisfies all; None if there is none."""


Severity = Literal["error", "warning"]


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that is wrong or suspicious.

    `kind` and `name` say in what ('transition', 'door.open'), `hint` what to do about it. `example` is a state that
    shows it: the values that matter or are not initial; all other variables have their initial values.
    """

    severity: Severity
    rule: str
    kind: str
    name: str
    message: str
    hint: str
    example: Mapping[str, Value] | None = None


@dataclass(frozen=True)
class Scene:
    """One level of a model: its system, its invariants as widened, and whom to ask about predicates."""

    system: System
    invariants: tuple[Invariant, ...]
    ask: Solver

    @cached_property
    def allowed(self) -> Expr:
        """The states that no invariant forbids."""
        return conjunction(invariant.predicate for invariant in self.invariants)

    @cached_property
    def _clauses(self) -> tuple[tuple[frozenset[str], Expr], ...]:
        parts = self.allowed.parts if isinstance(self.allowed, And) else (self.allowed,)
        return tuple((variables_of(part), part) for part in parts)

    def allowed_after(self, values: Mapping[str, Expr]) -> Expr:
        """That no invariant forbids what an allowed state becomes when variables get new values."""
        return conjunction(substitute(part, values) for read, part in self._clauses if not read.isdisjoint(values))

    def possible(self, *parts: Expr) -> bool:
        """Whether all of `parts` hold in some state together."""
        return self.ask.satisfiable(*parts)

    def state(self, values: Mapping[str, Value]) -> State:
        """The initial state with other values."""
        return tuple(values.get(variable.name, variable.initial) for variable in self.system.variables)

    def near(self, *parts: Expr) -> State | None:
        """A state in which all of `parts` hold, with as many initial values as a greedy choice can keep."""
        found = self.ask.example(*parts)
        if found is None:
            return None
        kept: list[Expr] = []
        for variable in self.system.variables:
            if variable.name in found:
                initial = equality(Var(variable.name), Const(variable.initial))
                if found[variable.name] == variable.initial:
                    kept.append(initial)
                elif other := self.ask.example(*parts, *kept, initial):
                    kept.append(initial)
                    found = other
        return self.state(found)

    def shown(self, state: State, about: Iterable[str]) -> dict[str, Value]:
        """The values of a state that a reader needs: those of the variables `about` which it is, and what is not initial."""
        wanted = set(about)
        named = self.system.named(state)
        return {v.name: named[v.name] for v in self.system.variables if v.name in wanted or named[v.name] != v.initial}

    def evidence(self, *parts: Expr, about: Iterable[str]) -> dict[str, Value] | None:
        """A state in which all of `parts` hold, as a finding shows it."""
        state = self.near(*parts)
        return None if state is None else self.shown(state, about)

    def forbidding(self, *parts: Expr) -> str:
        """The invariants that together keep `parts` from holding, none of them needless, for people."""
        predicates = [invariant.predicate for invariant in self.invariants]
        return quoted(self.invariants[at].name for at in core(self, predicates, *parts))


@dataclass(frozen=True, slots=True)
class Never:
    """Why a predicate holds in no state: by itself (`alone`), or because of invariants."""

    why: str
    alone: bool


def never(scene: Scene, predicate: Expr) -> Never | None:
    """None if the predicate holds in some state that the invariants allow."""
    if not scene.possible(predicate):
        return Never(f"'{show(contradiction(scene, predicate))}' never holds", alone=True)
    if not scene.possible(predicate, scene.allowed):
        return Never(f"every state in which it could is forbidden by {scene.forbidding(predicate)}", alone=False)
    return None


def core(scene: Scene, parts: Sequence[Expr], *given: Expr) -> list[int]:
    """Which of `parts` cannot hold together where `given` does, none of them needless; by position."""
    kept = list(range(len(parts)))
    for at in range(len(parts)):
        others = [other for other in kept if other != at]
        if not scene.possible(*given, *(parts[other] for other in others)):
            kept = others
    return kept


def contradiction(scene: Scene, predicate: Expr) -> Expr:
    """What in a predicate that never holds cannot hold together."""
    parts = predicate.parts if isinstance(predicate, And) else (predicate,)
    return conjunction(parts[at] for at in core(scene, parts))


def quoted(names: Iterable[str]) -> str:
    """`'a', 'b' and 'c'`."""
    words = [f"'{name}'" for name in names]
    return " and ".join(filter(None, [", ".join(words[:-1]), *words[-1:]]))
