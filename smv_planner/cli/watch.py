"""`smv-planner watch`: what is going on, for anybody on the network; `--mirror` judges whether commands are mirrored."""

from __future__ import annotations

import argparse
import json
import sys
import threading
import time
from collections import Counter
from typing import TYPE_CHECKING, Any

from bridge import keys, mirror
from bridge.link import Link, Mailbox
from bridge.mirror import Mirrors
from bridge.overheard import overheard
from bridge.printable import printable
from smv_planner.cli import outcome
from smv_planner.cli.network import add_network, linked, named_cell
from smv_planner.lazy import dataclass, field
from smv_planner.model.domains import Value, show_value
from smv_planner.protocol.messages import GoalMessage, StateMessage

if TYPE_CHECKING:
    from rich.table import Table

UNMIRRORED = 1
"""The exit status of `--mirror` when a field was not mirrored, or when there was nothing to judge."""

SHOWN_EVENTS = 8
DEPTH = 256


def add_watch(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--mirror", action="store_true", help="only judge whether every commanded field is mirrored")
    parser.add_argument(
        "--within",
        metavar="SECONDS",
        type=float,
        default=1.0,
        help="the time a field has (default: %(default)s)",
    )
    parser.add_argument("--for", dest="seconds", metavar="SECONDS", type=float, help="end then (default: when interrupted)")
    parser.add_argument("--lines", action="store_true", help="lines instead of a table, as it is without a terminal")
    parser.add_argument("--cell", metavar="NAME", help="which installation (default: all on this network)")
    add_network(parser, cell=False)


def run_watch(asked: argparse.Namespace) -> int:
    cell = "*" if asked.cell == "*" else named_cell(asked) or "*"
    with linked(asked) as link:
        if asked.mirror:
            return watch_mirrors(link, cell, asked.within, asked.seconds)
        station = Station(mirrors=Mirrors(asked.within))
        woken = threading.Event()
        topics = (f"smv/{cell}/*/goal", f"smv/{cell}/*/state", f"smv_planner/{cell}/*")
        mailbox = link.latest(*topics, depth=DEPTH, wake=woken.set)
        try:
            if asked.lines or not sys.stdout.isatty():
                _lines(station, mailbox, asked.seconds)
            else:
                _table(station, mailbox, asked.seconds)
        except KeyboardInterrupt:
            return outcome.REACHED
    return outcome.REACHED


def watch_mirrors(link: Link, cell: str, within: float, seconds: float | None) -> int:
    """Says each field that is not mirrored in time, on a line of its own; whether there was one is the exit status."""
    mailbox = link.latest(keys.goals(cell), keys.state(cell), depth=DEPTH)
    mirrors, late, rejected, heard = Mirrors(within), 0, 0, Counter[str]()
    ends = None if seconds is None else time.monotonic() + seconds
    try:
        while ends is None or time.monotonic() < ends:
            mailbox.wait(0.1)
            at = time.monotonic()
            for _, payload in mailbox.drain():
                message = overheard(payload)
                if message is None:
                    rejected += 1
                else:
                    heard[type(message).__name__] += 1
                    mirrors = mirror.hear(mirrors, message, at)
            mirrors, found = mirror.judge(mirrors, at)
            for each in found:
                late += 1
                mirrored = "nothing" if each.mirrored is None else show_value(each.mirrored)
                commanded = show_value(each.commanded)
                line = f"{each.name}: commanded {commanded}, mirrored {mirrored} for {at - each.since:.2f} s"
                print(printable(line), flush=True)
    except KeyboardInterrupt:
        pass
    goals, states = heard[GoalMessage.__name__], heard[StateMessage.__name__]
    print(f"{goals} goals and {states} states heard, {rejected} unreadable, {late} fields not mirrored in time", flush=True)
    if not goals:
        print("nothing was commanded, so nothing was judged", file=sys.stderr)
    return UNMIRRORED if late or not goals else outcome.REACHED


@dataclass
class Station:
    """What a spectator knows."""

    mirrors: Mirrors
    heard_at: dict[str, float] = field(default_factory=dict)
    documents: dict[str, str | None] = field(default_factory=dict)
    events: list[str] = field(default_factory=list)
    rejected: int = 0

    def take(self, key: str, payload: bytes, at: float) -> str | None:
        """What there is to say of it on a line, if anything is new."""
        if key.startswith("smv/"):
            message = overheard(payload)
            if message is None:
                self.rejected += 1
                return f"unreadable: {key}"
            name = mirror.name_of(message)
            before = self.mirrors.resources.get(name)
            self.mirrors = mirror.hear(self.mirrors, message, at)
            if isinstance(message, StateMessage):
                self.heard_at[name] = at
                if before is None or before.state is None or before.state.measured != message.measured:
                    return f"{name}: {_text(message.measured)}"
            elif before is None or before.goal is None or before.goal.values != message.values:
                return f"{name} <- {_text(message.values)}"
            return None
        try:
            document = json.loads(payload)
        except (ValueError, RecursionError):
            self.rejected += 1
            return f"unreadable: {key}"
        topic = key.rpartition("/")[2]
        if topic == "event":
            text = str(document.get("text", document)) if isinstance(document, dict) else str(document)
            self.events = [*self.events, text][-SHOWN_EVENTS:]
            return f"event: {text}"
        last, now = self.documents.get(topic), summary(topic, document)
        self.documents[topic] = now
        return now if now != last else None


def summary(topic: str, document: object) -> str | None:
    """What a document of the planner says, on a line, if anybody wants to see it go by."""
    match topic, document:
        case "plan", {"operations": [*operations]}:
            told = [f"{each.get('name')} {each.get('state')}" for each in operations if isinstance(each, dict)]
            return f"plan: {', '.join(told) or 'none'}"
        case "operator", {"requests": [*requests]}:
            return "operator: " + (
                "; ".join(str(each.get("text")) for each in requests if isinstance(each, dict)) or "nothing asked"
            )
        case "situation", {"phase": str(phase), "lost": list(lost), "failed": dict(failed)}:
            trouble = [f"lost: {', '.join(map(str, lost))}"] * bool(lost) + [f"failed: {', '.join(map(str, failed))}"] * bool(
                failed
            )
            return f"planner: {'; '.join([phase, *trouble])}"
    return None


def _lines(station: Station, mailbox: Mailbox, seconds: float | None) -> None:
    began = time.monotonic()
    while seconds is None or time.monotonic() - began < seconds:
        mailbox.wait(0.1)
        for key, payload in mailbox.drain():
            line = station.take(key, payload, time.monotonic())
            if line:
                print(f"{time.monotonic() - began:8.2f} s  {printable(line).replace(chr(10), ' ')}", flush=True)


def _table(station: Station, mailbox: Mailbox, seconds: float | None) -> None:
    from rich.live import Live

    began = time.monotonic()
    with Live(_shown(station), refresh_per_second=5, screen=False) as live:
        while seconds is None or time.monotonic() - began < seconds:
            mailbox.wait(0.2)
            for key, payload in mailbox.drain():
                station.take(key, payload, time.monotonic())
            live.update(_shown(station))


def _shown(station: Station) -> Table:
    """What others publish is text and never markup."""
    from rich.table import Table
    from rich.text import Text

    at = time.monotonic()
    lines = [line for line in station.documents.values() if line]
    caption = Text("\n".join(map(printable, [*lines, *station.events])))
    title = f"hubs ({station.rejected} unreadable messages)" if station.rejected else "hubs"
    table = Table(title=title, caption=caption, caption_justify="left", expand=True)
    for column in ("resource", "heard", "epoch", "goals", "measured"):
        table.add_column(column)
    for name, watched in sorted(station.mirrors.resources.items()):
        goals = Text()
        for field_name, value in (watched.goal.values if watched.goal else {}).items():
            since = watched.differs_since.get(field_name)
            style = "" if since is None else "bold red" if at - since > station.mirrors.limit else "yellow"
            goals.append(printable(f"{_short(name, field_name)} = {show_value(value)}\n"), style=style)
        heard = at - station.heard_at[name] if name in station.heard_at else None
        age = Text("never" if heard is None else f"{heard:.1f} s", style="bold red" if heard is None or heard > 1 else "")
        measured = "\n".join(
            printable(f"{_short(name, each)} = {show_value(value)}")
            for each, value in (watched.state.measured if watched.state else {}).items()
        )
        epoch = str(watched.state.epoch) if watched.state else ""
        table.add_row(Text(printable(name)), age, epoch, goals, Text(measured))
    return table


def _short(resource: str, name: str) -> str:
    return name.removeprefix(f"{resource.partition('/')[2]}.")


def _text(values: Any) -> str:
    told: dict[str, Value] = dict(values)
    return ", ".join(f"{name} = {show_value(value)}" for name, value in told.items())
