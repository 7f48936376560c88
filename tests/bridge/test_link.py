"""Links through a real router on loopback."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from bridge import keys
from bridge.endpoints import Tls, is_local
from bridge.errors import LinkError
from bridge.link import MAX_BYTES, MAX_DOCUMENT, Link, LinkConfig, open_link
from bridge.router import RouterConfig, free_endpoint, router
from smv_planner.errors import UsageError

ROOT = Path(__file__).parents[2]
PATIENCE = 20.0


@pytest.fixture(scope="module")
def endpoint() -> Iterator[str]:
    where = free_endpoint()
    with router(RouterConfig(listen=(where,))):
        yield where


@pytest.fixture
def one(endpoint: str) -> Iterator[Link]:
    with open_link(LinkConfig((endpoint,))) as link:
        yield link


@pytest.fixture
def other(endpoint: str) -> Iterator[Link]:
    with open_link(LinkConfig((endpoint,))) as link:
        yield link


def until(true: Callable[[], bool], repeat: Callable[[], object] = lambda: None) -> None:
    """Subscriptions take a moment to be known: keep doing until it has come to pass."""
    ends = time.monotonic() + PATIENCE
    while not true():
        assert time.monotonic() < ends, "it has not come to pass"
        repeat()
        time.sleep(0.01)


def test_the_newest_payload_of_every_key_is_kept(one: Link, other: Link) -> None:
    mailbox = other.latest("cell/*/state")
    seen: dict[str, bytes] = {}

    def send() -> None:
        for payload in (b"old", b"new"):
            for key in ("cell/a/state", "cell/b/state"):
                one.publish(key, payload)
        one.publish("cell/c/goal", b"not asked for")

    until(lambda: seen.update(mailbox.drain()) or seen == dict.fromkeys(("cell/a/state", "cell/b/state"), b"new"), send)


def test_a_deeper_mailbox_keeps_several_in_order(one: Link, other: Link) -> None:
    mailbox = other.latest("deep", depth=3)
    until(lambda: mailbox.wait(0.05), lambda: one.publish("deep", b"0"))
    mailbox.drain()
    for number in range(1, 10):
        one.publish("deep", b"%d" % number)
    kept: list[bytes] = []
    until(lambda: kept.extend(payload for _, payload in mailbox.drain()) or b"9" in kept)
    assert kept == sorted(kept)


def test_a_link_does_not_hear_itself(one: Link, other: Link) -> None:
    own, others = one.latest("self"), other.latest("self")
    until(lambda: others.wait(0.05), lambda: one.publish("self", b"x"))
    assert own.drain() == []


def test_whoever_waits_is_woken_by_a_call(one: Link, other: Link) -> None:
    woken = threading.Event()
    other.latest("wake", wake=woken.set)
    until(woken.is_set, lambda: one.publish("wake", b"x"))


@pytest.mark.parametrize(("key", "most"), [(keys.goal("cell", "r1"), MAX_BYTES), (keys.situation("cell"), MAX_DOCUMENT)])
def test_a_payload_that_is_too_long_passes_nowhere(key: str, most: int, one: Link, other: Link) -> None:
    """What planners tell everybody may be longer than what a hub is told."""
    mailbox = other.latest(key)
    until(lambda: mailbox.wait(0.05), lambda: one.publish(key, b"x"))
    longest = b"x" * most
    until(lambda: mailbox.drain() == [(key, longest)], lambda: one.publish(key, longest))
    one.publish(key, longest + b"x")
    until(lambda: mailbox.drain() == [(key, b"after")], lambda: one.publish(key, b"after"))
    assert mailbox.refused["oversize"] == 0  # the router of ours has not even passed it on


def test_a_long_payload_to_a_wild_key_is_not_read(one: Link, other: Link) -> None:
    mailbox = other.latest(keys.goal("cell", "r1"), depth=1000)
    until(lambda: mailbox.wait(0.05), lambda: one.publish("**", b"x"))
    until(lambda: mailbox.refused["oversize"] > 0, lambda: one.publish("**", b"x" * (MAX_BYTES + 1)))
    assert {len(payload) for _, payload in mailbox.drain()} == {1}


def test_what_is_no_key_is_refused(one: Link) -> None:
    does: tuple[Callable[[str], object], ...] = (
        one.latest,
        lambda key: one.answer(key, lambda asked: asked),
        one.alive,
        one.present,
        one.ask,
        lambda key: one.publish(key, b""),
    )
    for each in does:
        with pytest.raises(LinkError, match="cannot"):
            each("smv/x#/r1")
    assert one.connected


def test_questions_are_answered_and_refusals_say_why(one: Link, other: Link) -> None:
    def answer(asked: bytes) -> bytes:
        if asked == b"no":
            raise UsageError([])
        if asked == b"why":
            raise ValueError("because")
        return asked[::-1]

    one.answer("question", answer)
    until(lambda: _asked(other, "question", b"abc") == b"cba")
    with pytest.raises(LinkError, match="because"):
        other.ask("question", b"why")
    with pytest.raises(LinkError, match="nobody answers"):
        other.ask("nowhere")


def test_of_several_who_answer_one_that_refuses_does_not_count(endpoint: str, one: Link, other: Link) -> None:
    def refuses(_: bytes) -> bytes:
        raise ValueError("ask the other")

    with open_link(LinkConfig((endpoint,))) as third:
        one.answer("cell/several", refuses)
        until(lambda: _refusal(third, "cell/several") == "ask the other")
        other.answer("cell/several", lambda _: b"here I am")
        until(lambda: _refusal(third, "cell/several") is None)
        for _ in range(20):
            assert third.ask("cell/several") == b"here I am"


def _refusal(link: Link, key: str, payload: bytes = b"") -> str | None:
    try:
        link.ask(key, payload)
    except LinkError as error:
        return str(error)
    return None


def test_a_mistake_in_an_answer_does_not_keep_others_from_asking(one: Link, other: Link) -> None:
    def answer(asked: bytes) -> bytes:
        assert asked != b"break"
        return b"fine"

    one.answer("fragile", answer)
    until(lambda: _asked(other, "fragile", b"") == b"fine")
    with pytest.raises(LinkError, match="mistake"):
        other.ask("fragile", b"break")
    assert other.ask("fragile") == b"fine"


def test_a_refusal_that_quotes_what_is_no_text_is_told(one: Link, other: Link) -> None:
    """JSON may hold half a character."""

    def answer(asked: bytes) -> bytes:
        raise ValueError(f"nobody is named '{json.loads(asked)}'")

    one.answer("surrogate", answer)
    until(lambda: "nobody is named 'x'" in str(_refusal(other, "surrogate", b'"x"')))
    assert _refusal(other, "surrogate", rb'"\ud800"') == r"nobody is named '\ud800'"
    assert _refusal(other, "surrogate", b'"x"') == "nobody is named 'x'"
    assert one.connected


def test_a_reader_survives_whoever_it_wakes(one: Link, other: Link) -> None:
    woken = threading.Semaphore(0)

    def wake() -> None:
        woken.release()
        raise RuntimeError("who was woken fell over")

    other.latest("broken", wake=wake)
    for _ in range(3):
        until(lambda: woken.acquire(timeout=0.05), lambda: one.publish("broken", b"x"))
    assert other.connected


def test_who_is_alive_is_listed_until_its_link_closes(endpoint: str, other: Link) -> None:
    with open_link(LinkConfig((endpoint,))) as short:
        short.alive("cell/r1/alive")
        until(lambda: other.present("cell/*/alive") == ("cell/r1/alive",))
    until(lambda: other.present("cell/*/alive") == ())


def test_a_link_finds_a_router_that_is_started_late_and_again() -> None:
    where = free_endpoint()
    with pytest.raises(LinkError, match="smv-planner router"):
        open_link(LinkConfig((where,)))
    opened: list[Link] = []
    thread = threading.Thread(target=lambda: opened.append(open_link(LinkConfig((where,)), wait=PATIENCE)))
    thread.start()
    with router(RouterConfig((where,))):
        thread.join()
        assert opened[0].connected
    with opened[0] as link:
        until(lambda: not link.connected)
        with router(RouterConfig((where,))):
            until(lambda: link.connected)
            with open_link(LinkConfig((where,))) as other:
                mailbox = link.latest("back")
                until(lambda: mailbox.wait(0.05), lambda: other.publish("back", b"x"))


def test_a_flood_on_one_key_does_not_hold_up_another(one: Link, other: Link) -> None:
    flooded, quiet = other.latest("flood"), other.latest("quiet")
    until(lambda: quiet.wait(0.05), lambda: one.publish("quiet", b"0"))
    quiet.drain()
    for number in range(20_000):
        one.publish("flood", b"%d" % number)
        if number % 2_000 == 0:
            one.publish("quiet", b"%d" % number)
            until(lambda: quiet.drain() != [], lambda number=number: one.publish("quiet", b"%d" % number))  # type: ignore[misc]
    until(lambda: flooded.drain() != [], lambda: one.publish("flood", b"again"))


BUSY = """
import sys, threading
from bridge.link import LinkConfig, open_link
with open_link(LinkConfig((sys.argv[1],))) as link:
    boxes = [link.latest(f"busy/{number}") for number in range(50)]
    link.answer("busy/question", lambda asked: asked)
    boxes[0].wait(60)
"""


def test_a_process_with_readers_at_work_ends_cleanly(endpoint: str, one: Link) -> None:
    """Threads that Zenoh has are not ended by the interpreter: that would abort the process."""
    for _ in range(3):
        process = subprocess.Popen([sys.executable, "-c", BUSY, endpoint], cwd=ROOT, stderr=subprocess.PIPE, text=True)
        until(
            lambda process=process: process.poll() is not None,  # type: ignore[misc]
            lambda: [one.publish(f"busy/{number}", b"x") for number in range(50) for _ in range(5)],
        )
        assert (process.returncode, process.communicate()[1]) == (0, "")


@pytest.mark.parametrize(
    ("endpoint", "local"),
    [
        ("tcp/127.0.0.1:7447", True),
        ("tcp/127.9.9.9:1", True),
        ("tcp/localhost:7447", True),
        ("tcp/[::1]:7447", True),
        ("tls/127.0.0.1:7447?x=1", True),
        ("unixsock-stream//tmp/x", True),
        ("tcp/0.0.0.0:7447", False),
        ("tcp/[::]:7447", False),
        ("tcp/10.0.0.1:7447", False),
        ("tcp/localhost.example.org:7447", False),
        ("tcp/127.0.0.1.example.org:7447", False),
        ("tcp/:7447", False),
    ],
)
def test_only_this_machine_is_local(endpoint: str, local: bool) -> None:
    assert is_local(endpoint) is local


def test_other_machines_are_refused_unless_secured_or_told_so() -> None:
    files = Tls("ca.pem", "cert.pem", "key.pem")
    for config in (
        LinkConfig(("tcp/10.0.0.1:7447",)),
        LinkConfig(("tls/10.0.0.1:7447",)),
        LinkConfig(("tcp/10.0.0.1:7447",), files),  # files alone encrypt nothing
        LinkConfig(("nonsense",)),
    ):
        with pytest.raises(UsageError):
            open_link(config)
    for open_to_all in (
        RouterConfig(("tcp/0.0.0.0:0",)),
        RouterConfig(("tls/0.0.0.0:0",), files),
        RouterConfig(("tcp/0.0.0.0:0",), files, "acl.json"),
    ):
        with pytest.raises(UsageError), router(open_to_all):
            pass
    with router(RouterConfig(("tcp/0.0.0.0:0",), insecure_lan=True)):
        pass


def _asked(link: Link, key: str, payload: bytes) -> bytes | None:
    try:
        return link.ask(key, payload)
    except LinkError:
        return None
