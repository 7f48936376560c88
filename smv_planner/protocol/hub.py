"""The hub automaton: which goal a hub obeys, and what it reports.

Drivers and emulators run it. A hub obeys whole goal messages only, and only the newest planner: locks and leases cannot
keep two planners apart, but the receiver can, by refusing every epoch older than the newest it has seen (fencing). When
the planner falls silent, the deadman reaction takes over; fencing stays as it was. A hub that restarts has forgotten
which epoch it obeyed, and says so by its new boot: whoever plans has to see its own epoch echoed again.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import inf

from smv_planner.lazy import dataclass, replace
from smv_planner.model.domains import Value
from smv_planner.model.model import Resource
from smv_planner.protocol.interface import Interface
from smv_planner.protocol.messages import GoalMessage, Reason, Rejected, StateMessage


@dataclass(frozen=True, slots=True)
class Hold:
    """After so many seconds without a goal message the hub keeps obeying the last one, and `Hub.forsaken` says so."""

    after: float = 0.5


@dataclass(frozen=True, slots=True)
class Safe:
    """After so many seconds without a goal message the hub sets these goals and holds the others, until a planner speaks."""

    values: Mapping[str, Value]
    after: float = 0.5


Deadman = Hold | Safe

HOLD = Hold()


@dataclass(frozen=True, slots=True)
class Hub:
    """`obeyed` is the newest goal message accepted in this boot; before any, `resting` holds. `seq` counts reports."""

    interface: Interface
    boot: str
    deadman: Deadman
    resting: Mapping[str, Value]
    heard_at: float
    obeyed: GoalMessage | None = None
    forsaken: bool = False
    seq: int = 0

    @property
    def goal(self) -> Mapping[str, Value]:
        """The goal values to act on now, and to mirror."""
        told = self.obeyed.values if self.obeyed else self.resting
        match self.deadman:
            case Safe(values) if self.forsaken:
                return {**told, **values}
        return told

    @property
    def epoch(self) -> int:
        return self.obeyed.epoch if self.obeyed else 0


def deadman_of(resource: Resource) -> Deadman:
    """The reaction that the scenario asks of a hub. Without one it holds for ever and thinks nothing of it."""
    if resource.deadman is None:
        return Hold(inf)
    return Safe(dict(resource.safe), resource.deadman) if resource.safe else Hold(resource.deadman)


def start(interface: Interface, boot: str, at: float, goal: Mapping[str, Value], deadman: Deadman = HOLD) -> Hub:
    """A hub that has just started. `boot` must differ from those of all its earlier starts; `goal` is what the device does."""
    return Hub(interface, boot, deadman, goal, at)


def receive(hub: Hub, message: GoalMessage, at: float) -> Hub | Rejected:
    """The hub after a decoded goal message; a rejected one leaves it as it was and does not count as hearing a planner."""
    now = hub.obeyed
    if now and message != now:
        if message.epoch < now.epoch:
            return Rejected(Reason.OLD_EPOCH, f"epoch {message.epoch} of {message.planner}, {now.planner} is at {now.epoch}")
        if message.epoch == now.epoch:
            if message.planner != now.planner:
                return Rejected(Reason.OTHER_PLANNER, f"epoch {now.epoch} belongs to {now.planner}, not {message.planner}")
            if message.seq < now.seq:
                return Rejected(Reason.OLD, f"goal {message.seq} after {now.seq}")
            if message.seq == now.seq:
                return Rejected(Reason.CONFLICT, f"goal {now.seq} came with two different contents")
    return replace(hub, obeyed=message, heard_at=at, forsaken=False)


def tick(hub: Hub, at: float) -> Hub:
    """The hub as time goes by: the deadman reaction begins when no planner has spoken for too long."""
    if hub.forsaken or at - hub.heard_at <= hub.deadman.after:
        return hub
    return replace(hub, forsaken=True)


def report(hub: Hub, measured: Mapping[str, Value], at: float) -> tuple[Hub, StateMessage]:
    """The next state message. What it mirrors holds at `at`: an overdue deadman reaction begins first."""
    hub = replace(tick(hub, at), seq=hub.seq + 1)
    ours, obeyed = hub.interface, hub.obeyed
    return hub, StateMessage(
        ours.cell,
        ours.resource,
        hub.boot,
        hub.seq,
        ours.model,
        {name: measured[name] for name in ours.measured},
        {name: hub.goal[name] for name in ours.goals},
        obeyed.epoch if obeyed else 0,
        obeyed.seq if obeyed else 0,
        obeyed.planner if obeyed else "",
    )
