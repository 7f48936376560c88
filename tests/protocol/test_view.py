"""What the planner believes of a hub behind a network that loses, repeats, delays and reorders."""

from __future__ import annotations

from dataclasses import replace

from generated_messages import STATE
from hypothesis import given
from hypothesis import strategies as st

from smv_planner.protocol.messages import StateMessage
from smv_planner.protocol.view import (
    MAX_PAST,
    PERSISTENT,
    Heard,
    HubView,
    command,
    fenced,
    hear,
    silent,
    stuck,
    superseded,
)

OPENED = STATE.mirror
CLOSED = {**OPENED, "gate.ref": "closed"}


def said(seq: int, boot: str = "boot-1", **changes: object) -> StateMessage:
    return replace(STATE, boot=boot, seq=seq, measured={**STATE.measured, "gate.count": seq % 2}, **changes)


def heard(*messages: StateMessage, view: HubView | None = None) -> tuple[HubView, list[Heard]]:
    """What is believed after messages that come a tenth of a second apart."""
    view, kinds = view or HubView(heard_at=0.0), []
    for message in messages:
        view, kind = hear(view, message, round(view.heard_at + 0.1, 6))
        kinds.append(kind)
    return view, kinds


def test_newer_messages_are_believed():
    view, kinds = heard(said(1), said(2), said(7))
    assert kinds == [Heard.FRESH] * 3
    assert view.state == said(7)


def test_late_and_repeated_messages_change_nothing():
    before, _ = heard(said(5))
    after, kinds = heard(said(5), said(4), said(1), view=before)
    assert kinds == [Heard.DUPLICATE, Heard.OLD, Heard.OLD]
    assert after == before


@given(st.lists(st.integers(1, 12), max_size=40))
def test_in_whatever_order_they_come_the_newest_is_believed(order):
    newest = 0
    view = HubView(heard_at=0.0)
    for at, seq in enumerate(order, start=1):
        view, kind = hear(view, said(seq), float(at))
        assert kind.believed == (seq > newest)
        assert (kind is Heard.DUPLICATE) == (seq == newest)
        newest = max(newest, seq)
        assert view.state == said(newest)
        assert view.heard_at == order.index(newest) + 1


def test_a_rebooted_hub_starts_counting_anew():
    view, kinds = heard(said(900), said(1, "boot-2"), said(2, "boot-2"))
    assert kinds == [Heard.FRESH, Heard.REBOOTED, Heard.FRESH]
    assert view.state == said(2, "boot-2")


def test_what_a_dead_process_left_in_the_network_is_dropped():
    view, _ = heard(said(900), said(1, "boot-2"))
    view, kinds = heard(said(901), said(899), said(2, "boot-2"), said(902), said(903), said(3, "boot-2"), view=view)
    assert kinds == [*[Heard.OLD_BOOT] * 2, Heard.FRESH, *[Heard.OLD_BOOT] * 2, Heard.FRESH]
    assert view.state == said(3, "boot-2")


def test_repetitions_of_a_dead_process_are_no_persistence():
    view, _ = heard(said(900), said(1, "boot-2"))
    view, kinds = heard(*[said(901)] * 10, *[said(850)] * 10, view=view)
    assert set(kinds) == {Heard.OLD_BOOT}


def test_two_dead_processes_do_not_insist_together():
    view, _ = heard(said(100, "dead-1"), said(100, "dead-2"), said(1, "living"))
    view, kinds = heard(*(said(101 + n // 2, f"dead-{1 + n % 2}") for n in range(10)), view=view)
    assert set(kinds) == {Heard.OLD_BOOT}


def test_of_many_dead_processes_the_last_are_remembered():
    view, _ = heard(*(said(5, f"boot-{n}") for n in range(2 * MAX_PAST)))
    view, kinds = heard(said(6, f"boot-{2 * MAX_PAST - 2}"), view=view)
    assert kinds == [Heard.OLD_BOOT]


def test_a_living_hub_is_not_shut_out_by_a_late_message_of_a_dead_one():
    view, kinds = heard(said(7, "living"), said(3, "dead"))
    assert kinds[-1] is Heard.REBOOTED  # nobody can tell
    view, kinds = heard(*(said(seq, "living") for seq in range(8, 12)), view=view)
    assert kinds == [Heard.OLD_BOOT, Heard.OLD_BOOT, Heard.REBOOTED, Heard.FRESH]
    view, kinds = heard(said(2, "dead"), said(12, "living"), view=view)
    assert kinds == [Heard.OLD_BOOT, Heard.FRESH]


messages = st.builds(said, st.integers(1, 40), st.sampled_from([f"boot-{n}" for n in range(2 * MAX_PAST)]))


@given(st.lists(messages, max_size=80), st.sampled_from(["boot-0", "boot-5", "boot-99"]))
def test_whoever_keeps_speaking_is_believed_in_the_end(history, boot):
    view, _ = heard(*history)
    assert len(view.past) <= MAX_PAST
    view, kinds = heard(*(said(seq, boot) for seq in range(41, 41 + PERSISTENT)), view=view)
    assert kinds[-1].believed
    assert view.state == said(40 + PERSISTENT, boot)


def test_silence_counts_from_the_last_fresh_message():
    view = HubView(heard_at=10.0)
    assert not silent(view, 11.0, 1.0)
    assert silent(view, 11.1, 1.0)
    view, _ = hear(view, said(5), 11.1)
    assert not silent(view, 12.0, 1.0)
    for old in (said(5), said(4)):  # an echo in the network is not a sign of life
        view, _ = hear(view, old, 12.0)
    assert silent(view, 12.2, 1.0)


def told_to_close(*, limit: float = 1.0) -> HubView:
    view, _ = hear(HubView(heard_at=0.0), said(1, mirror=OPENED), 0.0)
    return command(view, CLOSED, 0.0)


def test_a_hub_that_keeps_mirroring_the_old_goal_is_stuck():
    view = told_to_close()
    for seq in range(2, 12):
        view, _ = hear(view, said(seq, mirror=OPENED), (seq - 1) / 10)
        assert stuck(view) == ()
    view, _ = hear(view, said(12, mirror=OPENED), 1.1)
    assert stuck(view) == ("gate.ref",)
    assert stuck(view, limit=2.0) == ()
    view, _ = hear(view, said(13, mirror=CLOSED), 1.2)
    assert stuck(view) == ()


def test_a_stuck_hub_is_not_excused_by_new_commands():
    view = told_to_close()
    for seq in range(2, 14):
        view = command(view, {**CLOSED, "gate.speed": seq % 2}, (seq - 1) / 10)
        view, _ = hear(view, said(seq, mirror=OPENED), (seq - 1) / 10)
    assert stuck(view) == ("gate.ref", "gate.speed")


def test_a_hub_that_follows_behind_is_not_stuck():
    view = HubView(heard_at=0.0)
    for tenth in range(100):
        view = command(view, {**OPENED, "gate.speed": tenth % 4}, tenth / 10)
        view, _ = hear(view, said(tenth + 1, mirror={**OPENED, "gate.speed": (tenth + 2) % 4}), tenth / 10)
        assert stuck(view) == ()
    assert "gate.speed" in view.differs_since


def test_a_hub_that_says_nothing_is_silent_but_not_stuck():
    view = told_to_close()
    view = command(view, CLOSED, 5.0)
    assert silent(view, 5.0, 1.0)
    assert stuck(view) == ()


def test_a_rebooted_hub_gets_its_time():
    view = told_to_close()
    view, _ = hear(view, said(1, "boot-2", mirror=OPENED), 1.1)
    assert stuck(view) == ()
    view, _ = hear(view, said(2, "boot-2", mirror=OPENED), 2.2)
    assert stuck(view) == ("gate.ref",)


def test_a_deadman_reaction_is_a_move_of_the_mirror():
    view = command(HubView(heard_at=0.0), OPENED, 0.0)
    view, _ = heard(said(1, mirror=OPENED), view=view)
    view, _ = hear(view, said(2, mirror=CLOSED), 3.0)
    assert view.differs_since == {"gate.ref": 3.0}


def test_fencing_needs_our_epoch_echoed_to_us():
    nobody = HubView(heard_at=0.0)
    assert not fenced(nobody, 3, "planner-a")
    assert not superseded(nobody, 3, "planner-a")
    view, _ = heard(said(1))  # it obeys planner-a in epoch 3
    assert fenced(view, 3, "planner-a")
    assert not superseded(view, 3, "planner-a")
    assert not fenced(view, 4, "planner-a")
    assert not fenced(view, 3, "planner-b")
    assert not superseded(view, 4, "planner-a")  # it has not heard us yet
    assert superseded(view, 3, "planner-b")  # the same epoch, but the other was first
    assert superseded(view, 2, "planner-b")
    view, _ = heard(said(1, "boot-2", epoch=0, goal_seq=0, planner=""), view=view)
    assert not fenced(view, 3, "planner-a")
    assert not superseded(view, 3, "planner-a")
