"""The questions that the bench asks: one reconstruction of the station of "Machines 2021" in two layouts, and hard cases.

Layout `A` has a pose per bolt: 4 bolts and 3 filters, 71 transitions, 87 Booleans with enumerations flattened. Layout `B`
goes to 24 bolts by index: 85 transitions. As in the paper, transitions of the operator (maintenance) and what is never
planned on are not counted. A robot locates the tool (6 steps), takes it (5), and tightens the first bolt (10): 21 steps.
Another bolt takes 12 steps in `A`, where the tool stops and the robot goes up in between, and 6 in `B`, where the robot
goes from bolt to bolt while the tool turns.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from random import Random

import smv_planner as sp
from smv_planner import language
from smv_planner.api import pose
from smv_planner.model.domains import Bool, Enum, Value
from smv_planner.model.expressions import (
    FALSE,
    TRUE,
    Const,
    Expr,
    Var,
    conjunction,
    disjunction,
    equality,
    meaning,
    negation,
    substitute,
)
from smv_planner.model.semantics import Steps
from smv_planner.model.system import Any, Assignment, Invariant, Kind, State, System, Transition, Variable, VariableKind
from smv_planner.planner.answer import Question
from smv_planner.problem import Goal, Problem

CONNECTOR_AND_CAMERA = """
  connector:
    parameters: [robot]
    variables:
      lock:     {kind: goal,     domain: bool, initial: false}
      unlock:   {kind: goal,     domain: bool, initial: false}
      attached: {kind: measured, domain: bool, initial: false}
    transitions:
      lock_on:   {kind: controlled, guard: not lock and $robot_located, actions: {lock: true, unlock: false}}
      unlock_on: {kind: controlled, guard: not unlock,                  actions: {lock: false, unlock: true}}
      attaches:  {kind: effect, guard: lock and not attached, actions: {attached: true},  within: 2 s}
      detaches:  {kind: effect, guard: unlock and attached,   actions: {attached: false}, within: 2 s}
      hang_tool: {kind: maintenance, guard: attached, instruction: "Hang the tool of $robot up and acknowledge.",
                  actions: {lock: false, unlock: false, attached: false, r1_located: false, r2_located: false}}

  camera:
    variables:
      scan:  {kind: goal,     domain: bool, initial: false}
      found: {kind: measured, domain: bool, initial: false}
    transitions:
      scan_on:  {kind: controlled, guard: not scan and not found, actions: {scan: true}}
      finds:    {kind: effect,     guard: scan and not found,     actions: {found: true}, within: 5 s}
      scan_off: {kind: controlled, guard: scan,                   actions: {scan: false}}
      resets:   {kind: effect,     guard: not scan and found,     actions: {found: false}, within: 1 s}
"""

RESOURCES = """
resources:
  $robot:           {foreach: {robot: [r1, r2]}, template: robot}
  $robot_connector: {foreach: {robot: [r1, r2]}, template: connector, with: {robot: $robot}}
  $robot_camera:    {foreach: {robot: [r1, r2]}, template: camera}
  nutrunner:        {template: nutrunner}
"""

# What the tool is, and where, becomes known by automatic transitions: completions of operations in the paper.
BOOKKEEPING = """
  $robot_locates: {foreach: {robot: [r1, r2]}, kind: automatic, guard: $robot_camera.scan and $robot_camera.found,
                   actions: {$robot_located: true, $robot_camera.scan: false}}
  $robot_let_go:  {foreach: {robot: [r1, r2]}, kind: automatic, guard: $robot_connector.unlock and not $robot_connector.attached,
                   actions: {$robot_connector.unlock: false, r1_located: false, r2_located: false}}
  place_bolt_$i:  {foreach: {i: 1..$bolts}, kind: controlled, guard: bolt_$i == empty, actions: {bolt_$i: placed}}
"""

INVARIANTS = """
invariants:
  tool_zone:        not (r1.at_the_tool and r2.near_the_tool) and not (r2.at_the_tool and r1.near_the_tool)
  bolt_zone:        not (r1.at_the_bolts and r2.at_the_bolts)
  one_tool:         not (r1_connector.attached and r2_connector.attached)
  runs_over_engine: (nutrunner.run_c or nutrunner.run_m) ->
                    (r1_connector.attached and r1.over_engine) or (r2_connector.attached and r2.over_engine)
  $robot_scans_still:     {foreach: {robot: [r1, r2]}, is: $robot_camera.scan -> $robot.still and $robot.act_pos == scan_tool}
  $robot_locks_at_tool:   {foreach: {robot: [r1, r2]}, is: ($robot_connector.lock and not $robot_connector.attached) ->
                             $robot.still and $robot.act_pos == at_tool}
  $robot_unlocks_at_tool: {foreach: {robot: [r1, r2]}, is: ($robot_connector.unlock and $robot_connector.attached) ->
                             $robot.still and $robot.act_pos == at_tool}
  $robot_bolts_with_tool: {foreach: {robot: [r1, r2]}, is: $robot.at_the_bolts -> $robot_connector.attached}
"""

NUTRUNNER = """
  nutrunner:
    variables:
      run_c:  {kind: goal,     domain: bool, initial: false}
      run_m:  {kind: measured, domain: bool, initial: false}
      tqr_m:  {kind: measured, domain: bool, initial: false}
      fail_m: {kind: measured, domain: bool, initial: false}
    transitions:
      start:  {kind: controlled, guard: not run_c and not run_m and not on_a_bolt, actions: {run_c: true}}
      runs:   {kind: effect, guard: run_c and not run_m, actions: {run_m: true}, within: 1 s}
      torque: {kind: effect, guard: run_m and not tqr_m and not fail_m and on_a_bolt, actions: {tqr_m: true}, within: 10 s}
      fails:  {kind: effect, guard: run_m and not tqr_m and not fail_m, actions: {fail_m: true}, expected: false}
      stop:   {kind: controlled, guard: run_c, actions: {run_c: false}}
"""

A = (
    """
smv_planner: 1
name: a_pose_per_bolt
templates:
  robot:
    parameters:
      poses: [home, service, scan_tool, at_tool, above_engine, {foreach: {i: 1..4}, is: at_bolt_$i},
              {foreach: {i: 1..3}, is: at_filter_$i}]
    variables:
      ref_pos: {kind: goal,     domain: $poses, initial: home}
      act_pos: {kind: measured, domain: $poses, initial: home}
      moving:  {kind: measured, domain: bool,   initial: false}
    predicates:
      still:         ref_pos == act_pos and not moving
      at_the_tool:   ref_pos == at_tool or act_pos == at_tool
      near_the_tool: at_the_tool or ref_pos == scan_tool or act_pos == scan_tool
      refers_bolt:   {any: ref_pos == at_bolt_$i, foreach: {i: 1..4}}
      is_at_bolt:    {any: act_pos == at_bolt_$i, foreach: {i: 1..4}}
      at_the_bolts:  refers_bolt or is_at_bolt
      over_engine:   (ref_pos == above_engine or refers_bolt) and (act_pos == above_engine or is_at_bolt)
    transitions:
      # A road map: what may be reached from where.
      move_home:         {kind: controlled, guard: "still and act_pos in {service, scan_tool, above_engine}",
                          actions: {ref_pos: home}}
      move_service:      {kind: controlled, guard: still and act_pos == home, actions: {ref_pos: service}}
      move_scan_tool:    {kind: controlled, guard: "still and act_pos in {home, at_tool}", actions: {ref_pos: scan_tool}}
      move_at_tool:      {kind: controlled, guard: "still and act_pos in {scan_tool, above_engine}", actions: {ref_pos: at_tool}}
      move_above_engine: {kind: controlled, guard: still and act_pos != service and act_pos != scan_tool,
                          actions: {ref_pos: above_engine}}
      move_at_bolt_$i:   {foreach: {i: 1..4}, kind: controlled, guard: still and act_pos == above_engine,
                          actions: {ref_pos: at_bolt_$i}}
      move_at_filter_$i: {foreach: {i: 1..3}, kind: controlled, guard: still and act_pos == above_engine and all_tightened,
                          actions: {ref_pos: at_filter_$i}}
      sets_out:   {kind: effect, guard: ref_pos != act_pos and not moving, actions: {moving: true}, within: 1 s}
      arrives:    {kind: effect, guard: ref_pos != act_pos and moving, actions: {act_pos: ref_pos, moving: false}, within: 20 s}
      push_home:  {kind: maintenance, actions: {ref_pos: home, act_pos: home, moving: false},
                   instruction: "Move robot $resource into its home position by hand and acknowledge."}
"""
    + CONNECTOR_AND_CAMERA
    + NUTRUNNER
    + """
      resets: {kind: effect, guard: not run_c and (run_m or tqr_m or fail_m),
               actions: {run_m: false, tqr_m: false, fail_m: false}, within: 2 s}
"""
    + RESOURCES
    + """
decision:
  bolt_$i:        {foreach: {i: 1..4}, domain: [empty, placed, tightened],  initial: placed}
  filter_$i:      {foreach: {i: 1..3}, domain: [empty, mounted, tightened], initial: empty}
  $robot_located: {foreach: {robot: [r1, r2]}, domain: bool, initial: false}
predicates:
  on_a_bolt:     (r1.still and r1.at_the_bolts) or (r2.still and r2.at_the_bolts)
  all_tightened: {all: bolt_$i == tightened, foreach: {i: 1..4}}
  no_filters:    {all: filter_$i == empty, foreach: {i: 1..3}}
transitions:
"""
    + BOOKKEEPING.replace("$bolts", "4")
    + """
  tightened_$i_$robot: {foreach: {i: 1..4, robot: [r1, r2]}, kind: automatic,
                        guard: bolt_$i == placed and nutrunner.tqr_m and $robot.still and $robot.act_pos == at_bolt_$i,
                        actions: {bolt_$i: tightened}}
  mount_filter_$i:     {foreach: {i: 1..3}, kind: controlled, guard: filter_$i == empty, actions: {filter_$i: mounted}}
  tighten_filter_$i:   {foreach: {i: 1..3}, kind: controlled, guard: filter_$i == mounted, actions: {filter_$i: tightened}}
"""
    + INVARIANTS
    + """
  down_turning:      not (r1.at_the_bolts and r1.act_pos == above_engine and (not nutrunner.run_m or nutrunner.tqr_m)) and
                     not (r2.at_the_bolts and r2.act_pos == above_engine and (not nutrunner.run_m or nutrunner.tqr_m))
  filters_need_bolts: no_filters or all_tightened
"""
)
"""A pose per bolt, another above the engine, and one per filter."""

B = (
    """
smv_planner: 1
name: bolts_by_index
templates:
  robot:
    parameters:
      poses: [home, scan_tool, at_tool, at_bolts]     # scan_tool is above the engine
    variables:
      ref_pos: {kind: goal,     domain: $poses, initial: home}
      act_pos: {kind: measured, domain: $poses, initial: home}
      moving:  {kind: measured, domain: bool,   initial: false}
      ref_bolt: {kind: goal,     domain: {min: 1, max: 24}, initial: 1}
      act_bolt: {kind: measured, domain: {min: 1, max: 24}, initial: 1}
    predicates:
      told:          ref_pos != act_pos or ref_bolt != act_bolt
      still:         not told and not moving
      at_the_tool:   ref_pos == at_tool or act_pos == at_tool
      near_the_tool: at_the_tool
      at_the_bolts:  ref_pos == at_bolts or act_pos == at_bolts
      over_engine:   ref_pos in {scan_tool, at_bolts} and act_pos in {scan_tool, at_bolts}
    transitions:
      move_home:      {kind: controlled, guard: still and act_pos != home and act_pos != at_bolts,   actions: {ref_pos: home}}
      move_scan_tool: {kind: controlled, guard: still and act_pos != scan_tool,                     actions: {ref_pos: scan_tool}}
      move_at_tool:   {kind: controlled, guard: still and (act_pos == home or act_pos == scan_tool), actions: {ref_pos: at_tool}}
      move_at_bolts:  {kind: controlled, guard: still and (act_pos == scan_tool or act_pos == at_bolts),
                       actions: {ref_pos: at_bolts, ref_bolt: any}}
      sets_out:   {kind: effect, guard: told and not moving, actions: {moving: true}, within: 1 s}
      # The robot's program waits for the torque signal to fall before it goes down.
      arrives:    {kind: effect, guard: told and moving and not (ref_pos == at_bolts and nutrunner.tqr_m),
                   actions: {act_pos: ref_pos, act_bolt: ref_bolt, moving: false}, within: 20 s}
      push_home:  {kind: maintenance, actions: {ref_pos: home, act_pos: home, moving: false},
                   instruction: "Move robot $resource into its home position by hand and acknowledge."}
"""
    + CONNECTOR_AND_CAMERA
    + NUTRUNNER
    + """
      resets: {kind: effect, guard: (not run_c and (run_m or tqr_m or fail_m)) or (tqr_m and not on_a_bolt),
               actions: {run_m: run_c, tqr_m: false, fail_m: false}, within: 2 s}
"""
    + RESOURCES
    + """
decision:
  bolt_$i:        {foreach: {i: 1..24}, domain: [empty, placed, tightened],  initial: placed}
  $robot_located: {foreach: {robot: [r1, r2]}, domain: bool, initial: false}
predicates:
  on_a_bolt:     (r1.still and r1.at_the_bolts) or (r2.still and r2.at_the_bolts)
  at_$i:         {foreach: {i: 1..24}, is: (r1.still and r1.at_the_bolts and r1.act_bolt == $i) or
                                           (r2.still and r2.at_the_bolts and r2.act_bolt == $i)}
transitions:
"""
    + BOOKKEEPING.replace("$bolts", "24")
    + """
  tightened_$i: {foreach: {i: 1..24}, kind: automatic, actions: {bolt_$i: tightened},
                 guard: bolt_$i == placed and nutrunner.tqr_m and at_$i}
"""
    + INVARIANTS
    + """
  down_turning: not (r1.at_the_bolts and r1.act_pos == scan_tool and (not nutrunner.run_m or nutrunner.tqr_m)) and
                not (r2.at_the_bolts and r2.act_pos == scan_tool and (not nutrunner.run_m or nutrunner.tqr_m))
"""
)
"""24 bolts, the one to go to chosen by the planner."""

FROZEN = """
  frozen_bolt_$i: {foreach: {i: 9..24}, is: not (bolt_$i == placed and nutrunner.tqr_m and at_$i)}
"""
"""Machines 2021, section 4.3: nothing may be about to change a bolt that no executing operation is concerned with."""

TEXTS = {"A": A, "B": B, "B frozen": B + FROZEN}


@cache
def layout(name: str) -> sp.Model:
    return sp.loads(TEXTS[name], file=f"<layout {name}>")


@dataclass(frozen=True)
class Instance:
    """A question, and how many steps a shortest plan has; None where there is no plan."""

    name: str
    problem: Problem
    length: int | None


def asked(name: str, where: str, length: int | None, goals: tuple[str, ...], **question: object) -> Instance:
    return Instance(name, pose(layout(where), Question(goals, **question)), length)  # type: ignore[arg-type]


def holding(robot: str, at: str) -> dict[str, Value]:
    """The settings under which a robot has the tool, and stands at a place."""
    connected: dict[str, Value] = {f"{robot}_connector.{each}": True for each in ("lock", "attached")}
    return connected | {f"{robot}.ref_pos": at, f"{robot}.act_pos": at, f"{robot}_located": True}


def standing(robot: str, at: str) -> dict[str, Value]:
    return {f"{robot}.ref_pos": at, f"{robot}.act_pos": at, f"{robot}_located": True}


def plans() -> Iterator[Instance]:
    """The six questions of the table of plans. r1 stays at the station, r2 comes and goes: where it has no part it is away."""
    first, second = "bolt_1 == tightened", "bolt_2 == tightened"
    yield asked("A1 one bolt", "A", 21, (first,), lost=("r2",))
    yield asked("B1 one bolt", "B", 21, (first,), lost=("r2",))
    lost = {"settings": holding("r2", "at_bolt_2"), "lost": ("r2",), "maintenance": True}
    yield asked("E7 with maintenance", "A", 23, (first,), **lost)
    over = "r2_connector.attached and r2.still and r2.act_pos == above_engine"
    yield asked("tool handover", "A", 31, ("r1_connector.attached", over))
    yield asked("two phi U goal", "A", 33, (first, second), lost=("r2",), formula="bolt_3 == placed and bolt_4 == placed")
    yield asked("two bolts", "A", 33, (f"{first} and {second}",), lost=("r2",))


def crowded() -> Iterator[Instance]:
    """The same where r2 is there and may do anything, as long as it is in nobody's way: fifty to a hundred times the states."""
    first, second = "bolt_1 == tightened", "bolt_2 == tightened"
    yield asked("A1, r2 about", "A", 21, (first,))
    yield asked("B1, r2 about", "B", 21, (first,))
    yield asked("two bolts, r2 about", "A", 33, (f"{first} and {second}",))


def impossible() -> Iterator[Instance]:
    """E5: r2 is disconnected at home. E6: r2 is disconnected at the tool. E3: r2 does not notice that the tool is there."""
    yield asked("E5 unreachable", "A", None, ("r2_connector.attached",), lost=("r2",))
    yield asked("E6 unreachable", "A", None, ("bolt_1 == tightened",), lost=("r2",), settings=standing("r2", "at_tool"))
    at_tool = {**standing("r2", "at_tool"), "r2_connector.lock": True}
    yield asked("E3 unreachable", "A", None, ("r2_connector.attached",), settings=at_tool, disabled=("r2_connector.attaches",))


def free() -> Iterator[Instance]:
    """Of 24 bolts three or four are asked for, and any may be tightened."""
    for number, length in ((3, 33), (4, 39)):
        yield asked(f"B{number} {number} of 24 bolts", "B", length, (tightened(number),), lost=("r2",))


def frozen(bolts: int = 8) -> Instance:
    """Some of the first eight bolts, in any order, and the other sixteen frozen."""
    return asked(f"{bolts} of 24 bolts frozen", "B frozen", 21 + 6 * (bolts - 1), (tightened(bolts),), lost=("r2",))


def tightened(bolts: int) -> str:
    return " and ".join(f"bolt_{i} == tightened" for i in range(1, bolts + 1))


def stations(number: int, goal: str = "bolt_1 == tightened") -> Instance:
    """Independent stations of layout A side by side, each with the goal of its own."""
    one = pose(layout("A"), Question((goal,), lost=("r2",)))
    copies = [_renamed(one, f"s{at}.") for at in range(1, number + 1)]
    system = System(
        variables=tuple(v for each in copies for v in each.system.variables),
        transitions=tuple(t for each in copies for t in each.system.transitions),
        invariants=tuple(i for each in copies for i in each.system.invariants),
    )
    problem = Problem(
        system=system,
        initial=system.initial,
        goals=tuple(goal for each in copies for goal in each.goals),
        allowed=tuple(i for each in copies for i in each.allowed),
        unusable=frozenset(name for each in copies for name in each.unusable),
        bound=21 * number + 10,
    )
    return Instance(f"{number} stations", problem, 21 * number)


def _renamed(problem: Problem, prefix: str) -> Problem:
    """The same question with every name behind a prefix."""
    system = problem.system
    names: Mapping[str, Expr] = {v.name: Var(prefix + v.name) for v in system.variables}

    def action(one: Assignment) -> Assignment:
        value = one.value if isinstance(one.value, Any) else substitute(one.value, names)
        return Assignment(prefix + one.variable, value)

    def transition(one: Transition) -> Transition:
        actions = tuple(map(action, one.actions))
        return replace(one, name=prefix + one.name, guard=substitute(one.guard, names), actions=actions)

    def invariants(all_of_them: Iterable[Invariant]) -> tuple[Invariant, ...]:
        return tuple(Invariant(prefix + i.name, substitute(i.predicate, names)) for i in all_of_them)

    return Problem(
        system=System(
            tuple(replace(v, name=prefix + v.name) for v in system.variables),
            tuple(map(transition, system.transitions)),
            invariants(system.invariants),
        ),
        initial=problem.initial,
        goals=tuple(Goal(substitute(goal.predicate, names)) for goal in problem.goals),
        allowed=invariants(problem.allowed),
        unusable=frozenset(prefix + name for name in problem.unusable),
        bound=problem.bound,
    )


def mutex(irrelevant: int = 24, entangled: bool = False) -> Instance:
    """Three workers share two tokens: any two may be at work, never all three; and switches that change nothing of that.

    No pair of facts excludes the goal, so pairwise mutexes cannot prove it impossible, and every switch doubles the states.
    Where they are `entangled`, a worker begins only while one of its switches is on, so none of them can be left aside unseen.
    """
    places = Enum(("free", "w1", "w2", "w3"))
    tokens, workers = ("token_1", "token_2"), ("w1", "w2", "w3")
    switches = tuple(f"switch_{number}" for number in range(irrelevant))
    variables = [Variable(token, VariableKind.ESTIMATED, places, "free") for token in tokens]
    variables += [Variable(name, VariableKind.ESTIMATED, Bool(), False) for name in (*workers, *switches)]
    transitions = []
    for token in tokens:
        for at, worker in enumerate(workers):
            on = disjunction(Var(name) for name in switches[at::3]) if entangled else TRUE
            take = conjunction([equality(Var(token), Const("free")), negation(Var(worker)), on])
            begin = (Assignment(token, Const(worker)), Assignment(worker, TRUE))
            end = (Assignment(token, Const("free")), Assignment(worker, FALSE))
            transitions.append(Transition(f"{worker}.takes-{token}", Kind.CONTROLLED, take, begin))
            transitions.append(Transition(f"{worker}.returns-{token}", Kind.CONTROLLED, equality(Var(token), Const(worker)), end))
    for name in switches:
        transitions.append(Transition(f"{name}.toggle", Kind.CONTROLLED, TRUE, (Assignment(name, negation(Var(name))),)))
    system = System(tuple(variables), tuple(transitions), ())
    goal = Goal(conjunction(Var(worker) for worker in workers))
    name = f"3-way mutex, 2^{irrelevant} {'entangled' if entangled else 'aside'}"
    return Instance(name, Problem(system, system.initial, (goal,), ()), None)


WANTED = (
    *(f"bolt_{i} == tightened" for i in range(1, 5)),
    "r1_connector.attached",
    "r2_connector.attached",
    "not r1_connector.attached and not r2_connector.attached",
    "r1.still and r1.act_pos == home and r2.still and r2.act_pos == home",
)


def replans(number: int, seed: int = 2021) -> Iterator[Problem]:
    """What a runner asks when something went wrong: from some reachable state, some robots dead, some effects disabled."""
    random, model = Random(seed), layout("A")
    effects = [t.name for t in model.transitions if t.kind is Kind.EFFECT and t.expected]
    goals = [Goal(language.predicate(model, text)) for text in WANTED]
    resting = pose(model, Question((WANTED[0],)))
    for _ in range(number):
        question = Question(
            goals=(WANTED[0],),
            disabled=tuple(random.sample(effects, random.choice((0, 0, 1, 1, 2)))),
            lost=random.choice(((), (), ("r1",), ("r2",))),
            maintenance=random.random() < 0.2,
        )
        usable = pose(model, question).unusable
        yield replace(resting, initial=wander(random, resting), goals=(random.choice(goals),), unusable=usable)


def wander(random: Random, problem: Problem, most: int = 150) -> State:
    """A state at the end of a random walk among allowed states."""
    steps = Steps(problem.system, problem.usable)
    allowed = meaning(conjunction(i.predicate for i in problem.allowed), problem.system.index)
    state = problem.initial
    for _ in range(random.randrange(most)):
        following = [after for _, after in steps(state) if allowed(after)]
        if not following:
            break
        state = random.choice(following)
    return state
