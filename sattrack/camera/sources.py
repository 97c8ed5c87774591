"""Where frames come from: folders, Alpaca, INDI and V4L cameras. All I/O of the package, and its clock."""

from __future__ import annotations

import re
import struct
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from sattrack.camera.frames import (
    START_EXPOSURE_S,
    CameraFrame,
    fits_exposure,
    grey,
    more_light,
    name_exposure,
    text_exposure,
)
from sattrack.core.clock import Clock, SystemClock
from sattrack.core.errors import BadInputError, SattrackError, needed
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

FITS_SUFFIXES = {".fits", ".fit", ".fts"}
PNG_SUFFIXES = {".png"}
POLL_S = 0.1
FORMS = "folder:DIR, alpaca://HOST:PORT/N, indi://HOST:PORT/NAME or v4l:/dev/video0"
LONGEST_TEXT = 100_000


class FrameSource(Protocol):
    """A camera, or what stands for one."""

    exposure_s: float | None
    """The next exposure; None where it cannot be set."""

    def frames(self) -> Iterator[CameraFrame | SattrackError]:
        """Return the frames as they come; an error for one that cannot be used."""

    def adjust(self, factor: float) -> None:
        """Take so many times the light from now on, as far as the camera can."""

    def close(self) -> None:
        """Let go of the camera."""


@dataclass(frozen=True, slots=True)
class SourceOptions:
    """What options say of a source: the exposure in seconds (None: by itself), the latency of its dates.

    `clock` dates what a live camera itself does not.
    """

    exposure_s: float | None = None
    latency_s: float = 0.0
    watch: bool = False
    clock: Clock = field(default_factory=SystemClock)

    def now(self) -> Utc:
        """Return the instant that it is by the clock."""
        return Utc(self.clock.utc_s(time.monotonic()))


def open_source(text: str, options: SourceOptions) -> FrameSource:
    """Return a source by its name on the command line; raises BadInputError, SattrackError."""
    kind, _, rest = text.partition(":")
    if kind == "folder" and rest:
        return FolderSource(Path(rest), options)
    if kind == "alpaca":
        from sattrack.camera.alpaca import AlpacaCamera

        return AlpacaCamera(rest, options)
    if kind == "indi":
        from sattrack.camera.indi import IndiCamera

        return IndiCamera(rest, options)
    if kind == "v4l" and rest:
        return VideoSource(rest, options)
    raise BadInputError(f"{text!r} is no camera: write {FORMS}")


class FolderSource:
    """FITS and PNG files of a folder, in the order of their names; with `watch`, new ones as they come."""

    exposure_s: float | None = None

    def __init__(self, folder: Path, options: SourceOptions) -> None:
        if not folder.is_dir():
            raise BadInputError(f"{folder}: there is no such folder")
        self._folder, self._options = folder, options

    def frames(self) -> Iterator[CameraFrame | SattrackError]:
        """See FrameSource."""
        done: set[str] = set()
        sizes: dict[str, int] = {}
        while True:
            found = sorted(
                each for each in self._folder.iterdir() if each.suffix.lower() in FITS_SUFFIXES | PNG_SUFFIXES
            )
            for path in found:
                if path.name in done or (self._options.watch and self._growing(path, sizes)):
                    continue
                done.add(path.name)
                try:
                    yield read_frame(path, self._options)
                except SattrackError as error:
                    yield error
            if not self._options.watch:
                return
            time.sleep(POLL_S)

    def _growing(self, path: Path, sizes: dict[str, int]) -> bool:
        """Tell whether a file may still be written: its size has changed since the last look."""
        size = path.stat().st_size
        before = sizes.get(path.name)
        sizes[path.name] = size
        return before != size or size == 0

    def adjust(self, factor: float) -> None:
        """See FrameSource: files are as they are."""

    def close(self) -> None:
        """See FrameSource."""


def read_frame(path: Path, options: SourceOptions) -> CameraFrame:
    """Return the frame of a FITS or PNG file; raises BadInputError, naming it, SattrackError."""
    if path.suffix.lower() in FITS_SUFFIXES:
        return _read_fits(path, options)
    return _read_png(path, options)


def _read_fits(path: Path, options: SourceOptions) -> CameraFrame:
    fits = needed("astropy.io.fits", f"{path}: reading FITS", "camera")
    try:
        with fits.open(path, memmap=False) as file:
            part = next((one for one in file if getattr(one, "data", None) is not None), None)
            if part is None:
                raise BadInputError(f"{path}: it has no image")
            header = {key: part.header[key] for key in part.header if key}
            pixels = np.asarray(part.data)
    except (OSError, ValueError, TypeError, IndexError) as error:
        raise BadInputError(f"{path}: cannot be read as FITS: {error}") from None
    exposure = fits_exposure(header, str(path), options.exposure_s)
    top_down = str(header.get("ROWORDER", "")).strip().upper() == "TOP-DOWN"
    image = _image(pixels, path)
    said = header.get("SATURATE")
    full = float(said) if isinstance(said, int | float) else _full_scale(pixels.dtype, header)
    return CameraFrame(
        image[::-1] if top_down else image,
        exposure.utc.plus(-options.latency_s),
        exposure.exposure_s,
        path.name,
        full,
        header,
    )


def _full_scale(kind: np.dtype[Any], header: dict[str, Any]) -> float | None:
    if kind.kind == "u":
        return float(np.iinfo(kind).max)
    # 16 bits without a sign are kept as 16 bits with one and an offset, which astropy takes out as floats.
    return 65535.0 if header.get("BZERO") == 32768 else None


def _read_png(path: Path, options: SourceOptions) -> CameraFrame:
    images = needed("PIL.Image", f"{path}: reading PNG", "camera")
    try:
        with images.open(path) as file:
            file.load()
            said = {key: str(value) for key, value in getattr(file, "text", {}).items()}
            pixels = np.asarray(file)
    except (OSError, ValueError, SyntaxError) as error:
        raise BadInputError(f"{path}: cannot be read as PNG: {error}") from None
    exposure = None
    if any(key.upper().startswith("DATE-") for key in said):
        exposure = fits_exposure(
            {key.upper(): value for key, value in said.items()}, str(path), options.exposure_s
        )
    for beside in (path.with_suffix(".CameraSettings.txt"), path.with_suffix(".txt")):
        if exposure is None and beside.is_file():
            text = beside.read_text(encoding="utf-8", errors="replace")[:LONGEST_TEXT]
            exposure = text_exposure(text, str(beside), options.exposure_s)
    if exposure is None:
        exposure = name_exposure(path.stem, str(path), options.exposure_s)
    if exposure is None:
        raise BadInputError(
            f"{path}: nothing dates it: no DATE-OBS in it, no settings of SharpCap or FireCapture beside it, "
            "no time in its name"
        )
    full = float(np.iinfo(pixels.dtype).max) if pixels.dtype.kind == "u" else None
    return CameraFrame(
        _image(pixels, path)[::-1],
        exposure.utc.plus(-options.latency_s),
        exposure.exposure_s,
        path.name,
        full,
    )


def _image(pixels: NDArray[Any], path: Path) -> NDArray[np.float32]:
    try:
        return np.ascontiguousarray(grey(pixels), dtype=np.float32)
    except ValueError as error:
        raise BadInputError(f"{path}: it is no image: {error}") from None


V4L_GAIN, V4L_EXPOSURE = 0x00980913, 0x009A0902
"""V4L2_CID_GAIN and V4L2_CID_EXPOSURE_ABSOLUTE (steps of 0.1 ms), of linux/v4l2-controls.h."""
QUERY_CONTROL = 0xC0445624
"""VIDIOC_QUERYCTRL, of linux/videodev2.h: its structure has 68 bytes."""
CONTROL = struct.Struct("=II32siiiiIII")
CONTROL_DISABLED = 0x0001


def v4l_range(device: str, control: int) -> tuple[float, float] | None:
    """Return the least and the greatest value of a V4L2 control; None where the driver does not have it."""
    import fcntl

    answer = bytearray(CONTROL.pack(control, 0, b"", 0, 0, 0, 0, 0, 0, 0))
    try:
        with Path(device).open("rb", buffering=0) as opened:
            fcntl.ioctl(opened, QUERY_CONTROL, answer)
    except OSError:
        return None
    _, _, _, least, most, _, _, flags, *_ = CONTROL.unpack(answer)
    return None if flags & CONTROL_DISABLED or most <= least else (float(least), float(most))


class VideoSource:
    """A webcam or guide camera of this machine, through OpenCV.

    A frame is dated by this machine's clock when it has come, less half its exposure and the latency: what
    the driver and the USB take is not known, and must be given as `--latency`.
    """

    def __init__(self, device: str, options: SourceOptions) -> None:
        self._cv2 = needed("cv2", f"v4l:{device}", "v4l")
        number = re.fullmatch(r"/dev/video(\d+)", device)
        self._capture = self._cv2.VideoCapture(int(number[1]) if number else device)
        if not self._capture.isOpened():
            raise SattrackError(f"v4l:{device}: it cannot be opened; `v4l2-ctl --list-devices` lists cameras")
        self._device, self._options = device, options
        self.exposure_s = options.exposure_s
        if options.exposure_s is not None:
            self._expose(options.exposure_s)

    def _expose(self, exposure_s: float) -> None:
        # V4L counts exposures in steps of 0.1 ms, and 1 is its manual mode.
        self._capture.set(self._cv2.CAP_PROP_AUTO_EXPOSURE, 1)
        self._capture.set(self._cv2.CAP_PROP_EXPOSURE, exposure_s * 1e4)

    def frames(self) -> Iterator[CameraFrame | SattrackError]:
        """See FrameSource."""
        number = 0
        while True:
            good, pixels = self._capture.read()
            came = self._options.now()
            if not good:
                yield SattrackError(f"v4l:{self._device}: no frame came")
                return
            number += 1
            exposure_s = self.exposure_s or 0.0
            full = float(np.iinfo(pixels.dtype).max) if pixels.dtype.kind == "u" else None
            yield CameraFrame(
                np.ascontiguousarray(grey(pixels)[::-1], dtype=np.float32),
                came.plus(-0.5 * exposure_s - self._options.latency_s),
                exposure_s,
                f"frame {number}",
                full,
            )

    def adjust(self, factor: float) -> None:
        """See FrameSource."""
        if self._options.exposure_s is not None or factor == 1.0:
            return
        # As long as nothing has to change, the driver's own automatic exposure goes on.
        before_s = self.exposure_s or START_EXPOSURE_S
        gains = v4l_range(self._device, V4L_GAIN)
        gain = None if gains is None else float(self._capture.get(self._cv2.CAP_PROP_GAIN))
        shown = v4l_range(self._device, V4L_EXPOSURE)
        exposures_s = (1e-4, 1.0) if shown is None else (shown[0] * 1e-4, shown[1] * 1e-4)
        self.exposure_s, wanted = more_light(before_s, factor, exposures_s, gain, gains)
        self._expose(self.exposure_s)
        if wanted is not None and wanted != gain:
            self._capture.set(self._cv2.CAP_PROP_GAIN, wanted)

    def close(self) -> None:
        """See FrameSource."""
        self._capture.release()


def save_frame(frame: CameraFrame, folder: Path, camera: str, solved: dict[str, float] | None) -> Path:
    """Write a frame as FITS, its first row at the bottom, with the headers of the field; return the file.

    Raises SattrackError.
    """
    fits = needed("astropy.io.fits", "--save", "camera")
    begun = frame.utc.plus(-0.5 * frame.exposure_s)
    top = np.asarray(frame.pixels)
    whole = bool(
        np.isfinite(top).all() and top.min() >= 0 and top.max() <= 65535 and (top == np.rint(top)).all()
    )
    part = fits.PrimaryHDU(top.astype(np.uint16) if whole else top)
    header = part.header
    header["TIMESYS"] = "UTC"
    header["DATE-OBS"] = (begun.isoformat("microseconds").rstrip("Z"), "beginning of the exposure")
    header["DATE-AVG"] = (frame.utc.isoformat("microseconds").rstrip("Z"), "middle of the exposure")
    header["EXPTIME"] = (frame.exposure_s, "[s]")
    header["ROWORDER"] = "BOTTOM-UP"
    header["INSTRUME"] = camera
    for key in ("GAIN", "OFFSET", "XPIXSZ", "YPIXSZ", "EGAIN", "CCD-TEMP", "XBINNING", "YBINNING"):
        if key in frame.header:
            header[key] = frame.header[key]
    for key, value in (solved or {}).items():
        header[key] = value
    name = begun.isoformat("milliseconds").replace(":", "").replace("-", "").replace(".", "_")
    path = folder / f"{name}.fits"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        part.writeto(path, overwrite=True)
    except OSError as error:
        raise SattrackError(f"{path}: cannot be written: {error.strerror or error}") from None
    return path
