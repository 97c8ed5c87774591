"""Element sets from the network, by the providers' rules: asked rarely, kept with their age, never half.

Any answer but 200 ends it: the server's own words are shown, and what was kept before is used instead.
"""

from __future__ import annotations

import asyncio
import os
import re
import time
import zlib
from typing import TYPE_CHECKING

import aiohttp

from sattrack import __version__
from sattrack.core.errors import SattrackError
from sattrack.elements.cache import DownloadCache, user_cache_folder
from sattrack.elements.providers import SPACE_TRACK, SPACE_TRACK_LIMITS, Query, credentials, query_of
from tle.errors import ElementsError, printable
from tle.formats.registry import is_html, parse_elements

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

_MOST_BYTES = 256 * 1024 * 1024
_CHUNK_BYTES = 64 * 1024
_MOST_WORDS = 240
_TIMEOUT = aiohttp.ClientTimeout(total=120.0, connect=15.0, sock_read=30.0)


class DownloadError(SattrackError):
    """Elements could not be had from the network, and none were kept; the message says why."""


class _UnreachableError(DownloadError):
    """No server answered, so that asking again soon bothers nobody."""


class Downloads:
    """Fetches what `tle.sources` is given as URLs or short names; `fetch` is what it takes.

    `tell` takes sentences for the user; `progress`, if given, how many bytes have come so far, then None.
    Kept in `folder`, by default the user's cache folder. `now` gives POSIX seconds. Not to be called where an
    event loop runs. One object asks a server nothing more once that has refused a request.
    """

    def __init__(
        self,
        tell: Callable[[str], None],
        progress: Callable[[str, int | None], None] | None = None,
        folder: Path | None = None,
        environ: Mapping[str, str] | None = None,
        now: Callable[[], float] = time.time,
        timeout: aiohttp.ClientTimeout = _TIMEOUT,
    ) -> None:
        """Take what is the same for all downloads."""
        self._environ = os.environ if environ is None else environ
        self._cache = DownloadCache(folder or user_cache_folder(self._environ))
        self._tell = tell
        self._progress = progress
        self._now = now
        self._timeout = timeout
        self._refused: dict[str, str] = {}

    def fetch(self, source: str) -> str:
        """Return the element text of a URL or short name, from the network or, told so, as kept before.

        Raises DownloadError where neither gives any, BadInputError for a source that means nothing or
        credentials that are nowhere.
        """
        query = query_of(source, self._environ)
        with self._cache.alone(query.provider):
            kept = self._cache.read(query.url)
            reason = self._why_not(query, kept.fetched_unix_s if kept else None)
            if reason is None:
                try:
                    return self._download(query)
                except DownloadError as error:
                    reason = str(error)
        if kept is None:
            raise DownloadError(f"{source}: {reason}")
        self._tell(
            f"{source}: using what was fetched {age_words(self._now() - kept.fetched_unix_s)} ago: {reason}"
        )
        return kept.text

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
                f"asked {age_words(waited_s)} ago, and once in {age_words(query.every_s)} is allowed: "
                f"again in {age_words(query.every_s - waited_s)}"
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
                return f"{most} requests in {age_words(span_s)} are allowed: again in {age_words(wait_s)}"
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


def age_words(seconds: float) -> str:
    """Return a span of time as a person says it: 40 s, 12 min, 2 h, 3.5 days."""
    seconds = max(0.0, seconds)
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    if seconds < 5400.0:
        return f"{seconds / 60.0:.0f} min"
    if seconds < 2 * 86400.0:
        return f"{seconds / 3600.0:.3g} h"
    return f"{seconds / 86400.0:.3g} days"


def _checked(data: bytes) -> str:
    """Return a body as text; raises DownloadError where it holds no whole list of element sets."""
    text = data.decode("utf-8-sig", errors="replace")
    if is_html(text):
        raise DownloadError(f"the server sent a web page instead of elements: {_words(data)}")
    found = parse_elements(text)
    if all(isinstance(item, ElementsError) for item in found):
        raise DownloadError(f"the server sent no element sets: {_words(data) or 'nothing'}")
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
