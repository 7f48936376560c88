"""The emulated plant: what it can be told, and that it is one with hubs elsewhere."""

from __future__ import annotations

import gc
import json
import os
import signal
import subprocess
import sys
import time
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import inf
from pathlib import Path

import pytest
from bridge_wires import Network, until

import smv_planner as sp
from bridge import keys
from bridge.errors import LinkError
from bridge.link import Link, LinkConfig, open_link
from bridge.router import free_endpoint
from smv_planner.emulation.behaviour import Behaviour, Instead
from smv_planner.errors import UsageError
from smv_planner.model.domains import Value
from smv_planner.plant import plant as plants
from smv_planner.plant.plant import Plant
from smv_planner.plant.serve import Emulation, perform, tell
from smv_planner.protocol.interface import interfaces
from smv_planner.protocol.messages import GoalMessage, Rejected, StateMessage, decode_state, encode

ROOT = Path(__file__).parents[2]
DOOR = sp.load(ROOT / "scenarios/door")
STATION = sp.load(ROOT / "scenarios/assembly_station")
QUICK = Behaviour(delay=0.1, jitter=0.0)
OPENED: dict[str, Value] = {"door.ref": "opened", "door.lock": False}


def planted(model: sp.Model = DOOR, *names: str) -> Plant:
    boots = {resource.name: f"{resource.name}-1" for resource in model.resources}
    return plants.planted(model, "c", names, boots, 0.0, QUICK)


def asked(plant: Plant, name: str, at: float, seq: int = 1, **goals: Value) -> Plant:
    hub = plant.emulators[name].hub
    values = {**hub.goal, **{f"{name}.{key}": value for key, value in goals.items()}}
    result = plants.obey(plant, GoalMessage("c", name, 1, seq, "p", hub.interface.model, values), at)
    assert not isinstance(result, Rejected)
    return result


def later(plant: Plant, since: float = 0.0) -> Plant:
    """Everything has happened that follows in a hundred seconds."""
    plant, at = plants.advance(plant, since), since + 100.0
    while plant.due <= at:
        plant = plants.advance(plant, plant.due)
    return plants.advance(plant, at)


def measured(plant: Plant) -> dict[str, Value]:
    return {name: value for each in plant.emulators.values() for name, value in each.device.measured.items()}


def test_devices_do_what_is_expected() -> None:
    plant = later(asked(planted(), "door", 0.0, lock=False))
    assert measured(plant) == {"door.pos": "closed", "door.locked": False}
    assert plant.due == inf


@pytest.mark.parametrize(
    ("words", "behaviour"),
    [
        ("fail=opens", Behaviour(failing={"door.opens": None})),
        ("fail=door.opens:2", Behaviour(failing={"door.opens": 2})),
        ("instead=opens:jams", Behaviour(instead={"door.opens": Instead("door.jams")})),
        ("silent", Behaviour(silent=True)),
        ("stuck=on", Behaviour(stuck=True)),
        ("silent=off", Behaviour()),
        ("forgetful", Behaviour(forgetful=True)),
        ("lying=locked:false", Behaviour(lying={"door.locked": False})),
        ("lying=door.pos:jammed", Behaviour(lying={"door.pos": "jammed"})),
    ],
)
def test_words_change_the_behaviour_and_well_changes_it_back(words: str, behaviour: Behaviour) -> None:
    before = plants.planted(DOOR, "c", (), {"door": "1"}, 0.0, Behaviour())
    after = plants.told(before, "door", words, "2", 0.0)
    assert after.emulators["door"].device.behaviour == behaviour
    assert plants.told(after, "door", "well", "2", 0.0).emulators["door"].device.behaviour == Behaviour()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("fial=opens", "did you mean 'fail'"),
        ("fail", "fail=EFFECT"),
        ("fail=opens:0", "how often"),
        ("fail=opens:often", "how often"),
        ("fail=close", "did you mean 'door.closes'"),
        ("instead=opens", "instead=EFFECT:OTHER"),
        ("silent=maybe", "silent"),
        ("lying=door.ref:opened", "does not measure"),
        ("lying=locked:1", "its domain is bool"),
        ("set=pos:ajar", "not a value"),
        ("restart=now", "restart"),
        ("", "there are"),
    ],
)
def test_words_that_tell_nothing_are_refused(words: str, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        plants.told(planted(), "door", words, "2", 0.0)


def test_an_effect_that_has_begun_fails_as_well() -> None:
    plant = plants.advance(asked(planted(), "door", 0.0, lock=False), 0.0)
    plant = plants.told(plant, "door", "fail=unlocked:1", "2", 0.01)
    assert measured(later(plant))["door.locked"] is True


def test_a_dead_hub_says_and_does_nothing_until_it_is_well() -> None:
    plant = plants.told(planted(), "door", "dead", "2", 0.0)
    plant = later(asked(plant, "door", 0.0, lock=False))
    plant, message = plants.report(plant, "door", 100.0)
    assert (message, measured(plant)["door.locked"]) == (None, True)
    plant = later(asked(plants.told(plant, "door", "well", "2", 100.0), "door", 100.0, lock=False), 100.0)
    plant, message = plants.report(plant, "door", 200.0)
    assert message is not None
    assert message.measured["door.locked"] is False


def test_a_restarted_hub_has_a_new_boot_and_obeys_nobody_yet() -> None:
    plant = plants.told(asked(planted(), "door", 0.0, lock=False), "door", "restart", "another", 1.0)
    _, message = plants.report(plant, "door", 1.0)
    assert message is not None
    assert (message.boot, message.epoch, message.mirror["door.lock"]) == ("another", 0, False)


def test_what_a_person_does_is_done() -> None:
    plant = plants.told(planted(), "door", "set=pos:jammed", "2", 0.0)
    assert measured(plants.perform(plant, "door", "door.reset", {}))["door.pos"] == "closed"
    for wrong in ("door.rset", "door.open", "door.opens"):
        with pytest.raises(UsageError):
            plants.perform(plant, "door", wrong, {})


def test_guards_see_what_hubs_elsewhere_say() -> None:
    """An effect of one device that reads another happens the same, whether the other is in this process or not."""
    effects = [
        (each, owners)
        for each in STATION.system.transitions
        if each.kind == "effect" and len(owners := {STATION.system.resources[name] for name in each.used} - {None}) > 1
    ]
    assert effects
    everybody = planted(STATION)
    for _, owners in effects[:5]:
        here = str(sorted(map(str, owners))[0])
        alone = planted(STATION, here)
        for name in everybody.emulators:
            _, said = plants.report(everybody, name, 0.0)
            assert said is not None
            alone = plants.overhear(alone, said)
        assert alone.world == everybody.world
        assert set(alone.emulators) == {here}


def test_unknown_hubs_are_refused() -> None:
    with pytest.raises(UsageError, match="did you mean 'r1'"):
        planted(STATION, "r11")


@pytest.mark.parametrize(("turns", "looked_at"), [(600, 300), pytest.param(100_000, 2_000, marks=pytest.mark.long)])
def test_an_emulation_does_not_grow(turns: int, looked_at: int) -> None:
    network = Network()
    planner, emulation = network.link(), Emulation(DOOR, "door", network.link(), behaviour=QUICK)
    heard, at = planner.latest(keys.state("door", "door")), time.monotonic()
    seen: set[Value] = set()
    try:
        for number in range(turns):
            values: dict[str, Value] = {"door.ref": "closed", "door.lock": number % 10 < 5}
            planner.publish(keys.goal("door", "door"), encode(GoalMessage("door", "door", 1, number + 1, "p", DOOR.hash, values)))
            planner.publish(keys.goal("door", "door"), b"nonsense")
            at += max(emulation.turn(at), 0.05)
            seen |= {json.loads(payload)["measured"]["door.locked"] for _, payload in heard.drain()}
            if number == turns - looked_at:
                gc.collect()
                tracemalloc.start()
        gc.collect()
        assert tracemalloc.get_traced_memory()[0] < 50_000
    finally:
        tracemalloc.stop()
    assert seen == {True, False}


# --- real processes


@contextmanager
def command(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A command of ours that says a line once it is ready, and is ended in the end."""
    line = [sys.executable, "-c", "from smv_planner.cli.main import main; raise SystemExit(main())", *arguments]
    process = subprocess.Popen(line, cwd=ROOT, stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONUNBUFFERED": "1"})
    try:
        assert process.stdout is not None
        yield process
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(20)
        finally:
            process.kill()
            process.wait()
    assert process.returncode == 0, "it ends cleanly when it is told to"


@pytest.fixture(scope="module")
def where() -> Iterator[str]:
    endpoint = free_endpoint()
    # The hubs come first: they wait for the router.
    with (
        command("emulate", "scenarios/door", "--connect", endpoint, "--pace", "10") as hubs,
        command("router", "--listen", endpoint),
    ):
        assert hubs.stdout is not None
        assert hubs.stdout.readline() == "hubs of cell door: door\n"
        yield endpoint


@pytest.fixture
def link(where: str) -> Iterator[Link]:
    with open_link(LinkConfig((where,))) as link:
        yield link
        tell(link, "door", "door", ["well"])


def test_an_emulated_hub_is_driven_over_the_network(link: Link) -> None:
    seen = Seen(link)
    boot = tell(link, "door", "door", [])["boot"]

    tell(link, "door", "door", ["fail=unlocked"])
    seen.until(lambda state: state.mirror == OPENED | {"door.ref": "closed"}, lambda: seen.ask(1, lock=False))
    assert seen.states[-1].measured["door.locked"] is True

    tell(link, "door", "door", ["well"])
    seen.until(lambda state: state.measured["door.locked"] is False, lambda: seen.ask(1, lock=False))

    tell(link, "door", "door", ["lying=pos:jammed"])
    seen.until(lambda state: state.measured["door.pos"] == "jammed")
    tell(link, "door", "door", ["well", "set=pos:jammed"])
    perform(link, DOOR, "door", "door.reset")
    seen.until(lambda state: state.measured["door.pos"] == "closed")

    tell(link, "door", "door", ["stuck"])
    for _ in range(5):
        seen.ask(2, lock=True)
    link.publish(keys.goal("door", "door"), b"{}")
    until(lambda: tell(link, "door", "door", [])["rejected"].get("format") == 1)
    assert tell(link, "door", "door", [])["goal"]["door.lock"] is False

    tell(link, "door", "door", ["silent"])
    seen.mailbox.drain()
    answer = tell(link, "door", "door", ["restart"])
    assert answer["boot"] != boot
    assert not seen.mailbox.wait(0.5)
    tell(link, "door", "door", ["well"])
    seen.until(lambda state: state.boot == answer["boot"])

    with pytest.raises(LinkError, match="did you mean 'silent'"):
        tell(link, "door", "door", ["silnt"])
    with pytest.raises(LinkError, match="nobody answers"):
        tell(link, "door", "window", [])


def test_the_command_line_tells_a_running_hub(link: Link, where: str) -> None:
    words = ["emulate", "scenarios/door", "--connect", where, "--tell", "door", "fail=opens:3"]
    line = [sys.executable, "-c", "from smv_planner.cli.main import main; raise SystemExit(main())", *words]
    done = subprocess.run(line, cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert json.loads(done.stdout)["behaviour"] == {"fail": {"door.opens": 3}}
    done = subprocess.run([*line[:-1], "nonsense"], cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (2, "")
    assert "tells a device nothing" in done.stderr


class Seen:
    def __init__(self, link: Link) -> None:
        self.link = link
        self.mailbox = link.latest(keys.state("door", "door"), depth=1000)
        self.interface = interfaces(DOOR, "door")["door"]
        self.states: list[StateMessage] = []

    def until(self, true: Callable[[StateMessage], bool], repeat: Callable[[], object] = lambda: None) -> None:
        def came() -> bool:
            for _, payload in self.mailbox.drain():
                message = decode_state(payload, self.interface)
                assert isinstance(message, StateMessage)
                self.states.append(message)
            return bool(self.states) and true(self.states[-1])

        until(came, repeat)

    def ask(self, seq: int, lock: bool) -> None:
        values: dict[str, Value] = {"door.ref": "closed", "door.lock": lock}
        self.link.publish(keys.goal("door", "door"), encode(GoalMessage("door", "door", 1, seq, "p", DOOR.hash, values)))
