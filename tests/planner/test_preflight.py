"""What a preflight finds: every rule by a model that breaks it and a neighbour that does not, and against all states."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import islice, pairwise, product
from math import prod
from random import Random

import generated
import pytest

from smv_planner import language
from smv_planner.engines.sat import Predicates
from smv_planner.model.expressions import Const, Var, conjunction, equality, meaning, negation, show
from smv_planner.model.model import Model
from smv_planner.model.semantics import Steps, fire
from smv_planner.model.system import Kind, State, System, Transition, VariableKind
from smv_planner.planner.preflight import Finding, Scene, domains, preflight, scene
from smv_planner.planner.preflight.firing import never_fires
from smv_planner.planner.preflight.growth import count, growth
from smv_planner.planner.preflight.guards import extra_guards
from smv_planner.planner.preflight.settling import Copied, groups, settling
from smv_planner.planner.widening import Widened, widen

SECTIONS = {
    "variables": """
      on:   {kind: goal,      domain: bool, initial: false}
      lit:  {kind: measured,  domain: bool, initial: false}
      wear: {kind: estimated, domain: {min: 0, max: 3}, initial: 0}""",
    "lamp": """
      switch_on:  {kind: controlled, guard: not on and not lit, actions: {on: true}}
      switch_off: {kind: controlled, guard: on and lit,         actions: {on: false}}
      lights_up:  {kind: effect,     guard: on and not lit,     actions: {lit: true}}
      goes_out:   {kind: effect,     guard: not on and lit,     actions: {lit: false}}
      renew:      {kind: maintenance, actions: {wear: any}, instruction: Renew the bulb.}""",
    "decision": """
      room: {domain: [dark, bright, gone], initial: dark}""",
    "transitions": """
      shine: {kind: automatic, guard: lamp.lit and room == dark,       actions: {room: bright}}
      dusk:  {kind: automatic, guard: not lamp.lit and room == bright, actions: {room: dark}}""",
    "invariants": "",
    "operations": "",
    "intentions": "",
}


def lamp(without: str = "nothing", **more: str | tuple[str, ...]) -> str:
    """A lamp that no rule has anything against, with lines added to its sections, and without others."""
    text = {}
    for name, lines in SECTIONS.items():
        added = more.get(name, ())
        every = [*lines.split("\n"), *(f"      {line}" for line in ((added,) if isinstance(added, str) else added))]
        text[name] = "\n".join(line for line in every if without not in line)
    below = "".join(f"{name}:{lines}\n" for name, lines in text.items() if name not in ("variables", "lamp"))
    head = "smv_planner: 1\nname: lamp\nresources:\n  lamp:\n"
    return f"{head}    variables:{text['variables']}\n    transitions:{text['lamp']}\n{below}"


def automatic(name: str, guard: str, actions: str) -> str:
    return f"{name}: {{kind: automatic, guard: {guard}, actions: {{{actions}}}}}"


def controlled(name: str, guard: str, actions: str) -> str:
    return f"{name}: {{kind: controlled, guard: {guard}, actions: {{{actions}}}}}"


def effect(name: str, guard: str, actions: str) -> str:
    return f"{name}: {{kind: effect, guard: {guard}, actions: {{{actions}}}}}"


def operation(text: str, **more: str | tuple[str, ...]) -> str:
    return lamp(operations=f"o: {{{text}}}", **more)


def intention(text: str, **more: str | tuple[str, ...]) -> str:
    return lamp(intentions=f"i: {{{text}}}", **more)


FLIP = automatic("flip", "on and wear == 0", "wear: 1")
FLOP = automatic("flop", "on and wear == 1", "wear: 0")
LATE = automatic("late", "on and wear == 0", "wear: 2")
MORE = automatic("more", "wear == 2", "wear: 3")
DONE = automatic("done", "on and wear == 3", "on: false")
BLOWS = effect("blows", "on and wear == 3", "lit: false")
BRIGHT = "effects: {room: bright}, goal: lamp.lit"
GLOW = "glow: {kind: measured, domain: [none, warm, hot], initial: none}"
WARMS = effect("warms", "on and glow == none", "glow: warm")
HEATS = effect("heats", "lit and glow == none", "glow: hot")
COUNTER = "n: {kind: estimated, domain: {min: 0, max: MOST}, initial: 0}"

SETTLING = [
    ("does-not-settle", "error", "lamp.flip", lamp(lamp=(FLIP, FLOP)), lamp(lamp=FLIP)),
    (
        *("does-not-settle", "error", "lamp.swing"),
        lamp(lamp=automatic("swing", "on", "wear: 3 - wear")),
        lamp(lamp=automatic("swing", "on and wear < 2", "wear: 3 - wear")),
    ),
    (  # only where an invariant does not allow it
        *("does-not-settle", "warning", "lamp.flip"),
        lamp(lamp=(FLIP, FLOP), invariants="i: not (lamp.on and lamp.wear < 2)"),
        lamp(lamp=FLIP, invariants="i: not (lamp.on and lamp.wear < 2)"),
    ),
    (
        *("not-proved-to-settle", "warning", "lamp.up"),
        lamp(variables=COUNTER.replace("MOST", "1000"), lamp=automatic("up", "n < 1000", "n: n + 1")),
        lamp(variables=COUNTER.replace("MOST", "40"), lamp=automatic("up", "n < 40", "n: n + 1")),
    ),
    ("order-matters", "warning", "lamp.late", lamp(lamp=(FLIP, LATE)), lamp(lamp=(FLIP, LATE.replace("== 0", "== 3")))),
    (  # each disables the other; in the second model both ways end alike
        *("order-matters", "warning", "lamp.late"),
        lamp(lamp=(FLIP, LATE, MORE)),
        lamp(lamp=(FLIP, LATE, automatic("more", "wear == 1", "wear: 2"))),
    ),
    (  # the same, some steps later
        *("order-matters", "warning", "lamp.late"),
        lamp(lamp=(FLIP, LATE, MORE, DONE)),
        lamp(lamp=(FLIP, LATE, MORE, DONE, automatic("worn", "wear == 1", "wear: 2"))),
    ),
    (  # in the second model an invariant keeps them from meeting
        *("order-matters", "warning", "lamp.late"),
        lamp(lamp=(FLIP, LATE)),
        lamp(lamp=(FLIP, LATE), invariants="i: not (lamp.on and lamp.wear == 0)"),
    ),
]

FIRING = [
    (
        *("never-fires", "error", "lamp.t"),
        lamp(lamp=controlled("t", "on and wear == 2 and not on", "wear: 0")),
        lamp(lamp=controlled("t", "on and wear == 2", "wear: 0")),
    ),
    (
        *("never-fires", "warning", "lamp.t"),
        lamp(lamp=controlled("t", "wear == 2", "wear: 2")),
        lamp(lamp=controlled("t", "wear == 2", "wear: 3")),
    ),
    (
        *("never-fires", "warning", "lamp.t"),
        lamp(lamp=controlled("t", "wear == 2", "wear: wear + 2")),
        lamp(lamp=controlled("t", "wear == 2", "wear: wear + 1")),
    ),
    (
        *("never-fires", "warning", "lamp.blows"),
        lamp(lamp=BLOWS, invariants="i: lamp.wear < 3"),
        lamp(lamp=BLOWS, invariants="i: lamp.wear < 3 or lamp.on"),
    ),
    (
        *("never-fires", "warning", "lamp.t"),
        lamp(lamp=(FLIP, controlled("t", "on and wear == 0", "wear: 2"))),
        lamp(lamp=(FLIP, controlled("t", "on and wear == 1", "wear: 2"))),
    ),
    (
        *("never-fires", "warning", "lamp.late"),
        lamp(lamp=(FLIP, LATE)),
        lamp(
            lamp=(LATE.replace("on and ", ""), FLIP.replace("on and", "not on and"), controlled("x", "on", "wear: 0")),
            without="flip",
        ),
    ),
    (
        *("never-fires", "warning", "lamp.switch_on"),
        lamp(invariants="i: not lamp.lit"),
        lamp(invariants="i: not (lamp.lit and lamp.wear == 3)"),
    ),
    (  # maintenance is for recovery: it may serve in forbidden states alone
        *("never-fires", "warning", "lamp.blows"),
        lamp(lamp=BLOWS, invariants="i: lamp.wear < 3"),
        lamp(lamp="help: {kind: maintenance, guard: wear == 3, actions: {wear: 0}}", invariants="i: lamp.wear < 3"),
    ),
    (
        *("leaves-domain", "warning", "lamp.t"),
        lamp(lamp=controlled("t", "on", "wear: wear + 1")),
        lamp(lamp=controlled("t", "on and wear < 3", "wear: wear + 1")),
    ),
    (
        *("leaves-domain", "warning", "lamp.t"),
        lamp(lamp=controlled("t", "on", "wear: wear + 1")),
        lamp(lamp=controlled("t", "on", "wear: wear + 1"), invariants="i: lamp.wear < 3"),
    ),
    (
        *("leaves-domain", "warning", "o"),
        operation("outcomes: {a: {effects: {n: n + 1}, goal: lamp.lit}}", decision="n: {domain: {min: 0, max: 2}, initial: 0}"),
        operation("guard: n < 2, effects: {n: n + 1}, goal: lamp.lit", decision="n: {domain: {min: 0, max: 2}, initial: 0}"),
    ),
    (
        *("effects-disagree", "warning", "lamp.heats"),
        lamp(variables=GLOW, lamp=(WARMS, HEATS)),
        lamp(variables=GLOW, lamp=(WARMS, HEATS.replace("none", "warm"))),
    ),
    (
        *("effects-disagree", "warning", "lamp.heats"),
        lamp(variables=GLOW, lamp=(WARMS, HEATS)),
        lamp(variables=GLOW, lamp=(WARMS, HEATS.replace("}}", "}, expected: false}"))),
    ),
]

OPERATIONS = [
    (
        "never-starts",
        "error",
        "o",
        operation(f"guard: room == dark and room == bright, {BRIGHT}"),
        operation(f"guard: room == dark, {BRIGHT}"),
    ),
    (
        *("never-starts", "warning", "o"),
        operation(f"guard: room == gone, {BRIGHT}", invariants="i: room != gone"),
        operation(f"guard: room == gone, {BRIGHT}", invariants="i: room != gone or lamp.lit"),
    ),
    (
        *("never-completes", "error", "o"),
        operation("effects: {room: bright}, goal: lamp.lit and not lamp.lit"),
        operation("effects: {room: bright}, goal: lamp.lit and not lamp.on"),
    ),
    (
        *("never-completes", "error", "o"),
        operation("effects: {room: bright}, goal: lamp.wear == 3", invariants="i: lamp.wear < 3"),
        operation("effects: {room: bright}, goal: lamp.wear == 3", invariants="i: lamp.wear < 3 or lamp.lit"),
    ),
    (
        *("never-completes", "error", "o"),
        operation("effects: {}, goal: lamp.lit, with: lamp.switch_on"),
        operation("effects: {}, goal: lamp.lit, with: lamp.switch_off"),
    ),
    (
        *("never-completes", "error", "o"),
        operation("outcomes: {a: {effects: {room: bright}, goal: lamp.lit}, b: {effects: {}, goal: lamp.wear > 3}}"),
        operation("outcomes: {a: {effects: {room: bright}, goal: lamp.lit}, b: {effects: {}, goal: lamp.wear > 2}}"),
    ),
    (  # goals count in settled states
        *("never-completes", "error", "o"),
        operation("effects: {room: bright}, goal: lamp.on and lamp.wear == 0", lamp=FLIP),
        operation("effects: {room: bright}, goal: lamp.on and lamp.wear == 1", lamp=FLIP),
    ),
    (
        *("changes-nothing", "warning", "o"),
        operation("guard: room == dark, effects: {room: dark}, goal: lamp.lit"),
        operation("guard: room != dark, effects: {room: dark}, goal: lamp.lit"),
    ),
    (
        *("changes-nothing", "warning", "o"),
        operation("outcomes: {a: {effects: {}, goal: lamp.lit}, b: {effects: {}, goal: lamp.on}}"),
        operation("outcomes: {a: {effects: {}, goal: lamp.lit}, b: {effects: {room: gone}, goal: lamp.on}}"),
    ),
    ("nobody-completes", "error", "o", operation("effects: {room: gone}"), operation("effects: {room: bright}")),
    (
        *("nobody-completes", "error", "o"),
        operation("effects: {worn: true}", decision="worn: {from: lamp.wear == 3}"),
        operation("effects: {worn: true}", decision="worn: {from: lamp.wear == 3}", lamp=controlled("t", "on", "wear: 3")),
    ),
    (
        "never-starts",
        "error",
        "i",
        intention("start: lamp.on and not lamp.on, goal: room == bright"),
        intention("start: lamp.on, goal: room == bright"),
    ),
    (
        *("never-starts", "warning", "i"),
        intention("start: lamp.wear == 3, goal: room == bright", invariants="i: lamp.wear < 3"),
        intention("start: lamp.wear == 2, goal: room == bright", invariants="i: lamp.wear < 3"),
    ),
    (
        "never-reached",
        "error",
        "i",
        intention("start: lamp.on, goal: room == bright and room == dark"),
        intention("start: lamp.on, goal: room == bright"),
    ),
    (
        *("never-reached", "error", "i"),
        intention(
            "start: lamp.on, goal: worn and room == dark", decision="worn: {from: lamp.wear == 3}", invariants="i: lamp.wear < 3"
        ),
        intention(
            "start: lamp.on, goal: worn and room == dark", decision="worn: {from: lamp.wear == 2}", invariants="i: lamp.wear < 3"
        ),
    ),
]

SIDE = "side: {domain: [left, right], initial: left}"
HOW = "how: {domain: [dim, full, off], from: {full: lamp.lit, otherwise: dim}}"

VALUES = [
    ("never-changes", "warning", "lamp.lit", lamp(without="kind: effect"), lamp(without="goes_out")),
    ("never-changes", "warning", "lamp.on", lamp(without="switch"), lamp(without="switch_on")),
    ("never-changes", "warning", "lamp.wear", lamp(without="renew"), lamp()),
    (
        "never-changes",
        "warning",
        "side",
        lamp(decision=SIDE),
        lamp(decision=SIDE, transitions=controlled("t", "true", "side: any")),
    ),
    (
        *("never-changes", "warning", "side"),
        operation("effects: {side: right}", decision=SIDE),
        operation("effects: {side: right}, goal: lamp.lit", decision=SIDE),
    ),
    (
        *("never-produced", "warning", "t"),
        lamp(transitions=controlled("t", "room == gone", "room: dark")),
        lamp(transitions=controlled("t", "room == bright", "room: dark")),
    ),
    (
        *("never-produced", "warning", "lamp.switch_on"),
        lamp(without="lights_up", lamp=effect("fades", "lit", "lit: on")),
        lamp(without="lights_up", lamp=effect("fades", "wear == 1", "lit: on")),
    ),
    (
        *("never-produced", "warning", "i"),
        intention("start: lamp.on, goal: room == dark, formula: room != gone"),
        intention("start: lamp.on, goal: room == dark, formula: room != bright"),
    ),
    (
        *("never-produced", "warning", "o"),
        operation(f"guard: how == off, {BRIGHT}", decision=HOW),
        operation(f"guard: how == dim, {BRIGHT}", decision=HOW),
    ),
    ("no-maintenance", "warning", "lamp", lamp(without="renew"), lamp()),
    (
        *("no-maintenance", "warning", "lamp"),
        lamp(without="renew"),
        lamp(without="renew", transitions="t: {kind: maintenance, actions: {lamp.wear: 0}}"),
    ),
]

INVARIANTS = [
    (
        "initial-forbidden",
        "error",
        "i",
        lamp(invariants="i: lamp.on or lamp.lit"),
        lamp(invariants="i: not lamp.on or not lamp.lit"),
    ),
    (
        *("initial-forbidden", "error", "i"),
        lamp(invariants="i: lamp.wear == 0", lamp=automatic("ages", "not lit", "wear: 1")),
        lamp(invariants="i: lamp.wear == 0", lamp=automatic("ages", "lit", "wear: 1")),
    ),
    (
        *("nothing-allowed", "error", "on"),
        lamp(invariants=("young: lamp.wear < 3", "on: lamp.on", "off: not lamp.on")),
        lamp(invariants=("young: lamp.wear < 3", "on: lamp.on", "off: not lamp.on or lamp.lit")),
    ),
]

RULES = [*SETTLING, *FIRING, *OPERATIONS, *VALUES, *INVARIANTS]


@pytest.mark.parametrize(
    ("rule", "severity", "name", "broken", "sound"), RULES, ids=[f"{r[0]}-{at}" for at, r in enumerate(RULES)]
)
def test_a_rule_finds_what_breaks_it_and_not_its_neighbour(rule, severity, name, broken, sound):
    assert (rule, severity, name) in {(f.rule, f.severity, f.name) for f in findings_in(language.loads(broken))}
    assert (rule, name) not in {(f.rule, f.name) for f in findings_in(language.loads(sound))}


def test_nothing_is_found_in_the_lamp_itself():
    assert findings_in(language.loads(lamp())) == ()


def test_invariants_that_exclude_each_other_are_told_once():
    (found,) = findings_in(language.loads(lamp(invariants=("young: lamp.wear < 3", "on: lamp.on", "off: not lamp.on"))))
    assert "'on' and 'off'" in found.message


def test_every_rule_has_its_model():
    found = {finding.rule for *_, broken, _ in RULES for finding in findings_in(language.loads(broken))}
    assert found == {rule for rule, *_ in RULES}


def findings_in(model: Model) -> tuple[Finding, ...]:
    with Predicates(domains(model)) as predicates:
        return preflight(model, widen(model.system, predicates.satisfiable), predicates)


def test_findings_say_why_and_show_a_state_near_the_initial_one():
    circle = language.loads(lamp(lamp=(FLIP, FLOP)))
    (found,) = [f for f in findings_in(circle) if f.rule == "does-not-settle"]
    assert found.message == "automatic transitions fire for ever: lamp.flip -> lamp.flop -> lamp.flip"
    assert found.example == {"lamp.on": True, "lamp.wear": 0}
    race = language.loads(lamp(lamp=(FLIP, LATE)))
    (found,) = [f for f in findings_in(race) if f.rule == "order-matters"]
    assert "as declared they lead to lamp.wear = 1, the other way round to lamp.wear = 2" in found.message
    unfit = language.loads(lamp(lamp=controlled("t", "on and wear == 2 and not on", "wear: 0")))
    (found,) = [f for f in findings_in(unfit) if f.name == "lamp.t"]
    assert "'lamp.on and not lamp.on' never holds" in found.message
    stays = language.loads(lamp(lamp=controlled("t", "wear == 2", "wear: 2")))
    (found,) = [f for f in findings_in(stays) if f.name == "lamp.t"]
    assert "it changes nothing" in found.message
    slid = language.loads(
        lamp(invariants=("other: lamp.wear < 3", "i: lamp.wear == 0"), lamp=automatic("ages", "not lit", "wear: 1"))
    )
    (found,) = [f for f in findings_in(slid) if f.rule == "initial-forbidden"]
    assert "may come to violate 'i' by lamp.ages" in found.message


STATES = 700
SYSTEMS = 150


def busy(seed: int) -> System:
    """A generated system with more automatic transitions, and controlled ones that mean nothing."""
    random = Random(seed)
    made = generated.Maker(random)
    made.system()
    ours = [variable for variable in made.variables if variable.kind is not VariableKind.MEASURED]
    for number in range(random.randint(0, 8)):
        variable = random.choice(ours)
        kind = Kind.AUTOMATIC if random.random() < 0.7 else Kind.CONTROLLED
        guard = conjunction(made.atom() for _ in range(random.randint(1, 3)))
        made.add(f"extra.{number}", kind, guard, {variable.name: Const(random.choice(variable.domain.values))})
    return System(tuple(made.variables), tuple(made.transitions), tuple(made.invariants))


@dataclass(frozen=True)
class Known:
    """A small system with the answers that a search of all states gives."""

    system: System
    widened: tuple[Widened, ...]

    @cached_property
    def states(self) -> list[State]:
        return list(product(*(variable.domain.values for variable in self.system.variables)))

    @cached_property
    def allowed(self) -> Callable[[State], object]:
        return meaning(conjunction(one.invariant.predicate for one in self.widened), self.system.index)

    @cached_property
    def automatic(self) -> Steps:
        return Steps(self.system, [t for t in self.system.transitions if t.kind.automatic])

    def settle(self, state: State, among: tuple[Transition, ...] = ()) -> State | None:
        """Where automatic transitions lead, all or some; None if they never settle."""
        automatic = Steps(self.system, among) if among else self.automatic
        seen = {state}
        while step := automatic.automatic(state):
            state = step[1]
            if state in seen:
                return None
            seen.add(state)
        return state

    def never_settling(self) -> tuple[bool, bool]:
        """Whether there is a state that never settles: an allowed one, any one."""
        return tuple(any(self.settle(s) is None for s in self.states if every or self.allowed(s)) for every in (False, True))

    def out_of_order(self) -> set[tuple[str, str]]:
        """Automatic transitions that come first among those which meet, and others that would lead elsewhere."""
        return {
            (next(first.name for first in group.transitions if fire(self.system, first, state)), late.name)
            for group in groups(self.system)
            for state in filter(self.allowed, self.states)
            for late in group.transitions
            for after in fire(self.system, late, state)
            if self.settle(state) != self.settle(after)
        }

    def idle(self) -> set[str]:
        """Transitions that fire nowhere; maintenance may fire in forbidden states, and lead into them."""
        steps = Steps(self.system, self.system.transitions)
        fires = {
            transition.name
            for state in self.states
            for transition, after in steps(state)
            if transition.kind is Kind.MAINTENANCE or (self.allowed(state) and self.allowed(after))
        }
        return {transition.name for transition in self.system.transitions} - fires


def known(make: Callable[[int], System], most: int = STATES) -> Iterator[tuple[Known, Scene]]:
    for seed in range(100_000):
        system = make(seed)
        if prod(len(variable.domain.values) for variable in system.variables) <= most:
            with Predicates(Copied(system.domains)) as predicates:
                one = Known(system, widen(system, predicates.satisfiable))
                if any(map(one.allowed, one.states)):
                    yield one, Scene(system, tuple(widened.invariant for widened in one.widened), predicates)


def test_settling_order_and_firing_agree_with_a_search_of_all_states():
    seen = Counter()
    for one, here in islice(known(busy), SYSTEMS):
        found = list(settling(here))
        rules = {(finding.rule, finding.severity) for finding in found}
        inside, anywhere = one.never_settling()
        assert (("does-not-settle", "error") in rules) is inside
        assert any(rule == "does-not-settle" for rule, _ in rules) is anywhere
        assert not any(rule == "not-proved-to-settle" for rule, _ in rules)
        for finding in found:
            shown = here.state(finding.example)
            assert one.allowed(shown) or finding.severity == "warning"
            if finding.rule == "does-not-settle":
                assert one.settle(shown) is None
            else:
                (after,) = fire(one.system, one.system.transition[finding.name], shown)
                (group,) = (g.transitions for g in groups(one.system) if finding.name in {t.name for t in g.transitions})
                ends = [one.settle(state, group) for state in (shown, after)]
                assert None not in ends
                assert ends[0] != ends[1]
        pairs = {tuple(finding.message.split("'")[1:4:2]) for finding in found if finding.rule == "order-matters"}
        if not inside:
            assert pairs == one.out_of_order()
        idle = {finding.name for finding in never_fires(here)}
        assert idle == one.idle()
        seen.update(
            {"circle": inside, "outside": anywhere and not inside, "order": 0 if inside else len(pairs), "idle": len(idle)}
        )
    assert seen["circle"] > 20
    assert seen["outside"] > 3
    assert seen["order"] > 15
    assert seen["idle"] > 100


def test_with_its_extra_guard_a_controlled_transition_leads_just_to_allowed_states():
    seen = Counter()
    for one, here in islice(known(generated.system), SYSTEMS):
        extra = list(extra_guards(here))
        for transition in one.system.transitions:
            if transition.kind is not Kind.CONTROLLED:
                assert transition.name not in {guard.transition for guard in extra}
                continue
            guards = [
                (guard.choice, meaning(guard.guard, one.system.index)) for guard in extra if guard.transition == transition.name
            ]
            for state in filter(one.allowed, one.states):
                for after in fire(one.system, transition, state):
                    reached = one.system.named(after)
                    admitted = all(g(state) for choice, g in guards if choice.items() <= reached.items())
                    assert bool(admitted) is bool(one.allowed(after)), (transition.name, state)
                    seen["steps held back" if guards and not admitted else "steps admitted" if guards else "free steps"] += 1
    assert min(seen["steps held back"], seen["steps admitted"], seen["free steps"]) > 1000, seen


def test_extra_guards_are_simple():
    """What the guard and the invariants say already is not said again."""
    model = language.loads(
        lamp(lamp=BLOWS, invariants=("worn: not (lamp.on and lamp.wear == 3)", "cold: lamp.wear < 3 or not lamp.lit"))
    )
    with Predicates(domains(model)) as predicates:
        extra = list(extra_guards(scene(model, widen(model.system, predicates.satisfiable), predicates)))
    assert [(guard.transition, dict(guard.choice), show(guard.guard)) for guard in extra] == [
        ("lamp.switch_on", {}, "lamp.wear < 3")
    ]


def test_the_growth_of_invariants_is_counted_exactly():
    grown = 0
    for one, _ in islice(known(generated.system), SYSTEMS):
        for told, widened in zip(growth(one.system, one.widened), one.widened, strict=True):
            good, kept = (meaning(p, one.system.index) for p in (widened.declared.predicate, widened.invariant.predicate))
            others = len(one.states) // told.states
            assert told.forbidden * others == sum(not good(state) for state in one.states)
            assert told.added * others == sum(bool(good(state)) and not kept(state) for state in one.states)
            assert told.added >= len(told.growth)
            grown += told.added > 0
    assert grown > 20


def test_counting_gives_up_beyond_its_budget():
    system = generated.system(3)
    names = tuple(variable.name for variable in system.variables)
    pairs = conjunction(negation(equality(Var(a), Var(b))) for a, b in pairwise(names))
    assert count(system, pairs, names, budget=1) is None
