"""Breadth-first search over packed states, nearest first, until a goal, the end, the bound or the budget.

A node is a packed state with the number of what the formula still asks for above it. The priority of automatic
transitions, what is usable, what is allowed and what the formula asks for are all looked up in memos.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING, Protocol

from smv_planner.clock import look
from smv_planner.engines.auto.grounding import Ground, Shared, Truth, View, needs_of, views
from smv_planner.lazy import dataclass
from smv_planner.model.expressions import Expr, Var, conjunction, conjuncts, meaning, variables_of
from smv_planner.model.ltl import Atom, Formula, Monitor, Until, all_of, atoms, over_atoms
from smv_planner.model.system import State
from smv_planner.problem import Exhausted, Goal, Problem, Reached

if TYPE_CHECKING:
    from smv_planner.engines.auto.symmetry import Fold

SETTLED = "settled"
"""Stands for 'no automatic transition is enabled' in formulas over propositions; no user name looks like the others."""


class Estimate(Protocol):
    """How many steps there are at least from a node, by what is owed there, to all the goals. It `reads` some bits of a state."""

    reads: int

    def __call__(self, node: int, owed: int) -> int: ...


FAR = 1 << 30
"""More steps than any plan has."""

WATCHES = 50
"""For how many goals is kept how they are followed."""

WATCHED = 20_000
"""How many entries that may have from earlier questions."""

MEMO = 500_000
"""How many entries the memos of a warm session may hold before they start afresh."""

TRIMS = 16
"""Every how many times they are counted: that takes as long as looking at a few dozen nodes."""

WORK = 20_000
"""How many moves and views are looked at before others get their turn: some milliseconds."""


@dataclass(frozen=True, slots=True)
class Move:
    """What one action does to a node: `keep` some bits, `put` others; computed values come from a view of what is read."""

    action: int
    keep: int
    put: int
    computed: Computed | None

    def after(self, node: int) -> int:
        return node & self.keep | (self.put if self.computed is None else self.computed[node & self.computed.part])


class Computed(dict[int, int]):
    """The bits that an action assigns, by the bits that its expressions read."""

    def __init__(self, of: Ground, assigned: dict[str, Expr], reads: frozenset[str]) -> None:
        super().__init__()
        self._packing = of.packing
        self._assigned = [(of.packing.codes[name], meaning(value, of.system.index)) for name, value in assigned.items()]
        self.part = of.packing.mask(reads)

    def __missing__(self, part: int) -> int:
        state = self._packing.unpack(part)
        self[part] = sum(codes[value(state)] for codes, value in self._assigned)
        return self[part]


@dataclass(frozen=True, slots=True)
class Way:
    """What can be done from nodes that look alike; `work` is how much it takes to look at such a node."""

    allowed: bool
    settled: bool
    fixed: tuple[tuple[int, int], ...]
    computed: tuple[tuple[int, Computed], ...]
    actions: tuple[int, ...]
    work: int


class Tables:
    """Everything about the moves of a grounded system that does not depend on the question; kept while it is warm."""

    def __init__(self, of: Ground) -> None:
        self.ground = of
        self.packing = of.packing
        self._count = len(of.actions)
        self.allowed = 1 << self._count
        enabled = ((action.conditions, 1 << at) for at, action in enumerate(of.actions))
        needs, self._unless = taken_apart(needs_of([*enabled, (of.clauses, self.allowed)]), self._count + 1, of.shared)
        self.full = (1 << self._count + 1 + len(self._unless)) - 1
        self.views = views(of.shared, needs, self.full, of.shared.truth)
        self.moves = tuple(self._move(at) for at in range(self._count))
        self._ways: dict[int, dict[int, Way]] = {}
        self._known: dict[tuple[int, bool, bool], Way] = {}
        self._watches: dict[tuple[Goal, ...], Watch] = {}
        self._trims = 0

    def ways(self, usable: int) -> dict[int, Way]:
        """A memo for one set of usable actions: from the masks that the views leave to what can be done."""
        return self._ways.setdefault(usable, {})

    def watch(self, goals: tuple[Goal, ...]) -> Watch:
        """What follows goals; the same for every question that has them."""
        found = self._watches.get(goals)
        if found is None or found.entries() > WATCHED:
            if len(self._watches) == WATCHES:
                self._watches.clear()
            found = self._watches[goals] = Watch(self.ground, goals)
        return found

    def allows(self, node: int) -> bool:
        """Whether a packed state is an allowed one."""
        mask = self.full
        for view in self.views:
            mask &= view[node & view.part]
        return bool(self.needed(mask) & self.allowed)

    def needed(self, mask: int) -> int:
        """The mask without what needs a condition of which no alternative holds."""
        for bit, needing in self._unless:
            if mask & bit:
                mask &= ~needing
        return mask

    def way(self, mask: int, usable: int) -> Way:
        """What can be done where the views leave `mask`. Whether a state is allowed is judged when it is looked at."""
        mask = self.needed(mask)
        enabled = mask & usable
        first = enabled & self.ground.automatic
        if first:
            enabled = first & -first
        key = enabled, bool(mask & self.allowed), not first
        if key not in self._known:
            self._known[key] = self._way(*key)
        return self._known[key]

    def _way(self, enabled: int, allowed: bool, settled: bool) -> Way:
        chosen = []
        while enabled:
            chosen.append(self.moves[(enabled & -enabled).bit_length() - 1])
            enabled &= enabled - 1
        return Way(
            allowed=allowed,
            settled=settled,
            fixed=tuple([(move.keep, move.put) for move in chosen if move.computed is None]),
            computed=tuple([(move.keep, move.computed) for move in chosen if move.computed is not None]),
            actions=tuple([move.action for move in chosen]),
            work=len(chosen) + len(self.views),
        )

    def entries(self) -> int:
        return sum(view.entries() for view in self.views) + sum(map(len, self._ways.values()))

    def trim(self, most: int = MEMO) -> None:
        """Forget what is only remembered to be quicker, if that has become much; as much as usual is counted now and then."""
        self._trims += 1
        if (most < MEMO or self._trims % TRIMS == 0) and self.entries() > most:
            for view in self.views:
                view.forget()
            self._ways.clear()
            self._known.clear()
            self.moves = tuple(self._move(at) for at in range(self._count))

    def _move(self, at: int) -> Move:
        look()
        action, packing = self.ground.actions[at], self.packing
        state_bits = (1 << packing.width) - 1
        keep = state_bits & ~packing.mask(action.assigned)
        constant = {name: value for name, value in action.assigned.items() if not variables_of(value)}
        if len(constant) == len(action.assigned):
            blank: State = ()
            put = 0
            for name, value in constant.items():
                worth = meaning(value, {})(blank)
                put |= packing.codes[name].get(worth, 0)  # a value outside the domain is never assigned
            return Move(at, keep, put, None)
        reads = frozenset(name for value in action.assigned.values() for name in variables_of(value))
        return Move(at, keep, 0, Computed(self.ground, dict(action.assigned), reads))


def taken_apart(needs: Mapping[Expr, int], first: int, shared: Shared) -> tuple[dict[Expr, int], list[tuple[int, int]]]:
    """Conditions that read too much for one view, by what reads less.

    An alternative that holds clears a bit, from `first` on. A bit that is left says that none of them holds; with it comes
    what needs the condition, which then is impossible.
    """
    narrow: dict[Expr, int] = {}
    unless: list[tuple[int, int]] = []
    for condition, bits in needs.items():
        look()
        for refused in shared.narrow(condition):
            bit = 1 << first + len(unless)
            unless.append((bit, bits))
            for alternative in refused:
                narrow[alternative] = narrow.get(alternative, 0) | bit
        if not shared.narrow(condition):
            narrow[condition] = narrow.get(condition, 0) | bits
    return narrow, unless


@dataclass(frozen=True, slots=True)
class Paused:
    """No plan of fewer than `depth` steps; `number` nodes are known so far, and the memos have so many entries, if counted."""

    depth: int
    number: int
    memos: int = 0


@dataclass(frozen=True, slots=True)
class Ended:
    """There is nothing more to look at, and so no plan: `proof` has the `number` nodes that there are, made when asked for."""

    number: int
    proof: Callable[[], Exhausted]


class Watch:
    """Follows the formula of goals on packed nodes: which propositions hold, and what is then left to ask for."""

    def __init__(self, of: Ground, goals: tuple[Goal, ...]) -> None:
        predicates: dict[Expr, str] = {}
        for goal in goals:
            for predicate in (goal.predicate, *atoms(goal.until)):
                predicates.setdefault(predicate, f"{len(predicates)}")
        names = [*predicates.values(), SETTLED]
        index = {name: at for at, name in enumerate(names)}
        proposition: Callable[[Expr], Expr] = lambda predicate: Var(predicates[predicate])  # noqa: E731
        formula: Formula = all_of(
            Until(over_atoms(goal.until, proposition), Atom(conjunction([proposition(goal.predicate), Var(SETTLED)])))
            for goal in goals
        )
        self._monitor = Monitor(formula, index)
        self._names = names
        self._width = of.packing.width
        self.full = (1 << len(predicates)) - 1
        needs = needs_of((conjuncts(predicate), 1 << at) for at, predicate in enumerate(predicates))
        self.views: tuple[View, ...] = views(of.shared, needs, self.full, partial(Truth, of.shared))
        self.obligations: list[int] = [self._monitor.start]
        self._numbers = {self._monitor.start: 0}
        self.duties: dict[tuple[int, bool, int], tuple[int, ...] | None] = {}

    def entries(self) -> int:
        return sum(view.entries() for view in self.views) + len(self.duties)

    def duty(self, seen: int, settled: bool, number: int) -> tuple[int, ...] | None:
        """What is left to ask for next, each way as bits of a node; None if idling here meets the formula."""
        state = (*(bool(seen >> at & 1) for at in range(len(self._names) - 1)), settled)
        owed = self.obligations[number]
        if settled and self._monitor.met_by_idling(owed, state):
            return None
        return tuple(self._number(left) << self._width for left in self._monitor.after(owed, state))

    def _number(self, owed: int) -> int:
        if owed not in self._numbers:
            self._numbers[owed] = len(self.obligations)
            self.obligations.append(owed)
        return self._numbers[owed]


class Remaining(dict[int, int]):
    """How many steps there are at least from a node: what an estimate says, kept for as long as a question is worked on."""

    def __init__(self, estimate: Estimate, watch: Watch, width: int) -> None:
        super().__init__()
        self._estimate = estimate
        self._reads = estimate.reads | -1 << width
        self._known: dict[int, int] = {}  # nodes often differ by what does not matter
        self._obligations = watch.obligations
        self._width = width

    def __missing__(self, node: int) -> int:
        read = node & self._reads
        steps = self._known.get(read)
        if steps is None:
            steps = self._known[read] = self._estimate(node, self._obligations[node >> self._width])
        self[node] = steps
        return steps


class Search:
    """A question to be answered by looking at nodes."""

    def __init__(self, tables: Tables, problem: Problem) -> None:
        self.tables = tables
        self.problem = problem
        self.usable = tables.ground.usable(problem.unusable)
        self._watch = tables.watch(problem.goals)

    def remaining(self, estimate: Estimate) -> Remaining:
        return Remaining(estimate, self._watch, self.tables.packing.width)

    def explore(
        self, fold: Fold | None = None, chunk: int = WORK, within: tuple[Remaining, int] | None = None
    ) -> Iterator[Reached | Ended | Paused]:
        """Look at nodes no deeper than the bound; pauses after each `chunk` of work and each step of depth.

        The first hit is a shortest plan. The initial state has to be allowed. With `fold`, one of all nodes that fold into
        the same is looked at; what has `Ended` then has no proof.

        `within` leaves out nodes that, as is estimated, are on no plan of so many steps; the last pause then says how many
        steps there have to be instead. No estimate is too high, so a plan that is found is the one found without: no node
        is left out that is on some plan of so many steps, nor any that is the first to lead to one.
        """
        tables, watch, usable, duties = self.tables, self._watch, self.usable, self._watch.duties
        packing, width = tables.packing, tables.packing.width
        ways = tables.ways(usable)
        moving = [(view.part, view) for view in tables.views]
        watching = [(view.part, view) for view in watch.views]
        full, watched = tables.full, watch.full
        bound = self.problem.bound

        start = packing.pack(self.problem.initial)
        if fold is not None:
            start = fold(start)
            folded = fold.part
        parent: dict[int, int] = {start: start}
        forbidden: set[int] = set()
        frontier = [start]
        depth = work = 0
        remaining, limit = within or (None, 0)
        beyond = FAR
        while frontier and depth <= bound:
            yield Paused(depth, len(parent))
            following: list[int] = []
            left_over, nearest = limit - depth - 1, FAR
            for node in frontier:
                if work > chunk:
                    work = 0
                    yield Paused(depth, len(parent), tables.entries() + len(fold or ()))
                mask, seen = full, watched
                for part, view in moving:
                    mask &= view[node & part]
                for part, view in watching:
                    seen &= view[node & part]
                way = ways.get(mask)
                if way is None:
                    way = ways[mask] = tables.way(mask, usable)
                work += way.work
                if not way.allowed:
                    forbidden.add(node)
                    continue
                key = (seen, way.settled, node >> width)
                if key in duties:
                    duty = duties[key]
                else:
                    duty = duties[key] = watch.duty(*key)
                if duty is None:
                    yield self._trace(node, parent, fold)
                    return
                for left in duty:
                    found = [node & keep | put | left for keep, put in way.fixed]
                    for keep, computed in way.computed:
                        found.append(node & keep | computed[node & computed.part] | left)
                    for new in found:
                        if fold is not None:
                            part = new & folded
                            new ^= part ^ fold[part]
                        if new not in parent:
                            if remaining is not None:
                                away = remaining[new]
                                if away > left_over:
                                    if away < nearest:
                                        nearest = away
                                    continue
                            parent[new] = node
                            following.append(new)
            frontier = following
            depth += 1
            beyond = min(beyond, depth + nearest)
        if frontier or remaining is not None:
            yield Paused(min(depth, beyond) if frontier else beyond, len(parent))
            return
        low = (1 << width) - 1
        looked_at = parent.keys() - forbidden
        yield Ended(
            number=len(looked_at),
            proof=lambda: Exhausted(
                frozenset((packing.unpack(node & low), watch.obligations[node >> width]) for node in looked_at)
            ),
        )

    def _trace(self, node: int, parent: dict[int, int], fold: Fold | None) -> Reached:
        nodes = [node]
        while parent[node] != node:
            node = parent[node]
            nodes.append(node)
        packing = self.tables.packing
        low = (1 << packing.width) - 1
        now = packing.pack(self.problem.initial)
        path, states = [], [self.problem.initial]
        for wanted in reversed(nodes[:-1]):
            following = self._steps(now)
            step = next((step for step in following if wanted & low == (step[1] if fold is None else fold(step[1]))), None)
            assert step is not None, "a node follows on its parent by one of the parent's actions"
            name, now = step
            path.append(name)
            states.append(packing.unpack(now))
        return Reached(tuple(path), tuple(states))

    def _steps(self, before: int) -> Iterator[tuple[str, int]]:
        """The steps from a packed state, by the names of their transitions."""
        tables = self.tables
        mask = tables.full
        for view in tables.views:
            mask &= view[before & view.part]
        for at in tables.way(mask, self.usable).actions:
            yield tables.ground.actions[at].transition.name, tables.moves[at].after(before)
