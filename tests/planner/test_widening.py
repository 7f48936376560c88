"""Widened invariants are exact: they forbid just the states from which the system can slide into breaking one."""

from __future__ import annotations

from itertools import islice, product

import generated

from smv_planner.engines.sat import Predicates
from smv_planner.model.expressions import meaning
from smv_planner.model.semantics import slide
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
