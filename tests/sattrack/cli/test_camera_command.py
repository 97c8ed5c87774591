"""`sattrack camera` and `track --camera`, as a user types them, with frames of closed forms."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from camera_frames import Canvas, star_streaks

from sattrack.camera.centring import ImageGeometry, Solution, centred
from sattrack.camera.detection import Detection
from sattrack.camera.frames import CameraFrame
from sattrack.cli.camera import ObservationLink
from sattrack.cli.main import run
from tle.instants import Utc

fits = pytest.importorskip("astropy.io.fits")
pytest.importorskip("sep", reason="cameras need the extra camera")
EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
FIELDS = {"utc", "exposure_s", "kind", "dx_arcsec", "dy_arcsec", "sigma_arcsec", "snr", "solved"}


@pytest.fixture(autouse=True)
def no_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """See no run: what is seen would be sent to that of a test beside this one."""
    monkeypatch.setattr("sattrack.runtime.view_server.feeders", list)


def write_frames(folder: Path, places: list[tuple[float, float] | None]) -> None:
    rng = np.random.default_rng(4)
    for number, place in enumerate(places):
        canvas = Canvas(400, 300, 1.3)
        star_streaks(canvas, rng, 12, 50.0, 30.0)
        if place is not None:
            canvas.point(*place, canvas.flux_of(40.0))
        part = fits.PrimaryHDU(canvas.exposed(rng))
        part.header["DATE-OBS"] = f"2026-10-02T13:05:{24 + number:02d}.4"
        part.header["EXPTIME"] = 0.2
        part.writeto(folder / f"frame_{number}.fits")


def ran(
    capsys: pytest.CaptureFixture[str], *arguments: str, code: int = 0
) -> tuple[list[dict[str, Any]], str]:
    assert run([*arguments]) == code
    out, err = capsys.readouterr()
    assert "Traceback" not in err
    return [json.loads(line) for line in out.splitlines()] if "--json" in arguments else [], err


def test_each_frame_is_a_line_with_the_offset_from_the_middle(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_frames(tmp_path, [(249.5, 149.5), None, (199.5, 99.5)])
    first, empty, third = ran(
        capsys,
        "camera",
        f"folder:{tmp_path}",
        "--scale",
        "2",
        "--json",
        "--no-solve",
        "--save",
        str(tmp_path / "kept"),
    )[0]
    assert set(first) >= FIELDS
    assert (first["kind"], empty["kind"], third["kind"]) == ("point", "none", "point")
    assert first["utc"].startswith("2026-10-02T13:05:24.5")
    # Middle at (199.5, 149.5): 50 pixels to the right, and 50 down.
    assert (first["dx_arcsec"], first["dy_arcsec"]) == pytest.approx((100.0, 0.0), abs=0.5)
    assert (third["dx_arcsec"], third["dy_arcsec"]) == pytest.approx((0.0, -100.0), abs=0.5)
    assert all(empty[name] is None for name in ("dx_arcsec", "dy_arcsec", "sigma_arcsec", "snr", "solved"))
    assert empty["why"]
    assert len(list((tmp_path / "kept").glob("*.fits"))) == 3
    again = ran(capsys, "camera", f"folder:{tmp_path / 'kept'}", "--json", "--no-solve")[0]
    assert [one["dx_arcsec"] for one in again] == [one["dx_arcsec"] for one in (first, empty, third)]


def test_that_fields_are_not_solved_without_a_scale_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_frames(tmp_path, [(249.5, 149.5), None])
    lines, err = ran(capsys, "camera", f"folder:{tmp_path}", "--json")
    assert [line["solved"] for line in lines] == [None, None]
    assert err.count("no scale is known; give --scale") == 1
    assert "scale" not in ran(capsys, "camera", f"folder:{tmp_path}", "--json", "--no-solve")[1]


@pytest.mark.parametrize(("date", "times"), [("2026-10-02T13:05:24", 1), ("2026-10-02T13:05:24.000", 0)])
def test_that_dates_are_of_whole_seconds_is_said_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], date: str, times: int
) -> None:
    write_frames(tmp_path, [(249.5, 149.5), None])
    for path in tmp_path.iterdir():
        fits.setval(path, "DATE-OBS", value=date)
    assert ran(capsys, "camera", f"folder:{tmp_path}", "--json")[1].count("dated to whole seconds") == times


def test_an_index_of_stars_that_cannot_be_made_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("tetra3rs", reason="solving needs the extra camera")
    write_frames(tmp_path, [(249.5, 149.5)])
    (tmp_path / "cache").write_text("no folder")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    failed = SimpleNamespace(wait=lambda: 1, poll=lambda: 1, returncode=1)
    monkeypatch.setattr("sattrack.camera.star_index.start_making", lambda *_: failed)
    monkeypatch.setattr("sattrack.camera.centring.FEWEST_STARS", 1)
    err = ran(capsys, "camera", f"folder:{tmp_path}", "--scale", "300", "--json")[1]
    assert "cannot be made: is its disk full or read-only?" in err


def test_that_a_field_is_not_found_by_its_scale_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_frames(tmp_path, [(249.5, 149.5), None])
    unsolved = SimpleNamespace(solve=lambda *_: None)
    monkeypatch.setattr("sattrack.cli.camera.Looker._made_solver", lambda *_: unsolved)
    monkeypatch.setattr("sattrack.camera.centring.FEWEST_STARS", 1)
    lines, err = ran(capsys, "camera", f"folder:{tmp_path}", "--scale", "5", "--json")
    assert [line["solved"] for line in lines] == [None, None]
    assert err.count("the scale, 5″ a pixel, must be right within 30 %") == 1


@pytest.mark.parametrize(
    ("mount", "late_s", "apart"),
    [
        ((10.0, 25.0), 0.1, "5.0°"),
        # Within the field's width, and a direction of a mount that may have slewed since.
        ((10.0, 23.0), 0.1, None),
        ((10.0, 25.0), 2.0, None),
        ((None, None), 0.1, None),
    ],
)
def test_a_field_far_from_where_the_mount_points_is_reported(
    mount: tuple[float | None, float | None], late_s: float, apart: str | None
) -> None:
    utc = Utc.parse("2026-10-02T13:05:24.5Z")
    frame = CameraFrame(np.zeros((960, 1280), dtype=np.float32), utc, 0.1, "f")
    solution = Solution(10.0, 20.0, 0.0, False, 10.0, 1.0, 9, lambda *_: (10.0, 20.0))
    seen = centred(frame, Detection("none"), ImageGeometry(), solution, "guide")
    link = object.__new__(ObservationLink)
    view = SimpleNamespace(utc_s=float(utc.unix_s) + late_s, mount_ra_deg=mount[0], mount_dec_deg=mount[1])
    link._views = [view]
    words = link.elsewhere(frame, seen)
    assert words is None if apart is None else words is not None and f"a field {apart} from where" in words


def test_frames_that_cannot_be_kept_end_no_camera_of_a_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_frames(tmp_path, [(249.5, 149.5), (249.5, 149.5)])
    (tmp_path / "no folder").write_text("")
    lines = ("camera", f"folder:{tmp_path}", "--scale", "2", "--json", "--no-solve", "--save")
    assert "cannot be written" in ran(capsys, *lines, str(tmp_path / "no folder" / "a"), code=1)[1]
    sent: list[Any] = []
    active = SimpleNamespace(
        hear=lambda: None,
        expected=lambda *_: None,
        field_angle_deg=lambda _: 0.0,
        elsewhere=lambda *_: None,
        send=lambda one: sent.append(one) or True,
        show=lambda *_: None,
        close=lambda: None,
    )
    monkeypatch.setattr("sattrack.cli.camera._run", lambda _: active)
    seen, err = ran(capsys, *lines, str(tmp_path / "no folder" / "a"))
    assert (len(seen), len(sent), err.count("no more frames are kept")) == (2, 2, 1)
    assert "the frames are read there" in ran(capsys, *lines, str(tmp_path), code=2)[1]


def test_the_settings_of_a_camera_are_those_of_its_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_frames(tmp_path, [(249.5, 149.5)])
    settings = tmp_path / "sattrack.toml"
    settings.write_text("[camera]\nscale_arcsec_px = 9\n[cameras.guide]\nscale_arcsec_px = 4\n")
    lines = ("camera", f"folder:{tmp_path}", "--json", "--config", str(settings))
    assert ran(capsys, *lines, "--name", "guide")[0][0]["dx_arcsec"] == pytest.approx(200.0, abs=1.0)
    assert ran(capsys, *lines)[0][0]["dx_arcsec"] == pytest.approx(450.0, abs=2.0)
    # A run calls its cameras so that were given no name.
    for name in ("camera", "camera-2"):
        assert ran(capsys, *lines, "--name", name)[0][0]["dx_arcsec"] == pytest.approx(450.0, abs=2.0)
    assert "the settings have guide" in ran(capsys, *lines, "--name", "gide", code=2)[1]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("folder:/nowhere/at/all",), "no such folder"),
        (("webcam",), "folder:DIR"),
        (("folder:.", "--scale", "0"), "--scale"),
        (("folder:.", "--exposure", "long"), "--exposure long"),
        (("folder:.", "--exposure", "-1"), "--exposure -1"),
        (("folder:.", "--rotation", "400"), "--rotation 400: give degrees, -360 to 360"),
        (("folder:.", "--rotation", "nan"), "--rotation nan: give degrees, -360 to 360"),
    ],
)
def test_what_cannot_be_is_one_line(
    arguments: tuple[str, ...], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    err = ran(capsys, "camera", *arguments, code=2)[1]
    assert words in err


def test_a_folder_without_a_frame_that_can_be_used_names_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.fits").write_bytes(b"nothing")
    err = ran(capsys, "camera", f"folder:{tmp_path}", code=2)[1]
    assert "a.fits" in err
    assert "no frame that can be used" in err


@pytest.mark.parametrize("others", [(), ("a.fits.gz", "b.jpg", "c.jpg")])
def test_a_folder_without_a_file_that_is_read_says_which_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], others: tuple[str, ...]
) -> None:
    (tmp_path / "older.fits.d").mkdir()
    for name in others:
        (tmp_path / name).write_bytes(b"something")
    err = ran(capsys, "camera", f"folder:{tmp_path}", code=2)[1]
    words = "no file there ends in .fit, .fits, .fts or .png; others are not read, nor packed ones"
    assert f"{tmp_path}: {words} (other files: {len(others)})" in err


def test_a_missing_extra_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "sep", None)
    practice = ("track", "ISS", "--mount", "sim", "--headless", "--camera")
    for command in (("camera",), practice):
        err = ran(capsys, *command, f"folder:{tmp_path}", code=1)[1]
        assert "run `pip install '.[camera]'` in the folder of the clone" in err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--camera", "gide=folder:."), "--name gide: the settings have guide"),
        (("--camera", "folder:.", "--exposure", "long"), "--exposure long: give seconds"),
        (("--camera", "folder:.", "--scale", "0"), "--scale 0: give arcseconds in a pixel"),
    ],
)
def test_what_no_camera_of_a_run_can_be_is_told_before_the_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], words: str
) -> None:
    """A camera's process tells it at the end of the run, when the pass is over."""
    settings = tmp_path / "sattrack.toml"
    settings.write_text("[cameras.guide]\nscale_arcsec_px = 4\n")
    practice = ("track", "ISS", "--mount", "sim", "--headless", "--config", str(settings))
    assert words in ran(capsys, *practice, *arguments, code=2)[1]


@pytest.mark.parametrize(
    ("name", "more", "unknown"),
    [("guide", (), False), ("finder", (), True), ("finder", ("--rotation", "0"), False)],
)
def test_that_the_rotation_of_an_image_is_not_known_is_reported_before_the_run(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    more: tuple[str, ...],
    unknown: bool,
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "sep", None)
    settings = tmp_path / "sattrack.toml"
    settings.write_text("[cameras.guide]\nrotation_deg = 93.0\n[cameras.finder]\n")
    practice = ("track", "ISS", "--mount", "sim", "--headless", "--config", str(settings))
    err = ran(capsys, *practice, "--camera", f"{name}=folder:{tmp_path}", *more, code=1)[1]
    assert (f"camera {name}: its rotation is not known" in err) is unknown


def test_frames_are_looked_at_by_one_thread(tmp_path: Path) -> None:
    """Others of numpy's would wait for work, busy, on the cores of the run and of its simulated mount."""
    write_frames(tmp_path, [None])
    code = """
import sys
from threadpoolctl import threadpool_info
from sattrack.camera.detection import Detection, Detector
from sattrack.cli.main import run
threads = lambda: max(one["num_threads"] for one in threadpool_info())
before = threads()
def look(*of):
    print("threads", before, threads())
    return Detection("none", why="")
Detector.look = look
sys.exit(run(sys.argv[1:]))
"""
    done = subprocess.run(
        [sys.executable, "-c", code, "camera", f"folder:{tmp_path}", "--alone", "--no-solve"],
        env={**os.environ, "OPENBLAS_NUM_THREADS": "2"},
        capture_output=True,
        text=True,
        check=True,
    )
    told = [line.split()[1:] for line in done.stdout.splitlines() if line.startswith("threads")]
    assert [after for _, after in told] == ["1"], done.stdout
    assert os.cpu_count() == 1 or told[0][0] != "1"


def test_in_virtual_time_offsets_of_another_mount_are_not_used(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_frames(tmp_path, [(249.5, 149.5), None])
    high = ("--min-alt", "75", "--clock", "2026-10-02T13:05:15Z", "--bias-memory", "off")
    practice = ("track", "ISS", "--mount", "sim", "--virtual", "--json", *high)
    summary = ran(capsys, *practice, "--camera", f"guide=folder:{tmp_path}", "--scale", "2")
    assert "1 frame was not solved" in summary[1]
    camera = summary[0][-1]["summary"]["camera"]
    assert camera == {
        "frames": 2,
        "detected": 1,
        "used": 0,
        "rejected": 0,
        "first_utc": "2026-10-02T13:05:24.500000Z",
    }
    err = ran(capsys, *practice, "--camera", "v4l:/dev/video0", code=2)[1]
    assert "in virtual time frames come from a folder" in err
