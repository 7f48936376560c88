"""A planner and obedient hubs on a bench: time stands still unless a test lets it pass."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

from small_stations import ARMS

import smv_planner as sp
from smv_planner import api
from smv_planner.engines import ENGINES, Limits
from smv_planner.model.domains import Value
from smv_planner.problem import Problem, Verdict
from smv_planner.protocol import hub as hubs
from smv_planner.protocol.messages import GoalMessage, Rejected
from smv_planner.runner.decision import Decision
from smv_planner.runner.events import (
    Answered,
    Ask,
    Began,
    Consent,
    Event,
    Heard,
    Instruct,
    Note,
    Order,
    Ordered,
    Output,
    Send,
    Tick,
)
from smv_planner.runner.recovery import Planners, recover
from smv_planner.runner.situation import Situation, Station, at_rest
from smv_planner.runner.step import step

TWO_ARMS = (
    ARMS
    + """\
decision:
  left_done:  {domain: bool, initial: false}
  right_done: {domain: bool, initial: false}
  told:       {domain: bool, initial: true}
  noted:      {domain: bool, initial: false}
  is_left_out: {domain: bool, from: left.at == out}
operations:
  work_left:  {guard: not left_done,  effects: {left_done: true},  goal: left.at == out, retries: 2}
  work_right: {guard: not right_done, effects: {right_done: true}, goal: right.at == out, retries: 2}
intentions:
  both:
    start: told and not (left_done and right_done)
    goal: left_done and right_done
    actions: {noted: true}
"""
)


@lru_cache
def station(text: str = TWO_ARMS) -> Station:
    import tempfile
    from pathlib import Path

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.yaml"
        path.write_text(text, encoding="utf-8")
        model = sp.load(path)
    return Station(model, api.widened(model))


def solve(problem: Problem) -> Verdict:
    return ENGINES["explicit"].ask(problem, Limits(20.0, 1 << 30, lambda text: None))


PLANNERS = Planners(solve, api.widened_system, 40)


class Rig:
    """`asked` is the question that waits for an answer; hubs hear and say only what the test lets through."""

    def __init__(self, text: str = TWO_ARMS, planner: str = "p", **given: Value) -> None:
        self.station = station(text)
        system = self.station.system
        named = {v.name: given.get(v.name.replace(".", "_"), v.initial) for v in system.variables}
        self.now: Situation = replace(at_rest(self.station), state=tuple(named.values()))
        self.hubs = {
            name: hubs.start(interface, f"{name}-1", 0.0, {v: named[v] for v in interface.goals})
            for name, interface in self.station.interfaces.items()
        }
        self.measured = {name: {v: named[v] for v in one.measured} for name, one in self.station.interfaces.items()}
        self.at = 0.0
        self.out: list[Output] = []
        self.deaf: set[str] = set()
        self.do(Began(0.0, planner))

    # --- what happens

    def do(self, event: Event) -> list[Output]:
        self.now, out = step(self.station, self.now, event)
        self.out += out
        for output in out:
            if isinstance(output, Send) and output.message.resource not in self.deaf:
                answer = hubs.receive(self.hubs[output.message.resource], output.message, self.at)
                if not isinstance(answer, Rejected):
                    self.hubs[output.message.resource] = answer
        return list(out)

    def speak(self, *names: str) -> list[Output]:
        """Hubs report: all, or those named."""
        out = []
        for name in names or tuple(self.hubs):
            self.hubs[name], message = hubs.report(self.hubs[name], self.measured[name], self.at)
            out += self.do(Heard(self.at, message))
        return out

    def measure(self, variable: str, value: Value) -> list[Output]:
        name = variable.split(".")[0]
        self.measured[name] = {**self.measured[name], variable: value}
        return self.speak(name)

    def wait(self, seconds: float, silent: tuple[str, ...] = ()) -> list[Output]:
        """Time passes, in periods; hubs report in each."""
        out, end = [], self.at + seconds
        while self.at < end - 1e-9:
            self.at = round(self.at + 0.2, 6)
            out += self.do(Tick(self.at))
            out += self.speak(*(name for name in self.hubs if name not in silent))
        return out

    def order(self, order: Order) -> list[Output]:
        return self.do(Ordered(self.at, order))

    def answer(self) -> Decision:
        """The planners answer the question that is open."""
        asked = self.question
        decision = recover(self.station.model, asked.request, PLANNERS)
        self.do(Answered(self.at, asked.revision, decision))
        return decision

    def answer_all(self) -> Rig:
        """The planners answer until nothing is asked."""
        for _ in range(30):
            if not self.now.asked:
                return self
            self.answer()
        raise AssertionError("one question follows from the other, and none settles anything")

    def begin(self) -> Rig:
        """Until the planner runs and has its first plan."""
        self.wait(0.4)
        return self.answer_all()

    def reboot(self, name: str, boot: str, **goals: Value) -> None:
        """A hub's process begins anew, and obeys goals of its own until it is told."""
        resting = {f"{name}.{variable}": value for variable, value in goals.items()}
        self.hubs[name] = hubs.start(self.station.interfaces[name], boot, self.at, resting)

    # --- what is the case

    @property
    def question(self) -> Ask:
        asks = [output for output in self.out if isinstance(output, Ask)]
        assert self.now.asked is not None, "nothing is asked"
        return asks[-1]

    def value(self, variable: str) -> Value:
        return self.station.system.named(self.now.state)[variable]

    def sent(self, resource: str) -> list[GoalMessage]:
        return [o.message for o in self.out if isinstance(o, Send) and o.message.resource == resource]

    def notes(self, kind: str) -> list[str]:
        return [o.text for o in self.out if isinstance(o, Note) and o.kind == kind]

    @property
    def instructions(self) -> list[Instruct]:
        return [o for o in self.out if isinstance(o, Instruct)]

    @property
    def consents(self) -> list[Consent]:
        return [o for o in self.out if isinstance(o, Consent)]

    @property
    def executing(self) -> list[str]:
        return [execution.task.name for execution in self.now.executing]
