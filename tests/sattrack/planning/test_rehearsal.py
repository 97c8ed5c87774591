"""Rehearsals against the runs that follow them, by other noise, and the budget against differences."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner
from late_start import late
from rehearsal import LOST_WITHIN_S, PEAKS_WITHIN, compare, within
from rehearsal_draws import draw, fly, noisy

from sattrack.cli.main import cli
from sattrack.cli.main import run as run_cli
from sattrack.core.errors import SattrackError
from sattrack.mount.model import MountProfile
from sattrack.mount.profiles import ProfileFile
from sattrack.planning.budget import Circumstances, error_budget
from sattrack.runtime import demo_pass
from sattrack.runtime.facts import Prepared, RunRequest, prepare
from sattrack.runtime.flight import fly_virtual
from sattrack.runtime.rehearse import RehearsedRun, rehearse
from tle.bias import NO_BIAS
from tle.elements import Elements
from tle.instants import Utc
from tle.propagator import Propagator
from tle.refraction import Refraction
from tle.site import Site

WHOLE = (0.0, 600.0)
SHORT_PASSES = (
    *(pytest.param(seed, WHOLE, marks=pytest.mark.soak) for seed in (17, 52, 69, 123, 175)),
    (69, (30.0, 75.0)),
    (175, (55.0, 100.0)),
)
"""Seeds of short passes and the part: 69 loses to the cables' end, 175 to the Sun, the others nothing."""
TOO_FAST = (189, (35.0, 87.0))
"""A short pass that is rehearsed at 20 Hz, as its mount is too slow for it."""
ISS = str(Path(__file__).parents[3] / "examples" / "iss_leiden.tle")
PASS = (1790946119.0, 1790946528.0)
"""The built-in pass, POSIX seconds of UTC."""
HIGH = ("--min-alt", "75", "--clock", "2026-10-02T13:04:40Z")
"""The pass lasts 25 s then, and begins half a minute after the clock."""
HIGH_ISS = ("--elements", ISS, "--site", "52.1541,4.4908,0", *HIGH)
SLOW = """name = "slow"
[ra]
max_rate_deg_s = 0.3
[dec]
max_rate_deg_s = 0.3
"""


def drawn_part(seed: int, part_s: tuple[float, float]) -> Prepared:
    """Return a drawn pass from so long after its beginning to so long after that."""
    prepared = draw(seed)
    if part_s == WHOLE:
        return prepared
    plan = prepared.facts.plan
    begin, end = (plan.start_utc_s + after_s for after_s in part_s)
    part = msgspec.structs.replace(plan, start_utc_s=begin, end_utc_s=min(plan.end_utc_s, end))
    return replace(prepared, facts=late(msgspec.structs.replace(prepared.facts, plan=part)))


@pytest.mark.parametrize(("seed", "part_s"), SHORT_PASSES)
def test_a_rehearsal_tells_what_the_run_that_follows_loses_and_reaches(
    seed: int, part_s: tuple[float, float]
) -> None:
    prepared = drawn_part(seed, part_s)
    report = rehearse(prepared).report
    flown = fly(noisy(prepared, seed, sticky=False))
    assert report.lost_s == pytest.approx(flown.lost_s, abs=0.5)
    assert report.ended_by == flown.summary.ended_by
    assert report.calibrated is False
    assert any(re.match("uncalibrated: .* ms of delay are up to [0-9]+″ at", note) for note in report.notes)
    for peak, reached in zip(report.peaks, (flown.peak_hour_angle_deg_s, flown.peak_dec_deg_s), strict=True):
        assert (peak.reached_rate_deg_s is None) == (reached is None)
        if reached is not None:
            assert peak.reached_rate_deg_s == pytest.approx(reached, rel=0.01)
    assert sum(stretch.seconds for stretch in report.lost) == pytest.approx(report.lost_s, abs=0.5)


def test_the_statuses_that_a_rehearsal_leaves_out_change_nothing_that_it_tells(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    prepared = drawn_part(*TOO_FAST)
    thinned = rehearse(prepared)
    monkeypatch.setattr(RehearsedRun, "_is_clear", lambda _: False)
    whole = rehearse(prepared)
    assert len(thinned.performance.trace.utc_s) < 0.75 * len(whole.performance.trace.utc_s)
    assert whole.report.lost_s > 20.0
    assert thinned.report.lost_s == pytest.approx(whole.report.lost_s, abs=0.15)
    assert thinned.report.acquired_after_s == pytest.approx(whole.report.acquired_after_s, abs=0.1)
    assert [lost.limit for lost in thinned.report.lost] == [lost.limit for lost in whole.report.lost]
    for some, every in zip(thinned.report.peaks, whole.report.peaks, strict=True):
        assert some.reached_rate_deg_s == pytest.approx(every.reached_rate_deg_s, rel=0.005)


@pytest.mark.soak
def test_over_two_hundred_passes_rehearsals_agree_with_the_runs_that_follow() -> None:
    rows = [compare(seed) for seed in range(200)]
    # How long a mount takes along the edge of the Sun's cone hangs on the link's noise, and so does whether a
    # pass that is too fast is followed for its first half second.
    free = [row for row in rows if not row.by_sun]
    assert len(free) > 150
    assert within([row.off_s for row in free], LOST_WITHIN_S) >= 0.98 * len(free)
    assert within([row.peaks_off for row in free], PEAKS_WITHIN) >= 0.98 * len(free)
    assert sum(row.foretold_end != row.end for row in rows) <= 0.02 * len(rows)


@pytest.fixture(scope="module")
def high(tmp_path_factory: pytest.TempPathFactory) -> tuple[int, dict[str, Any], Path]:
    """Return what `rehearse` ends with and tells of the high part of the pass, and its picture."""
    picture = tmp_path_factory.mktemp("high") / "pass.png"
    code, told = invoke("ISS", *HIGH_ISS, "--json", "--fov", "0.5", "--plot", str(picture))
    return code, json.loads(told), picture


def test_a_rehearsal_agrees_with_the_command_that_follows(high: tuple[int, dict[str, Any], Path]) -> None:
    foretold, at = high[1], HIGH_ISS
    flown = CliRunner().invoke(
        cli, ["track", "ISS", *at, "--mount", "sim", "--virtual", "--json"], standalone_mode=False
    )
    assert flown.exception is None, flown.exception
    summary = json.loads(flown.stdout.splitlines()[-1])["summary"]
    assert summary["on_target_s"] == pytest.approx(foretold["on_target_s"], abs=0.5)
    assert summary["ended_by"] == foretold["ended_by"]
    assert summary["source_file"] == Path(ISS).name


def test_a_mount_that_flips_by_its_profile_s_rule_is_rehearsed_on_the_side_that_the_rule_has(
    tmp_path: Path,
) -> None:
    # The pass is joined west of the meridian: there the rule has the mount beyond the pole.
    profile = tmp_path / "flips.toml"
    profile.write_text('name = "flips"\npier_rule = "hour_angle"\nwatchdog_s = 2.0\n')
    _, out = invoke("ISS", "--min-alt", "60", "--json", "--profile", str(profile))
    document = json.loads(out)
    assert document["ended_by"] == "set"
    assert document["sides"]["by_itself"]["side"] == "beyond_pole"
    # Beyond the pole the axis stands half a turn from the hour angle, and is let go to 200° either way.
    assert -200.0 <= document["cables"]["low_deg"] < -90.0
    assert document["link_loss"]["watchdog_s"] == 2.0
    assert document["link_loss"]["worst"]["seconds_to_rest"] > 2.0


def polar(through_pole: bool) -> Prepared:
    """Return a minute of a pass that goes by 0.16° from the southern pole, which stands 21° high."""
    elements = Elements(
        name="POLAR",
        catalog_number=8678,
        classification="U",
        designator="",
        epoch=Utc(1790899200.0),
        inclination_deg=70.42273,
        raan_deg=63.48391,
        eccentricity=0.0059214,
        arg_perigee_deg=278.56927,
        mean_anomaly_deg=339.47426,
        mean_motion_rev_day=14.873621882,
        mean_motion_dot_rev_day2=0.0,
        mean_motion_ddot_rev_day3=0.0,
        bstar_per_earth_radius=0.0,
    )
    profile = ProfileFile(
        hour_angle_limit_deg=270.0, dec_axis_limits_deg=(-270.0, 270.0), through_pole=through_pole
    )
    prepared = prepare(
        RunRequest(
            satellite="POLAR",
            mount_url="sim",
            elements=[elements],
            site=Site(-20.842877, -13.105663, 729.5),
            clock_option="2026-10-02T03:28:00Z",
            min_alt_deg=17.0,
            virtual=True,
            profile=profile,
        )
    )
    plan = prepared.facts.plan
    shorter = msgspec.structs.replace(plan, end_utc_s=min(plan.end_utc_s, plan.start_utc_s + 60.0))
    return replace(prepared, facts=late(msgspec.structs.replace(prepared.facts, plan=shorter)))


def test_through_the_pole_a_run_loses_less_than_half_of_what_clipping_does() -> None:
    lost = {}
    for through_pole in (False, True):
        prepared = polar(through_pole)
        plan = prepared.facts.plan
        assert bool(plan.detours) is through_pole
        summary = fly_virtual(noisy(prepared, 1, sticky=False))
        assert summary.ended_by == "set"
        lost[through_pole] = plan.end_utc_s - plan.start_utc_s - summary.on_target_s
    assert lost[False] > 20.0
    assert lost[True] < 0.5 * lost[False]


def test_the_keyhole_is_named_where_the_pass_is_lost_to_it() -> None:
    shares: list[float] = []
    report = rehearse(polar(False), shown=shares.append).report
    limits = {stretch.limit for stretch in report.lost}
    assert "keyhole" in limits
    (hole,) = report.keyholes
    assert hole.chosen == "clipped"
    assert hole.through_pole_s is None
    keyhole_s = sum(stretch.seconds for stretch in report.lost if stretch.limit == "keyhole")
    assert keyhole_s == pytest.approx(hole.clipped_s, abs=1.5)
    # The share of the pass that is done is shown meanwhile.
    assert shares == sorted(shares)
    assert len(shares) > 3
    assert 0.5 < shares[-1] <= 1.0


def budget(**changes: Any) -> Any:
    facts: dict[str, Any] = {
        "clock_error_s": 0.002,
        "servo_along_arcsec": 0.5,
        "servo_across_arcsec": 0.25,
        "servo_why": "made up",
        "refraction_applied": True,
        "fov_deg": 0.5,
    }
    real = Propagator(demo_pass.elements(), demo_pass.SITE.place())
    return error_budget(real, NO_BIAS, PASS, MountProfile(), Circumstances(**{**facts, **changes}))


def test_the_clock_s_part_is_its_error_times_the_speed_on_the_sky() -> None:
    found = budget()
    clock = next(part for part in found.parts if part.name == "clock")
    real = Propagator(demo_pass.elements(), demo_pass.SITE.place())
    at = float(Utc.parse(found.utc).unix_s)
    one, other = real.at(Utc(at - 0.5)), real.at(Utc(at + 0.5))
    cosine = float(np.dot(one.unit, other.unit))
    speed_arcsec_s = math.degrees(math.acos(min(1.0, cosine))) * 3600.0
    # The moment is told to a second.
    assert math.hypot(clock.along_arcsec, clock.across_arcsec) == pytest.approx(
        0.002 * speed_arcsec_s, rel=0.01
    )


def test_the_budget_s_sum_is_the_root_of_the_squares_of_its_parts() -> None:
    found = budget()
    assert [part.name for part in found.parts] == [
        "elements",
        "clock",
        "earth orientation",
        "refraction",
        "delay",
        "servo",
    ]
    for name in ("along_arcsec", "across_arcsec"):
        total = math.sqrt(sum(getattr(part, name) ** 2 for part in found.parts))
        assert getattr(found, name) == pytest.approx(total)
    assert found.fits is True
    assert budget(fov_deg=0.001).fits is False
    assert budget(fov_deg=None).fits is None


def test_the_elements_are_as_old_as_at_the_moment_of_the_budget() -> None:
    # Of a geostationary satellite the pass is as long as the search, and the error grows to its end.
    high = replace(demo_pass.elements(), inclination_deg=0.1, mean_motion_rev_day=1.0027, raan_deg=180.0)
    real = Propagator(high, demo_pass.SITE.place())
    begin = float(high.epoch.unix_s) + 43_200.0
    facts = Circumstances(0.002, 0.0, 0.0, "made up", refraction_applied=True)
    found = error_budget(real, NO_BIAS, (begin, begin + 172_800.0), MountProfile(), facts)
    days = (float(Utc.parse(found.utc).unix_s) - float(high.epoch.unix_s)) / 86_400.0
    assert days > 1.0
    assert found.parts[0].why == f"{days:.1f} days from their epoch"


@pytest.mark.parametrize(
    ("applied", "share"), [(True, math.hypot(10.0 / 1013.25, 10.0 / 288.15)), (False, 1.0)]
)
def test_refraction_counts_as_far_as_the_air_is_not_known_and_in_full_where_none_is_applied(
    applied: bool, share: float
) -> None:
    found = budget(refraction_applied=applied)
    part = next(part for part in found.parts if part.name == "refraction")
    site = demo_pass.SITE.place()
    at = Utc.parse(found.utc)
    bent = Propagator(demo_pass.elements(), site, refraction=Refraction.standard(site.height_m)).at(at)
    airless = Propagator(demo_pass.elements(), site).at(at)
    raised_arcsec = float(bent.alt_deg - airless.alt_deg) * 3600.0
    assert math.hypot(part.along_arcsec, part.across_arcsec) == pytest.approx(share * raised_arcsec, rel=0.02)


def invoke(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(cli, ["rehearse", *arguments], standalone_mode=False)
    assert result.exception is None, result.exception
    return int(result.return_value), result.stdout


def test_the_command_s_document_has_the_verdict_and_every_part(
    high: tuple[int, dict[str, Any], Path],
) -> None:
    code, document, picture = high
    assert code == 0
    assert document["go"] is True
    assert document["lost_s"] + document["on_target_s"] == pytest.approx(document["pass_s"], abs=0.01)
    assert {"peaks", "margins", "keyholes", "sides", "link_loss", "budget"} <= document.keys()
    assert document["link_loss"]["worst"]["seconds_to_limit"] == min(
        moment["seconds_to_limit"]
        for moment in document["link_loss"]["curve"]
        if moment["seconds_to_limit"] is not None
    )
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_a_pass_that_the_mount_cannot_follow_is_no_go_and_names_the_limit(tmp_path: Path) -> None:
    profile = tmp_path / "slow.toml"
    profile.write_text(SLOW)
    code, out = invoke("ISS", *HIGH, "--profile", str(profile))
    assert code == 1
    assert "no-go" in out
    assert "to rate" in out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("NOSUCH",), "NOSUCH"),
        (("ISS", "--pass", "0"), "--pass 0"),
        (("ISS", "--pass", "999"), "--pass 999"),
        (("ISS", "--fov", "nan"), "--fov nan"),
        (("ISS", "--fov", "-1"), "--fov -1"),
        (("ISS", "--bias-along", "nan"), "--bias-along nan"),
        (("ISS", "--min-alt", "89.9"), "does not rise above 89.9°"),
        (("ISS", "--plot", "/nowhere/at/all.png"), "/nowhere/at/all.png"),
        (("ISS", "--site", "52,4,0"), "no elements"),
        (("ISS", "--profile", "/nowhere.toml"), "/nowhere.toml"),
    ],
)
def test_what_cannot_be_rehearsed_is_told_in_one_line(
    arguments: tuple[str, ...], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_cli(["rehearse", *arguments]) in {1, 2}
    told = [line for line in capsys.readouterr().err.splitlines() if "no elements or site" not in line]
    assert len(told) == 1
    assert words in told[0]


ALT_AZ = f"""
name = "altaz"
hour_angle_limit_deg = 200.0
ra = {{ max_rate_deg_s = 6.0, max_acceleration_deg_s2 = 5.0 }}
dec = {{ max_rate_deg_s = 6.0, max_acceleration_deg_s2 = 5.0 }}
stands_at = {{ latitude_deg = {demo_pass.SITE.latitude_deg}, longitude_deg = {demo_pass.SITE.longitude_deg} }}
geometry = {{ pole_azimuth_deg = 0.0, pole_altitude_deg = 90.0 }}
"""


def test_a_limit_is_called_as_its_axis_is_wherever_it_is_shown(tmp_path: Path) -> None:
    profile = tmp_path / "altaz.toml"
    profile.write_text(ALT_AZ)
    code, text = invoke("ISS", "--min-alt", "50", "--profile", str(profile))

    assert code == 0
    assert re.search(r"\nfirst axis +115", text)
    assert re.search(r"at worst [0-9.]+ s to the first axis limit", text)
    assert re.search(r"[0-9.]+ s  first axis\n", text)
    assert "hour angle limit" not in text


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[safety]\nfloor_altitude_deg = 80.0\n", "the sky left reaches 10°"),
        ("[safety]\nsun_cone_deg = 0.0\n", "optical = false"),
        ("[safety]\nfloor_altitude_deg = 30.0\n", "floor_altitude_deg is 30, above min_altitude_deg"),
        ("[safety]\nhorizon = 'skyline.txt'\n", "sort the lines by azimuth"),
    ],
)
def test_limits_that_contradict_are_told_in_one_line(
    text: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("skyline.txt").write_text("0 12\n140 35\n90 12\n180 12\n270 12\n")
    Path("limits.toml").write_text(text)
    assert run_cli(["rehearse", "ISS", "--config", "limits.toml"]) == 2
    told = [line for line in capsys.readouterr().err.splitlines() if "no elements or site" not in line]
    assert len(told) == 1
    assert words in told[0]


def test_a_later_pass_is_rehearsed_by_its_number() -> None:
    _, out = invoke("ISS", "--json", *HIGH, "--pass", "2")
    # Above 75° again one or more revolutions after the first.
    assert float(Utc.parse(json.loads(out)["start_utc"]).unix_s) > PASS[1] + 5000.0


def test_elements_that_come_down_in_the_pass_are_told() -> None:
    prepared = prepare(RunRequest("25544", "sim", None, None, None, 10.0, virtual=True))
    elements = replace(prepared.facts.elements, bstar_per_earth_radius=1.0)
    sinking = replace(prepared, facts=msgspec.structs.replace(prepared.facts, elements=elements))
    with pytest.raises(SattrackError, match="come down before the pass ends"):
        rehearse(sinking)
