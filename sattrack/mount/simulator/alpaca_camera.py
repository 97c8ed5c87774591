"""The simulated camera as an ASCOM Alpaca device without I/O: ICameraV4's members. Time is an argument.

Source: ASCOM Alpaca API and "Alpaca ImageBytes" of the ASCOM Initiative: an image array has columns first,
[x][y], its origin at the top left.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from sattrack.mount.simulator.alpaca_telescope import INVALID_OPERATION, INVALID_VALUE, RefusedError
from sattrack.mount.simulator.camera import MOST_ADU, MOST_GAIN, PIXEL_UM, SENSOR
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

    from sattrack.mount.simulator.camera import RenderedFrame, SkyCamera

NOT_IMPLEMENTED = 0x400
LEAST_S, MOST_S = 0.0001, 600.0
MOST_BIN = 4
IDLE, EXPOSING, READING = 0, 2, 3
INT32, UINT16 = 2, 8
IMAGE_HEADER = struct.Struct("<iiIIiiiiiii")
TRUE = {"true": True, "false": False}
WHOLE_NUMBERS = ("BinX", "BinY", "NumX", "NumY", "StartX", "StartY", "Gain", "ReadoutMode")


class RunningExposure(NamedTuple):
    """An exposure as it was asked for: its start in truth, its length, and what of the sensor is read."""

    start_utc_s: float
    seconds: float
    gain: int
    binning: int
    left: int
    top: int
    width: int
    height: int

    def cut(self, frame: RenderedFrame) -> NDArray[np.uint16]:
        """Return the image array, [x][y], of a picture of the whole sensor."""
        pixels, bins = frame.pixels, self.binning
        if bins > 1:
            high, wide = pixels.shape[0] // bins, pixels.shape[1] // bins
            whole = pixels[: high * bins, : wide * bins].reshape(high, bins, wide, bins)
            pixels = np.minimum(whole.sum(axis=(1, 3), dtype=np.uint32), MOST_ADU).astype(np.uint16)
        window = pixels[self.top : self.top + self.height, self.left : self.left + self.width]
        return np.ascontiguousarray(window.T)


@dataclass(slots=True)
class SimulatedAlpacaCamera:
    """Camera 0. Whoever serves it takes the picture of `exposure` when that has ended, and delivers it."""

    camera: SkyCamera
    kind = "camera"
    name = "Simulated camera"
    unique_id = "8b3e2f50-5c0f-4f0e-9f37-0d1a52f7c6e2"
    connected: bool = False
    exposure: RunningExposure | None = None
    image: NDArray[np.uint16] | None = None
    _settings: dict[str, int] | None = None
    _last: tuple[RunningExposure, RenderedFrame] | None = None
    _failure: str | None = None

    def ask(self, member: str, _: Mapping[str, str], now: float) -> Any:
        """Return the value of a member. Raises RefusedError."""
        still, moving = self._still(), self._moving(now)
        if member in still:
            return still[member]
        if member not in moving:
            raise RefusedError(NOT_IMPLEMENTED, f"{member} is not implemented")
        return moving[member]()

    def change(self, member: str, fields: Mapping[str, str], now: float) -> None:
        """Set a member or do what it asks. Raises RefusedError, and KeyError or ValueError for bad fields."""
        names = {name.lower(): name for name in WHOLE_NUMBERS}
        if member in ("connected", "connect", "disconnect"):
            self.connected = (
                TRUE[fields["Connected"].lower()] if member == "connected" else member == "connect"
            )
        elif member in names:
            self._set(names[member], int(fields[names[member]]))
        elif member == "startexposure":
            self._start(float(fields["Duration"]), now)
        elif member == "stopexposure":
            if self.exposure is not None:
                self.exposure = self.exposure._replace(
                    seconds=max(LEAST_S, min(self.exposure.seconds, now - self.exposure.start_utc_s))
                )
        elif member == "abortexposure":
            self.exposure = None
        else:
            raise RefusedError(NOT_IMPLEMENTED, f"{member} is not implemented")

    def deliver(
        self, exposure: RunningExposure, frame: RenderedFrame | None, failure: str | None = None
    ) -> None:
        """Take the picture of an exposure, or why there is none; one that was aborted is dropped."""
        if self.exposure != exposure:
            return
        self.exposure, self._failure = None, failure
        if frame is not None:
            self.image, self._last = exposure.cut(frame), (exposure, frame)

    def image_bytes(self, client_transaction: int, server_transaction: int) -> bytes:
        """Return the image in the form ImageBytes. Raises RefusedError."""
        image = self._image()
        head = (
            1,
            0,
            client_transaction,
            server_transaction,
            IMAGE_HEADER.size,
            INT32,
            UINT16,
            2,
            *image.shape,
            0,
        )
        return IMAGE_HEADER.pack(*head) + image.tobytes()

    def _image(self) -> NDArray[np.uint16]:
        if self.image is None:
            raise RefusedError(INVALID_OPERATION, self._failure or "No image is ready")
        return self.image

    def _values(self) -> dict[str, int]:
        if self._settings is None:
            size = self.camera.settings
            self._settings = {
                "BinX": 1,
                "BinY": 1,
                "NumX": size.width,
                "NumY": size.height,
                "StartX": 0,
                "StartY": 0,
                "Gain": 0,
                "ReadoutMode": 0,
            }
        return self._settings

    def _still(self) -> dict[str, Any]:
        """Return the members that do not depend on time."""
        size, values = self.camera.settings, self._values()
        return {
            "name": self.name,
            "description": "A rendered sky on a simulated mount",
            "driverinfo": "sattrack sim --camera",
            "driverversion": "1",
            "interfaceversion": 4,
            "supportedactions": [],
            "connected": self.connected,
            "connecting": False,
            "cameraxsize": size.width,
            "cameraysize": size.height,
            "maxbinx": MOST_BIN,
            "maxbiny": MOST_BIN,
            "canasymmetricbin": False,
            "canabortexposure": True,
            "canstopexposure": True,
            "canpulseguide": False,
            "canfastreadout": False,
            "cangetcoolerpower": False,
            "cansetccdtemperature": False,
            "hasshutter": False,
            "maxadu": MOST_ADU,
            "electronsperadu": self.camera.electrons_per_adu(values["Gain"]),
            "fullwellcapacity": self.camera.hidden.full_well,
            "exposuremin": LEAST_S,
            "exposuremax": MOST_S,
            "exposureresolution": 1e-6,
            "gainmin": 0,
            "gainmax": MOST_GAIN,
            "pixelsizex": PIXEL_UM,
            "pixelsizey": PIXEL_UM,
            "readoutmodes": ["Normal"],
            "sensorname": SENSOR,
            "sensortype": 0,
            **{name.lower(): value for name, value in values.items()},
        }

    def _moving(self, now: float) -> dict[str, Callable[[], Any]]:
        """Return the members that tell of the exposure."""

        def ready() -> bool:
            if self._failure is not None:
                raise RefusedError(INVALID_OPERATION, self._failure)
            return self.image is not None

        return {
            "camerastate": lambda: self._state(now),
            "imageready": ready,
            "percentcompleted": lambda: self._percent(now),
            "imagearray": lambda: self._image().tolist(),
            "imagearrayvariant": lambda: self._image().tolist(),
            "lastexposureduration": lambda: self._taken()[0].seconds,
            "lastexposurestarttime": lambda: Utc(self._taken()[1].utc_s).isoformat().removesuffix("Z"),
            "devicestate": lambda: [
                {"Name": name, "Value": value}
                for name, value in (
                    ("CameraState", self._state(now)),
                    ("ImageReady", self.image is not None),
                    (
                        "PercentCompleted",
                        self._percent(now) if self.exposure or self.image is not None else 0,
                    ),
                )
            ],
        }

    def _taken(self) -> tuple[RunningExposure, RenderedFrame]:
        if self._last is None:
            raise RefusedError(INVALID_OPERATION, "No exposure has been made")
        return self._last

    def _state(self, now: float) -> int:
        if self.exposure is None:
            return IDLE
        return EXPOSING if now < self.exposure.start_utc_s + self.exposure.seconds else READING

    def _percent(self, now: float) -> int:
        if self.exposure is not None:
            return int(
                max(0.0, min(100.0, 100.0 * (now - self.exposure.start_utc_s) / self.exposure.seconds))
            )
        if self.image is None:
            raise RefusedError(INVALID_OPERATION, "No exposure is in progress")
        return 100

    def _set(self, name: str, value: int) -> None:
        least, most = {
            "BinX": (1, MOST_BIN),
            "BinY": (1, MOST_BIN),
            "Gain": (0, MOST_GAIN),
            "ReadoutMode": (0, 0),
        }.get(name, (0, 1 << 30))
        if not least <= value <= most:
            raise RefusedError(INVALID_VALUE, f"{name} {value} is outside {least} to {most}")
        self._values()[name] = value
        if name in ("BinX", "BinY"):
            self._values()["BinX"] = self._values()["BinY"] = value

    def _start(self, seconds: float, now: float) -> None:
        values, size = self._values(), self.camera.settings
        if self.exposure is not None:
            raise RefusedError(INVALID_OPERATION, "An exposure is in progress")
        if not LEAST_S <= seconds <= MOST_S:
            raise RefusedError(INVALID_VALUE, f"Duration {seconds:g} is outside {LEAST_S:g} to {MOST_S:g} s")
        bins = values["BinX"]
        for start, number, most in (
            ("StartX", "NumX", size.width // bins),
            ("StartY", "NumY", size.height // bins),
        ):
            if not (values[number] > 0 and values[start] + values[number] <= most):
                raise RefusedError(INVALID_VALUE, f"{start} and {number} leave the sensor's {most} pixels")
        window = (values[name] for name in ("StartX", "StartY", "NumX", "NumY"))
        self.exposure = RunningExposure(now, seconds, values["Gain"], bins, *window)
        self.image = self._failure = None
