"""The planners as a simulation uses them: the engines that there are, and the clock that actions are timed with."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

from smv_planner import api
from smv_planner.engines import ENGINES, Limits, auto
from smv_planner.errors import EngineError, Mistake, UsageError, did_you_mean
from smv_planner.model.model import Model
from smv_planner.problem import Problem, Verdict
from smv_planner.runner.recovery import Planners
from smv_planner.runner.situation import Station

DEADLINE = 60.0
"""Real seconds for one question to an engine."""


def no_clock() -> float:
    """Planning takes no time: the same seed gives the same bytes."""
    return 0.0


def planners(engine: str = api.DEFAULT_ENGINE, clock: Callable[[], float] = no_clock, deadline: float = DEADLINE) -> Planners:
    """Raises UsageError if there is no such engine, EngineError if it cannot be used here."""
    if engine not in ENGINES:
        raise UsageError([Mistake(f"there is no engine '{engine}'", did_you_mean(engine, ENGINES) or ", ".join(ENGINES))])
    missing = ENGINES[engine].available()
    if missing:
        raise EngineError(missing)
    auto.prepare()

    def solve(problem: Problem) -> Verdict:
        return ENGINES[engine].ask(problem, Limits(deadline, api.MEMORY, lambda text: None))

    return Planners(solve, api.widened_system, api.DEFAULT_BOUND, clock)


@lru_cache(maxsize=16)
def station(model: Model) -> Station:
    """A model with what the runner works out once."""
    return Station(model, api.widened(model))
