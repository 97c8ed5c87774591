"""Element sets from the network, by the providers' rules: asked rarely, kept with their age, never half.

CelesTrak: T. S. Kelso, "A New Way to Obtain GP Data"; its data change every 2 hours at most. Space-Track: its
"API Use Guidelines", no more than 30 requests a minute and 300 an hour, elements once an hour. Any answer but
200 ends it: the server's own words are shown, and what was kept before is used instead. What was downloaded
is kept in the user's cache folder, a line of JSON and then the text as it came, put in place whole.
"""

from __future__ import annotations

import asyncio
import hashlib
import json
import os
import re
import time
import zlib
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import date, timedelta
from importlib import import_module
from typing import TYPE_CHECKING, Any
from urllib.parse import quote, urlsplit

import aiohttp

from sattrack import __version__
from sattrack.core.errors import BadInputError, SattrackError
from sattrack.core.files import lock_file, replace_file, user_folder
from sattrack.core.local_time import duration
from sattrack.views.formatting import counted
from tle.elements import Elements
from tle.errors import ElementsError, TleError, printable
from tle.sources import (
    COMMON_NAMES,
    catalog_number_of,
    did_you_mean,
    find,
    full_designator,
    is_html,
    parse_elements,
    plain_name,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

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
# What was is asked for once; only of the last days something new may come.
HISTORY_EVERY_S = 24 * 3600.0
# Seconds, and how many requests Space-Track allows within them.
SPACE_TRACK_LIMITS = ((60.0, 30), (3600.0, 300))
_LOOPBACK = ("localhost", "127.0.0.1", "::1")
_MOST_BYTES = 256 * 1024 * 1024
_CHUNK_BYTES = 64 * 1024
_MOST_WORDS = 240
_SHOWN, _NAMED, _SHORTEST_NAME = 8, 3, 3
_LARGEST_NUMBER = 999_999_999
_HAS_NONE = r"No GP data found|Invalid query\b"
"""How CelesTrak's answer begins where it has nothing of a name."""
_TIMEOUT = aiohttp.ClientTimeout(total=120.0, connect=15.0, sock_read=30.0)


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
        """Name what is asked for, without its format: providers count downloads of a group, in any."""
        address, _, asked = self.url.partition("?")
        parts = sorted(part for part in asked.split("&") if not part.upper().startswith("FORMAT="))
        return f"{address}?{'&'.join(parts)}"


def query_of(source: str, environ: Mapping[str, str]) -> Query:
    """Return the query that a short name or a URL stands for. Raises BadInputError."""
    kind, _, what = source.partition(":")
    if kind in ("celestrak", "celestrak-sup"):
        return _celestrak(source, what.strip(), _base(environ, CELESTRAK_VARIABLE, CELESTRAK_URL))
    if kind == "spacetrack":
        return _space_track(source, what.strip(), _base(environ, SPACE_TRACK_VARIABLE, SPACE_TRACK_URL))
    celestrak = _base(environ, CELESTRAK_VARIABLE, CELESTRAK_URL)
    return _url(source, celestrak, _base(environ, SPACE_TRACK_VARIABLE, SPACE_TRACK_URL))


def named_source(satellite: str) -> str:
    """Return the source of one satellite at CelesTrak, by its catalogue number, designator or name."""
    key = satellite.strip()
    number = COMMON_NAMES.get(plain_name(key)) or catalog_number_of(key)
    if number is not None and number <= _LARGEST_NUMBER:
        return f"celestrak:{number}"
    return f"celestrak:{full_designator(key) or f'name={key}'}"


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
            f"the system's keyring under {KEYRING_SERVICE} (with the extra `keyring` installed)"
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
    """Return a query of CelesTrak's GP data, or of its supplemental ones, by operators' ephemerides."""
    supplemental = source.startswith("celestrak-sup:")
    if re.fullmatch(r"\d{1,9}", what, re.ASCII):
        asked = f"CATNR={int(what)}"
    elif launch := re.fullmatch(r"(\d{4}-\d{3})[A-Za-z]{0,3}", what, re.ASCII):
        asked = f"INTDES={launch.group(1)}"
    elif re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9-]{0,40}", what, re.ASCII):
        asked = f"{'FILE' if supplemental else 'GROUP'}={what.lower()}"
    elif name := re.fullmatch(r"name=\s*([^\x00-\x1f]{3,60}?)\s*", what):
        asked = f"NAME={quote(name.group(1).upper())}"
    else:
        raise BadInputError(
            f"{source}: write celestrak:GROUP (such as celestrak:active), celestrak:25544 (a number), "
            "celestrak:name=HUBBLE (three letters at least), or celestrak-sup:starlink"
        )
    page = "supplemental/sup-gp.php" if supplemental else "gp.php"
    url = f"{base}/NORAD/elements/{page}?{asked}&FORMAT=csv"
    return Query(source, url, CELESTRAK, DOWNLOAD_EVERY_S)


def _space_track(source: str, what: str, base: str) -> Query:
    what, _, day = what.partition("@")
    kind, order = "gp", "NORAD_CAT_ID"
    if re.fullmatch(r"\d{1,9}(,\d{1,9})*", what, re.ASCII):
        asked = f"NORAD_CAT_ID/{what}"
        if day:
            kind, order, asked = "gp_history", "EPOCH", f"{asked}/EPOCH/{_days_about(source, day)}"
    elif what.lower() in ("all", "active") and not day:
        asked = "decay_date/null-val/epoch/%3Enow-30"
    else:
        raise BadInputError(
            f"{source}: write spacetrack:all, spacetrack:25544 or spacetrack:25544,100534 (numbers), or "
            "spacetrack:25544@2026-10-02"
        )
    url = f"{base}/basicspacedata/query/class/{kind}/{asked}/orderby/{order}/format/json"
    every_s = HISTORY_EVERY_S if day else SPACE_TRACK_EVERY_S
    return Query(source, url, SPACE_TRACK, every_s, _login(source, base))


def _days_about(source: str, day: str) -> str:
    """Return the range of epochs from the day before a day to the day after it, ends of days."""
    try:
        middle = date.fromisoformat(day)
        return f"{middle - timedelta(days=1)}--{middle + timedelta(days=2)}"
    except (ValueError, OverflowError):
        raise BadInputError(f"{source}: {day!r} is no day: write it as 2026-10-02") from None


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


@dataclass(frozen=True, slots=True)
class Kept:
    """A download: its text, and when it was complete, in POSIX seconds."""

    text: str
    fetched_unix_s: float


def _whole(data: bytes) -> tuple[str, Kept | None]:
    """Return the URL of a kept download and what was kept; None where it is not whole."""
    head, _, body = data.partition(b"\n")
    try:
        facts = json.loads(head)
        if facts["bytes"] != len(body):
            return "", None
        return str(facts["url"]), Kept(body.decode("utf-8"), float(facts["fetched_unix_s"]))
    except (ValueError, KeyError, TypeError):
        return "", None


def user_cache_folder(environ: Mapping[str, str]) -> Path:
    """Return the folder for downloads: under XDG_CACHE_HOME where that is set, else the user's .cache."""
    return user_folder("XDG_CACHE_HOME", ".cache", environ) / "elements"


class DownloadCache:
    """The files of one folder. Every method raises SattrackError where the folder cannot be used."""

    def __init__(self, folder: Path) -> None:
        """Take the folder; it is made when something is first put into it."""
        self.folder = folder

    def read(self, url: str) -> Kept | None:
        """Return what was kept of a URL; None where there is nothing, or nothing whole."""
        try:
            data = self._path(url, "elements").read_bytes()
        except OSError:
            return None
        url_of, kept = _whole(data)
        return kept if url_of == url else None

    def keep(self, url: str, text: str, fetched_unix_s: float) -> None:
        """Put a download in the place of the one before it."""
        body = text.encode("utf-8")
        facts = {"url": url, "fetched_unix_s": fetched_unix_s, "bytes": len(body)}
        self._write(self._path(url, "elements"), json.dumps(facts).encode() + b"\n" + body)

    def all_kept(self) -> list[tuple[str, Kept]]:
        """Return every whole download with its URL, the newest first."""
        found = []
        for path in self.folder.glob("*.elements"):
            with suppress(OSError):
                url, kept = _whole(path.read_bytes())
                if kept is not None:
                    found.append((url, kept))
        return sorted(found, key=lambda item: -item[1].fetched_unix_s)

    def asked(self, name: str) -> list[float]:
        """Return when the server was asked for a URL, or a provider for anything, in POSIX seconds."""
        try:
            found = json.loads(self._path(name, "asked").read_bytes())
            return [float(unix_s) for unix_s in found]
        except (OSError, ValueError, TypeError):
            return []

    def set_asked(self, name: str, unix_s: list[float]) -> None:
        """Keep when the server was asked, in the place of what was kept before."""
        self._write(self._path(name, "asked"), json.dumps(unix_s).encode())

    @contextmanager
    def alone(self, provider: str) -> Iterator[None]:
        """Let no other process ask the same provider until this block ends: waits for one that does."""
        path = self._path(provider, "lock")
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            file = path.open("w")
        except OSError as error:
            raise self._unusable(error) from error
        with file:
            # Closing the file gives the lock back, as the end of the process does.
            lock_file(file)
            yield

    def _path(self, name: str, kind: str) -> Path:
        words = re.sub(r"[^A-Za-z0-9]+", "-", re.sub(r"^https?://", "", name)).strip("-")[-60:]
        return self.folder / f"{words}-{hashlib.sha256(name.encode()).hexdigest()[:12]}.{kind}"

    def _write(self, path: Path, data: bytes) -> None:
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            replace_file(path, data)
        except OSError as error:
            raise self._unusable(error) from error

    def _unusable(self, error: OSError) -> SattrackError:
        return SattrackError(
            f"{self.folder}: downloads cannot be kept there: {error.strerror or error}: "
            "set XDG_CACHE_HOME to a folder that can be written"
        )


class DownloadError(SattrackError):
    """Elements could not be fetched from the network, and none were kept; the message says why.

    `reason` is the message without what to do about it.
    """

    def __init__(self, reason: str, advice: str = "") -> None:
        """Join them."""
        super().__init__(f"{reason}; {advice}" if advice else reason)
        self.reason = reason


class NothingThereError(DownloadError):
    """CelesTrak answers that it has no such satellite or group."""


class _UnreachableError(DownloadError):
    """No server answered, so that asking again soon bothers nobody."""


def _bring(query: Query) -> str:
    """Return how to get elements without the network, as the end of a message."""
    how = "`passes`, `track` and others take it by --elements FILE"
    return f"save {query.url} as a file on another computer: {how}"


class Downloads:
    """Fetches what `tle.sources` is given as URLs or short names; `fetch` is what it takes.

    `tell` takes sentences for the user; `progress`, if given, how many bytes have come so far, then None.
    Kept in `folder`, by default the user's cache folder. `now` gives POSIX seconds. Not to be called where an
    event loop runs. One object asks a server nothing more once that has refused a request. `renewing`: the
    user asks for a download, and a note says where the server may not be asked again yet.
    """

    def __init__(
        self,
        tell: Callable[[str], None],
        progress: Callable[[str, int | None], None] | None = None,
        folder: Path | None = None,
        environ: Mapping[str, str] | None = None,
        now: Callable[[], float] = time.time,
        timeout: aiohttp.ClientTimeout = _TIMEOUT,
        renewing: bool = True,
    ) -> None:
        """Take what is the same for all downloads."""
        self._renewing = renewing
        self._environ = os.environ if environ is None else environ
        self._cache = DownloadCache(folder or user_cache_folder(self._environ))
        self._tell = tell
        self._progress = progress
        self._now = now
        self._timeout = timeout
        self._refused: dict[str, str] = {}

    def fetch(self, source: str) -> str:
        """Return the element text of a URL or short name, from the network or, if asked, as kept before.

        Raises DownloadError where neither gives any, BadInputError for a source that means nothing; where
        none was kept, also for credentials that are nowhere, and SattrackError for a folder that is full.
        """
        query = query_of(source, self._environ)
        with self._cache.alone(query.provider):
            kept = self._cache.read(query.url)
            early = reason = self._why_not(query, kept.fetched_unix_s if kept else None)
            if kept is not None and re.match(_HAS_NONE, kept.text):
                if early is not None:
                    raise NothingThereError(_no_such(query, kept.text))
                kept = None
            advice = f"check the network, or {_bring(query)}"
            if reason is None:
                try:
                    return self._download(query)
                except NothingThereError as error:
                    if kept is None:
                        with suppress(SattrackError):
                            self._cache.keep(query.url, str(error), self._now())
                        raise NothingThereError(_no_such(query, str(error))) from error
                    reason = f"{_host(query)} has it no more"
                except DownloadError as error:
                    reason = str(error)
                    if query.url == source and not isinstance(error, _UnreachableError):
                        advice = "check the address"
                except SattrackError as error:
                    # A full disk keeps no note of the request; or credentials are nowhere.
                    if kept is None:
                        raise
                    reason = str(error)
        if kept is None:
            raise DownloadError(f"{source}: {reason}", advice)
        if self._renewing or early is None:
            self._tell(f"{source}: using what was fetched {_since(kept, self._now())} ago: {reason}")
        return kept.text

    def fetch_satellite(self, satellite: str) -> list[Elements]:
        """Return one satellite's elements from CelesTrak, or from any download that was kept.

        Says of whom they were asked, unless the user asked for a download. Raises DownloadError, which says
        what was kept and how to bring a file, or that there is no such satellite.
        """
        source = named_source(satellite)
        if len(source) < len("celestrak:name=") + _SHORTEST_NAME and "name=" in source:
            raise NothingThereError(
                f"{satellite!r} is too short a name for CelesTrak: give {_SHORTEST_NAME} letters or more, "
                "or a catalogue number"
            )
        query = query_of(source, self._environ)
        before = self._cache.asked(query.data)
        try:
            found = [one for one in parse_elements(self.fetch(source)) if isinstance(one, Elements)]
        except DownloadError as error:
            return [self._kept_satellite(satellite, query, error)]
        if not self._renewing and self._cache.asked(query.data) != before:
            self._tell(
                f"no elements are set: {satellite} was downloaded from {_host(query)}, and is kept for "
                f"{duration(query.every_s)} (fetch_by_name = false in sattrack.toml forbids this)"
            )
        return found

    def _kept_satellite(self, satellite: str, query: Query, error: DownloadError) -> Elements:
        """Return a satellite from the newest download that holds it; raises DownloadError where none does."""
        held, every = [], []
        for url, kept in self._cache.all_kept():
            found = [one for one in parse_elements(kept.text) if isinstance(one, Elements)]
            if not found:
                continue
            ago = f"fetched {_since(kept, self._now())} ago"
            held.append(f"{_called(url, found)}, {ago}")
            every.extend(found)
            with suppress(TleError):
                one = find(found, satellite)
                self._tell(f"{satellite}: using {_called(url, found)}, {ago}: {error.reason}")
                return one
        if isinstance(error, NothingThereError):
            known = did_you_mean(every, satellite, COMMON_NAMES)
            raise NothingThereError(
                f"{_host(query)} has no satellite {satellite!r}"
                f"{known or ': check the spelling, or give the catalogue number'}"
            ) from error
        names = "; ".join(held[:_SHOWN]) if held else "nothing"
        raise DownloadError(
            f"no elements of {satellite}: {error}; kept from earlier downloads: {names}"
        ) from error

    def _why_not(self, query: Query, fetched_unix_s: float | None) -> str | None:
        """Return why the server must not be asked now, None where it may be."""
        if query.provider in self._refused:
            return f"the server refused another request just now: {self._refused[query.provider]}"
        now = self._now()
        last = [unix_s for unix_s in (*self._cache.asked(query.data), fetched_unix_s) if unix_s is not None]
        # A time to come tells that the clock was set back, and nothing of how long ago it was.
        waited_s = min((now - unix_s for unix_s in last if unix_s <= now), default=query.every_s)
        if waited_s < query.every_s:
            return (
                f"asked {duration(waited_s)} ago, and once in {duration(query.every_s)} is allowed: "
                f"again in {duration(query.every_s - waited_s)}"
            )
        return self._over_limit(query, now)

    def _over_limit(self, query: Query, now: float) -> str | None:
        if query.provider != SPACE_TRACK:
            return None
        recent = self._cache.asked(SPACE_TRACK)
        for span_s, most in SPACE_TRACK_LIMITS:
            within = sorted(unix_s for unix_s in recent if 0.0 <= now - unix_s < span_s)
            # Two requests: the login and the query.
            if len(within) + 2 > most:
                wait_s = within[len(within) + 1 - most] + span_s - now
                return f"{most} requests in {duration(span_s)} are allowed: again in {duration(wait_s)}"
        return None

    def _download(self, query: Query) -> str:
        login = credentials(self._environ) if query.login_url else None
        before = self._cache.asked(query.data)
        self._cache.set_asked(query.data, [self._now()])
        if login is not None:
            recent = [s for s in self._cache.asked(SPACE_TRACK) if 0.0 <= self._now() - s < 3600.0]
            self._cache.set_asked(SPACE_TRACK, [*recent, self._now(), self._now()])
        try:
            text = _checked(asyncio.run(self._get(query, login)))
        except _UnreachableError:
            self._cache.set_asked(query.data, before)
            raise
        finally:
            if self._progress is not None:
                self._progress(query.source, None)
        try:
            self._cache.keep(query.url, text, self._now())
        except SattrackError as error:
            # What has come is good all the same, and may not be asked for again for hours.
            self._tell(str(error))
        return text

    async def _get(self, query: Query, login: tuple[str, str] | None) -> bytes:
        # "Unsafe" lets a server that is named by its address keep the login too; one session sees one server.
        jar = aiohttp.CookieJar(unsafe=True)
        headers = {"User-Agent": f"sattrack/{__version__}", "Accept-Encoding": "gzip"}
        try:
            async with aiohttp.ClientSession(
                headers=headers, timeout=self._timeout, auto_decompress=False, trust_env=True, cookie_jar=jar
            ) as session:
                if login is not None:
                    form = {"identity": login[0], "password": login[1]}
                    async with session.post(query.login_url, data=form, allow_redirects=False) as response:
                        await self._check_login(query, response)
                async with session.get(query.url, allow_redirects=False) as response:
                    await self._check_status(query, response)
                    return await self._body(query, response)
        except TimeoutError:
            raise DownloadError("the server took too long to answer: try again later") from None
        except aiohttp.ClientConnectorError as error:
            raise _UnreachableError(f"cannot reach {error.host}: {error.strerror or error}") from None
        except aiohttp.ClientPayloadError:
            raise DownloadError("what the server sent was cut off: try again later") from None
        except aiohttp.ClientError as error:
            raise DownloadError(
                f"the download broke off: {printable(str(error)) or type(error).__name__}"
            ) from None

    async def _check_login(self, query: Query, response: aiohttp.ClientResponse) -> None:
        await self._check_status(query, response)
        words = _words(await _start(response))
        if "Failed" in words:
            self._refused[query.provider] = words
            raise DownloadError(f"Space-Track refused the login: {words}: correct name or password")

    async def _check_status(self, query: Query, response: aiohttp.ClientResponse) -> None:
        if response.status == 200:
            return
        words = _words(await _start(response))
        if moved := response.headers.get("Location"):
            words = f"moved to {printable(moved)[:_MOST_WORDS]} {words}".rstrip()
        said = f"{response.status} {printable(response.reason or '')}: {words or 'nothing more'}"
        self._refused[query.provider] = said
        raise DownloadError(f"the server answered {said}")

    async def _body(self, query: Query, response: aiohttp.ClientResponse) -> bytes:
        data = bytearray()
        async for chunk in response.content.iter_chunked(_CHUNK_BYTES):
            data += chunk
            if len(data) > _MOST_BYTES:
                raise DownloadError(f"the server sent more than {_MOST_BYTES // 2**20} MiB: not element sets")
            if self._progress is not None:
                self._progress(query.source, len(data))
        return _unpacked(bytes(data))


def _host(query: Query) -> str:
    return urlsplit(query.url).hostname or query.provider


def _no_such(query: Query, words: str) -> str:
    """Return that CelesTrak has nothing of a name, and what to do, for a group or a satellite."""
    said = f"{query.source}: {_host(query)} has none of that name ({words})"
    if "GROUP=" in query.url:
        return f"{said}: give one of its groups, as celestrak:stations, celestrak:visual or celestrak:active"
    return f"{said}: check the spelling, or give the catalogue number"


def _called(url: str, found: list[Elements]) -> str:
    """Return what a download holds, in words: its group, or its satellites."""
    kind, _, name = urlsplit(url).query.partition("&")[0].partition("=")
    if kind == "GROUP":
        return f"celestrak:{name} ({counted(len(found), 'satellite')})"
    labels = [one.label for one in found]
    return ", ".join(labels) if len(labels) <= _NAMED else f"{labels[0]} and {len(labels) - 1} more"


def _since(kept: Kept, now_unix_s: float) -> str:
    """Return how long something has been kept; a clock that was set back since counts as no time."""
    return duration(max(0.0, now_unix_s - kept.fetched_unix_s))


def _checked(data: bytes) -> str:
    """Return a body as text; raises DownloadError where it holds no whole list of element sets."""
    text = data.decode("utf-8-sig", errors="replace")
    if is_html(text):
        raise DownloadError(f"the server sent a web page instead of elements: {_words(data)}")
    found = parse_elements(text)
    if all(isinstance(item, ElementsError) for item in found):
        words = _words(data)
        if re.match(_HAS_NONE, words):
            raise NothingThereError(words)
        raise DownloadError(f"the server sent no element sets: {words or 'nothing'}")
    if isinstance(found[-1], ElementsError):
        raise DownloadError(f"what the server sent does not end as it should: {found[-1].reason}")
    return text


def _unpacked(data: bytes) -> bytes:
    """Return what gzip packed, in transfer or as a file; other data as they are."""
    if data[:2] != b"\x1f\x8b":
        return data
    unpacker = zlib.decompressobj(wbits=31)
    try:
        unpacked = unpacker.decompress(data, _MOST_BYTES)
    except zlib.error as error:
        raise DownloadError(f"what the server sent is damaged: {error}") from None
    if not unpacker.eof:
        raise DownloadError("what the server sent was cut off, or unpacks to more than element sets can be")
    return unpacked


async def _start(response: aiohttp.ClientResponse) -> bytes:
    """Return the first of a short answer, or of a long one as much as words may take."""
    data = await response.content.read(16 * _MOST_WORDS)
    try:
        return _unpacked(data)
    except DownloadError:
        return b""


def _words(data: bytes) -> str:
    """Return what a server says as one short line, without tags and control characters."""
    text = data[: 16 * _MOST_WORDS].decode("utf-8", errors="replace")
    if "<" in text:
        text = re.sub(r"<(script|style)\b.*?</\1>|<[^<>]*>", " ", text, flags=re.DOTALL | re.IGNORECASE)
    return printable(" ".join(text.split()))[:_MOST_WORDS]
