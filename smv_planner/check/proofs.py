"""Is there really no plan? Arguments for unreachability, checked on their own."""

from __future__ import annotations

from smv_planner.check.plan import Refused
from smv_planner.check.projection import of_the_whole, projected
from smv_planner.clock import look
from smv_planner.model.expressions import conjunction, meaning
from smv_planner.model.ltl import Monitor
from smv_planner.model.semantics import judge
from smv_planner.problem import Exhausted, Inductive, Pairs, Problem, Projected, Proof, Relaxed


def check_proof(problem: Problem, proof: Proof) -> Refused | None:
    """None if the proof holds: it has the start in it, no step leads out of it, and nothing in it meets the goals.

    A start that is not allowed needs no further proof. What a kind of proof needs is imported when there is one.
    """
    if not all(judge(problem.system, invariant.predicate)(problem.initial) for invariant in problem.allowed):
        return None
    match proof:
        case Projected(variables, Relaxed() as inner):
            whole = of_the_whole(problem.system, variables, inner)
            return check_proof(problem, whole) if whole else Refused("the proof's sets are not one for every variable it names")
        case Projected(variables, inner):
            part = projected(problem, variables)
            return Refused(part) if isinstance(part, str) else check_proof(part, inner)
        case Exhausted():
            return _check_exhausted(problem, proof)
        case Relaxed():
            from smv_planner.check import relaxed

            reason = relaxed.broken(problem, proof)
        case Pairs():
            from smv_planner.check import pairs

            reason = pairs.broken(problem, proof)
        case Inductive():
            from smv_planner.check import inductive  # the only part of the kernel that needs a SAT solver

            try:
                reason = inductive.broken(problem, proof)
            except OverflowError as error:
                return Refused(str(error), too_large=True)
    return Refused(reason) if reason else None


def _check_exhausted(problem: Problem, proof: Exhausted) -> Refused | None:
    steps = problem.steps
    monitor = Monitor(problem.formula, problem.system.index)
    allowed = meaning(conjunction(i.predicate for i in problem.allowed), problem.system.index)
    if (problem.initial, monitor.start) not in proof.reached:
        return Refused("the proof leaves out the initial state")
    for state, owed in proof.reached:
        look()
        if steps.settled(state) and monitor.met_by_idling(owed, state):
            return Refused("the proof's states include one that meets the goals")
        ways = monitor.after(owed, state)
        for transition, after in steps(state) if ways else ():
            if allowed(after) and any((after, way) not in proof.reached for way in ways):
                return Refused(f"the proof leaves out what follows on '{transition.name}'")
    return None
