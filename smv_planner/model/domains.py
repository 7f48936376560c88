"""Finite domains: Booleans, enumerations and small ranges of integers (Machines 2021, Def. 2)."""

from __future__ import annotations

from smv_planner.lazy import dataclass

Value = bool | int | str


@dataclass(frozen=True, slots=True)
class Bool:
    """`false` and `true`."""

    @property
    def values(self) -> tuple[Value, ...]:
        return (False, True)

    def __contains__(self, value: object) -> bool:
        return type(value) is bool

    def __str__(self) -> str:
        return "bool"


@dataclass(frozen=True, slots=True)
class Enum:
    """A few words."""

    words: tuple[str, ...]

    @property
    def values(self) -> tuple[Value, ...]:
        return self.words

    def __contains__(self, value: object) -> bool:
        return type(value) is str and value in self.words

    def __str__(self) -> str:
        return "{" + ", ".join(self.words) + "}"


@dataclass(frozen=True, slots=True)
class Range:
    """The integers from `low` to `high`, both included."""

    low: int
    high: int

    @property
    def values(self) -> tuple[Value, ...]:
        return tuple(range(self.low, self.high + 1))

    def __contains__(self, value: object) -> bool:
        return type(value) is int and self.low <= value <= self.high

    def __str__(self) -> str:
        return f"{self.low}..{self.high}"


Domain = Bool | Enum | Range


def show_value(value: Value) -> str:
    """A value as a scenario writes it."""
    return str(value).lower() if type(value) is bool else str(value)
