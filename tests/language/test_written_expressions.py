"""Expressions and formulas as text: how tightly operators bind, what is no expression, and the way there and back."""

from __future__ import annotations

from itertools import product

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from language.marked import unmarked

from smv_planner.errors import UsageError
from smv_planner.language import formula, loads, predicate
from smv_planner.model.expressions import And, Const, Equal, Less, Minus, Named, Not, Or, Plus, Var, meaning, show
from smv_planner.model.ltl import Atom, Both, Either, Next, Release, Until, holds, show_formula

MODEL = loads(
    """\
smv_planner: 1
name: test
resources:
  d:
    variables:
      p: {kind: goal, domain: bool, initial: true}
      q: {kind: goal, domain: bool, initial: true}
      r: {kind: goal, domain: bool, initial: true}
      x: {kind: goal, domain: {min: -1, max: 1}, initial: 0}
      y: {kind: goal, domain: {min: 0, max: 2}, initial: 0}
      a: {kind: measured, domain: [home, away, lost], initial: home}
      b: {kind: goal, domain: [home, away], initial: home}
    predicates:
      there: a == b
decision:
  G:   {domain: bool, initial: false}
  tidy: {from: d.there and not G}
"""
)
INDEX = MODEL.system.index
STATES = tuple(product(*(variable.domain.values for variable in MODEL.variables)))
SOME = STATES[::37]


def same(one, other):
    a, b = meaning(one, INDEX), meaning(other, INDEX)
    return all(a(state) == b(state) for state in STATES)


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("not d.p and d.q", "(not d.p) and d.q"),
        ("not d.p == d.q", "(not d.p) == d.q"),
        ("! d.p & d.q | d.r", "((not d.p) and d.q) or d.r"),
        ("d.p or d.q and d.r", "d.p or (d.q and d.r)"),
        ("d.p <-> d.q or d.r", "d.p <-> (d.q or d.r)"),
        ("d.p -> d.q <-> d.r", "d.p -> (d.q <-> d.r)"),
        ("d.p -> d.q -> d.r", "d.p -> (d.q -> d.r)"),
        ("d.p <-> d.q <-> d.r", "(d.p <-> d.q) <-> d.r"),
        ("d.x - d.y - 1 == -2", "((d.x - d.y) - 1) == -2"),
        ("- d.x + d.y > 0", "((0 - d.x) + d.y) > 0"),
        ("d.x + 1 in {0, d.y}", "(d.x + 1 == 0) or (d.x + 1 == d.y)"),
        ("d.x in {0, 1} == d.p", "(d.x == 0 or d.x == 1) == d.p"),
        ("d.p == d.x in {0, 1}", "d.p == (d.x == 0 or d.x == 1)"),
        ("d.a in {home, 'away'}", "d.a == home or d.a == away"),
        ("home == d.a and d.a != d.b", "d.a == home and not (d.a == d.b)"),
        ("d.x=d.y", "d.x == d.y"),
        ("d.x<=d.y&d.x>=0", "not (d.y < d.x) and not (d.x < 0)"),
        ("d.x+1 > d.y", "d.x + 1 > d.y"),
        ("`d.p` or G", "d.p or `G`"),
        ("(((d.there)))", "d.there"),
        ("d.p\n  and\t d.q", "d.p and d.q"),
        ("tidy", "d.there and not G"),
    ],
)
def test_operators_bind_as_in_smv(text, meant):
    assert same(predicate(MODEL, text), predicate(MODEL, meant))


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("G d.a == home", "G (d.a == home)"),
        ("not G d.p", "not (G d.p)"),
        ("G d.p and d.q", "(G d.p) and d.q"),
        ("G d.p U d.q", "(G d.p) U d.q"),
        ("d.p U d.q and d.r", "(d.p U d.q) and d.r"),
        ("d.p U d.q U d.r", "(d.p U d.q) U d.r"),
        ("F G d.p -> X d.q R d.r", "(F (G d.p)) -> ((X d.q) R d.r)"),
        ("d.x + 1 == d.y U d.a in {home}", "(d.x + 1 == d.y) U (d.a in {home})"),
        ("d.p W d.q", "(G d.p) or (d.p U d.q)"),
        ("F d.p <-> G d.q", "(F d.p and G d.q) or (not F d.p and not G d.q)"),
        ("d.p and F d.q and d.r and X d.p", "(d.p and d.r) and (F d.q and X d.p)"),
        ("not (d.p U `G`)", "not d.p R not `G`"),
    ],
)
def test_temporal_operators_bind_between_comparisons_and_conjunction(text, meant):
    one, other = formula(MODEL, text), formula(MODEL, meant)
    runs = [SOME[at : at + length] for at in range(len(SOME) - 4) for length in (1, 2, 4)]
    assert all(holds(one, run, INDEX) == holds(other, run, INDEX) for run in runs)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("d.p ==«»", "expected a value after '=='"),
        ("d.p and«»", "expected a condition after 'and'"),
        ("«and» d.p", "expected an expression, not 'and'"),
        ("d.p or «)»", "expected a condition after 'or', not ')'"),
        ("d.p «d.q»", "expected an operator between 'd.p' and 'd.q'"),
        ("d.p «AND» d.q", "expected an operator between 'd.p' and 'AND' (write 'and')"),
        ("d.p & «&» d.q", "expected a condition after '&', not '&' (write 'and' or '&')"),
        ("d.p = «>» d.q", "expected a value after '=', not '>' (write '->')"),
        ("«(»d.p and (d.q)", "this '(' is never closed"),
        ("d.p and d.q«)»", "there is no '(' before this ')'"),
        ("(d.p«}»", "there is no '{' before this '}'"),
        ("d.x in «d.y»", "expected '{' after 'in', not 'd.y' (write in {a, b})"),
        ("d.x in {1 «2»}", "expected ',' or '}' after '1', not '2'"),
        ("d.x in {«}»", "expected a value after '{', not '}'"),
        ("d.x in «{»1, 2", "this '{' is never closed"),
        ("d.a == «in»", "expected a value after '==', not 'in' (quote it if it is a value, 'in', or a name, `in`)"),
        ("d.a == «'»home", "this ' is never closed"),
        ("«`»d.p", "this ` is never closed"),
        ("«`d p`»", "`d p` is not a name (letters, digits, '_' and inner '-', with at least one letter between dots)"),
        ('d.a == «"»home"', "unexpected '\"' (write values in single quotes)"),
        ("d.x «*» 2 == 0", "unexpected '*' (there is no such operator)"),
        ("d.x == «1.5»", "'1.5' is neither a name nor a number (numbers are whole)"),
        ("d.x == «2-1»", "'2-1' is neither a name nor a number (write 2 - 1)"),
        ("d.x == «007»", "'007' is neither a name nor a number (write 7)"),
        ("«d.1» == 2", "'d.1' is neither a name nor a number (a name needs a letter between dots)"),
        ("d.x < d.y «<» 3", "comparisons do not chain (write a < b and b < c)"),
        ("G «d.p»", "expected an operator between 'G' and 'd.p' ('G' is an operator in formulas only)"),
        ("«»", "expected an expression, but there is nothing"),
        ("  «»", "expected an expression, but there is nothing"),
        ("d.a == «any»", "'any' is neither a value of 'd.a', which is {home, away, lost}, nor a variable "
         "('any' is only what a controlled or maintenance transition may assign)"),
    ],
)  # fmt: skip
def test_what_is_no_expression_is_explained_where_it_stops_being_one(text, message):
    assert refusal(predicate, text) == (unmarked(text)[0], message, unmarked(text)[1])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("d.p U d.q «R» d.r", "'U' and 'R' are mixed (put parentheses around one of them: (a U b) R c)"),
        ("G«»", "expected a condition after 'G'"),
        ("d.p == «U» d.q", "expected a value after '==', not 'U' (quote it if it is a value, 'U', or a name, `U`)"),
        ("(«G d.p») == d.q", "expected a value, but 'G d.p' is a temporal formula"),
        ("G «d.x»", "expected a condition, but 'd.x' is a number -1..1"),
    ],
)
def test_what_is_no_formula_is_explained(text, message):
    assert refusal(formula, text) == (unmarked(text)[0], message, unmarked(text)[1])


def refusal(read, text):
    """The text without marks, the only message, and the marks where the message points."""
    plain, marks = unmarked(text)
    with pytest.raises(UsageError) as caught:
        read(MODEL, plain)
    [mistake] = caught.value.mistakes
    assert mistake.place
    message = f"{mistake.message} ({mistake.hint})" if mistake.hint else mistake.message
    place = [(mistake.place.line, mistake.place.column, mistake.place.length)]
    if not plain.strip():  # nothing to point at
        place = marks
    return plain, message, place


numbers = st.recursive(
    st.integers(-3, 3).map(Const) | st.sampled_from([Var("d.x"), Var("d.y")]),
    lambda inner: st.builds(Plus, inner, inner) | st.builds(Minus, inner, inner),
    max_leaves=4,
)
words = st.sampled_from(
    [Equal(Var("d.a"), Var("d.b"))]
    + [Equal(Var(name), Const(word)) for name in ("d.a", "d.b") for word in ("home", "away")]
    + [Equal(Const("lost"), Var("d.a"))]
)
conditions = st.recursive(
    st.booleans().map(Const)
    | st.sampled_from([Var("d.p"), Var("G"), *(Named(name, expr) for name, expr in MODEL.predicates.items())])
    | st.just(Named("tidy", MODEL.copies[0].value))
    | words
    | st.builds(Less, numbers, numbers)
    | st.builds(Equal, numbers, numbers),
    lambda inner: (
        st.builds(Not, inner)
        | st.builds(Equal, inner, inner)
        | st.lists(inner, min_size=2, max_size=3).map(lambda parts: And(tuple(parts)))
        | st.lists(inner, min_size=2, max_size=3).map(lambda parts: Or(tuple(parts)))
    ),
    max_leaves=8,
)


@settings(max_examples=150, deadline=None)
@given(conditions)
def test_a_printed_expression_reads_back_with_the_same_meaning(expr):
    assert same(predicate(MODEL, show(expr)), expr)


formulas = st.recursive(
    # `G` is an operator here, and `show` does not quote it
    conditions.filter(lambda expr: "G" not in show(expr).replace("(", " ").replace(")", " ").split()).map(Atom),
    lambda inner: st.builds(Next, inner) | st.one_of([st.builds(kind, inner, inner) for kind in (Both, Either, Until, Release)]),
    max_leaves=5,
)


@settings(max_examples=100, deadline=None)
@given(formulas, st.lists(st.sampled_from(STATES), min_size=1, max_size=4))
def test_a_printed_formula_reads_back_with_the_same_meaning(written, run):
    assert holds(formula(MODEL, show_formula(written)), run, INDEX) == holds(written, run, INDEX)


PIECES = """d.p d.x d.a home there tidy G F U R W X any true 1 -1 'home' `G` and or not -> <-> == < in
{ } , ( ) + - ! & | = ' ` x-1 é 2-1"""


@settings(max_examples=400, deadline=None)
@given(st.lists(st.sampled_from(PIECES.split()), max_size=12).map(" ".join) | st.text(max_size=20))
def test_any_text_is_an_expression_or_a_mistake(text):
    for read in (predicate, formula):
        places = [mistake.place for mistake in wrong_with(read, text)]
        assert all(place and 1 <= place.column <= len(text) + 1 for place in places)


def wrong_with(read, text):
    try:
        read(MODEL, text)
    except UsageError as error:
        return error.mistakes
    return ()
