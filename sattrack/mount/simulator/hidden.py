"""What users know of a simulated camera, and what is hidden from those who use it: settings without numpy."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Literal

import msgspec

from sattrack.core.errors import BadInputError, refused_key

if TYPE_CHECKING:
    from sattrack.mount.model import MountProfile


class SimulatedCamera(msgspec.Struct, frozen=True):
    """What a user knows of the camera: arcseconds per pixel at the centre, and its size in pixels."""

    scale_arcsec_px: float = 2.5
    width: int = 1280
    height: int = 960

    @classmethod
    def parse(cls, text: str) -> SimulatedCamera:
        """Return the settings of "SCALE" or "SCALE,WIDTH,HEIGHT". Raises BadInputError."""
        parts = text.split(",")
        try:
            if len(parts) == 1:
                made = cls(float(text))
            else:
                scale, width, height = parts
                made = cls(float(scale), int(width), int(height))
        except ValueError:
            raise BadInputError(
                f"--camera {text}: write SCALE or SCALE,WIDTH,HEIGHT (arcseconds per pixel, pixels), "
                "e.g. 2.5,1280,960"
            ) from None
        if not 0.01 <= made.scale_arcsec_px <= 600.0:
            raise BadInputError(f"--camera {text}: the scale goes from 0.01 to 600 arcseconds per pixel")
        if not (16 <= made.width <= 10000 and 16 <= made.height <= 10000):
            raise BadInputError(f"--camera {text}: width and height go from 16 to 10000 pixels")
        return made


Share = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
Positive = Annotated[float, msgspec.Meta(gt=0.0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0.0)]


class Hidden(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What no client knows, by the keys of `--hidden`; units are those of `GRAMMAR`."""

    along: float = 0.0
    along_drift: float = 0.0
    along_curve: float = 0.0
    cross: float = 0.0
    cross_drift: float = 0.0
    magnitude: float = 5.0
    shadow: Literal[0, 1] = 1
    polar_az: float = 0.0
    polar_alt: float = 0.0
    ha: float = 0.0
    dec: float = 0.0
    cone: float = 0.0
    leaning: float = 0.0
    flexure: float = 0.0
    ha_wave: str = ""
    dec_wave: str = ""
    rotation: float = 0.0
    mirror: Literal[0, 1] = 0
    scale: Annotated[float, msgspec.Meta(ge=0.1, le=10.0)] = 1.0
    clock: float = 0.0
    split: Annotated[float, msgspec.Meta(ge=-1000.0, le=1000.0)] = 0.0
    clouds: str = ""
    plane: float | None = None
    cloudiness: Share = 0.0
    jitter: NotNegative = 0.0
    fwhm: Positive = 5.0
    sky: float = 20.0
    zero_point: float = 20.0
    read_noise: NotNegative = 2.5
    full_well: Positive = 30000.0
    bias: Annotated[float, msgspec.Meta(ge=0.0, le=60000.0)] = 500.0
    hot: Annotated[int, msgspec.Meta(ge=0, le=100000)] = 40
    faint: Annotated[float, msgspec.Meta(ge=0.0, le=500.0)] = 0.0
    pressure: Annotated[float, msgspec.Meta(ge=0.0, le=1200.0)] | None = None
    temperature: Annotated[float, msgspec.Meta(ge=-100.0, le=60.0)] | None = None

    def __post_init__(self) -> None:
        """Raise ValueError where a number is none, or clouds or waves cannot be read."""
        for name in self.__struct_fields__:
            value = getattr(self, name)
            if isinstance(value, float) and not math.isfinite(value):
                raise ValueError(f"{name} is {value:g}; it must be a number")
        cloud_windows(self.clouds)
        waves(self.ha_wave)
        waves(self.dec_wave)


GRAMMAR = (
    ("along=3", "s; the satellite is this much ahead of its elements at the start"),
    ("along_drift=0.3", "s/min"),
    ("along_curve=0.01", "s/min²"),
    ("cross=60", "arcsec across its path, along û x m̂ (direction x motion) as --bias-cross"),
    ("cross_drift=10", "arcsec/min"),
    ("magnitude=5", "of the satellite in sunlight"),
    ("shadow=0", "the satellite shines in the Earth's shadow too"),
    (
        "polar_az=3",
        "arcmin; the mount's pole is this far east of the true one; an azimuth axis is tilted east",
    ),
    ("polar_alt=4", "arcmin; the mount's pole is this far too high; an azimuth axis is tilted north"),
    ("ha=20", "arcsec; the hour angle axis points this far west of what it says"),
    ("dec=20", "arcsec; the declination axis points this far north of what it says"),
    ("cone=30", "arcsec; the camera looks this far west of square to the declination axis"),
    ("leaning=60", "arcsec; the west end of the declination axis leans this far to the north"),
    ("flexure=30", "arcsec; the tube sinks this far when it is level"),
    (
        "ha_wave=10x7@40",
        "arcsec, a turn, degrees; the hour angle axis points 10″ sin(7 angle + 40°) west of what it says. "
        "Several are joined by +",
    ),
    ("dec_wave=10x7@40", "the same of the declination axis, to the north"),
    ("rotation=12", "degrees; position angle of the image's +y, north through east"),
    ("mirror=1", "the image is mirrored, left and right swapped"),
    ("scale=1.02", "factor on the arcseconds per pixel"),
    ("clock=0.3", "s; the camera's clock is this much ahead"),
    ("split=-20", "ms; of the delays of the mount's profile, commands take this much more and statuses less"),
    ("clouds=20-40+60-70", "s after the start; nothing is seen through them"),
    ("plane=30", "s after the start; a plane with blinking lights crosses the middle of the picture"),
    ("cloudiness=0.3", "0 to 1; clouds that come and go, from the seed"),
    ("jitter=0.5", "arcsec; each frame is off at random, one sigma in x and in y"),
    ("fwhm=5", "arcsec; width of a star by air and optics"),
    ("sky=20", "mag/arcsec²; brightness of the sky"),
    ("zero_point=20", "magnitude that gives one electron a second"),
    ("read_noise=2.5", "electrons"),
    ("full_well=30000", "electrons"),
    ("bias=500", "ADU without light"),
    ("hot=40", "number of hot pixels"),
    ("faint=60", "made-up stars of magnitude 10 to 13 a square degree"),
    ("pressure=1010", "hPa at the site; default: standard air"),
    ("temperature=10", "°C"),
)
"""What may be hidden: an example of each, and what it means."""


def parse_hidden(text: str) -> Hidden:
    """Read `KEY=VALUE,...` of `GRAMMAR`. Raises BadInputError, naming the key and what may stand there."""
    values: dict[str, str] = {}
    for part in filter(None, (word.strip() for word in text.split(","))):
        key, mark, value = part.partition("=")
        if key not in Hidden.__struct_fields__:
            raise BadInputError(
                f"--hidden {part}: no key is called {key!r}; there are {', '.join(Hidden.__struct_fields__)}"
            )
        if not mark or key in values:
            raise BadInputError(f"--hidden {part}: {'given twice' if mark else f'write {key}=VALUE'}")
        values[key] = value.strip()
    try:
        return msgspec.convert(values, Hidden, strict=False)
    except msgspec.ValidationError as error:
        words, key = refused_key(error)
        if not key:
            raise BadInputError(f"--hidden {text}: {words}") from None
        example = next(one for one, _ in GRAMMAR if one.startswith(f"{key}="))
        wanted, _, _ = words.partition(", got ")
        for kind, plain in (("float", "a number"), ("int", "a whole number"), ("bool", "0 or 1")):
            wanted = wanted.replace(f"Expected `{kind}`", f"give {plain}")
        raise BadInputError(f"--hidden {key}={values[key]}: {wanted}, as {example}") from None


def cloud_windows(text: str) -> list[tuple[float, float]]:
    """Return the windows of `20-40+60-70`, seconds. Raises ValueError."""
    try:
        windows = [
            (float(low), float(high)) for low, high in (one.split("-") for one in text.split("+") if one)
        ]
    except ValueError:
        raise ValueError(f"clouds {text!r}: write seconds from and to, e.g. 20-40+60-70") from None
    if any(not 0.0 <= low < high for low, high in windows):
        raise ValueError(f"clouds {text!r}: each window needs a later end, e.g. 20-40")
    return windows


def waves(text: str) -> list[tuple[float, float, float]]:
    """Return the waves of `10x7@40+3x60`: arcseconds, cycles a turn, degrees. Raises ValueError."""
    found = []
    for one in filter(None, text.split("+")):
        size, _, rest = one.partition("x")
        cycles, _, phase = rest.partition("@")
        try:
            wave = float(size), float(cycles), float(phase or 0.0)
        except ValueError:
            wave = (math.nan,) * 3
        if not all(map(math.isfinite, wave)):
            raise ValueError(f"wave {one!r}: write arcseconds x cycles a turn @ degrees, e.g. 10x7@40")
        found.append(wave)
    return found


def split_delays_s(hidden: Hidden, profile: MountProfile) -> tuple[float, float]:
    """Return the true delays of commands and of statuses, seconds; none is below 0."""
    split_s = hidden.split / 1000.0
    return max(0.0, profile.command_delay_s + split_s), max(0.0, profile.status_delay_s - split_s)
