"""Access control that was generated for a scenario, with certificates that are made here and now."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from bridge_certificates import authority, certificate
from bridge_wires import until

from bridge import keys
from bridge.access import OPERATOR, PLANNER, SPECTATOR, access_control, hub_name
from bridge.errors import LinkError
from bridge.link import Link, LinkConfig, open_link
from bridge.router import RouterConfig, free_endpoint, router
from smv_planner.errors import UsageError

pytestmark = pytest.mark.skipif(shutil.which("openssl") is None, reason="there is no openssl to make certificates with")


@pytest.fixture(scope="module")
def secured(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Callable[[str], Link], str, Path]]:
    """How to get a link as somebody, where, and the certificates."""
    folder = tmp_path_factory.mktemp("certificates")
    authority(folder, "authority")
    (folder / "acl.json").write_text(json.dumps(access_control("cell", ["r1", "r2"])))
    where = free_endpoint().replace("tcp/", "tls/")
    with ExitStack() as stack:
        stack.enter_context(router(RouterConfig((where,), certificate(folder, "router"), str(folder / "acl.json"))))
        opened: dict[str, Link] = {}

        def link(name: str) -> Link:
            if name not in opened:
                opened[name] = stack.enter_context(open_link(LinkConfig((where,), certificate(folder, name)), wait=20.0))
            return opened[name]

        yield link, where, folder


def test_goals_and_states_reach_whom_they_are_for(secured: tuple[Callable[[str], Link], str, Path]) -> None:
    link = secured[0]
    planner, r1, r2, spectator = link(PLANNER), link(hub_name("r1")), link(hub_name("r2")), link(SPECTATOR)
    at_r1, at_r2 = r1.latest(keys.goal("cell", "r1")), r2.latest(keys.goal("cell", "r1"), keys.goals("cell"))
    at_planner, seen = planner.latest(keys.state("cell")), spectator.latest(keys.goals("cell"), keys.state("cell"))
    goal, state = keys.goal("cell", "r1"), keys.state("cell", "r1")

    until(lambda: at_r1.wait(0.02), lambda: planner.publish(goal, b"goal"))
    until(lambda: at_planner.wait(0.02), lambda: r1.publish(state, b"state"))
    heard: dict[str, bytes] = {}

    def speak() -> None:
        planner.publish(goal, b"goal")
        r1.publish(state, b"state")

    until(
        lambda: heard.update(seen.drain()) or heard.keys() == {goal, state},
        speak,
    )
    assert at_r2.drain() == [], "a hub cannot listen to what another is told"


def test_what_is_forged_reaches_nobody(secured: tuple[Callable[[str], Link], str, Path]) -> None:
    link = secured[0]
    planner, r1, r2, spectator, operator = map(link, (PLANNER, hub_name("r1"), hub_name("r2"), SPECTATOR, OPERATOR))
    at_r1, at_planner = r1.latest(keys.goal("cell", "r1"), depth=1000), planner.latest(keys.state("cell"), depth=1000)
    arrived: list[bytes] = []

    def forge() -> None:
        for forger in (r2, spectator, operator):
            for key in (keys.goal("cell", "r1"), keys.state("cell", "r1"), keys.goals("cell"), "smv/**", "**"):
                forger.publish(key, b"forged")
        r1.publish(keys.goal("cell", "r1"), b"forged")
        planner.publish(keys.goal("cell", "r1"), b"true")
        r1.publish(keys.state("cell", "r1"), b"true")

    def enough() -> bool:
        arrived.extend(payload for _, payload in [*at_r1.drain(), *at_planner.drain()])
        return arrived.count(b"true") > 40

    until(enough, forge)
    assert set(arrived) == {b"true"}


def test_only_operators_give_orders(secured: tuple[Callable[[str], Link], str, Path]) -> None:
    link = secured[0]
    link(PLANNER).answer(keys.order("cell"), lambda order: b"done " + order)
    until(lambda: _asked(link(OPERATOR)) == b"done x")
    for other in (SPECTATOR, hub_name("r1")):
        assert _asked(link(other)) is None


def test_strangers_are_not_let_in(secured: tuple[Callable[[str], Link], str, Path]) -> None:
    _, where, folder = secured
    authority(folder, "foreign")
    foreign = certificate(folder, "smv-planner-2", signed_by="foreign")
    plain = where.replace("tls/", "tcp/")
    for config in (LinkConfig((where,), foreign), LinkConfig((plain,))):
        with pytest.raises(LinkError):
            open_link(config)


def test_access_control_that_controls_nothing_is_refused(tmp_path: Path) -> None:
    sound = access_control("cell", ["r1"])
    file = tmp_path / "acl.json"
    for text in ("", "[]", "{}", json.dumps({**sound, "enabled": False}), json.dumps({**sound, "default_permission": "allow"})):
        file.write_text(text)
        with pytest.raises(UsageError), router(RouterConfig((free_endpoint(),), None, str(file))):
            pass
    with pytest.raises(UsageError, match="cannot read"), router(RouterConfig((free_endpoint(),), None, str(tmp_path / "none"))):
        pass


def _asked(link: Link) -> bytes | None:
    try:
        return link.ask(keys.order("cell"), b"x", timeout=1.0)
    except LinkError:
        return None
