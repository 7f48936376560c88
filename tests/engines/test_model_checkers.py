"""Real NuSMV, as a library and as an executable, on questions that are made to be misunderstood.

The executable that comes with pynusmv stands in for nuXmv.
"""

from __future__ import annotations

import os
import shutil
import sys
from itertools import pairwise
from pathlib import Path

import pytest
from engines.questions import QUESTIONS, vast, wide
from export.corpus import march, names

from smv_planner.engines import ENGINES, Limits, explicit, nuxmv
from smv_planner.model.ltl import holds
from smv_planner.model.semantics import Steps
from smv_planner.problem import NotWithin, Problem, Reached, Undecided, Verdict

LIMITS = Limits(deadline=60, memory=2 << 30, progress=lambda text: None)
NUSMV = shutil.which("NuSMV", path=os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")]))
BATCH = 25

# Both are asked the same text, and the executable starts ten times faster.
CASES = [("nuxmv", name) for name in QUESTIONS] + [("nusmv", name) for name in list(QUESTIONS)[::5]]


@pytest.fixture(params=["nusmv", "nuxmv"])
def ask(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch):
    """An engine that runs NuSMV."""
    if request.param == "nuxmv":
        if NUSMV is None:
            pytest.skip("there is no NuSMV executable beside this Python or on the PATH")
        monkeypatch.setenv(nuxmv.SETTING, NUSMV)
    if reason := ENGINES[request.param].available():
        pytest.skip(reason)
    return ENGINES[request.param].ask


@pytest.mark.parametrize(("ask", "name"), CASES, indirect=["ask"])
def test_the_shortest_plan_is_found_and_is_one(ask, name: str) -> None:
    problem, length = QUESTIONS[name]
    assert shortest(explicit.ask(problem, LIMITS)) == length
    answer = ask(problem, LIMITS)
    assert shortest(answer) == length
    assert is_plan(problem, answer) if length is not None else answer == NotWithin(problem.bound)


@pytest.mark.parametrize("ask", ["nuxmv"], indirect=True)
def test_wide_questions_mean_the_same(ask) -> None:
    lengths = []
    for seed in range(4):
        problem = wide(seed)
        expected, answer = explicit.ask(problem, LIMITS), ask(problem, LIMITS)
        assert shortest(answer) == shortest(expected), f"seed {seed}: {answer}"
        assert not isinstance(answer, Reached) or is_plan(problem, answer)
        lengths.append(shortest(answer))
    assert None not in lengths
    assert len(set(lengths)) > 2


@pytest.mark.long
def test_nothing_crashes_at_eight_thousand_transitions(ask) -> None:
    problem = vast(8400, 600)
    answer = ask(problem, Limits(deadline=300, memory=8 << 30, progress=lambda text: None))
    assert is_plan(problem, answer)
    assert shortest(answer) == 2


def shortest(answer: Verdict) -> int | None:
    return len(answer.path) if isinstance(answer, Reached) else None


def is_plan(problem: Problem, answer: Verdict) -> bool:
    """Whether the trace is a run of the problem that satisfies its formula and ends settled."""
    assert isinstance(answer, Reached), answer
    steps = Steps(problem.system, problem.usable)
    for name, (before, after) in zip(answer.path, pairwise(answer.states), strict=True):
        assert (name, after) in [(transition.name, state) for transition, state in steps(before)]
    assert answer.states[0] == problem.initial
    return steps.settled(answer.states[-1]) and holds(problem.formula, answer.states, problem.system.index)


@pytest.mark.parametrize("start", range(0, len(names()), BATCH))
def test_every_hostile_name_comes_back(ask, start: int) -> None:
    batch = names()[start : start + BATCH]
    answer = ask(march(batch), LIMITS)
    assert isinstance(answer, Reached)
    assert answer.path == batch
    assert answer.states[-1] == (len(batch), *batch)
    assert answer.states[0] == (0, *(f"not {name}" for name in batch))


def test_the_bounds_are_reported_as_they_are_reached(ask) -> None:
    problem, length = QUESTIONS["up to the border"]
    heard: list[str] = []
    ask(problem, Limits(60, 2 << 30, heard.append))
    assert heard[0] == "bound 0"
    assert heard[-1] == f"bound {length}"


def test_a_deadline_is_kept(ask, temporary: Path) -> None:
    answer = ask(march(names()[:200]), Limits(0.3, 2 << 30, lambda text: None))
    assert isinstance(answer, Undecided)
    assert answer.deadline
    assert answer.reason.startswith("the deadline passed at bound ")
    assert not list(temporary.iterdir())


def test_too_little_memory_is_no_answer(ask) -> None:
    answer = ask(QUESTIONS["up to the border"][0], Limits(60, 8 << 20, lambda text: None))
    assert isinstance(answer, Undecided)
    assert not answer.deadline


def test_an_executable_in_a_folder_with_a_space_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if NUSMV is None:
        pytest.skip("there is no NuSMV executable beside this Python or on the PATH")
    folder = tmp_path / "my model checkers; $(id)"
    folder.mkdir()
    folder.joinpath("nuXmv").symlink_to(NUSMV)
    monkeypatch.delenv(nuxmv.SETTING, raising=False)
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}/usr/bin")
    problem, length = QUESTIONS["up to the border"]
    assert shortest(nuxmv.ask(problem, LIMITS)) == length
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(nuxmv.SETTING, f"{folder.name}/nuXmv")
    assert shortest(nuxmv.ask(problem, LIMITS)) == length


def test_start_up_files_are_not_read(ask, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tmp_path.joinpath(".nusmvrc").write_text("quit\n")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    assert isinstance(ask(QUESTIONS["up to the border"][0], LIMITS), Reached)
