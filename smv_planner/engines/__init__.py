"""The engines: what is asked of each, and the table of those there are.

An engine takes a `Problem` and answers with a `Verdict` within its limits. It may be wrong: `check` judges every plan
and every proof before anything uses it. A new engine is one module and one line in `ENGINES`; modules are imported
when they are first asked, so that nobody waits for an engine that is not used.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from types import MappingProxyType

from smv_planner.lazy import dataclass
from smv_planner.problem import Problem, Verdict


@dataclass(frozen=True, slots=True)
class Limits:
    """How long, in seconds, and with how many bytes of memory an engine may try, and whom it tells how far it is."""

    deadline: float
    memory: int
    progress: Callable[[str], None]


Ask = Callable[[Problem, Limits], Verdict]


@dataclass(frozen=True, slots=True)
class Engine:
    """One line of the table. Its module has `ask`, and `available` if there can be a reason why it cannot be used."""

    module: str
    description: str

    def ask(self, problem: Problem, limits: Limits) -> Verdict:
        """Answer a question. Raises EngineError if the engine is not there or answers something it cannot mean."""
        ask: Ask = import_module(self.module).ask
        return ask(problem, limits)

    def available(self) -> str | None:
        """Why the engine cannot be used here and what to do about it; None if it can be used."""
        available: Callable[[], str | None] = getattr(import_module(self.module), "available", lambda: None)
        return available()


ENGINES: Mapping[str, Engine] = MappingProxyType(
    {
        "auto": Engine("smv_planner.engines.auto", "relaxed reachability, search and SAT in turn; proves impossibility"),
        "sat": Engine("smv_planner.engines.clauses", "incremental SAT and PDR alone; proves impossibility"),
        "explicit": Engine("smv_planner.engines.explicit", "breadth-first search over explicit states; proves impossibility"),
        "nusmv": Engine("smv_planner.engines.nusmv", "NuSMV as a library (pynusmv): incremental bounded model checking"),
        "nuxmv": Engine("smv_planner.engines.nuxmv", "the nuXmv executable you installed: bounded model checking"),
    }
)
