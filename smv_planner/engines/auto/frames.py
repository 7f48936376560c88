"""Property-directed reachability: clauses that hold whatever happens, found by generalising why states are out of reach.

Frames of clauses over-approximate what can follow within so many steps. A state that could meet the goals is followed
backwards, from frame to frame, until it is found out of reach, and the reason becomes a clause (Bradley 2011, Een and
others 2011). When two frames agree, their clauses are an inductive proof. What the formula still asks for is part of the
state: one obligation for each subformula that may be put off, in the numbering of `ltl.Monitor`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from heapq import heappop, heappush
from itertools import count

from smv_planner.clock import look
from smv_planner.engines.auto.bounded import Layer, question, step, value_in
from smv_planner.engines.auto.grounding import Ground, alternatives
from smv_planner.engines.sat import Clauses, Coding
from smv_planner.model.domains import Value
from smv_planner.model.expressions import conjuncts
from smv_planner.model.ltl import Atom, Both, Either, Formula, Next, Release, Until
from smv_planner.problem import Clause, Inductive, Problem

Fact = tuple[str, Value] | int
"""A variable has a value; or, as a number, an obligation is not owed."""

Cube = tuple[Fact, ...]
"""States in which all these facts hold."""


def numbered(formula: Formula) -> list[tuple[Formula, tuple[int, ...]]]:
    """Every subformula after its parts, with the numbers of its parts; the order of `ltl.Monitor`."""
    found: list[tuple[Formula, tuple[int, ...]]] = []

    def add(node: Formula) -> int:
        match node:
            case Atom():
                parts: tuple[int, ...] = ()
            case Next(part):
                parts = (add(part),)
            case Both(left, right) | Either(left, right) | Until(left, right) | Release(left, right):
                parts = (add(left), add(right))
        found.append((node, parts))
        return len(found) - 1

    add(formula)
    return found


def owable(formulas: list[tuple[Formula, tuple[int, ...]]]) -> list[int]:
    """The numbers of what may be left to the next state, and of the formula itself."""
    whole = {len(formulas) - 1}
    later = {number for number, (formula, _) in enumerate(formulas) if isinstance(formula, Until | Release)}
    return sorted(whole | later | {parts[0] for formula, parts in formulas if isinstance(formula, Next)})


class Expansion:
    """What obligations come to now, as literals: with `later` what they leave for the next state, else by idling."""

    def __init__(self, clauses: Clauses, coding: Coding, formulas: list[tuple[Formula, tuple[int, ...]]]) -> None:
        self._clauses, self._coding, self._formulas = clauses, coding, formulas

    def idling(self, number: int) -> int:
        formula, parts = self._formulas[number]
        match formula:
            case Atom(predicate):
                return self._coding.literal(predicate)
            case Both():
                return self._clauses.every(self.idling(part) for part in parts)
            case Either():
                return self._clauses.any([self.idling(part) for part in parts])
            case Next() | Until() | Release():
                return self.idling(parts[-1])

    def now(self, number: int, later: dict[int, int]) -> int:
        formula, parts = self._formulas[number]
        match formula:
            case Atom(predicate):
                return self._coding.literal(predicate)
            case Next():
                return later[parts[0]]
        left, right = (self.now(part, later) for part in parts)
        both, either = self._clauses.every, self._clauses.any
        match formula:
            case Both():
                return both([left, right])
            case Either():
                return either([left, right])
            case Until():
                return either([right, both([left, later[number]])])
            case Release():
                return both([right, either([left, later[number]])])
        raise AssertionError(formula)


class Frames:
    """The search for one problem's proof."""

    def __init__(self, of: Ground, problem: Problem) -> None:
        self._of, self._problem = of, problem
        self._names = [variable.name for variable in of.system.variables]
        formulas = numbered(question(problem))
        self._owable = owable(formulas)
        self._usable = of.usable(problem.unusable)
        self._start: dict[Fact, bool] = {}
        self._begin(formulas)
        self._lifting = _Lifting(of, problem, formulas, self._usable)
        self._frames: list[list[Cube]] = [[], []]
        self._turn = count()

    def _begin(self, formulas: list[tuple[Formula, tuple[int, ...]]]) -> None:
        clauses = self._clauses = Clauses()
        actions = self._of.actions
        usable = [clauses.true if self._usable >> at & 1 else -clauses.true for at in range(len(actions))]
        self._before = Layer(clauses, self._of.system, actions, usable)
        self._after = Layer(clauses, self._of.system, actions, usable)
        step(clauses, actions, usable, self._before, self._after)
        for layer in (self._before, self._after):
            for invariant in self._problem.allowed:
                for part in conjuncts(invariant.predicate):
                    look()
                    clauses.add(*map(layer.coding.literal, alternatives(part)))
        self._owed = {number: clauses.new() for number in self._owable}
        self._left = {number: clauses.new() for number in self._owable}
        expansion = Expansion(clauses, self._before.coding, formulas)
        for number, owed in self._owed.items():
            clauses.add(-owed, self._before.idle, expansion.now(number, self._left))
            clauses.add(-owed, -self._before.idle, expansion.idling(number))
        self._levels = [clauses.new(), clauses.new()]
        state = self._of.system.named(self._problem.initial)
        self._initial = frozenset[Fact]([*state.items(), *(n for n in self._owable if n != len(formulas) - 1)])
        facts: list[Fact] = [*state.items(), *self._owable]
        for fact in facts:
            holds = fact in self._initial
            literal = self._literal(fact, now=True)
            clauses.add(-self._levels[0], literal if holds else -literal)

    def work(self) -> int:
        """How much the search has taken so far, as the solvers count it."""
        return self._clauses.solver.work() + self._lifting.work()

    def proof(self) -> Iterator[Inductive | int]:
        """Look for a proof bit by bit; yields how many steps are known not to do. Ends if there is a plan."""
        top = 1
        while True:
            while (cube := self._goal(top)) is not None:
                for blocked in self._block(cube, top):
                    if not blocked:
                        return
                    yield top
            self._frames.append([])
            self._levels.append(self._clauses.new())
            for level in range(1, top + 1):
                for kept in list(self._frames[level]):
                    if isinstance(self._follows(kept, level + 1), frozenset):
                        self._frames[level].remove(kept)
                        self._add(kept, level + 1)
                    yield top
                if not self._frames[level]:
                    cubes = [cube for frame in self._frames[level + 1 :] for cube in frame]
                    yield Inductive(tuple(map(_clause, cubes)))
                    return
            top += 1

    def _goal(self, level: int) -> Cube | None:
        """Some states of a frame that meet the goals by idling."""
        if not self._clauses.solve([*self._levels[level:], self._before.idle]):
            return None
        state, owed, _ = self._model()
        return self._lifting.idling(state, owed)

    def _block(self, cube: Cube, top: int) -> Iterator[bool]:
        """Show that a cube is out of reach within `top` steps, one cube after the other; False if it is not."""
        waiting = [(top, next(self._turn), cube)]
        while waiting:
            level, _, cube = heappop(waiting)
            if level == 0 or self._initial.issuperset(cube):
                yield False
                return
            found = self._follows(cube, level)
            if isinstance(found, frozenset):
                general = self._generalised(tuple(fact for fact in cube if fact in found), cube, level)
                while level < top and isinstance(self._follows(general, level + 1), frozenset):
                    level += 1
                self._add(general, level)
                if level < top:
                    heappush(waiting, (level + 1, next(self._turn), cube))
            else:
                heappush(waiting, (level - 1, next(self._turn), found))
                heappush(waiting, (level, next(self._turn), cube))
            yield True

    def _follows(self, cube: Cube, level: int) -> Cube | frozenset[Fact]:
        """A cube of the frame before from which a step leads into `cube`; if there is none, facts that are the reason."""
        solver = self._clauses.solver
        elsewhere = self._clauses.new()
        self._clauses.add(-elsewhere, *(-self._literal(fact, now=True) for fact in cube))
        literals = {self._literal(fact, now=False): fact for fact in cube}
        assumptions = [elsewhere, *self._levels[level - 1 :], -self._before.idle, *literals]
        if self._clauses.solve(assumptions):
            state, owed, action = self._model()
            self._clauses.add(-elsewhere)
            return self._lifting.step(state, owed, action, cube)
        core = solver.core()
        self._clauses.add(-elsewhere)
        return frozenset(literals[literal] for literal in core if literal in literals)

    def _generalised(self, core: Cube, cube: Cube, level: int) -> Cube:
        """As few facts as will do, without the initial state."""
        if self._initial.issuperset(core):
            core = (*core, next(fact for fact in cube if fact not in self._initial))
        for fact in core:
            if fact not in core:
                continue
            fewer = tuple(other for other in core if other != fact)
            if self._initial.issuperset(fewer):
                continue
            found = self._follows(fewer, level)
            if isinstance(found, frozenset):
                smaller = tuple(other for other in fewer if other in found)
                core = fewer if self._initial.issuperset(smaller) else smaller
        return core

    def _add(self, cube: Cube, level: int) -> None:
        facts = frozenset(cube)
        for frame in self._frames[1 : level + 1]:
            frame[:] = [other for other in frame if not facts.issubset(other)]
        self._frames[level].append(cube)
        self._clauses.add(-self._levels[level], *(-self._literal(fact, now=True) for fact in cube))

    def _literal(self, fact: Fact, now: bool) -> int:
        if isinstance(fact, int):
            return -(self._owed if now else self._left)[fact]
        name, value = fact
        return (self._before if now else self._after).values[name][value]

    def _model(self) -> tuple[dict[str, Value], list[int], int | None]:
        true = frozenset(self._clauses.solver.model())
        state = {name: value_in(self._before.values[name], true) for name in self._names}
        action = next((at for at, literal in enumerate(self._before.steps) if literal in true), None)
        return state, [number for number, literal in self._owed.items() if literal in true], action


class _Lifting:
    """Which facts of a state make something follow from it: an unsatisfiable core over clauses about a single state."""

    def __init__(self, of: Ground, problem: Problem, formulas: list[tuple[Formula, tuple[int, ...]]], usable: int) -> None:
        self._of = of
        self._clauses = Clauses()
        usables = [self._clauses.true if usable >> at & 1 else -self._clauses.true for at in range(len(of.actions))]
        self._layer = Layer(self._clauses, of.system, of.actions, usables)
        self._coding = self._layer.coding
        self._expansion = Expansion(self._clauses, self._coding, formulas)
        self._owable = owable(formulas)

    def work(self) -> int:
        return self._clauses.solver.work()

    def idling(self, state: dict[str, Value], owed: list[int]) -> Cube:
        return self._needed(state, owed, [self._layer.settled, *map(self._expansion.idling, owed)])

    def step(self, state: dict[str, Value], owed: list[int], at: int | None, into: Cube) -> Cube:
        """The facts by which an action leads from a state into a cube."""
        assert at is not None
        action = self._of.actions[at]
        reasons = [self._coding.literal(part) for part in (*action.conditions, *self._of.keeps[at])]
        reasons.append(self._layer.first[at] if action.transition.kind.automatic else self._layer.settled)
        never = {fact for fact in into if isinstance(fact, int)}
        later = {n: -self._clauses.true if n in never else self._clauses.true for n in self._owable}
        reasons += [self._expansion.now(number, later) for number in owed]
        for fact in into:
            if not isinstance(fact, int):
                name, value = fact
                if name in action.assigned:
                    reasons.append(self._coding.table(action.assigned[name])[value])
                else:
                    reasons.append(self._layer.values[name][value])
        return self._needed(state, owed, reasons)

    def _needed(self, state: dict[str, Value], owed: list[int], reasons: Iterable[int]) -> Cube:
        facts = {self._layer.values[name][value]: (name, value) for name, value in state.items()}
        otherwise = self._clauses.any([-reason for reason in reasons])
        holds = self._clauses.solve([*facts, otherwise])
        assert not holds, "a state has the facts that it was found with"
        core = frozenset(self._clauses.solver.core())
        not_owed = (number for number in self._owable if number not in owed)
        return (*(fact for literal, fact in facts.items() if literal in core), *not_owed)


def _clause(cube: Cube) -> Clause:
    differs = tuple(fact for fact in cube if not isinstance(fact, int))
    return Clause(differs, tuple(fact for fact in cube if isinstance(fact, int)))
