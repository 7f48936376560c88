"""How far away a goal is at least: distances in small parts of the system, looked up while the search goes on.

The last step before a goal is met is taken by one of a few actions; what it needs is looked at one action at a time. For
each, a plan that loses nothing (a relaxed plan) tells which variables have to change. They are split into patterns of
which every action changes one at most, so that the steps needed in each add up, and a pattern's distances are found by
searching it alone, whatever all other variables are (pattern databases: Culberson and Schaeffer 1998, Felner and others
2004). Everything left out makes steps possible, never impossible; so no distance is overestimated.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations, product

from smv_planner.engines.auto.bounded import question
from smv_planner.engines.auto.clock import Over, look
from smv_planner.engines.auto.frames import numbered
from smv_planner.engines.auto.grounding import Action, Ground, Truth, alternatives
from smv_planner.engines.auto.relaxed import Abstraction, Condition, Support
from smv_planner.engines.auto.search import Computed, Tables
from smv_planner.lazy import dataclass
from smv_planner.model.expressions import FALSE, And, Const, Expr, conjuncts, variables_of
from smv_planner.model.ltl import Both, Formula, Until
from smv_planner.problem import Problem

NEVER = 1 << 20
"""A distance that no plan has."""

CASES = 12
"""How many actions may come last for a guide to be worth while."""

BITS = 15
"""How many bits of a state a pattern has at most, unless some action changes more."""

STATES = 20_000
"""How many states of a pattern are looked at; where there are more, it says nothing."""

ALTERNATIVES = 4
"""How many alternatives of what a last action needs are looked at apart."""

KEPT = 200_000
"""To how many states the distance is kept before all are forgotten."""

GOALS = 1000
"""For how many goals is kept what their distances are made of."""


class Distances(dict[int, int]):
    """By the bits of a pattern: how many steps that change the pattern are needed at least until the conditions may hold."""

    def __init__(self, of: Ground, pattern: frozenset[str], actions: Iterable[Action], target: Iterable[Expr]) -> None:
        super().__init__()
        self.part = of.packing.mask(pattern)
        within = [piece for action in actions for piece in _within(of, action, pattern)]
        last = Action(of.actions[0].transition, tuple(part for part in target if of.reads(part) <= pattern), {})
        clauses = tuple(clause for clause in of.clauses if of.reads(clause) <= pattern)
        self._tables = Freely(Ground(of.system, (*within, last), clauses, of.shared))
        self._following: dict[int, list[int]] = {}
        self._targets: list[int] = []

    def __missing__(self, part: int) -> int:
        try:
            self._explore(part)
        except Over:  # what is half explored would seem to lead nowhere
            self._following.clear()
            self._targets.clear()
            raise
        self.update(dict.fromkeys(self._following, NEVER if len(self._following) <= STATES else 0))
        if len(self._following) <= STATES:
            self._measure()
        return self[part]

    def _explore(self, start: int) -> None:
        """Add what can follow on a state of the pattern."""
        following, ahead = self._following, self._tables.ahead
        views = [(view.part, view) for view in self._tables.views]
        waiting = [start]
        while waiting and len(following) <= STATES:
            node = waiting.pop()
            if node in following:
                continue
            if len(following) % 1024 == 0:
                look()
            mask = self._tables.full
            for part, view in views:
                mask &= view[node & part]
            met, fixed, computed = ahead[mask]
            found = [node & keep | put for keep, put in fixed]
            for keep, worth in computed:
                found.append(node & keep | worth[node & worth.part])
            following[node] = found
            if met:
                self._targets.append(node)
            waiting += found
        for node in waiting:
            following.setdefault(node, [])

    def size(self) -> int:
        return len(self._following)

    def _measure(self) -> None:
        before: dict[int, list[int]] = {}
        for node, following in self._following.items():
            for after in following:
                before.setdefault(after, []).append(node)
        waiting, distance = self._targets, 0
        for node in waiting:
            self[node] = 0
        while waiting:
            distance += 1
            nearest = []
            for node in waiting:
                for earlier in before.get(node, ()):
                    if self[earlier] > distance:
                        self[earlier] = distance
                        nearest.append(earlier)
            waiting = nearest


def _within(of: Ground, action: Action, pattern: frozenset[str]) -> Iterator[Action]:
    """What an action does to a pattern. Where that depends on other variables, it may do anything."""
    assigned = {name: value for name, value in action.assigned.items() if name in pattern}
    if assigned:
        open_ = [name for name, value in assigned.items() if not variables_of(value) <= pattern]
        conditions = tuple(part for part in action.conditions if of.reads(part) <= pattern)
        for values in product(*(of.system.domains[name].values for name in open_)):
            chosen = {name: Const(value) for name, value in zip(open_, values, strict=True)}
            yield Action(action.transition, conditions, {**assigned, **chosen})


class Freely(Tables):
    """Moves where automatic actions have no priority. The last action does nothing: if it is enabled, a target is met."""

    def __init__(self, of: Ground) -> None:
        super().__init__(of)
        self.ahead = Ahead(self)


Ways = tuple[bool, list[tuple[int, int]], list[tuple[int, Computed]]]


class Ahead(dict[int, Ways]):
    """By the mask that the views leave: whether the target is met, and the moves."""

    def __init__(self, tables: Freely) -> None:
        super().__init__()
        self._tables = tables

    def __missing__(self, mask: int) -> Ways:
        tables = self._tables
        left = tables.needed(mask)
        met, chosen = False, []
        if left & tables.allowed:
            *moves, _ = tables.moves
            met = bool(left >> len(moves) & 1)
            chosen = [move for move in moves if left >> move.action & 1]
        self[mask] = (
            met,
            [(move.keep, move.put) for move in chosen if move.computed is None],
            [(move.keep, move.computed) for move in chosen if move.computed is not None],
        )
        return self[mask]


Case = tuple[tuple[int, Distances], ...]
"""Patterns, the bits of a state that each is about and how far away it is; together what has to come before a last action."""


@dataclass(frozen=True, slots=True)
class Towards:
    """How far a goal is away at least: nothing if it holds, else what comes before one of the actions that may make it hold."""

    part: int
    holds: Truth
    cases: tuple[Case, ...]

    def __call__(self, node: int) -> int:
        if self.holds[node & self.part]:
            return 0
        least = NEVER
        for case in self.cases:
            steps = 1
            for part, distances in case:
                steps += distances[node & part]
            if steps < least:
                least = steps
        return least


class Estimate:
    """How many steps there are at least before all goals that are still owed have been met."""

    def __init__(self, goals: Sequence[tuple[int, Towards]]) -> None:
        self._goals = goals

    def __call__(self, node: int, owed: int) -> int:
        most = 0
        for until, towards in self._goals:
            if owed & until:
                steps = towards(node)
                if steps > most:
                    most = steps
        return most


class Guide:
    """What is known about the distances in a grounded system: by pattern, so that it serves many questions."""

    def __init__(self, of: Ground, abstraction: Abstraction) -> None:
        self._of = of
        self._abstraction = abstraction
        self._known: dict[object, Distances] = {}
        self._lasts: dict[object, list[tuple[tuple[Expr, ...], Condition]]] = {}
        self._cases: dict[object, Case] = {}

    def estimate(self, problem: Problem) -> Estimate | None:
        """How far away a problem's goals are; None if nothing useful is known."""
        support = self._abstraction.support(problem.initial, self._of.usable(problem.unusable))
        formula = question(problem)
        numbers = {id(node): number for number, (node, _) in enumerate(numbered(formula))}
        found = []
        for goal, until in zip(problem.goals, each_of(formula), strict=True):
            towards = self._goal(goal.predicate, support)
            if towards is not None:
                found.append((1 << numbers[id(until)] | 1 << numbers[id(formula)], towards))
        return Estimate(found) if found else None

    def _goal(self, predicate: Expr, support: Support) -> Towards | None:
        of = self._of
        names = of.reads(predicate)
        cases = []
        for target, condition in self._last(predicate, support.taken):
            pattern = support.changed(condition)
            if pattern is not None:
                cases.append(self._case(target, pattern, support.taken))
        if not 0 < len(cases) <= CASES:
            return None
        ordered = sorted(names, key=of.packing.order.__getitem__)
        return Towards(of.packing.mask(names), of.shared.truth(predicate, ordered), tuple(cases))

    def _last(self, predicate: Expr, taken: tuple[int, ...]) -> list[tuple[tuple[Expr, ...], Condition]]:
        """What has to hold before the step that makes a predicate true, for each way."""
        key = predicate, taken
        if key not in self._lasts:
            if len(self._lasts) == GOALS:
                self._lasts.clear()
            self._lasts[key] = list(self._ways(predicate, taken))
        return self._lasts[key]

    def _ways(self, predicate: Expr, taken: tuple[int, ...]) -> Iterator[tuple[tuple[Expr, ...], Condition]]:
        names, wanted = self._of.reads(predicate), tuple(conjuncts(predicate))
        for action in map(self._of.actions.__getitem__, taken):
            if not names.isdisjoint(action.assigned):
                needed = (*action.conditions, *(part for each in wanted for part in self._of.shared.keeps(action, each)))
                for target in _split(needed):
                    if FALSE not in target:
                        condition = self._abstraction.forced(self._abstraction.condition(target))
                        yield (*target, *self._abstraction.written(condition)), condition

    def _case(self, target: tuple[Expr, ...], names: frozenset[str], taken: tuple[int, ...]) -> Case:
        key = target, names, taken
        if key not in self._cases:
            if len(self._cases) == GOALS:
                self._cases.clear()
            self._cases[key] = tuple(self._distances(target, names, taken))
        return self._cases[key]

    def _distances(
        self, target: tuple[Expr, ...], names: frozenset[str], taken: Sequence[int]
    ) -> Iterator[tuple[int, Distances]]:
        actions = [(at, self._of.actions[at]) for at in taken if not names.isdisjoint(self._of.actions[at].assigned)]
        for pattern in self._patterns(names, [action for _, action in actions]):
            within = [(at, action) for at, action in actions if not pattern.isdisjoint(action.assigned)]
            asked = tuple(part for part in target if self._of.reads(part) <= pattern)
            key = pattern, frozenset(asked), tuple(at for at, _ in within)
            if key not in self._known:
                if sum(distances.size() for distances in self._known.values()) > KEPT:
                    self._known.clear()
                    self._cases.clear()
                self._known[key] = Distances(self._of, pattern, [action for _, action in within], asked)
            yield self._known[key].part, self._known[key]

    def _patterns(self, names: frozenset[str], actions: list[Action]) -> list[frozenset[str]]:
        """The variables, apart where no action changes both; joined where most conditions speak of both."""
        order, masks = self._of.packing.order, self._of.packing.masks
        patterns = [frozenset([name]) for name in sorted(names, key=order.__getitem__)]
        for action in actions:
            patterns = _joined(patterns, action.assigned.keys())
        reads = [self._of.reads(clause) for clause in self._of.clauses]
        for action in actions:
            reads += [self._of.reads(part) | names.intersection(action.assigned) for part in action.conditions]
            reads += [self._of.reads(value) | {name} for name, value in action.assigned.items()]
        reads = [read for read in reads if read <= names]
        while True:
            pairs = [
                (sum(1 for read in reads if read & one and read & other), one, other)
                for one, other in combinations(patterns, 2)
                if sum(masks[name].bit_count() for name in one | other) <= BITS
            ]
            most = max(pairs, key=lambda pair: pair[0], default=(0, frozenset(), frozenset()))
            if not most[0]:
                return patterns
            patterns = _joined(patterns, most[1] | most[2])


def each_of(formula: Formula) -> Iterator[Until]:
    """The goals in a problem's formula, in their order."""
    match formula:
        case Both(left, right):
            yield from each_of(left)
            yield from each_of(right)
        case Until():
            yield formula


def _split(parts: tuple[Expr, ...]) -> Iterator[tuple[Expr, ...]]:
    """A conjunction of which one part has a few alternatives, once for each of them: each may take other variables."""
    for at, part in enumerate(parts):
        ways = alternatives(part)
        if 1 < len(ways) <= ALTERNATIVES and any(isinstance(way, And) for way in ways):
            for way in ways:
                yield (*parts[:at], *conjuncts(way), *parts[at + 1 :])
            return
    yield parts


def _joined(patterns: list[frozenset[str]], names: Iterable[str]) -> list[frozenset[str]]:
    touched = [pattern for pattern in patterns if not pattern.isdisjoint(names)]
    if len(touched) < 2:
        return patterns
    at = patterns.index(touched[0])
    whole = frozenset().union(*touched)
    return [whole if place == at else pattern for place, pattern in enumerate(patterns) if place == at or pattern not in touched]
