"""The planner's view of one hub: what it last said, whether it still speaks, and whether it does as it is told.

The network may lose, repeat, delay and reorder. Sequence numbers put the messages of one boot in order. Boots have no
order of their own, so what a replaced process left in the network is told from the living one by persistence: only who
keeps speaking while the other is silent is alive. So no accident of order can shut out a living hub for ever.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from smv_planner.lazy import dataclass, field, replace
from smv_planner.model.domains import Value
from smv_planner.protocol.messages import StateMessage

PERSISTENT = 3
"""So many newer messages of a boot believed dead, with nothing from the other in between, and it is alive."""

MAX_PAST = 16


class Heard(StrEnum):
    """What a state message turned out to be. Only the first two are believed."""

    FRESH = "fresh"
    REBOOTED = "rebooted"  # fresh, and of another process than before
    DUPLICATE = "duplicate"
    OLD = "old"  # overtaken by a newer message of the same boot
    OLD_BOOT = "old_boot"  # of a process believed dead

    @property
    def believed(self) -> bool:
        return self in (Heard.FRESH, Heard.REBOOTED)


@dataclass(frozen=True, slots=True)
class HubView:
    """`heard_at` is when the last fresh message came; before the first, since when we listen.

    `commanded` is what we ask of the hub. For each variable whose mirror differs, `differs_since` says since when it has
    been stuck there. `past` has the boots believed dead with the newest sequence number of each, the last one last;
    `insisting` counts the newer messages of one of them since the living boot was heard.
    """

    heard_at: float
    state: StateMessage | None = None
    commanded: Mapping[str, Value] = field(default_factory=dict)
    differs_since: Mapping[str, float] = field(default_factory=dict)
    past: tuple[tuple[str, int], ...] = ()
    insisting: tuple[str, int] = ("", 0)


def hear(view: HubView, message: StateMessage, at: float) -> tuple[HubView, Heard]:
    """The view after a decoded state message. What is not fresh neither changes the state nor counts as a sign of life."""
    now = view.state
    if now and message.boot == now.boot:
        if message.seq <= now.seq:
            return view, Heard.DUPLICATE if message.seq == now.seq else Heard.OLD
        return _believing(view, message, at), Heard.FRESH
    past = dict(view.past)
    if message.boot in past:
        if message.seq <= past[message.boot]:
            return view, Heard.OLD_BOOT
        boot, times = view.insisting
        times = times + 1 if boot == message.boot else 1
        past[message.boot] = message.seq
        if times < PERSISTENT:
            return replace(view, past=tuple(past.items()), insisting=(message.boot, times)), Heard.OLD_BOOT
        del past[message.boot]
    if now:
        past[now.boot] = now.seq
    # A new process mirrors what it starts with: it gets its time to follow from now.
    view = replace(view, past=tuple(past.items())[-MAX_PAST:], differs_since={})
    return _believing(view, message, at), Heard.REBOOTED if now else Heard.FRESH


def command(view: HubView, values: Mapping[str, Value], at: float) -> HubView:
    """The view once `values` are asked of the hub from `at` on. Asking the same again changes nothing."""
    if values == view.commanded:
        return view
    mirror = view.state.mirror if view.state else {}
    since = _differing(mirror, mirror, values, view.differs_since, at)
    return replace(view, commanded=dict(values), differs_since=since)


def silent(view: HubView, at: float, silent_after: float) -> bool:
    """Whether the hub has said nothing fresh for longer than that."""
    return at - view.heard_at > silent_after


def stuck(view: HubView, limit: float = 1.0) -> tuple[str, ...]:
    """The goal variables for which the hub, while speaking, has mirrored the same wrong value for longer than `limit`.

    A hub that has not spoken since is not stuck but silent; one whose mirror follows behind is not stuck but slow.
    """
    return tuple(name for name, since in view.differs_since.items() if view.heard_at - since > limit)


def fenced(view: HubView, epoch: int, planner: str) -> bool:
    """Whether the hub obeys this planner in this epoch, so that no older command can reach its device any more."""
    return view.state is not None and (view.state.epoch, view.state.planner) == (epoch, planner)


def superseded(view: HubView, epoch: int, planner: str) -> bool:
    """Whether the hub obeys a planner that comes after this one: a newer epoch, or the same claimed by another first."""
    if view.state is None or view.state.epoch < epoch:
        return False
    return view.state.epoch > epoch or view.state.planner != planner


def _believing(view: HubView, message: StateMessage, at: float) -> HubView:
    before = view.state.mirror if view.state else {}
    since = _differing(before, message.mirror, view.commanded, view.differs_since, at)
    return replace(view, heard_at=at, state=message, differs_since=since, insisting=("", 0))


def _differing(
    before: Mapping[str, Value],
    mirror: Mapping[str, Value],
    commanded: Mapping[str, Value],
    since: Mapping[str, float],
    at: float,
) -> dict[str, float]:
    """Since when each differing variable has been mirrored as it is; a mirror that moved is given time again."""
    return {
        name: since.get(name, at) if before.get(name) == mirror[name] else at
        for name, value in commanded.items()
        if name in mirror and mirror[name] != value
    }
