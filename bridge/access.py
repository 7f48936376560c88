"""Who may say what in a cell, as Zenoh's access control: everything that is not named here is denied.

A subject is known by the common name of its certificate. What is declared (interest, queryables) has to be allowed as well
as what is sent, on both sides of the router: ingress is from the subject, egress towards it. Access control does not replace
epochs: a planner that was superseded still holds its certificate.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from bridge import keys

PLANNER = "smv-planner"
OPERATOR = "smv-operator"
SPECTATOR = "smv-watch"


def hub_name(resource: str) -> str:
    """The common name in the certificate of a resource's hub."""
    return f"hub-{resource}"


def access_control(cell: str, resources: Iterable[str]) -> dict[str, Any]:
    """For one planner, the hub of each resource, operators and spectators. Emulated hubs cannot be told to fail."""
    told = f"smv_planner/{cell}/*"
    documents = [key(cell) for key in (keys.situation, keys.plan, keys.operator, keys.event, keys.health)]
    asked = [keys.order(cell), *documents]
    rules: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    subjects: list[dict[str, Any]] = []

    def subject(name: str, *allowed: list[dict[str, Any]]) -> None:
        own = [{**rule, "id": f"{name}-{number}"} for number, rule in enumerate(rule for part in allowed for rule in part)]
        rules.extend(own)
        subjects.append({"id": name, "cert_common_names": [name]})
        policies.append({"subjects": [name], "rules": [rule["id"] for rule in own]})

    subject(
        PLANNER,
        _publishes(keys.goals(cell)),
        _hears(keys.state(cell)),
        _publishes(told),
        _answers(*asked),
        _lives(keys.planner(cell)),
    )
    for resource in resources:
        every = keys.state(cell)  # how the planner asks for it
        subject(
            hub_name(resource),
            _publishes(keys.state(cell, resource), every),
            _hears(keys.goal(cell, resource)),
            _lives(keys.alive(cell, resource)),
        )
    subject(OPERATOR, _hears(told), _asks(*asked), _finds(keys.planner(cell)))
    subject(SPECTATOR, _hears(keys.goals(cell)), _hears(keys.state(cell)), _hears(told))
    return {"enabled": True, "default_permission": "deny", "rules": rules, "subjects": subjects, "policies": policies}


def _publishes(key: str, *asked_for_as: str) -> list[dict[str, Any]]:
    return [_rule("ingress", ["put"], key), _rule("egress", ["declare_subscriber"], key, *asked_for_as)]


def _hears(key: str) -> list[dict[str, Any]]:
    return [_rule("ingress", ["declare_subscriber"], key), _rule("egress", ["put"], key)]


def _answers(*asked: str) -> list[dict[str, Any]]:
    return [_rule("ingress", ["declare_queryable", "reply"], *asked), _rule("egress", ["query"], *asked)]


def _asks(*asked: str) -> list[dict[str, Any]]:
    return [_rule("ingress", ["query"], *asked), _rule("egress", ["declare_queryable", "reply"], *asked)]


def _lives(key: str) -> list[dict[str, Any]]:
    return [_rule("ingress", ["liveliness_token"], key)]


def _finds(key: str) -> list[dict[str, Any]]:
    return [_rule("ingress", ["liveliness_query"], key), _rule("egress", ["liveliness_token", "reply"], key)]


def _rule(flow: str, messages: list[str], *key_exprs: str) -> dict[str, Any]:
    return {"id": "", "permission": "allow", "flows": [flow], "messages": messages, "key_exprs": list(key_exprs)}
