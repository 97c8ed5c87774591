"""What an axis must report to stand at an angle, and when a table is left aside; by closed forms."""

from __future__ import annotations

import math
import random

import msgspec
import pytest
from feeder_passes import subjects

from sattrack.mount.geometry import Pole
from sattrack.mount.model import PeriodicErrors, PointingTerms, Wave, mean_sidereal_deg
from sattrack.pointing.periodic import AxisStand, PeriodicTable, TableJudge, past_pole, zeros_moved
from sattrack.runtime.facts import build_engine

EVERYWHERE = ((0.0, 360.0),)
GEARS = PeriodicErrors(
    "2026-10-02T00:00:00Z",
    3,
    (Wave(7, 6.0, -8.0, 0.1),),
    (Wave(360, 0.0, 5.0, 0.1), Wave(2, 30.0, 0.0, 0.1)),
    EVERYWHERE,
    EVERYWHERE,
)


@pytest.mark.parametrize("first", [-170.0, -33.3, 0.0, 12.0, 200.0])
@pytest.mark.parametrize("second", [-40.0, 61.7, 130.0])
def test_axes_that_report_so_stand_where_they_should(first: float, second: float) -> None:
    told = PeriodicTable(GEARS).reported(AxisStand(first, second))
    a, b = math.radians(told.first_deg), math.radians(told.second_deg)
    stands = told.first_deg + (6.0 * math.sin(7.0 * a) - 8.0 * math.cos(7.0 * a)) / 3600.0
    lifted = told.second_deg + (5.0 * math.cos(360.0 * b) + 30.0 * math.sin(2.0 * b)) / 3600.0
    assert (stands, lifted) == pytest.approx((first, second), abs=1e-8)


def test_rates_are_the_derivatives_of_what_is_reported() -> None:
    table, step_s = PeriodicTable(GEARS), 1e-3
    rates = (0.4, -0.3)

    def at(seconds: float) -> AxisStand:
        return table.reported(AxisStand(20.0 + rates[0] * seconds, 50.0 + rates[1] * seconds, *rates))

    before, here, after = (at(seconds) for seconds in (-step_s, 0.0, step_s))
    assert here.first_rate_deg_s == pytest.approx((after[0] - before[0]) / (2 * step_s), abs=1e-9)
    assert here.second_rate_deg_s == pytest.approx((after[1] - before[1]) / (2 * step_s), abs=1e-6)


def test_beside_what_passes_have_seen_a_table_fades_out() -> None:
    seen = ((0.0, 30.0), (350.0, 360.0))
    table = PeriodicTable(PeriodicErrors("", 3, (Wave(4, 0.0, 10.0, 0.1),), (), seen, ()))

    def error_arcsec(angle: float) -> float:
        return 3600.0 * table.error_deg(AxisStand(angle, 0.0))[0]

    assert error_arcsec(0.0) == error_arcsec(360.0) == pytest.approx(10.0)
    assert error_arcsec(-5.0) == pytest.approx(10.0 * math.cos(math.radians(20.0)))
    assert error_arcsec(34.0) == pytest.approx(5.0 * math.cos(math.radians(4 * 34.0)))
    assert error_arcsec(-14.0) == pytest.approx(5.0 * math.cos(math.radians(4 * 14.0)))
    assert error_arcsec(60.0) == error_arcsec(180.0) == 0.0
    told = [table.reported(AxisStand(34.0 + 0.5 * s, 0.0, 0.5, 0.0)) for s in (-1e-3, 0.0, 1e-3)]
    assert told[1].first_rate_deg_s == pytest.approx((told[2][0] - told[0][0]) / 2e-3, abs=1e-9)


def test_a_wave_that_comes_too_fast_for_a_servo_is_left_out() -> None:
    table = PeriodicTable(PeriodicErrors("", 3, (Wave(360, 0.0, 10.0, 0.1),), (), EVERYWHERE, ()))
    slow, middle, fast = (
        3600.0 * table.error_deg(AxisStand(0.0, 0.0, rate, 0.0))[0] for rate in (0.5, 3.0, 20.0)
    )
    assert slow == pytest.approx(10.0, rel=0.001)
    assert middle == pytest.approx(5.0)
    assert abs(fast) < 0.01


@pytest.mark.parametrize("north", [True, False])
def test_past_the_pole_and_back_is_the_same_direction(north: bool) -> None:
    there = past_pole(AxisStand(10.0, 70.0, 0.1, 0.2), north)
    assert abs(there.second_deg) > 90.0
    assert there.second_deg > 0.0 if north else there.second_deg < 0.0
    back = past_pole(there, north)
    assert (back.first_deg % 360.0, *back[1:]) == pytest.approx((10.0, 70.0, 0.1, 0.2))


def judged(turned_deg: float, seed: int, share: float = 1.0, corrected_hz: float = 0.0) -> bool:
    """Tell what a judge says of a mount whose gear has a share of a table's wave, turned; with noise of 1.5″.

    Corrections take a slow wave away as a filter of first order does.
    """
    wave = Wave(7, 6.0, -8.0, 0.1)
    judge, rng = TableJudge(PeriodicErrors("", 3, (wave,), ())), random.Random(seed)
    rate_deg_s, followed, before = 0.5, 0.0, 0.0
    for k in range(300):
        angle = math.radians(7.0 * rate_deg_s * k)
        turned = angle + math.radians(turned_deg)
        true = share * (6.0 * math.sin(turned) - 8.0 * math.cos(turned))
        left = 6.0 * math.sin(angle) - 8.0 * math.cos(angle) - true
        followed = left if not corrected_hz else followed * math.exp(-math.tau * corrected_hz) + left - before
        before = left
        seen = followed + rng.gauss(0.0, 1.5), rng.gauss(0.0, 1.5)
        judge.take(float(k), seen, AxisStand(rate_deg_s * k, 30.0, rate_deg_s, 0.2), 1.0)
    return judge.harms


@pytest.mark.parametrize("turned_deg", [120.0, 180.0, -100.0])
def test_a_table_of_a_gear_that_was_turned_is_left_aside_though_a_camera_corrects(turned_deg: float) -> None:
    assert all(judged(turned_deg, seed, corrected_hz=0.05) for seed in range(5))


def test_a_table_is_left_aside_where_there_is_nothing_of_the_kind() -> None:
    assert all(judged(0.0, seed, share=0.0) for seed in range(5))


def test_a_table_that_holds_or_nearly_is_never_left_aside() -> None:
    for corrected_hz in (0.0, 0.02, 0.05, 0.1):
        assert not any(judged(0.0, seed, corrected_hz=corrected_hz) for seed in range(10))
        assert not any(judged(5.0, seed, 0.95, corrected_hz) for seed in range(5))


def test_a_star_run_shows_that_zero_points_have_moved() -> None:
    before = PointingTerms("", 52.0, {"IH": (10.0, 1.0), "ID": (0.0, 1.0)}, 1.0, 12)
    near = PointingTerms("", 52.0, {"IH": (100.0, 1.0), "ID": (20.0, 1.0)}, 1.0, 12)
    far = PointingTerms("", 52.0, {"IH": (10.0, 1.0), "ID": (400.0, 1.0)}, 1.0, 12)
    assert not zeros_moved(GEARS, before, near)
    assert zeros_moved(GEARS, before, far)
    # Nobody knows where the signs of one are unknown, or its terms are about other axes.
    assert zeros_moved(GEARS, before, msgspec.structs.replace(near, signs="tpoint"))
    tilted = [msgspec.structs.replace(near, axes=Pole(20.0, altitude)) for altitude in (30.0, 30.05, 30.2)]
    assert zeros_moved(GEARS, before, tilted[0])
    assert not zeros_moved(GEARS, *tilted[:2])
    assert zeros_moved(GEARS, *tilted[::2])


def test_a_run_feeds_what_the_axes_must_report() -> None:
    facts = subjects()[0].facts
    plain = build_engine(facts).tracker
    geared = build_engine(
        msgspec.structs.replace(facts, profile=msgspec.structs.replace(facts.profile, periodic=GEARS))
    ).tracker
    for seconds in (-60.0, 0.0, 60.0):
        utc_s = facts.culminate_utc_s + seconds
        wanted, fed = plain.fed_at(utc_s), geared.fed_at(utc_s)
        sidereal = mean_sidereal_deg(utc_s, facts.site.longitude_deg)
        angle, lifted = math.radians(sidereal - fed.ra_deg), math.radians(fed.dec_deg)
        west = (6.0 * math.sin(7.0 * angle) - 8.0 * math.cos(7.0 * angle)) / 3600.0
        north = (5.0 * math.cos(360.0 * lifted) + 30.0 * math.sin(2.0 * lifted)) / 3600.0
        assert math.remainder(fed.ra_deg - west - float(wanted.ra_deg), 360.0) == pytest.approx(0.0, abs=3e-6)
        assert fed.dec_deg + north - float(wanted.dec_deg) == pytest.approx(0.0, abs=3e-6)
        shown = geared.periodic_arcsec(utc_s)
        on_sky = 3600.0 * west * math.cos(lifted), 3600.0 * north
        assert shown == pytest.approx(on_sky, abs=0.02)
        later = geared.fed_at(utc_s + 0.01)
        assert fed.ra_rate_deg_s == pytest.approx(
            math.remainder(later.ra_deg - geared.fed_at(utc_s - 0.01).ra_deg, 360.0) / 0.02, abs=2e-5
        )
