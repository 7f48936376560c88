"""Is there really no plan? Arguments for unreachability, checked on their own."""

from __future__ import annotations

from smv_planner.check.plan import Refused
from smv_planner.model.expressions import conjunction, meaning
from smv_planner.model.ltl import Monitor
from smv_planner.model.semantics import Steps
from smv_planner.problem import Exhausted, Problem


def check_proof(problem: Problem, proof: Exhausted) -> Refused | None:
    """None if the proof holds: the set has the start in it, no step leads out of it, and no state of it is a goal.

    A start that is not allowed needs no further proof.
    """
    steps = Steps(problem.system, problem.usable)
    monitor = Monitor(problem.formula, problem.system.index)
    allowed = meaning(conjunction(i.predicate for i in problem.allowed), problem.system.index)
    if not allowed(problem.initial):
        return None
    if (problem.initial, monitor.start) not in proof.reached:
        return Refused("the proof leaves out the initial state")
    for state, owed in proof.reached:
        if steps.settled(state) and monitor.met_by_idling(owed, state):
            return Refused("the proof's states include one that meets the goals")
        ways = monitor.after(owed, state)
        for transition, after in steps(state) if ways else ():
            if allowed(after) and any((after, way) not in proof.reached for way in ways):
                return Refused(f"the proof leaves out what follows on '{transition.name}'")
    return None
