"""A camera of an Alpaca server (ASCOM ICameraV3), with images as JSON or as ImageBytes."""

from __future__ import annotations

import re
import struct
import time
from typing import TYPE_CHECKING, Any

import numpy as np

from sattrack.camera.frames import AUTO_S, START_EXPOSURE_S, CameraFrame, grey, more_light, parse_utc
from sattrack.core.errors import BadInputError, SattrackError
from sattrack.mount.alpaca.client import AlpacaDevice, AlpacaRefusalError, NoAnswerError, value_in

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from sattrack.camera.sources import SourceOptions
    from tle.instants import Utc

POLL_S = 0.005
READ_WITHIN_S = 20.0
MOST_IMAGE_BYTES = 1 << 29
METADATA = struct.Struct("<iiIIiiiiiii")
ELEMENTS = {1: "<i2", 2: "<i4", 3: "<f8", 4: "<f4", 5: "<u8", 6: "u1", 7: "<i8", 8: "<u2", 9: "<u4"}
"""Types of the elements of ImageBytes, by their numbers (ASCOM Alpaca API Reference, ImageBytes)."""
_URL = re.compile(r"//([^/]+)/(\d+)/?")


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
        named = _URL.fullmatch(url)
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
        self._full = self._optional("maxadu")
        self._gain_per_unit = self._optional("electronsperadu")
        self._gains = tuple(self._optional(name) for name in ("gainmin", "gainmax", "gain"))

    def _optional(self, member: str) -> float | None:
        try:
            value = self._device.get(member)
        except (AlpacaRefusalError, NoAnswerError):
            return None
        return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None

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
            time.sleep(POLL_S)
        kind, body = self._device.get_body(
            "imagearray", "application/imagebytes, application/json", MOST_IMAGE_BYTES
        )
        pixels = grey(decode_image(kind, body))
        taken_s = self._optional("lastexposureduration")
        length_s = exposure_s if taken_s is None else taken_s
        header = {} if self._gain_per_unit is None else {"EGAIN": self._gain_per_unit}
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
        """Return when the exposure began, by the camera if it says so, else by us."""
        try:
            said = self._device.get("lastexposurestarttime")
        except AlpacaRefusalError:
            return by_us
        try:
            return parse_utc(str(said), "its lastexposurestarttime")
        except BadInputError as error:
            raise NoAnswerError(str(error)) from None

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

    def close(self) -> None:
        """See FrameSource: end an exposure that goes on; others may use the camera."""
        try:
            self._device.put("abortexposure")
        except (AlpacaRefusalError, NoAnswerError):
            return
