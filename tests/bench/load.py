"""The daemon with a hundred hubs at 10 Hz and a busy processor, beside a bare asyncio and Zenoh loop in the same run.

The bare loop hears the same messages, parses them, and says as many goals: what remains for a planner that plans nothing. Both
tell by how much their ticks came too late. `python -m tests.bench.load`, some 45 seconds.
"""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from bridge import keys
from bridge.errors import LinkError
from bridge.link import Link, LinkConfig, open_link
from bridge.router import free_endpoint

HUBS, PERIOD, SECONDS = 100, 0.1, 20.0
CELL = "load"
GATE = 4.0
"""How many times as late as the bare loop's the daemon's ticks may be, at the 99th percentile."""

ARM = """\
  arm_{n}:
    silent_after: 5 s
    variables:
      to: {{kind: goal, domain: [a, b], initial: a}}
      at: {{kind: measured, domain: [a, b], initial: a}}
    transitions:
      go: {{kind: controlled, guard: to == a and at == a, actions: {{to: b}}}}
      arrives: {{kind: effect, guard: to == b and at == a, actions: {{at: b}}, within: 2 s}}
"""


def main() -> int:
    scenario = f"smv_planner: 1\nname: load\nperiod: {PERIOD * 1000:g} ms\nresources:\n"
    scenario += "".join(ARM.format(n=n) for n in range(HUBS))
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        (folder / "model.yaml").write_text(scenario)
        model, endpoint = str(folder / "model.yaml"), free_endpoint()
        to = ("--connect", endpoint, "--cell", CELL)
        start = lambda *words: stack.enter_context(process([sys.executable, "-m", "smv_planner", *words]))  # noqa: E731
        start("router", "--listen", endpoint)
        start("emulate", model, *to)
        port = int(free_endpoint().rpartition(":")[2])
        start("run", model, *to, "--journal", str(folder / "journal"), "--second-opinion", "none", "--metrics", str(port))
        stack.enter_context(process([sys.executable, "-c", "while True: pass"]))  # an engine at work
        with open_link(LinkConfig((endpoint,)), wait=30) as link:
            running(link)
            before = health(link)
            bare = asyncio.run(bare_loop(endpoint))
            after = health(link)
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics") as answer:
            told = [line for line in answer.read().decode().splitlines() if line.startswith("smv_planner_tick_late")]
    ours = [float(line.split()[1]) for line in told]
    theirs = [percentile(bare, 0.5), percentile(bare, 0.99)]
    heard = (after["counts"]["heard"] - before["counts"]["heard"]) / SECONDS
    print(f"{HUBS} hubs at {1 / PERIOD:g} Hz, one busy process beside them; lateness of ticks in ms")
    print(f"{'':<10}{'p50':>8}{'p99':>8}{'missed':>8}")
    row("daemon", ours, after["missed"] - before["missed"])
    row("bare loop", theirs, sum(late > PERIOD for late in bare))
    print(f"the daemon heard {heard:.0f} messages a second")
    good = ours[1] <= GATE * max(theirs[1], 0.001)
    print(f"p99 within {GATE:g} times the bare loop's: {'yes' if good else 'NO'}")
    return 0 if good else 1


def row(name: str, late: Sequence[float], missed: int) -> None:
    print(f"{name:<10}{late[0] * 1e3:8.2f}{late[1] * 1e3:8.2f}{missed:8}")


async def bare_loop(endpoint: str) -> Sequence[float]:
    """By how much each of its ticks was late."""
    loop, late = asyncio.get_running_loop(), []
    with open_link(LinkConfig((endpoint,)), wait=30) as link:
        woken = asyncio.Event()
        mailbox = link.latest(keys.state(CELL), wake=lambda: loop.call_soon_threadsafe(woken.set))

        async def hear() -> None:
            while True:
                await woken.wait()
                woken.clear()
                for _, payload in mailbox.drain():
                    json.loads(payload)

        hearing = asyncio.create_task(hear())
        goal = json.dumps({"values": {"to": "a"}, "of": "the bare loop"}).encode()
        due = loop.time() + PERIOD
        while len(late) * PERIOD < SECONDS:
            await asyncio.sleep(max(0.0, due - loop.time()))
            late.append(loop.time() - due)
            due += PERIOD
            for n in range(HUBS):
                link.publish(keys.goal(f"{CELL}_bare", f"arm_{n}"), goal)
        hearing.cancel()
    return late


def running(link: Link) -> None:
    ends = time.monotonic() + 60
    while True:
        try:
            if health(link)["phase"] == "running":
                return
        except LinkError:
            assert time.monotonic() < ends, "the daemon does not run"
        time.sleep(0.1)


def health(link: Link) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(link.ask(keys.health(CELL), timeout=5.0))
    return found


def percentile(values: Sequence[float], part: float) -> float:
    return sorted(values)[min(int(part * len(values)), len(values) - 1)]


@contextmanager
def process(command: Sequence[str]) -> Iterator[None]:
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield
    finally:
        child.kill()
        child.wait()


if __name__ == "__main__":
    raise SystemExit(main())
