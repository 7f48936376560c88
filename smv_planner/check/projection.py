"""The same question about some of the variables only: whoever can answer the whole can answer this.

A run of the whole, with the steps left out that do not touch these variables, is a run of the projection: steps that do
write some of them neither read nor write any other variable, or can never be taken. Of the invariants and goals all that
reads others is left out, and so is a formula that counts steps. That makes it easier, so that no plan here is no plan.
A proof by sets of values needs none of this: where the other variables may be worth anything, it is one about the whole.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from smv_planner.lazy import replace
from smv_planner.model.expressions import FALSE, TRUE, Expr, conjunction, conjuncts, variables_of
from smv_planner.model.ltl import atoms, counts_steps
from smv_planner.model.semantics import ready
from smv_planner.model.system import Invariant, System
from smv_planner.problem import Goal, Problem, Relaxed


def projected(problem: Problem, names: frozenset[str]) -> Problem | str:
    """The question about the variables named; if their steps depend on others, why there is none."""
    system = problem.system
    if not names <= system.index.keys():
        return "the proof speaks of variables that do not exist"
    within = tuple(t for t in problem.usable if not names.isdisjoint(t.assigned) and FALSE not in conjuncts(ready(system, t)))
    for transition in within:
        if not transition.used <= names:
            return f"the proof leaves out variables that '{transition.name}' uses"
    return replace(
        problem,
        system=System(tuple(v for v in system.variables if v.name in names), within, ()),
        initial=tuple(value for name, value in system.named(problem.initial).items() if name in names),
        goals=tuple(goals_about(problem.goals, names)),
        allowed=tuple(Invariant(i.name, _about(i.predicate, names)) for i in problem.allowed),
        unusable=frozenset(),
    )


def of_the_whole(system: System, names: frozenset[str], part: Relaxed) -> Relaxed | None:
    """A proof about some variables, as one where the others may be worth anything; None if it is not about these."""
    own = [v.name for v in system.variables if v.name in names]
    if len(own) != len(names) or len(own) != len(part.values):
        return None
    sets = dict(zip(own, part.values, strict=True))
    return Relaxed(tuple(sets.get(v.name, v.domain.values) for v in system.variables))


def goals_about(goals: Iterable[Goal], names: frozenset[str]) -> Iterator[Goal]:
    """As much of the goals as reads only the variables named; those of which nothing is left are left out."""
    for goal in goals:
        about = _about(goal.predicate, names)
        within = all(variables_of(atom) <= names for atom in atoms(goal.until)) and not counts_steps(goal.until)
        if within and (about != TRUE or variables_of(goal.predicate) <= names):
            yield Goal(about, goal.until)


def _about(predicate: Expr, names: frozenset[str]) -> Expr:
    """As much of a predicate as reads only the variables named."""
    return conjunction(part for part in conjuncts(predicate) if variables_of(part) <= names)
