"""The daemon's loop, turn by turn: the clock, the network and the disk are ours."""

from __future__ import annotations

import gc
import json
import logging
import socket
import sys
import threading
from dataclasses import dataclass, field, replace
from typing import Any

import jsonschema
import pytest
from daemon.doubles import LaterPlanners, LoggedDisk, MemoryLink
from daemon.stations import ROOT, load

from bridge import keys
from bridge.link import MAX_DOCUMENT
from smv_planner import api
from smv_planner.daemon import chronicle, documents, metrics
from smv_planner.daemon.loop import FAILURES, Daemon, Waiting
from smv_planner.daemon.schema import schemas
from smv_planner.daemon.sizes import too_large
from smv_planner.errors import UsageError
from smv_planner.journal.folder import LIMIT
from smv_planner.model.domains import Enum
from smv_planner.protocol import hub as hubs
from smv_planner.protocol.interface import Interface
from smv_planner.protocol.messages import GoalMessage, Rejected, decode_goal, encode
from smv_planner.runner.decision import Decision
from smv_planner.runner.events import Assign, Began
from smv_planner.runner.records import Known
from smv_planner.runner.recovery import recover
from smv_planner.runner.situation import Phase, Station, Wish, WishKind, at_rest
from smv_planner.simulate.planning import planners

MODEL = load(ROOT / "scenarios" / "door")
STATION = Station(MODEL, api.widened(MODEL), "door")
KNOWN = Known(MODEL, api.widened_system)
PLANNERS = planners()
PERIOD = MODEL.period


@dataclass
class Bench:
    """A daemon, obedient hubs that measure their initial values, and a clock that moves when told to."""

    log: list[tuple[str, str]] = field(default_factory=list)
    now: float = 100.0
    limit: int = LIMIT

    def __post_init__(self) -> None:
        self.link, self.disk, self.planners = MemoryLink(self.log), LoggedDisk(log=self.log), LaterPlanners()
        initial = STATION.system.named(STATION.system.initial)
        self.initial = initial
        self.hubs = {
            name: hubs.start(one, f"{name}-1", 0.0, {goal: initial[goal] for goal in one.goals})
            for name, one in STATION.interfaces.items()
        }
        self.begin("one")

    def begin(self, planner: str) -> None:
        """A process of the planner; what was before is gone."""
        self.planners = LaterPlanners()
        found, situation, _ = chronicle.opened(self.disk, STATION, KNOWN, at_rest(STATION), self.limit)
        self.daemon = Daemon(STATION, situation, self.link, found, self.planners, threading.Event(), lambda: self.now)
        self.daemon.turn([Began(self.daemon.at(self.now), planner)])

    def pass_time(self, seconds: float = PERIOD) -> None:
        """Hubs obey and report, then it is the planner's turn."""
        self.now += seconds
        for name, hub in self.hubs.items():
            for key, payload in self.link.published:
                if key == keys.goal("door", name):
                    message = decode_goal(payload, STATION.interfaces[name])
                    assert not isinstance(message, Rejected)
                    obeying = hubs.receive(hub, message, self.now)
                    hub = hub if isinstance(obeying, Rejected) else obeying
            measured = {variable: self.initial[variable] for variable in STATION.interfaces[name].measured}
            self.hubs[name], state = hubs.report(hub, measured, self.now)
            self.link.arrive(keys.state("door", name), encode(state))
        self.link.published.clear()
        self.daemon.once(self.now)

    def until_running(self) -> None:
        for _ in range(20):
            if self.daemon.situation.phase is Phase.RUNNING:
                return
            self.pass_time()
        raise AssertionError(self.daemon.situation.phase)

    def order(self, **order: Any) -> dict[str, Any]:
        """An order as it comes from the network, in a thread of its own; its answer. The loop goes on meanwhile."""
        came: list[Any] = []

        def ask() -> None:
            try:
                came.append(json.loads(self.link.ask(keys.order("door"), json.dumps(order).encode())))
            except (ValueError, UsageError) as error:
                came.append(error)

        asking = threading.Thread(target=ask)
        asking.start()
        while asking.is_alive():
            self.daemon.once(self.now)
            asking.join(0.01)
        if isinstance(came[0], Exception):
            raise came[0]
        found: dict[str, Any] = came[0]
        return found

    def goals(self) -> dict[str, bytes]:
        return {key: payload for key, payload in self.link.published if key.endswith("/goal")}


@pytest.fixture
def bench() -> Bench:
    found = Bench()
    found.until_running()
    return found


def test_nothing_is_published_before_it_is_in_the_journal(bench: Bench) -> None:
    bench.log.clear()
    bench.order(order="set", values={next(v.name for v in MODEL.variables if v.resource is None): _other()})
    event = bench.log.index(("publish", keys.event("door")))
    assert [what for what, _ in bench.log[:event]] == ["write", "sync"]


def test_what_was_accepted_is_there_after_a_crash(bench: Bench) -> None:
    name = next(v.name for v in MODEL.variables if v.resource is None)
    assert bench.order(order="set", values={name: _other()})["kind"] == "accepted"
    bench.begin("two")
    assert STATION.system.named(bench.daemon.situation.state)[name] == _other()


def test_a_new_process_rules_nothing_before_it_has_begun(bench: Bench) -> None:
    found, situation, _ = chronicle.opened(bench.disk, STATION, KNOWN, at_rest(STATION))
    assert situation.phase is Phase.RUNNING
    daemon = Daemon(STATION, situation, bench.link, found, bench.planners, threading.Event(), lambda: bench.now)
    assert daemon.situation.phase is Phase.STOPPED


def test_the_clock_goes_on_where_the_journal_ends(bench: Bench) -> None:
    before = bench.daemon.situation.at
    bench.now = 7.0  # the machine has been started anew
    bench.begin("two")
    assert bench.daemon.situation.at == before
    bench.pass_time()
    assert bench.daemon.situation.at == pytest.approx(before + PERIOD, abs=PERIOD)


def test_while_nothing_can_be_written_the_same_is_said_again(bench: Bench) -> None:
    bench.pass_time()
    said = bench.goals()
    before = bench.daemon.situation
    bench.disk.full = True
    with pytest.raises(ValueError, match="No space left"):
        bench.order(order="set", values={next(v.name for v in MODEL.variables if v.resource is None): _other()})
    bench.pass_time()
    assert bench.goals() == said
    assert bench.daemon.situation is before
    assert bench.daemon.health()["wrong"]
    for _ in range(int(4 / PERIOD)):  # for so long that the runner, which hears of nothing, would have slept
        bench.pass_time()
        assert bench.goals() == said
    bench.link.published.clear()
    name, hub = next(iter(bench.hubs.items()))
    measured = {variable: bench.initial[variable] for variable in STATION.interfaces[name].measured}
    bench.link.arrive(keys.state("door", name), encode(hubs.report(hub, measured, bench.now)[1]))
    bench.daemon.once(bench.now + 0.01)
    assert not bench.goals(), "once a period is enough"
    bench.disk.full = False
    bench.pass_time()
    assert bench.daemon.health()["healthy"]
    assert bench.daemon.situation.at > before.at


@pytest.mark.parametrize("full_before", [True, False])
def test_who_was_fenced_out_says_nothing_again_whatever_the_disk_takes(bench: Bench, full_before: bool) -> None:
    bench.disk.full = full_before
    name, interface = next(iter(STATION.interfaces.items()))
    measured = {variable: bench.initial[variable] for variable in interface.measured}
    _, state = hubs.report(bench.hubs[name], measured, bench.now)
    other = replace(state, epoch=bench.daemon.situation.epoch + 1, planner="other")
    bench.link.published.clear()
    bench.link.arrive(keys.state("door", name), encode(other))
    bench.daemon.once(bench.now + 0.01)
    bench.disk.full = True
    for tick in (1, 2, 3):
        bench.daemon.once(bench.now + tick * PERIOD)
    assert not bench.goals()


def test_a_decision_that_came_while_nothing_could_be_written_is_not_lost(bench: Bench) -> None:
    bench.order(order="start", intention=MODEL.intentions[0].name)
    assert bench.planners.asked
    bench.planners.answer(lambda request: recover(MODEL, request, PLANNERS))
    bench.disk.full = True
    bench.pass_time()
    assert bench.daemon.situation.asked
    bench.disk.full = False
    bench.pass_time()
    bench.pass_time()
    assert bench.daemon.situation.following or bench.daemon.situation.executing or bench.daemon.situation.failed


def test_goals_are_repeated_every_period_however_late_the_ticks_are(bench: Bench) -> None:
    for late in (0.001, 0.05, 0.001, 0.09, 0.01, 0.001):
        bench.pass_time(PERIOD + late * PERIOD)
        assert bench.goals()
        bench.now -= late * PERIOD


def test_after_a_standstill_hubs_speak_first(bench: Bench) -> None:
    bench.now += 60.0
    bench.daemon.once(bench.now)
    for _ in range(3):
        bench.pass_time()
    assert not bench.daemon.situation.lost
    assert bench.daemon.pulse.missed > 0


def test_however_long_the_period_is_the_loop_shows_that_it_turns(bench: Bench) -> None:
    slow = replace(STATION, model=replace(MODEL, period=1000.0))
    found, situation, _ = chronicle.opened(bench.disk, STATION, KNOWN, at_rest(STATION))
    daemon = Daemon(slow, situation, bench.link, found, bench.planners, threading.Event())
    turns = []

    def turned() -> None:
        turns.append(daemon.pulse.ticks)
        if len(turns) == 3:
            daemon.stop()

    daemon.turned = turned
    daemon.run("two")
    assert turns == [1, 1, 1]


def test_without_a_router_the_loop_goes_on(bench: Bench) -> None:
    bench.link.broken = True
    bench.pass_time()
    bench.link.broken = False
    bench.pass_time()
    assert bench.goals()


def test_who_asks_for_its_health_hears_what_is_wrong(bench: Bench) -> None:
    def wrong() -> str:
        return "; ".join(bench.daemon.health()["wrong"])

    assert not wrong()
    bench.link.connected = False
    assert "no router" in wrong()
    bench.link.connected = True

    bench.order(order="start", intention=MODEL.intentions[0].name)
    for _ in range(FAILURES):
        assert "in a row" not in wrong()
        asked = len(bench.planners.asked)
        bench.planners.answer(lambda request: Decision(undecided="the engine is broken"))
        for _ in range(1000):
            bench.pass_time()
            if len(bench.planners.asked) > asked:
                break
    assert "in a row" in wrong()
    bench.planners.answer(lambda request: recover(MODEL, request, PLANNERS))
    bench.pass_time()
    assert not wrong()

    for tick in range(100):
        bench.daemon.once(bench.now + tick * PERIOD)
    assert "all resources are lost" in wrong()


def test_a_planner_that_waits_for_a_hub_is_well_and_says_what_it_waits_for() -> None:
    bench = Bench()
    for tick in range(100):
        bench.daemon.once(bench.now + tick * PERIOD)
    assert bench.daemon.situation.phase is Phase.JOINING
    health = bench.daemon.health()
    assert "has never spoken" in "".join(health["waiting"])
    assert "has never spoken" not in "".join(health["wrong"])


def test_a_planner_whose_station_is_stuck_or_waits_for_people_is_well(bench: Bench) -> None:
    bench.order(order="start", intention=MODEL.intentions[0].name)
    bench.planners.answer(lambda request: Decision(stuck="nothing can be done"))
    bench.pass_time()
    health = bench.daemon.health()
    assert health["healthy"]
    assert health["waiting"] == ["stuck: nothing can be done"]
    wish = Wish(WishKind.MAINTENANCE, "Lift it.", 0, "lift")
    done = replace(wish, confirmed_at=1.0)
    bench.daemon.situation = replace(bench.daemon.situation, stuck=None, halted="'r1' failed", wishes={"1.1": wish, "1.2": done})
    health = bench.daemon.health()
    assert health["healthy"]
    assert health["waiting"] == ["halted: 'r1' failed", "the operator: Lift it."]


@pytest.mark.parametrize(
    ("order", "reason"),
    [
        (b"not json", "not JSON"),
        (b'{"order": "dance"}', "no order"),
        (b'{"order": "start", "order": "start"}', "twice"),
        (b'{"order": "start"}', "other fields"),
        (b'{"order": "start", "intention": "nonsense"}', "there is no intention 'nonsense'"),
        (b'{"order": "start", "intention": 3}', "not text"),
        (b'{"order": "confirm", "request": "1.1"}', "no open request"),
        (b'{"order": "set", "values": {"door.pos": "opened"}}', "no decision or estimated variable"),
        (b'{"order": "set", "values": {}}', "'values' is an object"),
        (b"[" * 100_000, "not JSON"),
        (b"\xff\xfe", "not JSON"),
    ],
)
def test_an_order_that_means_nothing_is_refused_with_the_reason(bench: Bench, order: bytes, reason: str) -> None:
    with pytest.raises(UsageError, match=reason):
        bench.link.ask(keys.order("door"), order)


@pytest.mark.parametrize("payload", [b"", b"{}", b"\xff", b"[" * 70_000, b'{"format":1,"kind":"state"}'])
def test_a_message_that_is_none_is_counted_and_changes_nothing(bench: Bench, payload: bytes) -> None:
    before = bench.daemon.situation.hubs
    bench.link.arrive(keys.state("door", next(iter(bench.hubs))), payload)
    bench.link.arrive("smv/door/nobody/state", payload)
    bench.daemon.once(bench.now)
    assert sum(count for name, count in bench.daemon.pulse.counts.items() if name.startswith("rejected")) == 2
    assert bench.daemon.situation.hubs == before


def test_what_is_published_is_as_documented(bench: Bench) -> None:
    told: dict[str, Any] = {}
    bench.order(order="start", intention=MODEL.intentions[0].name)
    bench.planners.answer(lambda request: recover(MODEL, request, PLANNERS))
    for _ in range(7):  # more than a second: everything is said at least once
        told.update({key.rpartition("/")[2]: json.loads(payload) for key, payload in bench.link.published})
        bench.pass_time()
    del told["goal"]  # the bridge's
    assert set(told) == {"situation", "plan", "operator", "event", "health"}
    for kind, document in told.items():
        jsonschema.validate(document, schemas()[kind])
        assert document["kind"] == kind
        assert not set(schemas()[kind]["required"]) ^ set(document), "every field is documented"


def test_what_is_too_large_for_the_network_is_counted_and_told(bench: Bench, caplog: pytest.LogCaptureFixture) -> None:
    bench.link.published.clear()
    for size in (0, 1, 1):
        bench.daemon.publish(keys.plan("door"), b"x" * (MAX_DOCUMENT + size))
    assert [len(payload) for _, payload in bench.link.published] == [MAX_DOCUMENT]
    assert bench.daemon.pulse.counts["oversize"] == 2
    assert caplog.text.count("not published") == 1
    large = replace(bench.daemon.situation, failed={f"operation {n}": "x" * 1000 for n in range(2000)})
    bench.daemon.situation = large
    with pytest.raises(ValueError, match="at most"):
        bench.link.ask(keys.situation("door"))


@pytest.mark.parametrize(("variables", "fits"), [(300, True), (700, False)])
def test_a_resource_with_messages_that_no_hub_would_read_is_refused(variables: int, fits: bool) -> None:
    domain = Enum(("a", "b" * 100))
    one = Interface("door", "door", {f"door.goal_{n}": domain for n in range(variables)}, {}, "0" * 64)
    assert [mistake.message.split(" can")[0] for mistake in too_large({"door": one})] == (
        [] if fits else ["a message about resource 'door'"]
    )
    longest = GoalMessage("door", "door", 1, 1, "planner", "0" * 64, dict.fromkeys(one.goals, "b" * 100))
    assert isinstance(decode_goal(encode(longest), one), GoalMessage) == fits


def test_what_is_asked_and_answered_is_as_documented(bench: Bench) -> None:
    known = schemas()
    for schema in known.values():
        jsonschema.Draft202012Validator.check_schema(schema)
        assert schema["$schema"]
    own = next(v for v in MODEL.variables if v.resource is None)
    for order in (
        {"order": "set", "values": {own.name: _other()}},
        {"format": 1, "order": "start", "intention": MODEL.intentions[0].name},
        {"order": "proceed"},
    ):
        jsonschema.validate(order, known["order"])
        jsonschema.validate(bench.order(**order), known["accepted"])
    for wrong in ({"order": "proceed", "format": 2}, {"order": "proceed", "format": True}, {"order": "proceed", "more": 1}):
        with pytest.raises(UsageError):
            bench.link.ask(keys.order("door"), documents.encoded(wrong))
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(wrong, known["order"])
    missed = {"planner": "one", "after": 0}
    jsonschema.validate(missed, known["missed"])
    events = json.loads(bench.link.ask(keys.event("door"), documents.encoded(missed)))
    assert events
    jsonschema.validate(events, known["events"])


def test_metrics_keep_all_digits(bench: Bench) -> None:
    bench.daemon.pulse.ticks = 12_345_678
    assert 'smv_planner_ticks_total{cell="door"} 12345678\n' in metrics.text(bench.daemon)
    assert 'smv_planner_healthy{cell="door"} 1\n' in metrics.text(bench.daemon)


def test_a_port_for_metrics_that_somebody_has_is_a_mistake_in_the_settings(bench: Bench) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(UsageError, match=f"port {port}"), metrics.served(bench.daemon, port):
            pass


def test_events_that_were_missed_can_be_asked_for(bench: Bench) -> None:
    events = json.loads(bench.link.ask(keys.event("door")))
    assert [event["number"] for event in events] == list(range(1, len(events) + 1))
    last = {"planner": "one", "after": len(events) - 1}
    assert json.loads(bench.link.ask(keys.event("door"), documents.encoded(last))) == events[-1:]


@pytest.mark.parametrize("ticks", [10**4, pytest.param(10**5, marks=pytest.mark.long)])
def test_memory_stays_flat_however_long_it_runs(ticks: int, caplog: pytest.LogCaptureFixture) -> None:
    """Commands are repeated, journals begun anew, orders taken, hubs restarted, nonsense refused, and nothing of it is kept."""
    caplog.set_level(logging.CRITICAL, "smv_planner.daemon")  # what pytest catches it keeps
    bench = Bench(limit=64 * 1024)
    bench.until_running()
    name = next(iter(bench.hubs))
    own = next(v for v in MODEL.variables if v.resource is None)
    blocks = []
    for tick in range(ticks):
        match tick % 6:
            case 0:
                value = own.domain.values[tick // 6 % 2]
                waiting = Waiting(Assign({own.name: value}))
                bench.daemon._waiting.append(waiting)
            case 2:
                bench.link.arrive(keys.state("door", name), b"nonsense")
                bench.link.arrive(keys.state("door", f"stranger{tick}"), b"nonsense")
            case 4:
                initial = {goal: bench.initial[goal] for goal in STATION.interfaces[name].goals}
                bench.hubs[name] = hubs.start(STATION.interfaces[name], f"{name}-{tick}", bench.now, initial)
        bench.pass_time()
        bench.log.clear()
        bench.planners.asked.clear()  # what planners remember is theirs
        if tick in (ticks // 2, ticks - 1):
            gc.collect()
            blocks.append(sys.getallocatedblocks())
    assert bench.daemon.pulse.ticks >= ticks
    assert bench.daemon.chronicle.journal._header.segment > ticks // 1000, "journals were begun anew"
    assert bench.daemon.pulse.counts["event rebooted"] > ticks // 10
    assert blocks[1] - blocks[0] < ticks // 20


def _other() -> Any:
    variable = next(v for v in MODEL.variables if v.resource is None)
    return next(value for value in variable.domain.values if value != variable.initial)
