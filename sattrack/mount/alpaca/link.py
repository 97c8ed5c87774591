"""An Alpaca or INDI telescope's gateway, started and ended, and the messages on its channel.

Towards the session the gateway is a mount behind a UDP socket on loopback.
"""

from __future__ import annotations

import contextlib
import socket
import subprocess
import sys
from typing import TYPE_CHECKING, NamedTuple
from urllib.parse import parse_qs, quote, unquote, urlsplit

import msgspec

from sattrack.core.channel import Channel, start_process
from sattrack.core.errors import BadInputError, LinkLostError, SattrackError
from sattrack.mount.alpaca.device import GERMAN, DeviceFacts
from sattrack.mount.model import USUAL_TRAVEL_DEG, AxisLimits, MountProfile
from sattrack.mount.requests import FindHome, FineRate, Park, TrackingRate
from sattrack.mount.xerxes.client import Address, UdpLink, bind

if TYPE_CHECKING:
    from sattrack.mount.requests import Request
    from tle.site import Site

DEFAULT_PORT = 11111
DEFAULT_PORTS = {"alpaca": DEFAULT_PORT, "indi": 7624}
ON_TARGET_ARCSEC = 10.0
DEFAULT_HZ = 10.0
SLOWEST_HZ, FASTEST_HZ = 2.0, 20.0
FORM = (
    "write alpaca://HOST:PORT/DEVICE, as alpaca://192.0.2.9:11111/0; "
    "`sattrack init --mount alpaca` finds out which answer"
)
INDI_FORM = "write indi://HOST:PORT/DEVICE, as indi://192.0.2.9:7624/EQMod%20Mount"
HALF_ROUND_TRIP_S = 0.015
"""What a telescope takes on either way where nothing is known of it."""


class AlpacaAddress(NamedTuple):
    """Where a server listens, which of its telescopes is meant, and how often it is asked."""

    host: str
    port: int
    device: int | str
    """The number of an Alpaca telescope, or the name of an INDI device."""
    hz: float = DEFAULT_HZ
    longitude_deg: float | None = None
    """That of the site whose sidereal time dates what is read; None: the telescope's own."""
    latitude_deg: float | None = None
    """That of the same site, for a telescope that does not tell its own."""
    stops_only: bool = False
    """Whether nothing but stops is asked of it: a stop is refused no telescope."""
    axes_known: bool = False
    """Whether the profile that it is driven by tells how its axes lie."""

    def __str__(self) -> str:
        """Return it as a user would write it."""
        return f"{self.scheme}://{self.host}:{self.port}/{quote(str(self.device))}"

    @property
    def scheme(self) -> str:
        """The protocol: alpaca or indi."""
        return "indi" if isinstance(self.device, str) else "alpaca"

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
        if self.scheme == "indi":
            return (
                f"check that indiserver runs at {self.host}:{self.port} and that {self.device!r} is "
                "a telescope of its drivers"
            )
        return (
            f"check that the Alpaca server at {self.host}:{self.port} runs and that its telescope "
            f"{self.device} is the mount"
        )

    @property
    def presumption(self) -> str | None:
        """What to say of a run without a calibration; None for nothing."""
        if self.scheme == "indi":
            return (
                "this telescope is not calibrated: signs, gains and delays of its tracking rates are "
                "assumed; `sattrack mount calibrate` finds out"
            )
        return (
            "this telescope is not calibrated: signs, gains, and whether MoveAxis replaces tracking, are "
            "assumed as the ASCOM standard has them; a telescope that does not report its AlignmentMode is "
            "assumed to be equatorial; `sattrack mount calibrate` finds out"
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
        kind = "INDI" if self.scheme == "indi" else "Alpaca"
        return f"{self}: {kind} telescopes are parked, sent home and given other rates by their own programs"

    def seen_from(self, site: Site) -> AlpacaAddress:
        """Return the address with the site's own place for sidereal time and altitudes."""
        return self._replace(longitude_deg=site.longitude_deg, latitude_deg=site.latitude_deg)

    def to_stop(self) -> AlpacaAddress:
        """Return the address for somebody who asks for stops alone."""
        return self._replace(stops_only=True)

    def usual_profile(self) -> MountProfile:
        """Return what is presumed of a telescope that was not calibrated: as the ASCOM standard has it."""
        limits = AxisLimits(max_rate_deg_s=4.0, max_acceleration_deg_s2=5.0, slew_rate_deg_s=4.0)
        return MountProfile(
            name=f"{self.scheme}-{self.host}-{self.device}",
            ra=limits,
            dec=limits,
            additive=False,
            period_s=1.0 / self.hz,
            command_delay_s=HALF_ROUND_TRIP_S,
            status_delay_s=HALF_ROUND_TRIP_S,
            clock_offset_s=0.0,
            dated_by_requests=True,
            repeat_rates="never",
        )


def parse_alpaca(url: str, resolve: bool = True) -> AlpacaAddress:
    """Read `alpaca://HOST:PORT/DEVICE?hz=RATE`, or the same of `indi`; raises BadInputError.

    Without `resolve`, nobody is asked where the host is, and it stays as it was written.
    """
    form = INDI_FORM if url.partition(":")[0] == "indi" else FORM
    try:
        if "://" not in url:
            raise ValueError("no host")
        parts = urlsplit(url)
        port = parts.port if parts.port is not None else DEFAULT_PORTS[parts.scheme]
        query = parse_qs(parts.query, keep_blank_values=True)
        if unknown := set(query) - {"hz"}:
            raise ValueError(f"{min(unknown)}= is no option")
        hz = float(query.get("hz", [str(DEFAULT_HZ)])[0])
        device = _device_of(parts.scheme, unquote(parts.path.strip("/")))
    except ValueError as error:
        raise BadInputError(f"--mount {url}: {error}; {form}") from error
    if parts.hostname is None:
        raise BadInputError(f"--mount {url}: no host; {form}")
    if not 1 <= port <= 65535:
        raise BadInputError(f"--mount {url}: the port is {port}; ports run from 1 to 65535")
    if not SLOWEST_HZ <= hz <= FASTEST_HZ:
        raise BadInputError(f"--mount {url}: hz is {hz:g}; it goes from {SLOWEST_HZ:g} to {FASTEST_HZ:g}")
    try:
        host = socket.gethostbyname(parts.hostname) if resolve else parts.hostname
    except (OSError, UnicodeError) as error:
        raise BadInputError(
            f"--mount {url}: no such host {parts.hostname!r}; check the name, or give its IPv4 address"
        ) from error
    return AlpacaAddress(host, port, device, hz)


def _device_of(scheme: str, text: str) -> int | str:
    """Return a device's number, or its name. Raises ValueError."""
    if scheme == "indi":
        if not text:
            raise ValueError("no device")
        return text
    if not (text or "0").isdecimal():
        raise ValueError(f"{text!r} is no device number")
    return int(text or "0")


class GatewayConfig(msgspec.Struct, frozen=True):
    """A gateway's task."""

    address: AlpacaAddress
    peer_port: int
    channel: int


class GatewayReady(msgspec.Struct, frozen=True, tag=True):
    """It stands between: its port on loopback, and the telescope."""

    port: int
    facts: DeviceFacts


class GatewayRefusal(msgspec.Struct, frozen=True, tag=True):
    """It cannot, and why; `link` where nothing that answers is there."""

    words: str
    link: bool


class GatewayNews(msgspec.Struct, frozen=True, tag=True):
    """What is wrong with the telescope; None where nothing is any more."""

    words: str | None


START_WITHIN_S = 30.0
END_WITHIN_S = 5.0
BYE = b"bye\n"
"""The session's last word to its gateway: it has seen the stop through."""
_News = msgspec.json.Decoder(GatewayNews)


def pier_doubt(profile: MountProfile, facts: DeviceFacts) -> str | None:
    """Return what in a profile does not fit the sides of a telescope's pier, as text; None for nothing."""
    if profile.geometry is not None:
        return None
    if profile.pier_rule == "hour_angle":
        return (
            'pier_rule in the profile is "hour_angle", and ASCOM and INDI telescopes stand beyond the pole '
            'in the east: set "ascom"'
        )
    if profile.pier_rule == "never" and facts.alignment_mode == GERMAN:
        return (
            'this is a German telescope, and pier_rule in the profile is "never": set "ascom", or slews that '
            "change the side of its pier are stopped"
        )
    if profile.pier_rule == "ascom" and profile.dec_axis_limits_deg == USUAL_TRAVEL_DEG:
        return (
            "dec_axis_limits_deg in the profile is -190 to 190, and beyond the pole a German telescope turns "
            "farther: set [-270, 270]"
        )
    return None


class GatewayLink(UdpLink):
    """The socket towards a gateway, and what the gateway reports of its telescope.

    `profile` is that by which the telescope is driven, None where it is not known.
    """

    def __init__(
        self,
        address: Address,
        bound: socket.socket,
        process: subprocess.Popen[bytes],
        channel: Channel,
        facts: DeviceFacts,
        profile: MountProfile | None = None,
    ) -> None:
        super().__init__(address, bound)
        self.facts = facts
        self._doubt = None if profile is None else pier_doubt(profile, facts)
        self.largest_rates_deg_s = facts.fastest_deg_s(0), facts.fastest_deg_s(1)
        self._process = process
        self._channel = channel
        self._trouble: str | None = None

    @property
    def trouble(self) -> str | None:
        """What is wrong with the telescope, as last reported by the gateway, or with its profile."""
        self._hear_news()
        return self._trouble or self._doubt

    def close(self) -> None:
        """Give the port back; the gateway ends once the telescope rests, or is in its guardian's hands."""
        self._channel.send(BYE)
        self._channel.close()
        super().close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(END_WITHIN_S)

    def _hear_news(self) -> None:
        for line in self._channel.lines():
            with contextlib.suppress(msgspec.MsgspecError):
                self._trouble = _News.decode(line).words


LOOK_WITHIN_S = 2.0


def check_server(address: AlpacaAddress) -> None:
    """Raise LinkLostError where the server's host says that nothing listens there; silence says nothing."""
    with contextlib.suppress(OSError):
        try:
            socket.create_connection((address.host, address.port), LOOK_WITHIN_S).close()
        except ConnectionRefusedError:
            raise LinkLostError(f"{address}: nothing listens there: start the telescope's driver") from None


def open_gateway(address: AlpacaAddress, profile: MountProfile | None = None) -> GatewayLink:
    """Start a gateway and return the socket towards it; `profile` as in GatewayLink.

    Raises LinkLostError where no telescope answers, SattrackError where it cannot be driven.
    """
    bound = bind("127.0.0.1", 0)
    ours, theirs = socket.socketpair()
    config = GatewayConfig(address, int(bound.getsockname()[1]), theirs.fileno())
    with theirs:
        # The end of the session must not end the gateway before the telescope is stopped.
        process = start_process(
            "sattrack.mount.alpaca.gateway_process",
            msgspec.json.encode(config).decode(),
            inherits=(theirs.fileno(),),
        )
    channel = Channel(ours.detach())
    try:
        ready = _first_word(channel, address)
    except SattrackError:
        channel.close()
        bound.close()
        process.kill()
        process.wait()
        raise
    ours_at = Address("127.0.0.1", ready.port, config.peer_port)
    return GatewayLink(ours_at, bound, process, channel, ready.facts, profile)


def _first_word(channel: Channel, address: AlpacaAddress) -> GatewayReady:
    lines = channel.first(START_WITHIN_S)
    if not lines and not channel.ended:
        raise LinkLostError(f"{address}: no answer within {START_WITHIN_S:g} s")
    if not lines:
        raise SattrackError(
            f"{address}: the gateway did not start; "
            f"`{sys.executable} -m sattrack.mount.alpaca.gateway_process` shows why"
        )
    word = msgspec.json.decode(lines[0], type=GatewayReady | GatewayRefusal)
    if isinstance(word, GatewayRefusal):
        raise (LinkLostError if word.link else SattrackError)(word.words)
    return word
