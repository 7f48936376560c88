"""What befalls the planner's process: kill -9, SIGTERM, SIGSTOP, a second planner, a disk that is full."""

from __future__ import annotations

import json
import os
import random
import resource
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from daemon.stations import ASSEMBLY, PATIENCE, Running, Station, health, load, observed, routed, station, until

from bridge import keys
from bridge.router import free_endpoint
from smv_planner.cli.ask import UNHEALTHY
from smv_planner.simulate.script import cases


@pytest.fixture(scope="module")
def endpoint() -> Iterator[str]:
    with routed() as where:
        yield where


KILLS = int(os.environ.get("SMV_PLANNER_TEST_KILLS", "50"))
"""So often is the planner killed in the long run, 200 times is a run of its own."""

GIVEN = {name: case.given for name, (_, case) in cases(ASSEMBLY, load).items() if name in ("e4", "e9")}
"""Where the work begins: in e4 one bolt is left to do, in e9 four."""


@pytest.fixture
def here(endpoint: str, tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Station]:
    cell = f"crashes-{uuid.uuid4().hex[:8]}"
    with station(endpoint, tmp_path, cell, given=GIVEN[getattr(request, "param", "e4")]) as found:
        found.hubs(pace=20)
        yield found


def finished(here: Station, intention: str = "tighten_bolts") -> bool:
    events = here.heard()
    return any(e["event"] == "intention" and e["data"] == {"intention": intention, "state": "finished"} for e in events)


def killed_at_random(here: Station, times: int, seed: int) -> list[float]:
    """Kill and start the planner again and again while it works; how long each took until it ran."""
    draw, took = random.Random(seed), []
    planner = here.planner()
    for _ in range(times):
        here.phase("running")
        time.sleep(draw.random())  # any moment will do
        planner.end(signal.SIGKILL)
        before = time.monotonic()
        planner = here.planner()
        here.phase("running")
        took.append(time.monotonic() - before)
    return took


def believed(here: Station) -> dict[str, Any]:
    """What only the planner can know."""
    situation = until(here.situation, "the planner says how it stands")
    own = [v.name for v in here.model.variables if v.resource is None]
    return {name: situation["state"][name] for name in own}


def survives(here: Station, times: int, seed: int) -> None:
    with observed(here) as findings:
        took = killed_at_random(here, times, seed)
        until(lambda: finished(here), "the bolts are tightened")
        found = findings()
    assert len(took) == times
    assert found["wrong"] == []
    assert found["seen"]["takeovers"] >= times
    assert found["seen"]["goal"] > 50


@pytest.mark.parametrize("here", ["e9"], indirect=True)
def test_a_planner_killed_again_and_again_gets_the_job_done_and_commands_nothing_wrong(here: Station) -> None:
    survives(here, 3, seed=1)


@pytest.mark.long
@pytest.mark.parametrize("here", ["e9"], indirect=True)
@pytest.mark.parametrize("seed", range(KILLS // 10))
def test_a_planner_killed_fifty_times(here: Station, seed: int) -> None:
    """Ten times while it does one job, and that again and again."""
    survives(here, 10, seed)


def test_nothing_that_was_accepted_is_lost(here: Station) -> None:
    """An order is answered when it is in the journal."""
    planner = here.planner()
    here.phase("running")
    assert here.say(keys.order, {"order": "set", "values": {"filter_1": "tightened"}})
    planner.end(signal.SIGKILL)
    planner = here.planner()
    here.phase("running")
    assert believed(here)["filter_1"] == "tightened"
    assert planner.end() == 0
    planner = here.planner()
    assert here.phase("running")["epoch"] == 3
    assert believed(here)["filter_1"] == "tightened"


def test_it_ends_when_told_to_and_leaves_nothing_behind(
    here: Station, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("SMV_PLANNER_CONNECT", here.endpoint)
    planner = here.planner()
    here.phase("running")
    before = children(planner)
    assert before
    asked = ["--journal", str(here.folder / "journal"), "--json"]
    until(lambda: health(*asked) == 0 and json.loads(capsys.readouterr().out)["phase"] == "running", "it says so on its disk too")
    assert planner.end() == 0
    until(lambda: not any(alive(each) for each in before), "the process that plans is gone")
    assert "Traceback" not in planner.text
    assert health(*asked, "--cell", "nobodys") == UNHEALTHY


def test_the_process_that_plans_may_die(here: Station) -> None:
    planner = here.planner()
    here.phase("running")
    (worker,) = children(planner)
    os.kill(worker, signal.SIGKILL)
    until(lambda: finished(here), "the bolts are tightened")
    assert children(planner) != [worker]


def test_of_two_planners_one_gives_way(here: Station) -> None:
    with observed(here) as findings:
        first = here.planner(journal="first")
        here.phase("running")
        second = here.planner(journal="second")
        until(lambda: "has taken over" in first.text + second.text, "one gives way")
        until(lambda: finished(here), "the bolts are tightened")
        found = findings()
    assert found["wrong"] == []
    journals = [str(here.folder / name) for name in ("first", "second")]
    well = {name: health("--journal", name) for name in journals}
    assert sorted(well.values()) == [0, UNHEALTHY], "each is asked for itself"
    over_the_network = here.start("health")
    assert over_the_network.child.wait(PATIENCE) == 0, "who was superseded leaves it to the other to answer"
    assert first.end() == 0
    assert second.end() == 0


def test_one_that_stood_still_does_not_believe_what_is_old(here: Station) -> None:
    planner = here.planner()
    here.phase("running")
    planner.send(signal.SIGSTOP)
    time.sleep(3.0)  # longer than any hub may be silent
    planner.send(signal.SIGCONT)
    until(lambda: "stood still" in planner.text, "it notices")
    until(lambda: finished(here), "the bolts are tightened")
    assert "lost" not in {event["event"] for event in here.heard()}


@pytest.mark.long
def test_the_router_may_be_killed(tmp_path: Path) -> None:
    endpoint = free_endpoint()
    command = [sys.executable, "-m", "smv_planner", "router", "--listen", endpoint]
    with ExitStack() as stack:

        def router() -> subprocess.Popen[bytes]:
            child = subprocess.Popen(command, stdout=subprocess.DEVNULL)
            stack.callback(child.wait)
            stack.callback(child.kill)
            return child

        first = router()
        with station(endpoint, tmp_path, "router", given=GIVEN["e9"]) as here:
            here.hubs(pace=20)
            here.planner()
            here.phase("running")
            first.kill()
            first.wait()
            time.sleep(1.0)  # hubs hear nothing, and are not heard
            router()
            until(lambda: finished(here), "the bolts are tightened")


def test_with_a_full_disk_it_holds_says_so_and_goes_on_afterwards(here: Station) -> None:
    planner = here.planner()
    here.phase("running")
    limit = resource.RLIMIT_FSIZE
    resource.prlimit(planner.child.pid, limit, (2048, resource.RLIM_INFINITY))
    until(lambda: "journal" in str((here.say(keys.health) or {}).get("wrong")), "it cannot write")
    until(lambda: health("--journal", str(here.folder / "journal")) == UNHEALTHY, "its own disk says so, too")
    asked = here.start("health")
    assert asked.child.wait(PATIENCE) == UNHEALTHY
    assert here.say(keys.order, {"order": "set", "values": {"filter_1": "tightened"}}) is None
    held = goals(here)
    assert goals(here) == held
    resource.prlimit(planner.child.pid, limit, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    until(lambda: (here.say(keys.health) or {}).get("healthy"), "it is well again")
    until(lambda: finished(here), "the bolts are tightened")


def goals(here: Station) -> dict[str, bytes]:
    """What every hub is told, heard for a while."""
    mailbox = here.link.latest(keys.goals(here.cell))
    heard: dict[str, bytes] = {}
    names = {name for name in here.model.system.resources.values() if name}
    until(lambda: heard.update(mailbox.drain()) or len(heard) == len(names), "goals are repeated")
    return heard


def children(process: Running) -> list[int]:
    path = Path(f"/proc/{process.child.pid}/task/{process.child.pid}/children")
    return [int(each) for each in path.read_text().split()]


def alive(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().split()[2] != "Z"
    except OSError:
        return False
