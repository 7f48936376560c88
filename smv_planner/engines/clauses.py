"""SAT alone: the last ways of `auto`, from plans without steps on, owing nothing to its search and relaxed reachability.

Incremental bounded model checking in turns with property-directed reachability.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from smv_planner.engines import auto
from smv_planner.problem import Problem, Verdict

if TYPE_CHECKING:
    from smv_planner.engines import Limits


def ask(problem: Problem, limits: Limits) -> Verdict:
    """Answer a question; what the solver learns about a system serves the next question about it, also that of `auto`."""
    return auto.ask(problem, limits, search=lambda: 0)
