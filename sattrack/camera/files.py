"""Frames in files: FITS and PNG are read, FITS is written."""

from __future__ import annotations

import contextlib
import math
import re
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from sattrack.camera.frames import CameraFrame, fits_exposure, full_scale, grey, name_exposure, text_exposure
from sattrack.core.errors import BadInputError, SattrackError, needed

if TYPE_CHECKING:
    from numpy.typing import NDArray

FITS_SUFFIXES = {".fits", ".fit", ".fts"}
FITS_BEGINS = b"SIMPLE"
PNG_SUFFIXES = {".png"}
PLAIN_MODES = {"P": "RGB", "PA": "RGB", "LA": "L"}
"""What Pillow's kinds of images are read as that are neither grey nor of three colours."""
NAME_LONGEST = 100
"""Of a frame's own name, so many of its last characters are in the name of the file that keeps it."""
LONGEST_TEXT = 100_000
"""Bytes of the settings beside an image that are read."""
MOST_NUMBERS = 200_000_000
"""Pixels of a frame, times its colours: one that says it has more is not unpacked."""


def read_frame(path: Path, exposure_s: float | None, latency_s: float) -> CameraFrame:
    """Return the frame of a FITS or PNG file; its rows go upwards, its date is the middle of the exposure.

    `exposure_s` is that of a file that does not say it, `latency_s` how late the file's dates are. Raises
    BadInputError, naming the file, SattrackError.
    """
    # A pipe would be waited for.
    if not path.is_file():
        raise BadInputError(f"{path}: it is no file, or is gone")
    try:
        read = _read_fits if path.suffix.lower() in FITS_SUFFIXES else _read_png
        return read(path, exposure_s, latency_s)
    except (OSError, MemoryError) as error:
        raise _unreadable(path, "a frame", error) from None


def _read_fits(path: Path, exposure_s: float | None, latency_s: float) -> CameraFrame:
    with path.open("rb") as stream:
        header, pixels = fits_image(stream, str(path))
    exposure = fits_exposure(header, str(path), exposure_s)
    top_down = str(header.get("ROWORDER", "")).strip().upper() == "TOP-DOWN"
    image = grey_image(pixels, path)
    said = header.get("SATURATE")
    full = _full_scale(pixels.dtype, header)
    if isinstance(said, int | float) and not isinstance(said, bool) and said > 0.0:
        full = float(said)
    return CameraFrame(
        image[::-1] if top_down else image,
        exposure.utc.plus(-latency_s),
        exposure.exposure_s,
        path.name,
        full_scale(image, full),
        header,
        exposure.decimal_s,
    )


def fits_image(stream: BinaryIO, name: str) -> tuple[dict[str, Any], NDArray[Any]]:
    """Return header and pixels of the first image of a FITS file; raises BadInputError, SattrackError."""
    fits = needed("astropy.io.fits", f"{name}: reading FITS", "camera")
    # The library also unpacks other files, whatever comes out of them.
    if stream.read(len(FITS_BEGINS)) != FITS_BEGINS:
        raise BadInputError(f"{name}: it is no FITS file; unpack it first if it is packed")
    stream.seek(0)
    try:
        # What the library warns of either can be read or is refused below.
        with (
            warnings.catch_warnings(action="ignore"),
            fits.open(stream, memmap=False, disable_image_compression=True) as file,
        ):
            part = next((one for one in file if one.is_image and getattr(one, "shape", ())), None)
            if part is None:
                raise BadInputError(f"{name}: it has no image; unpack it first if it is packed")
            _check_size(math.prod(part.shape), name)
            # What an image does not say itself, the file's first header may say of all.
            header: dict[str, Any] = {}
            for one in (file[0].header, part.header):
                for key in filter(None, one):
                    # FITS has no NaN and no decimal comma; programs write both, for a missing sensor as well.
                    with contextlib.suppress(fits.VerifyError):
                        header[key] = one[key]
            return header, np.asarray(part.data)
    except BadInputError:
        raise
    except Exception as error:  # noqa: BLE001 - the library has no bounds on what it raises for broken files
        raise _unreadable(name, "FITS", error) from None


def _check_size(count: int, name: Path | str) -> None:
    if count > MOST_NUMBERS:
        raise BadInputError(f"{name}: it says that it has {count} pixels; {MOST_NUMBERS} are the most")


def _unreadable(name: Path | str, kind: str, error: Exception) -> BadInputError:
    # The libraries' words may have several lines, or none.
    words = " ".join(str(error).split()) or type(error).__name__
    return BadInputError(f"{name}: cannot be read as {kind}: {words}")


def _full_scale(kind: np.dtype[Any], header: dict[str, Any]) -> float | None:
    if kind.kind == "u":
        return float(np.iinfo(kind).max)
    # 16 bits without a sign are kept as 16 bits with one and an offset, which astropy takes out as floats.
    return 65535.0 if header.get("BZERO") == 32768 else None


def _read_png(path: Path, exposure_s: float | None, latency_s: float) -> CameraFrame:
    images = needed("PIL.Image", f"{path}: reading PNG", "camera")
    try:
        # The bound is ours, before anything is unpacked.
        images.MAX_IMAGE_PIXELS = None
        with images.open(path) as file:
            _check_size(math.prod(file.size) * len(file.getbands()), path)
            file.load()
            said = {key: str(value) for key, value in getattr(file, "text", {}).items()}
            # The numbers of a palette are no light, and transparency is none.
            plain = PLAIN_MODES.get(file.mode)
            pixels = np.asarray(file if plain is None else file.convert(plain))
    except BadInputError:
        raise
    except Exception as error:  # noqa: BLE001 - the library has no bounds on what it raises for broken files
        raise _unreadable(path, "PNG", error) from None
    exposure = None
    if any(key.upper().startswith("DATE-") for key in said):
        exposure = fits_exposure({key.upper(): value for key, value in said.items()}, str(path), exposure_s)
    for beside in (path.with_suffix(".CameraSettings.txt"), path.with_suffix(".txt")):
        if exposure is None and beside.is_file():
            with beside.open("rb") as stream:
                text = stream.read(LONGEST_TEXT).decode("utf-8", "replace")
            exposure = text_exposure(text, str(beside), exposure_s)
    if exposure is None:
        exposure = name_exposure(path.stem, str(path), exposure_s)
    if exposure is None:
        raise BadInputError(
            f"{path}: nothing dates it: no DATE-OBS in it, no settings of SharpCap or FireCapture beside it, "
            "no time in its name"
        )
    full = float(np.iinfo(pixels.dtype).max) if pixels.dtype.kind == "u" else None
    image = grey_image(pixels, path)[::-1]
    return CameraFrame(
        image,
        exposure.utc.plus(-latency_s),
        exposure.exposure_s,
        path.name,
        full_scale(image, full),
        decimal_s=exposure.decimal_s,
    )


def grey_image(pixels: NDArray[Any], path: Path | str) -> NDArray[np.float32]:
    """Return pixels, of colours their mean, as floats; raises BadInputError, naming where they come from."""
    try:
        return np.ascontiguousarray(grey(pixels), dtype=np.float32)
    except (ValueError, MemoryError) as error:
        raise _unreadable(path, "an image", error) from None


def save_frame(frame: CameraFrame, folder: Path, camera: str, solved: dict[str, float] | None) -> Path:
    """Write a frame as FITS, its first row at the bottom, with the headers of the field; return the file.

    `solved` may have SCALE, arcseconds in a pixel: where the size of the pixels is known, FOCALLEN goes with
    it. Raises SattrackError.
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
    # FITS has ASCII only.
    header["INSTRUME"] = camera.encode("ascii", "replace").decode()
    for key in ("GAIN", "OFFSET", "XPIXSZ", "YPIXSZ", "EGAIN", "CCD-TEMP", "XBINNING", "YBINNING"):
        if key in frame.header:
            header[key] = frame.header[key]
    if frame.saturation is not None:
        # Whole numbers are kept as 16 bits, whatever the camera has.
        header["SATURATE"] = (frame.saturation, "value of a full pixel")
    for key, value in (solved or {}).items():
        header[key] = value
    size_um = header.get("XPIXSZ")
    if "SCALE" in header and isinstance(size_um, int | float) and size_um > 0.0:
        header["FOCALLEN"] = (size_um * 1e-3 / math.radians(header["SCALE"] / 3600.0), "[mm]")
    name = begun.isoformat("milliseconds").replace(":", "").replace("-", "").replace(".", "_")
    # Two cameras of a run keep their frames in one folder, and some date several frames alike.
    whose = re.sub(r"[^\w.-]", "_", f"{camera}_{Path(frame.name).stem[-NAME_LONGEST:]}")
    path = folder / f"{name}_{whose}.fits"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        part.writeto(path, overwrite=True)
    except OSError as error:
        raise SattrackError(f"{path}: cannot be written: {error.strerror or error}") from None
    return path
