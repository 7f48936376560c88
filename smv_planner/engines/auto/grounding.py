"""A system taken apart, once: actions with their conditions, and states packed into integers.

An action is a transition with the planner's choices made. Whether it is enabled, and whether it leads to an allowed
state, are conjunctions; each conjunct reads a few variables only, which is what makes the search and the relaxed
reachability quick.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property, reduce
from itertools import product
from math import prod
from operator import or_

from smv_planner.clock import look
from smv_planner.lazy import dataclass
from smv_planner.model.domains import Value
from smv_planner.model.expressions import (
    FALSE,
    TRUE,
    And,
    Const,
    Expr,
    Or,
    Var,
    conjuncts,
    disjunction,
    equality,
    meaning,
    negation,
    parts_of,
    with_parts,
)
from smv_planner.model.semantics import may_fire
from smv_planner.model.system import Any, Invariant, State, System, Transition


@dataclass(frozen=True, slots=True)
class Action:
    """A transition and, where it lets the planner choose, one choice; enabled if all of `conditions` hold."""

    transition: Transition
    conditions: tuple[Expr, ...]
    assigned: Mapping[str, Expr]


class Reads:
    """Which variables expressions read. By identity: to compare large expressions takes time."""

    def __init__(self) -> None:
        self._known: dict[int, tuple[Expr, frozenset[str]]] = {}

    def __call__(self, expr: Expr) -> frozenset[str]:
        found = self._known.get(id(expr))
        if found is None:
            parts = parts_of(expr)
            names = frozenset([expr.name]) if isinstance(expr, Var) else frozenset().union(*map(self, parts))
            found = self._known[id(expr)] = expr, names
        return found[1]

    def trim(self) -> None:
        """Forget the expressions of earlier questions, if they have become many."""
        if len(self._known) > EXPRESSIONS:
            self._known.clear()


EXPRESSIONS = 200_000
"""Of how many expressions is kept what they read."""

DEALT_OUT = 8
"""How many conjuncts of an alternative are dealt out at most."""

FEW_BITS = 8
"""How many bits a condition reads at most for it to be judged as a whole."""

JUDGED = 1_000_000
"""How often conditions may have been judged before all that is remembered of them starts afresh."""


Assigned = tuple[tuple[str, Expr], ...]
"""What variables get."""


class Shared:
    """What is worked out of transitions, invariants and conditions; the same for all systems made from one base.

    By identity: to compare large expressions takes time.
    """

    def __init__(self, system: System) -> None:
        self.packing = Packing(system)
        self.reads = Reads()
        self._after: dict[tuple[int, Assigned], tuple[Expr, Expr]] = {}
        self.compiled: dict[int, tuple[Expr, Callable[[int], frozenset[Value]]]] = {}  # for relaxed reachability
        self.hit: dict[int, tuple[Expr, tuple[int, ...] | None]] = {}
        self.held: dict[tuple[int, bool], tuple[Expr, Callable[[int], bool]]] = {}
        self.judged = 0
        self._actions: dict[int, tuple[Transition, tuple[Action, ...]]] = {}
        self._clauses: dict[int, tuple[Expr, tuple[Expr, ...]]] = {}
        self._truths: dict[int, Truth] = {}
        self._narrow: dict[int, tuple[Expr, tuple[tuple[Expr, ...], ...]]] = {}
        self._alternatives: dict[int, tuple[Expr, tuple[Expr, ...]]] = {}
        self._keeps: dict[tuple[int, Assigned], tuple[Expr, tuple[Expr, ...]]] = {}

    def actions(self, system: System) -> tuple[Action, ...]:
        return tuple(action for transition in system.transitions for action in self._actions_of(system, transition))

    def _actions_of(self, system: System, transition: Transition) -> tuple[Action, ...]:
        if id(transition) not in self._actions:
            look()
            self._actions[id(transition)] = transition, tuple(_actions(system, transition))
        return self._actions[id(transition)][1]

    def clauses(self, predicate: Expr) -> Iterator[Expr]:
        """An invariant taken apart. Invariants that grow from one another have parts in common."""
        for part in predicate.parts if isinstance(predicate, And) else [predicate]:
            if id(part) not in self._clauses:
                look()
                self._clauses[id(part)] = part, tuple(conjuncts(part))
            yield from self._clauses[id(part)][1]

    def keeps(self, action: Action, clause: Expr) -> tuple[Expr, ...]:
        """What a clause asks of the state before an action, for it to hold after."""
        key = id(clause), self._read_of(action.assigned, clause)
        if key not in self._keeps:
            self._keeps[key] = clause, tuple(conjuncts(self._before(clause, dict(key[1]))))
        return self._keeps[key][1]

    def truth(self, condition: Expr, names: Sequence[str]) -> Truth:
        if id(condition) not in self._truths:
            self._truths[id(condition)] = Truth(self, condition, names)
        return self._truths[id(condition)]

    def narrow(self, condition: Expr) -> tuple[tuple[Expr, ...], ...]:
        """A condition that reads too much for one view, as several that all have to hold; of each what must not hold all.

        What must not hold all are negated alternatives, each of which reads less. Alternatives that read little together
        are one, and what all has to hold in an alternative is dealt out. Empty if the condition does not read too much.
        """
        if id(condition) not in self._narrow:
            found = self._in_turn(alternatives(condition)) if self._wide([condition]) else ()
            self._narrow[id(condition)] = condition, tuple(map(self._grouped, found))
        return self._narrow[id(condition)][1]

    def _wide(self, parts: Iterable[Expr]) -> bool:
        return self.packing.mask(frozenset().union(*map(self.reads, parts))).bit_count() > VIEW_BITS

    def _in_turn(self, parts: tuple[Expr, ...]) -> Iterator[tuple[Expr, ...]]:
        for at, part in enumerate(parts):
            inner = tuple(conjuncts(part)) if self._wide([part]) else ()
            if 1 < len(inner) <= DEALT_OUT:
                for one in inner:
                    yield from self._in_turn((*parts[:at], *alternatives(one), *parts[at + 1 :]))
                return
        yield parts

    def _grouped(self, parts: tuple[Expr, ...]) -> tuple[Expr, ...]:
        groups: list[list[Expr]] = []
        for part in parts:
            room = next((group for group in groups if not self._wide([*group, part])), None)
            if room is None:
                groups.append([part])
            else:
                room.append(part)
        return tuple(negation(disjunction(group)) for group in groups)

    def trim(self) -> None:
        """Forget what is only remembered to be quicker, if that has become much."""
        self.reads.trim()
        if self.judged + len(self._keeps) + len(self._after) > JUDGED:
            self.judged = 0
            for truth in self._truths.values():
                truth.clear()
            by_transition = self._actions, self._clauses, self._keeps, self._after
            for known in (*by_transition, self._alternatives, self._truths, self._narrow):
                known.clear()

    def _read_of(self, assigned: Mapping[str, Expr], expr: Expr) -> Assigned:
        """What is assigned to variables that an expression reads."""
        names = self.reads(expr)
        return tuple([(name, value) for name, value in assigned.items() if name in names])

    def _before(self, clause: Expr, assigned: Mapping[str, Expr]) -> Expr:
        """What has to hold for a clause to hold after what is assigned."""
        if id(clause) not in self._alternatives:
            self._alternatives[id(clause)] = clause, alternatives(clause)
        left = []
        for part in self._alternatives[id(clause)][1]:
            before = self._substituted(part, assigned)
            if before is part or not isinstance(before, Const):
                left.append(before)
            elif before.value:
                return TRUE
        return FALSE if not left else left[0] if len(left) == 1 else Or(tuple(left))

    def _substituted(self, expr: Expr, assigned: Mapping[str, Expr]) -> Expr:
        """An expression with what is assigned in place of its variables. Expressions have many parts in common."""
        if isinstance(expr, Var):
            return assigned.get(expr.name, expr)
        touched = self._read_of(assigned, expr)
        if not touched:
            return expr
        key = id(expr), touched
        if key not in self._after:
            self._after[key] = expr, with_parts(expr, [self._substituted(part, assigned) for part in parts_of(expr)])
        return self._after[key][1]


class Truth(dict[int, bool]):
    """Whether a condition holds, by the bits of the variables that it reads; judged once for all their values."""

    def __init__(self, shared: Shared, condition: Expr, names: Sequence[str]) -> None:
        super().__init__()
        self._shared = shared
        self._condition = condition
        self._names = names

    def __missing__(self, part: int) -> bool:
        self._shared.judged += 1
        result = self[part] = self._judge(part)
        return result

    @cached_property
    def _judge(self) -> Callable[[int], bool]:
        """What reads many bits is judged by its parts: each has few values, which come again and again."""
        packing = self._shared.packing
        if len(self._names) > 1 and packing.mask(self._names).bit_count() > FEW_BITS:
            for parts, every in ((tuple(conjuncts(self._condition)), True), (alternatives(self._condition), False)):
                if len(parts) > 1:
                    return self._connected(parts, every)
        holds = meaning(self._condition, {name: at for at, name in enumerate(self._names)})
        readers = [packing.reader[name] for name in self._names]
        return lambda part: bool(holds(tuple([values[part >> shift & mask] for shift, mask, values in readers])))

    def _connected(self, parts: Iterable[Expr], every: bool) -> Callable[[int], bool]:
        """`every` part has to hold, or one of them."""
        shared, judged = self._shared, []
        for each in parts:
            names = sorted(shared.reads(each), key=shared.packing.order.__getitem__)
            judged.append((shared.packing.mask(names), Truth(shared, each, names)))

        def judge(part: int) -> bool:
            for mask, truth in judged:
                if truth[part & mask] is not every:
                    return not every
            return every

        return judge


@dataclass(frozen=True, eq=False)
class Ground:
    """A system's actions, in the order in which their transitions are declared, under allowed invariants.

    The invariants are taken apart into `clauses`. `keeps` says for each action when it leads to a state that is allowed,
    given that it starts from one.
    """

    system: System
    actions: tuple[Action, ...]
    clauses: tuple[Expr, ...]
    shared: Shared

    @property
    def packing(self) -> Packing:
        return self.shared.packing

    @property
    def reads(self) -> Reads:
        return self.shared.reads

    def usable(self, unusable: frozenset[str]) -> int:
        """The usable actions, one bit each."""
        return (1 << len(self.actions)) - 1 & ~union(self._of[name] for name in self._named & unusable)

    @cached_property
    def _of(self) -> dict[str, int]:
        """By the name of a transition its actions, one bit each."""
        of: dict[str, int] = {}
        for at, action in enumerate(self.actions):
            of[action.transition.name] = of.get(action.transition.name, 0) | 1 << at
        return of

    @cached_property
    def _named(self) -> frozenset[str]:
        return frozenset(self._of)

    @cached_property
    def automatic(self) -> int:
        """The automatic actions, one bit each."""
        return sum(1 << at for at, action in enumerate(self.actions) if action.transition.kind.automatic)

    @cached_property
    def keeps(self) -> tuple[tuple[Expr, ...], ...]:
        touching: dict[str, list[int]] = {}
        for at, clause in enumerate(self.clauses):
            for name in self.reads(clause):
                touching.setdefault(name, []).append(at)
        result = []
        for action in self.actions:
            look()
            touched = sorted({at for name in action.assigned for at in touching.get(name, ())})
            result.append(tuple(part for at in touched for part in self.shared.keeps(action, self.clauses[at])))
        return tuple(result)


def ground(system: System, actions: tuple[Action, ...], allowed: Iterable[Invariant], shared: Shared) -> Ground:
    clauses = (clause for invariant in allowed for clause in shared.clauses(invariant.predicate))
    return Ground(system, actions, tuple(dict.fromkeys(clauses)), shared)


def _actions(system: System, transition: Transition) -> Iterator[Action]:
    fires = tuple(conjuncts(may_fire(system, transition)))
    fixed = {action.variable: action.value for action in transition.actions if not isinstance(action.value, Any)}
    free = [action.variable for action in transition.actions if isinstance(action.value, Any)]
    for choice in product(*(system.domains[name].values for name in free)):
        assigned = {**fixed, **{name: Const(value) for name, value in zip(free, choice, strict=True)}}
        changes = disjunction(negation(equality(Var(name), value)) for name, value in assigned.items())
        yield Action(transition, tuple(dict.fromkeys((*fires, *conjuncts(changes)))), assigned)


def alternatives(expr: Expr) -> tuple[Expr, ...]:
    """Parts of which one has to hold for `expr` to hold."""
    return tuple(negation(part) for part in conjuncts(expr, False))


def dealt_out(clause: Expr) -> Iterator[Expr]:
    """A clause as several of which each reads less, where some of its alternatives are conjunctions of a few parts."""
    parts = [tuple(conjuncts(part)) for part in alternatives(clause)]
    if prod(map(len, parts)) > DEALT_OUT:
        yield clause
    else:
        for chosen in product(*parts):
            yield disjunction(chosen)


class Packing:
    """States as integers: each variable has just as many bits as it needs, and `width` counts them all.

    `facts` counts the values of all variables.
    """

    def __init__(self, system: System) -> None:
        self.masks: dict[str, int] = {}
        self.codes: dict[str, dict[Value, int]] = {}
        self._values: list[tuple[int, int, tuple[Value, ...]]] = []
        self.width = 0
        for variable in system.variables:
            values = variable.domain.values
            bits = (len(values) - 1).bit_length()
            self.masks[variable.name] = ((1 << bits) - 1) << self.width
            self.codes[variable.name] = {value: at << self.width for at, value in enumerate(values)}
            self._values.append((self.width, (1 << bits) - 1, values))
            self.width += bits
        self._coded = tuple(self.codes.values())
        self.facts = sum(map(len, self._coded))
        self.order = {name: at for at, name in enumerate(self.masks)}
        self.reader = {v.name: value for v, value in zip(system.variables, self._values, strict=True)}

    def pack(self, state: State) -> int:
        return sum([codes[value] for codes, value in zip(self._coded, state, strict=True)])

    def unpack(self, node: int) -> State:
        return tuple([values[node >> shift & mask] for shift, mask, values in self._values])

    def mask(self, names: Iterable[str]) -> int:
        return sum(self.masks[name] for name in names)


class Judgement(dict[int, int]):
    """Conditions that read the same variables: from the bits of these variables to the mask that the conditions leave.

    A condition that does not hold clears its bits of the mask.
    """

    def __init__(self, part: int, conditions: Sequence[tuple[Truth, int]], full: int) -> None:
        super().__init__()
        self._conditions = conditions
        self._full = full
        self.part = part

    def __missing__(self, part: int) -> int:
        result = self._full
        for truth, bits in self._conditions:
            if not truth[part]:
                result &= ~bits
        self[part] = result
        return result

    def entries(self) -> int:
        return len(self)

    def forget(self) -> None:
        self.clear()


class View(dict[int, int]):
    """A part of the state, and the mask that everything judged by this part leaves."""

    def __init__(self, judgements: Iterable[Judgement | View], full: int) -> None:
        super().__init__()
        self._judgements = [(judgement.part, judgement) for judgement in judgements]
        self._full = full
        self.part: int = union(bits for bits, _ in self._judgements)

    def __missing__(self, part: int) -> int:
        result = self._full
        for bits, judgement in self._judgements:
            result &= judgement[part & bits]
        self[part] = result
        return result

    def entries(self) -> int:
        return len(self) + sum(judgement.entries() for _, judgement in self._judgements)

    def forget(self) -> None:
        self.clear()
        for _, judgement in self._judgements:
            judgement.forget()


VIEW_BITS = 16
"""How many bits of a state one view looks at, if its conditions allow."""


def views(
    shared: Shared, needs: Mapping[Expr, int], full: int, truth: Callable[[Expr, Sequence[str]], Truth]
) -> tuple[View, ...]:
    """Views that together say which bits of `full` survive: those whose conditions all hold, as `truth` knows.

    What reads few bits is judged by smaller views, whose values come again and again.
    """
    alike: dict[frozenset[str], list[tuple[Expr, int]]] = {}
    for condition, bits in needs.items():
        alike.setdefault(shared.reads(condition), []).append((condition, bits))
    judgements = []
    for names, conditions in alike.items():
        look()
        ordered = sorted(names, key=shared.packing.order.__getitem__)
        truths = [(truth(condition, ordered), bits) for condition, bits in conditions]
        judgements.append(Judgement(shared.packing.mask(names), truths, full))
    judgements.sort(key=lambda judgement: -judgement.part.bit_count())  # stable: equal widths stay in order
    found = []
    for group in _grouped(judgements, VIEW_BITS):
        small = [each for each in group if each.part.bit_count() < FEW_BITS]
        large = [each for each in group if each.part.bit_count() >= FEW_BITS]
        found.append(View([*large, *(View(each, full) for each in _grouped(small, FEW_BITS))], full))
    return tuple(found)


def _grouped(judgements: Iterable[Judgement], most: int) -> list[list[Judgement]]:
    """Judgements, widest first, of which those go together that read little more together."""
    groups: list[tuple[int, list[Judgement]]] = []
    for judgement in judgements:
        look()
        part = judgement.part
        room = [
            ((part & ~bits).bit_count(), at)
            for at, (bits, _) in enumerate(groups)
            if not part & ~bits or (part | bits).bit_count() <= most
        ]
        if room:
            at = min(room)[1]
            bits, kept = groups[at]
            kept.append(judgement)
            groups[at] = (bits | part, kept)
        else:
            groups.append((part, [judgement]))
    return [kept for _, kept in groups]


def needs_of(conditions: Iterable[tuple[Iterable[Expr], int]]) -> dict[Expr, int]:
    """For every condition the bits that need it."""
    needs: dict[Expr, int] = {}
    for parts, bit in conditions:
        for part in parts:
            needs[part] = needs.get(part, 0) | bit
    return needs


def union(masks: Iterable[int]) -> int:
    """Sets of bits, put together."""
    return reduce(or_, masks, 0)
