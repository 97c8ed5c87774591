"""What a report says is what was put into the recording: gains, delays, ripple, biases."""

from __future__ import annotations

import base64
import json
import math
import random
import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from sattrack import practice
from sattrack.cli import run
from sattrack.recording.mount_fit import lines, spectrum
from sattrack.recording.smoothing import Said, fit_biases, smooth_track
from tle.bias import Bias
from tle.instants import Utc
from tle.observations import Stations, read_observations
from tle.propagator import Propagator
from tle.residuals import bias_from_observation

if TYPE_CHECKING:
    from sattrack.recording.smoothing import BiasFit

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
BIAS = Bias(1.4, 0.012)
CULMINATION_S = 1790946324.0
SIGMA_ARCSEC = 20.0


def solution(utc_s: float, rng: random.Random, bias: Bias = BIAS, sigma_arcsec: float = SIGMA_ARCSEC) -> dict:
    """Return a camera's plate solution of a satellite that is off its elements by a bias, noise drawn."""
    seen = Propagator(practice.elements(), practice.SITE.place()).with_place("astrometric")
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
        options = ["--min-alt", "45", "--observations", "stdin", "--record", str(path)]
        profile = ["--profile", str(EXAMPLES / "profiles" / "realistic.toml")]
        code = run(["track", "25544", "--virtual", "--mount", "sim", "--json", *profile, *options])
    assert code == 0
    return path


def report_of(path: Path, capsys: pytest.CaptureFixture[str]) -> dict:
    capsys.readouterr()
    assert run(["report", str(path), "--json"]) == 0
    told: dict = json.loads(capsys.readouterr().out)
    return told


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
    assert any(re.search(r"--bias-along 1\.[34]\d? --bias-cross 0\.01", words) for words in advice)


def test_without_observations_a_nudge_is_told_as_one_and_nothing_as_nothing(
    short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert report_of(short, capsys)["bias"] is None
    assert run(["report", str(short)]) == 0
    assert "a mount that follows tells nothing of the satellite" in capsys.readouterr().out
    nudged = nudge(tmp_path / "nudged.mcap", short)
    bias = report_of(nudged, capsys)["bias"]
    assert bias["source"] == "nudge"
    assert bias["along_s"] == pytest.approx(0.25)
    assert bias["along_sigma_s"] is None
    assert run(["report", str(nudged)]) == 0
    assert "the operator's last word" in capsys.readouterr().out


def nudge(path: Path, short: Path) -> Path:
    from sattrack.recording.format import OPERATOR
    from sattrack.recording.reading import Recording
    from sattrack.recording.recorder import Recorder

    recording = Recording(short)
    with path.open("wb") as stream:
        recorder = Recorder(stream, recording.header.spec)
        for number, entry in enumerate(recording.entries()):
            recorder.write(*entry)
            if number == 300:
                recorder.write(OPERATOR, entry.utc_s, b'{"type":"nudge","along_s":0.25}')
        recorder.close()
    return path


def test_html_holds_its_plots_and_nothing_from_elsewhere(
    observed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, folder, tdm = tmp_path / "report.html", tmp_path / "plots", tmp_path / "seen.tdm"
    options = ["--html", str(out), "--png", str(folder), "--tdm", str(tdm)]
    assert run(["report", str(observed), *options]) == 0
    text = out.read_text()
    pictures = re.findall(r'src="([^"]*)"', text)
    assert len(pictures) == 7
    for picture in pictures:
        kind, _, data = picture.partition(",")
        assert kind == "data:image/png;base64"
        assert base64.b64decode(data).startswith(b"\x89PNG")
    assert "http" not in re.sub(r'src="[^"]*"', "", text)
    assert len(list(folder.iterdir())) == 7
    assert len(read_observations(tdm, Stations({}, practice.SITE.place()))) == 15
    assert run(["report", str(observed), "--html", str(out)]) == 2
    assert "exists already" in capsys.readouterr().err


def test_several_files_show_their_trend_in_order_of_time(
    observed: Path, short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "trend.html"
    capsys.readouterr()
    assert run(["report", str(short), str(observed), "--html", str(out)]) == 0
    table = capsys.readouterr().out.splitlines()[-3:]
    assert table[0].startswith("began")
    assert table[1].split()[0] < table[2].split()[0]
    assert "<h2>Trend</h2>" in out.read_text()
    assert run(["report", str(short), str(observed), "--tdm", str(tmp_path / "x.tdm")]) == 2


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
    elements = Propagator(practice.elements(), practice.SITE.place())
    said = []
    for _ in range(count):
        utc_s = CULMINATION_S + rng.uniform(-150.0, 150.0)
        seen = solution(utc_s, rng, Bias(along, 0.0))
        found = bias_from_observation(
            elements, seen["ra_deg"], seen["dec_deg"], Utc.parse(seen["utc"]), "icrf", SIGMA_ARCSEC
        )
        range_km = float(elements.at(Utc(utc_s + found.along_s)).range_km)
        said.append(
            Said(
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


def test_outliers_are_left_out_and_more_scatter_than_claimed_grows_the_sigma() -> None:
    rng = random.Random(1)
    said = [Said(10.0 * i, 1.0 + rng.gauss(0.0, 0.03), 0.2, 0.01, 0.05) for i in range(30)]
    fit = fit_biases([*said, Said(15.0, 30.0, 0.2, 0.01, 0.05)])
    assert fit is not None
    assert (fit.taken, fit.rejected) == (30, 1)
    assert fit.along.value == pytest.approx(1.0, abs=0.03)
    assert fit.along.sigma > 0.003
    assert fit_biases([]) is None
