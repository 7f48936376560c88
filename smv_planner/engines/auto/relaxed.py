"""Relaxed reachability: which values each variable could ever take, if values once reached were never lost.

All sets of values together are one integer, a bit for each value of each variable. Conditions are judged over sets, each
part on its own: whether one may hold then depends on which bits are there, and nearly always it is a conjunction of masks
that all have to be hit. The sets only grow, so the fixpoint takes a moment; they hold whatever can happen and more. A goal
that is out of reach even so has no plan (the h1 heuristic of classical planning).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import product
from math import prod

from smv_planner.clock import look
from smv_planner.engines.auto.grounding import DEALT_OUT, Ground, alternatives, union
from smv_planner.lazy import dataclass
from smv_planner.model.domains import Value
from smv_planner.model.expressions import (
    And,
    Const,
    Equal,
    Expr,
    If,
    Less,
    Minus,
    Named,
    Not,
    Or,
    Plus,
    Var,
    conjuncts,
    disjunction,
    equality,
    meaning,
)
from smv_planner.model.ltl import Atom, Both, Either, Formula, Next, Release, Until
from smv_planner.model.system import State, System
from smv_planner.problem import Problem, Relaxed

EXPRESSIONS = 100_000
"""How many expressions may be kept compiled."""

LATEST = 1 << 30
"""More values than come about."""

MASKS = 64
"""How many masks one condition may become."""

JUDGED = 500
"""For how many sets is kept whether a condition may hold."""

Sets = int
"""For every variable of the system the values it may have: one bit each, variable by variable in the order of its domain."""

Values = Callable[[Sets], frozenset[Value]]

Link = tuple[str, str]
"""A variable that changes, and one that changes so that it can."""


class Others(dict[Sets, bool]):
    """Whether what is no conjunction of masks may hold, by the values in `part`, all that it reads."""

    def __init__(self, part: Sets, judged: tuple[Callable[[Sets], bool], ...]) -> None:
        super().__init__()
        self.part = part
        self._judged = judged

    def __missing__(self, sets: Sets) -> bool:
        if len(self) == JUDGED:
            self.clear()
        self[sets] = found = all(may_hold(sets) for may_hold in self._judged)
        return found

    def together(self, other: Others) -> Others:
        return Others(self.part | other.part, self._judged + other._judged)


@dataclass(frozen=True, slots=True)
class Condition:
    """A conjunction. What its parts that read a single variable leave of the sets is `narrow`; this has to hit all of `masks`.

    `others` are parts that are no conjunction of masks.
    """

    narrow: Sets
    masks: tuple[Sets, ...]
    others: Others

    def narrowed(self, sets: Sets) -> Sets | None:
        """The sets as far as the condition may hold; None if it cannot."""
        sets &= self.narrow
        for mask in self.masks:
            if not sets & mask:
                return None
        return sets if self.others[sets & self.others.part] else None

    def to_hit(self) -> tuple[Sets, ...]:
        """What has to be hit, of each mask as much as the condition leaves."""
        return tuple(mask & self.narrow for mask in self.masks)

    def together(self, other: Condition) -> Condition:
        return Condition(self.narrow & other.narrow, self.masks + other.masks, self.others.together(other.others))


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


class Loose(dict[Sets, bool]):
    """Which masks have values of several variables."""

    def __init__(self, fields: Sequence[Sets], owner: Mapping[Sets, int]) -> None:
        super().__init__()
        self._fields, self._owner = fields, owner

    def __missing__(self, mask: Sets) -> bool:
        self[mask] = mask != 0 and bool(mask & ~self._fields[self._owner[mask & -mask]])
        return self[mask]


class Abstraction:
    """Conditions and actions of a grounded system, compiled to judge sets of values. The same for every question."""

    def __init__(self, of: Ground) -> None:
        self.system: System = of.system
        self.index = of.system.index
        self.names = tuple(variable.name for variable in of.system.variables)
        self._domains = tuple(variable.domain.values for variable in of.system.variables)
        self._low: list[int] = []
        self._field: list[Sets] = []
        self._bits: list[dict[Value, Sets]] = []
        width = 0
        for values in self._domains:
            self._low.append(width)
            self._field.append(((1 << len(values)) - 1) << width)
            self._bits.append({value: 1 << width + at for at, value in enumerate(values)})
            width += len(values)
        self.field = dict(zip(self.names, self._field, strict=True))
        self._lows = sum(1 << low for low in self._low)
        self._ends = self._lows & ~1 | 1 << width
        self._of = of
        self._reads = of.reads
        self._compiled: dict[int, tuple[Expr, Values]] = of.shared.compiled
        self._hit: dict[int, tuple[Expr, tuple[Sets, ...] | None]] = of.shared.hit
        self._held: dict[tuple[int, bool], tuple[Expr, Callable[[Sets], bool]]] = of.shared.held
        self._parts: dict[tuple[int, bool], tuple[Expr, list[Sets] | None]] = {}
        self._asked_of: dict[int, tuple[Expr, Condition]] = {}
        self._needs: dict[int, tuple[Sets, ...]] = {}
        self._dealt: dict[int, tuple[Expr, tuple[Sets, ...]]] = {}
        self.assigned = tuple(action.assigned for action in of.actions)
        self._hits: dict[Sets, Hits] = {}  # by what has to be hit
        self.actions = tuple(
            self._outcome(number, self.condition([*action.conditions, *keeps]), action.assigned)
            for number, (action, keeps) in enumerate(zip(of.actions, of.keeps, strict=True))
        )
        self.allowed = self.condition(of.clauses)
        self._parts.clear()
        self._by_bit = {1 << action.number: action for action in self.actions}
        self._hit_by = self._woken((1 << width) - 1)
        self._last: tuple[State, int, Support] | None = None
        self.owner = {bit: at for at, bits in enumerate(self._bits) for bit in bits.values()}
        self.loose = Loose(self._field, self.owner)
        self.makers: dict[Sets, list[int]] = {}
        for number, action in enumerate(self.actions):
            for bit in each_bit(action.constant):
                self.makers.setdefault(bit, []).append(number)

    def condition(self, parts: Iterable[Expr]) -> Condition:
        look()
        narrow, masks, judged, read = -1, dict[Sets, None](), [], set[str]()
        for part in parts:
            names = self._reads(part)
            hit = self._masks(part)
            if hit is None:
                judged.append(self._judged(part, True))
                read |= names
                continue
            for mask in hit:
                if len(names) == 1:
                    (name,) = names
                    field = self._field[self.index[name]]
                    narrow &= ~field | mask
                    mask = field
                masks.setdefault(mask)
        return Condition(narrow, tuple(masks), Others(self.fields(read), tuple(judged)))

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

    def _dealt_out(self, part: Expr) -> tuple[Sets, ...]:
        """Masks that have to be hit for a predicate to hold, also where one of its alternatives is a conjunction."""
        if id(part) not in self._dealt:
            parts = [tuple(conjuncts(each)) for each in alternatives(part)]
            if 1 != prod(map(len, parts)) <= DEALT_OUT:
                hits = ([self._to_hit(each, True) for each in some] for some in parts)
                found = (self._one_of(chosen) for chosen in product(*hits))
                masks = tuple(mask for hit in found if hit is not None for mask in self._in_doubt(hit))
            else:
                masks = self._masks(part) or ()
            self._dealt[id(part)] = part, masks
        return self._dealt[id(part)][1]

    def asked(self, predicate: Expr) -> Condition:
        """What a predicate asks of an allowed state."""
        if id(predicate) not in self._asked_of:
            self._asked_of[id(predicate)] = predicate, self.condition(conjuncts(predicate)).together(self.allowed)
        return self._asked_of[id(predicate)][1]

    def _masks(self, part: Expr) -> tuple[Sets, ...] | None:
        """The masks that all have to be hit for a predicate to hold; None if it is not like that."""
        if id(part) not in self._hit:
            masks = self._to_hit(part, True)
            self._hit[id(part)] = part, None if masks is None else tuple(self._in_doubt(masks))
        return self._hit[id(part)][1]

    def _in_doubt(self, masks: list[Sets]) -> list[Sets]:
        """Masks without those that are hit whenever others are, or in any case: every variable has some value."""
        left: list[Sets] = []
        for mask in sorted(masks, key=int.bit_count):
            # Adding one to every variable's values carries out of those that are all there.
            full = ((mask + self._lows) ^ mask ^ self._lows) & self._ends
            if not full and all(fewer & ~mask for fewer in left):
                left.append(mask)
        return left

    def _to_hit(self, part: Expr, wanted: bool) -> list[Sets] | None:
        """What has to be hit for a part of a predicate to be as wanted. Predicates have many parts in common."""
        key = id(part), wanted
        if key not in self._parts:
            self._parts[key] = part, self._asked(part, wanted) if len(self._reads(part)) < 2 else self._combined(part, wanted)
        return self._parts[key][1]

    def _combined(self, part: Expr, wanted: bool) -> list[Sets] | None:
        match part:
            case Named(_, inner):
                return self._to_hit(inner, wanted)
            case Not(inner):
                return self._to_hit(inner, not wanted)
            case And(parts) | Or(parts):
                hits = []
                for each in parts:
                    masks = self._to_hit(each, wanted)
                    if masks is None:
                        return None
                    hits.append(masks)
                if isinstance(part, And) is wanted:
                    return [mask for masks in hits for mask in masks]
                return self._one_of(hits)
        return None

    def _one_of(self, hits: Iterable[list[Sets] | None]) -> list[Sets] | None:
        """What has to be hit where all of one of these have to; None if that is too much, or one is not like that."""
        found: list[Sets] = [0]
        for masks in hits:
            if masks is None:
                return None
            found = list(dict.fromkeys(one | other for one, other in product(found, masks)))
            if len(found) > MASKS:
                return None
        return found

    def _asked(self, part: Expr, wanted: bool) -> list[Sets]:
        """What a predicate on one variable asks for: nothing, if it always is as wanted."""
        match part:
            case Var(name):
                return [self._bits[self.index[name]][wanted]]
            case Equal(Var(name), Const(value)):
                bit = self._bits[self.index[name]].get(value, 0)
                return [bit if wanted else self._field[self.index[name]] & ~bit]
            case Not(inner):
                return self._asked(inner, not wanted)
        names = self._reads(part)
        holds = meaning(part, dict.fromkeys(names, 0))
        for name in names:
            return [sum(bit for value, bit in self._bits[self.index[name]].items() if holds((value,)) is wanted)]
        return [] if holds(()) is wanted else [0]

    def _judged(self, part: Expr, wanted: bool) -> Callable[[Sets], bool]:
        """Whether a predicate may be as wanted, where that is no conjunction of masks."""
        key = id(part), wanted
        if key not in self._held:
            self._held[key] = part, self._judge(part, wanted)
        return self._held[key][1]

    def _judge(self, part: Expr, wanted: bool) -> Callable[[Sets], bool]:
        hit = self._to_hit(part, wanted)
        if hit is not None:
            masks = self._in_doubt(hit)
            return lambda sets: all(sets & mask for mask in masks)
        match part:
            case Named(_, inner):
                return self._judged(inner, wanted)
            case Not(inner):
                return self._judged(inner, not wanted)
            case Equal(Var(one), Var(other)) if self._domains[self.index[one]] == self._domains[self.index[other]]:
                first, second = self._low[self.index[one]], self._low[self.index[other]]
                full = self._field[self.index[one]] >> first
                if wanted:
                    return lambda sets: bool(sets >> first & sets >> second & full)
                return lambda sets: ((sets >> first | sets >> second) & full).bit_count() > 1
            case And(parts) | Or(parts):
                return self._connected(parts, wanted, every=isinstance(part, And) is wanted)
        values = self._values(part)
        return lambda sets: wanted in values(sets)

    def _connected(self, parts: Iterable[Expr], wanted: bool, every: bool) -> Callable[[Sets], bool]:
        """`every` part has to be as wanted, or one of them. What a mask decides is looked at first."""
        masks, judged = [], []
        for part in parts:
            hit = self._to_hit(part, wanted)
            if hit is not None and (every or len(hit) == 1):
                masks += hit
            else:
                judged.append(self._judged(part, wanted))
        if not every:
            masks = [union(masks)]

        def may_hold(sets: Sets) -> bool:
            for mask in masks:
                if bool(sets & mask) is not every:
                    return not every
            for part in judged:
                if part(sets) is not every:
                    return not every
            return every

        return may_hold

    def trim(self) -> None:
        """Forget what was compiled for earlier questions, if that has become much; what belongs to the actions stays."""
        if len(self._compiled) + len(self._hit) + len(self._parts) + len(self._asked_of) > EXPRESSIONS:
            for known in (self._compiled, self._hit, self._held, self._parts, self._asked_of):
                known.clear()

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

    def forced(self, condition: Condition, allowed: Condition) -> Condition | None:
        """The condition together with what it leaves of single variables where `allowed` holds too; None if nothing is left."""
        narrow, before = condition.narrow & allowed.narrow, 0
        masks = dict.fromkeys(condition.masks)
        while narrow != before:
            before = narrow
            for mask in (*condition.masks, *allowed.masks):
                left = mask & narrow
                if not left:
                    return None
                field = self._field[self.owner[left & -left]]
                if not left & ~field and (field & narrow) & ~left:
                    narrow &= ~field | left
                    masks.setdefault(field)
        return Condition(narrow, tuple(masks), condition.others)

    def written(self, condition: Condition) -> Iterator[Expr]:
        """What a condition leaves of single variables, as expressions."""
        for variable, low, field in zip(self.system.variables, self._low, self._field, strict=True):
            if field & ~condition.narrow:
                values = variable.domain.values
                yield disjunction(
                    equality(Var(variable.name), Const(value))
                    for at, value in enumerate(values)
                    if condition.narrow >> low + at & 1
                )

    def fields(self, names: Iterable[str]) -> Sets:
        """All values of some variables."""
        return union(self.field[name] for name in names)

    def computed(self, action: Outcome) -> Sets:
        """All values of the variables that an action computes."""
        return union(self._field[at] for at, _ in action.computed)

    def same(self, bit: Sets, name: str) -> Sets:
        """The value of another variable that is worth the same; 0 if it has none."""
        at = self.owner[bit]
        value = self._domains[at][(bit >> self._low[at]).bit_length() - 1]
        return self._bits[self.index[name]].get(value, 0)

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

    def _mask(self, at: int, values: Iterable[Value]) -> Sets:
        """The values that lie in a variable's domain."""
        bits = self._bits[at]
        mask = 0
        for value in values:
            mask |= bits.get(value, 0)
        return mask

    def proof(self, sets: Sets) -> Relaxed:
        return Relaxed(tuple(self._decoded(at, sets) for at in range(len(self._domains))))

    def _decoded(self, at: int, sets: Sets) -> tuple[Value, ...]:
        return tuple(value for value, bit in self._bits[at].items() if sets & bit)

    def _values(self, expr: Expr) -> Values:
        """What an expression may be worth."""
        if id(expr) not in self._compiled:
            self._compiled[id(expr)] = expr, self._compile(expr)
        return self._compiled[id(expr)][1]

    def _compile(self, expr: Expr) -> Values:
        names = self._reads(expr)
        if len(names) <= 1:
            return self._single(expr, next(iter(names), None))
        match expr:
            case Named(_, part):
                return self._values(part)
            case Not(part):
                inner = self._values(part)
                return lambda sets: _NEGATED[inner(sets)]
            case And(parts) | Or(parts):
                return _connective([self._values(part) for part in parts], neutral=isinstance(expr, And))
            case Equal(left, right):
                a, b = self._values(left), self._values(right)
                return lambda sets: _equal(a(sets), b(sets))
            case Less(left, right):
                a, b = self._values(left), self._values(right)
                return lambda sets: _less(a(sets), b(sets))
            case Plus(left, right) | Minus(left, right):
                a, b = self._values(left), self._values(right)
                sign = 1 if isinstance(expr, Plus) else -1
                return lambda sets: frozenset(int(x) + sign * int(y) for x in a(sets) for y in b(sets))
            case If(condition, then, otherwise):
                c, a, b = self._values(condition), self._values(then), self._values(otherwise)
                none: frozenset[Value] = frozenset()
                return lambda sets: (a(sets) if True in c(sets) else none) | (b(sets) if False in c(sets) else none)
        raise AssertionError(expr)

    def _single(self, expr: Expr, name: str | None) -> Values:
        if name is None:
            always = frozenset([meaning(expr, {})(())])
            return lambda sets: always
        at, worth = self.index[name], meaning(expr, {name: 0})
        field = self._field[at]
        known: dict[Sets, frozenset[Value]] = {}

        def values(sets: Sets) -> frozenset[Value]:
            mask = sets & field
            if mask not in known:
                known[mask] = frozenset(worth((value,)) for value in self._decoded(at, mask))
            return known[mask]

        return values


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


def each_bit(mask: int) -> Iterator[int]:
    while mask:
        bit = mask & -mask
        yield bit
        mask ^= bit


_BOTH: frozenset[Value] = frozenset([False, True])
_NO: frozenset[Value] = frozenset([False])
_YES: frozenset[Value] = frozenset([True])
_NEGATED: dict[frozenset[Value], frozenset[Value]] = {_BOTH: _BOTH, _NO: _YES, _YES: _NO}


def _connective(parts: list[Values], neutral: bool) -> Values:
    """`and` (neutral: true) or `or` (neutral: false) of parts that are judged each on its own."""

    def values(sets: Sets) -> frozenset[Value]:
        result = _YES if neutral else _NO
        for part in parts:
            found = part(sets)
            if neutral not in found:
                return found
            if len(found) == 2:
                result = _BOTH
        return result

    return values


def _equal(left: frozenset[Value], right: frozenset[Value]) -> frozenset[Value]:
    if left.isdisjoint(right):
        return _NO
    return _YES if len(left) == len(right) == 1 else _BOTH


def _less(left: frozenset[Value], right: frozenset[Value]) -> frozenset[Value]:
    found: list[Value] = []
    if any(x < y for x in left for y in right):  # type: ignore[operator]
        found.append(True)
    if any(not x < y for x in left for y in right):  # type: ignore[operator]
        found.append(False)
    return frozenset(found)


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
