"""Every rule of the language, with the message that its violation gives, and where.

Each case is what stands below DEVICE, with a mark at the place of each message. That these are all the messages says as
well that no mistake has others in its wake.
"""

from __future__ import annotations

import pytest
from language.marked import DEVICE, expected, mistakes

RULE = "letters, digits, '_' and inner '-', with at least one letter between dots"
FOREIGN = "a variable of a resource; here only decision variables count (give it a name under 'decision', with 'from')"
POS = "{closed, opened, jammed}"


def case(text, *messages):
    return pytest.param(text, messages, id=text.replace("\n", " ")[:60])


def transition(text, *messages):
    return case(f"transitions:\n  t: {{{text}}}", *messages)


def operation(text, *messages):
    return case(f"operations:\n  o: {{{text}}}", *messages)


def intention(text, *messages):
    return case(f"intentions:\n  i: {{{text}}}", *messages)


def guard(text, *messages):
    return case(f"invariants:\n  i: {text}", *messages)


def variable(text, *messages):
    return case(f"  x: {{{text}}}", *messages)


NAMES = [
    case("predicates:\n  «d.pos»: d.lock", "there is a variable or predicate 'd.pos' already (the other one is in line 6)"),
    case("predicates:\n  «state»: d.lock", "there is a variable or predicate 'state' already (the other one is in line 16)"),
    case("  «d.moving»: {from: d.lock}", "there is a variable or predicate 'd.moving' already (the other one is in line 12)"),
    case(
        "transitions:\n  «d.go»: {kind: controlled, actions: {state: seen}}",
        "there is a transition 'd.go' already (full names of transitions are unique)",
    ),
    case("operations:\n  go: {effects: {}}\n  d.go: {effects: {}}"),
    case("predicates:\n  not: d.lock\n  MODULE: '`not`'\n  U: MODULE\n  läge-2: U"),
    case(
        "predicates:\n  «a b»: d.lock\n  «1.x»: d.lock\n  «2-3»: d.lock\n  «x-»: d.lock",
        *(f"'{name}' is not a name ({RULE})" for name in ("a b", "1.x", "2-3", "x-")),
    ),
    case(
        "operations:\n  o: {outcomes: {«a.b»: {effects: {}}}}",
        f"'a.b' is not a name without dots ({RULE})",
    ),
    case(
        f"predicates:\n  «{'x' * 201}»: d.lock",
        f"'{'x' * 37}...' is longer than 200 characters ({RULE})",
    ),
]

DOMAINS = [
    variable("domain: bool, initial: false"),
    variable("domain: {min: -1, max: 1}, initial: -1"),
    variable("domain: [on, off, in], initial: in"),
    variable(
        "domain: «bol», initial: false",
        "expected 'bool' or a list [a name, ...] or a mapping {min: ..., max: ...}, not 'bol' (did you mean 'bool'?)",
    ),
    variable("domain: «[]», initial: a", "this domain is empty (name its values)"),
    variable("domain: «{min: 2, max: 1}», initial: 1", "this domain is empty: min 2 is larger than max 1"),
    variable("domain: {min: 0, max: 4095}, initial: 1"),
    variable(
        "domain: «{min: 0, max: 4096}», initial: 1", "this domain has 4097 values; the limit is 4096 (count in larger steps)"
    ),
    variable(f"domain: [{', '.join(f'w{n}' for n in range(1024))}], initial: w0"),
    variable(
        f"domain: «[{', '.join(f'w{n}' for n in range(1025))}]», initial: w0",
        "this domain has 1025 values; the limit is 1024",
    ),
    variable("domain: [a, «a»], initial: a", "the value 'a' is here twice"),
    variable("domain: [a, «true»], initial: a", "'true' cannot be a value among others (write 'domain: bool')"),
    variable(
        "domain: [«1», «half open»], initial: a",
        f"'1' is not a name ({RULE})",
        f"'half open' is not a name ({RULE})",
    ),
    variable(
        "domain: {min: «a», max: «1.5»}, initial: 1",
        "expected a whole number from -2147483647 to 2147483647, not 'a'",
        "expected a whole number from -2147483647 to 2147483647, not '1.5'",
    ),
    variable(
        "domain: {min: 0, max: «9999999999»}, initial: 1",
        "expected a whole number from -2147483647 to 2147483647, not '9999999999'",
    ),
    case("  «x»: {initial: a}", "'domain' is missing in 'x'"),
    case("  «x»: {domain: bool}", "'initial' is missing in 'x' (every variable without 'from' starts with a value)"),
    variable(
        "domain: [waiting, seen], initial: «waitin»",
        "'waitin' is not in the domain, which is {waiting, seen} (did you mean 'waiting'?)",
    ),
    variable("domain: {min: 0, max: 3}, initial: «4»", "'4' is not in the domain, which is a number 0..3"),
]

COPIES = [
    case("  x: {from: d.pos == opened}"),
    case("  x: {domain: [closed, opened, jammed], from: d.pos}"),
    case("  x: {domain: {min: -1, max: 4}, from: d.wear + 1}"),
    case("  x: {domain: [a, b, c], from: {a: d.lock, b: home, otherwise: 'c'}}"),
    case("  x: {domain: bool, from: {true: d.lock, otherwise: false}}"),
    case("  x: {domain: {min: 0, max: 9}, from: {1: d.lock, 3: home, otherwise: 0}}"),
    case("  x: {from: «d.pos»}", f"expected a condition, but 'd.pos' is {POS}"),
    case("  x: {domain: [closed], from: «d.pos»}", "this may lie outside the domain, which is {closed}"),
    case("  x: {domain: {min: 0, max: 3}, from: «d.wear + 1»}", "this may lie outside the domain, which is a number 0..3"),
    case("  x: {domain: [a, b], from: «d.pos»}", f"'d.pos' is {POS}, but 'x' is {{a, b}}"),
    case("  x: {domain: [a, b], «from»: {a: d.lock}}", "'otherwise' is missing (it is the value when no condition holds)"),
    case(
        "  x: {domain: [a, b], from: {«c»: d.lock, b: «d.wear», otherwise: «d»}}",
        "'c' is not in the domain, which is {a, b}",
        "expected a condition, but 'd.wear' is a number 0..3",
        "'d' is not in the domain, which is {a, b}",
    ),
    case("  «x»: {from: {a: d.lock, otherwise: b}}", "'domain' is missing in 'x'"),
    case("  x: {from: d.lock, «initial»: true}", "'x' is a measured copy: 'from' gives its value (remove 'initial')"),
    case(
        f"  x: {{domain: {{min: 0, max: 99}}, from: «{{{', '.join(f'{n}: d.lock' for n in range(64))}, otherwise: 0}}»}}",
        "these conditions are too many or too large (at most 63)",
    ),
]

CIRCLES = [
    case("predicates:\n  «p»: p", "'p' is defined by itself: p -> p (break the circle)"),
    case(
        "  x: {from: q}\npredicates:\n  «r»: s\n  s: r or q\n  q: r\n  t: q",
        "'r' is defined by itself: r -> s -> r (break the circle)",
    ),
    case("  «x»: {from: not y}\n  y: {from: x}", "'x' is defined by itself: x -> y -> x (break the circle)"),
    case("predicates:\n  opened: d.pos == opened"),
]

ASSIGNMENTS = [
    transition("kind: effect, actions: {d.pos: jammed, d.done: true}"),
    transition("kind: controlled, actions: {d.ref: any, d.wear: d.wear - 1, state: seen}"),
    transition("kind: automatic, actions: {d.ref: d.pos, d.lock: not d.done}"),
    transition("kind: maintenance, actions: {d.pos: any, d.ref: closed, state: seen}, instruction: Push."),
    transition(
        "kind: effect, actions: {«d.ref»: closed, «d.wear»: 0, «state»: seen}",
        "an effect assigns measured variables, and 'd.ref' is of kind 'goal'",
        "an effect assigns measured variables, and 'd.wear' is of kind 'estimated'",
        "an effect assigns measured variables, and 'state' is of kind 'decision'",
    ),
    transition(
        "kind: controlled, actions: {«d.pos»: closed}",
        "a controlled transition assigns goal, estimated and decision variables, and 'd.pos' is of kind 'measured'",
    ),
    transition(
        "kind: automatic, actions: {«d.pos»: «any»}",
        "an automatic transition assigns goal, estimated and decision variables, and 'd.pos' is of kind 'measured'",
        "'any' is for controlled and maintenance transitions only (write the value)",
    ),
    transition(
        "kind: maintenance, actions: {«home»: true, «d.moving»: true}",
        "'home' is a measured copy and is not assigned here (it follows from what it is measured from)",
        "'d.moving' is a predicate and is not assigned here",
    ),
    transition("kind: controlled, actions: {«ref»: closed}", "unknown variable 'ref' (did you mean 'd.ref'?)"),
    case(
        "transitions:\n  «t»: {kind: controlled}\n  «u»: {kind: controlled, actions: {}}",
        "'t' changes nothing (give it 'actions')",
        "'u' changes nothing (give it 'actions')",
    ),
    transition(
        "kind: controlled, actions: {d.ref: «jammed», d.lock: «closed», d.wear: «true»}",
        "'jammed' is neither a value of 'd.ref', which is {closed, opened}, nor a variable",
        "'closed' is neither a value of 'd.lock', which is bool, nor a variable",
        "'true' is not a value of 'd.wear', which is a number 0..3",
    ),
    transition(
        "kind: controlled, actions: {d.lock: «d.wear», d.wear: «7»}",
        "'d.wear' is a number 0..3, but 'd.lock' is bool",
        "'7' is not a value of 'd.wear', which is a number 0..3",
    ),
    transition(
        "kind: controlled, actions: {d.lock: «on»}",
        "'on' is neither a value of 'd.lock', which is bool, nor a variable (write true)",
    ),
    transition("kind: controlled, actions: {d.ref: «state»}", "'state' is {waiting, seen}, but 'd.ref' is {closed, opened}"),
    transition(
        "kind: controlled, actions: {d.ref: closed, «'`d.ref`'»: opened}",
        "'d.ref' is here twice (the other one is in line 19)",
    ),
    transition(
        "kind: effect, guard: d.lock == «any», actions: {d.done: true}",
        "'any' is neither a value of 'd.lock', which is bool, nor a variable in the guard of 't' "
        "('any' is only what a controlled or maintenance transition may assign)",
    ),
]

BY_KIND = [
    transition("kind: effect, actions: {d.done: true}, within: 1.5 s, expected: false"),
    transition(
        "kind: controlled, actions: {d.lock: true}, «within»: 2 s", "'within' is for effects only, and this one is controlled"
    ),
    transition(
        "kind: automatic, actions: {d.lock: true}, «expected»: true", "'expected' is for effects only, and this one is automatic"
    ),
    transition(
        "kind: effect, actions: {d.done: true}, «instruction»: Push.",
        "'instruction' is for maintenance transitions only, and this one is effect",
    ),
    transition(
        "kind: «effects», actions: {d.done: true}",
        "expected one of controlled, automatic, effect, maintenance, not 'effects' (did you mean 'effect'?)",
    ),
    case("transitions:\n  «t»: {actions: {d.done: true}}", "'kind' is missing in 't'"),
    transition(
        "kind: effect, actions: {d.done: true}, within: «2»", "'2' is not a duration (write '500 ms', '1.5 s', '1 min' or '1 h')"
    ),
    transition(
        "kind: effect, actions: {d.done: true}, within: «2 sec»",
        "'2 sec' is not a duration (write '500 ms', '1.5 s', '1 min' or '1 h')",
    ),
    transition("kind: effect, actions: {d.done: true}, within: «0 ms»", "a duration is longer than nothing"),
    transition("kind: effect, actions: {d.done: true}, expected: «no»", "expected true or false, not 'no' (write false)"),
    transition(
        'kind: effect, actions: {d.done: true}, expected: «"true"»',
        "expected true or false, not 'true' (write it without quotes)",
    ),
    transition(
        "kind: effect, actions: {d.done: true}, «durring»: 2 s",
        "unknown key 'durring' (known here: kind, guard, actions, within, expected, instruction, reenable)",
    ),
    transition("kind: effect, actions: {d.done: true}, «witin»: 2 s", "unknown key 'witin' (did you mean 'within'?)"),
]

OPERATIONS = [
    operation(
        "guard: state == waiting and home, effects: {state: seen, home: false}, goal: d.pos == opened and not d.moving, "
        "with: d.go, on_start: {state: waiting}, retries: 3"
    ),
    operation("outcomes: {good: {effects: {state: seen}, goal: home}, bad: {effects: {}, goal: d.wear == 3}}"),
    case("operations:\n  «o»: {goal: d.lock}", "'o' has neither 'effects' nor 'outcomes'"),
    operation(
        "«effects»: {state: seen}, «goal»: d.lock, outcomes: {a: {effects: {}}}",
        "'effects' stands beside 'outcomes' (each outcome has its own)",
        "'goal' stands beside 'outcomes' (each outcome has its own)",
    ),
    operation("«outcomes»: {}", "there are no outcomes (name them, or give 'effects')"),
    operation(
        "outcomes: {a: {effects: {}, goal: home}, «b»: {effects: {}}}",
        "'goal' is missing in 'b' (either every outcome has one, or none)",
    ),
    operation("outcomes: {«a»: {goal: home}}", "'effects' is missing in 'a'"),
    operation(
        "guard: «d.lock», effects: {state: seen}",
        f"'d.lock' is {FOREIGN}",
    ),
    operation(
        "guard: «d.moving», effects: {state: seen}",
        f"'d.moving' reads 'd.ref', {FOREIGN}",
    ),
    operation("effects: {«d.ref»: closed}", "only decision variables are assigned here, and 'd.ref' is of kind 'goal'"),
    operation(
        "effects: {state: seen, home: «d.lock»}",
        f"'d.lock' is {FOREIGN}",
    ),
    operation("effects: {state: «any»}", "'any' is for controlled and maintenance transitions only (write the value)"),
    operation(
        "effects: {}, goal: «state» == seen",
        "'state' is a decision variable; the goal of an operation is over variables of resources",
    ),
    operation(
        "effects: {}, on_start: {«home»: true}",
        "'home' is a measured copy and is not assigned here (it follows from what it is measured from)",
    ),
    operation("effects: {}, with: «d.g»", "unknown transition 'd.g' (did you mean 'd.go'?)"),
    case(
        "transitions:\n  t: {kind: controlled, actions: {state: seen}}\noperations:\n  o: {«effects»: {state: waiting}, with: t}",
        "'o' and the transition 't' that completes with it both assign 'state'",
    ),
    operation("effects: {}, retries: «-1»", "expected a whole number from 0 to 1000000, not '-1'"),
]

INTENTIONS = [
    intention("start: d.lock and home, goal: state == seen, formula: G home -> F state == seen, actions: {state: waiting}"),
    case("intentions:\n  «i»: {goal: home}", "'start' is missing in 'i'"),
    case("intentions:\n  «i»: {start: home}", "'goal' is missing in 'i'"),
    intention(
        "start: home, goal: «d.lock», formula: G «d.lock»",
        *2 * [f"'d.lock' is {FOREIGN}"],
    ),
    intention(
        "start: home, goal: home, actions: {«home»: false, «d.lock»: true}",
        "'home' is a measured copy and is not assigned here (it follows from what it is measured from)",
        "only decision variables are assigned here, and 'd.lock' is of kind 'goal'",
    ),
    intention("start: G «home», goal: home", "expected an operator between 'G' and 'home' ('G' is an operator in formulas only)"),
]

WORDS = [
    guard("d.pos == opened and 'closed' != d.ref and d.ref in {opened}"),
    guard(
        "d.pos == «open»",
        f"'open' is neither a value of 'd.pos', which is {POS}, nor a variable in the invariant 'i' (did you mean 'opened'?)",
    ),
    guard("d.pos == «'open'»", f"'open' is not a value of 'd.pos', which is {POS} (did you mean 'opened'?)"),
    guard("«opened» == closed", "unknown variable 'opened' in the invariant 'i'"),
    guard("not «opend»", "unknown variable 'opend' in the invariant 'i'"),
    guard("d.lock == «'true'»", "'true' is not a value of 'd.lock', which is bool"),
    guard("«d.wear-1» == 2", "unknown variable 'd.wear-1' in the invariant 'i' ('-' is part of a name: write d.wear - 1)"),
    guard(
        "d.wear == «d.wear-d.wear» + 1",
        "unknown variable 'd.wear-d.wear' in the invariant 'i' ('-' is part of a name: write d.wear - d.wear)",
    ),
    guard(
        "«mowing» or «d.lck»",
        "unknown variable 'mowing' in the invariant 'i' (did you mean 'd.moving'?)",
        "unknown variable 'd.lck' in the invariant 'i' (did you mean 'd.lock'?)",
    ),
    guard("«lock»", "unknown variable 'lock' in the invariant 'i' (did you mean 'd.lock'?)"),
    case(
        "  opened: {domain: bool, initial: true}\ninvariants:\n  i: d.pos == «opened»",
        "'opened' is a value of 'd.pos' and also the variable 'opened' "
        "(write 'opened' with quotes for the value, `opened` for the variable)",
    ),
    case("  opened: {domain: bool, initial: true}\ninvariants:\n  i: d.pos == 'opened' and opened and `opened` == true"),
    case(
        "  d.opened: {domain: [opened], initial: opened}\ninvariants:\n  i: d.pos == opened and d.pos == d.opened",
    ),
    guard(
        "«state == d.pos»",
        f"'state' is {{waiting, seen}} and 'd.pos' is {POS} have no value in common",
    ),
]

TYPES = [
    guard("d.wear + 1 - d.wear >= -2 and -d.wear < 3"),
    guard("d.lock == d.done and (d.lock <-> home) == true"),
    guard(
        "not «d.pos» == closed",
        f"expected a condition, but 'd.pos' is {POS} ('not' binds tighter than '==': write not (a == b))",
    ),
    guard("not d.lock == d.done"),
    guard(
        "«d.pos» and «d.wear» or «3» -> «'x'»",
        f"expected a condition, but 'd.pos' is {POS}",
        "expected a condition, but 'd.wear' is a number 0..3",
        "expected a condition, but '3' is a number",
        "the value 'x' has no variable opposite it (names are quoted with backticks: `name`)",
    ),
    guard("«d.lock == 3»", "cannot compare 'd.lock', which is bool, with '3', which is a number"),
    guard("«d.pos» < 3", f"expected a whole number beside '<', but 'd.pos' is {POS}"),
    guard("3 <= «d.lock»", "expected a whole number beside '<=', but 'd.lock' is bool"),
    guard("«d.lock» + 1 == 2", "expected a whole number, but 'd.lock' is bool"),
    guard("0 < d.wear «<» 3", "comparisons do not chain (write a < b and b < c)"),
    guard("«d.wear + 2147483647» > 3", "the result may lie outside -2147483647..2147483647"),
    guard("d.wear > «2147483648»", "2147483648 is too large (the largest number is 2147483647)"),
    guard(
        '"«d.wear in {0, -1, true»}"',
        "cannot compare 'd.wear', which is a number 0..3, with 'true', which is bool",
    ),
    guard("«d.wear»", "expected a condition, but 'd.wear' is a number 0..3"),
]

ALL = [*NAMES, *DOMAINS, *COPIES, *CIRCLES, *ASSIGNMENTS, *BY_KIND, *OPERATIONS, *INTENTIONS, *WORDS, *TYPES]


@pytest.mark.parametrize(("text", "messages"), ALL)
def test_a_violated_rule_is_reported_where_it_is_violated(text, messages):
    plain, found = expected(DEVICE + text + "\n", *messages)
    assert mistakes(plain) == found
