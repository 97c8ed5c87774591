"""Answers to requests, byte for byte those of Hamlib's rotctld 4.5.4.

An answer ends in `RPRT` and a code: for every failure, for commands without values, and at the end of every
extended response. Nine commands are computed without the mount.

Numbers are read as C's `sscanf` reads them (ISO/IEC 9899:2011, 7.21.6.2, as in glibc): the leading number is
taken, with an exponent that lacks its digits as one of 0; the rest is ignored. Rounding and the treatment of
strange values are those of Hamlib 4.5.4. The Maidenhead locator: IARU Region 1 VHF Managers Handbook, with a
fifth pair from A to X.
"""

from __future__ import annotations

import math
import re
import struct
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from sattrack.servers.antenna.protocol import NS
from sattrack.servers.rotctld.reader import (
    Code,
    FailedError,
    Reader,
    RotctldRequest,
    SpecialRequest,
    done,
    given,
    need,
    report,
    usage,
    words_of,
)
from sattrack.servers.rotctld.rotator import MOVE_RATE_DEG_S, Direction, Rotator

if TYPE_CHECKING:
    from collections.abc import Callable

PROTOCOL = 1
MODEL = 1
"""Hamlib's dummy rotator, which clients are tested with."""
LONGEST_PAUSE_S = 60
LEVELS = "SPEED "
DIRECTIONS: dict[int, Direction] = {2: "up", 4: "down", 8: "left", 16: "right"}
DIRECTION_WORDS: dict[str, Direction] = {
    "UP": "up",
    "DOWN": "down",
    "LEFT": "left",
    "CCW": "left",
    "RIGHT": "right",
    "CW": "right",
}
BOUNDS = {name: f"{name}_deg" for name in ("min_az", "max_az", "min_el", "max_el")}
WITHOUT_MEANING = frozenset({"write_delay", "post_write_delay", "timeout", "retry"})
"""Settings of a rotator's serial line: accepted and ignored."""
MOST_DIGITS = 300
PAIRS = (18, 10, 24, 10, 24, 10)
"""Number of possible characters in each pair of a locator: digits where it is 10, else letters."""
GUARD_DEG = 1e-6
KM_A_DEGREE = 111.2
ONE_PLACE = 0.999999999999999
ANTIPODES = -0.999999
NEAR_POLE_DEG = 89.999999999
LEAST_INTEGER = -(2**31)
_SPACES = " \t\n\v\f\r"
_INTEGER = re.compile(r"[+-]?[0-9]+")
_HEX = re.compile(r"([+-]?)0[xX]([0-9a-fA-F]*)(?:\.([0-9a-fA-F]*))?(?:[pP]([+-]?[0-9]*))?")
_DECIMAL = re.compile(r"([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))(?:[eE]([+-]?[0-9]*))?")
_NAMED = re.compile(r"([+-]?)(inf(?:i[a-z]*)?|nan)", re.IGNORECASE)


@dataclass(slots=True)
class Client:
    """One client: its bytes in, answers out, none before `pause_until_s`."""

    number: int
    rotator: Rotator
    info: str = "sattrack"
    pause_until_s: float = 0.0
    refused: int = 0
    """Number of requests that were answered with a failure."""
    left: bool = False
    """Whether it has sent a quit command."""
    _reader: Reader = field(default_factory=Reader)
    _after_pause: str = ""

    @property
    def paused(self) -> bool:
        """Whether a pause that it requested is not over."""
        return self._after_pause != ""

    def receive(self, data: bytes) -> None:
        """Take bytes; `answer` answers the requests in them."""
        self._reader.feed(data)

    def answer(self, now_ns: int, most: int) -> tuple[bytes, int]:
        """Answer at most so many requests; return the answers and the number of requests."""
        answers: list[str] = []
        count = 0
        while count < most and not self.left and now_ns / NS >= self.pause_until_s:
            answers.append(self._after_pause)
            self._after_pause = ""
            request = self._reader.next()
            if request is None:
                break
            count += 1
            self.rotator.heard(self.number, now_ns / NS)
            answers.append(self._answer(request, now_ns))
        return "".join(answers).encode("latin-1"), count

    def _answer(self, request: RotctldRequest | SpecialRequest, now_ns: int) -> str:
        if isinstance(request, RotctldRequest):
            return self._execute(request, now_ns)
        self.left = request is SpecialRequest.QUIT
        if request is SpecialRequest.TOO_LONG:
            self.refused += 1
            return report(Code.INVALID)
        return usage() if request is SpecialRequest.HELP else ""

    def _execute(self, request: RotctldRequest, now_ns: int) -> str:
        command = request.command
        echoed = "".join(f" {word}" for word in request.words)
        text = f"{command.name}:{echoed}{request.mark}" if request.extended else ""
        try:
            calculate = CALCULATIONS.get(command.name)
            text += calculate(request) if calculate else _HANDLERS[command.name](self, request, now_ns)
        except FailedError as error:
            self.refused += 1
            return text + report(error.code)
        if request.extended or not command.answers:
            text += report(Code.OK)
        if self.pause_until_s > now_ns / NS:
            self._after_pause, text = text, ""
        return text

    # Each of these carries out one command and returns its answer.

    def _set_position(self, request: RotctldRequest, now_ns: int) -> str:
        # A comma may stand for the point, as in many languages.
        az, el = (need(scan_single(word.replace(",", ".", 1))) for word in words_of(request))
        return done(self.rotator.point(self.number, az, el, now_ns / NS))

    def _get_position(self, request: RotctldRequest, now_ns: int) -> str:
        here = self.rotator.where(now_ns)
        if here is None:
            raise FailedError(Code.IO)
        return given(request, f"{here.az_deg:.2f}", f"{here.el_deg:.2f}")

    def _stop(self, request: RotctldRequest, now_ns: int) -> str:
        del request, now_ns
        return done(self.rotator.stop(self.number))

    def _park(self, request: RotctldRequest, now_ns: int) -> str:
        del request
        return done(self.rotator.go_to_park(self.number, now_ns / NS))

    def _reset(self, request: RotctldRequest, now_ns: int) -> str:
        del now_ns
        need(scan_integer(request.words[0]))
        return done(self.rotator.reset(self.number))

    def _move(self, request: RotctldRequest, now_ns: int) -> str:
        first, second = words_of(request)
        direction = DIRECTION_WORDS.get(first)
        number = None if direction is not None else need(scan_integer(first))
        speed = need(scan_integer(second))
        if number is not None:
            direction = DIRECTIONS.get(number)
        if direction is None:
            raise FailedError(Code.INVALID)
        return done(self.rotator.move(self.number, direction, speed, now_ns / NS))

    def _set_level(self, request: RotctldRequest, now_ns: int) -> str:
        del now_ns
        name, value = words_of(request)
        if name == "?":
            return LEVELS + "\n"
        if name != LEVELS.strip():
            raise FailedError(Code.NOT_AVAILABLE)
        self.rotator.speed_level = need(scan_integer(value))
        return ""

    def _get_level(self, request: RotctldRequest, now_ns: int) -> str:
        del now_ns
        name = request.words[0]
        if name == "?":
            return LEVELS + "\n"
        if name != LEVELS.strip():
            raise FailedError(Code.INVALID)
        return f"{self.rotator.speed_level}\n"

    def _set_function(self, request: RotctldRequest, now_ns: int) -> str:
        del now_ns
        if request.words[0] == "?":
            return "\n"
        raise FailedError(Code.NOT_AVAILABLE)

    def _no_such_name(self, request: RotctldRequest, now_ns: int) -> str:
        del now_ns
        if request.words[0] == "?":
            return "\n"
        raise FailedError(Code.INVALID)

    def _set_configuration(self, request: RotctldRequest, now_ns: int) -> str:
        del now_ns
        name, value = words_of(request)
        if not value:
            raise FailedError(Code.INVALID)
        rest = f"{name}={value}"
        while rest:
            name, equals, rest = rest.partition("=")
            if not equals:
                raise FailedError(Code.MALFORMED)
            value, _, rest = rest.partition(",")
            done(self._configure(name, value))
        return ""

    def _configure(self, name: str, value: str) -> Code:
        if name in BOUNDS:
            return self.rotator.narrow(BOUNDS[name], need(scan_double(value)))
        if name == "south_zero":
            return Code.OK if scan_integer(value) == 0 else Code.INVALID
        if name in WITHOUT_MEANING:
            return Code.INVALID if scan_integer(value) is None else Code.OK
        return Code.OK if name == "rot_pathname" else Code.INVALID

    def _get_info(self, request: RotctldRequest, now_ns: int) -> str:
        del now_ns
        return given(request, self.info)

    def _get_status(self, request: RotctldRequest, now_ns: int) -> str:
        flags = self.rotator.flags(now_ns)
        if flags is None:
            raise FailedError(Code.IO)
        return given(request, "".join(f"{flag} " for flag in flags))

    def _send_command(self, request: RotctldRequest, now_ns: int) -> str:
        del request, now_ns
        raise FailedError(Code.IO)

    def _dump_state(self, request: RotctldRequest, now_ns: int) -> str:
        del now_ns
        reach, long = self.rotator.reach, request.extended
        lines = [
            ("rotctld Protocol Ver: " if long else "") + str(PROTOCOL),
            ("Rotor Model: " if long else "") + str(MODEL),
            ("Minimum Azimuth: " if long else "min_az=") + f"{reach.min_az_deg:f}",
            ("Maximum Azimuth: " if long else "max_az=") + f"{reach.max_az_deg:f}",
            ("Minimum Elevation: " if long else "min_el=") + f"{reach.min_el_deg:f}",
            ("Maximum Elevation: " if long else "max_el=") + f"{reach.max_el_deg:f}",
            ("South Zero: " if long else "south_zero=") + "0",
            "rot_type=AzEl",
            "done",
        ]
        return "".join(line + request.mark for line in lines)

    def _dump_capabilities(self, request: RotctldRequest, now_ns: int) -> str:
        del request, now_ns
        reach = self.rotator.reach
        lines = [
            f"Caps dump for model:\t{MODEL}",
            f"Model name:\t\t{self.info}",
            "Mfg name:\t\tsattrack",
            "Rot type:\t\tAz-El",
            "Port type:\t\tNone",
            "Status flags: MOVING MOVING_AZ MOVING_LEFT MOVING_RIGHT MOVING_EL MOVING_UP MOVING_DOWN ",
            "Get functions: ",
            "Set functions: ",
            "Get level: SPEED(1..4/1) ",
            "Set level: SPEED(1..4/1) ",
            "Get parameters: ",
            "Set parameters: ",
            f"Min Azimuth:\t\t{reach.min_az_deg:.2f}",
            f"Max Azimuth:\t\t{reach.max_az_deg:.2f}",
            f"Min Elevation:\t\t{reach.min_el_deg:.2f}",
            f"Max Elevation:\t\t{reach.max_el_deg:.2f}",
            f"Move at speed 100:\t{MOVE_RATE_DEG_S:.2f}",
            f"Can Park:\t\t{'N' if self.rotator.park is None else 'Y'}",
            *(f"Can {what}:\t\tY" for what in ("set Conf", "set Position", "get Position", "Stop")),
            *(f"Can {what}:\t\tY" for what in ("Reset", "Move", "get Info", "get Status")),
        ]
        return "".join(line + "\n" for line in lines)

    def _pause(self, request: RotctldRequest, now_ns: int) -> str:
        seconds = need(scan_integer(request.words[0]))
        self.pause_until_s = now_ns / NS + max(0, min(LONGEST_PAUSE_S, seconds))
        return ""


_HANDLERS: dict[str, Callable[[Client, RotctldRequest, int], str]] = {
    "set_pos": Client._set_position,
    "get_pos": Client._get_position,
    "park": Client._park,
    "stop": Client._stop,
    "reset": Client._reset,
    "move": Client._move,
    "set_level": Client._set_level,
    "get_level": Client._get_level,
    "set_func": Client._set_function,
    "get_func": Client._no_such_name,
    "set_parm": Client._no_such_name,
    "get_parm": Client._no_such_name,
    "set_conf": Client._set_configuration,
    "get_info": Client._get_info,
    "get_status": Client._get_status,
    "send_cmd": Client._send_command,
    "dump_caps": Client._dump_capabilities,
    "dump_state": Client._dump_state,
    "pause": Client._pause,
}


def scan_integer(text: str) -> int | None:
    """Return the whole number that a text begins with, as `%d` reads it; None where there is none."""
    found = _INTEGER.match(text.lstrip(_SPACES))
    return None if found is None or len(found.group()) > MOST_DIGITS else int(found.group())


def scan_double(text: str) -> float | None:
    """Return the number that a text begins with, as `%lf` reads it; None where there is none.

    Hexadecimal numbers, infinities and not-a-numbers are numbers too.
    """
    text = text.lstrip(_SPACES)
    named = _NAMED.match(text)
    if named is not None:
        sign, word = named.groups()
        if word.lower() not in {"inf", "infinity", "nan"} and not word.lower().startswith("infinity"):
            return None
        return float(sign + word[:3])
    if re.match(r"[+-]?0[xX]", text):
        return _hexadecimal(text)
    found = _DECIMAL.match(text)
    if found is None:
        return None
    mantissa, exponent = found.groups()
    return float(mantissa if _lacks_digits(exponent) else f"{mantissa}e{exponent}")


def _hexadecimal(text: str) -> float | None:
    found = _HEX.match(text)
    if found is None:
        return None
    sign, whole, fraction, exponent = found.groups()
    if not (whole or fraction):
        return None
    power = "0" if _lacks_digits(exponent) else exponent
    try:
        return float.fromhex(f"{sign}0x{whole or '0'}.{fraction or '0'}p{power}")
    except OverflowError:
        return float(f"{sign}inf")


def _lacks_digits(exponent: str | None) -> bool:
    return not (exponent or "").strip("+-")


def scan_single(text: str) -> float | None:
    """Return the number that a text begins with, as `%f` reads it: rounded to single precision."""
    value = scan_double(text)
    if value is None:
        return None
    try:
        (single,) = struct.unpack("f", struct.pack("f", value))
    except OverflowError:
        single = float("inf") if value > 0 else float("-inf")
    return float(single)


def _whole(value: float) -> int:
    """Return the whole part as a C `int`; the least one where there is none, as on x86."""
    if not math.isfinite(value) or abs(value) >= 2**31:
        return LEAST_INTEGER
    return int(value)


def to_locator(longitude_deg: float, latitude_deg: float, pairs: int) -> str:
    """Return the locator of a place, of 1 to 6 pairs; angles beyond a turn wrap. Raises FailedError."""
    if not 1 <= pairs <= len(PAIRS):
        raise FailedError(Code.INVALID)
    halves = []
    for angle_deg in (longitude_deg / 2.0, latitude_deg):
        if not math.isfinite(angle_deg):
            raise FailedError(Code.INVALID)
        left, square, characters = math.fmod(angle_deg + 270.0 + GUARD_DEG, 180.0), 180.0, []
        for size in PAIRS[:pairs]:
            square /= size
            value = int(left / square)
            left -= square * value
            characters.append(chr(value + ord("0" if size == 10 else "A")))
        halves.append(characters)
    return "".join(first + second for first, second in zip(*halves, strict=True))


def from_locator(locator: str) -> tuple[float, float]:
    """Return longitude and latitude of a locator's middle, degrees; an odd last character is ignored.

    Raises FailedError.
    """
    pairs = min(len(locator) // 2, len(PAIRS))
    if pairs < 1:
        raise FailedError(Code.INVALID)
    angles = []
    for first in (0, 1):
        angle_deg, divisions = -90.0, 1
        for pair in range(pairs):
            character, size = locator[2 * pair + first], PAIRS[pair]
            base = "0" if size == 10 else "A" if "A" <= character <= "Z" else "a"
            value = ord(character) - ord(base)
            if not 0 <= value < size:
                raise FailedError(Code.INVALID)
            divisions *= size
            angle_deg += value * 180.0 / divisions
        angles.append(angle_deg + 90.0 / divisions)
    return angles[0] * 2.0, angles[1]


def to_sexagesimal(angle_deg: float) -> tuple[int, int, float, bool]:
    """Return degrees, minutes, seconds, and whether it is south or west, of an angle wrapped to ±180."""
    if math.isinf(angle_deg):
        angle_deg = math.nan
    half = 180.0 if angle_deg >= 0.0 else -180.0
    wrapped = math.fmod(angle_deg + half, 360.0) - half
    negative = wrapped < 0.0 and wrapped != -180.0
    left = abs(wrapped)
    degrees = _whole(left)
    left = 60.0 * (left - degrees)
    minutes = _whole(left)
    return degrees, minutes, 60.0 * (left - minutes), negative


def great_circle(lon1: float, lat1: float, lon2: float, lat2: float) -> tuple[float, float]:
    """Return distance (km, of 111.2 km a degree) and bearing (whole degrees) from one place to another.

    Places that are one, or opposite each other, have bearing 0. Raises FailedError beyond 180° or 90°.
    """
    if any(abs(lat) > 90.0 for lat in (lat1, lat2)) or any(abs(lon) > 180.0 for lon in (lon1, lon2)):
        raise FailedError(Code.INVALID)
    phi1, phi2 = (
        math.radians(math.copysign(NEAR_POLE_DEG, lat) if abs(lat) == 90.0 else lat) for lat in (lat1, lat2)
    )
    apart = math.radians(lon2) - math.radians(lon1)
    cosine = math.sin(phi1) * math.sin(phi2) + math.cos(phi1) * math.cos(phi2) * math.cos(apart)
    if math.isnan(cosine):
        return math.nan, math.nan
    if cosine > ONE_PLACE:
        return 0.0, 0.0
    if cosine < ANTIPODES:
        return 180.0 * KM_A_DEGREE, 0.0
    east = math.sin(apart) * math.cos(phi2)
    north = math.cos(phi1) * math.sin(phi2) - math.sin(phi1) * math.cos(phi2) * math.cos(apart)
    bearing_deg = math.fmod(360.0 + math.degrees(math.atan2(east, north)), 360.0)
    return KM_A_DEGREE * math.degrees(math.acos(cosine)), float(math.floor(bearing_deg + 0.5))


def _to_locator(request: RotctldRequest) -> str:
    first, second, third = words_of(request)
    longitude, latitude = need(scan_double(first)), need(scan_double(second))
    return given(request, to_locator(longitude, latitude, int(need(scan_integer(third)) / 2)))


def _from_locator(request: RotctldRequest) -> str:
    longitude, latitude = from_locator(request.words[0])
    return given(request, f"{longitude:f}", f"{latitude:f}")


def _from_seconds(request: RotctldRequest) -> str:
    first, second, third, fourth = words_of(request)
    degrees, minutes = need(scan_integer(first)), need(scan_integer(second))
    seconds, west = need(scan_double(third)), need(scan_integer(fourth)) == 1
    total = abs(degrees) + abs(minutes) / 60.0 + abs(seconds) / 3600.0
    return given(request, f"{-total if west else total:f}")


def _to_seconds(request: RotctldRequest) -> str:
    degrees, minutes, seconds, west = to_sexagesimal(need(scan_double(request.words[0])))
    return given(request, str(degrees), str(minutes), f"{seconds:f}", str(int(west)))


def _from_minutes(request: RotctldRequest) -> str:
    """Take the flag for seconds, as Hamlib does."""
    first, second, third = words_of(request)
    degrees, minutes = need(scan_integer(first)), need(scan_double(second))
    total = abs(degrees) + abs(minutes) / 60.0 + need(scan_integer(third)) / 3600.0
    return given(request, f"{total:f}")


def _to_minutes(request: RotctldRequest) -> str:
    degrees, minutes, seconds, west = to_sexagesimal(need(scan_double(request.words[0])))
    return given(request, str(degrees), f"{minutes + seconds / 60.0:f}", str(int(west)))


def _great_circle(request: RotctldRequest) -> str:
    lon1, lat1, lon2, lat2 = (need(scan_double(word)) for word in words_of(request))
    distance_km, bearing_deg = great_circle(lon1, lat1, lon2, lat2)
    return given(request, f"{distance_km:f}", f"{bearing_deg:f}")


def _long_bearing(request: RotctldRequest) -> str:
    bearing_deg = need(scan_double(request.words[0]))
    if not 0.0 <= bearing_deg <= 360.0:
        raise FailedError(Code.INVALID)
    return given(request, f"{bearing_deg + 180.0 if bearing_deg < 180.0 else bearing_deg - 180.0:f}")


def _long_distance(request: RotctldRequest) -> str:
    return given(request, f"{360.0 * KM_A_DEGREE - need(scan_double(request.words[0])):f}")


CALCULATIONS: dict[str, Callable[[RotctldRequest], str]] = {
    "lonlat2loc": _to_locator,
    "loc2lonlat": _from_locator,
    "dms2dec": _from_seconds,
    "dec2dms": _to_seconds,
    "dmmm2dec": _from_minutes,
    "dec2dmmm": _to_minutes,
    "qrb": _great_circle,
    "a_sp2a_lp": _long_bearing,
    "d_sp2d_lp": _long_distance,
}
"""By the command's name; they raise FailedError."""
