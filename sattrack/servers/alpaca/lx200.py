"""LX200 commands for the telescope that Alpaca's clients see: text in, answers and orders out, without I/O.

Source: "Meade Telescope Serial Command Protocol", revision 2010.10; `Te`, `Td` (tracking on and off) and `hC`
(home) as OnStep has them. A command is a colon, letters, a value and `#`; a byte 6 outside of one asks for
the mount's alignment. Places are of date. Longitudes grow westward; a zone's offset is what makes UTC of its
time. Site and clock are this program's own: values that agree with them are accepted, others refused.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from sattrack.mount.model import SIDEREAL_RATE_DEG_S
from sattrack.mount.requests import Abort
from sattrack.servers.alpaca.protocol import MOVING_BY_RATES, Fault, MoveOrder, TrackOrder
from sattrack.servers.alpaca.telescope import ALT_AZ, GERMAN, POLAR

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.servers.alpaca.protocol import Order, TelescopeState
    from sattrack.servers.alpaca.telescope import Device, ServedTelescope

ALIGNMENT_QUERY = "\x06"
ALIGNMENTS = {ALT_AZ: "A", POLAR: "P", GERMAN: "G"}
LONGEST_COMMAND = 64
SEEN_WITHIN_S = 1.0
"""So long after a key is pressed the mount's state shows that it moves."""
RATES_DEG_S = {"G": 0.5 * SIDEREAL_RATE_DEG_S, "C": 0.1, "M": 0.5, "S": 4.0}
"""What `RG`, `RC`, `RM` and `RS` choose: guiding, centring, finding, slewing; at most what the axis bears."""
DIRECTIONS = {"n": (1, 1.0), "s": (1, -1.0), "e": (0, -1.0), "w": (0, 1.0)}
"""The axis that a direction turns, and its sense: positive turns westward and northward."""
PULSES = {"n": 0, "s": 1, "e": 2, "w": 3}
PLACE_WITHIN_DEG, CLOCK_WITHIN_S = 0.2, 60.0
"""A client's place or time that is off by less agrees with ours."""
MATCHED = b"Coordinates     matched.        #"
DATE_TAKEN = b"1Updating Planetary Data#                                #"
_ANGLE = re.compile(r"\s*([+-]?)(\d{1,3})[*:\xdf\xb0](\d{1,2})(?:[:'](\d{1,2}(?:\.\d*)?)['\"]?)?\s*")
_HOURS = re.compile(r"\s*(\d{1,2}):(\d{1,2}(?:\.\d*)?)(?::(\d{1,2}(?:\.\d*)?))?\s*")
_OFFSET = re.compile(r"\s*([+-]?)(\d{1,2}(?:\.\d*)?)(?::(\d{2}))?\s*")
OFFSETS_AN_HOUR = 4
"""Zones are whole quarters of an hour off; a client with one decimal rounds Nepal's 5.75 h to 5.8 h."""
_PULSE = re.compile(r"g([nsew])(\d{1,5})")


class Asked(NamedTuple):
    """Orders to carry out, the answer where they are, and the one where they are refused, by the reason.

    With an `objection` they are refused already.
    """

    orders: tuple[Order, ...] = ()
    done: bytes = b""
    refused: Callable[[str], bytes] = lambda _: b""
    objection: str | None = None


Answer: TypeAlias = bytes | Asked


class CommandReader:
    """Commands from a client's bytes; on a `noisy` line what is no command is passed over."""

    def __init__(self, noisy: bool = False) -> None:
        self._noisy = noisy
        self._rest = ""

    def read(self, data: bytes) -> list[str] | None:
        """Return the commands that are complete, without colon and `#`; None where this is another protocol.

        Before and between commands nothing but line ends, blanks and `#` may stand.
        """
        text, self._rest = self._rest + data.decode("latin-1"), ""
        found = []
        while text:
            if text[0] == ":":
                command, end, after = text[1:].partition("#")
                if len(command) > LONGEST_COMMAND:
                    if not self._noisy:
                        return None
                    command, end, after = "", "#", command
                if not end:
                    self._rest = text
                    break
                found.append(command)
                text = after
                continue
            if text[0] == ALIGNMENT_QUERY:
                found.append(ALIGNMENT_QUERY)
            elif text[0] not in "#\r\n \0" and not self._noisy:
                return None
            text = text[1:]
        return found


@dataclass(slots=True)
class Lx200Client:
    """One client with its target, precision and rate; `client` is its number at the telescope."""

    telescope: ServedTelescope
    client: int
    gives_reasons: bool = False
    """Whether a refused slew is answered with a text. Over TCP, where nothing flushes what a client has not
    read, it is a digit alone, as OnStep has it."""
    turning: set[int] = field(default_factory=set)
    """The axes that its direction keys turn."""
    _pressed_utc_s: float = -math.inf
    """When one was pressed last."""
    _is_long: bool = True
    _rate: str = "C"
    _ra_h: float | None = None
    _dec_deg: float | None = None
    _to_utc_h: float = 0.0

    def answer(self, command: str, now_utc_s: float) -> Answer:
        """Return the answer to a command, or what it asks for; unknown commands are not answered.

        Raises Fault where it is refused and the protocol has no words for that.
        """
        if not self.telescope.connected(self.client) and command != "Q":
            self.telescope.order("connect", self.client, now_utc_s)
        if command == ALIGNMENT_QUERY:
            return b"A" if self.telescope.device.alignment == ALT_AZ else b"P"
        if command == "D":
            return b"\x7f#" if self.telescope.heard(now_utc_s).slewing else b"#"
        if command in {"CM", "CMR"}:
            return self._to_target("synctocoordinates", MATCHED, _not_synced, now_utc_s)
        if command == "U":
            self._is_long = not self._is_long
        if command == "P":
            return b"HIGH PRECISION"
        groups: dict[str, Callable[[str, float], Answer]] = {
            "G": self._get,
            "S": self._set,
            "M": self._move,
            "Q": self._halt,
            "R": self._choose_rate,
            "T": self._track,
            "A": self._align,
            "h": self._place,
        }
        group = groups.get(command[:1])
        return b"" if group is None else group(command[1:], now_utc_s)

    def left(self) -> Asked:
        """Return what ends the motions of a client that is gone."""
        return Asked(self._ends(self.turning))

    def _get(self, what: str, now_utc_s: float) -> bytes:
        device, now = self.telescope.device, self._local(now_utc_s)
        if what in _REPORTED:
            text = _REPORTED[what](self.telescope.heard(now_utc_s), device, self._is_long)
        elif what in _FIXED:
            text = _FIXED[what](device)
        elif what in _CLOCK:
            text = now.strftime(_CLOCK[what])
        elif what == "r":
            text = _hours_text(self._ra_h or 0.0, self._is_long)
        elif what == "d":
            text = _angle_text(self._dec_deg or 0.0, self._is_long)
        elif what == "G":
            text = f"{self._to_utc_h:+05.1f}"
        else:
            return b""
        return text.encode("latin-1") + b"#"

    def _local(self, now_utc_s: float) -> datetime:
        return datetime.fromtimestamp(now_utc_s - 3600.0 * self._to_utc_h, UTC)

    def _set(self, what: str, now_utc_s: float) -> bytes:
        key, text, site = what[:1], what[1:], self.telescope.device.site
        good = False
        if key == "r" and (hours := _read_hours(text)) is not None:
            self._ra_h, good = hours, True
        elif key == "d" and (angle := _read_angle(text)) is not None and abs(angle) <= 90.0:
            self._dec_deg, good = angle, True
        elif key in {"t", "g"} and (angle := _read_angle(text)) is not None:
            off_deg = angle - (site.latitude_deg if key == "t" else -site.longitude_deg)
            good = abs(math.remainder(off_deg, 360.0)) <= PLACE_WITHIN_DEG
        elif key == "G" and (offset := _OFFSET.fullmatch(text)) is not None:
            hours = float(offset[2]) + int(offset[3] or 0) / 60.0
            hours = round(OFFSETS_AN_HOUR * hours) / OFFSETS_AN_HOUR
            self._to_utc_h, good = -hours if offset[1] == "-" else hours, True
        elif key == "L" and (hours := _read_hours(text)) is not None:
            off_s = 3600.0 * (hours + self._to_utc_h) - now_utc_s
            good = abs(math.remainder(off_s, 86400.0)) <= CLOCK_WITHIN_S
        elif key == "C" and text.strip() == self._local(now_utc_s).strftime(_CLOCK["C"]):
            return DATE_TAKEN
        return b"1" if good else b"0"

    def _move(self, what: str, now_utc_s: float) -> Answer:
        if what == "S":
            return self._to_target("slewtocoordinatesasync", b"0", self._not_slewed, now_utc_s)
        pulse = _PULSE.fullmatch(what)
        if pulse is not None:
            return self._ask("pulseguide", now_utc_s, Direction=PULSES[pulse[1]], Duration=int(pulse[2]))
        if what not in DIRECTIONS:
            return b""
        axis, sense = DIRECTIONS[what]
        fastest = max((high for _, high in self.telescope.device.axis_rates_deg_s(axis)), default=0.0)
        rate_deg_s = sense * min(RATES_DEG_S[self._rate], fastest)

        def refused(_: str) -> bytes:
            self.turning.discard(axis)
            return b""

        asked = self._ask("moveaxis", now_utc_s, refused=refused, Axis=axis, Rate=rate_deg_s)
        self.turning.add(axis)
        self._pressed_utc_s = now_utc_s
        return asked

    def _halt(self, what: str, now_utc_s: float) -> Answer:
        """End one direction; without one, end the keys' motion, or stop the mount where that is not all.

        So the drive tracks on when a key is let go, and a stop stops everything.
        """
        if what in DIRECTIONS:
            return self._end_motion({DIRECTIONS[what][0]}, now_utc_s)
        if what:
            return b""
        state = self.telescope.state
        by_rates = state is not None and state.doing == MOVING_BY_RATES
        if state is not None and by_rates and self.turning and self.turning.issuperset(state.turning):
            return self._end_motion(self.turning, now_utc_s)
        self.turning.clear()
        return Asked((Abort(),))

    def _end_motion(self, axes: set[int], now_utc_s: float) -> Asked:
        state, ends = self.telescope.state, self._ends(axes)
        if not ends or self.turning or state is None or state.tracking:
            return Asked(ends)
        if state.doing != MOVING_BY_RATES and now_utc_s - self._pressed_utc_s > SEEN_WITHIN_S:
            # Somebody has stopped what the key began.
            return Asked(ends)
        # Most of these clients cannot set tracking: after a stop, a key is how they take it up.
        return Asked((*ends, TrackOrder(on=True)))

    def _ends(self, axes: set[int]) -> tuple[Order, ...]:
        """Return what ends the keys' motion of some axes."""
        ends = sorted(self.turning & axes)
        self.turning.difference_update(ends)
        return tuple(MoveOrder(axis, 0.0) for axis in ends)

    def _to_target(
        self, member: str, done: bytes, refused: Callable[[str], bytes], now_utc_s: float
    ) -> Answer:
        if self._ra_h is None or self._dec_deg is None:
            return Asked(refused=refused, objection="no target is set")
        try:
            return self._ask(
                member, now_utc_s, done, refused, RightAscension=self._ra_h, Declination=self._dec_deg
            )
        except Fault as fault:
            return Asked(refused=refused, objection=fault.message)

    def _not_slewed(self, why: str) -> bytes:
        return b"1" + _plain(why) + b"#" if self.gives_reasons else b"1"

    def _choose_rate(self, what: str, _: float) -> bytes:
        self._rate = what if what in RATES_DEG_S else self._rate
        return b""

    def _track(self, what: str, now_utc_s: float) -> Answer:
        if what == "Q":
            return self._ask("tracking", now_utc_s, Tracking=True)
        if what not in {"e", "d"}:
            return b""
        try:
            return self._ask("tracking", now_utc_s, b"1", lambda _: b"0", Tracking=what == "e")
        except Fault as fault:
            return Asked(refused=lambda _: b"0", objection=fault.message)

    def _align(self, what: str, now_utc_s: float) -> Answer:
        return self._ask("tracking", now_utc_s, Tracking=what == "P") if what in {"P", "L"} else b""

    def _place(self, what: str, now_utc_s: float) -> Answer:
        if what == "P":
            return self._ask("park", now_utc_s)
        if what in {"F", "C"}:
            return self._ask("findhome", now_utc_s)
        if what != "?":
            return b""
        state = self.telescope.heard(now_utc_s)
        return b"1" if state.at_home else b"2" if state.slewing else b"0"

    def _ask(
        self,
        member: str,
        now_utc_s: float,
        done: bytes = b"",
        refused: Callable[[str], bytes] = lambda _: b"",
        **values: float,
    ) -> Asked:
        order = self.telescope.order(member, self.client, now_utc_s, **values)
        return Asked(() if order is None else (order,), done, refused)


def _not_synced(why: str) -> bytes:
    return b"not synchronised: " + _plain(why) + b"#"


def _plain(words: str) -> bytes:
    """Return words as they may stand before the `#` that ends them."""
    return words.replace("#", " ").replace("°", "*").encode("ascii", "replace")


def _read_angle(text: str) -> float | None:
    found = _ANGLE.fullmatch(text)
    if found is None or int(found[3]) >= 60 or float(found[4] or 0.0) >= 60.0:
        return None
    angle = int(found[2]) + int(found[3]) / 60.0 + float(found[4] or 0.0) / 3600.0
    return -angle if found[1] == "-" else angle


def _read_hours(text: str) -> float | None:
    found = _HOURS.fullmatch(text)
    if found is None or float(found[2]) >= 60.0 or float(found[3] or 0.0) >= 60.0:
        return None
    hours = int(found[1]) + float(found[2]) / 60.0 + float(found[3] or 0.0) / 3600.0
    return hours if hours < 24.0 else None


def _hours_text(hours: float, is_long: bool) -> str:
    if is_long:
        seconds = round(hours * 3600.0) % 86400
        return f"{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}"
    tenths = round(hours * 600.0) % 14400
    return f"{tenths // 600:02d}:{tenths // 10 % 60:02d}.{tenths % 10}"


def _angle_text(angle_deg: float, is_long: bool, digits: int = 2, sign: str = "+") -> str:
    """Return an angle with its sign, or without where `sign` is empty: DD*MM or DD*MM'SS."""
    units = round(abs(angle_deg) * (3600.0 if is_long else 60.0))
    mark = "-" if angle_deg < 0.0 and units else sign
    if is_long:
        return f"{mark}{units // 3600:0{digits}d}*{units // 60 % 60:02d}'{units % 60:02d}"
    return f"{mark}{units // 60:0{digits}d}*{units % 60:02d}"


def _azimuth_text(azimuth_deg: float, is_long: bool) -> str:
    turn = 360 * (3600 if is_long else 60)
    rounded = round(azimuth_deg * turn / 360.0) % turn
    return _angle_text(rounded * 360.0 / turn, is_long, 3, "")


def _status(state: TelescopeState, device: Device) -> str:
    """Return how the mount stands, whether it tracks, and whether it is parked or at home."""
    place = "P" if state.at_park else "H" if state.at_home else "1"
    return f"{ALIGNMENTS[device.alignment]}{'T' if state.tracking else 'N'}{place}"


_REPORTED: dict[str, Callable[[TelescopeState, Device, bool], str]] = {
    "R": lambda state, _, is_long: _hours_text(state.ra_h, is_long),
    "D": lambda state, _, is_long: _angle_text(state.dec_deg, is_long),
    "A": lambda state, _, is_long: _angle_text(state.altitude_deg or 0.0, is_long),
    "Z": lambda state, _, is_long: _azimuth_text(state.azimuth_deg or 0.0, is_long),
    "S": lambda state, *_: _hours_text(state.sidereal_h, is_long=True),
    "T": lambda state, *_: "60.1" if state.tracking else "00.0",
    "W": lambda state, device, _: _status(state, device),
}
_FIXED: dict[str, Callable[[Device], str]] = {
    "t": lambda device: _angle_text(device.site.latitude_deg, is_long=False),
    "g": lambda device: _angle_text(math.remainder(-device.site.longitude_deg, 360.0), False, digits=3),
    "c": lambda _: "24",
    "VP": lambda _: "sattrack",
    **dict.fromkeys(("VN", "VD", "VT", "VF"), lambda device: device.version),
    **dict.fromkeys(("M", "N", "O", "P"), lambda _: "sattrack"),
}
_CLOCK = {"L": "%H:%M:%S", "a": "%I:%M:%S", "C": "%m/%d/%y"}
