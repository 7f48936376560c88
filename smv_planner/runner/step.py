"""The transition runner (Machines 2021, section 4.1): what happens next, given what is known and what has just happened.

An event is taken in; then automatic transitions are taken until none is enabled, controlled ones as far as the plan and
its order allow, operations and intentions begin and end; and if what is believed does not fit the plan any more, the
planners are asked. While they think nothing new is commanded, and what was commanded is repeated.
"""

from __future__ import annotations

from smv_planner.runner import advancing, asking, failures, goals, hearing, operator, orders, plan_steps, resources, taking_over
from smv_planner.runner.advancing import UNSETTLED
from smv_planner.runner.events import Answered, Began, Event, Heard, Ordered, Output, Tick
from smv_planner.runner.situation import Phase, Situation, Station
from smv_planner.runner.turn import Turn

ASLEEP = 2.0
"""Seconds without any event after which the runner has slept: what it believes is from before, and so is its plan."""

SETTLING = 1000
"""So many automatic steps in a row mean that a model does not settle."""


def step(station: Station, situation: Situation, event: Event) -> tuple[Situation, tuple[Output, ...]]:
    """The situation after an event, and what is to be done about it."""
    turn = Turn(station, situation.but(at=event.at))
    awake = situation.phase not in (Phase.STOPPED, Phase.FENCED_OUT)
    if awake and event.at - situation.at > max(ASLEEP, 10 * station.model.period):
        turn.note("alarm", f"nothing has happened for {event.at - situation.at:.1f} s: joining anew")
        taking_over.begin(turn, situation.planner, deaf=station.model.period)
    match event:
        case Began(_, planner):
            taking_over.begin(turn, planner)
        case Tick():
            pass
        case Heard(_, message):
            if not hearing.hear(turn, message):
                return turn.now, tuple(turn.out)  # the usual case: nothing new
        case Answered(_, revision, decision):
            asking.answered(turn, revision, decision)
        case Ordered(_, order):
            orders.obey(turn, order)
    _advance(turn)
    return turn.now, tuple(turn.out)


def _advance(turn: Turn) -> None:
    """Everything that follows from the situation as it is now."""
    if turn.now.phase is Phase.FENCED_OUT and taking_over.outvoted(turn):
        turn.note("alarm", "all hubs obey this planner all the same: joining anew")
        taking_over.begin(turn, turn.now.planner)
    if turn.now.phase in (Phase.LISTENING, Phase.JOINING):
        taking_over.take_over(turn)
    if turn.now.phase in (Phase.JOINING, Phase.RUNNING):
        resources.watch(turn)
    if turn.now.phase is Phase.RUNNING:
        _settle(turn)
        failures.watch_effects(turn)
        asking.ask(turn)
    if turn.now.phase in (Phase.JOINING, Phase.RUNNING):
        goals.send(turn)


def _settle(turn: Turn) -> None:
    """One thing after the other, until nothing more can be done at this moment."""
    for _ in range(SETTLING):
        if not (operator.performed(turn) or advancing.automatic(turn) or advancing.progress(turn) or plan_steps.command(turn)):
            return
    turn.set(halted=UNSETTLED)
    turn.note("alarm", f"{UNSETTLED}: halted after {SETTLING} steps")
