"""Where an Alpaca telescope is: `alpaca://HOST:PORT/DEVICE?hz=RATE`."""

from __future__ import annotations

import socket
from typing import TYPE_CHECKING, NamedTuple
from urllib.parse import parse_qs, urlsplit

from sattrack.core.errors import BadInputError
from sattrack.mount.model import AxisLimits, MountProfile
from sattrack.mount.requests import FindHome, FineRate, Park, TrackingRate

if TYPE_CHECKING:
    from sattrack.mount.requests import Request
    from tle.site import Site

DEFAULT_PORT = 11111
ON_TARGET_ARCSEC = 10.0
DEFAULT_HZ = 10.0
SLOWEST_HZ, FASTEST_HZ = 1.0, 20.0
FORM = "write alpaca://HOST:PORT/DEVICE, as alpaca://192.0.2.9:11111/0"
HALF_ROUND_TRIP_S = 0.015
"""What a telescope takes on either way where nothing is known of it."""


class AlpacaAddress(NamedTuple):
    """Where an Alpaca server listens, which of its telescopes is meant, and how often it is asked."""

    host: str
    port: int
    device: int
    hz: float = DEFAULT_HZ
    longitude_deg: float | None = None
    """That of the site whose sidereal time dates what is read; None: the telescope's own."""
    latitude_deg: float | None = None
    """That of the same site, for a telescope that does not tell its own."""
    stops_only: bool = False
    """Whether nothing but stops is asked of it: a stop is refused no telescope."""

    def __str__(self) -> str:
        """Return it as a user would write it."""
        return f"alpaca://{self.host}:{self.port}/{self.device}"

    @property
    def server(self) -> str:
        """Where its server listens."""
        return f"{self.host}:{self.port}"

    @property
    def name(self) -> str:
        """The name under which a mount is owned."""
        return str(self)

    @property
    def silence_advice(self) -> str:
        """What to check where it is not heard."""
        return (
            f"check that the Alpaca server at {self.host}:{self.port} runs and that its telescope "
            f"{self.device} is the mount"
        )

    @property
    def presumption(self) -> str | None:
        """What to say of a run without a calibration; None for nothing."""
        return (
            "this telescope is not calibrated: signs, gains, and whether MoveAxis replaces tracking, are "
            "presumed as the ASCOM standard has them; where it does not report its AlignmentMode, it is "
            "taken for an equatorial one; `sattrack mount calibrate` finds out"
        )

    @property
    def dates_itself(self) -> bool:
        """Whether statuses carry a clock of the mount's own; else the middle of each request dates them."""
        return False

    @property
    def on_target_arcsec(self) -> float:
        """How near to the satellite counts as on it: requests are dated to some milliseconds only."""
        return ON_TARGET_ARCSEC * max(1.0, DEFAULT_HZ / self.hz)

    def not_carried(self, request: Request) -> str | None:
        """Return why a request cannot be made to this kind of mount, as text; None where it can."""
        if not isinstance(request, Park | FindHome | FineRate | TrackingRate):
            return None
        return f"{self}: Alpaca telescopes are parked, sent home and given other rates by their own programs"

    def seen_from(self, site: Site) -> AlpacaAddress:
        """Return the address with the site's own place to reckon sidereal time and altitudes by."""
        return self._replace(longitude_deg=site.longitude_deg, latitude_deg=site.latitude_deg)

    def to_stop(self) -> AlpacaAddress:
        """Return the address for somebody who asks for stops alone."""
        return self._replace(stops_only=True)

    def usual_profile(self) -> MountProfile:
        """Return what is presumed of a telescope that was not calibrated: as the ASCOM standard has it."""
        limits = AxisLimits(max_rate_deg_s=4.0, max_acceleration_deg_s2=5.0, slew_rate_deg_s=4.0)
        return MountProfile(
            name=f"alpaca-{self.host}-{self.device}",
            ra=limits,
            dec=limits,
            additive=False,
            period_s=1.0 / self.hz,
            command_delay_s=HALF_ROUND_TRIP_S,
            status_delay_s=HALF_ROUND_TRIP_S,
            clock_offset_s=0.0,
            repeat_rates="never",
        )


def parse_alpaca(url: str, resolve: bool = True) -> AlpacaAddress:
    """Read `alpaca://HOST:PORT/DEVICE?hz=RATE`; raises BadInputError.

    Without `resolve`, nobody is asked where the host is, and it stays as it was written.
    """
    try:
        parts = urlsplit(url)
        port = parts.port if parts.port is not None else DEFAULT_PORT
        query = parse_qs(parts.query, keep_blank_values=True)
        if unknown := set(query) - {"hz"}:
            raise ValueError(f"{min(unknown)}= is no option")
        hz = float(query.get("hz", [str(DEFAULT_HZ)])[0])
        device_text = parts.path.strip("/") or "0"
        if not device_text.isdecimal():
            raise ValueError(f"{device_text!r} is no device number")
    except ValueError as error:
        raise BadInputError(f"--mount {url}: {error}; {FORM}") from error
    if parts.hostname is None:
        raise BadInputError(f"--mount {url}: no host; {FORM}")
    if not 1 <= port <= 65535:
        raise BadInputError(f"--mount {url}: the port is {port}; ports run from 1 to 65535")
    if not SLOWEST_HZ <= hz <= FASTEST_HZ:
        raise BadInputError(f"--mount {url}: hz is {hz:g}; it goes from {SLOWEST_HZ:g} to {FASTEST_HZ:g}")
    try:
        host = socket.gethostbyname(parts.hostname) if resolve else parts.hostname
    except (OSError, UnicodeError) as error:
        raise BadInputError(f"--mount {url}: no such host {parts.hostname!r}") from error
    return AlpacaAddress(host, port, int(device_text), hz)
