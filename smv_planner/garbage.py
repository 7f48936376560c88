"""How often the garbage collector looks through what there is: seldom in a process that plans.

What is learnt of a model stays with the process, and nearly all that a question makes is needed to its end; looking through
it again and again finds little. Whose process it is decides, so this is for commands and not for the library.
"""

from __future__ import annotations

import gc

OBJECTS = 200_000
"""How many more objects there have to be before it looks: a first question about a large station makes 120 000."""


def look_seldom() -> None:
    gc.set_threshold(OBJECTS)
