"""A hub for a mobile platform that speaks REST, as MiRCOM is one for its robots (FAIM, section 5.1).

    smv-planner interface scenarios/dummy_robots r1 > r1.json
    python -m bridge.examples.rest r1.json http://127.0.0.1:8080/api

The platform takes missions, which are events, into a queue; goals are state and come again and again. So each turn asks the
platform what it does, and says something only if that is not what it should do: nothing is remembered here that could be
wrong after a restart on either side. A platform that does not answer is not reported on, and the hub falls silent.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from http.client import HTTPException
from typing import Any
from urllib.error import HTTPError
from urllib.request import Request, urlopen

from bridge.endpoints import LOOPBACK
from bridge.hub import Hub
from bridge.link import LinkConfig
from smv_planner.errors import SmvPlannerError
from smv_planner.model.domains import Value

TURN = 0.1
TIMEOUT = 0.5
MAX_ANSWER = 64 * 1024

READY, PAUSE = 3, 4
"""State numbers of the platform."""


@dataclass(frozen=True, slots=True)
class Status:
    """What the platform says of itself: where it stands, None while it drives, and the mission that it is on."""

    state: int
    position: str | None
    mission: str | None


@dataclass(frozen=True, slots=True)
class Say:
    """One request."""

    method: str
    path: str
    body: Mapping[str, object] | None = None


def status_of(document: Any) -> Status:
    """Raises ValueError for what is no status: a device is trusted as little as a network."""
    match document:
        case {"state_id": int() as state, "position": str() | None as position, "mission": str() | None as mission}:
            if type(state) is int:  # and not a Boolean, which Python takes for one
                return Status(state, position, mission)
    raise ValueError("this is no status")


def due(goal: Mapping[str, Value], status: Status, name: str) -> tuple[Say, ...]:
    """What to say so that the platform does as it should; nothing if it does."""
    active, target = bool(goal[f"{name}.activate"]), str(goal[f"{name}.ref_pos"])
    if not active:
        return () if status.state == PAUSE else (Say("PUT", "/status", {"state_id": PAUSE}),)
    said = [] if status.state == READY else [Say("PUT", "/status", {"state_id": READY})]
    if status.mission is not None and status.mission != target:
        said.append(Say("DELETE", "/mission_queue"))
    if target not in (status.mission, status.position) or status.mission not in (None, target):
        said.append(Say("POST", "/mission_queue", {"mission_id": target}))
    return tuple(said)


def measured(status: Status, name: str, positions: tuple[Value, ...]) -> dict[str, Value]:
    """What the platform says, in the words of the scenario."""
    known = status.position in positions
    return {f"{name}.active": status.state == READY, f"{name}.act_pos": str(status.position) if known else "unknown"}


def serve(hub: Hub, ask: Callable[[Say], Any], failures: Counter[str], over: Callable[[], bool] = lambda: False) -> None:
    """Until it is over. `failures` counts what did not work with the device, by kind."""
    name = hub.interface.resource
    positions = hub.interface.measured[f"{name}.act_pos"].values
    while not over():
        goal = hub.wait(TURN)
        try:
            status = status_of(ask(Say("GET", "/status")))
            hub.report(measured(status, name, positions))
            for each in due(goal, status, name):
                ask(each)
        except (OSError, HTTPException, ValueError) as error:
            failures[type(error).__name__] += 1


def http(url: str) -> Callable[[Say], Any]:
    """How to ask a platform at this address. What it answers with is read up to a limit of time and size."""

    def ask(said: Say) -> Any:
        body = None if said.body is None else json.dumps(said.body).encode()
        request = Request(url + said.path, body, {"Content-Type": "application/json"}, method=said.method)
        try:
            with urlopen(request, timeout=TIMEOUT) as answer:
                return json.loads(answer.read(MAX_ANSWER) or b"null")
        except HTTPError as error:
            error.close()
            raise

    return ask


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m bridge.examples.rest", description="A hub for a platform that speaks REST.")
    parser.add_argument("interface", help="written by 'smv-planner interface'")
    parser.add_argument("url", help="of the platform, as in http://127.0.0.1:8080/api")
    parser.add_argument("--connect", default=LOOPBACK, help="where the Zenoh router is (default: %(default)s)")
    asked = parser.parse_args()
    if not asked.url.startswith(("http://", "https://")):
        parser.error("the address begins with http:// or https://")
    failures: Counter[str] = Counter()
    try:
        with Hub(asked.interface, LinkConfig((asked.connect,))) as hub:
            serve(hub, http(asked.url), failures)
    except SmvPlannerError as error:
        print(error, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(f"failures: {dict(failures)}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
