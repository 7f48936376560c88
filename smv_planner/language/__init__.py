"""The language of scenarios: YAML or Python values in, a `Model` out, and what questions about a model say."""

from smv_planner.language.document import (
    Bounds,
    Decision,
    Intention,
    Operation,
    Outcome,
    Parallel,
    Resource,
    Scenario,
    Transition,
    Variable,
)
from smv_planner.language.load import build, load, loads
from smv_planner.language.questions import formula, predicate, setting

__all__ = [
    "Bounds",
    "Decision",
    "Intention",
    "Operation",
    "Outcome",
    "Parallel",
    "Resource",
    "Scenario",
    "Transition",
    "Variable",
    "build",
    "formula",
    "load",
    "loads",
    "predicate",
    "setting",
]
