"""`passes --feasible` and `--judged` against the rates that the list itself tells, and against the Sun."""

from __future__ import annotations

import json
import math
import os
import re
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from sattrack.cli import passes as passes_command
from sattrack.cli import passes_output
from sattrack.cli.main import cli

ISS = str(Path(__file__).parents[3] / "examples" / "iss_leiden.tle")
SEARCH = ("--elements", ISS, "--site", "52.1541,4.4908,0", "--from", "2026-10-02T00:00:00Z", "--hours", "48")
LIMIT_DEG_S = 0.9


def passes(*arguments: str) -> list[dict[str, Any]]:
    result = CliRunner().invoke(cli, ["passes", *SEARCH, *arguments, "--json"], standalone_mode=False)
    assert result.exception is None, result.exception
    listed: list[dict[str, Any]] = json.loads(result.stdout)
    return listed


@pytest.fixture
def slow_mount(tmp_path: Path) -> str:
    """Return a profile file of a mount that turns no faster than LIMIT_DEG_S."""
    path = tmp_path / "slow.toml"
    path.write_text(f"[ra]\nmax_rate_deg_s = {LIMIT_DEG_S}\n[dec]\nmax_rate_deg_s = {LIMIT_DEG_S}\n")
    return str(path)


@pytest.fixture
def without_optics(tmp_path: Path) -> str:
    """Return a settings file of a mount without a telescope."""
    path = tmp_path / "sattrack.toml"
    path.write_text("[safety]\noptical = false\n")
    return str(path)


def test_nothing_is_judged_unless_it_is_asked_for() -> None:
    assert {(one["feasible"], one["why_not"]) for one in passes()} == {(None, None)}


def test_a_pass_is_judged_by_the_rates_that_it_needs(slow_mount: str, without_optics: str) -> None:
    judged = passes("--judged", "--profile", slow_mount, "--config", without_optics)
    assert len(judged) > 5
    for one in judged:
        fastest = max(one["peak_ha_rate_deg_s"], one["peak_dec_rate_deg_s"])
        if fastest <= LIMIT_DEG_S:
            assert one["feasible"] is True
        assert one["feasible"] is (one["why_not"] is None)
        if not one["feasible"]:
            assert one["why_not"].startswith("rate: hour angle turns ")
    assert {one["feasible"] for one in judged} == {True, False}


def test_an_azimuth_mount_begins_on_the_turn_on_which_its_cables_bear_the_pass(tmp_path: Path) -> None:
    # The first angle is the azimuth: a satellite that sets beyond the south is begun at 180° to 270°.
    mount, settings = tmp_path / "altaz.toml", tmp_path / "sattrack.toml"
    settings.write_text("[safety]\noptical = false\n")
    mount.write_text(
        "additive = false\nhour_angle_limit_deg = 270.0\n[ra]\nmax_rate_deg_s = 50.0\n"
        "max_acceleration_deg_s2 = 50.0\n[stands_at]\nlatitude_deg = 52.1541\nlongitude_deg = 4.4908\n"
        "[geometry]\npole_azimuth_deg = 180.0\npole_altitude_deg = 90.0\n"
    )
    judged = passes("--judged", "--profile", str(mount), "--config", str(settings))
    begun_beyond = 0
    for one in judged:
        azimuths = [one["rise_az_deg"], one["culminate_az_deg"], one["set_az_deg"]]
        assert 90.0 < one["culminate_az_deg"] < 270.0
        if max(azimuths) < 268.0 or min(azimuths) > 92.0:
            assert one["feasible"], one["why_not"]
            begun_beyond += one["rise_az_deg"] > 180.0 and one["set_az_deg"] < 90.0
    assert begun_beyond > 0


def test_many_passes_are_judged_and_written_a_block_at_a_time_by_several_processes(
    slow_mount: str, without_optics: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = ("--judged", "--profile", slow_mount, "--config", without_optics)
    at_once, shown = passes(*asked), list[tuple[str, int, int]]()
    monkeypatch.setattr(passes_output, "_JUDGED_A_BLOCK", 2)
    monkeypatch.setattr(passes_output, "_ROWS_A_BLOCK", 3)
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    monkeypatch.setattr(
        passes_command, "_progress", lambda text, _: lambda done, total: shown.append((text, done, total))
    )
    assert passes(*asked) == at_once
    judged = [done for text, done, _ in shown if text.startswith("judged")]
    assert (len(judged), judged[-1]) == (math.ceil(len(at_once) / 2), len(at_once))


def test_only_what_can_be_followed_is_left(slow_mount: str, without_optics: str) -> None:
    asked = ("--profile", slow_mount, "--config", without_optics)
    judged, left = passes("--judged", *asked), passes("--feasible", *asked)
    assert left == [one for one in judged if one["feasible"]]


@pytest.mark.soak
def test_a_pass_that_rises_by_the_sun_is_judged_as_it_is_rehearsed() -> None:
    """The mount waits at the cone's edge, and joins the satellite where it comes out."""
    there = ("--elements", ISS, "--site", "52.15833,4.49306,0", "--clock", "2026-11-23T14:30:00Z")
    rehearsed, judged = (
        json.loads(CliRunner().invoke(cli, [*words, *there, "--json"]).stdout)
        for words in (("rehearse", "ISS"), ("passes", "ISS", "--judged", "--hours", "1"))
    )
    assert rehearsed["lost"][0]["limit"] == "sun"
    words = re.fullmatch(r"sun: .*; (\d+) s of (\d+) s lost", judged[0]["why_not"])
    assert words is not None
    assert [float(word) for word in words.groups()] == pytest.approx(
        [rehearsed["lost_s"], rehearsed["pass_s"]], abs=2.0
    )


def test_past_a_pillar_a_pass_is_judged_about_as_it_is_rehearsed(tmp_path: Path, without_optics: str) -> None:
    """The mount slews round it, and follows on: a sixth of the pass at most, not all that comes after."""
    pillar = tmp_path / "pillar.toml"
    for widest_deg, least_alt, goes in ((5.0, "17", True), (35.0, "40", False)):
        pillar.write_text(
            f'[[pier_zones]]\nname = "pillar"\ncorners = [[-{widest_deg}, 20.0], [5.0, 20.0], [5.0, 60.0], '
            f"[-{widest_deg}, 60.0]]\n"
        )
        there = ("ISS", *SEARCH[:4], "--min-alt", least_alt, "--profile", str(pillar))
        there = (*there, "--config", without_optics, "--json")
        at = "2026-10-02T12:30:00Z"
        (judged, *_), rehearsed = (
            json.loads(CliRunner().invoke(cli, [*words, *there]).stdout)
            for words in (("passes", "--judged", "--from", at, "--hours", "3"), ("rehearse", "--clock", at))
        )
        assert rehearsed["lost"][-1]["limit"] == "pier"
        assert (judged["feasible"], rehearsed["go"]) == (goes, goes)
        if not goes:
            words = re.fullmatch(r"pier: .*; (\d+) s of (\d+) s lost", judged["why_not"])
            assert words is not None
            assert 0.6 < float(words[1]) / rehearsed["lost_s"] < 1.6


@pytest.mark.soak
def test_past_a_narrow_pillar_a_pass_is_judged_about_as_it_is_rehearsed(
    tmp_path: Path, without_optics: str
) -> None:
    """The mount is held before it until the target is far ahead, longer than the target is behind it."""
    pillar = tmp_path / "pillar.toml"
    pillar.write_text(
        '[[pier_zones]]\nname = "pillar"\ncorners = [[1.0, 20.0], [5.0, 20.0], [5.0, 60.0], [1.0, 60.0]]\n'
    )
    there = ("ISS", *SEARCH[:4], "--min-alt", "30", "--profile", str(pillar))
    there = (*there, "--config", without_optics, "--json")
    at = "2026-10-02T12:30:00Z"
    (judged,), rehearsed = (
        json.loads(CliRunner().invoke(cli, [*words, *there]).stdout)
        for words in (("passes", "--judged", "--from", at, "--hours", "1"), ("rehearse", "--clock", at))
    )
    assert rehearsed["lost"][-1]["limit"] == "pier"
    assert (judged["feasible"], rehearsed["go"]) == (False, False)
    words = re.fullmatch(r"pier: .*; (\d+) s of (\d+) s lost", judged["why_not"])
    assert words is not None
    assert 0.8 < float(words[1]) / rehearsed["lost_s"] < 1.25


CIRCUMPOLAR = (
    "KANOPUS-V 1\n"
    "1 38707U 12039A   24247.82317651  .00138984  00000-0  16635-2 0  9998\n"
    "2 38707  97.4945 189.8924 0007050 108.0286 252.1739 15.60479551673427\n"
)
GAP = "hour_angle_limit_deg = 165.0\n"
ALTAZ = (
    "additive = false\n[ra]\nmax_rate_deg_s = 4.0\nslew_rate_deg_s = 4.0\nmax_acceleration_deg_s2 = 5.0\n"
    "[stands_at]\nlatitude_deg = 45.0\nlongitude_deg = 4.5\n"
    "[geometry]\npole_azimuth_deg = 0.0\npole_altitude_deg = 90.0\n"
)


@pytest.mark.parametrize(
    ("profile", "words", "at"),
    [
        ("", ("38707", "--site", "62,10,0"), "2024-09-04T02:20:00Z"),
        pytest.param(GAP, ("38707", "--site", "62,10,0"), "2024-09-04T02:20:00Z", marks=pytest.mark.soak),
        pytest.param(ALTAZ, ("25544", "--site", "45,4.5,0"), "2026-10-02T14:00:00Z", marks=pytest.mark.soak),
    ],
    ids=["equatorial", "gap", "altaz"],
)
def test_past_the_end_of_its_cables_a_pass_is_judged_about_as_it_is_rehearsed(
    profile: str, words: tuple[str, ...], at: str, tmp_path: Path, without_optics: str
) -> None:
    """Either mount slews back by a turn, and follows on."""
    circumpolar, mount = tmp_path / "kanopus.tle", tmp_path / "mount.toml"
    circumpolar.write_text(CIRCUMPOLAR)
    mount.write_text(profile)
    there = (*words, "--min-alt", "15", "--profile", str(mount), "--config", without_optics, "--json")
    elements = ("--elements", ISS if profile == ALTAZ else str(circumpolar))
    (judged, *_), rehearsed = (
        json.loads(CliRunner().invoke(cli, [*command, *there, *elements]).stdout)
        for command in (("passes", "--judged", "--from", at, "--hours", "1"), ("rehearse", "--clock", at))
    )
    assert rehearsed["lost"][-1]["limit"] == "hour_angle"
    lost = re.fullmatch(r"hour_angle: .*; (\d+) s of (\d+) s lost", judged["why_not"])
    assert lost is not None
    assert 0.75 < float(lost[1]) / rehearsed["lost_s"] < 1.33


def test_passes_by_the_sun_are_not_for_optics() -> None:
    near = [one for one in passes("--judged") if one["why_not"] is not None]
    assert near
    for one in near:
        assert one["why_not"].startswith("sun: ")
        # The separation told is geometric and of the whole pass; the cone is 15°.
        assert one["min_sun_separation_deg"] < 16.0
        assert one["sun_alt_deg"] > -10.0
