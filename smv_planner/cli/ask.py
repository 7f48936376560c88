"""`smv-planner ask` and `smv-planner health`: one question or order to a planner that runs."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from bridge import keys
from bridge.errors import LinkError
from bridge.link import Link
from bridge.printable import printable
from smv_planner.cli import outcome
from smv_planner.cli.asking import PATIENCE, add_planner, document, running_cell
from smv_planner.cli.network import linked, settings
from smv_planner.daemon import orders, status
from smv_planner.daemon.documents import FORMAT
from smv_planner.errors import Mistake, UsageError
from smv_planner.model.domains import Value, show_value

UNHEALTHY = 1
QUESTIONS = {"plan": (keys.plan, "plan"), "state": (keys.situation, "situation"), "operator": (keys.operator, "operator")}
"""Where they are asked, and the kind of document that is answered."""

WORDS = {
    "plan": "plan                      what comes: operations and steps",
    "state": "state                     what is known and believed",
    "operator": "operator                  what the operator is asked for",
    "start": "start INTENTION           pursue it, or let a paused one go on",
    "pause": "pause INTENTION           leave it for now",
    "cancel": "cancel NAME               give up an intention, or an operation that executes",
    "confirm": "confirm [REQUEST]         what the operator was asked to do is done",
    "approve": "approve [REQUEST]         the operator agrees",
    "set": "set VAR=VALUE ...         new values of decision or estimated variables",
    "reenable": "reenable NAME             count on an effect, a resource or an operation again",
    "proceed": "proceed                   go on after a halt",
}
TELLING = "what can be asked:\n" + "\n".join(f"  {line}" for line in WORDS.values())


def add_ask(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("words", metavar="WORD", nargs="+", help="a question or an order, as below")
    parser.add_argument("--json", action="store_true", help="print what the planner says as JSON")
    add_planner(parser)


def add_health(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="print all that the planner says of its health")
    parser.add_argument("--journal", metavar="DIR", help="the planner of this machine that has its journal there")
    add_planner(parser)


def ask(asked: argparse.Namespace) -> int:
    word, *rest = asked.words
    if word not in WORDS:
        raise UsageError([Mistake(f"'{word}' is no question and no order", "there are " + ", ".join(WORDS))])
    if word in QUESTIONS and rest:
        raise _not_so(word, rest)
    with linked(asked) as link:
        cell = running_cell(asked, link)
        if word in QUESTIONS:
            key, kind = QUESTIONS[word]
            found = document(link, key(cell), kind)
            print(json.dumps(found, indent=2) if asked.json else printable("\n".join(_LINES[word](found))))
            return outcome.REACHED
        order = ordered(word, rest, link, cell)
        link.ask(keys.order(cell), json.dumps(order).encode(), timeout=PATIENCE)
        accepted = {"format": FORMAT, "kind": "accepted", **order}
        print(json.dumps(accepted) if asked.json else f"accepted: {' '.join(asked.words)}")
    return outcome.REACHED


def ordered(word: str, rest: list[str], link: Link, cell: str) -> dict[str, Any]:
    """The order that words mean. Raises UsageError."""
    field = orders.ORDERS[word][1]
    if word == "set" and rest:
        return {"order": word, "values": dict(_value(text) for text in rest)}
    if field is None and not rest:
        return {"order": word}
    if field == "request" and not rest:
        return {"order": word, field: only_request(document(link, keys.operator(cell), "operator"), word)}
    if field is None or len(rest) != 1 or word == "set":
        raise _not_so(word, rest)
    return {"order": word, field: rest[0]}


def _not_so(word: str, rest: list[str]) -> UsageError:
    return UsageError([Mistake(f"'{' '.join([word, *rest])}' is not how to say it", WORDS[word].partition("  ")[0])])


def only_request(found: dict[str, Any], answer: str) -> str:
    """The one request that is open and answered by this word. Raises UsageError."""
    fitting = [request["request"] for request in found["requests"] if request["answer"] == answer and not request["confirmed"]]
    if len(fitting) != 1:
        there = printable(", ".join(fitting)) or "'ask operator' shows them"
        raise UsageError([Mistake(f"there are {len(fitting)} requests to {answer}", there)])
    return str(fitting[0])


def health(asked: argparse.Namespace) -> int:
    """0 if the planner does its work; else 1, whatever the reason, for those who restart it. A station may wait all the same."""
    try:
        found = _status(asked)
        if found is None:
            with linked(asked) as link:
                found = document(link, keys.health(running_cell(asked, link)), "health")
    except LinkError as error:
        print(error, file=sys.stderr)
        return UNHEALTHY
    if asked.json:
        print(json.dumps(found, indent=2))
    else:
        text = "; ".join(found["wrong"])  # there may be nothing else
        text = text or f"well: {found['phase']}, {found['ticks']} ticks, the last {found['tick_age']:g} s ago"
        print(printable("\n".join([text, *(f"the station waits: {each}" for each in found["waiting"])])))
    return outcome.REACHED if found["healthy"] else UNHEALTHY


def _status(asked: argparse.Namespace) -> dict[str, Any] | None:
    """What the daemon of this machine says that is meant; None if the network has to be asked. Raises UsageError."""
    if asked.connect:
        return None
    found = settings(asked)
    if found["journal"].origin != "default" or found["cell"].value:
        told = status.found(found["journal"].value)
        if told is None and found["journal"].origin != "default":  # on the network another one might answer
            return status.unwell(f"no planner runs that has its journal in '{found['journal'].value}'")
        return told
    told = status.all_below(Path(found["journal"].value).parent)
    if len(told) > 1:
        raise UsageError([Mistake("several planners were started here: " + ", ".join(told), "name one with --cell or --journal")])
    return next(iter(told.values()), None)


def _value(text: str) -> tuple[str, Value]:
    name, equals, value = text.partition("=")
    if not equals:
        raise UsageError([Mistake(f"'{text}' sets nothing", "as in bolt_1=placed")])
    if value in ("true", "false"):
        return name, value == "true"
    return name, int(value) if value.removeprefix("-").isdecimal() else value


def _plan(found: dict[str, Any]) -> list[str]:
    lines = [f"{each['state']:<10} {each['name']}" for each in found["operations"]]
    lines += [
        f"  {'done' if each['done'] else 'to do':<6} {each['transition']:<32} {_values(each['changes'])}".rstrip()
        for each in found["steps"]
    ]
    return lines or ["nothing is planned"]


def _state(found: dict[str, Any]) -> list[str]:
    lines = [f"{found['phase']}, epoch {found['epoch']}, {found['at']:g} s"]
    lines += [f"  {name} = {'unknown' if value is None else show_value(value)}" for name, value in found["state"].items()]
    lines += [f"intention {name}: {' '.join(each.values())}" for name, each in found["intentions"].items()]
    for what in ("executing", "failed", "disabled", "lost", "broken"):
        if found[what]:
            lines.append(f"{what}: {', '.join(found[what])}")
    lines += [f"{what}: {found[what]}" for what in ("halted", "stuck") if found[what]]
    return lines


def _operator(found: dict[str, Any]) -> list[str]:
    return [f"{each['request']}  {each['text']}  [{each['answer']}]" for each in found["requests"]] or ["nothing is asked for"]


def _values(changes: dict[str, Value]) -> str:
    return ", ".join(f"{name} = {show_value(value)}" for name, value in changes.items())


_LINES = {"plan": _plan, "state": _state, "operator": _operator}
