"""The arguments that put a question to a scenario; shared by every command that asks one."""

from __future__ import annotations

import argparse

from smv_planner import language
from smv_planner.api import DEFAULT_BOUND
from smv_planner.errors import Mistake, UsageError
from smv_planner.model.domains import Value
from smv_planner.model.model import Model


def add_question(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scenario", metavar="SCENARIO", help="a scenario file, or a folder that holds model.yaml")
    group = parser.add_argument_group("the question")
    for flags, options in QUESTION.items():
        group.add_argument(flags, **options)  # type: ignore[arg-type]


def settings(model: Model, texts: list[str]) -> dict[str, Value]:
    """The values of `--set`, checked against the model.

    Raises UsageError with every mistake in them.
    """
    values: dict[str, Value] = {}
    mistakes: list[Mistake] = []
    for text in texts:
        try:
            name, value = language.setting(model, text)
            if name in values:
                mistakes.append(Mistake(f"'{name}' is set twice", "a start has one value of each variable"))
            values[name] = value
        except UsageError as error:
            mistakes += error.mistakes
    if mistakes:
        raise UsageError(mistakes)
    return values


QUESTION: dict[str, dict[str, object]] = {
    "--goal": {
        "metavar": "EXPR",
        "action": "append",
        "default": [],
        "help": "reach a settled state in which this holds; repeat for several, which need not hold at once",
    },
    "--formula": {"metavar": "EXPR", "help": "LTL that must hold until each goal is reached: 'EXPR U goal'"},
    "--set": {
        "metavar": "VAR=VALUE",
        "action": "append",
        "default": [],
        "help": "start with another value than the initial one; repeatable",
    },
    "--maintenance": {"action": "store_true", "help": "let the plan use maintenance transitions, which the operator performs"},
    "--lift": {"metavar": "INVARIANT", "action": "append", "default": [], "help": "plan without this invariant; repeatable"},
    "--disable": {
        "metavar": "TRANSITION",
        "action": "append",
        "default": [],
        "help": "do not plan on this transition, as on an effect that timed out; repeatable",
    },
    "--lose": {
        "metavar": "RESOURCE",
        "action": "append",
        "default": [],
        "help": "do not plan on this resource, as on one whose hub is silent; repeatable",
    },
    "--ran": {
        "metavar": "OPERATION",
        "action": "append",
        "default": [],
        "help": "this operation of a prescribed sequence has run already; repeatable",
    },
    "--bound": {
        "metavar": "N",
        "type": int,
        "default": DEFAULT_BOUND,
        "help": "the longest plan to look for, in steps (default: %(default)s)",
    },
}
