"""`smv-planner run` and `smv-planner config`: the daemon, and its settings."""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Mapping

from bridge import keys
from smv_planner import language
from smv_planner.cli import outcome
from smv_planner.cli.question import settings
from smv_planner.daemon.config import FILE, PREFIX, SETTINGS, Config, resolved, state_folder
from smv_planner.daemon.signals import Signals
from smv_planner.model.model import Model


def add_run(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scenario", metavar="SCENARIO", help="a scenario file, or a folder that holds model.yaml")
    parser.add_argument(
        "--set",
        metavar="VAR=VALUE",
        action="append",
        default=[],
        help="what products are like when a new journal begins; repeatable. What hubs measure and obey they say themselves",
    )
    add_settings(parser)


def add_config(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("action", choices=["show"], help="print all settings, as a file would have them")
    parser.add_argument("scenario", metavar="SCENARIO", help="a scenario file, or a folder that holds model.yaml")
    parser.add_argument("--origin", action="store_true", help="also say where each comes from")
    add_settings(parser)


def add_settings(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group(
        "settings", f"also in the environment, as {PREFIX}CELL for --cell, and in a TOML file, as 'cell'"
    )
    group.add_argument("--config", metavar="FILE", help=f"the file (default: {FILE}, if it is there)")
    for name, setting in SETTINGS.items():
        flag, default = "--" + name.replace("_", "-"), setting.default
        if setting.read is SETTINGS["insecure_lan"].read:
            group.add_argument(flag, action="store_true", help=setting.help)
        elif isinstance(default, tuple):
            group.add_argument(flag, metavar=setting.metavar, action="append", help=f"{setting.help} (default: {default[0]})")
        else:
            told = f" (default: {default})" if default is not None and name != "wait" else ""
            group.add_argument(flag, metavar=setting.metavar, help=setting.help + told)


def configured(asked: argparse.Namespace, model: Model, environment: Mapping[str, str] = os.environ) -> Config:
    found = resolved(vars(asked), environment, asked.config, {"cell": model.name}, state_folder(environment))
    keys.checked_cell(found["cell"].value)
    return found


def show_config(asked: argparse.Namespace) -> int:
    for name, found in configured(asked, language.load(asked.scenario)).items():
        if found.value is None and not asked.origin:
            continue
        line = f"{name} = {json.dumps(found.value)}"
        print(f"{line:<60}  # {found.origin}" if asked.origin else line)
    return outcome.REACHED


def run(asked: argparse.Namespace) -> int:
    signals = Signals()
    signals.remember_reload()  # the scenario may change while it is being read
    model = language.load(asked.scenario)
    config = configured(asked, model)
    given = settings(model, asked.set)
    from smv_planner.daemon.service import serve

    serve(model, asked.scenario, config, given, signals)
    return outcome.REACHED
