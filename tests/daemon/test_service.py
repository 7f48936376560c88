"""The daemon among others: systemd, Prometheus, a scenario that changes, people at the command line, a second engine."""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest
from daemon.doubles import LoggedDisk
from daemon.stations import PATIENCE, ROOT, Station, load, routed, station, until

import smv_planner as sp
from bridge.router import free_endpoint
from smv_planner import api, language
from smv_planner.cli.main import command
from smv_planner.daemon import chronicle as chronicles
from smv_planner.daemon import service
from smv_planner.daemon.planners import Opinion, Worker, job
from smv_planner.daemon.service import Coming
from smv_planner.daemon.signals import Signals
from smv_planner.model.model import Model
from smv_planner.runner.decision import Cause, Decision, Request, Wanted
from smv_planner.runner.records import Known
from smv_planner.runner.recovery import promised
from smv_planner.runner.situation import Station as Seen
from smv_planner.runner.situation import at_rest


@pytest.fixture(scope="module")
def endpoint() -> Iterator[str]:
    with routed() as where:
        yield where


@pytest.fixture
def here(endpoint: str, tmp_path: Path) -> Iterator[Station]:
    """The door, from a scenario file of its own."""
    scenario = tmp_path / "model.yaml"
    shutil.copy(ROOT / "scenarios" / "door" / "model.yaml", scenario)
    with station(endpoint, tmp_path, f"service-{tmp_path.name[-12:].strip('_')}", scenario) as found:
        yield found


def test_systemd_is_told_and_prometheus_answered(here: Station, tmp_path: Path) -> None:
    port = int(free_endpoint().rpartition(":")[2])
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(str(tmp_path / "notify"))
        systemd.settimeout(PATIENCE)
        here.hubs()
        planner = here.planner("--metrics", str(port), environment={"NOTIFY_SOCKET": str(tmp_path / "notify")})
        assert systemd.recv(100) == b"READY=1"
        assert systemd.recv(100) == b"WATCHDOG=1"
        here.phase("running")
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=PATIENCE) as answer:
            told = answer.read().decode()
        assert f'smv_planner_healthy{{cell="{here.cell}"}} 1' in told
        assert 'phase="running"' in told
        assert planner.end() == 0
        last = [b""]
        until(lambda: last.append(systemd.recv(100)) or last[-1] == b"STOPPING=1", "it says that it stops")


def test_a_changed_scenario_is_taken_over_and_one_with_mistakes_is_not(here: Station) -> None:
    hubs, planner = here.hubs(), here.planner()
    before = here.phase("running")
    good = here.scenario.read_text()
    here.scenario.write_text(good.replace("kind: controlled", "kind: controled", 1))
    planner.send(signal.SIGHUP)
    until(lambda: "the old one stays" in planner.text, "mistakes are told")
    assert here.phase("running")["model"] == before["model"]

    own = here.model.intentions[0].name
    here.scenario.write_text(good.replace("name: door", "name: gate", 1))
    planner.send(signal.SIGHUP)
    changed = sp.load(here.scenario)
    until(lambda: (here.situation() or before)["model"] == changed.hash, "the new one takes over")
    hubs.end()
    here.hubs()
    after = here.phase("running")
    assert after["epoch"] > before["epoch"]
    assert own in after["intentions"]
    assert planner.end() == 0


def test_with_a_full_disk_the_old_scenario_stays(tmp_path: Path, known: Known) -> None:
    scenario = tmp_path / "model.yaml"
    scenario.write_text((ROOT / "scenarios" / "door" / "model.yaml").read_text().replace("name: door", "name: gate", 1))
    here, disk = Seen(known.model, api.widened(known.model), "door"), LoggedDisk()
    chronicle, situation, _ = chronicles.opened(disk, here, known, at_rest(here))
    coming = Coming(str(scenario), known.model, "door")
    coming.load()
    until(lambda: not coming.loading, "it is read")
    disk.full = True
    assert not coming.take_over(chronicle, situation)
    assert coming.taken is None
    disk.full = False
    assert not coming.take_over(chronicle, situation), "it has been given up"
    assert chronicles.opened(disk, here, known, at_rest(here))[1] == situation
    coming.load()
    until(lambda: coming.take_over(chronicle, situation), "it takes over")
    assert coming.taken
    assert coming.taken.hash == sp.load(scenario).hash


def test_a_reload_that_is_asked_for_while_the_scenario_is_being_read_is_remembered(monkeypatch: pytest.MonkeyPatch) -> None:
    served: list[Signals] = []

    def reads(path: str) -> Model:
        os.kill(os.getpid(), signal.SIGHUP)
        return load(ROOT / "scenarios" / "door")

    monkeypatch.setattr(language, "load", reads)
    monkeypatch.setattr(service, "serve", lambda *given: served.append(given[-1]))
    before = signal.getsignal(signal.SIGHUP)
    try:
        assert command(["run", "scenarios/door"]) == 0
    finally:
        signal.signal(signal.SIGHUP, before)
    assert [signals.reload for signals in served] == [True]


def test_signals_are_heard_while_there_is_no_router(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "smv_planner", "run", str(ROOT / "scenarios" / "door"), "--connect", free_endpoint()]
    said = tmp_path / "said"
    with said.open("wb") as out:
        child = subprocess.Popen([*command, "--journal", str(tmp_path / "journal"), "--second-opinion", "none"], stderr=out)
    try:
        until(lambda: (tmp_path / "journal").exists(), "it has begun")
        child.send_signal(signal.SIGHUP)
        with pytest.raises(subprocess.TimeoutExpired):
            child.wait(0.5)
        child.send_signal(signal.SIGTERM)
        assert child.wait(PATIENCE) == 0
    finally:
        child.kill()
        child.wait()


def test_people_ask_and_order_at_the_command_line(here: Station) -> None:
    here.hubs()
    here.planner()
    here.phase("running")
    name = here.model.intentions[0].name
    assert run(here, "ask", "start", name) == (0, f"accepted: start {name}\n")
    code, text = run(here, "ask", "start", "nonsense")
    assert code != 0
    assert "there is no intention 'nonsense'" in text
    code, text = run(here, "ask", "state", "--json")
    assert code == 0
    assert json.loads(text)["phase"] == "running"
    code, text = run(here, "ask", "plan")
    assert code == 0
    assert text
    code, text = run(here, "health")
    assert code == 0
    assert text.startswith("well: running")


def run(here: Station, *words: str) -> tuple[int, str]:
    process = here.start(*words)
    return process.child.wait(PATIENCE), process.text


def question(model: sp.Model) -> Request:
    """All intentions from the initial state."""
    wanted = tuple(Wanted(each.name, promised(model, each.name)) for each in model.intentions)
    return Request(Cause.PROGRESS, model.system.initial, wanted)


def answered(worker: Worker, revision: int = 1) -> Decision:
    worker.ask(revision, question(load(ROOT / "scenarios" / "door")))
    replies: list[object] = []
    until(lambda: replies.extend(worker.replies()) or any(isinstance(each, tuple) for each in replies), "it answers")
    (one,) = (each for each in replies if isinstance(each, tuple))
    assert one[0] == revision
    decision = one[1]
    assert isinstance(decision, Decision)
    return decision


@pytest.fixture
def known() -> Known:
    return Known(load(ROOT / "scenarios" / "door"), api.widened_system)


def test_planners_in_a_process_of_their_own_decide_and_are_started_again_when_they_die(known: Known) -> None:
    worker = Worker(job(known, "auto", PATIENCE), known, lambda: None)
    try:
        first = answered(worker)
        assert first.undecided is None
        again = answered(worker, 2)
        assert [action.name for action in again.actions] == [action.name for action in first.actions]
        worker.ask(3, question(known.model))
        worker._process.child.kill()
        replies: list[object] = []
        until(lambda: replies.extend(worker.replies()) or replies, "its death is noticed")
        assert isinstance(replies[0], tuple)
        answer = replies[0][1]
        assert isinstance(answer, Decision)
        if answer.undecided is not None:  # it may have answered before it died
            assert "ended with status" in answer.undecided
        assert answered(worker, 4).undecided is None
    finally:
        worker.close()


def test_planners_that_take_too_long_are_killed(known: Known) -> None:
    worker = Worker(job(known, "auto", 0.001), known, lambda: None)
    try:
        worker._process.child.send_signal(signal.SIGSTOP)
        decision = answered(worker)
        assert decision.undecided
        assert "took too long" in decision.undecided
    finally:
        worker.close()


BLIND = '#!/bin/sh\nsed -n "s/.*-k \\\\([0-9]*\\\\).*/-- no counterexample found with bound \\\\1/p" problem.cmd\n'
"""In nuXmv's place: it says that there is no plan, whatever the question."""


def opinions(worker: Worker) -> list[Opinion]:
    """Those on the first question, as soon as there are any."""
    worker.ask(1, question(load(ROOT / "scenarios" / "door")))
    replies: list[object] = []
    until(lambda: replies.extend(worker.replies()) or any(isinstance(each, Opinion) for each in replies), "it has an opinion")
    return [each for each in replies if isinstance(each, Opinion)]


def test_another_engine_agrees_in_the_background(known: Known, tmp_path: Path) -> None:
    worker = Worker(job(known, "auto", PATIENCE, "explicit", str(tmp_path)), known, lambda: None)
    try:
        assert {opinion.differs for opinion in opinions(worker)} == {None}
    finally:
        worker.close()


def test_one_that_differs_is_told_with_what_reproduces_it(known: Known, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in = tmp_path / "nuXmv"
    stand_in.write_text(BLIND)
    stand_in.chmod(0o755)
    monkeypatch.setenv("SMV_PLANNER_NUXMV", str(stand_in))
    worker = Worker(job(known, "auto", PATIENCE, "nuxmv", str(tmp_path)), known, lambda: None)
    try:
        opinion = opinions(worker)[0]
    finally:
        worker.close()
    assert opinion.differs
    assert "nuxmv says that there is no plan" in opinion.differs
    assert opinion.folder
    assert {each.name for each in Path(opinion.folder).iterdir()} == {"problem.smv", "problem.cmd", "difference.json"}
