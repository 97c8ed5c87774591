"""How bright a satellite is, where somebody has measured how bright it is at a standard distance."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tle.errors import SourceError, printable

if TYPE_CHECKING:
    from tle.quantities import Quantity

_STANDARD_KM = 1000.0
_LARGEST_NUMBER = 999_999_999


def magnitude(intrinsic: Quantity, range_km: Quantity, phase_rad: Quantity) -> Quantity:
    """Return the apparent magnitude without air of a sphere that scatters light evenly (Lambert's law).

    `intrinsic` is the magnitude at 1000 km with half of the disc lit, the convention of observers' lists;
    `phase_rad` is the angle at the satellite between Sun and observer. A satellite with flat panels may
    differ by magnitudes, and flash. Formula: phase function of a diffuse sphere, (sin φ + (π - φ) cos φ),
    which is 1 at a right angle.
    """
    lit = np.sin(phase_rad) + (math.pi - phase_rad) * np.cos(phase_rad)
    return intrinsic + 5.0 * np.log10(range_km / _STANDARD_KM) - 2.5 * np.log10(np.maximum(lit, 1e-12))


def read_magnitudes(path: str | Path) -> dict[int, float]:
    """Return intrinsic magnitudes by catalogue number, from lines of those two numbers.

    More on a line, and lines that begin with `#`, are passed over. Raises SourceError, naming file and line.
    """
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        why = (error.strerror or str(error)) if isinstance(error, OSError) else "is not text"
        raise SourceError(f"{path}: cannot read magnitudes: {why}") from None
    known: dict[int, float] = {}
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split("#")[0].replace(",", " ").split()
        if not words:
            continue
        try:
            catalog_number, value = int(words[0]), float(words[1])
            if not math.isfinite(value) or not 0 < catalog_number <= _LARGEST_NUMBER:
                raise ValueError
        except (ValueError, IndexError):
            raise SourceError(
                f"{path}:{number}: {printable(line.strip())!r} is no magnitude: "
                "write catalogue number and intrinsic magnitude, as 25544 -1.8"
            ) from None
        known[catalog_number] = value
    return known
