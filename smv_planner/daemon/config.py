"""The daemon's settings, and where each comes from: flag, environment, file, scenario, default, in this order.

A setting is one line of `SETTINGS`. On the command line it is `--its-name`, in the environment `SMV_PLANNER_ITS_NAME`, in
TOML `its_name`.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from bridge.endpoints import LOOPBACK, Tls
from bridge.link import LinkConfig
from smv_planner.errors import Mistake, UsageError, did_you_mean
from smv_planner.lazy import dataclass

FILE = "smv-planner.toml"
PREFIX = "SMV_PLANNER_"

Read = Callable[[Any], Any]


def _text(value: Any) -> str:
    if type(value) is not str or not value:
        raise ValueError("expected text")
    return value


def _texts(value: Any) -> tuple[str, ...]:
    values = value.split(",") if type(value) is str else value
    if type(values) is not list or not all(type(each) is str for each in values):
        raise ValueError("expected texts, in the environment with commas between them")
    return tuple(each.strip() for each in values)


def _yes(value: Any) -> bool:
    known = {True: True, False: False, "true": True, "false": False, "1": True, "0": False}
    if type(value) not in (bool, str) or value not in known:
        raise ValueError("expected true or false")
    return known[value]


def _seconds(value: Any) -> float:
    seconds = float(value) if type(value) in (str, int, float) else -1.0
    if not 0 < seconds <= 1e6:
        raise ValueError("expected seconds: more than 0, at most 1000000")
    return seconds


def _port(value: Any) -> int:
    port = int(value) if type(value) in (str, int) else -1
    if not 0 <= port < 65536:
        raise ValueError("expected a port, or 0 for none")
    return port


def _one_of(*words: str) -> Read:
    def read(value: Any) -> str:
        if value not in words:
            raise ValueError("expected one of " + ", ".join(words))
        return str(value)

    return read


@dataclass(frozen=True, slots=True)
class Setting:
    read: Read
    default: Any
    help: str
    metavar: str = "VALUE"


SETTINGS: Mapping[str, Setting] = {
    "cell": Setting(_text, None, "which installation, where several share a network (default: the scenario's name)", "NAME"),
    "connect": Setting(_texts, (LOOPBACK,), "where the Zenoh router is; repeatable", "ENDPOINT"),
    "tls_authority": Setting(_text, None, "whose certificates are trusted, in PEM", "FILE"),
    "tls_certificate": Setting(_text, None, "our certificate", "FILE"),
    "tls_key": Setting(_text, None, "our key", "FILE"),
    "insecure_lan": Setting(_yes, False, "use addresses of other machines without any protection"),
    "wait": Setting(_seconds, 1e6, "how long to wait for the router at the start", "S"),
    "journal": Setting(_text, None, "the folder of the journal (default: by cell in the user's state folder)", "DIR"),
    "engine": Setting(_text, "auto", "who plans", "NAME"),
    "deadline": Setting(_seconds, 30.0, "how long a decision may take", "S"),
    "second_opinion": Setting(_text, "nusmv", "who is asked the same in the background, if it is there; or none", "NAME"),
    "log_format": Setting(_one_of("text", "json"), "text", "how the log is written to standard error: text or json"),
    "log_level": Setting(_one_of("debug", "info", "warning", "error"), "info", "what is logged: debug, info, warning or error"),
    "metrics": Setting(_port, 0, "the port on this machine where Prometheus finds metrics; 0 is none", "PORT"),
}


@dataclass(frozen=True, slots=True)
class Found:
    """A value and its origin, in words."""

    value: Any
    origin: str


Config = Mapping[str, Found]


def resolved(
    flags: Mapping[str, Any], environment: Mapping[str, str], file: str | None, scenario: Mapping[str, Any], home: str
) -> Config:
    """Every setting. Raises UsageError with all mistakes in the environment and the file."""
    mistakes: list[Mistake] = []
    path, written = _file(file or environment.get(PREFIX + "CONFIG"))
    for name in written:
        if name not in SETTINGS:
            mistakes.append(Mistake(f"{path}: there is no setting '{name}'", did_you_mean(name, SETTINGS)))
    for name in environment:
        word = name.removeprefix(PREFIX).lower()
        close = did_you_mean(word, SETTINGS)  # other parts of the project have variables of their own
        if name.startswith(PREFIX) and word not in SETTINGS and close:
            mistakes.append(Mistake(f"there is no setting '{name}'", close))
    found: dict[str, Found] = {}
    for name, setting in SETTINGS.items():
        variable = PREFIX + name.upper()
        sources = (
            (flags.get(name) or None, "flag --" + name.replace("_", "-")),
            (environment.get(variable), f"environment {variable}"),
            (written.get(name), f"file {path}"),
        )
        value, origin = next(((value, origin) for value, origin in sources if value is not None), (None, ""))
        if value is None:
            value, origin = (scenario[name], "scenario") if name in scenario else (setting.default, "default")
        else:
            try:
                value = setting.read(value)
            except ValueError as error:
                mistakes.append(Mistake(f"{origin}: '{name}' cannot be {value!r}: {error}"))
        found[name] = Found(value, origin)
    if mistakes:
        raise UsageError(mistakes)
    if found["journal"].value is None:
        found["journal"] = Found(os.path.join(home, "smv_planner", str(found["cell"].value)), "default")
    return found


def link_config(config: Config) -> LinkConfig:
    """Raises UsageError if only some of the three files of TLS are named."""
    files = [config[name].value for name in ("tls_authority", "tls_certificate", "tls_key")]
    if any(files) and not all(files):
        raise UsageError([Mistake("TLS needs three files", "--tls-authority, --tls-certificate and --tls-key go together")])
    return LinkConfig(tuple(config["connect"].value), Tls(*files) if all(files) else None, config["insecure_lan"].value)


def state_folder(environment: Mapping[str, str]) -> str:
    """Where programs keep what they need again, by the conventions of the desktop."""
    return environment.get("XDG_STATE_HOME") or os.path.join(os.path.expanduser("~"), ".local", "state")


def _file(named: str | None) -> tuple[str, Mapping[str, Any]]:
    path = Path(named or FILE)
    if named is None and not path.exists():
        return str(path), {}
    try:
        return str(path), tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise UsageError([Mistake(f"cannot read settings from '{path}': {error}")]) from error
