"""The live picture of a simulation, for a terminal."""

from __future__ import annotations

from collections import deque

from rich.columns import Columns
from rich.console import Console, Group
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from smv_planner.model.model import OnError
from smv_planner.runner.events import Note
from smv_planner.simulate.script import Case
from smv_planner.simulate.view import BUSY, Timelines, abilities, plan_lines, purpose, transcript, waits
from smv_planner.simulate.world import World

LATEST = 8
"""Lines of the story that are shown."""

COLOURS = {
    "executing": "bold",
    "finished": "green",
    "error": "bold red",
    "paused": "yellow",
    "cancelled": "dim",
    "initial": "dim",
}


class Scene:
    """What a world looks like now. `draw` puts it on the screen."""

    def __init__(self, world: World, case: Case, speed: float) -> None:
        self.world, self.case, self.speed = world, case, speed
        self.lines = Timelines(world.station)
        self.story: deque[str] = deque(maxlen=LATEST)
        self._console = Console(highlight=False)
        self._live = Live(console=self._console, auto_refresh=False, transient=True, screen=False)

    def shown(self) -> Live:
        return self._live

    def tell(self, at: float, note: Note) -> None:
        self.story.append(transcript(at, note))

    def draw(self) -> None:
        self._live.update(self.picture(self._console.width), refresh=True)

    def picture(self, width: int) -> Group:
        now = self.world.situation
        model = self.world.station.model
        speed = f"{self.speed:g} times real time" if self.speed else "as fast as possible"
        title = f"{model.name}, {self.case.name}   {self.world.at:.1f} s, {speed}   epoch {now.epoch}, {now.phase.value}"
        if model.on_error is not OnError.CONTINUE:
            title += f", on error: {model.on_error.value}"
        status = Table.grid(padding=(0, 2))
        for name, pursuit in now.intentions.items():
            status.add_row("intention", Text(name), Text(pursuit.status.value, style=COLOURS[pursuit.status.value]))
        for execution in now.executing:
            status.add_row("operation", Text(execution.task.name), Text("executing", style="bold"))
        for name, reason in list(now.failed.items())[:6]:
            status.add_row("operation", Text(name), Text(f"error: {reason}"[:60], style="bold red"))
        for name in now.disabled:
            status.add_row("effect", Text(name), Text("timed out", style="yellow"))
        waiting = [Text(f"waits for {line}"[: width - 4]) for line in waits(self.world.station, now)[:6]]
        held = [Text(f"{owner}: {', '.join(names)}") for owner, names in abilities(self.world.station, now).items() if names]
        return Group(
            Text(title, style="bold reverse"),
            Columns(
                [
                    Panel(status, title="intentions and operations"),
                    Panel(Text("\n".join(plan_lines(now.following)) or "-"), title=purpose(now.following)),
                    Panel(Group(*held) if held else Text("-"), title="holds"),
                ]
            ),
            *waiting,
            self._lanes(width),
            Text("\n".join(line[: width - 1] for line in self.story), style="dim"),
        )

    def _lanes(self, width: int) -> Text:
        names = max((len(name) for name in self.lines.lanes), default=0)
        room = max(20, width - names - 3)
        seconds = max(1.0, self.world.at / room) if self.world.at < 4 * room else 4.0
        text = Text()
        for name, line in self.lines.drawn(self.world.at, room, seconds):
            text.append(f"{name:<{names}} │")
            for sign in line:
                text.append(sign, style="" if sign == BUSY else "bold red")
            text.append("\n")
        text.append(f"{'seconds':<{names}} │{self.lines.axis(self.world.at, room, seconds)}", style="dim")
        return text
