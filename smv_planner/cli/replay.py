"""`smv-planner replay`: what a journal tells, and whether the decisions come out the same."""

from __future__ import annotations

import argparse
from pathlib import Path

from smv_planner import api, language
from smv_planner.cli import outcome
from smv_planner.cli.simulate import SCENARIO
from smv_planner.errors import Mistake, UsageError
from smv_planner.runner.records import Known
from smv_planner.runner.recovery import recover
from smv_planner.simulate.planning import planners, station
from smv_planner.simulate.replay import payloads, replay, segments
from smv_planner.simulate.view import Timelines, abilities, plan_lines, purpose, transcript, waits


def add_replay(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("journal", metavar="JOURNAL", help="the folder of a journal")
    parser.add_argument("--scenario", metavar="SCENARIO", help="what it is a journal of (default: what 'simulate' noted there)")
    parser.add_argument("--at", metavar="T", type=float, help="tell the story up to this time, and what was going on then")
    parser.add_argument("--engine", metavar="NAME", default="auto", help="who decides once more (default: %(default)s)")
    parser.add_argument("--trust", action="store_true", help="do not decide once more")


def run(asked: argparse.Namespace) -> int:
    folder = Path(asked.journal)
    of = station(language.load(asked.scenario or _noted(folder)))
    planning = planners(asked.engine)
    known = Known(of.model, api.widened_system)
    decide = None if asked.trust else lambda request: recover(of.model, request, planning)
    lines, decisions, different, events = Timelines(of), 0, 0, 0
    for told in replay(of, known, payloads(folder, of), decide):
        now = told.situation
        if asked.at is not None and now.at > asked.at:
            break
        events += 1
        lines.see(now)
        for note in told.notes:
            print(transcript(now.at, note))
        if told.answered is not None:
            decisions += 1
        if told.again is not None and told.answered is not None:
            different += 1
            print(
                f"{now.at:8.2f} s  differs    decided now: {'; '.join(action.name for action in told.again.actions) or 'nothing'}"
            )
    if asked.at is not None and lines.last is not None:
        _show(lines, asked.at)
    told_of = "not made again" if asked.trust else "all the same" if not different else f"{different} otherwise"
    print(f"\n{events} events, {decisions} decisions, {told_of}")
    return outcome.NO_PLAN if different else outcome.REACHED


def _noted(folder: Path) -> str:
    try:
        return (folder / SCENARIO).read_text(encoding="utf-8").strip()
    except OSError:
        segments(folder)  # of nothing there is nothing to be told
        raise UsageError([Mistake(f"'{folder}' does not say which scenario it is of", "name it with --scenario")]) from None


def _show(lines: Timelines, at: float) -> None:
    now, width = lines.last, 100
    assert now is not None
    print(f"\nat {at:g} s")
    for name, pursuit in now.intentions.items():
        print(f"  intention {name}: {pursuit.status.value}" + (f", {pursuit.reason}" if pursuit.reason else ""))
    for execution in now.executing:
        print(f"  operation {execution.task.name}: executing")
    for name, reason in now.failed.items():
        print(f"  operation {name}: in error, {reason}")
    print(f"  {purpose(now.following)}")
    for line in plan_lines(now.following):
        print(f"    {line}")
    for line in waits(lines.station, now):
        print(f"  waits for {line}")
    for owner, names in abilities(lines.station, now).items():
        print(f"  {owner}: {', '.join(names)}" if names else f"  {owner}: -")
    scale = max(at, 1.0) / width
    for name, line in lines.drawn(at, width, scale):
        print(f"  {name:<32} │{line.rstrip()}")
    print(f"  {'seconds':<32} │{lines.axis(at, width, scale)}")
