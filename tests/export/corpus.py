"""Names that have broken somebody's parser, and problems made of nothing but such names."""

from __future__ import annotations

from random import Random

from smv_planner.export.names import RESERVED
from smv_planner.model.domains import Enum, Range
from smv_planner.model.expressions import Const, Named, Plus, Var, disjunction, equality, negation
from smv_planner.model.system import Assignment, Invariant, Kind, System, Transition, Variable, VariableKind
from smv_planner.problem import Goal, Problem

_WRITTEN = (
    *("", " ", ".", "..", "-", "--", "---", "_", "__", "a.b", "a..b", ".a", "a.", "a__b", "a._b", "a_.b", "_a", "a_"),
    *("x-1", "pos-3", "x - 1", "1", "0", "01", "1e5", "0ub2_10", "f'1/2", "-1", "1..3", "2147483648", "TRUE", "true"),
    *("v_", "v_a", "k_on", "d_x", "t_", "p_p", "m_main", "x_step", "x_idle", "x_done", "x_settled", "x_ready__a", "x_none"),
    *("z", "zz", "zx", "zx20_", "zu", "Z", "azb", "step", "idle", "done", "settled", "none", "ready.a", "part.1", "any.2"),
    *("a;b", "a:=b", "a{b}", "a(b)", "a[0]", "a,b", "a|b", "a&b", "!a", "a=b", "a->b", "a$b", "a#b", "a/b", "a\\b", "a@b"),
    *("x; TRANS FALSE", "x : boolean; TRANS FALSE --", "x;\nTRANS FALSE\n--", "\nINIT FALSE\n", "esac; INVAR FALSE;"),
    *("};\nLTLSPEC TRUE", "x -- comment", "/-- x --/", "--/", "/--", '# 1 "file"', "\n#line 1", "MODULE main", "\nMODULE main"),
    *(
        '"',
        '"quoted"',
        "'",
        "'quoted'",
        '";INVAR FALSE;"',
        "`x`",
        "$(id)",
        "`id`",
        "!id",
        "; quit",
        "\nquit\n",
        "%s%n",
        "{{ x }}",
    ),
    *(
        "{% raw %}",
        "{#",
        "#}",
        "<value>",
        "</state>",
        "&lt;",
        "]]>",
        "<!ENTITY a 'b'>",
        "<?xml?>",
        "&#0;",
        "a\tb",
        "a\rb",
        "a\0b",
    ),
    *("\n", "\r\n", "\t", "\x00", "\x1a", "\x7f", "\x80", "\u2028", "\ufeff", "\u202eabc", "é", "ß", "İ", "ı", "ａ", "变量"),
    *("🤖", "🤖.🔧", "\ud800", "a\u0301", "á", "Ω", "Ω", "x" * 200, "x" * 201, "x." * 150 + "x", "é" * 300, "-" * 250),
    *("case", "esac", "next(x)", "init(x)", "self.x", "x.y.z", "a.TRANS", "TRANS.a", "x[self]", "running", "process.x"),
)


def names() -> tuple[str, ...]:
    """Every reserved word and at least 200 others, all different; the same in every run."""
    random = Random(1)
    alphabet = "aZz09_.-/ ;:{}()\"'\n\t\\#$é🤖"
    noise = ("".join(random.choices(alphabet, k=random.randint(1, 30))) for _ in range(60))
    decorated = (change(word) for word in sorted(RESERVED)[::7] for change in (str.lower, "{}.x".format, "a.{}".format))
    return tuple(dict.fromkeys((*sorted(RESERVED), *_WRITTEN, *noise, *decorated)))


def march(names: tuple[str, ...]) -> Problem:
    """A problem whose only plan uses each name once as variable, value, transition, predicate and invariant."""
    at = "how far"
    variables = [Variable(at, VariableKind.ESTIMATED, Range(0, len(names)), 0)]
    transitions, invariants = [], []
    for number, name in enumerate(names):
        words = Enum((f"not {name}", name))
        variables.append(Variable(name, VariableKind.ESTIMATED, words, words.words[0]))
        guard = Named(name, equality(Var(at), Const(number)))
        actions = (Assignment(at, Plus(Var(at), Const(1))), Assignment(name, Const(name)))
        transitions.append(Transition(name, Kind.CONTROLLED, guard, actions))
        named = equality(Var(name), Const(name))
        invariants.append(Invariant(name, disjunction([named, negation(named)])))
    system = System(tuple(variables), tuple(transitions), tuple(invariants))
    goal = Goal(equality(Var(at), Const(len(names))))
    return Problem(system, system.initial, (goal,), system.invariants, bound=len(names))
