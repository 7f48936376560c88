"""The journal: what has happened, on disk before anybody acts upon it.

`framing` says which bytes a record becomes and how records are found again, without touching a file; `folder` keeps
them in files that survive crashes and full disks. What a record says is none of their business.
"""

from smv_planner.journal.folder import Disk, Folder, Journal, Opened, Refused, Unwritten
from smv_planner.journal.framing import Damaged, Header, Sound, Torn, frame, opening, read

__all__ = [
    "Damaged",
    "Disk",
    "Folder",
    "Header",
    "Journal",
    "Opened",
    "Refused",
    "Sound",
    "Torn",
    "Unwritten",
    "frame",
    "opening",
    "read",
]
