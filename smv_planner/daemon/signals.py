"""What signals have asked of the daemon."""

from __future__ import annotations

import signal

from smv_planner.lazy import dataclass


@dataclass
class Signals:
    """Handlers only set these: in a handler no lock may be taken."""

    stop: bool = False
    reload: bool = False

    def remember_reload(self) -> None:
        """From the first moment on: a SIGHUP that nobody listens to would kill us."""

        def reload(*_: object) -> None:
            self.reload = True

        signal.signal(signal.SIGHUP, reload)

    def listen(self) -> None:
        """Once there is something to end in order: until then SIGTERM and SIGINT end the process as they always do."""

        def stop(*_: object) -> None:
            self.stop = True

        self.remember_reload()
        signal.signal(signal.SIGTERM, stop)
        signal.signal(signal.SIGINT, stop)
