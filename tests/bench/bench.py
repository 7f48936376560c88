"""How long engines and kernel take: `python -m tests.bench.bench [--json FILE] [ROW ...]`, where a ROW is a part of a name.

Rows take turns, round after round, and each figure is the median of its runs: at least five, unless a row has used up its
time. Engine and check are timed apart, in milliseconds of processor time, those of child processes included; for what is
sent through a pipe it is time that passes. Every answer has to be accepted by the kernel, where nothing else is said. A
gate is missed by more than 20 per cent, or it is met. How the questions came about stands in `instances.py`.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cache, partial
from multiprocessing.connection import Connection
from pathlib import Path
from statistics import median, quantiles
from typing import TypeVar

from smv_planner import garbage
from smv_planner.check import CheckedPlan, check_plan, check_proof
from smv_planner.engines import ENGINES, Limits, auto
from smv_planner.problem import NotWithin, Problem, Reached, Undecided, Unreachable, Verdict
from tests.bench.instances import Instance, crowded, free, frozen, impossible, mutex, plans, replans, stations

ROOT = Path(__file__).parents[2]
BIN = Path(sys.executable).parent

RUNS = 5
SECONDS = 60.0
"""How long a row may take over all its runs, in seconds that pass; one run is made in any case."""

TOLERANCE = 1.2
LIMITS = Limits(deadline=20, memory=4 << 30, progress=lambda text: None)
QUESTIONS = 100
"""How many questions one run of re-planning asks; every run has others."""

Figures = Mapping[str, float]
"""Milliseconds by what took them, and how often one of them goes into another."""

Result = TypeVar("Result")


@dataclass(frozen=True)
class Gate:
    """A figure may be `most`, or has to be `least`, or else another gate be met; a fifth more or less is tolerated."""

    figure: str
    most: float | None = None
    least: float | None = None
    otherwise: Gate | None = None

    def met(self, figures: Figures) -> bool:
        if self.otherwise and self.otherwise.met(figures):
            return True
        value = figures.get(self.figure)
        if value is None:
            return False
        return (self.most is None or value <= self.most * TOLERANCE) and (self.least is None or value * TOLERANCE >= self.least)

    def judges(self, figures: Figures) -> bool:
        """Whether there is enough to say so."""
        return self.figure in figures or (self.otherwise is not None and self.otherwise.met(figures))

    def __str__(self) -> str:
        asked = f"{self.figure} <= {self.most:g}" if self.least is None else f"{self.figure} >= {self.least:g}"
        return f"{asked} or {self.otherwise}" if self.otherwise else asked


@dataclass(frozen=True)
class Row:
    """`run` makes one run: what came out, in words, and its figures. `times` is the second of `compared` over the first."""

    name: str
    run: Callable[[int], tuple[str, Figures]]
    gates: tuple[Gate, ...] = ()
    compared: tuple[str, str] | None = None
    seconds: float = SECONDS


@dataclass(frozen=True)
class Measured:
    name: str
    outcome: str
    runs: int
    medians: Figures
    least: Figures
    gates: tuple[str, ...]
    met: bool | None
    """None where there is no gate, or where what is compared with is not there."""


def processor() -> float:
    """Milliseconds of processor time that this process and its ended children have used."""
    used = os.times()
    return 1000 * (time.process_time() + used.children_user + used.children_system)


def timed(work: Callable[[], Result]) -> tuple[Result, float]:
    began = processor()
    result = work()
    return result, processor() - began


def outcome(verdict: Verdict) -> str:
    match verdict:
        case Reached(path):
            return f"{len(path)} steps"
        case Unreachable(proof):
            return f"proved: {type(proof).__name__.lower()}"
        case NotWithin(bound):
            return f"not within {bound}"
        case Undecided():
            return "undecided"


def accepted(problem: Problem, verdict: Verdict) -> bool:
    match verdict:
        case Reached():
            return isinstance(check_plan(problem, verdict), CheckedPlan)
        case Unreachable(proof):
            return check_proof(problem, proof) is None
    return True


def as_stated(instance: Instance, verdict: Verdict) -> bool:
    match verdict:
        case Reached(path):
            return len(path) == instance.length
        case Unreachable():
            return instance.length is None
    return isinstance(verdict, Undecided)


def asked(instance: Callable[[], Instance], run: int, reference: str | None, warm: bool, check: bool) -> tuple[str, Figures]:
    """A question to `auto`, to the checker, and to a reference engine. Without `check`, only the length is compared."""
    question = instance()
    problem = question.problem
    if not warm:  # an engine knows a system again by identity
        problem = replace(problem, system=replace(problem.system))
    elif isinstance(auto.ask(problem, LIMITS), Undecided):  # other rows had the processor's caches since
        return "undecided", {"engine": 1000 * LIMITS.deadline}
    verdict, engine = timed(partial(auto.ask, problem, LIMITS))
    assert as_stated(question, verdict), f"{question.name}: {outcome(verdict)}, not {question.length}"
    figures = {"engine": engine}
    if check:
        fine, figures["check"] = timed(partial(accepted, problem, verdict))
        assert fine, f"{question.name}: the checker refuses the answer"
    if reference:
        told, taken = timed(partial(ENGINES[reference].ask, problem, Limits(60, LIMITS.memory, LIMITS.progress)))
        assert as_stated(question, told), f"{question.name}: {reference} says {outcome(told)}"
        figures["nusmv"] = taken
    return outcome(verdict), figures


def replanned(run: int, again: bool) -> tuple[str, Figures]:
    """Many questions about one model, all of them new; or asked `again`, when the tables that they need are there."""
    engine, check, reached = [], [], 0
    problems = tuple(replans(QUESTIONS, seed=2021 + run))
    for problem in problems if again else ():
        auto.ask(problem, LIMITS)
    for problem in problems:
        verdict, taken = timed(partial(auto.ask, problem, LIMITS))
        engine.append(taken)
        fine, taken = timed(partial(accepted, problem, verdict))
        assert fine, "the checker refuses an answer"
        check.append(taken)
        reached += isinstance(verdict, Reached)
    hundredths = quantiles(engine, n=100, method="inclusive")
    return f"{reached} of {QUESTIONS} reached", {"engine": hundredths[49], "p99": hundredths[98], "check": median(check)}


def whole_process(arguments: Sequence[str], run: int) -> tuple[str, Figures]:
    """The command as a user calls it, beside an interpreter that imports what reading a scenario needs at least."""
    bare = partial(subprocess.run, (BIN / "python", "-c", "import yaml, lark"), check=True)
    _, imports = timed(bare)
    command = (BIN / "smv-plan", "--json", "--engine", "auto", *arguments)
    ended, taken = timed(partial(subprocess.run, command, check=True, capture_output=True, cwd=ROOT))
    return f"{json.loads(ended.stdout)['length']} steps", {"process": taken, "imports": imports}


def through_a_pipe(instance: Callable[[], Instance], run: int) -> tuple[str, Figures]:
    """A warm engine in a process of its own: what it costs that question and answer go through a pipe. Time that passes."""
    problem = instance().problem
    ours, theirs = multiprocessing.Pipe()
    child = multiprocessing.get_context("fork").Process(target=answer, args=(problem, theirs, ours))
    child.start()
    theirs.close()
    try:
        for _ in range(3):  # the last of them counts
            began = time.perf_counter()
            ours.send((problem.initial, problem.goals, problem.unusable, problem.bound))
            verdict, engine = ours.recv()
            passed = 1000 * (time.perf_counter() - began)
    finally:
        ours.close()
        child.join()
    assert accepted(problem, verdict)
    return outcome(verdict), {"pipe": passed - engine, "engine": engine}


def answer(blank: Problem, pipe: Connection, other: Connection) -> None:
    """The child: answers until the pipe is closed, of which it inherits the other end too."""
    other.close()
    while True:
        try:
            initial, goals, unusable, bound = pipe.recv()
        except EOFError:
            return
        began = time.perf_counter()
        problem = replace(blank, initial=initial, goals=goals, unusable=unusable, bound=bound)
        verdict = auto.ask(problem, LIMITS)
        pipe.send((verdict, 1000 * (time.perf_counter() - began)))


PROTOTYPE = ((220, 1.4), (199, 1.9), (141, 2.7), (120, 16), (583, 4.2), (900, 8.3))
"""How much faster than NuSMV 2.5.4 the prototype was, plan by plan, and its milliseconds: the least as in `facts/engines.md`.

Either will do: NuSMV answers what we export up to eight times faster than what the prototype was compared on.
"""


def rows(reference: str | None) -> Iterator[Row]:
    """All rows; each instance is built when it is first asked."""
    beside = None if reference is None else ("engine", "nusmv")

    def at(group: Callable[[], Iterable[Instance]], number: int) -> Callable[[], Instance]:
        return cache(lambda: tuple(group())[number])

    def ask(
        instance: Callable[[], Instance], told: str | None = None, warm: bool = True, check: bool = True
    ) -> Callable[[int], tuple[str, Figures]]:
        return lambda run: asked(instance, run, told, warm, check)

    names = ("A1 one bolt", "B1 one bolt", "E7 with maintenance", "tool handover", "two phi U goal", "two bolts")
    for number, (name, (times, most)) in enumerate(zip(names, PROTOTYPE, strict=True)):
        gate = Gate("times", least=times, otherwise=Gate("engine", most=most))
        yield Row(name, ask(at(plans, number), reference), (gate,), beside)
    for number, name in enumerate(("A1, r2 about", "B1, r2 about", "two bolts, r2 about")):
        yield Row(name, ask(at(crowded, number)))
    for number, name in enumerate(("E5 unreachable", "E6 unreachable", "E3 unreachable")):
        yield Row(name, ask(at(impossible, number)), (Gate("engine", most=1),))
    yield Row("re-plan, all new", partial(replanned, again=False))
    yield Row("re-plan, warm", partial(replanned, again=True), (Gate("engine", most=1), Gate("p99", most=15)))
    for number in (0, 1):
        instance = at(free, number)
        yield Row(f"B{number + 3} of 24 free, cold", ask(instance, warm=False), (Gate("engine", most=250),))
        yield Row(f"B{number + 3} of 24 free, warm", ask(instance), (Gate("engine", most=250),))
    yield Row("3-way mutex, aside, cold", ask(cache(mutex), warm=False), (Gate("engine", most=10_000),))
    entangled = cache(partial(mutex, entangled=True))
    yield Row("3-way mutex, entangled, cold", ask(entangled, warm=False), (Gate("engine", most=10_000),))
    yield Row("5 stations", ask(cache(partial(stations, 5))))
    # Not checked: from every state the kernel explores the effects of all stations in any order, which is out of proportion here.
    yield Row("50 stations, not checked", ask(cache(partial(stations, 50)), check=False), (Gate("engine", most=150),))
    yield Row("8 of 24 bolts, rest frozen", ask(cache(frozen)), (Gate("engine", most=10_000),), seconds=0)
    station = "scenarios/assembly_station"
    whole = Gate("times", most=2.5)
    compared = ("imports", "process")
    goal = (station, "--goal", "r1_connector.attached")
    yield Row("smv-plan --json, one goal", partial(whole_process, goal), (whole,), compared)
    yield Row("smv-plan --json, whole job", partial(whole_process, (station,)), (whole,), compared)
    yield Row("A1 through a pipe", partial(through_a_pipe, at(plans, 0)))


@dataclass
class Taken:
    """What a row has shown so far."""

    row: Row
    outcome: str = ""
    spent: float = 0.0
    runs: list[Figures] = field(default_factory=list)

    def again(self) -> bool:
        return not self.runs or (len(self.runs) < RUNS and self.spent < self.row.seconds)

    def run(self) -> None:
        began = time.monotonic()
        self.outcome, figures = self.row.run(len(self.runs))
        self.runs.append(figures)
        self.spent += time.monotonic() - began

    def measured(self) -> Measured:
        names = dict.fromkeys(name for figures in self.runs for name in figures)
        medians = {name: median(figures[name] for figures in self.runs if name in figures) for name in names}
        least = {name: min(figures[name] for figures in self.runs if name in figures) for name in names}
        row = self.row
        if row.compared:
            below, above = row.compared
            medians["times"], least["times"] = medians[above] / medians[below], least[above] / least[below]
        judged = bool(row.gates) and all(gate.judges(medians) for gate in row.gates)
        met = all(gate.met(medians) for gate in row.gates) and self.outcome != "undecided" if judged else None
        return Measured(row.name, self.outcome, len(self.runs), medians, least, tuple(map(str, row.gates)), met)


def bench(chosen: Sequence[Row]) -> list[Measured]:
    """Round after round; in a round every row that is not done yet runs once."""
    taken = [Taken(row) for row in chosen]
    while any(each.again() for each in taken):
        for each in taken:
            if each.again():
                print(f"\r\033[K{each.row.name}, run {len(each.runs) + 1}", end="", file=sys.stderr, flush=True)
                each.run()
    print("\r\033[K", end="", file=sys.stderr)
    return [each.measured() for each in taken]


COLUMNS = ("engine", "p99", "check", "nusmv", "process", "imports", "pipe", "times")


def table(results: Iterable[Measured]) -> Iterator[str]:
    """Medians in milliseconds; `times` is a ratio."""
    yield f"{'':28} {'':19} runs " + " ".join(f"{name:>8}" for name in COLUMNS) + "  gate"
    for each in results:
        figures = (f"{each.medians[name]:8.2f}" if name in each.medians else " " * 8 for name in COLUMNS)
        verdict = {True: "PASS ", False: "MISS ", None: ""}[each.met]
        line = f"{each.name:28} {each.outcome:19} {each.runs:4} {' '.join(figures)}  {verdict}{', '.join(each.gates)}"
        yield line.rstrip()


def main() -> None:
    garbage.look_seldom()  # as all do that plan
    parser = argparse.ArgumentParser(description="Time engines and checks on the questions that they are judged by.")
    parser.add_argument("rows", nargs="*", metavar="ROW", help="only rows whose name has this in it")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures to a file, too")
    parser.add_argument("--alone", action="store_true", help="do not ask NuSMV")
    told = parser.parse_args()
    if (BIN / "NuSMV").exists():
        os.environ.setdefault("SMV_PLANNER_NUXMV", str(BIN / "NuSMV"))
    reference = None if told.alone or ENGINES["nuxmv"].available() else "nuxmv"
    if reference is None and not told.alone:
        print("There is no NuSMV here (`make nusmv` builds it): nothing is compared with it.", file=sys.stderr)
    chosen = [row for row in rows(reference) if not told.rows or any(part in row.name for part in told.rows)]
    results = bench(chosen)
    print("\n".join(table(results)))
    if told.json:
        told.json.write_text(json.dumps([asdict(each) for each in results], indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
