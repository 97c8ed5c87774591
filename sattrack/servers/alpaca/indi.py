"""INDI's telescope for clients of the telescope that Alpaca's see: XML in, XML and orders out, without I/O.

Properties and their elements are the standard ones of INDI's telescopes, as the simulator of INDI 1.9 defines
them; a satellite comes as two-line elements. All clients see one device. Source: "INDI: Instrument-Neutral
Distributed Interface", protocol 1.7. Places are of date, right ascension in hours, longitudes eastward from 0
to 360°.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import TYPE_CHECKING, NamedTuple, cast
from xml.etree.ElementTree import ParseError, XMLPullParser
from xml.sax.saxutils import escape, quoteattr

from sattrack.core.angles import separation_deg
from sattrack.mount.indi.numbers import read_number
from sattrack.mount.requests import Abort
from sattrack.servers.alpaca.lx200 import (
    CLOCK_WITHIN_S,
    PLACE_WITHIN_DEG,
    RATES_DEG_S,
    Asked,
)
from sattrack.servers.alpaca.protocol import MOVING_BY_RATES, Fault, MoveOrder, Number

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from xml.etree.ElementTree import Element

    from sattrack.servers.alpaca.protocol import Order, TelescopeState
    from sattrack.servers.alpaca.telescope import ServedTelescope

DEVICE = "sattrack"
LONGEST_MESSAGE = 65536
DEEPEST = 3
PROLOG, PROLOG_INSIDE = b"<?xml", b"<?indi"
"""How an XML prolog begins, which clients may send before a message, and how it may within an element."""
KEPT_MESSAGES = 32
THERE_WITHIN_DEG = 1.0
"""A slew that ends farther from its place was ended by somebody."""
TELESCOPE_AND_GUIDER = 1 | 4
IDLE, OK, BUSY, ALERT = "Idle", "Ok", "Busy", "Alert"
MAIN, MOTION, SITE, SATELLITE, GENERAL = (
    "Main Control", "Motion Control", "Site Management", "Satellite", "Connection",
)  # fmt: skip
ABORT, SATELLITE_STATE = "TELESCOPE_ABORT_MOTION", "SAT_TRACKING_STAT"


class Vector(NamedTuple):
    """A property: its kind, where clients show it, and its elements with their labels or number formats."""

    kind: str
    name: str
    group: str
    elements: tuple[tuple[str, ...], ...]
    rule: str = ""
    is_set: bool = True


def _number(name: str, layout: str, low: float, high: float) -> tuple[str, ...]:
    return name, layout, f"{low:g}", f"{high:g}"


_PLACE = (_number("RA", "%010.6m", 0, 24), _number("DEC", "%010.6m", -90, 90))
_ONE, _MOST = "OneOfMany", "AtMostOne"
VECTORS = (
    Vector("Switch", "CONNECTION", MAIN, (("CONNECT",), ("DISCONNECT",)), _ONE),
    Vector(
        "Text",
        "DRIVER_INFO",
        GENERAL,
        (("DRIVER_NAME",), ("DRIVER_EXEC",), ("DRIVER_VERSION",), ("DRIVER_INTERFACE",)),
        is_set=False,
    ),
    Vector("Switch", "ON_COORD_SET", MAIN, (("TRACK",), ("SLEW",), ("SYNC",)), _ONE),
    Vector("Number", "EQUATORIAL_EOD_COORD", MAIN, _PLACE),
    Vector("Number", "TARGET_EOD_COORD", MOTION, _PLACE, is_set=False),
    Vector("Switch", ABORT, MAIN, (("ABORT",),), _MOST),
    Vector("Switch", "TELESCOPE_TRACK_MODE", MAIN, (("TRACK_SIDEREAL",),), _ONE),
    Vector("Switch", "TELESCOPE_TRACK_STATE", MAIN, (("TRACK_ON",), ("TRACK_OFF",)), _ONE),
    Vector("Switch", "TELESCOPE_MOTION_NS", MOTION, (("MOTION_NORTH",), ("MOTION_SOUTH",)), _MOST),
    Vector("Switch", "TELESCOPE_MOTION_WE", MOTION, (("MOTION_WEST",), ("MOTION_EAST",)), _MOST),
    Vector("Switch", "TELESCOPE_SLEW_RATE", MOTION, (("1x",), ("2x",), ("3x",), ("4x",)), _ONE),
    Vector("Switch", "TELESCOPE_PARK", MAIN, (("PARK",), ("UNPARK",)), _ONE),
    Vector("Switch", "TELESCOPE_PIER_SIDE", MAIN, (("PIER_WEST",), ("PIER_EAST",)), _MOST, is_set=False),
    Vector(
        "Number",
        "TELESCOPE_TIMED_GUIDE_NS",
        MOTION,
        (_number("TIMED_GUIDE_N", "%.f", 0, 60000), _number("TIMED_GUIDE_S", "%.f", 0, 60000)),
    ),
    Vector(
        "Number",
        "TELESCOPE_TIMED_GUIDE_WE",
        MOTION,
        (_number("TIMED_GUIDE_W", "%.f", 0, 60000), _number("TIMED_GUIDE_E", "%.f", 0, 60000)),
    ),
    Vector("Text", "TIME_UTC", SITE, (("UTC",), ("OFFSET",))),
    Vector(
        "Number",
        "GEOGRAPHIC_COORD",
        SITE,
        (
            _number("LAT", "%012.8m", -90, 90),
            _number("LONG", "%012.8m", 0, 360),
            _number("ELEV", "%g", -200, 10000),
        ),
    ),
    Vector("Text", "SAT_TLE_TEXT", SATELLITE, (("TLE",),)),
    Vector("Text", "SAT_PASS_WINDOW", SATELLITE, (("SAT_PASS_WINDOW_END",), ("SAT_PASS_WINDOW_START",))),
    Vector("Switch", SATELLITE_STATE, SATELLITE, (("SAT_TRACK",), ("SAT_HALT",)), _ONE),
)
BY_NAME = {vector.name: vector for vector in VECTORS}
PLACE, PARK, TRACKING = "EQUATORIAL_EOD_COORD", "TELESCOPE_PARK", "TELESCOPE_TRACK_STATE"
MOTIONS = {"TELESCOPE_MOTION_NS": 1, "TELESCOPE_MOTION_WE": 0}
"""The axis that each turns."""
GUIDES = ("TELESCOPE_TIMED_GUIDE_NS", "TELESCOPE_TIMED_GUIDE_WE")
MOVERS = frozenset((PLACE, PARK, TRACKING, SATELLITE_STATE, *MOTIONS, *GUIDES))
"""The properties whose setting may move the mount."""
RATES = {"1x": "G", "2x": "C", "3x": "M", "4x": "S"}
AXES = {
    "MOTION_NORTH": (1, 1.0),
    "MOTION_SOUTH": (1, -1.0),
    "MOTION_WEST": (0, 1.0),
    "MOTION_EAST": (0, -1.0),
}
PULSES = {"TIMED_GUIDE_N": 0, "TIMED_GUIDE_S": 1, "TIMED_GUIDE_E": 2, "TIMED_GUIDE_W": 3}
Values = tuple[str, ...]


class MessageReader:
    """Whole messages from a client's bytes; what is no XML, or stands between them, is another protocol."""

    def __init__(self) -> None:
        # Within an element no entity can be declared, so that nothing expands.
        self._parser: XMLPullParser[Element] = XMLPullParser(("start", "end"))
        self._parser.feed(b"<indi>")
        self._depth = self._size = 0
        self._root: Element | None = None
        self._kept = b""
        """What a prolog may begin with."""

    def read(self, data: bytes) -> list[Element] | None:
        """Return the messages that are complete; None where the client must be disconnected."""
        self._size += len(data)
        found: list[Element] = []
        data = (self._kept + data).replace(PROLOG, PROLOG_INSIDE)
        begun = max(n for n in range(len(PROLOG)) if data.endswith(PROLOG[:n]))
        self._kept = PROLOG[:begun]
        try:
            self._parser.feed(data.removesuffix(self._kept))
            for event, element in self._events():
                self._depth += 1 if event == "start" else -1
                if self._root is None:
                    self._root = element
                elif event == "end" and self._depth == 1:
                    found.append(element)
                    self._size = 0
                if not 0 < self._depth <= DEEPEST:
                    return None
        except ParseError:
            return None
        if self._root is None or self._size > LONGEST_MESSAGE or self._has_text(self._root):
            return None
        if found:
            # The last one stays: what stands after it may be still to come.
            del self._root[: list(self._root).index(found[-1])]
        return found

    def _events(self) -> Iterator[tuple[str, Element]]:
        yield from cast("Iterator[tuple[str, Element]]", self._parser.read_events())

    @staticmethod
    def _has_text(root: Element) -> bool:
        return any((text or "").strip() for text in (root.text, *(element.tail for element in root)))


def set_by(message: Element) -> str | None:
    """Return the name of the property that a message is to set, None where that is none of ours."""
    vector = BY_NAME.get(message.get("name", ""))
    if vector is None or message.get("device") != DEVICE:
        return None
    return vector.name if message.tag == f"new{vector.kind}Vector" else None


class TrackElements(NamedTuple):
    """A satellite to follow, as text of two-line elements."""

    text: str


@dataclass(slots=True)
class ServedIndiDevice:
    """The device that all INDI clients see; `client` is its number at the telescope."""

    telescope: ServedTelescope
    client: int
    turning: dict[int, int] = field(default_factory=dict)
    """The axes that clients' keys turn, and which client's."""
    messages: list[tuple[int, str]] = field(default_factory=list)
    """What was said last, numbered from 1."""
    settings: Counter[str] = field(default_factory=Counter)
    """How often clients have set each property: all of them hear the answer, though nothing of it changes."""
    _states: dict[str, str] = field(default_factory=dict)
    _waiting: set[str] = field(default_factory=set)
    """The properties whose orders are not under way yet."""
    _on_coord: str = "TRACK"
    _rate: str = "3x"
    _target: tuple[float, float] = (0.0, 0.0)
    _texts: dict[str, Values] = field(default_factory=dict)
    _place: Values | None = None
    """The last place that the mount reported."""

    def take(self, message: Element, caller: int, now_utc_s: float) -> Asked | TrackElements | None:
        """Return what a client's message asks for. Raises Fault where it is refused; `refuse` tells that."""
        name = set_by(message)
        if name is None or not BY_NAME[name].is_set:
            return None
        vector = BY_NAME[name]
        values = {one.get("name", ""): (one.text or "").strip() for one in message}
        if vector.name == ABORT:
            self.turning.clear()
            return self._asked(ABORT, Abort())
        if vector.name == "CONNECTION":
            order = "connect" if values.get("CONNECT") == "On" else "disconnect"
            self.telescope.order(order, self.client, now_utc_s)
            self._states.pop(vector.name, None)
        elif vector.name in MOVERS and not self.telescope.connected(self.client):
            # KStars sends its time and place as soon as it sees the properties.
            raise Fault(Number.NOT_CONNECTED, "connect first")
        if vector.name in MOTIONS:
            return self._turn(vector.name, values, caller, now_utc_s)
        if vector.name in GUIDES:
            return self._guide(vector.name, values, now_utc_s)
        takes = _TAKES.get(vector.name)
        return None if takes is None else takes(self, values, now_utc_s)

    def carried_out(self, name: str) -> None:
        """Note that what a property asked for is under way, or was refused."""
        self._waiting.discard(name)

    def refuse(self, name: str, why: str) -> None:
        """Tell all clients that a property could not be set."""
        if name in BY_NAME:
            self._states[name] = ALERT
        number = self.messages[-1][0] + 1 if self.messages else 1
        self.messages = [*self.messages, (number, why)][-KEPT_MESSAGES:]

    def left(self, caller: int) -> Asked:
        """Return what ends the motions of a client that is gone."""
        ends = [axis for axis, whose in self.turning.items() if whose == caller]
        for axis in ends:
            del self.turning[axis]
        return Asked(tuple(MoveOrder(axis, 0.0) for axis in ends))

    def _asked(self, name: str, *orders: Order | None, state: str = OK) -> Asked:
        def refused(why: str) -> bytes:
            self.refuse(name, why)
            return b""

        self._states[name] = state
        self._waiting.add(name)
        return Asked(tuple(one for one in orders if one is not None), b"", refused)

    def _order(self, member: str, now_utc_s: float, **values: float) -> Order | None:
        return self.telescope.order(member, self.client, now_utc_s, **values)

    def _take_on_coord_set(self, values: Mapping[str, str], _: float) -> None:
        self._on_coord = _chosen(values, self._on_coord)
        self._states["ON_COORD_SET"] = OK

    def _take_telescope_slew_rate(self, values: Mapping[str, str], _: float) -> None:
        self._rate = _chosen(values, self._rate)
        self._states["TELESCOPE_SLEW_RATE"] = OK

    def _take_telescope_track_mode(self, values: Mapping[str, str], _: float) -> None:
        if values.get("TRACK_SIDEREAL") != "On":
            raise Fault(Number.INVALID_VALUE, "TELESCOPE_TRACK_MODE: this mount tracks at the sidereal rate")
        self._states["TELESCOPE_TRACK_MODE"] = OK

    def _take_equatorial_eod_coord(self, values: Mapping[str, str], now_utc_s: float) -> Asked:
        ra_h, dec_deg = _read(values.get("RA")), _read(values.get("DEC"))
        syncs = self._on_coord == "SYNC"
        member = "synctocoordinates" if syncs else "slewtocoordinatesasync"
        order = self._order(member, now_utc_s, RightAscension=ra_h, Declination=dec_deg)
        self._target = ra_h, dec_deg
        return self._asked(PLACE, order, state=OK if syncs else BUSY)

    def _turn(self, name: str, values: Mapping[str, str], caller: int, now_utc_s: float) -> Asked:
        axis = MOTIONS[name]
        key = _chosen(values, "")
        if key not in AXES:
            self.turning.pop(axis, None)
            return self._asked(name, MoveOrder(axis, 0.0))
        _, sense = AXES[key]
        fastest = max((high for _, high in self.telescope.device.axis_rates_deg_s(axis)), default=0.0)
        rate_deg_s = sense * min(RATES_DEG_S[RATES[self._rate]], fastest)
        order = self._order("moveaxis", now_utc_s, Axis=axis, Rate=rate_deg_s)
        self.turning[axis] = caller
        self._texts[name] = (key,)
        asked = self._asked(name, order)

        def refused(why: str) -> bytes:
            self.turning.pop(axis, None)
            return asked.refused(why)

        return asked._replace(refused=refused)

    def _take_telescope_track_state(self, values: Mapping[str, str], now_utc_s: float) -> Asked:
        on = _chosen(values, "") == "TRACK_ON"
        return self._asked(TRACKING, self._order("tracking", now_utc_s, Tracking=on))

    def _take_telescope_park(self, values: Mapping[str, str], now_utc_s: float) -> Asked | None:
        parks = _chosen(values, "") == "PARK"
        if not parks and not self.telescope.heard(now_utc_s).at_park:
            return None
        return self._asked(PARK, self._order("park" if parks else "unpark", now_utc_s), state=BUSY)

    def _guide(self, name: str, values: Mapping[str, str], now_utc_s: float) -> Asked:
        for key, text in values.items():
            ms = round(_read(text))
            if key in PULSES and ms > 0:
                order = self._order("pulseguide", now_utc_s, Direction=PULSES[key], Duration=ms)
                return self._asked(name, order, state=BUSY)
        return self._asked(name)

    def _take_time_utc(self, values: Mapping[str, str], now_utc_s: float) -> None:
        try:
            given = datetime.fromisoformat(values.get("UTC", "")).replace(tzinfo=UTC).timestamp()
        except ValueError as error:
            raise Fault(Number.INVALID_VALUE, f"TIME_UTC: {error}") from error
        if abs(given - now_utc_s) > CLOCK_WITHIN_S:
            raise Fault(Number.INVALID_VALUE, f"this computer's clock is {given - now_utc_s:+.0f} s off that")
        self._texts["TIME_UTC"] = ("", values.get("OFFSET", "0"))
        self._states["TIME_UTC"] = OK

    def _take_geographic_coord(self, values: Mapping[str, str], _: float) -> None:
        site = self.telescope.device.site
        north, east = _read(values.get("LAT")), _read(values.get("LONG"))
        off_deg = max(abs(north - site.latitude_deg), abs(math.remainder(east - site.longitude_deg, 360.0)))
        if off_deg > PLACE_WITHIN_DEG:
            where = f"{site.latitude_deg:.4f}, {site.longitude_deg:.4f}"
            raise Fault(Number.INVALID_VALUE, f"the site is set to {where}; it is not changed from here")
        self._states["GEOGRAPHIC_COORD"] = OK

    def _take_sat_tle_text(self, values: Mapping[str, str], _: float) -> None:
        self._texts["SAT_TLE_TEXT"] = (values.get("TLE", ""),)
        self._states["SAT_TLE_TEXT"] = OK

    def _take_sat_pass_window(self, values: Mapping[str, str], _: float) -> None:
        names = ("SAT_PASS_WINDOW_END", "SAT_PASS_WINDOW_START")
        self._texts["SAT_PASS_WINDOW"] = tuple(values.get(name, "") for name in names)
        self._states["SAT_PASS_WINDOW"] = OK

    def _take_sat_tracking_stat(self, values: Mapping[str, str], _: float) -> Asked | TrackElements:
        if _chosen(values, "") != "SAT_TRACK":
            return self._asked(SATELLITE_STATE, Abort(), state=IDLE)
        (text,) = self._texts.get("SAT_TLE_TEXT", ("",))
        if not text:
            raise Fault(Number.INVALID_VALUE, "SAT_TLE_TEXT: send the satellite's elements first")
        self._states[SATELLITE_STATE] = BUSY
        self._waiting.add(SATELLITE_STATE)
        return TrackElements(text)

    def values(self, now_utc_s: float) -> dict[str, tuple[str, Values]]:
        """Return the state and the values of each property, in the order of its elements."""
        device, site = self.telescope.device, self.telescope.device.site
        connected = self.telescope.connected(self.client)
        found: dict[str, Values] = {
            "CONNECTION": _switches(connected, not connected),
            "DRIVER_INFO": (device.name, DEVICE, device.version, str(TELESCOPE_AND_GUIDER)),
            "ON_COORD_SET": _switches(*(self._on_coord == one for one in ("TRACK", "SLEW", "SYNC"))),
            "TARGET_EOD_COORD": tuple(f"{one:.9g}" for one in self._target),
            ABORT: _switches(False),
            "TELESCOPE_TRACK_MODE": _switches(True),
            "TELESCOPE_SLEW_RATE": _switches(*(self._rate == one for one in RATES)),
            "TELESCOPE_TIMED_GUIDE_NS": ("0", "0"),
            "TELESCOPE_TIMED_GUIDE_WE": ("0", "0"),
            "TIME_UTC": (
                datetime.fromtimestamp(now_utc_s, UTC).strftime("%Y-%m-%dT%H:%M:%S"),
                self._texts.get("TIME_UTC", ("", "0"))[1],
            ),
            "GEOGRAPHIC_COORD": (
                f"{site.latitude_deg:.9g}",
                f"{site.longitude_deg % 360.0:.9g}",
                f"{site.height_m:.9g}",
            ),
            "SAT_TLE_TEXT": self._texts.get("SAT_TLE_TEXT", ("",)),
            "SAT_PASS_WINDOW": self._texts.get("SAT_PASS_WINDOW", ("", "")),
        }
        states = {"CONNECTION": OK if connected else IDLE, **self._states}
        try:
            found |= self._reported(self.telescope.heard(now_utc_s), states)
            self._place = found[PLACE]
        except Fault:
            states[PLACE] = ALERT
            if self._place is not None:
                found[PLACE] = self._place
        return {name: (states.get(name, IDLE), values) for name, values in found.items()}

    def _reported(self, state: TelescopeState, states: dict[str, str]) -> dict[str, Values]:
        """Return what the mount reports, and end the states that were busy with what is over."""
        following = state.following is not None
        over = {PLACE: not state.slewing, PARK: not state.slewing, SATELLITE_STATE: not following}
        over |= dict.fromkeys(GUIDES, not state.pulse_guiding)
        for name, is_over in over.items():
            if states.get(name) == BUSY and is_over and name not in self._waiting:
                self._end(name, state)
                states[name] = self._states[name]
        if state.slewing:
            states[PLACE] = BUSY
        if states.get(TRACKING) != ALERT:
            states[TRACKING] = BUSY if state.tracking else IDLE
        if following:
            states[SATELLITE_STATE] = BUSY
        # A stop by another protocol, or by a limit, ends what keys turn, and no key says so.
        moves = state.doing == MOVING_BY_RATES
        turned = {
            name
            for name, axis in MOTIONS.items()
            if axis in self.turning and (moves or name in self._waiting)
        }
        states |= {name: BUSY if name in turned else IDLE for name in MOTIONS}
        keys = {
            name: _switches(
                *(name in turned and self._texts.get(name) == key for key in BY_NAME[name].elements)
            )
            for name in MOTIONS
        }
        return keys | {
            PLACE: (f"{state.ra_h:.9g}", f"{state.dec_deg:.9g}"),
            TRACKING: _switches(state.tracking, not state.tracking),
            PARK: _switches(state.at_park, not state.at_park),
            "TELESCOPE_PIER_SIDE": _switches(state.beyond_pole, not state.beyond_pole),
            SATELLITE_STATE: _switches(following, not following),
        }

    def _end(self, name: str, state: TelescopeState) -> None:
        """Note that what a property asked for is over: it failed, is done, or was ended by somebody."""
        if state.failure is not None and name not in GUIDES:
            self.refuse(name, state.failure)
            return
        ra_h, dec_deg = self._target
        off_deg = separation_deg(15.0 * state.ra_h, state.dec_deg, 15.0 * ra_h, dec_deg)
        done = (name == PLACE and off_deg < THERE_WITHIN_DEG) or (name == PARK and state.at_park)
        self._states[name] = OK if done else IDLE


_TAKES: dict[str, Callable[[ServedIndiDevice, Mapping[str, str], float], Asked | TrackElements | None]] = {
    "ON_COORD_SET": ServedIndiDevice._take_on_coord_set,
    "TELESCOPE_SLEW_RATE": ServedIndiDevice._take_telescope_slew_rate,
    "TELESCOPE_TRACK_MODE": ServedIndiDevice._take_telescope_track_mode,
    PLACE: ServedIndiDevice._take_equatorial_eod_coord,
    TRACKING: ServedIndiDevice._take_telescope_track_state,
    PARK: ServedIndiDevice._take_telescope_park,
    "TIME_UTC": ServedIndiDevice._take_time_utc,
    "GEOGRAPHIC_COORD": ServedIndiDevice._take_geographic_coord,
    "SAT_TLE_TEXT": ServedIndiDevice._take_sat_tle_text,
    "SAT_PASS_WINDOW": ServedIndiDevice._take_sat_pass_window,
    SATELLITE_STATE: ServedIndiDevice._take_sat_tracking_stat,
}


class ClientView:
    """What one client knows of the device; `definitions` and `changes` give what it does not know yet."""

    def __init__(self, device: ServedIndiDevice) -> None:
        self._device = device
        self._wanted: set[str] = set()
        """The properties that it has asked for; some are not there while the mount is not heard."""
        self._told: dict[str, tuple[str, Values]] = {}
        self._settings: dict[str, int] = {}
        self._last = device.messages[-1][0] if device.messages else 0

    def definitions(self, asked: Element, now_utc_s: float) -> bytes:
        """Return the answer to getProperties."""
        # A server that chains all devices of another one, `indiserver @HOST`, asks for "*".
        if asked.get("device") not in {None, "", "*", DEVICE}:
            return b""
        now = self._device.values(now_utc_s)
        names = [one.name for one in VECTORS if asked.get("name") in {None, "", one.name}]
        self._wanted.update(names)
        return "".join(self._define(name, now[name]) for name in names if name in now).encode()

    def changes(self, now_utc_s: float) -> bytes:
        """Return what has changed of what this client knows."""
        parts = []
        for name, value in self._device.values(now_utc_s).items():
            if name not in self._told:
                parts += [self._define(name, value)] if name in self._wanted else []
                continue
            was_set = self._settings[name] != self._device.settings[name]
            if was_set or (self._told[name] != value and not self._is_clock(name, value)):
                self._told[name], self._settings[name] = value, self._device.settings[name]
                parts.append(_setting(BY_NAME[name], *value))
        for number, words in self._device.messages:
            if number > self._last:
                self._last = number
                parts.append(f"<message device={quoteattr(DEVICE)} message={quoteattr(words)}/>\n")
        return "".join(parts).encode()

    def _define(self, name: str, value: tuple[str, Values]) -> str:
        self._told[name], self._settings[name] = value, self._device.settings[name]
        return _definition(BY_NAME[name], *value)

    def _is_clock(self, name: str, value: tuple[str, Values]) -> bool:
        return name == "TIME_UTC" and self._told[name][0] == value[0]


def _chosen(values: Mapping[str, str], otherwise: str) -> str:
    return next((name for name, value in values.items() if value == "On"), otherwise)


def _switches(*on: bool) -> Values:
    return tuple("On" if one else "Off" for one in on)


def _read(text: str | None) -> float:
    """Return the number that a text is. Raises Fault."""
    value = read_number(text)
    if value is None:
        raise Fault(Number.INVALID_VALUE, f"{text!r} is no number")
    return value


def _definition(vector: Vector, state: str, values: Values) -> str:
    kind = vector.kind
    permission = "rw" if vector.is_set else "ro"
    rule = f" rule={quoteattr(vector.rule)}" if vector.rule else ""
    name = quoteattr(vector.name)
    parts = [
        f"<def{kind}Vector device={quoteattr(DEVICE)} name={name} label={name} "
        f'group={quoteattr(vector.group)} state="{state}" perm="{permission}"{rule} timeout="60">\n'
    ]
    for (element, *layout), value in zip(vector.elements, values, strict=True):
        shape = ""
        if layout:
            style, low, high = layout
            shape = f' format={quoteattr(style)} min="{low}" max="{high}" step="0"'
        called = f"name={quoteattr(element)} label={quoteattr(element)}"
        parts.append(f"<def{kind} {called}{shape}>{escape(value)}</def{kind}>\n")
    return "".join([*parts, f"</def{kind}Vector>\n"])


def _setting(vector: Vector, state: str, values: Values) -> str:
    kind = vector.kind
    parts = [f'<set{kind}Vector device={quoteattr(DEVICE)} name={quoteattr(vector.name)} state="{state}">\n']
    parts += [
        f"<one{kind} name={quoteattr(name)}>{escape(value)}</one{kind}>\n"
        for (name, *_), value in zip(vector.elements, values, strict=True)
    ]
    return "".join([*parts, f"</set{kind}Vector>\n"])
