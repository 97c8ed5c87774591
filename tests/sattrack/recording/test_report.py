"""What a report says is what was put into the recording: gains, delays, ripple, biases; and no more."""

from __future__ import annotations

import base64
import dataclasses
import json
import math
import random
import re
import time
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
import pytest
from late_start import late
from matplotlib.figure import Figure

from sattrack.cli import recording as commands
from sattrack.cli.main import run
from sattrack.cli.recording import _learn
from sattrack.core.errors import SattrackError
from sattrack.mount.model import MountProfile
from sattrack.mount.profiles import load_profile_file
from sattrack.recording import rendering
from sattrack.recording.fits import (
    NoFit,
    ObservedBias,
    fit_biases,
    lines,
    one_way,
    repeats,
    smooth_track,
    spectrum,
)
from sattrack.recording.format import COMMAND, OPERATOR, STATUS, VIEW, Recording
from sattrack.recording.recorder import Recorder
from sattrack.recording.replay import replay
from sattrack.recording.report import AxisFigures, BiasFigures, ErrorFigures, Report, TimeFigures
from sattrack.recording.trace import Trace
from sattrack.runtime import demo_pass
from sattrack.runtime.facts import RunRequest, engine_of, prepare
from sattrack.runtime.flight import fly_virtual
from sattrack.safety import SafetyLimits
from sattrack.settings import SiteSettings
from sattrack.views.formatting import summary_lines
from sattrack.views.messages import Go, Message, Nudge, ObservationMessage, Pause, SolvedField, StopNow
from tle.bias import Bias
from tle.formats.observations import Stations, read_observations
from tle.instants import Utc
from tle.observed import bias_from_observation
from tle.propagator import Propagator

if TYPE_CHECKING:
    from sattrack.recording.fits import BiasFit
    from sattrack.views.run import Summary

pytestmark = pytest.mark.usefixtures("traced_once")
ROOT = Path(__file__).resolve().parents[3]
EXAMPLES = ROOT / "examples"
LATCHED = ROOT.parent / "shared" / "cases" / "latched"
BIAS = Bias(1.4, 0.012)
CULMINATION_S = 1790946324.0
LEIDEN = ("--site", "52.1541,4.4908,0")
SIGMA_ARCSEC = 20.0


def solution(utc_s: float, rng: random.Random, bias: Bias = BIAS, sigma_arcsec: float = SIGMA_ARCSEC) -> dict:
    """Return a camera's plate solution of a satellite that is off its elements by a bias, noise drawn."""
    seen = Propagator(demo_pass.elements(), demo_pass.SITE.place()).with_place("astrometric")
    true = seen.at(Utc(utc_s), bias)
    dec_deg = float(true.dec_deg) + rng.gauss(0.0, sigma_arcsec / 3600.0)
    east_deg = rng.gauss(0.0, sigma_arcsec / 3600.0) / math.cos(math.radians(dec_deg))
    return {
        "type": "observation",
        "utc": Utc(utc_s).isoformat("microseconds"),
        "ra_deg": (float(true.ra_deg) + east_deg) % 360.0,
        "dec_deg": dec_deg,
        "frame": "icrs",
        "sigma_arcsec": sigma_arcsec,
    }


@pytest.fixture(scope="module")
def observed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A minute about culmination on a mount that is not ideal, with a camera's observations."""
    folder = tmp_path_factory.mktemp("observed")
    rng = random.Random(4)
    seen = [json.dumps(solution(CULMINATION_S + s, rng)) for s in range(-36, 34, 5)]
    seen.append(json.dumps(solution(CULMINATION_S, rng, Bias(9.0, 0.5))))
    path = folder / "observed.mcap"
    monkey = pytest.MonkeyPatch()
    with monkey.context() as patched, (folder / "seen.jsonl").open("w+b") as stream:
        stream.write("\n".join(seen).encode() + b"\n")
        stream.seek(0)
        patched.setattr("sys.stdin", type("Input", (), {"buffer": stream})())
        # It begins 15 s before the pass: enough for this slew.
        options = [
            "--min-alt",
            "55",
            "--clock",
            "2026-10-02T13:04:30Z",
            "--observations",
            "stdin",
            "--record",
            str(path),
        ]
        profile = ["--profile", str(EXAMPLES / "profiles" / "realistic.toml")]
        code = run(["track", "25544", "--virtual", "--mount", "sim", "--json", *profile, *options])
    assert code == 0
    return path


def no_plots(*_: object) -> dict[str, object]:
    """Return what stands for a pass' plots where a test reads the page's words alone."""
    return {}


def report_of(path: Path, capsys: pytest.CaptureFixture[str]) -> dict:
    capsys.readouterr()
    assert run(["report", str(path), "--json"]) == 0
    told: dict = json.loads(capsys.readouterr().out)
    return told


def test_gains_of_an_azimuth_mount_are_those_of_its_axes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mount, path = tmp_path / "altaz.toml", tmp_path / "altaz.mcap"
    mount.write_text(
        "additive = false\n[stands_at]\nlatitude_deg = 52.1541\nlongitude_deg = 4.4908\n"
        "[geometry]\npole_azimuth_deg = 0.0\npole_altitude_deg = 90.0\n"
    )
    begin = ("--clock", "2026-10-02T13:03:15Z", "--to", "2026-10-02T13:04:05Z")
    site = ("--site", "52.1541,4.4908,0", "--elements", str(EXAMPLES / "iss_leiden.tle"))
    followed = ("track", "25544", "--virtual", "--mount", "sim", "--json", *site, *begin)
    assert run([*followed, "--profile", str(mount), "--record", str(path)]) == 0
    told = report_of(path, capsys)
    for axis in ("ra", "dec"):
        assert told[axis]["gain"] == pytest.approx(1.0, abs=1e-4)
        assert told[axis]["delay_s"] == pytest.approx(0.0253, abs=0.002)
    assert not any("gain" in words for words in told["advice"])
    assert told["axes"] == ["first axis", "second axis"]
    assert run(["report", str(path)]) == 0
    shown = capsys.readouterr().out
    assert "first axis" in shown
    assert "hour angle" not in shown
    assert "declination" not in shown


def test_gain_and_delay_are_those_of_the_simulated_mount(
    observed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told = report_of(observed, capsys)
    # The profile says 1.0005 and 0.9997; 2 ms of the link, and half a period of 50 ms until the mount looks.
    assert told["ra"]["gain"] == pytest.approx(1.0005, abs=2e-5)
    assert told["dec"]["gain"] == pytest.approx(0.9997, abs=2e-5)
    assert told["ra"]["delay_s"] == pytest.approx(0.027, abs=0.003)
    assert told["dec"]["delay_s"] == pytest.approx(0.027, abs=0.003)
    assert told["link"]["delay_ms"] == pytest.approx(2.0, abs=0.2)
    assert told["link"]["lost"] == 0
    assert told["error"]["median_arcsec"] < 0.1


def test_the_satellites_biases_are_those_that_the_camera_saw(
    observed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bias = report_of(observed, capsys)["bias"]
    assert bias["source"] == "observations"
    assert bias["observations"] == 14
    assert bias["rejected"] == 1
    assert abs(bias["along_s"] - BIAS.along_s) < 3.0 * bias["along_sigma_s"] < 0.03
    assert abs(bias["cross_deg"] - BIAS.cross_deg) < 3.0 * bias["cross_sigma_deg"] < 0.02


def test_what_to_change_names_the_option(observed: Path, capsys: pytest.CaptureFixture[str]) -> None:
    advice = report_of(observed, capsys)["advice"]
    # A bias of milliseconds can be sure, and must not be rounded to 0.
    assert any(re.search(r"--bias-along 1\.[34]\d{3} --bias-cross 0\.01\d{3},", words) for words in advice)


def test_without_observations_a_nudge_is_told_as_one_and_nothing_as_nothing(
    short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert report_of(short, capsys)["bias"] is None
    assert run(["report", str(short)]) == 0
    assert "a mount that follows shows nothing of the satellite" in capsys.readouterr().out
    nudged = nudge(tmp_path / "nudged.mcap", short, b'{"type":"nudge","along_s":0.25}')
    bias = report_of(nudged, capsys)["bias"]
    assert bias["source"] == "nudge"
    assert bias["along_s"] == pytest.approx(0.25)
    assert bias["along_sigma_s"] is None
    assert run(["report", str(nudged)]) == 0
    assert "the operator's last nudge" in capsys.readouterr().out
    # What moves the axes, or was taken away again, is no bias of the satellite.
    axis = b'{"type":"offset","what":"dec_axis_deg","how":"add","value":0.01}'
    taken_away = b'{"type":"nudge","along_s":0.25}', b'{"type":"clear_bias"}'
    for number, words in enumerate(((axis,), taken_away)):
        assert report_of(nudge(tmp_path / f"{number}.mcap", short, *words), capsys)["bias"] is None


def test_a_report_says_where_today_s_code_did_not_go_on(
    short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    newer = nudge(tmp_path / "newer.mcap", short, b'{"type":"of_a_newer_version"}')
    (problem,) = report_of(newer, capsys)["problems"]
    assert "this report ends where today's code broke" in problem
    assert "of_a_newer_version" in problem


def nudge(path: Path, short: Path, *words: bytes) -> Path:
    recording = Recording(short)
    with path.open("wb") as stream:
        recorder = Recorder(stream, recording.header.spec)
        for number, entry in enumerate(recording.entries()):
            recorder.write(*entry)
            if number == 300:
                for line in words:
                    recorder.write(OPERATOR, entry.utc_s, line)
        recorder.close()
    return path


def test_why_an_older_run_ended_is_what_its_views_say(capsys: pytest.CaptureFixture[str]) -> None:
    """Format 1 has no summary, and today's code sends commands that its mount does not seem to obey."""
    older = Path(__file__).parent / "data" / "version_1.mcap"
    assert [json.loads(one.data)["ended_by"] for one in Recording(older).entries() if one.topic == VIEW][
        -1
    ] == "set"
    assert report_of(older, capsys)["ended_by"] == "set"


def test_html_holds_its_plots_and_nothing_from_elsewhere(
    observed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn, savefig = [], Figure.savefig
    monkeypatch.setattr(
        Figure, "savefig", lambda self, *args, **more: (drawn.append(self), savefig(self, *args, **more))
    )
    out, folder, tdm = tmp_path / "report.html", tmp_path / "plots", tmp_path / "seen.tdm"
    options = ["--html", str(out), "--png", str(folder), "--tdm", str(tdm)]
    assert run(["report", str(observed), *options]) == 0
    text = out.read_text()
    pictures = re.findall(r'src="([^"]*)"', text)
    assert len(pictures) == 7
    images = set()
    for picture in pictures:
        kind, _, data = picture.partition(",")
        assert kind == "data:image/png;base64"
        images.add(base64.b64decode(data))
    assert all(image.startswith(b"\x89PNG") for image in images)
    assert "http" not in re.sub(r'src="[^"]*"', "", text)
    assert {one.read_bytes() for one in folder.iterdir()} == images
    assert len(images) == len(drawn) == 7
    assert len(read_observations(tdm, Stations({}, demo_pass.SITE.place()))) == 15
    assert run(["report", str(observed), "--html", str(out)]) == 2
    assert "exists already" in capsys.readouterr().err


def test_a_folder_that_cannot_be_made_is_reported_before_the_work(
    short: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(commands, "make_report", lambda *_: pytest.fail("the work was begun"))
    folder = short / "plots"
    assert run(["report", str(short), str(short), "--plot", str(folder)]) == 2
    assert f"{folder}: cannot be made: Not a directory" in capsys.readouterr().err


def test_several_files_show_their_trend_in_order_of_time(
    observed: Path,
    short: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    out = tmp_path / "trend.html"
    monkeypatch.setattr(rendering, "figures", no_plots)
    capsys.readouterr()
    assert run(["report", str(short), str(observed), "--html", str(out)]) == 0
    table = capsys.readouterr().out.splitlines()[-3:]
    assert table[0].startswith("began")
    assert table[1][:20] < table[2][:20]
    assert "<h2>Trend</h2>" in out.read_text()
    assert run(["report", str(short), str(observed), "--tdm", str(tmp_path / "x.tdm")]) == 2


def test_a_pass_that_was_followed_for_a_moment_is_drawn_as_far_as_it_went(tmp_path: Path) -> None:
    """In less than a second there may be none of the places that the chart of the sky shows."""
    path, plots = tmp_path / "brief.mcap", tmp_path / "plots"
    span = ("--clock", "2026-10-02T13:05:15Z", "--to", "2026-10-02T13:05:23Z", "--min-alt", "78")
    assert run(["track", "25544", "--virtual", "--mount", "sim", *span, "--record", str(path)]) == 0
    assert run(["report", str(path), "--plot", str(plots)]) == 0
    drawn = {one.name for one in plots.iterdir()}
    assert "brief-error-along-and-across-the-track.png" in drawn
    assert "brief-sky.png" not in drawn


@pytest.mark.parametrize("count", [3, 9, 90])
def test_a_trend_is_drawn_in_order_of_time_with_names_that_can_be_read(count: int) -> None:
    axis = AxisFigures(1.0005, 1e-5, None, None, ())
    bias = BiasFigures("nudge", "2026-10-02T13:00:00Z", 0.5, 0.0)
    times = TimeFigures(0.0, {}, 0.0, 0.0, 400.0, 0.0, 400.0)
    reports = [
        Report(
            *("x", "STARLINK-31234", 1, "sim", Utc(CULMINATION_S + 86400.0 * k).isoformat("seconds")),
            *(400.0, 8000, "set", ErrorFigures(1.0 + k, 9.0, 1.0, 2.0, 0.0, 0.0, 1.0, 1.0)),
            *(None, bias, axis, axis, (), (), True, None, times),
        )
        for k in reversed(range(count))
    ]
    figure = rendering.trend(reports)
    assert figure is not None
    errors, biases, gains = figure.axes
    assert errors.lines[0].get_ydata().tolist() == [1.0 + k for k in range(count)]
    assert [one.get_text() for one in biases.get_legend().get_texts()] == ["last nudge"]
    figure.canvas.draw()
    boxes = [one.get_window_extent() for one in gains.get_xticklabels()]
    assert len(boxes) >= min(count, 30)
    assert not any(one.overlaps(other) for one, other in pairwise(boxes))


def test_plots_of_recordings_of_one_name_lie_side_by_side(
    short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rendering, "figures", lambda *_: {"Link": rendering.new_figure(1.0, 1.0)})
    monkeypatch.setattr(commands, "trend", lambda _: None)
    (tmp_path / "first").mkdir()
    other = tmp_path / "first" / short.name
    other.write_bytes(short.read_bytes())
    assert run(["report", str(other), str(short), "--plot", str(tmp_path / "plots")]) == 0
    drawn = {one.name for one in (tmp_path / "plots").iterdir()}
    assert drawn == {"short-link.png", "short-2-link.png"}


@pytest.mark.parametrize(("one_deg", "other_deg"), [(180.0, -180.0), (-4.5, 355.5), (179.98, -179.98)])
def test_a_site_is_the_same_however_its_longitude_is_written(
    one_deg: float, other_deg: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sattrack.recording.sky_residuals.sky_residuals", lambda *_: NoFit("no camera"))
    passes: Any = [
        (
            SimpleNamespace(path=f"{number}.mcap"),
            SimpleNamespace(
                started_utc_s=float(number), profile=MountProfile(), site=SiteSettings(52.0, longitude_deg)
            ),
            None,
        )
        for number, longitude_deg in enumerate((one_deg, other_deg))
    ]
    with pytest.raises(SattrackError, match="no camera saw anything"):
        _learn(passes, tmp_path / "new.toml", None)


def test_passes_without_a_camera_teach_no_profile(
    short: Path, traced_once: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = tmp_path / "learnt.toml"
    assert run(["report", str(short), "--learn-profile", str(target)]) == 1
    told = capsys.readouterr().err
    assert f"{short}: left out: cameras saw 0 times where the axes pointed; it takes 40" in told
    assert not target.exists()
    assert run(["report", str(short), "--profile", str(target)]) == 2
    assert "--learn-profile" in capsys.readouterr().err


def test_a_track_is_smoothed_as_far_as_its_sigma_says() -> None:
    rng = np.random.default_rng(2)
    at = np.arange(0.0, 60.0, 0.05)
    true = 0.3 * np.sin(at / 6.0)
    track = smooth_track(at, true + rng.normal(0.0, 0.05, len(at)))
    assert track.noise == pytest.approx(0.05, rel=0.1)
    off = (track.values - true)[40:-40]
    assert np.std(off) < 0.02
    assert 0.85 < np.mean(np.abs(off) < 2.0 * track.sigmas[40:-40]) <= 1.0
    assert np.std(track.innovations[40:]) == pytest.approx(1.0, abs=0.15)


def test_spans_of_hours_are_judged_each_by_its_own_median() -> None:
    """Twelve hours at 20 a second, with a clock that was set back, take about twelve times as long as one."""
    rng, fastest_s = np.random.default_rng(7), []
    for count in (72_000, 864_000):
        at = 1.79e9 + 0.05 * np.arange(count) - np.where(np.arange(count) > count // 2, 90.0, 0.0)
        levels = rng.uniform(0.1, 20.0, 2200)
        number = ((at - at[0]) // 20.0).astype(int)
        marked = rng.random(count) < 0.9
        plan = SimpleNamespace(on_target_arcsec=2.0)
        run = SimpleNamespace(
            utc_s=at, total=levels[number], engine=SimpleNamespace(spec=SimpleNamespace(plan=plan))
        )
        took_s = []
        for _ in range(3):
            began_s = time.process_time()
            near = Trace._near(run, marked)
            took_s.append(time.process_time() - began_s)
        assert (near == (marked & (levels[number] < 10.0))).all()
        fastest_s.append(min(took_s))
    # Twelve times the samples do not fit in the processor's cache; judged span by span over all of them,
    # they would take 144 times as long.
    assert fastest_s[1] < 72.0 * fastest_s[0]


def test_a_smoothed_track_is_the_most_likely_one_of_all_states_at_once() -> None:
    """Every step's and every sample's equation, solved together: what a filter and its way back come to."""
    rng = np.random.default_rng(4)
    at = np.cumsum(rng.choice([0.02, 0.05, 0.9], 40))
    values = rng.normal(0.0, 0.3, 40)
    track = smooth_track(at, values)
    rows, wanted = [np.zeros((2, 80))], [np.array([values[0] / track.noise, 0.0])]
    rows[0][:, :2] = np.diag([1.0, 0.1**0.5]) / track.noise
    for k, dt in enumerate(np.diff(at), 1):
        walk = track.noise**2 * np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]])
        white = np.linalg.inv(np.linalg.cholesky(walk))
        row = np.zeros((2, 80))
        row[:, 2 * k - 2 : 2 * k], row[:, 2 * k : 2 * k + 2] = white @ [[-1.0, -dt], [0.0, -1.0]], white
        rows.append(row)
        wanted.append(np.zeros(2))
    system = np.concatenate([*rows, np.eye(80)[::2] / track.noise])
    states = np.linalg.lstsq(system, np.concatenate([*wanted, values / track.noise]), rcond=None)[0]
    assert track.values == pytest.approx(states[::2], rel=1e-5, abs=1e-6)
    sigmas = np.sqrt(np.diag(np.linalg.inv(system.T @ system)))[::2]
    assert track.sigmas == pytest.approx(sigmas, rel=1e-5)


def test_a_spectrum_finds_a_ripple_of_known_size_and_nothing_in_noise() -> None:
    rng = np.random.default_rng(3)
    angle = np.linspace(10.0, 130.0, 6000)
    ripple = 0.4 * np.sin(np.radians(angle * 96.0 + 20.0))
    noise = rng.normal(0.0, 0.05, len(angle))
    (line,) = lines(*spectrum(angle, ripple + noise))
    assert line.cycles_a_turn == pytest.approx(96.0, abs=1.5)
    assert line.amplitude_arcsec == pytest.approx(0.4, rel=0.2)
    assert not [one for one in lines(*spectrum(angle, noise)) if one.amplitude_arcsec > 0.02]
    assert lines(*spectrum(angle[:100], ripple[:100])) == []


def fitted(seed: int, count: int) -> tuple[BiasFit, float]:
    """Return the fit of a pass of which a camera took so many plates, and its cross bias, km, by the seed."""
    rng = random.Random(seed)
    along, cross = rng.uniform(-5.0, 5.0), rng.uniform(-0.02, 0.02)
    elements = Propagator(demo_pass.elements(), demo_pass.SITE.place())
    said = []
    for _ in range(count):
        utc_s = CULMINATION_S + rng.uniform(-150.0, 150.0)
        seen = solution(utc_s, rng, Bias(along, 0.0))
        found = bias_from_observation(
            elements, seen["ra_deg"], seen["dec_deg"], Utc.parse(seen["utc"]), "icrf", SIGMA_ARCSEC
        )
        range_km = float(elements.at(Utc(utc_s + found.along_s)).range_km)
        said.append(
            ObservedBias(
                utc_s,
                found.along_s - along,
                range_km * math.tan(math.radians(found.cross_deg)) + cross,
                found.along_sigma_s,
                math.radians(found.cross_sigma_deg) * range_km,
            )
        )
    fit = fit_biases(said)
    assert fit is not None
    return fit, cross


@pytest.mark.parametrize(("seeds", "slack"), [(25, 0.17), pytest.param(1000, 0.02, marks=pytest.mark.soak)])
def test_smoothed_biases_are_as_near_to_the_truth_as_they_say(seeds: int, slack: float) -> None:
    """The truth is zero along; drifts are zero, and across it is a constant distance."""
    inside = {"along": 0, "cross": 0, "drift": 0, "cross drift": 0}
    for seed in range(seeds):
        fit, cross = fitted(seed, 10)
        inside["cross"] += abs(fit.cross.value - cross) < 2.0 * fit.cross.sigma
        inside["along"] += abs(fit.along.value) < 2.0 * fit.along.sigma
        inside["drift"] += abs(fit.along.drift) < 2.0 * fit.along.drift_sigma
        inside["cross drift"] += abs(fit.cross.drift) < 2.0 * fit.cross.drift_sigma
    for name, count in inside.items():
        assert abs(count / seeds - 0.9545) < slack, name


def test_biases_with_constant_drifts_are_those_of_a_weighted_line() -> None:
    """numpy's polyfit judges; what is known beforehand is far wider."""
    rng = np.random.default_rng(6)
    at = 1.79e9 + np.sort(rng.uniform(0.0, 300.0, 25))
    off = at - at.mean()
    sigmas = rng.uniform(0.002, 0.02, (2, 25))
    seen = [1.4 + 1e-3 * off, 0.3 - 2e-3 * off] + sigmas * rng.uniform(-1.0, 1.0, (2, 25))
    fit = fit_biases([ObservedBias(*one) for one in np.array([at, *seen, *sigmas]).T.tolist()])
    assert fit is not None
    assert fit.chi_square < 1.0
    for found, values, sigma in zip((fit.along, fit.cross), seen, sigmas, strict=True):
        (drift, value), covariance = np.polyfit(off, values, 1, w=1.0 / sigma, cov="unscaled")
        assert (found.value, found.drift) == pytest.approx((value, drift), rel=1e-4)
        assert (found.sigma, found.drift_sigma) == pytest.approx(np.sqrt(np.diag(covariance)[::-1]), rel=1e-4)
    assert fit.along_all == pytest.approx(fit.along.value + fit.along.drift * off, abs=1e-9)


def test_outliers_are_left_out_and_more_scatter_than_claimed_grows_the_sigma() -> None:
    rng = random.Random(1)
    said = [ObservedBias(10.0 * i, 1.0 + rng.gauss(0.0, 0.03), 0.2, 0.01, 0.05) for i in range(30)]
    fit = fit_biases([*said, ObservedBias(15.0, 30.0, 0.2, 0.01, 0.05)])
    assert fit is not None
    assert (fit.taken, fit.rejected) == (30, 1)
    assert fit.along.value == pytest.approx(1.0, abs=0.03)
    assert fit.along.sigma > 0.003
    assert fit_biases([]) is None


def flown(
    path: Path,
    messages: tuple[tuple[float, Message], ...] = (),
    limits: SafetyLimits | None = None,
    min_alt_deg: float = 60.0,
    says: dict[str, float] | None = None,
    name: str = "ISS (ZARYA)",
    **hardware: object,
) -> Summary:
    """Record a pass in virtual time; messages are dated from culmination.

    `hardware` changes what the mount is, `says` what its profile says, `name` what the satellite is called.
    """
    profile = load_profile_file(EXAMPLES / "profiles" / "realistic.toml")
    servo = {**profile.simulator["servo"], **hardware.pop("servo", {})}
    profile = msgspec.structs.replace(profile, simulator={**profile.simulator, **hardware, "servo": servo})
    profile = msgspec.structs.replace(profile, **(says or {}))
    request = RunRequest(
        *("25544", "sim", None, None, None, min_alt_deg),
        virtual=True,
        record=path,
        profile=profile,
        limits=limits or SafetyLimits(),
    )
    prepared = prepare(request)
    facts = late(prepared.facts, 12.0)
    assert facts.elements is not None
    facts = msgspec.structs.replace(facts, elements=dataclasses.replace(facts.elements, name=name))
    prepared = dataclasses.replace(prepared, facts=facts)
    return fly_virtual(prepared, messages=tuple((CULMINATION_S + at, word) for at, word in messages))


@pytest.mark.parametrize(
    "name", ["M6", "L9", *(pytest.param(name, marks=pytest.mark.soak) for name in ("L6", "L7"))]
)
def test_of_a_mount_that_was_never_on_target_no_fit_is_told(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    if not LATCHED.is_dir():
        pytest.skip(
            "the recordings of mounts that were never on target (../shared/cases/latched) are not here"
        )
    path = LATCHED / f"{name}.mcap"
    told = report_of(path, capsys)
    assert told["acquired"] is False
    assert told["error"] is None
    missed = told["missed"]
    assert 30.0 < missed["ra"]["typical_arcsec"] < 90.0
    assert missed["dec"]["typical_arcsec"] < 5.0
    assert missed["largest_arcsec"] > 0.99 * missed["ra"]["largest_arcsec"] > 500.0
    assert told["times"]["acquiring_s"] > 25.0
    for axis in ("ra", "dec"):
        assert (told[axis]["gain"], told[axis]["delay_s"], told[axis]["lines"]) == (None, None, [])
        assert "never on target" in told[axis]["untold"][0]
    assert told["advice"][0] == "only right ascension was far off: look for what is peculiar to that axis"
    assert "mount calibrate" in told["advice"][1]
    assert run(["report", str(path)]) == 0
    lines_told = capsys.readouterr().out.splitlines()
    assert lines_told[0].startswith("NEVER ON TARGET")
    assert "typically" in lines_told[0]
    assert not any(re.match("to change +nothing", words) for words in lines_told)


def test_a_span_held_by_a_limit_is_counted_apart_and_fitted_from_nowhere(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # 25 s after culmination the satellite passes behind the pillar, and comes out again.
    around = ((180.0, 0.0), (270.0, 0.0), (350.0, 0.0))
    pillar = ((20.0, 0.0), (103.0, 0.0), (104.0, 66.0), (106.0, 66.0), (107.0, 0.0), *around)
    path = tmp_path / "held.mcap"
    summary = flown(path, limits=SafetyLimits(horizon=pillar), min_alt_deg=53.0)
    held_s = summary.held_s["horizon"]
    assert held_s > 5.0
    assert summary.reported_peak_arcsec is not None
    assert summary.reported_peak_arcsec < 2.0
    assert summary.lost_peak_arcsec is not None
    assert summary.lost_peak_arcsec > 3600.0
    told = report_of(path, capsys)
    times = told["times"]
    assert times["held_s"] == {"horizon": pytest.approx(held_s, abs=0.3)}
    assert times["rejoining_s"] > 0.5
    # From 53° to 53° the pass lasts so long (made with another library).
    assert times["following_s"] + times["rejoining_s"] + held_s == pytest.approx(84.6, abs=4.0)
    assert told["error"]["peak_arcsec"] < 2.0
    assert told["ra"]["gain"] == pytest.approx(1.0005, abs=2e-5)
    assert told["ra"]["delay_s"] == pytest.approx(0.027, abs=0.003)
    assert told["dec"]["delay_s"] == pytest.approx(0.027, abs=0.003)
    assert [words.split(" held the mount")[0] for words in told["advice"]] == ["the horizon limit"]
    monkeypatch.setattr(rendering, "figures", no_plots)
    assert run(["report", str(path), "--html", str(tmp_path / "held.html")]) == 0
    assert re.search(
        r"counted apart +.*held by the horizon limit [0-9.]+ s; rejoining", capsys.readouterr().out
    )
    assert "held by the horizon limit" in (tmp_path / "held.html").read_text()


def test_what_the_keyhole_takes_and_the_way_back_are_in_no_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # It passes 0.3° from the pole, where the hour angle turns at 26 °/s; the mount does 6 °/s.
    elements, path = tmp_path / "sky.tle", tmp_path / "keyhole.mcap"
    elements.write_text(
        "BY THE POLE\n"
        "1 70014U          26275.01380287  .00000000  00000+0  00000+0 0  9991\n"
        "2 70014  89.3729 329.4206 0006946 211.9293 193.3815 14.02428269588313\n"
    )
    options = (
        "--mount",
        "sim",
        "--virtual",
        "--clock",
        "2026-10-02T20:55:40Z",
        "--record",
        str(path),
        "--json",
    )
    assert run(["track", "70014", "--elements", str(elements), *LEIDEN, "--min-alt", "45", *options]) == 0
    summary = json.loads(capsys.readouterr().out.splitlines()[-1])["summary"]
    lost_s = summary["held_s"]["keyhole"] + summary["rejoining_s"]
    assert 10.0 < lost_s < 40.0
    assert summary["lost_peak_arcsec"] > 3600.0
    assert summary["reported_rms_arcsec"] < 0.5
    assert summary["reported_peak_arcsec"] < 2.5
    told = report_of(path, capsys)
    assert told["times"]["held_s"]["keyhole"] == pytest.approx(summary["held_s"]["keyhole"], abs=0.2)
    assert told["error"]["rms_arcsec"] == pytest.approx(summary["reported_rms_arcsec"], rel=1e-6)
    assert told["times"]["off_target_s"] < 1.0
    assert "(the keyhole)" in told["advice"][0]


def test_a_pass_that_was_held_throughout_is_not_told_to_need_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    wall = tuple((azimuth, 85.0) for azimuth in (0.0, 90.0, 180.0, 270.0))
    path = tmp_path / "walled.mcap"
    monkeypatch.setattr(rendering, "figures", no_plots)
    assert flown(path, limits=SafetyLimits(horizon=wall, optical=False), min_alt_deg=75.0).samples == 0
    told = report_of(path, capsys)
    assert told["acquired"] is False
    assert told["times"]["held_s"]["horizon"] > 10.0
    assert len(told["advice"]) == 1
    assert "horizon limit" in told["advice"][0]
    assert run(["report", str(path), "--html", str(tmp_path / "walled.html")]) == 0
    assert 'class="bad">NEVER ON TARGET' in (tmp_path / "walled.html").read_text()


def test_a_pass_that_its_operator_ended_early_gets_no_advice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    summary = flown(tmp_path / "early.mcap", messages=((-300.0, StopNow()),))
    assert (summary.ended_by, summary.acquired_after_s, summary.mount_stopped) == ("operator", None, True)
    (line,) = (line for line in summary_lines(summary) if "never on target" in line)
    assert line == "  never on target: the operator ended the run before the mount could follow"
    told = report_of(tmp_path / "early.mcap", capsys)
    assert told["advice"] == ["the operator ended the run before the mount could follow"]


@pytest.mark.parametrize(
    "name", ["ISS [/b]", "[bold]ISS[/bold] :star:", "[link=https://example.org]ISS[/link]"]
)
def test_a_name_is_text_and_never_markup(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = str(tmp_path / "named.mcap")
    flown(tmp_path / "named.mcap", messages=((-300.0, StopNow()),), name=name)
    for files in ([path], [path, path]):
        assert run(["report", *files]) == 0
        assert capsys.readouterr().out.count(name) == {1: 1, 2: 4}[len(files)]


def test_a_name_commands_no_terminal_and_is_in_json_as_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, name = (
        tmp_path / "named.mcap",
        "ISS\x1b[2J\x1b]0;owned\x07\x1b]8;;https://example.org\x1b\\\x9b1m\u202e",
    )
    flown(path, messages=((-300.0, StopNow()),), name=name)
    for command in ("report FILE", "report FILE FILE", "recording info FILE", "replay FILE"):
        assert run([str(path) if word == "FILE" else word for word in command.split()]) == 0
        told = "".join(capsys.readouterr())
        assert told.replace("\n", "").isprintable()
        assert ("ISS?[2J?]0;owned" in told) == ("replay" not in command)
    assert report_of(path, capsys)["name"] == name


def test_of_a_recording_that_is_cut_off_that_comes_first_and_nothing_is_guessed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole, cut = EXAMPLES / "passes" / "clean.mcap", tmp_path / "cut.mcap"
    recording = Recording(whole)
    for share in (3, 30):
        cut.write_bytes(whole.read_bytes()[: whole.stat().st_size // share])
        assert Recording(cut).cut_off
        assert run(["report", str(cut), "--output", str(tmp_path / f"{share}.html")]) == 0
        out, err = capsys.readouterr()
        lines_told = out.splitlines()
        assert f"the report is in {tmp_path / f'{share}.html'}" in err
        assert lines_told[0].startswith("wrong with the file")
        text = "\n".join(lines_told)
        assert "cut off" in lines_told[0] or "cut off" in lines_told[1]
        assert "the file does not show its end" in text
        assert not re.search("None|NEVER|calibrate|rehearse", text)
        page = (tmp_path / f"{share}.html").read_text()
        assert page.index("cut off") < page.index("<table>")
    assert not recording.cut_off


def test_a_mount_that_follows_beside_the_satellite_is_not_told_to_need_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A ripple of more than a slow servo can take."""
    rough = {"bandwidth_hz": 4.0, "integral_hz": 0.5, "ripple_a": 3.3}
    summary = flown(tmp_path / "rough.mcap", min_alt_deg=73.0, servo=rough)
    assert summary.reported_rms_arcsec is not None
    assert summary.reported_rms_arcsec > 2.0
    told = report_of(tmp_path / "rough.mcap", capsys)
    times = told["times"]
    assert times["off_target_s"] == pytest.approx(times["following_s"] - summary.on_target_s, abs=0.3)
    assert told["advice"][0].startswith(
        f"the mount was more than 2″ off for {times['off_target_s']:.0f} of the"
    )
    for axis in ("ra", "dec"):
        assert told[axis]["delay_s"] is None or told[axis]["delay_sigma_s"] < 0.005
        assert not any("act" in words.split() for words in told["advice"])


def test_a_pause_and_the_way_back_are_counted_apart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    summary = flown(tmp_path / "paused.mcap", messages=((-10.0, Pause()), (-4.0, Go())), min_alt_deg=70.0)
    times = report_of(tmp_path / "paused.mcap", capsys)["times"]
    assert times["paused_s"] == pytest.approx(summary.paused_s, abs=0.3)
    assert times["rejoining_s"] == pytest.approx(summary.rejoining_s, abs=0.3)


def test_the_dates_of_a_camera_are_corrected_as_in_the_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The stars show its clock to be 0.3 s ahead before it sees the satellite."""
    rng, messages = random.Random(6), list[tuple[float, Message]]()
    for at in [*np.arange(-25.0, -5.0, 0.5).tolist(), *np.arange(-5.0, 8.25, 0.25).tolist()]:
        found = solution(CULMINATION_S + at, rng, Bias() if at < -5.0 else BIAS, 2.0)
        utc, place = (
            Utc(CULMINATION_S + at + 0.3).isoformat("microseconds"),
            (found["ra_deg"], found["dec_deg"]),
        )
        among_stars = SolvedField(utc, *place, 2.0, "guide")
        of_it = ObservationMessage(utc, *place, "icrs", 2.0, camera="guide")
        messages.append((at + 0.5, among_stars if at < -5.0 else of_it))
    summary = flown(tmp_path / "clock.mcap", messages=(*messages, (9.0, StopNow())))
    assert summary.loop is not None
    assert summary.loop.clocks[0].corrected_s == pytest.approx(0.3, abs=0.02)
    bias = report_of(tmp_path / "clock.mcap", capsys)["bias"]
    assert bias["observations"] > 50
    assert bias["along_s"] == pytest.approx(BIAS.along_s, abs=0.02)
    assert run(["report", str(tmp_path / "clock.mcap"), "--tdm", str(tmp_path / "seen.tdm")]) == 0
    first = read_observations(tmp_path / "seen.tdm", Stations({}, demo_pass.SITE.place()))[0]
    assert float(first.utc.unix_s) == pytest.approx(CULMINATION_S - 5.0, abs=0.02)


def test_places_of_date_have_air_in_them_only_where_the_run_feeds_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    seen = Propagator(demo_pass.elements(), demo_pass.SITE.place())
    messages = list[tuple[float, Message]]()
    for at in range(-12, 8, 4):
        true = seen.at(Utc(CULMINATION_S + at), BIAS)
        utc = Utc(CULMINATION_S + at).isoformat("microseconds")
        messages.append(
            (at, ObservationMessage(utc, float(true.ra_deg), float(true.dec_deg), "of_date", 1.0))
        )
    flown(tmp_path / "air.mcap", messages=tuple(messages), min_alt_deg=75.0, does_refraction=True)
    bias = report_of(tmp_path / "air.mcap", capsys)["bias"]
    assert bias["along_s"] == pytest.approx(BIAS.along_s, abs=1e-4)
    assert bias["cross_deg"] == pytest.approx(BIAS.cross_deg, abs=1e-4)


def test_a_sample_after_a_silence_counts_as_little_as_in_the_run(
    short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, recording = tmp_path / "silent.mcap", Recording(short)
    with path.open("wb") as stream:
        recorder = Recorder(stream, recording.header.spec)
        silent_s = CULMINATION_S + 4.0
        for entry in recording.entries():
            if entry.topic != STATUS or not silent_s < entry.utc_s < silent_s + 0.7:
                recorder.write(*entry)
        recorder.close()
    counted = replay(Recording(path), engine_of).replayed
    told = report_of(path, capsys)
    assert (told["samples"], told["error"]["rms_arcsec"]) == (
        counted.samples,
        pytest.approx(counted.rms_arcsec, rel=1e-9),
    )


def test_a_jump_of_a_bias_is_no_ripple_of_a_motor(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A servo this slow errs by arcseconds during the jump."""
    slow = {"bandwidth_hz": 3.0, "damping": 0.7, "integral_hz": 0.5}
    jump = ((-25.0, Nudge(along_s=60.0)),)
    summary = flown(tmp_path / "jump.mcap", messages=jump, min_alt_deg=58.0, servo=slow)
    assert summary.reported_peak_arcsec is not None
    assert summary.reported_peak_arcsec > 5.0
    told = report_of(tmp_path / "jump.mcap", capsys)
    assert told["times"]["following_s"] - told["times"]["fitted_s"] > 20.0
    assert [*told["ra"]["lines"], *told["dec"]["lines"]] == []
    assert told["ra"]["gain"] == pytest.approx(1.0005, abs=5e-5)
    assert told["ra"]["delay_s"] == pytest.approx(0.027, abs=0.003)
    assert told["advice"] == []


def waits_s(path: Path, delay_s: float) -> float:
    """Return how long a command waits in the mean until the mount looks for it.

    It does so whenever it sends a status, which takes 2 ms: when that is, the recording's instants tell.
    """
    entries = list(Recording(path).entries())
    sent, heard = (np.array([e.utc_s for e in entries if e.topic == topic]) for topic in (COMMAND, STATUS))
    came, turns = sent[340:-100] + delay_s, heard - 0.002
    return float(np.mean(turns[np.searchsorted(turns, came)] - came))


def test_a_delay_that_the_profile_does_not_have_is_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Commands take 42 ms and not 2."""
    flown(tmp_path / "late.mcap", min_alt_deg=71.0, command_delay_s=0.042)
    told = report_of(tmp_path / "late.mcap", capsys)
    acts_s = 0.042 + waits_s(tmp_path / "late.mcap", 0.042)
    assert 0.042 < acts_s < 0.092
    for axis in ("ra", "dec"):
        assert told[axis]["delay_s"] == pytest.approx(acts_s, abs=0.002)
        assert told[axis]["delay_sigma_s"] < 0.002
    assert told["advice"] == [
        f"commands in {axis} act {1000.0 * told[key]['delay_s']:.0f} ms after their tick, 27 ms are "
        "expected: the mount is simulated: this machine was busy, or its delays were set otherwise"
        for key, axis in (("ra", "right ascension"), ("dec", "declination"))
    ]


def test_a_command_that_acts_before_it_is_sent_tells_of_wrong_dates(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Statuses take 2 ms, and the profile says 70: by that they are dated 68 ms too early."""
    flown(tmp_path / "dated.mcap", min_alt_deg=71.0, says={"status_delay_s": 0.07}, status_delay_s=0.002)
    told = report_of(tmp_path / "dated.mcap", capsys)
    waited_s = waits_s(tmp_path / "dated.mcap", 0.002)
    assert told["ra"]["delay_s"] == pytest.approx(0.002 + waited_s - 0.068, abs=0.003)
    assert -0.05 < told["ra"]["delay_s"] < -0.015
    assert len(told["advice"]) == 2
    for key, axis, words in zip(
        ("ra", "dec"), ("right ascension", "declination"), told["advice"], strict=True
    ):
        ahead = f"{-1000.0 * told[key]['delay_s']:.0f}"
        assert re.match(f"commands in {axis} seem to act {ahead} ms before they are sent: the profile", words)


def test_a_motors_ripple_is_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # Of the profile's own servo the run's filter takes the ripple out; of a softer one enough of it is left.
    flown(tmp_path / "ripple.mcap", min_alt_deg=53.0, servo={"ripple_a": 3.0, "bandwidth_hz": 6.0})
    told = report_of(tmp_path / "ripple.mcap", capsys)
    assert told["ra"]["lines"][0]["cycles_a_turn"] == pytest.approx(96.0, abs=2.0)
    assert told["ra"]["lines"][0]["amplitude_arcsec"] == pytest.approx(0.37, abs=0.13)
    assert re.match(r"the hour angle axis errs by 0\.\d+″ 9[5-7] times a turn", told["advice"][0])


def test_of_a_short_pass_it_is_told_what_was_not_enough(
    short: Path, observed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert any("one way" in why for why in report_of(short, capsys)["dec"]["untold"])
    assert run(["report", str(observed)]) == 0
    assert "declination axis        not enough to tell what repeats" in capsys.readouterr().out


def test_an_error_that_jolts_or_wanders_is_no_line() -> None:
    rng = np.random.default_rng(5)
    angle = np.linspace(10.0, 130.0, 4000)
    noise = rng.normal(0.0, 0.05, len(angle))
    ripple = 0.5 * np.sin(np.radians(angle * 96.0))
    found = repeats(angle, noise + ripple)
    assert isinstance(found, list)
    assert [round(line.cycles_a_turn) for line in found] == [96]
    struck = noise + ripple * np.exp(-(((angle - 60.0) / 10.0) ** 2))
    assert lines(*spectrum(angle, struck)), "the spectrum alone takes it for a line"
    assert repeats(angle, struck) == []
    wander = np.cumsum(rng.normal(0.0, 0.05, len(angle)))
    assert repeats(angle, noise + wander) == []


def test_a_gap_in_the_angle_neither_hides_a_ripple_nor_makes_one() -> None:
    rng = np.random.default_rng(6)
    angle = np.linspace(10.0, 130.0, 4000)
    error = rng.normal(0.0, 0.05, len(angle)) + 0.4 * np.sin(np.radians(angle * 96.0))
    kept = (angle < 50.0) | (angle > 85.0)
    found = repeats(angle[kept], error[kept])
    assert isinstance(found, list)
    (line,) = found
    assert line.cycles_a_turn == pytest.approx(96.0, abs=2.0)
    assert line.amplitude_arcsec == pytest.approx(0.4, rel=0.2)


def test_a_part_of_a_turn_that_is_too_small_is_said() -> None:
    angle = np.linspace(10.0, 25.0, 400)
    found = repeats(angle, np.sin(angle))
    assert isinstance(found, NoFit)
    assert "15.0° one way in 400 samples; that takes 20°" in found.why
    there_and_back = np.concatenate([np.linspace(50.0, 65.0, 200), np.linspace(65.0, 20.0, 300)])
    assert one_way(there_and_back) == slice(199, 500)
