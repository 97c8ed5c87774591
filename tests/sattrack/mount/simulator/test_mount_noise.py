"""Whatever a simulated mount is told, it stays within its limits, counts what it refuses, and does not grow.

Bad input is drawn by seed: random bytes, wrong lengths and headers, commands with anything in their fields.
"""

from __future__ import annotations

import random
import tracemalloc

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import astuple
from simulator_bench import PERIOD_S, SITE, START, T0

from sattrack.mount.model import AxisLimits, MountProfile
from sattrack.mount.simulator.mount import SimulatedMount
from sattrack.mount.simulator.profile import ServoSettings, SimulatorProfile
from sattrack.mount.xerxes.datagrams import Command, encode_command

RA, DEC = AxisLimits(4.0, 8.0, 5.0), AxisLimits(3.0, 6.0, 4.0)
PLAIN = SimulatorProfile()
REAL = SimulatorProfile(
    servo=ServoSettings(
        bandwidth_hz=10.0, integral_hz=1.0, stiction_a=0.6, friction_feedforward=0.5, ripple_a=0.03
    )
)
HOW_MANY = [30_000, pytest.param(1_000_000, marks=pytest.mark.soak)]
VALID = encode_command(Command(slew=True, target_ra_h=3.0, target_dec_deg=20.0))
GROWTH_BYTES = 100_000

COMMANDS = st.builds(
    Command,
    target_dec_deg=st.floats(-90.0, 90.0),
    target_ra_h=st.floats(0.0, 24.0),
    move_dec_rate_deg_s=st.floats(-20.0, 20.0),
    move_ra_rate_deg_s=st.floats(-20.0, 20.0),
    dec_fine_rate_dtics_s=st.integers(-(2**40), 2**40),
    ra_fine_rate_dtics_s=st.integers(-(2**40), 2**40),
    pulse_ra_ms=st.integers(-3000, 3000),
    pulse_dec_ms=st.integers(-3000, 3000),
    **{
        name: st.booleans()
        for name in ("abort", "find_home", "move_ra", "move_dec", "park", "pulse_guide", "slew", "sync")
    },
)


@given(
    orders=st.lists(st.tuples(COMMANDS, st.integers(1, 12)), min_size=1, max_size=10),
    how=st.sampled_from(["held", "edge"]),
    hardware=st.sampled_from([PLAIN, REAL]),
    watchdog_s=st.sampled_from([None, 0.3]),
)
@settings(max_examples=60, deadline=None)
def test_no_orders_take_the_axes_beyond_rate_acceleration_or_cable(
    orders: list[tuple[Command, int]], how: str, hardware: SimulatorProfile, watchdog_s: float | None
) -> None:
    profile = MountProfile(ra=RA, dec=DEC, move_axis=how, watchdog_s=watchdog_s, hour_angle_limit_deg=100.0)  # type: ignore[arg-type]
    mount = SimulatedMount(profile, SITE, START, hardware)
    exact = hardware is PLAIN
    room, now = (1e-6, T0) if exact else (0.25, T0)
    _, before = mount.tick(now)
    for command, turns in orders:
        mount.receive(encode_command(command))
        for _ in range(turns):
            now += PERIOD_S
            _, truth = mount.tick(now)
            for position, was, rate, rate_was, limits in (
                (
                    truth.hour_angle_axis_deg,
                    before.hour_angle_axis_deg,
                    truth.ra_rate_deg_s,
                    before.ra_rate_deg_s,
                    RA,
                ),
                (truth.dec_axis_deg, before.dec_axis_deg, None, None, DEC),
            ):
                # A slew's rate is that against the sky, an axis' own may be more by the sky's.
                assert abs(position - was) <= (limits.slew_rate_deg_s + 0.0043 + room) * PERIOD_S
                assert abs(position) <= 110.0 + room
                if exact and rate is not None and rate_was is not None:
                    assert abs(rate - rate_was) <= limits.max_acceleration_deg_s2 * PERIOD_S + 1e-6
            before = truth


@pytest.mark.parametrize("count", HOW_MANY)
def test_garbage_is_counted_moves_nothing_and_leaves_nothing_behind(count: int) -> None:
    rng = random.Random(11)
    noisy, quiet = (SimulatedMount(MountProfile(), SITE, START) for _ in range(2))
    now = T0

    def garbage() -> bytes:
        match rng.randrange(4):
            case 0:
                return rng.randbytes(rng.randrange(200))
            case 1:
                return VALID[: rng.randrange(82)]
            case 2:
                return VALID + rng.randbytes(rng.randrange(1, 60))
        header = bytearray(VALID)
        header[rng.randrange(8)] ^= 1 << rng.randrange(8)
        return bytes(header)

    def turns(number: int) -> None:
        nonlocal now
        for _ in range(number):
            for _ in range(20):
                assert noisy.receive(garbage()) is False
            now += PERIOD_S
            (status, truth), (expected_status, expected) = noisy.tick(now), quiet.tick(now)
            assert status == expected_status
            assert astuple(truth) == astuple(expected)

    turns(100)
    tracemalloc.start()
    turns(500)
    first, _ = tracemalloc.get_traced_memory()
    turns(500)
    second, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    turns(count // 20 - 1100)
    assert noisy.refused == count
    assert quiet.refused == 0
    assert second - first < GROWTH_BYTES


@pytest.mark.parametrize("count", HOW_MANY)
def test_mutated_commands_are_counted_or_obeyed_within_the_limits(count: int) -> None:
    rng = random.Random(12)
    mount = SimulatedMount(MountProfile(ra=RA, dec=DEC), SITE, START)
    now, taken = T0, 0
    for number in range(count):
        data = bytearray(VALID)
        for _ in range(rng.randrange(1, 5)):
            data[rng.randrange(8, 82)] = rng.randrange(256)
        taken += mount.receive(bytes(data))
        if number % 5 == 0:
            now += PERIOD_S
            status, truth = mount.tick(now)
            assert len(status) == 160
            assert abs(truth.ra_rate_deg_s) <= 5.0 + 0.0043
            assert abs(truth.dec_rate_deg_s) <= 4.0 + 1e-9
            assert -90.0 <= truth.dec_deg <= 90.0
        if number % 1000 == 999:
            mount.restart(now)
    assert taken + mount.refused == count
    assert 0 < mount.refused < count
