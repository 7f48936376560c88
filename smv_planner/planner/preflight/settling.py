"""Whether automatic transitions settle, and always in the same way whatever their order.

Runs of automatic transitions are written out as predicates, with a copy of the variables for each step, so that SAT
finds a state from which a run is long, or from which two orders end differently. When no state allows a run of n steps
all is proved; when some state does, that state is tried out, and either runs in a circle or tells how far to look.
Transitions that do not touch what the others use are looked at apart: n stays small.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import pairwise

from smv_planner.lazy import dataclass
from smv_planner.model.domains import Domain, Value, show_value
from smv_planner.model.expressions import TRUE, Expr, Var, conjunction, disjunction, equality, negation, substitute
from smv_planner.model.semantics import Step, Steps, fire, ready
from smv_planner.model.system import Any, State, System, Transition
from smv_planner.planner.preflight.finding import Finding, Scene, quoted

WORK = 20_000
"""How large a run may be that is written out: steps, times transitions, times values of the variables they write."""

LONGEST_RUN = 10_000
"""Steps after which trying out a state is given up."""


class Copied(dict[str, Domain]):
    """Domains that also know the copies of variables: `x@3` has the domain of `x`."""

    def __missing__(self, name: str) -> Domain:
        original, at, _ = name.rpartition("@")
        if not at:
            raise KeyError(name)
        return self[original]


UNPROVED = 8
"""How many steps of runs are compared that are not known to settle."""


def settling(scene: Scene) -> Iterator[Finding]:
    for group in groups(scene.system):
        length = _longest(scene, group, scene.allowed, forbidden=False)
        if isinstance(length, Finding):
            yield length
        elif scene.allowed != TRUE:
            elsewhere = _longest(scene, group, TRUE, forbidden=True)
            if isinstance(elsewhere, Finding):
                yield elsewhere
        yield from _order(scene, group, length if isinstance(length, int) else UNPROVED)


@dataclass(frozen=True, eq=False)
class Group:
    """Automatic transitions in declared order, and all that use what they write or write what they use.

    A state is named by a label: `""` is the state that we ask about, others have copies of the variables written.
    """

    system: System
    transitions: tuple[Transition, ...]

    @cached_property
    def written(self) -> tuple[str, ...]:
        assigned = frozenset[str]().union(*(transition.assigned for transition in self.transitions))
        return tuple(variable.name for variable in self.system.variables if variable.name in assigned)

    @cached_property
    def work(self) -> int:
        """How large one step is, written out."""
        return len(self.transitions) * sum(len(self.system.domains[name].values) for name in self.written)

    @cached_property
    def used(self) -> frozenset[str]:
        return frozenset[str]().union(*(transition.used for transition in self.transitions))

    @cached_property
    def _steps(self) -> Steps:
        return Steps(self.system, self.transitions)

    @cached_property
    def _ready(self) -> dict[tuple[str, str], Expr]:
        return {(transition.name, ""): ready(self.system, transition) for transition in self.transitions}

    def ready(self, transition: Transition, label: str) -> Expr:
        """That the transition is enabled."""
        if (transition.name, label) not in self._ready:
            self._ready[transition.name, label] = self._at(self._ready[transition.name, ""], label)
        return self._ready[transition.name, label]

    def first(self, transition: Transition, label: str) -> Expr:
        """That the transition is the one which fires."""
        earlier = self.transitions[: self.transitions.index(transition)]
        return conjunction([self.ready(transition, label), *(negation(self.ready(other, label)) for other in earlier)])

    def settled(self, label: str) -> Expr:
        return negation(disjunction(self.ready(transition, label) for transition in self.transitions))

    def becomes(self, transition: Transition, label: str, after: str) -> Expr:
        """That the second state is what the transition makes of the first."""
        values = {action.variable: action.value for action in transition.actions}
        new = []
        for name in self.written:
            value = values.get(name, Var(name))
            assert not isinstance(value, Any), "nobody chooses the values of an automatic transition"
            new.append(equality(self._at(Var(name), after), self._at(value, label)))
        return conjunction(new)

    def step(self, label: str, after: str) -> Expr:
        return disjunction(conjunction([self.first(t, label), self.becomes(t, label, after)]) for t in self.transitions)

    def run(self, labels: Sequence[str]) -> Expr:
        """That each state is made of the one before by a transition."""
        return conjunction(self.step(a, b) for a, b in pairwise(labels))

    def end(self, labels: Sequence[str]) -> Expr:
        """That the states follow one another until a settled one, which is repeated up to the last."""
        stays = (conjunction([self.settled(a), self.same(a, b)]) for a, b in pairwise(labels))
        moves = (disjunction([self.step(a, b), stay]) for (a, b), stay in zip(pairwise(labels), stays, strict=True))
        return conjunction([*moves, self.settled(labels[-1])])

    def same(self, label: str, other: str) -> Expr:
        return conjunction(equality(self._at(Var(name), label), self._at(Var(name), other)) for name in self.written)

    def follow(self, state: State) -> list[Step]:
        """The steps that follow a state: up to a settled one, one that was there before, or too many."""
        steps: list[Step] = []
        seen = {state}
        while len(steps) < LONGEST_RUN and (step := self._steps.automatic(state)):
            steps.append(step)
            state = step[1]
            if state in seen:
                break
            seen.add(state)
        return steps

    def _at(self, expr: Expr, label: str) -> Expr:
        return substitute(expr, {name: Var(f"{name}@{label}") for name in self.written}) if label else expr


def groups(system: System) -> list[Group]:
    """The automatic transitions, put together where one uses what another one writes."""
    found: list[list[Transition]] = []
    for transition in system.transitions:
        if transition.kind.automatic:
            meeting = [group for group in found if any(_meet(transition, other) for other in group)]
            found = [group for group in found if group not in meeting] + [[*(t for group in meeting for t in group), transition]]
    position = {transition.name: at for at, transition in enumerate(system.transitions)}
    return [Group(system, tuple(sorted(group, key=lambda t: position[t.name]))) for group in found]


def _meet(a: Transition, b: Transition) -> bool:
    return not (a.assigned.isdisjoint(b.used) and b.assigned.isdisjoint(a.used))


def _longest(scene: Scene, group: Group, within: Expr, forbidden: bool) -> int | Finding:
    """The number of steps that no run has which starts `within`, or what speaks against there being one."""
    length = 1
    while True:
        running = group.run(["", *(f"a{at}" for at in range(1, length + 1))])
        found = scene.ask.example(within, running)
        if found is None:
            return length
        reached = length
        for state in (scene.near(within, running), scene.state(found)):
            assert state is not None
            steps = group.follow(state)
            visited = [state, *(after for _, after in steps)]
            if visited[-1] in visited[:-1]:
                return _circle(scene, group, steps[visited.index(visited[-1]) :], forbidden)
            reached = max(reached, len(steps))
        length = max(2 * length, reached + 1)
        if length * group.work > WORK:
            return _not_proved(group, reached)


def _circle(scene: Scene, group: Group, steps: Sequence[Step], forbidden: bool) -> Finding:
    names = [transition.name for transition, _ in steps]
    shown = " -> ".join([*names[:8], "..." if len(names) > 8 else names[0]])
    where = ", from a state that the invariants forbid" if forbidden else ""
    return Finding(
        "warning" if forbidden else "error",
        "does-not-settle",
        "transition",
        next(transition.name for transition in group.transitions if transition.name in names),
        f"automatic transitions fire for ever{where}: {shown}",
        "let a guard become false by what follows it",
        scene.shown(steps[-1][1], group.used),
    )


def _not_proved(group: Group, steps: int) -> Finding:
    names = [transition.name for transition in group.transitions]
    message = f"not proved to settle: {quoted(names)}; a run of {steps} steps was found, and longer ones were not looked for"
    if len(names) > 1:
        message += f"; whether their order matters was tried for runs of {UNPROVED - 1} steps"
    hint = "count in larger steps, or with fewer automatic transitions"
    return Finding("warning", "not-proved-to-settle", "transition", names[0], message, hint)


def _order(scene: Scene, group: Group, length: int) -> Iterator[Finding]:
    """States from which a later transition, if it came first, would lead elsewhere.

    To ask this of every transition and the one that comes first is enough: if it never matters which of them begins, any
    order ends where the declared one does.
    """
    if length == 1 or len(group.transitions) == 1:
        return
    declared = ["", *(f"a{at}" for at in range(1, length))]
    other = [f"b{at}" for at in range(length)]
    differ = negation(group.same(declared[-1], other[-1]))
    ends = (group.end(declared), group.end(other), differ, scene.allowed)
    for at, late in enumerate(group.transitions):
        earlier = list(group.transitions[:at])
        while earlier:
            begins = disjunction(group.first(transition, "") for transition in earlier)
            state = scene.near(group.ready(late, ""), begins, group.becomes(late, "", other[0]), *ends)
            if state is None:
                break
            yield _pair(scene, group, state, late)
            first = next(t for t in group.transitions if fire(scene.system, t, state))
            earlier.remove(first)


def _pair(scene: Scene, group: Group, state: State, late: Transition) -> Finding:
    steps = group.follow(state)
    (begun,) = fire(scene.system, late, state)
    one, two = ([(late, begun), *group.follow(start)][-1][1] for start in (state, begun))
    return Finding(
        "warning",
        "order-matters",
        "transition",
        late.name,
        f"'{steps[0][0].name}' and '{late.name}' can be enabled together, and their order matters: as declared they lead to "
        f"{_told(scene.system.changes(two, one))}, the other way round to {_told(scene.system.changes(one, two))}",
        "let one guard exclude the other; until then the first that is declared fires first",
        scene.shown(state, group.used),
    )


def _told(values: dict[str, Value]) -> str:
    return ", ".join(f"{name} = {show_value(value)}" for name, value in values.items())
