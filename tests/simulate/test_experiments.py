"""How planning actions are counted as Table 1 does."""

from __future__ import annotations

import pytest

from smv_planner.errors import UsageError
from smv_planner.runner.decision import Action
from smv_planner.simulate.experiments import TABLE_1, Taken, experiments, taken
from smv_planner.simulate.planning import planners


def action(name: str, reached: bool = True, ordinary: bool = False, seconds: float = 1.0) -> Action:
    return Action(name, reached, "", ordinary, seconds)


def test_planning_that_is_needed_anyway_is_not_counted() -> None:
    assert taken([(action("OP", ordinary=True), action("TP", ordinary=True)), (action("TP", ordinary=True),)]) == ()


def test_a_transition_plan_that_carries_a_new_operation_plan_out_is_counted_with_it() -> None:
    decision = (action("TP w/ETO", reached=False), action("OP w/DO"), action("TP w/ETO", ordinary=True, seconds=2.0))
    assert taken([decision]) == (Taken("TP w/ETO", 1, 1.0), Taken("OP w/DO", 1, 3.0))


def test_an_action_that_is_needed_again_is_counted_with_the_first() -> None:
    first = (action("TP w/RTO", reached=False), action("OP w/DO"))
    later = (action("TP w/RTO", reached=False), action("OP w/DO", reached=False), action("TP w/MT"))
    assert taken([first, later]) == (Taken("TP w/RTO", 2, 2.0), Taken("OP w/DO", 2, 2.0), Taken("TP w/MT", 1, 1.0))


def test_the_table_of_the_paper_adds_up() -> None:
    assert [row.milliseconds for row in TABLE_1] == [223, 181, 1032, 1824, 1587, 2215, 2835, 642, 895]
    assert [row.experiment for row in TABLE_1 if row.operator != "None"] == ["E2", "E4", "E6", "E7"]


def test_a_scenario_without_the_cases_is_refused() -> None:
    with pytest.raises(UsageError, match="no execution case 'e1'"):
        list(experiments({}, planners()))
