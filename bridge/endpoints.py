"""Which addresses may be used: this machine's own freely, others only secured, or when told so explicitly.

Zenoh has no access control of its own accord. Whoever reaches the router may command every device.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from ipaddress import ip_address

from smv_planner.errors import Mistake, UsageError

PORT = 7447
LOOPBACK = f"tcp/127.0.0.1:{PORT}"


@dataclass(frozen=True, slots=True)
class Tls:
    """Files in PEM: who is trusted, and who we are. Both sides of a connection show a certificate."""

    authority: str
    certificate: str
    key: str


def is_local(endpoint: str) -> bool:
    """Whether what is reached there is this machine, by its text alone: a name other than `localhost` may be anybody."""
    protocol, _, address = endpoint.partition("/")
    if protocol.startswith("unixsock"):
        return True
    host = address.partition("?")[0].partition("#")[0].rpartition(":")[0].removeprefix("[").removesuffix("]")
    if host == "localhost":
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False


def is_encrypted(endpoint: str) -> bool:
    return endpoint.partition("/")[0] in ("tls", "quic")


def refuse_open(endpoints: Iterable[str], secured: bool, insecure_lan: bool, lacking: str) -> None:
    """Raises UsageError if one of the endpoints is open to others and not secured; `lacking` says what would secure it."""
    mistakes = []
    for endpoint in endpoints:
        protocol, _, address = endpoint.partition("/")
        if not protocol or (":" not in address and not protocol.startswith("unixsock")):
            mistakes.append(Mistake(f"'{endpoint}' is no endpoint", f"as in '{LOOPBACK}'"))
        elif not is_local(endpoint) and not insecure_lan and not (secured and is_encrypted(endpoint)):
            hint = f"{lacking}, or say --insecure-lan if everybody on that network may command the devices"
            mistakes.append(Mistake(f"'{endpoint}' is open to other machines and not secured", hint))
    if mistakes:
        raise UsageError(mistakes)
