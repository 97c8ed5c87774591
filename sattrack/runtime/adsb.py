"""Aircraft by ADS-B: fixes out of what a receiver such as dump1090 serves, BaseStation lines or Beast frames.

`adsb:HOST:PORT/ICAO`, as adsb:localhost:30003/4CA2D6 (BaseStation, port 30003) or :30005 (Beast). Beast is
decoded by pyModeS, an extra. Instants are those of arrival by this computer's clock. Heights are those of the
pressure, as aircraft send them: hundreds of metres off where the air pressure is not the standard one.
"""

from __future__ import annotations

import math
import re
import select
import socket
import time
from typing import TYPE_CHECKING, Any

from sattrack.core.errors import BadInputError, SattrackError, how_to_install
from sattrack.views.messages import PlaceFix, encode_message
from tle.fixes import Fix, path_of
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from tle.ephemeris import TableEphemeris

PREFIX = "adsb:"
FOOT_M, KNOT_M_S, FOOT_MIN_M_S = 0.3048, 1852.0 / 3600.0, 0.3048 / 60.0
VELOCITY_LASTS_S = 10.0
FIRST_WITHIN_S, CONNECT_S = 20.0, 5.0
READ_BYTES, MOST_WAITING_BYTES = 65536, 1 << 20
_ADDRESS = re.compile(r"adsb:(\[[0-9a-fA-F:]+\]|[^:/\s]+):(\d{1,5})/([0-9a-fA-F]{6})", re.ASCII)
_ESCAPE = 0x1A
# Of each kind of Beast frame: the bytes of the message after seven of time and signal.
_BEAST_BYTES = {0x31: 2, 0x32: 7, 0x33: 14}


class Aircraft:
    """The last reports of an aircraft, its place and velocity, by its ICAO address in hexadecimal."""

    def __init__(self, icao: str) -> None:
        self.icao = icao.upper()
        self.callsign = ""
        self._height_m: float | None = None
        self._velocity: tuple[float, float, float] | None = None
        """East, north, up."""
        self._moved_s = float("-inf")
        self._pipe: Any = None

    def sbs(self, line: bytes, now_s: float) -> Fix | None:
        """Take a BaseStation line; return a fix where it completes one. What is none of it is passed over."""
        fields = [field.strip() for field in line.decode("ascii", "replace").split(",")]
        if len(fields) < 17 or fields[0] != "MSG" or fields[4].upper() != self.icao:
            return None
        self.callsign = fields[10] or self.callsign
        height, speed, track, lat, lon, climb = (_number(fields[k]) for k in (11, 12, 13, 14, 15, 16))
        self._note(height, speed, track, climb, now_s)
        return self._fix(lat, lon, now_s)

    def mode_s(self, message: bytes, now_s: float) -> Fix | None:
        """Take a Mode S message, as Beast frames hold them; return a fix where it completes one.

        Raises SattrackError without pyModeS.
        """
        # Of extended squitters (DF 17, 18) alone the address is in the clear.
        if len(message) != 14 or message[0] >> 3 not in (17, 18) or message[1:4].hex().upper() != self.icao:
            return None
        got = self._decoder().decode(message.hex().upper(), timestamp=now_s)
        if not got.get("crc_valid"):
            return None
        self.callsign = got.get("callsign") or self.callsign
        self._note(
            got.get("altitude"),
            got.get("groundspeed"),
            got.get("track"),
            got.get("vertical_rate"),
            now_s,
        )
        return self._fix(got.get("latitude"), got.get("longitude"), now_s)

    def _decoder(self) -> Any:
        if self._pipe is None:
            try:
                from pyModeS import PipeDecoder
            except ImportError:
                raise SattrackError(
                    f"Beast frames need pyModeS: {how_to_install('adsb')}, or take port 30003"
                ) from None
            self._pipe = PipeDecoder()
        return self._pipe

    def _note(
        self,
        height_ft: float | None,
        speed_kt: float | None,
        track_deg: float | None,
        climb_ft_min: float | None,
        now_s: float,
    ) -> None:
        if height_ft is not None:
            self._height_m = height_ft * FOOT_M
        if speed_kt is None or track_deg is None:
            return
        speed, track = speed_kt * KNOT_M_S, math.radians(track_deg)
        up = 0.0 if climb_ft_min is None else climb_ft_min * FOOT_MIN_M_S
        self._velocity, self._moved_s = (speed * math.sin(track), speed * math.cos(track), up), now_s

    def _fix(self, lat_deg: float | None, lon_deg: float | None, now_s: float) -> Fix | None:
        fresh = now_s - self._moved_s <= VELOCITY_LASTS_S
        if (
            lat_deg is None
            or lon_deg is None
            or self._height_m is None
            or self._velocity is None
            or not fresh
        ):
            return None
        return Fix(now_s, lat_deg, lon_deg, self._height_m, *self._velocity)


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def beast_messages(data: bytes) -> tuple[list[bytes], bytes]:
    """Return the whole Mode S messages in a stream of Beast frames, and the rest that is not whole yet."""
    found: list[bytes] = []
    at = 0
    while (begin := data.find(_ESCAPE, at)) >= 0 and begin + 1 < len(data):
        length = _BEAST_BYTES.get(data[begin + 1])
        if length is None:
            at = begin + (2 if data[begin + 1] == _ESCAPE else 1)
            continue
        body, k = bytearray(), begin + 2
        while len(body) < 7 + length and k < len(data):
            if data[k] == _ESCAPE:
                if k + 1 >= len(data):
                    return found, data[begin:]
                if data[k + 1] != _ESCAPE:
                    break
                k += 1
            body.append(data[k])
            k += 1
        if len(body) < 7 + length and k >= len(data):
            return found, data[begin:]
        if len(body) == 7 + length:
            found.append(bytes(body[7:]))
        at = k
    return found, data[begin:] if begin >= 0 else b""


class AdsbFeed:
    """Fixes of one aircraft from a receiver, as lines of JSON: a source that never waits."""

    def __init__(self, address: str, now: Callable[[], float] = time.time) -> None:
        """Connect. Raises BadInputError for an address that is none, SattrackError where nobody answers."""
        match = _ADDRESS.fullmatch(address)
        if match is None or not 0 < int(match[2]) < 65536:
            raise BadInputError(f"{address}: write adsb:HOST:PORT/ICAO, as adsb:localhost:30003/4CA2D6")
        self.aircraft = Aircraft(match[3])
        self._now = now
        self._rest = b""
        self._is_beast: bool | None = None
        """By the first byte that comes: later pieces may begin anywhere in a frame."""
        self.hung_up = False
        try:
            self._socket = socket.create_connection((match[1].strip("[]"), int(match[2])), CONNECT_S)
        except OSError as error:
            raise SattrackError(
                f"{address}: no receiver answers: {error.strerror or error}: start dump1090 with --net"
            ) from None
        self._socket.setblocking(False)

    def fixes(self) -> Iterator[Fix]:
        """Yield the fixes in what has come."""
        try:
            data = self._socket.recv(READ_BYTES)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self.hung_up = True
            return
        now_s = self._now()
        if self._is_beast is None:
            self._is_beast = data[0] == _ESCAPE
        data = (self._rest + data)[-MOST_WAITING_BYTES:]
        if self._is_beast:
            messages, self._rest = beast_messages(data)
            found = [self.aircraft.mode_s(message, now_s) for message in messages]
        else:
            *lines, self._rest = data.split(b"\n")
            found = [self.aircraft.sbs(line, now_s) for line in lines]
        yield from (fix for fix in found if fix is not None)

    def lines(self) -> Sequence[bytes]:
        """Return the last fix that has come, as a line of JSON."""
        fixes = list(self.fixes())[-1:]
        return [encode_message(PlaceFix(Utc(fix.utc_s).isoformat("microseconds"), *fix[1:])) for fix in fixes]

    def close(self) -> None:
        """Hang up."""
        self._socket.close()


def aircraft_now(address: str) -> TableEphemeris:
    """Return the path of an aircraft by its next fix. Raises SattrackError where none comes."""
    feed = AdsbFeed(address)
    try:
        deadline_s = time.monotonic() + FIRST_WITHIN_S
        while (left_s := deadline_s - time.monotonic()) > 0.0:
            select.select([feed._socket], [], [], left_s)
            for fix in feed.fixes():
                return path_of(feed.aircraft.callsign or feed.aircraft.icao, fix)
            if feed.hung_up:
                raise SattrackError(f"{address}: the receiver has closed the connection: see that it runs")
            time.sleep(0.02)
    finally:
        feed.close()
    raise SattrackError(
        f"{address}: no place and velocity of {feed.aircraft.icao} within {FIRST_WITHIN_S:g} s: "
        "see that it is received"
    )
