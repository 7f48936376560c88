"""The hub library as the author of a driver uses it."""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from math import inf
from pathlib import Path

import pytest
from bridge_wires import Network, until

import smv_planner as sp
from bridge import keys
from bridge.descriptions import descriptions, read, written
from bridge.errors import LinkError
from bridge.hub import Hub
from bridge.link import LinkConfig, Mailbox, open_link
from bridge.router import RouterConfig, free_endpoint, router
from smv_planner.errors import UsageError
from smv_planner.protocol.hub import Hold, Safe
from smv_planner.protocol.messages import GoalMessage, Rejected, StateMessage, decode_state, encode

ROOT = Path(__file__).parents[2]
DOOR = descriptions(sp.load(ROOT / "scenarios/door"), "door")["door"]
SHUT = {"door.pos": "closed", "door.locked": True}
OPENED = {"door.ref": "opened", "door.lock": False}
CLOSED = {"door.ref": "closed", "door.lock": True}


def goal(epoch: int, seq: int, values: dict[str, object], planner: str = "p") -> bytes:
    return encode(GoalMessage("door", "door", epoch, seq, planner, DOOR.interface.model, values))  # type: ignore[arg-type]


class Planner:
    """The other end: says goals, hears states."""

    def __init__(self, network: Network) -> None:
        self.link = network.link()
        self.mailbox: Mailbox = self.link.latest(keys.state("door"), depth=1000)
        self.heard: list[StateMessage] = []

    def say(self, payload: bytes) -> None:
        self.link.publish(keys.goal("door", "door"), payload)

    def states(self) -> list[StateMessage]:
        for _, payload in self.mailbox.drain():
            message = decode_state(payload, DOOR.interface)
            assert not isinstance(message, Rejected)
            self.heard.append(message)
        return self.heard

    def last(self) -> StateMessage | None:
        return self.states()[-1] if self.states() else None

    def hears(self, true: Callable[[StateMessage], bool]) -> None:
        until(lambda: (last := self.last()) is not None and true(last))


@pytest.fixture
def network() -> Network:
    return Network()


@pytest.fixture
def planner(network: Network) -> Planner:
    return Planner(network)


def test_a_hub_says_nothing_before_its_driver_has_measured(network: Network, planner: Planner) -> None:
    with Hub(DOOR, network.link()) as hub:
        assert hub.wait(0.0) == CLOSED
        planner.say(goal(1, 1, OPENED))
        until(lambda: hub.goal == OPENED)
        assert planner.states() == []
        hub.report(SHUT)
        planner.hears(lambda state: state.mirror == OPENED and state.measured == SHUT)


def test_what_is_obeyed_is_mirrored_with_its_epoch(network: Network, planner: Planner) -> None:
    with Hub(DOOR, network.link(), stale_after=inf) as hub:
        hub.report(SHUT)
        planner.hears(lambda state: (state.epoch, state.planner) == (0, ""))
        planner.say(goal(3, 7, OPENED))
        planner.hears(lambda state: (state.epoch, state.goal_seq, state.planner) == (3, 7, "p") and state.mirror == OPENED)
        hub.report({**SHUT, "door.locked": False})
        planner.hears(lambda state: state.measured["door.locked"] is False)
        numbers = [state.seq for state in planner.states()]
        assert numbers == sorted(set(numbers))


def test_a_superseded_planner_moves_nothing(network: Network, planner: Planner) -> None:
    with Hub(DOOR, network.link(), stale_after=inf) as hub:
        hub.report(SHUT)
        planner.say(goal(5, 1, CLOSED, "new"))
        planner.say(goal(4, 9, OPENED, "old"))
        planner.say(goal(5, 9, OPENED, "other"))
        planner.say(b"nonsense")
        until(lambda: sum(hub.rejected.values()) == 3)
        assert hub.rejected == {"old_epoch": 1, "other_planner": 1, "malformed": 1}
        assert hub.goal == CLOSED


RETREAT = {**OPENED, "door.ref": "closed"}


@pytest.mark.parametrize(("deadman", "afterwards"), [(Hold(0.05), OPENED), (Safe({"door.ref": "closed"}, 0.05), RETREAT)])
def test_the_deadman_reaction_begins_when_no_planner_speaks(
    network: Network, planner: Planner, deadman: Hold | Safe, afterwards: dict[str, object]
) -> None:
    with Hub(replace(DOOR, deadman=deadman), network.link(), stale_after=inf) as hub:
        hub.report(SHUT)
        planner.say(goal(1, 1, OPENED))
        until(lambda: hub.goal == OPENED or hub.forsaken)
        until(lambda: hub.forsaken)
        assert hub.goal == afterwards
        planner.hears(lambda state: state.mirror == afterwards and state.epoch == 1)


def test_a_driver_that_hangs_is_not_taken_for_a_device_that_stands_still(network: Network, planner: Planner) -> None:
    described = replace(DOOR, period=0.01)
    with Hub(described, network.link(), stale_after=0.2) as hub:
        hub.report(SHUT)
        until(lambda: len(planner.states()) > 3)
        until(lambda: _quiet(planner, 0.3))
        hub.report(SHUT)
        before = len(planner.states())
        until(lambda: len(planner.states()) > before)


def _quiet(planner: Planner, seconds: float) -> bool:
    before = len(planner.states())
    return not planner.mailbox.wait(seconds) and len(planner.states()) == before


def test_a_goal_wakes_who_waits_for_it(network: Network, planner: Planner) -> None:
    with Hub(DOOR, network.link()) as hub:
        hub.wait(0.0)
        threading.Timer(0.05, lambda: planner.say(goal(1, 1, OPENED))).start()
        assert hub.wait(30.0) == OPENED


def test_in_asyncio_goals_come_as_they_change(network: Network, planner: Planner) -> None:
    async def drive() -> list[object]:
        seen: list[object] = []
        async with Hub(DOOR, network.link()) as hub:
            async for asked in hub.goals():
                seen.append(dict(asked))
                hub.report({**SHUT, "door.locked": bool(asked["door.lock"])})
                if len(seen) == 1:
                    planner.say(goal(1, 1, OPENED))
                else:
                    return seen
        return seen

    assert asyncio.run(asyncio.wait_for(drive(), 30)) == [CLOSED, OPENED]


def test_a_report_that_does_not_fit_is_the_drivers_mistake(network: Network) -> None:
    with Hub(DOOR, network.link()) as hub:
        for wrong in ({}, {**SHUT, "door.pos": "ajar"}, {**SHUT, "door.locked": 1}, {**SHUT, "wear": 0}):
            with pytest.raises(UsageError):
                hub.report(wrong)  # type: ignore[arg-type]


def test_a_description_is_read_as_it_was_written() -> None:
    for scenario in ("door", "assembly_station", "nutrunner", "engine_line"):
        for described in descriptions(sp.load(ROOT / "scenarios" / scenario), "cell-1").values():
            for deadman in (described.deadman, Hold(0.5), Safe(described.initial, 1.0)):
                this = replace(described, deadman=deadman)
                assert read(json.dumps(written(this))) == this


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"format": 1, "kind": "interface"}', '{"format": 2, "kind": "interface"}'])
def test_what_is_no_description_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="smv-planner interface"):
        read(text)


# `keys` are for other languages; ours makes its keys itself.
@pytest.mark.parametrize("part", [part for part in written(DOOR) if part != "keys"])
def test_a_description_with_a_broken_part_is_refused(part: str) -> None:
    for broken in (None, {"type": "none"}, 17):
        document = {**written(DOOR), part: broken}
        if part in ("resource", "model", "period") and broken is not None:
            continue
        with pytest.raises(UsageError):
            read(json.dumps({name: value for name, value in document.items() if value is not None}))


DRIVER = """
import sys, time
from bridge.hub import Hub
from bridge.link import LinkConfig
light = {"yaml", "jinja2", "rich", "pysat", "smv_planner.language", "smv_planner.planner", "smv_planner.api"} & set(sys.modules)
assert not light, light
with Hub(sys.argv[1], LinkConfig((sys.argv[2],))) as hub:
    while True:
        goal = hub.wait(0.02)
        hub.report({"door.pos": goal["door.ref"], "door.locked": goal["door.lock"]})
"""


def test_a_driver_in_a_process_of_its_own_needs_nothing_of_the_planner(tmp_path: Path) -> None:
    where, file = free_endpoint(), tmp_path / "door.json"
    file.write_text(json.dumps(written(DOOR)))
    # The driver comes first: it waits for the router.
    driver = subprocess.Popen([sys.executable, "-c", DRIVER, str(file), where], cwd=ROOT)
    try:
        with router(RouterConfig((where,))), open_link(LinkConfig((where,))) as link:
            mailbox, seen = link.latest(keys.state("door")), []

            def heard(true: Callable[[StateMessage], bool]) -> bool:
                seen.extend(decode_state(payload, DOOR.interface) for _, payload in mailbox.drain())
                return any(isinstance(message, StateMessage) and true(message) for message in seen[-1:])

            say = lambda: link.publish(keys.goal("door", "door"), goal(1, 1, OPENED))  # noqa: E731
            until(lambda: heard(lambda state: state.mirror == OPENED and state.measured["door.pos"] == "opened"), say)
            assert link.present(keys.alive("door")) == (keys.alive("door", "door"),)
            driver.kill()
            until(lambda: link.present(keys.alive("door")) == ())
    finally:
        driver.kill()
        driver.wait()


def test_a_hub_goes_on_when_its_router_is_back() -> None:
    """It has neither forgotten whom it obeys nor become another process."""
    where = free_endpoint()
    heard: list[StateMessage] = []
    with ExitStack() as first:
        first.enter_context(router(RouterConfig((where,))))
        with Hub(DOOR, LinkConfig((where,)), stale_after=inf) as hub:
            hub.report(SHUT)
            with open_link(LinkConfig((where,))) as link:
                until(lambda: hub.goal == OPENED, lambda: link.publish(keys.goal("door", "door"), goal(2, 1, OPENED)))
            first.close()
            with router(RouterConfig((where,))), open_link(LinkConfig((where,))) as link:
                mailbox = link.latest(keys.state("door"))

                def came() -> bool:
                    found = (decode_state(payload, DOOR.interface) for _, payload in mailbox.drain())
                    heard.extend(each for each in found if isinstance(each, StateMessage))
                    return len(heard) > 2

                until(came)
    assert len({state.boot for state in heard}) == 1
    assert (heard[-1].mirror, heard[-1].epoch) == (OPENED, 2)


def test_a_hub_without_a_router_says_so_when_it_is_not_to_wait() -> None:
    with pytest.raises(LinkError):
        Hub(DOOR, LinkConfig((free_endpoint(),)), wait=0.0).open()


def test_a_hub_whose_thread_broke_does_not_go_unnoticed(network: Network) -> None:
    link = network.link()

    def broken(key: str, payload: bytes) -> None:
        raise LinkError("the wire is cut")

    link.publish = broken  # type: ignore[method-assign]

    def drive(hub: Hub) -> None:
        while True:
            hub.wait(0.05)

    with Hub(DOOR, link) as hub:
        hub.report(SHUT)
        with pytest.raises(LinkError, match="cut"):
            drive(hub)
