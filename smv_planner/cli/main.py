"""`smv-planner`: everything that is not a one-shot plan."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
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
from smv_planner.planner.answer import Question

SMV_FILE = "problem.smv"
SCRIPT_FILE = "problem.cmd"


def main() -> int:
    return outcome.run(command, sys.argv[1:])


def parser() -> argparse.ArgumentParser:
    parser = outcome.Arguments(
        prog="smv-planner",
        description="Work with planning scenarios. To plan, use smv-plan.",
        epilog=outcome.EXIT_CODES + outcome.NETWORK_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"smv-planner {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    export = commands.add_parser(
        "export",
        help="write a question as SMV text that NuSMV and nuXmv read alone",
        description="Write a question as SMV text, specification included. Without --output the text is printed.",
        epilog=f"With --output DIR, run it by: cd DIR && NuSMV -source {SCRIPT_FILE} {SMV_FILE}",
    )
    add_question(export)
    export.add_argument("--output", "-o", metavar="DIR", help=f"write {SMV_FILE} and the command script {SCRIPT_FILE} there")
    check.add_check(
        commands.add_parser(
            "check",
            help="say what is wrong or suspicious in a scenario",
            description="Say what is wrong or suspicious in a scenario that loads: automatic transitions that never settle, what "
            "can never fire, start or complete, values that nobody produces. Errors exit with 3, with --strict warnings too.",
        )
    )
    schemas = commands.add_parser(
        "schema",
        help="print the JSON Schema of scenarios, for editors, or of messages",
        description="Print the JSON Schema of scenarios (draft 2020-12). Editors complete, explain and check with it.",
        epilog="A scenario that begins with '# yaml-language-server: $schema=FILE' tells an editor where it is.",
    )
    schemas.add_argument("--messages", action="store_true", help="the schemas of what travels on the network instead, by kind")
    router.add_router(
        commands.add_parser(
            "router",
            help="run a Zenoh router, where no zenohd is at hand",
            description="Run an embedded Zenoh router until interrupted. It listens on loopback; other addresses need "
            "TLS and access control, or the word that they may be insecure.",
        )
    )
    emulate.add_emulate(
        commands.add_parser(
            "emulate",
            help="run hubs with emulated devices",
            description="Run the hubs of a scenario, or some, with devices that do what the effects say, until "
            "interrupted; or tell running ones what goes wrong.",
            epilog=emulate.TELLING + emulate.EXAMPLES,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
    )
    watch.add_watch(
        commands.add_parser(
            "watch",
            help="show what is going on, to anybody on the network",
            description="Show hubs, plan and events as they are published, without a scenario. With --mirror: say every "
            "commanded field that its hub does not mirror in time, and exit with 1 if there was one, or if nothing was "
            "commanded.",
        )
    )
    interface.add_interface(
        commands.add_parser(
            "interface",
            help="write what the driver of a resource has to know",
            description="Print the interface of a resource as JSON: keys, variables with their domains, model, deadman reaction. "
            "The hub library `bridge.hub` reads it, and so can any other program.",
        )
    )
    run.add_run(
        commands.add_parser(
            "run",
            help="plan for a station that runs: the daemon",
            description="Run the planner daemon: it hears the hubs of a scenario, plans for its intentions and commands them, "
            "until SIGTERM. SIGHUP has it read its scenario again.",
        )
    )
    run.add_config(
        commands.add_parser("config", help="print the daemon's settings", description="Print the settings that 'run' would use.")
    )
    ask.add_ask(
        commands.add_parser(
            "ask",
            help="ask or order a planner that runs",
            description="Ask a planner that runs, or order something. An order is accepted when it is in the journal.",
            epilog=ask.TELLING,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
    )
    ask.add_health(
        commands.add_parser(
            "health",
            help="say whether the planner is well",
            description="Say whether the planner that runs is well: exit 0, else 1. It is not if it stands still, if its journal "
            "cannot be written, or if another planner has taken over. The planner of this machine is asked without the network; "
            "over the network where --connect says so, or if none has run here. What the station waits for is told, and changes "
            "nothing about that.",
        )
    )
    operator.add_operator(
        commands.add_parser(
            "operator",
            help="show what the planner asks of people, and answer",
            description="Show what the planner asks of people, and take their answers from standard input.",
            epilog=operator.ANSWERS,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
    )
    simulate.add_simulate(
        commands.add_parser(
            "simulate",
            help="play a station in virtual time",
            description="Play a whole station in virtual time: the planner, and emulated hubs behind the real messages. The same "
            "seed tells the same story.",
            epilog=simulate.EXAMPLES,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
    )
    experiments.add_experiments(
        commands.add_parser(
            "experiments",
            help="play E1 to E9 beside Table 1 of the paper",
            description="Play the error situations E1 to E9 of Machines 2021 and show planning actions, their times and what the "
            "operator is asked for beside Table 1. Exits with 1 if one comes out otherwise.",
        )
    )
    replay.add_replay(
        commands.add_parser(
            "replay",
            help="tell what a journal holds, and decide once more",
            description="Take the events of a journal through the runner again and tell the story; every decision is made once "
            "more. Exits with 1 if one comes out otherwise.",
        )
    )
    security.add_security_commands(
        commands.add_parser(
            "security",
            help="write access control for a router",
            description="Print who may say what in a cell, for 'smv-planner router --access-control FILE', or for the "
            "configuration of zenohd. Emulated hubs cannot be told to fail under it.",
            epilog=security.NAMES,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
    )
    demo.add_demo(
        commands.add_parser(
            "demo",
            help="play an execution case on real processes",
            description="Start router, emulated hubs, planner and operator as processes on this machine, let happen what an "
            "execution case tells, and say what comes of it. It takes less than a minute.",
        )
    )
    return parser


def command(arguments: Sequence[str]) -> int:
    asked = parser().parse_args(arguments)
    match asked.command:
        case "export":
            return export(asked)
        case "check":
            return check.check(asked)
        case "schema":
            return schema(asked.messages)
        case "router":
            return router.run_router(asked)
        case "emulate":
            return emulate.run_emulate(asked)
        case "watch":
            return watch.run_watch(asked)
        case "interface":
            return interface.run_interface(asked)
        case "security":
            return security.run_security(asked)
        case "run":
            return run.run(asked)
        case "config":
            return run.show_config(asked)
        case "ask":
            return ask.ask(asked)
        case "health":
            return ask.health(asked)
        case "operator":
            return operator.operate(asked)
        case "simulate":
            return simulate.run(asked)
        case "experiments":
            return experiments.run(asked)
        case "replay":
            return replay.run(asked)
        case "demo":
            return demo.demo(asked)
    raise AssertionError(asked.command)


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


def schema(messages: bool) -> int:
    """The JSON Schema of scenarios, or the schemas of messages by kind, to standard output."""
    if messages:
        from bridge.schemas import schemas
        from smv_planner.daemon.schema import schemas as of_the_planner
        from smv_planner.plant.schema import schemas as of_the_plant

        print(json.dumps({**schemas(), **of_the_planner(), **of_the_plant()}, indent=2))
        return outcome.REACHED
    from smv_planner.language.schema import schema as of_scenarios

    print(json.dumps(of_scenarios(), indent=2, ensure_ascii=False))
    return outcome.REACHED
