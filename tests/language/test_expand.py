"""Templates, `foreach` and quantified conditions mean what is written out by hand, and their mistakes say which instance."""

from __future__ import annotations

import time
from itertools import product

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from language.marked import unmarked

from smv_planner.errors import ModelError
from smv_planner.language import loads
from smv_planner.language.document import NAME_RULE

SOON = 30.0
"""Seconds. They take one or two; a busy machine is not what is tested."""

HEAD = "smv_planner: 1\nname: cell\n"

ROBOT = """\
templates:
  robot:
    parameters: {poses: , start: home}
    variables:
      ref: {kind: goal,     domain: $poses,             initial: $start}
      act: {kind: measured, domain: [unknown, $poses], initial: $start}
    predicates:
      moving: ref != act
    transitions:
      move_$pose:
        foreach: {pose: $poses}
        kind: controlled
        guard: not moving and ref != $pose
        actions: {ref: $pose}
      arrives: {kind: effect, guard: moving, actions: {act: ref}, within: 15 s}
"""

ABILITY = """\
templates:
  run_nut:
    parameters: [seconds]
    variables:
      run_c:  {kind: goal,     domain: bool, initial: false}
      run_m:  {kind: measured, domain: bool, initial: false}
    predicates:
      enabled:  not run_c and not run_m
      starting: run_c and not run_m
    transitions:
      start: {kind: controlled, guard: enabled and $resource.free, actions: {run_c: true}}
      runs:  {kind: effect, guard: starting, actions: {run_m: true}, within: $seconds s}
"""


SAME = [
    (
        "a template with what it is given",
        ROBOT + "resources:\n  r1: {template: robot, with: {poses: [home, b1]}}",
        """
resources:
  r1:
    variables:
      ref: {kind: goal,     domain: [home, b1],          initial: home}
      act: {kind: measured, domain: [unknown, home, b1], initial: home}
    predicates: {moving: ref != act}
    transitions:
      move_home: {kind: controlled, guard: not moving and ref != home, actions: {ref: home}}
      move_b1:   {kind: controlled, guard: not moving and ref != b1,   actions: {ref: b1}}
      arrives:   {kind: effect, guard: moving, actions: {act: ref}, within: 15 s}
""",
    ),
    (
        "a resource that uses a template and adds to it",
        ROBOT
        + """
resources:
  r1:
    silent_after: 1 s
    transitions: {park: {kind: controlled, guard: not moving and free, actions: {ref: away}}}
    use: [{template: robot, with: {poses: [away, b1], start: b1}}]
    predicates: {free: act == b1}
""",
        """
resources:
  r1:
    silent_after: 1 s
    variables:
      ref: {kind: goal,     domain: [away, b1],          initial: b1}
      act: {kind: measured, domain: [unknown, away, b1], initial: b1}
    predicates: {moving: ref != act, free: act == b1}
    transitions:
      move_away: {kind: controlled, guard: not moving and ref != away, actions: {ref: away}}
      move_b1:   {kind: controlled, guard: not moving and ref != b1,   actions: {ref: b1}}
      arrives:   {kind: effect, guard: moving, actions: {act: ref}, within: 15 s}
      park:      {kind: controlled, guard: not moving and free, actions: {ref: away}}
""",
    ),
    (
        "an ability used twice, each under a name of its own",
        ABILITY
        + """
resources:
  nr:
    use: [{template: run_nut, as: tighten, with: {seconds: 10}}, {template: run_nut, as: loosen, with: {seconds: 5}}]
    predicates: {free: not tighten.run_c and not loosen.run_c, enabled: tighten.enabled or loosen.enabled}
""",
        """
resources:
  nr:
    variables:
      tighten.run_c:  {kind: goal,     domain: bool, initial: false}
      tighten.run_m:  {kind: measured, domain: bool, initial: false}
      loosen.run_c:  {kind: goal,     domain: bool, initial: false}
      loosen.run_m:  {kind: measured, domain: bool, initial: false}
    predicates:
      tighten.enabled:  not tighten.run_c and not tighten.run_m
      tighten.starting: tighten.run_c and not tighten.run_m
      loosen.enabled:  not loosen.run_c and not loosen.run_m
      loosen.starting: loosen.run_c and not loosen.run_m
      free: not tighten.run_c and not loosen.run_c
      enabled: tighten.enabled or loosen.enabled
    transitions:
      tighten.start: {kind: controlled, guard: tighten.enabled and free, actions: {tighten.run_c: true}}
      tighten.runs:  {kind: effect, guard: tighten.starting, actions: {tighten.run_m: true}, within: 10 s}
      loosen.start: {kind: controlled, guard: loosen.enabled and free, actions: {loosen.run_c: true}}
      loosen.runs:  {kind: effect, guard: loosen.starting, actions: {loosen.run_m: true}, within: 5 s}
""",
    ),
    (
        "several resources in one entry",
        ROBOT + "resources:\n  r$i: {foreach: {i: 2..3}, template: robot, with: {poses: [home, b$i, 'b${i+1}']}}",
        ROBOT
        + "resources:\n  r2: {template: robot, with: {poses: [home, b2, b3]}}\n"
        + "  r3: {template: robot, with: {poses: [home, b3, b4]}}",
    ),
    (
        "several uses in one entry",
        ABILITY
        + "resources:\n  nr:\n    use: [{foreach: {n: 1..3}, is: {template: run_nut, as: nut_$n, with: {seconds: $n}}}]\n"
        + "    predicates: {free: 'true'}",
        ABILITY
        + "resources:\n  nr:\n    use:\n"
        + "".join(f"    - {{template: run_nut, as: nut_{n}, with: {{seconds: {n}}}}}\n" for n in (1, 2, 3))
        + "    predicates: {free: 'true'}",
    ),
    (
        "two templates that agree on something",
        "templates: {a: {silent_after: 1 s}, b: {silent_after: 1 s}}\nresources: {r: {use: [a, b]}}",
        "resources: {r: {silent_after: 1 s}}",
    ),
    (
        "what is passed may hold placeholders of its own place, lists and conditions",
        """
templates:
  gate:
    parameters: [ready, moves]
    variables: {open: {kind: goal, domain: bool, initial: false}}
    transitions:
      open: {kind: controlled, guard: $ready, actions: $moves}
      shut: {kind: controlled, guard: not $ready, actions: {open: false}}
resources:
  g$i:
    foreach: {i: 1..2}
    template: gate
    with: {ready: {any: part_$j_at_$i, foreach: {j: 1..2}}, moves: {open: true, part_1_at_$i: false}}
decision: {part_$j_at_$i: {foreach: {i: 1..2, j: 1..2}, domain: bool, initial: false}}
""",
        """
resources:
  g1:
    variables: {open: {kind: goal, domain: bool, initial: false}}
    transitions:
      open: {kind: controlled, guard: part_1_at_1 or part_2_at_1, actions: {open: true, part_1_at_1: false}}
      shut: {kind: controlled, guard: not (part_1_at_1 or part_2_at_1), actions: {open: false}}
  g2:
    variables: {open: {kind: goal, domain: bool, initial: false}}
    transitions:
      open: {kind: controlled, guard: part_1_at_2 or part_2_at_2, actions: {open: true, part_1_at_2: false}}
      shut: {kind: controlled, guard: not (part_1_at_2 or part_2_at_2), actions: {open: false}}
decision:
  part_1_at_1: {domain: bool, initial: false}
  part_2_at_1: {domain: bool, initial: false}
  part_1_at_2: {domain: bool, initial: false}
  part_2_at_2: {domain: bool, initial: false}
""",
    ),
    (
        "what is inserted into an expression stays together",
        """
templates: {t: {parameters: [c], predicates: {p: not $c and b}}}
decision: {a: {domain: bool, initial: true}, b: {domain: bool, initial: true}}
resources: {r: {template: t, with: {c: a or b}}}
""",
        """
decision: {a: {domain: bool, initial: true}, b: {domain: bool, initial: true}}
resources: {r: {predicates: {p: not (a or b) and b}}}
""",
    ),
    (
        "a list inside an expression",
        """
templates:
  t:
    parameters: {near: [b, c]}
    variables: {at: {kind: measured, domain: [a, $near, d], initial: a}}
    predicates: {close: "at in {$near}"}
resources: {r: {template: t}}
""",
        """
resources:
  r:
    variables: {at: {kind: measured, domain: [a, b, c, d], initial: a}}
    predicates: {close: "at in {b, c}"}
""",
    ),
]

BITS = "decision:\n" + "".join(f"  bit_{n}: {{domain: bool, initial: false}}\n" for n in range(1, 5))


def bits(one, other):
    return (one.strip().replace("\n", " ")[:60], BITS + one, BITS + other)


SAME += [
    bits(
        "invariants:\n  i_$a_$b: {foreach: {a: 1..3, b: [4, 1]}, where: $a != $b, is: bit_$a or bit_$b}",
        "invariants: {i_1_4: bit_1 or bit_4, i_2_4: bit_2 or bit_4, i_2_1: bit_2 or bit_1, "
        "i_3_4: bit_3 or bit_4, i_3_1: bit_3 or bit_1}",
    ),
    bits(
        'invariants:\n  "next_${i}": {foreach: {i: 1..4}, where: $i >= 2 and $i < 4, is: "bit_${i-1} -> bit_${ i + 1 }"}',
        "invariants: {next_2: bit_1 -> bit_3, next_3: bit_2 -> bit_4}",
    ),
    bits(
        "predicates: {none: {all: not bit_$i, foreach: {i: 1..4}}}",
        "predicates: {none: not bit_1 and not bit_2 and not bit_3 and not bit_4}",
    ),
    bits(
        "predicates: {p: {any: bit_$i and bit_1, foreach: {i: 1..2}}}", "predicates: {p: (bit_1 and bit_1) or (bit_2 and bit_1)}"
    ),
    bits(
        "predicates: {p: {all: [bit_1 or bit_2, {any: [bit_3, {all: [bit_4, bit_1]}]}, {any: bit_$i, foreach: {i: 1..2}}]}}",
        "predicates: {p: (bit_1 or bit_2) and (bit_3 or bit_4 and bit_1) and (bit_1 or bit_2)}",
    ),
    bits(
        "predicates: {p: {any: {all: bit_$i or bit_$j, foreach: {j: 1..2}}, foreach: {i: 3..4}}}",
        "predicates: {p: ((bit_3 or bit_1) and (bit_3 or bit_2)) or ((bit_4 or bit_1) and (bit_4 or bit_2))}",
    ),
    bits("predicates: {p: {all: [{foreach: {i: 1..2}, is: bit_$i}, bit_4]}}", "predicates: {p: bit_1 and bit_2 and bit_4}"),
    bits(
        "predicates: {p: {all: bit_$i, foreach: {i: 1..0}}, q: {any: bit_$i, foreach: {i: 1..0}}}",
        "predicates: {p: 'true', q: 'false'}",
    ),
    bits(
        "predicates: {$x_$i: {foreach: {x: [p, q], i: 1..2}, is: {all: [bit_$i, bit_3]}}}",
        "predicates: {p_1: bit_1 and bit_3, p_2: bit_2 and bit_3, q_1: bit_1 and bit_3, q_2: bit_2 and bit_3}",
    ),
    bits(
        "transitions: {set: {kind: controlled, actions: {foreach: {i: 1..3}, bit_$i: not bit_$i}}}",
        "transitions: {set: {kind: controlled, actions: {bit_1: not bit_1, bit_2: not bit_2, bit_3: not bit_3}}}",
    ),
    bits(
        "transitions: {s: {kind: controlled, actions: {bit_4: true, bit_$i: {foreach: {i: 1..2}, is: {any: [bit_$i, bit_3]}}}}}",
        "transitions: {s: {kind: controlled, actions: {bit_4: true, bit_1: bit_1 or bit_3, bit_2: bit_2 or bit_3}}}",
    ),
    bits(
        "operations: {o_$i: {foreach: {i: 1..2}, retries: $i, outcomes: "
        "{r_$j: {foreach: {j: 3..4}, effects: {bit_$i: bit_$j}}}}}",
        "operations: {o_1: {outcomes: {r_3: {effects: {bit_1: bit_3}}, r_4: {effects: {bit_1: bit_4}}}, retries: 1}, "
        "o_2: {outcomes: {r_3: {effects: {bit_2: bit_3}}, r_4: {effects: {bit_2: bit_4}}}, retries: 2}}",
    ),
    bits(
        "intentions: {i: {start: {all: [bit_1, bit_2]}, goal: bit_3, "
        "formula: {all: 'G (bit_$i -> F bit_4)', foreach: {i: 1..2}}}}",
        "intentions: {i: {start: bit_1 and bit_2, goal: bit_3, formula: '(G (bit_1 -> F bit_4)) and (G (bit_2 -> F bit_4))'}}",
    ),
    bits(
        "  at: {domain: [none, {foreach: {i: 1..3}, is: p$i}], from: {p$i: {foreach: {i: 1..3}, is: bit_$i}, otherwise: none}}",
        "  at: {domain: [none, p1, p2, p3], from: {p1: bit_1, p2: bit_2, p3: bit_3, otherwise: none}}",
    ),
    bits("  all: {from: {any: [bit_1, bit_2]}}", "  all: {from: bit_1 or bit_2}"),
]


@pytest.mark.parametrize(("short", "long"), [pytest.param(short, long, id=name) for name, short, long in SAME])
def test_what_is_written_once_means_what_is_written_out(short, long):
    assert loads(HEAD + short).hash == loads(HEAD + long).hash


def test_twenty_four_bolts_are_one_entry():
    model = loads(
        HEAD
        + """
decision:
  bolt_$i: {foreach: {i: 1..24}, domain: [empty, placed, tight], initial: empty}
transitions:
  place: {kind: maintenance, actions: {foreach: {i: 1..24}, bolt_$i: placed}, instruction: Place 24 bolts.}
operations:
  tighten_$i: {foreach: {i: 1..24}, guard: bolt_$i == placed, effects: {bolt_$i: tight}}
intentions:
  assemble: {start: "true", goal: {all: bolt_$i == tight, foreach: {i: 1..24}}}
"""
    )
    bolts = [f"bolt_{i}" for i in range(1, 25)]
    written = (
        "decision:\n"
        + "".join(f"  {bolt}: {{domain: [empty, placed, tight], initial: empty}}\n" for bolt in bolts)
        + "transitions:\n  place:\n    kind: maintenance\n    instruction: Place 24 bolts.\n    actions:\n"
        + "".join(f"      {bolt}: placed\n" for bolt in bolts)
        + "operations:\n"
        + "".join(f"  tighten_{i}: {{guard: bolt_{i} == placed, effects: {{bolt_{i}: tight}}}}\n" for i in range(1, 25))
        + "intentions:\n  assemble:\n    start: true\n    goal: "
        + " and ".join(f"{bolt} == tight" for bolt in bolts)
    )
    assert model.hash == loads(HEAD + written).hash


WORDS = st.lists(st.sampled_from("abcdefg"), unique=True, max_size=4)


@settings(deadline=None)
@given(pools=st.lists(WORDS, min_size=1, max_size=3))
def test_all_combinations_come_in_order_the_last_name_running_fastest(pools):
    names = [f"n{at}" for at in range(len(pools))]
    foreach = ", ".join(f"{name}: [{', '.join(pool)}]" for name, pool in zip(names, pools, strict=True))
    key = "_".join(f"${name}" for name in names)
    model = loads(HEAD + f"decision:\n  v_{key}: {{foreach: {{{foreach}}}, domain: bool, initial: false}}\n")
    assert [variable.name for variable in model.variables] == ["_".join(["v", *each]) for each in product(*pools)]


@settings(deadline=None)
@given(low=st.integers(-30, 30), more=st.integers(-1, 20), added=st.integers(0, 9))
def test_ranges_hold_both_ends_and_can_be_counted_with(low, more, added):
    high = low + more
    model = loads(HEAD + BITS + f'invariants:\n  "i${{n+{added}}}": {{foreach: {{n: {low}..{high}}}, is: bit_1}}\n')
    assert [each.name for each in model.invariants] == [f"i{n + added}" for n in range(low, high + 1)]


def case(text, *messages):
    return pytest.param(HEAD + text + "\n", messages, id=" ".join(text.split())[-70:])


def in_robot(old, new, *messages, by="{r1: {template: robot, with: {poses: [home, b1]}}}"):
    assert old in ROBOT
    return case(ROBOT.replace(old, new, 1) + f"resources: {by}", *messages)


def used(text, *messages):
    return case(ROBOT + "resources:\n  r1: " + text, *messages)


def repeated(text, *messages):
    return case(BITS + "invariants:\n  i_$a: " + text, *messages)


def condition(text, *messages):
    return case(BITS + "predicates:\n  p: " + text, *messages)


R1 = "in template 'robot' for resource 'r1'"
WHERE = "unknown key 'where' (known here: kind, domain, initial)"
COMPARE = "write $a != $b, or several of == != < <= > >= joined by 'and'"

MISTAKES = [
    in_robot(
        "guard: not moving and ref != $pose",
        "guard: not «movng» and ref != $pose",
        f"unknown variable 'movng' in the guard of 'move_home' "
        f"({R1}, pose = home, and in 1 more instance; did you mean 'moving'?)",
    ),
    in_robot(
        "actions: {ref: $pose}",
        "actions: {«reff»: $pose}",
        f"unknown variable 'reff' ({R1}, pose = home, and in 1 more instance; did you mean 'ref'?)",
    ),
    in_robot(
        "ref != $pose\n",
        "act == «${pose}s»\n",
        f"'homes' is neither a value of 'r1.act', which is {{unknown, home, b1}}, nor a variable in the guard of 'move_home' "
        f"({R1}, pose = home, and in 1 more instance; did you mean 'home'?)",
    ),
    in_robot("15 s", "«15 sec»", f"'15 sec' is not a duration ({R1}; write '500 ms', '1.5 s', '1 min' or '1 h')"),
    in_robot("within", "«witin»", f"unknown key 'witin' ({R1}; did you mean 'within'?)"),
    in_robot(
        "start: home",
        "start: «hom»",
        f"'hom' is not in the domain, which is {{home, b1}} ({R1}, and in 1 more instance; did you mean 'home'?)",
    ),
    in_robot("ref != act", "«$reff» != act", f"unknown placeholder '$reff' ({R1}; known here: $resource, $start, $poses)"),
    in_robot("ref != act", "«$stat» != act", f"unknown placeholder '$stat' ({R1}; did you mean 'start'?)"),
    in_robot("ref != act", "«${start+1}» != act", f"'$start' is 'home', not a whole number ({R1})"),
    in_robot("ref != act", "«${start*2}» != act", f"'${{start*2}}' is not a placeholder ({R1}; write ${{name}} or ${{name+1}})"),
    in_robot(
        "foreach: {pose: $poses}",
        "foreach: {«start»: $poses}",
        f"'$start' has a meaning here already ({R1}; take another name: letters, digits and '_')",
    ),
    in_robot(
        "move_$pose:",
        "«move»:",
        f"two instances have the name 'move' ({R1}, pose = b1; put $pose into the name)",
    ),
    in_robot("{poses: , start: home}", "«poses»", "expected a list [name, ...] or a mapping {name: default, ...}", by="{}"),
    in_robot(
        "{poses: , start: home}",
        "[«1», «resource», a, «a»]",
        "expected the name of a parameter (letters, digits and '_', not a digit first)",
        "'resource' always stands for the name of the resource",
        "'a' is here twice",
        by="{}",
    ),
    in_robot("    variables:", "    «use»: [a]\n    variables:", "'use' stands in a template (templates do not use templates)"),
    in_robot("    variables:", "    «varables»: {}\n    variables:", "unknown key 'varables' (did you mean 'variables'?)"),
    used("{template: «robt», with: {poses: [a]}}", "unknown template 'robt' (did you mean 'robot'?)"),
    used("{template: «robot»}", "the template 'robot' needs 'poses' (write with: {poses: ...})"),
    used("{use: [«robot»]}", "the template 'robot' needs 'poses' (write with: {poses: ...})"),
    used("{template: robot, with: {«pose»: [a]}}", "the template 'robot' has no parameter 'pose' (did you mean 'poses'?)"),
    used("{template: robot, with: {poses: [home], «x»: 1}}", "the template 'robot' has no parameter 'x' (it has poses, start)"),
    used("{template: robot, with: «[a]»}", "expected a mapping {parameter: value, ...}"),
    used("{template: robot, «use»: [], with: {poses: [home]}}", "'use' stands beside 'template' (list all templates in 'use')"),
    used("{use: [«{with: {poses: [home]}}»]}", "'template' is missing"),
    used("{use: [«[robot]»]}", "expected a mapping {template: ..., with: ..., as: ...}"),
    used("{use: [{template: robot, as: a, «wth»: 1, with: {poses: [home]}}]}", "unknown key 'wth' (did you mean 'with'?)"),
    used("{template: robot, as: «2», with: {poses: [home]}}", "'2' is not a name (" + NAME_RULE + ")"),
    used("{template: robot, with: {poses: [home, «2»]}}", f"'2' is not a name ({R1}; {NAME_RULE})"),
    used("{«with»: {}}", "'with' stands without 'template' (an entry of 'use' has its own)"),
    used("{use: [], «as»: x}", "'as' stands without 'template' (an entry of 'use' has its own)"),
    used("{variables: {v: {kind: goal, domain: bool, initial: true, «where»: x}}}", WHERE),
    used("{«templat»: x}", "unknown key 'templat' (did you mean 'template'?)"),
    used(
        "{template: robot, with: {poses: [home]}, predicates: {«moving»: act == home}}",
        f"'moving' is here twice (the other one is in line 10, {R1})",
    ),
    used(
        "{template: robot, with: {poses: [home]}, predicates: {«ref»: act == home}}",
        f"there is a variable or predicate 'r1.ref' already (the other one is in line 7, {R1})",
    ),
    case("«templats»: {a: {}}\nresources: {r: {template: a}}", "unknown key 'templats' (did you mean 'templates'?)"),
    case(
        "templates: «[robot]»\nresources: {r: {template: robot}}",
        "expected a mapping with a name before each ':' (templates: {NAME: {...}})",
    ),
    case(
        "templates: {a: {silent_after: 1 s}, b: {«silent_after»: 2 s}}\nresources: {r: {use: [a, b]}}",
        "'silent_after' is here twice "
        "(in template 'b' for resource 'r'; the other one is in line 3, in template 'a' for resource 'r')",
    ),
    case(
        "templates: {t: {variables: «[a]»}}\nresources: {r: {template: t, variables: {v: {}}, predicates: {p: a}}}",
        "expected a mapping with a name before each ':', not a list (in template 't' for resource 'r')",
    ),
    case(
        "templates: {t: {predicates: {«p»: 'true'}}}\nresources: {r: {use: [{template: t, as: a}, {template: t, as: a}]}}",
        "'a.p' is here twice (in template 't' as 'a' for resource 'r'; "
        "the other one is in line 3, in template 't' as 'a' for resource 'r')",
    ),
    case(
        BITS + "operations: {o: {guard: «{foreach: {i: 1..4}, is: bit_$i}», effects: {}}}",
        "expected an expression, not a mapping (write {all: ..., foreach: ...} or {any: ..., foreach: ...})",
    ),
    case("resources: {r: {use: }}"),
    repeated("{foreach: «3», is: bit_1}", "expected {name: 1..9} or {name: [a, b]}"),
    repeated("{foreach: «{}», is: bit_1}", "expected {name: 1..9} or {name: [a, b]}"),
    repeated("{foreach: {a: «4..1»}, is: bit_1}", "4..1 counts downwards (write 1..4)"),
    repeated("{foreach: {a: «1-3»}, is: bit_1}", "expected numbers 1..9 or a list [a, b]"),
    repeated("{foreach: {a: [1, «[2]»]}, is: bit_1}", "expected a word or a number"),
    repeated(
        "{foreach: {a: 1..3, «a-b»: 1..2}, is: bit_$a}",
        "'a-b' cannot be a placeholder (take another name: letters, digits and '_')",
    ),
    repeated("{«foreach»: {a: 1..3}}", "'is' is missing beside 'foreach' (write {foreach: ..., is: ...})"),
    repeated("{foreach: {a: 1..3}, is: bit_$a, «were»: x}", "unknown key 'were' (did you mean 'where'?)"),
    repeated("{foreach: {a: 1..3}, is: «$b»}", "unknown placeholder '$b' (a = 1, and in 2 more instances; known here: $a)"),
    repeated(
        '{foreach: {a: 1..3}, is: "bit_1 or «bit_${a+4}»"}',
        "unknown variable 'bit_5' in the invariant 'i_1' (a = 1, and in 2 more instances; did you mean 'bit_4'?)",
    ),
    repeated("{foreach: {a: 1..3}, where: «$a», is: bit_$a}", f"'1' is not a comparison (a = 1; {COMPARE})"),
    repeated("{foreach: {a: 1..2}, where: «$a == 1 == 1», is: bit_1}", f"'1 == 1 == 1' is not a comparison (a = 1; {COMPARE})"),
    repeated(
        "{foreach: {a: [x, y]}, where: «$a < 3», is: bit_1}",
        "'x < 3' is not a comparison (a = x; only whole numbers are smaller or larger)",
    ),
    repeated("{foreach: {a: 1..2}, where: «$b» == 1, is: bit_1}", "unknown placeholder '$b' (a = 1; known here: $a)"),
    condition(
        "{all: bit_$i and «bit_9», foreach: {i: 1..4}}",
        "unknown variable 'bit_9' in the predicate 'p' (i = 1, and in 3 more instances; did you mean 'bit_4'?)",
    ),
    condition(
        "{all: [bit_1, {any: [bit_2, «bit_5»]}]}",
        "unknown variable 'bit_5' in the predicate 'p' (did you mean 'bit_4'?)",
    ),
    condition("{all: [bit_1«)» or (bit_2]}", "there is no '(' before this ')'"),
    condition("{any: ['bit_1 and«'», bit_2]}", "expected a condition after 'and'"),
    condition("«{all: bit_1}»", "'all' needs a list or 'foreach'"),
    condition("{all: bit_$i, foreach: {i: 1..2}, «foreac»: 1}", "unknown key 'foreac' (did you mean 'foreach'?)"),
    condition("{all: [bit_1, «{x: y}»]}", "expected an expression"),
    condition("«{x: y}»", "expected an expression, not a mapping (quote an expression that starts with '{')"),
    condition("bit_1 or «$x»", "unknown placeholder '$x' (write $$ for a dollar sign)"),
]


def found(text):
    try:
        loads(text)
    except ModelError as error:
        return [(_said(each), each.place.line, each.place.column, each.place.length) for each in error.mistakes]
    return []


def _said(mistake):
    """What a mistake says, without its place and the line of the text."""
    return str(mistake).split("\n")[0].removeprefix(f"{mistake.place}: ")


@pytest.mark.parametrize(("text", "messages"), MISTAKES)
def test_a_mistake_says_where_it_is_written_and_in_which_instance(text, messages):
    plain, places = unmarked(text)
    assert found(plain) == [(message, *place) for message, place in zip(messages, places, strict=True)]


def test_a_dollar_sign_is_written_twice():
    text = "transitions: {m: {kind: maintenance, actions: {bit_1: true}, instruction: 'Pay 5 $$ or $$x, or 5 $ for 1 $.'}}"
    (transition,) = loads(HEAD + BITS + text).transitions
    assert transition.instruction == "Pay 5 $ or $x, or 5 $ for 1 $."


@pytest.mark.parametrize("quote", ["", "'", '"', ">\n        ", "|\n        "])
def test_places_behind_a_placeholder_are_right_however_yaml_writes_the_text(quote):
    end = quote if quote in ("'", '"') else ""
    text = f"predicates:\n  p_$a_$b:\n    foreach: {{a: [bit_1], b: [bit_2]}}\n    is: {quote}$a or not $b and bit_5 or $b{end}\n"
    ((message, line, column, length),) = found(HEAD + BITS + text)
    assert message == "unknown variable 'bit_5' in the predicate 'p_bit_1_bit_2' (a = bit_1, b = bit_2; did you mean 'bit_4'?)"
    assert (HEAD + BITS + text).split("\n")[line - 1][column - 1 : column - 1 + length] == "bit_5"


# Texts that would become very large. Each is refused, and soon.

BIT = "decision: {bit: {domain: bool, initial: true}}\n"
LARGE = {
    "nested quantifiers": BIT
    + "predicates: {p: {all: {all: {all: bit, foreach: {k: 1..200}}, foreach: {j: 1..200}}, foreach: {i: 1..200}}}",
    "28 nested quantifiers": BIT
    + "predicates: {p: "
    + "{all: " * 28
    + "bit"
    + "".join(f", foreach: {{i{n}: 1..9}}}}" for n in range(28))
    + "}",
    "a template of foreach for foreach": "templates:\n  t:\n    variables:\n"
    + "      v$i: {foreach: {i: 1..1000}, kind: goal, domain: bool, initial: true}\n"
    + "resources: {r$j: {foreach: {j: 1..1000}, template: t}}",
    "a large product": BIT + "invariants: {i$a$b$c: {foreach: {a: 1..999999999, b: 1..999999999, c: 1..999999999}, is: bit}}",
    "a product of which nothing is wanted": BIT
    + "invariants: {i$a$b: {foreach: {a: 1..400, b: 1..400}, where: $a == x, is: bit}}",
    "a large text in many places": "templates: {t: {parameters: [p], predicates: {q$i: {foreach: {i: 1..1000}, is: a or $p}}}}\n"
    + f"resources: {{r: {{template: t, with: {{p: {'x' * 100_000}}}}}}}",
    "a text without placeholders in many places": BIT
    + f"predicates: {{q$i: {{foreach: {{i: 1..1000}}, is: {' and '.join(['bit'] * 1000)}}}}}",
    "a long list in many places": "templates:\n  t:\n    parameters: [p]\n    variables:\n"
    + "      v$i: {foreach: {i: 1..1000}, kind: goal, domain: $p, initial: w1}\n"
    + f"resources: {{r: {{template: t, with: {{p: [{', '.join(f'w{n}' for n in range(10_000))}]}}}}}}",
    "a long list for nothing": "templates:\n  t:\n    parameters: [p]\n    variables:\n"
    + "      v$i:\n        {foreach: {i: 1..9999}, kind: goal, initial: a, domain: [{foreach: {q: $p, z: 1..0}, is: x}]}\n"
    + f"resources: {{r: {{template: t, with: {{p: [{', '.join(f'w{n}' for n in range(30_000))}]}}}}}}",
    "placeholders of nothing": "templates:\n  t:\n    parameters: [p]\n    transitions:\n"
    + "      q$i: {foreach: {i: 1..99999}, kind: effect, instruction: "
    + "$p" * 200_000
    + "}\nresources: {r: {template: t, with: {p: ''}}}",
    "many parameters in many places": f"templates: {{t: {{parameters: {{{', '.join(f'p{n}: {n}' for n in range(20_000))}}}}}}}\n"
    + "resources: {r$j: {foreach: {j: 1..9999}, template: t}}",
    "one operation in many places": BIT + "operations: {o: {effects: {bit: true}}}\nsequence: [{foreach: {i: 1..150000}, do: o}]",
}


@pytest.mark.parametrize("text", LARGE.values(), ids=LARGE)
def test_what_would_become_too_large_is_refused_soon(text):
    started = time.process_time()
    (message, *_), *_ = found(HEAD + text)
    assert any(limit in message for limit in ("200000", "2000000", "longer than 100000")), message
    assert time.process_time() - started < SOON


@pytest.mark.parametrize("name", ["_" * 900_000, "x" + "_" * 900_000, "x_" * 400_000], ids=lambda name: name[:3])
def test_a_long_placeholder_is_just_unknown(name):
    started = time.process_time()
    ((message, *_),) = found(HEAD + BIT + f"predicates: {{p: bit or ${name}}}")
    assert message.startswith("unknown placeholder")
    assert time.process_time() - started < SOON


def test_the_limit_names_the_instance():
    text = "resources: {r$j: {foreach: {j: 1..1000}, variables: {v$i: {foreach: {i: 1..1000}, kind: goal, domain: bool}}}}"
    ((message, *_),) = found(HEAD + text)
    assert message == "written out, the scenario has more than 200000 entries (j = 29, i = 313; repeat less)"
