"""How many steps a small part of a system needs, by searching it alone, whatever all other variables are.

Everything that is left out makes steps possible, never impossible; so no distance is too high (pattern databases: Culberson
and Schaeffer 1998). Where an action changes several parts, its steps count in one of them and are free in the others, so
that the distances of all parts may be added.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
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
        self.width = of.packing.width
        self.targets = len(targets)

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
        self.following: dict[int, tuple[int, ...]] = {}
        self.beside: dict[int, tuple[int, ...]] = {}
        self.met: dict[int, tuple[tuple[int, int, int], ...]] = {}
        """By state the targets that are met by an action, what follows on that, and how much the action counts."""

    def explore(self, start: int) -> bool:
        """Add what can follow on a state; False if there are too many."""
        try:
            self._explore(start)
        except Over:  # what is half explored would seem to lead nowhere
            self.following.clear()
            self.beside.clear()
            self.met.clear()
            raise
        return len(self.following) <= STATES

    def _explore(self, start: int) -> None:
        following, ahead = self.following, self._tables.ahead
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
            met, counted, free = ahead[mask]
            found = counted.after(node)
            following[node] = tuple(found)  # unlike a list, soon nothing to the garbage collector
            waiting += found
            if free:
                found = free.after(node)
                self.beside[node] = tuple(found)
                waiting += found
            if met:
                self.met[node] = tuple(self._meet(node, met))
                waiting += [after for _, after, _ in self.met[node]]

    def stuck(self, node: int) -> bool:
        """Whether nothing follows on an explored state: above all on one that is not allowed."""
        return not (self.following[node] or node in self.beside or node in self.met)

    def _meet(self, node: int, met: int) -> Iterator[tuple[int, int, int]]:
        """Which targets are met by what follows on a state."""
        moves = self._tables.moves[-len(self._lasts) :]
        found: dict[tuple[int, int, int], int] = {}
        for number, (bit, at, cost) in enumerate(self._lasts):
            if met >> number & 1:
                key = moves[number].after(node), at, cost
                found[key] = found.get(key, 0) | bit
        for (after, _, cost), bits in found.items():
            yield bits, after, cost


class Distances(dict[int, int]):
    """How many steps that count are needed at least until each of a pattern's targets has been met once.

    Looked up by the bits of the pattern, and above them a bit for each target that is still to be met. The step by which the
    last of them is met does not count.
    """

    def __init__(self, pattern: Pattern, order: Order) -> None:
        super().__init__()
        self.part = pattern.part
        self._pattern = pattern
        self._order = order

    def about(self, still: int) -> object:
        """What the distances to some targets depend on."""
        return id(self._pattern), tuple(before & still for at, before in enumerate(self._order) if still >> at & 1)

    def __missing__(self, key: int) -> int:
        if not self._pattern.explore(key & self.part):
            return 0
        if self._pattern.stuck(key & self.part):  # others are as far as before
            self[key] = NEVER
        else:
            self._measure()
        return self[key]

    def _measure(self) -> None:
        of = self._pattern
        before, beside = _backwards(of.following), _backwards(of.beside)
        for still in range(1, 1 << of.targets):  # a set of targets comes after the smaller ones in it
            above = still << of.width
            self.update(dict.fromkeys([node | above for node in of.following], NEVER))
            self._spread(above, self._nearest(still), before, beside)

    def _nearest(self, still: int) -> dict[int, list[int]]:
        """Where one of the targets is met, by how many steps all others then take."""
        nearest: dict[int, list[int]] = {}
        for node, met in self._pattern.met.items():
            for bits, after, cost in met:
                now = self._in_turn(bits & still, still)
                if now:
                    left = still & ~now
                    nearest.setdefault(cost + self[after | left << self._pattern.width] if left else 0, []).append(node)
        return {steps: nodes for steps, nodes in nearest.items() if steps < NEVER}

    def _in_turn(self, bits: int, still: int) -> int:
        """Of targets that are met at once those whose turn it is."""
        for number, before in enumerate(self._order):
            if bits >> number & 1 and before & still & ~bits:
                return self._in_turn(bits ^ 1 << number, still)
        return bits

    def _spread(
        self, above: int, nearest: dict[int, list[int]], before: Mapping[int, list[int]], beside: Mapping[int, list[int]]
    ) -> None:
        """Set distances from what is near to what is farther away."""
        distance = 0
        while nearest:
            waiting = nearest.pop(distance, [])
            distance += 1
            farther = nearest.get(distance, [])
            for node in waiting:  # what is beside a node joins them
                if self[node | above] >= distance:
                    self[node | above] = distance - 1
                    farther += before.get(node, ())
                    waiting += beside.get(node, ())
            if farther:
                nearest[distance] = farther


def _backwards(following: Mapping[int, Iterable[int]]) -> dict[int, list[int]]:
    before: dict[int, list[int]] = {}
    for node, found in following.items():
        for after in found:
            before.setdefault(after, []).append(node)
    return before


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
    """Moves where automatic actions have no priority: some that count, and some that do not.

    The last few actions do nothing: if one is enabled, a target is met.
    """

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
