"""A camera of an INDI server, through indipyclient: frames come as FITS in BLOBs."""

from __future__ import annotations

import asyncio
import io
import queue
import re
import threading
import time
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

import numpy as np

from sattrack.camera.frames import AUTO_S, START_EXPOSURE_S, CameraFrame, fits_exposure, grey, more_light
from sattrack.core.errors import BadInputError, SattrackError, needed

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sattrack.camera.sources import SourceOptions
    from tle.instants import Utc

FOUND_WITHIN_S = 10.0
READ_WITHIN_S = 20.0
GAINS = (("CCD_GAIN", "GAIN"), ("CCD_CONTROLS", "Gain"))
"""Where drivers have the gain: a vector of its own, or among the camera's other controls."""
FULL_8_BITS, FULL_16_BITS = 255.0, 65535.0
_URL = re.compile(r"//([^/:]+):(\d+)/(.+)")


class IndiCamera:
    """Asks for one exposure after another; indipyclient runs in a thread with its own loop."""

    def __init__(self, url: str, options: SourceOptions) -> None:
        """Connect. Raises BadInputError for a URL that is none, SattrackError where there is no camera."""
        named = _URL.fullmatch(url)
        if named is None:
            raise BadInputError(f"indi:{url}: write indi://HOST:PORT/NAME, with the name of the INDI device")
        package = needed("indipyclient", f"indi:{url}", "indi")
        needed("astropy.io.fits", "reading FITS", "camera")
        self._url, self._device, self._options = f"indi:{url}", unquote(named[3]), options
        self.exposure_s: float | None = options.exposure_s or START_EXPOSURE_S
        self._blobs: queue.SimpleQueue[bytes] = queue.SimpleQueue()
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
                        blobs.put(bytes(member))

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
            self._send("CCD_EXPOSURE", {"CCD_EXPOSURE_VALUE": f"{exposure_s:g}"})
            begun = self._options.now()
            try:
                data = self._blobs.get(timeout=exposure_s + READ_WITHIN_S)
            except queue.Empty:
                yield SattrackError(f"{self._url}: no frame came within {READ_WITHIN_S:g} s")
                continue
            try:
                yield self._frame(data, begun, exposure_s, number)
            except SattrackError as error:
                yield error

    def _frame(self, data: bytes, begun: Utc, exposure_s: float, number: int) -> CameraFrame:
        fits = needed("astropy.io.fits", "reading FITS", "camera")
        try:
            with fits.open(io.BytesIO(data)) as file:
                header = {key: file[0].header[key] for key in file[0].header if key}
                pixels = grey(np.asarray(file[0].data))
        except (OSError, ValueError, TypeError) as error:
            raise SattrackError(f"{self._url}: its frame is no FITS image: {error}") from None
        name = f"frame {number}"
        dated = any(key in header for key in ("DATE-OBS", "DATE-BEG", "DATE-AVG"))
        gain = next((found[0] for one in GAINS if (found := self._number(*one)) is not None), None)
        if gain is not None:
            header.setdefault("GAIN", gain)
        utc = begun.plus(0.5 * exposure_s)
        if dated:
            utc, exposure_s = fits_exposure(header, name, exposure_s)
        top_down = str(header.get("ROWORDER", "")).strip().upper() == "TOP-DOWN"
        return CameraFrame(
            np.ascontiguousarray(pixels[::-1] if top_down else pixels, dtype=np.float32),
            utc.plus(-self._options.latency_s),
            exposure_s,
            name,
            FULL_8_BITS
            if header.get("BITPIX") == 8
            else FULL_16_BITS
            if header.get("BZERO") == 32768
            else None,
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
