"""How values come about when nothing is lost: relaxed plans, which tell what changes on the way to a condition."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from itertools import product
from typing import TYPE_CHECKING

from smv_planner.engines.auto.conditions import Condition, Sets, each_bit
from smv_planner.engines.auto.grounding import union
from smv_planner.lazy import dataclass
from smv_planner.model.expressions import Var

if TYPE_CHECKING:
    from smv_planner.engines.auto.relaxed import Abstraction

LATEST = 1 << 30
"""More values than come about."""

Link = tuple[str, str]
"""A variable that changes, and one that changes so that it can."""


@dataclass(frozen=True, slots=True)
class Support:
    """The values that there are when nothing is lost, which actions are taken, and by which each value comes about first.

    `first` has for each value also how many came about before it; `takes` is `taken` as a set.
    """

    abstraction: Abstraction
    begin: Sets
    sets: Sets
    taken: tuple[int, ...]
    takes: frozenset[int]
    first: Mapping[Sets, tuple[int, int]]

    def may_hold(self, condition: Condition) -> bool:
        """Whether each value that a condition asks for comes about."""
        return all(mask & self.sets for mask in condition.to_hit())

    def changed(self, condition: Condition, begin: Sets | None = None) -> dict[Link, None] | None:
        """The variables that a plan that loses nothing changes until a condition holds; None if it cannot.

        Each comes with those that change so that it can, or with itself. The plan begins where the question does, or with
        the values of `begin`. What an action needs has to come about before what it brings about. What may come about by
        several variables or actions waits, for one of them may change in any case; else that is taken which asks for least.
        """
        of = self.abstraction
        names, owner, loose = of.names, of.owner, of.loose
        begin = self.begin if begin is None else begin
        known, ranks = 0, dict[Sets, int]()
        changed = dict[Link, None]()
        waiting = [(mask, LATEST, "") for mask in condition.to_hit() if not mask & begin]
        loosely = deque[tuple[Sets, int, str]]()
        while waiting or loosely:
            first = bool(waiting)
            mask, latest, after = waiting.pop() if first else loosely.popleft()
            if first and loose[mask]:
                loosely.append((mask, LATEST, after))
                continue
            ready = mask & known
            if ready and first:
                ready = next((bit for bit in each_bit(ready) if ranks[bit] < latest), 0)
            if ready:
                if after:
                    changed[after, names[owner[ready & -ready]]] = None
                continue
            bit, rank, at = self._brought_about(mask)
            if not bit:
                return None
            if not bit & known and len(of.makers.get(bit, ())) > 1:
                if first:
                    loosely.append((mask, LATEST, after))
                    continue
                at = self._easiest(bit, at, begin | known, begin | of.fields(name for link in changed for name in link))
            name = names[owner[bit]]
            changed[after or name, name] = None
            if bit & known:  # begun elsewhere, it may be late, and is enough all the same
                continue
            known |= bit
            ranks[bit] = rank
            waiting += [(needed, rank, name) for needed in of.needs(at) if not needed & begin]
            value = of.assigned[at].get(name)
            if isinstance(value, Var):
                source = of.same(bit, value.name)
                if not source & begin:
                    waiting.append((source, rank, name))
        return changed

    def _easiest(self, bit: Sets, first: int, met: Sets, touched: Sets) -> int:
        """The action that brings about a value, as `first` does, and asks for least that is not met, of variables not touched."""

        def missing(at: int) -> int:
            return sum((not needed & met) + (not needed & touched) for needed in self.abstraction.needs(at))

        return min((first, *(at for at in self.abstraction.makers[bit] if at in self.takes)), key=missing)

    def linked(self, action: int, names: Iterable[str]) -> Iterator[Link]:
        """What an action changes, with what has to change before, as far as it has one of some names."""
        of = self.abstraction
        asked = union(mask for mask in of.needs(action) if not mask & self.begin)
        changed = [name for name in names if name in of.assigned[action]]
        before = [name for name in names if asked & of.field[name]]
        return product(changed, before)

    def _brought_about(self, mask: Sets) -> tuple[Sets, int, int]:
        """The first of some values to come about, how many did so before, and by which action; none if they never do."""
        reached = mask & self.sets & ~self.begin
        if reached:
            bit = min(each_bit(reached), key=self.first.__getitem__)
            return bit, *self.first[bit]
        for at in self.taken:
            action = self.abstraction.actions[at]
            again = action.constant & mask or self.abstraction.computed(action) & mask & self.sets
            if again:
                return again & -again, LATEST, at
        return 0, 0, 0

    def after(self, condition: Condition, action: int) -> Sets:
        """The values that variables may have when an action is taken while a condition holds."""
        constant = self.abstraction.actions[action].constant
        assigned = self.abstraction.fields(self.abstraction.assigned[action])
        return condition.narrow & ~assigned | constant
