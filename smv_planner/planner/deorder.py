"""Which steps of a plan may go in any order (Machines 2021, section 4.2).

These are proposals, loosest first; only the checker's certificate makes one of them part of a plan.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from smv_planner.check.order import Order, blocks, certified
from smv_planner.lazy import dataclass
from smv_planner.model.expressions import Expr, variables_of
from smv_planner.model.ltl import ALWAYS_TRUE, atoms
from smv_planner.model.semantics import judge, once
from smv_planner.model.system import Invariant, State, System, Transition
from smv_planner.problem import Problem, Reached


def proposals(problem: Problem, trace: Reached) -> Iterator[Order]:
    """Partial orders to try, loosest first. Two steps stay in order if one writes what the other uses, or both write
    into one formula; if that is not enough, also if both write into one automatic guard, or into one of the invariants that
    the looser orders violate."""
    system = problem.system
    footprints = [once(system, _footprint, system.transition[name]) for name in trace.path]
    formulas, invariants = _formulas(problem), _read_by_invariants(problem)
    automatic = [once(system, _reads, t.guard) for t in problem.usable if t.kind.automatic]
    tried: list[Order] = []

    def untried(watched: Sequence[frozenset[str]]) -> Iterator[Order]:
        order = _order(problem, trace, footprints, watched)
        if order not in tried:
            tried.append(order)
            yield order

    watched, guards, left = formulas, automatic, list(zip(problem.allowed, invariants, strict=True))
    adding = True
    while adding:
        yield from untried(watched)
        visited = certified(problem, trace, tried[-1])  # it was refused: does it go wrong, or where it should not go?
        if visited is None:
            added, guards = guards, []
        else:
            added = [read for one, read in left if not _holds(problem, one, visited)]
            left = [(one, read) for one, read in left if read not in added]
        watched, adding = watched + added, bool(added)
    for together in (formulas + invariants, formulas + invariants + automatic):
        yield from untried(together)


def _holds(problem: Problem, invariant: Invariant, states: Iterable[State]) -> bool:
    return all(map(judge(problem.system, invariant.predicate), states))


def disjoint(problem: Problem, trace: Reached, variables: Mapping[str, frozenset[str]]) -> Iterator[Order]:
    """The partial order of operations: two are independent if they have no variable in common (section 4.2)."""
    steps = [problem.system.transition[name] for name in trace.path]
    footprints = [Footprint(variables[t.name] | t.assigned, variables[t.name] | t.used) for t in steps]
    yield _order(problem, trace, footprints, _formulas(problem) + _read_by_invariants(problem))


@dataclass(frozen=True, slots=True)
class Footprint:
    """The variables that a step writes, and all that it reads or writes."""

    writes: frozenset[str]
    uses: frozenset[str]


def _footprint(system: System, transition: Transition) -> Footprint:
    return Footprint(transition.assigned, transition.used)


def _reads(system: System, expr: Expr) -> frozenset[str]:
    return variables_of(expr)


def _read_by_invariants(problem: Problem) -> list[frozenset[str]]:
    return [once(problem.system, _reads, invariant.predicate) for invariant in problem.allowed]


def _formulas(problem: Problem) -> list[frozenset[str]]:
    """For each formula its variables: what is written into them stays in the plan's order."""
    watched = []
    for goal in problem.goals:
        if goal.until != ALWAYS_TRUE:
            watched.append(_union(map(variables_of, atoms(goal.until))) | variables_of(goal.predicate))
        elif len(problem.goals) > 1:
            watched.append(variables_of(goal.predicate))
    return watched


def _order(problem: Problem, trace: Reached, footprints: Sequence[Footprint], watched: Sequence[frozenset[str]]) -> Order:
    groups = blocks(problem, trace.path)
    writes = [_union(footprints[at].writes for at in group) for group in groups]
    uses = [_union(footprints[at].uses for at in group) for group in groups]
    touches = [{at for at, shared in enumerate(watched) if shared & written} for written in writes]
    due_at_once = bool(groups) and problem.system.transition[trace.path[0]].kind.automatic  # comes before all else

    def dependent(a: int, b: int) -> bool:
        return bool((a == 0 and due_at_once) or writes[a] & uses[b] or writes[b] & uses[a] or touches[a] & touches[b])

    before: list[int] = []  # per group all groups before it
    order: list[int] = []
    for b, group in enumerate(groups):
        earlier = 0
        for a in range(b):
            if dependent(a, b):
                earlier |= before[a] | 1 << a
        before.append(earlier)
        steps = sum(1 << at for a in range(b) if earlier >> a & 1 for at in groups[a])
        for at in group:
            order.append(steps)
            steps |= 1 << at
    return tuple(order)


def _union(sets: Iterable[frozenset[str]]) -> frozenset[str]:
    return frozenset().union(*sets)
