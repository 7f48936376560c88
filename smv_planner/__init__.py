"""Planning for intelligent automation: certified plans from models of resources, tools and people.

    import smv_planner as sp

    model = sp.load("scenarios/door")
    answer = sp.plan(model, goal="door.pos == opened")

The method is that of Sequence Planner (Machines 2021): an engine is asked to prove that the goal is unreachable, and its
counterexample, once checked, is the plan; so is a proof checked. Every question can be exported to SMV.
"""

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
