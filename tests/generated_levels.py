"""Small generated models with two levels: devices below, products and operations above. The same seed, the same model."""

from __future__ import annotations

from dataclasses import dataclass, replace
from random import Random

from generated import Maker

from smv_planner.model import ltl
from smv_planner.model.domains import Bool, Enum
from smv_planner.model.expressions import TRUE, Const, Expr, Named, Var, conjunction, equality, negation
from smv_planner.model.ltl import Atom
from smv_planner.model.model import Copy, Intention, Model, Operation, Outcome, Resource
from smv_planner.model.system import Any, Assignment, Kind, Variable, VariableKind

STATES = Enum(("raw", "held", "done"))


def model(seed: int) -> Model:
    """Two or three devices, two or three products, operations between the products' states, one or two intentions."""
    return _Levels(Random(seed)).model()


@dataclass
class _Levels:
    random: Random

    def model(self) -> Model:
        random = self.random
        maker = Maker(random)
        for number in range(random.randint(1, 3)):
            maker.device(f"r{number}")
        self.low = maker
        self.products = [f"part{number}" for number in range(random.randint(2, 3))]
        for name in self.products:
            maker.variable(name, VariableKind.DECISION, STATES, "raw")
        device = random.choice([v for v in maker.variables if v.kind is VariableKind.MEASURED])
        self.copy = Copy("away", Bool(), negation(equality(Var(device.name), Const(device.initial))))
        operations = [self.operation(name, a, b) for name in self.products for a, b in (("raw", "held"), ("held", "done"))]
        if random.random() < 0.5:
            operations.append(self.operation(self.products[0], "done", "raw", name="undo"))
        if random.random() < 0.4:
            goal = equality(self.copied(), Const(True))
            outcome = Outcome(None, (Assignment("away", Const(True)),), self.copy.value)
            operations.append(Operation("leave", negation(goal), (outcome,)))
        intentions = [self.intention(f"i{number}") for number in range(random.choice((1, 1, 2)))]
        return Model(
            name="generated",
            resources=tuple(Resource(name) for name in dict.fromkeys(self.owner(v) for v in maker.variables) if name),
            variables=tuple(self.owned(v) for v in maker.variables),
            copies=(self.copy,),
            predicates={},
            transitions=tuple(maker.transitions),
            invariants=tuple(maker.invariants),
            operations=tuple(operations),
            intentions=tuple(intentions),
        )

    def owner(self, variable: Variable) -> str | None:
        return variable.name.partition(".")[0] if "." in variable.name else None

    def owned(self, variable: Variable) -> Variable:
        return replace(variable, resource=self.owner(variable))

    def copied(self) -> Expr:
        return Named(self.copy.name, self.copy.value)

    def device_state(self) -> Expr:
        devices = [v for v in self.low.variables if v.kind is VariableKind.MEASURED]
        chosen = self.random.sample(devices, min(len(devices), self.random.choice((1, 1, 2))))
        return conjunction(self.low.about(device) for device in chosen)

    def operation(self, product: str, before: str, after: str, name: str | None = None) -> Operation:
        random = self.random
        name = name or f"{product}-{after}"
        guard = [equality(Var(product), Const(before))]
        if random.random() < 0.15:
            guard.append(negation(equality(Var(random.choice(self.products)), Const(random.choice(STATES.words)))))
        if random.random() < 0.1:
            guard.append(self.copied() if random.random() < 0.5 else negation(self.copied()))
        effects = (Assignment(product, Const(after)),)
        if random.random() < 0.15:  # brought about by an interaction, not by a completion (Industry 4.0, Example 5)
            self.low.add(f"make-{name}", Kind.AUTOMATIC, conjunction([*guard, self.device_state()]), {product: Const(after)})
            return Operation(name, conjunction(guard), (Outcome(None, effects, None),))
        if random.random() < 0.2:
            other = Outcome("bad", (Assignment(product, Const("raw" if before != "raw" else "done")),), self.device_state())
            return Operation(name, conjunction(guard), (Outcome("good", effects, self.device_state()), other))
        fixed = [t for t in self.low.transitions if not any(isinstance(action.value, Any) for action in t.actions)]
        controlled = [t for t in fixed if t.kind is Kind.CONTROLLED]
        synchronised = random.choice(controlled).name if controlled and random.random() < 0.2 else None
        return Operation(name, conjunction(guard), (Outcome(None, effects, self.device_state()),), synchronised=synchronised)

    def intention(self, name: str) -> Intention:
        random = self.random
        chosen = random.sample(self.products, random.randint(1, len(self.products)))
        wanted = [equality(Var(product), Const("done")) for product in chosen]
        if random.random() < 0.1:
            wanted.append(self.copied())
        formula = None
        if random.random() < 0.4:
            product = random.choice(self.products)
            held = Atom(equality(Var(product), Const("held")))
            atom = Atom(negation(conjunction([equality(Var(p), Const("held")) for p in self.products[:2]])))
            formula = random.choice((atom, ltl.eventually(held), ltl.always(atom), ltl.weak_until(negated_done(product), held)))
        return Intention(name, TRUE, conjunction(wanted), formula, ())


def negated_done(product: str) -> ltl.Formula:
    return Atom(negation(equality(Var(product), Const("done"))))
