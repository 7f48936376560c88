"""A question taken apart: variables that no transition, invariant or goal connects are planned apart, and plans merged.

Variables that nothing writes connect nothing. Steps of one part neither help nor hinder another's, except that automatic
steps go before all others; so the parts' plans are joined block by block, a step with the automatic ones it triggers.
Each part's share of any plan is a plan for the part (formulas that count steps are not taken apart), so the shortest
plans of the parts add up to a shortest plan.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from smv_planner.check.projection import goals_about
from smv_planner.clock import look
from smv_planner.engines.auto.grounding import Ground, union
from smv_planner.lazy import dataclass
from smv_planner.model.expressions import FALSE, conjunction, conjuncts, meaning
from smv_planner.model.ltl import ALWAYS_TRUE, atoms, counts_steps
from smv_planner.model.system import Invariant, System
from smv_planner.problem import Goal, Problem, Reached

Variables = int
"""A set of variables, one bit each in the system's order."""

ANY: Variables = -1

PARTS = 500
"""How many parts of one system are kept."""


@dataclass(frozen=True, eq=False, slots=True, weakref_slot=True)
class Part:
    """Variables that hang together, and those that nothing writes, as a system of its own; `at` is where they stand."""

    at: tuple[int, ...]
    system: System
    allowed: tuple[Invariant, ...]

    def share(self, problem: Problem, goals: Iterable[Goal]) -> Problem:
        """The question as far as it is about these variables; in the kernel's words, for it will check the proof.

        Of the problem's goals those are enough that read some of these variables, or in some part none at all.
        """
        return Problem(
            system=self.system,
            initial=tuple([problem.initial[at] for at in self.at]),
            goals=tuple(goals_about(goals, frozenset(self.system.index))),
            allowed=self.allowed,
            unusable=problem.unusable,
            bound=problem.bound,
        )


class Parts:
    """What connects the variables of a grounded system."""

    def __init__(self, of: Ground) -> None:
        self._of = of
        self._bit = {variable.name: 1 << at for at, variable in enumerate(of.system.variables)}
        live = [action for action in of.actions if FALSE not in action.conditions]
        self._written = self._mask(name for action in live for name in action.assigned)
        self._needs: dict[int, Variables] = {}
        self._automatic = []
        connected = []
        for action in live:
            look()
            reads = map(of.reads, (*action.conditions, *action.assigned.values()))
            written = self._mask(action.assigned)
            used = written | self._mask(name for names in reads for name in names) & self._written
            connected.append(used)
            self._need(used if action.transition.kind.automatic else written, used)
            if action.transition.kind.automatic:
                enabled = meaning(conjunction(action.conditions), of.system.index)
                self._automatic.append((action.transition.name, enabled, written))
        for clause in of.clauses:
            look()
            used = self._mask(of.reads(clause)) & self._written
            connected.append(used)
            self._need(used, used)
        self._apart = joined(connected)
        self._parts: dict[Variables, Part] = {}

    def apart(self, problem: Problem) -> tuple[tuple[Part, Problem], ...]:
        """Parts that do not touch each other, with their shares of the question; none if there are not several."""
        if len(self._apart) < 2 or any(counts_steps(goal.until) for goal in problem.goals):
            return ()
        waking = self._waking(problem)
        plain = all(goal.until == ALWAYS_TRUE for goal in problem.goals)
        if waking and not plain:
            return ()  # while others have yet to settle, a goal that is met does not count, and its formula may be broken
        asked = [self._asked(goal) for goal in problem.goals]
        if plain and len(problem.goals) == 1:
            asked = [self._asked(Goal(part)) for part in conjuncts(problem.goals[0].predicate)]
        concerned = union([*asked, *waking])
        groups = [group for group in joined([*self._apart, *asked]) if group & concerned]
        if len(groups) < 2:
            return ()
        read = [(goal, self._read(goal)) for goal in problem.goals]
        return tuple(
            (part, part.share(problem, [goal for goal, names in read if names & (group | ~self._written)]))
            for group, part in zip(groups, map(self._part, groups), strict=True)
        )

    def needed(self, problem: Problem) -> tuple[Part, Problem] | None:
        """The part that matters to a question; None if that is the whole. What is left out need not move."""
        if any(counts_steps(goal.until) for goal in problem.goals):
            return None  # steps may be needed for their number
        waiting = found = union([*map(self._asked, problem.goals), *self._waking(problem)])
        while waiting:
            needs = union(self._needs[at] for at in places(waiting))
            waiting = needs & ~found
            found |= needs
        if found == self._written:
            return None
        part = self._part(found)
        return part, part.share(problem, problem.goals)

    def _waking(self, problem: Problem) -> list[Variables]:
        """What the automatic transitions that are enabled at the start write."""
        return [
            written for name, enabled, written in self._automatic if name not in problem.unusable and enabled(problem.initial)
        ]

    def _asked(self, goal: Goal) -> Variables:
        read = (self._of.reads(predicate) for predicate in (goal.predicate, *atoms(goal.until)))
        return self._mask(name for names in read for name in names) & self._written

    def _read(self, goal: Goal) -> Variables:
        """What a goal's predicate reads; any variable if some part of it reads none."""
        if all(self._of.reads(part) for part in conjuncts(goal.predicate)):
            return self._mask(self._of.reads(goal.predicate)) or ANY
        return ANY

    def _need(self, some: Variables, others: Variables) -> None:
        for at in places(some):
            self._needs[at] = self._needs.get(at, 0) | others

    def _mask(self, names: Iterable[str]) -> Variables:
        return union(self._bit[name] for name in names)

    def _part(self, group: Variables) -> Part:
        if group not in self._parts:
            if len(self._parts) == PARTS:
                self._parts.clear()
            self._parts[group] = self._made(group)
        return self._parts[group]

    def _made(self, group: Variables) -> Part:
        look()
        whole = self._of.system
        left_out = self._written & ~group
        at = tuple(at for at in range(len(whole.variables)) if not left_out >> at & 1)
        kept = frozenset(whole.variables[place].name for place in at)
        live = {action.transition.name for action in self._of.actions if FALSE not in action.conditions}
        return Part(
            at=at,
            system=System(
                variables=tuple(whole.variables[place] for place in at),
                transitions=tuple(t for t in whole.transitions if t.name in live and t.assigned <= kept and t.used <= kept),
                invariants=(),
            ),
            allowed=tuple(
                Invariant(str(number), clause)
                for number, clause in enumerate(self._of.clauses)
                if self._of.reads(clause) <= kept and self._mask(self._of.reads(clause)) & group
            ),
        )


def merged(problem: Problem, plans: Sequence[tuple[Part, Reached]]) -> Reached:
    """One plan out of the parts' plans: first what is automatic from the start, as declared, then part by part."""
    order = {transition.name: at for at, transition in enumerate(problem.system.transitions)}
    kinds = problem.system.transition
    state = list(problem.initial)
    path: list[str] = []
    states = [problem.initial]
    done = [0] * len(plans)

    def take(which: int) -> None:
        part, plan = plans[which]
        done[which] += 1
        for at, value in zip(part.at, plan.states[done[which]], strict=True):
            state[at] = value
        path.append(plan.path[done[which] - 1])
        states.append(tuple(state))

    def automatic() -> Iterator[tuple[int, int]]:
        for which, (_, plan) in enumerate(plans):
            if done[which] < len(plan.path) and kinds[plan.path[done[which]]].kind.automatic:
                yield order[plan.path[done[which]]], which

    while first := min(automatic(), default=None):
        take(first[1])
    for which, (_, plan) in enumerate(plans):
        while done[which] < len(plan.path):
            take(which)
    return Reached(tuple(path), tuple(states))


def joined(groups: Iterable[Variables]) -> list[Variables]:
    """Groups that have a variable in common, made one; in the order of their first variables."""
    apart: list[Variables] = []
    for group in groups:
        look()
        if group:
            together = [other for other in apart if other & group]
            apart = [other for other in apart if not other & group]
            apart.append(union([group, *together]))
    return sorted(apart, key=lambda group: group & -group)


def places(mask: Variables) -> Iterator[int]:
    while mask:
        yield (mask & -mask).bit_length() - 1
        mask &= mask - 1
