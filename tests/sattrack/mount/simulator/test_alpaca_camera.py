"""`sattrack sim --camera` as users of alpyca and of FITS files meet it."""

from __future__ import annotations

import json
import re
import subprocess
import time
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from programs import ended, sattrack

from sattrack.cli.main import run
from sattrack.mount.simulator.alpaca_server import CameraConfig, make_camera
from sattrack.mount.simulator.hidden import GRAMMAR, Hidden, SimulatedCamera, parse_hidden
from sattrack.mount.simulator.mount import SimulatedSite
from sattrack.runtime import demo_pass
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Iterator

alpaca = pytest.importorskip("alpaca.camera")
management = pytest.importorskip("alpaca.management")
Telescope = pytest.importorskip("alpaca.telescope").Telescope
WITHIN_S = 60.0
PAGE = Path(__file__).parents[4] / "docs" / "camera-sim.md"


@contextmanager
def simulated_camera(*options: str) -> Iterator[Any]:
    """A camera beside a simulated mount, by alpyca."""
    command = ("sim", "--camera", "2.5,400,300", "--port", "0", "--json", "--clock", "2026-10-02T13:03:00Z")
    quiet = {"stdin": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with ended(sattrack(*command, *options, **quiet)) as process:
        assert process.stdout is not None
        url = json.loads(process.stdout.readline())["camera"]
        camera = alpaca.Camera(url.split("/")[2], int(url.split("/")[3]))
        camera.Connected = True
        yield camera


def expose(camera: Any, seconds: float) -> np.ndarray[Any, Any]:
    """The image array of an exposure, [x][y]."""
    camera.StartExposure(seconds, True)
    until_s = time.monotonic() + WITHIN_S
    while not camera.ImageReady:
        assert time.monotonic() < until_s
        time.sleep(0.01)
    return np.array(camera.ImageArray)


def test_alpyca_exposes_and_gets_the_picture_with_its_dates(tmp_path: Path) -> None:
    with simulated_camera("--hidden", "clock=100,hot=0", "--frames", str(tmp_path)) as camera:
        assert (camera.CameraXSize, camera.CameraYSize, camera.MaxADU) == (400, 300, 65535)
        with pytest.raises(alpaca.NotImplementedException):
            _ = camera.CCDTemperature
        assert not camera.CanSetCCDTemperature
        with pytest.raises(alpaca.InvalidOperationException):
            _ = camera.ImageArray
        image = expose(camera, 0.2)
        assert image.shape == (400, 300)
        assert camera.ImageArrayInfo.TransmissionElementType == 8
        assert 490.0 < image.mean() < 520.0
        assert camera.LastExposureDuration == 0.2
        # The camera's clock is 100 s ahead of the sky's.
        start = datetime.fromisoformat(camera.LastExposureStartTime).replace(tzinfo=UTC)
        since_s = (start - datetime(2026, 10, 2, 13, 3, tzinfo=UTC)).total_seconds()
        assert 100.0 < since_s < 100.0 + WITHIN_S
        camera.BinX = camera.BinY = 2
        camera.StartX, camera.StartY, camera.NumX, camera.NumY = 10, 20, 100, 50
        assert expose(camera, 0.05).shape == (100, 50)
        camera.NumX = 300
        with pytest.raises(alpaca.InvalidValueException):
            camera.StartExposure(0.1, True)
        camera.NumX = 100
        camera.StartExposure(100.0, True)
        assert camera.CameraState == alpaca.CameraStates.cameraExposing
        camera.AbortExposure()
        assert camera.CameraState == alpaca.CameraStates.cameraIdle
        camera.StartExposure(100.0, True)
        camera.StopExposure()
        until_s = time.monotonic() + WITHIN_S
        while not camera.ImageReady:
            assert time.monotonic() < until_s
        assert camera.LastExposureDuration < 50.0
        until_s = time.monotonic() + WITHIN_S
        while not (files := sorted(tmp_path.glob("frame_*.fits"))):
            assert time.monotonic() < until_s
            time.sleep(0.05)
    fits = pytest.importorskip("astropy.io.fits")
    with fits.open(files[0]) as opened:
        header, data = opened[0].header, opened[0].data
        assert data.shape == (300, 400)
        assert header["EXPTIME"] == 0.1
        assert header["DATE-OBS"].startswith("2026-10-02T13:04:")


def test_a_telescope_and_its_camera_share_a_server() -> None:
    quiet = {"stdin": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    options = ("--camera", "2.5,400,300", "--port", "0", "--json")
    with ended(sattrack("sim", "--alpaca", *options, **quiet)) as process:
        assert process.stdout is not None
        first = json.loads(process.stdout.readline())
        address = first["camera"].split("/")[2]
        devices = management.configureddevices(address)
        assert {device["DeviceType"] for device in devices} == {"Telescope", "Camera"}
        camera = alpaca.Camera(address, 0)
        camera.Connected = True
        assert expose(camera, 0.05).shape == (400, 300)
        with pytest.raises(alpaca.NotConnectedException):
            _ = Telescope(address, 0).RightAscension


def test_json_and_bytes_have_the_columns_first_and_the_top_left_first() -> None:
    from sattrack.mount.simulator.alpaca_camera import RunningExposure, SimulatedAlpacaCamera
    from sattrack.mount.simulator.camera import RenderedFrame

    pixels = np.arange(12, dtype=np.uint16).reshape(3, 4)
    exposure = RunningExposure(0.0, 1.0, 0, 1, 0, 0, 4, 3)
    image = exposure.cut(RenderedFrame(pixels, 0.0, 1.0, 0))
    # Row 0 is the top one; ImageArray[x][y]: x to the right, y down.
    assert image.tolist() == [[0, 4, 8], [1, 5, 9], [2, 6, 10], [3, 7, 11]]
    device = SimulatedAlpacaCamera(camera=None)  # type: ignore[arg-type]
    device.image = image
    sent = device.image_bytes(7, 9)
    head = (
        "01000000 00000000 07000000 09000000 2c000000 02000000 08000000 02000000 04000000 03000000 00000000"
    )
    assert sent[:44] == bytes.fromhex(head.replace(" ", ""))
    assert sent[44:52] == bytes.fromhex("0000040008000100")


def test_the_help_shows_every_key_and_every_example_is_one(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["sim", "--help"]) == 0
    shown = "".join(capsys.readouterr().out.split())
    for example, meaning in GRAMMAR:
        assert "".join(f"{example}{meaning}".split()) in shown
        assert parse_hidden(example) != Hidden() or example.split("=")[0] in (
            "magnitude", "fwhm", "sky", "zero_point", "read_noise", "full_well", "bias", "hot"
        )  # fmt: skip
    assert {example.split("=")[0] for example, _ in GRAMMAR} == set(Hidden.__struct_fields__)


def test_the_page_has_every_key() -> None:
    page = PAGE.read_text(encoding="utf-8")
    for example, meaning in GRAMMAR:
        assert f"| `{example}` | {meaning} |" in page


def test_a_camera_takes_any_seed_that_its_mount_takes() -> None:
    where = SimulatedSite(52.15, 4.49)
    config = CameraConfig(where, "[]", SimulatedCamera(2.5, 64, 48), Hidden(faint=1.0), 1.79e9, seed=-3)
    assert make_camera(config).camera.seed == 3


def test_a_camera_on_axes_with_a_geometry_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It would show the sky of an equatorial mount, and a star run would measure that."""
    profile = tmp_path / "altaz.toml"
    profile.write_text(
        "additive = false\n[stands_at]\nlatitude_deg = 52.15\nlongitude_deg = 4.49\n"
        "[geometry]\npole_azimuth_deg = 0.0\npole_altitude_deg = 90.0\n"
    )
    assert run(["sim", "--port", "0", "--camera", "--profile", str(profile)]) == 2
    assert "altaz.toml has a [geometry]" in capsys.readouterr().err


def test_the_example_of_the_page_takes_pictures() -> None:
    (example,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    begin_s = Utc.parse(demo_pass.BEFORE_PASS).unix_s
    names = {"site": demo_pass.SITE.place(), "elements": demo_pass.elements()}
    named = names | {"begin_utc_s": begin_s, "start_utc_s": begin_s}
    exec(example.replace("TruePath()", "TruePath()\npath.add(begin_utc_s, 0.0, 40.0, 0.0, 0.0)"), named)
    assert named["frame"].pixels.shape == (960, 1280)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--hidden", "along=1"], "needs --camera"),
        (["--alpaca", "--satellite", "ISS"], "needs --camera"),
        (["--alpaca", "--camera", "--hidden", "split=5"], "split"),
        (["--camera", "--hidden", "alogn=1"], "alogn"),
        (["--camera", "2.5,10"], "SCALE,WIDTH,HEIGHT"),
        (["--camera", "--frames", "/nowhere"], "/nowhere"),
        (["--camera", "--hidden", "/nowhere.toml"], "/nowhere.toml"),
        (["--camera", "--every", "0"], "--every"),
        (["--camera", "--camera-port", "70000"], "70000"),
    ],
)
def test_bad_options_get_one_line(options: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["sim", "--port", "0", *options]) == 2
    message = capsys.readouterr().err
    assert words in message
    assert message.count("\n") == 1
