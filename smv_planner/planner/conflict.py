"""Why there is no plan: a minimal set of what is assumed that is impossible together.

Assumed are the goals, that some effects are disabled and some resources lost, and the invariants. QuickXplain (Junker 2004)
finds a set of which nothing can be left out: without any one of them it would be possible, or is not proved impossible.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Literal

from smv_planner.errors import EngineError
from smv_planner.lazy import dataclass, replace
from smv_planner.planner.answer import Conflict
from smv_planner.planner.decide import NoPlan, Solve, decide
from smv_planner.problem import Problem, Unreachable

Unusable = Callable[[frozenset[str], frozenset[str]], frozenset[str]]
"""Which transitions no plan may use when some of them are disabled and some resources lost."""


@dataclass(frozen=True, slots=True)
class Assumption:
    kind: Literal["goal", "disabled", "lost", "invariant"]
    name: str


@dataclass(frozen=True, slots=True)
class Asked:
    """A problem, and what of it may be left out: goals by the given names, what is `disabled` or `lost`, invariants."""

    problem: Problem
    goals: tuple[str, ...]
    disabled: frozenset[str]
    lost: frozenset[str]
    unusable: Unusable

    def causes(self) -> list[Assumption]:
        """What is not an invariant: goals first, which are kept rather than the others."""
        named = (("goal", self.goals), ("disabled", sorted(self.disabled)), ("lost", sorted(self.lost)))
        return [Assumption(kind, name) for kind, names in named for name in dict.fromkeys(names)]  # type: ignore[arg-type]

    def invariants(self) -> list[Assumption]:
        return [Assumption("invariant", invariant.name) for invariant in self.problem.allowed]

    def under(self, assumptions: Iterable[Assumption]) -> Problem:
        """The problem with nothing assumed but this."""
        kept = frozenset(assumptions)
        disabled = frozenset(name for name in self.disabled if Assumption("disabled", name) in kept)
        lost = frozenset(name for name in self.lost if Assumption("lost", name) in kept)
        wanted = zip(self.goals, self.problem.goals, strict=True)
        return replace(
            self.problem,
            goals=tuple(goal for name, goal in wanted if Assumption("goal", name) in kept),
            allowed=tuple(i for i in self.problem.allowed if Assumption("invariant", i.name) in kept),
            unusable=self.unusable(disabled, lost),
        )


def conflict(asked: Asked, solve: Solve) -> Conflict | None:
    """A minimal conflict, checked; None if `solve` does not prove the whole problem impossible.

    `solve` is asked many questions and should be quick rather than thorough.
    """

    def impossible(assumptions: Iterable[Assumption]) -> bool:
        return isinstance(solve(asked.under(assumptions)), Unreachable)

    causes, invariants = asked.causes(), asked.invariants()
    if not impossible([*causes, *invariants]):
        return None
    held = minimal(causes, invariants, impossible)
    found = [*minimal(held, causes, impossible), *held]
    if not impossible(found):  # bounded effort may prove more of a larger set
        found = [*causes, *invariants]
    for assumption in list(found):
        others = [other for other in found if other is not assumption]
        if impossible(others):
            found = others
    sure = decide(asked.under(found), solve)
    if not isinstance(sure, NoPlan) or not isinstance(sure.verdict, Unreachable):
        raise EngineError("the engine does not prove a second time what it proved before")

    def named(kind: str) -> tuple[str, ...]:
        return tuple(assumption.name for assumption in found if assumption.kind == kind)

    return Conflict(named("goal"), named("disabled"), named("lost"), named("invariant"))


def minimal(
    background: Sequence[Assumption], candidates: Sequence[Assumption], impossible: Callable[[Iterable[Assumption]], bool]
) -> list[Assumption]:
    """The fewest of `candidates`, in the sense that none can be left out, that are impossible with the background.

    All together they are. Those that come first are kept rather than those that come last.
    """
    if not candidates or impossible(background):
        return []
    return _minimal(list(background), list(candidates), impossible)


def _minimal(
    background: list[Assumption], candidates: list[Assumption], impossible: Callable[[Iterable[Assumption]], bool]
) -> list[Assumption]:
    """The background alone is not impossible."""
    if len(candidates) == 1:
        return candidates
    first, second = candidates[: len(candidates) // 2], candidates[len(candidates) // 2 :]
    of_second = minimal([*background, *first], second, impossible)
    of_first = minimal([*background, *of_second], first, impossible)
    return [*of_first, *of_second]


def in_words(found: Conflict) -> str:
    """A conflict as a sentence."""
    causes = [
        *(f"'{name}' is disabled" for name in found.disabled),
        *(f"'{name}' is lost" for name in found.lost),
        *([f"{_listed(found.invariants)} {'has' if len(found.invariants) == 1 else 'have'} to hold"] if found.invariants else []),
    ]
    wanted = _listed(found.goals) or "coming to rest"
    together = "together " if len(found.goals) > 1 else ""
    if not causes:
        return f"{wanted} {together}cannot be reached, whatever is enabled, connected or allowed"
    return f"{wanted} {together}cannot be reached as long as {' and '.join(causes)}"


def _listed(names: Sequence[str]) -> str:
    quoted = [f"'{name}'" for name in names]
    return " and ".join([", ".join(quoted[:-1]), quoted[-1]] if len(quoted) > 1 else quoted)
