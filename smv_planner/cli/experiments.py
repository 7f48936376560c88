"""`smv-planner experiments`: E1 to E9 beside Table 1 of the paper."""

from __future__ import annotations

import argparse
import json
import time
from functools import cache
from pathlib import Path

from smv_planner import garbage, language
from smv_planner.cli import outcome
from smv_planner.simulate.experiments import Row, experiments, total
from smv_planner.simulate.planning import planners
from smv_planner.simulate.script import cases

QUICK = ("auto", "sat", "explicit")
"""Engines that keep what they have learnt of a model. What others take does not depend on when they are asked."""


def add_experiments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scenario", metavar="SCENARIO", help="the folder of the scenario, with cases e1 to e9")
    parser.add_argument("--engine", metavar="NAME", default="auto", help="who plans (default: %(default)s)")
    parser.add_argument("--seed", metavar="N", type=int, default=0, help="what decides how fast devices are (default: 0)")
    parser.add_argument("--json", action="store_true", help='print {"rows": [...]}')


def run(asked: argparse.Namespace) -> int:
    garbage.look_seldom()
    found = cases(Path(asked.scenario), cache(language.load))
    warms_up = asked.engine in QUICK
    timed = planners(asked.engine, clock=time.perf_counter)
    rows = list(experiments(found, timed, again=warms_up, seed=asked.seed))
    if asked.json:
        told = {"engine": asked.engine, "seed": asked.seed, "rows": [row.to_json() for row in rows]}
        print(json.dumps(told, indent=2))
    else:
        show(rows, asked.engine, warms_up)
    return outcome.REACHED if all(row.as_published for row in rows) else outcome.NO_PLAN


def show(rows: list[Row], engine: str, warms_up: bool) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = max(console.width, 150)
    table = Table(title=f"Machines 2021, Table 1, and here (engine {engine}, milliseconds)", title_justify="left")
    table.add_column("")
    table.add_column("planning actions")
    table.add_column("paper", justify="right")
    for column in ("first time", "once more") if warms_up else ("here",):
        table.add_column(column, justify="right")
    table.add_column("operator: paper")
    table.add_column("operator: here")
    for row in rows:
        actions = [f"{one.name} ({one.times} times)" if one.times > 1 else one.name for one in row.warm]
        paper = dict(row.published.actions)
        several = len(row.warm) > 1
        lines: list[list[str]] = [
            [*actions, "in sum"] if several else actions,
            [*(str(paper.get(one.name, "-")) for one in row.warm), *([str(row.published.milliseconds)] if several else [])],
        ]
        for times in (row.cold, row.warm) if warms_up else (row.warm,):
            lines.append([*(_ms(one.seconds) for one in times), *([_ms(total(times))] if several else [])])
        here = [*row.operator] or ["None"]
        table.add_row(row.published.experiment, *map("\n".join, lines), row.published.operator, "\n".join(here), end_section=True)
    console.print(table)
    for row in rows:
        for difference in row.differences:
            console.print(f"{row.published.experiment}: {difference}", markup=False)
        if not row.as_published and not row.differences:
            console.print(f"{row.published.experiment}: the paper has other planning actions")


def _ms(seconds: float) -> str:
    return f"{1000 * seconds:.1f}"
