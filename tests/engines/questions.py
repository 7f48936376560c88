"""Small questions made by hand, each about one corner of the meaning, with the length of the shortest plan."""

from __future__ import annotations

from dataclasses import replace
from random import Random

from smv_planner.model import ltl
from smv_planner.model.domains import Bool, Domain, Enum, Range, Value
from smv_planner.model.expressions import (
    FALSE,
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
    negation,
)
from smv_planner.model.ltl import Atom, Formula
from smv_planner.model.semantics import Steps
from smv_planner.model.system import Any, Assignment, Invariant, Kind, System, Transition, Variable, VariableKind
from smv_planner.problem import Goal, Problem

Actions = dict[str, Value | Expr | Any]


def is_(variable: str, value: Value) -> Expr:
    return equality(Var(variable), Const(value))


def step(name: str, guard: Expr, actions: Actions, kind: Kind = Kind.CONTROLLED) -> Transition:
    """A transition whose values may be plain."""
    assigned = {v: Const(x) if isinstance(x, (bool, int, str)) else x for v, x in actions.items()}
    return Transition(name, kind, guard, tuple(Assignment(v, x) for v, x in assigned.items()))


def auto(name: str, guard: Expr, actions: Actions) -> Transition:
    return step(name, guard, actions, Kind.AUTOMATIC)


def ask(
    variables: dict[str, tuple[Domain, Value]],
    transitions: list[Transition],
    *goals: Expr | Goal,
    never: Expr = FALSE,
    unusable: tuple[str, ...] = (),
    bound: int = 12,
) -> Problem:
    declared = tuple(Variable(n, VariableKind.ESTIMATED, domain, value) for n, (domain, value) in variables.items())
    invariants = () if never == FALSE else (Invariant("never", negation(never)),)
    system = System(declared, tuple(transitions), invariants)
    wanted = tuple(goal if isinstance(goal, Goal) else Goal(goal) for goal in goals)
    return Problem(system, system.initial, wanted, invariants, frozenset(unusable), bound)


N03, FLAG, WORDS = Range(0, 3), Bool(), Enum(("a", "b", "c"))
N = Var("n")
up, down = step("up", TRUE, {"n": Plus(N, Const(1))}), step("down", TRUE, {"n": Minus(N, Const(1))})
lamp = [step("on", TRUE, {"lamp": True}), step("off", TRUE, {"lamp": False})]
LAMP, TWO = Var("lamp"), {"n": (N03, 0), "lamp": (FLAG, False)}


FULL = is_("n", 3)


def walk(until: Formula, goal: Expr = FULL) -> Problem:
    """A counter and a lamp, from 0 and off."""
    return ask(TWO, [up, down, *lamp], Goal(goal, until))


LIT, DARK = Atom(LAMP), Atom(negation(LAMP))
AT = [Atom(is_("n", value)) for value in range(4)]

QUESTIONS: dict[str, tuple[Problem, int | None]] = {
    # integers
    "up to the border": (ask({"n": (N03, 0)}, [up], is_("n", 3)), 3),
    "not beyond the border": (ask({"n": (N03, 3)}, [up], negation(is_("n", 3))), None),
    "down to the border": (ask({"n": (Range(-2, 1), 1)}, [down], is_("n", -2)), 3),
    "not below the border": (ask({"n": (Range(-2, 1), -2)}, [down], Less(Const(-2), N)), None),
    "over the border from a sum": (
        ask(
            {"n": (N03, 2), "m": (Range(0, 9), 2)},
            [step("add", TRUE, {"n": Plus(N, Var("m"))}), step("less", TRUE, {"m": 1})],
            is_("n", 3),
        ),
        2,
    ),
    "a difference of negative numbers": (
        ask({"n": (Range(-3, 3), -3)}, [step("flip", Less(N, Const(-1)), {"n": Minus(Const(-1), N)})], is_("n", 2)),
        1,
    ),
    "one variable into a smaller one": (
        ask(
            {"n": (N03, 0), "m": (Range(2, 5), 5)},
            [step("copy", TRUE, {"n": Var("m")}), step("less", TRUE, {"m": Minus(Var("m"), Const(1))})],
            is_("n", 3),
        ),
        3,
    ),
    "a word that the other domain lacks": (
        ask(
            {"w": (WORDS, "a"), "v": (Enum(("x", "c")), "x")},
            [step("copy", TRUE, {"w": Var("v")}), step("set", TRUE, {"v": "c"})],
            is_("w", "c"),
        ),
        2,
    ),
    "a choice between values": (
        ask(TWO, [step("set", TRUE, {"n": If(LAMP, Const(3), Plus(N, Const(2)))}), *lamp], is_("n", 3), never=is_("n", 2)),
        2,
    ),
    "an invariant on a sum": (ask(TWO | {"m": (N03, 3)}, [up], is_("n", 3), never=equality(Plus(N, Var("m")), Const(5))), None),
    # one value, no steps
    "a domain of one word": (
        ask(TWO | {"w": (Enum(("a",)), "a")}, [step("go", is_("w", "a"), {"w": "a", "lamp": True})], LAMP),
        1,
    ),
    "a domain of one number": (ask({"n": (Range(3, 3), 3), "m": (N03, 0)}, [step("go", TRUE, {"m": N})], is_("m", 3)), 1),
    "a domain of one number is never left": (ask({"n": (Range(3, 3), 3)}, [up], negation(is_("n", 3))), None),
    "no transitions, goal holds": (ask(TWO, [], is_("n", 0)), 0),
    "no transitions, goal does not hold": (ask(TWO, [], LAMP), None),
    "no transition that can ever fire": (ask(TWO, [step("go", FALSE, {"lamp": True}), step("stay", TRUE, {})], LAMP), None),
    "a transition that changes nothing": (ask(TWO, [step("stay", TRUE, {"n": N})], LAMP), None),
    "a goal that always holds": (ask(TWO, [up], TRUE), 0),
    "no goal": (ask(TWO, [up]), 0),
    "an unusable transition": (ask(TWO, [up, *lamp], LAMP, unusable=("on",)), None),
    # any
    "the planner chooses": (ask({"w": (WORDS, "a")}, [step("set", TRUE, {"w": Any()})], is_("w", "c")), 1),
    "the planner chooses numbers": (ask({"n": (Range(-2, 3), 0)}, [step("set", TRUE, {"n": Any()})], is_("n", -2)), 1),
    "choosing must change something": (
        ask(
            TWO | {"done": (FLAG, False)},
            [step("set", TRUE, {"lamp": Any()}), auto("count", LAMP, {"n": Plus(N, Const(1)), "lamp": False})],
            is_("n", 2),
        ),
        4,
    ),
    "choosing together with a value": (
        ask(TWO, [step("both", TRUE, {"n": Any(), "lamp": True})], conjunction([LAMP, is_("n", 0)])),
        1,
    ),
    "choosing nothing new with a value that stays": (
        ask(
            {"n": (N03, 0), "lamp": (FLAG, True)},
            [step("both", TRUE, {"n": Any(), "lamp": True})],
            conjunction([LAMP, is_("n", 0)]),
            Goal(is_("n", 1)),
        ),
        1,
    ),
    # automatic transitions
    "automatic steps count": (
        ask(
            TWO,
            [auto("first", conjunction([LAMP, is_("n", 0)]), {"n": 1}), auto("second", is_("n", 1), {"n": 2}), *lamp],
            is_("n", 2),
        ),
        3,
    ),
    "the first automatic one wins": (
        ask(
            TWO,
            [
                *lamp,
                auto("first", conjunction([LAMP, is_("n", 0)]), {"n": 1}),
                auto("second", conjunction([LAMP, is_("n", 0)]), {"n": 2}),
            ],
            is_("n", 2),
        ),
        None,
    ),
    "goals count in settled states only": (
        ask(TWO, [*lamp, auto("away", conjunction([LAMP, is_("n", 0)]), {"n": 1, "lamp": False})], LAMP),
        3,
    ),
    "a start that is not settled": (ask(TWO, [auto("go", is_("n", 0), {"n": 1}), up], is_("n", 2)), 2),
    "a goal that holds at an unsettled start only": (ask(TWO, [auto("go", is_("n", 0), {"n": 1}), up], is_("n", 0)), None),
    "automatic steps that never settle": (
        ask(TWO, [auto("flip", TRUE, {"lamp": If(LAMP, FALSE, TRUE)}), up], is_("n", 1)),
        None,
    ),
    "automatic steps that never settle, goal holds": (
        ask(TWO, [auto("flip", TRUE, {"lamp": If(LAMP, FALSE, TRUE)})], is_("n", 0)),
        None,
    ),
    "twenty automatic ones in order": (
        ask(
            {"n": (Range(0, 20), 0)},
            [auto(f"a{at}", disjunction([is_("n", at), is_("n", at + 1)]), {"n": at + 1}) for at in range(20)],
            is_("n", 20),
            bound=25,
        ),
        20,
    ),
    # goals and invariants
    "already there": (walk(ltl.ALWAYS_TRUE, is_("n", 0)), 0),
    "several goals, one after the other": (ask(TWO, [up, down], is_("n", 2), is_("n", 0)), 2),
    "several goals that exclude each other": (ask(TWO, [up, down, *lamp], is_("n", 2), conjunction([LAMP, is_("n", 0)])), 3),
    "an invariant in the way": (ask(TWO, [up, *lamp, step("jump", LAMP, {"n": 3})], is_("n", 3), never=is_("n", 1)), 2),
    "an invariant through an automatic step": (
        ask(TWO, [*lamp, auto("go", LAMP, {"n": 3, "lamp": False}), up], is_("n", 3), never=LAMP),
        3,
    ),
    "a named predicate": (ask(TWO, [up], Named("full", negation(Less(N, Const(2))))), 2),
    "exactly the bound": (ask({"n": (N03, 0)}, [up], is_("n", 3), bound=3), 3),
    "one beyond the bound": (ask({"n": (N03, 0)}, [up], is_("n", 3), bound=2), None),
    "bound zero": (ask({"n": (N03, 0)}, [up], is_("n", 0), bound=0), 0),
    # formulas
    "until": (walk(DARK), 3),
    "until, with a detour": (walk(ltl.Until(DARK, LIT)), 4),
    "eventually before": (walk(ltl.eventually(LIT)), 4),
    "eventually may come after": (walk(ltl.eventually(Atom(conjunction([LAMP, is_("n", 2)]))), is_("n", 1)), 3),
    "always": (walk(ltl.always(DARK), is_("n", 2)), 2),
    "always, after the goal too": (walk(ltl.always(Atom(negation(is_("n", 2)))), is_("n", 3)), None),
    "always eventually": (walk(ltl.always(ltl.eventually(LIT)), is_("n", 1)), 2),
    "eventually always": (walk(ltl.eventually(ltl.always(LIT)), is_("n", 1)), 2),
    "always, the goal in an unfit state": (walk(ltl.always(ltl.Either(LIT, AT[0])), is_("n", 1)), 2),
    "next": (walk(ltl.Either(ltl.Next(LIT), LIT), is_("n", 1)), 2),
    "next at the end": (walk(ltl.Next(ltl.Next(ltl.Next(AT[1]))), is_("n", 1)), 1),
    "next again and again": (walk(ltl.Next(ltl.Next(ltl.Next(LIT))), is_("n", 1)), 2),
    "release": (walk(ltl.Release(LIT, AT[0]), is_("n", 1)), 2),
    "release for ever": (walk(ltl.Release(ltl.ALWAYS_FALSE, ltl.Either(DARK, AT[3]))), 3),
    "weak until": (walk(ltl.weak_until(DARK, AT[2]), conjunction([LAMP, is_("n", 3)])), 4),
    "weak until, never released": (walk(ltl.weak_until(DARK, ltl.ALWAYS_FALSE), is_("n", 2)), 2),
    "nested until": (walk(ltl.Until(ltl.Until(DARK, LIT), AT[2]), is_("n", 3)), 4),
    "until and always": (walk(ltl.Both(ltl.eventually(LIT), ltl.always(ltl.Either(DARK, AT[1]))), is_("n", 3)), 6),
    "a formula over an unsettled state": (
        ask(TWO, [*lamp, auto("go", LAMP, {"n": 3, "lamp": False})], Goal(is_("n", 3), ltl.eventually(LIT))),
        2,
    ),
}


def wide(seed: int) -> Problem:
    """Far more transitions, automatic ones, invariants and steps that assign one variable than fit beside each other."""
    random = Random(seed)
    names = [f"r{number}" for number in range(30)]
    places = range(40)

    def about() -> Expr:
        return is_(random.choice(names), random.choice((0, 0, 0, 1, 2)))

    def here() -> Expr:
        return is_("hub", random.choice(places))

    steps = []
    for number in range(900):
        kind = Kind.AUTOMATIC if random.random() < 0.5 else Kind.CONTROLLED
        to = If(about(), Const(random.choice(places)), Const(random.choice(places)))
        actions: Actions = {"hub": to} if random.random() < 0.6 else {random.choice(names): random.randrange(4)}
        rarely = is_(random.choice(names), random.choice((1, 2))) if kind is Kind.AUTOMATIC else about()
        steps.append(step(f"t{number}", conjunction([here(), about(), rarely]), actions, kind))
    variables: dict[str, tuple[Domain, Value]] = dict.fromkeys(names, (N03, 0)) | {"hub": (Range(0, 39), 0)}
    problem = ask(variables, steps, bound=5)
    moves = Steps(problem.system, problem.usable)
    state = problem.initial
    for _ in range(random.randint(2, 6)):
        state = random.choice([after for _, after in moves(state)] or [state])
    goal = conjunction(is_(name, value) for name, value in zip(variables, state, strict=True) if value)
    never = (negation(conjunction([about(), here(), is_(random.choice(names), 3)])) for _ in range(300))
    return replace(problem, goals=(Goal(goal),), allowed=tuple(Invariant(f"i{at}", each) for at, each in enumerate(never)))


def vast(transitions: int, variables: int) -> Problem:
    """A great many simple transitions; the goal takes two of them."""
    names = [f"r{number}" for number in range(variables)]
    steps = []
    for number in range(transitions):
        to, turn = number % variables, number // variables % 4
        beside = is_(names[(to + 1) % variables], (turn + 1) % 4)
        steps.append(step(f"t{number}", disjunction([beside, is_(names[to * 7 % variables], 0)]), {names[to]: turn}))
    wanted = conjunction([is_(names[3], 2), is_(names[variables // 2], 1)])
    never = conjunction(negation(is_(name, 3)) for name in names)
    return ask(dict.fromkeys(names, (N03, 0)), steps, wanted, never=negation(never), bound=3)
