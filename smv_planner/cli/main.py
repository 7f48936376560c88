"""`smv-planner`: everything that is not a one-shot plan."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from smv_planner import __version__, language
from smv_planner.api import encoded, pose
from smv_planner.cli import (
    ask,
    check,
    demo,
    emulate,
    experiments,
    interface,
    operator,
    outcome,
    replay,
    router,
    run,
    security,
    simulate,
    watch,
)
from smv_planner.cli.question import add_question, settings
from smv_planner.errors import Mistake, UsageError
from smv_planner.lazy import dataclass
from smv_planner.planner.answer import Question

SMV_FILE = "problem.smv"
SCRIPT_FILE = "problem.cmd"


@dataclass(frozen=True, slots=True)
class Command:
    """`add` gives a parser its arguments, `act` does what they ask for; `help` is for the list of commands."""

    add: Callable[[argparse.ArgumentParser], None]
    act: Callable[[argparse.Namespace], int]
    help: str
    description: str
    epilog: str | None = None
    formatter: type[argparse.HelpFormatter] = argparse.HelpFormatter


def main() -> int:
    return outcome.run(command, sys.argv[1:])


def command(arguments: Sequence[str]) -> int:
    asked = parser().parse_args(arguments)
    return COMMANDS[asked.command].act(asked)


def parser() -> argparse.ArgumentParser:
    parser = outcome.Arguments(
        prog="smv-planner",
        description="Work with planning scenarios. To plan, use smv-plan.",
        epilog=outcome.EXIT_CODES + outcome.NETWORK_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"smv-planner {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, one in COMMANDS.items():
        one.add(
            commands.add_parser(
                name, help=one.help, description=one.description, epilog=one.epilog, formatter_class=one.formatter
            )
        )
    return parser


def _add_export(parser: argparse.ArgumentParser) -> None:
    add_question(parser)
    parser.add_argument("--output", "-o", metavar="DIR", help=f"write {SMV_FILE} and the command script {SCRIPT_FILE} there")


def _add_schema(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--messages", action="store_true", help="the schemas of what travels on the network instead, by kind")


def export(asked: argparse.Namespace) -> int:
    """The SMV text of a question, to standard output or with its command script into a folder."""
    model = language.load(asked.scenario)
    question = Question(
        goals=tuple(asked.goal),
        formula=asked.formula,
        settings=settings(model, asked.set),
        maintenance=asked.maintenance,
        lifted=tuple(asked.lift),
        disabled=tuple(asked.disable),
        lost=tuple(asked.lose),
        ran=tuple(asked.ran),
    )
    encoding = encoded(pose(model, question, asked.bound))
    if asked.output is None:
        print(encoding.text, end="")
        return outcome.REACHED
    folder = Path(asked.output)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / SMV_FILE).write_text(encoding.text, encoding="ascii")
        (folder / SCRIPT_FILE).write_text(encoding.script, encoding="ascii")
    except OSError as error:
        raise UsageError([Mistake(f"cannot write to '{folder}': {error.strerror}")]) from error
    print(f"wrote {folder / SMV_FILE} and {folder / SCRIPT_FILE}")
    return outcome.REACHED


def schema(asked: argparse.Namespace) -> int:
    """The JSON Schema of scenarios, or the schemas of messages by kind, to standard output."""
    if asked.messages:
        from bridge.schemas import schemas
        from smv_planner.daemon.schema import schemas as of_the_planner
        from smv_planner.plant.schema import schemas as of_the_plant

        print(json.dumps({**schemas(), **of_the_planner(), **of_the_plant()}, indent=2))
        return outcome.REACHED
    from smv_planner.language.schema import schema as of_scenarios

    print(json.dumps(of_scenarios(), indent=2, ensure_ascii=False))
    return outcome.REACHED


COMMANDS: Mapping[str, Command] = {
    "export": Command(
        _add_export,
        export,
        "write a question as SMV text that NuSMV and nuXmv read alone",
        "Write a question as SMV text, specification included. Without --output the text is printed.",
        epilog=f"With --output DIR, run it by: cd DIR && NuSMV -source {SCRIPT_FILE} {SMV_FILE}",
    ),
    "check": Command(
        check.add_check,
        check.check,
        "say what is wrong or suspicious in a scenario",
        "Say what is wrong or suspicious in a scenario that loads: automatic transitions that never settle, what "
        "can never fire, start or complete, values that nobody produces. Errors exit with 3, with --strict warnings too.",
    ),
    "schema": Command(
        _add_schema,
        schema,
        "print the JSON Schema of scenarios, for editors, or of messages",
        "Print the JSON Schema of scenarios (draft 2020-12). Editors complete, explain and check with it.",
        epilog="A scenario that begins with '# yaml-language-server: $schema=FILE' tells an editor where it is.",
    ),
    "router": Command(
        router.add_router,
        router.run_router,
        "run a Zenoh router, where no zenohd is at hand",
        "Run an embedded Zenoh router until interrupted. It listens on loopback; other addresses need "
        "TLS and access control, or the word that they may be insecure.",
    ),
    "emulate": Command(
        emulate.add_emulate,
        emulate.run_emulate,
        "run hubs with emulated devices",
        "Run the hubs of a scenario, or some, with devices that do what the effects say, until "
        "interrupted; or tell running ones what goes wrong.",
        epilog=emulate.TELLING + emulate.EXAMPLES,
        formatter=argparse.RawDescriptionHelpFormatter,
    ),
    "watch": Command(
        watch.add_watch,
        watch.run_watch,
        "show what is going on, to anybody on the network",
        "Show hubs, plan and events as they are published, without a scenario. With --mirror: say every "
        "commanded field that its hub does not mirror in time, and exit with 1 if there was one, or if nothing was "
        "commanded.",
    ),
    "interface": Command(
        interface.add_interface,
        interface.run_interface,
        "write what the driver of a resource has to know",
        "Print the interface of a resource as JSON: keys, variables with their domains, model, deadman reaction. "
        "The hub library `bridge.hub` reads it, and so can any other program.",
    ),
    "run": Command(
        run.add_run,
        run.run,
        "plan for a station that runs: the daemon",
        "Run the planner daemon: it hears the hubs of a scenario, plans for its intentions and commands them, "
        "until SIGTERM. SIGHUP has it read its scenario again.",
    ),
    "config": Command(
        run.add_config,
        run.show_config,
        "print the daemon's settings",
        "Print the settings that 'run' would use.",
    ),
    "ask": Command(
        ask.add_ask,
        ask.ask,
        "ask or order a planner that runs",
        "Ask a planner that runs, or order something. An order is accepted when it is in the journal.",
        epilog=ask.TELLING,
        formatter=argparse.RawDescriptionHelpFormatter,
    ),
    "health": Command(
        ask.add_health,
        ask.health,
        "say whether the planner is well",
        "Say whether the planner that runs is well: exit 0, else 1. It is not if it stands still, if there is no router, if its "
        "journal cannot be written, if decisions do not come about, if all resources are lost, or if another planner has taken "
        "over. The planner of this machine is asked without the network; over the network where --connect says so, or if none "
        "runs here and --journal names none. What the station waits for is told, and changes nothing about that.",
    ),
    "operator": Command(
        operator.add_operator,
        operator.operate,
        "show what the planner asks of people, and answer",
        "Show what the planner asks of people, and take their answers from standard input.",
        epilog=operator.ANSWERS,
        formatter=argparse.RawDescriptionHelpFormatter,
    ),
    "simulate": Command(
        simulate.add_simulate,
        simulate.run,
        "play a station in virtual time",
        "Play a whole station in virtual time: the planner, and emulated hubs behind the real messages. The same "
        "seed tells the same story.",
        epilog=simulate.EXAMPLES,
        formatter=argparse.RawDescriptionHelpFormatter,
    ),
    "experiments": Command(
        experiments.add_experiments,
        experiments.run,
        "play E1 to E9 beside Table 1 of the paper",
        "Play the error situations E1 to E9 of Machines 2021 and show planning actions, their times and what the "
        "operator is asked for beside Table 1. Exits with 1 if one comes out otherwise.",
    ),
    "replay": Command(
        replay.add_replay,
        replay.run,
        "tell what a journal holds, and decide once more",
        "Take the events of a journal through the runner again and tell the story; every decision is made once "
        "more. Exits with 1 if one comes out otherwise.",
    ),
    "security": Command(
        security.add_security_commands,
        security.run_security,
        "write access control for a router",
        "Print who may say what in a cell, for 'smv-planner router --access-control FILE', or for the "
        "configuration of zenohd. Emulated hubs cannot be told to fail under it.",
        epilog=security.NAMES,
        formatter=argparse.RawDescriptionHelpFormatter,
    ),
    "demo": Command(
        demo.add_demo,
        demo.demo,
        "play an execution case on real processes",
        "Start router, emulated hubs, planner and operator as processes on this machine, let happen what an "
        "execution case tells, and say what comes of it. It takes less than a minute.",
    ),
}
