"""A whole station behind TLS and access control as the project generates it: the real daemon, hubs, and people."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from bridge_certificates import authority, certificate
from daemon.stations import PATIENCE, until
from daemon.stories import swinging

from bridge.access import OPERATOR, PLANNER, SPECTATOR, hub_name
from bridge.router import free_endpoint

pytestmark = pytest.mark.skipif(shutil.which("openssl") is None, reason="there is no openssl to make certificates with")

CELL = "secured"
SWINGS = 4


@pytest.fixture
def acting(tmp_path: Path) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Starts `smv-planner WORDS` as somebody who has a certificate with this name."""
    authority(tmp_path, "authority")
    where = free_endpoint().replace("tcp/", "tls/")
    with ExitStack() as stack:

        def started(name: str, *words: str) -> subprocess.Popen[str]:
            tls = certificate(tmp_path, name)
            files = ("--tls-authority", tls.authority, "--tls-certificate", tls.certificate, "--tls-key", tls.key)
            to = ("--listen", where) if words[0] == "router" else ("--connect", where, "--cell", CELL)
            command = [sys.executable, "-m", "smv_planner", *words, *to, *files]
            child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=tmp_path)
            stack.callback(child.wait)
            stack.callback(child.kill)
            return child

        yield started


def test_a_station_works_behind_certificates_and_nobody_exceeds_his_rights(
    acting: Callable[..., subprocess.Popen[str]], tmp_path: Path
) -> None:
    scenario = str(swinging(tmp_path / "swinging", SWINGS, silent="2 s"))
    command = [sys.executable, "-m", "smv_planner", "security", "acl", scenario, "--cell", CELL]
    acl = subprocess.run(command, check=True, capture_output=True, timeout=PATIENCE)
    (tmp_path / "acl.json").write_bytes(acl.stdout)
    acting("router", "router", "--access-control", str(tmp_path / "acl.json"))
    for name in ("left", "right"):
        acting(hub_name(name), "emulate", scenario, "--hub", name, "--pace", "10")
    acting(PLANNER, "run", scenario, "--journal", str(tmp_path / "journal"), "--second-opinion", "none")

    def says(name: str, *words: str) -> tuple[int, str]:
        child = acting(name, *words)
        return child.wait(PATIENCE), child.stdout.read() if child.stdout else ""

    def over() -> bool:
        code, text = says(OPERATOR, "ask", "state", "--json")
        return code == 0 and json.loads(text)["state"]["part"] == f"p{SWINGS}"

    until(over, "the operator sees that the work is done", patience=2 * PATIENCE)
    assert says(OPERATOR, "health")[0] == 0
    assert says(OPERATOR, "ask", "set", "part=p1") == (0, "accepted: set part=p1\n")
    for other in (SPECTATOR, hub_name("left")):
        code, text = says(other, "ask", "set", "part=p0")
        assert code != 0
        assert "accepted" not in text
