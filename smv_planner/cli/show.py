"""An answer for people: what the verdict is, the plan as a table, and its partial order as lanes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from smv_planner.model.domains import Value, show_value
from smv_planner.model.model import Model
from smv_planner.planner.answer import Answer, PlanStep, Stage
from smv_planner.planner.conflict import in_words

COLOURS = {"controlled": "bold", "automatic": "dim", "effect": "cyan", "maintenance": "bold yellow", "operation": "magenta"}


class _Output(Console):
    """Leaves it to the command what a reader that has gone away means."""

    def on_broken_pipe(self) -> None:
        raise BrokenPipeError


def show_answer(model: Model, answer: Answer) -> None:
    console = _Output(highlight=False)
    if not console.is_terminal:
        console.width = max(console.width, 120)
    took = f"engine {answer.engine}, {answer.engine_seconds:.2f} s of {answer.total_seconds:.2f} s"
    console.print(f"[bold]{escape(model.name)}[/]: {_headline(answer)} ({took})")
    for argument in answer.arguments:
        console.print(f"[dim]{escape(answer.engine)}: {escape(argument)}[/]")
    if answer.second_opinion:
        second = answer.second_opinion
        console.print(f"[dim]{escape(second.engine)} agrees on {second.agreed} of {_count(second.asked, 'question')}[/]")
    if answer.operations:
        console.print(_operations(answer))
    overlaps = overlapping(answer.steps)
    for stage in answer.stages:
        if stage.first < stage.last:
            if answer.operations:
                console.print(f"\n[bold]stage {stage.index}[/]: {escape(_operation_names(answer, stage))}")
            console.print(_table(answer.steps[stage.first : stage.last], overlaps))
    if any(overlaps):
        console.print("[dim]Steps that may overlap can run in parallel or in either order; the checker tried all of them.[/]\n")
        console.print(_lanes(model, answer.steps))
    elif answer.steps:
        console.print("[dim]The steps go one after the other: none may overlap with another.[/]")
    for culprit in answer.culprits:
        console.print(f"  cannot be reached{' together' if len(culprit) > 1 else ''}: [bold]{escape(', '.join(culprit))}[/]")
    if answer.conflict:
        console.print(f"  {escape(in_words(answer.conflict))}")
    for violation in answer.violations:
        now = "is violated now" if violation.now else f"would be violated by {' then '.join(violation.slide) or 'a long slide'}"
        console.print(f"  invariant [bold]{escape(violation.invariant)}[/] {escape(now)}")
    for warning in answer.warnings:
        console.print(f"[yellow]warning:[/] {escape(warning)}")


def _headline(answer: Answer) -> str:
    match answer.verdict:
        case "reached" if not answer.steps and (answer.question.goals or answer.question.exit_forbidden):
            return "[green]reached[/] already: the goal holds in the initial state"
        case "reached" if not answer.operations and not answer.steps:
            return "[green]nothing to do[/]"
        case "reached":
            fewest = "in each stage the fewest possible" if len(answer.stages) > 1 else "the fewest possible"
            return f"[green]reached[/] in {_count(len(answer.steps), 'step')}, {fewest}; [green]checked[/]"
        case "unreachable":
            return f"[red]unreachable[/], proved and checked: {escape(answer.reason or '')}"
        case "invariant_violated":
            return f"[red]no planning from here[/]: {escape(answer.reason or '')}"
        case "not_within":
            return f"[yellow]no plan found[/], not proved: {escape(answer.reason or '')}"
        case "undecided":
            return f"[yellow]undecided[/]: {escape(answer.reason or '')}"


def _operations(answer: Answer) -> Table:
    table = Table(box=None, pad_edge=False, header_style="underline")
    for title in ("", "operation", "outcome", "waits for", "stage"):
        table.add_column(title)
    stage_of = {number: stage.index for stage in answer.stages for number in stage.operations}
    for one in answer.operations:
        stage = str(stage_of.get(one.index, ""))
        table.add_row(str(one.index), escape(one.operation), escape(one.outcome or ""), _ranges(one.after), stage)
    return table


def _operation_names(answer: Answer, stage: Stage) -> str:
    return ", ".join(answer.operations[number].operation for number in stage.operations)


def _table(steps: Sequence[PlanStep], overlaps: Sequence[Sequence[int]]) -> Table:
    table = Table(box=None, pad_edge=False, header_style="underline")
    table.add_column("", justify="right")
    table.add_column("transition", overflow="fold")
    table.add_column("kind")
    table.add_column("changes", overflow="fold")
    table.add_column("waits for", overflow="fold")
    table.add_column("may overlap with", overflow="fold")
    for step in steps:
        table.add_row(
            str(step.index),
            escape(step.transition) + (f"\n[yellow]{escape(step.instruction)}[/]" if step.instruction else ""),
            f"[{COLOURS[step.kind]}]{step.kind}[/]",
            escape(_changes(step.changes)),
            _ranges(step.after),
            _ranges(overlaps[step.index]),
        )
    return table


def _lanes(model: Model, steps: Sequence[PlanStep]) -> Table:
    """The partial order drawn: a lane per resource, downwards in time; what stands in one row may run at the same time."""
    owners = {transition.name: transition.resource or "" for transition in model.transitions}
    lanes = list(dict.fromkeys(owners.get(step.transition, "") for step in steps))
    lanes.sort(key=lambda lane: (lane == "", [r.name for r in model.resources].index(lane) if lane else 0))
    table = Table(box=None, pad_edge=False, header_style="underline")
    table.add_column("row", justify="right", style="dim")
    for lane in lanes:
        table.add_column(escape(lane) or "between resources", overflow="fold")
    rows: dict[int, dict[str, list[str]]] = {}
    depth: list[int] = []
    for step in steps:
        depth.append(1 + max((depth[other] for other in step.after), default=-1))
        lane = owners.get(step.transition, "")
        name = step.transition.removeprefix(f"{lane}.") if lane else step.transition
        text = f"[{COLOURS[step.kind]}]{step.index} {escape(name)}[/]"
        rows.setdefault(depth[-1], {}).setdefault(lane, []).append(text)
    for row, cells in sorted(rows.items()):
        table.add_row(str(row), *("\n".join(cells.get(lane, [])) for lane in lanes))
    return table


def overlapping(steps: Sequence[PlanStep]) -> list[list[int]]:
    """For each step the steps that are neither before nor after it."""
    before: list[set[int]] = []
    for step in steps:
        before.append(set(step.after).union(*(before[other] for other in step.after)))
    return [[b for b in range(len(steps)) if b != a and b not in before[a] and a not in before[b]] for a in range(len(steps))]


def _changes(changes: Mapping[str, Value]) -> str:
    return ", ".join(f"{name} = {show_value(value)}" for name, value in changes.items())


def _ranges(numbers: Sequence[int]) -> str:
    """`[1, 2, 3, 7]` as `1-3, 7`."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return ", ".join(str(run[0]) if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in runs)


def _count(number: int, thing: str) -> str:
    return f"{number} {thing}" if number == 1 else f"{number} {thing}s"
