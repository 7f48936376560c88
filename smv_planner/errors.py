"""What can go wrong, as exceptions.

Only three things are exceptions: a scenario that is wrong (`ModelError`, with every mistake found), a question that
is wrong (`UsageError`), and a tool that broke (`EngineError`). That there is no plan is an answer, not an error.
"""

from __future__ import annotations

from collections.abc import Iterable

from smv_planner.lazy import dataclass


@dataclass(frozen=True, slots=True)
class Place:
    """Where in a text: 1-based line and column, the length to underline, and the whole source line.

    `instance` says which one is meant where a text stands for many: "in template 'robot' for resource 'r1', pose = b3".
    """

    file: str
    line: int
    column: int
    length: int = 1
    source: str = ""
    instance: str = ""

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}"


@dataclass(frozen=True, slots=True)
class Mistake:
    """One thing that is wrong in a scenario or a question, where it is, and what to do about it.

    `file` is which file is meant when it is not a place in it that is wrong.
    """

    message: str
    hint: str | None = None
    place: Place | None = None
    file: str | None = None

    def __str__(self) -> str:
        text = f"{self.place}: {self.message}" if self.place else self.message
        notes = "; ".join(filter(None, (self.place.instance if self.place else None, self.hint)))
        text += f" ({notes})" if notes else ""
        if self.place and self.place.source:
            text += "\n" + _underlined(self.place)
        return text


class SmvPlannerError(Exception):
    """Everything this package raises on purpose."""


class MistakesError(SmvPlannerError):
    """Carries every `Mistake` found, in the order of the text."""

    def __init__(self, mistakes: Iterable[Mistake]) -> None:
        self.mistakes = tuple(mistakes)
        super().__init__("\n".join(map(str, self.mistakes)))


class ModelError(MistakesError):
    """The scenario is wrong."""


class UsageError(MistakesError):
    """The question put to a correct scenario is wrong: an unknown variable in a goal, a value outside a domain."""


class EngineError(SmvPlannerError):
    """A tool broke, or answered something that its own trace does not bear out."""


def did_you_mean(word: str, known: Iterable[str]) -> str | None:
    """A hint that names the closest known word, if one is close."""
    from difflib import get_close_matches

    close = get_close_matches(word, list(known), n=1, cutoff=0.6)
    return f"did you mean '{close[0]}'?" if close else None


def _underlined(place: Place, width: int = 160) -> str:
    """The source line with carets; long lines are cut around the place, tabs and control characters become spaces."""
    column = min(max(place.column - 1, 0), len(place.source))
    start = max(0, column - width // 2) if len(place.source) > width else 0
    shown = "".join(c if c.isprintable() else " " for c in place.source[start : start + width])
    carets = max(1, min(place.length, len(place.source) - column, width - (column - start)))
    return f"    {shown}\n    {' ' * (column - start)}{'^' * carets}"
