"""Runs that follow rows of a file and bodies: rehearsed, recorded, replayed to the last byte."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import msgspec
import numpy as np
import pytest
from ephemeris_files import elements, oem_text

from sattrack.cli.main import run
from sattrack.core.errors import BadInputError
from sattrack.mount.profiles import ProfileFile
from sattrack.recording.format import Recording
from sattrack.recording.replay import replay
from sattrack.runtime.facts import (
    RunRequest,
    build_engine,
    decode_facts,
    encode_facts,
    engine_of,
    open_recording,
    prepare,
)
from sattrack.runtime.flight import fly_virtual
from sattrack.runtime.rehearse import choose_nth_pass
from sattrack.runtime.target_facts import MARGIN_S, target_facts
from sattrack.safety import SafetyLimits
from sattrack.views.messages import ObservationMessage, Slip, decode_message
from tle.bodies import find_body
from tle.formats.ephemerides import parse_ephemerides
from tle.instants import Utc
from tle.propagator import Propagator
from tle.site import Site

if TYPE_CHECKING:
    from pathlib import Path

LEIDEN = Site(52.1541, 4.4908)
SITE = ("--site", "52.1541,4.4908,0")
BEFORE = "2026-10-02T13:00:00Z"


def seconds(utc: str) -> float:
    return float(Utc.parse(utc).unix_s)


def rows(start="2026-10-02T12:50:00Z", minutes=40, step_s=60.0):
    (one,) = parse_ephemerides(oem_text(start, minutes, step_s).encode(), "iss.oem")
    return one


def request(target, **changes):
    given = {
        "satellite": target.label,
        "mount_url": "sim",
        "elements": None,
        "site": LEIDEN,
        "clock_option": BEFORE,
        "min_alt_deg": 10.0,
        "virtual": True,
        "target": target,
    }
    return RunRequest(**{**given, **changes})


def track(capsys, recording: Path, *arguments: str) -> dict:
    common = ("--mount", "sim", "--virtual", "--record", str(recording), "--json")
    assert run(["track", *arguments, *SITE, *common]) == 0
    return json.loads(capsys.readouterr().out)["summary"]


def replayed(recording: Path, least_ticks: int = 1000) -> None:
    result = replay(Recording(recording), engine_of)
    assert result.verdict == "same"
    assert result.ticks > least_ticks


def test_a_satellite_of_a_file_is_followed_and_its_recording_needs_no_file(capsys, tmp_path):
    oem, recording = tmp_path / "iss.oem", tmp_path / "iss.mcap"
    oem.write_text(oem_text("2026-10-02T12:50:00Z", 40))
    ends = ("--clock", "2026-10-02T13:01:50Z", "--to", "2026-10-02T13:02:45Z")
    summary = track(capsys, recording, "ISS", "--ephemeris", str(oem), *ends)
    assert (summary["name"], summary["catalog_number"], summary["ended_by"]) == ("ISS", None, "set")
    assert summary["on_target_s"] > 40.0
    assert summary["true_rms_arcsec"] < 0.1
    oem.unlink()
    replayed(recording)
    _, facts = open_recording(recording)
    # What was followed is where SGP4 has the satellite.
    at = Utc(seconds("2026-10-02T13:02:40Z"))
    followed, made = (Propagator(one, LEIDEN).at(at) for one in (facts.target, elements()))
    assert followed.ra_deg == pytest.approx(made.ra_deg, abs=0.01 / 3600.0)
    assert run(["recording", "info", str(recording)]) == 0
    assert capsys.readouterr().out.startswith("ISS, ")
    moved = tmp_path / "moved.mcap"
    assert run(["recording", "export", str(recording), str(moved), "--anonymous"]) == 2
    assert "only a run by element sets can be moved" in capsys.readouterr().err
    assert not moved.exists()


@pytest.mark.parametrize("target", ["Moon", "83.6331,22.0145"])
def test_bodies_and_directions_are_followed_and_replayed_without_skyfield(
    capsys, tmp_path, target, monkeypatch
):
    recording = tmp_path / "body.mcap"
    begin = ("--clock", "2026-10-02T23:00:00Z", "--to", "2026-10-02T23:00:35Z")
    summary = track(capsys, recording, target, *begin)
    assert summary["on_target_s"] > 15.0
    assert summary["true_rms_arcsec"] < 0.1

    def absent():
        raise AssertionError("a replay needs no ephemeris of the Solar System")

    monkeypatch.setattr("tle.bodies._kernel", absent)
    replayed(recording, 600)


@pytest.mark.parametrize("target", ["Moon", "83.6331,22.0145"])
def test_observations_of_what_has_no_elements_are_refused_in_a_live_run_too(target):
    """There the first one is prepared for, before any has come."""
    facts = prepare(request(find_body(target))).facts
    engine = build_engine(facts)
    engine.expect_observations()
    utc_s = facts.plan.start_utc_s + 1.0
    seen = ObservationMessage(Utc(utc_s).isoformat(), 83.6, 22.0, "icrs", 5.0)
    engine.tracker.operate(seen, utc_s + 1.0)
    estimator = engine.tracker.steering.estimator
    assert (estimator.accepted, estimator.refused) == (0, 1)
    assert estimator.words == "observations correct element sets only"


def test_a_run_has_places_before_the_first_row_and_after_the_last():
    table = rows("2026-10-02T13:03:00Z", 4, 30.0)
    prepared = prepare(request(table, bias_along_s=10.0))
    plan = prepared.facts.plan
    assert (plan.start_utc_s, plan.end_utc_s) == (
        seconds("2026-10-02T13:03:00Z"),
        seconds("2026-10-02T13:07:00Z"),
    )
    target = decode_facts(encode_facts(prepared.facts)).target
    outside = np.array([plan.start_utc_s - 600.0, plan.start_utc_s, plan.end_utc_s, plan.end_utc_s + 600.0])
    for bias_s in (0.0, -60.0, 60.0):
        seen = Propagator(target, LEIDEN).at(Utc(outside + bias_s))
        made = Propagator(elements(), LEIDEN).at(Utc(outside + bias_s))
        # Free fall by the Earth's mass and flattening stays within a kilometre of SGP4 for ten minutes.
        assert np.abs(seen.range_km - made.range_km).max() < 1.0
        assert not seen.error.any()
    beyond = Propagator(target, LEIDEN).at(Utc(np.array([plan.end_utc_s + MARGIN_S + 60.0])))
    assert beyond.error.tolist() == [102]


def test_places_are_kept_to_the_last_bit_through_json():
    table = rows()
    begin, end = seconds("2026-10-02T13:02:00Z"), seconds("2026-10-02T13:09:00Z")
    kept = target_facts(table, begin, end)
    at = Utc(np.linspace(begin, end, 97))
    one = Propagator(kept.target(), LEIDEN).at(at)
    other = Propagator(table, LEIDEN).at(at)
    assert np.array_equal(one.ra_deg, other.ra_deg)
    assert np.array_equal(one.dec_rate_deg_s, other.dec_rate_deg_s)


def test_the_nth_pass_of_a_file_is_searched_in_the_whole_file():
    prepared = prepare(request(rows(minutes=240)))
    second = choose_nth_pass(prepared, 2, 10.0)
    assert second.facts.plan.start_utc_s > prepared.facts.plan.end_utc_s + 3600.0
    middle = Utc(second.facts.culminate_utc_s)
    seen = Propagator(second.facts.target, LEIDEN).at(middle)
    assert seen.alt_deg == pytest.approx(second.facts.max_alt_deg, abs=0.01)


def test_a_rehearsal_says_what_the_file_says_of_its_error(capsys, tmp_path):
    oem = tmp_path / "iss.oem"
    text = oem_text("2026-10-02T12:50:00Z", 40)
    covariance = "".join(f"{'0 ' * k}{1e-4 if k < 3 else 1e-10}\n" for k in range(6))
    oem.write_text(f"{text}COVARIANCE_START\nEPOCH = 2026-10-02T13:00:00\n{covariance}COVARIANCE_STOP\n")
    high = ("--clock", BEFORE, "--min-alt", "75")
    assert run(["rehearse", "ISS", "--ephemeris", str(oem), *SITE, *high, "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert (report["name"], report["catalog_number"], report["elements_epoch"]) == ("ISS", None, None)
    part = report["budget"]["parts"][0]
    assert part["name"] == "ephemeris"
    # 10 m each way, 430 km away at culmination.
    assert part["along_arcsec"] == pytest.approx(np.degrees(0.01 / 430.0) * 3600.0, rel=0.05)
    assert part["why"] == "17.3 m by the file"
    # A file that states none is taken to miss by 100 m in all, 58 m each way.
    oem.write_text(text)
    assert run(["rehearse", "ISS", "--ephemeris", str(oem), *SITE, *high, "--json"]) == 0
    part = json.loads(capsys.readouterr().out)["budget"]["parts"][0]
    assert part["along_arcsec"] == pytest.approx(np.degrees(0.0577 / 430.0) * 3600.0, rel=0.05)
    assert part["why"] == "not stated: taken as 100 m"


def test_the_sun_is_followed_through_a_stated_filter_only():
    sun = find_body("Sun")
    assert sun is not None
    noon = {"clock_option": "2026-10-02T11:00:00Z"}
    with pytest.raises(BadInputError, match="with a solar filter only"):
        prepare(request(sun, **noon))
    filtered = ProfileFile(solar_filter=True)
    with pytest.raises(BadInputError, match="set optical = false"):
        prepare(request(sun, profile=filtered, **noon))
    limits = SafetyLimits(optical=False)
    with pytest.raises(BadInputError, match="with a solar filter only"):
        prepare(request(sun, limits=limits, **noon))
    assert prepare(request(sun, profile=filtered, limits=limits, **noon)).facts.target.label == "Sun"


def test_an_antenna_takes_element_sets_only(capsys):
    assert run(["track", "Moon", *SITE, "--mount", "antenna://localhost:9"]) == 2
    assert "fed from element sets only" in capsys.readouterr().err


LAUNCH = """# name: Launch
t_s,lat_deg,lon_deg,height_m
""" + "".join(f"{t},52.2,{4.6 + 2e-5 * t * t},{10 + 12.5 * t * t}\n" for t in range(0, 61, 5))
T0 = "2026-10-02T13:05:00Z"
BEFORE_T0 = "2026-10-02T13:04:42Z"


def launch():
    (one,) = parse_ephemerides(LAUNCH.encode(), "launch.csv", LEIDEN, Utc.parse(T0))
    return one


def test_a_launch_is_followed_from_its_pad_and_replayed_without_the_table(capsys, tmp_path):
    table, recording = tmp_path / "launch.csv", tmp_path / "launch.mcap"
    table.write_text(LAUNCH)
    summary = track(capsys, recording, str(table), "--t0", T0, "--clock", BEFORE_T0)
    assert (summary["name"], summary["ended_by"]) == ("Launch", "set")
    assert summary["ended_utc"].startswith("2026-10-02T13:06:0")
    assert summary["on_target_s"] > 45.0
    assert summary["true_rms_arcsec"] < 0.2
    table.unlink()
    replayed(recording)


def test_a_launch_that_is_over_is_refused_and_one_under_way_is_followed(capsys, tmp_path):
    table = tmp_path / "launch.csv"
    table.write_text(LAUNCH)
    common = (str(table), *SITE, "--mount", "sim", "--virtual", "--json", "--t0", T0)
    assert run(["track", *common, "--clock", "2026-10-02T14:00:00Z"]) == 1
    words = "launch.csv is from 2026-10-02T13:05:00.000Z to 2026-10-02T13:06:00.000Z: ask within that"
    assert words in capsys.readouterr().err
    assert run(["track", *common, "--clock", "2026-10-02T13:05:10Z"]) == 0
    assert json.loads(capsys.readouterr().out)["summary"]["on_target_s"] > 30.0


def test_what_is_no_orbit_rests_before_its_first_row_and_after_its_last():
    facts = prepare(request(launch())).facts
    here = [Propagator(facts.target, LEIDEN).at(Utc(seconds(T0) + s)) for s in (-3000.0, 0.0, 60.0, 4000.0)]
    for rested, moving in (here[:2], here[:1:-1]):
        assert rested.az_deg == pytest.approx(moving.az_deg, abs=1e-6)
        assert rested.alt_deg == pytest.approx(moving.alt_deg, abs=1e-6)


def test_t0_slips_in_a_run_and_the_launch_is_followed_at_its_new_time(tmp_path):
    recording = tmp_path / "launch.mcap"
    prepared = prepare(request(launch(), clock_option=BEFORE_T0, record=recording))
    views = []
    held = (seconds("2026-10-02T13:04:50Z"), Slip(40.0)), (seconds("2026-10-02T13:05:10Z"), Slip(-20.0))
    summary = fly_virtual(prepared, views.append, messages=held)
    assert summary.ended_by == "set"
    # 60 s of the path after T0, which is 20 s later.
    assert seconds(summary.ended_utc) == pytest.approx(seconds(T0) + 80.0, abs=3.0)
    assert summary.on_target_s > 45.0
    assert summary.true_rms_arcsec < 0.2
    assert {round(view.t0_utc_s - seconds(T0)) for view in views} == {0, 40, 20}
    assert views[-1].end_utc_s == pytest.approx(seconds(T0) + 80.0)
    replayed(recording)


def test_t0_that_slips_while_it_is_followed_is_caught_up_with():
    prepared = prepare(request(launch(), clock_option=BEFORE_T0))
    views = []
    summary = fly_virtual(prepared, views.append, messages=((seconds(T0) + 25.0, Slip(-5.0)),))
    assert summary.ended_by == "set"
    assert seconds(summary.ended_utc) == pytest.approx(seconds(T0) + 55.0, abs=3.0)
    last = [view for view in views if view.error is not None and view.phase == "tracking"][-1]
    assert last.utc_s > seconds(T0) + 45.0
    assert last.error.total_arcsec < 2.0
    # Where the table has it five seconds later; the air raises it by less than the bound.
    there = Propagator(launch(), LEIDEN).at(Utc(last.error.utc_s + 5.0))
    assert last.target_alt_deg == pytest.approx(there.alt_deg, abs=0.2)


def test_only_a_launch_slips():
    engine = build_engine(prepare(request(rows())).facts)
    before = engine.tracker.plan
    engine.operate(Slip(10.0), engine.spec.started_utc_s)
    assert engine.tracker.plan == before
    assert engine.tracker.steering.refusal == "only a table from T0 slips"


@pytest.mark.parametrize("line", ['{"type":"slip"}', '{"type":"slip","seconds":1e6}'])
def test_a_slip_without_seconds_or_of_more_than_a_day_is_no_message(line):
    with pytest.raises(msgspec.MsgspecError):
        decode_message(line.encode())
    assert decode_message(b'{"type":"slip","seconds":-90}') == Slip(-90.0)
