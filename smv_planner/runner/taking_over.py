"""Taking over a cell, and being taken over: listen, hold under a new epoch until all live hubs obey, run."""

from __future__ import annotations

from smv_planner.model.system import Policy
from smv_planner.protocol import view as hubs
from smv_planner.runner import operator, resources
from smv_planner.runner.decision import Cause
from smv_planner.runner.resources import LISTEN
from smv_planner.runner.situation import Phase
from smv_planner.runner.turn import Turn

LEAP = 1_000_000
"""No planner begins so often: an epoch so far ahead of ours is nobody's, and would leave none for us."""

OUTVOTED = 5.0
"""Seconds after which a planner that was fenced out, but whom all hubs obey all the same, takes that for a forgery."""


def begin(turn: Turn, planner: str, deaf: float = 0.0) -> None:
    """Nothing of an earlier reign is taken for granted but what only the planner can know.

    For `deaf` seconds nothing is listened to: who has slept hears what has waited in sockets, and that is older than it looks.
    """
    at, listens = turn.now.at, turn.now.at + deaf
    views = {name: hubs.HubView(heard_at=listens) for name in turn.station.interfaces}
    by_hand = [n for n in turn.now.lost if turn.station.resources[n].reenable.policy is Policy.MANUAL]
    turn.set(
        phase=Phase.LISTENING,
        planner=planner,
        since=listens,
        hubs=views,
        sequence={},
        published={},
        lost=dict.fromkeys(by_hand, at),
        doubts={},
        timers={},
        disabled=dict.fromkeys(turn.now.disabled, at),
        following=None,
        asked=None,
        cause=Cause.RESUMED if turn.now.wanted() else None,
        blamed=frozenset(),
        broken=frozenset(),
        not_before=at,
        recheck=True,
    )
    operator.keep_wishes(turn, None)
    turn.note("began", f"planner {planner} listens", planner=planner)


def take_over(turn: Turn) -> None:
    """From listening to holding under a new epoch, and from there to running."""
    now, at = turn.now, turn.now.at
    if now.phase is Phase.LISTENING:
        silent = [name for name, view in now.hubs.items() if view.state is None]
        if all(resources.is_silent(turn, name) for name in silent):
            claimed = [view.state.epoch for view in now.hubs.values() if view.state]
            epoch = max([now.epoch, *(one for one in claimed if one <= now.epoch + LEAP)]) + 1
            turn.set(phase=Phase.JOINING, epoch=epoch, since=at, sequence=dict.fromkeys(now.hubs, 0), published={})
            for name in silent:
                if name not in now.lost:
                    resources.lose(turn, name, "has not spoken since the planner began")
            for name in now.hubs:
                if name not in silent:
                    resources.adopt_mirror(turn, name)
            turn.note("joining", f"epoch {epoch}: holding until all hubs obey", epoch=epoch)
    elif now.phase is Phase.JOINING:
        living = [view for name, view in now.hubs.items() if name not in now.lost]
        unknown = [name for name in now.hubs if name not in now.heard]
        if unknown and now.stuck is None and now.at - now.since > LISTEN:
            waits = f"nothing is known of {', '.join(map(repr, unknown))}, which has never spoken: waiting for it"
            turn.set(stuck=waits)
            turn.note("alarm", waits, resources=tuple(unknown))
        if not unknown and all(resources.obeys(turn, view) for view in living):
            turn.set(phase=Phase.RUNNING, since=at, stuck=None)
            turn.note("running", f"epoch {now.epoch}: {len(living)} of {len(now.hubs)} hubs obey", epoch=now.epoch)
            if now.executing:
                turn.need(Cause.RESUMED)


def is_deaf(turn: Turn) -> bool:
    """Whether this planner has slept, and hears what is older than it looks."""
    return turn.now.phase is Phase.LISTENING and turn.now.at < turn.now.since


def superseded(turn: Turn, name: str) -> bool:
    """Another planner rules this hub: give way, or claim a newer epoch if both claimed the same at once."""
    now = turn.now
    view = now.hubs[name]
    if now.phase not in (Phase.JOINING, Phase.RUNNING) or not hubs.superseded(view, now.epoch, now.planner):
        return False
    assert view.state is not None
    if view.state.epoch > now.epoch + LEAP:
        if name not in now.lost:
            resources.lose(turn, name, f"claims to obey epoch {view.state.epoch}, which nobody can have reached")
        return False
    if view.state.epoch == now.epoch and now.phase is Phase.JOINING and now.planner > view.state.planner:
        turn.set(epoch=now.epoch + 1, since=now.at, sequence=dict.fromkeys(now.hubs, 0), published={})
        turn.note("joining", f"epoch {now.epoch + 1}: '{view.state.planner}' claims {now.epoch}", epoch=now.epoch + 1)
        return True
    turn.set(phase=Phase.FENCED_OUT, since=now.at, following=None, asked=None, cause=None)
    operator.keep_wishes(turn, None)
    text = f"planner {view.state.planner} has taken over with epoch {view.state.epoch}; nothing is sent any more"
    turn.note("alarm", text, planner=view.state.planner, epoch=view.state.epoch)
    return True


def outvoted(turn: Turn) -> bool:
    """Whether nobody but a single message has ever said that another planner has taken over."""
    return turn.now.at - turn.now.since > OUTVOTED and all(
        resources.obeys(turn, view) and not resources.is_silent(turn, name) for name, view in turn.now.hubs.items()
    )
