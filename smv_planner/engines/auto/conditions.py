"""Conditions judged over sets: whether one may hold where variables may have any of some values each.

All sets of values together are one integer, a bit for each value of each variable. Each part of a condition is judged on its
own: whether it may hold then depends on which bits are there, and nearly always it is a conjunction of masks that all have
to be hit.
"""

from __future__ import annotations

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
from smv_planner.model.system import System

EXPRESSIONS = 100_000
"""How many expressions may be kept compiled."""

MASKS = 64
"""How many masks one condition may become."""

JUDGED = 500
"""For how many sets is kept whether a condition may hold."""

Sets = int
"""For every variable of the system the values it may have: one bit each, variable by variable in the order of its domain."""

Values = Callable[[Sets], frozenset[Value]]


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


class Loose(dict[Sets, bool]):
    """Which masks have values of several variables."""

    def __init__(self, fields: Sequence[Sets], owner: Mapping[Sets, int]) -> None:
        super().__init__()
        self._fields, self._owner = fields, owner

    def __missing__(self, mask: Sets) -> bool:
        self[mask] = mask != 0 and bool(mask & ~self._fields[self._owner[mask & -mask]])
        return self[mask]


class Conditions:
    """The conditions of a grounded system, compiled to judge sets of values. The same for every question."""

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
        self._dealt: dict[int, tuple[Expr, tuple[Sets, ...]]] = {}
        self.owner = {bit: at for at, bits in enumerate(self._bits) for bit in bits.values()}
        self.loose = Loose(self._field, self.owner)
        self.allowed = self.condition(of.clauses)

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

    def same(self, bit: Sets, name: str) -> Sets:
        """The value of another variable that is worth the same; 0 if it has none."""
        at = self.owner[bit]
        value = self._domains[at][(bit >> self._low[at]).bit_length() - 1]
        return self._bits[self.index[name]].get(value, 0)

    def _mask(self, at: int, values: Iterable[Value]) -> Sets:
        """The values that lie in a variable's domain."""
        bits = self._bits[at]
        mask = 0
        for value in values:
            mask |= bits.get(value, 0)
        return mask

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
