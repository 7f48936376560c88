"""The example of a hub that speaks REST, against a small platform behind a real HTTP server."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from itertools import count
from pathlib import Path
from typing import Any

import pytest
from bridge_wires import Network, until

import smv_planner as sp
from bridge import keys
from bridge.descriptions import descriptions, written
from bridge.examples.rest import PAUSE, READY, Say, Status, due, http, measured, serve, status_of
from bridge.hub import Hub
from bridge.link import Link, LinkConfig, open_link
from bridge.router import RouterConfig, free_endpoint, router
from smv_planner.model.domains import Value
from smv_planner.protocol.messages import GoalMessage, StateMessage, decode_state, encode

ROOT = Path(__file__).parents[2]
R1 = descriptions(sp.load(ROOT / "scenarios/dummy_robots"), "cell")["r1"]
DRIVE = 0.05


class Platform:
    """A platform that drives for a moment, to whatever is first in its queue, unless it is paused."""

    def __init__(self) -> None:
        self.state, self.position, self.queue = PAUSE, "away", list[str]()
        self.arrives: float | None = None
        self.missions: list[str] = []
        self.mode = "well"

    def status(self) -> dict[str, object]:
        if self.state == READY and self.queue:
            self.arrives = self.arrives or time.monotonic() + DRIVE
            if time.monotonic() >= self.arrives:
                self.position, self.arrives = self.queue.pop(0), None
        driving = self.arrives is not None
        return {
            "state_id": self.state,
            "position": None if driving else self.position,
            "mission": self.queue[0] if self.queue else None,
            "battery": 71.5,
        }

    def told(self, method: str, path: str, body: Any) -> object:
        match method, path:
            case "GET", "/api/status":
                return self.status()
            case "PUT", "/api/status":
                self.state = body["state_id"]
            case "DELETE", "/api/mission_queue":
                self.queue, self.arrives = [], None
            case "POST", "/api/mission_queue":
                self.queue.append(body["mission_id"])
                self.missions.append(body["mission_id"])
        return {}


@contextmanager
def served(platform: Platform, port: int = 0) -> Iterator[str]:
    lock = threading.Lock()

    class Handler(BaseHTTPRequestHandler):
        def answer(self) -> None:
            body = json.loads(self.rfile.read(int(self.headers.get("Content-Length") or 0)) or b"null")
            with lock:
                answer = json.dumps(platform.told(self.command, self.path, body)).encode()
            status = {"ill": 503}.get(platform.mode, 200)
            answer = {"garbled": b"<html>", "nonsense": b'{"state_id": "ready"}'}.get(platform.mode, answer)
            self.send_response(status)
            self.send_header("Content-Length", str(len(answer)))
            self.end_headers()
            self.wfile.write(answer)

        do_GET = do_PUT = do_POST = do_DELETE = answer

        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", port), Handler) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}/api"
        finally:
            server.shutdown()
            thread.join()


class Planner:
    def __init__(self, link: Link) -> None:
        self.link, self.states, self._numbers = link, list[StateMessage](), count(1)
        self.mailbox = link.latest(keys.state("cell", "r1"), depth=1000)

    def ask(self, activate: bool, position: str) -> None:
        values: dict[str, Value] = {"r1.activate": activate, "r1.ref_pos": position}
        message = GoalMessage("cell", "r1", 1, next(self._numbers), "p", R1.interface.model, values)
        self.link.publish(keys.goal("cell", "r1"), encode(message))

    def hears(self, active: bool, position: str, repeat: Callable[[], object] = lambda: None) -> None:
        def came() -> bool:
            for _, payload in self.mailbox.drain():
                message = decode_state(payload, R1.interface)
                assert isinstance(message, StateMessage)
                self.states.append(message)
            wanted = {"r1.active": active, "r1.act_pos": position}
            return bool(self.states) and self.states[-1].measured == wanted

        until(came, repeat)


@contextmanager
def driven(platform: Platform) -> Iterator[tuple[Planner, Counter[str]]]:
    network, over, failures = Network(), threading.Event(), Counter[str]()
    planner = Planner(network.link())
    with served(platform) as url, Hub(R1, network.link(), stale_after=0.3) as hub:
        thread = threading.Thread(target=serve, args=(hub, http(url), failures, over.is_set))
        thread.start()
        try:
            yield planner, failures
        finally:
            over.set()
            thread.join()


def test_goals_become_missions_and_each_only_once() -> None:
    platform = Platform()
    with driven(platform) as (planner, _):
        planner.hears(True, "away")  # what the scenario begins with is asked of the device before anybody speaks
        planner.ask(True, "at")
        planner.hears(True, "at", lambda: planner.ask(True, "at"))
        planner.ask(True, "away")
        planner.hears(True, "away")
        planner.ask(False, "away")
        planner.hears(False, "away")
    assert platform.missions == ["at", "away"]
    assert "unknown" in {state.measured["r1.act_pos"] for state in planner.states}, "it has been seen driving"


@pytest.mark.parametrize(("mode", "failure"), [("ill", "HTTPError"), ("garbled", "JSONDecodeError"), ("nonsense", "ValueError")])
def test_a_platform_that_fails_makes_its_hub_fall_silent(mode: str, failure: str) -> None:
    platform = Platform()
    with driven(platform) as (planner, failures):
        planner.hears(True, "away")
        platform.mode = mode
        until(lambda: failures[failure] > 0)
        until(lambda: planner.mailbox.drain() == [] and not planner.mailbox.wait(0.5))
        platform.mode = "well"
        planner.ask(True, "buffer")
        planner.hears(True, "buffer")


@pytest.mark.parametrize(
    ("activate", "position", "status", "said"),
    [
        (True, "at", Status(READY, "at", None), ()),
        (True, "at", Status(READY, None, "at"), ()),
        (True, "at", Status(READY, "away", None), ("POST",)),
        (True, "at", Status(READY, None, "away"), ("DELETE", "POST")),
        (True, "at", Status(PAUSE, "at", None), ("PUT",)),
        (True, "at", Status(READY, "at", "away"), ("DELETE", "POST")),
        (False, "at", Status(READY, None, "at"), ("PUT",)),
        (False, "at", Status(PAUSE, "away", "at"), ()),
    ],
)
def test_what_is_said_follows_from_goal_and_status_alone(
    activate: bool, position: str, status: Status, said: tuple[str, ...]
) -> None:
    found = due({"r1.activate": activate, "r1.ref_pos": position}, status, "r1")
    assert tuple(each.method for each in found) == said


def test_a_place_that_the_scenario_does_not_know_is_unknown() -> None:
    assert measured(Status(READY, "the yard", None), "r1", ("away", "at", "unknown"))["r1.act_pos"] == "unknown"
    assert status_of({"state_id": 3, "position": "at", "mission": None, "battery": 7}) == Status(READY, "at", None)
    sound = {"state_id": 3, "position": "at", "mission": None}
    for wrong in (None, [], {}, {**sound, "state_id": True}, {**sound, "position": 1}):
        with pytest.raises(ValueError, match="no status"):
            status_of(wrong)


def test_the_example_runs_as_a_process(tmp_path: Path) -> None:
    file, where, platform = tmp_path / "r1.json", free_endpoint(), Platform()
    file.write_text(json.dumps(written(R1)))
    with served(platform) as url, router(RouterConfig((where,))), open_link(LinkConfig((where,))) as link:
        planner = Planner(link)
        line = [sys.executable, "-m", "bridge.examples.rest", str(file), url, "--connect", where]
        with subprocess.Popen(line, cwd=ROOT) as hub:
            try:
                planner.hears(True, "at", lambda: planner.ask(True, "at"))
            finally:
                hub.kill()
    assert platform.missions == ["at"]


def test_requests_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """A platform that accepts connections and never answers holds the hub up for no longer than the timeout."""
    monkeypatch.setattr("bridge.examples.rest.TIMEOUT", 0.05)
    import socket

    with socket.create_server(("127.0.0.1", 0)) as listener, pytest.raises(OSError, match="timed out"):
        http(f"http://127.0.0.1:{listener.getsockname()[1]}")(Say("GET", "/status"))
