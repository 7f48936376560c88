"""Relaxed reachability: which values each variable could ever take, if values once reached were never lost.

All sets of values together are one integer, a bit for each value of each variable. Conditions are judged over sets, each
part on its own: whether one may hold then depends on which bits are there, and nearly always it is a conjunction of masks
that all have to be hit. The sets only grow, so the fixpoint takes a moment; they hold whatever can happen and more. A goal
that is out of reach even so has no plan (the h1 heuristic of classical planning).
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import reduce
from itertools import product
from operator import or_

from smv_planner.engines.auto.clock import look
from smv_planner.engines.auto.grounding import Ground
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
from smv_planner.model.system import System
from smv_planner.problem import Problem, Relaxed

EXPRESSIONS = 100_000
"""How many expressions may be kept compiled."""

MASKS = 64
"""How many masks one condition may become."""

Sets = int
"""For every variable of the system the values it may have: one bit each, variable by variable in the order of its domain."""

Values = Callable[[Sets], frozenset[Value]]


@dataclass(frozen=True, slots=True)
class Condition:
    """A conjunction. What its parts that read a single variable leave of the sets is `narrow`; this has to hit all of `masks`.

    `others` are parts that are no conjunction of masks.
    """

    narrow: Sets
    masks: tuple[Sets, ...]
    others: tuple[Callable[[Sets], bool], ...]

    def narrowed(self, sets: Sets) -> Sets | None:
        """The sets as far as the condition may hold; None if it cannot."""
        sets &= self.narrow
        for mask in self.masks:
            if not sets & mask:
                return None
        for may_hold in self.others:
            if not may_hold(sets):
                return None
        return sets

    def together(self, other: Condition) -> Condition:
        return Condition(self.narrow & other.narrow, self.masks + other.masks, self.others + other.others)


@dataclass(frozen=True, slots=True)
class Outcome:
    """What an action adds to the sets, if its condition may hold."""

    condition: Condition
    constant: Sets
    computed: tuple[tuple[int, Values], ...]


class Abstraction:
    """Conditions and actions of a grounded system, compiled to judge sets of values. The same for every question."""

    def __init__(self, of: Ground) -> None:
        self.system: System = of.system
        self.index = of.system.index
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
        self._lows = sum(1 << low for low in self._low)
        self._ends = self._lows & ~1 | 1 << width
        self._reads = of.reads
        self._compiled: dict[int, tuple[Expr, Values]] = of.shared.compiled
        self._hit: dict[int, tuple[Expr, tuple[Sets, ...] | None]] = of.shared.hit
        self._held: dict[int, tuple[Expr, Callable[[Sets], bool]]] = of.shared.held
        self.assigned = tuple(action.assigned for action in of.actions)
        self.actions = tuple(
            self._outcome(self.condition([*action.conditions, *keeps]), action.assigned)
            for action, keeps in zip(of.actions, of.keeps, strict=True)
        )
        self.allowed = self.condition(of.clauses)

    def condition(self, parts: Iterable[Expr]) -> Condition:
        look()
        narrow, masks, others = -1, dict[Sets, None](), []
        for part in parts:
            names = self._reads(part)
            hit = self._masks(part)
            if hit is None:
                others.append(self._may_hold(part))
                continue
            for mask in hit:
                if len(names) == 1:
                    (name,) = names
                    field = self._field[self.index[name]]
                    narrow &= ~field | mask
                    mask = field
                masks.setdefault(mask)
        return Condition(narrow, tuple(masks), tuple(others))

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
        names = self._reads(part)
        if len(names) < 2:
            return self._asked(part, wanted)
        match part:
            case Named(_, inner):
                return self._to_hit(inner, wanted)
            case Not(inner):
                return self._to_hit(inner, not wanted)
            case And(parts) | Or(parts):
                hits = [masks for each in parts if (masks := self._to_hit(each, wanted)) is not None]
                if len(hits) < len(parts):
                    return None
                if isinstance(part, And) is wanted:
                    return [mask for masks in hits for mask in masks]
                found: list[Sets] = [0]
                for masks in hits:
                    found = list(dict.fromkeys(one | other for one, other in product(found, masks)))
                    if len(found) > MASKS:
                        return None
                return found
        return None

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

    def _may_hold(self, part: Expr) -> Callable[[Sets], bool]:
        """Whether a predicate may hold that is no conjunction of masks."""
        if id(part) not in self._held:
            self._held[id(part)] = part, self._judged(part, True)
        return self._held[id(part)][1]

    def _judged(self, part: Expr, wanted: bool) -> Callable[[Sets], bool]:
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
            masks = [reduce(or_, masks, 0)]

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
        if len(self._compiled) + len(self._hit) > EXPRESSIONS:
            for known in (self._compiled, self._hit, self._held):
                known.clear()

    def fixpoint(self, start: Iterable[Value], usable: int) -> Sets:
        """What can follow on `start` by the usable actions, and more."""
        sets = sum(bits[value] for bits, value in zip(self._bits, start, strict=True))
        waiting = [action for at, action in enumerate(self.actions) if usable >> at & 1]
        before = 0
        while sets != before:
            before, left = sets, []
            for action in waiting:
                if not action.computed and not action.constant & ~sets:
                    continue  # it has nothing to add any more
                narrowed = action.condition.narrowed(sets)
                if narrowed is None:
                    left.append(action)
                    continue
                sets |= action.constant
                if action.computed:
                    left.append(action)
                    for variable, values in action.computed:
                        sets |= self._mask(variable, values(narrowed))
            waiting = left
        return sets

    def support(self, start: Iterable[Value], usable: int) -> Support:
        """How `fixpoint` comes about: which actions are taken, in order, and which is the first to bring about each value."""
        sets = sum(bits[value] for bits, value in zip(self._bits, start, strict=True))
        begin, taken, first = sets, dict[int, None](), dict[Sets, int]()
        before = 0
        while sets != before:
            before = sets
            for at, action in enumerate(self.actions):
                if usable >> at & 1 and (action.computed or at not in taken):
                    narrowed = action.condition.narrowed(before)
                    if narrowed is None:
                        continue
                    taken.setdefault(at)
                    found = action.constant
                    for variable, values in action.computed:
                        found |= self._mask(variable, values(narrowed))
                    fresh = found & ~sets
                    sets |= found
                    while fresh:
                        first[fresh & -fresh] = at
                        fresh &= fresh - 1
        return Support(self, begin, tuple(sorted(taken)), first)

    def forced(self, condition: Condition) -> Condition:
        """The condition together with what it leaves of single variables where everything allowed holds too."""
        narrow, before = condition.narrow, 0
        masks = dict.fromkeys(condition.masks)
        while narrow != before:
            before = narrow
            for mask in (*condition.masks, *self.allowed.masks):
                left = mask & narrow
                field = self._field[self.variable(left)] if left else 0
                if left and not left & ~field and (field & narrow) & ~left:
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

    def variable(self, bit: Sets) -> int:
        """Which variable a value belongs to."""
        return bisect_right(self._low, bit.bit_length() - 1) - 1

    def same(self, bit: Sets, name: str) -> Sets:
        """The value of another variable that is worth the same; 0 if it has none."""
        at = self.variable(bit)
        value = self._domains[at][(bit >> self._low[at]).bit_length() - 1]
        return self._bits[self.index[name]].get(value, 0)

    def _outcome(self, condition: Condition, assigned: Mapping[str, Expr]) -> Outcome:
        constant, computed = 0, []
        for name, value in assigned.items():
            at = self.index[name]
            if isinstance(value, Const):
                constant |= self._mask(at, [value.value])
            else:
                computed.append((at, self._values(value)))
        return Outcome(condition, constant, tuple(computed))

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
    """Which actions are taken when nothing is lost, and by which each value comes about first."""

    abstraction: Abstraction
    begin: Sets
    taken: tuple[int, ...]
    first: Mapping[Sets, int]

    def changed(self, condition: Condition) -> frozenset[str] | None:
        """The variables that a plan that loses nothing changes until a condition holds; None if it cannot."""
        names = [variable.name for variable in self.abstraction.system.variables]
        known = self.begin
        changed: set[str] = set()
        waiting = self._asked(condition)
        while waiting:
            mask = waiting.pop()
            if mask & known:
                continue
            bit = next((bit for bit in self.first if bit & mask), 0)
            if not bit:
                return None
            known |= bit
            name = names[self.abstraction.variable(bit)]
            changed.add(name)
            at = self.first[bit]
            waiting += self._asked(self.abstraction.actions[at].condition)
            value = self.abstraction.assigned[at].get(name)
            if isinstance(value, Var):
                waiting.append(self.abstraction.same(bit, value.name))
        return frozenset(changed)

    def _asked(self, condition: Condition) -> list[Sets]:
        return [mask & condition.narrow for mask in condition.masks]


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
            return abstraction.condition(conjuncts(predicate)).together(abstraction.allowed).narrowed(sets) is not None
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
    sets = abstraction.fixpoint(problem.initial, of.usable(problem.unusable))
    goals_met = all(may_be_met(Until(goal.until, Atom(goal.predicate)), abstraction, sets) for goal in problem.goals)
    return None if goals_met else abstraction.proof(sets)
