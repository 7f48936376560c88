"""How a command ends: exit codes, and errors for people or as JSON."""

from __future__ import annotations

import argparse
import io
import json
import os
import signal
import sys
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

from bridge.errors import LinkError, RefusedError
from smv_planner.errors import EngineError, Mistake, MistakesError, ModelError, UsageError

REACHED = 0
NO_PLAN = 1
USAGE = 2
INVALID_SCENARIO = 3
UNDECIDED = 4
ENGINE_FAILED = 5
NO_NETWORK = 6
INTERRUPTED = 130

EXIT_CODES = """\
exit codes:
  0  reached                       3  the scenario is invalid
  1  unreachable, or an invariant  4  no plan within the bound, or the deadline passed
     is violated at the start      5  the engine is missing, failed, or lied,
  2  the question is wrong            or two engines differ"""

NETWORK_CODES = """
  on the network: 2 if an order is refused, 6 if there is no router or nobody answers"""


class Arguments(argparse.ArgumentParser):
    """A parser whose mistakes go the same way as all others, and that wants its words spelled out."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options, allow_abbrev=False)

    def error(self, message: str) -> NoReturn:
        raise UsageError([Mistake(message, f"'{self.prog} --help' tells what there is")])


def run(command: Callable[[Sequence[str]], int], arguments: Sequence[str]) -> int:
    """Run a command; whatever goes wrong on purpose becomes a message and an exit code."""
    as_json = "--json" in arguments
    if sys.stderr is None:  # somebody closed it; what is said there is lost
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115
    if isinstance(sys.stdout, io.TextIOWrapper):  # what a terminal's encoding does not have is told all the same
        sys.stdout.reconfigure(errors="backslashreplace")
    signal.signal(signal.SIGTERM, _interrupted)
    try:
        code = command(arguments)
        sys.stdout.flush()
        return code
    except MistakesError as error:
        _report(error.mistakes, as_json)
        return INVALID_SCENARIO if isinstance(error, ModelError) else USAGE
    except LinkError as error:
        _report([Mistake(str(error))], as_json)
        return USAGE if isinstance(error, RefusedError) else NO_NETWORK
    except EngineError as error:
        _report([Mistake(str(error))], as_json)
        return ENGINE_FAILED
    except KeyboardInterrupt:
        print("\ninterrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # whoever read our output has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        return INTERRUPTED
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        _report([Mistake(f"the answer cannot be written: {error.strerror}")], as_json=False)
        return ENGINE_FAILED
    except Exception:  # a broken assumption of ours; its own exit status 1 would read as 'unreachable'
        import traceback

        traceback.print_exc()
        _report([Mistake("this is a mistake in smv_planner, not in your scenario; please report it")], as_json)
        return ENGINE_FAILED


def _interrupted(*_: object) -> None:
    raise KeyboardInterrupt


def _report(mistakes: Sequence[Mistake], as_json: bool) -> None:
    if as_json:
        print(json.dumps({"problems": [_as_json(mistake) for mistake in mistakes]}, indent=2))
        return
    for mistake in mistakes:
        print(mistake, file=sys.stderr)
    if len(mistakes) > 1:
        print(f"{len(mistakes)} problems", file=sys.stderr)


def _as_json(mistake: Mistake) -> dict[str, object]:
    place = mistake.place
    instance = {"instance": place.instance} if place and place.instance else {}
    return {
        "file": place.file if place else mistake.file,
        "line": place.line if place else None,
        "column": place.column if place else None,
        "message": mistake.message,
        "hint": mistake.hint,
        **instance,
    }
