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
LARGEST_PORT = 65535
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
        said = " ".join(text.split())
        if said.startswith("<"):
            said = "a page of a web server, which is no Alpaca server"
        raise NoAnswerError(f"it answered {member} with HTTP status {status}: {said[:120]}", status)
    try:
        answer = json.loads(text)
        number = int(answer.get("ErrorNumber") or 0)
    except (ValueError, TypeError, AttributeError, OverflowError, RecursionError) as error:
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
            with contextlib.suppress(OSError, ValueError, KeyError, TypeError, OverflowError, RecursionError):
                answer, (host, _) = asker.recvfrom(MOST_BYTES)
                number = int(json.loads(answer)["AlpacaPort"])
                if 0 < number <= LARGEST_PORT:
                    servers[f"{host}:{number}"] = None
    return [one for server in servers for one in _telescopes_at(server)]


def _telescopes_at(server: str) -> list[FoundTelescope]:
    try:
        devices = _exchange(server, ANSWER_WITHIN_S, "configureddevices", "/management/v1/configureddevices")
        return [
            FoundTelescope(printable(str(one["DeviceName"])), f"alpaca://{server}/{int(one['DeviceNumber'])}")
            for one in devices
            if str(one["DeviceType"]).casefold() == "telescope"
        ]
    except (AlpacaRefusalError, NoAnswerError, TypeError, KeyError, ValueError, OverflowError):
        return []


def _exchange(server: str, within_s: float, member: str, path: str, form: str | None = None) -> Any:
    """Get a path of a server, or put a form there; return the value that its answer gives.

    Raises AlpacaRefusalError, NoAnswerError.
    """
    status, _, body = _request(server, within_s, member, path, form)
    return value_in(member, status, body)


def _request(
    server: str,
    within_s: float,
    member: str,
    path: str,
    form: str | None = None,
    accept: str | None = None,
    most_bytes: int = MOST_BYTES,
) -> tuple[int, str, bytes]:
    """Send one request; return HTTP's status, the type of the answer and its body. Raises NoAnswerError."""
    headers = {} if accept is None else {"Accept": accept}
    with contextlib.closing(http.client.HTTPConnection(server, timeout=within_s)) as connection:
        try:
            if form is None:
                connection.request("GET", path, headers=headers)
            else:
                connection.request("PUT", path, form, _FORM)
            answer = connection.getresponse()
            body = answer.read(most_bytes)
        except TimeoutError as error:
            raise NoAnswerError(f"it did not answer {member} within {within_s:g} s") from error
        except (OSError, http.client.HTTPException) as error:
            raise NoAnswerError(broken(error)) from error
    return answer.status, answer.headers.get_content_type(), body


@dataclass(slots=True)
class AlpacaDevice:
    """One device at `HOST:PORT`, of a kind and a number as Alpaca's paths have them."""

    server: str
    kind: Literal["telescope", "focuser", "safetymonitor", "camera"]
    number: int
    within_s: float = ANSWER_WITHIN_S
    _transaction: int = 0

    def get(self, member: str) -> Any:
        """Return a member's value. Raises AlpacaRefusalError, NoAnswerError."""
        path, given = self._next(member, {})
        return _exchange(self.server, self.within_s, member, f"{path}?{given}")

    def get_body(self, member: str, accept: str, most_bytes: int) -> tuple[str, bytes]:
        """Return the type and the body of an answer that may be other than JSON. Raises NoAnswerError."""
        path, given = self._next(member, {})
        status, kind, body = _request(
            self.server, self.within_s, member, f"{path}?{given}", accept=accept, most_bytes=most_bytes
        )
        if status != 200:
            raise NoAnswerError(f"it answered {member} with HTTP status {status}", status)
        return kind, body

    def put(self, member: str, **fields: str) -> None:
        """Set a member, or call it. Raises AlpacaRefusalError, NoAnswerError."""
        path, given = self._next(member, fields)
        _exchange(self.server, self.within_s, member, path, given)

    def _next(self, member: str, fields: dict[str, str]) -> tuple[str, str]:
        """Return the path and the form of the next request."""
        self._transaction += 1
        return path_of(self.kind, self.number, member), urlencode(with_ids(fields, self._transaction))
