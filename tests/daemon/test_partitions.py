"""One-way partitions: hubs in a network namespace of their own, behind a cable that is cut in one direction.

A machine whose neighbour has another address than it believes sends into the void, and still hears everything.
"""

from __future__ import annotations

import subprocess
import sys
import uuid
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest
from daemon.stations import PATIENCE, Station, observed, station, until
from daemon.stories import swinging

SWINGS = 6
SMV = (sys.executable, "-m", "smv_planner")
VOID = "02:00:00:00:00:99"
PORT = 7447


def ip(*words: str) -> str:
    return subprocess.run(["ip", *words], check=True, capture_output=True, text=True, timeout=30).stdout


@dataclass(frozen=True)
class End:
    """One end of the cable. `spaces` are told apart by name, for others run tests on this machine too."""

    space: str
    device: str
    address: str

    @property
    def mac(self) -> str:
        return ip("netns", "exec", self.space, "cat", f"/sys/class/net/{self.device}/address").strip()

    def speaks_to(self, other: End, mac: str) -> None:
        ip("-n", self.space, "neigh", "replace", other.address, "lladdr", mac, "dev", self.device, "nud", "permanent")


@contextmanager
def cable() -> Iterator[tuple[End, End]]:
    """Two network namespaces and a cable between them; skips where that is not permitted."""
    name = uuid.uuid4().hex[:6]
    ends = End(f"smv-a-{name}", f"va{name}", "10.231.7.1"), End(f"smv-b-{name}", f"vb{name}", "10.231.7.2")
    with ExitStack() as stack:
        try:
            for end in ends:
                ip("netns", "add", end.space)
                stack.callback(ip, "netns", "del", end.space)
            here, there = ends
            ip("-n", here.space, "link", "add", here.device, "type", "veth", "peer", "name", there.device, "netns", there.space)
            for end in ends:
                ip("-n", end.space, "addr", "add", f"{end.address}/24", "dev", end.device)
                for device in ("lo", end.device):
                    ip("-n", end.space, "link", "set", device, "up")
        except (OSError, subprocess.SubprocessError) as error:
            pytest.skip(f"network namespaces are not permitted here: {getattr(error, 'stderr', None) or error}")
        yield ends


@pytest.fixture
def cut(tmp_path: Path) -> Iterator[tuple[Station, End, End]]:
    """Router and planner at one end of the cable, the hub that works at the other."""
    scenario = swinging(tmp_path / "swinging", SWINGS, silent="1 s")
    local = f"unixsock-stream/{tmp_path}/zenoh"
    with cable() as (here, there), ExitStack() as stack:
        remote = f"tcp/{here.address}:{PORT}"
        inside = ["ip", "netns", "exec", here.space]
        command = [*inside, *SMV, "router", "--listen", local, "--listen", remote, "--insecure-lan"]
        child = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        stack.callback(child.wait)
        stack.callback(child.kill)
        found = stack.enter_context(station(local, tmp_path, f"cut-{uuid.uuid4().hex[:8]}", scenario))
        found.hubs("--hub", "right", pace=10)
        hub = ["emulate", str(scenario), "--hub", "left", "--pace", "10", "--connect", remote, "--cell", found.cell]
        left = subprocess.Popen(["ip", "netns", "exec", there.space, *SMV, *hub, "--insecure-lan"], stdout=subprocess.DEVNULL)
        stack.callback(left.wait)
        stack.callback(left.kill)
        found.planner()
        found.phase("running")
        yield found, here, there


def missed_and_back(here: Station, from_: End, to: End) -> None:
    """Cut one direction, until the hub is missed; mend it, until the work is done."""
    right, events = to.mac, here.heard
    with observed(here) as findings:
        from_.speaks_to(to, VOID)
        until(lambda: noted(events(), "lost"), "the hub is missed")
        from_.speaks_to(to, right)
        until(lambda: noted(events(), "back"), "the hub is back")
        until(lambda: (here.situation() or {"state": {}})["state"].get("part") == f"p{SWINGS}", "the work is done", 2 * PATIENCE)
        found = findings()
    assert found["wrong"] == []
    assert found["seen"]["goal"] > 10


def noted(events: list[dict[str, object]], kind: str) -> bool:
    return any(event["event"] == kind and event["data"] == {"resource": "left"} for event in events)


def test_a_hub_that_is_not_heard_is_missed_though_it_hears(cut: tuple[Station, End, End]) -> None:
    here, router, hub = cut
    missed_and_back(here, hub, router)


@pytest.mark.long
def test_a_hub_that_does_not_hear_is_missed_though_it_is_heard(cut: tuple[Station, End, End]) -> None:
    here, router, hub = cut
    missed_and_back(here, router, hub)
