"""The arguments by which commands find each other on the network."""

from __future__ import annotations

import argparse
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from math import inf
from typing import Any

from bridge.endpoints import LOOPBACK, Tls
from bridge.keys import checked_cell
from bridge.link import Link, LinkConfig, open_link
from smv_planner.daemon import config
from smv_planner.errors import Mistake, UsageError
from smv_planner.model.model import Model


def add_network(parser: argparse.ArgumentParser, cell: bool = True) -> None:
    group = parser.add_argument_group("the network")
    group.add_argument(
        "--connect",
        metavar="ENDPOINT",
        action="append",
        default=[],
        help=f"where the Zenoh router is; repeatable (default: {LOOPBACK})",
    )
    if cell:
        group.add_argument("--cell", metavar="NAME", help="which installation on this network (default: the scenario's name)")
    add_security(group)


def add_security(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--tls-authority", metavar="FILE", help="whose certificates are trusted, in PEM")
    group.add_argument("--tls-certificate", metavar="FILE", help="our certificate")
    group.add_argument("--tls-key", metavar="FILE", help="our key")
    group.add_argument("--insecure-lan", action="store_true", help="use addresses of other machines without any protection")


def tls(asked: argparse.Namespace) -> Tls | None:
    """Raises UsageError if only some of the three files are named."""
    files = asked.tls_authority, asked.tls_certificate, asked.tls_key
    if not any(files):
        return None
    if not all(files):
        hint = "--tls-authority, --tls-certificate and --tls-key go together"
        raise UsageError([Mistake("TLS needs three files", hint)])
    return Tls(*files)


def link_config(asked: argparse.Namespace) -> LinkConfig:
    """From the arguments; what they do not say, from the environment and the file, as `smv-planner run` has it."""
    return config.link_config(settings(asked))


def setting(asked: argparse.Namespace, name: str) -> Any:
    """One setting, from the same places."""
    return settings(asked)[name].value


def settings(asked: argparse.Namespace) -> config.Config:
    """All of them; flags that a command does not have count as not given."""
    return config.resolved(vars(asked), os.environ, None, {}, config.state_folder(os.environ))


def named_cell(asked: argparse.Namespace) -> str | None:
    """The cell that the arguments, the environment or the file name. Raises UsageError for what cannot be one."""
    named = setting(asked, "cell") if asked.cell is None else asked.cell
    return None if named is None else checked_cell(named)


def cell_of(asked: argparse.Namespace, model: Model) -> str:
    """The cell that is named, else the scenario's. Raises UsageError."""
    return named_cell(asked) or checked_cell(model.name)


@contextmanager
def linked(asked: argparse.Namespace, patient: bool = False) -> Iterator[Link]:
    """A link as the arguments say; a patient one waits for the router to be started."""
    with open_link(link_config(asked), inf if patient else 0.0) as link:
        yield link


def until_interrupted(seconds: float | None = None) -> None:
    """Ctrl-C and SIGTERM are KeyboardInterrupt here (`outcome.run`); for whoever waits for it that is the end, and no trouble."""
    with suppress(KeyboardInterrupt):
        threading.Event().wait(seconds)
