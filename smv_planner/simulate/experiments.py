"""Table 1 of Machines 2021 again: the error situations E1 to E9 played, beside what the paper reports.

Each is a case of the scenario, `e1` to `e9`. Planning actions are those of the recorded decisions that led out of the error;
the time of an action is what the planners took for it, with everything that is checked. What is planned anyway is not
counted, but a transition plan that carries a new operation plan out is counted with that.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator, Mapping, Sequence

from smv_planner.lazy import dataclass
from smv_planner.model.model import Model
from smv_planner.runner.decision import Action
from smv_planner.runner.recovery import Planners
from smv_planner.simulate.planning import station
from smv_planner.simulate.play import Play
from smv_planner.simulate.script import Case, chosen

Clock = Callable[[], float]


@dataclass(frozen=True, slots=True)
class Published:
    """A row of Table 1: planning actions with their milliseconds."""

    experiment: str
    description: str
    actions: tuple[tuple[str, int], ...]
    operator: str = "None"

    @property
    def milliseconds(self) -> int:
        return sum(time for _, time in self.actions)


TABLE_1 = (
    Published("E1", "Bolt state changed from tightened to not tightened.", (("OP", 223),)),
    Published("E2", "Tighten oil filter prematurely.", (("TP w/MT", 181),), "Remove oil filter."),
    Published("E3", "Mechanical failure of tool change mechanism 1", (("TP w/ETO", 787), ("OP w/DO", 245))),
    Published(
        "E4",
        "Mechanical failure of tool change mechanism 2",
        (("TP w/ETO", 747), ("OP w/DO", 498), ("TP w/MT", 579)),
        "Manually remove tool and place in hanging position.",
    ),
    Published("E5", "Disconnect robot situation 1", (("TP w/RTO", 926), ("OP w/DO", 661))),
    Published(
        "E6",
        "Disconnect robot situation 2",
        (("TP w/RTO", 1071), ("OP w/DO", 512), ("TP w/MT", 632)),
        "Move disconnected robot into home state.",
    ),
    Published(
        "E7",
        "Disconnect robot situation 3",
        (("TP w/RTO", 855), ("OP w/DO", 637), ("TP w/MT", 1343)),
        "Move disconnected robot into home state and place tool in hanging position.",
    ),
    Published("E8", "Fail to identify tool location using 3D camera.", (("TP", 642),)),
    Published("E9", "Fail to tighten bolt, expected torque not reached.", (("TP", 895),)),
)


@dataclass(frozen=True, slots=True)
class Taken:
    """A planning action of ours: all of that name that a recovery needed, `times` of them, with their seconds in sum."""

    name: str
    times: int
    seconds: float


@dataclass(frozen=True, slots=True)
class Row:
    """An experiment of ours: `cold` is when its questions were put for the first time, `warm` when they were put again."""

    published: Published
    cold: tuple[Taken, ...]
    warm: tuple[Taken, ...]
    operator: tuple[str, ...]
    virtual: float
    differences: tuple[str, ...]

    @property
    def as_published(self) -> bool:
        """Whether the planning actions are those of the paper and the case came out as it declares."""
        names = tuple(name for name, _ in self.published.actions)
        return not self.differences and tuple(taken.name for taken in self.warm) == names

    def to_json(self) -> dict[str, object]:
        return {
            "experiment": self.published.experiment,
            "description": self.published.description,
            "actions": [
                {"name": warm.name, "times": warm.times, "cold_ms": _ms(cold.seconds), "ms": _ms(warm.seconds)}
                for cold, warm in zip(self.cold, self.warm, strict=True)
            ],
            "ms": _ms(total(self.warm)),
            "cold_ms": _ms(total(self.cold)),
            "operator": list(self.operator),
            "virtual_seconds": round(self.virtual, 3),
            "paper": {
                "actions": [{"name": name, "ms": time} for name, time in self.published.actions],
                "ms": self.published.milliseconds,
                "operator": self.published.operator,
            },
            "as_published": self.as_published,
            "differences": list(self.differences),
        }


def experiments(cases: Mapping[str, tuple[Model, Case]], planners: Planners, again: bool = True, seed: int = 0) -> Iterator[Row]:
    """The rows of Table 1, one after the other. `planners` need a clock. Raises UsageError if a case is missing.

    With `again`, each is played twice: the second time the engine has seen the model and these questions' systems, as that of a
    daemon that has been at work for a while.
    """
    for published in TABLE_1:
        model, case = chosen(cases, published.experiment.lower())
        first = Play(station(model), case, planners, seed)
        differences = first.run()
        last = first
        if again:
            gc.collect()  # what the first time has left behind must not be paid for in the second
            last = Play(station(model), case, planners, seed)
            differences += last.run()
        yield Row(
            published,
            taken(first.record.decisions),
            taken(last.record.decisions),
            tuple(last.record.operator),
            last.world.at,
            tuple(dict.fromkeys(differences)),
        )


def taken(decisions: Sequence[Sequence[Action]]) -> tuple[Taken, ...]:
    """The actions of all decisions that were part of a recovery, by name in the order of their first times."""
    found: dict[str, Taken] = {}
    for actions in decisions:
        if all(action.ordinary for action in actions):
            continue
        name = ""
        for action in actions:
            follows = action.ordinary and name.startswith("OP")  # the transition plan that carries it out
            name = name if follows else action.name
            known = found.get(name, Taken(name, 0, 0.0))
            found[name] = Taken(name, known.times + (not follows), known.seconds + action.seconds)
    return tuple(found.values())


def total(actions: Sequence[Taken]) -> float:
    return sum(action.seconds for action in actions)


def _ms(seconds: float) -> float:
    return round(1000 * seconds, 1)
