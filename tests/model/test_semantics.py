"""What a model means, one rule at a time."""

from __future__ import annotations

from smv_planner.model.domains import Bool, Enum, Range
from smv_planner.model.expressions import TRUE, Const, Minus, Plus, Var, equality, negation
from smv_planner.model.semantics import Steps, fire, slide
from smv_planner.model.system import Any, Assignment, Kind, System, Transition, Variable, VariableKind

LAMP = Variable("lamp", VariableKind.GOAL, Bool(), False)
POSE = Variable("pose", VariableKind.ESTIMATED, Enum(("home", "table", "away")), "home")
WEAR = Variable("wear", VariableKind.ESTIMATED, Range(0, 2), 0)


def transition(name, kind=Kind.CONTROLLED, guard=TRUE, **actions):
    assigned = tuple(Assignment(v, x if isinstance(x, Any | Var | Plus | Minus) else Const(x)) for v, x in actions.items())
    return Transition(name, kind, guard, assigned)


def system(*transitions):
    return System((LAMP, POSE, WEAR), transitions, ())


def names(steps, state):
    return [step.name for step, _ in steps(state)]


def test_all_assignments_read_the_old_state():
    swap = transition("swap", wear=Plus(Var("wear"), Const(1)), lamp=True)
    assert fire(system(swap), swap, (False, "home", 0)) == ((True, "home", 1),)


def test_a_transition_that_changes_nothing_is_not_enabled():
    light = transition("light", lamp=True)
    assert fire(system(light), light, (True, "home", 0)) == ()


def test_an_assignment_that_leaves_the_domain_disables_the_transition():
    up, down = transition("up", wear=Plus(Var("wear"), Const(1))), transition("down", wear=Minus(Var("wear"), Const(1)))
    assert fire(system(up), up, (False, "home", 2)) == ()
    assert fire(system(down), down, (False, "home", 0)) == ()
    assert fire(system(down), down, (False, "home", 2)) == ((False, "home", 1),)


def test_the_planner_chooses_any_value_but_the_old_one():
    go = transition("go", pose=Any())
    assert [pose for _, pose, _ in fire(system(go), go, (False, "table", 0))] == ["home", "away"]


def test_only_the_first_enabled_automatic_transition_may_fire():
    dark = negation(Var("lamp"))
    first = transition("first", Kind.AUTOMATIC, dark, lamp=True)
    second = transition("second", Kind.AUTOMATIC, dark, pose="table")
    third = transition("third", Kind.AUTOMATIC, equality(Var("pose"), Const("home")), wear=1)
    steps = Steps(system(second, first, third), [second, first, third])
    assert names(steps, (False, "home", 0)) == ["second"]
    assert names(steps, (False, "table", 0)) == ["first"]
    assert steps.settled((True, "home", 1))


def test_effects_wait_for_automatic_transitions_only_in_plans_not_in_slides():
    automatic = transition("note", Kind.AUTOMATIC, negation(Var("lamp")), lamp=True)
    effect = transition("falls", Kind.EFFECT, negation(Var("lamp")), pose="away")
    whole = system(automatic, effect)
    assert names(Steps(whole, whole.transitions), (False, "home", 0)) == ["note"]
    way = slide(whole, [(False, "home", 0)], [negation(equality(Var("pose"), Const("away")))])
    assert [step.name for step, _ in way] == ["falls"]


def test_a_state_that_is_bad_already_slides_in_no_step_and_a_safe_one_in_none():
    effect = transition("falls", Kind.EFFECT, Var("lamp"), pose="away")
    never_away = [negation(equality(Var("pose"), Const("away")))]
    assert slide(system(effect), [(False, "away", 0)], never_away) == []
    assert slide(system(effect), [(False, "home", 0)], never_away) is None
