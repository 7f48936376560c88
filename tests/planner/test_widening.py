"""Widened invariants are exact: they forbid just the states from which the system can slide into breaking one."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice, product

import generated
import generated_levels

from smv_planner.api import widened, widened_system
from smv_planner.engines.sat import Predicates
from smv_planner.model.expressions import Const, Var, conjunction, equality, meaning, negation
from smv_planner.model.model import Model
from smv_planner.model.semantics import slide
from smv_planner.model.system import Invariant, VariableKind
from smv_planner.planner.operations import tasks
from smv_planner.planner.stage import stage_system, start
from smv_planner.planner.widening import widen

SYSTEMS = 200
STATES = 3000


def test_widened_invariants_equal_a_search_of_all_states():
    grown = 0
    for seed, system in islice(with_invariants(), SYSTEMS):
        with Predicates(system.domains) as predicates:
            widened = widen(system, predicates.satisfiable)
        for one in widened:
            allows = meaning(one.invariant.predicate, system.index)
            for state in product(*(variable.domain.values for variable in system.variables)):
                safe = slide(system, [state], [one.declared.predicate]) is None
                assert allows(state) is safe, (seed, one.declared.name, state)
            grown += bool(one.growth)
    assert grown > SYSTEMS / 4, "hardly any of the generated invariants had to be widened"


def with_invariants():
    for seed in range(100_000):
        system = generated.system(seed)
        size = 1
        for variable in system.variables:
            size *= len(variable.domain.values)
        if system.invariants and size <= STATES:
            yield seed, system


def about_products(model: Model) -> Model:
    """With invariants that completions of operations may break."""
    at_rest = conjunction(equality(Var(v.name), Const(v.initial)) for v in model.variables if v.kind is VariableKind.MEASURED)
    never = (conjunction([equality(Var(v.name), Const("held")), at_rest]) for v in model.variables if v.name.startswith("part"))
    more = (Invariant(f"never.held.{at}", negation(each)) for at, each in enumerate(never))
    return replace(model, invariants=(*model.invariants, *more))


def test_what_a_stage_adds_widens_as_if_it_had_always_been_there():
    """Widening goes on from what the base's transitions do; no state more and none less than from the start."""
    further = 0
    for seed in range(40):
        two_levels = about_products(generated_levels.model(seed))
        for task in tasks(two_levels):
            system = stage_system(two_levels, start(two_levels, two_levels.system.initial, [task])[1])
            with Predicates(system.domains) as predicates:
                plain = widen(system, predicates.satisfiable)
                for one, other in zip(widened_system(system), plain, strict=True):
                    assert one.declared == other.declared
                    both = one.invariant.predicate, other.invariant.predicate
                    assert not predicates.satisfiable(both[0], negation(both[1]))
                    assert not predicates.satisfiable(negation(both[0]), both[1])
                    shared = {known.declared.name: known for known in widened(two_levels)}.get(one.declared.name)
                    further += shared is not None and one is not shared
    assert further > 20
