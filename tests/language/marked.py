"""Scenario texts in which the places of the expected mistakes are marked: `guard: «pos» == 3`."""

from __future__ import annotations

import re

from smv_planner.errors import ModelError, Place
from smv_planner.language import loads

DEVICE = """\
smv_planner: 1
name: test
resources:
  d:
    variables:
      pos:  {kind: measured,  domain: [closed, opened, jammed], initial: closed}
      ref:  {kind: goal,      domain: [closed, opened], initial: closed}
      lock: {kind: goal,      domain: bool, initial: true}
      done: {kind: measured,  domain: bool, initial: false}
      wear: {kind: estimated, domain: {min: 0, max: 3}, initial: 0}
    predicates:
      moving: ref != pos
    transitions:
      go: {kind: controlled, actions: {lock: false}}
decision:
  state: {domain: [waiting, seen], initial: waiting}
  home:  {from: d.pos == closed}
"""

Found = list[tuple[str, int, int, int]]
"""Messages with their hints, each with line, column and length of its place."""


def unmarked(text: str) -> tuple[str, list[tuple[int, int, int]]]:
    """The text without the marks, and where they stood."""
    places = []
    lines = text.split("\n")
    for at, line in enumerate(lines):
        while match := re.search("«([^»]*)»", line):
            places.append((at + 1, match.start() + 1, len(match[1]) or 1))
            line = line[: match.start()] + match[1] + line[match.end() :]
        lines[at] = line
    return "\n".join(lines), places


def mistakes(text: str) -> Found:
    """What `loads` finds wrong with a text; nothing if it is a model."""
    try:
        loads(text)
    except ModelError as error:
        return [(_said(m.message, m.hint), *_where(m.place)) for m in error.mistakes]
    return []


def expected(text: str, *messages: str) -> tuple[str, Found]:
    """A marked text without its marks, and the messages at the places of the marks."""
    plain, places = unmarked(text)
    assert len(places) == len(messages), "one mark for each message"
    return plain, [(message, *place) for message, place in zip(messages, places, strict=True)]


def _said(message: str, hint: str | None) -> str:
    return f"{message} ({hint})" if hint else message


def _where(place: Place | None) -> tuple[int, int, int]:
    return (place.line, place.column, place.length) if place else (0, 0, 0)
