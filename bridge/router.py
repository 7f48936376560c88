"""A Zenoh router inside a Python process, where no zenohd is at hand.

It listens on loopback unless it is secured: with TLS, and with access control in a Zenoh configuration file of the user
(`smv-planner security acl` writes one from a scenario).
"""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from bridge.endpoints import LOOPBACK, Tls, refuse_open
from bridge.errors import LinkError
from bridge.link import MAX_BYTES, MAX_DOCUMENT, settings
from smv_planner.errors import Mistake, UsageError


@dataclass(frozen=True, slots=True)
class RouterConfig:
    """`access` is a JSON file with Zenoh's `access_control`.

    Between planner and hubs, and in questions, payloads above 64 KiB do not pass; elsewhere none above 1 MiB do.
    """

    listen: tuple[str, ...] = (LOOPBACK,)
    tls: Tls | None = None
    access: str | None = None
    insecure_lan: bool = False


@contextmanager
def router(config: RouterConfig | None = None) -> Iterator[None]:
    """A router as long as the context lasts.

    Raises UsageError for an endpoint that is not safe to use, LinkError if it cannot listen there.
    """
    config = config or RouterConfig()
    secured = config.tls is not None and config.access is not None
    refuse_open(config.listen, secured, config.insecure_lan, "use tls/... with certificates and --access-control")
    values = _values(config)
    import zenoh

    try:
        session = zenoh.open(settings(values))
    except zenoh.ZError as error:
        raise LinkError(f"no router can be started at {', '.join(config.listen)}: {_short(error)}") from error
    with session:
        yield


def free_endpoint() -> str:
    """An endpoint on loopback where nobody listens at this moment."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def _values(config: RouterConfig) -> dict[str, object]:
    values: dict[str, object] = {
        "mode": "router",
        "listen/endpoints": list(config.listen),
        "transport/link/tx/lease": 2000,
        # Of several that fit a key, the least counts. Who reads judges once more, for what is put to "**" passes by the first.
        "low_pass_filter": [
            _at_most(MAX_DOCUMENT, "documents", ["put", "delete", "reply"], "**"),
            _at_most(MAX_BYTES, "questions", ["query"], "**"),
            _at_most(MAX_BYTES, "hubs", ["put", "delete", "reply"], "smv/**"),
        ],
    }
    if config.tls:
        tls = "transport/link/tls/"
        values[tls + "root_ca_certificate"] = config.tls.authority
        values[tls + "listen_certificate"] = config.tls.certificate
        values[tls + "listen_private_key"] = config.tls.key
        values[tls + "enable_mtls"] = True
        values[tls + "close_link_on_expiration"] = True
        values["transport/link/protocols"] = ["tls", "quic"]
    if config.access:
        values["access_control"] = _access(config.access)
    return values


def _at_most(size: int, name: str, messages: list[str], key: str) -> dict[str, object]:
    return {"id": name, "flows": ["ingress"], "messages": messages, "key_exprs": [key], "size_limit": size}


def _access(path: str) -> object:
    try:
        with open(path, encoding="utf-8") as file:
            found = json.load(file)
    except (OSError, ValueError) as error:
        raise UsageError([Mistake(f"cannot read access control from '{path}': {error}")]) from error
    found = found.get("access_control", found) if isinstance(found, dict) else found
    # Zenoh takes a file in which it is off, or allows by default, without a word.
    if not isinstance(found, dict) or found.get("enabled") is not True or found.get("default_permission") != "deny":
        hint = "it needs 'enabled': true and 'default_permission': 'deny'"
        raise UsageError([Mistake(f"'{path}' controls no access", hint)])
    return found


def _short(error: Exception) -> str:
    return str(error).partition(" at /")[0].strip()
