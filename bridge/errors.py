"""What can go wrong on the network, as exceptions."""

from __future__ import annotations

from smv_planner.errors import EngineError


class LinkError(EngineError):
    """The network broke: no router, nobody who answers, or an answer that says no."""


class RefusedError(LinkError):
    """Somebody answered, and said no; the text is theirs."""
