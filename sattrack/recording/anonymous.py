"""A recording moved to another longitude and hour, so that it can be shown and still be run again.

Labels alone hide nothing: sidereal time with UTC gives the longitude, and so do directions to a satellite
with its elements. So the site goes round the Earth's axis, and all instants with the sidereal time that it
has there: right ascensions, hour angles and every datagram stay what they were. What cannot be moved is
in docs/recordings.md: the latitude, and the orbit's own numbers.
"""

from __future__ import annotations

import math
import secrets
import struct
from typing import TYPE_CHECKING, Any

import erfa
import msgspec
import numpy as np

from sattrack.core.angles import wrap180
from sattrack.core.errors import BadInputError
from sattrack.mount.xerxes.datagrams import STATUS_FIELDS, STATUS_LENGTH
from sattrack.recording.format import COMMAND, FAILURE, OPERATOR, REPEAT, STATUS, SUMMARY, VIEW
from sattrack.recording.observed import FRAMES
from sattrack.recording.reading import GAP
from sattrack.recording.recorder import Recorder
from tle.earth import EarthOrientation, to_tirs
from tle.instants import Utc
from tle.residuals import apparent_unit
from tle.site import Site

if TYPE_CHECKING:
    from typing import BinaryIO

    from numpy.typing import NDArray

    from sattrack.recording.reading import Recording

LEAST_S, MOST_S = 3600, 11 * 3600
NUMBER = 99999
"""The catalogue number that stands for every object."""
WITHHELD = "withheld"
_CHANGED: dict[str, Any] = {
    "name": "anonymous",
    "designator": "",
    "catalog_number": NUMBER,
    "element_set_number": 0,
    "revolution_number": 0,
    "recording": "anonymous.mcap",
    "message": WITHHELD,
    "words": WITHHELD,
    "recording_trouble": WITHHELD,
    "bias_memory": WITHHELD,
    "warnings": [],
    "horizon": [],
}
"""What stands in the place of fields that may reveal who, where or what; null stays null."""
_JSON = {OPERATOR, VIEW, SUMMARY, FAILURE}
_AT = {field.name: field.offset for field in STATUS_FIELDS}
_DOUBLE = struct.Struct("<d")
_ROUNDS = 8
WGS84 = 1
"""ERFA's number of the ellipsoid."""


def random_shift_s() -> int:
    """Return by how many seconds to move, from 1 to 11 hours either way, as nobody can foretell."""
    seconds = LEAST_S + secrets.randbelow(MOST_S - LEAST_S)
    return seconds if secrets.randbits(1) else -seconds


def write_anonymous(recording: Recording, stream: BinaryIO, shift_s: int) -> None:
    """Write a recording moved by a time and the longitude that goes with it.

    Raises BadInputError where its facts cannot be read. A gap stays a gap.
    """
    header = recording.header
    try:
        facts = msgspec.json.decode(header.spec)
        if facts["elements"] is None:
            raise BadInputError(
                f"{recording.path}: only a run by element sets can be moved to another place and time, and "
                "this one followed the rows of a file, or a body"
            )
        moving = _Moving(facts, shift_s)
        spec = msgspec.Raw(msgspec.json.encode(moving.facts(facts)))
    except (msgspec.MsgspecError, KeyError, TypeError, AttributeError) as error:
        raise BadInputError(f"{recording.path}: the run's facts cannot be read: {error}") from error
    moved = msgspec.structs.replace(header, spec=spec, anonymous=True)
    recorder = Recorder(stream, spec, moved)
    for entry in recording.entries():
        if entry.topic == GAP:
            recorder.skip()
        elif entry.topic == STATUS:
            recorder.write(STATUS, entry.utc_s + shift_s, moving.status(entry.data))
        elif entry.topic in {COMMAND, REPEAT}:
            recorder.write(entry.topic, entry.utc_s + shift_s, entry.data)
        elif entry.topic in _JSON:
            try:
                value = msgspec.json.decode(entry.data)
            except msgspec.MsgspecError:
                recorder.skip()
                continue
            recorder.write(entry.topic, entry.utc_s + shift_s, msgspec.json.encode(moving.value("", value)))
    recorder.close()
    if recorder.trouble is not None:
        raise BadInputError(recorder.trouble)


def write_as_it_is(recording: Recording, stream: BinaryIO) -> None:
    """Write what could be read of a recording as a file that is whole; raises BadInputError."""
    recorder = Recorder(stream, recording.header.spec, recording.header)
    for entry in recording.entries():
        if entry.topic == GAP:
            recorder.skip()
        else:
            recorder.write(*entry)
    recorder.close()
    if recorder.trouble is not None:
        raise BadInputError(recorder.trouble)


class _Moving:
    """One way of moving: by a time, and to where sidereal time is then what it was."""

    def __init__(self, facts: dict[str, Any], shift_s: int) -> None:
        self._shift_s = shift_s
        site = facts["site"]
        here = Site(site["latitude_deg"], site["longitude_deg"], site.get("height_m", 0.0))
        plan = facts["plan"]
        middle_utc_s = 0.5 * (plan["start_utc_s"] + plan["end_utc_s"])
        self._here = here
        self.site, self._equinoxes_deg = _moved_site(here, middle_utc_s, shift_s)
        self._north_deg = self.site.latitude_deg - here.latitude_deg
        self._east_deg = self.site.longitude_deg - here.longitude_deg

    def facts(self, facts: dict[str, Any]) -> dict[str, Any]:
        """Return a run's facts, moved."""
        moved: dict[str, Any] = self.value("", facts)
        site, elements = self.site, moved["elements"]
        place = {"latitude_deg": site.latitude_deg, "longitude_deg": site.longitude_deg}
        moved["site"] = place | {"height_m": site.height_m}
        elements["epoch"] = facts["elements"]["epoch"] + self._shift_s
        elements["raan_deg"] = (elements["raan_deg"] + self._equinoxes_deg) % 360.0
        profile = moved.get("profile", {})
        if profile.get("stands_at") is not None:
            profile["stands_at"] = place
        return moved

    def value(self, key: str, value: Any) -> Any:
        """Return a field's value: instants moved, what reveals who, where or what replaced."""
        if key in _CHANGED and value is not None:
            return _CHANGED[key]
        if isinstance(value, dict):
            moved = {name: self.value(name, one) for name, one in value.items()}
            return moved | self._seen_there(value) if value.get("type") == "observation" else moved
        if isinstance(value, list):
            return [self.value(key, one) for one in value]
        if isinstance(value, str):
            return self._text(key, value)
        return value + self._shift_s if key.endswith("utc_s") and value is not None else value

    def _seen_there(self, seen: dict[str, Any]) -> dict[str, float]:
        """Return where among the stars the same direction of date is, hours later: stars move by 0.1″."""
        frame = FRAMES.get(seen["frame"], "of_date")
        then, ra_deg, dec_deg = Utc.parse(seen["utc"]), seen["ra_deg"], seen["dec_deg"]
        if frame == "of_date":
            return {}
        earth, later = EarthOrientation.installed(), then.plus(float(self._shift_s))
        wanted = _angles_deg(apparent_unit(ra_deg, dec_deg, then, frame, self._here, earth))
        for _ in range(_ROUNDS):
            found = _angles_deg(apparent_unit(ra_deg, dec_deg, later, frame, self.site, earth))
            ra_deg += wrap180(wanted[0] - found[0])
            dec_deg = max(-90.0, min(90.0, dec_deg + wanted[1] - found[1]))
        return {"ra_deg": ra_deg % 360.0, "dec_deg": dec_deg}

    def _text(self, key: str, value: str) -> str:
        if key in {"mount", "mount_name"}:
            return value if value == "sim" else "mount"
        if key == "utc" or key.endswith("_utc"):
            return Utc.parse(value).plus(float(self._shift_s)).isoformat("microseconds")
        return value

    def status(self, data: bytes) -> bytes:
        """Return a status with its site moved as ours is; what is no status is blanked."""
        if len(data) != STATUS_LENGTH:
            return bytes(len(data))
        moved = bytearray(data)
        north, east = _AT["site_latitude_deg"], _AT["site_longitude_deg"]
        latitude_deg, longitude_deg = (_DOUBLE.unpack_from(data, at)[0] for at in (north, east))
        if latitude_deg or longitude_deg:
            _DOUBLE.pack_into(moved, north, latitude_deg + self._north_deg)
            _DOUBLE.pack_into(moved, east, wrap180(longitude_deg + self._east_deg))
        for name in ("utc_1", "utc_2", "utc_3"):
            moved[_AT[name]] = 0
        return bytes(moved)


def _angles_deg(unit: NDArray[np.float64]) -> tuple[float, float]:
    x, y, z = (float(one) for one in unit)
    return math.degrees(math.atan2(y, x)), math.degrees(math.atan2(z, math.hypot(x, y)))


def _moved_site(site: Site, utc_s: float, shift_s: int) -> tuple[Site, float]:
    """Return where sidereal time and pole are after a time what they are here, and how far nodes go with it.

    The equation of the equinoxes changes by some tenths of an arcsecond meanwhile: orbit and site take it up.
    Polar motion shifts a site by metres, elsewhere in another direction.
    """
    earth = EarthOrientation.installed()
    theta, _, equinoxes, _, xp, yp = earth.rotation(utc_s)
    later_theta, _, later_equinoxes, _, later_xp, later_yp = earth.rotation(utc_s + shift_s)
    nodes = equinoxes - later_equinoxes
    turn = theta - later_theta + nodes
    x, y, z = to_tirs(site.itrs_km, xp, yp)
    cosine, sine = math.cos(turn), math.sin(turn)
    place = (x * cosine - y * sine, x * sine + y * cosine, z)
    return _site_at(to_tirs(place, -later_xp, -later_yp)), math.degrees(nodes)


def _site_at(itrs_km: tuple[float, float, float]) -> Site:
    """Return the site of a position, its height to a millimetre."""
    longitude, latitude, height_m = erfa.gc2gd(WGS84, np.multiply(itrs_km, 1000.0))
    return Site(math.degrees(latitude), math.degrees(longitude), round(float(height_m), 3))
