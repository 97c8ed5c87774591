"""The sky of the practice pass against closed forms, the rehearsal's own keyhole and skyfield."""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import UTC, datetime

import msgspec
import numpy as np
import pytest
from skyfield.api import EarthSatellite, load, wgs84

from sattrack.cli.running import announcement
from sattrack.control.engine_view import view_of
from sattrack.core.clock import make_clock
from sattrack.mount.geometry import AxisGeometry
from sattrack.mount.model import CalibrationRecord, MountProfile, SitePlace
from sattrack.mount.profiles import profile_file
from sattrack.runtime import demo_pass
from sattrack.runtime.facts import RunRequest, build_engine, prepare
from sattrack.runtime.flight import RunStatistics, summarise
from sattrack.runtime.pass_scene import keyhole_deg, pass_scene, uncalibrated
from sattrack.views.formatting import summary_lines
from sattrack.views.run import CameraSummary

FACTS = prepare(
    RunRequest(
        satellite=demo_pass.NAME,
        mount_url="sim",
        elements=[demo_pass.elements()],
        site=demo_pass.SITE.place(),
        clock_option=demo_pass.BEFORE_PASS,
        min_alt_deg=10.0,
    )
).facts
SCENE = pass_scene(FACTS)


def test_the_path_is_that_of_another_library() -> None:
    times = load.timescale(builtin=True)
    site = FACTS.site
    place = wgs84.latlon(site.latitude_deg, site.longitude_deg, elevation_m=site.height_m)
    seen = EarthSatellite(demo_pass.LINE_1, demo_pass.LINE_2, ts=times) - place
    for point in SCENE.path[10:-10:20]:
        at = times.from_datetime(datetime.fromtimestamp(point.utc_s, UTC))
        alt, az, _ = seen.at(at).altaz(temperature_C=FACTS.temperature_c, pressure_mbar=FACTS.pressure_hpa)
        assert point.alt_deg == pytest.approx(alt.degrees, abs=0.03)
        assert point.az_deg == pytest.approx(az.degrees, abs=0.15)


def test_the_path_goes_from_the_beginning_to_the_end_and_says_whether_those_are_rise_and_set() -> None:
    assert SCENE.path[0].utc_s == pytest.approx(FACTS.plan.start_utc_s, abs=1e-3)
    assert SCENE.path[-1].utc_s == pytest.approx(FACTS.plan.end_utc_s, abs=1e-3)
    highest = max(SCENE.path, key=lambda point: point.alt_deg)
    assert abs(highest.utc_s - SCENE.culminate_utc_s) < 5.0
    assert (SCENE.rises, SCENE.sets) == (True, True)
    late = msgspec.structs.replace(FACTS, started_utc_s=FACTS.plan.start_utc_s)
    assert not pass_scene(late).rises


def test_a_second_of_bias_moves_the_satellite_by_its_own_speed_over_its_range() -> None:
    overhead = max(SCENE.path, key=lambda point: point.alt_deg)
    # 7.66 km/s relative to the turning ground less 0.2 km/s or so, 420 km above: an arctangent a second.
    assert overhead.along_deg_s == pytest.approx(math.degrees(7.4 / 425.0), rel=0.06)
    assert SCENE.path[0].along_deg_s < 0.15 * overhead.along_deg_s


def test_the_sun_stands_where_the_almanac_has_it_to_a_degree() -> None:
    # Solar declination on 2 October is -3.5 degrees, the equation of time +10.6 minutes.
    first = SCENE.sun[0]
    hour_angle = math.radians((first.utc_s % 86400.0 / 3600.0 - 12.0 + 10.6 / 60.0) * 15.0 + 4.4908)
    latitude, dec = math.radians(52.1541), math.radians(-3.5)
    sine = math.sin(latitude) * math.sin(dec) + math.cos(latitude) * math.cos(dec) * math.cos(hour_angle)
    assert first.alt_deg == pytest.approx(math.degrees(math.asin(sine)), abs=1.0)
    assert 180.0 < first.az_deg < 225.0


def test_the_keyhole_is_where_the_hour_angle_outruns_the_axis() -> None:
    speed, limit = 1.0, 6.0
    found = keyhole_deg(np.array([10.0, 85.0]), np.radians([[0.3, 0.0, 0.0], [0.0, speed, 0.0]]), limit)
    assert found is not None
    assert speed / math.sin(math.radians(found)) == pytest.approx(limit)
    assert keyhole_deg(np.array([85.0]), np.radians([[7.0, 0.0, 0.0]]), limit) is None
    assert keyhole_deg(np.array([np.nan]), np.full((1, 3), np.nan), limit) is None


def test_an_error_to_expect_grows_with_the_age_of_the_elements() -> None:
    assert SCENE.along_arcsec is not None
    old = msgspec.structs.replace(
        FACTS, elements=replace(FACTS.elements, epoch=FACTS.elements.epoch.plus(-10 * 86400.0))
    )
    older = pass_scene(old).along_arcsec
    assert older is not None
    assert older > 2.0 * SCENE.along_arcsec


def test_it_is_small_enough_to_be_told_at_once() -> None:
    assert len(msgspec.json.encode(SCENE)) < 16_384


def test_what_a_limit_takes_of_the_pass_is_told_before_it() -> None:
    """The declination axis ends at 40°: lost while skyfield's declination is higher, and a second before."""
    low = msgspec.structs.replace(FACTS, profile=MountProfile(dec_axis_limits_deg=(-90.0, 40.0)))
    times = load.timescale(builtin=True)
    place = wgs84.latlon(FACTS.site.latitude_deg, FACTS.site.longitude_deg, elevation_m=FACTS.site.height_m)
    seen = EarthSatellite(demo_pass.LINE_1, demo_pass.LINE_2, ts=times) - place
    utc_s = np.arange(FACTS.plan.start_utc_s, FACTS.plan.end_utc_s, 1.0)
    decs = seen.at(times.from_datetimes([datetime.fromtimestamp(t, UTC) for t in utc_s.tolist()])).hadec()[1]
    beyond = np.flatnonzero(decs.degrees > 40.0)
    assert 20 < len(beyond) < len(utc_s) - 20

    scene = pass_scene(low)
    assert scene.lost_to == "declination"
    assert scene.lost_s == pytest.approx(len(beyond), abs=4.0)
    assert scene.lost_from_utc_s == pytest.approx(utc_s[beyond[0]], abs=4.0)
    (words,) = (line for line in announcement(low) if "lost" in line)
    assert words.startswith(f"about {scene.lost_s:.0f} s of the pass will be lost, most from ")
    assert words.endswith("° past the limit; `sattrack rehearse` shows it")
    assert (SCENE.lost_s, SCENE.lost_to, SCENE.lost_from_utc_s) == (0.0, None, None)
    assert not any("lost" in line for line in announcement(FACTS))


def test_what_begins_or_ends_high_up_neither_rises_nor_sets() -> None:
    plan = msgspec.structs.replace(
        FACTS.plan, start_utc_s=FACTS.culminate_utc_s - 20.0, end_utc_s=FACTS.culminate_utc_s + 20.0
    )
    scene = pass_scene(msgspec.structs.replace(FACTS, plan=plan))

    assert (scene.rises, scene.sets) == (False, False)


def test_what_is_said_before_a_run_tells_a_pass_to_come_from_one_that_goes_on_and_one_without_an_end() -> (
    None
):
    plan = FACTS.plan

    def said(started_utc_s: float, **times: float) -> str:
        changed = msgspec.structs.replace(plan, **times)
        return announcement(msgspec.structs.replace(FACTS, plan=changed, started_utc_s=started_utc_s))[0]

    assert said(plan.start_utc_s - 65.0) == (
        "ISS (ZARYA) from Fri 2 Oct 2026 13:01:59 to 13:08:49 UTC, 81.3° high, begins in 1 min"
    )
    assert said(plan.start_utc_s - 5.0).endswith("begins in 5 s")
    assert said(plan.start_utc_s) == "ISS (ZARYA) is up now, until 13:08:49 UTC, 81.3° high"
    # What is followed of it ends a minute after the rise, or begins after the culmination.
    cut = said(plan.start_utc_s, end_utc_s=plan.start_utc_s + 60.0)
    assert cut == "ISS (ZARYA) is up now, until 13:02:59 UTC, 81.3° high at 13:05:24"
    assert said(plan.end_utc_s - 60.0).endswith(", until 13:08:49 UTC, 81.3° high at 13:05:24")
    ever = said(plan.start_utc_s, end_utc_s=plan.start_utc_s + 48.0 * 3600.0)
    assert ever == "ISS (ZARYA) is up, and stays up for the next 48 h and longer, 81.3° high"
    longer = said(plan.start_utc_s - 3600.0, end_utc_s=plan.start_utc_s + 40.0 * 3600.0)
    assert " from Fri 2 Oct 2026 13:01:59 to Sun 4 Oct 2026 05:01:59 UTC, " in longer


MEASURED = MountProfile(
    calibration=CalibrationRecord(
        "2026-09-01T20:00:00Z", "test", "normal", *(1e-5, 1e-5, 0.01, 1e-4), (0.0, 1e-4), (0.0, 1e-4),
        (0.0, 1e-4), *(0.0, 1.0, 0.05, 1e-4),
    )
)  # fmt: skip
REAL = msgspec.structs.replace(FACTS, mount_name="xerxes://192.0.2.7:15001")


def test_what_an_uncalibrated_mount_costs_is_the_passs_greatest_speed_times_a_delay() -> None:
    times = load.timescale(builtin=True)
    site = FACTS.site
    place = wgs84.latlon(site.latitude_deg, site.longitude_deg, elevation_m=site.height_m)
    seen = EarthSatellite(demo_pass.LINE_1, demo_pass.LINE_2, ts=times) - place

    def direction(utc_s: float) -> np.ndarray:
        at = seen.at(times.from_datetime(datetime.fromtimestamp(utc_s, UTC))).position.km
        return at / np.linalg.norm(at)

    about = FACTS.culminate_utc_s
    fastest = max(np.linalg.norm(direction(about + s + 1.0) - direction(about + s)) for s in range(-20, 20))
    arcsec = math.degrees(fastest) * 3600.0 * 0.02
    words = uncalibrated(REAL)
    assert words is not None
    begun, cost, ended = words.partition(f"{arcsec:.0f}″")
    assert begun == "uncalibrated: delays and gains are the default profile's; 20 ms of delay are up to "
    assert cost
    assert ended == " at this pass's fastest; run `sattrack mount calibrate`"
    assert words in announcement(REAL)
    dome = msgspec.structs.replace(REAL, profile=MountProfile(name="dome"))
    assert "those of the profile 'dome', not measured;" in (uncalibrated(dome) or "")


def test_a_mount_with_a_geometry_is_told_what_can_be_measured_of_it() -> None:
    site = FACTS.site
    stands = SitePlace(site.latitude_deg, site.longitude_deg)
    altaz = MountProfile(name="altaz", geometry=AxisGeometry(0.0, 90.0), stands_at=stands, additive=False)
    words = uncalibrated(msgspec.structs.replace(REAL, profile=altaz)) or ""
    assert words.endswith("; let `sattrack track --learn-profile FILE` learn the mount in a pass")
    for profile, assumed in ((altaz, False), (MountProfile(), True)):
        request = RunRequest(
            satellite=demo_pass.NAME,
            mount_url="alpaca://127.0.0.1:9/0",
            elements=[demo_pass.elements()],
            site=demo_pass.SITE.place(),
            clock_option=None,
            clock=make_clock(demo_pass.BEFORE_PASS)[0],
            min_alt_deg=10.0,
            profile=profile_file(profile),
        )
        notes = prepare(request).notes
        assert any("is assumed to be equatorial" in note for note in notes) is assumed


def test_nothing_is_said_of_a_calibrated_mount_or_of_the_simulated_one() -> None:
    measured = msgspec.structs.replace(REAL, profile=MEASURED)
    assert uncalibrated(measured) is None
    assert uncalibrated(FACTS) is None
    assert not any("uncalibrated" in words for one in (measured, FACTS) for words in announcement(one))


def test_view_and_summary_say_whether_the_profile_was_measured() -> None:
    for facts, calibrated, named in (
        (REAL, False, True),
        (msgspec.structs.replace(REAL, profile=MEASURED), True, False),
        (FACTS, False, False),
    ):
        engine = build_engine(facts)
        assert view_of(engine, facts.plan.start_utc_s).calibrated is calibrated
        summary = summarise(engine, RunStatistics(), facts.plan.end_utc_s)
        assert summary.calibrated is calibrated
        assert ("uncalibrated" in summary_lines(summary)[0]) is named


@pytest.mark.parametrize(
    ("frames", "detected", "line"),
    [
        (0, 0, "  cameras: 0 frames, the satellite found in 0"),
        (1, 1, "  cameras: 1 frame, the satellite found in 1"),
        (
            255,
            0,
            "  cameras: 255 frames, the satellite found in 0: it was out of the field, or too faint; "
            "try a wider camera, or --bias-along",
        ),
    ],
)
def test_a_summary_says_what_the_cameras_came_to(frames: int, detected: int, line: str) -> None:
    engine = build_engine(FACTS)
    summary = summarise(engine, RunStatistics(), FACTS.plan.end_utc_s)
    assert not any("cameras" in words for words in summary_lines(summary))
    seen = CameraSummary(frames, detected, 0, 0, None)
    assert line in summary_lines(msgspec.structs.replace(summary, camera=seen))
