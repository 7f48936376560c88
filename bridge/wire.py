"""One hub's end of a link: goal messages in, state messages out, and a count of what was refused and why."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

from bridge import keys
from bridge.link import Link
from smv_planner.protocol.interface import Interface
from smv_planner.protocol.messages import GoalMessage, Rejected, StateMessage, decode_goal, encode

WAITING = 32
"""So many goal messages wait for a hub: two planners that speak at once are both heard."""


class Wire:
    """`rejected` counts goal messages by reason; whoever runs the hub automaton adds what that refuses."""

    def __init__(self, link: Link, interface: Interface, wake: Callable[[], None]) -> None:
        ours = interface.cell, interface.resource
        self.rejected: Counter[str] = Counter()
        self._link = link
        self._interface = interface
        self._key = keys.state(*ours)
        self._last: tuple[bytes, GoalMessage] | None = None
        self._mailbox = link.latest(keys.goal(*ours), depth=WAITING, wake=wake)
        link.alive(keys.alive(*ours))

    def goals(self) -> list[GoalMessage]:
        """The well-formed goal messages that have arrived since the last time."""
        good = []
        for _, payload in self._mailbox.drain():
            if self._last and self._last[0] == payload:  # the usual case: the same again
                good.append(self._last[1])
                continue
            match decode_goal(payload, self._interface):
                case Rejected() as rejected:
                    self.refuse(rejected)
                case message:
                    self._last = payload, message
                    good.append(message)
        self.rejected.update(self._mailbox.refused)
        self._mailbox.refused.clear()
        return good

    def refuse(self, rejected: Rejected) -> None:
        self.rejected[rejected.reason.value] += 1

    def send(self, message: StateMessage) -> None:
        self._link.publish(self._key, encode(message))
