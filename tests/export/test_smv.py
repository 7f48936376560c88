"""The SMV text: what it says, what it must never contain, and which traces are taken for plans."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest
from engines.questions import QUESTIONS
from export.corpus import march, names
from export.relex import KEYWORDS, SECTIONS, balanced, comments, depth, words
from generated import question

from smv_planner.errors import EngineError
from smv_planner.export.names import Sort, original
from smv_planner.export.smv import DONE, IDLE, STEP, Encoding, RawTrace, encode
from smv_planner.model import ltl
from smv_planner.model.domains import Bool, Enum, Range, Value
from smv_planner.model.expressions import (
    TRUE,
    Const,
    Expr,
    Less,
    Named,
    Plus,
    Var,
    conjunction,
    disjunction,
    equality,
    negation,
    nodes,
)
from smv_planner.model.ltl import Atom
from smv_planner.model.system import Any, Assignment, Invariant, Kind, System, Transition, Variable, VariableKind
from smv_planner.problem import Goal, Problem, Reached

INTERNAL = {"step", "idle", "done", "settled", "none"}
HOSTILE = [names()[at : at + 60] for at in range(0, len(names()), 60)]


def door() -> Problem:
    """A door that is unlocked, opens by itself or is pushed by a person, wears, and must not move locked."""
    lock, locked, wear = Var("door.lock"), Var("door.locked"), Var("door.wear")
    ref, pos = Var("door.ref"), Var("door.pos")
    moving = Named("door.moving", negation(equality(ref, pos)))
    variables = (
        Variable("door.ref", VariableKind.GOAL, Enum(("closed", "opened")), "closed"),
        Variable("door.pos", VariableKind.MEASURED, Enum(("closed", "opened", "jammed")), "closed"),
        Variable("door.lock", VariableKind.GOAL, Bool(), True),
        Variable("door.locked", VariableKind.MEASURED, Bool(), True),
        Variable("door.wear", VariableKind.ESTIMATED, Range(0, 3), 0),
        Variable("variant-2", VariableKind.DECISION, Enum(("left", "right")), "left"),
    )

    def transition(name: str, kind: Kind, guard: list[Expr], variable: str, value: Value | Expr | Any) -> Transition:
        assigned = Const(value) if isinstance(value, (bool, int, str)) else value
        return Transition(name, kind, conjunction(guard), (Assignment(variable, assigned),))

    closed, opened = equality(pos, Const("closed")), equality(pos, Const("opened"))
    transitions = (
        transition("door.unlock", Kind.CONTROLLED, [lock, negation(moving)], "door.lock", False),
        transition("door.open", Kind.CONTROLLED, [negation(locked), closed], "door.ref", "opened"),
        transition("door.unlocked", Kind.EFFECT, [negation(lock), locked], "door.locked", False),
        transition("door.opens", Kind.EFFECT, [moving], "door.pos", ref),
        transition("door.push", Kind.MAINTENANCE, [equality(Var("variant-2"), Const("left"))], "door.pos", Any()),
        transition("worn", Kind.AUTOMATIC, [opened, negation(moving), Less(wear, Const(2))], "door.wear", Plus(wear, Const(1))),
    )
    invariants = (Invariant("never_move_locked", negation(conjunction([moving, locked]))),)
    system = System(variables, transitions, invariants)
    return Problem(system, system.initial, (Goal(opened, ltl.always(Atom(negation(locked)))), Goal(closed)), invariants, bound=20)


def test_a_door_reads_well(golden) -> None:
    encoding = encode(door())
    golden(Path(__file__).with_name("door.smv"), encoding.text)
    golden(Path(__file__).with_name("door.cmd"), encoding.script)


def test_the_same_problem_gives_the_same_text() -> None:
    assert encode(door()).text == encode(door()).text


@pytest.mark.parametrize(
    "problem", [door(), *map(question, range(80)), *map(march, HOSTILE), *(p for p, _ in QUESTIONS.values())]
)
def test_a_text_holds_known_names_and_expected_sections_only(problem: Problem) -> None:
    encoding = encode(problem)
    found = words(encoding.text)
    known = known_names(problem)
    for word in found.keys() - KEYWORDS:
        sort, name = original(word)
        assert name in known[sort] or (sort is Sort.INTERNAL and internal(name, problem)), word
    assigned = {action.variable for t in problem.usable for action in t.actions}
    defines = [word for word in found if original_sort(word) in (Sort.PREDICATE, Sort.PROPERTY)]
    automatic = any(t.kind.automatic for t in problem.usable)
    assert {section: found[section] for section in SECTIONS} == {
        **dict.fromkeys(("MODULE", "VAR", "IVAR", "ASSIGN", "LTLSPEC"), 1),
        "FROZENVAR": int(len(assigned) < len(problem.system.variables)),
        "DEFINE": int(bool(problem.usable or defines)),
        "INIT": 0,
        "TRANS": (len(problem.usable) or 1) + automatic + 1,
        "INVAR": sum(invariant.predicate != TRUE for invariant in problem.allowed),
    }
    assert found["init"] == len(problem.system.variables) + 1
    assert balanced(encoding.text)
    assert comments(encoding.text) == comments(encode(door()).text), "comments are fixed"


def known_names(problem: Problem) -> dict[Sort, set[str]]:
    system = problem.system
    actions = [action for t in system.transitions for action in t.actions]
    expressions = [
        *(t.guard for t in system.transitions),
        *(action.value for action in actions if not isinstance(action.value, Any)),
        *(invariant.predicate for invariant in problem.allowed),
        *ltl.atoms(problem.formula),
    ]
    return {
        Sort.VARIABLE: set(system.index),
        Sort.VALUE: {word for domain in system.domains.values() if isinstance(domain, Enum) for word in domain.words},
        Sort.PREDICATE: {node.name for expr in expressions for node in nodes(expr) if isinstance(node, Named)},
        Sort.TRANSITION: {t.name for t in problem.usable},
        Sort.PROPERTY: {invariant.name for invariant in problem.allowed},
        Sort.INTERNAL: INTERNAL,
        Sort.MODULE: set(),
    }


def internal(name: str, problem: Problem) -> bool:
    kind, _, rest = name.partition(".")
    return rest in {t.name for t in problem.usable} if kind == "ready" else kind == "any" and rest.isdigit()


def original_sort(word: str) -> Sort | None:
    return None if word in KEYWORDS else original(word)[0]


def counter(transitions: int) -> Problem:
    """Many transitions, many of which assign the same variable, half of them automatic; and one wide invariant."""
    width = transitions // 8
    variables = tuple(Variable(f"r{at}", VariableKind.ESTIMATED, Range(0, 9), 0) for at in range(width))
    assigned = [f"r{at % width}" if at % 2 else "r0" for at in range(transitions)]
    steps = tuple(
        Transition(
            f"t{at}",
            Kind.AUTOMATIC if at % 2 else Kind.CONTROLLED,
            equality(Var(f"r{at % width}"), Const(at % 9)),
            (Assignment(name, Const(at % 9 + 1) if at % 4 else Plus(Var(name), Const(at % 7 - 3))),),
        )
        for at, name in enumerate(assigned)
    )
    wide = Invariant("wide", disjunction(equality(Var(v.name), Const(at % 9)) for at, v in enumerate(variables)))
    system = System(variables, steps, (wide,))
    return Problem(system, system.initial, (Goal(equality(Var("r1"), Const(9))),), (wide,), bound=2)


def test_text_stays_shallow_however_wide_the_problem_is() -> None:
    text = encode(counter(8_000)).text
    assert depth(text) < 20
    assert words(text)["TRANS"] < 300
    longest = max(re.findall(r"case\n(.*?)esac", text, re.DOTALL), key=len)
    assert longest.count("\n") < 300


def test_predicates_of_one_name_and_two_meanings_are_told_apart() -> None:
    variables = tuple(Variable(name, VariableKind.ESTIMATED, Bool(), False) for name in "ab")
    system = System(variables, (), ())
    goal = conjunction([Named("p", Var("a")), negation(Named("p", Var("b")))])
    text = encode(Problem(system, system.initial, (Goal(goal),), ())).text
    assert "d_p := v_a;" in text
    assert "F (d_p & !v_b)" in text


def encoded() -> tuple[Encoding, RawTrace]:
    """A question and the trace that answers it."""
    problem = replace(door(), goals=(Goal(equality(Var("door.lock"), Const(False))),))
    encoding = encode(problem)
    state = {"v_door__ref": "k_closed", "v_door__pos": "k_closed", "v_door__lock": "TRUE", "v_door__locked": "TRUE"}
    state |= {"v_door__wear": "0", "v__variantzm2": "k_left", DONE: "FALSE", "x_settled": "TRUE"}
    unlocked = state | {"v_door__lock": "FALSE"}
    states = (state, unlocked, unlocked | {DONE: "TRUE"})
    return encoding, RawTrace(states, ({STEP: "t_door__unlock"}, {STEP: IDLE}))


def test_a_trace_is_read_as_the_plan_it_shows() -> None:
    encoding, trace = encoded()
    initial = encoding.problem.initial
    after = (*initial[:2], False, *initial[3:])
    assert encoding.decode(trace) == Reached(("door.unlock",), (initial, after))


def test_no_trace_with_a_foreign_name_value_or_length_is_read() -> None:
    encoding, trace = encoded()
    first, second, last = trace.states
    step, idle = trace.inputs

    def without(state: dict[str, str], name: str) -> dict[str, str]:
        return {key: value for key, value in state.items() if key != name}

    wrong = {
        "nothing": RawTrace((), ()),
        "no states": RawTrace((), trace.inputs),
        "one state too few": RawTrace((first, last), trace.inputs),
        "one input too few": RawTrace(trace.states, (step,)),
        "no idling": RawTrace((first, second), (step,)),
        "too long": RawTrace((first,) * 30, (step,) * 28 + (idle,)),
        "longer than asked for": RawTrace((first,) * 22 + (first | {DONE: "TRUE"},), (step,) * 21 + (idle,)),
        "moving after idling": RawTrace((*trace.states, second), (*trace.inputs, step)),
        "changing while idling": RawTrace((first, second, last | {"v_door__wear": "1"}), trace.inputs),
        "done too early": RawTrace((first, second | {DONE: "TRUE"}, last), trace.inputs),
        "never done": RawTrace((first, second, second), trace.inputs),
        "done is neither": RawTrace((first, second, second | {DONE: "1"}), trace.inputs),
        "done is missing": RawTrace((first, without(second, DONE), last), trace.inputs),
        "missing variable": RawTrace((first, without(second, "v_door__pos"), last), trace.inputs),
        "foreign variable": RawTrace((first | {"v_gate": "TRUE"}, second, last), trace.inputs),
        "step among the state": RawTrace((first | {STEP: IDLE}, second, last), trace.inputs),
        "another domain's value": RawTrace((first, second | {"v_door__ref": "k_jammed"}, last), trace.inputs),
        "a value unmangled": RawTrace((first, second | {"v_door__ref": "closed"}, last), trace.inputs),
        "a number for a Boolean": RawTrace((first | {"v_door__lock": "1"}, second, last), trace.inputs),
        "a number outside": RawTrace((first | {"v_door__wear": "4"}, second, last), trace.inputs),
        "a number written otherwise": RawTrace((first | {"v_door__wear": "00"}, second, last), trace.inputs),
        "an unknown transition": RawTrace(trace.states, ({STEP: "t_door__fly"}, idle)),
        "an unmangled transition": RawTrace(trace.states, ({STEP: "door.unlock"}, idle)),
        "no step": RawTrace(trace.states, ({}, idle)),
        "two inputs": RawTrace(trace.states, (step | {"x_other": "TRUE"}, idle)),
    }
    for name, raw in wrong.items():
        with pytest.raises(EngineError):
            pytest.fail(f"{name}: {encoding.decode(raw)}")


def test_an_unusable_transition_is_no_step_of_a_trace() -> None:
    encoding, trace = encoded()
    lost = encode(replace(encoding.problem, unusable=frozenset({"door.unlock"})))
    with pytest.raises(EngineError, match="t_door__unlock"):
        lost.decode(trace)
