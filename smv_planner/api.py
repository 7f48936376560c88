"""Questions from Python: load a scenario, ask for a plan, export the question as SMV text.

This is the composition root of one-shot planning: the pure planner meets the engines and the clock here.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from smv_planner import language
from smv_planner.clock import Over, watched
from smv_planner.errors import EngineError, Mistake, UsageError, did_you_mean
from smv_planner.lazy import dataclass, field, replace
from smv_planner.model.domains import Value
from smv_planner.model.expressions import meaning
from smv_planner.model.ltl import ALWAYS_TRUE
from smv_planner.model.model import Intention, Model
from smv_planner.model.semantics import Steps
from smv_planner.model.system import System
from smv_planner.planner import reach
from smv_planner.planner.answer import Answer, Question, SecondOpinion
from smv_planner.planner.decide import Solve
from smv_planner.planner.widening import Widened, Widening
from smv_planner.problem import Goal, NotWithin, Problem, Reached, Undecided, Unreachable, Verdict

if TYPE_CHECKING:
    from smv_planner.export.smv import Encoding
    from smv_planner.planner.second_opinion import Says

DEFAULT_ENGINE = "auto"
DEFAULT_BOUND = 100
DEFAULT_DEADLINE = 60.0
LONGEST_PLAN = 100_000
"""Steps; no bound may ask for more."""

MEMORY = 4 << 30
"""Bytes an engine may use."""


def plan(
    model: Model,
    goal: str | Iterable[str] | None = None,
    *,
    intentions: Iterable[str] = (),
    exit_forbidden: bool = False,
    formula: str | None = None,
    set: Mapping[str, Value] | None = None,
    maintenance: bool = False,
    lift: Iterable[str] = (),
    disable: Iterable[str] = (),
    lose: Iterable[str] = (),
    ran: Iterable[str] = (),
    engine: str = DEFAULT_ENGINE,
    second_opinion: str | None = None,
    bound: int = DEFAULT_BOUND,
    deadline: float = DEFAULT_DEADLINE,
    smv: str | Path | None = None,
    progress: Callable[[str], None] = lambda text: None,
    command: str | None = None,
) -> Answer:
    """Answer one planning question, from the model's initial state changed by `set`.

    With `goal`: plan transitions straight to every goal; several need not hold at once. With `formula` each is asked as
    `formula U goal` (Machines 2021, section 4.2). With `exit_forbidden`: plan the way back to where all invariants hold
    (section 4.6). With neither: plan the named `intentions`, or all whose start holds, on two levels (section 4).

    `lift` names invariants to plan without, `disable` transitions (an effect that timed out) and `lose` resources (a hub
    that is silent) that a plan may not count on. `ran` names operations of prescribed sequences that have run, each as often
    as it did; without it nothing has. `deadline` is in seconds, `bound` in steps. `smv` writes what the engine is
    asked as SMV text: to a file, or for several questions to numbered files in that folder. Every plan has been
    accepted by the checker, which does not depend on the engine.

    `second_opinion` names an engine that is asked everything that `engine` is asked, with as much time: if one finds a
    shorter plan than the other, or none where the other finds one, that is an EngineError, and a folder is left behind that
    reproduces it, with the `command` in it that put the question. Time the second engine takes is not that of the deadline.

    Raises UsageError for mistakes in the question and EngineError for an engine that is missing or lies.
    """
    began = time.monotonic()
    asked = Question(
        goals=() if goal is None else (goal,) if isinstance(goal, str) else tuple(goal),
        intentions=tuple(intentions),
        exit_forbidden=exit_forbidden,
        formula=formula,
        settings=dict(set or {}),
        maintenance=maintenance,
        lifted=tuple(lift),
        disabled=tuple(disable),
        lost=tuple(lose),
        ran=tuple(ran),
    )
    ask = _Engine(engine, began + deadline, progress, Path(smv) if smv is not None else None, not (asked.goals or exit_forbidden))
    second = None if second_opinion is None else _Second(ask, second_opinion, deadline, model, command)
    solve = second or ask
    if not 0 <= bound <= LONGEST_PLAN:
        raise UsageError([Mistake(f"the bound is {bound}", f"it counts steps: 0 is the least and {LONGEST_PLAN} the most")])
    if formula is not None and not asked.goals:
        raise UsageError([Mistake("a formula goes with a goal", "an intention has its own formula, in the scenario")])
    begin = start(model, asked)
    blank = Answer(
        model=model.name,
        model_hash=model.hash,
        question=asked,
        engine=engine,
        bound=bound,
        initial=model.system.named(begin.state),
        verdict="undecided",
    )
    try:
        with watched(ask.in_time):
            answer = _answered(model, begin, solve, blank)
    except Over:
        answer = replace(blank, reason="the deadline passed while the answer was being prepared", deadline=True)
    # What answers a question with goals is the first verdict; those after it only look for whom to blame.
    arguments = tuple(ask.arguments)[:1]
    if ask.several:
        arguments = tuple(f"{argument} ({count} of {ask.asked} questions)" for argument, count in ask.arguments.items())
    if second is not None:
        answer = replace(answer, second_opinion=second.opinion, warnings=answer.warnings + tuple(second.warnings))
    return replace(answer, arguments=arguments, engine_seconds=ask.seconds, total_seconds=time.monotonic() - began)


def _answered(model: Model, begin: reach.Start, solve: Solve, blank: Answer) -> Answer:
    asked, bound = blank.question, blank.bound
    if asked.goals:
        return reach.reach(pose(model, asked, bound), blank, begin, solve, _briefly)
    if asked.exit_forbidden:
        return reach.leave_forbidden(model, begin, bound, blank, solve, _briefly)
    chosen = active_intentions(model, asked, begin)
    blank = replace(blank, question=replace(asked, intentions=tuple(intention.name for intention in chosen)))
    if not chosen:
        blank = replace(blank, warnings=("no intention starts in the initial state; nothing is planned",))
    from smv_planner.planner import intend

    return intend.intend(model, chosen, intend.Levels(begin, solve, widened_system, bound, _briefly), blank)


def pose(model: Model, asked: Question, bound: int = DEFAULT_BOUND) -> Problem:
    """The problem that a question with goals puts to an engine.

    Raises UsageError with every mistake in the question.
    """
    if not asked.goals:
        raise UsageError([Mistake("there is no goal", 'say which state to reach, as in --goal "door.pos == opened"')])
    until = language.formula(model, asked.formula, source="--formula") if asked.formula else ALWAYS_TRUE
    goals = [Goal(language.predicate(model, text, source="--goal"), until) for text in asked.goals]
    return reach.pose(model, start(model, asked), goals, bound)


def start(model: Model, asked: Question) -> reach.Start:
    """Where a question begins: settings in place of initial values, lifted invariants left out."""
    _check(model, asked)
    state = tuple(asked.settings.get(v.name, v.initial) for v in model.variables)
    held = tuple(w for w in widened(model) if w.declared.name not in asked.lifted)
    return reach.Start(
        state=state,
        widened=held,
        lifted=frozenset(asked.lifted),
        maintenance=asked.maintenance,
        disabled=frozenset(asked.disabled),
        lost=frozenset(asked.lost),
        ran=asked.ran,
    )


def active_intentions(model: Model, asked: Question, begin: reach.Start) -> Sequence[Intention]:
    """The intentions that a question names, or else those whose start holds once the automatic steps that are due have come
    (Def. 6)."""
    if asked.intentions:
        known = {intention.name: intention for intention in model.intentions}
        _known(asked.intentions, known, "intention")
        return [known[name] for name in asked.intentions]
    settled = Steps(model.system, model.transitions).settle(begin.state)
    return [i for i in model.intentions if meaning(i.start, model.system.index)(settled)]


@lru_cache(maxsize=16)
def widened(model: Model) -> tuple[Widened, ...]:
    """The model's invariants, widened over automatic and effect transitions (Machines 2021, section 3)."""
    return widened_system(model.system)


@lru_cache(maxsize=64)
def widened_system(system: System) -> tuple[Widened, ...]:
    """A system's invariants widened; systems that are made from one share what is worked out."""
    return _widening(system.base or system)(system) if system.invariants else ()


@lru_cache(maxsize=16)
def _widening(base: System) -> Widening:
    from smv_planner.engines.sat import Predicates

    return Widening(base, Predicates(base.domains).satisfiable)


def _briefly(problem: Problem) -> Verdict:
    """What is asked for the causes of an impossible goal."""
    from smv_planner.engines.auto.briefly import briefly

    return briefly(problem)


def encoded(problem: Problem) -> Encoding:
    """The problem as SMV text, with the script that has NuSMV or nuXmv answer it, and the way back from its names."""
    from smv_planner.export.smv import encode

    return encode(problem)


@dataclass
class _Engine:
    """An engine as the planner sees it: a function from problems to verdicts. Keeps the time, and writes what it asks.

    Raises UsageError if there is no engine of that name, EngineError if it cannot be used on this machine.
    """

    name: str
    ends: float
    progress: Callable[[str], None]
    smv: Path | None
    several: bool
    seconds: float = 0.0
    asked: int = 0
    arguments: dict[str, int] = field(default_factory=dict)
    """By which arguments it has answered, and how often, in the order of their first use."""

    def __post_init__(self) -> None:
        from smv_planner.engines import ENGINES, Limits

        _known([self.name], ENGINES, "engine")
        self._engine = ENGINES[self.name]
        self._limits = Limits
        self._asking = False
        missing = self._engine.available()
        if missing:
            raise EngineError(missing)

    def __call__(self, problem: Problem) -> Verdict:
        if self.smv is not None:
            self._write(problem, self.smv)
        began = time.monotonic()
        self._asking = True
        try:
            verdict = self._engine.ask(problem, self._limits(max(self.ends - began, 0.0), MEMORY, self.progress))
        finally:
            self._asking = False
            self.asked += 1
            self.seconds += time.monotonic() - began
        match verdict:
            case Reached() | NotWithin() | Unreachable():
                self.arguments[verdict.argument] = self.arguments.get(verdict.argument, 0) + 1
        return verdict

    def in_time(self) -> bool:
        """Whether there is time left; whoever looks while nothing is asked checks an answer, or looks for causes."""
        if not self._asking:
            self.progress("checking what was answered")
        return time.monotonic() <= self.ends

    def _write(self, problem: Problem, path: Path) -> None:
        try:
            if self.several:
                path.mkdir(parents=True, exist_ok=True)
                path = path / f"{self.asked:03d}.smv"
            path.write_text(encoded(problem).text, encoding="ascii")
        except OSError as error:
            raise UsageError([Mistake(f"cannot write the SMV text to '{path}': {error.strerror}")]) from error


class _Second:
    """An engine together with a second one, which is asked the same as the first; the verdict is that of the first.

    Raises EngineError when they differ, UsageError and EngineError as `_Engine` does.
    """

    def __init__(self, first: _Engine, name: str, deadline: float, model: Model, command: str | None) -> None:
        if name == first.name:
            raise UsageError([Mistake(f"the second opinion is that of '{name}' again", "name another engine than --engine")])
        self._first = first
        self._second = _Engine(name, 0.0, first.progress, None, first.several)
        self._left = deadline
        self._model = model
        self._command = command
        self.opinion = SecondOpinion(name, 0, 0)
        self.warnings: list[str] = []

    def __call__(self, problem: Problem) -> Verdict:
        verdict = self._first(problem)
        if isinstance(verdict, Undecided):
            return verdict
        began = time.monotonic()
        self._second.ends = began + self._left
        other = self._second(problem)
        spent = time.monotonic() - began
        self._left -= spent
        self._first.ends += spent
        from smv_planner.planner.second_opinion import Agrees, Differs, Says, Silent, compare

        one, two = Says(self._first.name, verdict), Says(self._second.name, other)
        number, agreed = self.opinion.asked, self.opinion.agreed
        match compare(one, two):
            case Agrees():
                agreed += 1
            case Silent(reason):
                self.warnings.append(f"no second opinion on question {number + 1}: {reason}")
            case Differs(reason):
                folder = self._keep(problem, reason, one, two)
                raise EngineError(f"the engines differ: {reason}; '{folder}' holds the question and both answers")
        self.opinion = SecondOpinion(self._second.name, number + 1, agreed)
        return verdict

    def _keep(self, problem: Problem, reason: str, one: Says, two: Says) -> Path:
        about = {"commands": [*filter(None, [self._command])], "question": self.opinion.asked + 1}
        return keep_difference(self._model, problem, one, two, reason, about)


def keep_difference(
    model: Model,
    problem: Problem,
    one: Says,
    two: Says,
    reason: str,
    about: Mapping[str, object] | None = None,
    within: str | None = None,
) -> Path:
    """Write what reproduces a difference between two engines into a new folder."""
    import tempfile

    from smv_planner.planner.second_opinion import report

    folder = Path(tempfile.mkdtemp(prefix="smv_planner-difference-", dir=within))
    encoding = encoded(problem)
    commands = list(about.get("commands", [])) if about else []  # type: ignore[call-overload]
    told = {
        "difference": reason,
        "model": {"name": model.name, "hash": model.hash},
        **(about or {}),
        "commands": [*commands, "NuSMV -source problem.cmd problem.smv"],
        **report(problem, one, two),
    }
    (folder / "problem.smv").write_text(encoding.text, encoding="ascii")
    (folder / "problem.cmd").write_text(encoding.script, encoding="ascii")
    (folder / "difference.json").write_text(json.dumps(told, indent=2) + "\n", encoding="ascii")
    return folder


def _check(model: Model, asked: Question) -> None:
    """Raises UsageError with every setting and lifted name that does not fit the model."""
    domains = model.system.domains
    unknown = [
        Mistake(f"unknown variable '{name}'", did_you_mean(name, domains)) for name in asked.settings if name not in domains
    ]
    outside = [
        Mistake(f"{value!r} is not a value of '{name}'", f"its domain is {domains[name]}")
        for name, value in asked.settings.items()
        if name in domains and value not in domains[name]
    ]
    if unknown or outside:
        raise UsageError(unknown + outside)
    _known(asked.lifted, [invariant.name for invariant in model.invariants], "invariant")
    _known(asked.disabled, [transition.name for transition in model.transitions], "transition")
    _known(asked.lost, [resource.name for resource in model.resources], "resource")
    _known(asked.ran, [operation.name for operation in model.operations], "operation")


def _known(names: Iterable[str], known: Iterable[str], what: str) -> None:
    known = list(known)
    there_are = "there is none" if not known else "there are " + ", ".join(f"'{name}'" for name in known[:8])
    unknown = [
        Mistake(f"there is no {what} '{name}'", did_you_mean(name, known) or there_are) for name in names if name not in known
    ]
    if unknown:
        raise UsageError(unknown)
