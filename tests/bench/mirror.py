"""How long a command takes until its hub mirrors it, beside bare Zenoh in the same run; and what is lost of how many states.

Hub and echo are processes of their own, and the router too. The command is a goal message to a hub of `bridge.hub`, answered
by the state that mirrors it; beside it, in turns, as many bytes come back from callbacks of Zenoh. Then one process says the
states of many hubs at several rates, and another hears them as the daemon does. `python -m tests.bench.mirror`, half a minute.
"""

from __future__ import annotations

import json
import sys
import threading
import time
from contextlib import ExitStack
from itertools import product
from pathlib import Path

import smv_planner as sp
from bridge import keys
from bridge.descriptions import Description, descriptions
from bridge.hub import Hub
from bridge.link import Link, LinkConfig, Mailbox, open_link, settings
from bridge.router import free_endpoint
from smv_planner.protocol.messages import GoalMessage, Rejected, decode_state, encode
from tests.bench.load import percentile, process

CELL = "bench"
ROUNDS, PAUSE = 400, 0.01
GATE = 3.0
"""How many times as long as bare Zenoh takes a command may take until it is mirrored, at the median."""

HUBS, RATES, SECONDS = (10, 100, 300), (10, 50), 3.0
PATIENCE = 30.0
BARE_OUT, BARE_BACK = "bare/out", "bare/back"


def main() -> int:
    with ExitStack() as stack:
        endpoint = free_endpoint()
        stack.enter_context(process([sys.executable, "-m", "smv_planner", "router", "--listen", endpoint]))
        for part in ("hub", "echo"):
            stack.enter_context(process([sys.executable, "-m", "tests.bench.mirror", part, endpoint]))
        link = stack.enter_context(open_link(LinkConfig((endpoint,)), wait=PATIENCE))
        commands, bare = in_turns(link, endpoint)
        print(f"command until mirrored, {ROUNDS} times, {1 / PAUSE:g} a second at most; in ms")
        print(f"{'':<10}{'p50':>8}{'p99':>8}")
        for name, took in (("bridge", commands), ("bare", bare)):
            print(f"{name:<10}{percentile(took, 0.5) * 1e3:8.2f}{percentile(took, 0.99) * 1e3:8.2f}")
        good = percentile(commands, 0.5) <= GATE * percentile(bare, 0.5)
        print(f"p50 within {GATE:g} times that of bare Zenoh: {'yes' if good else 'NO'}")
        print("states of many hubs, said by one process and heard by another")
        print(f"{'hubs':>6}{'Hz':>6}{'said':>8}{'lost':>8}{'p50 ms':>8}{'p99 ms':>8}")
        for hubs, rate in product(HUBS, RATES):
            row(link, endpoint, hubs, rate)
    return 0 if good else 1


def in_turns(link: Link, endpoint: str) -> tuple[list[float], list[float]]:
    """What a command and its mirror take, and what bytes to and fro take."""
    import zenoh

    door, states = described(), link.latest(keys.state(CELL, "door"))
    commands, bare, came = list[float](), list[float](), threading.Event()
    payload = b"x" * len(encode(goal(door, 1)))
    with zenoh.open(settings({"mode": "client", "connect/endpoints": [endpoint]})) as session:
        drop = zenoh.CongestionControl.DROP
        out = session.declare_publisher(BARE_OUT, congestion_control=drop, express=True)
        back = session.declare_subscriber(BARE_BACK, lambda _: came.set())
        for number in range(1, ROUNDS + 21):
            began = time.perf_counter()
            link.publish(keys.goal(CELL, "door"), encode(goal(door, number)))
            mirrored = heard(states, door, number)
            commands += [time.perf_counter() - began] if mirrored else []
            time.sleep(PAUSE)
            came.clear()
            began = time.perf_counter()
            out.put(payload)
            returned = came.wait(1.0)
            bare += [time.perf_counter() - began] if returned else []
            time.sleep(PAUSE)
        back.undeclare()
    assert min(len(commands), len(bare)) > 0.9 * ROUNDS, "so many came back that they tell something"
    return commands[-ROUNDS:], bare[-ROUNDS:]  # without those that found nobody yet


def heard(states: Mailbox, door: Description, number: int) -> bool:
    ends = time.monotonic() + 1.0
    while time.monotonic() < ends:
        states.wait(0.1)
        for _, payload in states.drain():
            message = decode_state(payload, door.interface)
            if not isinstance(message, Rejected) and message.goal_seq == number:
                return True
    return False


def goal(door: Description, number: int) -> GoalMessage:
    """Each asks for something else than the one before."""
    values = {"door.ref": "opened" if number % 2 else "closed", "door.lock": False}
    return GoalMessage(CELL, "door", 1, number, "bench", door.interface.model, values)


def described() -> Description:
    return descriptions(sp.load(Path(__file__).parents[2] / "scenarios" / "door"), CELL)["door"]


def row(link: Link, endpoint: str, hubs: int, rate: int) -> None:
    mailbox = link.latest(f"{CELL}/{hubs}/{rate}/*", depth=64)
    with process([sys.executable, "-m", "tests.bench.mirror", "many", endpoint, str(hubs), str(rate)]):
        late, numbers = list[float](), [list[int]() for _ in range(hubs)]
        while mailbox.wait(1.0 if late else PATIENCE):  # until it has become quiet
            now = time.monotonic()
            for key, payload in mailbox.drain():
                message = json.loads(payload)
                numbers[int(key.rpartition("/")[2])].append(message["seq"])
                late.append(now - message["at"])
    said = sum(max(each) - min(each) + 1 for each in numbers if each)
    lost = said - len(late)
    print(f"{hubs:>6}{rate:>6}{said:>8}{lost:>8}{percentile(late, 0.5) * 1e3:8.2f}{percentile(late, 0.99) * 1e3:8.2f}")


# --- the other processes ------------------------------------------------------------------------------------------------


def hub(endpoint: str) -> None:
    with Hub(described(), LinkConfig((endpoint,)), stale_after=1e6) as one:
        one.report({"door.pos": "closed", "door.locked": True})
        threading.Event().wait()


def echo(endpoint: str) -> None:
    import zenoh

    open_link(LinkConfig((endpoint,)), wait=PATIENCE).close()  # Zenoh itself waits for no router
    with zenoh.open(settings({"mode": "client", "connect/endpoints": [endpoint]})) as session:
        back = session.declare_publisher(BARE_BACK, congestion_control=zenoh.CongestionControl.DROP, express=True)
        with session.declare_subscriber(BARE_OUT, lambda sample: back.put(sample.payload.to_bytes())):
            threading.Event().wait()


def many(endpoint: str, hubs: int, rate: int) -> None:
    """Every period a message of each hub, of the size of a state."""
    filling = "x" * 300
    with open_link(LinkConfig((endpoint,)), wait=PATIENCE) as link:
        due = time.monotonic() + 0.5
        for number in range(int(rate * SECONDS) + 1):
            time.sleep(max(0.0, due - time.monotonic()))
            due += 1 / rate
            for each in range(hubs):
                said = json.dumps({"seq": number, "at": time.monotonic(), "values": filling})
                link.publish(f"{CELL}/{hubs}/{rate}/{each}", said.encode())
        time.sleep(1.0)  # what is on its way still goes


if __name__ == "__main__":
    match sys.argv[1:]:
        case []:
            raise SystemExit(main())
        case ["hub", where]:
            hub(where)
        case ["echo", where]:
            echo(where)
        case ["many", where, count, rate]:
            many(where, int(count), int(rate))
