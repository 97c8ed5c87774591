"""Where frames come from: folders, Alpaca, INDI and V4L cameras. With `files`, all I/O of the package."""

from __future__ import annotations

import asyncio
import contextlib
import io
import logging
import math
import os
import queue
import re
import struct
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol
from urllib.parse import unquote

import numpy as np

from sattrack.camera.files import FITS_SUFFIXES, PNG_SUFFIXES, fits_image, grey_image, read_frame
from sattrack.camera.frames import (
    AUTO_S,
    COARSE_S,
    START_EXPOSURE_S,
    CameraFrame,
    fits_exposure,
    full_scale,
    grey,
    last_decimal_s,
    more_light,
    parse_utc,
)
from sattrack.core.clock import Clock, SystemClock
from sattrack.core.errors import BadInputError, SattrackError, needed
from sattrack.mount.alpaca.client import AlpacaDevice, AlpacaRefusalError, NoAnswerError, value_in
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

POLL_S = 0.1
READ_WITHIN_S = 20.0
FORMS = "folder:DIR, alpaca://HOST:PORT/N, indi://HOST:PORT/NAME or v4l:/dev/video0"


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


def check_source(text: str) -> tuple[str, str]:
    """Return kind and place of a source; raises BadInputError where it can be no camera, or is not there."""
    kind, colon, rest = text.partition(":")
    if kind in ("alpaca", "indi") or (kind == "v4l" and rest):
        return kind, rest
    if kind == "folder" and rest:
        if not Path(rest).is_dir():
            raise BadInputError(f"{rest}: there is no such folder")
        return kind, rest
    missing = "" if colon or Path(text).exists() else ", and there is no such file"
    raise BadInputError(f"{text!r} is no camera{missing}: write {FORMS}")


def open_source(text: str, options: SourceOptions) -> FrameSource:
    """Return a source by its name on the command line; raises BadInputError, SattrackError."""
    kind, rest = check_source(text)
    if kind == "folder":
        return FolderSource(Path(rest), options)
    if kind == "alpaca":
        return AlpacaCamera(rest, options)
    return IndiCamera(rest, options) if kind == "indi" else VideoSource(rest, options)


class FolderSource:
    """FITS and PNG files of a folder, in the order of their names; with `watch`, new ones as they come."""

    exposure_s: float | None = None

    def __init__(self, folder: Path, options: SourceOptions) -> None:
        self._folder, self._options = folder, options

    def frames(self) -> Iterator[CameraFrame | SattrackError]:
        """See FrameSource."""
        done: set[str] = set()
        refused: dict[str, int | None] = {}
        sizes: dict[str, int] = {}
        while True:
            found = sorted(
                each for each in self._folder.iterdir() if each.suffix.lower() in FITS_SUFFIXES | PNG_SUFFIXES
            )
            for path in found:
                if path.name in done or (self._options.watch and self._growing(path, sizes)):
                    continue
                size = sizes.get(path.name)
                if path.name in refused and refused[path.name] == size:
                    continue
                try:
                    frame = read_frame(path, self._options.exposure_s, self._options.latency_s)
                except SattrackError as error:
                    # It may be written on.
                    refused[path.name] = size
                    yield error
                else:
                    done.add(path.name)
                    yield frame
            if not self._options.watch:
                if not found:
                    yield self._nothing_to_read()
                return
            time.sleep(POLL_S)

    def _nothing_to_read(self) -> BadInputError:
        """Return the refusal of a folder that has no file of a suffix that is read."""
        *most, last = sorted(FITS_SUFFIXES | PNG_SUFFIXES)
        others = sum(each.is_file() for each in self._folder.iterdir())
        return BadInputError(
            f"{self._folder}: no file there ends in {', '.join(most)} or {last}; others are not read, "
            f"nor packed ones (other files: {others})"
        )

    def _growing(self, path: Path, sizes: dict[str, int]) -> bool:
        """Tell whether a file may still be written: its size has changed since the last look."""
        try:
            size = path.stat().st_size
        except OSError:
            # It is gone.
            return True
        before = sizes.get(path.name)
        sizes[path.name] = size
        return before != size or size == 0

    def adjust(self, factor: float) -> None:
        """See FrameSource: files are as they are."""

    def close(self) -> None:
        """See FrameSource."""


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
        # What cannot be opened is told below; OpenCV would add its own log to that.
        os.environ.setdefault("OPENCV_LOG_LEVEL", "ERROR")
        self._cv2 = needed("cv2", f"v4l:{device}", "v4l")
        number = re.fullmatch(r"/dev/video(\d+)", device)
        self._capture = self._cv2.VideoCapture(int(number[1]) if number else device)
        if not self._capture.isOpened():
            raise SattrackError(f"v4l:{device}: it cannot be opened; `v4l2-ctl --list-devices` lists cameras")
        # A frame that waited in the driver's queue, of four by itself, would be dated when it is read.
        self._capture.set(self._cv2.CAP_PROP_BUFFERSIZE, 1)
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


READY_POLL_S = 0.005
MOST_IMAGE_BYTES = 1 << 29
METADATA = struct.Struct("<iiIIiiiiiii")
ELEMENTS = {1: "<i2", 2: "<i4", 3: "<f8", 4: "<f4", 5: "<u8", 6: "u1", 7: "<i8", 8: "<u2", 9: "<u4"}
"""Types of the elements of ImageBytes, by their numbers (ASCOM Alpaca API Reference, ImageBytes)."""
RGGB = 2
"""Of the types of sensors: pixels behind filters, one red, two green and one blue (ICameraV3)."""
_ALPACA_URL = re.compile(r"//([^/]+)/(\d+)/?")


def decode_image(kind: str, body: bytes) -> NDArray[Any]:
    """Return the image of an answer to imagearray: [row][column], row 0 at the top.

    Alpaca's arrays have the column first. Raises AlpacaRefusalError, NoAnswerError.
    """
    if "imagebytes" not in kind:
        return _turned(np.asarray(value_in("imagearray", 200, body)))
    if len(body) < METADATA.size:
        raise NoAnswerError("its image is shorter than its own description")
    version, number, _, _, start, _, element, rank, *dimensions = METADATA.unpack_from(body)
    if number:
        raise AlpacaRefusalError(number, body[start:].decode(errors="replace")[:200])
    if version != 1 or element not in ELEMENTS or rank not in {2, 3} or min(dimensions[:rank]) <= 0:
        raise NoAnswerError(
            f"its image is of an unknown kind (version {version}, elements {element}, rank {rank})"
        )
    shape = tuple(dimensions[:rank])
    count = int(np.prod(shape, dtype=np.int64))
    if count * np.dtype(ELEMENTS[element]).itemsize > len(body) - start or start < METADATA.size:
        raise NoAnswerError("its image is shorter than it says")
    return _turned(np.frombuffer(body, ELEMENTS[element], count, start).reshape(shape))


def _turned(columns: NDArray[Any]) -> NDArray[Any]:
    if columns.ndim not in {2, 3} or columns.dtype.kind not in "uif":
        raise NoAnswerError("its image is no array of numbers")
    return np.swapaxes(columns, 0, 1)


class AlpacaCamera:
    """Exposes again and again, and reads each image as soon as it is there."""

    def __init__(self, url: str, options: SourceOptions) -> None:
        """Connect. Raises BadInputError for a URL that is none, SattrackError where there is no camera."""
        named = _ALPACA_URL.fullmatch(url)
        if named is None:
            raise BadInputError(f"alpaca:{url}: write alpaca://HOST:PORT/N")
        self._url = f"alpaca:{url}"
        self._device = AlpacaDevice(named[1], "camera", int(named[2]), READ_WITHIN_S)
        self._options = options
        self.exposure_s: float | None = options.exposure_s or START_EXPOSURE_S
        try:
            self._device.put("connected", Connected="true")
        except (AlpacaRefusalError, NoAnswerError) as error:
            raise SattrackError(f"{self._url}: no camera: {error}") from None
        self._shortest_s = float(self._optional("exposuremin") or AUTO_S[0])
        self._full = self._optional("maxadu") or None
        self._gain_per_unit = self._optional("electronsperadu")
        self._gains = tuple(self._optional(name) for name in ("gainmin", "gainmax", "gain"))
        self._optics: dict[str, float | str] = {}
        for axis in "xy":
            size_um, bins = self._optional(f"pixelsize{axis}") or 0.0, self._optional(f"bin{axis}") or 0.0
            # FITS has the pixels as they are read out, Alpaca as they are made.
            if size_um > 0.0:
                self._optics[f"{axis.upper()}PIXSZ"] = size_um * max(bins, 1.0)
            if bins >= 1.0:
                self._optics[f"{axis.upper()}BINNING"] = int(bins)
        if self._optional("sensortype") == RGGB:
            self._optics["BAYERPAT"] = "RGGB"

    def _optional(self, member: str) -> float | None:
        try:
            value = self._device.get(member)
        except (AlpacaRefusalError, NoAnswerError):
            return None
        if not isinstance(value, int | float) or isinstance(value, bool) or not math.isfinite(value):
            return None
        return float(value)

    def frames(self) -> Iterator[CameraFrame | SattrackError]:
        """See FrameSource; the end is an error that tells why."""
        number = 0
        while True:
            number += 1
            try:
                yield self._frame(number)
            except (AlpacaRefusalError, NoAnswerError, ValueError) as error:
                yield SattrackError(f"{self._url}: {error}")
                time.sleep(1.0)

    def _frame(self, number: int) -> CameraFrame:
        exposure_s = self.exposure_s or START_EXPOSURE_S
        self._device.put("startexposure", Duration=f"{exposure_s:g}", Light="true")
        begun = self._options.now()
        until_s = time.monotonic() + exposure_s + READ_WITHIN_S
        time.sleep(exposure_s)
        while not self._device.get("imageready"):
            if time.monotonic() > until_s:
                raise NoAnswerError("its exposure does not end")
            time.sleep(READY_POLL_S)
        kind, body = self._device.get_body(
            "imagearray", "application/imagebytes, application/json", MOST_IMAGE_BYTES
        )
        pixels = grey(decode_image(kind, body))
        taken_s = self._optional("lastexposureduration")
        length_s = exposure_s if taken_s is None else taken_s
        self._full = full_scale(pixels, self._full)
        header = dict(self._optics)
        if self._gain_per_unit is not None:
            header["EGAIN"] = self._gain_per_unit
        if self._gains[2] is not None:
            header["GAIN"] = self._gains[2]
        return CameraFrame(
            np.ascontiguousarray(pixels[::-1], dtype=np.float32),
            self._begun(begun).plus(0.5 * length_s - self._options.latency_s),
            length_s,
            f"frame {number}",
            self._full,
            header,
        )

    def _begun(self, by_us: Utc) -> Utc:
        """Return when the exposure began, by the camera if it says fractions of a second, else by us."""
        try:
            said = str(self._device.get("lastexposurestarttime"))
            utc = parse_utc(said, "lastexposurestarttime")
        except (AlpacaRefusalError, NoAnswerError, BadInputError):
            return by_us
        # ASCOM's template for drivers cuts it off at a second.
        return by_us if last_decimal_s(said) > COARSE_S else utc

    def adjust(self, factor: float) -> None:
        """See FrameSource: the exposure first, then the gain."""
        if self._options.exposure_s is not None or self.exposure_s is None:
            return
        low, high, gain = self._gains
        known = None if low is None or high is None else (low, high)
        exposures_s = (self._shortest_s, AUTO_S[1])
        self.exposure_s, wanted = more_light(self.exposure_s, factor, exposures_s, gain, known)
        if wanted is not None and wanted != gain:
            try:
                self._device.put("gain", Gain=str(round(wanted)))
            except (AlpacaRefusalError, NoAnswerError):
                return
            self._gains = low, high, wanted
            self._gain_per_unit = self._optional("electronsperadu")

    def close(self) -> None:
        """See FrameSource: end an exposure that goes on; others may use the camera."""
        try:
            self._device.put("abortexposure")
        except (AlpacaRefusalError, NoAnswerError):
            return


FOUND_WITHIN_S = 10.0
GAINS = (("CCD_GAIN", "GAIN"), ("CCD_CONTROLS", "Gain"))
"""Where drivers have the gain: a vector of its own, or among the camera's other controls."""
PACKINGS = (("INDI_ENABLED", "INDI_DISABLED"), ("CCD_COMPRESS", "CCD_RAW"))
"""What drivers of different age call images that are packed, and others."""
FULL_8_BITS, FULL_16_BITS = 255.0, 65535.0
_INDI_URL = re.compile(r"//([^/:]+):(\d+)/(.+)")


class IndiCamera:
    """Asks for one exposure after another; indipyclient runs in a thread with its own loop."""

    def __init__(self, url: str, options: SourceOptions) -> None:
        """Connect. Raises BadInputError for a URL that is none, SattrackError where there is no camera."""
        named = _INDI_URL.fullmatch(url)
        if named is None:
            raise BadInputError(f"indi:{url}: write indi://HOST:PORT/NAME, with the name of the INDI device")
        package = needed("indipyclient", f"indi:{url}", "indi")
        # It reports each attempt to connect, and its own exceptions with their tracebacks.
        logging.getLogger("indipyclient").setLevel(logging.CRITICAL)
        needed("astropy.io.fits", "reading FITS", "camera")
        self._url, self._device, self._options = f"indi:{url}", unquote(named[3]), options
        self._cut_off: float | None = None
        self.exposure_s: float | None = options.exposure_s or START_EXPOSURE_S
        # One image is asked for. A driver that others let stream sends more, and those fill the memory.
        self._blobs: queue.Queue[bytes] = queue.Queue(1)
        self._client = self._made(package, named[1], int(named[2]))
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._serve, name="INDI", daemon=True)
        self._thread.start()
        try:
            self._find()
        except SattrackError:
            self.close()
            raise

    def _made(self, package: Any, host: str, port: int) -> Any:
        blobs, device = self._blobs, self._device

        class BlobClient(package.IPyClient):  # type: ignore[misc]
            async def rxevent(self, event: Any) -> None:
                if event.eventtype == "SetBLOB" and event.devicename == device:
                    for member in event.values():
                        with contextlib.suppress(queue.Full):
                            blobs.put_nowait(bytes(member))

        client = BlobClient(indihost=host, indiport=port)
        client.enable_reports = False
        return client

    def _serve(self) -> None:
        # The runner closes the loop.
        with asyncio.Runner(loop_factory=lambda: self._loop) as runner:
            runner.run(self._client.asyncrun())

    def _find(self) -> None:
        until_s = time.monotonic() + FOUND_WITHIN_S
        asked = False
        while time.monotonic() < until_s:
            device = self._client.data.get(self._device)
            if device is not None and "CCD_EXPOSURE" in device:
                self._send("BLOB_ENABLE", {})
                return
            if device is not None and "CONNECTION" in device and not asked:
                asked = True
                self._send("CONNECTION", {"CONNECT": "On", "DISCONNECT": "Off"})
            time.sleep(0.05)
        if not self._client.connected:
            raise SattrackError(f"{self._url}: nothing answers there; check that indiserver runs")
        known = ", ".join(self._client.data) or "no device"
        raise SattrackError(f"{self._url}: no camera of that name; the server has {known}")

    def _send(self, vector: str, members: dict[str, Any]) -> None:
        client, device = self._client, self._device

        async def send() -> None:
            if vector == "BLOB_ENABLE":
                await client.send_enableBLOB("Also", device)
            else:
                await client.send_newVector(device, vector, members=members)

        asyncio.run_coroutine_threadsafe(send(), self._loop).result(READ_WITHIN_S)

    def frames(self) -> Iterator[CameraFrame | SattrackError]:
        """See FrameSource."""
        number = 0
        while True:
            number += 1
            exposure_s = self.exposure_s or START_EXPOSURE_S
            while not self._blobs.empty():
                self._blobs.get()
            self._ask_for_plain_images()
            self._send("CCD_EXPOSURE", {"CCD_EXPOSURE_VALUE": f"{exposure_s:g}"})
            begun = self._options.now()
            try:
                data = self._blobs.get(timeout=exposure_s + READ_WITHIN_S)
            except queue.Empty:
                yield SattrackError(f"{self._url}: no frame came within {READ_WITHIN_S:g} s")
                try:
                    # A server that was started again has forgotten that its camera was wanted.
                    self._find()
                except SattrackError as error:
                    yield error
                continue
            try:
                yield self._frame(data, begun, exposure_s, number)
            except SattrackError as error:
                yield error

    def _ask_for_plain_images(self) -> None:
        """Have the driver send images as they are, where it is set to pack them."""
        device = self._client.data.get(self._device)
        vector = {} if device is None else device.get("CCD_COMPRESSION", {})
        for packed, plain in PACKINGS:
            if vector.get(packed) == "On":
                self._send("CCD_COMPRESSION", {packed: "Off", plain: "On"})

    def _frame(self, data: bytes, begun: Utc, exposure_s: float, number: int) -> CameraFrame:
        header, image = fits_image(io.BytesIO(data), self._url)
        pixels = grey_image(image, self._url)
        name = f"frame {number}"
        dated = any(key in header for key in ("DATE-OBS", "DATE-BEG", "DATE-AVG"))
        gain = next((found[0] for one in GAINS if (found := self._number(*one)) is not None), None)
        if gain is not None:
            header.setdefault("GAIN", gain)
        utc = begun.plus(0.5 * exposure_s)
        if dated:
            said = fits_exposure(header, name, exposure_s)
            exposure_s = said.exposure_s
            # A date that is cut off at a second is worse than ours.
            utc = begun.plus(0.5 * exposure_s) if said.decimal_s > COARSE_S else said.utc
        top_down = str(header.get("ROWORDER", "")).strip().upper() == "TOP-DOWN"
        # One that is cut off shows where of those that come after it, too.
        self._cut_off = full_scale(pixels, self._cut_off)
        fulls = [] if self._cut_off is None else [self._cut_off]
        if header.get("BITPIX") == 8:
            fulls.append(FULL_8_BITS)
        elif header.get("BZERO") == 32768:
            fulls.append(FULL_16_BITS)
        return CameraFrame(
            np.ascontiguousarray(pixels[::-1] if top_down else pixels, dtype=np.float32),
            utc.plus(-self._options.latency_s),
            exposure_s,
            name,
            min(fulls, default=None),
            header,
        )

    def adjust(self, factor: float) -> None:
        """See FrameSource: the exposure first, then the gain, as far as the driver has one."""
        if self._options.exposure_s is not None or self.exposure_s is None:
            return
        exposure = self._number("CCD_EXPOSURE", "CCD_EXPOSURE_VALUE")
        exposures_s = AUTO_S if exposure is None or exposure[2] <= exposure[1] else exposure[1:]
        gain = next(((*name, found) for name in GAINS if (found := self._number(*name)) is not None), None)
        value, gains = (None, None) if gain is None else (gain[2][0], gain[2][1:])
        self.exposure_s, wanted = more_light(self.exposure_s, factor, exposures_s, value, gains)
        if gain is not None and wanted is not None and wanted != value:
            self._send(gain[0], {gain[1]: f"{wanted:g}"})

    def _number(self, vector: str, member: str) -> tuple[float, float, float] | None:
        """Return a number of the driver's with its bounds; None where it has none of that name."""
        device = self._client.data.get(self._device)
        if device is None or vector not in device:
            return None
        found = device[vector].data.get(member)
        if found is None:
            return None
        return (
            float(found.getfloatvalue()),
            float(found.getfloat(found.min)),
            float(found.getfloat(found.max)),
        )

    def close(self) -> None:
        """See FrameSource."""
        self._client.shutdown()
        self._thread.join(5.0)
