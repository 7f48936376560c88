"""Which goals make a problem impossible (Machines 2021, sections 4.2 and 4.3): each alone, then minimal conflict sets."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations

from smv_planner.check import CheckedPlan
from smv_planner.lazy import replace
from smv_planner.planner.decide import NoPlan, Solve, decide
from smv_planner.problem import Problem

Possible = Callable[[tuple[int, ...]], bool]
"""Whether the goals with these numbers can be reached together."""


def culprits(goals: int, possible: Possible) -> list[tuple[int, ...]]:
    """The smallest sets of goals, by number, that cannot be reached together; no set contains another.

    All goals together are known to be impossible, so there is at least one.
    """
    alone: list[tuple[int, ...]] = [(goal,) for goal in range(goals) if not possible((goal,))]
    if alone or goals == 1:
        return alone or [(0,)]
    for size in range(2, goals):
        together: list[tuple[int, ...]] = [chosen for chosen in combinations(range(goals), size) if not possible(chosen)]
        if together:
            return together
    return [tuple(range(goals))]


def goals_to_blame(problem: Problem, whole: NoPlan, solve: Solve) -> list[tuple[int, ...]] | NoPlan:
    """The smallest sets of a problem's goals that have no plan, where all of them have none.

    NoPlan if that could not be decided.
    """
    undecided: list[NoPlan] = [] if whole.decided else [whole]

    def possible(goals: tuple[int, ...]) -> bool:
        if undecided or len(goals) == len(problem.goals):
            return False
        result = decide(replace(problem, goals=tuple(problem.goals[at] for at in goals)), solve)
        if isinstance(result, NoPlan) and not result.decided:
            undecided.append(result)
        return isinstance(result, CheckedPlan)

    sets = culprits(len(problem.goals), possible)
    return undecided[0] if undecided else sets


def named(sets: Sequence[tuple[int, ...]], names: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    return tuple(tuple(names[at] for at in chosen) for chosen in sets)
