"""What systemd is told (sd_notify): datagrams to a socket that it names. Without systemd nothing happens."""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping
from contextlib import suppress


class Notify:
    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        self._where = environment.get("NOTIFY_SOCKET", "")

    def __call__(self, text: str) -> None:
        """As in `READY=1`; the watchdog is petted with `WATCHDOG=1`."""
        if not self._where:
            return
        where = "\0" + self._where[1:] if self._where.startswith("@") else self._where
        with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as out:
            out.sendto(text.encode(), where)
