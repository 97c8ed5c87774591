"""Messages to a run, to its session, and to a manual console: one JSON object a line.

To a run, from an operator or a camera's program:

`{"type":"nudge","along_s":0.1}`, `{"type":"clear_bias"}`, `{"type":"drop_remembered"}`, `{"type":"stop"}`,
`{"type":"pause"}`, `{"type":"jog","dec_rate_deg_s":0.1}`, `{"type":"go"}`, `{"type":"slip","seconds":60}`,
`{"type":"offset","what":"along_s","how":"add","value":0.5}`,
`{"type":"guide","how":"off"}`,
`{"type":"search","how":"spiral","spacing_deg":0.05,"speed_deg_s":0.05}`,
`{"type":"observation","utc":"2026-10-02T13:05:24.5Z","ra_deg":1.2,"dec_deg":3.4,"frame":"icrs",
"sigma_arcsec":20}`,
`{"type":"field","utc":"2026-10-02T13:05:24.5Z","ra_deg":1.2,"dec_deg":3.4,"sigma_arcsec":2,"camera":"guide"}`,
`{"type":"offset","utc":"2026-10-02T13:05:24.5Z","dx_arcsec":12.5,"dy_arcsec":-3,"sigma_arcsec":2}`,
`{"type":"offset","utc":"2026-10-02T13:05:24.5Z","dx_px":8.3,"dy_px":-2,"sigma_px":0.2,"camera":"guide"}`,
`{"type":"fix","utc":"2026-10-02T13:05:24.5Z","lat_deg":52.2,"lon_deg":4.6,"height_m":9000,"east_m_s":220}`.

About its control: `{"type":"take_control"}`, `{"type":"yield_control"}`, `{"type":"leave_running"}`,
`{"type":"arm","catalog_number":25544,"culminate_utc_s":1790946324.4}`.

To a manual console: `{"type":"slew","ra_deg":82.5,"dec_deg":-12.5}`, `{"type":"jog","dec_rate_deg_s":0.1}`,
`{"type":"abort"}`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypeVar, get_args

import msgspec

from sattrack.core.errors import NO_JSON
from sattrack.mount.model import Slew
from sattrack.mount.requests import Abort, FindHome, Park, Sync
from tle.errors import TimeFormatError
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Collection

    from tle.observed import Frame

T = TypeVar("T")
Quantity = Literal[
    "along_s",
    "cross_deg",
    "ra_cos_dec_deg",
    "dec_deg",
    "ra_axis_deg",
    "dec_axis_deg",
    "camera_x_deg",
    "camera_y_deg",
]
"""What can be offset: along the track in seconds, across it; right ascension on the sky and declination; the
axes' own angles; the camera's two directions. Degrees but for the first."""
How = Literal["add", "set", "rate", "gradual", "stop", "reset"]
SearchHow = Literal["spiral", "sweep", "auto", "stop", "cancel"]
GuideHow = Literal["on", "off", "accept", "reject"]
FRAMES: dict[str, Frame] = {"icrs": "icrf", "j2000": "j2000", "of_date": "of_date"}
"""The frames of observations, and what `tle` calls them."""
MOST_SLIP_S = 86400.0
MOST_FIX_M_S = 10000.0
MOST_SIGMA_ARCSEC = 3600.0
LEAST_SIGMA_ARCSEC = 0.01
LEAST_SIGMA_PX = 0.001
MOST_OFFSET_ARCSEC = 18000.0
MOST_OFFSET_PX = 1e5
MOST_SCALE_ARCSEC_PX = 3600.0


class Nudge(msgspec.Struct, frozen=True, tag="nudge", forbid_unknown_fields=True):
    """Move the target: seconds along its track, degrees across it, added to what is in force."""

    along_s: float = 0.0
    cross_deg: float = 0.0


class ClearBias(msgspec.Struct, frozen=True, tag="clear_bias", forbid_unknown_fields=True):
    """Take all offsets, the search and the estimate away."""


class DropRemembered(msgspec.Struct, frozen=True, tag="drop_remembered", forbid_unknown_fields=True):
    """Take away the bias that was remembered from an earlier pass, and what is offered after this one."""


class StopNow(msgspec.Struct, frozen=True, tag="stop", forbid_unknown_fields=True):
    """Stop the mount and end the run."""


class Pause(msgspec.Struct, frozen=True, tag="pause", forbid_unknown_fields=True):
    """Bring the mount to rest and go on with the run; a search that runs ends where it is."""


class Go(msgspec.Struct, frozen=True, tag="go", forbid_unknown_fields=True):
    """Go on with a run that is paused: onto the satellite again, where it is then."""


class Jog(msgspec.Struct, frozen=True, tag="jog", forbid_unknown_fields=True):
    """While the run is paused, move an axis, or both, for a short time; said again, for longer.

    Rates are those that an axis has beyond its rest, of right ascension (positive east) and declination
    (positive north), degrees a second; None leaves an axis alone.
    """

    ra_rate_deg_s: float | None = None
    dec_rate_deg_s: float | None = None


class Slip(msgspec.Struct, frozen=True, tag="slip", forbid_unknown_fields=True):
    """The T0 of the launch that is followed is later by so many seconds than was known; negative: earlier."""

    seconds: float

    def __post_init__(self) -> None:
        """Raise ValueError for more than MOST_SLIP_S."""
        if not abs(self.seconds) <= MOST_SLIP_S:
            raise ValueError(f"seconds {self.seconds:g} is outside -{MOST_SLIP_S:g} to {MOST_SLIP_S:g}")


class PlaceFix(msgspec.Struct, frozen=True, tag="fix", forbid_unknown_fields=True):
    """Where what is followed by its own reports was, and how it moved: WGS 84, metres and metres a second."""

    utc: str
    lat_deg: float
    lon_deg: float
    height_m: float
    east_m_s: float = 0.0
    north_m_s: float = 0.0
    up_m_s: float = 0.0

    def __post_init__(self) -> None:
        """Raise ValueError for what is no instant, no place, or faster than anything that reports so."""
        _check_utc(self.utc)
        if not (abs(self.lat_deg) <= 89.9 and abs(self.lon_deg) <= 360.0 and abs(self.height_m) <= 1e6):
            raise ValueError("lat_deg, lon_deg and height_m are no place that can be followed")
        if not all(abs(v) <= MOST_FIX_M_S for v in (self.east_m_s, self.north_m_s, self.up_m_s)):
            raise ValueError(f"a velocity of more than {MOST_FIX_M_S:g} m/s")


class OffsetBy(msgspec.Struct, frozen=True, tag="offset", forbid_unknown_fields=True):
    """Change one offset.

    `value` is in the unit that `what` names: added (`add`), the new total (`set`), the new total in so many
    `seconds` (`gradual`), or the change a second (`rate`). `stop` ends a rate where the offset is; `reset`
    takes the offset away.
    """

    what: str
    how: str
    value: float | None = None
    seconds: float | None = None

    def __post_init__(self) -> None:
        """Raise ValueError where fields are missing, or there that mean nothing."""
        _one_of("what", self.what, get_args(Quantity))
        _one_of("how", self.how, get_args(How))
        _given("value", self.value, self.how, self.how in {"add", "set", "rate", "gradual"})
        _given("seconds", self.seconds, self.how, self.how == "gradual")


class Search(msgspec.Struct, frozen=True, tag="search", forbid_unknown_fields=True):
    """Run a pattern about where the target is fed, or end the one that runs.

    `spiral`: arms `spacing_deg` apart, at `speed_deg_s` on the sky. `sweep`: along the track by `reach_s`
    ahead and behind, there and back in `period_s`. `auto`: either, where the target may be by what was
    seen of it. `stop` keeps where it is as an offset along and across
    the track; `cancel` goes back to the centre.
    """

    how: str
    spacing_deg: float | None = None
    speed_deg_s: float | None = None
    reach_s: float | None = None
    period_s: float | None = None

    def __post_init__(self) -> None:
        """Raise ValueError where fields are missing, or there that mean nothing."""
        _one_of("how", self.how, get_args(SearchHow))
        _given("spacing_deg", self.spacing_deg, self.how, self.how == "spiral")
        _given("speed_deg_s", self.speed_deg_s, self.how, self.how == "spiral")
        _given("reach_s", self.reach_s, self.how, self.how == "sweep")
        _given("period_s", self.period_s, self.how, self.how == "sweep")


class Guide(msgspec.Struct, frozen=True, tag="guide", forbid_unknown_fields=True):
    """Have observations correct the target (`on`), or only be shown (`off`), or decide on the last one.

    `accept` takes the last one that was not taken, although it contradicts others; `reject` gives back what
    the last one that was taken has changed.
    """

    how: str

    def __post_init__(self) -> None:
        """Raise ValueError for anything else."""
        _one_of("how", self.how, get_args(GuideHow))


class ObservationMessage(
    msgspec.Struct, frozen=True, tag="observation", forbid_unknown_fields=True, omit_defaults=True
):
    """Where the satellite was seen at an instant.

    `utc` is ISO 8601 with Z. Frames: "icrs" and "j2000" are astrometric, as a plate solution among catalogued
    stars gives; "of_date" is apparent, true equator and equinox of date, where the mount had to point to see
    it there (air included where the run includes it). `sigma_arcsec` is one standard deviation of each of the
    two directions on the sky. `camera` is what saw it, whose clock may be known.
    """

    utc: str
    ra_deg: float
    dec_deg: float
    frame: str
    sigma_arcsec: float
    catalog_number: int | None = None
    camera: str | None = None

    def __post_init__(self) -> None:
        """Raise ValueError where a number cannot be one of an observation."""
        _check_utc(self.utc)
        _one_of("frame", self.frame, FRAMES)
        _check_direction(self.ra_deg, self.dec_deg)
        check_sigma(self.sigma_arcsec)


class SolvedField(msgspec.Struct, frozen=True, tag="field", forbid_unknown_fields=True):
    """Where the middle of a camera's image pointed at the middle of an exposure: ICRS, by its stars.

    It says nothing of the satellite, but when the camera's clock is compared with the mount's statuses.
    """

    utc: str
    ra_deg: float
    dec_deg: float
    sigma_arcsec: float
    camera: str | None = None

    def __post_init__(self) -> None:
        """Raise ValueError where a number cannot be one of a field."""
        _check_utc(self.utc)
        _check_direction(self.ra_deg, self.dec_deg)
        check_sigma(self.sigma_arcsec)


class SeenOffset(msgspec.Struct, frozen=True, tag="offset", forbid_unknown_fields=True, omit_defaults=True):
    """Where a camera on the mount saw the satellite at an instant, from the middle of its image.

    `utc` is the middle of the exposure, ISO 8601 with Z. x to the right and y up as the image is displayed,
    arcseconds on the sky, or pixels; the sigma is one standard deviation of each. `camera` is its name.
    `rotation_deg` is the position angle of up, from north through east, `flipped` whether the image is
    mirrored, `scale_arcsec_px` the sky in a pixel, by which arcseconds were made: where they are left out,
    what the run knows of the camera holds. Not mirrored, an image with north up has east to the left.
    """

    utc: str
    dx_arcsec: float | None = None
    dy_arcsec: float | None = None
    sigma_arcsec: float | None = None
    camera: str | None = None
    rotation_deg: float | None = None
    flipped: bool | None = None
    dx_px: float | None = None
    dy_px: float | None = None
    sigma_px: float | None = None
    scale_arcsec_px: float | None = None

    def __post_init__(self) -> None:
        """Raise ValueError where fields are missing, or a number cannot be one of an offset."""
        _check_utc(self.utc)
        in_arcsec = self.dx_arcsec, self.dy_arcsec, self.sigma_arcsec
        in_px = self.dx_px, self.dy_px, self.sigma_px
        if None not in in_arcsec and in_px == (None, None, None):
            dx, dy, sigma = in_arcsec
            most, unit = MOST_OFFSET_ARCSEC, "arcseconds"
        elif None not in in_px and in_arcsec == (None, None, None):
            dx, dy, sigma = in_px
            most, unit = MOST_OFFSET_PX, "pixels"
        else:
            raise ValueError("give dx_arcsec, dy_arcsec and sigma_arcsec, or dx_px, dy_px and sigma_px")
        assert dx is not None
        assert dy is not None
        assert sigma is not None
        if not max(abs(dx), abs(dy)) <= most:
            raise ValueError(f"an offset goes to {most:g} {unit} either way")
        if unit == "arcseconds":
            check_sigma(sigma)
        elif not LEAST_SIGMA_PX <= sigma <= most:
            raise ValueError(f"sigma_px {sigma:g} is outside {LEAST_SIGMA_PX:g} to {most:g}")
        if self.rotation_deg is not None and not abs(self.rotation_deg) <= 360.0:
            raise ValueError(f"rotation_deg {self.rotation_deg:g} is outside -360 to 360")
        if self.scale_arcsec_px is not None and not 0.0 < self.scale_arcsec_px <= MOST_SCALE_ARCSEC_PX:
            raise ValueError(
                f"scale_arcsec_px {self.scale_arcsec_px:g} is outside 0 to {MOST_SCALE_ARCSEC_PX:g}"
            )


TaggedMessage = (
    Nudge
    | ClearBias
    | DropRemembered
    | StopNow
    | OffsetBy
    | Search
    | Guide
    | ObservationMessage
    | SolvedField
    | Pause
    | Go
    | Jog
    | Slip
    | PlaceFix
)
"""The messages that their types tell apart."""
Message = TaggedMessage | SeenOffset
Reported = ObservationMessage | SeenOffset | SolvedField | PlaceFix
"""What comes from those who observe: it needs no control."""


class TakeControl(msgspec.Struct, frozen=True, tag="take_control", forbid_unknown_fields=True):
    """Take control, from anybody who has it."""


class YieldControl(msgspec.Struct, frozen=True, tag="yield_control", forbid_unknown_fields=True):
    """Give control up, for anybody to take."""


class LeaveRunning(msgspec.Struct, frozen=True, tag="leave_running", forbid_unknown_fields=True):
    """From the starter of the run: the end of this channel must not stop it."""


class Arm(msgspec.Struct, frozen=True, tag="arm", forbid_unknown_fields=True):
    """Have a pass followed after this one; with `now`, end this one for it.

    A pass is named by the satellite's catalogue number and about when it culminates (UTC, POSIX seconds).
    """

    catalog_number: int
    culminate_utc_s: float
    name: str = ""
    now: bool = False


class Disarm(msgspec.Struct, frozen=True, tag="disarm", forbid_unknown_fields=True):
    """Take a pass back that was armed."""

    catalog_number: int
    culminate_utc_s: float


SessionMessage = TakeControl | YieldControl | LeaveRunning | Arm | Disarm


class Reset(msgspec.Struct, frozen=True, tag="reset", forbid_unknown_fields=True):
    """Let the mount move again after a safety limit has stopped it, once it is at rest."""


class Leave(msgspec.Struct, frozen=True, tag="leave", forbid_unknown_fields=True):
    """Stop what was begun from this console, and end."""


class _Typed(msgspec.Struct):
    """What any message is besides: of a type."""

    type: str | None = None


ConsoleMessage = Slew | Sync | Jog | Abort | Park | FindHome | Reset | Leave
_MESSAGES: msgspec.json.Decoder[TaggedMessage] = msgspec.json.Decoder(TaggedMessage)
_ALL: msgspec.json.Decoder[TaggedMessage | SessionMessage] = msgspec.json.Decoder(
    TaggedMessage | SessionMessage
)
# It cannot distinguish two types of one name: offsets that were seen have a decoder of their own.
_SEEN_OFFSETS: msgspec.json.Decoder[SeenOffset] = msgspec.json.Decoder(SeenOffset)
_OBSERVATIONS: msgspec.json.Decoder[ObservationMessage] = msgspec.json.Decoder(ObservationMessage)
_TYPES: msgspec.json.Decoder[_Typed] = msgspec.json.Decoder(_Typed)
_FIELDS: msgspec.json.Decoder[SolvedField] = msgspec.json.Decoder(SolvedField)
_FIXES: msgspec.json.Decoder[PlaceFix] = msgspec.json.Decoder(PlaceFix)
_ORDERS: msgspec.json.Decoder[ConsoleMessage] = msgspec.json.Decoder(ConsoleMessage)


def encode_message(message: Message | SessionMessage | ConsoleMessage) -> bytes:
    """Return a message as one JSON line, its end included."""
    return msgspec.json.encode(message) + b"\n"


def _decode(decoder: msgspec.json.Decoder[T], line: bytes | str) -> T:
    """Return what one JSON line says; raises msgspec.MsgspecError."""
    try:
        return decoder.decode(line)
    except NO_JSON as error:
        raise msgspec.DecodeError(str(error)) from None


def decode_message(line: bytes) -> Message:
    """Return the message to a run of one JSON line; raises msgspec.MsgspecError."""
    return _decode(_SEEN_OFFSETS, line) if _is_seen_offset(line) else _decode(_MESSAGES, line)


def decode_said(line: bytes | str) -> Message | SessionMessage:
    """Return the message to a run, or about its control, of one JSON line; raises msgspec.MsgspecError."""
    return _decode(_SEEN_OFFSETS, line) if _is_seen_offset(line) else _decode(_ALL, line)


def decode_observation(line: bytes) -> Reported:
    """Return the observation of one JSON line, the offset, field or fix; raises msgspec.MsgspecError.

    The type of an observation may be left out.
    """
    match _type_of(line):
        case "fix":
            return _decode(_FIXES, line)
        case "field":
            return _decode(_FIELDS, line)
        case "offset":
            return _decode(_SEEN_OFFSETS, line)
        case _:
            return _decode(_OBSERVATIONS, line)


def is_observation(line: bytes) -> bool:
    """Tell whether a line looks like an observation, a field, a fix, or an offset that was seen."""
    found = any(name in line for name in (b'"observation"', b'"field"', b'"fix"'))
    return found or (b'"utc"' in line and b'"offset"' in line)


def _is_seen_offset(line: bytes | str) -> bool:
    """Tell an offset that was seen from an order to offset, whose type is of the same name."""
    text = line.encode(errors="replace") if isinstance(line, str) else line
    return b'"utc"' in text and b'"offset"' in text and _type_of(text) == "offset"


def _type_of(line: bytes) -> str | None:
    """Return the type of a JSON line's message; None where it says none. A camera may have any name."""
    try:
        return _TYPES.decode(line).type
    except (msgspec.MsgspecError, *NO_JSON):
        return None


def decode_order(line: bytes) -> ConsoleMessage:
    """Return the message to a console of one JSON line; raises msgspec.MsgspecError."""
    return _decode(_ORDERS, line)


def _check_utc(text: str) -> None:
    if not text.endswith("Z"):
        raise ValueError(f"utc {text!r} does not end with Z: give UTC as 2026-10-02T13:05:24.5Z")
    try:
        Utc.parse(text)
    except TimeFormatError as error:
        raise ValueError(f"utc: {error}") from None


def _check_direction(ra_deg: float, dec_deg: float) -> None:
    if not 0.0 <= ra_deg <= 360.0:
        raise ValueError(f"ra_deg {ra_deg:g} is outside 0 to 360")
    if not -90.0 <= dec_deg <= 90.0:
        raise ValueError(f"dec_deg {dec_deg:g} is outside -90 to 90")


def check_sigma(sigma_arcsec: float) -> None:
    """Check one standard deviation of an observation. Raises ValueError outside the bounds."""
    if not LEAST_SIGMA_ARCSEC <= sigma_arcsec <= MOST_SIGMA_ARCSEC:
        span = f"{LEAST_SIGMA_ARCSEC:g} to {MOST_SIGMA_ARCSEC:g}"
        raise ValueError(f"sigma_arcsec {sigma_arcsec:g} is outside {span}")


def _one_of(field: str, value: str, text: Collection[str]) -> None:
    if value not in text:
        raise ValueError(f"{field} {value!r} is not known: give one of {', '.join(text)}")


def _given(field: str, value: float | None, how: str, wanted: bool) -> None:
    if wanted and value is None:
        raise ValueError(f"{how} needs {field}")
    if not wanted and value is not None:
        raise ValueError(f"{field} does not go with {how}")
