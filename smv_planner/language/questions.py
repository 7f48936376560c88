"""What a question says in the language of scenarios: goals, formulas, settings. Every full name may be used."""

from __future__ import annotations

from collections.abc import Iterator

from smv_planner.errors import Mistake, Place, UsageError
from smv_planner.language.expressions import Asking, Name, Scope, Typed, assigned_of, formula_of, measured, predicate_of
from smv_planner.language.reader import bare, closest
from smv_planner.model.domains import Bool, Value
from smv_planner.model.expressions import Const, Expr
from smv_planner.model.ltl import Formula
from smv_planner.model.model import Model


def predicate(model: Model, text: str, source: str = "--goal") -> Expr:
    """A condition on the state. `source` names the text in messages."""
    question = _Question(model, text, source)
    part = predicate_of(question.asking(text))
    question.check()
    assert part
    return part.expr


def formula(model: Model, text: str, source: str = "--formula") -> Formula:
    """A condition on the run, with or without `G F X U R W`."""
    question = _Question(model, text, source)
    part = formula_of(question.asking(text))
    question.check()
    assert part
    return part


def setting(model: Model, text: str, source: str = "--set") -> tuple[str, Value]:
    """A variable's full name and the value that `VAR=VALUE` gives it."""
    word, sign, written = text.partition("=")
    written = written.removeprefix("=")
    question = _Question(model, text, source)
    start, end = len(word) - len(word.lstrip()), max(len(word.rstrip()), 1)
    name = question.scope.find(bare(word.strip()))
    if not sign:
        question.wrong("expected VARIABLE=VALUE", None, (0, max(len(text), 1)))
    elif name is None:
        question.wrong(
            f"unknown variable '{word.strip()}'",
            closest(word.strip(), [each.name for each in model.variables]),
            (start, end),
        )
    elif name.kind == "copy":
        question.wrong(f"'{name.full}' is a measured copy and cannot be set", "set what it is measured from", (start, end))
    elif name.kind == "predicate":
        question.wrong(f"'{name.full}' is a predicate and cannot be set", "set the variables that it reads", (start, end))
    question.check()
    assert name
    part = assigned_of(question.asking(written, len(text) - len(written)), name, may_choose=False)
    question.check()
    if isinstance(part, Typed) and isinstance(part.expr, Const):
        return name.full, part.expr.value
    question.wrong("expected a value, not an expression", None, (len(text) - len(written), len(text)))
    raise question.error


def scope(model: Model) -> Scope:
    """Every full name that a text about a model may use."""
    return Scope({name.full: name for name in _names(model)})


class _Question:
    """A text about a model, and what is wrong with it so far."""

    def __init__(self, model: Model, text: str, source: str) -> None:
        self.text, self.source = text, source
        self.scope = scope(model)
        self._mistakes: list[Mistake] = []

    def asking(self, text: str, offset: int = 0) -> Asking:
        """Read the part of the whole text that begins at `offset`."""

        def complain(message: str, hint: str | None, at: tuple[int, int]) -> None:
            self.wrong(message, hint, (at[0] + offset, at[1] + offset))

        return Asking(text, self.scope, complain)

    def wrong(self, message: str, hint: str | None, at: tuple[int, int]) -> None:
        where = Place(self.source, 1, at[0] + 1, max(1, at[1] - at[0]), self.text)
        self._mistakes.append(Mistake(message, hint, where))

    @property
    def error(self) -> UsageError:
        return UsageError(sorted(self._mistakes, key=lambda each: each.place.column if each.place else 0))

    def check(self) -> None:
        if self._mistakes:
            raise self.error


def _names(model: Model) -> Iterator[Name]:
    for variable in model.variables:
        yield Name(variable.name, variable.domain, variable.kind)
    for copy in model.copies:
        yield Name(copy.name, copy.domain, "copy", measured(copy.value, copy.domain))
    for name, expr in model.predicates.items():
        yield Name(name, Bool(), "predicate", measured(expr, Bool()))
