"""An ASCOM Alpaca telescope with two axes anywhere (alt-az by default), from the ITelescopeV3 standard alone.

It is an HTTP program. Its axes turn as rigid bodies (Rodrigues rotations in east, north, up); what it reports
is where the tube really points, in its own mean sidereal time. It imports nothing of the package.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import socket
import sys
import threading
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qsl, urlsplit

STEP_S = 0.002
SIDEREAL_DEG_S = 360.98564736629 / 86400.0
J2000_POSIX_S = 946728000.0
NOT_IMPLEMENTED, INVALID_VALUE, NOT_CONNECTED, PARKED, INVALID_OPERATION = 1024, 1025, 1031, 1032, 1035
ARRIVED_DEG = 2e-4
SERVO_PER_S = 4.0
Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Parameters:
    """What kind of mount it is; the first axis points along `pole_*`."""

    latitude_deg: float = 52.0
    longitude_deg: float = 4.5
    elevation_m: float = 20.0
    pole_azimuth_deg: float = 0.0
    pole_altitude_deg: float = 90.0
    axes_deg: float = 90.0  # angle between the axes
    cone_deg: float = 0.0  # the tube leans towards the second axis by this much
    first_turn: int = (
        1  # sense of a positive MoveAxis rate: 1 clockwise seen from the pole's tip, -1 the other
    )
    second_turn: int = 1  # 1 towards the pole, -1 away from it
    first_gain: float = 1.0
    second_gain: float = 1.0
    alignment_mode: int = 0
    has_alignment_mode: bool = True
    max_rate_deg_s: float = 8.0
    min_rate_deg_s: float = 0.0  # MoveAxis refuses slower rates, other than 0
    acceleration_deg_s2: float = 10.0
    azimuth_deg: float = 180.0
    altitude_deg: float = 45.0
    tracking: bool = False
    reply_s: float = 0.0  # each answer takes this much longer
    refresh_s: float = 0.0  # the reported place is renewed this often


def _rotate(vector: Vector, about: Vector, angle_deg: float) -> Vector:
    """Turn a vector right-handed about a unit vector."""
    c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    dot = sum(a * b for a, b in zip(vector, about, strict=True)) * (1.0 - c)
    cross = (
        about[1] * vector[2] - about[2] * vector[1],
        about[2] * vector[0] - about[0] * vector[2],
        about[0] * vector[1] - about[1] * vector[0],
    )
    x, y, z = (v * c + k * s + a * dot for v, k, a in zip(vector, cross, about, strict=True))
    return x, y, z


def _towards(azimuth_deg: float, altitude_deg: float) -> Vector:
    """Unit vector east, north, up."""
    azimuth, altitude = math.radians(azimuth_deg), math.radians(altitude_deg)
    return (
        math.cos(altitude) * math.sin(azimuth),
        math.cos(altitude) * math.cos(azimuth),
        math.sin(altitude),
    )


class RefusedError(Exception):
    """A request that the standard answers with an error number."""

    def __init__(self, number: int, message: str) -> None:
        """Keep the number and the message."""
        super().__init__(message)
        self.number = number


class Telescope:
    """Two axes with acceleration limits; everything is a function of the instant asked for."""

    def __init__(self, parameters: Parameters, now_s: float) -> None:
        """Stand still at the starting direction."""
        self.p = parameters
        p = parameters
        self.pole = _towards(p.pole_azimuth_deg, p.pole_altitude_deg)
        # With angles zero the tube points "down the meridian" of the pole: away from it by 90 degrees.
        self.reference = _towards(p.pole_azimuth_deg, p.pole_altitude_deg - 90.0)
        west = _rotate(self.reference, self.pole, -90.0)
        self.second_axis = _rotate(west, self.reference, p.axes_deg - 90.0)
        lean = math.radians(p.cone_deg)
        pairs = zip(self.reference, self.second_axis, strict=True)
        x, y, z = (math.cos(lean) * a + math.sin(lean) * b for a, b in pairs)
        self.tube = (x, y, z)
        self.angles = [0.0, 0.0]
        self.speeds = [0.0, 0.0]
        self.now_s = now_s
        self.lock = threading.RLock()
        self.connected = False
        self.tracking = p.tracking
        self.parked = False
        self.moving: list[float | None] = [None, None]
        self.aim: list[float] | None = None
        self.target: list[float | None] = [None, None]
        self.sky: tuple[float, float] | None = None
        self.angles = self.solve(_towards(p.azimuth_deg, p.altitude_deg), [10.0, 10.0])
        self.shown_s, self.shown = -math.inf, (0.0, 0.0)

    def direction(self, angles: list[float]) -> Vector:
        """Where the tube points with the axes at these angles."""
        tube = _rotate(self.tube, self.second_axis, angles[1])
        return _rotate(tube, self.pole, -angles[0])

    def solve(self, wanted: Vector, start: list[float]) -> list[float]:
        """Axis angles that point there, near the start if it converges; by Newton's method."""
        best, best_off = start, math.inf
        for first in (start[0], start[0] + 90.0, start[0] - 90.0, start[0] + 180.0):
            for second in (start[1], 45.0, -45.0):
                angles = [first, second]
                for _ in range(40):
                    u = self.direction(angles)
                    off = [w - v for w, v in zip(wanted, u, strict=True)]
                    columns = []
                    for axis in (0, 1):
                        nudged = list(angles)
                        nudged[axis] += 1e-4
                        moved = self.direction(nudged)
                        columns.append([(m - v) / 1e-4 for m, v in zip(moved, u, strict=True)])
                    a, b = columns
                    aa, bb = sum(x * x for x in a), sum(x * x for x in b)
                    ab = sum(x * y for x, y in zip(a, b, strict=True))
                    fa = sum(x * y for x, y in zip(a, off, strict=True))
                    fb = sum(x * y for x, y in zip(b, off, strict=True))
                    det = aa * bb - ab * ab + 1e-15
                    step = [(bb * fa - ab * fb) / det, (aa * fb - ab * fa) / det]
                    for axis in (0, 1):
                        angles[axis] += max(-20.0, min(20.0, step[axis]))
                    if max(abs(s) for s in step) < 1e-9:
                        break
                off_deg = math.degrees(math.dist(self.direction(angles), wanted))
                if off_deg < 1e-6 and abs(angles[1]) <= 90.0:
                    angles[0] = start[0] + math.remainder(angles[0] - start[0], 360.0)
                    return angles
                if off_deg < best_off:
                    best, best_off = angles, off_deg
        return best

    def sidereal_deg(self, at_s: float) -> float:
        """Local mean sidereal time, degrees (UT1 taken as UTC)."""
        days = (at_s - J2000_POSIX_S) / 86400.0
        return (280.46061837 + 360.98564736629 * days + self.p.longitude_deg) % 360.0

    def horizontal(self) -> tuple[float, float]:
        """Azimuth and altitude of the tube, degrees."""
        east, north, up = self.direction(self.angles)
        return math.degrees(math.atan2(east, north)) % 360.0, math.degrees(
            math.atan2(up, math.hypot(east, north))
        )

    def equatorial(self, at_s: float) -> tuple[float, float]:
        """Right ascension and declination of the tube, degrees, by its own clock."""
        east, north, up = self.direction(self.angles)
        latitude = math.radians(self.p.latitude_deg)
        z = up * math.sin(latitude) + north * math.cos(latitude)
        x = up * math.cos(latitude) - north * math.sin(latitude)
        hour = math.degrees(math.atan2(-east, x))
        return (self.sidereal_deg(at_s) - hour) % 360.0, math.degrees(math.atan2(z, math.hypot(east, x)))

    def of_sky(self, ra_deg: float, dec_deg: float, at_s: float) -> Vector:
        """The direction of a place on the sky."""
        hour = math.radians(self.sidereal_deg(at_s) - ra_deg)
        dec, latitude = math.radians(dec_deg), math.radians(self.p.latitude_deg)
        x, east, z = math.cos(dec) * math.cos(hour), -math.cos(dec) * math.sin(hour), math.sin(dec)
        return (
            east,
            z * math.cos(latitude) - x * math.sin(latitude),
            z * math.sin(latitude) + x * math.cos(latitude),
        )

    def tracking_rates(self) -> list[float]:
        """Axis rates that hold the sky still in the tube, deg/s."""
        if not self.tracking or self.parked:
            return [0.0, 0.0]
        ra, dec = self.equatorial(self.now_s)
        after = self.solve(self.of_sky(ra, dec, self.now_s + 1.0), list(self.angles))
        return [b - a for a, b in zip(self.angles, after, strict=True)]

    def advance(self, to_s: float) -> None:
        """Move the axes on to an instant."""
        with self.lock:
            while self.now_s < to_s - 1e-9:
                span = min(STEP_S, to_s - self.now_s)
                if all(rate is not None for rate in self.moving):
                    base = [0.0, 0.0]
                else:
                    base = self.tracking_rates() if self.tracking else [0.0, 0.0]
                for axis, (turn, gain) in enumerate(
                    ((self.p.first_turn, self.p.first_gain), (self.p.second_turn, self.p.second_gain))
                ):
                    rate = self.moving[axis]
                    if rate is not None:
                        wanted = turn * gain * rate
                    elif self.aim is not None:
                        off = self.aim[axis] - self.angles[axis]
                        brake = math.sqrt(1.2 * self.p.acceleration_deg_s2 * abs(off))
                        wanted = base[axis] + math.copysign(min(brake, SERVO_PER_S * abs(off)), off)
                    else:
                        wanted = base[axis]
                    wanted = max(-self.p.max_rate_deg_s, min(self.p.max_rate_deg_s, wanted))
                    most = self.p.acceleration_deg_s2 * span
                    change = max(-most, min(most, wanted - self.speeds[axis]))
                    self.angles[axis] += (self.speeds[axis] + 0.5 * change) * span
                    self.speeds[axis] += change
                self.now_s += span
                if self.aim is not None:
                    if self.sky is not None:
                        self.aim = self.solve(self.of_sky(*self.sky, self.now_s), list(self.angles))
                    if all(abs(a - b) < ARRIVED_DEG for a, b in zip(self.aim, self.angles, strict=True)):
                        self.aim = self.sky = None

    def slewing(self) -> bool:
        """What the standard calls Slewing."""
        return self.aim is not None or any(rate is not None for rate in self.moving)

    def move_axis(self, axis: int, rate: float) -> None:
        """MoveAxis: a rate about an axis; zero gives the axis back to what it did before."""
        if self.parked:
            raise RefusedError(PARKED, "MoveAxis is refused while parked")
        borne = rate == 0.0 or self.p.min_rate_deg_s <= abs(rate) <= self.p.max_rate_deg_s
        if axis not in (0, 1) or not borne:
            raise RefusedError(INVALID_VALUE, f"no axis {axis} with a rate of {rate}")
        self.aim = self.sky = None
        self.moving[axis] = rate if rate else None

    def slew(self, wanted: Vector, sky: tuple[float, float] | None) -> None:
        """Start for a direction."""
        if self.parked:
            raise RefusedError(PARKED, "slews are refused while parked")
        if wanted[2] < 0.0:
            raise RefusedError(INVALID_VALUE, "the place is below the horizon")
        self.moving = [None, None]
        self.sky = sky
        self.aim = self.solve(wanted, list(self.angles))

    def place(self) -> tuple[float, float]:
        """The reported right ascension and declination, degrees, as fresh as the mount makes them."""
        if self.now_s - self.shown_s >= self.p.refresh_s:
            self.shown_s, self.shown = self.now_s, self.equatorial(self.now_s)
        return self.shown

    def truth(self) -> dict[str, float]:
        """Where everything is at the present instant."""
        azimuth, altitude = self.horizontal()
        ra, dec = self.equatorial(self.now_s)
        return {
            "utc_s": self.now_s,
            "first_deg": self.angles[0],
            "second_deg": self.angles[1],
            "first_deg_s": self.speeds[0],
            "second_deg_s": self.speeds[1],
            "azimuth_deg": azimuth,
            "altitude_deg": altitude,
            "ra_deg": ra,
            "dec_deg": dec,
        }


CONSTANTS: dict[str, Any] = {
    "interfaceversion": 3,
    "driverversion": "1.0",
    "driverinfo": "Two axes anywhere",
    "description": "A telescope with two axes",
    "name": "Two axes",
    "supportedactions": [],
    "equatorialsystem": 1,
    "trackingrate": 0,
    "trackingrates": [0],
    "doesrefraction": False,
    "rightascensionrate": 0.0,
    "declinationrate": 0.0,
    "athome": False,
    "ispulseguiding": False,
    "slewsettletime": 0,
    **dict.fromkeys(
        [
            "canfindhome",
            "cansetpark",
            "canpulseguide",
            "cansetdeclinationrate",
            "cansetguiderates",
            "cansetpierside",
            "cansetrightascensionrate",
            "cansync",
            "cansyncaltaz",
            "canslew",
            "canslewaltaz",
        ],
        False,
    ),
    **dict.fromkeys(["canpark", "canunpark", "cansettracking", "canslewasync", "canslewaltazasync"], True),
}
PUTS = {
    "tracking",
    "moveaxis",
    "abortslew",
    "park",
    "unpark",
    "slewtocoordinatesasync",
    "slewtotargetasync",
    "slewtoaltazasync",
    "targetrightascension",
    "targetdeclination",
}


def _flag(text: str) -> bool:
    """A boolean as Alpaca writes it."""
    if text.lower() not in ("true", "false"):
        raise ValueError(text)
    return text.lower() == "true"


def get(scope: Telescope, name: str, fields: dict[str, str]) -> Any:
    """The value of a property."""
    p, now = scope.p, scope.now_s
    if name == "connected":
        return scope.connected
    if name in CONSTANTS:
        return CONSTANTS[name]
    if not scope.connected:
        raise RefusedError(NOT_CONNECTED, "the telescope is not connected")
    if name == "alignmentmode" and p.has_alignment_mode:
        return p.alignment_mode
    if name == "canmoveaxis":
        return int(fields["axis"]) in (0, 1)
    if name == "axisrates":
        moves = int(fields["axis"]) in (0, 1)
        return [{"Minimum": p.min_rate_deg_s, "Maximum": p.max_rate_deg_s}] if moves else []
    if name in ("targetrightascension", "targetdeclination"):
        value = scope.target[name == "targetdeclination"]
        if value is None:
            raise RefusedError(1026, f"{name} was not set")
        return value
    ra, dec = scope.place()
    azimuth, altitude = scope.horizontal()
    values: dict[str, Any] = {
        "rightascension": ra / 15.0,
        "declination": dec,
        "azimuth": azimuth,
        "altitude": altitude,
        "siderealtime": scope.sidereal_deg(now) / 15.0,
        "slewing": scope.slewing(),
        "tracking": scope.tracking,
        "atpark": scope.parked,
        "sitelatitude": p.latitude_deg,
        "sitelongitude": p.longitude_deg,
        "siteelevation": p.elevation_m,
        "utcdate": datetime.fromtimestamp(now, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z"),
    }
    if name not in values:
        raise RefusedError(NOT_IMPLEMENTED, f"{name} is not implemented")
    return values[name]


def put(scope: Telescope, name: str, fields: dict[str, str]) -> None:
    """Set a property or call a method."""
    if name == "connected":
        scope.connected = _flag(fields["Connected"])
        return
    if not scope.connected:
        raise RefusedError(NOT_CONNECTED, "the telescope is not connected")
    if name not in PUTS:
        raise RefusedError(NOT_IMPLEMENTED, f"{name} is not implemented")
    if name == "tracking":
        scope.tracking = _flag(fields["Tracking"])
    elif name == "moveaxis":
        scope.move_axis(int(fields["Axis"]), float(fields["Rate"]))
    elif name == "abortslew":
        if scope.parked:
            raise RefusedError(PARKED, "AbortSlew is refused while parked")
        scope.aim = scope.sky = None
        scope.moving = [None, None]
    elif name == "park":
        scope.moving, scope.aim, scope.tracking, scope.parked = [None, None], None, False, True
    elif name == "unpark":
        scope.parked = False
    elif name == "slewtoaltazasync":
        if scope.tracking:
            raise RefusedError(INVALID_OPERATION, "SlewToAltAz is refused while Tracking is on")
        scope.slew(_towards(float(fields["Azimuth"]), float(fields["Altitude"])), None)
    elif name in ("targetrightascension", "targetdeclination"):
        _target(
            scope,
            name == "targetdeclination",
            float(next(iter(fields[k] for k in fields if k.startswith("Target")))),
        )
    else:
        if not scope.tracking:
            raise RefusedError(INVALID_OPERATION, "SlewToCoordinates is refused while Tracking is off")
        if name == "slewtocoordinatesasync":
            _target(scope, False, float(fields["RightAscension"]))
            _target(scope, True, float(fields["Declination"]))
        ra, dec = scope.target
        if ra is None or dec is None:
            raise RefusedError(1026, "no target was set")
        scope.slew(scope.of_sky(15.0 * ra, dec, scope.now_s), (15.0 * ra, dec))


def _target(scope: Telescope, is_dec: bool, value: float) -> None:
    """Keep one coordinate of the target."""
    if not (abs(value) <= 90.0 if is_dec else 0.0 <= value < 24.0):
        raise RefusedError(INVALID_VALUE, f"{value} is out of range")
    scope.target[is_dec] = value


class Handler(BaseHTTPRequestHandler):
    """HTTP to the telescope and back."""

    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True
    scope: Telescope

    def do_GET(self) -> None:
        """Answer a property."""
        self.answer("GET", dict(parse_qsl(urlsplit(self.path).query, keep_blank_values=True)))

    def do_PUT(self) -> None:
        """Answer a method."""
        body = self.rfile.read(int(self.headers.get("Content-Length") or 0)).decode()
        self.answer("PUT", dict(parse_qsl(body, keep_blank_values=True)))

    def answer(self, verb: str, fields: dict[str, str]) -> None:
        """Find what is asked for and reply in the standard's envelope."""
        path = urlsplit(self.path).path.lower().strip("/").split("/")
        lower = {key.lower(): value for key, value in fields.items()}
        envelope: dict[str, Any] = {
            "ClientTransactionID": int(lower.get("clienttransactionid", "0") or 0),
            "ServerTransactionID": time.monotonic_ns() % 2**31,
            "ErrorNumber": 0,
            "ErrorMessage": "",
        }
        scope = self.scope
        if scope.p.reply_s:
            time.sleep(scope.p.reply_s)
        status = 200
        try:
            if path == ["management", "apiversions"]:
                envelope["Value"] = [1]
            elif path == ["management", "v1", "description"]:
                envelope["Value"] = {
                    "ServerName": "Two axes",
                    "Manufacturer": "",
                    "ManufacturerVersion": "1",
                    "Location": "",
                }
            elif path == ["management", "v1", "configureddevices"]:
                device = {
                    "DeviceName": "Two axes",
                    "DeviceType": "Telescope",
                    "DeviceNumber": 0,
                    "UniqueID": "two-axes-0",
                }
                envelope["Value"] = [device]
            elif path[:4] != ["api", "v1", "telescope", "0"] or len(path) != 5:
                status = 400
            else:
                with scope.lock:
                    scope.advance(time.time())
                    if verb == "GET":
                        envelope["Value"] = get(scope, path[4], lower)
                    else:
                        put(scope, path[4], fields)
        except RefusedError as error:
            envelope["ErrorNumber"], envelope["ErrorMessage"] = error.number, str(error)
        except (KeyError, ValueError):
            status = 400
        payload = json.dumps(envelope).encode() if status == 200 else b"bad request"
        self.send_response(status)
        self.send_header("Content-Type", "application/json" if status == 200 else "text/plain")
        self.send_header("Content-Length", str(len(payload)))
        self.end_headers()
        self.wfile.write(payload)

    def log_message(self, *_: Any) -> None:
        """Write no log."""


class Server(ThreadingHTTPServer):
    """One thread a connection."""

    daemon_threads = True
    address_family = socket.AF_INET


def main(argv: list[str] | None = None) -> int:
    """Serve the telescope on the loopback until standard input ends."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--listen", type=int, default=0)
    parser.add_argument("--parameters", type=json.loads, default={})
    parser.add_argument("--truth", action="store_true", help="write where the axes are, 20 lines a second")
    options = parser.parse_args(argv)
    scope = Telescope(dataclasses.replace(Parameters(), **options.parameters), time.time())
    handler = type("Bound", (Handler,), {"scope": scope})
    server = Server(("127.0.0.1", options.listen), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    sys.stdout.write(json.dumps({"port": server.server_address[1]}) + "\n")
    sys.stdout.flush()
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    while not ended.wait(0.05):
        scope.advance(time.time())
        if options.truth:
            with scope.lock:
                sys.stdout.write(json.dumps(scope.truth()) + "\n")
                sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
