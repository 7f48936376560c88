"""The bench judges medians with a fifth of tolerance, and lets rows take turns."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[2]))  # `python -m tests.bench.bench` has the root there

from tests.bench.bench import RUNS, Figures, Gate, Row, bench, table


@pytest.mark.parametrize(("engine", "met"), [(8.0, True), (12.0, True), (12.1, False)])
def test_a_limit_is_missed_by_more_than_a_fifth(engine: float, met: bool) -> None:
    assert Gate("engine", most=10).met({"engine": engine}) is met


@pytest.mark.parametrize(("times", "met"), [(130.0, True), (101.0, True), (99.0, False)])
def test_a_ratio_is_missed_by_more_than_a_fifth(times: float, met: bool) -> None:
    assert Gate("times", least=120).met({"times": times}) is met


@pytest.mark.parametrize(("figures", "met"), [((10, 1200), True), ((20, 1200), False), ((15, None), True), ((20, None), None)])
def test_a_gate_may_be_met_by_another(figures: tuple[float, float | None], met: bool | None) -> None:
    engine, nusmv = figures
    answer: Figures = {"engine": engine} if nusmv is None else {"engine": engine, "nusmv": nusmv}
    compared = None if nusmv is None else ("engine", "nusmv")
    gate = Gate("times", least=900, otherwise=Gate("engine", most=13))
    (measured,) = bench([Row("any", lambda run: ("3 steps", answer), (gate,), compared)])
    assert measured.met is met
    assert measured.gates == ("times >= 900 or engine <= 13",)


def shown(name: str, engine: list[float], log: list[str], outcome: str = "3 steps") -> Callable[[int], tuple[str, Figures]]:
    def run(number: int) -> tuple[str, Figures]:
        log.append(name)
        return outcome, {"engine": engine[number], "nusmv": 1000.0}

    return run


def test_rows_take_turns_and_one_slow_run_does_not_count() -> None:
    log: list[str] = []
    compared = ("engine", "nusmv")
    slow, fast = [10.0, 10.0, 500.0, 10.0, 10.0], [2.0] * RUNS
    gate = (Gate("times", least=400),)
    first, second = bench(
        [Row("slow", shown("slow", slow, log), gate, compared), Row("fast", shown("fast", fast, log), gate, compared)]
    )
    assert log == ["slow", "fast"] * RUNS
    assert (first.medians["engine"], first.medians["times"], first.met) == (10.0, 100.0, False)
    assert (second.medians["times"], second.met) == (500.0, True)
    assert ["MISS" in line for line in list(table([first, second]))[1:]] == [True, False]


def test_what_is_undecided_meets_no_gate() -> None:
    (measured,) = bench([Row("hard", shown("hard", [1.0], [], "undecided"), (Gate("engine", most=10),), seconds=0)])
    assert (measured.met, measured.runs) == (False, 1)


def test_a_ratio_to_what_is_not_there_is_not_judged() -> None:
    (measured,) = bench([Row("alone", shown("alone", [1.0] * RUNS, []), (Gate("times", least=100),))])
    assert measured.met is None
