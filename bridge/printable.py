"""What others have said, as it may be shown in a terminal."""

from __future__ import annotations


def printable(text: str) -> str:
    """Nobody on the network writes to our terminal: only what can be read, and ends of lines."""
    return "".join(each if each.isprintable() or each == "\n" else "?" for each in text)
