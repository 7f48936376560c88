"""Small generated planning questions: the same seed gives the same question.

Devices with commands and measurements, counters, automatic bookkeeping, invariants across devices, and goals with
formulas; small enough for a search of all states, rich enough to take detours, need a lasso, or have no answer.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from random import Random

from smv_planner.engines.sat import Predicates
from smv_planner.model import ltl
from smv_planner.model.domains import Bool, Domain, Enum, Range, Value
from smv_planner.model.expressions import (
    TRUE,
    Const,
    Expr,
    If,
    Less,
    Minus,
    Named,
    Plus,
    Var,
    conjunction,
    disjunction,
    equality,
    meaning,
    negation,
)
from smv_planner.model.ltl import Atom, Formula
from smv_planner.model.semantics import Steps
from smv_planner.model.system import Any, Assignment, Invariant, Kind, State, System, Transition, Variable, VariableKind
from smv_planner.planner.reach import Start
from smv_planner.planner.widening import widen
from smv_planner.problem import Goal, Problem

BOUND = 25


def system(seed: int) -> System:
    """A system with its invariants, whether or not its start is allowed."""
    return Maker(Random(seed)).system()


@cache
def question(seed: int) -> Problem:
    """A question whose start is allowed."""
    random = Random(seed)
    made = Maker(random)
    system = made.system()
    allowed = []
    with Predicates(system.domains) as predicates:
        for widened in widen(system, predicates.satisfiable):
            if meaning(widened.invariant.predicate, system.index)(system.initial):
                allowed.append(widened.invariant)
    kept = {invariant.name for invariant in allowed}
    system = replace(system, invariants=tuple(i for i in system.invariants if i.name in kept))
    disabled = frozenset(t.name for t in system.transitions if random.random() < 0.03)
    blank = Problem(
        system=system,
        initial=system.initial,
        goals=(),
        allowed=tuple(allowed),
        unusable=Start(system.initial, (), maintenance=random.random() < 0.3, disabled=disabled).unusable(system),
        bound=BOUND,
    )
    somewhere = wander(random, blank)
    return replace(blank, goals=tuple(made.goal(somewhere) for _ in range(random.choice((1, 1, 1, 2, 3)))))


def wander(random: Random, problem: Problem) -> State:
    """A settled state at the end of a random walk."""
    steps = Steps(problem.system, problem.usable)
    allowed = meaning(conjunction(i.predicate for i in problem.allowed), problem.system.index)
    state = problem.initial
    for _ in range(40):
        following = [after for _, after in steps(state) if allowed(after)]
        state = random.choice(following) if following else state
    return state


@dataclass
class Maker:
    random: Random

    def __post_init__(self) -> None:
        self.variables: list[Variable] = []
        self.transitions: list[Transition] = []
        self.invariants: list[Invariant] = []

    def system(self) -> System:
        random = self.random
        devices = random.choice((1, 2, 2, 3, 3, 4))
        for number in range(devices):
            self.device(f"r{number}")
        if random.random() < 0.6:
            self.counter("count")
        if random.random() < 0.7:
            self.product("part")
        for number in range(random.randint(0, 2)):
            self.invariants.append(Invariant(f"never.{number}", negation(conjunction([self.atom(), self.atom()]))))
        return System(tuple(self.variables), tuple(self.transitions), tuple(self.invariants))

    def variable(self, name: str, kind: VariableKind, domain: Domain, initial: Value | None = None) -> str:
        value = self.random.choice(domain.values) if initial is None else initial
        self.variables.append(Variable(name, kind, domain, value))
        return name

    def add(self, name: str, kind: Kind, guard: Expr, actions: dict[str, Expr | Any], expected: bool = True) -> None:
        assigned = tuple(Assignment(variable, value) for variable, value in actions.items())
        self.transitions.append(Transition(name, kind, guard, assigned, expected=expected))

    def device(self, name: str) -> None:
        """A command and a measurement that follows it, sometimes only next to another device's, sometimes wrongly."""
        random = self.random
        domain: Domain = random.choice((Bool(), Enum(("home", "left", "right")), Range(0, 3), Range(-1, 1)))
        start = domain.values[0]
        others = list(self.variables)
        ref = self.variable(f"{name}.ref", VariableKind.GOAL, domain, start)
        act = self.variable(f"{name}.act", VariableKind.MEASURED, domain, start)
        still = Named(f"{name}.still", equality(Var(ref), Var(act)))
        if random.random() < 0.25:
            self.add(f"{name}.go", Kind.CONTROLLED, still, {ref: Any()})
        else:
            for before, value in zip(domain.values, domain.values[1:], strict=False):
                guard = [still, *([equality(Var(act), Const(before))] if random.random() < 0.6 else [])]
                guard += [self.about(random.choice(others))] if others and random.random() < 0.5 else []
                self.add(f"{name}.go-{value}", Kind.CONTROLLED, conjunction(guard), {ref: Const(value)})
            if random.random() < 0.7:
                self.add(f"{name}.back", Kind.CONTROLLED, still, {ref: Const(start)})
        self.add(f"{name}.arrives", Kind.EFFECT, negation(still), {act: Var(ref)})
        if random.random() < 0.2:
            self.add(f"{name}.slips", Kind.EFFECT, self.about(self.variables[-1]), {act: Const(start)}, random.random() < 0.5)
        if random.random() < 0.3:
            self.add(f"{name}.reset", Kind.MAINTENANCE, TRUE, {act: Const(start), ref: Const(start)})

    def counter(self, name: str) -> None:
        domain = Range(0, self.random.choice((2, 3, 7)))
        self.variable(name, VariableKind.ESTIMATED, domain, 0)
        step = Plus(Var(name), Const(1)) if self.random.random() < 0.8 else Minus(Const(domain.high), Var(name))
        self.add(f"{name}.up", Kind.CONTROLLED, self.about(self.random.choice(self.variables)), {name: step})
        if self.random.random() < 0.3:
            full = equality(Var(name), Const(domain.high))
            self.add(f"{name}.full", Kind.AUTOMATIC, conjunction([full, self.atom()]), {name: Const(0)})

    def product(self, name: str) -> None:
        """Bookkeeping by automatic transitions, in a row, with one that depends on a choice."""
        domain = Enum(("raw", "held", "done"))
        self.variable(name, VariableKind.DECISION, domain, "raw")
        self.add(
            f"{name}.taken", Kind.AUTOMATIC, conjunction([equality(Var(name), Const("raw")), self.atom()]), {name: Const("held")}
        )
        value = If(self.atom(), Const("done"), Const("raw")) if self.random.random() < 0.3 else Const("done")
        self.add(
            f"{name}.made",
            Kind.AUTOMATIC,
            conjunction([equality(Var(name), Const("held")), self.atom(), self.atom()]),
            {name: value},
        )

    def about(self, variable: Variable) -> Expr:
        """Something about one variable."""
        value = self.random.choice(variable.domain.values)
        if isinstance(variable.domain, Range) and self.random.random() < 0.4:
            return (
                Less(Var(variable.name), Const(value))
                if self.random.random() < 0.5
                else negation(Less(Var(variable.name), Const(value)))
            )
        same = equality(Var(variable.name), Const(value))
        return negation(same) if self.random.random() < 0.3 else same

    def atom(self) -> Expr:
        random = self.random
        first = self.about(random.choice(self.variables))
        if random.random() < 0.2:
            return disjunction([first, self.about(random.choice(self.variables))])
        return first

    def goal(self, somewhere: State) -> Goal:
        """Mostly something that held on a walk, sometimes just anything."""
        random = self.random
        if random.random() < 0.7:
            held = [equality(Var(v.name), Const(value)) for v, value in zip(self.variables, somewhere, strict=True)]
            wanted = conjunction(random.sample(held, random.randint(1, len(held))))
        else:
            wanted = conjunction(self.about(random.choice(self.variables)) for _ in range(random.choice((1, 2))))
        return Goal(wanted, self.formula(2) if random.random() < 0.45 else ltl.ALWAYS_TRUE)

    def formula(self, depth: int) -> Formula:
        random = self.random
        if depth == 0 or random.random() < 0.2:
            return Atom(self.atom())
        part, other = self.formula(depth - 1), self.formula(depth - 1)
        return random.choice(
            (
                lambda: ltl.eventually(part),
                lambda: ltl.always(ltl.Either(part, ltl.eventually(other))),
                lambda: ltl.always(part),
                lambda: ltl.Next(part),
                lambda: ltl.Until(part, other),
                lambda: ltl.Release(part, other),
                lambda: ltl.weak_until(part, other),
                lambda: ltl.Both(part, other),
                lambda: ltl.Either(part, other),
                lambda: ltl.Either(Atom(negation(self.atom())), ltl.negated(part)),
            )
        )()
