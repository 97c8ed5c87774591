"""Who is let in to the page, and who is not."""

from __future__ import annotations

import asyncio
import html
import json
import re
import subprocess
from typing import TYPE_CHECKING

import pytest

from sattrack.runtime.callers import CallerLimits
from sattrack.servers import web
from sattrack.servers.alpaca import connections
from sattrack.servers.web import Visit, addresses_in, needs_token, new_token

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable
    from pathlib import Path

PATIENCE_S = 60.0
CHROMIUM = "chromium|chromium-browser|google-chrome"

TOKEN = "correct-horse-battery"
HERE = Visit("127.0.0.1", 8137, None, ("sattrack",))
ABROAD = Visit("0.0.0.0", 8137, TOKEN, ("sattrack",))


@pytest.mark.parametrize("host", ["127.0.0.1:8137", "localhost:8137", "[::1]:8137", "127.0.0.1"])
def test_this_machine_needs_nothing(host: str) -> None:
    assert HERE.refusal(host, None, {}, {}) is None
    assert HERE.refusal(host, f"http://{host}", {}, {}) is None


@pytest.mark.parametrize(
    "host", ["evil.example:8137", "", "127.0.0.1.evil.example", "192.0.2.1:8137", "[::1"]
)
def test_a_name_that_was_led_here_from_elsewhere_is_refused(host: str) -> None:
    try:
        assert HERE.refusal(host, None, {}, {}) is not None
    except ValueError:
        pytest.fail("a strange header is refused, and breaks nothing")


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://localhost:80", "https://127.0.0.1:8138", "http://[", ""]
)
@pytest.mark.parametrize("visit", [HERE, ABROAD])
def test_another_page_s_scripts_are_refused_whatever_they_bring(visit: Visit, origin: str) -> None:
    assert visit.refusal("127.0.0.1:8137", origin, {"token": TOKEN}, {visit.cookie: TOKEN}) is not None


def test_elsewhere_only_who_brings_the_token_comes_in() -> None:
    host = "telescope.example:8137"
    assert ABROAD.refusal(host, None, {"token": TOKEN}, {}) is None
    assert ABROAD.refusal(host, f"http://{host}", {}, {ABROAD.cookie: TOKEN}) is None
    for query, cookies in (
        ({}, {}),
        ({"token": TOKEN[:-1]}, {}),
        ({"token": ""}, {}),
        ({}, {"other": TOKEN}),
    ):
        assert ABROAD.refusal(host, None, query, cookies) is not None
    assert ABROAD.refusal(host, None, {"token": "ключ"}, {}) is not None


VISITED = """<script>
(() => {
  // In place of the browser's: a clock, a page behind a proxy, a connection that answers when it is told to.
  let nowMs = 0, tick, hear, classes = new Set(), sent = [];
  const performance = { now: () => nowMs }, setInterval = (act) => { tick = act; };
  const location = { href: "https://telescope.example/run/7" };
  const document = { body: { classList: { toggle: (n, on) => on ? classes.add(n) : classes.delete(n) } } };
  class WebSocket {
    static OPEN = 1;
    constructor(url) { this.url = String(url); this.readyState = 1; }
    addEventListener(_, act) { hear = act; }
    send(text) { sent.push(JSON.parse(text)[0]); }
  }
  const window = { WebSocket, addEventListener() {} };
  %s
  const found = [], connection = new window.WebSocket("/ws/7?width=80&height=24");
  for (let second = 0; second < 20; second += 1) {
    nowMs = 1000 * second;
    tick();
    // It answers for 3 s, and again from 15 s on.
    if (second < 3 || second >= 15) hear({ data: new ArrayBuffer(1) });
    found.push(classes.has("-silent"));
  }
  globalThis.document.title = JSON.stringify({ url: connection.url, silent: found, pings: sent.length });
})();
</script>"""


def test_the_page_says_that_nothing_answers_and_connects_as_it_came(
    tmp_path: Path, program: Callable[[str], str]
) -> None:
    script = re.findall(r"<script>(.*?)</script>", web.PAGE.read_text(encoding="utf-8"), re.DOTALL)[0]
    visited = tmp_path / "visited.html"
    visited.write_text(VISITED % script, encoding="utf-8")
    done = subprocess.run(
        [
            program(CHROMIUM), "--headless=new", "--no-sandbox", "--disable-gpu",
            f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom", visited.as_uri(),
        ],
        capture_output=True, text=True, check=False, timeout=PATIENCE_S,
    )  # fmt: skip
    title = re.search(r"<title>(.*)</title>", done.stdout)
    assert title is not None, done.stderr
    seen = json.loads(html.unescape(title[1]))

    assert seen["url"] == "wss://telescope.example/ws/7?width=80&height=24"
    assert [second for second, silent in enumerate(seen["silent"]) if silent] == list(range(9, 16))
    assert seen["pings"] == 3 + 1 + 4


@pytest.mark.parametrize(
    ("runs", "words"),
    [
        ({}, "No run is active."),
        ({7: "<b>ISS</b> & sim"}, "That run is not active. Another one is:"),
        ({7: "<b>ISS</b> & sim", 8: "HST"}, "2 runs are active:"),
    ],
)
def test_the_list_of_runs_counts_them_and_takes_names_for_text(runs: dict[int, str], words: str) -> None:
    page = web.listed(runs)

    assert words in page
    assert page.count("<a href") == len(runs)
    assert "<b>" not in page


def test_a_token_is_needed_off_this_machine_and_is_not_guessed() -> None:
    assert [needs_token(host) for host in ("127.0.0.1", "::1", "localhost", "0.0.0.0", "192.0.2.1")] == [
        False, False, False, True, True
    ]  # fmt: skip
    made = {new_token() for _ in range(50)}
    assert len(made) == 50
    assert min(len(token) for token in made) >= 24


FIB_TRIE = """\
Main:
  +-- 0.0.0.0/0 3 0 5
           |-- 127.0.0.1
              /32 host LOCAL
           |-- 192.0.2.0
              /24 link UNICAST
           |-- 192.0.2.7
              /32 host LOCAL
        |-- 192.0.2.255
           /32 link BROADCAST
Local:
           |-- 192.0.2.7
              /32 host LOCAL
           |-- 198.51.100.9
              /32 host LOCAL
"""
IF_INET6 = """\
20010db8000000000000000000000007 02 40 00 80     eth0
fe800000000000000042acfffe110002 02 40 20 80     eth0
00000000000000000000000000000001 01 80 10 80       lo
"""


def test_the_addresses_that_are_shown_are_those_that_another_computer_can_open() -> None:
    machine = addresses_in(FIB_TRIE, IF_INET6)
    assert machine == ("192.0.2.7", "198.51.100.9", "2001:db8::7")
    query = f"?token={TOKEN}"
    assert ABROAD.urls(8137, machine) == (
        f"http://192.0.2.7:8137/{query}",
        f"http://198.51.100.9:8137/{query}",
    )
    assert Visit("::", 0, None, ()).urls(81, machine)[2] == "http://[2001:db8::7]:81/"
    assert HERE.urls(8137, machine) == ("http://127.0.0.1:8137/",)
    assert ABROAD.urls(8137, addresses_in("", "")) == (f"http://127.0.0.1:8137/{query}",)


def visited(play: Callable[[int], Awaitable[None]], runs: Callable[[], dict[int, str]] = dict) -> None:
    """Play a scene before the page, at its port."""

    async def scene() -> None:
        told: asyncio.Future[tuple[str, ...]] = asyncio.get_running_loop().create_future()
        page = asyncio.ensure_future(web._serve(Visit("127.0.0.1", 0, None, ()), runs, told.set_result))
        try:
            async with asyncio.timeout(PATIENCE_S):
                await play(int((await told)[0].rstrip("/").rpartition(":")[2]))
        finally:
            page.cancel()
            await asyncio.wait((page,))

    asyncio.run(scene())


async def whole_answer(reader: asyncio.StreamReader) -> bytes:
    """Read until the page hangs up."""
    try:
        return await reader.read()
    except ConnectionError:
        return b""


def test_one_address_has_its_share_of_connections_and_silent_ones_give_way(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(web, "LIMITS", CallerLimits(callers=3))

    async def play(port: int) -> None:
        lines = [await asyncio.open_connection("127.0.0.1", port) for _ in range(4)]
        assert await whole_answer(lines[0][0]) == b""
        lines[3][1].write(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n")
        assert (await whole_answer(lines[3][0])).startswith(b"HTTP/1.1 200")
        for _, writer in lines:
            writer.close()

    visited(play)


@pytest.mark.parametrize(("path", "status"), [("/run/{}", 200), ("/ws/{}", 404), ("/?fontsize={}", 200)])
def test_numbers_of_thousands_of_digits_break_nothing(
    path: str, status: int, caplog: pytest.LogCaptureFixture
) -> None:
    async def play(port: int) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        asked = path.format("9" * 5000)
        writer.write(f"GET {asked} HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n".encode())
        assert (await whole_answer(reader)).startswith(f"HTTP/1.1 {status}".encode())
        writer.close()

    visited(play, lambda: {7: "the run"})
    assert caplog.records == []


@pytest.mark.parametrize("begun", [b"G", b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: "])
def test_who_leaves_a_request_unfinished_is_hung_up_on(monkeypatch: pytest.MonkeyPatch, begun: bytes) -> None:
    monkeypatch.setattr(connections, "REQUEST_WITHIN_S", 0.0)
    monkeypatch.setattr(connections, "TEND_EVERY_S", 0.0)

    async def play(port: int) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(begun)
        assert await whole_answer(reader) == b""
        writer.close()

    visited(play)
