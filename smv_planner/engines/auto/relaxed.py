"""Relaxed reachability: which values each variable could ever take, if values once reached were never lost.

The sets of values (`conditions`) only grow, so the fixpoint takes a moment; they hold whatever can happen and more. A goal that
is out of reach even so has no plan (the h1 heuristic of classical planning).
"""

from __future__ import annotations

from collections.abc import Mapping

from smv_planner.clock import look
from smv_planner.engines.auto.conditions import Condition, Conditions, Sets, Values, each_bit
from smv_planner.engines.auto.grounding import Ground, union
from smv_planner.engines.auto.support import Support
from smv_planner.lazy import dataclass
from smv_planner.model.expressions import Const, Expr
from smv_planner.model.ltl import Atom, Both, Either, Formula, Next, Release, Until
from smv_planner.model.system import State
from smv_planner.problem import Problem, Relaxed

Hits = int
"""Some of the masks that any action's condition asks for, one bit each."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What an action adds to the sets, if its condition may hold, of which the masks are `asks` in short."""

    number: int
    condition: Condition
    asks: Hits
    constant: Sets
    computed: tuple[tuple[int, Values], ...]


class Abstraction(Conditions):
    """A grounded system as sets of values see it: what actions add to them, and when. The same for every question."""

    def __init__(self, of: Ground) -> None:
        super().__init__(of)
        self._needs: dict[int, tuple[Sets, ...]] = {}
        self.assigned = tuple(action.assigned for action in of.actions)
        self._hits: dict[Sets, Hits] = {}  # by what has to be hit
        self.actions = tuple(
            self._outcome(number, self.condition([*action.conditions, *keeps]), action.assigned)
            for number, (action, keeps) in enumerate(zip(of.actions, of.keeps, strict=True))
        )
        self._parts.clear()
        self._by_bit = {1 << action.number: action for action in self.actions}
        self._hit_by = self._woken(union(self._field))
        self._last: tuple[State, int, Support] | None = None
        self.makers: dict[Sets, list[int]] = {}
        for number, action in enumerate(self.actions):
            for bit in each_bit(action.constant):
                self.makers.setdefault(bit, []).append(number)

    def needs(self, at: int) -> tuple[Sets, ...]:
        """What has to be hit for an action, as closely as it can be said."""
        if at not in self._needs:
            self._needs[at] = self.closely(at).to_hit()
        return self._needs[at]

    def closely(self, at: int) -> Condition:
        """What an action asks for, as closely as it can be said: whatever is a conjunction is dealt out."""
        look()
        narrow, masks = -1, dict[Sets, None]()
        for part in (*self._of.actions[at].conditions, *self._of.keeps[at]):
            for mask in self._dealt_out(part):
                if mask and not self.loose[mask]:
                    field = self._field[self.owner[mask & -mask]]
                    narrow &= ~field | mask
                    mask = field
                masks.setdefault(mask)
        return Condition(narrow, tuple(masks), self.actions[at].condition.others)

    def support(self, start: State, usable: int) -> Support:
        """What can follow on `start` by the usable actions, and more, and how that comes about. The last answer is kept."""
        if self._last is None or self._last[:2] != (start, usable):
            self._last = start, usable, self._support(start, usable)
        return self._last[2]

    def _support(self, start: State, usable: int) -> Support:
        begin = hit = 0
        for bits, value in zip(self._bits, start, strict=True):
            bit = bits[value]
            begin |= bit
            hit |= self._hit_by[bit][0]
        sets, missed = begin, (1 << len(self._hits)) - 1 & ~hit
        taken, first = dict[int, None](), dict[Sets, tuple[int, int]]()
        waiting = woken = usable
        while woken:
            before, again = sets, 0
            while woken:
                one = woken & -woken
                woken ^= one
                action = self._by_bit[one]
                if action.asks & missed:
                    continue
                condition = action.condition
                if not condition.others[before & condition.narrow & condition.others.part]:
                    again |= one
                    continue
                taken[action.number] = None
                found = action.constant
                if action.computed:
                    again |= one
                    for variable, values in action.computed:
                        found |= self._mask(variable, values(before & condition.narrow))
                else:
                    waiting ^= one
                fresh = found & ~sets
                sets |= fresh
                while fresh:
                    bit = fresh & -fresh
                    fresh ^= bit
                    first[bit] = len(first), action.number
            new = sets ^ before
            if new:
                woken = again
                while new:
                    bit = new & -new
                    new ^= bit
                    hits, actions = self._hit_by[bit]
                    missed &= ~hits
                    woken |= actions
                woken &= waiting
        return Support(self, begin, sets, tuple(sorted(taken)), frozenset(taken), first)

    def _woken(self, facts: Sets) -> dict[Sets, tuple[Hits, int]]:
        """For each value what it hits, and which actions ask for some of that."""
        asking = dict.fromkeys(self._hits.values(), 0)
        for at, action in enumerate(self.actions):
            for hit in each_bit(action.asks):
                asking[hit] |= 1 << at
        found = dict.fromkeys(each_bit(facts), (0, 0))
        for mask, hit in self._hits.items():
            for bit in each_bit(mask):
                hits, actions = found[bit]
                found[bit] = hits | hit, actions | asking[hit]
        return found

    def computed(self, action: Outcome) -> Sets:
        """All values of the variables that an action computes."""
        return union(self._field[at] for at, _ in action.computed)

    def _outcome(self, number: int, condition: Condition, assigned: Mapping[str, Expr]) -> Outcome:
        constant, computed = 0, []
        for name, value in assigned.items():
            at = self.index[name]
            if isinstance(value, Const):
                constant |= self._mask(at, [value.value])
            else:
                computed.append((at, self._values(value)))
        asks = union(self._hits.setdefault(mask, 1 << len(self._hits)) for mask in condition.to_hit())
        return Outcome(number, condition, asks, constant, tuple(computed))

    def proof(self, sets: Sets) -> Relaxed:
        return Relaxed(tuple(self._decoded(at, sets) for at in range(len(self._domains))))


def may_be_met(formula: Formula, abstraction: Abstraction, sets: Sets) -> bool:
    """Whether a run inside `sets` might satisfy the formula at some time, each of its parts judged on its own."""
    match formula:
        case Atom(predicate):
            return abstraction.asked(predicate).narrowed(sets) is not None
        case Next(part):
            return may_be_met(part, abstraction, sets)
        case Both(left, right):
            return all(may_be_met(part, abstraction, sets) for part in (left, right))
        case Either(left, right):
            return any(may_be_met(part, abstraction, sets) for part in (left, right))
        case Until(_, right) | Release(_, right):
            return may_be_met(right, abstraction, sets)


def out_of_reach(abstraction: Abstraction, of: Ground, problem: Problem) -> Relaxed | None:
    """Why no goal can be met even when no value is ever lost; None if that does not show it."""
    sets = abstraction.support(problem.initial, of.usable(problem.unusable)).sets
    goals_met = all(may_be_met(Until(goal.until, Atom(goal.predicate)), abstraction, sets) for goal in problem.goals)
    return None if goals_met else abstraction.proof(sets)
