"""The daemon put together: scenario, journal, network, the process that plans, signals, systemd; and the other way round.

SIGTERM and SIGINT end it, SIGHUP has it read its scenario again.
"""

from __future__ import annotations

import logging
import os
import secrets
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import Any

from bridge.errors import LinkError
from bridge.link import Link, LinkConfig, open_link
from smv_planner import api, language
from smv_planner.daemon import chronicle as chronicles
from smv_planner.daemon import logs, metrics
from smv_planner.daemon.config import Config, link_config
from smv_planner.daemon.loop import Daemon
from smv_planner.daemon.notify import Notify
from smv_planner.daemon.planners import Worker, job
from smv_planner.daemon.reload import changes, moved
from smv_planner.daemon.signals import Signals
from smv_planner.daemon.sizes import too_large
from smv_planner.daemon.status import Status
from smv_planner.engines import ENGINES
from smv_planner.errors import EngineError, Mistake, SmvPlannerError, UsageError, did_you_mean
from smv_planner.journal import Folder, Refused, Unwritten
from smv_planner.lazy import replace
from smv_planner.model.domains import Value
from smv_planner.model.model import Model
from smv_planner.protocol.interface import interfaces
from smv_planner.runner.records import Known, Unreadable
from smv_planner.runner.situation import Situation, Station, at_rest

log = logging.getLogger("smv_planner.daemon")


LOOK = 0.2
"""So often is looked after signals while there is no router."""


def serve(model: Model, path: str, config: Config, given: Mapping[str, Value], signals: Signals) -> None:
    """Plan for a station until told to stop. A new journal begins with the values `given` for products.

    A reload that `signals` remember from before is made up for.

    Raises UsageError, EngineError, LinkError.
    """
    settings = {name: found.value for name, found in config.items()}
    link = link_config(config)
    logs.begin(settings["log_format"], settings["log_level"])
    signals.listen()  # before there is anything to wait for
    following = model
    while not signals.stop:
        following = _reign(following, path, settings, link, signals, given)


def _reign(
    model: Model, path: str, settings: Mapping[str, Any], where: LinkConfig, signals: Signals, given: Mapping[str, Value]
) -> Model:
    """One model's time; the model to go on with, unless it is all over."""
    cell: str = settings["cell"]
    station = Station(model, api.widened(model), cell)
    if mistakes := list(too_large(station.interfaces)):
        raise UsageError(mistakes)
    known = Known(model, api.widened_system)
    second = _second(settings["engine"], settings["second_opinion"])
    notify = Notify()
    with ExitStack() as stack:
        try:
            folder = Folder(settings["journal"])
            stack.callback(folder.close)
            chronicle, situation, torn = chronicles.opened(folder, station, known, _begun(station, given))
        except (Refused, Unreadable) as error:
            raise UsageError([Mistake(str(error), "--journal names another folder")]) from error
        except Unwritten as error:  # a full disk may have room again: worth another start
            raise EngineError(str(error)) from error
        if torn:
            log.warning("%d bytes that a crash left unfinished were cut off the journal", torn)
        alarm = threading.Event()
        asking = job(known, settings["engine"], settings["deadline"], second, settings["journal"])
        worker = Worker(asking, known, alarm.set)
        stack.callback(worker.close)
        link = opened(where, settings["wait"], signals, notify)
        if link is None:
            return model
        stack.enter_context(link)
        daemon = Daemon(station, situation, link, chronicle, worker, alarm)
        stack.enter_context(metrics.served(daemon, settings["metrics"]))
        status = Status(settings["journal"], daemon.patience)
        stack.callback(status.clear)
        coming = Coming(path, model, cell)

        def turned() -> None:
            notify("WATCHDOG=1")
            if signals.stop:
                daemon.stop()

        def ticked() -> None:
            status.tell(daemon.health())
            if signals.reload and not coming.loading:
                signals.reload = False
                coming.load()
            if not daemon.situation.executing and coming.take_over(chronicle, daemon.situation):
                daemon.stop()

        daemon.ticked, daemon.turned = ticked, turned
        log.info("cell '%s', model %s, process %d", cell, model.hash[:12], os.getpid())
        notify("READY=1")
        daemon.run(f"planner-{secrets.token_hex(4)}")
        notify("STOPPING=1" if signals.stop else "RELOADING=1")
        if coming.taken is not None:
            return coming.taken
        chronicle.close(daemon.situation)
    return model


class Coming:
    """What the scenario says now: read in a thread of its own, for ticks do not wait, and taken over between two operations."""

    def __init__(self, path: str, model: Model, cell: str) -> None:
        self._path, self._model, self._cell = path, model, cell
        self._thread: threading.Thread | None = None
        self._loaded: Model | None = None
        self.taken: Model | None = None

    @property
    def loading(self) -> bool:
        return self._thread is not None and self._thread.is_alive()

    def load(self) -> None:
        self._thread = threading.Thread(target=self._load, name="reload", daemon=True)
        self._thread.start()

    def take_over(self, chronicle: chronicles.Chronicle, now: Situation) -> bool:
        """Whether the journal is the new scenario's from now on, so that the old one may not go on."""
        if self._loaded is None or self.loading:
            return False
        loaded, self._loaded = self._loaded, None
        try:
            chronicle.become(loaded.hash, moved(loaded, now, self._model))
        except Unwritten as error:
            log.error("the old scenario stays, for the journal cannot be begun anew: %s", error)
            return False
        self.taken = loaded
        return True

    def _load(self) -> None:
        self._loaded = reloaded(self._path, self._model, self._cell)


def opened(where: LinkConfig, wait: float, signals: Signals, notify: Callable[[str], None]) -> Link | None:
    """A link as soon as there is a router; None if a signal ends the wait. Raises LinkError when it has been too long."""
    ends = time.monotonic() + wait
    while not signals.stop:
        left = ends - time.monotonic()
        try:
            return open_link(where, max(0.0, min(left, LOOK)))
        except LinkError:
            if left <= LOOK:
                raise
        notify("WATCHDOG=1")  # we may have been ready before, under another scenario
    return None


def _begun(station: Station, given: Mapping[str, Value]) -> Situation:
    state = tuple(given.get(variable.name, variable.initial) for variable in station.system.variables)
    return replace(at_rest(station), state=state)


def reloaded(path: str, model: Model, cell: str) -> Model | None:
    """What the scenario says now, if that is something else and holds."""
    try:
        found = language.load(path)
        if mistakes := list(too_large(interfaces(found, cell))):
            raise UsageError(mistakes)
        api.widened(found)  # takes its time now, and none when it takes over
    except (SmvPlannerError, OSError) as error:
        log.error("the scenario has mistakes, the old one stays: %s", error)
        return None
    if found.hash == model.hash:
        log.info("the scenario has not changed")
        return None
    for change in changes(model, found):
        log.info("%s", change)
    log.info("the new scenario takes over as soon as no operation executes; its hubs have to know it too")
    return found


def _second(engine: str, name: str) -> str | None:
    """The engine of second opinions, if there is one here."""
    for each in (engine, *([] if name == "none" else [name])):
        if each not in ENGINES:
            raise UsageError([Mistake(f"there is no engine '{each}'", did_you_mean(each, ENGINES) or ", ".join(ENGINES))])
    missing = ENGINES[engine].available()
    if missing:
        raise EngineError(missing)
    if name in ("none", engine):
        return None
    reason = ENGINES[name].available()
    if reason:
        log.info("no second opinions: %s", reason)
    return None if reason else name
