"""`smv-plan`: one question, one checked answer."""

from __future__ import annotations

import argparse
import gc
import json
import shlex
import sys
from collections.abc import Sequence

from smv_planner import __version__, garbage, language
from smv_planner.api import DEFAULT_DEADLINE, DEFAULT_ENGINE, plan
from smv_planner.cli import outcome
from smv_planner.cli.progress import Progress
from smv_planner.cli.question import add_question, settings
from smv_planner.errors import Mistake, UsageError
from smv_planner.planner.answer import Answer

DESCRIPTION = """\
Plan how a scenario reaches a goal. An engine is asked to prove that the goal cannot be reached; its counterexample,
replayed and accepted by an independent checker, is the plan. Its proof, if there is none, is checked as well."""

EXAMPLES = """\
examples:
  smv-plan scenarios/door --goal "door.pos == opened"
  smv-plan scenarios/door --goal free --goal "door.pos == closed" --set door.wear=2
  smv-plan scenarios/door --goal "door.pos == opened" --formula "G door.locked -> not door.moving" --json
"""


SECOND_ENGINE = "nusmv"

LONGEST_DEADLINE = 1e6
"""Seconds."""


def main() -> int:
    garbage.look_seldom()
    code = outcome.run(command, sys.argv[1:])
    gc.freeze()  # nor are they looked at when the process ends
    return code


def parser() -> argparse.ArgumentParser:
    parser = outcome.Arguments(
        prog="smv-plan",
        description=DESCRIPTION,
        epilog=f"{EXAMPLES}\n{outcome.EXIT_CODES}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"smv-plan {__version__}")
    add_question(parser)
    two_levels = parser.add_argument_group("without a goal")
    two_levels.add_argument(
        "--intention", metavar="NAME", action="append", default=[], help="plan this intention (default: all whose start holds)"
    )
    two_levels.add_argument(
        "--exit-forbidden", action="store_true", help="plan the way out of a forbidden state, with maintenance, to be approved"
    )
    answer = parser.add_argument_group("the answer")
    answer.add_argument(
        "--engine", metavar="NAME", default=DEFAULT_ENGINE, help="auto, sat, explicit, nusmv or nuxmv (default: %(default)s)"
    )
    answer.add_argument(
        "--second-opinion",
        metavar="ENGINE",
        nargs="?",
        const=SECOND_ENGINE,
        help="ask this engine too, and compare verdict and length (%(const)s if none is named); a difference is an error",
    )
    answer.add_argument(
        "--deadline",
        metavar="S",
        type=float,
        default=DEFAULT_DEADLINE,
        help="seconds until the search is given up (default: %(default)g)",
    )
    answer.add_argument(
        "--smv", metavar="PATH", help="also write the SMV text that is asked: a file, or a folder if it is several"
    )
    answer.add_argument("--json", action="store_true", help="print the answer as one JSON object")
    return parser


def command(arguments: Sequence[str]) -> int:
    """Answer the question that the arguments put; the exit code."""
    asked = parser().parse_args(arguments)
    _check(asked)
    model = language.load(asked.scenario)
    with Progress() as progress:
        answer = plan(
            model,
            asked.goal or None,
            intentions=asked.intention,
            exit_forbidden=asked.exit_forbidden,
            formula=asked.formula,
            set=settings(model, asked.set),
            maintenance=asked.maintenance,
            lift=asked.lift,
            disable=asked.disable,
            lose=asked.lose,
            ran=asked.ran,
            engine=asked.engine,
            second_opinion=asked.second_opinion,
            bound=asked.bound,
            deadline=asked.deadline,
            smv=asked.smv,
            progress=progress,
            command=shlex.join(["smv-plan", *arguments]),
        )
    if asked.json:
        print(json.dumps(answer.to_json(), indent=2))
    else:
        from smv_planner.cli.show import show_answer

        show_answer(model, answer)
    return exit_code(answer)


def _check(asked: argparse.Namespace) -> None:
    """Raises UsageError for arguments that do not go together."""
    kinds = [
        flag
        for flag, given in (("--goal", asked.goal), ("--intention", asked.intention), ("--exit-forbidden", asked.exit_forbidden))
        if given
    ]
    mistakes = []
    if len(kinds) > 1:
        mistakes.append(Mistake(f"{' and '.join(kinds)} do not go together", "they ask different questions"))
    if asked.formula and not asked.goal:
        mistakes.append(Mistake("--formula goes with --goal", "an intention has its own formula, in the scenario"))
    if not 0 < asked.deadline <= LONGEST_DEADLINE:
        mistakes.append(
            Mistake(f"the deadline is {asked.deadline:g}", f"it is in seconds, greater than 0, at most {LONGEST_DEADLINE:g}")
        )
    if mistakes:
        raise UsageError(mistakes)


def exit_code(answer: Answer) -> int:
    match answer.verdict:
        case "reached":
            return outcome.REACHED
        case "unreachable" | "invariant_violated":
            return outcome.NO_PLAN
        case "not_within":
            return outcome.UNDECIDED
        case "undecided":
            return outcome.UNDECIDED if answer.deadline else outcome.ENGINE_FAILED
