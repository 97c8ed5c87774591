"""Where element sets come from on the network: short names to queries, and how often each may be asked.

CelesTrak: T. S. Kelso, "A New Way to Obtain GP Data"; its data change every 2 hours at most. Space-Track: its
"API Use Guidelines", no more than 30 requests a minute and 300 an hour, elements once an hour.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from sattrack.core.errors import BadInputError

if TYPE_CHECKING:
    from collections.abc import Mapping

CELESTRAK_URL = "https://celestrak.org"
SPACE_TRACK_URL = "https://www.space-track.org"
# Other addresses for the same services, such as a mirror of one's own.
CELESTRAK_VARIABLE = "SATTRACK_CELESTRAK_URL"
SPACE_TRACK_VARIABLE = "SATTRACK_SPACETRACK_URL"
USER_VARIABLE = "SATTRACK_SPACETRACK_USER"
PASSWORD_VARIABLE = "SATTRACK_SPACETRACK_PASSWORD"
KEYRING_SERVICE = "space-track.org"
CELESTRAK = "celestrak"
SPACE_TRACK = "space-track"
DOWNLOAD_EVERY_S = 2 * 3600.0
SPACE_TRACK_EVERY_S = 3600.0
# Seconds, and how many requests Space-Track allows within them.
SPACE_TRACK_LIMITS = ((60.0, 30), (3600.0, 300))
_LOOPBACK = ("localhost", "127.0.0.1", "::1")


@dataclass(frozen=True, slots=True)
class Query:
    """One thing to ask of a server.

    `source` is what the user wrote, `every_s` the least time between two downloads of it in seconds, and
    `login_url` where to log in first, empty where nobody needs to.
    """

    source: str
    url: str
    provider: str
    every_s: float
    login_url: str = ""

    @property
    def data(self) -> str:
        """Name what is asked for whatever its format: providers count downloads of a group, in any."""
        address, _, asked = self.url.partition("?")
        parts = sorted(part for part in asked.split("&") if not part.upper().startswith("FORMAT="))
        return f"{address}?{'&'.join(parts)}"


def query_of(source: str, environ: Mapping[str, str]) -> Query:
    """Return the query that a short name or a URL stands for. Raises BadInputError."""
    kind, _, what = source.partition(":")
    if kind == "celestrak":
        return _celestrak(source, what.strip(), _base(environ, CELESTRAK_VARIABLE, CELESTRAK_URL))
    if kind == "spacetrack":
        return _space_track(source, what.strip(), _base(environ, SPACE_TRACK_VARIABLE, SPACE_TRACK_URL))
    celestrak = _base(environ, CELESTRAK_VARIABLE, CELESTRAK_URL)
    return _url(source, celestrak, _base(environ, SPACE_TRACK_VARIABLE, SPACE_TRACK_URL))


def credentials(environ: Mapping[str, str]) -> tuple[str, str]:
    """Return name and password for Space-Track, from the environment or else the system's keyring.

    Raises BadInputError where neither holds them.
    """
    user, password = environ.get(USER_VARIABLE, ""), environ.get(PASSWORD_VARIABLE, "")
    if user and password:
        return user, password
    kept = _from_keyring(user or None)
    if kept is None:
        raise BadInputError(
            f"no credentials for Space-Track: set {USER_VARIABLE} and {PASSWORD_VARIABLE}, or keep them in "
            f"the system's keyring under {KEYRING_SERVICE} (with sattrack[keyring] installed)"
        )
    return kept


def _from_keyring(user: str | None) -> tuple[str, str] | None:
    try:
        keyring: Any = import_module("keyring")
        errors: Any = import_module("keyring.errors")
    except ImportError:
        return None
    try:
        found = keyring.get_credential(KEYRING_SERVICE, user)
    except errors.KeyringError as error:
        raise BadInputError(f"the system's keyring cannot be read for Space-Track: {error}") from error
    return None if found is None else (found.username, found.password)


def _base(environ: Mapping[str, str], variable: str, default: str) -> str:
    base = (environ.get(variable) or default).rstrip("/")
    parts = urlsplit(base)
    if parts.scheme not in ("http", "https") or not parts.hostname:
        raise BadInputError(f"{variable} is {base!r}: write it as https://HOST")
    return base


def _celestrak(source: str, what: str, base: str) -> Query:
    if re.fullmatch(r"\d{1,9}", what, re.ASCII):
        asked = f"CATNR={int(what)}"
    elif launch := re.fullmatch(r"(\d{4}-\d{3})[A-Za-z]{0,3}", what, re.ASCII):
        asked = f"INTDES={launch.group(1)}"
    elif re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9-]{0,40}", what, re.ASCII):
        asked = f"GROUP={what.lower()}"
    else:
        raise BadInputError(
            f"{source}: write celestrak:GROUP (such as celestrak:active), or celestrak:25544 (a number)"
        )
    url = f"{base}/NORAD/elements/gp.php?{asked}&FORMAT=csv"
    return Query(source, url, CELESTRAK, DOWNLOAD_EVERY_S)


def _space_track(source: str, what: str, base: str) -> Query:
    if re.fullmatch(r"\d{1,9}(,\d{1,9})*", what, re.ASCII):
        asked = f"NORAD_CAT_ID/{what}"
    elif what.lower() in ("all", "active"):
        asked = "decay_date/null-val/epoch/%3Enow-30"
    else:
        raise BadInputError(
            f"{source}: write spacetrack:all, spacetrack:25544 or spacetrack:25544,100534 (catalogue numbers)"
        )
    url = f"{base}/basicspacedata/query/class/gp/{asked}/orderby/NORAD_CAT_ID/format/json"
    return Query(source, url, SPACE_TRACK, SPACE_TRACK_EVERY_S, _login(source, base))


def _url(source: str, celestrak: str, space_track: str) -> Query:
    try:
        parts = urlsplit(source)
        host, _ = parts.hostname, parts.port
    except ValueError as error:
        raise BadInputError(f"{source}: is no URL: {error}") from None
    if parts.username is not None or parts.password is not None:
        # Not shown again: it holds a password.
        raise BadInputError(
            f"{host or 'a URL'}: no name and password in a URL: others can read command lines and histories"
        )
    if parts.scheme not in ("http", "https") or not host:
        raise BadInputError(f"{source}: elements come from a file, https://, celestrak: or spacetrack:")
    if parts.netloc == urlsplit(space_track).netloc or host == "space-track.org":
        base = f"{parts.scheme}://{parts.netloc}"
        return Query(source, source, SPACE_TRACK, SPACE_TRACK_EVERY_S, _login(source, base))
    provider = CELESTRAK if parts.netloc == urlsplit(celestrak).netloc else host
    return Query(source, source, provider, DOWNLOAD_EVERY_S)


def _login(source: str, base: str) -> str:
    parts = urlsplit(base)
    if parts.scheme != "https" and parts.hostname not in _LOOPBACK:
        raise BadInputError(f"{source}: a password is not sent over plain http: use https")
    return f"{base}/ajaxauth/login"
