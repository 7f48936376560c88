"""Why there is no plan: what is named is impossible together, and nothing in it can be left out."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from random import Random

import pytest
from generated import question, wander
from scenarios.declared import CASES, ROOT, answer, model

from smv_planner.engines import Limits, explicit
from smv_planner.engines.auto.briefly import briefly
from smv_planner.model.expressions import Const, Var, conjunction, equality
from smv_planner.model.system import Kind
from smv_planner.planner.answer import Conflict
from smv_planner.planner.conflict import Asked, Assumption, conflict, in_words, minimal
from smv_planner.problem import Goal, Problem, Unreachable, Verdict

LIMITS = Limits(deadline=60, memory=1 << 30, progress=lambda text: None)
STATION = model(ROOT / "scenarios" / "assembly_station" / "model.yaml")


def explicitly(problem: Problem) -> Verdict:
    return explicit.ask(replace(problem, bound=10_000), LIMITS)


def hindered(seed: int) -> Asked:
    """A generated question of which a few effects are disabled and perhaps a device is lost."""
    random = Random(f"hindered {seed}")
    problem = question(seed)
    if random.random() < 0.6:  # something that the invariants may forbid
        somewhere = problem.system.named(wander(random, replace(problem, allowed=())))
        held = [equality(Var(name), Const(value)) for name, value in somewhere.items()]
        wanted = (conjunction(random.sample(held, random.randint(1, len(held)))) for _ in range(2))
        problem = replace(problem, goals=tuple(map(Goal, wanted)))
    effects = [t.name for t in problem.usable if t.kind is Kind.EFFECT]
    devices = sorted({name.partition(".")[0] for name in effects})
    disabled = frozenset(random.sample(effects, min(len(effects), random.choice((0, 1, 2)))))
    lost = frozenset(random.sample(devices, min(len(devices), random.choice((0, 0, 1)))))

    def unusable(disabled: frozenset[str], lost: frozenset[str]) -> frozenset[str]:
        of_lost = (t.name for t in problem.system.transitions if not t.kind.automatic and t.name.partition(".")[0] in lost)
        return problem.unusable | disabled | frozenset(of_lost)

    names = tuple(f"goal {at}" for at in range(len(problem.goals)))
    return Asked(replace(problem, unusable=unusable(disabled, lost)), names, disabled, lost, unusable)


def assumed(found: Conflict) -> list[Assumption]:
    return [
        *(Assumption("goal", name) for name in found.goals),
        *(Assumption("disabled", name) for name in found.disabled),
        *(Assumption("lost", name) for name in found.lost),
        *(Assumption("invariant", name) for name in found.invariants),
    ]


def test_conflicts_are_impossible_and_nothing_in_them_can_be_left_out():
    seen: Counter[str] = Counter()
    for seed in range(100):
        asked = hindered(seed)
        found = conflict(asked, briefly)
        impossible = isinstance(explicitly(asked.problem), Unreachable)
        assert (found is not None) <= impossible
        if found is None:
            seen["overlooked"] += impossible
            continue
        together = assumed(found)
        assert isinstance(explicitly(asked.under(together)), Unreachable)
        for each in together:
            rest = [other for other in together if other is not each]
            assert not isinstance(explicitly(asked.under(rest)), Unreachable), (found, each)
            seen[each.kind] += 1
        seen["several"] += len(together) > 1
    assert seen["overlooked"] == 0
    assert all(seen[kind] >= 5 for kind in ("goal", "disabled", "lost", "invariant", "several")), seen


def test_of_many_assumptions_a_smallest_impossible_set_is_found():
    """Against all sets that are impossible by decree; nothing smaller than what is found is among them."""
    random = Random(7)
    everything = [Assumption("invariant", f"{at}") for at in range(12)]
    sizes = Counter[int]()
    for _ in range(200):
        decreed = [frozenset(random.sample(everything, random.randint(1, 6))) for _ in range(random.randint(1, 4))]

        def impossible(assumptions, decreed=decreed):
            return any(each <= frozenset(assumptions) for each in decreed)

        background = random.sample(everything, random.randint(0, 3))
        candidates = [assumption for assumption in everything if assumption not in background]
        found = minimal(background, candidates, impossible)
        assert impossible([*background, *found])
        assert not any(impossible([*background, *(other for other in found if other != each)]) for each in found)
        sizes[len(found)] += 1
    assert all(sizes[size] for size in range(5)), sizes


@pytest.mark.parametrize(
    ("case", "expected"),
    [
        ("e3_tp_eto", Conflict(("r2_connector.attached",), ("r2_connector.attaches",), (), ())),
        ("e5_tp_rto", Conflict(("r2_connector.attached",), (), ("r2",), ("r2_locks_at_tool",))),
        ("one_robot_at_the_tool", Conflict(("r1.act_pos == at_tool and r2.act_pos == at_tool",), (), (), ("tool_zone",))),
        ("no_frame", Conflict(("tighten_bolts",), (), (), tuple(f"bolt_{i}_needs_frame" for i in (1,)))),
    ],
)
def test_the_station_says_what_is_in_its_way(case, expected):
    assert answer(CASES["assembly_station"][case], STATION).conflict == expected


def test_a_conflict_reads_as_a_sentence():
    found = Conflict(("a", "b"), ("door.opens",), ("robot",), ("zone", "one_tool"))
    assert in_words(found) == (
        "'a' and 'b' together cannot be reached as long as 'door.opens' is disabled and 'robot' is lost "
        "and 'zone' and 'one_tool' have to hold"
    )
