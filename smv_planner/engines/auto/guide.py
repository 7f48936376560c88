"""How far away a goal is at least: distances in small parts of the system, looked up while the search goes on.

The last step before a goal is met is taken by one of a few actions; what it needs is looked at one action at a time. For
each, a plan that loses nothing (a relaxed plan) tells which variables have to change. They are split into patterns of
which every action changes one at most, so that the steps needed in each add up, and a pattern's distances are found by
searching it alone, whatever all other variables are (pattern databases: Culberson and Schaeffer 1998, Felner and others
2004). Everything left out makes steps possible, never impossible; so no distance is overestimated. A few goals are looked
at together: a pattern has to come by what each of them needs, in any order.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations, permutations, product
from math import prod

from smv_planner.clock import Over, look
from smv_planner.engines.auto.bounded import question
from smv_planner.engines.auto.frames import numbered
from smv_planner.engines.auto.grounding import Action, Ground, Truth, alternatives, dealt_out
from smv_planner.engines.auto.relaxed import Abstraction, Condition, Support
from smv_planner.engines.auto.search import Computed, Estimate, Tables
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

BITS_PER_GOAL = 2
"""How many more it may have for each other goal that is looked at together with the first."""

STATES = 20_000
"""How many states of a pattern are looked at; where there are more, it says nothing."""

TOGETHER = 3
"""How many goals are looked at together."""

ALTERNATIVES = 4
"""How many alternatives of what a last action needs are looked at apart."""

KEPT = 200_000
"""To how many states the distance is kept before all are forgotten."""

GOALS = 1000
"""For how many goals is kept what their distances are made of."""


class Distances(dict[int, int]):
    """How many steps that change a pattern are needed at least until each of some targets may have been met once.

    Looked up by the bits of the pattern, and above them a bit for each target that is still to be met.
    """

    def __init__(
        self,
        of: Ground,
        clauses: Iterable[Expr],
        pattern: frozenset[str],
        actions: Iterable[Action],
        targets: Sequence[Iterable[Expr]],
    ) -> None:
        super().__init__()
        self.part = of.packing.mask(pattern)
        self._width = of.packing.width
        within = [piece for action in actions for piece in _within(of, action, pattern)]
        last = [Action(of.actions[0].transition, tuple(target), {}) for target in targets]
        allowed = tuple(clause for clause in clauses if of.reads(clause) <= pattern)
        self._tables = Freely(Ground(of.system, (*within, *last), allowed, of.shared), len(last))
        self._together = range(1, 1 << len(last))
        self._following: dict[int, tuple[int, ...]] = {}
        self._met: list[tuple[int, int]] = []

    def __missing__(self, key: int) -> int:
        try:
            self._explore(key & self.part)
        except Over:  # what is half explored would seem to lead nowhere
            self._following.clear()
            self._met.clear()
            raise
        if len(self._following) > STATES:
            return 0
        self._measure()
        return self[key]

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
            following[node] = tuple(found)  # unlike a list, soon nothing to the garbage collector
            if met:
                self._met.append((node, met))
            waiting += found

    def size(self) -> int:
        return len(self._following)

    def _measure(self) -> None:
        before: dict[int, list[int]] = {}
        for node, following in self._following.items():
            for after in following:
                before.setdefault(after, []).append(node)
        for still in self._together:  # a set of targets comes after the smaller ones in it
            above = still << self._width
            self.update(dict.fromkeys([node | above for node in self._following], NEVER))
            self._spread(above, self._nearest(still), before)

    def _nearest(self, still: int) -> dict[int, list[int]]:
        """Where one of the targets is met, by how many steps all others then take."""
        nearest: dict[int, list[int]] = {}
        for node, met in self._met:
            if met & still:
                left = still & ~met
                nearest.setdefault(self[node | left << self._width] if left else 0, []).append(node)
        nearest.pop(NEVER, None)
        return nearest

    def _spread(self, above: int, nearest: dict[int, list[int]], before: Mapping[int, list[int]]) -> None:
        """Set distances from what is near to what is farther away."""
        distance = 0
        while nearest:
            waiting = nearest.pop(distance, ())
            distance += 1
            farther = nearest.get(distance, [])
            for node in waiting:
                if self[node | above] >= distance:
                    self[node | above] = distance - 1
                    farther += before.get(node, ())
            if farther:
                nearest[distance] = farther


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
    """Moves where automatic actions have no priority. The last few do nothing: if one is enabled, a target is met."""

    def __init__(self, of: Ground, targets: int) -> None:
        super().__init__(of)
        self.ahead = Ahead(self, targets)


Ways = tuple[int, list[tuple[int, int]], list[tuple[int, Computed]]]


class Ahead(dict[int, Ways]):
    """By the mask that the views leave: which targets are met, and the moves."""

    def __init__(self, tables: Freely, targets: int) -> None:
        super().__init__()
        self._tables = tables
        self._moves = tables.moves[: len(tables.moves) - targets]

    def __missing__(self, mask: int) -> Ways:
        tables = self._tables
        left = tables.needed(mask)
        met, chosen = 0, []
        if left & tables.allowed:
            met = (left & tables.allowed - 1) >> len(self._moves)
            chosen = [move for move in self._moves if left >> move.action & 1]
        self[mask] = (
            met,
            [(move.keep, move.put) for move in chosen if move.computed is None],
            [(move.keep, move.computed) for move in chosen if move.computed is not None],
        )
        return self[mask]


@dataclass(frozen=True, slots=True)
class Last:
    """An action by which a goal may come to hold, and what has to hold before it."""

    action: int
    target: tuple[Expr, ...]
    condition: Condition


@dataclass(frozen=True, slots=True)
class Towards:
    """A goal as far as it can be said what comes before it: for as long as all of `until` is owed and the goal does not hold."""

    until: int
    part: int
    holds: Truth
    lasts: tuple[Last, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """What comes before one last action of each goal: how far away it is, pattern by pattern.

    `besides` says for every set of goals how many steps come on top, since they change no pattern or come last of all.
    """

    besides: tuple[int, ...]
    patterns: tuple[Distances, ...]

    def away(self, node: int, above: int) -> int:
        return sum(distances[node & distances.part | above] for distances in self.patterns)


class Together:
    """How many steps there are at least before all of a few goals have been met that are still owed."""

    def __init__(self, goals: Sequence[Towards], cases: Sequence[Case], width: int) -> None:
        self._goals = [(1 << at, goal.until, goal.part, goal.holds) for at, goal in enumerate(goals)]
        self._cases = [(case.besides, [(each.part, each) for each in case.patterns]) for case in cases]
        self._width = width

    def __call__(self, node: int, owed: int) -> int:
        still = 0
        for bit, until, part, holds in self._goals:
            if owed & until and not holds[node & part]:
                still |= bit
        if not still:
            return 0
        least, above = NEVER, still << self._width
        for besides, patterns in self._cases:
            steps = besides[still]
            for part, distances in patterns:
                steps += distances[node & part | above]
            if steps < least:
                least = steps
        return least


class Guide:
    """What is known about the distances in a grounded system: by pattern, so that it serves many questions."""

    def __init__(self, of: Ground, abstraction: Abstraction) -> None:
        self._of = of
        self._abstraction = abstraction
        self._clauses = tuple(dict.fromkeys(part for clause in of.clauses for part in dealt_out(clause)))
        self._allowed = abstraction.condition(self._clauses)
        self._known: dict[object, Distances] = {}
        self._lasts: dict[object, list[tuple[int, tuple[Expr, ...], Condition]]] = {}
        self._cases: dict[object, Case] = {}

    def estimate(self, problem: Problem) -> Estimate | None:
        """How far away a problem's goals are; None if nothing useful is known."""
        support = self._abstraction.support(problem.initial, self._of.usable(problem.unusable))
        formula = question(problem)
        numbers = {id(node): number for number, (node, _) in enumerate(numbered(formula))}
        found = []
        for goal, until in zip(problem.goals, each_of(formula), strict=True):
            towards = self._goal(goal.predicate, 1 << numbers[id(until)] | 1 << numbers[id(formula)], support)
            if towards is not None:
                found.append(towards)
        initial = self._of.packing.pack(problem.initial)
        estimates = [self._together(goals, support, initial) for goals in _few(found)]
        return _farthest(estimates) if estimates else None

    def _goal(self, predicate: Expr, until: int, support: Support) -> Towards | None:
        of = self._of
        names = of.reads(predicate)
        lasts = []
        for action, target, condition in self._last(predicate, support.taken):
            if support.changed(condition, closely=False) is not None:
                lasts.append(Last(action, target, condition))
        if not 0 < len(lasts) <= CASES:
            return None
        ordered = sorted(names, key=of.packing.order.__getitem__)
        return Towards(until, of.packing.mask(names), of.shared.truth(predicate, ordered), tuple(lasts))

    def _last(self, predicate: Expr, taken: tuple[int, ...]) -> list[tuple[int, tuple[Expr, ...], Condition]]:
        """What has to hold before the step that makes a predicate true, for each way, and which action that is."""
        key = predicate, taken
        if key not in self._lasts:
            if len(self._lasts) == GOALS:
                self._lasts.clear()
            self._lasts[key] = list(self._ways(predicate, taken))
        return self._lasts[key]

    def _ways(self, predicate: Expr, taken: tuple[int, ...]) -> Iterator[tuple[int, tuple[Expr, ...], Condition]]:
        names, wanted = self._of.reads(predicate), tuple(conjuncts(predicate))
        for at in taken:
            action = self._of.actions[at]
            if not names.isdisjoint(action.assigned):
                needed = (*action.conditions, *(part for each in wanted for part in self._of.shared.keeps(action, each)))
                for target in _split(needed):
                    if FALSE not in target:
                        condition = self._abstraction.forced(self._abstraction.condition(target), self._allowed)
                        if condition is not None:
                            yield at, (*target, *self._abstraction.written(condition)), condition

    def _together(self, goals: Sequence[Towards], support: Support, initial: int) -> Together:
        cases = [self._case(lasts, support, initial) for lasts in product(*(goal.lasts for goal in goals))]
        different = {(case.besides, *map(id, case.patterns)): case for case in cases}
        return Together(goals, tuple(different.values()), self._of.packing.width)

    def _case(self, lasts: tuple[Last, ...], support: Support, initial: int) -> Case:
        """Of two ways to say which variables change the one by which the goals are farther away in the beginning."""
        everything = (1 << len(lasts)) - 1 << self._of.packing.width
        cases = [self._case_of(lasts, _changed(lasts, support, closely), support.taken) for closely in (False, True)]
        return max(cases, key=lambda case: case.away(initial, everything))

    def _case_of(self, lasts: tuple[Last, ...], names: frozenset[str], taken: tuple[int, ...]) -> Case:
        targets = tuple(last.target for last in lasts)
        key = tuple(last.action for last in lasts), targets, names, taken
        if key not in self._cases:
            if len(self._cases) == GOALS:
                self._cases.clear()
            free = [last.action if names.isdisjoint(self._of.actions[last.action].assigned) else None for last in lasts]
            besides = [
                max(1, len({action for at, action in enumerate(free) if still >> at & 1 and action is not None}))
                for still in range(1 << len(lasts))
            ]
            self._cases[key] = Case(tuple(besides), tuple(self._distances(targets, names, taken)))
        return self._cases[key]

    def _distances(self, targets: Sequence[tuple[Expr, ...]], names: frozenset[str], taken: Sequence[int]) -> Iterator[Distances]:
        actions = [(at, self._of.actions[at]) for at in taken if not names.isdisjoint(self._of.actions[at].assigned)]
        for pattern in self._patterns(names, [action for _, action in actions], BITS + BITS_PER_GOAL * (len(targets) - 1)):
            within = [(at, action) for at, action in actions if not pattern.isdisjoint(action.assigned)]
            asked = [frozenset(part for part in target if self._of.reads(part) <= pattern) for target in targets]
            key = pattern, tuple(asked), tuple(at for at, _ in within)
            if key not in self._known:
                if sum(distances.size() for distances in self._known.values()) > KEPT:
                    self._known.clear()
                    self._cases.clear()
                self._known[key] = Distances(self._of, self._clauses, pattern, [action for _, action in within], asked)
            yield self._known[key]

    def _patterns(self, names: frozenset[str], actions: list[Action], bits: int) -> list[frozenset[str]]:
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
                if sum(masks[name].bit_count() for name in one | other) <= bits
            ]
            most = max(pairs, key=lambda pair: pair[0], default=(0, frozenset(), frozenset()))
            if not most[0]:
                return patterns
            patterns = _joined(patterns, most[1] | most[2])


def _changed(lasts: Sequence[Last], support: Support, closely: bool) -> frozenset[str]:
    """The variables that change until one of the last actions, or on the way from one goal to another."""
    changed = [support.changed(last.condition, closely) for last in lasts]
    for one, other in permutations(lasts, 2):
        changed.append(support.changed(other.condition, closely, support.after(one.condition, one.action)))
    return frozenset().union(*(names for names in changed if names is not None))


def _few(goals: Iterable[Towards]) -> Iterator[list[Towards]]:
    """Goals that are looked at together: few, and with few cases."""
    few: list[Towards] = []
    for goal in goals:
        cases = prod(len(each.lasts) for each in (*few, goal))
        if few and (len(few) == TOGETHER or cases > CASES):
            yield few
            few = []
        few.append(goal)
    if few:
        yield few


def _farthest(estimates: Sequence[Estimate]) -> Estimate:
    if len(estimates) == 1:
        return estimates[0]
    return lambda node, owed: max(estimate(node, owed) for estimate in estimates)


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
