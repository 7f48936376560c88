"""Planning for intelligent automation: certified plans from models of resources, tools and people.

    import smv_planner as sp

    model = sp.load("scenarios/door")
    answer = sp.plan(model, goal="door.pos == opened")

The method is that of Sequence Planner (Machines 2021): an engine is asked to prove that the goal is unreachable, and its
counterexample, once checked, is the plan; so is a proof checked. Every question can be exported to SMV.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from smv_planner.api import encoded, plan, pose, widened
    from smv_planner.errors import EngineError, Mistake, ModelError, Place, SmvPlannerError, UsageError
    from smv_planner.language import build, load, loads
    from smv_planner.model.model import Model
    from smv_planner.planner.answer import Answer, PlanStep, Question, Violation

__version__ = "0.1.0"

__all__ = [
    "Answer",
    "EngineError",
    "Mistake",
    "Model",
    "ModelError",
    "Place",
    "PlanStep",
    "Question",
    "SmvPlannerError",
    "UsageError",
    "Violation",
    "build",
    "encoded",
    "load",
    "loads",
    "plan",
    "pose",
    "widened",
]

_PLACES = {
    "smv_planner.api": ("encoded", "plan", "pose", "widened"),
    "smv_planner.errors": ("EngineError", "Mistake", "ModelError", "Place", "SmvPlannerError", "UsageError"),
    "smv_planner.language": ("build", "load", "loads"),
    "smv_planner.model.model": ("Model",),
    "smv_planner.planner.answer": ("Answer", "PlanStep", "Question", "Violation"),
}


def __getattr__(name: str) -> object:
    """Imports what is asked for when it is asked for: a hub that needs messages alone loads no planner."""
    from importlib import import_module

    for place, names in _PLACES.items():
        if name in names:
            found: object = getattr(import_module(place), name)
            globals()[name] = found
            return found
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
