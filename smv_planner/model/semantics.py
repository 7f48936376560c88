"""What a model means.

Everything that decides which state follows which lives in this file. The runner, the explicit engine, the emulators
and the checker call it; the SMV encoding says the same thing in another language, and tests/engines holds the two
together.

A step fires exactly one transition; all its assignments read the old state. A transition is enabled when its guard
holds, its assignments stay inside the domains, and firing changes the state. While any automatic transition is
enabled, only the first of them in declared order may fire. A state in which none is enabled is settled.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Set
from itertools import product
from operator import itemgetter
from typing import TypeVar, cast

from smv_planner.clock import look
from smv_planner.model.domains import Bool, Domain, Enum, Range, Value
from smv_planner.model.expressions import (
    TRUE,
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
    conjunction,
    conjuncts,
    disjunction,
    equality,
    meaning,
    negation,
    variables_of,
)
from smv_planner.model.system import Any, Assignment, State, System, Transition

REMEMBERED = 20_000
"""How many things a system and those made from it may remember before they start afresh."""

JUDGED = 1000
"""For how many states what holds there is remembered, of a predicate or of what comes by itself, before it starts afresh."""

T = TypeVar("T")
R = TypeVar("R")

Step = tuple[Transition, State]
"""A transition and the state it leads to."""


def ready(system: System, transition: Transition) -> Expr:
    """When a transition is enabled, as a predicate on states (automatic priority apart)."""
    return once(system, _ready, transition)


def _ready(system: System, transition: Transition) -> Expr:
    fires, changes = may_fire(system, transition), _changing(system, transition)
    known = set(conjuncts(fires))
    implied = any(_follows(change, known) for change in (changes.parts if isinstance(changes, Or) else [changes]))
    return fires if implied else conjunction([fires, changes])


def may_fire(system: System, transition: Transition) -> Expr:
    """When the guard holds and the assigned values lie in their domains, whether or not firing changes anything."""
    return conjunction([transition.guard, *(_inside(system, action) for action in transition.actions)])


def settled(system: System, transitions: Iterable[Transition]) -> Expr:
    """When none of the automatic ones among `transitions` is enabled, as a predicate on states."""
    return negation(disjunction(ready(system, t) for t in transitions if t.kind.automatic))


def fire(system: System, transition: Transition, state: State) -> tuple[State, ...]:
    """Every state the transition may lead to; none if it is not enabled; several if the planner has a choice."""
    return _compiled(system, transition)(state)


class Steps:
    """The steps that a set of usable transitions allows, with the priority of automatic ones."""

    def __init__(self, system: System, usable: Iterable[Transition]) -> None:
        transitions = tuple(usable)
        self._index = system.index
        self._automatic = [(t, _compiled(system, t)) for t in transitions if t.kind.automatic]
        self._others = [(t, _compiled(system, t)) for t in transitions if not t.kind.automatic]
        self._outcomes = {t.name: outcomes for t, outcomes in self._others}
        self._due: dict[State, Step | None] = {}

    def automatic(self, state: State) -> Step | None:
        """The automatic step that comes next, or None in a settled state."""
        if state not in self._due:
            if len(self._due) >= JUDGED:
                self._due.clear()
            self._due[state] = self._first(state)
        return self._due[state]

    def _first(self, state: State) -> Step | None:
        for transition, outcomes in self._automatic:
            for after in outcomes(state):
                return transition, after
        return None

    def settled(self, state: State) -> bool:
        return self.automatic(state) is None

    def settle(self, state: State) -> State:
        """Where automatic steps lead from a state before anything else happens; the state itself if they never end."""
        seen, now = {state}, state
        while step := self.automatic(now):
            now = step[1]
            if now in seen:
                return state
            seen.add(now)
        return now

    def by(self, state: State, name: str) -> Iterator[State]:
        """Where a transition may lead from a state; nowhere if it cannot come next."""
        due = self.automatic(state)
        if due:
            if due[0].name == name:
                yield due[1]
        elif name in self._outcomes:
            yield from self._outcomes[name](state)

    def again(self, state: State, transition: Transition, once: State) -> State | None:
        """The state that a transition leads to with the choices by which it led to `once`; None if it cannot come next."""
        due = self.automatic(state)
        if due:
            return due[1] if due[0] is transition else None
        chosen = [self._index[action.variable] for action in transition.actions if isinstance(action.value, Any)]
        outcomes = self._outcomes.get(transition.name)
        for after in outcomes(state) if outcomes else ():
            if all(after[at] == once[at] for at in chosen):
                return after
        return None

    def __call__(self, state: State) -> Iterator[Step]:
        """Every possible step, in declared order."""
        first = self.automatic(state)
        if first:
            yield first
        else:
            for transition, outcomes in self._others:
                for after in outcomes(state):
                    yield transition, after


def slide(
    system: System,
    starts: Iterable[State],
    invariants: Iterable[Expr],
    budget: int = 100_000,
    among: Iterable[Transition] | None = None,
) -> list[Step] | None:
    """The shortest way in which automatic and effect transitions, in any order, lead to breaking an invariant.

    The empty list if one of the starts breaks an invariant already, None if there is no way (Machines 2021, section
    3). Effects and automatic transitions interleave freely here, and none counts as disabled: the late sensor may
    still come. With `among`, only these transitions are looked at.

    Raises OverflowError after looking at `budget` states.
    """
    holds = [judge(system, invariant) for invariant in invariants]
    moves = [(t, _compiled(system, t)) for t in (system.transitions if among is None else among) if t.kind.uncontrollable]
    came_from: dict[State, Step | None] = dict.fromkeys(starts)
    waiting = deque(came_from)
    while waiting:
        look()
        before = waiting.popleft()
        if not all(held(before) for held in holds):
            return _steps_to(before, came_from)
        for transition, outcomes in moves:
            for after in outcomes(before):
                if after not in came_from:
                    came_from[after] = (transition, before)
                    waiting.append(after)
        if len(came_from) > budget:
            raise OverflowError(f"more than {budget} states can follow without the planner")
    return None


def _steps_to(state: State, came_from: Mapping[State, Step | None]) -> list[Step]:
    steps: list[Step] = []
    while (origin := came_from[state]) is not None:
        steps.append((origin[0], state))
        state = origin[1]
    return steps[::-1]


def _compiled(system: System, transition: Transition) -> Callable[[State], tuple[State, ...]]:
    """`fire` for one transition."""
    return once(system, _compile, transition)


def judge(system: System, predicate: Expr) -> Callable[[State], Value]:
    """`meaning`, made once and found once for what is read: for predicates that are asked again, as those of invariants are."""
    return once(system, _judge, predicate)


def _judge(system: System, predicate: Expr) -> Callable[[State], Value]:
    worth = meaning(predicate, system.index)
    read = sorted(system.index[name] for name in variables_of(predicate))
    if len(read) < 2:
        return worth
    part, known = itemgetter(*read), dict[object, Value]()

    def judged(state: State) -> Value:
        values = part(state)
        if values not in known:
            if len(known) >= JUDGED:
                known.clear()
            known[values] = worth(state)
        return known[values]

    return judged


def once(system: System, make: Callable[[System, T], R], of: T) -> R:
    """What `make` makes of something, remembered by identity: to compare large expressions takes time.

    Systems with one base remember together; so `make` may use no more of a system than its variables, unless it is `of` it.
    """
    found = system.memo.get((make, id(of)))
    if found is None:
        if len(system.memo) >= REMEMBERED:
            system.memo.clear()
        found = system.memo[make, id(of)] = of, make(system, of)
    return cast("R", found[1])


def _compile(system: System, transition: Transition) -> Callable[[State], tuple[State, ...]]:
    enabled = meaning(ready(system, transition), system.index)
    fixed = [
        (system.index[action.variable], meaning(action.value, system.index))
        for action in transition.actions
        if not isinstance(action.value, Any)
    ]
    free = [system.index[action.variable] for action in transition.actions if isinstance(action.value, Any)]
    choices = list(product(*(system.variables[at].domain.values for at in free)))

    def outcomes(state: State) -> tuple[State, ...]:
        if not enabled(state):
            return ()
        after = list(state)
        for at, value in fixed:
            after[at] = value(state)
        if not free:
            return (tuple(after),)
        reached = []
        for choice in choices:
            for at, chosen in zip(free, choice, strict=True):
                after[at] = chosen
            reached.append(tuple(after))
        return tuple(new for new in reached if new != state)

    return outcomes


def _inside(system: System, action: Assignment) -> Expr:
    """That the assigned value lies in the variable's domain; true where the types alone say so."""
    if isinstance(action.value, Any):
        return TRUE
    domain = system.domains[action.variable]
    match domain, possible(action.value, system.domains):
        case Range(low, high), Range(least, most):
            below, above = Less(action.value, Const(low)), Less(Const(high), action.value)
            return conjunction([negation(b) for b, needed in ((below, least < low), (above, most > high)) if needed])
        case Enum(words), Enum(others) if not set(others) <= set(words):
            return disjunction(equality(action.value, Const(word)) for word in words if word in others)
    return TRUE


def _changing(system: System, transition: Transition) -> Expr:
    return disjunction(
        Const(len(system.domains[action.variable].values) > 1)
        if isinstance(action.value, Any)
        else negation(equality(action.value, Var(action.variable)))
        for action in transition.actions
    )


def _follows(change: Expr, known: Set[Expr]) -> bool:
    """Whether something known says that a value changes: so itself, or that the variable has another value now."""
    match change:
        case Not(Equal(Var(name), Const(value))):
            others = (part for part in known if isinstance(part, Equal) and part.left == Var(name))
            if any(isinstance(part.right, Const) and part.right.value != value for part in others):
                return True
    return change in known


def possible(expr: Expr, domains: Mapping[str, Domain]) -> Domain:
    """A domain that holds every value an expression can have, judged by its shape alone."""
    match expr:
        case Var(name):
            return domains[name]
        case Const(value):
            return Bool() if type(value) is bool else Range(value, value) if type(value) is int else Enum((str(value),))
        case Named(_, part):
            return possible(part, domains)
        case Plus(left, right) | Minus(left, right):
            a, b = possible(left, domains), possible(right, domains)
            assert isinstance(a, Range)
            assert isinstance(b, Range)
            if isinstance(expr, Plus):
                return Range(a.low + b.low, a.high + b.high)
            return Range(a.low - b.high, a.high - b.low)
        case If(_, then, otherwise):
            a, b = possible(then, domains), possible(otherwise, domains)
            if isinstance(a, Range) and isinstance(b, Range):
                return Range(min(a.low, b.low), max(a.high, b.high))
            if isinstance(a, Enum) and isinstance(b, Enum):
                return Enum(tuple(dict.fromkeys(a.words + b.words)))
    return Bool()
