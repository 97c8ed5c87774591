"""Axes found from small motions of strangers' mounts, and mounts that are refused with a reason."""

from __future__ import annotations

import functools
import math
import os
import signal
from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import axes_anywhere
import erfa
import msgspec
import pytest

from sattrack.calibration.axes_in_space import LEGS, AxisTurn, Stood, find_axes, kind_of, with_axes
from sattrack.cli import mount_calibrate
from sattrack.core.errors import InterruptedRunError, LinkLostError, SafetyLimitError, SattrackError
from sattrack.mount.geometry import AxisFrame, AxisGeometry
from sattrack.mount.model import MountProfile, PointingTerms, SitePlace
from sattrack.mount.profiles import load_profile_file, profile_text
from sattrack.pointing.fields import FieldSky, FieldWait, Solved
from sattrack.safety import SafetyLimits
from tle.refraction import Refraction
from tle.site import Site

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

LATITUDE_DEG = 47.0
STRANGER = axes_anywhere.Telescope


def motions(
    stranger: axes_anywhere.Parameters, first: float = 200.0, second: float = 30.0, **how: Any
) -> list[AxisTurn]:
    """Return the motions of a stranger's telescope from drive angles on; `how` makes it disobey."""
    telescope = STRANGER(stranger, 0.0)
    turns, slip = how.get("turns", (1.0, 1.0)), how.get("slip", 0.0)

    def place() -> tuple[float, float]:
        azimuth, altitude = (math.radians(angle) for angle in telescope.horizontal())
        hour_angle, dec = erfa.ae2hd(azimuth, altitude, math.radians(stranger.latitude_deg))
        return math.degrees(hour_angle), math.degrees(dec)

    telescope.angles = [first, second]
    legs = []
    for axis, sense in LEGS:
        before = place()
        telescope.angles[axis] += 4.0 * sense * turns[axis]
        telescope.angles[1 - axis] += slip * abs(telescope.angles[axis] - 200.0) if axis == 0 else 0.0
        legs.append(AxisTurn(axis, 4.0 * sense, before, place()))
    return legs


def parameters(pole: tuple[float, float], **more: float) -> axes_anywhere.Parameters:
    return axes_anywhere.Parameters(
        latitude_deg=LATITUDE_DEG,
        pole_azimuth_deg=pole[0],
        pole_altitude_deg=pole[1],
        **more,  # type: ignore[arg-type]
    )


@pytest.mark.parametrize(
    ("pole", "kind"),
    [
        ((0.0, 90.0), "alt-azimuth"),
        ((0.0, 47.0), "equatorial"),
        ((0.0, 30.0), "neither"),
        ((130.0, 12.0), "neither"),
    ],
)
def test_axes_are_found_and_named(pole: tuple[float, float], kind: str) -> None:
    found = find_axes(motions(parameters(pole, axes_deg=91.0, cone_deg=0.5), turns=(-1.0, 1.0)), LATITUDE_DEG)
    assert found.geometry.pole_altitude_deg == pytest.approx(pole[1], abs=1e-4)
    if pole[1] < 89.0:
        off_deg = math.remainder(found.geometry.pole_azimuth_deg - pole[0], 360.0)
        assert off_deg == pytest.approx(0.0, abs=1e-4)
    assert found.geometry.axes_deg == pytest.approx(91.0, abs=1e-3)
    assert found.geometry.cone_deg == pytest.approx(0.5, abs=1e-3)
    assert found.gains == pytest.approx((-1.0, 1.0), abs=1e-4)
    assert kind_of(found.geometry, LATITUDE_DEG) == kind
    profile = with_axes(MountProfile(), found, SitePlace(LATITUDE_DEG, 5.0))
    assert (profile.ra_rate_sign, profile.dec_rate_sign, profile.additive) == (-1, 1, False)


@pytest.mark.parametrize(
    ("how", "says"),
    [
        ({"turns": (0.0, 1.0)}, "the first axis does not move"),
        ({"turns": (1.0, 0.0)}, "the second axis does not move"),
        ({"turns": (1.0, 2.5)}, "the second axis went 2.50 times as far as commanded"),
        ({"slip": 0.2}, "the tube does not move as two axes make it"),
        ({"second": 75.0}, "the tube points within 20° of where the first axis does"),
    ],
)
def test_a_mount_that_does_not_fit_is_refused_with_the_reason(how: dict[str, Any], says: str) -> None:
    with pytest.raises(SattrackError, match=says):
        find_axes(motions(parameters((0.0, 90.0)), **how), LATITUDE_DEG)


@pytest.mark.parametrize("number", [3, pytest.param(6, marks=pytest.mark.soak)])
def test_a_whole_run_finds_the_axes_of_a_stranger_and_ends_at_rest(number: int) -> None:
    axes = axes_anywhere.draw_to_find(number)
    run = axes_anywhere.Finding(axes).run()
    finder: Any = run.engine
    assert (finder.trouble, finder.finished, finder.mount_stopped) == (None, True, True)
    found = find_axes(finder.legs, axes.drawn.site.latitude_deg)
    assert axes_anywhere.poles_apart_deg(found.geometry, axes.geometry) < 0.01


def test_nothing_moves_where_a_limit_is_near() -> None:
    axes = axes_anywhere.draw_to_find(3)
    run = axes_anywhere.Finding(axes)
    altitude = axes_anywhere.Tube(axes).horizontal(*axes.drawn.stands)[1]
    limits = SafetyLimits(floor_altitude_deg=altitude - 15.0, optical=False)
    run.engine = axes_anywhere.finder_of(axes, limits)  # type: ignore[assignment]
    run.run()
    finder: Any = run.engine
    assert "altitude limit" in str(finder.trouble)
    assert finder.legs == []
    assert isinstance(finder.trouble, SafetyLimitError)
    azimuths = {round(azimuth, 1) for _, azimuth, _ in run.tube_deg}
    assert len(azimuths) <= 8, "it has only followed the sky"


def test_a_mount_that_runs_away_is_stopped_within_the_circle() -> None:
    axes = axes_anywhere.draw_to_find(3)
    fast = replace(axes.drawn.hardware, gains=(8.0, 8.0))
    axes = axes._replace(drawn=replace(axes.drawn, hardware=fast))
    run = axes_anywhere.Finding(axes).run()
    finder: Any = run.engine
    assert "obedience limit" in str(finder.trouble)
    assert finder.mount_stopped is True
    begin, end = run.tube_deg[0], run.tube_deg[-1]
    apart = math.degrees(erfa.seps(*(math.radians(angle) for one in (begin, end) for angle in one[1:])))
    assert apart < 20.0


def test_an_updated_profile_keeps_its_values_but_what_was_learnt_of_its_former_axes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A zero point that is found anew is in the former pointing model too, as IA."""
    file = tmp_path / "altaz.toml"
    terms = PointingTerms("2026-09-21T00:00:00Z", LATITUDE_DEG, {"IA": (3600.0, 1.0)}, 2.0, 12, axes="altaz")
    known = MountProfile(
        name="altaz",
        additive=False,
        watchdog_s=7.0,
        stands_at=SitePlace(LATITUDE_DEG, 5.0),
        geometry=AxisGeometry(0.0, 90.0),
        pointing=msgspec.structs.replace(terms, signs="tpoint"),
    )
    file.write_text(f"{profile_text(known)}\n[simulator]\nfloor_altitude_deg = 3.0\n", encoding="utf-8")
    before = load_profile_file(file)
    turned = SimpleNamespace(
        legs=motions(parameters((0.0, 90.0))), stood=None, trouble=None, mount_stopped=True
    )
    monkeypatch.setattr(mount_calibrate, "_turn_axes", lambda *_: (turned, None))
    settings = tmp_path / "s.toml"
    settings.write_text('[mount]\nprofile = "altaz.toml"\n', encoding="utf-8")
    words = ["--mount", "sim", "--axes", "--yes", "--update", str(file), "--site", f"{LATITUDE_DEG},5,0"]
    words += ["--config", str(settings)]
    assert mount_calibrate.command.main(args=words, standalone_mode=False) == 0
    err = capsys.readouterr().err
    assert "[pointing] of the profile left out" in err
    assert "changed during the run" not in err
    after = load_profile_file(file)
    assert after.pointing is None
    assert (after.watchdog_s, after.simulator) == (7.0, before.simulator)


def test_a_link_that_is_cut_in_a_motion_is_a_lost_link() -> None:
    run = axes_anywhere.Finding(axes_anywhere.draw_to_find(3))
    finder: Any = run.engine
    receive = finder.receive
    finder.receive = lambda data, at_s: receive(data, at_s) if len(finder.legs) < 2 else None
    run.run()
    assert isinstance(finder.trouble, LinkLostError)
    assert finder.mount_stopped is False


@pytest.mark.parametrize(
    ("trouble", "stopped", "error", "says"),
    [
        (
            InterruptedRunError("interrupted"),
            True,
            InterruptedRunError,
            "interrupted; nothing was written; the",
        ),
        (
            LinkLostError("unheard"),
            False,
            LinkLostError,
            "unheard; nothing was written; the mount was NOT seen",
        ),
        (None, False, SattrackError, "nothing was written; the mount was NOT seen at rest"),
    ],
)
def test_motions_that_did_not_end_at_rest_write_nothing_and_say_why(
    trouble: SattrackError | None,
    stopped: bool,
    error: type[SattrackError],
    says: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    legs = motions(parameters((0.0, 90.0)))
    turned = SimpleNamespace(legs=legs, stood=None, trouble=trouble, mount_stopped=stopped)
    monkeypatch.setattr(mount_calibrate, "_turn_axes", lambda *_: (turned, None))
    file = tmp_path / "a.toml"
    words = ["--mount", "sim", "--axes", "--yes", "--output", str(file), "--site", f"{LATITUDE_DEG},5,0"]
    with pytest.raises(error, match=says) as raised:
        mount_calibrate.command.main(args=words, standalone_mode=False)
    assert type(raised.value) is error
    assert not file.exists()


def test_a_signal_while_the_axes_are_looked_for_is_an_interruption(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mount_calibrate, "_show", lambda *_: os.kill(os.getpid(), signal.SIGINT))
    file = tmp_path / "a.toml"
    with pytest.raises(InterruptedRunError, match="interrupted; nothing was written; nothing was moved"):
        mount_calibrate.command.main(
            args=["--mount", "sim", "--axes", "--yes", "--output", str(file)], standalone_mode=False
        )
    assert not file.exists()


def test_the_found_profile_can_be_written_and_read() -> None:
    found = find_axes(motions(parameters((0.0, 90.0))), LATITUDE_DEG)
    profile = with_axes(MountProfile(), found, SitePlace(LATITUDE_DEG, 5.0))
    read = msgspec.json.decode(msgspec.json.encode(profile), type=MountProfile)
    assert read == profile
    assert isinstance(read.geometry, AxisGeometry)
    assert isinstance(read.frame, AxisFrame)


# With a camera: what a mount reports may mean anything.


def seen_run(number: int, **how: Any) -> tuple[Any, Any, Any]:
    """Return a draw, a run with a camera, and its finder; `how` has limits, hardware, and wrong frames."""
    axes = axes_anywhere.draw_meaning(axes_anywhere.draw_to_find(number))
    drawn = replace(axes.drawn, hardware=replace(axes.drawn.hardware, **how.get("hardware", {})))
    axes = axes._replace(drawn=drawn, clock_s=5.0)
    camera = axes_anywhere.MadeUpCamera(axes.drawn.site, number)
    camera.wrong = how.get("wrong", {})
    run: Any = axes_anywhere.Finding(axes, camera)
    if "limits" in how:
        run.engine = axes_anywhere.finder_of(axes, how["limits"], camera)
    return axes, run.run(), run.engine


@pytest.mark.parametrize(("number", "reports"), [(3, "sky"), (13, "axes"), (2, "horizon")])
def test_fields_tell_the_axes_and_what_a_mount_reports(number: int, reports: str) -> None:
    axes, _, finder = above_a_low_floor() if number == 13 else seen_run(number)
    assert (finder.trouble, finder.finished, finder.mount_stopped) == (None, True, True)
    found = find_axes(finder.legs, axes.drawn.site.latitude_deg, finder.stood)
    assert found.geometry.reports == reports == axes.geometry.reports
    turns = [(leg.axis, leg.asked_deg) for leg in finder.legs]
    off_deg = axes_anywhere.poles_apart_deg(found.geometry, axes.geometry)
    assert off_deg < 4.0 * axes_anywhere.least_pole_error_deg(axes, turns)
    assert axes_anywhere.reports_off_deg(axes, found.geometry, 10.0) < 30.0 / 3600.0
    profile = with_axes(MountProfile(), found, SitePlace(LATITUDE_DEG, 5.0))
    assert profile.geometry == found.geometry


def moved_deg(run: Any) -> float:
    """Return how far a run's tube has come from its beginning."""
    begin = run.tube_deg[0]
    return max(
        math.degrees(erfa.seps(*(math.radians(angle) for one in (begin, end) for angle in one[1:])))
        for end in run.tube_deg
    )


def test_nothing_moves_before_two_fields_are_alike() -> None:
    _, run, finder = seen_run(13, wrong=dict.fromkeys(range(100)))
    words = "no field was found among the stars: clouds, or a wrong scale?"
    assert str(finder.trouble) == f"before the first motion: {words}"
    assert (finder.legs, finder.mount_stopped) == ([], None)
    assert moved_deg(run) < 1e-3
    contradicting = {k: (40.0 * (k % 3), 10.0) for k in range(100)}
    _, run, finder = seen_run(13, wrong=contradicting)
    assert str(finder.trouble).startswith("before the first motion")
    assert moved_deg(run) < 1e-3


def test_clouds_end_the_motions_at_rest_and_a_frame_without_a_field_does_not() -> None:
    _, run, finder = seen_run(13, wrong=dict.fromkeys(range(22, 100)))
    assert str(finder.trouble).endswith("no field was found among the stars: clouds, or a wrong scale?")
    assert str(finder.trouble).startswith("after motion ")
    assert finder.mount_stopped is True
    assert 0.5 < moved_deg(run) < 12.0
    _, _, finder = seen_run(13, wrong=dict.fromkeys((9, 17, 21, 30)))
    assert (finder.trouble, len(finder.legs)) == (None, 10)


def test_fields_that_are_solved_far_off_are_named_by_their_motion() -> None:
    _, _, finder = seen_run(13, wrong=dict.fromkeys(range(22, 100), (10.0, 10.0)))
    assert "after motion " in str(finder.trouble)
    assert "from the one before, farther than a motion leads" in str(finder.trouble)
    assert finder.mount_stopped is True


def floor_below(below_deg: float) -> SafetyLimits:
    """Return limits with a floor so far below where mount 13 looks as it begins."""
    axes = axes_anywhere.draw_to_find(13)
    altitude = axes_anywhere.Tube(axes).horizontal(*axes.drawn.stands)[1]
    return SafetyLimits(floor_altitude_deg=altitude - below_deg, optical=False)


@functools.cache
def above_a_low_floor() -> tuple[Any, Any, Any]:
    return seen_run(13, limits=floor_below(22.0))


def test_limits_are_judged_by_where_a_mount_really_looks() -> None:
    _, run, finder = seen_run(13, limits=floor_below(15.0))
    assert "altitude limit" in str(finder.trouble)
    assert moved_deg(run) <= 8.0
    _, run, finder = above_a_low_floor()
    assert finder.trouble is None
    assert moved_deg(run) > 8.0


def test_a_mount_that_reports_angles_and_runs_away_is_stopped_within_the_circle() -> None:
    _, run, finder = seen_run(13, hardware={"gains": (8.0, 8.0)})
    assert "obedience limit" in str(finder.trouble)
    assert finder.mount_stopped is True
    assert moved_deg(run) < 15.0


def stood_by(
    told: Callable[[float, float], tuple[float, float]], pole: tuple[float, float]
) -> tuple[list[AxisTurn], list[Stood]]:
    """Return motions of a stranger, and what is made of its hour angles and declinations as reports."""
    legs = motions(parameters(pole))
    places = [legs[0].before, *(leg.after for leg in legs)]
    return legs, [Stood(place, told(*place), 0.0) for place in places]


def test_reports_that_are_aligned_with_the_sky_are_the_sky() -> None:
    for pole in ((0.0, 47.0), (0.0, 90.0)):
        found = find_axes(*with_latitude(stood_by(lambda h, d: (h + 0.01, d), pole)))
        assert found.geometry.reports == "sky"
        assert not found.geometry.has_zeros


def with_latitude(seen: tuple[list[AxisTurn], list[Stood]]) -> tuple[list[AxisTurn], float, list[Stood]]:
    return seen[0], LATITUDE_DEG, seen[1]


def test_reports_that_mean_nothing_are_refused_with_the_reason() -> None:
    seen = stood_by(lambda h, d: (0.5 * h + d, 20.0 + 0.3 * h), (0.0, 90.0))
    with pytest.raises(SattrackError, match="neither the sky, nor azimuth and altitude, nor the angles"):
        find_axes(*with_latitude(seen))


@pytest.mark.parametrize("number", [0, 3, pytest.param(8, marks=pytest.mark.soak)])
def test_a_field_that_contradicts_the_others_is_named(number: int) -> None:
    legs, stood = stood_by(lambda h, d: (h, d), (0.0, 90.0))
    off = stood[number].looks[0] + 0.7, stood[number].looks[1] - 0.6
    if number:
        legs[number - 1] = legs[number - 1]._replace(after=off)
    if number < len(legs):
        legs[number] = legs[number]._replace(before=off)
    when = f"after motion {number}" if number else "before motion 1"
    with pytest.raises(SattrackError, match=f"the field {when} contradicts the others"):
        find_axes(legs, LATITUDE_DEG, stood)


class Frames:
    """A camera that has frames at hand."""

    source, ended = "frames", False

    def __init__(self, *frames: Solved) -> None:
        self.frames = list(frames)

    def poll(self) -> list[Solved]:
        there, self.frames = self.frames, []
        return there


def test_a_frame_that_began_while_the_mount_moved_does_not_count() -> None:
    early, late = Solved(100.4, 1.0, (1.0, 2.0)), Solved(100.6, 1.0, (3.0, 4.0))
    wait = FieldWait(Frames(early, late))
    wait.begin(100.0)
    assert wait.look(102.0) == [late]
    # By a clock that is 5 s ahead, a frame began after the mount stood. It came too soon for that.
    ahead = Solved(105.0, 1.0, (1.0, 2.0))
    wait = FieldWait(Frames(ahead))
    wait.begin(100.0)
    assert wait.look(100.9) == []
    assert wait.frames == 0


def test_a_camera_that_starts_late_has_its_time_for_a_second_frame() -> None:
    camera = Frames(Solved(250.0, 1.0, None))
    wait = FieldWait(camera)
    wait.begin(100.0)
    assert wait.trouble(250.0) is None
    assert wait.look(251.0) == []
    assert wait.trouble(260.0) is None
    assert wait.trouble(280.0) == "no field was found among the stars: clouds, or a wrong scale?"
    wait.begin(300.0)
    assert wait.trouble(330.0) == "no frame came"


def test_a_field_is_seen_where_erfa_has_it_through_the_air() -> None:
    site, utc_s = Site(47.0, 5.0, 300.0), 1_795_000_000.0
    air = Refraction(980.0, 8.0)
    for ra, dec in ((200.0, 60.0), (120.0, 70.0)):
        _, zenith, hour_angle, dec_seen, _, _ = erfa.atco13(
            math.radians(ra), math.radians(dec), 0.0, 0.0, 0.0, 0.0, 2440587.5, utc_s / 86400.0, 0.0,
            math.radians(site.longitude_deg), math.radians(site.latitude_deg), site.height_m, 0.0, 0.0,
            air.pressure_hpa, air.temperature_c, 0.0, 0.55,
        )  # fmt: skip
        assert math.degrees(zenith) < 60.0
        seen = FieldSky(site, air).seen(Solved(utc_s, 1.0, (ra, dec)))
        apart = erfa.seps(hour_angle, dec_seen, math.radians(seen[0]), math.radians(seen[1]))
        # Its refraction is by another formula, and UT1 is taken as UTC.
        assert math.degrees(apart) * 3600.0 < 3.0
