"""How many steps a small part of a system needs, by searching it alone, whatever all other variables are.

Everything that is left out makes steps possible, never impossible; so no distance is too high (pattern databases: Culberson
and Schaeffer 1998). Where an action changes several parts, its steps count in one of them and are free in the others, so
that the distances of all parts may be added.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import product

from smv_planner.clock import Over, look
from smv_planner.engines.auto.grounding import Action, Ground
from smv_planner.engines.auto.search import Computed, Move, Tables
from smv_planner.lazy import dataclass
from smv_planner.model.expressions import Const, Expr, variables_of

NEVER = 1 << 20
"""A distance that no plan has."""

STATES = 20_000
"""How many states of a part are looked at; where there are more, it says nothing."""

Order = tuple[int, ...]
"""For every target those that are met before it or at once, one bit each."""

Target = tuple[int, frozenset[Expr]]
"""An action, and what has to hold before it is taken."""


class Pattern:
    """A part of a system: what can follow on its states by steps that count and by steps that do not, and what meets targets."""

    def __init__(
        self,
        of: Ground,
        clauses: Iterable[Expr],
        names: frozenset[str],
        counted: Sequence[int],
        free: Sequence[int],
        targets: Sequence[Target],
        implied: Callable[[int], tuple[Expr, ...]],
    ) -> None:
        self.part = of.packing.mask(names)

        def within(at: int) -> Iterator[Action]:
            return _within(of, of.actions[at], implied(at), names)

        counting, idle = ([piece for at in some for piece in within(at)] for some in (counted, free))
        last, self._lasts = [], []
        for number, (at, target) in enumerate(targets):
            for piece in tuple(within(at)) or (Action(of.actions[at].transition, (), {}),):
                last.append(Action(piece.transition, tuple(target), piece.assigned))
                self._lasts.append((1 << number, at, int(at in counted)))
        allowed = tuple(clause for clause in clauses if of.reads(clause) <= names)
        self._tables = Freely(Ground(of.system, (*counting, *idle, *last), allowed, of.shared), len(counting), len(last))
        self._distances: dict[tuple[int, Order], Distances] = {}
        self.states: set[int] = set()
        """What follows on any of these is one of them, except where there are too many."""
        self.stuck: set[int] = set()
        """Those on which nothing follows: above all what is not allowed."""
        self.before: dict[int, list[int]] = {}
        """From where a step that counts leads to a state."""
        self.beside: dict[int, list[int]] = {}
        """From where a step that does not count leads to a state."""
        self.met: list[tuple[int, int, int, int]] = []
        """A state, the targets that are met by an action, what follows on that, and how much the action counts."""

    def distances(self, still: int, order: Order) -> Distances:
        """To the targets that are still to be met; the same for all orders that differ in other targets only."""
        key = still, tuple(before & still for at, before in enumerate(order) if still >> at & 1)
        if key not in self._distances:
            self._distances[key] = Distances(self, still, order)
        return self._distances[key]

    def size(self) -> int:
        """How many states and distances are kept."""
        return len(self.states) + sum(map(len, self._distances.values()))

    def explore(self, start: int) -> bool:
        """Add what can follow on a state; False if there are too many."""
        try:
            self._explore(start)
        except Over:  # what is half explored would seem to lead nowhere
            for known in (self.states, self.stuck, self.before, self.beside, self.met):
                known.clear()
            raise
        return len(self.states) <= STATES

    def _explore(self, start: int) -> None:
        states, ahead = self.states, self._tables.ahead
        views = [(view.part, view) for view in self._tables.views]
        waiting = [start]
        while waiting and len(states) <= STATES:
            node = waiting.pop()
            if node in states:
                continue
            if len(states) % 1024 == 0:
                look()
            states.add(node)
            mask = self._tables.full
            for part, view in views:
                mask &= view[node & part]
            met, counted, free = ahead[mask]
            for moves, sources in ((counted, self.before), (free, self.beside)):
                if moves:
                    found = moves.after(node)
                    for after in found:
                        sources.setdefault(after, []).append(node)
                    waiting += found
            if met:
                waiting += self._meet(node, met)
            if not (met or counted or free):
                self.stuck.add(node)

    def _meet(self, node: int, met: int) -> Iterator[int]:
        """Note which targets are met by what follows on a state, and yield that."""
        moves = self._tables.moves[-len(self._lasts) :]
        found: dict[tuple[int, int, int], int] = {}
        for number, (bit, at, cost) in enumerate(self._lasts):
            if met >> number & 1:
                key = moves[number].after(node), at, cost
                found[key] = found.get(key, 0) | bit
        for (after, _, cost), bits in found.items():
            self.met.append((node, bits, after, cost))
            yield after


class Distances(dict[int, int]):
    """How many steps that count are needed at least until each target that is `still` to be met has been met once.

    Looked up by the bits of the pattern. The step by which the last of the targets is met does not count. When the pattern
    comes to have more states, what is known of others stays right: all that can follow on them was there before.
    """

    def __init__(self, pattern: Pattern, still: int, order: Order) -> None:
        super().__init__()
        self.part = pattern.part
        self._pattern = pattern
        self._still = still
        self._order = order

    def __missing__(self, node: int) -> int:
        if not self._pattern.explore(node):
            return 0
        if node in self._pattern.stuck:  # others are as far as before
            self[node] = NEVER
        else:
            self._measure()
        return self[node]

    def _measure(self) -> None:
        """Measure from all states of the pattern: what is left half done if the time is up is not kept."""
        look()
        nearest = self._nearest()
        self.update(dict.fromkeys(self._pattern.states, NEVER))
        self._spread(nearest)

    def _nearest(self) -> dict[int, list[int]]:
        """Where one of the targets is met, by how many steps all others then take."""
        nearest: dict[int, list[int]] = {}
        for node, bits, after, cost in self._pattern.met:
            now = self._in_turn(bits & self._still)
            if now:
                left = self._still & ~now
                steps = cost + self._pattern.distances(left, self._order)[after] if left else 0
                if steps < NEVER:
                    nearest.setdefault(steps, []).append(node)
        return nearest

    def _in_turn(self, bits: int) -> int:
        """Of targets that are met at once those whose turn it is."""
        for number, before in enumerate(self._order):
            if bits >> number & 1 and before & self._still & ~bits:
                return self._in_turn(bits ^ 1 << number)
        return bits

    def _spread(self, nearest: dict[int, list[int]]) -> None:
        """Set distances from what is near to what is farther away."""
        before, beside = self._pattern.before, self._pattern.beside
        distance = 0
        while nearest:
            waiting = nearest.pop(distance, [])
            distance += 1
            farther = nearest.get(distance, [])
            for node in waiting:  # what is beside a node joins them
                if self[node] >= distance:
                    self[node] = distance - 1
                    farther += before.get(node, ())
                    waiting += beside.get(node, ())
            if farther:
                nearest[distance] = farther


def _within(of: Ground, action: Action, implied: tuple[Expr, ...], pattern: frozenset[str]) -> Iterator[Action]:
    """What an action does to a pattern. Where that depends on other variables, it may do anything."""
    assigned = {name: value for name, value in action.assigned.items() if name in pattern}
    if assigned:
        open_ = [name for name, value in assigned.items() if not variables_of(value) <= pattern]
        conditions = tuple(part for part in (*action.conditions, *implied) if of.reads(part) <= pattern)
        for values in product(*(of.system.domains[name].values for name in open_)):
            chosen = {name: Const(value) for name, value in zip(open_, values, strict=True)}
            yield Action(action.transition, conditions, {**assigned, **chosen})


@dataclass(frozen=True, slots=True)
class Moves:
    """What some moves do to a node."""

    fixed: tuple[tuple[int, int], ...]
    computed: tuple[tuple[int, Computed], ...]

    def __bool__(self) -> bool:
        return bool(self.fixed or self.computed)

    def after(self, node: int) -> list[int]:
        found = [node & keep | put for keep, put in self.fixed]
        for keep, worth in self.computed:
            found.append(node & keep | worth[node & worth.part])
        return found


class Freely(Tables):
    """Moves where automatic actions have no priority: some that count, some that do not, and the last few meet targets."""

    def __init__(self, of: Ground, counted: int, targets: int) -> None:
        super().__init__(of)
        self.ahead = Ahead(self, counted, targets)


class Ahead(dict[int, tuple[int, Moves, Moves]]):
    """By the mask that the views leave: which targets are met, the moves that count, and those that do not."""

    def __init__(self, tables: Freely, counted: int, targets: int) -> None:
        super().__init__()
        self._tables = tables
        self._split = counted, len(tables.moves) - targets

    def __missing__(self, mask: int) -> tuple[int, Moves, Moves]:
        tables, (counted, last) = self._tables, self._split
        left = tables.needed(mask)
        if left & tables.allowed:
            met = (left & tables.allowed - 1) >> last
        else:
            met = left = 0
        moves = tables.moves
        self[mask] = met, _chosen(moves[:counted], left), _chosen(moves[counted:last], left)
        return self[mask]


def _chosen(moves: Iterable[Move], left: int) -> Moves:
    chosen = [move for move in moves if left >> move.action & 1]
    return Moves(
        tuple((move.keep, move.put) for move in chosen if move.computed is None),
        tuple((move.keep, move.computed) for move in chosen if move.computed is not None),
    )
