"""How far away goals are at least: looked up while the search goes on, to leave out what is too far for a plan.

The last step before a goal is met is taken by one of a few actions; what it needs is looked at one action at a time. For
each, a plan that loses nothing (a relaxed plan) tells which variables have to change. They are split into patterns, and the
steps needed in each add up (additive pattern databases: Felner and others 2004). A few goals are looked at together: a
pattern has to come by what each of them needs.

A quick estimate has small patterns, in which variables belong together of which many conditions speak. A wide one has
large patterns, of variables that change so that others can; it looks at the goals in every order, and at parts of a goal
that have to come about before it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations, permutations, product
from math import prod

from smv_planner.engines.auto.bounded import question
from smv_planner.engines.auto.frames import numbered
from smv_planner.engines.auto.grounding import Action, Ground, Truth, alternatives, dealt_out, union
from smv_planner.engines.auto.patterns import NEVER, Distances, Order, Pattern
from smv_planner.engines.auto.relaxed import Abstraction, Condition, Link, Support
from smv_planner.engines.auto.search import Estimate
from smv_planner.lazy import dataclass
from smv_planner.model.expressions import FALSE, And, Expr, conjuncts
from smv_planner.model.ltl import Both, Formula, Until
from smv_planner.problem import Problem

CASES = 12
"""How many actions may come last for a guide to be worth while."""

BITS = 15
"""How many bits of a state a small pattern has at most, unless some action changes more."""

BITS_PER_GOAL = 2
"""How many more it may have for each other goal that is looked at together with the first."""

WIDE = 19
"""How many bits a large pattern has at most."""

TOGETHER = 3
"""How many goals and parts of goals are looked at together."""

ALTERNATIVES = 4
"""How many alternatives of what a last action needs are looked at apart."""

KEPT = 200_000
"""To how many states the distance is kept before all are forgotten."""

GOALS = 1000
"""For how many goals is kept what their distances are made of."""


@dataclass(frozen=True, slots=True, eq=False)
class Last:
    """An action by which a goal may come to hold, and what has to hold before it."""

    action: int
    target: tuple[Expr, ...]
    condition: Condition


@dataclass(frozen=True, slots=True)
class Towards:
    """A goal as far as it can be said what comes before it: for as long as all of `until` is owed and the goal does not hold.

    A part of a goal comes `before` that, whose number it has among those that are looked at together.
    """

    until: int
    part: int
    holds: Truth
    lasts: tuple[Last, ...]
    before: int | None = None


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

    def __init__(self, goals: Sequence[Towards], cases: Iterable[Case], width: int) -> None:
        self._goals = [(1 << at, goal.until, goal.part, goal.holds) for at, goal in enumerate(goals)]
        self._cases = tuple(cases)
        self._width = width
        self.reads = union(goal.part for goal in goals) | union(each.part for case in self._cases for each in case.patterns)
        self._left: dict[int, tuple[int, list[tuple[int, list[tuple[int, Distances]]]]]] = {}

    def __call__(self, node: int, owed: int) -> int:
        still = 0
        for bit, until, part, holds in self._goals:
            if owed & until and not holds[node & part]:
                still |= bit
        if not still:
            return 0
        if still not in self._left:
            self._left[still] = still << self._width, self._of(still)
        above, cases = self._left[still]
        least = NEVER
        for steps, patterns in cases:
            for part, distances in patterns:
                steps += distances[node & part | above]
            if steps < least:
                least = steps
        return least

    def _of(self, still: int) -> list[tuple[int, list[tuple[int, Distances]]]]:
        """The cases as far as they differ by what they say of some goals."""
        different = {
            (case.besides[still], *(each.about(still) for each in case.patterns)): (
                case.besides[still],
                [(each.part, each) for each in case.patterns],
            )
            for case in self._cases
        }
        return list(different.values())


class Guide:
    """What is known about the distances in a grounded system: by pattern, so that it serves many questions."""

    def __init__(self, of: Ground, abstraction: Abstraction) -> None:
        self._of = of
        self._abstraction = abstraction
        self._clauses = tuple(dict.fromkeys(part for clause in of.clauses for part in dealt_out(clause)))
        self._allowed = abstraction.condition(self._clauses)
        self._patterns: dict[object, Pattern] = {}
        self._distances: dict[object, Distances] = {}
        self._lasts: dict[object, tuple[Last, ...]] = {}
        self._cases: dict[object, Case] = {}
        self._far: set[object] = set()
        self._implies: dict[int, tuple[Expr, ...]] = {}

    def far(self, question: object) -> bool:
        """Whether a quick estimate was not enough for a question."""
        return question in self._far

    def was_far(self, question: object) -> None:
        if len(self._far) == GOALS:
            self._far.clear()
        self._far.add(question)

    def estimate(self, problem: Problem, widely: bool) -> Estimate | None:
        """How far away a problem's goals are; None if nothing useful is known."""
        support = self._abstraction.support(problem.initial, self._of.usable(problem.unusable))
        formula = question(problem)
        numbers = {id(node): number for number, (node, _) in enumerate(numbered(formula))}
        found = []
        for goal, until in zip(problem.goals, each_of(formula), strict=True):
            towards = self._goal(goal.predicate, 1 << numbers[id(until)] | 1 << numbers[id(formula)], support)
            if towards is not None:
                found.append((goal.predicate, towards))
        initial = self._of.packing.pack(problem.initial)
        estimates = []
        for goals in _few(found):
            together = [each for _, each in goals] + (self._parts(goals, support) if widely else [])
            cases = self._all_cases(together, support, initial, widely)
            estimates.append(Together(together, cases, self._of.packing.width))
        return estimates[0] if len(estimates) == 1 else Farthest(estimates) if estimates else None

    def _goal(self, predicate: Expr, until: int, support: Support, before: int | None = None) -> Towards | None:
        of = self._of
        lasts = tuple(last for last in self._last(predicate, support.taken) if support.may_hold(last.condition))
        if not 0 < len(lasts) <= CASES:
            return None
        names = of.reads(predicate)
        truth = of.shared.truth(predicate, sorted(names, key=of.packing.order.__getitem__))
        return Towards(until, of.packing.mask(names), truth, lasts, before)

    def _parts(self, goals: Sequence[tuple[Expr, Towards]], support: Support) -> list[Towards]:
        """Parts of goals that only one action brings about. While a goal is owed and does not hold, they come before it."""
        parts: list[Towards] = []
        for number, (predicate, goal) in enumerate(goals):
            wanted = tuple(conjuncts(predicate))
            for part in wanted if len(wanted) > 1 else ():
                towards = self._goal(part, goal.until, support, number)
                if towards is not None and len(towards.lasts) == 1 and len(goals) + len(parts) < TOGETHER:
                    parts.append(towards)
        return parts

    def _last(self, predicate: Expr, taken: tuple[int, ...]) -> tuple[Last, ...]:
        """Each way to make a predicate true: which action does, and what has to hold before."""
        key = predicate, taken
        if key not in self._lasts:
            if len(self._lasts) == GOALS:
                self._lasts.clear()
            self._lasts[key] = tuple(self._ways(predicate, taken))
        return self._lasts[key]

    def _ways(self, predicate: Expr, taken: tuple[int, ...]) -> Iterator[Last]:
        names, wanted = self._of.reads(predicate), tuple(conjuncts(predicate))
        for at in taken:
            action = self._of.actions[at]
            if not names.isdisjoint(action.assigned):
                needed = (*action.conditions, *(part for each in wanted for part in self._of.shared.keeps(action, each)))
                for target in _split(needed):
                    if FALSE not in target:
                        condition = self._abstraction.forced(self._abstraction.condition(target), self._allowed)
                        if condition is not None:
                            yield Last(at, (*target, *self._abstraction.written(condition)), condition)

    def _all_cases(self, goals: Sequence[Towards], support: Support, initial: int, widely: bool) -> list[Case]:
        """What comes before each choice of last actions, if a plan may be like that.

        Goals that do not hold at first come about in any case, before a state from where they are met or after. So a case is
        left out if it cannot bring about those. The others may stay as they are, whatever a case says of them.
        """
        orders = tuple(_orders(goals)) if widely else ((0,) * len(goals),)
        whole = sum(goal.before is None for goal in goals)
        missing = union(1 << at for at, goal in enumerate(goals) if not goal.holds[initial & goal.part])
        cases = []
        for lasts in product(*(goal.lasts for goal in goals)):
            links = _links(lasts[:whole], support)
            threads = _threads(lasts, links, support) if widely else (_names(links),)
            cases += [self._case(lasts, order, threads, support.taken, widely) for order in orders]
        above = missing << self._of.packing.width
        return [case for case in cases if case.away(initial, above) < NEVER] if missing else cases

    def _case(
        self, lasts: tuple[Last, ...], order: Order, threads: tuple[frozenset[str], ...], taken: tuple[int, ...], widely: bool
    ) -> Case:
        key = lasts, order, threads, taken, widely
        if key not in self._cases:
            if len(self._cases) == GOALS:
                self._cases.clear()
            names, masks = frozenset().union(*threads), self._of.packing.masks
            actions = {at: self._of.actions[at] for at in taken if not names.isdisjoint(self._of.actions[at].assigned)}
            patterns: list[frozenset[str]] = []
            for thread in threads:
                if widely and sum(masks[name].bit_count() for name in thread) <= WIDE:
                    patterns.append(thread)
                else:
                    patterns += self._split(thread, actions, BITS if widely else BITS + BITS_PER_GOAL * (len(lasts) - 1))
            free = [last.action if names.isdisjoint(self._of.actions[last.action].assigned) else None for last in lasts]
            besides = [
                max(1, len({action for at, action in enumerate(free) if still >> at & 1 and action is not None}))
                for still in range(1 << len(lasts))
            ]
            self._cases[key] = Case(tuple(besides), tuple(self._distances_in(patterns, lasts, order, actions)))
        return self._cases[key]

    def _distances_in(
        self, patterns: Sequence[frozenset[str]], lasts: Sequence[Last], order: Order, actions: Mapping[int, Action]
    ) -> Iterator[Distances]:
        """An action that changes several patterns counts in one of them."""
        of = self._of
        counts = {at: max(patterns, key=lambda each: len(each & action.assigned.keys())) for at, action in actions.items()}
        for names in patterns:
            within = [at for at, action in actions.items() if not names.isdisjoint(action.assigned)]
            counted = tuple(at for at in within if counts[at] is names)
            free = tuple(at for at in within if counts[at] is not names)
            targets = tuple((last.action, frozenset(part for part in last.target if of.reads(part) <= names)) for last in lasts)
            key = names, counted, free, targets
            if key not in self._patterns:
                if sum(len(pattern.following) for pattern in self._patterns.values()) > KEPT:
                    for known in (self._patterns, self._distances, self._cases):
                        known.clear()
                self._patterns[key] = Pattern(of, self._clauses, *key, self._implied)
            if (key, order) not in self._distances:
                self._distances[key, order] = Distances(self._patterns[key], order)
            yield self._distances[key, order]

    def _implied(self, at: int) -> tuple[Expr, ...]:
        """What single variables have to be worth for an action to lead from an allowed state to another."""
        if at not in self._implies:
            condition = self._abstraction.forced(self._abstraction.closely(at), self._allowed)
            self._implies[at] = (FALSE,) if condition is None else tuple(self._abstraction.written(condition))
        return self._implies[at]

    def _split(self, names: frozenset[str], actions: Mapping[int, Action], bits: int) -> list[frozenset[str]]:
        """The variables, apart where no action changes both; joined where most conditions speak of both."""
        order, masks = self._of.packing.order, self._of.packing.masks
        patterns = [frozenset([name]) for name in sorted(names, key=order.__getitem__)]
        changing = [action for action in actions.values() if not names.isdisjoint(action.assigned)]
        for action in changing:
            patterns = _joined(patterns, action.assigned.keys())
        reads = [self._of.reads(clause) for clause in self._of.clauses]
        for action in changing:
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


def _links(lasts: Sequence[Last], support: Support) -> dict[Link, None]:
    """What changes until each of the last actions, with what else has to change for that; and what changes in between."""
    links = {link: None for last in lasts for link in support.changed(last.condition) or ()}
    names = set(_names(links))
    for one, other in permutations(lasts, 2):
        for link in support.changed(other.condition, support.after(one.condition, one.action)) or ():
            if not names.issuperset(link):
                links[link] = None
                names.update(link)
    return links


def _names(links: Iterable[Link]) -> frozenset[str]:
    return frozenset(name for link in links for name in link)


def _threads(lasts: Sequence[Last], links: Iterable[Link], support: Support) -> tuple[frozenset[str], ...]:
    """The variables that change, together those of which one changes so that another can."""
    names = sorted(_names(links))
    threads = [frozenset([name]) for name in names]
    for link in links:
        threads = _joined(threads, link)
    for last in lasts if len(lasts) > 1 else ():
        for link in support.linked(last.action, names):
            threads = _joined(threads, link)
    return tuple(threads)


def _few(goals: Iterable[tuple[Expr, Towards]]) -> Iterator[list[tuple[Expr, Towards]]]:
    """Goals that are looked at together: few, and with few cases."""
    few: list[tuple[Expr, Towards]] = []
    for goal in goals:
        cases = prod(len(each.lasts) for _, each in (*few, goal))
        if few and (len(few) == TOGETHER or cases > CASES):
            yield few
            few = []
        few.append(goal)
    if few:
        yield few


def _orders(goals: Sequence[Towards]) -> Iterator[Order]:
    """The orders in which goals may be met: a part of a goal not after it."""
    for order in permutations(range(len(goals))):
        turn = {number: at for at, number in enumerate(order)}
        if all(goal.before is None or turn[number] < turn[goal.before] for number, goal in enumerate(goals)):
            yield tuple(union(1 << other for other in order[: turn[number]]) for number in range(len(goals)))


class Farthest:
    """What the estimates of several goals say at most."""

    def __init__(self, estimates: Sequence[Estimate]) -> None:
        self._estimates = estimates
        self.reads = union(estimate.reads for estimate in estimates)

    def __call__(self, node: int, owed: int) -> int:
        return max(estimate(node, owed) for estimate in self._estimates)


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
