"""Frames from folders, Alpaca, INDI and video: bytes as the standards have them, written out by hand."""

from __future__ import annotations

import base64
import gzip
import io
import json
import math
import os
import re
import socket
import struct
import sys
import threading
import time
import tracemalloc
import warnings
import zlib
from types import SimpleNamespace
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import pytest
from camera_frames import Canvas

from sattrack.camera import files, sources
from sattrack.camera.centring import ImageGeometry
from sattrack.camera.detection import Detection, Detector, ExpectedMotion, light_wanted
from sattrack.camera.files import save_frame
from sattrack.camera.frames import CameraFrame, full_scale, reduced
from sattrack.camera.sources import SourceOptions, decode_image, open_source
from sattrack.core.clock import SimulatedClock
from sattrack.core.errors import BadInputError, SattrackError
from sattrack.mount.alpaca.client import AlpacaRefusalError, NoAnswerError
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

MIDDLE = Utc.parse("2026-10-02T13:05:24.5Z")
# Two columns of three rows: the element at [column][row].
COLUMNS = [[1, 2, 3], [4, 5, 6]]
ROWS = [[1, 4], [2, 5], [3, 6]]


def metadata(
    element: int, *, version: int = 1, error: int = 0, rank: int = 2, width: int = 2, height: int = 3
) -> bytes:
    return struct.pack("<iiIIiiiiiii", version, error, 7, 9, 44, 2, element, rank, width, height, 0)


@pytest.mark.parametrize(
    ("element", "form"), [(1, "<6h"), (2, "<6i"), (3, "<6d"), (4, "<6f"), (6, "6B"), (8, "<6H"), (9, "<6I")]
)
def test_image_bytes_have_columns_first(element: int, form: str) -> None:
    body = metadata(element) + struct.pack(form, 1, 2, 3, 4, 5, 6)
    assert decode_image("application/imagebytes", body).tolist() == ROWS


def test_an_image_as_json_has_columns_first() -> None:
    body = json.dumps({"Type": 2, "Rank": 2, "Value": COLUMNS, "ErrorNumber": 0}).encode()
    assert decode_image("application/json", body).tolist() == ROWS


@pytest.mark.parametrize(
    "body",
    [
        b"",
        metadata(8)[:20],
        metadata(8) + b"\x01\x00",
        metadata(99) + b"\x00" * 100,
        metadata(8, version=3) + b"\x00" * 100,
        metadata(8, rank=7) + b"\x00" * 100,
        metadata(8, width=-2) + b"\x00" * 100,
        metadata(8, width=1 << 30, height=1 << 30) + b"\x00" * 100,
    ],
)
def test_a_broken_image_is_refused(body: bytes) -> None:
    with pytest.raises(NoAnswerError):
        decode_image("application/imagebytes", body)


def test_an_error_in_image_bytes_is_the_cameras_own() -> None:
    with pytest.raises(AlpacaRefusalError, match="no exposure yet"):
        decode_image("application/imagebytes", metadata(0, error=0x40B) + b"no exposure yet")


def fits_bytes(pixels: np.ndarray, **header: object) -> bytes:
    fits = pytest.importorskip("astropy.io.fits")
    part = fits.PrimaryHDU(pixels)
    for key, value in header.items():
        part.header[key.replace("_", "-")] = value
    out = io.BytesIO()
    part.writeto(out)
    return out.getvalue()


def frames(text: str, options: SourceOptions) -> list[CameraFrame | SattrackError]:
    source = open_source(text, options)
    try:
        return list(source.frames())
    finally:
        source.close()


def test_a_folder_gives_its_frames_in_order_and_names_what_is_none(tmp_path: Path) -> None:
    pixels = np.arange(1200, dtype=np.uint16).reshape(30, 40)
    dated = {"DATE_OBS": "2026-10-02T13:05:24.4", "EXPTIME": 0.2}
    (tmp_path / "b.fits").write_bytes(fits_bytes(pixels, **dated, ROWORDER="TOP-DOWN"))
    (tmp_path / "a.fits").write_bytes(fits_bytes(pixels, **dated))
    (tmp_path / "c.fits").write_bytes(fits_bytes(pixels))
    (tmp_path / "d.fits").write_bytes(b"no fits at all")
    (tmp_path / "notes.txt").write_text("nothing")
    first, second, undated, broken = frames(f"folder:{tmp_path}", SourceOptions(latency_s=0.1))
    assert isinstance(first, CameraFrame)
    assert isinstance(second, CameraFrame)
    assert abs(float(first.utc - MIDDLE) + 0.1) < 1e-6
    assert first.saturation == 65535.0
    assert first.pixels.tolist() == pixels.tolist()
    assert second.pixels.tolist() == pixels[::-1].tolist()
    for error, name in ((undated, "c.fits"), (broken, "d.fits")):
        assert isinstance(error, BadInputError)
        assert name in str(error)


DATED = {"DATE_OBS": "2026-10-02T13:05:24.4", "EXPTIME": 0.2}


def image_fits() -> bytes:
    return fits_bytes(np.arange(1200, dtype=np.uint16).reshape(30, 40), **DATED)


def packed_fits() -> bytes:
    """Return a file whose image is packed in a table, as fpack and drivers of INDI write it."""
    fits = pytest.importorskip("astropy.io.fits")
    out = io.BytesIO()
    packed = fits.CompImageHDU(np.arange(1200, dtype=np.uint16).reshape(30, 40))
    fits.HDUList([fits.PrimaryHDU(), packed]).writeto(out)
    return out.getvalue()


def write_large_fits(path: Path) -> None:
    """Write a FITS file of 20 000 pixels a side that takes no room on the disk."""
    data = image_fits()
    for number, true in ((1, 40), (2, 30)):
        card = b"NAXIS%d  = %20d"
        data = data.replace(card % (number, true), card % (number, 20_000))
    path.write_bytes(data)
    os.truncate(path, 2880 * 277_800)


def claiming_png(side: int) -> bytes:
    """Return a PNG file that says it has so many pixels a side."""
    png = b"\x89PNG\r\n\x1a\n"
    head = struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    for kind, content in ((b"IHDR", head), (b"IDAT", zlib.compress(bytes(1000))), (b"IEND", b"")):
        png += struct.pack(">I", len(content)) + kind + content
        png += struct.pack(">I", zlib.crc32(kind + content))
    return png


@pytest.mark.parametrize(
    ("name", "make", "why"),
    [
        ("a.fits", write_large_fits, "400000000 pixels; 200000000 are the most"),
        ("a.png", lambda path: path.write_bytes(claiming_png(20_000)), "400000000 pixels; 200000000 are the"),
        ("a.fits", lambda path: path.write_bytes(gzip.compress(image_fits())), "unpack it first"),
        ("a.fits", lambda path: path.write_bytes(packed_fits()), "unpack it first"),
        ("a.fits", lambda path: path.write_bytes(image_fits().replace(b"NAXIS1", b"NAXISX")), "read as FITS"),
        ("a.png", lambda path: path.write_bytes(claiming_png(100)), "read as PNG"),
        ("a.fits", lambda path: path.write_bytes(b""), "it is no FITS file"),
        ("a.fits", lambda path: path.mkdir(), "it is no file, or is gone"),
        ("a.png", lambda path: path.symlink_to("nowhere"), "it is no file, or is gone"),
        ("a.fits", os.mkfifo, "it is no file, or is gone"),
    ],
    ids=[
        "large FITS",
        "large PNG",
        "packed",
        "packed image",
        "broken FITS",
        "broken PNG",
        "empty",
        "folder",
        "gone",
        "pipe",
    ],
)
def test_what_cannot_be_a_frame_is_told_in_a_line_and_the_next_is_read(
    tmp_path: Path, name: str, make: Callable[[Path], object], why: str
) -> None:
    pytest.importorskip("PIL.Image")
    (tmp_path / "b.fits").write_bytes(image_fits())
    make(tmp_path / name)
    refused, frame = frames(f"folder:{tmp_path}", SourceOptions())
    assert isinstance(refused, BadInputError)
    assert f"{tmp_path / name}: " in str(refused)
    assert why in str(refused)
    assert "\n" not in str(refused)
    assert isinstance(frame, CameraFrame)


NOISE = np.random.default_rng(6).normal(600.0, 8.0, (30, 40)).astype(np.float32)


@pytest.mark.parametrize(
    ("shape", "size"),
    [
        ((1, 1), "1 × 1"),
        ((1, 1000), "1000 × 1"),
        ((1000, 1), "1 × 1000"),
        ((5, 4, 30, 20), "20 × 30 × 4 × 5"),
    ],
)
def test_what_is_no_image_is_told_with_its_size_in_the_file(
    tmp_path: Path, shape: tuple[int, ...], size: str
) -> None:
    (tmp_path / "a.fits").write_bytes(fits_bytes(np.ones(shape, dtype=np.float32), **DATED))
    (refused,) = frames(f"folder:{tmp_path}", SourceOptions())
    assert isinstance(refused, BadInputError)
    words = f"it has {size} pixels; an image has several columns and rows, of one plane or three colours"
    assert str(refused) == f"{tmp_path / 'a.fits'}: cannot be read as an image: {words}"


@pytest.mark.filterwarnings("always")
@pytest.mark.parametrize(
    ("data", "why"),
    [
        (lambda: fits_bytes(NOISE, **DATED)[:3000], "cannot be read as FITS"),
        (lambda: fits_bytes(NOISE, **DATED)[:1500], "cannot be read as FITS"),
        (lambda: fits_bytes(NOISE * np.nan, **DATED), "none of its pixels is a number up to 1e+12"),
        (lambda: fits_bytes(NOISE * np.float32(1e30), **DATED), "none of its pixels is a number up to 1e+12"),
        (lambda: fits_bytes(NOISE * np.float64(1e300), **DATED), "none of its pixels is a number up to"),
        (lambda: fits_bytes(np.full((3, 30, 40), np.inf), **DATED), "none of its pixels is a number up to"),
    ],
    ids=["cut data", "cut header", "no numbers", "large", "larger than single precision", "infinite colours"],
)
def test_a_frame_without_pixels_is_told_without_words_of_the_libraries(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], data: Callable[[], bytes], why: str
) -> None:
    pytest.importorskip("astropy.io.fits")
    (tmp_path / "a.fits").write_bytes(data())
    with warnings.catch_warnings(record=True) as told:
        (refused,) = frames(f"folder:{tmp_path}", SourceOptions())
    assert isinstance(refused, BadInputError)
    assert why in str(refused)
    assert not told
    assert capfd.readouterr() == ("", "")


def test_pixels_that_are_no_numbers_are_left_out_of_a_frame_and_its_picture(tmp_path: Path) -> None:
    pytest.importorskip("astropy.io.fits")
    pixels = np.tile(NOISE, (4, 4))
    pixels[7, 3], pixels[9, 9], pixels[50:70, 60:100] = 1e30, np.inf, np.nan
    (tmp_path / "a.fits").write_bytes(fits_bytes(pixels, **DATED))
    with warnings.catch_warnings(action="error"):
        (frame,) = frames(f"folder:{tmp_path}", SourceOptions())
        assert isinstance(frame, CameraFrame)
        light_wanted(frame, Detection("none"))
        columns, rows, levels = reduced(frame, 40)
    bad = ~np.isfinite(frame.pixels)
    assert bad.sum() == 2 + 20 * 40
    assert frame.pixels[~bad].max() < 1000.0
    picture = np.frombuffer(levels, np.uint8).reshape(rows, columns)
    # A level of the sky where there are none, and not the brightest.
    assert picture[14, 20] < 128


def test_the_light_of_a_frame_of_which_a_few_pixels_are_numbers_is_judged_quietly() -> None:
    pixels = np.full((60, 80), np.nan, dtype=np.float32)
    pixels[5, 5] = 100.0
    with warnings.catch_warnings(action="error"):
        assert light_wanted(CameraFrame(pixels, MIDDLE, 0.05, "f", 65535.0), Detection("none")) == 2.0


@pytest.mark.parametrize("watch", [False, True])
def test_a_file_that_goes_away_before_it_is_read_ends_nothing(tmp_path: Path, watch: bool) -> None:
    for name in ("a.fits", "c.fits"):
        (tmp_path / name).write_bytes(image_fits())
    (tmp_path / "b.fits").symlink_to("nowhere")
    coming = open_source(f"folder:{tmp_path}", SourceOptions(watch=watch)).frames()
    read = [next(coming) for _ in range(2 if watch else 3)]
    names = [one.name for one in read if isinstance(one, CameraFrame)]
    assert names == ["a.fits", "c.fits"]


def test_a_file_whose_writing_pauses_is_read_once_it_is_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, file = image_fits(), tmp_path / "a.fits"
    file.write_bytes(whole[:4000])
    monkeypatch.setattr(sources, "POLL_S", 0.0)
    camera = open_source(f"folder:{tmp_path}", SourceOptions(watch=True)).frames()
    assert isinstance(next(camera), BadInputError)
    file.write_bytes(whole)
    (tmp_path / "b.fits").write_bytes(whole)
    read = next(camera)
    assert isinstance(read, CameraFrame)
    assert read.name == "a.fits"


def test_a_frame_that_does_not_fit_into_the_memory_is_told_and_the_next_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("a.fits", "b.fits"):
        (tmp_path / name).write_bytes(image_fits())
    room = iter((False, True))

    def grey(pixels: np.ndarray) -> np.ndarray:
        if not next(room):
            raise MemoryError
        return pixels

    monkeypatch.setattr(files, "grey", grey)
    refused, frame = frames(f"folder:{tmp_path}", SourceOptions())
    assert isinstance(refused, BadInputError)
    assert str(refused) == f"{tmp_path / 'a.fits'}: cannot be read as an image: MemoryError"
    assert isinstance(frame, CameraFrame)


def test_an_image_is_dated_by_the_settings_beside_it_and_has_its_top_row_first(tmp_path: Path) -> None:
    images = pytest.importorskip("PIL.Image")
    pixels = np.arange(1200, dtype=np.uint16).reshape(30, 40)
    images.fromarray(pixels).save(tmp_path / "x.png")
    (tmp_path / "x.CameraSettings.txt").write_text(
        "Exposure=200ms\nMidCapture=2026-10-02T13:05:24.5000000Z\n"
    )
    images.fromarray(pixels).save(tmp_path / "y.png")
    found, undated = frames(f"folder:{tmp_path}", SourceOptions())
    assert isinstance(found, CameraFrame)
    assert abs(float(found.utc - MIDDLE)) < 1e-6
    assert found.pixels.tolist() == pixels[::-1].tolist()
    assert "y.png: nothing dates it" in str(undated)


@pytest.mark.parametrize("mode", ["L", "LA", "P", "RGB", "RGBA"])
def test_an_image_is_as_bright_in_any_kind_of_png(tmp_path: Path, mode: str) -> None:
    images = pytest.importorskip("PIL.Image")
    pixels = np.full((30, 40), 20, dtype=np.uint8)
    pixels[3, 5] = 230
    image = images.fromarray(pixels).convert(mode, palette=images.Palette.ADAPTIVE)
    image.save(tmp_path / "20261002_130524_400.png")
    (found,) = frames(f"folder:{tmp_path}", SourceOptions(0.2))
    assert isinstance(found, CameraFrame)
    assert found.saturation == 255.0
    assert found.pixels.tolist() == pixels[::-1].tolist()


@pytest.mark.parametrize("value", ["NaN", "-1,5", "inf", "ten"])
def test_a_value_of_a_header_that_is_none_in_fits_is_left_out(tmp_path: Path, value: str) -> None:
    data = fits_bytes(np.ones((30, 40)), DATE_OBS="2026-10-02T13:05:24.4", EXPTIME=0.2, CCD_TEMP=1.5)
    at = data.index(b"CCD-TEMP=")
    data = data[:at] + f"CCD-TEMP= {value:>20} / [degC]".ljust(80).encode() + data[at + 80 :]
    (tmp_path / "a.fits").write_bytes(data)
    (frame,) = frames(f"folder:{tmp_path}", SourceOptions())
    assert isinstance(frame, CameraFrame)
    assert "CCD-TEMP" not in frame.header
    assert abs(float(frame.utc - MIDDLE)) < 1e-6


def test_an_image_beside_a_first_header_is_dated_by_that(tmp_path: Path) -> None:
    fits = pytest.importorskip("astropy.io.fits")
    pixels = np.arange(1200, dtype=np.uint16).reshape(30, 40)
    first, image = fits.PrimaryHDU(), fits.ImageHDU(pixels)
    first.header["DATE-OBS"], first.header["EXPTIME"] = "2026-10-02T13:05:24.4", 9.0
    image.header["EXPTIME"] = 0.2
    fits.HDUList([first, image]).writeto(tmp_path / "a.fits")
    (found,) = frames(f"folder:{tmp_path}", SourceOptions())
    assert isinstance(found, CameraFrame)
    assert abs(float(found.utc - MIDDLE)) < 1e-6
    assert found.saturation == 65535.0
    assert found.pixels.tolist() == pixels.tolist()


def test_a_frame_that_was_kept_reads_as_it_was(tmp_path: Path) -> None:
    fits = pytest.importorskip("astropy.io.fits")
    pixels = np.arange(1200, dtype=np.float32).reshape(30, 40)
    path = save_frame(
        CameraFrame(pixels, MIDDLE, 0.2, "f", header={"GAIN": 7}), tmp_path / "kept", "guide", {"RA": 1.5}
    )
    header = fits.getheader(path)
    assert header["DATE-OBS"] == "2026-10-02T13:05:24.400000"
    assert (header["EXPTIME"], header["INSTRUME"], header["GAIN"], header["RA"]) == (0.2, "guide", 7, 1.5)
    assert fits.getdata(path).tolist() == pixels.tolist()


def test_frames_of_two_cameras_are_both_kept(tmp_path: Path) -> None:
    pytest.importorskip("astropy.io.fits")
    frame = CameraFrame(np.zeros((30, 40), dtype=np.float32), MIDDLE, 0.2, "f")
    kept = {save_frame(frame, tmp_path, camera, None) for camera in ("finder", "guide", "../my camera")}
    assert set(tmp_path.iterdir()) == kept
    assert len(kept) == 3


def test_frames_of_one_instant_are_all_kept_in_their_order(tmp_path: Path) -> None:
    pytest.importorskip("astropy.io.fits")
    pixels = np.zeros((30, 40), dtype=np.float32)
    names = ["a_0009.fits", "a_0010.fits", "süd 11.fits", "x" * 240 + "12.fits"]
    kept = [save_frame(CameraFrame(pixels, MIDDLE, 0.2, name), tmp_path, "Süd", None) for name in names]
    assert sorted(tmp_path.iterdir())[:2] == kept[:2]
    assert set(tmp_path.iterdir()) == set(kept)
    assert len(set(kept)) == 4


@pytest.mark.parametrize("saturation", [255.0, 4095.0, None])
def test_a_frame_that_was_kept_is_full_at_the_same_value(tmp_path: Path, saturation: float | None) -> None:
    pytest.importorskip("astropy.io.fits")
    pixels = np.full((30, 40), 250.0, dtype=np.float32)
    save_frame(CameraFrame(pixels, MIDDLE, 0.2, "f", saturation), tmp_path, "guide", None)
    (kept,) = frames(f"folder:{tmp_path}", SourceOptions())
    assert isinstance(kept, CameraFrame)
    assert kept.saturation == (saturation or 65535.0)


@pytest.mark.parametrize("said", [0, -1.0, True, "4095"])
def test_a_full_scale_that_is_none_is_that_of_the_pixels(tmp_path: Path, said: object) -> None:
    pixels = np.arange(1200, dtype=np.uint16).reshape(30, 40)
    (tmp_path / "a.fits").write_bytes(fits_bytes(pixels, **DATED, SATURATE=said))
    (found,) = frames(f"folder:{tmp_path}", SourceOptions())
    assert isinstance(found, CameraFrame)
    assert found.saturation == 65535.0


@pytest.mark.parametrize("header", [{}, {"XPIXSZ": 0.0}, {"XPIXSZ": 3.75, "YPIXSZ": 3.75, "FOCALLEN": 50.0}])
def test_a_frame_that_was_kept_tells_its_scale(tmp_path: Path, header: dict[str, float]) -> None:
    pytest.importorskip("astropy.io.fits")
    pixels = np.zeros((30, 40), dtype=np.float32)
    save_frame(CameraFrame(pixels, MIDDLE, 0.2, "f", header=header), tmp_path, "guide", {"SCALE": 2.5})
    (kept,) = frames(f"folder:{tmp_path}", SourceOptions())
    assert isinstance(kept, CameraFrame)
    assert kept.header["SCALE"] == 2.5
    # 3.75 um under 2.5 arcseconds, of which a radian has 206264.8.
    focal_mm = pytest.approx(3.75e-3 * 206264.806 / 2.5, abs=1e-3) if header.get("XPIXSZ") else None
    assert kept.header.get("FOCALLEN") == focal_mm
    assert ImageGeometry().of_header(kept).scale_arcsec_px == pytest.approx(2.5, rel=1e-5)


class AnnouncedCamera:
    """An Alpaca camera of two by three pixels, by what AlpacaCamera asks of its device."""

    members: ClassVar = {"pixelsizex": 3.75, "pixelsizey": 3.0, "binx": 2, "biny": 2, "imageready": True}

    def __init__(self, *_: object) -> None: ...

    def put(self, member: str, **values: str) -> None: ...

    def get(self, member: str) -> object:
        if member not in self.members:
            raise AlpacaRefusalError(0x400, "not implemented")
        value = self.members[member]
        if isinstance(value, Exception):
            raise value
        return value

    def get_body(self, *_: object) -> tuple[str, bytes]:
        return "application/imagebytes", metadata(8) + struct.pack("<6H", 1, 2, 3, 4, 5, 6)


@pytest.mark.parametrize("said", [0.0, -1.0, math.nan, math.inf, "3.75"])
def test_a_pixel_size_that_is_none_is_not_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, said: object
) -> None:
    fits = pytest.importorskip("astropy.io.fits")
    monkeypatch.setattr(AnnouncedCamera, "members", {"pixelsizex": said, "binx": said, "imageready": True})
    monkeypatch.setattr(sources, "AlpacaDevice", AnnouncedCamera)
    frame = next(iter(open_source("alpaca://127.0.0.1:1/0", SourceOptions(0.001)).frames()))
    assert isinstance(frame, CameraFrame)
    header = fits.getheader(save_frame(frame, tmp_path, "guide", {"SCALE": 2.5}))
    assert not {"XPIXSZ", "XBINNING", "FOCALLEN"} & set(header)


def test_the_pixel_size_that_an_alpaca_camera_announces_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fits = pytest.importorskip("astropy.io.fits")
    monkeypatch.setattr(sources, "AlpacaDevice", AnnouncedCamera)
    frame = next(iter(open_source("alpaca://127.0.0.1:1/0", SourceOptions(0.001)).frames()))
    assert isinstance(frame, CameraFrame)
    header = fits.getheader(save_frame(frame, tmp_path, "guide", None))
    # FITS has the size of the pixels as they are read out.
    assert (header["XPIXSZ"], header["YPIXSZ"]) == (7.5, 6.0)
    assert (header["XBINNING"], header["YBINNING"]) == (2, 2)


@pytest.mark.parametrize(("sensor", "pattern"), [(0, None), (1, None), (2, "RGGB")])
def test_that_an_alpaca_camera_has_filters_of_colours_goes_with_its_frames(
    monkeypatch: pytest.MonkeyPatch, sensor: int, pattern: str | None
) -> None:
    monkeypatch.setattr(AnnouncedCamera, "members", AnnouncedCamera.members | {"sensortype": sensor})
    monkeypatch.setattr(sources, "AlpacaDevice", AnnouncedCamera)
    frame = next(iter(open_source("alpaca://127.0.0.1:1/0", SourceOptions(0.001)).frames()))
    assert isinstance(frame, CameraFrame)
    assert frame.header.get("BAYERPAT") == pattern


@pytest.mark.parametrize(
    ("said", "begun"),
    [
        ("2026-10-02T13:05:23.75", "2026-10-02T13:05:23.75Z"),
        # Cut off at a second, and perhaps local time, as ASCOM's template for drivers has it.
        ("2026-10-02T13:05:23", "2026-10-02T13:05:24Z"),
        ("2026-10-02T15:05:24", "2026-10-02T13:05:24Z"),
        # No date at all.
        (None, "2026-10-02T13:05:24Z"),
        ("02/10/2026 13:05:23", "2026-10-02T13:05:24Z"),
        (NoAnswerError("it answered with HTTP status 400", 400), "2026-10-02T13:05:24Z"),
    ],
)
def test_an_alpaca_camera_that_does_not_date_well_is_dated_by_our_clock(
    monkeypatch: pytest.MonkeyPatch, said: object, begun: str
) -> None:
    members = AnnouncedCamera.members | {"lastexposurestarttime": said, "lastexposureduration": 0.0}
    monkeypatch.setattr(AnnouncedCamera, "members", members)
    monkeypatch.setattr(sources, "AlpacaDevice", AnnouncedCamera)
    options = SourceOptions(0.001, clock=SimulatedClock(Utc.parse("2026-10-02T13:05:24Z").unix_s, 0.0, 0.0))
    frame = next(iter(open_source("alpaca://127.0.0.1:1/0", options).frames()))
    assert isinstance(frame, CameraFrame)
    assert abs(float(frame.utc - Utc.parse(begun))) < 1e-6


def test_the_electrons_of_a_unit_are_those_of_the_gain_that_is_set(monkeypatch: pytest.MonkeyPatch) -> None:
    members = AnnouncedCamera.members | {"gainmin": 0, "gainmax": 400, "gain": 0, "electronsperadu": 4.0}

    def put(_: AnnouncedCamera, member: str, **values: str) -> None:
        if member == "gain":
            members["electronsperadu"] = 4.0 * 10.0 ** (-float(values["Gain"]) / 200.0)

    monkeypatch.setattr(AnnouncedCamera, "members", members)
    monkeypatch.setattr(AnnouncedCamera, "put", put)
    monkeypatch.setattr(sources, "AlpacaDevice", AnnouncedCamera)
    monkeypatch.setattr(time, "sleep", lambda _: None)
    camera = open_source("alpaca://127.0.0.1:1/0", SourceOptions())
    camera.adjust(10.0)
    camera.adjust(2.0)
    frame = next(iter(camera.frames()))
    assert isinstance(frame, CameraFrame)
    assert frame.header["GAIN"] == 40.0
    assert frame.header["EGAIN"] == pytest.approx(4.0 * 10.0**-0.2)


@pytest.mark.parametrize("scale", [0.0, -2.5, 3601.0, "2.5"])
def test_a_header_whose_scale_is_none_tells_none(scale: object) -> None:
    frame = CameraFrame(np.zeros((30, 40), dtype=np.float32), MIDDLE, 0.2, "f", header={"SCALE": scale})
    assert ImageGeometry().of_header(frame).scale_arcsec_px is None


@pytest.mark.parametrize(
    "text", ["", "folder:", "alpaca://host", "indi://host/x", "webcam", "v4l:", "folder:/nowhere/at/all"]
)
def test_what_is_no_source_is_refused_in_one_line(text: str) -> None:
    with pytest.raises(BadInputError) as error:
        open_source(text, SourceOptions())
    assert "\n" not in str(error.value)


def cut_off(bits: int) -> np.ndarray:
    """Return what a converter of so many bits makes of a brighter star, kept in 16."""
    canvas = Canvas(120, 100)
    canvas.point(60.0, 50.0, 1e7)
    return np.minimum(canvas.exposed(np.random.default_rng(3), gain=5.0), 2**bits - 1)


@pytest.mark.parametrize(("bits", "full"), [(10, 1023.0), (12, 4095.0), (14, 16383.0), (16, 65535.0)])
def test_a_full_pixel_of_fewer_bits_is_known_by_a_frame_that_is_cut_off(
    tmp_path: Path, bits: int, full: float
) -> None:
    (tmp_path / "a.fits").write_bytes(fits_bytes(cut_off(bits), **DATED))
    (found,) = frames(f"folder:{tmp_path}", SourceOptions())
    assert isinstance(found, CameraFrame)
    assert found.saturation == full
    seen = Detector().look(found, ExpectedMotion(400.0, 0.0))
    assert (seen.kind, seen.x, seen.y) == (
        "point",
        pytest.approx(60.0, abs=0.5),
        pytest.approx(50.0, abs=0.5),
    )
    assert light_wanted(found, seen) == 0.5


def test_a_value_that_many_pixels_have_by_chance_is_no_full_scale() -> None:
    pixels = np.random.default_rng(4).normal(4000.0, 30.0, (100, 120)).clip(None, 4095.0).astype(np.float32)
    pixels[50:53, 60:63] = 4095.0, 4094.0, 4095.0
    assert full_scale(pixels, 65535.0) == 65535.0
    assert full_scale(pixels + 0.5, 65535.0) == 65535.0


INDI = b"""<defSwitchVector device="CCD Sim" name="CONNECTION" state="Ok" perm="rw" rule="OneOfMany"
timestamp="2026-10-02T13:05:20"><defSwitch name="CONNECT">On</defSwitch>
<defSwitch name="DISCONNECT">Off</defSwitch>
</defSwitchVector>
<defNumberVector device="CCD Sim" name="CCD_EXPOSURE" state="Idle" perm="rw" timestamp="2026-10-02T13:05:20">
<defNumber name="CCD_EXPOSURE_VALUE" format="%5.2f" min="0" max="3600" step="1">1</defNumber>
</defNumberVector>
<defBLOBVector device="CCD Sim" name="CCD1" state="Idle" perm="ro" timestamp="2026-10-02T13:05:20">
<defBLOB name="CCD1"/></defBLOBVector>
"""


def serve_indi(listener: socket.socket, image: bytes, heard: list[bytes]) -> None:
    connection, _ = listener.accept()
    with connection:
        waiting = b""
        while data := connection.recv(65536):
            heard.append(data)
            waiting += data
            if b"getProperties" in waiting:
                connection.sendall(INDI)
                waiting = b""
            if b"</newNumberVector>" in waiting:
                waiting = b""
                blob = base64.b64encode(image)
                connection.sendall(
                    b'<setBLOBVector device="CCD Sim" name="CCD1" state="Ok" timestamp="2026-10-02T13:05:25">'
                    b'<oneBLOB name="CCD1" size="%d" format=".fits">%s</oneBLOB></setBLOBVector>\n'
                    % (len(image), blob)
                )


def from_indi(image: bytes, heard: list[bytes]) -> CameraFrame | SattrackError:
    """Return what comes of an image that an INDI server sends."""
    pytest.importorskip("indipyclient")
    with socket.create_server(("127.0.0.1", 0)) as listener:
        server = threading.Thread(target=serve_indi, args=(listener, image, heard), daemon=True)
        server.start()
        camera = open_source(f"indi://127.0.0.1:{listener.getsockname()[1]}/CCD%20Sim", SourceOptions(0.2))
        frame = next(iter(camera.frames()))
        camera.close()
        server.join(10.0)
    return frame


def test_an_indi_camera_is_asked_for_frames(capfd: pytest.CaptureFixture[str]) -> None:
    heard: list[bytes] = []
    frame = from_indi(image_fits(), heard)
    assert isinstance(frame, CameraFrame)
    assert abs(float(frame.utc - MIDDLE)) < 1e-6
    assert frame.pixels.tolist() == np.arange(1200).reshape(30, 40).tolist()
    assert b"0.2" in b"".join(heard)
    assert capfd.readouterr().out == ""


def test_an_indi_server_that_is_not_there_is_told_in_one_line(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("indipyclient")
    monkeypatch.setattr(sources, "FOUND_WITHIN_S", 0.3)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    with pytest.raises(SattrackError, match="nothing answers there; check that indiserver runs"):
        open_source(f"indi://127.0.0.1:{port}/CCD%20Sim", SourceOptions(0.2))
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("packed", "plain"), [("INDI_ENABLED", "INDI_DISABLED"), ("CCD_COMPRESS", "CCD_RAW")]
)
def test_an_indi_camera_that_packs_its_images_is_asked_for_plain_ones(
    monkeypatch: pytest.MonkeyPatch, packed: str, plain: str
) -> None:
    packing = (
        f'<defSwitchVector device="CCD Sim" name="CCD_COMPRESSION" state="Ok" perm="rw" rule="OneOfMany" '
        f'timestamp="2026-10-02T13:05:20"><defSwitch name="{packed}">On</defSwitch>'
        f'<defSwitch name="{plain}">Off</defSwitch></defSwitchVector>\n'
    )
    monkeypatch.setattr(sys.modules[__name__], "INDI", packing.encode() + INDI)
    heard: list[bytes] = []
    assert isinstance(from_indi(image_fits(), heard), CameraFrame)
    asked = re.search(
        rb'<newSwitchVector[^>]*name="CCD_COMPRESSION".*?</newSwitchVector>', b"".join(heard), re.S
    )
    assert asked is not None
    wanted = dict(re.findall(rb'<oneSwitch name="(\w+)">\s*(\w+)\s*</oneSwitch>', asked[0]))
    assert wanted == {packed.encode(): b"Off", plain.encode(): b"On"}


def test_an_indi_camera_that_streams_fills_no_memory() -> None:
    pytest.importorskip("indipyclient")
    image, stream = b"\0" * 1_000_000, threading.Event()

    def serve(listener: socket.socket) -> None:
        connection, _ = listener.accept()
        with connection:
            connection.recv(65536)
            connection.sendall(INDI)
            stream.wait(10.0)
            blob = b'<setBLOBVector device="CCD Sim" name="CCD1" state="Ok" timestamp="2026-10-02T13:05:25">'
            blob += b'<oneBLOB name="CCD1" size="%d" format=".fits">' % len(image)
            blob += base64.b64encode(image) + b"</oneBLOB></setBLOBVector>\n"
            for _ in range(40):
                connection.sendall(blob)
            # Acknowledged by the client's own words: all was read before.
            connection.sendall(b'<message device="CCD Sim" message="last"/>\n')
            until_s = time.monotonic() + 20.0
            while time.monotonic() < until_s and not read.is_set():
                time.sleep(0.05)

    read = threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as listener:
        threading.Thread(target=serve, args=(listener,), daemon=True).start()
        camera = open_source(f"indi://127.0.0.1:{listener.getsockname()[1]}/CCD%20Sim", SourceOptions(0.2))
        assert isinstance(camera, sources.IndiCamera)
        tracemalloc.start()
        try:
            stream.set()
            until_s = time.monotonic() + 20.0
            while not any("last" in str(one) for one in camera._client.data["CCD Sim"].messages):
                assert time.monotonic() < until_s
                time.sleep(0.05)
            kept, _ = tracemalloc.get_traced_memory()
        finally:
            tracemalloc.stop()
            read.set()
        camera.close()
    assert kept < 10.0 * len(image)


def test_an_indi_server_that_is_started_again_is_asked_for_frames_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pytest.importorskip("indipyclient")
    heard: list[bytes] = []

    def serve(listener: socket.socket) -> None:
        connection, _ = listener.accept()
        with connection:
            waiting = connection.recv(65536)
            connection.sendall(INDI)
            while b"</newNumberVector>" not in waiting:
                waiting += connection.recv(65536)
        serve_indi(listener, image_fits(), heard)

    monkeypatch.setattr(sources, "READ_WITHIN_S", 1.0)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        threading.Thread(target=serve, args=(listener,), daemon=True).start()
        camera = open_source(f"indi://127.0.0.1:{listener.getsockname()[1]}/CCD%20Sim", SourceOptions(0.2))
        until_s = time.monotonic() + 60.0
        for frame in camera.frames():
            if isinstance(frame, CameraFrame) or time.monotonic() > until_s:
                break
        camera.close()
    assert isinstance(frame, CameraFrame)
    assert b">Also</enableBLOB>" in b"".join(heard)


def test_an_indi_camera_that_dates_to_whole_seconds_is_dated_by_our_clock() -> None:
    dated = {"DATE_OBS": "2026-10-02T13:05:24", "EXPTIME": 0.2}
    frame = from_indi(fits_bytes(np.ones((30, 40), dtype=np.uint16), **dated), [])
    assert isinstance(frame, CameraFrame)
    assert abs(float(frame.utc - Utc(time.time()))) < 10.0


@pytest.mark.parametrize(
    ("make", "why"),
    [
        (image_fits, "1200 pixels; 1199 are the most"),
        (lambda: gzip.compress(image_fits()), "unpack it first"),
        (lambda: image_fits().replace(b"NAXIS1", b"NAXISX"), "cannot be read as FITS"),
    ],
    ids=["large", "packed", "broken"],
)
def test_what_an_indi_camera_sends_that_cannot_be_a_frame_is_told(
    monkeypatch: pytest.MonkeyPatch, make: Callable[[], bytes], why: str
) -> None:
    monkeypatch.setattr(files, "MOST_NUMBERS", 1199)
    refused = from_indi(make(), [])
    assert isinstance(refused, SattrackError)
    assert why in str(refused)


def test_a_video_device_gives_frames_with_their_top_row_last(tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    path = tmp_path / "clip.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 10, (64, 48))
    image = np.zeros((48, 64, 3), dtype=np.uint8)
    image[:24] = 200
    for _ in range(3):
        writer.write(image)
    writer.release()
    first, second, third, end = frames(f"v4l:{path}", SourceOptions())
    assert isinstance(end, SattrackError)
    for frame in (first, second, third):
        assert isinstance(frame, CameraFrame)
        assert frame.pixels[40:].mean() > 150.0 > 50.0 > frame.pixels[:8].mean()


def test_no_frame_of_a_video_device_waits_in_the_queue_of_the_driver(monkeypatch: pytest.MonkeyPatch) -> None:
    """V4L2 keeps four frames while one is looked at: dated when they are read, they would be too late."""
    asked: list[tuple[int, float]] = []
    capture = SimpleNamespace(
        isOpened=lambda: True,
        set=lambda *one: asked.append(one),
        read=lambda: (True, np.zeros((30, 40), dtype=np.uint8)),
        release=lambda: None,
    )
    cv2 = SimpleNamespace(VideoCapture=lambda _: capture, CAP_PROP_BUFFERSIZE=38)
    monkeypatch.setattr(sources, "needed", lambda *_: cv2)
    assert isinstance(next(iter(open_source("v4l:/dev/video0", SourceOptions()).frames())), CameraFrame)
    assert asked == [(38, 1)]
