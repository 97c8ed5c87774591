"""When the last datagram goes out a second time, and that a mount with a mailbox does not notice.

Source: Van Deventer, "Xerxes Mount Control Protocol", Theory of Operation: the inbound message is a mailbox,
of which the mount's loop processes the latest; and, Details, commands are launched by rising edges.
"""

from __future__ import annotations

import pytest
from msgspec.structs import replace
from xerxes_builders import PERIOD_S, SIDEREAL_DTICS_S, T0, want

from sattrack.mount.model import Hold, Motion, MountProfile, MoveAxes, Slew, Status, Stop
from sattrack.mount.simulator.mount import SimulatedMount, SimulatedSite, StartPosition
from sattrack.mount.xerxes.datagrams import Command, decode_command, encode_status
from sattrack.mount.xerxes.session import Repeats, Session

MOVE = MoveAxes(-1.25, -0.75)
RESTING = Status(dec_deg=20.0, ra_h=10.0, sidereal_h=9.0, ra_rate_dtics_s=SIDEREAL_DTICS_S)
MOVING = replace(RESTING, slewing=True, ack_move_ra=True, ack_move_dec=True)


class Client:
    """A session that hears one status and sends one datagram a period."""

    def __init__(self, profile: MountProfile) -> None:
        self.session = Session(profile)
        self.turn = 0

    def go(self, motion: Motion, turns: int, status: Status = MOVING, lost: int = 0) -> list[bytes | None]:
        """Want a motion for some turns, the first of which miss statuses; return the copies asked for."""
        want(self.session, motion)
        copies = []
        for _ in range(turns):
            self.turn += 1
            if lost:
                lost -= 1
            else:
                clock_h = status.sidereal_h + self.turn * PERIOD_S / 3600.0
                told = replace(status, counter=self.turn, sidereal_h=clock_h)
                self.session.receive(encode_status(told), T0 + self.turn * PERIOD_S)
            self.last = self.session.compose()
            copies.append(self.session.repeat())
        return copies


def policy(repeat_rates: str, move_axis: str = "held") -> MountProfile:
    return MountProfile(repeat_rates=repeat_rates, move_axis=move_axis)  # type: ignore[arg-type]


def test_nothing_is_repeated_where_nothing_is_lost() -> None:
    client = Client(MountProfile())
    assert client.go(MOVE, 100) == [None] * 100


def test_rates_are_repeated_byte_for_byte_once_a_status_is_missing_and_for_half_a_minute() -> None:
    client = Client(MountProfile())
    client.go(MOVE, 20)
    client.go(MOVE, 2, lost=1)
    (copy,) = client.go(MOVE, 1)
    assert copy == client.last
    assert decode_command(copy).move_ra
    assert client.session.health.repeated == 2
    copies = client.go(MOVE, 1200)
    lasted_s = PERIOD_S * sum(copy is not None for copy in copies)
    assert 25.0 < lasted_s < 35.0
    assert copies[-1] is None


def test_a_status_that_was_only_overtaken_is_no_loss() -> None:
    client = Client(MountProfile())
    client.go(MOVE, 20)
    client.go(MOVE, 2, lost=1)
    client.session.receive(
        encode_status(replace(MOVING, counter=client.turn - 1)), T0 + client.turn * PERIOD_S
    )
    assert client.go(MOVE, 40) == [None] * 40


def test_the_profile_may_have_it_always_or_never() -> None:
    always, never = Client(policy("always")), Client(policy("never"))
    assert None not in always.go(MOVE, 20)[10:]
    never.go(MOVE, 20)
    assert never.go(MOVE, 20, lost=5) == [None] * 20


def test_edges_are_never_repeated() -> None:
    client = Client(policy("always", "edge"))
    assert client.go(MOVE, 50, RESTING) == [None] * 50


def test_no_flag_of_another_kind_is_repeated_nor_rates_that_follow_one_closely() -> None:
    client = Client(policy("always"))
    assert client.go(Hold(), 5, RESTING) == [None] * 5
    assert client.go(Slew(150.0, 10.0), 10, RESTING) == [None] * 10
    assert decode_command(client.last).slew
    # The slew's flag falls with the first rates; a copy waits until both are long on their way.
    copies = client.go(MOVE, 10, RESTING)
    assert copies[:4] == [None] * 4
    assert copies[-1] == client.last
    assert client.go(Stop(), 20) == [None] * 20


@pytest.mark.parametrize(
    "flag", ["abort", "find_home", "park", "pulse_guide", "slew", "sync", "move_ra", "move_dec"]
)
def test_rates_are_repeated_after_five_datagrams_that_have_no_flag_of_another_kind(flag: str) -> None:
    repeats = Repeats(policy("always"))
    rates = Command(move_dec=True) if flag == "move_ra" else Command(move_ra=True)
    for turn in range(6):
        repeats.sent(replace(rates, **{flag: True}) if turn == 0 else rates, bytes([turn]))
        began = turn + (1 if flag.startswith("move") else 0)
        assert repeats.copy(0) == (bytes([turn]) if began >= 5 else None)
    repeats.sent(Command(), b"")
    assert repeats.copy(0) is None


def test_a_loss_is_remembered_for_thirty_marks_of_a_second() -> None:
    repeats = Repeats(MountProfile())
    for turn in range(6):
        repeats.sent(Command(move_ra=True), bytes([turn]))
    assert repeats.copy(1) is None
    repeats.see(T0, 0)
    assert (repeats.copy(0), repeats.copy(1)) == (None, b"\5")
    for turn in range(1, 620):
        repeats.see(T0 + turn * PERIOD_S, 1)
        # The first mark, from before the loss, is the thirtieth last for so long.
        assert (repeats.copy(1) is None) == (turn >= 600)


def test_a_stop_asked_for_between_a_datagram_and_its_copy_keeps_the_copy_back() -> None:
    client = Client(policy("always"))
    assert client.go(MOVE, 20)[-1] is not None
    want(client.session, Stop())
    assert client.session.repeat() is None


@pytest.mark.parametrize("late_turns", [0, 1])
def test_a_mount_does_the_same_with_copies_as_without(late_turns: int) -> None:
    """A copy may come before the mount's turn or after it; either way the next datagram finds it replaced."""
    mounts = [
        SimulatedMount(MountProfile(), SimulatedSite(52.0, 4.5, 0.0), StartPosition(10.0, 40.0)) for _ in "ab"
    ]
    client = Client(policy("always"))
    copies = 0
    for turn in range(100):
        (copy,) = client.go(MoveAxes(0.01 * turn, -0.02 * turn), 1)
        for mount in mounts:
            mount.receive(client.last)
        copies += copy is not None
        if copy is not None and not late_turns:
            mounts[1].receive(copy)
        plain, doubled = (mount.tick(T0 + turn * PERIOD_S) for mount in mounts)
        assert plain == doubled
        if copy is not None and late_turns:
            mounts[1].receive(copy)
    assert copies > 80
