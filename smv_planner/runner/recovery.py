"""How plans are made, and how errors are recovered from (Machines 2021, sections 4.2 to 4.6).

`recover` reads as the paper does: leave forbidden states first; else reach what the executing operations promised (TP);
else find other operations without those that cannot be completed (OP w/DO); else ask the operator for help (TP w/MT).
Whatever a plan is for, it is a `CheckedPlan` before it leaves this module.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import pairwise

from smv_planner.check import CheckedPlan, check_plan
from smv_planner.lazy import dataclass, replace
from smv_planner.model.domains import Bool, Value
from smv_planner.model.expressions import FALSE, TRUE, Const, Var, conjunction, meaning
from smv_planner.model.ltl import (
    ALWAYS_FALSE,
    ALWAYS_TRUE,
    Atom,
    Either,
    Formula,
    Until,
    all_of,
    holds,
    over_atoms,
    parts,
    progressed,
)
from smv_planner.model.model import Intention, Model
from smv_planner.model.semantics import fire
from smv_planner.model.system import Assignment, Kind, State, System, Transition, Variable, VariableKind
from smv_planner.planner.culprits import goals_to_blame
from smv_planner.planner.decide import NoPlan, Solve, decide
from smv_planner.planner.deorder import disjoint, proposals
from smv_planner.planner.operations import Task, abstracted, footprints, operation_state, operation_system, tasks
from smv_planner.planner.reach import Start, violations
from smv_planner.planner.sequences import OperationPlan, constraints, in_order, manual_plan
from smv_planner.planner.stage import Execution, start
from smv_planner.problem import Goal, Problem, Reached
from smv_planner.runner.decision import Action, Course, Decision, Following, Purpose, Request, Wanted
from smv_planner.runner.posed import Widen, posed


@dataclass(frozen=True, slots=True)
class Planners:
    """What planning needs from outside: an engine, the widening of invariants, the longest plan, a clock for the record."""

    solve: Solve
    widen: Widen
    bound: int = 100
    clock: Callable[[], float] = lambda: 0.0


def recover(model: Model, request: Request, planners: Planners) -> Decision:
    """Decide how to go on. Raises EngineError if an engine answers what the checker refuses."""
    recovery = _Recovery(model, request, planners)
    return recovery.recheck() if request.recheck else recovery.decide()


class _Recovery:
    """One decision in the making: what was tried, and what turned out to be impossible."""

    def __init__(self, model: Model, request: Request, planners: Planners) -> None:
        self.model, self.request, self.planners = model, request, planners
        self.actions: list[Action] = []
        self.failed: dict[str, str] = {}
        self.given_up: dict[str, str] = {}

    def decide(self) -> Decision:
        request = self.request
        if violations(self.model.system, request.state, self.planners.widen(self.model.system)):
            return self.leave_forbidden()
        following, executing, course = request.following, request.executing, request.course
        if following and following.purpose is Purpose.MAINTENANCE and request.given_up and not request.wanted:
            kept = self.without_help(executing) if request.cause.ordinary else None
            kept = kept or self.still_reaches(following, executing)
            if kept:
                return self.going_on(executing, course, kept)
        if not request.wanted:
            if not request.given_up:
                return self.going_on((), None, None)
            # What executes was to be completed with the operator's help, and that plan does not hold any more.
            self.failed |= {execution.task.name: "cannot be completed as it was planned" for execution in executing}
            return self.ask_for_help()
        if course is not None and not self.leads_on(course, executing):
            course = None
        wanted = request.wanted
        while True:
            if course is None:
                planned = self.plan_operations(wanted, executing)
                if isinstance(planned, Decision):
                    return planned
                if isinstance(planned, frozenset):  # the intentions that cannot be reached
                    wanted = tuple(w for w in wanted if w.intention not in planned)
                    if wanted:
                        continue
                    return self.ask_for_help()
                course, executing = planned
            carried = self.carry_out(course, executing)
            if isinstance(carried, Decision):
                return carried
            executing = tuple(e for e in executing if e.task.name not in self.failed)
            course = None

    def without_help(self, executing: Sequence[Execution]) -> Following | None:
        """A plan for operations that were in error, if they have become possible without any maintenance."""
        result = decide(self.stage_problem(self.request.state, executing), self.planners.solve)
        return Following(result, operations=tuple(executing)) if isinstance(result, CheckedPlan) else None

    # --- forward simulation ---------------------------------------------------------------------------------

    def leads_on(self, course: Course, executing: Sequence[Execution]) -> bool:
        """Whether the rest of an operation plan still reaches the goals, if operations do what they promise."""
        system = operation_system(self.model)
        states = [operation_state(self.model, self.request.state)]
        for execution in executing:
            states.append(_with(system, states[-1], execution.post))
        for at, task in enumerate(course.plan.tasks):
            if at in course.begun:
                continue
            if task.name in self.failed or task.name in self.request.failed:
                return False
            after = fire(system, system.transition[task.name], states[-1])
            if not after:
                return False
            states.append(after[0])
        return all(holds(wanted.owed, states, system.index) for wanted in self.request.wanted)

    def still_reaches(self, following: Following, executing: Sequence[Execution]) -> Following | None:
        """A plan's remaining steps as a plan from the present state, if they are one.

        Effects that came early and commands that were given already count as done.
        """
        help_wanted = following.purpose is not Purpose.OPERATIONS
        problem = self.stage_problem(self.request.state, executing, maintenance=help_wanted, lifted=following.lifted)
        trace = _replayed(problem, following)
        if trace is None:
            return None
        checked = check_plan(problem, trace, proposals(problem, trace))
        if not isinstance(checked, CheckedPlan):
            return None
        return Following(checked, following.purpose, lifted=following.lifted, operations=tuple(executing))

    def going_on(self, executing: Sequence[Execution], course: Course | None, following: Following | None) -> Decision:
        return Decision(
            actions=tuple(self.actions),
            executing=tuple(executing),
            course=course,
            following=following,
            failed=self.failed,
            given_up=self.given_up,
        )

    # --- operations -----------------------------------------------------------------------------------------

    def plan_operations(
        self, wanted: tuple[Wanted, ...], executing: tuple[Execution, ...]
    ) -> tuple[Course, tuple[Execution, ...]] | frozenset[str] | Decision:
        """A new operation plan with those operations that go on; or the intentions to blame that there is none."""
        if not wanted:
            return Course(OperationPlan((), ())), ()
        for one in wanted:
            sequence = intention_of(self.model, one).sequence
            if sequence and sequence.manual:
                return self.by_hand(one, manual_plan(self.model, sequence, self.request.ran), executing)
        problem = self.operations_problem(wanted, executing)
        by_name = {task.name: task for task in tasks(self.model)}
        variables = {name + end: used for name, used in footprints(self.model).items() for end in ("", GOING_ON)}
        began = self.planners.clock()
        result = decide(problem, self.planners.solve, lambda problem, trace: disjoint(problem, trace, variables))
        name = "OP w/DO" if self.failed or self.request.failed else "OP"
        self.note(name, result, ", ".join(w.intention for w in wanted), began)
        if isinstance(result, NoPlan):
            if not result.decided:
                return self.undecided(result)
            sets = goals_to_blame(problem, result, self.planners.solve)
            if isinstance(sets, NoPlan):
                return self.undecided(sets)
            per_goal = [w.intention for w in wanted for _ in _goals(self.model, w)]
            blamed = frozenset(per_goal[at] for at in sets[0])
            self.given_up |= dict.fromkeys(blamed, result.reason)
            return blamed
        plan = OperationPlan(tuple(by_name[name.removesuffix(GOING_ON)] for name in result.trace.path), result.after)
        return self.continued(Course(plan), executing)

    def by_hand(
        self, wanted: Wanted, plan: OperationPlan, executing: tuple[Execution, ...]
    ) -> tuple[Course, tuple[Execution, ...]] | frozenset[str]:
        """A manual sequence takes the place of operation planning, and goes on after what has run of it."""
        in_error = [task.name for task in plan.tasks if task.name in self.failed or task.name in self.request.failed]
        if in_error or not plan.tasks:
            why = f"'{in_error[0]}' cannot be completed" if in_error else "it ends without reaching its goal"
            self.given_up[wanted.intention] = f"its manual sequence stops: {why}"
            return frozenset([wanted.intention])
        return self.continued(Course(plan), executing)

    def continued(self, course: Course, executing: Iterable[Execution]) -> tuple[Course, tuple[Execution, ...]]:
        """A new operation plan with the operations that go on in it; what has to wait for others goes back to initial."""
        running = {execution.task.operation.name: execution for execution in executing}
        going_on, begun = [], set()
        for at in course.ready():
            execution = running.pop(course.plan.tasks[at].operation.name, None)
            if execution:
                going_on.append(replace(execution, task=course.plan.tasks[at]))
                begun.add(at)
        return replace(course, begun=frozenset(begun)), tuple(going_on)

    def operations_problem(self, wanted: Iterable[Wanted], executing: Iterable[Execution]) -> Problem:
        """The operation planner's question; an operation that executes goes on to the post-condition it started with."""
        model, request = self.model, self.request
        wanted, system = tuple(wanted), operation_system(model)
        problem = Problem(
            system=system,
            initial=operation_state(model, request.state),
            goals=tuple(goal for one in wanted for goal in _goals(model, one)),
            allowed=system.invariants,
            unusable=frozenset((*self.failed, *request.failed)),
            bound=self.planners.bound,
        )
        sequences = constraints(model, [intention_of(model, one) for one in wanted])
        problem = in_order(model, problem, sequences, request.ran)
        for execution in executing:
            if self.differs(execution):
                problem = _with_execution(problem, execution)
        return _marked(problem, model, wanted)

    def differs(self, execution: Execution) -> bool:
        """Whether going on is something else than starting again."""
        operation = execution.task.operation
        _, (again,) = start(self.model, self.request.state, [execution.task])
        return bool(operation.on_start) or again.posts != execution.posts

    # --- transitions ----------------------------------------------------------------------------------------

    def carry_out(self, course: Course, executing: tuple[Execution, ...]) -> Decision | None:
        """Start what may start and plan the transitions for all that executes; None if some of it cannot be completed."""
        ready = [at for at in course.ready() if self.may_start(course.plan.tasks[at])]
        while True:
            state, started = start(self.model, self.request.state, [course.plan.tasks[at] for at in ready])
            together = (*executing, *started)
            now = replace(course, begun=course.begun.union(ready))
            if not together:
                return self.going_on((), now, None)
            following = self.request.following
            if following and not ready and following.purpose is Purpose.OPERATIONS:
                kept = self.still_reaches(following, together)
                if kept:
                    return self.going_on(together, now, kept)
            problem = self.stage_problem(state, together)
            began = self.planners.clock()
            result = decide(problem, self.planners.solve)
            if isinstance(result, CheckedPlan):
                self.note(self.transitions(), result, _named(together), began)
                broken = self.breaks(result)
                if broken is None:
                    return self.going_on(together, now, Following(result, operations=together))
                self.failed |= {execution.task.name: f"its steps break the formula of '{broken}'" for execution in together}
                return None
            if not result.decided:
                return self.undecided(result)
            sets = goals_to_blame(problem, result, self.planners.solve)
            if isinstance(sets, NoPlan):
                return self.undecided(sets)
            alone = [goals[0] for goals in sets if len(goals) == 1]
            if alone or not ready or len(together) == 1:
                self.note(self.transitions(), result, _named(together), began)
                self.failed |= {together[at].task.name: result.reason for at in alone or sets[0]}
                return None
            ready = ready[:-1] if executing or len(ready) > 1 else []  # possible alone but not together: later

    def breaks(self, plan: CheckedPlan) -> str | None:
        """The intention whose formula the steps of a plan would break for good, which no operation plan can see."""
        system = operation_system(self.model)
        states = [operation_state(self.model, state) for state in (self.request.state, *plan.trace.states)]
        for wanted in (*self.request.wanted, *self.request.given_up):
            owed = wanted.owed
            for before, after in pairwise(states):
                if before != after:
                    owed = progressed(owed, before, system.index)
            if progressed(owed, states[-1], system.index) == ALWAYS_FALSE:
                return wanted.intention
        return None

    def may_start(self, task: Task) -> bool:
        return bool(meaning(task.operation.guard, self.model.system.index)(self.request.state))

    def stage_problem(
        self,
        state: State,
        executing: Sequence[Execution],
        maintenance: bool = False,
        lifted: frozenset[str] = frozenset(),
    ) -> Problem:
        """Which transitions bring about the post-conditions of all operations that execute?"""
        return self.limited(posed(self.model, self.planners.widen, Purpose.OPERATIONS, state, executing, lifted), maintenance)

    def limited(self, problem: Problem, maintenance: bool) -> Problem:
        """With what may be used now, and for how many steps."""
        request = self.request
        begin = Start(problem.initial, (), maintenance=maintenance, disabled=request.disabled, lost=request.lost)
        return replace(problem, unusable=begin.unusable(problem.system), bound=self.planners.bound)

    # --- help -----------------------------------------------------------------------------------------------

    def ask_for_help(self) -> Decision:
        """Nothing can go on: try the operations in error with maintenance (section 4.5), as few of it as possible."""
        found: list[tuple[int, Following, Execution]] = []
        in_error = self.failed | dict(self.request.failed)
        candidates = [t for t in tasks(self.model) if t.name in in_error and t.name not in self.request.spent]
        began, undecided = self.planners.clock(), None
        for task in candidates:
            if not self.may_start(task):
                continue
            state, (execution,) = start(self.model, self.request.state, [task])
            result = decide(self.stage_problem(state, [execution], maintenance=True), self.planners.solve)
            if isinstance(result, CheckedPlan) and not self.breaks(result):
                system = result.problem.system
                asked = sum(system.transition[name].kind is Kind.MAINTENANCE for name in result.trace.path)
                found.append((asked, Following(result, Purpose.MAINTENANCE, operations=(execution,)), execution))
            elif isinstance(result, NoPlan) and not result.decided:
                undecided = result
        if found:
            _, following, execution = min(found, key=lambda way: (way[0], len(way[1].plan.trace.path)))
            self.note("TP w/MT", following.plan, _named([execution]), began)
            return self.going_on([execution], Course(OperationPlan((), ())), following)
        if undecided:
            return self.undecided(undecided)
        why = "; ".join(f"'{intention}': {reason}" for intention, reason in self.given_up.items())
        if candidates:
            self.actions.append(
                Action("TP w/MT", False, ", ".join(t.name for t in candidates), False, self.planners.clock() - began)
            )
        return replace(self.going_on((), None, None), stuck=why or "no intention can be reached")

    def leave_forbidden(self) -> Decision:
        """Plan the way out of forbidden states, with maintenance and without the invariants violated now (section 4.6)."""
        model, request = self.model, self.request
        widened = self.planners.widen(model.system)
        broken = frozenset(v.invariant for v in violations(model.system, request.state, widened))
        following = request.following
        if following and following.purpose is Purpose.EXIT and following.lifted == broken:
            problem = self.exit_problem(broken)
            trace = _replayed(problem, following)
            checked = check_plan(problem, trace, proposals(problem, trace)) if trace else None
            if isinstance(checked, CheckedPlan):
                return self.going_on((), None, Following(checked, Purpose.EXIT, lifted=broken))
        problem = self.exit_problem(broken)
        began = self.planners.clock()
        result = decide(problem, self.planners.solve)
        if isinstance(result, NoPlan) and not result.decided:
            return self.undecided(result)
        self.note("TP w/MT", result, "leave forbidden states: " + ", ".join(sorted(broken)), began)
        if isinstance(result, NoPlan):
            names = ", ".join(f"'{name}'" for name in sorted(broken))
            return Decision(tuple(self.actions), stuck=f"{names} violated, and there is no way out: {result.reason}")
        return Decision(tuple(self.actions), following=Following(result, Purpose.EXIT, lifted=broken))

    def exit_problem(self, broken: frozenset[str]) -> Problem:
        problem = posed(self.model, self.planners.widen, Purpose.EXIT, self.request.state, lifted=broken)
        return self.limited(problem, maintenance=True)

    def recheck(self) -> Decision:
        """What in error is possible again by itself: operations, intentions; or else operations with the operator's help."""
        possible, request = [], self.request
        for task in tasks(self.model):
            if task.name in request.failed and task.name not in request.spent:
                state, (execution,) = start(self.model, request.state, [task])
                result = decide(self.stage_problem(state, [execution]), self.planners.solve)
                if isinstance(result, CheckedPlan) and not self.breaks(result):
                    possible.append(task.name)
        if possible or not request.given_up:
            return Decision(possible=tuple(possible))
        reachable = [
            wanted.intention
            for wanted in request.given_up
            if isinstance(decide(self.operations_problem([wanted], request.executing), self.planners.solve), CheckedPlan)
        ]
        if reachable or request.following or request.executing:
            return Decision(reachable=tuple(reachable))
        return self.ask_for_help()

    # --- the record -----------------------------------------------------------------------------------------

    def transitions(self) -> str:
        """The notation of Table 1 for planning transitions now."""
        timed_out = [part for part, there in (("ETO", self.request.disabled), ("RTO", self.request.lost)) if there]
        return "TP w/" + "+".join(timed_out) if timed_out else "TP"

    def note(self, name: str, result: CheckedPlan | NoPlan, what: str, began: float) -> None:
        """Keep what was tried. Table 1 counts the transition plan that follows from a new operation plan with the latter."""
        reason = result.reason if isinstance(result, NoPlan) else ""
        follows = bool(self.actions) and self.actions[-1].name.startswith("OP") and self.actions[-1].reached
        untroubled = self.request.cause.ordinary and all(action.reached for action in self.actions)
        ordinary = isinstance(result, CheckedPlan) and (follows or untroubled)
        self.actions.append(Action(name, not reason, what, ordinary, self.planners.clock() - began, reason))

    def undecided(self, result: NoPlan) -> Decision:
        return Decision(tuple(self.actions), undecided=result.reason)


def _replayed(problem: Problem, following: Following) -> Reached | None:
    """The steps that remain, from the problem's initial state, with the automatic ones that follow them; None if stuck."""
    plan, steps = following.plan, problem.steps
    old = plan.problem.system
    path: list[str] = []
    states = [problem.initial]

    def settle() -> None:
        while (due := steps.automatic(states[-1])) and len(path) <= problem.bound:
            path.append(due[0].name)
            states.append(due[1])

    settle()
    for at, name in enumerate(plan.trace.path):
        transition = problem.system.transition.get(name)
        if at in following.done or old.transition[name].kind.automatic:
            continue
        if transition is None or name in problem.unusable:
            return None
        given = old.changes(plan.trace.states[at], plan.trace.states[at + 1])
        given = {variable: value for variable, value in given.items() if variable in transition.assigned}
        now = problem.system.named(states[-1])
        if all(now[variable] == value for variable, value in given.items()):
            continue
        outcomes = [s for s in fire(problem.system, transition, states[-1]) if _agrees(problem.system, s, given)]
        if not outcomes or not steps.settled(states[-1]):
            return None
        path.append(name)
        states.append(outcomes[0])
        settle()
    return Reached(tuple(path), tuple(states))


def _agrees(system: System, state: State, values: Mapping[str, object]) -> bool:
    return all(state[system.index[name]] == value for name, value in values.items())


def _with(system: System, state: State, values: Mapping[str, Value]) -> State:
    return tuple(values.get(v.name, old) for v, old in zip(system.variables, state, strict=True))


GOING_ON = " going on"
"""Behind a task's name: the rest of an execution, instead of another one. No name of a scenario has a space."""


def _with_execution(problem: Problem, execution: Execution) -> Problem:
    """With steps, usable once, that complete an operation that executes: its start is over, its post-condition fixed."""
    system, task = problem.system, execution.task
    open_yet = f"{task.operation.name}{GOING_ON}"
    steps: list[Transition] = []
    for step in system.transitions:
        posts = execution.posts.get(step.name)
        if posts is not None:
            guard = Var(open_yet) if task.operation.on_start else conjunction([step.guard, Var(open_yet)])
            reached = [Assignment(name, Const(value)) for name, value in posts.items()]
            decided = operation_variables(task)
            others = [action for action in step.actions if action.variable not in decided]
            actions = (*reached, *others, Assignment(open_yet, FALSE))
            steps.append(replace(step, name=step.name + GOING_ON, guard=guard, actions=actions))
        steps.append(step)
    unusable = problem.unusable | {name + GOING_ON for name in problem.unusable}
    variables = (*system.variables, Variable(open_yet, VariableKind.DECISION, Bool(), True))
    system = System(variables, tuple(steps), system.invariants)
    return replace(problem, system=system, initial=(*problem.initial, True), unusable=unusable)


def operation_variables(task: Task) -> frozenset[str]:
    """What starting and completing an operation assigns, whatever its outcome."""
    effects = (action for outcome in task.operation.outcomes for action in outcome.effects)
    return frozenset(action.variable for action in (*task.operation.on_start, *effects))


BEGUN = " begun"
"""Tells later states of an operation plan from the first one; no name of a scenario begins with a space."""


def _marked(problem: Problem, model: Model, wanted: Sequence[Wanted]) -> Problem:
    """With a variable that every step sets, if something owed counts in the first state only (see `_goals`)."""
    if all(_rest(model, one) == ALWAYS_TRUE for one in wanted):
        return problem
    system = problem.system
    steps = tuple(replace(t, actions=(*t.actions, Assignment(BEGUN, TRUE))) for t in system.transitions)
    variables = (*system.variables, Variable(BEGUN, VariableKind.DECISION, Bool(), False))
    return replace(problem, system=System(variables, steps, system.invariants), initial=(*problem.initial, False))


def promised(model: Model, intention: str) -> Formula:
    """`formula U goal` of an intention, over decision variables (section 4.2)."""
    one = next(known for known in model.intentions if known.name == intention)
    until = ALWAYS_TRUE if one.formula is None else over_atoms(one.formula, lambda predicate: abstracted(model, predicate))
    return Until(until, Atom(abstracted(model, one.goal)))


def intention_of(model: Model, wanted: Wanted) -> Intention:
    return next(known for known in model.intentions if known.name == wanted.intention)


def _goals(model: Model, wanted: Wanted) -> list[Goal]:
    """What is still owed of an intention, as a goal.

    What earlier states have left to be met from now on, beside `formula U goal` itself, counts in the first state only.
    """
    whole, rest = promised(model, wanted.intention), _rest(model, wanted)
    now_only: Formula = Either(Atom(Var(BEGUN)), rest)
    match whole:
        case Until(until, Atom(goal)) if whole in parts(wanted.owed):
            return [Goal(goal, until if rest == ALWAYS_TRUE else all_of([until, now_only]))]
    return [Goal(Var(BEGUN), now_only)]


def _rest(model: Model, wanted: Wanted) -> Formula:
    whole = promised(model, wanted.intention)
    return all_of(part for part in parts(wanted.owed) if part != whole)


def _named(executing: Iterable[Execution]) -> str:
    return ", ".join(execution.task.name for execution in executing)
