"""The mirror monitor judges each field by itself, and the command says so by its exit status."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from bridge_wires import Network, until
from hypothesis import given
from hypothesis import strategies as st

from bridge import keys
from bridge.link import LinkConfig, open_link
from bridge.mirror import Mirrors, Unmirrored, hear, judge
from bridge.overheard import overheard
from bridge.router import RouterConfig, free_endpoint, router
from smv_planner.cli.watch import UNMIRRORED, Station, watch_mirrors
from smv_planner.model.domains import Value
from smv_planner.protocol.messages import GoalMessage, StateMessage, encode

ROOT = Path(__file__).parents[2]


def goal(seq: int, epoch: int = 1, **values: Value) -> GoalMessage:
    return GoalMessage("cell", "r1", epoch, seq, "p", "m", values)


def state(seq: int, **mirror: Value) -> StateMessage:
    return StateMessage("cell", "r1", "b", seq, "m", {}, mirror, 1, 1, "p")


def late(mirrors: Mirrors, at: float) -> list[str]:
    return [each.name for each in judge(mirrors, at)[1]]


def test_a_mirrored_command_is_fine_for_ever() -> None:
    mirrors = hear(hear(Mirrors(), goal(1, x=1, y=2), 0.0), state(1, x=1, y=2), 0.9)
    assert late(mirrors, 100.0) == []


def test_only_the_field_that_is_not_mirrored_is_late() -> None:
    mirrors = hear(hear(Mirrors(), goal(1, x=1, y=2), 0.0), state(1, x=1, y=3), 0.5)
    assert late(mirrors, 1.0) == []
    mirrors, found = judge(mirrors, 1.25)
    assert found == (Unmirrored("cell/r1", "y", 2, 3, 0.0),)
    assert late(mirrors, 9.0) == []  # said once


def test_a_hub_that_says_nothing_mirrors_nothing() -> None:
    assert late(hear(Mirrors(), goal(1, x=1), 0.0), 1.5) == ["x"]


def test_a_new_command_gives_its_field_time_and_others_none() -> None:
    mirrors = hear(hear(Mirrors(), goal(1, x=1, y=1), 0.0), state(1, x=0, y=0), 0.1)
    mirrors = hear(mirrors, goal(2, x=2, y=1), 0.8)
    assert late(mirrors, 1.5) == ["y"]
    assert late(mirrors, 2.0) == ["x", "y"]


def test_a_field_that_comes_late_may_be_late_again() -> None:
    mirrors, found = judge(hear(Mirrors(), goal(1, x=1), 0.0), 2.0)
    assert found
    mirrors, found = judge(hear(mirrors, state(1, x=1), 2.1), 2.1)
    assert not found
    assert late(hear(mirrors, state(2, x=0), 3.0), 5.0) == ["x"]


def test_true_does_not_mirror_one() -> None:
    assert late(hear(hear(Mirrors(), goal(1, x=True), 0.0), state(1, x=1), 0.1), 2.0) == ["x"]


def test_a_superseded_planner_commands_nothing() -> None:
    mirrors = hear(hear(Mirrors(), goal(1, epoch=2, x=1), 0.0), state(1, x=1), 0.1)
    assert late(hear(mirrors, goal(9, epoch=1, x=5), 0.2), 5.0) == []


@given(st.binary(max_size=300) | st.text(max_size=200).map(str.encode))
def test_whatever_is_overheard_is_a_message_or_nothing(payload: bytes) -> None:
    assert overheard(payload) is None


@given(
    st.sampled_from([goal(3, x=1, y=True), state(4, x="word")]),
    st.integers(0, 400),
    st.sampled_from([b"", b"0", b"-", b"1e9", b"NaN", b"[", b"{", b'"', b"9" * 30, b"null", b"\xff"]),
)
def test_a_damaged_message_is_overheard_as_one_of_its_kind_or_not_at_all(
    message: GoalMessage | StateMessage, place: int, damage: bytes
) -> None:
    payload = encode(message)
    assert overheard(payload) == message
    found = overheard(payload[:place] + damage + payload[place + 1 :])
    assert found is None or type(found) is type(message)


def test_a_spectator_is_told_of_changes_and_of_nothing_else() -> None:
    station = Station(Mirrors())
    key = keys.goal("cell", "r1")
    assert station.take(key, encode(goal(1, x=1)), 0.0) == "cell/r1 <- x = 1"
    assert station.take(key, encode(goal(2, x=1)), 0.1) is None
    assert station.take(key, b"?", 0.1) == f"unreadable: {key}"
    measured = replace(state(1, x=1), measured={"y": True})
    assert station.take(keys.state("cell", "r1"), encode(measured), 0.2) == "cell/r1: y = true"
    assert station.take(keys.event("cell"), b'{"text": "r1 is lost"}', 0.3) == "event: r1 is lost"
    plan = b'{"operations": [{"name": "bolt", "state": "waiting"}]}'
    assert station.take(keys.plan("cell"), plan, 0.3) == "plan: bolt waiting"
    assert station.take(keys.plan("cell"), plan, 0.3) is None
    assert station.take(keys.plan("cell"), b"[" * 60_000, 0.3) == f"unreadable: {keys.plan('cell')}"


def test_the_monitor_that_heard_no_command_has_judged_nothing() -> None:
    assert watch_mirrors(Network().link(), "*", 1.0, 0.05) == UNMIRRORED


@pytest.fixture(scope="module")
def where() -> Iterator[str]:
    endpoint = free_endpoint()
    with router(RouterConfig((endpoint,))):
        yield endpoint


@pytest.mark.parametrize(("mirrored", "status"), [(1, 0), (0, UNMIRRORED)])
def test_the_command_watches_from_outside(where: str, mirrored: int, status: int) -> None:
    line = [sys.executable, "-c", "from smv_planner.cli.main import main; raise SystemExit(main())"]
    line += ["watch", "--mirror", "--connect", where, "--cell", "cell", "--for", "2.5", "--within", "0.3" if status else "2"]
    watching = subprocess.Popen(line, cwd=ROOT, stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONUNBUFFERED": "1"})
    with open_link(LinkConfig((where,))) as link:
        numbers = iter(range(1, 10**6))

        def speak() -> None:
            number = next(numbers)
            link.publish(keys.goal("cell", "r1"), encode(goal(1, x=1, y=2)))
            link.publish(keys.state("cell", "r1"), encode(state(number, x=mirrored, y=2)))

        until(lambda: watching.poll() is not None, speak)
    out, _ = watching.communicate()
    assert watching.returncode == status, out
    assert ("x: commanded 1, mirrored 0" in out) is bool(status)
    assert "y: commanded" not in out
