"""The planner may die at any moment and goes on from its journal; two planners never mix their commands."""

from __future__ import annotations

from functools import cache

import pytest
from simulate import seeds

from smv_planner.emulation import emulator as emulators
from smv_planner.emulation.behaviour import Behaviour
from smv_planner.runner.situation import Phase, Situation
from smv_planner.simulate.network import Weather
from smv_planner.simulate.observer import Observer
from smv_planner.simulate.process import MemoryDisk
from smv_planner.simulate.sweep import Point, killed, points
from smv_planner.simulate.world import World

LAST_BOLT = {
    **{f"bolt_{at}": "tightened" for at in range(1, 6)},
    "bolt_6": "placed",
    "r1_located": False,
    "r2_located": True,
}
UNTIL = 100.0


def e3() -> World:
    """The connector of r2 does not take the tool; r1 does the job instead (E3 of the paper)."""
    station, memory = seeds.station("assembly_station"), seeds.memory("assembly_station")
    given = {**LAST_BOLT, "r2.ref_pos": "at_tool", "r2.act_pos": "at_tool"}
    world = World(station, memory.planners, 1, given, disk=MemoryDisk(), think=lambda request: (memory(request), (0.05,)))
    for name in world.hubs:
        failing = {"r2_connector.attaches": None} if name == "r2_connector" else {}
        behaviour = Behaviour(delay=0.1, failing=failing)
        world.hubs[name] = emulators.behaving(world.hubs[name], behaviour)
    return world


def done(now: Situation) -> bool:
    """The bolt is tight, the tool hangs, and then the filters are on."""
    system = seeds.station("assembly_station").system
    return now.phase is Phase.RUNNING and all(now.state[system.index[f"filter_{at}"]] == "tightened" for at in (1, 2, 3))


@cache
def moments() -> tuple[Point, ...]:
    return tuple(points(e3, done, UNTIL))


def test_a_run_has_many_moments_of_every_kind() -> None:
    kinds = {point.moment for point in moments()}
    assert len(kinds) == 5
    assert len(moments()) > 200


@pytest.mark.parametrize("part", range(4))
def test_the_planner_may_die_at_some_moment(part: int) -> None:
    for point in moments()[part * 5 :: 20 * 4]:
        assert list(killed(point, e3, done, UNTIL)) == []


@pytest.mark.long
def test_the_planner_may_die_at_every_moment() -> None:
    for point in moments():
        assert list(killed(point, e3, done, UNTIL)) == []


def test_two_planners_never_mix_their_commands() -> None:
    """The second begins in the middle, with a journal of its own; the first hears of it late, if at all."""
    for seed in range(3):
        world = e3()
        world.seed = seed
        world.weather = Weather(loss=0.2, twice=0.2, late=0.3, longest=1.0)
        observer = Observer(world.station)
        observer.watching(world)
        world.later(5.0 + seed, lambda world=world: world.start_planner("other", MemoryDisk()))  # type: ignore[misc]
        world.run(30.0)
        first, other = world.processes
        assert first.situation.phase is Phase.FENCED_OUT
        assert other.situation.phase is Phase.RUNNING
        assert observer.violations == []
        epochs = [message.epoch for _, message in world.sent]
        assert set(epochs) == {1, 2}
