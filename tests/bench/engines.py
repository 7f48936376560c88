"""How long engines and kernel take: `python tests/bench/engines.py`. Every answer is checked; compare within one run only.

For every question: `auto` cold (first question about a system), warm (the same question again), the kernel's check of the
plan or proof, and `explicit` as the yardstick, all in milliseconds of processor time, the least of several runs.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

import smv_planner as sp  # noqa: E402
from smv_planner.api import pose  # noqa: E402
from smv_planner.check import CheckedPlan, check_plan, check_proof  # noqa: E402
from smv_planner.engines import Limits, auto, explicit  # noqa: E402
from smv_planner.engines.auto.session import session_of  # noqa: E402
from smv_planner.planner.answer import Question  # noqa: E402
from smv_planner.problem import Problem, Reached, Undecided, Unreachable, Verdict  # noqa: E402

LIMITS = Limits(deadline=60, memory=4 << 30, progress=lambda text: None)
RUNS = 5

QUESTIONS = (
    ("door", Question(("door.pos == opened",))),
    ("door", Question(("door.pos == jammed",))),
    ("door", Question(("door.pos == opened",), formula="F G door.locked")),
    ("tool_change", Question(("tool_e == robot",))),
    ("dummy_robots", Question(("r1.act_pos == at", "r2.act_pos == at"))),
    ("assembly_station", Question(("r1.at_the_bolts",))),
    ("assembly_station", Question(("r1.act_pos == at_tool and r2.act_pos == at_tool",))),
    ("assembly_station", Question(("r1.at_the_bolts",), disabled=("r1_connector.attaches",), lost=("r2",))),
)


def least(run: Callable[[], object], runs: int = RUNS) -> float:
    """Milliseconds of processor time."""
    taken = []
    for _ in range(runs):
        began = time.process_time()
        run()
        taken.append(time.process_time() - began)
    return 1000 * min(taken)


def cold(problem: Problem) -> Verdict:
    session_of.cache_clear()
    return auto.ask(problem, LIMITS)


def accepted(problem: Problem, verdict: Verdict) -> bool:
    match verdict:
        case Reached():
            return isinstance(check_plan(problem, verdict), CheckedPlan)
        case Unreachable(proof):
            return check_proof(problem, proof) is None
    return False


def outcome(verdict: Verdict) -> str:
    match verdict:
        case Reached(path):
            return f"{len(path)} steps"
        case Unreachable(proof):
            return type(proof).__name__.lower()
        case Undecided(reason):
            return reason
    return str(verdict)


def main() -> None:
    models = {name: sp.load(ROOT / "scenarios" / name) for name in dict.fromkeys(name for name, _ in QUESTIONS)}
    print(f"{'cold':>8} {'warm':>8} {'check':>8} {'explicit':>9} {'ratio':>7}  outcome, question")
    for name, asked in QUESTIONS:
        problem = pose(models[name], asked)
        first = least(partial(cold, problem))
        verdict = auto.ask(problem, LIMITS)
        again = least(partial(auto.ask, problem, LIMITS))
        assert accepted(problem, verdict), f"{name}: {asked}"
        check = least(partial(accepted, problem, verdict))
        slow = least(partial(explicit.ask, problem, LIMITS), runs=1)
        print(
            f"{first:8.1f} {again:8.1f} {check:8.1f} {slow:9.1f} {slow / again:6.0f}x  "
            f"{outcome(verdict)}, {name}: {' ; '.join(asked.goals)}"
        )


if __name__ == "__main__":
    main()
