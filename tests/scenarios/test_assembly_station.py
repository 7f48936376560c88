"""The station of Machines 2021: its size, its story, and that nothing in it is there for show."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace

import pytest
from scenarios.declared import CASES, ROOT, answer, differences, model

import smv_planner as sp
from smv_planner import api
from smv_planner.export.smv import encode
from smv_planner.model.domains import Bool
from smv_planner.model.expressions import FALSE
from smv_planner.model.system import Kind
from smv_planner.planner.answer import Question
from smv_planner.planner.intend import Levels, pose_stage
from smv_planner.planner.operations import tasks
from smv_planner.problem import Problem

STATION = model(ROOT / "scenarios" / "assembly_station" / "model.yaml")
FOUND = CASES["assembly_station"]

RESOURCE_TRANSITIONS = tuple(t.name for t in STATION.transitions if t.kind is not Kind.MAINTENANCE and t.expected)
PRODUCTS = ("bolt_", "filter_", "frame_on_engine", "tool_at")


def first_stage() -> Problem:
    """What the transition planner is asked for the first operations of the whole job."""
    begun = [task for task in tasks(STATION) if task.name in ("locate_tool_r1", "place_bolt_1")]
    begin = api.start(STATION, Question())
    levels = Levels(begin, lambda problem: pytest.fail("nothing is solved here"), api.widened_system, bound=20)
    return pose_stage(STATION, begin.state, begun, levels)


def test_the_size_is_that_of_the_paper() -> None:
    """7 resources, 30 operations; problems of 72 transitions and 87 Booleans (Machines 2021, section 6)."""
    problem = first_stage()
    assert len(STATION.resources) == 7
    assert len(STATION.operations) == 30
    assert len(RESOURCE_TRANSITIONS) == 42
    assert len(problem.usable) == 72
    assert [t.kind for t in problem.usable].count(Kind.OPERATION) == 30
    assert sum(1 if isinstance(v.domain, Bool) else len(v.domain.values) for v in problem.system.variables) == 87
    assert not STATION.copies


def test_the_exported_text_has_that_size() -> None:
    text = encode(first_stage()).text
    steps = re.findall(r"\bt_\w+", re.search(r"x_step : \{(.*?)\}", text, re.DOTALL)[1])
    declared = re.findall(r"^  v_\w+ : (.*);$", text, re.MULTILINE)
    assert len(steps) == len(set(steps)) == 72
    assert sum(1 if domain == "boolean" else domain.count(",") + 1 for domain in declared) == 87


@pytest.mark.parametrize("engine", ["explicit", "nusmv"])
def test_both_robots_move_at_the_same_time(engine: str) -> None:
    got = answer(FOUND["both_make_way"], STATION, engine)
    before = transitively(got)
    moves = [{step.index for step in got.steps if step.transition in (f"{r}.move_home", f"{r}.sets_out")} for r in ("r1", "r2")]
    assert [len(each) for each in moves] == [2, 2]
    for one in moves[0]:
        for other in moves[1]:
            assert got.steps[one].stage == got.steps[other].stage
            assert one not in before[other]
            assert other not in before[one]


def transitively(got: sp.Answer) -> dict[int, set[int]]:
    """For each step all steps that it waits for."""
    before: dict[int, set[int]] = {}
    for step in got.steps:
        before[step.index] = set(step.after).union(*(before[other] for other in step.after))
    return before


def test_the_whole_job_tells_the_story_of_the_paper() -> None:
    got = answer(FOUND["alone_r1"], STATION)
    stages = [[got.operations[at].operation for at in stage.operations] for stage in got.stages]
    places = [f"place_bolt_{i}" for i in range(1, 7)]
    assert sorted(stages[0]) == ["locate_tool_r1", *places]
    assert stages[1:] == [["attach_tool_r1"], *([f"tighten_bolt_{i}_r1"] for i in range(1, 7)), ["detach_tool_r1"]]
    assert [stage.last - stage.first for stage in got.stages] == [12, 6, 9, 10, 10, 10, 10, 10, 10]


def test_every_resource_and_every_product_can_be_helped_by_the_operator() -> None:
    maintenance = [t for t in STATION.transitions if t.kind is Kind.MAINTENANCE]
    assert all(t.instruction and t.instruction.endswith("acknowledge.") for t in maintenance)
    assert {t.resource for t in maintenance} - {None} == {resource.name for resource in STATION.resources}
    products = {v.name for v in STATION.variables if v.name.startswith(PRODUCTS)}
    assert len(products) == 6 + 3 + 1 + 1
    assert products <= set().union(*(t.assigned for t in maintenance))


def without(part: str) -> sp.Model:
    """The station without one transition or operation."""
    transitions = tuple(replace(t, guard=FALSE) if t.name == part else t for t in STATION.transitions)
    return replace(STATION, transitions=transitions, operations=tuple(o for o in STATION.operations if o.name != part))


def who_notices(part: str) -> Iterator[str]:
    """The cases to try, those first that name the part, and small ones before large ones."""
    for name in sorted(FOUND, key=lambda name: (part not in str(FOUND[name]), FOUND[name].then.length or 0)):
        if FOUND[name].then.verdict == "reached" and FOUND[name].then.length:
            yield name


OPERATIONS = tuple(operation.name for operation in STATION.operations)
SOME = ("r1.move_home", "r2.move_at_bolt_6", "r2.arrives", "r1_connector.detaches", "r2_camera.resets", "nutrunner.resets")
SOME += ("locate_tool_r2", "detach_tool_r1", "tighten_bolt_3_r2", "place_bolt_4", "mount_filter_2", "tighten_filter_3")


@pytest.mark.parametrize(
    "part", [pytest.param(p, marks=() if p in SOME else pytest.mark.long) for p in (*RESOURCE_TRANSITIONS, *OPERATIONS)]
)
def test_nothing_can_be_taken_away(part: str) -> None:
    lesser = without(part)
    assert any(differences(FOUND[name], answer(FOUND[name], lesser)) for name in who_notices(part)), "no case notices"
