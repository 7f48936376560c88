"""How far away goals are at least: looked up while the search goes on, to leave out what is too far for a plan.

A case is a choice of one last action for each goal. What that needs comes about, in a plan that loses nothing (a relaxed
plan), by changes of a few variables. These are split into patterns, and the steps needed in each add up (additive pattern
databases: Felner and others 2004). A plan is like one of the cases, so the nearest case counts. A few goals are looked at
together: a pattern has to come by what each of them needs.

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
from smv_planner.engines.auto.grounding import Action, Ground, union
from smv_planner.engines.auto.lasts import ACTIONS, Last, Lasts, Towards
from smv_planner.engines.auto.patterns import NEVER, Distances, Order, Pattern
from smv_planner.engines.auto.relaxed import Abstraction
from smv_planner.engines.auto.search import Estimate
from smv_planner.engines.auto.support import Link, Support
from smv_planner.lazy import dataclass
from smv_planner.model.expressions import conjuncts
from smv_planner.model.ltl import Both, Formula, Until
from smv_planner.problem import Problem

BITS = 15
"""How many bits of a state a small pattern has at most, unless some action changes more."""

BITS_PER_GOAL = 2
"""How many more it may have for each other goal that is looked at together with the first."""

WIDE = 19
"""How many bits a large pattern has at most."""

TOGETHER = 3
"""How many goals and parts of goals are looked at together."""

KEPT = 500_000
"""How many states and distances of patterns are kept before all are forgotten."""

QUESTIONS = 1000
"""How many are remembered because they were far, and of how many choices of last actions is kept what comes before."""

Before = tuple[tuple[int, ...], tuple[Pattern, ...]]
"""What comes before a last action of each goal: `besides` and patterns of a case."""


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """What comes before one last action of each goal, where goals are met in some order.

    `besides` says for every set of goals how many steps come on top of those in patterns, since they change none or come
    last of all.
    """

    order: Order
    besides: tuple[int, ...]
    patterns: tuple[Pattern, ...]

    def distances(self, still: int) -> list[Distances]:
        """By pattern, until all goals are met that still are to be."""
        return [pattern.distances(still, self.order) for pattern in self.patterns]

    def possible(self, node: int, still: int) -> bool:
        """Whether these goals may be met like that."""
        return all(distances[node & distances.part] < NEVER for distances in self.distances(still))


class Together:
    """How many steps there are at least before all of a few goals have been met that are still owed."""

    def __init__(self, goals: Sequence[Towards], cases: Iterable[Case]) -> None:
        self._goals = [(1 << at, goal.until, goal.part, goal.holds) for at, goal in enumerate(goals)]
        self._cases = tuple(cases)
        self.reads = union(goal.part for goal in goals) | union(each.part for case in self._cases for each in case.patterns)
        self._of: dict[int, list[tuple[int, list[tuple[int, Distances]]]]] = {}

    def __call__(self, node: int, owed: int) -> int:
        still = 0
        for bit, until, part, holds in self._goals:
            if owed & until and not holds[node & part]:
                still |= bit
        if not still:
            return 0
        if still not in self._of:
            self._of[still] = self._different(still)
        least = NEVER
        for steps, patterns in self._of[still]:
            for part, distances in patterns:
                steps += distances[node & part]
            if steps < least:
                least = steps
        return least

    def _different(self, still: int) -> list[tuple[int, list[tuple[int, Distances]]]]:
        """The cases as far as they differ by what they say of some goals."""
        different = {}
        for case in self._cases:
            steps, patterns = case.besides[still], case.distances(still)
            different[steps, *map(id, patterns)] = steps, [(each.part, each) for each in patterns]
        return list(different.values())


class Guide:
    """What is known about the distances in a grounded system: by pattern, so that it serves many questions."""

    def __init__(self, of: Ground, abstraction: Abstraction) -> None:
        self._of = of
        self._abstraction = abstraction
        self._lasts = Lasts(of, abstraction)
        self._patterns: dict[object, Pattern] = {}
        self._before: dict[object, Before] = {}
        self._far: set[object] = set()

    def far(self, question: object) -> bool:
        """Whether a quick estimate was not enough for a question."""
        return question in self._far

    def was_far(self, question: object) -> None:
        if len(self._far) == QUESTIONS:
            self._far.clear()
        self._far.add(question)

    def estimate(self, problem: Problem, widely: bool) -> Estimate | None:
        """How far away a problem's goals are, from any node that can follow on where it starts; None if nothing is known."""
        support = self._abstraction.support(problem.initial, self._of.usable(problem.unusable))
        formula = question(problem)
        numbers = {id(node): number for number, (node, _) in enumerate(numbered(formula))}
        found = []
        for goal, until in zip(problem.goals, each_of(formula), strict=True):
            owed = 1 << numbers[id(until)] | 1 << numbers[id(formula)]
            towards = self._lasts.towards(goal.predicate, owed, support)
            if towards is not None:
                found.append(towards)
        initial = self._of.packing.pack(problem.initial)
        estimates = []
        for goals in _few(found):
            together = [*goals, *(self._parts(goals, support) if widely else ())]
            estimates.append(Together(together, self._cases(together, support, initial, widely)))
        return estimates[0] if len(estimates) == 1 else Farthest(estimates) if estimates else None

    def _parts(self, goals: Sequence[Towards], support: Support) -> list[Towards]:
        """Parts of goals that only one action brings about. While a goal is owed and does not hold, they come before it."""
        parts: list[Towards] = []
        for number, goal in enumerate(goals):
            wanted = tuple(conjuncts(goal.predicate))
            for part in wanted if len(wanted) > 1 else ():
                towards = self._lasts.towards(part, goal.until, support, number)
                if towards is not None and len(towards.lasts) == 1 and len(goals) + len(parts) < TOGETHER:
                    parts.append(towards)
        return parts

    def _cases(self, goals: Sequence[Towards], support: Support, initial: int, widely: bool) -> list[Case]:
        """Each choice of last actions, in each order, if a plan may be like that.

        Goals that do not hold at first come about in any case, before a state from where they are met or after. So a case is
        left out if it cannot bring about those. The others may stay as they are, whatever a case says of them.
        """
        orders = tuple(_orders(goals)) if widely else ((0,) * len(goals),)
        whole = sum(goal.before is None for goal in goals)
        cases = []
        for lasts in product(*(goal.lasts for goal in goals)):
            links = _links(lasts[:whole], support)
            threads = _threads(lasts, links, support) if widely else (_names(links),)
            besides, patterns = self._what_comes_before(lasts, threads, support.taken, widely)
            cases += [Case(order, besides, patterns) for order in orders]
        missing = union(1 << at for at, goal in enumerate(goals) if not goal.holds[initial & goal.part])
        return [case for case in cases if case.possible(initial, missing)] if missing else cases

    def _what_comes_before(
        self, lasts: tuple[Last, ...], threads: tuple[frozenset[str], ...], taken: tuple[int, ...], widely: bool
    ) -> Before:
        """The same in every order."""
        key = lasts, threads, taken, widely
        if key not in self._before:
            if len(self._before) == QUESTIONS:
                self._before.clear()
            names, masks = frozenset().union(*threads), self._of.packing.masks
            actions = {at: self._of.actions[at] for at in taken if not names.isdisjoint(self._of.actions[at].assigned)}
            split: list[frozenset[str]] = []
            for thread in threads:
                if widely and sum(masks[name].bit_count() for name in thread) <= WIDE:
                    split.append(thread)
                else:
                    split += self._split(thread, actions, BITS if widely else BITS + BITS_PER_GOAL * (len(lasts) - 1))
            self._before[key] = tuple(_besides(lasts, actions)), tuple(self._patterns_of(split, lasts, actions))
        return self._before[key]

    def _patterns_of(
        self, split: Sequence[frozenset[str]], lasts: Sequence[Last], actions: Mapping[int, Action]
    ) -> Iterator[Pattern]:
        """An action that changes several patterns counts in one of them."""
        of = self._of
        counts = {at: max(split, key=lambda each: len(each & action.assigned.keys())) for at, action in actions.items()}
        for names in split:
            within = [at for at, action in actions.items() if not names.isdisjoint(action.assigned)]
            counted = tuple(at for at in within if counts[at] is names)
            free = tuple(at for at in within if counts[at] is not names)
            targets = tuple((last.action, frozenset(part for part in last.target if of.reads(part) <= names)) for last in lasts)
            key = names, counted, free, targets
            if key not in self._patterns:
                if sum(pattern.size() for pattern in self._patterns.values()) > KEPT:
                    self._patterns.clear()
                    self._before.clear()
                self._patterns[key] = Pattern(of, self._lasts.clauses, *key, self._lasts.implied)
            yield self._patterns[key]

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
        of = {name: 1 << at for at, name in enumerate(names)}
        together = [union(of[name] for name in read) for read in reads if read <= names]
        while True:
            sets = [(pattern, union(of[name] for name in pattern)) for pattern in patterns]
            pairs = [
                (sum([1 for read in together if read & some and read & others]), one, other)
                for (one, some), (other, others) in combinations(sets, 2)
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


def _besides(lasts: Sequence[Last], actions: Mapping[int, Action]) -> Iterator[int]:
    """For every set of goals how many of their last actions change no pattern; at least the one that is the last of all."""
    for still in range(1 << len(lasts)):
        yield max(1, len({last.action for at, last in enumerate(lasts) if still >> at & 1 and last.action not in actions}))


def _few(goals: Iterable[Towards]) -> Iterator[list[Towards]]:
    """Goals that are looked at together: few, and with few cases."""
    few: list[Towards] = []
    for goal in goals:
        cases = prod(len(each.lasts) for each in (*few, goal))
        if few and (len(few) == TOGETHER or cases > ACTIONS):
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


def _joined(patterns: list[frozenset[str]], names: Iterable[str]) -> list[frozenset[str]]:
    touched = [pattern for pattern in patterns if not pattern.isdisjoint(names)]
    if len(touched) < 2:
        return patterns
    at = patterns.index(touched[0])
    whole = frozenset().union(*touched)
    return [whole if place == at else pattern for place, pattern in enumerate(patterns) if place == at or pattern not in touched]
