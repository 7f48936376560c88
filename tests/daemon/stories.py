"""A station with work for a while: an arm goes out and comes home again, time after time, beside one that rests."""

from __future__ import annotations

from pathlib import Path

ARM = """
  {name}:
    silent_after: {silent}
    variables:
      to: {{kind: goal,     domain: [home, out], initial: home}}
      at: {{kind: measured, domain: [home, out], initial: home}}
    transitions:
      reach:   {{kind: controlled, guard: to == home and at == home, actions: {{to: out}}}}
      retreat: {{kind: controlled, guard: to == out and at == out, actions: {{to: home}}}}
      arrives: {{kind: effect, guard: to == out and at == home, actions: {{at: out}}, within: 5 s}}
      returns: {{kind: effect, guard: to == home and at == out, actions: {{at: home}}, within: 5 s}}
"""


def swinging(folder: Path, times: int, silent: str) -> Path:
    """A scenario in which `left` goes out or home so many times; `part` is what has been done."""
    text = "smv_planner: 1\nname: swinging\nperiod: 100 ms\nresources:" + "".join(
        ARM.format(name=name, silent=silent) for name in ("left", "right")
    )
    text += f"decision:\n  part: {{domain: [{', '.join(f'p{n}' for n in range(times + 1))}], initial: p0}}\noperations:\n"
    for n in range(times):
        where = "home" if n % 2 else "out"
        text += f"  swing_{n}: {{guard: part == p{n}, effects: {{part: p{n + 1}}}, goal: left.at == {where}, retries: 5}}\n"
    text += f"intentions:\n  swing: {{start: part == p0, goal: part == p{times}}}\n"
    folder.mkdir(exist_ok=True)
    (folder / "model.yaml").write_text(text)
    return folder
