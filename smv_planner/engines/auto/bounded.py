"""Bounded model checking: a system unrolled into layers of clauses, one state each, for an incremental SAT solver.

Everything that belongs to one question is an assumption: where it starts, what is usable, what is allowed, which
formula has to hold and after how many steps the run idles. So what the solver has learnt serves the next question about
the same system.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

from smv_planner.clock import Over, look
from smv_planner.engines.auto.grounding import Action, Ground, alternatives
from smv_planner.engines.sat import CONFLICTS, Clauses, Coding, Literals
from smv_planner.model.domains import Value
from smv_planner.model.expressions import Expr, Var, conjunction, conjuncts, variables_of
from smv_planner.model.ltl import ALWAYS_TRUE, Atom, Both, Either, Formula, Next, Release, Until, all_of, atoms, counts_steps
from smv_planner.model.system import Invariant, System
from smv_planner.problem import Problem, Reached

SETTLED = Var("")
"""Stands in formulas for 'no usable automatic transition is enabled'; no variable has that name."""

ORDERS = 2
"""For how many kinds of questions the order of steps that might as well be swapped is fixed."""


class Layer:
    """One state: its variables, whether the run idles from here on, and the actions of the step that follows, if any."""

    def __init__(self, clauses: Clauses, system: System, actions: tuple[Action, ...], usable: list[int]) -> None:
        self.values: dict[str, Literals] = {v.name: clauses.variable(v.domain.values) for v in system.variables}
        self.coding = Coding(clauses, self.values.__getitem__)
        self.idle = clauses.new()
        self.steps: list[int] = []
        self.enabled: dict[int, int] = {}
        self.first: dict[int, int] = {}  # that no automatic action declared before is enabled
        none = clauses.true
        for at, action in enumerate(actions):
            look()
            if action.transition.kind.automatic:
                self.first[at] = none
                self.enabled[at] = clauses.every([usable[at], *map(self.coding.literal, action.conditions)])
                none = clauses.every([none, -self.enabled[at]])
        self.settled = none
        self.values[SETTLED.name] = {False: -none, True: none}
        clauses.add(-self.idle, none)


class Unrolled:
    """A system's layers, as many as were needed so far."""

    def __init__(self, system: System, actions: tuple[Action, ...]) -> None:
        self.clauses = Clauses()
        self._system = system
        self._actions = actions
        self.usable = [self.clauses.new() for _ in actions]
        self.layers = [Layer(self.clauses, system, actions, self.usable)]
        self._held: dict[Expr, int] = {}
        self._orders: dict[tuple[Ground, frozenset[str] | None], tuple[int, list[tuple[int, int]]]] = {}
        self._truths: dict[tuple[Formula, int], int] = {}
        self._waiting: list[tuple[Formula, int, int]] = []  # what later layers have to say about formulas
        self.whole = True
        """Whether nothing was left half done."""

    def work(self) -> int:
        """How much all questions have taken so far, as the solver counts it."""
        return self.clauses.solver.work()

    def run(self, problem: Problem, of: Ground, depth: int) -> Iterator[Reached | int]:
        """Look for a shortest plan of `depth` or more steps, bit by bit; yields proven lower bounds until there is one.

        Ends after the problem's bound.
        """
        try:
            yield from self._run(problem, of, depth)
        except Over:
            self.whole = False
            raise

    def _run(self, problem: Problem, of: Ground, depth: int) -> Iterator[Reached | int]:
        usable = [
            literal if action.transition.name not in problem.unusable else -literal
            for action, literal in zip(self._actions, self.usable, strict=True)
        ]
        held = {self._hold(invariant) for invariant in problem.allowed}
        holding = [literal if literal in held else -literal for literal in self._held.values()]
        start = [self.layers[0].values[name][value] for name, value in problem.system.named(problem.initial).items()]
        root = self._truth(question(problem), 0)
        in_order = self._order(of, problem)
        solver = self.clauses.solver
        while depth <= problem.bound:
            while len(self.layers) <= depth:
                self._grow()
                yield depth
            self._settle_accounts()
            before = [-self.layers[depth - 1].idle] if depth else []
            assumptions = [*usable, *holding, *start, *in_order, root, *before, self.layers[depth].idle]
            answer = solver.solve_limited(assumptions, CONFLICTS)
            if answer:
                yield self._decoded(depth)
                return
            if answer is False:
                depth += 1
            yield depth

    def _order(self, of: Ground, problem: Problem) -> list[int]:
        """Literals by which steps that might as well be swapped come in the order of their declaration."""
        key = of, visible(problem)
        if key not in self._orders:
            if len(self._orders) == ORDERS:
                return [-literal for literal, _ in self._orders.values()]
            self._orders[key] = self.clauses.new(), swappable(of, key[1])
            for first, second in pairwise(self.layers[:-1]):
                self._in_order(first, second, *self._orders[key])
        return [literal if key == other else -literal for other, (literal, _) in self._orders.items()]

    def _in_order(self, first: Layer, second: Layer, literal: int, pairs: list[tuple[int, int]]) -> None:
        for earlier, later in pairs:
            self.clauses.add(-literal, -first.steps[later], -second.steps[earlier])

    def _hold(self, invariant: Invariant) -> int:
        """The literal that holds an invariant in every layer but the first."""
        predicate = invariant.predicate
        if predicate not in self._held:
            self._held[predicate] = self.clauses.new()
            for layer in self.layers[1:]:
                self._constrain(layer, predicate)
        return self._held[predicate]

    def _constrain(self, layer: Layer, predicate: Expr) -> None:
        held = self._held[predicate]
        for part in conjuncts(predicate):
            look()
            self.clauses.add(-held, *map(layer.coding.literal, alternatives(part)))

    def _grow(self) -> None:
        before, after = self.layers[-1], Layer(self.clauses, self._system, self._actions, self.usable)
        step(self.clauses, self._actions, self.usable, before, after)
        self.clauses.add(-before.idle, after.idle)
        self.layers.append(after)
        if len(self.layers) > 2:
            for literal, pairs in self._orders.values():
                self._in_order(self.layers[-3], before, literal, pairs)
        for predicate in self._held:
            self._constrain(after, predicate)

    def _truth(self, formula: Formula, at: int) -> int:
        """A literal that implies that the formula holds from this layer on."""
        match formula:
            case Atom(predicate):
                return self.layers[at].coding.literal(predicate)
            case Both(left, right):
                return self.clauses.every([self._truth(left, at), self._truth(right, at)])
            case Either(left, right):
                return self.clauses.any([self._truth(left, at), self._truth(right, at)])
        if (formula, at) not in self._truths:
            literal = self._truths[formula, at] = self.clauses.new()
            self._waiting.append((formula, at, literal))
            last = formula.part if isinstance(formula, Next) else formula.right  # what it comes to where the run idles
            self.clauses.add(-literal, -self.layers[at].idle, self._truth(last, at))
        return self._truths[formula, at]

    def _settle_accounts(self) -> None:
        """Say what formulas mean where the run goes on, as far as there are layers."""
        left = []
        while self._waiting:
            formula, at, literal = self._waiting.pop()
            if at + 1 == len(self.layers):
                left.append((formula, at, literal))
                continue
            goes_on = (-literal, self.layers[at].idle)
            match formula:
                case Next(part):
                    self.clauses.add(*goes_on, self._truth(part, at + 1))
                case Until(first, second):
                    later = self.clauses.every([self._truth(first, at), self._truth(formula, at + 1)])
                    self.clauses.add(*goes_on, self._truth(second, at), later)
                case Release(first, second):
                    self.clauses.add(*goes_on, self._truth(second, at))
                    self.clauses.add(*goes_on, self._truth(first, at), self._truth(formula, at + 1))
        self._waiting = left

    def _decoded(self, depth: int) -> Reached:
        true = frozenset(self.clauses.solver.model())
        path = []
        for layer in self.layers[:depth]:
            chosen = next(at for at, literal in enumerate(layer.steps) if literal in true)
            path.append(self._actions[chosen].transition.name)
        names = [variable.name for variable in self._system.variables]
        states = [tuple(value_in(layer.values[name], true) for name in names) for layer in self.layers[: depth + 1]]
        return Reached(tuple(path), tuple(states))


def question(problem: Problem) -> Formula:
    """The problem's formula, with a stand-in for being settled; as it is, in its shape."""
    return all_of(Until(goal.until, Atom(conjunction([goal.predicate, SETTLED]))) for goal in problem.goals)


def visible(problem: Problem) -> frozenset[str] | None:
    """Variables whose changes a formula follows; swapping two steps that change them may matter. None: any swap may."""
    if len(problem.goals) == 1 and problem.goals[0].until == ALWAYS_TRUE:
        return frozenset()
    formulas = [Until(goal.until, Atom(goal.predicate)) for goal in problem.goals]
    if any(counts_steps(formula) for formula in formulas):
        return None
    return frozenset().union(*(variables_of(predicate) for formula in formulas for predicate in atoms(formula)))


def swappable(of: Ground, seen: frozenset[str] | None) -> list[tuple[int, int]]:
    """Pairs of actions that may be swapped when one directly follows the other: everything stays possible and allowed.

    Neither reads or writes what the other writes, no invariant reads what both write, the formula follows one of them at
    most, and no automatic transition reads what they write.
    """
    if seen is None:
        return []
    woken = {name for a in of.actions if a.transition.kind.automatic for part in a.conditions for name in of.reads(part)}
    footprints = []
    for at, action in enumerate(of.actions):
        look()
        if not action.transition.kind.automatic and woken.isdisjoint(action.assigned):
            used = frozenset().union(*map(of.reads, (*action.conditions, *action.assigned.values())), action.assigned)
            touched = frozenset(n for n, clause in enumerate(of.clauses) if not of.reads(clause).isdisjoint(action.assigned))
            footprints.append((at, action.assigned.keys(), used, touched, not seen.isdisjoint(action.assigned)))
    pairs = []
    for n, (one, writes, used, touched, followed) in enumerate(footprints):
        look()
        pairs += [
            (one, other)
            for other, also_writes, also_used, also_touched, also_followed in footprints[n + 1 :]
            if used.isdisjoint(also_writes)
            and also_used.isdisjoint(writes)
            and touched.isdisjoint(also_touched)
            and not (followed and also_followed)
        ]
    return pairs


def value_in(literals: Literals, true: frozenset[int]) -> Value:
    return next(value for value, literal in literals.items() if literal in true)


def step(clauses: Clauses, actions: tuple[Action, ...], usable: list[int], before: Layer, after: Layer) -> None:
    """One action leads from a layer to the next, or the run idles."""
    before.steps = [clauses.new() for _ in actions]
    clauses.exactly_one([*before.steps, before.idle])
    writers: dict[str, list[int]] = {}
    for at, (action, literal) in enumerate(zip(actions, before.steps, strict=True)):
        look()
        if action.transition.kind.automatic:
            clauses.add(-literal, before.enabled[at])
            clauses.add(-literal, before.first[at])
        else:
            clauses.add(-literal, usable[at])
            clauses.add(-literal, before.settled)
            for condition in action.conditions:
                clauses.add(-literal, before.coding.literal(condition))
        for name, expr in action.assigned.items():
            writers.setdefault(name, []).append(literal)
            for value, worth in before.coding.table(expr).items():
                if value in after.values[name]:
                    clauses.add(-literal, -worth, after.values[name][value])
    for name, values in before.values.items():
        if name != SETTLED.name:
            written = clauses.any(writers.get(name, []))
            for value, now in values.items():
                clauses.add(written, -now, after.values[name][value])
