"""What is written into a profile, and that both readers of profiles take it."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from typing import TYPE_CHECKING

import msgspec
import pytest
from calibration import Network
from calibration_builders import run
from ramp_mount import RampMount

from sattrack.calibration.findings import ClockTruth, Findings, conclude
from sattrack.calibration.guard import sun_hour_angle_and_dec, true_clocks
from sattrack.calibration.motion import LagFit
from sattrack.calibration.profile import calibrated, german
from sattrack.mount.model import AxisLimits, MountProfile, PointingTerms
from sattrack.mount.profiles import ProfileFile, load_profile_file, profile_text
from tle.site import Site

if TYPE_CHECKING:
    from pathlib import Path


def found(truth: ClockTruth | None = None, **mount: object) -> Findings:
    one = RampMount(**mount)
    return conclude(run(one, Network(0.02, 0.03)).calibrator.seen, one.longitude, truth)


@pytest.fixture(scope="module")
def normal() -> Findings:
    return found(ra_sign=-1, dec_sign=1, ra_gain=1.03, edge=True, additive=False, doubles=True)


@pytest.fixture(scope="module")
def beyond() -> Findings:
    return found(ra_sign=1, dec_sign=-1, beyond_pole=True)


def test_a_first_run_writes_the_signs_of_its_side_and_what_else_it_found(normal: Findings) -> None:
    base = MountProfile(hour_angle_limit_deg=120.0, ra=AxisLimits(max_rate_deg_s=3.0))
    profile = calibrated(base, normal, "east pier", "test")
    assert profile.name == "east pier"
    assert profile.signs(beyond_pole=False) == (-1, 1)
    assert (profile.ra_rate_sign_beyond_pole, profile.dec_rate_sign_beyond_pole) == (None, None)
    assert (profile.move_axis, profile.additive) == ("edge", False)
    assert profile.ra_rate_gain == pytest.approx(1.03, abs=1e-5)
    assert profile.ra.max_acceleration_deg_s2 == pytest.approx(8.0, rel=0.02)
    assert profile.braking_deg_s2[0] < profile.ra.max_acceleration_deg_s2
    assert (profile.ra.max_rate_deg_s, profile.hour_angle_limit_deg) == (3.0, 120.0)
    assert profile.readings["counter"] == "double"
    # The split is not known: the two delays add up to the round trip, and no clock error is claimed.
    assert profile.command_delay_s + profile.status_delay_s == pytest.approx(0.05, abs=0.001)
    assert profile.clock_offset_s is None
    assert profile.calibration is not None
    assert (profile.calibration.side_of_pier, profile.calibration.both_sides) == ("normal", False)


def test_the_other_side_is_added_and_the_first_kept(normal: Findings, beyond: Findings) -> None:
    once = calibrated(MountProfile(), normal, None, "test")
    both = calibrated(once, beyond, None, "test")
    assert both.signs(beyond_pole=False) == (-1, 1)
    assert both.signs(beyond_pole=True) == (1, -1)
    assert both.calibration is not None
    assert (both.calibration.side_of_pier, both.calibration.both_sides) == ("beyond_pole", True)
    again = calibrated(both, normal, None, "test")
    assert again.signs(beyond_pole=True) == (1, -1)
    assert again.calibration is not None
    assert again.calibration.both_sides


def test_beyond_the_pole_first_serves_both_sides_until_the_other_is_measured(
    normal: Findings, beyond: Findings
) -> None:
    once = calibrated(MountProfile(), beyond, None, "test")
    assert once.signs(beyond_pole=False) == once.signs(beyond_pole=True) == (1, -1)
    both = calibrated(once, normal, None, "test")
    assert (both.signs(beyond_pole=False), both.signs(beyond_pole=True)) == ((-1, 1), (1, -1))


def test_the_file_is_read_back_as_it_was_written(normal: Findings, tmp_path: Path) -> None:
    profile = calibrated(MountProfile(), normal, None, "test")
    file = tmp_path / "mount.toml"
    file.write_text(profile_text(profile), encoding="utf-8")
    assert load_profile_file(file).mount == profile


def test_what_the_file_says_of_a_simulated_mount_stays(normal: Findings, tmp_path: Path) -> None:
    file = tmp_path / "mount.toml"
    file.write_text('name = "x"\n[simulator]\nclock_drift_ppm = 12.0\n', encoding="utf-8")
    profile = calibrated(load_profile_file(file), normal, None, "test")
    file.write_text(profile_text(profile), encoding="utf-8")
    assert load_profile_file(file).simulator == {"clock_drift_ppm": 12.0}
    assert isinstance(profile, ProfileFile)


WRITTEN = """\
# The dome's mount. Ask the workshop before you change limits.
name = "north"   # not the one in the south
ra_rate_gain = 1  # by hand, in May

# Cables are 60 cm too short since the move.
hour_angle_limit_deg = 100

[ra] # the first axis
max_rate_deg_s = 9.5
# cool nights only
max_acceleration_deg_s2 = 7.0

[[pier_zones]]
name = "all"  # the pier
corners = [
  [-10, -89],  # south
  [10, -89], [10, 0],
]

[stands_at]
latitude_deg = 52.5
longitude_deg = 4.5

[simulator] # for practice
clock_drift_ppm = 12.0
"""


def test_what_a_file_says_in_its_comments_stays(normal: Findings, tmp_path: Path) -> None:
    file = tmp_path / "mount.toml"
    file.write_text(WRITTEN, encoding="utf-8")
    old = load_profile_file(file)
    profile = msgspec.structs.replace(calibrated(old, normal, None, "test"), stands_at=None)
    text = profile_text(profile, file)
    assert tomllib.loads(text)["ra_rate_gain"] == profile.ra_rate_gain != 1
    file.write_text(text, encoding="utf-8")
    assert load_profile_file(file) == profile
    changed = {"ra_rate_gain", "max_acceleration_deg_s2", "[stands_at]", "latitude_deg", "longitude_deg"}
    for line in filter(None, WRITTEN.splitlines()):
        if not any(line.startswith(key) for key in changed):
            assert line in text.splitlines()
    assert "  # by hand, in May\n" in text
    assert "[stands_at]" not in text
    assert "encoder_tics" not in text
    # What has not changed is not touched.
    assert profile_text(profile, file) == text


def test_what_somebody_writes_into_the_file_meanwhile_stays(normal: Findings, tmp_path: Path) -> None:
    file = tmp_path / "mount.toml"
    file.write_text(WRITTEN, encoding="utf-8")
    loaded = load_profile_file(file)
    profile = calibrated(loaded, normal, None, "test")
    edited = WRITTEN.replace("= 100\n", "= 80  # the new cable\n")
    edited = edited.replace("ra_rate_gain = 1 ", "ra_rate_gain = 1.5 ").replace("latitude_deg = 52.5\n", "")
    edited = edited.replace("longitude_deg = 4.5\n", "").replace("[stands_at]\n", "")
    edited = edited.replace("max_rate_deg_s = 9.5\n", "max_rate_deg_s = 9.5\nmax_current_a = 4.0\n")
    file.write_text(edited, encoding="utf-8")
    file.write_text(profile_text(profile, file, loaded), encoding="utf-8")
    current = msgspec.structs.replace(profile.ra, max_current_a=4.0)
    meant = msgspec.structs.replace(profile, hour_angle_limit_deg=80.0, stands_at=None, ra=current)
    assert load_profile_file(file) == meant
    assert "= 80  # the new cable\n" in file.read_text(encoding="utf-8")


def test_two_models_that_were_made_at_once_are_not_mixed(tmp_path: Path) -> None:
    def model(**terms: float) -> PointingTerms:
        pairs = {name: (value, 1.0) for name, value in terms.items()}
        return PointingTerms("2026-10-02T00:00:00Z", 52.0, pairs, 1.0, 20)

    file = tmp_path / "mount.toml"
    loaded = ProfileFile(pointing=model(IH=10.0, ID=5.0))
    mine = msgspec.structs.replace(loaded, pointing=model(IH=30.0, ID=5.0))
    others = msgspec.structs.replace(loaded, pointing=model(IH=20.0, ID=15.0, TF=40.0))
    file.write_text(profile_text(others), encoding="utf-8")
    file.write_text(profile_text(mine, file, loaded), encoding="utf-8")
    assert load_profile_file(file) == mine


def test_what_was_measured_counts_where_it_contradicts_what_was_written_meanwhile(tmp_path: Path) -> None:
    file = tmp_path / "mount.toml"
    file.write_text("", encoding="utf-8")
    loaded = load_profile_file(file)
    found = msgspec.structs.replace(loaded, hour_angle_limit_deg=100.0)
    file.write_text("[park]\nhour_angle_deg = 150\ndec_deg = 0\n", encoding="utf-8")
    file.write_text(profile_text(found, file, loaded), encoding="utf-8")
    assert load_profile_file(file) == found


@pytest.mark.parametrize(
    "written",
    [
        "ra.max_rate_deg_s = 9.5 # fast\nname = 'x'\n",
        "ra = {max_rate_deg_s = 9.5, max_acceleration_deg_s2 = 3} # fast\nname = 'x'\n",
        "[ra]\nmax_rate_deg_s = 9.5 # fast\n[simulator.axis]\na = 1\n[dec]\n[simulator.other]\nb = 2\n",
        "name = 'x'\r\n# fast\r\n[ra]\r\nmax_rate_deg_s = 9.5\r\n",
        "",
    ],
)
def test_a_file_in_any_style_of_toml_is_brought_up_to_date(
    written: str, normal: Findings, tmp_path: Path
) -> None:
    file = tmp_path / "mount.toml"
    file.write_bytes(written.encode())
    profile = calibrated(load_profile_file(file), normal, None, "test")
    text = profile_text(profile, file)
    assert ("# fast" in text) is ("# fast" in written)
    file.write_text(text, encoding="utf-8")
    assert load_profile_file(file) == profile


def test_a_german_telescope_gets_its_rule_where_the_profile_knows_none() -> None:
    """ASCOM's AlignmentMode 2 is German, 1 polar."""
    usual = MountProfile()
    assert german(usual, None) == german(usual, 1) == usual
    made = german(usual, 2)
    assert (made.pier_rule, made.dec_axis_limits_deg) == ("ascom", (-270.0, 270.0))
    narrow = msgspec.structs.replace(usual, dec_axis_limits_deg=(-40.0, 200.0))
    assert german(narrow, 2).dec_axis_limits_deg == (-40.0, 200.0)
    other = msgspec.structs.replace(usual, pier_rule="hour_angle")
    assert german(other, 2) == other


def test_a_true_clock_is_written_as_known() -> None:
    profile = calibrated(MountProfile(), found(ClockTruth(0.002, {"mean": 0.0})), None, "test")
    assert profile.clock_offset_s == 0.0
    assert profile.status_delay_s == pytest.approx(0.03, abs=0.002)
    assert profile.command_delay_s == pytest.approx(0.02, abs=0.002)


def test_an_axis_without_a_lag_is_not_one_whose_lag_is_unknown(normal: Findings) -> None:
    """A run takes a lag of 0 for an unknown one, and begins with 30 ms."""
    for seconds in (-0.0003, 0.0):
        motion = replace(normal.ra_motion, lag=LagFit(seconds, 0.0007))
        profile = calibrated(MountProfile(), replace(normal, ra_motion=motion), None, "test")
        assert profile.ra.lag_s == 0.0005


def test_every_number_of_the_record_is_finite(normal: Findings) -> None:
    record = calibrated(MountProfile(), normal, None, "test").calibration
    text = msgspec.json.encode(record).decode()
    # JSON has no NaN: msgspec writes null for what is not a number.
    assert "null" not in text


def test_the_sun_is_overhead_where_the_almanac_has_it() -> None:
    # Equinox of 2026-03-20, 14:46 UTC: declination 0; equation of time -7.4 minutes.
    ha, dec = sun_hour_angle_and_dec(1_774_017_960.0, Site(0.0, 0.0))
    assert dec == pytest.approx(0.0, abs=0.01)
    solar_noon_min = 12 * 60 + 7.4
    assert ha == pytest.approx((14 * 60 + 46 - solar_noon_min) / 4.0, abs=0.1)


def test_true_clocks_differ_by_the_equation_of_the_equinoxes_and_by_ut1() -> None:
    import erfa

    clocks = true_clocks(1_774_017_960.0, Site(52.0, 4.5))
    day = 1_774_017_960.0 / 86400.0 + 40587.0
    equinoxes_s = float(erfa.ee06a(2400000.5, day + 69.2 / 86400.0)) * 43200.0 / 3.141592653589793
    assert clocks["mean, UT1 taken as UTC"] == 0.0
    assert abs(clocks["mean, by UT1"]) < 0.9
    between = clocks["apparent, by UT1"] - clocks["mean, by UT1"]
    assert between == pytest.approx(equinoxes_s, abs=0.01)


def test_stops_are_foretold_with_two_sigma_less_than_was_measured(normal: Findings) -> None:
    profile = calibrated(MountProfile(), normal, None, "test")
    record = profile.calibration
    assert record is not None
    assert record.ra_acceleration_sigma_deg_s2 is not None
    assert profile.braking_deg_s2 == pytest.approx(
        (
            profile.ra.max_acceleration_deg_s2 - 2.0 * record.ra_acceleration_sigma_deg_s2,
            profile.dec.max_acceleration_deg_s2 - 2.0 * (record.dec_acceleration_sigma_deg_s2 or 0.0),
        )
    )
    assert MountProfile().braking_deg_s2 == (10.0, 10.0)
