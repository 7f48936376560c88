"""A connection to the others, as this project uses Zenoh.

Always a client of a router: no scouting, no gossip, no shared memory, a short lease and fast retries, so that a router that
comes back is found within a second. What is sent may be dropped and is sent again anyway; what arrives is kept as the newest
of its key, so that neither a flood nor a slow reader can hold up other keys. Nothing of Zenoh is called in a callback, for
there are none: each subscription is read by a thread of its own (measured: a slow callback stalls the whole session).

A link does not survive a fork: what the child sends is silently lost. Start processes by spawning.
"""

from __future__ import annotations

import json
import threading
import time
import traceback
from collections import Counter, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol, Self

from bridge import keys
from bridge.endpoints import LOOPBACK, Tls, refuse_open
from bridge.errors import LinkError, RefusedError
from bridge.printable import printable
from smv_planner.errors import SmvPlannerError

if TYPE_CHECKING:
    import zenoh

MAX_BYTES = 64 * 1024
"""Longer messages between planner and hubs, and longer questions, are not even copied; none of ours is."""

MAX_DOCUMENT = 1024 * 1024
"""What planners tell everybody may be so long: of a large station it is more than any hub is told."""

MAX_KEYS = 4096
"""So many keys does a mailbox remember, whatever a wildcard lets in."""

PAUSE = 0.001
"""Seconds that a reader rests after it has taken what there was: a flood on one key wakes us so often and not more."""

BURST = 64
"""So many messages are taken between two rests."""

READER_ENDS = 2.0
"""Seconds that a reader is given to end; one that answers a question may take so long."""

WILD_RING = 1024
QUERIES = 64


@dataclass(frozen=True, slots=True)
class LinkConfig:
    """To which router. A router that dies is noticed after `lease` seconds."""

    connect: tuple[str, ...] = (LOOPBACK,)
    tls: Tls | None = None
    insecure_lan: bool = False
    lease: float = 2.0


class Mailbox(Protocol):
    """What has arrived and was not taken yet: for each key the newest payloads, as many as was asked for.

    `refused` counts what was thrown away unread, by reason: `oversize`, or `full` when there were too many keys.
    """

    @property
    def refused(self) -> Counter[str]: ...

    def drain(self) -> list[tuple[str, bytes]]:
        """Take everything: key and payload, the payloads of one key in the order of their arrival."""

    def wait(self, timeout: float | None = None) -> bool:
        """Until there is something, or the time is over; whether there is."""


class Link(Protocol):
    """Tests and other transports may have their own. Everything may be called from any thread; `with` closes."""

    @property
    def connected(self) -> bool:
        """Whether there is a router now, and all is heard and answered that was to be."""

    def publish(self, key: str, payload: bytes) -> None:
        """Send without waiting; what cannot be sent is dropped."""

    def latest(self, *topics: str, depth: int = 1, wake: Callable[[], None] | None = None) -> Mailbox:
        """Listen to keys, which may be wild. `wake` is called in another thread when something arrives, and must be quick.

        What this very link publishes is not heard.
        """

    def answer(self, key: str, function: Callable[[bytes], bytes]) -> None:
        """Answer questions with a function, in a thread of its own. A SmvPlannerError or ValueError is told to who asks."""

    def ask(self, key: str, payload: bytes = b"", timeout: float = 2.0) -> bytes:
        """Everybody who answers there is asked; the first answer that is no refusal. Raises LinkError."""

    def alive(self, key: str) -> None:
        """Be listed under this key as long as this link lives."""

    def present(self, topic: str, timeout: float = 1.0) -> tuple[str, ...]:
        """Who is listed, sorted."""

    def close(self) -> None: ...

    def __enter__(self) -> Self: ...

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None: ...


def open_link(config: LinkConfig | None = None, wait: float = 0.0) -> Link:
    """A link through the router, for which to wait so many seconds if it is not there yet. Once open it reconnects by itself.

    Raises UsageError for an endpoint that is not safe to use, LinkError if no router answers.
    """
    config = config or LinkConfig()
    lacking = "use tls/... with an authority, a certificate and a key"
    refuse_open(config.connect, config.tls is not None, config.insecure_lan, lacking)
    import zenoh

    until = time.monotonic() + wait
    while True:
        try:
            return _ZenohLink(zenoh.open(settings(_client(config))))
        except zenoh.ZError as error:
            if time.monotonic() >= until:
                where = ", ".join(config.connect)
                # Zenoh tells every refusal, also that of a certificate, as a timeout.
                raise LinkError(f"no router at {where} lets us in; 'smv-planner router' starts one ({_first(error)})") from error
        time.sleep(min(0.1, max(0.0, until - time.monotonic())))


def most(key: str) -> int:
    """How many bytes may be published there."""
    return MAX_DOCUMENT if key.startswith(keys.PLANNERS) else MAX_BYTES


def settings(values: dict[str, object]) -> zenoh.Config:
    """What all our sessions have in common, and `values`."""
    import zenoh

    config = zenoh.Config()
    common: dict[str, object] = {
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,
        "transport/link/rx/max_message_size": 2 * MAX_DOCUMENT,  # with what Zenoh adds to it
        "adminspace/enabled": False,
    }
    for path, value in {**common, **values}.items():
        config.insert_json5(path, json.dumps(value))
    return config


def _client(config: LinkConfig) -> dict[str, object]:
    values: dict[str, object] = {
        "mode": "client",
        "connect/endpoints": list(config.connect),
        "connect/timeout_ms": 0,
        "connect/retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 1.5},
        "transport/link/tx/lease": int(config.lease * 1000),
    }
    if config.tls:
        tls = "transport/link/tls/"
        values[tls + "root_ca_certificate"] = config.tls.authority
        values[tls + "connect_certificate"] = config.tls.certificate
        values[tls + "connect_private_key"] = config.tls.key
        values[tls + "enable_mtls"] = True
        values[tls + "verify_name_on_connect"] = True
    return values


class LatestMailbox:
    """A mailbox that somebody puts into."""

    def __init__(self, depth: int = 1, wake: Callable[[], None] | None = None) -> None:
        self.refused: Counter[str] = Counter()
        self._depth = depth
        self._wake = wake
        self._lock = threading.Lock()
        self._some = threading.Event()
        self._kept: dict[str, deque[bytes]] = {}

    def put(self, key: str, payload: bytes) -> None:
        with self._lock:
            if key not in self._kept:
                if len(self._kept) >= MAX_KEYS:
                    self.refused["full"] += 1
                    return
                self._kept[key] = deque(maxlen=self._depth)
            self._kept[key].append(payload)
            self._some.set()
        if self._wake:
            self._wake()

    def refuse(self, reason: str) -> None:
        with self._lock:
            self.refused[reason] += 1

    def drain(self) -> list[tuple[str, bytes]]:
        with self._lock:
            taken, self._kept = self._kept, {}
            self._some.clear()
        return [(key, payload) for key, payloads in taken.items() for payload in payloads]

    def wait(self, timeout: float | None = None) -> bool:
        return self._some.wait(timeout)


class _ZenohLink:
    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._readers: list[threading.Thread] = []
        self._kept: list[Any] = []
        """What Zenoh undeclares as soon as nobody refers to it."""

    @property
    def connected(self) -> bool:
        there = not self._session.is_closed() and bool(list(self._session.info.routers_zid()))
        return there and all(reader.is_alive() for reader in self._readers)

    def publish(self, key: str, payload: bytes) -> None:
        import zenoh

        with _ours(f"publish on '{key}'"):
            publisher = self._publishers.get(key)
            if publisher is None:
                drop = zenoh.CongestionControl.DROP
                publisher = self._session.declare_publisher(key, congestion_control=drop, express=True)
                self._publishers[key] = publisher
            publisher.put(payload)

    def latest(self, *topics: str, depth: int = 1, wake: Callable[[], None] | None = None) -> Mailbox:
        import zenoh

        mailbox = LatestMailbox(depth, wake)
        for key in topics:
            ring: Any = zenoh.handlers.RingChannel(WILD_RING if "*" in key else depth)
            with _ours(f"listen to '{key}'"):
                subscriber = self._session.declare_subscriber(key, ring, allowed_origin=zenoh.Locality.REMOTE)
            self._kept.append(subscriber)
            # The handler and not the subscriber is read: who reads a subscriber keeps others from undeclaring it.
            self._read(subscriber.handler, lambda sample: _keep(mailbox, sample), f"latest {key}")
        return mailbox

    def answer(self, key: str, function: Callable[[bytes], bytes]) -> None:
        import zenoh

        ring: Any = zenoh.handlers.RingChannel(QUERIES)
        with _ours(f"answer at '{key}'"):
            queryable = self._session.declare_queryable(key, ring, complete=True)
        self._kept.append(queryable)
        self._read(queryable.handler, lambda query: _answered(key, query, function), f"answer {key}")

    def ask(self, key: str, payload: bytes = b"", timeout: float = 2.0) -> bytes:
        import zenoh

        with _ours(f"ask '{key}'"):
            # By default Zenoh asks one of several, which may be the one that refuses, and holds replies back until all are in.
            everybody, at_once = zenoh.QueryTarget.ALL, zenoh.ConsolidationMode.NONE
            replies = self._session.get(key, payload=payload, timeout=timeout, target=everybody, consolidation=at_once)
            refusal = None
            for reply in replies:
                if reply.ok is not None:
                    return reply.ok.payload.to_bytes()
                refusal = printable(reply.err.payload.to_bytes().decode("utf-8", "replace")) if reply.err else None
        if refusal:
            raise RefusedError(refusal)
        raise LinkError(f"nobody answers at '{key}'")

    def alive(self, key: str) -> None:
        with _ours(f"be listed as '{key}'"):
            self._kept.append(self._session.liveliness().declare_token(key))

    def present(self, topic: str, timeout: float = 1.0) -> tuple[str, ...]:
        with _ours(f"ask who is at '{topic}'"):
            replies = self._session.liveliness().get(topic, timeout=timeout)
            return tuple(sorted(str(reply.ok.key_expr) for reply in replies if reply.ok is not None))

    def close(self) -> None:
        self._session.close()  # type: ignore[no-untyped-call]  # ends what the readers read
        # A thread that the interpreter ends while Zenoh has it takes the whole process down (SIGABRT).
        for reader in self._readers:
            if reader is not threading.current_thread():
                reader.join(READER_ENDS)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _read(self, handler: Any, take: Callable[[Any], None], name: str) -> None:
        import zenoh

        def read() -> None:
            while True:
                try:
                    burst = [handler.recv()]
                    while len(burst) < BURST and (more := handler.try_recv()) is not None:
                        burst.append(more)
                except zenoh.ZError:  # closed
                    return
                for each in burst:
                    try:
                        take(each)
                    except Exception:  # whatever one message does, the next is for this thread, too
                        traceback.print_exc()
                time.sleep(PAUSE)

        reader = threading.Thread(target=read, name=name, daemon=True)
        self._readers.append(reader)
        reader.start()


def _keep(mailbox: LatestMailbox, sample: zenoh.Sample) -> None:
    key = str(sample.key_expr)
    if len(sample.payload) > most(key):
        mailbox.refuse("oversize")
    else:
        mailbox.put(key, sample.payload.to_bytes())


def _answered(key: str, query: zenoh.Query, function: Callable[[bytes], bytes]) -> None:
    import zenoh

    with query:
        asked = query.payload
        try:
            if asked is not None and len(asked) > MAX_BYTES:
                raise ValueError(f"{len(asked)} bytes, at most {MAX_BYTES} are read")
            answer, refusal = function(asked.to_bytes() if asked is not None else b""), ""
        except (SmvPlannerError, ValueError) as error:
            answer, refusal = b"", str(error) or "refused"
        except Exception:  # a broken assumption of ours, which must not keep others from asking
            traceback.print_exc()
            answer, refusal = b"", "this is a mistake in who answers; its log says more"
        with suppress(zenoh.ZError):  # who asked may be gone
            if refusal:
                query.reply_err(refusal.encode("utf-8", "backslashreplace"))  # it may quote what JSON can say and UTF-8 cannot
            else:
                query.reply(key, answer)


@contextmanager
def _ours(doing: str) -> Iterator[None]:
    """What Zenoh refuses is a LinkError."""
    import zenoh

    try:
        yield
    except zenoh.ZError as error:
        raise LinkError(f"cannot {doing}: {_first(error)}") from error


def _first(error: Exception) -> str:
    """What Zenoh says, without where in its source it says so."""
    return str(error).partition(" at /")[0].strip()
