"""What Prometheus is told, as text over HTTP on this machine alone; off unless a port is named."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING

from smv_planner.errors import Mistake, UsageError

if TYPE_CHECKING:
    from smv_planner.daemon.loop import Daemon


@contextmanager
def served(daemon: Daemon, port: int) -> Iterator[int | None]:
    """The port at which they are as long as the context lasts. Raises UsageError if somebody else has it."""
    if not port:
        yield None
        return

    class Answer(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            if self.path != "/metrics":
                self.send_error(404)
                return
            body = text(daemon).encode()
            self.send_response(200)
            self.send_header("Content-Type", "text/plain; version=0.0.4")
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format: str, *args: object) -> None:
            pass

    try:
        bound = ThreadingHTTPServer(("127.0.0.1", port), Answer)
    except OSError as error:
        why = f"metrics cannot be served on port {port}: {error.strerror or error}"
        raise UsageError([Mistake(why, "--metrics names another")]) from error
    with bound as server:
        server.daemon_threads = True
        threading.Thread(target=server.serve_forever, name="metrics", daemon=True).start()
        try:
            yield server.server_port
        finally:
            server.shutdown()


def text(daemon: Daemon) -> str:
    """In the exposition format of Prometheus."""
    now, pulse = daemon.situation, daemon.pulse
    late = sorted(pulse.late)
    cell = daemon.station.cell
    lines = []

    def metric(name: str, kind: str, what: str, *values: tuple[str, float]) -> None:
        lines.append(f"# HELP smv_planner_{name} {what}")
        lines.append(f"# TYPE smv_planner_{name} {kind}")
        for labels, value in values:
            lines.append(f'smv_planner_{name}{{cell="{cell}"{labels}}} {_number(value)}')

    health = daemon.health()
    metric("healthy", "gauge", "Whether the planner does its work.", ("", health["healthy"]))
    metric(
        "waiting",
        "gauge",
        "What the station waits for: a halt to end, a way to go on, the operator.",
        ("", len(health["waiting"])),
    )
    metric("connected", "gauge", "Whether there is a router.", ("", health["connected"]))
    metric("worker_starts_total", "counter", "Processes begun that plan.", ("", health["worker_starts"]))
    metric("phase", "gauge", "The phase it is in.", (f',phase="{now.phase.value}"', 1))
    metric("epoch", "gauge", "The epoch that hubs obey.", ("", now.epoch))
    metric("ticks_total", "counter", "Ticks.", ("", pulse.ticks))
    metric("missed_ticks_total", "counter", "Ticks that came a period late or more.", ("", pulse.missed))
    quantiles = [
        (f',quantile="{part}"', late[min(int(part * len(late)), len(late) - 1)] if late else 0.0) for part in (0.5, 0.99)
    ]
    metric("tick_late_seconds", "gauge", "By how much the last ticks came too late.", *quantiles)
    metric("lost_resources", "gauge", "Resources that are lost.", ("", len(now.lost)))
    metric("operator_requests", "gauge", "What the operator has not answered.", ("", len(now.wishes)))
    counts = [(f',what="{name}"', float(count)) for name, count in sorted(pulse.counts.items())]
    metric("counts_total", "counter", "Messages and events by kind.", *counts)
    return "\n".join(lines) + "\n"


def _number(value: float) -> str:
    """With all its digits: a counter that is rounded seems to stand still."""
    return str(int(value)) if value == int(value) else repr(value)
