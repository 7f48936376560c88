"""A quick look at a question: relaxed reachability, then a few states.

Bounded by effort and not by time, so that the same question is always answered alike.
"""

from __future__ import annotations

from smv_planner.engines.auto.relaxed import out_of_reach
from smv_planner.engines.auto.search import Ended, Search
from smv_planner.engines.auto.session import session_of
from smv_planner.model.semantics import judge
from smv_planner.problem import Exhausted, Problem, Reached, Undecided, Unreachable, Verdict

STATES = 3_000
"""How many states are looked at."""


def briefly(problem: Problem) -> Verdict:
    """Answer if that is easy; else `Undecided`."""
    if not all(judge(problem.system, invariant.predicate)(problem.initial) for invariant in problem.allowed):
        return Unreachable(Exhausted(frozenset()))
    warm = session_of(problem.system)
    ground, tables = warm.variant(problem.allowed)
    proof = out_of_reach(warm.abstraction(ground), ground, problem)
    if proof:
        return Unreachable(proof)
    for found in Search(tables, problem).explore():
        match found:
            case Reached():
                return found
            case Ended():
                return Unreachable(found.proof())
        if found.number > STATES:
            break
    return Undecided(f"not decided by a look at {STATES} states", deadline=False)
