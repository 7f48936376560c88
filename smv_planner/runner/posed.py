"""The question that a transition plan answers: the same for who plans, and for who checks a plan of the journal again."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from smv_planner.model.expressions import conjunction
from smv_planner.model.model import Model
from smv_planner.model.system import State, System
from smv_planner.planner.stage import Execution, goal_of, stage_system
from smv_planner.planner.widening import Widened
from smv_planner.problem import Goal, Problem
from smv_planner.runner.decision import Purpose

Widen = Callable[[System], tuple[Widened, ...]]


def posed(
    model: Model,
    widen: Widen,
    purpose: Purpose,
    state: State,
    operations: Sequence[Execution] = (),
    lifted: frozenset[str] = frozenset(),
) -> Problem:
    """How are the post-conditions of operations that execute brought about, or how are forbidden states left?

    What is not usable, and how long a plan may be, is the asker's.
    """
    leaving = purpose is Purpose.EXIT
    system = model.system if leaving else stage_system(model, operations)
    widened = widen(system)
    wanted = [conjunction(one.invariant.predicate for one in widened)] if leaving else [goal_of(model, one) for one in operations]
    return Problem(
        system=system,
        initial=state,
        goals=tuple(map(Goal, wanted)),
        allowed=tuple(one.invariant for one in widened if one.declared.name not in lifted),
    )
