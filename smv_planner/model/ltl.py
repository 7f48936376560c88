"""Linear temporal logic over states, and what it means on a run that ends by idling for ever.

Formulas are kept in negation normal form: negation stands only inside atoms, which are predicates on states. `F`, `G`
and `W` are expressed by `Until` and `Release`. A plan's run is its states followed by the last one repeated for ever
(the system idles); the mission's `phi U goal` is meant literally (Machines 2021, section 4.2).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

from smv_planner.lazy import dataclass
from smv_planner.model.expressions import FALSE, TRUE, Expr, meaning, negation, show
from smv_planner.model.system import State


@dataclass(frozen=True, slots=True)
class Atom:
    predicate: Expr


@dataclass(frozen=True, slots=True)
class Both:
    left: Formula
    right: Formula


@dataclass(frozen=True, slots=True)
class Either:
    left: Formula
    right: Formula


@dataclass(frozen=True, slots=True)
class Next:
    part: Formula


@dataclass(frozen=True, slots=True)
class Until:
    """`left` in every state before one in which `right` holds, and there is such a state."""

    left: Formula
    right: Formula


@dataclass(frozen=True, slots=True)
class Release:
    """`right` up to and including the first state in which `left` holds; for ever if there is none."""

    left: Formula
    right: Formula


Formula = Atom | Both | Either | Next | Until | Release

ALWAYS_TRUE = Atom(TRUE)
ALWAYS_FALSE = Atom(FALSE)


def eventually(part: Formula) -> Formula:
    return Until(ALWAYS_TRUE, part)


def always(part: Formula) -> Formula:
    return Release(ALWAYS_FALSE, part)


def weak_until(left: Formula, right: Formula) -> Formula:
    return Release(right, Either(left, right))


def negated(formula: Formula) -> Formula:
    """The formula that holds exactly where this one does not."""
    match formula:
        case Atom(predicate):
            return Atom(negation(predicate))
        case Both(left, right):
            return Either(negated(left), negated(right))
        case Either(left, right):
            return Both(negated(left), negated(right))
        case Next(part):
            return Next(negated(part))
        case Until(left, right):
            return Release(negated(left), negated(right))
        case Release(left, right):
            return Until(negated(left), negated(right))


def all_of(formulas: Iterable[Formula]) -> Formula:
    result: Formula | None = None
    for formula in formulas:
        result = formula if result is None else Both(result, formula)
    return result or ALWAYS_TRUE


def co_safe(formula: Formula) -> bool:
    """Whether a finite trace can show the formula true whatever follows: no `Release` in it."""
    match formula:
        case Atom():
            return True
        case Next(part):
            return co_safe(part)
        case Release():
            return False
        case Both(left, right) | Either(left, right) | Until(left, right):
            return co_safe(left) and co_safe(right)


def counts_steps(formula: Formula) -> bool:
    """Whether the formula speaks of the next state."""
    match formula:
        case Atom():
            return False
        case Next():
            return True
        case Both(left, right) | Either(left, right) | Until(left, right) | Release(left, right):
            return counts_steps(left) or counts_steps(right)


def atoms(formula: Formula) -> Iterator[Expr]:
    match formula:
        case Atom(predicate):
            yield predicate
        case Next(part):
            yield from atoms(part)
        case Both(left, right) | Either(left, right) | Until(left, right) | Release(left, right):
            yield from atoms(left)
            yield from atoms(right)


def over_atoms(formula: Formula, change: Callable[[Expr], Expr]) -> Formula:
    """The formula with every predicate changed."""
    match formula:
        case Atom(predicate):
            return Atom(change(predicate))
        case Next(part):
            return Next(over_atoms(part, change))
        case Both(left, right) | Either(left, right) | Until(left, right) | Release(left, right):
            return type(formula)(over_atoms(left, change), over_atoms(right, change))


def show_formula(formula: Formula) -> str:
    """A formula in the language of scenarios."""
    match formula:
        case Atom(predicate):
            return f"({show(predicate)})"
        case Next(part):
            return f"X {show_formula(part)}"
        case Until(Atom(predicate), right) if predicate == TRUE:
            return f"F {show_formula(right)}"
        case Release(Atom(predicate), right) if predicate == FALSE:
            return f"G {show_formula(right)}"
        case Both(left, right):
            return f"({show_formula(left)} and {show_formula(right)})"
        case Either(left, right):
            return f"({show_formula(left)} or {show_formula(right)})"
        case Until(left, right):
            return f"({show_formula(left)} U {show_formula(right)})"
        case Release(left, right):
            return f"({show_formula(left)} R {show_formula(right)})"


def holds(formula: Formula, states: Sequence[State], index: Mapping[str, int]) -> bool:
    """Whether a run satisfies a formula: `states`, at least one, then the last for ever.

    Worked out backwards, one truth value per subformula and position: the definition, not a search.
    """

    def where(predicate: Expr) -> list[bool]:
        judge = meaning(predicate, index)
        return [bool(judge(state)) for state in states]

    return truths(formula, where)[0]


def truths(formula: Formula, where: Callable[[Expr], list[bool]]) -> list[bool]:
    """Whether a formula holds from each state of a run on; `where` says it of predicates."""
    match formula:
        case Atom(predicate):
            return where(predicate)
        case Next(part):
            later = truths(part, where)
            return [*later[1:], later[-1]]
        case Both(left, right):
            return [a and b for a, b in zip(truths(left, where), truths(right, where), strict=True)]
        case Either(left, right):
            return [a or b for a, b in zip(truths(left, where), truths(right, where), strict=True)]
        case Until(left, right) | Release(left, right):
            first, second = truths(left, where), truths(right, where)
            now = second[-1]  # in the last state, repeated for ever, both operators come down to their right side
            result = []
            for a, b in zip(reversed(first), reversed(second), strict=True):
                now = b or (a and now) if isinstance(formula, Until) else b and (a or now)
                result.append(now)
            return result[::-1]


def progressed(formula: Formula, state: State, index: Mapping[str, int]) -> Formula:
    """What is owed from the next state on so that `formula` holds in `state`; ALWAYS_FALSE if it is broken for good."""
    match formula:
        case Atom(predicate):
            return ALWAYS_TRUE if meaning(predicate, index)(state) else ALWAYS_FALSE
        case Next(part):
            return part
        case Both(left, right):
            return _both(progressed(left, state, index), progressed(right, state, index))
        case Either(left, right):
            return _either(progressed(left, state, index), progressed(right, state, index))
        case Until(left, right):
            return _either(progressed(right, state, index), _both(progressed(left, state, index), formula))
        case Release(left, right):
            return _both(progressed(right, state, index), _either(progressed(left, state, index), formula))


def parts(formula: Formula) -> Iterator[Formula]:
    """The formulas that a conjunction says together, each once and in order."""
    seen: dict[Formula, None] = {}
    waiting = [formula]
    while waiting:
        match waiting.pop():
            case Both(left, right):
                waiting += [right, left]
            case part if part != ALWAYS_TRUE:
                seen.setdefault(part)
    yield from seen


def _both(left: Formula, right: Formula) -> Formula:
    if ALWAYS_FALSE in (left, right):
        return ALWAYS_FALSE
    return all_of(parts(Both(left, right)))


def _either(left: Formula, right: Formula) -> Formula:
    if ALWAYS_TRUE in (left, right):
        return ALWAYS_TRUE
    if left == right or right == ALWAYS_FALSE:
        return left
    return right if left == ALWAYS_FALSE else Either(left, right)


Obligations = int
"""A set of subformulas that must all hold from some state on, one bit each."""


class Monitor:
    """Follows a formula along a run, state by state.

    Where a formula can be met in several ways (`p or X q`), each way leaves its own obligations for the next state.
    """

    def __init__(self, formula: Formula, index: Mapping[str, int]) -> None:
        self._index = index
        self._formulas: list[Formula] = []
        self._ways: list[Callable[[State], tuple[Obligations, ...]]] = []
        self.start: Obligations = 1 << self._add(formula)

    def after(self, obligations: Obligations, state: State) -> tuple[Obligations, ...]:
        """The ways to meet `obligations` in `state`: what each leaves for the next state. None if they are broken."""
        ways: tuple[Obligations, ...] = _MET
        for at, way in enumerate(self._ways):
            if obligations >> at & 1:
                ways = _each(ways, way(state))
        return ways

    def met_by_idling(self, obligations: Obligations, state: State) -> bool:
        """Whether staying in `state` for ever meets `obligations`."""
        owed = (formula for at, formula in enumerate(self._formulas) if obligations >> at & 1)
        return all(holds(formula, (state,), self._index) for formula in owed)

    def _add(self, formula: Formula) -> int:
        """Number a formula after its parts and keep how it expands into now and later."""
        way: Callable[[State], tuple[Obligations, ...]]
        match formula:
            case Atom(predicate):
                judge = meaning(predicate, self._index)
                way = lambda state: _MET if judge(state) else _BROKEN  # noqa: E731
            case Next(part):
                owed = (1 << self._add(part),)
                way = lambda state: owed  # noqa: E731
            case Both(left, right):
                a, b = self._ways[self._add(left)], self._ways[self._add(right)]
                way = lambda state: _each(a(state), b(state))  # noqa: E731
            case Either(left, right):
                a, b = self._ways[self._add(left)], self._ways[self._add(right)]
                way = lambda state: _least(a(state) + b(state))  # noqa: E731
            case Until(left, right):
                a, b = self._ways[self._add(left)], self._ways[self._add(right)]
                again = (1 << len(self._ways),)
                way = lambda state: _least(b(state) + _each(a(state), again))  # noqa: E731
            case Release(left, right):
                a, b = self._ways[self._add(left)], self._ways[self._add(right)]
                again = (1 << len(self._ways),)
                way = lambda state: _each(b(state), _least(a(state) + again))  # noqa: E731
        self._formulas.append(formula)
        self._ways.append(way)
        return len(self._ways) - 1


_MET: tuple[Obligations, ...] = (0,)
_BROKEN: tuple[Obligations, ...] = ()


def _each(left: tuple[Obligations, ...], right: tuple[Obligations, ...]) -> tuple[Obligations, ...]:
    """Meeting both sides: every way of one with every way of the other."""
    if left == _MET:
        return right
    return _least(tuple(a | b for a in left for b in right))


def _least(ways: tuple[Obligations, ...]) -> tuple[Obligations, ...]:
    """In order and without the ways that owe more than another one does."""
    if len(ways) < 2:
        return ways
    distinct = sorted(set(ways))
    return tuple(way for way in distinct if not any(other != way and other & way == other for other in distinct))
