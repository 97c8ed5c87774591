"""The stand-in mount against the paper's sentences, so that what it says of a client can be believed.

Source: Van Deventer, "Xerxes Mount Control Protocol", Details, both tables, Theory of Operation.
"""

from __future__ import annotations

import struct
from typing import Any, Literal

import pytest
from paper_mount import SIDEREAL_DEG_S, PaperMount
from paper_packing import CommandRow, pack_command

ACK_SLEW, ACK_ABORT, ACK_SYNC, ACK_PULSE, ACK_DEC, ACK_RA = 158, 155, 156, 157, 146, 147
PULSE_GUIDING, SLEWING, TRACKING = 141, 143, 144


def obey(mount: PaperMount, **fields: Any) -> bytes:
    assert mount.receive(pack_command(CommandRow(**fields)))
    return mount.turn()


def true_bytes(status: bytes) -> list[int]:
    """Which of the boolean bytes of a status are 0xFF, Connected and Tracking left out."""
    return [offset for offset in range(136, 160) if status[offset] and offset not in (138, TRACKING)]


SLEW = {"TargetRA": 11.0, "TargetDec": 22.0, "SlewToTargetCmd": True}
MOVE = {"MoveAxisRA": True, "MoveAxisRateRA": 1.0}


def test_the_steps_of_a_slew_are_the_paper_s() -> None:
    mount = PaperMount()
    assert true_bytes(mount.turn()) == []
    assert true_bytes(obey(mount, **SLEW)) == [SLEWING, ACK_SLEW]
    assert true_bytes(obey(mount, **SLEW)) == [SLEWING, ACK_SLEW]
    assert true_bytes(obey(mount)) == [SLEWING]
    for _ in range(60):
        status = mount.turn()
    assert true_bytes(status) == []
    assert status[TRACKING] == 0xFF
    assert struct.unpack_from("<d", status, 40)[0] == pytest.approx(11.0)
    assert struct.unpack_from("<d", status, 24)[0] == 22.0
    assert len(mount.launches) == 1


def test_a_slew_is_ignored_while_slewing() -> None:
    mount = PaperMount()
    obey(mount, **SLEW)
    obey(mount)
    obey(mount, **(SLEW | {"TargetRA": 3.0}))
    assert len(mount.launches) == len(mount.ignored) == 1
    for _ in range(100):
        mount.turn()
    assert mount.ra_deg == pytest.approx(165.0)


def test_only_the_latest_of_the_mailbox_counts() -> None:
    mount = PaperMount()
    mount.receive(pack_command(CommandRow(**SLEW)))
    obey(mount)
    assert mount.launches == []


@pytest.mark.parametrize("how", ["held", "edge"])
def test_moveaxis_is_slewing_and_acknowledged_by_axis(how: Literal["held", "edge"]) -> None:
    mount = PaperMount(move_axis=how)
    assert true_bytes(obey(mount, **MOVE)) == [SLEWING, ACK_RA]
    both = MOVE | {"MoveAxisDec": True, "MoveAxisRateDec": -2.0}
    assert true_bytes(obey(mount, **both)) == [SLEWING, ACK_DEC, ACK_RA]
    assert true_bytes(obey(mount)) == ([SLEWING] if how == "edge" else [])


def test_held_takes_the_latest_rates_and_edge_those_of_the_edge() -> None:
    for how, expected in (("held", 3.0), ("edge", 1.0)):
        mount = PaperMount(move_axis=how)
        obey(mount, **MOVE)
        obey(mount, **(MOVE | {"MoveAxisRateRA": 3.0}))
        before = mount.ra_deg
        mount.turn()
        # Additive to sidereal tracking, a positive rate turns westward: right ascension falls.
        assert before - mount.ra_deg == pytest.approx(expected * 0.05)


def test_an_edge_of_rate_0_gives_the_axis_back_to_tracking() -> None:
    mount = PaperMount(move_axis="edge")
    obey(mount, **MOVE)
    obey(mount)
    obey(mount, MoveAxisRA=True)
    before = mount.ra_deg
    assert true_bytes(obey(mount)) == []
    assert mount.ra_deg == before


def test_an_abort_stops_everything_and_leaves_the_drives_at_rest() -> None:
    for how in ("held", "edge"):
        mount = PaperMount(move_axis=how)
        obey(mount, **MOVE)
        assert true_bytes(obey(mount, AbortSlewCmd=True)) == [SLEWING, ACK_ABORT]
        for _ in range(10):
            status = obey(mount)
        assert true_bytes(status) == []
        before = mount.ra_deg
        mount.turn()
        assert mount.ra_deg - before == pytest.approx(SIDEREAL_DEG_S * 0.05)


def test_a_pulse_runs_its_timers_out_negative_to_the_east() -> None:
    mount = PaperMount()
    pulse = {"PulseGuideCmd": True, "PulseGuideRADuration": -1000, "PulseGuideDecDuration": 500}
    assert true_bytes(obey(mount, **pulse)) == [PULSE_GUIDING, ACK_PULSE]
    for _ in range(20):
        assert true_bytes(obey(mount)) == [PULSE_GUIDING]
    assert true_bytes(obey(mount)) == []
    half_sidereal = 3500 / 10 * 360 / 2**26
    assert mount.ra_deg - 150.0 == pytest.approx(1.0 * half_sidereal, abs=2e-4)
    assert mount.dec_deg - 20.0 == pytest.approx(0.5 * half_sidereal, abs=2e-4)


def test_a_sync_changes_what_is_reported() -> None:
    mount = PaperMount()
    status = obey(mount, SyncToTargetCmd=True, TargetRA=5.0, TargetDec=-3.0)
    assert true_bytes(status) == [ACK_SYNC]
    assert struct.unpack_from("<d", status, 40)[0] == 5.0
    assert struct.unpack_from("<d", status, 24)[0] == -3.0


def test_fine_rates_adjust_tracking_at_once() -> None:
    mount = PaperMount()
    obey(mount, RAFineRate=-7789, DecFineRate=100)
    status = mount.turn()
    assert struct.unpack_from("<q", status, 48)[0] == 0
    assert struct.unpack_from("<q", status, 32)[0] == 100


def test_park_cuts_the_drives_and_has_no_acknowledgement() -> None:
    mount = PaperMount()
    assert true_bytes(obey(mount, ParkCmd=True)) == []
    obey(mount)
    obey(mount, **SLEW)
    assert true_bytes(mount.turn()) == []


def test_one_command_is_serviced_at_a_time_abort_first() -> None:
    mount = PaperMount()
    status = obey(mount, AbortSlewCmd=True, PulseGuideCmd=True, PulseGuideRADuration=500, **SLEW)
    assert true_bytes(status) == [ACK_ABORT]
    assert mount.crowded == 1


def test_a_flag_that_is_up_launches_again_in_a_restarted_mount() -> None:
    mount = PaperMount()
    obey(mount, **SLEW)
    mount.restart()
    obey(mount, **SLEW)
    assert [launch.command for launch in mount.launches] == ["SlewToTargetCmd"] * 2
