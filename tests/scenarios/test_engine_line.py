"""A whole engine: the operations tell the story, stage by stage."""

from __future__ import annotations

import pytest
from scenarios.declared import CASES, ROOT, answer, differences, model

from smv_planner.model.domains import Bool
from smv_planner.model.system import Kind

LINE = model(ROOT / "scenarios" / "engine_line" / "model.yaml")

STORY = [
    {"call_engine", "call_kit", "take_lf_tool"},
    {"pick_frame"},
    {"put_frame"},
    {"leave_lf_tool", "place_bolts"},
    {"take_nutrunner", "mount_filters"},
    *({f"tighten_bolt_{i}"} for i in range(1, 25)),
    {"leave_nutrunner", "attach_pipes"},
    {"take_filter_tool", "tighten_pipes"},
]


def test_the_size_is_as_the_readme_says() -> None:
    maintenance = [t for t in LINE.transitions if t.kind is Kind.MAINTENANCE]
    others = [t for t in LINE.transitions if t.kind is not Kind.MAINTENANCE]
    booleans = sum(1 if isinstance(v.domain, Bool) else len(v.domain.values) for v in LINE.variables)
    assert (len(LINE.resources), len(LINE.operations), len(others), len(maintenance)) == (9, 43, 50 + 5, 39)
    assert ([t.expected for t in others].count(True), booleans) == (50, 194)
    assert all(t.instruction and t.instruction.endswith("acknowledge.") for t in maintenance)
    assert {t.resource for t in maintenance} - {None} == {resource.name for resource in LINE.resources}


@pytest.mark.long
@pytest.mark.parametrize("engine", ["auto", "explicit", "nusmv"])
def test_a_whole_engine_is_planned_stage_by_stage(engine: str) -> None:
    case = CASES["engine_line"]["whole_engine"]
    got = answer(case, LINE, engine)
    stages = [{got.operations[at].operation for at in stage.operations} for stage in got.stages]
    assert not differences(case, got)
    assert stages[: len(STORY)] == STORY
    assert set().union(*stages[len(STORY) :]) == {*(f"tighten_filter_{i}" for i in range(1, 4)), "send_engine", "send_kit"}
    assert all(stage.last - stage.first <= 17 for stage in got.stages)


def test_vehicles_come_while_the_robot_takes_its_tool() -> None:
    """Some invariants keep steps in order; those that speak of vehicles need not."""
    got = answer(CASES["engine_line"]["get_ready"], LINE)
    before: dict[int, set[int]] = {}
    for step in got.steps:
        before[step.index] = set(step.after).union(*(before[other] for other in step.after))
    lanes = [{s.index for s in got.steps if s.transition.startswith(name)} for name in ("agv.", "mir.", ("robot.", "connector."))]
    assert all(lanes)
    for lane in lanes:
        others = set().union(*(other for other in lanes if other is not lane))
        assert all(before[at].isdisjoint(others) for at in lane)
