"""Would the plan still work if every effect came as soon as it can?

A planner may use that an effect has not happened yet: the nutrunner's torque flag, not reset while the robot moves
on, seems to tighten the next bolt as well. Such a plan is possible in the model and improbable on the machine, so it
is replayed with prompt effects and reported as a warning.
"""

from __future__ import annotations

from collections import deque

from smv_planner.lazy import dataclass
from smv_planner.model.expressions import conjunction, meaning
from smv_planner.model.ltl import holds
from smv_planner.model.semantics import Step, Steps
from smv_planner.model.system import Kind
from smv_planner.problem import Problem, Reached


def needs_late_effects(problem: Problem, trace: Reached) -> str | None:
    """A warning if the plan works only because some effect stays late."""
    return _Replay(problem, trace).warning()


@dataclass
class _Replay:
    problem: Problem
    trace: Reached

    def __post_init__(self) -> None:
        self.steps = Steps(self.problem.system, self.problem.usable)
        self.states = [self.problem.initial]
        self.unplanned: list[str] = []  # effects that came although the plan has them later or never
        self.ahead = deque(enumerate(self.trace.path))

    def warning(self) -> str | None:
        allowed = meaning(conjunction(i.predicate for i in self.problem.allowed), self.problem.system.index)
        refused = self._run()
        if refused is not None:
            result = f"step {refused} ('{self.trace.path[refused]}') is not possible then"
        elif not holds(self.problem.formula, self.states, self.problem.system.index):
            result = "the goal is not reached then"
        elif not all(allowed(state) for state in self.states):
            result = "an invariant is violated then"
        else:
            return None
        late = ", ".join(f"'{name}'" for name in dict.fromkeys(self.unplanned)) or "an effect"
        return f"the plan works only if {late} comes late: replayed with prompt effects, {result}"

    def _run(self) -> int | None:
        """Take the plan's deliberate steps, letting everything else happen first. The first step that is refused."""
        self._let_happen()
        while self.ahead:
            at, name = self.ahead.popleft()
            if not self.problem.system.transition[name].kind.deliberate:
                continue  # it has happened by itself, or does not happen any more
            after = self.steps.again(self.states[-1], self.problem.system.transition[name], self.trace.states[at + 1])
            if after is None:
                return at
            self.states.append(after)
            self._let_happen()
        return None

    def _let_happen(self) -> None:
        """Automatic steps and effects until none is left, or they go round in circles."""
        seen = {self.states[-1]}
        while (step := self._next_event()) is not None and step[1] not in seen:
            transition, after = step
            if transition.kind is Kind.EFFECT:
                self._note(transition.name)
            seen.add(after)
            self.states.append(after)

    def _next_event(self) -> Step | None:
        """The automatic step that is due; else the effect that the plan has next; else any other effect."""
        events = [step for step in self.steps(self.states[-1]) if not step[0].kind.deliberate]
        planned = {name: at for at, name in reversed(self.ahead)}
        return min(events, key=lambda step: planned.get(step[0].name, len(self.trace.path)), default=None)

    def _note(self, effect: str) -> None:
        """Take a planned effect off the list if it is the plan's next; remember any other as unplanned."""
        coming = next((name for _, name in self.ahead if not self.problem.system.transition[name].kind.automatic), None)
        if coming == effect:
            while self.ahead[0][1] != effect:
                self.ahead.popleft()
            self.ahead.popleft()
        else:
            self.unplanned.append(effect)
