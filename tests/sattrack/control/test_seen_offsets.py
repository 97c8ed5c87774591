"""Offsets that a camera on the mount sees, closed into a loop with a mount whose errors nobody knows."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import msgspec
import numpy as np
import pytest

from sattrack.control.camera_image import UPRIGHT, Camera, Cameras
from sattrack.control.engine_view import loop_view
from sattrack.control.steering import Steering
from sattrack.mount.model import MountProfile
from sattrack.runtime import demo_pass
from sattrack.runtime.facts import RunRequest, build_engine, prepare
from sattrack.views.messages import Guide, OffsetBy, Search, SeenOffset
from tle.bias import NO_BIAS
from tle.instants import Utc
from tle.orbit_fit import STATES, CorrectableOrbit, cross_product
from tle.propagator import Propagator
from tle.refraction import Refraction

if TYPE_CHECKING:
    from sattrack.control.biases import Biases
    from sattrack.control.tracker import Tracker
    from sattrack.views.run import LoopView

CULMINATION_S = float(Utc.parse("2026-10-02T13:05:24Z").unix_s)
BEGIN_S = CULMINATION_S - 60.0
SIGMA_ARCSEC = 1.5
EARTH_RAD_S = 7.2921159e-5
POLE = np.array([0.0, 0.0, 1.0])
ARCSEC = math.pi / 648000.0
PERIOD_S, TICK_S = 0.05, 0.1
"""Of the feeder, and of what is looked at here."""
LATE_S = 0.6
ELEMENTS_OFF_KM = np.array([23.0, 0.2, 0.3, -0.3, 0.2, 0.2])


@dataclass
class Loop:
    """A steered mount that points beside what it is fed, and its camera at 2 Hz."""

    camera: Camera = UPRIGHT
    turn_arcsec: tuple[float, float, float] = (0.0, 0.0, 0.0)
    delay_s: float = 0.0
    seed: int = 1
    clouds_s: tuple[float, float] = (math.inf, math.inf)
    profile: MountProfile = field(default_factory=MountProfile)
    cameras: Cameras | None = None
    beside_arcsec: tuple[float, float] | None = None
    """Where a coarse camera sees what is in the middle of the fine one, which sees 0.1° only."""
    times: list[float] = field(default_factory=list)
    off_arcsec: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        believed = Propagator(
            demo_pass.elements(), demo_pass.SITE.place(), refraction=Refraction.standard(0.0)
        )
        orbit = CorrectableOrbit(demo_pass.elements(), Utc(BEGIN_S))
        self.true = believed.with_elements(orbit.corrected(ELEMENTS_OFF_KM))
        self.steering = Steering(
            believed, self.profile, NO_BIAS, self.cameras or Cameras(self.camera), BEGIN_S - 5.0
        )
        self.rng = np.random.default_rng(self.seed)
        self.waiting: list[SeenOffset] = []

    def wanted(self, utc_s: float) -> np.ndarray:
        """Return where the mount must be fed to for the satellite to be in the middle, by hand."""
        seen = self.true.at(Utc(utc_s))
        u = seen.unit
        sidereal = math.radians(float(seen.ra_deg) + float(seen.ha_deg))
        c, s = math.cos(sidereal), math.sin(sidereal)
        axis = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]).T @ np.array(self.turn_arcsec) * ARCSEC
        moving = seen.unit_rate - cross_product(np.array([0.0, 0.0, EARTH_RAD_S]), u)
        there = u + cross_product(axis, u) + self.delay_s * moving
        return there / np.linalg.norm(there)

    def off(self, utc_s: float) -> tuple[float, float]:
        """Return how far east and north of the middle the satellite is seen, arcsec."""
        fed = self.steering.biases.at(utc_s).unit
        east = cross_product(POLE, fed)
        east = east / np.linalg.norm(east)
        away = self.wanted(utc_s) - fed
        return float(away @ east) / ARCSEC, float(away @ cross_product(fed, east)) / ARCSEC

    def seen(self, utc_s: float) -> SeenOffset:
        """Return what the camera sees: with north up, and not mirrored, east is to the left."""
        east, north = self.off(utc_s)
        angle = math.radians(self.camera.rotation_deg)
        left = east * math.cos(angle) - north * math.sin(angle)
        up = east * math.sin(angle) + north * math.cos(angle)
        dx, dy = (left if self.camera.flip else -left), up
        dx, dy = (value + self.rng.normal(0.0, SIGMA_ARCSEC) for value in (dx, dy))
        name = "guide"
        if self.beside_arcsec is not None and math.hypot(dx, dy) > 180.0:
            name, dx, dy = "finder", dx + self.beside_arcsec[0], dy + self.beside_arcsec[1]
        return SeenOffset(Utc(utc_s).isoformat("microseconds"), float(dx), float(dy), SIGMA_ARCSEC, name)

    def run(self, seconds: float, shuffled: bool = False) -> None:
        self.go_on(0.0, seconds, shuffled)

    def go_on(self, from_s: float, to_s: float, shuffled: bool = False) -> None:
        for tick in range(round(from_s / TICK_S), round(to_s / TICK_S)):
            now = BEGIN_S + tick * TICK_S
            self.times.append(now - BEGIN_S)
            self.off_arcsec.append(math.hypot(*self.off(now)))
            cloudy = self.clouds_s[0] <= now - BEGIN_S < self.clouds_s[1]
            if tick % 5 == 0 and not cloudy:
                self.waiting.append(self.seen(now))
            # The order is that of a camera whose every third frame takes twice as long.
            for one in list(self.waiting):
                frame = round((float(Utc.parse(one.utc).unix_s) - BEGIN_S) / 0.5)
                late_s = 3.0 * LATE_S if shuffled and frame % 3 == 0 else LATE_S
                if float(Utc.parse(one.utc).unix_s) + late_s <= now:
                    self.waiting.remove(one)
                    self.steering.obey(one, now)
            self.steering.watch(now)

    def rms(self, from_s: float, to_s: float) -> float:
        chosen = [off for t, off in zip(self.times, self.off_arcsec, strict=True) if from_s <= t < to_s]
        return math.sqrt(sum(off * off for off in chosen) / len(chosen))


@pytest.mark.parametrize(
    "camera",
    [*(pytest.param(one, marks=pytest.mark.soak) for one in (UPRIGHT, Camera(130.0))), Camera(-40.0, True)],
)
def test_a_hidden_polar_error_delay_and_late_satellite_are_taken_out(camera: Camera) -> None:
    """Five minutes of arc, 20 ms, 3 s and kilometres of orbit, from half a degree off to an arcsecond."""
    loop = Loop(camera, (200.0, -180.0, 130.0), 0.02)
    loop.run(25.0)
    assert loop.off_arcsec[0] > 1000.0
    assert loop.rms(12.0, 25.0) < 2.0
    estimator = loop.steering.estimator
    assert estimator.rejected + estimator.refused <= 3
    assert estimator.begun_anew == 0


@pytest.mark.parametrize("camera", [Camera(180.0), Camera(90.0), Camera(0.0, True)])
def test_what_was_seen_before_an_image_was_found_to_lie_otherwise_serves_again(camera: Camera) -> None:
    loop = Loop(camera, (200.0, -180.0, 130.0), 0.02, cameras=Cameras(UPRIGHT))
    estimator, tick = loop.steering.estimator, 0
    while not estimator.deviations:
        loop.go_on(tick * TICK_S, (tick + 1) * TICK_S)
        tick += 1
    loop.go_on(tick * TICK_S, tick * TICK_S + 0.8)
    assert estimator.filter is not None
    assert estimator.filter.accepted >= 4
    # Each counts once all the same.
    loop.go_on(tick * TICK_S + 0.8, 20.0)
    assert estimator.accepted + estimator.rejected == 39
    assert estimator.refused == 0


@pytest.mark.parametrize("camera", [UPRIGHT, Camera(130.0), Camera(-40.0, True)])
def test_an_offset_is_the_direction_in_which_the_camera_saw_the_satellite(
    camera: Camera, monkeypatch: pytest.MonkeyPatch
) -> None:
    loop, directed = Loop(camera), []
    monkeypatch.setattr(loop.steering, "_observe", lambda seen, *_, **__: directed.append(seen))
    loop.run(2.0)
    assert len(directed) > 1
    for one in directed:
        utc_s = float(Utc.parse(one.utc).unix_s)
        x, y, z = loop.wanted(utc_s)
        off_dec = one.dec_deg - math.degrees(math.asin(z))
        off_ra = math.remainder(one.ra_deg - math.degrees(math.atan2(y, x)), 360.0)
        assert math.hypot(off_ra * math.cos(math.asin(z)), off_dec) * 3600.0 < 6.0 * SIGMA_ARCSEC
        # Where it is fed to is minutes of arc away.
        assert math.hypot(*loop.off(utc_s)) > 60.0


def test_frames_that_come_late_and_out_of_order_are_used_at_their_own_instants() -> None:
    loop = Loop(turn_arcsec=(100.0, 100.0, 100.0))
    loop.run(25.0, shuffled=True)
    assert loop.rms(14.0, 25.0) < 2.0
    assert loop.steering.estimator.rejected <= 3


def test_clouds_are_bridged_by_what_was_learnt() -> None:
    loop = Loop(turn_arcsec=(200.0, -180.0, 130.0), delay_s=0.02, clouds_s=(30.0, 50.0))
    loop.run(51.0)
    assert loop.rms(49.0, 50.0) < 10.0


def test_the_operators_offset_on_the_sky_stays_and_is_not_learnt_as_the_satellites() -> None:
    loop = Loop()
    loop.run(10.0)
    biases, later_s = loop.steering.biases, BEGIN_S + 15.0
    middle, fed = middle_at(biases, later_s), biases.at(later_s).unit
    assert np.allclose(middle, fed, atol=1e-12)
    loop.steering.obey(OffsetBy("dec_deg", "set", 0.05), BEGIN_S + 10.0)
    assert np.array_equal(middle_at(biases, later_s), middle)
    moved_deg = math.degrees(float(np.linalg.norm(biases.at(later_s).unit - fed)))
    assert moved_deg == pytest.approx(0.05, rel=1e-3)


def test_a_single_offset_far_from_what_is_fed_begins_nothing() -> None:
    """A plane that crosses the field first must not lead the mount away."""
    loop = Loop()
    loop.steering.obey(SeenOffset(Utc(BEGIN_S).isoformat("microseconds"), 5000.0, 0.0, 1.5), BEGIN_S + 0.5)
    before = loop.off_arcsec, loop.steering.estimator.filter
    assert before == ([], None)
    assert loop.steering.estimator.rejected == 1
    loop.run(20.0)
    assert loop.rms(15.0, 20.0) < 3.0


@pytest.mark.parametrize(("off_arcsec", "begins"), [(350.0, True), (370.0, False)])
@pytest.mark.parametrize("axis", ["dx_arcsec", "dy_arcsec"])
def test_one_within_a_tenth_of_a_degree_is_believed_at_once(
    off_arcsec: float, begins: bool, axis: str
) -> None:
    steering = Loop().steering
    places = {"dx_arcsec": 0.0, "dy_arcsec": 0.0, axis: off_arcsec}
    utc = Utc(BEGIN_S).isoformat("microseconds")
    steering.obey(SeenOffset(utc, sigma_arcsec=1.5, **places), BEGIN_S + 0.5)  # type: ignore[arg-type]
    assert (steering.estimator.filter is not None) is begins
    assert steering.last_seen == (
        "taken" if begins else "it lies far from what is fed: 3 that agree are needed"
    )


def test_three_that_agree_begin_an_estimate_far_from_what_is_fed_in_the_periods_that_follow() -> None:
    """Each is weighed by filters that take long: one a period, and none while a message is read."""
    loop = Loop()
    steering = loop.steering
    for number in range(3):
        now_s = BEGIN_S + 0.5 * number
        assert math.hypot(*loop.off(now_s)) > 360.0
        assert not any(steering.watch(now_s + PERIOD_S * tick) for tick in range(5))
        steering.obey(loop.seen(now_s), now_s + 0.25)
        begun = steering.estimator.filter
        assert begun is None
    watched = [steering.watch(BEGIN_S + 1.25 + PERIOD_S * tick) for tick in range(4)]
    assert watched == [False, False, True, False]
    assert steering.estimator.filter is not None
    assert math.hypot(*loop.off(BEGIN_S + 6.0)) < 180.0


def test_what_comes_so_late_that_nobody_knows_what_was_fed_is_refused() -> None:
    loop = Loop()
    loop.run(8.0)
    first = loop.seen(BEGIN_S + 5.0)
    for tick in range(128):
        loop.steering.obey(OffsetBy("along_s", "add", 1e-6), BEGIN_S + 8.0 + 0.05 * tick)
    loop.steering.obey(first, BEGIN_S + 16.0)
    words = loop.steering.estimator.words
    assert words is not None
    assert "what was fed then is not known any more" in words


@pytest.mark.parametrize("seed", [1, 5, 16, 22])
def test_a_wild_offset_moves_nothing(seed: int) -> None:
    """By one that no filter takes another may become the likeliest, and says something else."""
    loop = Loop(seed=seed)
    loop.run(10.0)
    now = BEGIN_S + 10.0
    known = loop.steering.estimator.filter
    assert known is not None
    before, rejected = known.correction_km.copy(), loop.steering.estimator.rejected
    for dx, dy in ((17000.0, 0.0), (0.0, -9000.0), (300.0, 300.0)):
        loop.steering.obey(SeenOffset(Utc(now - 0.5).isoformat("microseconds"), dx, dy, 1.5), now)
    assert loop.steering.estimator.rejected == rejected + 3
    assert np.array_equal(known.correction_km, before)
    assert len(before) == STATES


def test_a_camera_whose_only_offset_was_wild_is_shown_without_a_fault() -> None:
    loop = Loop()
    loop.run(10.0)
    now, estimator = BEGIN_S + 10.0, loop.steering.estimator
    late = Utc(now - 0.5).isoformat("microseconds")
    loop.steering.obey(SeenOffset(late, 300.0, 300.0, 1.5, "finder"), now)
    for _ in range(2):
        assert estimator.sky_terms is not None
        assert estimator.camera_words == ()
        assert "guide" in [one.name for one in loop.steering.camera_views()]
        loop.go_on(10.0, 12.0)


def test_up_is_north_and_right_is_west_unless_the_camera_is_turned_or_mirrored() -> None:
    for camera, dx, dy, east, north in (
        (UPRIGHT, 0.0, 1.0, 0.0, 1.0),
        (UPRIGHT, 1.0, 0.0, -1.0, 0.0),
        (Camera(0.0, True), 1.0, 0.0, 1.0, 0.0),
        (Camera(90.0), 0.0, 1.0, 1.0, 0.0),
        (Camera(90.0), 1.0, 0.0, 0.0, 1.0),
        (Camera(90.0, True), 1.0, 0.0, 0.0, -1.0),
    ):
        biases = Loop(camera).steering.biases
        x, y = dx * 60.0 * ARCSEC, dy * 60.0 * ARCSEC
        here, image = biases.at(BEGIN_S), biases.image_at(BEGIN_S, x, y, camera, "")
        there = image.fed + x * image.right + y * image.up
        ra_deg, dec_deg = math.degrees(math.atan2(there[1], there[0])), math.degrees(math.asin(there[2]))
        off_ra_deg = (ra_deg - float(here.ra_deg) + 180.0) % 360.0 - 180.0
        to_east = off_ra_deg * math.cos(math.radians(float(here.dec_deg)))
        assert (to_east * 60.0, (dec_deg - float(here.dec_deg)) * 60.0) == pytest.approx(
            (east, north), abs=1e-3
        )


def middle_at(biases: Biases, utc_s: float) -> np.ndarray:
    return biases.image_at(utc_s, 0.0, 0.0, UPRIGHT, "").fed


@pytest.mark.parametrize(
    ("camera", "said"),
    [
        (Camera(90.0, True), {}),
        (Camera(12.0), {"rotation_deg": 90.0, "flipped": True}),
    ],
)
def test_an_offset_in_pixels_is_what_it_is_in_arcseconds(camera: Camera, said: dict[str, Any]) -> None:
    """By hand: 30 px of 2″ to the right of a mirrored image whose up is east is 60″ south."""
    steering = Loop(camera).steering
    steering.obey(in_pixels(30.0, 0.0, 1.0, scale_arcsec_px=2.0, **said), BEGIN_S + 0.5)
    known = steering.estimator.filter
    assert known is not None
    orbit = CorrectableOrbit(demo_pass.elements(), Utc(BEGIN_S - 5.0))
    plain = Propagator(orbit.given, demo_pass.SITE.place(), refraction=Refraction.standard(0.0))
    here, there = plain.at(Utc(BEGIN_S)), known.pointing(plain, Utc(BEGIN_S), True)[0]
    north = math.degrees(math.asin(there[2])) - float(here.dec_deg)
    assert north * 3600.0 == pytest.approx(-60.0, abs=0.5)


def test_an_offset_in_pixels_of_unknown_size_is_refused() -> None:
    steering = Loop().steering
    steering.obey(in_pixels(30.0, 0.0, 1.0, camera="guide"), BEGIN_S + 0.5)
    words = steering.estimator.words
    assert words is not None
    assert "[cameras.guide]" in words
    assert steering.estimator.refused == 1


def in_pixels(dx: float, dy: float, sigma: float, **more: Any) -> SeenOffset:
    return SeenOffset(Utc(BEGIN_S).isoformat("microseconds"), dx_px=dx, dy_px=dy, sigma_px=sigma, **more)


def test_what_was_learnt_at_a_pass_helps_the_next_and_another_mounts_is_left_aside() -> None:
    """The same hidden base and delay again; then those of another mount, of which the profile tells wrong."""
    first = Loop(turn_arcsec=(200.0, -180.0, 130.0), delay_s=0.02)
    first.run(40.0)
    sky = first.steering.estimator.sky_terms
    assert sky is not None
    assert sky.cameras["guide"]["middle_x_deg"] == (0.0, 0.0), "a fine camera looks where the mount does"
    delay_s, sigma_s = sky.mount["delay_s"]
    assert abs(delay_s - 0.02) < 3.0 * sigma_s
    again = Loop(turn_arcsec=(200.0, -180.0, 130.0), delay_s=0.02, seed=2, profile=MountProfile(sky=sky))
    fresh = Loop(turn_arcsec=(200.0, -180.0, 130.0), delay_s=0.02, seed=2)
    for loop in (again, fresh):
        loop.run(25.0)
    assert again.rms(10.0, 25.0) < 1.1 * fresh.rms(10.0, 25.0)
    kept = again.steering.estimator.sky_terms
    assert kept is not None
    assert kept.cameras["guide"]["middle_x_deg"] == (0.0, 0.0)
    assert again.steering.estimator.camera_words == ()
    other = Loop(turn_arcsec=(-900.0, 800.0, -500.0), delay_s=-0.02, profile=MountProfile(sky=sky))
    other.run(25.0)
    assert other.rms(15.0, 25.0) < 2.0
    assert any("does not hold" in words for words in other.steering.estimator.camera_words)


def test_a_lost_target_is_searched_for_where_it_may_be_and_found_again() -> None:
    """Clouds for half a minute, and a field that is smaller than what is not known by then."""
    field_deg = 8.0 / 3600.0
    cameras = Cameras(UPRIGHT, field_deg=field_deg, search_when_lost=True)
    loop = Loop(turn_arcsec=(200.0, -180.0, 130.0), delay_s=0.02, clouds_s=(12.0, 40.0), cameras=cameras)
    loop.run(39.0)
    pattern = loop.steering.biases.pattern_at(BEGIN_S + 39.0)
    assert pattern is not None
    view = loop_view_of(loop, 39.0)
    assert (view.state, view.predicted_s) == ("lost", pytest.approx(27.5, abs=0.01))
    assert view.sigma_arcsec is not None
    assert view.sigma_arcsec > 2.0
    loop.clouds_s = (12.0, 39.0)
    loop.go_on(39.0, 50.0)
    assert loop.steering.biases.pattern_at(BEGIN_S + 50.0) is None
    assert loop_view_of(loop, 50.0).state == "camera"
    assert loop.rms(46.0, 50.0) < 3.0


def loop_view_of(loop: Loop, at_s: float) -> LoopView:
    tracker = SimpleNamespace(steering=loop.steering)
    view = loop_view(cast("Tracker", tracker), BEGIN_S + at_s)
    assert view is not None
    return view


def test_a_search_that_is_asked_for_is_refused_while_nothing_was_seen_or_no_field_is_known() -> None:
    loop = Loop()
    loop.steering.obey(Search("auto"), BEGIN_S)
    assert "nothing seen yet" in (loop.steering.refusal or "")
    loop.run(10.0)
    loop.steering.obey(Search("auto"), BEGIN_S + 10.0)
    assert "the camera's field is not known" in (loop.steering.refusal or "")


def test_a_coarse_camera_hands_over_to_a_fine_one_that_looks_elsewhere() -> None:
    """The coarse one looks 6' beside the fine one: the target ends up in the middle of the fine one."""
    loop = Loop(cameras=Cameras(UPRIGHT, {"finder": Camera(kind="coarse")}), beside_arcsec=(300.0, -200.0))
    loop.run(30.0)
    assert loop.rms(20.0, 30.0) < 2.0
    found = {one.name: one.kind for one in loop.steering.camera_views()}
    assert found == {"finder": "coarse", "guide": "fine"}


class TestGuidingByHand:
    """What an operator decides about what a camera shows."""

    def loop(self) -> Loop:
        return Loop()

    def told(self, loop: Loop, how: str) -> None:
        loop.steering.obey(Guide(how), loop.times[-1] + BEGIN_S)

    def test_unguided_the_target_stays_where_the_elements_have_it_until_guided_again(self) -> None:
        loop = self.loop()
        loop.times.append(0.0)
        self.told(loop, "off")
        loop.go_on(0.0, 10.0)
        assert loop.steering.estimator.accepted == 0
        assert not loop.steering.guided
        assert loop.steering.last_seen == "held"
        unled = loop.off_arcsec[-1]
        self.told(loop, "on")
        loop.go_on(10.0, 25.0)
        assert loop.steering.last_seen == "taken"
        assert loop.off_arcsec[-1] < 0.05 * unled

    def test_one_that_is_held_is_taken_when_it_is_accepted(self) -> None:
        loop = self.loop()
        loop.times.append(0.0)
        self.told(loop, "off")
        loop.go_on(0.0, 3.0)
        unled = loop.off_arcsec[-1]
        self.told(loop, "accept")
        assert loop.steering.estimator.accepted == 1
        loop.waiting.clear()
        loop.go_on(3.0, 8.0)
        assert loop.steering.estimator.accepted == 1
        assert min(loop.off_arcsec[-40:]) < 0.5 * unled

    def test_one_that_contradicts_the_estimate_begins_another_when_it_is_accepted(self) -> None:
        loop = self.loop()
        loop.run(12.0)
        now = BEGIN_S + 12.0
        wild = msgspec.structs.replace(loop.seen(now - 0.5), dx_arcsec=900.0)
        loop.steering.obey(wild, now)
        assert loop.steering.last_seen is not None
        assert "contradicts" in loop.steering.last_seen
        before = loop.steering.biases.at(now + 6.0).unit
        self.told(loop, "accept")
        for tick in range(60):
            loop.steering.watch(now + PERIOD_S * tick)
        moved = loop.steering.biases.at(now + 6.0).unit - before
        assert float(np.linalg.norm(moved)) / ARCSEC == pytest.approx(900.0, rel=0.3)

    def test_rejecting_gives_back_what_the_last_one_changed_once(self) -> None:
        loop = self.loop()
        loop.run(12.0)
        now = BEGIN_S + 12.0
        steering, course = loop.steering, loop.steering.biases.course
        before = steering.estimator.reading(now, course)
        loop.steering.obey(loop.seen(now - 0.1), now)
        assert steering.estimator.reading(now, course) != before
        accepted = steering.estimator.accepted
        self.told(loop, "reject")
        assert steering.estimator.reading(now, course) == before
        assert steering.estimator.accepted == accepted - 1
        self.told(loop, "reject")
        assert steering.estimator.accepted == accepted - 1
        assert "nothing to reject" in (steering.refusal or "")

    def test_the_first_one_rejected_leads_back_to_the_elements(self) -> None:
        loop = self.loop()
        loop.times.append(0.0)
        self.told(loop, "off")
        loop.go_on(0.0, 1.0)
        self.told(loop, "accept")
        assert loop.steering.estimator.accepted == 1
        loop.go_on(1.0, 3.0)
        self.told(loop, "reject")
        assert loop.steering.estimator.accepted == 0
        loop.go_on(3.0, 12.0)
        plain = loop.steering.biases.course.propagator.at(Utc(BEGIN_S + 12.0)).unit
        fed = loop.steering.biases.at(BEGIN_S + 12.0).unit
        assert float(np.linalg.norm(fed - plain)) / ARCSEC < 1.0


def test_a_tick_that_was_prepared_does_not_wait_for_the_estimate(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reading an estimate takes milliseconds, and a datagram is computed two before it is due."""
    facts = prepare(RunRequest("25544", "sim", None, None, None, 10.0, virtual=True)).facts
    engine = build_engine(facts)
    now_s, period_s = facts.started_utc_s, facts.profile.period_s
    looked: list[float] = []
    monkeypatch.setattr(engine.tracker.steering, "watch", lambda at_s, *_: bool(looked.append(at_s)))
    engine.tick(now_s)
    engine.prepare(now_s)
    assert looked == [now_s, now_s + period_s], "once without having been prepared, and for the next"
    engine.tick(now_s + period_s)
    assert len(looked) == 2
    engine.tick(now_s + 2.0 * period_s)
    assert looked[2:] == [now_s + 2.0 * period_s], "as it was not prepared"


def test_what_almost_everything_contradicts_is_left_for_the_elements() -> None:
    """Noise that is taken for the satellite would otherwise be extrapolated, seconds away within minutes."""
    loop, rng, now_s, back = Loop(), np.random.default_rng(1), BEGIN_S, "back to the elements"
    steering = loop.steering
    rejected = 0
    for number in range(22):
        assert back not in (steering.refusal or "")
        now_s += 0.5
        dx, dy = (float(one) for one in rng.uniform(-1500.0, 1500.0, 2)) if number else (200.0, 150.0)
        utc = Utc(now_s - 0.3).isoformat("microseconds")
        steering.obey(SeenOffset(utc, dx, dy, 2.0, "guide"), now_s)
        steering.watch(now_s)
        rejected += steering.estimator.words is not None
        assert (abs(steering.biases.totals(now_s + 10.0)[0]) > 0.02) == (rejected < 20)
    assert rejected == 20, "of the other two that agreed by chance"
    assert back in (steering.refusal or "")
    assert steering.biases.totals(now_s + 10.0) == (0.0, 0.0)
