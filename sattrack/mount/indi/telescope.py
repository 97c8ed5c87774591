"""An INDI telescope as the gateway sees it, without I/O: its properties, and Alpaca's members in their terms.

MoveAxis is the rate of tracking (TELESCOPE_TRACK_RATE in the mode TRACK_CUSTOM), which turns an axis against
the ground; a rate of 0 gives sidereal tracking back, one below STANDS_ARCSEC_S has the first axis stand.
TELESCOPE_ABORT_MOTION alone is no stop: INDI's own simulator goes on at a custom rate after it, so the stop
is both. Source: "INDI: Instrument-Neutral Distributed Interface", protocol 1.7; property names are the
standard ones of INDI's telescopes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple, cast
from xml.etree.ElementTree import ParseError, XMLPullParser
from xml.sax.saxutils import quoteattr

from sattrack.mount.alpaca.client import NOT_CONNECTED, NOT_IMPLEMENTED, AlpacaRefusalError, NoAnswerError
from sattrack.mount.alpaca.device import PIER_WEST, DeviceFacts, RateSpan
from sattrack.mount.indi.numbers import read_number

if TYPE_CHECKING:
    from collections.abc import Iterator
    from xml.etree.ElementTree import Element

SIDEREAL_ARCSEC_S = 15.041067
ARCSEC = 3600.0
STANDS_ARCSEC_S = 0.01
LONGEST_MESSAGE = 1 << 20
CONNECTION, PLACE, ABORT = "CONNECTION", "EQUATORIAL_EOD_COORD", "TELESCOPE_ABORT_MOTION"
RATE, MODE, TRACKING = "TELESCOPE_TRACK_RATE", "TELESCOPE_TRACK_MODE", "TELESCOPE_TRACK_STATE"
PARK, PIER, SITE, ON_SET = "TELESCOPE_PARK", "TELESCOPE_PIER_SIDE", "GEOGRAPHIC_COORD", "ON_COORD_SET"
GUIDES = ("TELESCOPE_TIMED_GUIDE_NS", "TELESCOPE_TIMED_GUIDE_WE")
POLLING = "POLLING_PERIOD"
PULSES = {"0": (GUIDES[0], "TIMED_GUIDE_N"), "1": (GUIDES[0], "TIMED_GUIDE_S")} | {
    "2": (GUIDES[1], "TIMED_GUIDE_E"),
    "3": (GUIDES[1], "TIMED_GUIDE_W"),
}
"""By Alpaca's GuideDirections."""
Members = dict[str, str]


@dataclass(slots=True)
class Property:
    """One property as the device last sent it."""

    kind: str
    state: str
    values: Members
    highest: dict[str, float] = field(default_factory=dict)
    """Largest value of each number, by its definition."""
    updates: int = 0
    """How many messages about it have come."""


class Setting(NamedTuple):
    """A property to set: its kind, its name, and the new values."""

    kind: str
    name: str
    values: Members


@dataclass(slots=True)
class IndiTelescope:
    """The properties of one device, from a server's bytes; others' are left alone."""

    device: str
    properties: dict[str, Property] = field(default_factory=dict)
    others: set[str] = field(default_factory=set)
    """Names of the server's other devices."""
    message: str = ""
    """The last words of the device."""
    places: int = 0
    """How many places have come that the driver has read of its telescope."""
    _rates_arcsec_s: list[float] = field(default_factory=lambda: [0.0, 0.0])
    """The rates given to the axes; 0 for one that tracks."""
    _sent: tuple[float, float] = (SIDEREAL_ARCSEC_S, 0.0)
    """The rates of tracking that were sent last."""
    _parser: XMLPullParser[Element] = field(init=False)
    _root: Element | None = None
    _depth: int = 0
    _size: int = 0

    def __post_init__(self) -> None:
        """Open the document that the server's messages are the parts of."""
        self._parser = XMLPullParser(("start", "end"))
        self._parser.feed(b"<indi>")

    def anew(self) -> IndiTelescope:
        """Return it as it is known on a new connection: by the rates alone that were given to its axes."""
        return IndiTelescope(self.device, _rates_arcsec_s=self._rates_arcsec_s, _sent=self._sent)

    def feed(self, data: bytes) -> None:
        """Take a server's bytes. Raises NoAnswerError for what is no INDI."""
        self._size += len(data)
        try:
            self._parser.feed(data)
            events = cast("Iterator[tuple[str, Element]]", self._parser.read_events())
            for event, element in events:
                self._depth += 1 if event == "start" else -1
                if self._root is None:
                    self._root = element
                elif event == "end" and self._depth == 1:
                    self._take(element)
                    self._root.remove(element)
                    self._size = 0
        except ParseError as error:
            raise NoAnswerError("what it sends is no INDI") from error
        if self._size > LONGEST_MESSAGE:
            raise NoAnswerError("it sends a message without an end")

    def _take(self, element: Element) -> None:
        device, name = element.get("device", self.device), element.get("name", "")
        if device != self.device:
            self.others.add(device)
            return
        self.message = element.get("message") or self.message
        if element.tag == "delProperty":
            self.properties = {key: one for key, one in self.properties.items() if name and key != name}
            return
        begin, kind = element.tag[:3], element.tag[3:].removesuffix("Vector")
        if not element.tag.endswith("Vector") or begin not in {"def", "set"}:
            return
        values = {one.get("name", ""): (one.text or "").strip() for one in element}
        known = self.properties.get(name)
        if begin == "def" or known is None:
            highest = {one.get("name", ""): read_number(one.get("max")) or 0.0 for one in element}
            updates = 0 if known is None else known.updates
            known = self.properties[name] = Property(kind, "Idle", {}, highest, updates)
        known.values |= values
        known.state = element.get("state", known.state)
        known.updates += 1
        # A driver that cannot read its telescope repeats the last place, in Alert.
        self.places += name == PLACE and known.state != "Alert"

    # What the telescope can do, and how it stands.

    @property
    def connected(self) -> bool | None:
        """Whether the driver is connected to its telescope; None before that is known."""
        found = self.properties.get(CONNECTION)
        return None if found is None else found.values.get("CONNECT") == "On"

    @property
    def ready(self) -> bool:
        """Whether all is known that decides what the telescope can do."""
        return self.connected is True and all(name in self.properties for name in (PLACE, ABORT))

    def facts(self) -> DeviceFacts:
        """Return what it can do, in Alpaca's terms."""
        latitude, longitude = (read_number(self._values(SITE).get(key)) for key in ("LAT", "LONG"))
        if not latitude and not longitude:
            latitude = longitude = None
        rate = self.properties.get(RATE)
        spans = tuple(
            (RateSpan(0.0, highest / ARCSEC),) if (highest := _highest(rate, name)) > 0.0 else ()
            for name in ("TRACK_RATE_RA", "TRACK_RATE_DE")
        )
        return DeviceFacts(
            name=self.device,
            moved_by=f"{RATE} (rates of tracking)",
            stops_without_rates=True,
            latitude_deg=latitude,
            longitude_deg=None if longitude is None else math.remainder(longitude, 360.0),
            can_set_tracking=TRACKING in self.properties,
            can_slew=ON_SET in self.properties,
            can_sync="SYNC" in self._values(ON_SET),
            can_pulse_guide=all(name in self.properties for name in GUIDES),
            primary_rates=spans[0] if MODE in self.properties else (),
            secondary_rates=spans[1] if MODE in self.properties else (),
        )

    def value(self, member: str) -> Any:
        """Return a member's value. Raises AlpacaRefusalError where the device does not tell it."""
        if self.connected is not True:
            raise AlpacaRefusalError(NOT_CONNECTED, "the driver is not connected to its telescope")
        values = {
            "rightascension": read_number(self._values(PLACE).get("RA")),
            "declination": read_number(self._values(PLACE).get("DEC")),
            "slewing": self._state(PLACE) == "Busy",
            "tracking": self._values(TRACKING).get("TRACK_ON") == "On",
            "atpark": self._values(PARK).get("PARK") == "On" and self._state(PARK) != "Busy",
            "sideofpier": PIER_WEST if self._values(PIER).get("PIER_WEST") == "On" else 0,
            "ispulseguiding": any(self._state(name) == "Busy" for name in GUIDES),
        }
        if member not in values:
            raise AlpacaRefusalError(NOT_IMPLEMENTED, f"{member} is nothing of INDI's")
        return values[member]

    def settings(self, member: str, fields: Members) -> list[Setting]:
        """Return the properties that carry out an order. Raises AlpacaRefusalError where one is missing."""
        found = self._settings(member, fields)
        for one in found:
            if one.name not in self.properties:
                raise AlpacaRefusalError(NOT_IMPLEMENTED, f"the driver has no {one.name}")
        return found

    def _settings(self, member: str, fields: Members) -> list[Setting]:
        if member == "abortslew":
            return [Setting("Switch", ABORT, {"ABORT": "On"})]
        if member == "moveaxis":
            return self._move(int(fields["Axis"]), ARCSEC * float(fields["Rate"]))
        if member == "tracking":
            return [_switch(TRACKING, "TRACK_ON" if fields["Tracking"] == "true" else "TRACK_OFF")]
        if member in {"slewtocoordinatesasync", "synctocoordinates"}:
            how = "TRACK" if member.startswith("slew") else "SYNC"
            place = {"RA": fields["RightAscension"], "DEC": fields["Declination"]}
            return [_switch(ON_SET, how), Setting("Number", PLACE, place)]
        if member == "pulseguide":
            name, key = PULSES[fields["Direction"]]
            return [Setting("Number", name, {key: fields["Duration"]})]
        raise AlpacaRefusalError(NOT_IMPLEMENTED, f"{member} is nothing of INDI's")

    def _move(self, axis: int, rate_arcsec_s: float) -> list[Setting]:
        self._rates_arcsec_s[axis] = rate_arcsec_s
        if RATE not in self.properties and not rate_arcsec_s:
            return []
        primary, secondary = self._rates_arcsec_s
        stands = 0.0 < abs(primary) < STANDS_ARCSEC_S
        before, self._sent = self._sent, (0.0 if stands else primary or SIDEREAL_ARCSEC_S, secondary)
        found = [_rate(*self._sent)]
        if not (primary or secondary):
            return [*found, _switch(MODE, "TRACK_SIDEREAL")]
        if self._values(MODE).get("TRACK_CUSTOM") != "On":
            return [*found, _switch(MODE, "TRACK_CUSTOM")]
        turns = [was * now < 0.0 for was, now in zip(before, self._sent, strict=True)]
        if any(turns):
            # Drivers refuse to reverse a rate that is in force, other than through 0.
            through = [0.0 if turned else now for turned, now in zip(turns, self._sent, strict=True)]
            found.insert(0, _rate(*through))
        return found

    def _values(self, name: str) -> Members:
        found = self.properties.get(name)
        return {} if found is None else found.values

    def _state(self, name: str) -> str:
        found = self.properties.get(name)
        return "Idle" if found is None else found.state

    def message_of(self, setting: Setting) -> bytes:
        """Return what sets a property."""
        kind, device, name = setting.kind, quoteattr(self.device), quoteattr(setting.name)
        ones = "".join(
            f"<one{kind} name={quoteattr(key)}>{value}</one{kind}>" for key, value in setting.values.items()
        )
        return f"<new{kind}Vector device={device} name={name}>{ones}</new{kind}Vector>\n".encode()

    def question(self, name: str) -> bytes:
        """Return what asks for one property as it is now."""
        return f'<getProperties version="1.7" device={quoteattr(self.device)} name="{name}"/>\n'.encode()

    def greeting(self) -> bytes:
        """Return what asks for the device's properties, and for what changes."""
        return f'<getProperties version="1.7" device={quoteattr(self.device)}/>\n'.encode()


def _rate(primary_arcsec_s: float, secondary_arcsec_s: float) -> Setting:
    rates = {"TRACK_RATE_RA": f"{primary_arcsec_s:.6f}", "TRACK_RATE_DE": f"{secondary_arcsec_s:.6f}"}
    return Setting("Number", RATE, rates)


def _switch(name: str, on: str) -> Setting:
    return Setting("Switch", name, {on: "On"})


def _highest(rate: Property | None, name: str) -> float:
    return 0.0 if rate is None else rate.highest.get(name, 0.0)
