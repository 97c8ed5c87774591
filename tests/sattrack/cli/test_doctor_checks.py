"""The doctor's judgements, each from facts that are written out here."""

from __future__ import annotations

import re
from pathlib import Path

import msgspec
import pytest

from sattrack.cli import doctor
from sattrack.cli.doctor import CheckResult, ElementFacts, TerminalFacts
from sattrack.cli.main import run
from sattrack.core.realtime import Grant
from sattrack.mount.geometry import AxisGeometry
from sattrack.mount.model import CalibrationRecord, MountProfile, SitePlace
from sattrack.mount.xerxes.link import LinkHealth
from sattrack.runtime.system import KernelClock
from tle.earth import EarthOrientationAge
from tle.instants import Utc
from tle.site import Site

NOW_S = 1_790_000_000.0
DAY_S = 86400.0
SIZE = (120, 40)
EXAMPLES = Path(__file__).parents[3] / "examples"
CALIBRATION = CalibrationRecord(
    utc="2026-09-01T20:00:00Z",
    program="sattrack 0.1",
    side_of_pier="beyond_pole",
    ra_gain_sigma=1e-4,
    dec_gain_sigma=1e-4,
    round_trip_s=0.1,
    round_trip_sigma_s=0.001,
    command_delay_interval_s=(0.0, 0.01),
    status_delay_interval_s=(0.0, 0.01),
    clock_offset_interval_s=(-0.01, 0.01),
    clock_drift_ppm=1.0,
    clock_drift_sigma_ppm=0.1,
    status_period_s=0.05,
    status_period_jitter_s=0.001,
    both_sides=True,
)


def elements(*ages_days: float, refused: int = 0) -> ElementFacts:
    epochs_s = tuple(NOW_S - age * DAY_S for age in ages_days)
    return ElementFacts(("sky.tle",), epochs_s, refused, "sky.tle:4: checksum" if refused else None)


@pytest.mark.parametrize(
    ("facts", "state", "says"),
    [
        (elements(0.5, 1.0, 2.0), "ok", "3 objects"),
        (elements(0.5, 9.0), "ok", "the newest 12.0 h old, 1 more than 3 days off"),
        (elements(3.5, 9.0), "warn", "the newest 3.5 days old, 2 more than 3 days off"),
        (elements(-4.0), "warn", "4.0 days ahead"),
        (elements(0.5, refused=2), "warn", "2 refused, the first: sky.tle:4: checksum"),
        (elements(refused=2), "bad", "no set in sky.tle can be used, 2 refused"),
        (ElementFacts(()), "warn", "none are set: only practice"),
        (ElementFacts((), fetched_by_name=True), "warn", "none are set: those of a satellite that is named"),
        (ElementFacts(("x",), error="x: no such file"), "bad", "x: no such file"),
    ],
)
def test_elements_are_judged_by_age_and_refusals(facts: ElementFacts, state: str, says: str) -> None:
    check = doctor.check_elements(facts, NOW_S)
    assert check.state == state
    assert says in check.what
    assert bool(check.do) is (state != "ok")


def test_old_elements_are_off_by_what_a_pass_of_them_is_refused_for(
    capsys: pytest.CaptureFixture[str],
) -> None:
    elements = ("--elements", str(EXAMPLES / "iss_leiden.tle"), "--site", "52,4,0")
    later = (*elements, "--clock", "2026-11-23T05:00:00Z")
    run(["doctor", *later])
    doctor_says = capsys.readouterr().out
    (off,) = re.findall(r"expect ([0-9.]+)° along track", doctor_says)
    assert 20.0 < float(off) < 90.0
    assert run(["rehearse", "ISS", *later, "--min-alt", "30"]) == 1
    out, err = capsys.readouterr()
    assert "`sattrack track` refuses this pass: the elements of ISS (ZARYA) are 5" in err
    renew = "fetch new ones: `sattrack elements get 25544 --output new.csv`, then give --elements new.csv"
    assert f"14 are allowed: {renew}" in err
    assert renew in doctor_says
    (along,) = re.findall(r"^all +([0-9.]+)", out, re.MULTILINE)
    assert float(along) / 3600.0 == pytest.approx(float(off), rel=0.8)


@pytest.mark.parametrize(
    ("status", "age_days", "state"),
    [
        ("observed", -3.0, "ok"),
        ("predicted", 59.0, "ok"),
        ("predicted", 61.0, "warn"),
        ("extrapolated", 400.0, "bad"),
    ],
)
def test_earth_orientation_is_judged_by_whether_and_how_far_it_is_predicted(
    status: doctor.State, age_days: float, state: str
) -> None:
    observed = Utc.parse("2026-10-01")
    age = EarthOrientationAge(age_days * DAY_S, status, observed, observed.plus(365 * DAY_S))  # type: ignore[arg-type]
    check = doctor.check_earth(age, None)
    assert check.state == state
    assert "observed to 2026-10-01, predicted to 2027-10-01" in check.what
    assert ("astropy-iers-data" in "".join(check.do)) is (state != "ok")


def test_no_table_of_the_earth_s_orientation_is_bad() -> None:
    assert doctor.check_earth(None, "no such package") == CheckResult(
        "earth", "bad", "no such package", ("update the package: pip install --upgrade astropy-iers-data",)
    )


@pytest.mark.parametrize(
    ("clock", "state", "says"),
    [
        (KernelClock(True, 0.0002, 0.003), "ok", "error 0.2 ms by estimate, 3 ms at most"),
        (KernelClock(True, 0.02, 0.03), "warn", "error 20 ms by estimate"),
        (KernelClock(False, 16.0, 16.0), "warn", "not known"),
        (None, "warn", "does not say"),
    ],
)
def test_the_clock_is_judged_by_what_disciplines_it(clock: KernelClock | None, state: str, says: str) -> None:
    check = doctor.check_clock(clock)
    assert check.state == state
    assert says in check.what
    assert "1 ms is 3.6″ on a target at 1°/s" in check.what


def test_priority_and_memory_are_told_apart() -> None:
    ways = ("ask the administrator",)
    both = Grant(10, True)
    none = Grant(None, False, ("memory is not locked: no", "no real-time priority: never"))
    alone = Grant(10, False, ("memory is not locked: no",))
    assert [doctor.check_priority(g, ways).state for g in (both, none, alone)] == ["ok", "warn", "ok"]
    assert [doctor.check_memory(g, ways).state for g in (both, none, alone)] == ["ok", "warn", "warn"]
    assert doctor.check_priority(none, ways).do == ways
    assert doctor.check_priority(none, ways).what.startswith("no real-time priority: never")
    assert doctor.check_memory(none, ways).what == "memory is not locked: no"
    assert doctor.check_memory(none, ways).do == ("as for the priority",)
    assert doctor.check_memory(alone, ways).do == ways


@pytest.mark.parametrize(
    ("facts", "todo"),
    [
        (TerminalFacts(None, "", "ascii"), 0),
        (TerminalFacts(SIZE, "xterm-256color", "utf-8"), 0),
        (TerminalFacts(SIZE, "xterm", "UTF-8", colour_refused=True), 0),
        (TerminalFacts((79, 24), "xterm", "utf-8"), 1),
        (TerminalFacts((80, 23), "dumb", "ascii"), 3),
    ],
)
def test_a_terminal_is_judged_by_size_encoding_and_kind(facts: TerminalFacts, todo: int) -> None:
    check = doctor.check_terminal(facts)
    assert len(check.do) == todo
    assert check.state == ("warn" if todo else "ok")


def test_only_the_terminal_screen_is_missed() -> None:
    everything = dict.fromkeys(doctor.EXTRAS, True)
    assert doctor.check_extras(everything).state == "ok"
    assert doctor.check_extras(everything | {"plot": False}).state == "ok"
    some = doctor.check_extras(everything | {"camera": False, "serial": False})
    assert some.what == "not installed: serial (serial lines), camera (cameras, FITS, PNG)"
    assert some.do == ("run `pip install '.[NAME,NAME]'` in the folder of the clone",)
    without = doctor.check_extras(everything | {"tui": False})
    assert (without.state, without.do) == ("warn", ("run `pip install '.[tui]'` in the folder of the clone",))


def test_an_uncalibrated_profile_matters_for_a_real_mount_only() -> None:
    profile = MountProfile(name="dome", move_axis="edge")
    assert doctor.check_profile(None, profile, None, real=False).state == "ok"
    real = doctor.check_profile("dome.toml", profile, None, real=True)
    assert real.state == "warn"
    assert "dome (dome.toml), uncalibrated: " in real.what
    assert "uncalibrated: signs, gains, delays and MoveAxis semantics (edge) are not measured" in real.what
    assert "20 ms of delay are 72″ on a target at 1°/s" in real.what
    altaz = msgspec.structs.replace(
        profile, geometry=AxisGeometry(0.0, 90.0), stands_at=SitePlace(52.0, 4.5), additive=False
    )
    check = doctor.check_profile(None, altaz, None, real=True)
    assert "its geometry is alt-azimuth; gains, delays and MoveAxis semantics are not measured" in check.what
    assert check.do == ("`sattrack track --learn-profile FILE` learns lags and gains during a pass",)
    measured = msgspec.structs.replace(profile, calibration=CALIBRATION)
    check = doctor.check_profile(None, measured, None, real=True)
    assert check.state == "ok"
    assert "calibrated 2026-09-01T20:00:00Z, beyond pole side and the other; MoveAxis is edge" in check.what
    assert doctor.check_profile("dome.toml", None, "dome.toml:3: no number", real=True).state == "bad"


def heard(**counts: int) -> LinkHealth:
    """A link on which statuses came at exactly 20 Hz, except for what is counted otherwise."""
    health = LinkHealth(received=40)
    for turn in range(40):
        health.hear(NOW_S + 0.05 * turn, 1)
    return replace_counts(health, **counts)


def replace_counts(health: LinkHealth, **counts: int) -> LinkHealth:
    for name, count in counts.items():
        setattr(health, name, count)
    return health


@pytest.mark.parametrize(
    ("health", "state", "says"),
    [
        (heard(), "ok", "40 statuses, 20.0 a second, uneven by 0.0 ms; 0 lost"),
        (heard(lost=1), "warn", "1 lost"),
        (heard(late=2), "warn", "2 late"),
        (heard(rejected=3), "warn", "3 rejected"),
        (heard(strangers=4), "warn", "4 from other hosts"),
        (LinkHealth(), "bad", "no status within 2 s"),
        (LinkHealth(rejected=5), "bad", "5 datagrams that are no status"),
        (LinkHealth(strangers=6), "bad", "6 from other hosts"),
        (None, "ok", "nothing to listen to"),
    ],
)
def test_the_link_is_judged_by_what_was_heard(health: LinkHealth | None, state: str, says: str) -> None:
    check = doctor.check_link("xerxes://mount:15001", health, 2.0, None)
    assert check.state == state
    assert says in check.what
    assert bool(check.do) is (state != "ok")


def test_uneven_statuses_are_told() -> None:
    health = LinkHealth(received=40)
    for turn in range(40):
        health.hear(NOW_S + 0.05 * turn + (0.03 if turn % 2 else 0.0), 1)
    check = doctor.check_link("xerxes://mount:15001", health, 2.0, None)
    assert check.state == "warn"
    # Intervals of 80 and 20 ms in turn: the standard deviation is 30 ms, a little more for a sample of 39.
    assert "uneven by 30.4 ms" in check.what


def test_a_port_that_is_not_to_be_had_is_bad() -> None:
    assert doctor.check_link("xerxes://mount:1", None, 2.0, "UDP port 1 is taken").state == "bad"


def test_a_disk_is_judged_by_its_room() -> None:
    folder = Path("/recordings")
    assert doctor.check_disk(folder, 5e9, True) == CheckResult(
        "disk", "ok", "/recordings: 5.0 GB free for recordings"
    )
    states = [doctor.check_disk(folder, free, True).state for free in (150e6, 5e6, None)]
    assert states == ["warn", "bad", "bad"]
    assert doctor.check_disk(folder, 5e9, False).state == "warn"


def test_settings_and_site_name_what_is_wrong() -> None:
    assert doctor.check_settings(None, None).state == "ok"
    assert doctor.check_settings(Path("sattrack.toml"), None).what == "sattrack.toml is in force"
    assert doctor.check_settings(None, "sattrack.toml:3: no").what == "sattrack.toml:3: no"
    wrong, missing = "sattrack.toml:3: no", "none.toml: cannot read the settings: No such file or directory"
    assert doctor.check_settings(None, wrong).state == "bad"
    for error, way_out in ((wrong, "correct that line;"), (missing, "give another with --config;")):
        assert doctor.check_settings(None, error).do[0].startswith(way_out)
    assert doctor.check_site(None, None).state == "warn"
    assert doctor.check_site(None, "latitude").state == "bad"
    assert (
        doctor.check_site(Site(-30.25, 150.5, 20.0), None).what == "-30.25000° north, 150.50000° east, 20 m"
    )


def test_the_worst_of_all_counts() -> None:
    fine, doubtful, wrong = (CheckResult("x", state, "") for state in ("ok", "warn", "bad"))
    assert doctor.worst([]) == "ok"
    assert doctor.worst([fine, doubtful, fine]) == "warn"
    assert doctor.worst([wrong, doubtful, fine]) == "bad"
