"""A model checker that crashes, hangs, floods or forks gives no answer, in time, and leaves nothing behind."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from engines.questions import QUESTIONS
from engines.stand_ins import FAULTS, HANGS, StandIn

from smv_planner.engines import Limits, nusmv, nuxmv
from smv_planner.errors import EngineError
from smv_planner.problem import Undecided, Verdict

PROBLEM, _ = QUESTIONS["up to the border"]
DEADLINE, AMPLE, LATENESS = 0.5, 30.0, 20.0

Ask = Callable[[StandIn, float], Verdict]


@pytest.fixture(params=["nusmv", "nuxmv"])
def ask(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, temporary: Path) -> Ask:
    """Asks an engine while a stand-in is in the place of its model checker."""

    def put(stand_in: StandIn, deadline: float) -> Verdict:
        limits = Limits(deadline, 100 << 20, lambda text: None)
        if request.param == "nusmv":
            monkeypatch.setattr(nusmv, "available", lambda: None)
            return nusmv.ask(PROBLEM, limits, child=(str(stand_in.path),))
        monkeypatch.setenv(nuxmv.SETTING, str(stand_in.path))
        return nuxmv.ask(PROBLEM, limits)

    return put


@pytest.mark.parametrize("fault", FAULTS)
def test_a_broken_model_checker_leaves_the_question_undecided(ask: Ask, fault: str, tmp_path: Path, temporary: Path) -> None:
    stand_in = StandIn(tmp_path, FAULTS[fault])
    deadline = DEADLINE if fault in HANGS else AMPLE
    began = time.monotonic()
    answer = ask(stand_in, deadline)
    assert time.monotonic() - began < deadline + LATENESS
    assert isinstance(answer, Undecided)
    assert answer.deadline == (fault in HANGS), answer.reason
    assert stand_in.started()
    assert stand_in.gone()
    assert not list(temporary.iterdir())


def test_the_last_words_are_kept(ask: Ask, tmp_path: Path) -> None:
    body = "for n in 1 2 3; do echo line $n >&2; done; printf 'file x: line 7: \\377 syntax error' >&2; exit 3"
    answer = ask(StandIn(tmp_path, body), AMPLE)
    assert isinstance(answer, Undecided)
    assert "exit status 3" in answer.reason
    assert "line 2\nline 3\nfile x: line 7: " in answer.reason
    assert answer.reason.endswith("syntax error")


def test_what_cannot_be_started_is_an_error(ask: Ask, tmp_path: Path, temporary: Path) -> None:
    stand_in = StandIn(tmp_path, "exit 0")
    stand_in.path.write_text("#!/no/such/interpreter\n")
    with pytest.raises(EngineError, match="cannot be started"):
        ask(stand_in, AMPLE)
    assert not list(temporary.iterdir())


def test_a_listener_that_fails_leaves_nothing_behind(tmp_path: Path, temporary: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in = StandIn(tmp_path, "echo 'Generating problem with bound 1, no loopback...' >&2; exec sleep 600")
    monkeypatch.setenv(nuxmv.SETTING, str(stand_in.path))

    def interrupted(text: str) -> None:
        raise KeyboardInterrupt(text)

    with pytest.raises(KeyboardInterrupt, match="bound 0"):
        nuxmv.ask(PROBLEM, Limits(60, 1 << 30, interrupted))
    assert stand_in.gone()
    assert not list(temporary.iterdir())


PLANNER = """
import sys, tempfile
from smv_planner.engines import Limits, nuxmv
sys.path.insert(0, sys.argv[1])
from engines.questions import QUESTIONS
tempfile.tempdir = sys.argv[2]
nuxmv.ask(QUESTIONS["up to the border"][0], Limits(60, 1 << 30, print))
"""


@pytest.mark.usefixtures("interruptible")
@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGKILL])
def test_the_model_checker_goes_with_the_planner(end: signal.Signals, tmp_path: Path, temporary: Path) -> None:
    stand_in = StandIn(tmp_path, "exec sleep 600")
    tests = str(Path(__file__).parent.parent)
    planner = subprocess.Popen(
        [sys.executable, "-c", PLANNER, tests, str(temporary)],
        env={"PATH": "/usr/bin:/bin", "SMV_PLANNER_NUXMV": str(stand_in.path)},
        stderr=subprocess.PIPE,
    )
    with planner:
        while not stand_in.started():
            assert planner.poll() is None
            time.sleep(0.01)
        planner.send_signal(end)
        assert planner.stderr
        said = planner.stderr.read()
    assert stand_in.gone()
    if end == signal.SIGINT:
        assert b"KeyboardInterrupt" in said
        assert not list(temporary.iterdir())
