"""What is judged once for all states that a part cannot tell apart is what is judged in each of them."""

from random import Random

from generated import question

from smv_planner.check.where import Where
from smv_planner.model.expressions import conjunction, meaning, negation
from smv_planner.model.ltl import atoms, holds, truths
from smv_planner.model.system import State


def test_predicates_hold_where_their_meaning_says() -> None:
    seen = set()
    for seed in range(100):
        random, problem = Random(seed), question(seed)
        states: list[State] = [
            tuple(random.choice(variable.domain.values) for variable in problem.system.variables) for _ in range(12)
        ]
        where = Where(problem.system, states)
        predicates = [
            *(invariant.predicate for invariant in problem.allowed),
            *atoms(problem.formula),
            *(transition.guard for transition in problem.usable),
        ]
        for predicate in (*predicates, *map(negation, predicates), conjunction(predicates)):
            judge = meaning(predicate, problem.system.index)
            expected = [bool(judge(state)) for state in states]
            assert where(predicate) == expected
            assert where.everywhere(predicate) is all(expected)
            seen.add((any(expected), all(expected)))
        assert truths(problem.formula, where)[0] is holds(problem.formula, states, problem.system.index)
    assert len(seen) == 3
