"""Star runs in virtual time, on a mount whose errors are a stranger's, under a sky by ERFA."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field, replace
from functools import cache
from typing import TYPE_CHECKING, Any

import erfa
import msgspec
import numpy as np
import pytest
from console_builders import PROFILE, SITE, Bench
from strangers.tilted_mount import TiltedMount, apart_arcsec, local

from sattrack.cli.main import run
from sattrack.control.console import Console
from sattrack.control.manual_operation import ConsoleSession
from sattrack.core.errors import SafetyLimitError, SattrackError
from sattrack.mount.geometry import AxisGeometry, Pole
from sattrack.mount.model import MountProfile, SitePlace
from sattrack.mount.profiles import load_profile_file, profile_text
from sattrack.mount.simulator.mount import StartPosition
from sattrack.pointing.fields import Solved
from sattrack.pointing.files import RunParameters, read_stars, star_line, stars_head
from sattrack.pointing.fit import Star, fit
from sattrack.pointing.terms import PointingModel
from sattrack.runtime.star_run import (
    RunSky,
    Stage,
    StarRun,
    aligned_by,
    icrs_at,
    seen_with,
    without_zeros,
)
from sattrack.safety import SafetyLimits
from tle.bodies import find_body, read_star
from tle.instants import Utc
from tle.refraction import Refraction
from tle.site import Site

if TYPE_CHECKING:
    from pathlib import Path

LATITUDE, LONGITUDE = SITE.latitude_deg, SITE.longitude_deg
AIR = Refraction(1010.0, 10.0)
MOUNT = TiltedMount(LATITUDE, 4000.0, -3500.0, 600.0, 90.0, 700.0, -900.0, 30.0)
ALTAZ = TiltedMount(90.0, 1500.0, -1100.0, 400.0, 60.0, 700.0, -900.0, 30.0)
"""The same with its first axis at the zenith, or nearly."""
FRAME_S, EXPOSURE_S = 1.5, 0.5
EAST_ARCMIN, NORTH_ARCMIN = 20.0, 15.0
LIMITS = SafetyLimits()
UNIX_EPOCH_JD = 2440587.5


@dataclass
class StrangeSky:
    """What a camera on a stranger's mount solves: where it looks, by ERFA, noise of a second of arc added."""

    bench: Bench
    mount: TiltedMount = MOUNT
    source: str = "strange"
    ended: bool = False
    cloudy: bool = False
    wrong: bool = False
    _due_s: float = 0.0
    _rng: Any = field(default_factory=lambda: np.random.default_rng(11))

    def poll(self) -> list[Solved]:
        if self.bench.now_s < self._due_s or self.bench.truth is None:
            return []
        self._due_s = self.bench.now_s + FRAME_S
        if self.cloudy:
            return [Solved(self.bench.now_s, EXPOSURE_S, None)]
        truth = self.bench.truth
        tube = self.mount.looks(truth.hour_angle_axis_deg, truth.dec_axis_deg)
        tube = tube + self._rng.normal(0.0, 1.0 / 206264.8, 3)
        tube = tube / np.linalg.norm(tube)
        azimuth, zenith = math.atan2(tube[0], tube[1]), math.acos(tube[2])
        day = self.bench.now_s / 86400.0
        ra, dec = erfa.atoc13(
            "A", azimuth, zenith, UNIX_EPOCH_JD, day, 0.0, math.radians(LONGITUDE), math.radians(LATITUDE),
            0.0, 0.0, 0.0, AIR.pressure_hpa, AIR.temperature_c, 0.0, 0.55,
        )  # fmt: skip
        seen = math.degrees(ra), math.degrees(dec)
        if self.wrong:
            seen = (seen[0] + 40.0) % 360.0, -seen[1]
        return [Solved(self.bench.now_s, EXPOSURE_S, seen)]


@dataclass
class Flight:
    """A run in virtual time to its end."""

    bench: Bench
    camera: StrangeSky
    run: StarRun
    words: list[str]
    kept: list[Star]
    begun_s: float

    @property
    def minutes(self) -> float:
        return (self.bench.now_s - self.begun_s) / 60.0

    def missed_arcsec(self) -> float:
        """Return by how much the telescope misses the sky by the model, RMS."""
        assert self.run.fitted is not None
        sample = self.bench.console.sample
        assert sample is not None
        zero = find_body("0,0")
        assert zero is not None
        seen = self.run.sky.seen(zero, sample.arrival_utc_s)
        fast_deg = math.remainder(sample.sidereal_h * 15.0 - float(seen.ra_deg) - float(seen.ha_deg), 360.0)
        off = []
        for h, d in self.run.sky.grid()[::7] + 1.7:
            axes = self.run.fitted.model.axes_of(h, d)
            looks = self.camera.mount.looks(axes[0] + fast_deg, axes[1])
            off.append(apart_arcsec(looks, local(h, d, LATITUDE)))
        return math.sqrt(sum(one * one for one in off) / len(off))


def flown(
    most: int = 14,
    known: tuple[Star, ...] = (),
    judged: PointingModel | None = None,
    mount: TiltedMount = MOUNT,
    limits: SafetyLimits = LIMITS,
    each: Any = None,
    by_hand: bool = False,
    profile: MountProfile = PROFILE,
    drives: MountProfile | None = None,
    realigned: bool = False,
    **camera: Any,
) -> Flight:
    """Return a run that is over; `each` is called once a period with the flight.

    `drives` is the profile of the simulated mount, where it is not the one that the program is told.
    """
    bench = Bench(drives or profile, start=StartPosition(10.0, 40.0), limits=limits)
    bench.console = Console(profile, limits, SITE, "bench")
    words: list[str] = []
    kept: list[Star] = []
    sky = RunSky(SITE, profile, bench.limits, AIR)
    session = ConsoleSession(bench.console, bench.now_s)
    seen = StrangeSky(bench, mount, **camera)
    star_run = StarRun(
        session, sky, None if by_hand else seen, most, 3.0, words.append, kept.append,  # type: ignore[arg-type]
        stars=list(known), judged=judged, known=len(known), realigned=realigned,
    )  # fmt: skip
    flight = Flight(bench, seen, star_run, words, kept, bench.now_s)
    while not session.finished:
        bench.turn(session)
        star_run.step(bench.now_s)
        if each is not None:
            each(flight)
        assert flight.minutes < 30.0, star_run.doing
    return flight


def test_from_nothing_a_mount_two_degrees_off_points_within_five_arcseconds() -> None:
    flight = flown(30)
    assert flight.run.trouble is None
    assert flight.run.stage is Stage.OVER
    assert 12 <= len(flight.kept) <= 30
    assert flight.minutes < 10.0
    assert flight.missed_arcsec() < 5.0
    assert flight.bench.console.mount_stopped in {None, True}


def test_a_mount_whose_reports_have_nothing_to_do_with_the_sky_is_synced_first() -> None:
    flight = flown(9, mount=replace(MOUNT, zero_ha=5.0 * 3600.0, zero_dec=-4.0 * 3600.0))
    assert any("synced" in words for words in flight.words)
    assert flight.run.fitted is not None
    assert float(np.linalg.norm(flight.run.fitted.before_arcsec, axis=1).max()) < 6.0 * 3600.0
    assert flight.run.fitted.rms_arcsec < 5.0


def test_clouds_for_good_end_the_run_and_say_so() -> None:
    flight = flown(cloudy=True)
    assert isinstance(flight.run.trouble, SattrackError)
    assert "clouds" in str(flight.run.trouble)
    assert not flight.kept


def test_clouds_that_pass_cost_places_not_the_run() -> None:
    def drift(flight: Flight) -> None:
        flight.camera.cloudy = len(flight.kept) == 4 and 60.0 < flight.bench.now_s - flight.begun_s < 110.0

    flight = flown(8, each=drift)
    assert flight.run.trouble is None
    assert flight.run.fitted is not None
    assert flight.run.fitted.rms_arcsec < 5.0


def test_a_wrongly_solved_star_is_left_out() -> None:
    def mistake(flight: Flight) -> None:
        flight.camera.wrong = len(flight.kept) == 5

    flight = flown(11, each=mistake)
    assert flight.run.fitted is not None
    assert int((~flight.run.fitted.used).sum()) == 1
    assert flight.missed_arcsec() < 6.0


def test_a_mount_that_is_bumped_is_found_out_and_measured_anew() -> None:
    def bump(flight: Flight) -> None:
        if len(flight.kept) == 6:
            flight.camera.mount = replace(MOUNT, pole_up=MOUNT.pole_up + 400.0, zero_ha=MOUNT.zero_ha + 300.0)

    flight = flown(11, each=bump)
    assert any("moved before star 7" in words for words in flight.words)
    assert flight.run.bumped_at == 6
    assert flight.missed_arcsec() < 6.0


def test_a_run_that_was_cut_off_goes_on_where_it_was() -> None:
    def cut(flight: Flight) -> None:
        if len(flight.kept) == 7:
            flight.run.end(None, flight.bench.now_s)

    first = flown(14, each=cut)
    assert len(first.kept) == 7
    head = stars_head("cut", RunParameters(LATITUDE, "2026-09-21", 10.0, 1010.0, 0.0))
    _, known = read_stars(head + "".join(star_line(star) for star in first.kept), "cut.dat")
    for star, read in zip(first.kept, known, strict=True):
        assert read.hour_angle_deg == pytest.approx(star.hour_angle_deg, abs=1.5 / 3600.0)
        assert read.dec_deg == pytest.approx(star.dec_deg, abs=1.0 / 3600.0)
    second = flown(8, known=tuple(known))
    assert len(second.kept) <= 8
    assert len(second.run.stars) == 7 + len(second.kept)
    assert fit(second.run.stars, LATITUDE).rms_arcsec < 6.0
    # It looks where the first has not.
    old = [local(star.hour_angle_deg, star.dec_deg, LATITUDE) for star in known]
    nearest = max(
        float(np.max(np.array(old) @ local(s.hour_angle_deg, s.dec_deg, LATITUDE))) for s in second.kept
    )
    assert math.degrees(math.acos(nearest)) > 5.0


def test_an_operator_centres_named_stars_by_keys() -> None:
    pressed: list[str] = []

    def operate(flight: Flight) -> None:
        star_run = flight.run
        if star_run.stage is not Stage.CENTRING or flight.bench.console.moving:
            return
        # Left and up, then as long back, and the star is centred again: this mount has no errors.
        wanted = ["+", "\x1b[D", "\x1b[C", "\r"] if len(flight.kept) == 1 else ["\r"]
        key = wanted[min(len(pressed), len(wanted) - 1)] if len(flight.kept) == 1 else "\r"
        if len(flight.kept) == 1:
            pressed.append(key)
        star_run.key(key, flight.bench.now_s)

    flight = flown(3, by_hand=True, each=operate)
    assert len(flight.kept) == 3
    assert pressed == ["+", "\x1b[D", "\x1b[C", "\r"]
    assert "move_ra" in flight.bench.flags()
    assert "0.05 °/s" in flight.words
    for star in (flight.kept[0], flight.kept[2]):
        assert star.axis_dec_deg == pytest.approx(star.dec_deg, abs=0.01)
        assert star.axis_hour_angle_deg == pytest.approx(star.hour_angle_deg, abs=0.05)
    # Stars move on between the epoch of their catalogue and the run.
    head = stars_head("by hand", RunParameters(LATITUDE, "2026-09-21", 10.0, 1010.0, SITE.height_m))
    _, read = read_stars(head + "".join(star_line(star) for star in flight.kept), "run.dat")
    for star, again in zip(flight.kept, read, strict=True):
        assert again.hour_angle_deg == pytest.approx(star.hour_angle_deg, abs=0.6 / 3600.0)
        assert again.dec_deg == pytest.approx(star.dec_deg, abs=0.5 / 3600.0)


def test_a_limit_that_stops_the_mount_while_a_star_is_centred_ends_the_run_as_that() -> None:
    """An axis that goes eight times as far as told is stopped; the run went on to stars it was refused."""

    def operate(flight: Flight) -> None:
        if flight.run.stage is Stage.CENTRING:
            flight.run.key("+", flight.bench.now_s)
            flight.run.key("\x1b[B", flight.bench.now_s)

    drives = msgspec.structs.replace(PROFILE, dec_rate_gain=8.0)
    flight = flown(3, by_hand=True, each=operate, drives=drives)
    assert isinstance(flight.run.trouble, SafetyLimitError)
    assert str(flight.run.trouble).startswith("safety stopped the mount at its obedience limit")
    assert flight.run.session.mount_stopped is True


@pytest.mark.parametrize("number", [8102, 16537, 91262])
def test_a_near_star_is_read_from_a_file_where_it_was_seen(number: int) -> None:
    """Tau Ceti has moved by 68″ since the epoch of its catalogue."""
    body, utc_s = read_star(number, "near"), float(Utc.parse("2026-12-01T20:00:00Z").unix_s)
    assert body.star is not None
    sky = RunSky(SITE, PROFILE, LIMITS, AIR)
    seen = sky.seen(body, utc_s)
    at = float(seen.ha_deg), float(seen.dec_deg)
    star = Star(*at, *at, icrs_at(body.star, utc_s), float(seen.ra_deg + seen.ha_deg) % 360.0)
    parameters = RunParameters(LATITUDE, "2026-12-01", AIR.temperature_c, AIR.pressure_hpa, SITE.height_m)
    _, (read,) = read_stars(stars_head("near", parameters) + star_line(star), "near.dat")
    assert read.dec_deg == pytest.approx(star.dec_deg, abs=0.5 / 3600.0)
    assert read.hour_angle_deg == pytest.approx(star.hour_angle_deg, abs=0.6 / 3600.0)


@pytest.mark.parametrize("latitude_deg", [52.0, -35.0])
def test_a_tour_on_both_sides_of_the_pier_slews_as_little_in_the_south(latitude_deg: float) -> None:
    mount = msgspec.structs.replace(PROFILE, pier_rule="hour_angle")
    sky = RunSky(Site(latitude_deg, 4.5, 0.0), mount, LIMITS)
    places, north = sky.grid(), math.copysign(1.0, latitude_deg)
    h, d = places[sky.tour(places, 20, [], (-20.0, 30.0 * north))].T
    west = h > 0.0
    axes = np.stack([np.where(west, h - 180.0, h), np.where(west, 180.0 * north - d, d)], axis=1)
    assert np.max(np.abs(np.diff(axes, axis=0)), axis=1).sum() < 1100.0


def test_a_model_is_judged_by_stars_and_not_fitted() -> None:
    truth = {"ME": -4000.0, "MA": 3500.0, "CH": -600.0, "NP": -90.0, "IH": -700.0, "ID": 900.0, "TF": 30.0}
    flight = flown(5, judged=PointingModel(truth, LATITUDE))
    assert len(flight.kept) == 5
    assert flight.run.fitted is None


def test_nothing_that_may_be_looked_at_is_said_before_anything_moves() -> None:
    floor = SafetyLimits(floor_altitude_deg=89.0, optical=False)
    flight = flown(5, limits=floor)
    assert "nothing of the sky may be looked at" in str(flight.run.trouble)
    assert not flight.bench.flags()


ZENITH = Pole(0.0, 90.0)


def alt_azimuth(reports: str, pole: Pole = ZENITH) -> MountProfile:
    return msgspec.structs.replace(
        PROFILE,
        geometry=AxisGeometry(pole.pole_azimuth_deg, pole.pole_altitude_deg, reports=reports),  # type: ignore[arg-type]
        stands_at=SitePlace(LATITUDE, LONGITUDE),
        additive=False,
    )


def test_one_frame_that_is_solved_wrongly_gives_no_zero_points() -> None:
    frames: list[bool] = []
    begun: list[bool] = []

    def mistake(flight: Flight) -> None:
        flight.camera.wrong = not frames
        if flight.camera._due_s > 0.0:
            frames.append(True)
        if flight.run.stage is Stage.SLEWING:
            begun.append(True)
            flight.run.end(None, flight.bench.now_s)

    flight = flown(3, mount=ALTAZ, profile=alt_azimuth("sky"), each=mistake)
    assert flight.run.alignment is None
    assert not any("zero points" in words for words in flight.words)
    assert begun


def fed_altaz_off_arcsec(flight: Flight, mount: TiltedMount) -> float:
    """Return by how much the telescope misses the sky as a run feeds it: what is reported there, the axes."""
    fitted, frame = flight.run.fitted, flight.run.sky.profile.frame
    assert fitted is not None
    assert frame is not None
    sample = flight.bench.console.sample
    zero = find_body("0,0")
    assert sample is not None
    assert zero is not None
    seen = flight.run.sky.seen(zero, sample.arrival_utc_s)
    fast_deg = math.remainder(sample.sidereal_h * 15.0 - float(seen.ra_deg) - float(seen.ha_deg), 360.0)
    fast_deg = fast_deg if frame.geometry.reports == "sky" else 0.0
    own = frame.geometry
    off = []
    for h, d in flight.run.sky.grid()[::7] + 1.7:
        told, dec = fitted.model.reported(h, d)
        first, second, _, _ = frame.angles(told + fast_deg, dec)
        # The simulated drives count as the mount reports: from where they were switched on.
        counted = first + own.first_zero_deg, second + own.second_zero_deg
        off.append(apart_arcsec(mount.looks(*counted), local(h, d, LATITUDE)))
    return math.sqrt(sum(one * one for one in off) / len(off))


@pytest.mark.parametrize("reports", ["sky", pytest.param("axes", marks=pytest.mark.soak)])
def test_from_nothing_an_alt_azimuth_mount_points_within_five_arcseconds(reports: str) -> None:
    """Its reports have nothing to do with the sky, its azimuth axis is two degrees off the zenith."""
    mount = replace(ALTAZ, pole_up=5500.0, pole_west=-4600.0, zero_ha=-70.0 * 3600.0, zero_dec=6.0 * 3600.0)
    # Nobody knows where its cables end before it is homed: these drives turn without end.
    drives = msgspec.structs.replace(alt_azimuth(reports), hour_angle_limit_deg=700.0)
    first = flown(14, mount=mount, profile=alt_azimuth(reports), drives=drives)
    assert first.run.trouble is None
    assert first.run.alignment is not None
    assert not first.kept
    assert "sync" not in first.bench.flags()
    second = flown(14, mount=mount, profile=first.run.alignment, drives=drives, realigned=True)
    assert second.run.trouble is None
    assert 12 <= len(second.kept) <= 14
    assert first.minutes + second.minutes < 10.0
    fitted = second.run.fitted
    assert fitted is not None
    assert fitted.axes == "altaz"
    assert {"AN", "AW", "IA", "IE", "CA", "NPAE"} <= set(fitted.names)
    assert fed_altaz_off_arcsec(second, mount) < 5.0
    # A file keeps what the mount reports: whoever reads it with the old profile finds the same zero points.
    found = first.run.alignment
    bare = [seen_with(star, found, without_zeros(found), SITE) for star in second.kept]
    off = [
        apart_arcsec(
            local(-star.axis_hour_angle_deg, star.axis_dec_deg, 90.0),
            local(-star.hour_angle_deg, star.dec_deg, 90.0),
        )
        for star in bare
    ]
    assert min(off) > 4.0 * 3600.0
    again = aligned_by(bare, alt_azimuth(reports), SITE)
    assert again.geometry is not None
    assert found.geometry is not None
    assert again.geometry.first_zero_deg == pytest.approx(found.geometry.first_zero_deg, abs=4.0)
    assert again.geometry.second_zero_deg == pytest.approx(found.geometry.second_zero_deg, abs=2.0)
    stars = [seen_with(star, without_zeros(found), again, SITE) for star in bare]
    assert fit(stars, LATITUDE, "altaz").rms_arcsec < 5.0


POLE = Pole(-40.0, 25.0)
TILTED = replace(
    MOUNT, latitude_deg=25.0, pole_azimuth_deg=-40.0, zero_ha=-70.0 * 3600.0, zero_dec=6.0 * 3600.0
)


@pytest.mark.parametrize("reports", ["axes", pytest.param("sky", marks=pytest.mark.soak)])
def test_from_nothing_a_mount_with_a_pole_of_its_own_points_within_five_arcseconds(
    reports: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its reports are 70° off; its file has them as they are, so that whoever fits it finds them again."""
    given = alt_azimuth(reports, POLE)
    drives = msgspec.structs.replace(given, hour_angle_limit_deg=700.0)
    first = flown(14, mount=TILTED, profile=given, drives=drives)
    found = first.run.alignment
    assert found is not None
    assert "sync" not in first.bench.flags()
    second = flown(14, mount=TILTED, profile=found, drives=drives, realigned=True)
    assert second.run.trouble is None
    assert 12 <= len(second.kept) <= 14
    assert first.minutes + second.minutes < 10.0
    fitted = second.run.fitted
    assert fitted is not None
    assert fitted.axes == POLE
    assert {"MA", "ME", "IH", "ID", "CH", "NP"} <= set(fitted.names)
    assert fed_altaz_off_arcsec(second, TILTED) < 5.0
    data, old, new = (tmp_path / name for name in ("run.dat", "mount.toml", "modelled.toml"))
    bare = [seen_with(star, found, without_zeros(found), SITE) for star in second.kept]
    if reports == "axes":
        # What is reported are the angles that the drives count.
        for star, told in zip(second.kept, bare, strict=True):
            tube = TILTED.looks(told.axis_hour_angle_deg, told.axis_dec_deg)
            assert apart_arcsec(tube, local(star.hour_angle_deg, star.dec_deg, LATITUDE)) < 20.0
    head = stars_head("own", RunParameters(LATITUDE, "2026-09-21", 10.0, 1010.0, 0.0), POLE)
    data.write_text(head + "".join(star_line(star, POLE) for star in bare), encoding="utf-8")
    assert ":EQUAT" in data.read_text(encoding="utf-8")
    old.write_text(profile_text(given), encoding="utf-8")
    words = ["star-run", "--fit-only", "--json", "--mount", "sim", "--site", f"{LATITUDE},{LONGITUDE},0"]
    words += ["--data", str(data), "--profile", str(old), "--output", str(new)]
    assert run([*words, "--plot", str(tmp_path / "sky.svg"), "--model", str(tmp_path / "tp.dat")]) == 0
    model = json.loads(capsys.readouterr().out)["model"]
    assert model["rms_arcsec"] < 6.0
    for name, value in (("MA", 3500.0), ("ME", -4000.0), ("CH", -600.0), ("NP", -90.0)):
        term = model["terms"][name]
        assert term["arcsec"] == pytest.approx(value, abs=max(4.0 * term["sigma_arcsec"], 5.0))
    kept = load_profile_file(new)
    assert kept.pointing is not None
    assert kept.pointing.axes == POLE
    assert kept.geometry is not None
    assert kept.geometry.first_zero_deg == pytest.approx(-70.0, abs=4.0)
    assert "pole at azimuth -40, altitude 25" in (tmp_path / "tp.dat").read_text(encoding="utf-8")


@cache
def three_altaz_stars() -> Flight:
    tilted = TiltedMount(90.0, pole_up=-60.0 * NORTH_ARCMIN, pole_west=-60.0 * EAST_ARCMIN)
    return flown(3, mount=tilted, profile=alt_azimuth("axes"))


def test_three_stars_in_a_file_tell_the_tilt_of_an_azimuth_axis(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What tests/sattrack/cli/test_star_run_sky.py takes minutes for, under a rendered sky."""
    flight, profile = three_altaz_stars(), alt_azimuth("axes")
    data, given, written = (tmp_path / name for name in ("run.dat", "mount.toml", "modelled.toml"))
    head = stars_head("altaz", RunParameters(LATITUDE, "2026-09-21", 10.0, 1010.0, 0.0), "altaz")
    data.write_text(head + "".join(star_line(star, "altaz") for star in flight.kept), encoding="utf-8")
    given.write_text(profile_text(profile), encoding="utf-8")
    words = ["star-run", "--fit-only", "--json", "--mount", "sim", "--site", f"{LATITUDE},{LONGITUDE},0"]
    words += ["--data", str(data), "--profile", str(given), "--output", str(written)]
    assert run(words) == 0
    terms = json.loads(capsys.readouterr().out)["model"]["terms"]
    assert set(terms) == {"IA", "IE", "AN", "AW"}
    assert terms["AW"]["arcsec"] == pytest.approx(-60.0 * EAST_ARCMIN, abs=15.0)
    assert terms["AN"]["arcsec"] == pytest.approx(60.0 * NORTH_ARCMIN, abs=15.0)
    assert ":ALTAZ" in data.read_text(encoding="utf-8")
    assert "[pointing.terms]" in written.read_text(encoding="utf-8")
    given.write_text(f"# Oiled in May.\n{given.read_text(encoding='utf-8')}", encoding="utf-8")
    assert run(words[:-2]) == 0
    assert given.read_text(encoding="utf-8").startswith("# Oiled in May.\n")
    kept, first = load_profile_file(given).pointing, load_profile_file(written).pointing
    assert kept is not None
    assert first is not None
    assert kept == msgspec.structs.replace(first, utc=kept.utc)


def test_stars_of_an_alt_azimuth_mount_are_read_as_they_were_written() -> None:
    flight = three_altaz_stars()
    head = stars_head("altaz", RunParameters(LATITUDE, "2026-09-21", 10.0, 1010.0, 0.0), "altaz")
    text = head + "".join(star_line(star, "altaz") for star in flight.kept)
    _, read = read_stars(text, "altaz.dat", "altaz")
    for star, again in zip(flight.kept, read, strict=True):
        assert again.axis_hour_angle_deg == pytest.approx(star.axis_hour_angle_deg % 360.0, abs=1e-5)
        assert again.axis_dec_deg == pytest.approx(star.axis_dec_deg, abs=1e-5)
        assert math.remainder(again.hour_angle_deg - star.hour_angle_deg, 360.0) == pytest.approx(
            0.0, abs=2e-3
        )
        assert again.dec_deg == pytest.approx(star.dec_deg, abs=1e-3)
    with pytest.raises(SattrackError, match="another mount's"):
        read_stars(text, "altaz.dat")
