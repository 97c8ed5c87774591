"""Requests to an Alpaca device over HTTP, and what its answers mean.

`AlpacaDevice` sends one request at a time and waits for its answer: for focusers, safety monitors, and the
gateway's warden, which must start soon, so that this module needs the standard library alone. The gateway
itself sends requests of the same form at once, on connections that stay open (`gateway_process`).
"""

from __future__ import annotations

import contextlib
import http.client
import json
import os
import socket
import time
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple
from urllib.parse import urlencode

from tle.errors import printable

ANSWER_WITHIN_S = 2.0
DISCOVERY_PORT = 32227
MOST_SERVERS = 32
MOST_BYTES = 200_000
NOT_IMPLEMENTED, NOT_CONNECTED, PARKED = 0x400, 0x407, 0x408
_FORM = {"Content-Type": "application/x-www-form-urlencoded"}


class AlpacaRefusalError(Exception):
    """The device refuses a request: the standard's number, and its words."""

    def __init__(self, number: int, words: str) -> None:
        super().__init__(f"{words} (0x{number:X})")
        self.number, self.words = number, words


class NoAnswerError(Exception):
    """No answer came, or none that is Alpaca's; `status` where HTTP's own status says so."""

    def __init__(self, words: str, status: int | None = None) -> None:
        super().__init__(words)
        self.status = status


def path_of(kind: str, device: int, member: str) -> str:
    """Return the path of a member of one device."""
    return f"/api/v1/{kind}/{device}/{member}"


def with_ids(fields: dict[str, str], transaction: int) -> dict[str, str]:
    """Return the parameters of a request with the numbers that name this process and the request."""
    return {**fields, "ClientID": str(os.getpid()), "ClientTransactionID": str(transaction)}


def value_in(member: str, status: int, body: bytes) -> Any:
    """Return the value that an answer gives, None where it gives none. Raises Refusal, Unheard."""
    text = body.decode(errors="replace")
    if status != 200:
        raise NoAnswerError(f"it answered {member} with HTTP status {status}: {text.strip()[:120]}", status)
    try:
        answer = json.loads(text)
        number = int(answer.get("ErrorNumber") or 0)
    except (ValueError, TypeError, AttributeError, RecursionError) as error:
        raise NoAnswerError(f"its answer to {member} is no Alpaca answer") from error
    if number:
        raise AlpacaRefusalError(number, str(answer.get("ErrorMessage") or "no words")[:200])
    return answer.get("Value")


def broken(error: Exception) -> str:
    """Return what broke a connection, as text."""
    if isinstance(error, ConnectionRefusedError):
        return "nothing listens there"
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return f"the connection broke ({type(error).__name__})"


class FoundTelescope(NamedTuple):
    """An Alpaca telescope that answered: its name, and what `--mount` takes."""

    name: str
    url: str


def discover_telescopes(within_s: float = 1.5, port: int = DISCOVERY_PORT) -> list[FoundTelescope]:
    """Return the Alpaca telescopes on this machine and its networks (ASCOM Alpaca API Reference, Discovery).

    Servers that do not answer, or not as Alpaca's do, are left out.
    """
    servers: dict[str, None] = {}
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asker:
        asker.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        for host in ("127.0.0.1", "255.255.255.255"):
            with contextlib.suppress(OSError):
                asker.sendto(b"alpacadiscovery1", (host, port))
        end_s = time.monotonic() + within_s
        while (left_s := end_s - time.monotonic()) > 0.0 and len(servers) < MOST_SERVERS:
            asker.settimeout(left_s)
            with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
                answer, (host, _) = asker.recvfrom(MOST_BYTES)
                servers[f"{host}:{int(json.loads(answer)['AlpacaPort'])}"] = None
    return [one for server in servers for one in _telescopes_at(server)]


def _telescopes_at(server: str) -> list[FoundTelescope]:
    connection = http.client.HTTPConnection(server, timeout=ANSWER_WITHIN_S)
    with contextlib.closing(connection):
        try:
            connection.request("GET", "/management/v1/configureddevices")
            answer = connection.getresponse()
            devices = value_in("configureddevices", answer.status, answer.read(MOST_BYTES))
            return [
                FoundTelescope(
                    printable(str(one["DeviceName"])), f"alpaca://{server}/{int(one['DeviceNumber'])}"
                )
                for one in devices
                if str(one["DeviceType"]).casefold() == "telescope"
            ]
        except (
            OSError,
            http.client.HTTPException,
            AlpacaRefusalError,
            NoAnswerError,
            TypeError,
            KeyError,
            ValueError,
        ):
            return []


@dataclass(slots=True)
class AlpacaDevice:
    """One device at `HOST:PORT`, of a kind and a number as Alpaca's paths have them."""

    server: str
    kind: Literal["telescope", "focuser", "safetymonitor"]
    number: int
    within_s: float = ANSWER_WITHIN_S
    _transaction: int = 0

    def get(self, member: str) -> Any:
        """Return a member's value. Raises Refusal, Unheard."""
        return self._ask("GET", member, {})

    def put(self, member: str, **fields: str) -> None:
        """Set a member, or call it. Raises Refusal, Unheard."""
        self._ask("PUT", member, fields)

    def _ask(self, method: str, member: str, fields: dict[str, str]) -> Any:
        self._transaction += 1
        path = path_of(self.kind, self.number, member)
        given = urlencode(with_ids(fields, self._transaction))
        connection = http.client.HTTPConnection(self.server, timeout=self.within_s)
        with contextlib.closing(connection):
            try:
                if method == "GET":
                    connection.request(method, f"{path}?{given}")
                else:
                    connection.request(method, path, given, _FORM)
                answer = connection.getresponse()
                body = answer.read(MOST_BYTES)
            except TimeoutError as error:
                raise NoAnswerError(f"it did not answer {member} within {self.within_s:g} s") from error
            except (OSError, http.client.HTTPException) as error:
                raise NoAnswerError(broken(error)) from error
        return value_in(member, answer.status, body)
