"""Who may come in: decisions about requests, without a server. No I/O."""

from __future__ import annotations

import secrets
from dataclasses import dataclass
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

if TYPE_CHECKING:
    from collections.abc import Mapping

LOOPBACK = frozenset({"127.0.0.1", "::1", "localhost"})
WILDCARDS = frozenset({"0.0.0.0", "::", ""})
"""Listening there is listening on all of the machine's addresses."""
TOKEN_BYTES = 18


@dataclass(frozen=True, slots=True)
class Visit:
    """Where the page is, what a visitor brings, and the program that draws each visitor's screen."""

    host: str
    port: int
    token: str | None
    command: tuple[str, ...]

    @property
    def cookie(self) -> str:
        """The name under which a browser keeps the token; one for each port."""
        return f"sattrack_{self.port}"

    def urls(self, port: int, machine: tuple[str, ...]) -> tuple[str, ...]:
        """Return what can be opened: where the host is a wildcard, one of each of the machine's addresses."""
        hosts: tuple[str, ...] = (self.host,)
        if self.host in WILDCARDS:
            hosts = tuple(each for each in machine if ":" not in each or self.host != "0.0.0.0")
            hosts = hosts or ("127.0.0.1",)
        query = "" if self.token is None else f"?token={self.token}"
        return tuple(f"http://{f'[{host}]' if ':' in host else host}:{port}/{query}" for host in hosts)

    def refusal(
        self, host_header: str, origin: str | None, query: Mapping[str, str], cookies: Mapping[str, str]
    ) -> str | None:
        """Return why a request is refused, or None.

        A page elsewhere that is open in a visitor's browser could otherwise reach this one, by its own
        scripts (told by the origin) or by a name that it has lead here (told by the host).
        """
        if self.host in LOOPBACK and _name(host_header) not in LOOPBACK:
            return f"this page is at {self.host} only"
        if origin is not None and _authority(origin) != host_header:
            return "this page is not for others' scripts"
        if self.token is None:
            return None
        brought = (query.get("token"), cookies.get(self.cookie))
        if any(each is not None and _same(each, self.token) for each in brought):
            return None
        return "bring the token: open the address that `sattrack serve web` has shown"


def needs_token(host: str) -> bool:
    """Tell whether others than this machine's users can come."""
    return host not in LOOPBACK


def new_token() -> str:
    """Return a token that nobody guesses."""
    return secrets.token_urlsafe(TOKEN_BYTES)


def _name(host_header: str) -> str:
    try:
        return urlsplit(f"//{host_header}").hostname or ""
    except ValueError:
        return ""


def _authority(origin: str) -> str | None:
    try:
        return urlsplit(origin).netloc or None
    except ValueError:
        return None


def _same(one: str, other: str) -> bool:
    return secrets.compare_digest(one.encode(), other.encode())
