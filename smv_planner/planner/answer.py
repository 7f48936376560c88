"""What a question about a model is answered with, and its JSON form (LANGUAGE: "What the one-shot planner answers")."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from smv_planner.lazy import dataclass, field, fields
from smv_planner.model.domains import Value

VerdictName = Literal["reached", "not_within", "unreachable", "undecided", "invariant_violated"]
ProofKind = Literal["exhausted", "relaxed", "pairs", "inductive"]


@dataclass(frozen=True, slots=True)
class Question:
    """As the user put it: texts, not resolved expressions. Values of `settings` replace initial values."""

    goals: tuple[str, ...] = ()
    intentions: tuple[str, ...] = ()
    exit_forbidden: bool = False
    formula: str | None = None
    settings: Mapping[str, Value] = field(default_factory=dict)
    maintenance: bool = False
    lifted: tuple[str, ...] = ()
    disabled: tuple[str, ...] = ()
    lost: tuple[str, ...] = ()
    ran: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class PlanStep:
    """One step. `after` are the indices of the steps it directly waits for; `changes` what it gives a new value."""

    index: int
    transition: str
    kind: str
    after: tuple[int, ...]
    changes: Mapping[str, Value]
    stage: int = 0
    operation: str | None = None
    instruction: str | None = None


@dataclass(frozen=True, slots=True)
class PlannedOperation:
    """An operation of the operation plan; `after` are the indices of the operations it directly waits for.

    `changes` is what its start gives a value (`on_start`), before the first step of its stage.
    """

    index: int
    operation: str
    outcome: str | None
    after: tuple[int, ...]
    changes: Mapping[str, Value] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Stage:
    """Operations that start together, and the steps `first` up to but not including `last` that carry them out."""

    index: int
    operations: tuple[int, ...]
    first: int
    last: int


@dataclass(frozen=True, slots=True)
class Violation:
    """An invariant that is broken now, or that the system may slide into breaking by the transitions in `slide`."""

    invariant: str
    now: bool
    slide: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Conflict:
    """What is impossible together, of which nothing can be left out: goals, transitions that are `disabled`, resources that
    are `lost`, and invariants. Without any one of them there is a plan, or a brief look does not prove that there is none."""

    goals: tuple[str, ...]
    disabled: tuple[str, ...]
    lost: tuple[str, ...]
    invariants: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class SecondOpinion:
    """What another engine thought of the `asked` questions that were put to both: on `agreed` of them the same."""

    engine: str
    asked: int
    agreed: int


@dataclass(frozen=True, slots=True)
class Answer:
    """A verdict with all that belongs to it. `steps` is one valid total order; only a checked plan has steps.

    `culprits` are goals, intentions or operations that cannot be reached (together); `disabled` are the operations that
    the plan does without, because no transition plan could complete them. `conflict` is why there is no plan, if that was
    easy to find out.
    `arguments` are the engine's own words on how it came to its verdicts, each once; empty if it was not asked.
    `engine_seconds` and `total_seconds` are filled in by whoever holds the clock.
    """

    model: str
    model_hash: str
    question: Question
    engine: str
    bound: int
    initial: Mapping[str, Value]
    verdict: VerdictName
    checked: bool = False
    reason: str | None = None
    deadline: bool = False
    proof: ProofKind | None = None
    steps: tuple[PlanStep, ...] = ()
    stages: tuple[Stage, ...] = ()
    operations: tuple[PlannedOperation, ...] = ()
    culprits: tuple[tuple[str, ...], ...] = ()
    disabled: tuple[str, ...] = ()
    conflict: Conflict | None = None
    final: Mapping[str, Value] = field(default_factory=dict)
    violations: tuple[Violation, ...] = ()
    warnings: tuple[str, ...] = ()
    arguments: tuple[str, ...] = ()
    second_opinion: SecondOpinion | None = None
    engine_seconds: float = 0.0
    total_seconds: float = 0.0

    @property
    def reached(self) -> bool:
        return self.verdict == "reached"

    @property
    def length(self) -> int | None:
        """The number of steps; None unless reached."""
        return len(self.steps) if self.reached else None

    def to_json(self) -> dict[str, object]:
        """The fixed members of the answer format 1, ready for `json.dumps`."""
        question = self.question
        return {
            "format": 1,
            "model": {"name": self.model, "hash": self.model_hash},
            "question": {
                "goals": list(question.goals),
                "intentions": list(question.intentions),
                "exit_forbidden": question.exit_forbidden,
                "formula": question.formula,
                "set": dict(question.settings),
                "maintenance": question.maintenance,
                "lifted": list(question.lifted),
                "disabled": list(question.disabled),
                "lost": list(question.lost),
                "ran": list(question.ran),
            },
            "verdict": self.verdict,
            "length": self.length,
            "bound": self.bound,
            "engine": self.engine,
            "argument": "; ".join(self.arguments) or None,
            "second_opinion": _entries(self.second_opinion),
            "checked": self.checked,
            "reason": self.reason,
            "proof": {"kind": self.proof, "checked": True} if self.proof else None,
            "initial": dict(self.initial),
            "final": dict(self.final),
            "steps": [
                {
                    "index": step.index,
                    "stage": step.stage,
                    "operation": step.operation,
                    "transition": step.transition,
                    "kind": step.kind,
                    "after": list(step.after),
                    "changes": dict(step.changes),
                    **({"instruction": step.instruction} if step.instruction else {}),
                }
                for step in self.steps
            ],
            "stages": [
                {
                    "index": stage.index,
                    "operations": list(stage.operations),
                    "length": stage.last - stage.first,
                    "steps": [stage.first, stage.last],
                }
                for stage in self.stages
            ],
            "operations": [
                {
                    "index": o.index,
                    "operation": o.operation,
                    "outcome": o.outcome,
                    "after": list(o.after),
                    "changes": dict(o.changes),
                }
                for o in self.operations
            ],
            "conflict": _entries(self.conflict),
            "culprits": [list(together) for together in self.culprits],
            "disabled": list(self.disabled),
            "violations": [{"invariant": v.invariant, "now": v.now, "slide": list(v.slide)} for v in self.violations],
            "warnings": list(self.warnings),
            "seconds": {"total": round(self.total_seconds, 4), "engine": round(self.engine_seconds, 4)},
        }


def _entries(value: Conflict | SecondOpinion | None) -> dict[str, object] | None:
    return {each.name: getattr(value, each.name) for each in fields(value)} if value else None
