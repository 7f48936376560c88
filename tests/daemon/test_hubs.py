"""What befalls the processes of hubs: kill -9, a new process in place of the old one, SIGSTOP and SIGCONT."""

from __future__ import annotations

import signal
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from daemon.stations import Running, Station, observed, routed, station, until
from daemon.stories import swinging

SWINGS = 8
PACE = 10.0


@pytest.fixture(scope="module")
def endpoint() -> Iterator[str]:
    with routed() as where:
        yield where


@pytest.fixture
def here(endpoint: str, tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Station]:
    scenario = swinging(tmp_path / "swinging", SWINGS, silent=request.param)
    with station(endpoint, tmp_path, f"hubs-{uuid.uuid4().hex[:8]}", scenario) as found:
        yield found


def begun(here: Station) -> Running:
    """Hubs in a process each and a planner at work; the process of the hub that works."""
    here.hubs("--hub", "right", pace=PACE)
    left = here.hubs("--hub", "left", pace=PACE)
    here.planner()
    done(here, 2)
    return left


def done(here: Station, swings: int) -> None:
    def far() -> bool:
        now = here.situation()
        return now is not None and int(str(now["state"]["part"] or "p0")[1:]) >= swings

    until(far, f"{swings} swings are done")


def noted(here: Station, kind: str) -> Callable[[], bool]:
    return lambda: any(event["event"] == kind and event["data"].get("resource") == "left" for event in here.heard())


def finds_nothing_wrong(found: dict[str, Any], reboots: int) -> None:
    seen = found["seen"]
    assert found["wrong"] == []
    assert seen["goal"] > 20
    assert seen["reboots"] == reboots


@pytest.mark.parametrize("here", ["60 s"], indirect=True)
def test_a_hub_in_place_of_one_that_was_killed_is_used_once_it_obeys(here: Station) -> None:
    """It begins anew before its silence is noticed: that it is another process, and obeys nobody yet, its messages tell."""
    left = begun(here)
    with observed(here) as findings:
        for swings in (3, 5):
            done(here, swings)
            left.end(signal.SIGKILL)
            left = here.hubs("--hub", "left", pace=PACE)
        done(here, SWINGS)
        found = findings()
    finds_nothing_wrong(found, reboots=2)
    assert found["seen"]["first obeyed"], "it was seen to obey before it was used"
    assert noted(here, "rebooted")()
    assert not noted(here, "lost")()


@pytest.mark.long
@pytest.mark.parametrize("here", ["1 s"], indirect=True)
def test_a_hub_that_was_killed_is_missed_and_comes_back(here: Station) -> None:
    left = begun(here)
    with observed(here) as findings:
        done(here, 4)
        left.end(signal.SIGKILL)
        until(noted(here, "lost"), "it is missed")
        here.hubs("--hub", "left", pace=PACE)
        done(here, SWINGS)
        found = findings()
    finds_nothing_wrong(found, reboots=1)
    assert noted(here, "back")()


@pytest.mark.parametrize("here", ["1 s"], indirect=True)
def test_a_hub_that_stood_still_is_missed_and_comes_back(here: Station) -> None:
    left = begun(here)
    with observed(here) as findings:
        done(here, 4)
        left.send(signal.SIGSTOP)
        until(noted(here, "lost"), "it is missed")
        left.send(signal.SIGCONT)
        done(here, SWINGS)
        found = findings()
    finds_nothing_wrong(found, reboots=0)
    assert noted(here, "back")()
