"""A camera's clock by the stars in its frames, while a mount follows that points beside what it reports."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import erfa
import msgspec
import numpy as np
import pytest

from sattrack.control.camera_clock import BEFORE, TERMS, CameraClocks, _Clock
from sattrack.control.camera_image import Cameras, Deviation
from sattrack.control.engine_view import loop_view
from sattrack.control.steering import Steering
from sattrack.mount.model import CalibrationRecord, MountProfile
from sattrack.runtime import demo_pass
from sattrack.views.formatting import camera_clock_text
from sattrack.views.messages import ObservationMessage, SolvedField, decode_observation, encode_message
from tle.bias import NO_BIAS
from tle.instants import Utc
from tle.observed import apparent_unit
from tle.propagator import Propagator
from tle.refraction import Refraction

if TYPE_CHECKING:
    from sattrack.views.run import ClockView

CULMINATION_S = float(Utc.parse("2026-10-02T13:05:24Z").unix_s)
BEGIN_S = CULMINATION_S - 70.0
ARCSEC = math.pi / 648000.0
TICK_S = 0.05
CALIBRATED = CalibrationRecord(
    utc="2026-10-01T00:00:00Z",
    program="sattrack",
    side_of_pier="normal",
    ra_gain_sigma=1e-4,
    dec_gain_sigma=1e-4,
    round_trip_s=0.01,
    round_trip_sigma_s=1e-4,
    command_delay_interval_s=(0.0, 0.01),
    status_delay_interval_s=(0.0, 0.01),
    clock_offset_interval_s=(-0.005, 0.005),
    clock_drift_ppm=1.0,
    clock_drift_sigma_ppm=1.0,
    status_period_s=0.05,
    status_period_jitter_s=0.001,
)


def direction(ra_deg: float, dec_deg: float) -> np.ndarray:
    return np.array(erfa.s2c(math.radians(ra_deg), math.radians(dec_deg)))


def icrs_of(unit: np.ndarray, utc_s: float, propagator: Propagator) -> tuple[float, float]:
    """Return the astrometric place that is seen in a direction of date, by iterating the forward way."""
    t, guess = Utc(utc_s), np.array(unit)
    for _ in range(8):
        ra, dec = (math.degrees(one) for one in erfa.c2s(guess))
        seen = apparent_unit(ra % 360.0, dec, t, "icrf", propagator.site, propagator.earth)
        guess = guess + unit - seen
        guess = guess / np.linalg.norm(guess)
    ra, dec = (math.degrees(one) for one in erfa.c2s(guess))
    return ra % 360.0, dec


class Pass:
    """A mount that follows the pass, its pole beside the true one, and a camera whose clock is off."""

    def __init__(
        self, clock_s: float, profile: MountProfile | None = None, noise_arcsec: float = 2.0
    ) -> None:
        self.clock_s, self.noise = clock_s, noise_arcsec
        self.propagator = Propagator(
            demo_pass.elements(), demo_pass.SITE.place(), refraction=Refraction.standard(0.0)
        )
        self.airless = self.propagator.with_place("apparent")
        self.steering = Steering(
            self.propagator, profile or MountProfile(), NO_BIAS, Cameras(), BEGIN_S - 5.0
        )
        self.rng = np.random.default_rng(5)

    def pointed(self, utc_s: float) -> np.ndarray:
        """Return where the telescope really points: the base is turned by 6′ about an axis in the equator."""
        seen = self.propagator.at(Utc(utc_s))
        sidereal = math.radians(float(seen.ra_deg) + float(seen.ha_deg))
        axis = np.array([math.cos(sidereal + 1.0), math.sin(sidereal + 1.0), 0.0])
        turned = seen.unit + np.cross(axis, seen.unit) * 360.0 * ARCSEC
        return turned / np.linalg.norm(turned)

    def field(self, utc_s: float, camera: str = "guide") -> SolvedField:
        """Return what the stars of an exposure show, dated by the camera's clock."""
        t = Utc(utc_s)
        bent = self.propagator.at(t).unit - self.airless.at(t).unit
        ra, dec = icrs_of(self.pointed(utc_s) - bent, utc_s, self.propagator)
        ra += self.rng.normal(0.0, self.noise) / 3600.0 / math.cos(math.radians(dec))
        dec += self.rng.normal(0.0, self.noise) / 3600.0
        return SolvedField(Utc(utc_s + self.clock_s).isoformat("microseconds"), ra, dec, self.noise, camera)

    def run(self, from_s: float, to_s: float, fields: bool = True) -> None:
        for tick in range(round(from_s / TICK_S), round(to_s / TICK_S)):
            now = BEGIN_S + tick * TICK_S
            status = self.propagator.at(Utc(now))
            self.steering.clocks.note(now, float(status.ra_deg), float(status.dec_deg))
            if fields and tick % 10 == 0:
                self.steering.clocks.hear(self.field(now - 0.1))
            self.steering.watch(now)

    @property
    def clock(self) -> ClockView:
        (found,) = self.steering.clocks.views()
        return found


@pytest.mark.parametrize("clock_s", [0.3, -0.3])
def test_a_clock_that_is_off_is_found_within_its_sigma_and_corrected(clock_s: float) -> None:
    one = Pass(clock_s)
    one.run(0.0, 40.0)
    found = one.clock
    assert found.clock_s == pytest.approx(clock_s, abs=0.01)
    assert found.corrected_s == found.clock_s
    # So is the mount's base, turned by 6′ about an axis in the equator, a radian from the meridian.
    (known,) = one.steering.clocks._clocks.values()
    assert known.solved()[0][1:3] / ARCSEC == pytest.approx(
        (360.0 * math.cos(1.0), 360.0 * math.sin(1.0)), abs=20.0
    )
    # A usual profile knows the delay of statuses to 20 ms, and nothing tells that from the clock.
    assert 0.02 <= found.sigma_s < 0.03
    side = "ahead" if clock_s > 0.0 else "behind"
    words = f"its clock is {abs(found.clock_s):.3f} ± {found.sigma_s:.3f} s {side}"
    assert words in camera_clock_text(found)
    assert "corrected" in camera_clock_text(found)
    loop = loop_view(cast("Any", SimpleNamespace(steering=one.steering)), BEGIN_S + 40.0)
    assert loop is not None
    assert loop.state == "elements"
    assert loop.clocks == (found,)


@pytest.mark.parametrize(("clock_s", "changes"), [(0.3, True), (0.0, False)])
def test_an_estimate_begins_anew_when_a_correction_changes_by_much_and_only_then(
    clock_s: float, changes: bool
) -> None:
    """What was seen by the wrong dates is of another place."""
    one, forgotten = Pass(clock_s), []
    one.steering.estimator.forget = lambda: forgotten.append(True)  # type: ignore[method-assign]
    one.run(0.0, 40.0)
    assert bool(forgotten) is changes


def test_a_right_clock_is_left_alone_all_the_time() -> None:
    one = Pass(0.0)
    for second in range(0, 60, 2):
        one.run(float(second), second + 2.0)
        assert one.clock.corrected_s == 0.0 if one.steering.clocks.views() else True
    assert abs(one.clock.clock_s) < 0.01


def test_sigmas_are_right_where_the_delays_were_measured() -> None:
    off = []
    for seed in range(12):
        one = Pass(0.05, noise_arcsec=8.0)
        one.rng = np.random.default_rng(seed)
        one.steering.clocks._delay_s = 0.0
        one.run(0.0, 14.0)
        off.append((one.clock.clock_s - 0.05) / one.clock.sigma_s)
    assert 0.3 < float(np.sqrt(np.mean(np.square(off)))) < 1.7


def test_the_stars_take_the_place_of_what_the_images_of_their_own_camera_showed() -> None:
    one = Pass(0.3)
    shown = {
        "guide": Deviation(clock_s=0.25),
        "finder": Deviation(clock_s=0.2),
        "turned": Deviation(180.0),
    }
    one.steering.estimator.deviations.update(shown)
    one.run(0.0, 40.0)
    assert one.steering.ahead_s("guide") == pytest.approx(0.3, abs=0.01)
    assert one.steering.ahead_s("finder") == 0.2
    # A camera that lies as set teaches the profile again.
    del shown["guide"]
    assert one.steering.estimator.deviations == shown


@pytest.mark.parametrize("camera", ["guide", None])
def test_it_is_told_once_that_a_correction_has_changed(camera: str | None) -> None:
    """Fields wait for the statuses about their dates, and are used in one go."""
    one = Pass(0.3)
    clocks, course = one.steering.clocks, one.steering.biases.course
    for tick in range(400):
        now = BEGIN_S + tick * TICK_S
        status = one.propagator.at(Utc(now))
        clocks.note(now, float(status.ra_deg), float(status.dec_deg))
        if tick % 20 == 0:
            clocks.hear(msgspec.structs.replace(one.field(now - 0.4), camera=camera))
    assert (clocks.views(), clocks.correction_s(camera)) == ((), 0.0)
    assert clocks.watch(course) is True
    assert clocks.correction_s(camera) == pytest.approx(0.3, abs=0.03)
    assert clocks.correction_s("another") == 0.0
    assert clocks.watch(course) is False
    assert not clocks.waiting


@pytest.mark.parametrize("towards_deg", [0.0, 45.0, 90.0, 135.0])
def test_a_field_is_off_by_as_much_in_whatever_direction(towards_deg: float) -> None:
    """Those an arcminute away from what the others say are left out."""
    one = Pass(0.0, noise_arcsec=0.5)
    # About right ascension 235°, far from both axes of the equator.
    one.run(67.0, 87.0)
    towards = math.radians(towards_deg)
    for off_arcsec, taken in ((70.0, 0), (-70.0, 0), (50.0, 1)):
        seen = one.field(BEGIN_S + 86.5)
        east, north = off_arcsec * math.sin(towards) / 3600.0, off_arcsec * math.cos(towards) / 3600.0
        ra_deg = seen.ra_deg + east / math.cos(math.radians(seen.dec_deg))
        one.steering.clocks.hear(msgspec.structs.replace(seen, ra_deg=ra_deg, dec_deg=seen.dec_deg + north))
        before = one.clock.frames
        one.steering.watch(BEGIN_S + 87.0)
        assert one.clock.frames == before + taken


def test_a_field_that_was_solved_wrongly_changes_nothing() -> None:
    one = Pass(0.3)
    one.run(0.0, 20.0)
    before = one.clock
    wrong = msgspec.structs.replace(one.field(BEGIN_S + 19.5), dec_deg=10.0)
    one.steering.clocks.hear(wrong)
    one.run(20.0, 21.0, fields=False)
    assert one.clock.clock_s == pytest.approx(before.clock_s, abs=0.005)


def test_observations_of_that_camera_are_dated_anew_and_others_are_not() -> None:
    one = Pass(0.3)
    one.run(0.0, 30.0)
    for camera, along_s in (("guide", 0.0), (None, -0.3)):
        one.steering.estimator.forget()
        for second in range(30, 36):
            now = BEGIN_S + second
            seen = one.airless.at(Utc(now))
            ra, dec = icrs_of(seen.unit, now, one.propagator)
            utc = Utc(now + 0.3).isoformat("microseconds")
            line = encode_message(ObservationMessage(utc, ra, dec, "icrs", 3.0, camera=camera))
            message = decode_observation(line)
            assert isinstance(message, ObservationMessage)
            one.steering.obey(message, now + 1.0)
        read = one.steering.estimator.reading(BEGIN_S + 35.0, one.steering.biases.course)
        assert read is not None
        assert read.along_s == pytest.approx(along_s, abs=0.02)


def test_fields_from_before_the_mount_was_heard_are_dropped() -> None:
    one = Pass(0.0)
    one.steering.clocks.hear(one.field(BEGIN_S - 30.0))
    one.run(0.0, 2.0, fields=False)
    assert one.steering.clocks.views() == ()


def test_a_field_is_used_once_there_are_statuses_from_both_sides_of_its_date() -> None:
    """Of a fifth of a second: it waits for the later ones, and without the earlier ones it is of no use."""
    one = Pass(0.0)
    one.run(0.0, 2.0, fields=False)
    for at_s in (0.19, 0.21, 1.74, 1.76):
        one.steering.clocks.hear(one.field(BEGIN_S + at_s))
    one.steering.watch(BEGIN_S + 2.0)
    assert (one.clock.frames, len(one.steering.clocks.waiting)) == (2, 1)
    one.run(2.0, 2.1, fields=False)
    assert (one.clock.frames, len(one.steering.clocks.waiting)) == (3, 0)


def test_of_the_fields_that_wait_the_last_fifty_are_kept() -> None:
    one, clocks = Pass(0.0), CameraClocks(MountProfile())
    seen = one.field(BEGIN_S)
    for number in range(60):
        clocks.hear(msgspec.structs.replace(seen, sigma_arcsec=1.0 + number))
    assert [field.sigma_arcsec for field in clocks.waiting] == [1.0 + number for number in range(10, 60)]


class TestByHand:
    def test_fields_are_solved_by_least_squares_with_what_was_presumed(self) -> None:
        """Rows over their sigmas, and one row a term over its own: numpy's solution of all of them."""
        rng = np.random.default_rng(2)
        clock = _Clock()
        rows, offs = [np.diag(1.0 / BEFORE)], [np.zeros(TERMS)]
        for sigma in (1e-5, 2e-5, 4e-5):
            row = rng.normal(0.0, 1.0, (2, TERMS))
            off = row @ (0.1 * BEFORE) + rng.normal(0.0, sigma, 2)
            assert clock.take(row, off, sigma) is True
            rows.append(row / sigma)
            offs.append(off / sigma)
        terms, spread = clock.solved()
        design, right = np.concatenate(rows), np.concatenate(offs)
        assert terms == pytest.approx(np.linalg.lstsq(design, right, rcond=None)[0], rel=1e-5, abs=1e-9)
        inverse = np.linalg.inv(design.T @ design)
        assert np.sqrt(np.diag(spread)) == pytest.approx(np.sqrt(np.diag(inverse)), rel=1e-6)
        assert (clock.frames, clock.left_out) == (3, 0)

    @pytest.mark.parametrize(
        ("before", "off_arcsec", "sigma_arcsec", "taken"),
        [
            (4, 61.0, 5.0, False),
            (4, 59.0, 5.0, True),
            (4, 61.0, 10.1, False),
            (4, 61.0, 10.2, True),
            (3, 61.0, 5.0, True),
        ],
    )
    def test_a_field_far_off_is_left_out_once_there_are_four(
        self, before: int, off_arcsec: float, sigma_arcsec: float, taken: bool
    ) -> None:
        """Farther than an arcminute, and than six sigmas."""
        clock = _Clock()
        row = np.zeros((2, TERMS))
        row[0, 4] = row[1, 5] = 1.0
        for _ in range(before):
            assert clock.take(row, np.zeros(2), 1e-3 * ARCSEC) is True
        assert clock.take(row, np.array([0.0, off_arcsec * ARCSEC]), sigma_arcsec * ARCSEC) is taken
        assert (clock.frames, clock.left_out) == ((before + 1, 0) if taken else (before, 1))

    def test_what_is_presumed_before_the_first_field(self) -> None:
        """A clock of 5 s, a base that is turned by 0.3°, a telescope that looks 0.1° aside."""
        assert BEFORE[0] == 5.0
        assert np.degrees(BEFORE[1:]) == pytest.approx([0.3] * 3 + [0.1] * 2)
        terms, spread = _Clock().solved()
        assert terms.tolist() == [0.0] * TERMS
        assert np.sqrt(np.diag(spread)) == pytest.approx(BEFORE)

    def test_a_field_counts_with_what_it_says_and_three_arcseconds_of_the_status(self) -> None:
        """How far the mount moves in a second tells the clock. Of sides 3 and 4, 5 is the hypotenuse."""
        one = Pass(0.0)
        one.run(0.0, 2.0, fields=False)
        one.steering.clocks.hear(msgspec.structs.replace(one.field(BEGIN_S + 1.0), sigma_arcsec=4.0))
        one.steering.watch(BEGIN_S + 2.0)
        (clock,) = one.steering.clocks._clocks.values()
        there = one.propagator.at(Utc(BEGIN_S + 1.0))
        east = float(there.ra_rate_deg_s) * math.cos(math.radians(float(there.dec_deg)))
        pace = math.radians(math.hypot(east, float(there.dec_rate_deg_s)))
        assert clock.information[0, 0] - 5.0**-2 == pytest.approx((pace / (5.0 * ARCSEC)) ** 2, rel=1e-3)

    def test_between_statuses_the_mount_is_on_a_parabola(self) -> None:
        clocks = CameraClocks(MountProfile())

        def ra(t: float) -> float:
            return 359.9 + 0.4 * t + 0.3 * t * t

        def dec(t: float) -> float:
            return 20.0 - 0.2 * t + 0.1 * t * t

        for number in range(41):
            t = 0.05 * number
            clocks.note(BEGIN_S + t, ra(t) % 360.0, dec(t))
        clocks.note(BEGIN_S + 1.0, 0.0, 0.0)
        assert len(clocks._statuses) == 41
        for t in (0.33, 1.02, 1.61):
            here, rate = clocks._pointing(BEGIN_S + t)
            alpha, delta = math.radians(ra(t)), math.radians(dec(t))
            assert here == pytest.approx(np.array(erfa.s2c(alpha, delta)), abs=1e-8)
            west, up = math.radians(0.4 + 0.6 * t) * math.cos(delta), math.radians(-0.2 + 0.2 * t)
            assert math.hypot(*rate) == pytest.approx(math.hypot(west, up), rel=1e-4)
            assert rate @ here == pytest.approx(0.0, abs=1e-4)

    @pytest.mark.parametrize(
        ("clock_s", "sigma_s", "frames", "corrected"),
        [
            (0.1, 0.01, 4, True),
            (-0.1, 0.01, 4, True),
            (0.1, 0.01, 3, False),
            (0.031, 0.001, 9, True),
            (0.029, 0.001, 9, False),
            (0.19, 0.05, 9, False),
            (0.21, 0.05, 9, True),
            (0.9, 0.11, 9, False),
        ],
    )
    def test_a_clock_is_corrected_by_four_sigmas_and_30_ms(
        self, clock_s: float, sigma_s: float, frames: int, corrected: bool
    ) -> None:
        clocks, clock = CameraClocks(MountProfile()), _Clock(frames=frames)
        clocks._read = lambda _: (clock_s, sigma_s)  # type: ignore[method-assign]
        assert clocks._apply(clock) is corrected
        assert clock.applied_s == clock.begun_s == (clock_s if corrected else 0.0)
        if corrected:
            # It follows what is found, and an estimate begins anew only where that goes far.
            clocks._read = lambda _: (clock_s + 0.02, 0.001)  # type: ignore[method-assign]
            assert clocks._apply(clock) is False
            assert (clock.applied_s, clock.begun_s) == (clock_s + 0.02, clock_s)
            clocks._read = lambda _: (clock_s + 0.04, 0.01)  # type: ignore[method-assign]
            assert clocks._apply(clock) is True
            assert clock.begun_s == clock_s + 0.04

    def test_the_statuses_delay_limits_what_is_known(self) -> None:
        clocks, clock = CameraClocks(MountProfile()), _Clock()
        assert clocks._read(clock) == (0.0, pytest.approx(math.hypot(5.0, 0.02)))
        clock.information[0, 0] = 0.01**-2
        assert clocks._read(clock)[1] == pytest.approx(math.hypot(0.01, 0.02))
        clocks._clocks["guide"] = clock
        clock.applied_s, clock.frames = 0.3, 7
        assert (clocks.correction_s("guide"), clocks.correction_s("other"), clocks.correction_s(None)) == (
            0.3,
            0.0,
            0.0,
        )
        measured = CameraClocks(MountProfile(calibration=CALIBRATED))
        assert measured._read(clock)[1] == pytest.approx(math.hypot(0.01, 0.002))
        (view,) = clocks.views()
        assert (view.camera, view.frames, view.corrected_s) == ("guide", 7, 0.3)
