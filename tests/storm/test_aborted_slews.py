"""Slews of mounts written from the paper alone, aborted as they brake: how far past their end they go."""

from __future__ import annotations

import struct
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from storm.draws import draw
from storm.mounts import Stranger

from sattrack.safety.geometry import Place
from sattrack.safety.route import overshoot_deg

if TYPE_CHECKING:
    from storm.draws import Storm

COMMAND = struct.Struct("<Qq4d2q2i10B")
ABORT, SLEW = 1, 7
START_DEG, WAY_DEG = 10.0, 30.0
ASKED_FOR = 5
"""The turn in which the slew is asked for."""


def datagram(counter: int, dec_deg: float = 0.0, ra_h: float = 0.0, flag: int | None = None) -> bytes:
    flags = [0xFF if k == flag else 0 for k in range(10)]
    return COMMAND.pack(0x5555AAAA, counter, dec_deg, ra_h, 0.0, 0.0, 0, 0, 0, 0, *flags)


def declinations(storm: Storm, aborted: int | None) -> list[float]:
    """Return the declination axis turn by turn through a slew that is aborted in a turn, until it rests."""
    stranger = Stranger(storm)
    places, ra_h = [START_DEG], 0.0
    while len(places) < ASKED_FOR + 20 or abs(places[-1] - places[-12]) > 1e-3:
        turn = len(places)
        if turn == ASKED_FOR:
            ra_h = stranger.mount.truth()[5] / 15.0
        if ASKED_FOR <= turn < ASKED_FOR + 6:
            stranger.receive(datagram(turn, START_DEG + WAY_DEG, ra_h, SLEW))
        else:
            aborts = aborted is not None and aborted <= turn < aborted + 6
            stranger.receive(datagram(turn, flag=ABORT if aborts else None))
        stranger.turn()
        places.append(stranger.truth().dec_axis_deg)
    return places


@pytest.mark.parametrize(
    ("seed", "stall_s", "at_least_deg"),
    [(452878, 0.1, 0.6), (453194, 0.1, 0.3), (451810, 0.0, 0.15), (451808, 0.0, 0.0), (451801, 0.0, 0.0)],
)
def test_an_aborted_slew_goes_no_farther_past_its_end_than_is_allowed_for(
    seed: int, stall_s: float, at_least_deg: float
) -> None:
    """Three planners of limited jerk, the slowest first, and two servos that only have to stop."""
    storm = draw(seed)
    storm = replace(
        storm,
        parameters=storm.parameters | {"abort_delay_s": 0.0, "stall_s": stall_s},
        stands=(0.0, START_DEG),
    )
    profile = storm.facts.profile
    start, end = Place(0.0, START_DEG), Place(0.0, START_DEG + WAY_DEG)
    own = declinations(storm, None)
    brakes_deg = end.dec_deg - 1.3 * 36.0 / (2.0 * storm.hardware.acceleration_deg_s2) - 3.0
    braking = [turn for turn, dec_deg in enumerate(own) if dec_deg > brakes_deg]
    past_deg = max(max(declinations(storm, turn)) for turn in braking[:60]) - end.dec_deg
    assert at_least_deg <= past_deg <= overshoot_deg(start, end, profile)[1]
