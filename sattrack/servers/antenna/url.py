"""`--mount antenna://HOST:PORT` and `antenna:///dev/ttyUSB0`: which controller, and how it is spoken to."""

from __future__ import annotations

import socket
from dataclasses import dataclass
from typing import TYPE_CHECKING, get_args
from urllib.parse import parse_qs, urlsplit

from sattrack.core.errors import BadInputError, LinkLostError
from sattrack.servers.antenna.door import BAUDS, DEFAULT_FRAMING, Channel, SerialChannel, TcpChannel
from sattrack.servers.antenna.line import TCP_CHARACTER_TIME_OUT_S, Check, character_time_out_s
from sattrack.servers.antenna.sky import AxisKind

if TYPE_CHECKING:
    from collections.abc import Mapping

CONNECT_WITHIN_S = 3.0
FORMS = "antenna://HOST:PORT or antenna:///dev/ttyUSB0, with ?axes=azel, ?rate=10 and the like"
OPTIONS = ("axes", "check", "rate", "timing", "baud", "framing")
MOST_RATE_HZ = 10.0


@dataclass(frozen=True, slots=True)
class AntennaUrl:
    """One controller's address: `host` and `port`, or `device` with its settings."""

    text: str
    axes: AxisKind
    check: Check
    interval_s: float
    """Between trajectory designations."""
    per_character: bool = False
    """Whether every character of a response has its own time-out."""
    host: str = ""
    port: int = 0
    device: str | None = None
    baud: int = BAUDS[0]
    framing: str = DEFAULT_FRAMING

    @property
    def character_s(self) -> float:
        """The character time-out of the line."""
        return TCP_CHARACTER_TIME_OUT_S if self.device is None else character_time_out_s(self.baud)

    def connect(self) -> Channel:
        """Return a line to the controller. Raises LinkLostError, SattrackError or BadInputError."""
        if self.device is not None:
            return SerialChannel(self.device, self.baud, self.framing)
        try:
            return TcpChannel(socket.create_connection((self.host, self.port), CONNECT_WITHIN_S))
        except OSError as error:
            raise LinkLostError(
                f"no antenna controller at {self.host}:{self.port}: {error.strerror or error}"
            ) from error


def parse_antenna_url(url: str) -> AntennaUrl:
    """Read `--mount antenna:...`. Raises BadInputError, naming what is wrong."""
    try:
        parts = urlsplit(url)
        options = parse_qs(parts.query, keep_blank_values=True, strict_parsing=bool(parts.query))
        host, port = parts.hostname or "", parts.port
    except ValueError as error:
        raise BadInputError(f"--mount {url}: {error}; write {FORMS}") from error
    for name, values in options.items():
        if name not in OPTIONS or len(values) != 1:
            raise BadInputError(
                f"--mount {url}: {name} is not understood; there are {', '.join(OPTIONS)}, once"
            )
    given = {name: values[0] for name, values in options.items()}
    on_line = not host and parts.path not in {"", "/"}
    if not on_line and (not host or not port or parts.path not in {"", "/"}):
        raise BadInputError(f"--mount {url}: write {FORMS}")
    axes = _one_of(url, given, "axes", get_args(AxisKind))
    check = Check.CRC16 if _one_of(url, given, "check", ("sum", "crc")) == "crc" else Check.SUM
    baud = int(_one_of(url, given, "baud", tuple(str(b) for b in BAUDS)))
    if not on_line and ("baud" in given or "framing" in given):
        raise BadInputError(f"--mount {url}: baud and framing are of serial lines")
    return AntennaUrl(
        text=url.partition("?")[0],
        axes="azel" if axes == "azel" else "hadec",
        check=check,
        interval_s=1.0 / _rate_hz(url, given),
        per_character=_one_of(url, given, "timing", ("transaction", "character")) == "character",
        host=host,
        port=port or 0,
        device=parts.path if on_line else None,
        baud=baud,
        framing=given.get("framing", DEFAULT_FRAMING),
    )


def _one_of(url: str, given: Mapping[str, str], name: str, words: tuple[str, ...]) -> str:
    value = given.get(name, words[0])
    if value not in words:
        raise BadInputError(f"--mount {url}: {name} is {value!r}; it is one of {', '.join(words)}")
    return value


def _rate_hz(url: str, given: Mapping[str, str]) -> float:
    text = given.get("rate", "1")
    try:
        rate_hz = float(text)
    except ValueError:
        rate_hz = 0.0
    if not 0.1 <= rate_hz <= MOST_RATE_HZ:
        raise BadInputError(
            f"--mount {url}: rate is {text!r}; designations a second, 0.1 to {MOST_RATE_HZ:g}"
        )
    return rate_hz
