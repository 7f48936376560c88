"""The engine that is asked when none is named: quick arguments first, each exact or silent.

Relaxed reachability proves most impossible goals impossible at once. Breadth-first search on packed states finds a
shortest plan or runs out of states. Where there are too many, bounded model checking looks for a shortest plan from
where the search stopped, in turns with a search for an inductive proof that there is none.

Most plans are found by the first states that are looked at. What else there is, is imported where it is needed.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from typing import TYPE_CHECKING

from smv_planner.clock import Over, watched
from smv_planner.engines.auto.grounding import Ground
from smv_planner.engines.auto.parts import Part, merged
from smv_planner.engines.auto.search import MEMO, Ended, Paused, Search, Tables
from smv_planner.engines.auto.session import Session, session_of
from smv_planner.lazy import dataclass, replace
from smv_planner.problem import (
    Exhausted,
    Inductive,
    NotWithin,
    Problem,
    Projected,
    Proof,
    Reached,
    Undecided,
    Unreachable,
    Verdict,
)

if TYPE_CHECKING:
    from smv_planner.engines import Limits
    from smv_planner.engines.auto.symmetry import Fold

FEW = 2_000
"""How many states are looked at before relaxed reachability is tried: most plans are found sooner than it is set up."""

SOME = 30
"""The same where earlier questions have taken more."""

BUDGET = 75_000
"""How many states the search looks at before others get their turn."""

FOLDED = 20
"""How many times as many states are looked at where each stands for many that differ by swaps of interchangeable things."""

STATES_PER_PAIR = 4
"""How many states are looked at in the time in which relaxed reachability is set up for one action and one invariant."""

GLANCED = 2000
"""How many states are looked at where quick estimates say how far away the goals are."""

GUIDED = 8_000
"""The same where estimates are better, and take longer to set up."""

STRIDE = 2
"""By how many steps at least the next look reaches farther. The first hit is a shortest plan in any case."""

QUICK = 4_000
"""Up to how many facts times actions pairwise mutexes take a few milliseconds. Else as many states are looked at first."""

ALIKE = 6
"""From how many interchangeable things on it stands for many."""

LASTING = 3
"""How many times as long such a search goes on before pairwise mutexes are looked at."""

BYTES_PER_NODE = 250

WORK_PER_STATE = 1_700
"""About how much work of a solver takes as long as the kernel takes to check one state of a proof by exhaustion."""

MANY = 1000
"""From so many states on, a proof by clauses is worth looking for."""

EXTRA = 8_500_000
"""With how much work at least a proof is looked for when it is clear that no plan is within the bound: about a second."""

BYTES_PER_CLAUSE = 200

NEAR = "breadth-first search looked at every shorter plan, but for what is too far from the goal for one"
SEARCHED = "breadth-first search looked at every shorter plan"
ALL_SEEN = "breadth-first search looked at every state that can follow"
FOLDING = "breadth-first search looked at every shorter plan, up to swaps of what is interchangeable"
RELAXED = "relaxed reachability: out of reach even if no value were ever lost"
APART = "pairwise mutexes: every way to meet the goals needs values that never hold together"
PRESERVED = "property-directed reachability found conditions that every step preserves"
"""By which argument an answer was found, in words."""

OnTime = Callable[[str], bool]
"""Says how far a search is, and is told whether there is time left."""


@dataclass(frozen=True, slots=True)
class Means:
    """What may be spent on a question: states to look at, bytes, and time; and what comes before SAT, if not `by_states`."""

    states: int
    memory: int
    on_time: OnTime
    search: Callable[[], int] | None = None


def prepare() -> None:
    """Import what hard questions need: who plans for a station that runs shall not wait for it in between."""
    from smv_planner.engines.auto import bounded, frames, guide, mutexes, relaxed, symmetry  # noqa: F401


def ask(problem: Problem, limits: Limits, budget: int = BUDGET, search: Callable[[], int] | None = None) -> Verdict:
    """Answer a question; `budget` is how many states the search may look at before the SAT solver takes over.

    With `search` nothing comes before SAT; it says how many steps a plan has at least.
    """
    ends = time.monotonic() + limits.deadline

    def on_time(text: str) -> bool:
        limits.progress(text)
        return time.monotonic() <= ends

    means = Means(min(budget, limits.memory // BYTES_PER_NODE), limits.memory, on_time, search)
    try:
        with watched(lambda: time.monotonic() <= ends):
            verdict = answer(problem, session_of(problem.system), means)
    except Over:
        return Undecided("deadline reached while a way to an answer was being prepared", deadline=True)
    if isinstance(verdict, Late):
        return Undecided(f"{verdict.limit} reached, no plan of fewer than {verdict.depth} steps", deadline=verdict.deadline)
    return verdict


@dataclass(frozen=True, slots=True)
class Late:
    """A limit was reached before an answer: what is known is that there is no plan of fewer than `depth` steps."""

    depth: int
    deadline: bool = True

    @property
    def limit(self) -> str:
        return "deadline" if self.deadline else "memory limit"


Found = Reached | NotWithin | Unreachable | Late


def answer(problem: Problem, warm: Session, means: Means) -> Found:
    ground, tables = warm.variant(problem.allowed)
    if not tables.allows(ground.packing.pack(problem.initial)):
        return Unreachable(Exhausted(frozenset()))
    if means.search is not None:
        return by_clauses(problem, warm, ground, means.search(), means)
    parts = warm.parts(ground).apart(problem)
    if parts:
        return by_parts(problem, warm, parts, means)
    found = by_states(problem, warm, ground, tables, means)
    return by_clauses(problem, warm, ground, found, means) if isinstance(found, int) else found


def by_parts(problem: Problem, warm: Session, parts: Iterable[tuple[Part, Problem]], means: Means) -> Found:
    """Plan each part by itself. What one cannot reach the whole cannot either."""
    plans: list[tuple[Part, Reached]] = []
    unfinished: NotWithin | Late | None = None
    depth = 0
    for part, share in parts:
        match answer(share, warm.of_part(part), means):
            case Reached(path) as plan:
                plans.append((part, plan))
                depth += len(path)
            case Unreachable(proof, argument):
                return Unreachable(_of_the_whole(part, proof), argument)
            case Late(least, deadline):
                unfinished = unfinished if isinstance(unfinished, NotWithin) else Late(depth + least, deadline)
                if deadline:
                    return unfinished
            case NotWithin() as found:  # for certain: only a proof says more
                unfinished = found
    if unfinished is not None:
        return unfinished
    arguments = " and ".join(dict.fromkeys(plan.argument for _, plan in plans))
    if depth > problem.bound:
        return NotWithin(problem.bound, f"{len(plans)} independent parts, each: {arguments}")
    argument = arguments if len(plans) == 1 else f"{len(plans)} independent parts, in each {arguments}"
    return replace(merged(problem, plans), argument=argument)


def _of_the_whole(part: Part, proof: Proof) -> Projected:
    names = frozenset(variable.name for variable in part.system.variables)
    match proof:
        case Projected(fewer, inner):
            return Projected(fewer, inner)
        case _:
            return Projected(names, proof)


class Look:
    """A search for a plan that goes on where it has paused, as long as that can lead to one within the bound."""

    def __init__(self, search: Search, means: Means) -> None:
        self._search, self._means = search, means
        self.found: Reached | Ended | Paused | Late = Paused(0, 0)
        self.least = 0
        """How many steps are known to be needed."""
        self._searching = search.explore()

    def goes_on(self, states: int) -> bool:
        """Whether so many states would be looked at."""
        bound, found = self._search.problem.bound, self.found
        return isinstance(found, Paused) and found.number <= states and max(found.depth, self.least) <= bound

    def on(self, states: int) -> None:
        """Go on until something is found, or more than so many states were looked at."""
        if self.goes_on(states):
            self.found = _search(self._searching, self._search.problem, states, self._means)

    def anew(self, fold: Fold | None = None) -> None:
        """Begin again; with one of all states that fold into the same."""
        if isinstance(self.found, Paused):
            self.least = max(self.least, self.found.depth)
        self.found = Paused(0, 0)
        self._searching = self._search.explore(fold)


def by_states(problem: Problem, warm: Session, ground: Ground, tables: Tables, means: Means) -> Found | int:
    """Search states; when they are not few, try relaxed reachability, and leave out what does not matter or is too far.

    A number says how many steps are at least needed. Whether earlier questions were hard decides what is tried first, and
    not which plan is found.
    """
    hard, states = warm.hard(ground), means.states
    tables.trim(min(MEMO, means.memory // BYTES_PER_NODE // 4))
    search = Search(tables, problem)
    look = Look(search, means)
    look.on(min(SOME if hard else FEW, states))
    if isinstance(look.found, Reached):
        return replace(look.found, argument=SEARCHED)
    from smv_planner.engines.auto.patterns import NEVER
    from smv_planner.engines.auto.relaxed import out_of_reach

    if isinstance(look.found, Paused | Ended):
        warm.was_hard(ground)
        part = warm.parts(ground).needed(problem)
        if part:
            return by_parts(problem, warm, [part], means)

    @cache
    def folding() -> Fold | None:
        return warm.symmetries(ground).fold(problem)

    @cache
    def patience() -> int:
        work = len(ground.actions) * len(ground.clauses) * STATES_PER_PAIR
        return min(FEW if _many_alike(folding()) else max(FEW, work), states)

    if not hard and look.goes_on(states):
        look.on(patience())
    if isinstance(look.found, Paused | Ended):
        proof = out_of_reach(warm.abstraction(ground), ground, problem)
        if proof:
            return Unreachable(proof, RELAXED)
    effort = len(ground.actions) * ground.packing.facts
    if isinstance(look.found, Paused) and effort <= QUICK:
        apart = _apart(look.found, problem, warm, ground, means.on_time, 1)
        if apart:
            return apart
    if look.goes_on(states):
        guided = _guided(search, warm, ground, lambda: not _many_alike(folding()), means)
        if not isinstance(guided, int):
            return guided
        if guided < NEVER:  # that there is no way at all remains to be proved
            look.least = max(look.least, guided)
    if look.goes_on(states):
        look.on(patience())
    fold = folding() if look.goes_on(states) else None
    alike = 1 if fold is None else FOLDED
    if fold is not None:
        look.anew(fold)
        if _many_alike(fold):
            states = min(states * FOLDED, means.memory // BYTES_PER_NODE)
            effort *= LASTING
    look.on(min(effort, states))
    if isinstance(look.found, Ended) or effort > QUICK:
        apart = _apart(look.found, problem, warm, ground, means.on_time, alike)
        if apart:
            return apart
    look.on(states)
    if isinstance(look.found, Ended):
        short = _short_proof(look.found, ground, problem, means.on_time, alike)
        if short is not None:
            return Unreachable(short, PRESERVED)
        if fold is not None:
            look.anew()
            look.on(means.memory // BYTES_PER_NODE)
        if isinstance(look.found, Ended):
            return Unreachable(look.found.proof(), ALL_SEEN)
    match look.found:
        case Reached():
            return replace(look.found, argument=SEARCHED if fold is None else FOLDING)
        case Paused(depth):
            return max(depth, look.least)
        case Late(depth, deadline=False):  # SAT needs little memory
            tables.trim(0)
            return max(depth, look.least)
    return look.found


def _many_alike(fold: Fold | None) -> bool:
    return fold is not None and fold.alike >= ALIKE


def _guided(search: Search, warm: Session, ground: Ground, wide: Callable[[], bool], means: Means) -> Reached | Late | int:
    """Search among states from which the goals may be near enough, if few are. A number says how many steps are needed.

    Where a quick estimate was not enough, a `wide` one is asked at once the next time.
    """
    problem, guide = search.problem, warm.guide(ground)
    question = problem.goals, search.usable
    least = 0
    for widely, left in ((False, GLANCED), (True, GUIDED)):
        if not wide() if widely else guide.far(question):
            continue
        estimate = guide.estimate(problem, widely)
        if estimate is None:
            return 0
        remaining = search.remaining(estimate)
        least = limit = max(least, estimate(ground.packing.pack(problem.initial), -1))
        while left > 0 and least <= problem.bound:
            match _search(search.explore(within=(remaining, limit)), problem, left, means):
                case Reached() as found:
                    return replace(found, argument=NEAR)
                case Paused(depth, number):
                    if number <= left:
                        least, limit = depth, max(depth, limit + STRIDE)
                    left -= number
                case Late(_, deadline):
                    return Late(least) if deadline else least
        if least > problem.bound:
            break
        guide.was_far(question)
    return least


def _apart(
    found: Reached | Ended | Paused | Late, problem: Problem, warm: Session, ground: Ground, on_time: OnTime, patience: int
) -> Unreachable | None:
    """A proof by pairs of facts, unless there are too many of them, or fewer states than are soon checked."""
    from smv_planner.engines.auto.mutexes import FACTS, kept_apart

    few = isinstance(found, Ended) and found.number * patience <= MANY
    if few or not isinstance(found, Ended | Paused) or ground.packing.facts > FACTS:
        return None
    try:
        proof = kept_apart(warm.mutexes(ground), ground, problem, lambda: on_time("looking at pairs of values"))
    except Over:
        if isinstance(found, Ended):  # there is a proof already
            return None
        raise
    return Unreachable(proof, APART) if proof else None


def _search(
    searching: Iterator[Reached | Ended | Paused], problem: Problem, states: int, means: Means
) -> Reached | Ended | Paused | Late:
    """Search to the end, or until more than so many states were looked at, or the bound, the time or the memory is passed.

    An entry of a memo takes about as much memory as a state.
    """
    found: Reached | Ended | Paused = Paused(0, 0)
    for found in searching:
        if not isinstance(found, Paused) or found.number > states or found.depth > problem.bound:
            break
        if (found.number + found.memos) * BYTES_PER_NODE > means.memory:
            return Late(found.depth, deadline=False)
        if not means.on_time(f"{found.number} states, {found.depth} steps deep"):
            return Late(found.depth)
    return found


def _short_proof(ended: Ended, ground: Ground, problem: Problem, on_time: OnTime, patience: int) -> Inductive | None:
    """A proof by clauses, if one is found with less work than the kernel has with a proof by states."""
    from smv_planner.engines.auto.frames import Frames

    if ended.number * patience <= MANY:
        return None
    try:
        frames = Frames(ground, problem)
        for found in frames.proof():
            if isinstance(found, Inductive):
                return found
            on_time_still = on_time(f"all {ended.number} states seen, looking for a short proof")
            if frames.work() > ended.number * WORK_PER_STATE * patience or not on_time_still:
                return None
    except Over:  # there is a proof already
        pass
    return None


def by_clauses(problem: Problem, warm: Session, ground: Ground, depth: int, means: Means) -> Found:
    """A shortest plan of `depth` or more steps, or a proof that there is none, whichever is found first.

    The two take turns, so that each has about as much work as the other; a proof gets a little more, for it says more than
    that no plan is within the bound. Work is counted and not timed: a slow machine answers the same.
    """
    from smv_planner.engines.auto.frames import Frames

    by = "SAT" if not depth else "breadth-first search, then SAT," if depth <= problem.bound else "breadth-first search"
    not_within = NotWithin(problem.bound, f"{by} ruled out every plan within the bound")
    unrolled, frames = warm.unrolled(), Frames(ground, problem)
    searching, proving = unrolled.run(problem, ground, depth), frames.proof()
    before = unrolled.work()
    hopeful = True  # that there may be a proof
    while True:
        searched, proved = unrolled.work() - before, frames.work()
        if depth > problem.bound and not (hopeful and proved < 2 * searched + EXTRA):
            return not_within
        try:
            if hopeful and (depth > problem.bound or proved < searched):
                proof = next(proving, None)
                if isinstance(proof, Inductive):
                    return Unreachable(proof, PRESERVED)
                hopeful = proof is not None
            else:
                found = next(searching)
                if isinstance(found, Reached):
                    return replace(found, argument=f"{by} ruled out every shorter plan")
                depth = found
        except Over:
            return Late(depth) if depth <= problem.bound else not_within
        in_memory = unrolled.clauses.solver.clauses() * BYTES_PER_CLAUSE <= means.memory
        if not means.on_time(f"no plan of fewer than {depth} steps") or not in_memory:
            return Late(depth, deadline=in_memory) if depth <= problem.bound else not_within
