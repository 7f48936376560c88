"""Things that may stand for each other: bolts of which any may come next. Then one order of them is as good as all.

A thing is a variable, with a value of other variables that speak of it (a bolt, and the pose above it). Two things are
interchangeable if swapping both everywhere turns actions into actions, what is allowed into what is allowed, and goals
into themselves; where the order of declaration decides, it must not matter. A search may then look at one state of all
that differ by swaps only. Candidates are guessed from how actions are written, and tried before they are believed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property
from itertools import combinations

from smv_planner.clock import look
from smv_planner.engines.auto.grounding import Action, Ground, Packing, union
from smv_planner.engines.sat import Predicates
from smv_planner.lazy import dataclass
from smv_planner.model.domains import Value
from smv_planner.model.expressions import And, Const, Equal, Expr, Named, Or, Var, conjuncts, nodes, parts_of
from smv_planner.model.ltl import atoms
from smv_planner.problem import Problem

QUESTIONS = 50
"""For how many sets of unusable transitions the things that are interchangeable are kept."""

EXPRESSIONS = 100_000
"""Of how many expressions is kept what they mention."""

Form = int
"""A number for each way to write an expression, up to the order of what may come in any order."""


@dataclass(frozen=True, slots=True)
class Thing:
    """A variable, and which value of each of some others speaks of it."""

    name: str
    values: tuple[tuple[str, Value], ...]


Mention = str | tuple[str] | tuple[str, Value]
"""A variable; one of which the value matters; or one value of it, that it is compared with or gets."""


@dataclass(frozen=True, slots=True)
class Swap:
    """Which names and values it turns into which; what has none of the mentions in `touched` stays as it is."""

    names: Mapping[str, str]
    values: Mapping[str, Mapping[Value, Value]]
    touched: frozenset[Mention]

    @classmethod
    def of(cls, one: Thing, other: Thing) -> Swap:
        pairs = zip(one.values, other.values, strict=True)
        values = {name: {a: b, b: a} for (name, a), (_, b) in pairs}
        touched: list[Mention] = [one.name, other.name, *one.values, *other.values, *((name,) for name in values)]
        return cls({one.name: other.name, other.name: one.name}, values, frozenset(touched))


class Unclear(Exception):
    """It cannot be said what an expression becomes by a swap."""


class Symmetries:
    """Which things of a grounded system are interchangeable."""

    def __init__(self, of: Ground) -> None:
        self._of = of
        self._numbers: dict[object, Form] = {}
        self._plain: dict[int, tuple[Expr, Form]] = {}
        self._mentioned: dict[int, tuple[Expr, frozenset[Mention]]] = {}
        self._alike = self._copies()
        self._where: dict[Form, int] = {}
        for at, action in enumerate(of.actions):
            look()
            form = self._action(action, NO_SWAP)
            self._where[form] = self._where.get(form, 0) | 1 << at
        self._clauses = {self._form(clause, NO_SWAP) for clause in of.clauses}
        self._used = [self._mentions_of(action) for action in of.actions]
        self._apart: dict[tuple[int, int], bool] = {}
        self._moves: dict[tuple[Thing, Thing], dict[int, int] | None] = {}
        self._groups = [
            group
            for things in self._candidates()
            for group in split(things, lambda one, other: self._moved(one, other) is not None)
        ]
        self._usable: dict[int, list[tuple[Thing, ...]]] = {}

    def fold(self, problem: Problem) -> Fold | None:
        """What makes one state of all that differ by swaps that change nothing about a question; None if there are none."""
        if len(self._mentioned) > EXPRESSIONS:
            self._mentioned.clear()
            self._plain.clear()
        usable = self._of.usable(problem.unusable)
        if usable not in self._usable:
            if len(self._usable) == QUESTIONS:
                self._usable.clear()
            self._usable[usable] = [
                group for things in self._groups for group in split(things, lambda one, other: self._closed(usable, one, other))
            ]
        asked = [predicate for goal in problem.goals for predicate in (goal.predicate, *atoms(goal.until))]
        groups = [
            group
            for things in self._usable[usable]
            for group in split(things, lambda one, other: self._same(asked, Swap.of(one, other)))
        ]
        return Fold(self._of.packing, groups) if groups else None

    def _same(self, predicates: Iterable[Expr], swap: Swap) -> bool:
        concerned = [predicate for predicate in predicates if not swap.touched.isdisjoint(self._mentions(predicate))]
        try:
            return all(self._all(predicate, swap) == self._all(predicate, NO_SWAP) for predicate in concerned)
        except Unclear:
            return False

    def _all(self, predicate: Expr, swap: Swap) -> frozenset[Form]:
        return frozenset(self._form(part, swap) for part in conjuncts(predicate))

    def _closed(self, usable: int, one: Thing, other: Thing) -> bool:
        """Whether a swap turns usable actions into usable ones."""
        moved = self._moved(one, other)
        return moved is not None and all(usable & images for at, images in moved.items() if usable >> at & 1)

    def _moved(self, one: Thing, other: Thing) -> dict[int, int] | None:
        """For an action those that a swap turns it into, all the same; None if the swap changes the system or what is allowed."""
        if (one, other) not in self._moves:
            try:
                self._moves[one, other] = self._kept(Swap.of(one, other))
            except Unclear:
                self._moves[one, other] = None
        return self._moves[one, other]

    def _kept(self, swap: Swap) -> dict[int, int] | None:
        moved = {}
        look()
        for at, action in enumerate(self._of.actions):
            if not swap.touched.isdisjoint(self._used[at]):
                images = self._where.get(self._action(action, swap), 0)
                if not images:
                    return None
                moved[at] = images
        for clause in self._of.clauses:
            if not swap.touched.isdisjoint(self._mentions(clause)) and self._form(clause, swap) not in self._clauses:
                return None
        automatic = [at for at in range(len(self._of.actions)) if self._of.automatic >> at & 1]
        in_order = all(
            moved.get(one, 1 << one).bit_length() < (moved.get(other, 1 << other) & -moved.get(other, 1 << other)).bit_length()
            or self._never_both(one, other)
            for one, other in combinations(automatic, 2)
            if one in moved or other in moved
        )
        return moved if in_order else None

    def _never_both(self, one: int, other: int) -> bool:
        """Whether no allowed state enables two actions."""
        if (one, other) not in self._apart:
            conditions = (*self._of.actions[one].conditions, *self._of.actions[other].conditions)
            self._apart[one, other] = not self._states.satisfiable(*conditions, *self._of.clauses)
        return self._apart[one, other]

    @cached_property
    def _states(self) -> Predicates:
        return Predicates(self._of.system.domains)

    def _action(self, action: Action, swap: Swap) -> Form:
        conditions = frozenset(self._form(condition, swap) for condition in action.conditions)
        assigned = frozenset(
            (swap.names.get(name, name), self._value(name, value, swap)) for name, value in action.assigned.items()
        )
        return self._number((action.transition.kind.automatic, conditions, assigned))

    def _value(self, name: str, value: Expr, swap: Swap) -> Form:
        """What is assigned to a variable."""
        match value:
            case Const(constant):
                return self._constant(swap.values.get(name, {}).get(constant, constant))
            case Var(other) if swap.values.get(name) == swap.values.get(other):
                return self._variable(other, swap)
        if name in swap.values:
            raise Unclear
        return self._form(value, swap)

    def _mentions_of(self, action: Action) -> frozenset[Mention]:
        found = frozenset[Mention](action.assigned).union(*map(self._mentions, action.conditions))
        return found.union(*(self._mentions(Equal(Var(name), value)) for name, value in action.assigned.items()))

    def _mentions(self, expr: Expr) -> frozenset[Mention]:
        known = self._mentioned.get(id(expr))
        if known is None:
            match expr:
                case Var(name):
                    found = frozenset[Mention]([name, (name,)])
                case Equal(Var(name), Const(value)) | Equal(Const(value), Var(name)):
                    found = frozenset[Mention]([name, (name, value)])
                case Equal(Var(name), Var(other)) if other in self._alike[name]:  # a swap has the same values of both
                    found = frozenset[Mention]([name, other])
                case _:
                    found = frozenset[Mention]().union(*map(self._mentions, parts_of(expr)))
            known = self._mentioned[id(expr)] = expr, found
        return known[1]

    def _form(self, expr: Expr, swap: Swap) -> Form:
        if swap.touched.isdisjoint(self._mentions(expr)):
            if id(expr) not in self._plain:
                self._plain[id(expr)] = expr, self._written(expr, NO_SWAP)
            return self._plain[id(expr)][1]
        return self._written(expr, swap)

    def _written(self, expr: Expr, swap: Swap) -> Form:
        match expr:
            case Const(value):
                return self._constant(value)
            case Var(name):
                if name in swap.values:
                    raise Unclear
                return self._variable(name, swap)
            case Named(_, part):
                return self._form(part, swap)
            case And(parts) | Or(parts):
                return self._number((type(expr), frozenset(self._form(part, swap) for part in parts)))
            case Equal(Var(name), Const(value)) | Equal(Const(value), Var(name)):
                worth = swap.values.get(name, {}).get(value, value)
                return self._number((Equal, frozenset([self._variable(name, swap), self._constant(worth)])))
            case Equal(Var(name), Var(other)) if swap.values.get(name) == swap.values.get(other):
                return self._number((Equal, frozenset([self._variable(name, swap), self._variable(other, swap)])))
        return self._number((type(expr), *(self._form(part, swap) for part in parts_of(expr))))

    def _variable(self, name: str, swap: Swap) -> Form:
        return self._number((Var, swap.names.get(name, name)))

    def _constant(self, value: Value) -> Form:
        return self._number((Const, type(value), value))

    def _number(self, written: object) -> Form:
        return self._numbers.setdefault(written, len(self._numbers))

    def _copies(self) -> dict[str, tuple[str, ...]]:
        """Variables that are compared with each other or copied to each other, and so speak of the same things."""
        alike: dict[str, tuple[str, ...]] = {variable.name: (variable.name,) for variable in self._of.system.variables}

        def join(one: str, other: str) -> None:
            if other not in alike[one]:
                together = tuple(sorted({*alike[one], *alike[other]}))
                alike.update(dict.fromkeys(together, together))

        seen: set[int] = set()
        for action in self._of.actions:
            look()
            for name, value in action.assigned.items():
                if isinstance(value, Var):
                    join(name, value.name)
            for condition in action.conditions:
                for node in nodes(condition) if id(condition) not in seen else ():
                    match node:
                        case Equal(Var(one), Var(other)):
                            join(one, other)
                seen.add(id(condition))
        return alike

    def _candidates(self) -> Iterator[list[Thing]]:
        """Variables that are assigned in the same way, with the values that go with them."""
        domains = self._of.system.domains
        assigning: dict[str, list[Action]] = {}
        for action in self._of.actions:
            for name in action.assigned:
                assigning.setdefault(name, []).append(action)
        similar: dict[tuple[object, int], list[str]] = {}
        for name, actions in assigning.items():
            similar.setdefault((domains[name], len(actions)), []).append(name)
        for names in similar.values():
            while len(names) > 1:
                first, *others = names
                found: dict[str, tuple[Thing, Thing]] = {}
                for other in others:
                    look()
                    pair = self._pair(first, assigning[first], other, assigning[other])
                    if pair and all(pair[0] == known and apart(pair[1], thing) for known, thing in found.values()):
                        found[other] = pair
                if found:
                    yield [next(iter(found.values()))[0], *(thing for _, thing in found.values())]
                names = [name for name in others if name not in found]

    def _pair(self, first: str, ones: list[Action], second: str, others: list[Action]) -> tuple[Thing, Thing] | None:
        """How two variables differ in what is written about them; None if not by a value of some others at most."""
        values: dict[str, tuple[Value, Value]] = {}
        for one, other in zip(ones, others, strict=True):
            if len(one.conditions) != len(other.conditions) or len(one.assigned) != len(other.assigned):
                return None
            pairs = list(zip(one.conditions, other.conditions, strict=True))
            for (name, value), (also, worth) in zip(one.assigned.items(), other.assigned.items(), strict=True):
                pairs.append((Equal(Var(name), value), Equal(Var(also), worth)))
            while pairs:
                a, b = pairs.pop()
                match a, b:
                    case Equal(Var(x), Const(v)), Equal(Var(y), Const(w)) if x == y and v != w:
                        if values.setdefault(x, (v, w)) != (v, w):
                            return None
                    case Var(x), Var(y) if x != y:
                        if (x, y) != (first, second):
                            return None
                    case (Var() | Const(), _) | (_, Var() | Const()):
                        if a != b:
                            return None
                    case _ if type(a) is type(b) and len(parts_of(a)) == len(parts_of(b)):
                        if a is not b:
                            pairs.extend(zip(parts_of(a), parts_of(b), strict=True))
                    case _:
                        return None
        for name, pair in list(values.items()):
            for alike in self._alike[name]:
                if values.setdefault(alike, pair) != pair:
                    return None
        if {first, second} & values.keys():
            return None
        named = sorted(values)
        return (
            Thing(first, tuple((name, values[name][0]) for name in named)),
            Thing(second, tuple((name, values[name][1]) for name in named)),
        )


NO_SWAP = Swap({}, {}, frozenset())


def split(things: Iterable[Thing], alike: Callable[[Thing, Thing], bool]) -> Iterator[tuple[Thing, ...]]:
    """Things that are all alike the first of them, several at a time."""
    rest = list(things)
    while len(rest) > 1:
        first, *others = rest
        found = [other for other in others if alike(first, other)]
        if found:
            yield (first, *found)
        rest = [other for other in others if other not in found]


def apart(one: Thing, other: Thing) -> bool:
    """Whether no value speaks of both."""
    return all(name != also or value != worth for name, value in one.values for also, worth in other.values)


class Fold(dict[int, int]):
    """For the bits of a packed state that speak of interchangeable things, those of the state that stands for all alike."""

    def __init__(self, packing: Packing, groups: Iterable[tuple[Thing, ...]]) -> None:
        super().__init__()
        self.groups = list(groups)
        self._orders = [Order.of(packing, group) for group in self.groups]
        self.alike = max(map(len, self.groups))
        self.part = packing.mask({name for group in self.groups for thing in group for name in _speaking(thing)})

    def __missing__(self, part: int) -> int:
        bits = part
        for order in self._orders:
            bits = order(bits)
        self[part] = bits
        return bits

    def __call__(self, node: int) -> int:
        part = node & self.part
        return node ^ part | self[part]


@dataclass(frozen=True, slots=True)
class Order:
    """Deals the records of some things, what each is worth and who speaks of it, out to the things in order.

    A record is a number: a bit for each variable that may speak of the thing, the last one lowest, and above them its worth.
    """

    things: tuple[tuple[int, int], ...]  # where each stands, and a mask of as many bits as it has
    speakers: tuple[tuple[int, int, tuple[int, ...], Mapping[int, int]], ...]  # flag, mask, codes by thing and the reverse
    masks: int

    @classmethod
    def of(cls, packing: Packing, group: tuple[Thing, ...]) -> Order:
        masks, codes = [packing.masks[thing.name] for thing in group], packing.codes
        lowest = [(mask & -mask).bit_length() - 1 for mask in masks]
        speakers = []
        for flag, said in enumerate(zip(*(reversed(thing.values) for thing in group), strict=True)):
            name, _ = said[0]
            speaks = tuple(codes[name][value] for _, value in said)
            speakers.append((1 << flag, packing.masks[name], speaks, {code: at for at, code in enumerate(speaks)}))
        things = tuple((low, mask >> low) for low, mask in zip(lowest, masks, strict=True))
        return cls(things, tuple(speakers), union(masks))

    def __call__(self, bits: int) -> int:
        above = len(self.speakers)
        records = [(bits >> low & mask) << above for low, mask in self.things]
        for flag, mask, _, spoken_of in self.speakers:
            at = spoken_of.get(bits & mask)
            if at is not None:
                records[at] |= flag
        records.sort()
        bits &= ~self.masks
        flags = (1 << above) - 1
        for at, ((low, _), record) in enumerate(zip(self.things, records, strict=True)):
            bits |= record >> above << low
            if record & flags:
                for flag, mask, speaks, _ in self.speakers:
                    if record & flag:
                        bits = bits & ~mask | speaks[at]
        return bits


def _speaking(thing: Thing) -> Iterator[str]:
    yield thing.name
    yield from (name for name, _ in thing.values)
