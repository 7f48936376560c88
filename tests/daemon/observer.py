"""Who sees every goal message of a cell, from another process, and judges with code of its own.

It knows the model's domains and nothing of planners. Of a hub's commands: whole and within their domains; epochs never go
back in what a hub obeys; within an epoch there is one planner, numbers go up, and the same number says the same again.
It says what it has found when its standard input ends.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

import smv_planner as sp
from bridge import keys
from bridge.link import LinkConfig, open_link

DEPTH = 4096


class Observer:
    def __init__(self, model: sp.Model) -> None:
        self.domains = {
            resource.name: {v.name: v.domain for v in model.variables if v.resource == resource.name and v.kind.value == "goal"}
            for resource in model.resources
        }
        self.model = model.hash
        self.seen: Counter[str] = Counter()
        self.wrong: list[str] = []
        self.newest: dict[tuple[str, int], dict[str, Any]] = {}
        self.obeyed: dict[str, dict[str, Any]] = {}
        self.unused: dict[str, list[dict[str, Any]]] = {}

    def take(self, key: str, payload: bytes) -> None:
        message = json.loads(payload)
        name = message["resource"]
        self.seen[message["kind"]] += 1
        if key.split("/")[2] != name or message["model"] != self.model:
            self.wrong.append(f"{key}: not for this hub, or of another model")
        if message["kind"] == "goal":
            self.goal(name, message)
        else:
            self.state(name, message)

    def goal(self, name: str, message: dict[str, Any]) -> None:
        values, domains = message["values"], self.domains[name]
        if values.keys() != domains.keys() or not all(values[each] in domain for each, domain in domains.items()):
            self.wrong.append(f"{name}: {values} is not whole, or out of its domain")
        before = self.newest.get((name, message["epoch"]))
        if before is not None and before["planner"] == message["planner"]:
            if message["seq"] < before["seq"]:
                self.wrong.append(f"{name}: command {message['seq']} after {before['seq']} in epoch {message['epoch']}")
            if message["seq"] == before["seq"] and values != before["values"]:
                self.wrong.append(f"{name}: command {message['seq']} of epoch {message['epoch']} says two things")
        self.newest[name, message["epoch"]] = message

    def state(self, name: str, message: dict[str, Any]) -> None:
        before = self.obeyed.get(name)
        reboot = before is not None and before["boot"] != message["boot"]
        self.seen["reboots"] += reboot
        if before is not None and reboot and not message["epoch"]:
            # Who replaces a hub obeys nobody yet: nothing new may be asked of it until it says whom it obeys.
            said = self.newest.get((name, before["epoch"]), {}).get("values")
            self.unused[name] = [each for each in (message["mirror"], before["mirror"], said) if each is not None]
        elif name in self.unused and message["epoch"]:
            self.seen["first obeyed"] += 1
            if message["mirror"] not in self.unused.pop(name):
                self.wrong.append(f"{name}: was asked for {message['mirror']} before it had said that it obeys")
        if before is not None and before["boot"] == message["boot"] and message["seq"] > before["seq"]:
            told, was = (message["epoch"], message["goal_seq"]), (before["epoch"], before["goal_seq"])
            if told < was:
                self.wrong.append(f"{name}: obeys {told} after {was}")
            if message["epoch"] == before["epoch"] and message["planner"] != before["planner"]:
                self.wrong.append(f"{name}: two planners in epoch {message['epoch']}")
            if message["epoch"] > before["epoch"]:
                self.seen["takeovers"] += 1
                # A new planner holds: what it says first is what the hub mirrored before.
                if message["goal_seq"] == 1 and message["mirror"] != before["mirror"]:
                    self.wrong.append(f"{name}: epoch {message['epoch']} begins with {message['mirror']}, not {before['mirror']}")
        self.obeyed[name] = message


def main(endpoint: str, cell: str, scenario: str) -> None:
    observer = Observer(sp.load(scenario))
    with open_link(LinkConfig((endpoint,)), wait=30) as link:
        mailbox = link.latest(keys.goals(cell), keys.state(cell), depth=DEPTH)
        print("watching", flush=True)
        import threading

        over = threading.Event()
        threading.Thread(target=lambda: (sys.stdin.read(), over.set()), daemon=True).start()
        while True:
            last = over.is_set()
            mailbox.wait(0.05)
            for key, payload in mailbox.drain():
                observer.take(key, payload)
            if last:
                break
    print(json.dumps({"wrong": observer.wrong[:20], "seen": observer.seen}))


if __name__ == "__main__":
    main(*sys.argv[1:])
