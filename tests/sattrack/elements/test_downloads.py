"""Downloads against a real server on loopback that behaves as CelesTrak and Space-Track do."""

from __future__ import annotations

import errno
import fcntl
import gzip
import itertools
import multiprocessing
import os
import socket
import types
from pathlib import Path

import aiohttp
import pytest
from element_server import CSV, element_server
from hypothesis import example, given, settings
from hypothesis import strategies as st

from sattrack.core.errors import BadInputError, SattrackError
from sattrack.elements.downloads import (
    KEYRING_SERVICE,
    PASSWORD_VARIABLE,
    USER_VARIABLE,
    DownloadCache,
    DownloadError,
    Downloads,
    NothingThereError,
    credentials,
    query_of,
    user_cache_folder,
)
from tle.sources import load_elements

HOUR_S = 3600.0
RIGHT = {USER_VARIABLE: "someone@example.org", PASSWORD_VARIABLE: "right"}


class Client:
    """A `Downloads` whose clock is set by the test, and what it told the user."""

    def __init__(
        self, folder: Path, url: str, timeout_s: float = 30.0, renewing: bool = True, **environ: str
    ) -> None:
        self.folder, self.renewing = folder, renewing
        self.now_s = 1_000_000.0
        self.told: list[str] = []
        self.shown: list[tuple[str, int | None]] = []
        self.environ = {"SATTRACK_CELESTRAK_URL": url, "SATTRACK_SPACETRACK_URL": url, **environ}
        self.timeout = aiohttp.ClientTimeout(total=timeout_s)
        self.start()

    def start(self) -> None:
        """Begin anew, as the next run of the program does."""
        self.downloads = Downloads(
            self.told.append,
            lambda source, count: self.shown.append((source, count)),
            self.folder,
            self.environ,
            lambda: self.now_s,
            self.timeout,
            self.renewing,
        )

    def later(self, seconds: float) -> None:
        self.now_s += seconds
        self.start()

    def fetch(self, source: str) -> str:
        return self.downloads.fetch(source)


def test_a_group_is_fetched_as_csv_kept_and_asked_for_once_in_two_hours(tmp_path):
    with element_server() as server:
        client = Client(tmp_path, server.url)
        assert client.fetch("celestrak:active") == CSV
        assert client.told == []
        client.later(HOUR_S)
        assert client.fetch("celestrak:active") == CSV
        assert client.told == [
            "celestrak:active: using what was fetched 1 h ago: "
            "asked 1 h ago, and once in 2 h is allowed: again in 1 h"
        ]
        assert server.asked == ["GROUP=active&FORMAT=csv"]
        assert server.agents[0].startswith("sattrack/")
        client.later(HOUR_S)
        server.served.clear()
        client.fetch("celestrak:active")
        assert server.asked == ["GROUP=active&FORMAT=csv"] * 2
        assert len(client.told) == 1


def test_each_group_and_number_has_its_own_two_hours(tmp_path):
    with element_server() as server:
        client = Client(tmp_path, server.url)
        for source in (
            "celestrak:active",
            "celestrak:25544",
            "celestrak:1998-067A",
            "celestrak:Last-30-Days",
        ):
            client.fetch(source)
        assert server.asked == [
            "GROUP=active&FORMAT=csv",
            "CATNR=25544&FORMAT=csv",
            "INTDES=1998-067&FORMAT=csv",
            "GROUP=last-30-days&FORMAT=csv",
        ]


def test_a_refusal_stops_shows_the_servers_words_and_uses_what_was_kept(tmp_path):
    with element_server() as server:
        client = Client(tmp_path, server.url)
        client.fetch("celestrak:active")
        client.later(3 * HOUR_S)
        assert client.fetch("celestrak:active") == CSV
        (told,) = client.told
        assert "using what was fetched 3 h ago: the server answered 403 Forbidden" in told
        assert "GP data has not updated since your last successful download of GROUP=active" in told
        # A server that has refused once is left alone by the same run, and for two hours by the next.
        with pytest.raises(DownloadError, match="refused another request just now: 403"):
            client.fetch("celestrak:stations")
        client.later(HOUR_S)
        client.fetch("celestrak:active")
        assert len(server.asked) == 2


@pytest.mark.parametrize(
    ("manner", "words"),
    [
        ("moved", "answered 301 Moved Permanently: moved to https://example.org/elsewhere"),
        ("broken", "answered 500 Internal Server Error: Down for maintenance"),
        ("html", "sent a web page instead of elements: Down for maintenance"),
        ("cut", "what the server sent was cut off"),
        ("half a line", "does not end as it should"),
        ("cut gzip", "cut off"),
        ("bad gzip", "what the server sent is damaged"),
        ("silent", "took too long"),
    ],
)
def test_what_goes_wrong_is_told_and_what_was_kept_stays_whole(tmp_path, manner, words):
    with element_server() as server:
        client = Client(tmp_path, server.url, timeout_s=0.3 if manner == "silent" else 30.0)
        client.fetch("celestrak:active")
        before = {path: path.read_bytes() for path in tmp_path.glob("*.elements")}
        server.manner = manner
        client.later(5 * HOUR_S)
        assert client.fetch("celestrak:active") == CSV
        assert (
            f"using what was fetched 5 h ago: {'the server ' if words.startswith('answered') else ''}"
            in client.told[0]
        )
        assert words in client.told[0]
        assert "\n" not in client.told[0]
        assert "<" not in client.told[0]
        assert {path: path.read_bytes() for path in tmp_path.glob("*.elements")} == before
        assert not list(tmp_path.glob(".*.part"))
        with pytest.raises(DownloadError, match="celestrak:stations: ") as error:
            Client(tmp_path / "empty", server.url, timeout_s=0.3).fetch("celestrak:stations")
        assert words.split(":")[0] in str(error.value)
        assert error.value.exit_code == 1


@pytest.mark.parametrize(
    ("source", "words"),
    [
        (
            "celestrak:nowhere",
            '(Invalid query: "GROUP=nowhere&FORMAT=csv" (GROUP "nowhere" not found)): give',
        ),
        ("celestrak:99999", "(No GP data found): check the spelling"),
    ],
)
def test_a_query_that_finds_nothing_shows_the_servers_words_and_blames_no_network(tmp_path, source, words):
    with element_server() as server, pytest.raises(NothingThereError) as error:
        Client(tmp_path, server.url).fetch(source)
    assert words in str(error.value)
    assert "network" not in str(error.value)


def test_what_was_kept_is_used_in_silence_until_the_server_may_be_asked_again(tmp_path):
    with element_server() as server:
        client = Client(tmp_path, server.url, renewing=False)
        client.fetch("celestrak:active")
        client.later(HOUR_S)
        assert client.fetch("celestrak:active") == CSV
        assert client.told == []
        server.manner = "broken"
        client.later(2 * HOUR_S)
        assert client.fetch("celestrak:active") == CSV
        assert "using what was fetched 3 h ago: the server answered 500" in client.told[0]


@pytest.mark.parametrize("manner", ["gzip", "gz file"])
def test_compressed_answers_are_unpacked(tmp_path, manner):
    with element_server(manner) as server:
        client = Client(tmp_path, server.url)
        assert client.fetch("celestrak:active") == CSV
        assert client.shown[-1] == ("celestrak:active", None)
        assert 0 < (client.shown[-2][1] or 0) < len(CSV)


def test_a_server_that_is_not_there_may_be_asked_again_at_once(tmp_path):
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        client = Client(tmp_path, f"http://127.0.0.1:{unused.getsockname()[1]}")
        for _ in range(2):
            with pytest.raises(DownloadError, match=r"celestrak:active: cannot reach 127\.0\.0\.1"):
                client.fetch("celestrak:active")


def test_a_clock_set_back_does_not_stop_downloads_for_years(tmp_path):
    with element_server("gzip") as server:
        client = Client(tmp_path, server.url)
        client.fetch("celestrak:active")
        client.later(-1000 * HOUR_S)
        client.fetch("celestrak:active")
        assert len(server.asked) == 2


def test_urls_go_the_same_way(tmp_path):
    with element_server("tle") as server:
        client = Client(tmp_path, "http://127.0.0.1:1")
        url = f"{server.url}/NORAD/elements/gp.php?GROUP=active&FORMAT=tle"
        client.environ["SATTRACK_SPACETRACK_URL"] = "https://example.org"
        sets = load_elements(url, fetch=client.fetch)
        assert [one.catalog_number for one in sets.accepted] == [25544]
        assert "is truncated" in sets.notes[0]
        client.later(60.0)
        client.fetch(url)
        assert len(server.asked) == 1


def test_one_group_in_two_formats_is_one_group(tmp_path):
    with element_server() as server:
        client = Client(tmp_path, server.url, SATTRACK_SPACETRACK_URL="https://example.org")
        client.fetch("celestrak:active")
        with pytest.raises(DownloadError, match="asked 0 s ago, and once in 2 h is allowed"):
            client.fetch(f"{server.url}/NORAD/elements/gp.php?FORMAT=json&GROUP=active")
        assert len(server.asked) == 1


def test_a_full_disk_loses_nothing(tmp_path, monkeypatch):
    with element_server("gzip") as server:
        client = Client(tmp_path, server.url)
        client.fetch("celestrak:active")
        before = {path: path.read_bytes() for path in tmp_path.glob("*.elements")}
        client.later(3 * HOUR_S)
        whole = os.fsync

        def full(file: int) -> None:
            # What is written now is the body: the small files beside it still fit.
            if os.fstat(file).st_size > 300:
                raise OSError(errno.ENOSPC, "No space left on device")
            whole(file)

        monkeypatch.setattr("os.fsync", full)
        assert client.fetch("celestrak:active") == CSV
        assert "downloads cannot be kept there: No space left on device" in client.told[0]
        assert {path: path.read_bytes() for path in tmp_path.glob("*.elements")} == before
        assert not list(tmp_path.glob(".*.part"))


def test_what_was_kept_is_used_on_a_disk_that_takes_no_byte_more(tmp_path, monkeypatch):
    with element_server() as server:
        client = Client(tmp_path, server.url)
        client.fetch("celestrak:active")
        client.later(3 * HOUR_S)

        def full(file: int) -> None:
            raise OSError(errno.ENOSPC, "No space left on device")

        monkeypatch.setattr("os.fsync", full)
        assert client.fetch("celestrak:active") == CSV
        assert "using what was fetched 3 h ago:" in client.told[0]
        assert "No space left on device" in client.told[0]
        # Without a note of it, no request is sent.
        assert len(server.asked) == 1
        with pytest.raises(SattrackError, match="No space left on device"):
            client.fetch("celestrak:stations")


def test_what_was_kept_is_used_where_the_credentials_are_gone(tmp_path):
    with element_server() as server:
        client = Client(tmp_path, server.url, **RIGHT)
        text = client.fetch("spacetrack:all")
        del client.environ[PASSWORD_VARIABLE]
        client.later(2 * HOUR_S)
        assert client.fetch("spacetrack:all") == text
        assert "using what was fetched 2 h ago:" in client.told[0]
        assert "for Space-Track" in client.told[0]
        with pytest.raises(BadInputError, match="for Space-Track"):
            client.fetch("spacetrack:25544")


def test_space_track_gets_the_credentials_of_the_environment_and_is_asked_once_an_hour(tmp_path):
    with element_server() as server:
        client = Client(tmp_path, server.url, **RIGHT)
        for source in ("spacetrack:25544,100534", "spacetrack:all"):
            sets = load_elements(source, fetch=client.fetch)
            assert [one.catalog_number for one in sets.accepted] == [25544, 100534]
        assert server.logins == [("someone@example.org", "right")] * 2
        client.later(0.9 * HOUR_S)
        client.fetch("spacetrack:all")
        assert "once in 1 h is allowed" in client.told[0]
        assert len(server.asked) == 2
        client.later(0.2 * HOUR_S)
        client.fetch("spacetrack:all")
        assert len(server.asked) == 3
        assert server.asked[0].endswith(
            "/class/gp/NORAD_CAT_ID/25544,100534/orderby/NORAD_CAT_ID/format/json"
        )
        assert "decay_date/null-val/epoch/>now-30" in server.asked[1]
        kept = b"".join(path.read_bytes() for path in tmp_path.iterdir())
        assert b"right" not in kept


def test_space_track_is_asked_at_most_thirty_times_a_minute_and_three_hundred_an_hour(tmp_path):
    with element_server() as server:
        client = Client(tmp_path, server.url, **RIGHT)
        for number in range(15):
            client.fetch(f"spacetrack:{number + 1}")
        with pytest.raises(DownloadError, match=r"30 requests in 1 min are allowed: again in 1 min"):
            client.fetch("spacetrack:100")
        client.later(30.0)
        with pytest.raises(DownloadError, match="again in 30 s"):
            client.fetch("spacetrack:100")
        done = 15
        while done < 150:
            client.later(61.0)
            for _ in range(15):
                done += 1
                client.fetch(f"spacetrack:{done}")
        client.later(61.0)
        with pytest.raises(DownloadError, match="300 requests in 1 h are allowed: again in 49 min"):
            client.fetch("spacetrack:1000")
        assert len(server.asked) + len(server.logins) == 300
        client.later(HOUR_S)
        client.fetch("spacetrack:1000")


@pytest.mark.parametrize(
    ("manner", "password", "words"),
    [
        ("well", "wrong", "refused the login"),
        ("limit", "right", "violated your query rate limit"),
        ("none", "right", r"no element sets: \[\]"),
    ],
)
def test_what_space_track_refuses(tmp_path, manner, password, words):
    with element_server(manner) as server:
        client = Client(tmp_path, server.url, **{**RIGHT, PASSWORD_VARIABLE: password})
        with pytest.raises(DownloadError, match=words) as error:
            client.fetch("spacetrack:25544")
        assert password not in str(error.value).replace("correct", "")


def test_credentials_come_from_the_keyring_where_the_environment_has_none(monkeypatch):
    asked = []

    def get_credential(service: str, user: str | None) -> types.SimpleNamespace | None:
        asked.append((service, user))
        return types.SimpleNamespace(username="someone", password="kept") if user != "nobody" else None

    ring = types.ModuleType("keyring")
    ring.get_credential = get_credential
    errors = types.ModuleType("keyring.errors")
    errors.KeyringError = type("KeyringError", (Exception,), {})
    monkeypatch.setitem(__import__("sys").modules, "keyring", ring)
    monkeypatch.setitem(__import__("sys").modules, "keyring.errors", errors)
    assert credentials({}) == ("someone", "kept")
    assert credentials(RIGHT) == ("someone@example.org", "right")
    with pytest.raises(BadInputError, match="no credentials for Space-Track: set SATTRACK_SPACETRACK_USER"):
        credentials({USER_VARIABLE: "nobody"})
    assert asked == [(KEYRING_SERVICE, None), (KEYRING_SERVICE, "nobody")]


def test_supplemental_data_come_by_the_name_of_their_file_or_of_a_satellite(tmp_path):
    with element_server() as server:
        client = Client(tmp_path, server.url)
        for source in ("celestrak-sup:Starlink", "celestrak-sup:25544", "celestrak:starlink"):
            sets = load_elements(source, fetch=client.fetch)
            assert [one.catalog_number for one in sets.accepted] == [25544, 100534]
        assert server.asked == [
            "FILE=starlink&FORMAT=csv",
            "CATNR=25544&FORMAT=csv",
            "GROUP=starlink&FORMAT=csv",
        ]
        assert (
            query_of("celestrak-sup:iss", {}).url
            == "https://celestrak.org/NORAD/elements/supplemental/sup-gp.php?FILE=iss&FORMAT=csv"
        )


def test_the_elements_of_a_day_come_from_the_history_and_are_asked_for_once(tmp_path):
    with element_server() as server:
        client = Client(tmp_path, server.url, **RIGHT)
        sets = load_elements("spacetrack:25544@2026-10-02", fetch=client.fetch)
        assert sets.accepted[0].catalog_number == 25544
        assert server.asked == [
            "/basicspacedata/query/class/gp_history/NORAD_CAT_ID/25544/EPOCH/2026-10-01--2026-10-04"
            "/orderby/EPOCH/format/json"
        ]
        client.later(20.0 * HOUR_S)
        client.fetch("spacetrack:25544@2026-10-02")
        assert len(server.asked) == 1


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("spacetrack:25544@soon", "'soon' is no day: write it as 2026-10-02"),
        ("spacetrack:25544@9999-12-31", "'9999-12-31' is no day: write it as 2026-10-02"),
        ("spacetrack:all@2026-10-02", "(numbers), or spacetrack:25544@2026-10-02"),
        ("celestrak-sup:", "or celestrak-sup:starlink"),
        ("celestrak:", "write celestrak:GROUP"),
        ("celestrak:a&b", "write celestrak:GROUP"),
        ("celestrak:1234567890", "GROUP=1234567890"),
        ("spacetrack:iss", "write spacetrack:all"),
        ("ftp://example.org/a", "elements come from a file"),
        ("https://", "elements come from a file"),
        ("https://[x/", "is no URL"),
        ("https://me:secret@example.org/a", "no name and password in a URL"),
        ("http://www.space-track.org/basicspacedata", "a password is not sent over plain http"),
    ],
)
def test_sources_that_mean_nothing(source, words):
    if words.startswith("GROUP="):
        assert words in query_of(source, {}).url
        return
    with pytest.raises(BadInputError) as error:
        query_of(source, {})
    assert words in str(error.value)
    assert "secret" not in str(error.value)


def test_a_base_address_that_is_none(tmp_path):
    with pytest.raises(BadInputError, match="SATTRACK_CELESTRAK_URL is 'nonsense'"):
        Client(tmp_path, "nonsense").fetch("celestrak:active")
    with pytest.raises(BadInputError, match="not sent over plain http"):
        Client(tmp_path, "http://example.org", **RIGHT).fetch("spacetrack:all")


def test_where_downloads_are_kept(tmp_path):
    assert user_cache_folder({"XDG_CACHE_HOME": str(tmp_path)}) == tmp_path / "sattrack" / "elements"
    assert user_cache_folder({"XDG_CACHE_HOME": "relative"}) == user_cache_folder({})
    assert user_cache_folder({}) == Path.home() / ".cache" / "sattrack" / "elements"


def test_no_body_raises_anything_but_a_download_error(tmp_path):
    with element_server("any") as server:
        client = Client(tmp_path, server.url)
        numbers = itertools.count(1)

        @given(st.binary(max_size=200) | st.binary(max_size=50).map(lambda tail: CSV.encode()[:-40] + tail))
        @example(b"")
        @example(b"\x1f\x8b")
        @example(gzip.compress(b"1 "))
        @example(b"<html>\xff\x1b[2J")
        @settings(max_examples=60, deadline=None)
        def any_body(body: bytes) -> None:
            server.body = body
            source = f"celestrak:{next(numbers)}"
            said = ""
            try:
                assert client.fetch(source)
            except DownloadError as error:
                said = str(error)
            assert said.isprintable()
            assert len(said) < 700

        any_body()
    assert not list(tmp_path.glob(".*.part"))


def test_damaged_files_count_as_none(tmp_path):
    cache = DownloadCache(tmp_path)
    cache.keep("https://example.org/a", CSV, 5.0)
    kept = cache.read("https://example.org/a")
    assert kept is not None
    assert (kept.text, kept.fetched_unix_s) == (CSV, 5.0)
    (path,) = tmp_path.glob("*.elements")
    data = path.read_bytes()
    for damaged in (data[:-1], data[:20], b"", b"[]\n", b"\xff\n"):
        path.write_bytes(damaged)
        assert cache.read("https://example.org/a") is None
    cache.set_asked("x", [1.0])
    next(tmp_path.glob("*.asked")).write_text("{")
    assert cache.asked("x") == []


def test_a_folder_that_cannot_be_used_is_told(tmp_path):
    (tmp_path / "file").write_text("")
    with element_server() as server, pytest.raises(SattrackError, match="set XDG_CACHE_HOME") as error:
        Client(tmp_path / "file" / "folder", server.url).fetch("celestrak:active")
    assert error.value.exit_code == 1


def _hold(
    folder: Path, held: multiprocessing.synchronize.Event, let_go: multiprocessing.synchronize.Event
) -> None:
    with DownloadCache(folder).alone("celestrak"):
        held.set()
        let_go.wait()


def test_two_processes_do_not_ask_one_provider_at_once(tmp_path):
    spawning = multiprocessing.get_context("spawn")
    held, let_go = spawning.Event(), spawning.Event()
    other = spawning.Process(target=_hold, args=(tmp_path, held, let_go))
    other.start()
    held.wait()
    (lock,) = tmp_path.glob("*.lock")
    with lock.open("w") as file, pytest.raises(BlockingIOError):
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    let_go.set()
    with DownloadCache(tmp_path).alone("celestrak"):
        pass
    other.join()
    assert other.exitcode == 0
