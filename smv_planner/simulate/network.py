"""What becomes of a message between planner and hub, drawn from the seed.

Frames carry the checksum of the transport, so what is damaged on the way is thrown away by whoever receives it. It is
read all the same before that: nothing that comes out of a network may make the codecs fail.
"""

from __future__ import annotations

from smv_planner.emulation.draw import Draw
from smv_planner.lazy import dataclass

TRAVEL = 0.002
"""Seconds that a message takes when nothing holds it up."""


@dataclass(frozen=True, slots=True)
class Weather:
    """Chances per message: lost, arriving twice, held up for up to `longest` seconds (so overtaken), damaged."""

    loss: float = 0.0
    twice: float = 0.0
    late: float = 0.0
    damage: float = 0.0
    longest: float = 0.0


CALM = Weather()


@dataclass(frozen=True, slots=True)
class Arrival:
    """`after` so many seconds these bytes arrive; unless `sound`, the transport's checksum tells that they are not those sent."""

    after: float
    payload: bytes
    sound: bool = True


def arrivals(weather: Weather, payload: bytes, draw: Draw) -> tuple[Arrival, ...]:
    """Every copy of a message that arrives."""
    if weather is CALM:
        return (Arrival(TRAVEL, payload),)
    if draw.unit("loss") < weather.loss:
        return ()
    if weather.twice and draw.unit("twice") < weather.twice:
        return _arrival(weather, payload, draw), _arrival(weather, payload, draw.of("again"))
    return (_arrival(weather, payload, draw),)


def _arrival(weather: Weather, payload: bytes, draw: Draw) -> Arrival:
    held_up = weather.late and draw.unit("late") < weather.late
    after = TRAVEL + (draw.unit("how late") * weather.longest if held_up else 0.0)
    if weather.damage and draw.unit("damage") < weather.damage:
        return Arrival(after, damaged(payload, draw), sound=False)
    return Arrival(after, payload)


def damaged(payload: bytes, draw: Draw) -> bytes:
    """With up to three bits flipped, cut short, or with rubbish behind it."""
    spoilt = bytearray(payload)
    match int(draw.unit("how") * 5):
        case 0:
            return bytes(spoilt[: int(draw.unit("cut") * len(spoilt))])
        case 1:
            return bytes(spoilt) + bytes(int(draw.unit("more", each) * 256) for each in range(8))
        case _:
            for flip in range(1 + int(draw.unit("flips") * 3)):
                bit = int(draw.unit("bit", flip) * len(spoilt) * 8)
                spoilt[bit // 8] ^= 1 << bit % 8
            return bytes(spoilt)
