"""Passes with plate solutions of a satellite that is late: as a user runs them, recorded and run again."""

from __future__ import annotations

import io
import json
import math
import random
import socket
import subprocess
import sys
import tempfile
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from datetime import datetime
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import bias as bench
import numpy as np
import pytest
from flight_runs import until
from programs import ended, free_port, sattrack
from skyfield.api import EarthSatellite, load, wgs84

from sattrack.cli import main
from sattrack.control.target import Course
from sattrack.recording.format import OPERATOR, VIEW, Recording
from sattrack.recording.replay import replay
from sattrack.runtime import demo_pass
from sattrack.runtime.facts import build_engine, decode_facts
from sattrack.views.messages import ObservationMessage, SeenOffset, encode_message
from tle.bias import Bias
from tle.instants import Utc
from tle.propagator import Propagator
from tle.refraction import Refraction

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

BEGIN_S = float(Utc.parse("2026-10-02T13:05:10Z").unix_s)
LATE_S = 3.0
TRACK = [
    "track",
    "25544",
    "--virtual",
    "--mount",
    "sim",
    "--json",
    *("--min-alt", "70", "--clock", "2026-10-02T13:04:50Z"),
    "--observations",
    "stdin",
]


def true_satellite(ahead_s: float = LATE_S) -> Propagator:
    return bench.true_satellite(demo_pass.elements(), demo_pass.SITE.place(), ahead_s)


def solutions(
    count: int, true: Propagator, from_s: float = BEGIN_S, sigma_arcsec: float = 20.0
) -> list[bytes]:
    rng = random.Random(7)
    return [encode_message(bench.solution(true, from_s + i, rng, sigma_arcsec)) for i in range(count)]


def fly(lines: list[bytes], *options: str, command: Sequence[str] = TRACK) -> tuple[dict[str, Any], str]:
    out, err = fly_text(lines, [*command, *options])
    return json.loads(out)["summary"], err


def fly_text(lines: list[bytes], command: Sequence[str]) -> tuple[str, str]:
    """Run a command in this process, on lines from its standard input."""
    out, err = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, tempfile.TemporaryFile() as stream:
        stream.write(b"".join(lines))
        stream.seek(0)
        patch.setattr("sys.stdin", SimpleNamespace(buffer=stream))
        with redirect_stdout(out), redirect_stderr(err):
            assert main.run(list(command)) == 0, err.getvalue()
    return out.getvalue(), err.getvalue()


def fly_apart(lines: list[bytes], *options: str) -> tuple[dict[str, Any], str]:
    """Run the command as users do."""
    done = subprocess.run(
        [sys.executable, "-m", "sattrack", *TRACK, *options],
        input=b"".join(lines),
        capture_output=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)["summary"], done.stderr.decode()


def test_a_late_satellite_is_found_and_kept_when_observations_end_and_the_recording_runs_again(
    tmp_path: Path,
) -> None:
    path = tmp_path / "pass.mcap"
    summary, _ = fly_apart(solutions(15, true_satellite()), "--record", str(path))
    estimate = summary["estimate"]
    assert (estimate["accepted"], estimate["rejected"], estimate["refused"]) == (15, 0, 0)
    assert estimate["along_s"] == pytest.approx(LATE_S, abs=4.0 * estimate["along_sigma_s"])
    assert summary["bias_along_s"] == pytest.approx(estimate["along_s"], abs=1e-4), "what is said is fed"
    assert summary["true_peak_arcsec"] < 5.0, "no jolt on the way"
    recording = Recording(path)
    result = replay(recording, lambda spec: build_engine(decode_facts(spec)))
    assert result.divergence is None
    assert result.ticks > 600
    entries = list(Recording(path).entries())
    assert sum(entry.topic == OPERATOR for entry in entries) == 15
    views = [json.loads(entry.data) for entry in entries if entry.topic == VIEW]
    last = [view for view in views if view["phase"] == "tracking"][-1]
    # Ten seconds after the last observation the mount points where the true satellite is, in its own frame.
    assert last["utc_s"] - BEGIN_S > 25.0
    air = replace_air(last["error"]["utc_s"])
    apart = separation_arcsec((last["mount_ra_deg"], last["mount_dec_deg"]), air)
    # Fifteen directions within 14 s leave the range open to what elements err in height, and it shows later.
    told = last["estimate"]
    pace_deg_s = (
        Course(Propagator(demo_pass.elements(), demo_pass.SITE.place())).going(last["utc_s"]).pace_deg_s
    )
    sigma_deg = math.hypot(told["along_sigma_s"] * pace_deg_s, told["cross_sigma_deg"])
    assert apart < min(2.5 * 3600.0 * sigma_deg, 60.0)


def replace_air(utc_s: float) -> tuple[float, float]:
    """Where the true satellite is seen through the air that the run includes."""
    true = true_satellite()
    bent = Propagator(true.elements, true.site, refraction=Refraction.standard(0.0))
    seen = bent.at(Utc(utc_s))
    return float(seen.ra_deg), float(seen.dec_deg)


def separation_arcsec(one: tuple[float, float], other: tuple[float, float]) -> float:
    (ra, dec), (other_ra, other_dec) = one, other
    east = ((ra - other_ra + 180.0) % 360.0 - 180.0) * math.cos(math.radians(dec))
    return math.hypot(east, dec - other_dec) * 3600.0


def test_a_satellite_a_minute_ahead_is_followed_from_the_first_observation_on() -> None:
    summary, _ = fly(solutions(5, true_satellite(60.0)))
    assert summary["estimate"]["accepted"] == 5
    assert summary["bias_along_s"] == pytest.approx(60.0, abs=0.05)
    assert summary["ended_by"] == "set"


def test_garbage_strangers_and_wrong_frames_leave_the_pass_as_it_was() -> None:
    plain, err = fly([])
    assert plain["estimate"] is None
    assert "observations" not in err, "without any, nothing is said of them"
    other = replace(demo_pass.elements(), raan_deg=demo_pass.elements().raan_deg + 4.0)
    on_track = true_satellite(0.0)
    wrong_frame = [line.replace(b'"icrs"', b'"of_date"') for line in solutions(3, on_track, BEGIN_S - 3.0)]
    lines = [
        b"garbage\n",
        b'{"type":"stop"}\n',
        b'{"type":"observation","utc":"2026-10-02T13:05:12Z","ra_deg":NaN}\n',
        *solutions(3, Propagator(other, demo_pass.SITE.place())),
        *solutions(3, on_track, BEGIN_S - 3600.0),
        *(line.replace(b"}", b',"catalog_number":38707}') for line in solutions(3, on_track)),
        *wrong_frame,
    ]
    summary, err = fly(lines)
    estimate = summary["estimate"]
    assert (estimate["accepted"], estimate["rejected"], estimate["refused"]) == (0, 6, 9)
    assert estimate["along_s"] is None
    assert "3 lines were no observations" in err
    for name in ("true_rms_arcsec", "on_target_s", "bias_along_s", "bias_cross_deg", "samples"):
        assert summary[name] == plain[name]


def test_offsets_of_a_camera_are_followed_and_the_recording_runs_again(tmp_path: Path) -> None:
    """A satellite seen five minutes of arc west of the middle is where the mount goes then, and stays."""
    path = tmp_path / "pass.mcap"

    def offset(at_s: float, dx_arcsec: float) -> bytes:
        seen = SeenOffset(Utc(BEGIN_S + at_s).isoformat("microseconds"), dx_arcsec, 0.0, 2.0, "guide")
        return encode_message(seen)

    early = offset(-60.0, 5.0)
    summary, _ = fly(
        [early, offset(0.0, 300.0), offset(0.05, 300.0), offset(30.0, 9000.0)], "--record", str(path)
    )
    estimate = summary["estimate"]
    assert (estimate["accepted"], estimate["rejected"], estimate["refused"]) == (2, 1, 1)
    assert summary["true_peak_arcsec"] < 5.0, "no jolt on the way"
    view = [json.loads(entry.data) for entry in Recording(path).entries() if entry.topic == VIEW][-5]
    known = Propagator(demo_pass.elements(), demo_pass.SITE.place(), refraction=Refraction.standard(0.0))
    seen = known.at(Utc(view["error"]["utc_s"]))
    apart = separation_arcsec(
        (view["mount_ra_deg"], view["mount_dec_deg"]), (float(seen.ra_deg), float(seen.dec_deg))
    )
    assert 100.0 < apart < 1000.0
    result = replay(Recording(path), lambda spec: build_engine(decode_facts(spec)))
    assert result.divergence is None


def test_a_thousand_at_once_in_real_time_beside_orders_and_udp(tmp_path: Path) -> None:
    """Datagrams go out all the same, the first observation taken ends the search, the record runs again."""
    port, path = free_port(), tmp_path / "live.mcap"
    arguments = ["track", "25544", "--mount", "sim", "--stream", "--control", "--observations", f"udp:{port}"]
    clock = ["--clock", "2026-10-02T13:04:20Z", "--record", str(path), "--camera-rotation", "30"]
    true = true_satellite(1.0)
    with ended(sattrack(*arguments, *clock)) as run:
        assert run.stdin is not None
        assert run.stdout is not None
        until(run, "tracking")
        for order in (
            '{"type":"offset","what":"camera_x_deg","how":"set","value":0.02}',
            '{"type":"offset","what":"dec_deg","how":"add","value":9}',
            '{"type":"search","how":"sweep","reach_s":0.5,"period_s":10}',
            '{"type":"offset","what":"sideways","how":"add","value":1}',
        ):
            run.stdin.write(f"{order}\n")
        run.stdin.flush()
        view = searching(run)
        assert [one["what"] for one in view["offsets"]] == ["camera_x_deg"]
        assert any("dec_deg refused: 9°" in words for words in view["warnings"])
        now_s = view["utc_s"]
        burst = solutions(1000, true, now_s, 20.0)
        one = b"".join(solutions(1, true, now_s - 1.0))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for _ in range(500):
                sender.sendto(b"x\n" * 50, ("127.0.0.1", port))
            until_malformed(run, 100)
            sender.sendto(one, ("127.0.0.1", port))
        run.stdin.write(b"".join(burst).decode())
        run.stdin.flush()
        for line in run.stdout:
            view = json.loads(line)
            told = view["estimate"]
            if told is not None and told["accepted"] > 0 and told["refused"] > 100 and view["search"] is None:
                break
        assert view["bias_along_goal_s"] == pytest.approx(1.0, abs=0.2)
        assert view["phase"] == "tracking"
        out, err = run.communicate(timeout=60.0)
    summary = json.loads(out.splitlines()[-1])["summary"]
    assert run.returncode == 0, err
    assert summary["mount_stopped"] is True
    assert summary["datagrams"]["unsent"] == 0
    assert "a control line was ignored: what 'sideways' is not known" in err
    assert "lines were no observations" in err
    result = replay(Recording(path), lambda spec: build_engine(decode_facts(spec)))
    assert result.divergence is None


def until_malformed(run: subprocess.Popen[str], least: int) -> None:
    """Read views until one warns of so many lines that were nothing; the queue may be full before."""
    for line in run.stdout or ():
        for warning in json.loads(line)["warnings"]:
            count, _, words = warning.partition(" lines were neither messages nor observations")
            if warning != count and int(count) >= least and not words:
                return
    raise AssertionError("nothing was told of lines that were nothing")


def searching(run: subprocess.Popen[str]) -> dict[str, Any]:
    for line in run.stdout or ():
        view: dict[str, Any] = json.loads(line)
        if view["search"] is not None and view["search"]["elapsed_s"] > 1.0:
            return view
    raise AssertionError("no search was begun")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--observations", "udp:99999"], "a port is 1 to 65535; write udp:PORT or stdin"),
        (["--observations", "serial"], "write udp:PORT or stdin"),
        (["--observations", "udp:15000", "--virtual"], "in virtual time they come from stdin"),
        (["--observations", "stdin", "--control"], "with --control, observations come with the messages"),
        (["--camera-rotation", "361"], "--rotation 361: give degrees, -360 to 360"),
        (["--camera-rotation", "nan"], "--rotation nan: give degrees, -360 to 360"),
    ],
)
def test_options_that_make_no_sense_are_refused(
    options: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main.run(["track", "25544", "--mount", "sim", "--headless", *options]) == 2
    err = capsys.readouterr().err
    assert words in err
    assert len(err.splitlines()) == 1


def test_the_bias_of_a_true_satellite_is_no_bias_of_the_propagators() -> None:
    """The truth of these tests is SGP4 with another epoch; that `Bias` agrees is what they rest on."""
    believed = Propagator(demo_pass.elements(), demo_pass.SITE.place())
    one, other = true_satellite().at(Utc(BEGIN_S)), believed.at(Utc(BEGIN_S), Bias(LATE_S))
    assert separation_arcsec((one.ra_deg, one.dec_deg), (other.ra_deg, other.dec_deg)) < 0.01


# UTC of 2020-07-24, right ascension and declination (ICRF, degrees) of STARLINK-1179: plate solutions of New
# Mexico Skies, good to 2″ or 3″. They are in github.com/ut-astria/orbdetpy, examples/fit_radec.py (radians,
# to 0.2″), the site in its CAR_MHF.py; elements of ten days before in github.com/richiecarmichael/
# Esri-Satellite-Map.
SEEN = """
03:19:36.035 61.5115457 79.1357847
03:19:40.551 54.4322510 79.4397389
03:19:45.226 46.5896620 79.5748423
03:20:08.080 10.1833508 77.2382631
03:20:12.593 4.7592166 76.2511141
03:20:17.135 359.9850282 75.1261688
03:20:35.638 346.2565584 69.5420648
03:20:40.159 343.9325842 68.0009230
03:20:44.824 341.8357306 66.3575654
03:20:49.538 339.9832435 64.6543338
03:20:54.236 338.3603978 62.9173549
03:20:58.770 336.9725221 61.2112585
03:21:07.908 334.6162905 57.7071059
03:21:12.645 333.5888626 55.8714637
03:21:17.240 332.6927566 54.0798820
03:21:26.480 331.1505834 50.4748316
03:21:31.131 330.4845199 48.6673216
03:21:35.713 329.8894460 46.8960799
03:21:40.249 329.3531002 45.1522828
03:21:44.927 328.8502724 43.3750823
03:21:54.265 327.9758815 39.8850245
03:21:59.018 327.5890777 38.1454101
03:22:03.679 327.2436415 36.4693366
03:22:08.283 326.9306919 34.8404176
03:22:12.904 326.6436401 33.2369952
03:22:17.432 326.3858664 31.6954523
03:22:22.073 326.1437917 30.1511018
03:22:26.745 325.9209684 28.6275498
03:22:31.417 325.7173965 27.1408962
03:22:35.997 325.5357116 25.7160074
03:22:40.696 325.3657150 24.2921500
03:22:45.390 325.2102716 22.9025555
03:22:49.930 325.0745952 21.5959825
"""
SEEN_FROM = (32.90305556, -105.52955560, 2225.04)
SEEN_ELEMENTS = (
    "1 45085U 20006AT  20195.91667824 +.00004558 +00000-0 +33159-3 0  9996",
    "2 45085 053.0008 155.7386 0001352 085.2110 042.9283 15.05599130001808",
)


def seen_solutions() -> list[ObservationMessage]:
    rows = [line.split() for line in SEEN.split("\n")[1:-1]]
    return [
        ObservationMessage(f"2020-07-24T{clock}Z", float(ra), float(dec), "icrs", 3.0)
        for clock, ra, dec in rows
    ]


def ahead_s(one: ObservationMessage) -> float:
    """Return by how much the satellite is ahead of its elements, by skyfield; the observer is not."""
    satellite, scale = EarthSatellite(*SEEN_ELEMENTS), load.timescale(builtin=True)
    site = wgs84.latlon(SEEN_FROM[0], SEEN_FROM[1], SEEN_FROM[2])
    at = scale.from_datetime(datetime.fromisoformat(one.utc))
    observer = site.at(at).position.km
    ra, dec = math.radians(one.ra_deg), math.radians(one.dec_deg)
    toward = np.array([math.cos(dec) * math.cos(ra), math.cos(dec) * math.sin(ra), math.sin(dec)])

    def seen(ahead: float) -> NDArray[np.float64]:
        away_km = 1500.0
        for _ in range(3):
            later = scale.tt_jd(at.tt + (ahead - away_km / 299792.458) / 86400.0)
            place = satellite.at(later).position.km - observer
            away_km = float(np.linalg.norm(place))
        direction: NDArray[np.float64] = place / away_km
        return direction

    ahead = 0.0
    for _ in range(8):
        now, after = seen(ahead), seen(ahead + 0.01)
        path = (after - now) / 0.01
        ahead += float((toward - now) @ path / (path @ path))
    return ahead


def seen_pass(folder: Path, lines: tuple[str, str]) -> list[str]:
    elements = folder / "starlink.tle"
    elements.write_text("\n".join(lines) + "\n")
    site = ",".join(map(str, SEEN_FROM))
    where = ["--elements", str(elements), "--site", site]
    span = ("--clock", "2020-07-24T03:19:10Z", "--to", "2020-07-24T03:22:54Z")
    return ["45085", *where, *span, "--min-alt", "15"]


def test_a_real_satellite_ten_days_after_its_elements_is_met_by_real_plate_solutions(tmp_path: Path) -> None:
    path = tmp_path / "pass.mcap"
    seen = seen_solutions()
    arguments = seen_pass(tmp_path, SEEN_ELEMENTS)
    lines = [encode_message(one) for one in seen]
    summary, _ = fly(lines, "--record", str(path), command=["track", *arguments, *TRACK[2:6], *TRACK[-2:]])
    estimate = summary["estimate"]
    assert (len(seen), estimate["accepted"], estimate["begun_anew"]) == (33, 33, 0)
    last_utc_s = float(Utc.parse(seen[-1].utc).unix_s)
    views = [json.loads(entry.data) for entry in Recording(path).entries() if entry.topic == VIEW]
    told = next(view["estimate"] for view in views if view["utc_s"] > last_utc_s + 1.0)
    since_s = np.array([float(Utc.parse(one.utc).unix_s) - last_utc_s for one in seen])
    wanted = float(np.polyfit(since_s, np.array(list(map(ahead_s, seen))), 2)[-1])
    assert told["along_s"] == pytest.approx(wanted, abs=0.02)
    assert told["along_s"] == pytest.approx(wanted, abs=3.0 * math.hypot(told["along_sigma_s"], 0.001))


def test_of_observations_that_no_correction_explains_it_is_said_that_none_fits() -> None:
    out, _ = fly_text(solutions(5, true_satellite(120.0)), [word for word in TRACK if word != "--json"])
    assert "observations: 0 taken, 5 rejected" in out
    assert "none fits the elements; check satellite, site and clock (sattrack bias fits larger errors)" in out
