"""The page as a browser has it: what is served to whom, and a run seen and stopped in a real one."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import json
import os
import re
import select
import shlex
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections import deque
from contextlib import asynccontextmanager, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any
from unittest.mock import create_autospec
from urllib.parse import parse_qs, urlsplit

import aiohttp
import pytest
from aiohttp import web

from sattrack.cli.main import run as run_command
from sattrack.runtime.view_server import SUPPORTED, name_for

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable, Iterator

pytest.importorskip("textual_serve")
pytestmark = pytest.mark.skipif(not SUPPORTED, reason="abstract names are Linux's")
CHROMIUM = "chromium|chromium-browser|google-chrome"
PATIENCE_S = 60.0
ARROWS = {"ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39, "ArrowDown": 40}
WHERE = "document.querySelector('.xterm-screen').getBoundingClientRect().toJSON()"
ESCAPES = re.compile(rb"\x1b\[[0-9;?]*[A-Za-z]")


@contextmanager
def started(*command: str, told: str = "stdout") -> Iterator[subprocess.Popen[bytes]]:
    pipes = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, told: subprocess.PIPE}
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL, start_new_session=True, **pipes)
    try:
        yield process
    finally:
        process.terminate()
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(10.0)
        process.kill()
        process.wait()
        pipe = getattr(process, told)
        pipe.close()


DEMO = (sys.executable, "-m", "sattrack", "demo", "--headless", "--json")


@pytest.fixture(scope="module")
def demo() -> Iterator[subprocess.Popen[bytes]]:
    """A run that is watched by one test after the other, and stopped by the last."""
    with started(*DEMO) as running:
        yield running


@contextmanager
def page(*options: str, run: int | None = None) -> Iterator[str]:
    """Serve the page; give its address."""
    which = () if run is None else ("--run", str(run))
    command = (sys.executable, "-m", "sattrack", "serve", "web", "--port", "0", "--json", *which, *options)
    with started(*command) as server:
        assert server.stdout is not None
        yield json.loads(server.stdout.readline())["url"]


class NoRedirect(urllib.request.HTTPRedirectHandler):
    def redirect_request(self, *_: Any) -> None:
        return None


def fetched(url: str, **headers: str) -> tuple[int, str, dict[str, str]]:
    request = urllib.request.Request(url, headers=headers)
    try:
        with urllib.request.build_opener(NoRedirect).open(request, timeout=PATIENCE_S) as answer:
            return answer.status, answer.read().decode(errors="replace"), dict(answer.headers)
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read().decode(), dict(error.headers)


def test_the_page_is_served_to_whom_it_is_for_and_fetches_nothing_from_elsewhere() -> None:
    with page("--host", "0.0.0.0", run=os.getpid()) as url, socket.socket(socket.AF_UNIX) as run:
        address, _, token = url.partition("?token=")
        assert "0.0.0.0" not in address
        assert len(token) >= 24
        for path in ("", f"run/{os.getpid()}", "static/js/textual.js", "ws", f"ws/{os.getpid()}"):
            code, text, _ = fetched(address + path)
            assert (code, text.count("\n")) == (403, 1)
        code, _, headers = fetched(f"{address}?token={token}")
        assert (code, headers["Location"]) == (303, "/")
        cookie = headers["Set-Cookie"].partition(";")[0]
        assert "HttpOnly" in headers["Set-Cookie"]
        code, text, headers = fetched(address, Cookie=cookie)
        assert (code, headers["Refresh"]) == (200, "3; url=/")
        assert "No run is active" in text
        run.bind(name_for(os.getpid()))
        code, text, headers = fetched(address, Cookie=cookie)
        assert code == 200
        assert "data-session-websocket-url" in text
        assert not re.search(r"https?://", text)
        assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
        assert fetched(address, Cookie=cookie, Origin="http://evil.example")[0] == 403
        assert fetched(f"{address}static/js/textual.js", Cookie=cookie)[0] == 200
        assert fetched(f"{address}static/../server.py", Cookie=cookie)[0] in {403, 404}


def test_of_several_runs_the_page_links_to_each_and_shows_no_command(
    demo: subprocess.Popen[bytes],
) -> None:
    with started(*DEMO) as other, page() as url:
        until_s = time.monotonic() + PATIENCE_S
        while not all(f'<a href="/run/{each.pid}">' in (text := fetched(url)[1]) for each in (demo, other)):
            assert time.monotonic() < until_s, text
            select.select([], [], [], 0.05)
        assert "headless" not in text
        assert "ISS" in text
        code, text, _ = fetched(f"{url}run/{other.pid}")
        assert code == 200
        assert f'data-session-websocket-url="/ws/{other.pid}"' in text
        assert "run/" in fetched(f"{url}run/1")[1]


def test_a_port_that_is_taken_and_a_short_token_are_told_in_a_line(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        for options, words in (
            (("--port", port), f"TCP port {port} on 127.0.0.1 is not available"),
            (("--token", "short"), "16 or more"),
        ):
            assert run_command(["serve", "web", *options]) in {1, 2}
            err = capsys.readouterr().err
            assert words in err
            assert err.count("\n") == 1


def screens_of(run: int) -> set[int]:
    """Return the processes, by the machine's table, that draw visitors' screens of a run."""
    found = set()
    for folder in Path("/proc").iterdir():
        with contextlib.suppress(OSError):
            words = (folder / "cmdline").read_bytes().split(b"\0") if folder.name.isdecimal() else []
            if b"attach" in words and str(run).encode() in words and b"--as" in words:
                found.add(int(folder.name))
    return found


async def until(happens: Callable[[], bool], within_s: float) -> None:
    until_s = time.monotonic() + within_s
    while not happens():
        assert time.monotonic() < until_s, "it did not come"
        await asyncio.sleep(0.05)


async def visited(url: str, run: int, drawn: bool, leave: Callable[[], None] | None) -> None:
    """Come, leave before or after the screen is drawn, or stay and have `leave` happen."""
    async with (
        aiohttp.ClientSession() as session,
        session.ws_connect(f"{url}ws?width=100&height=30") as visitor,
    ):
        await until(lambda: bool(screens_of(run)), PATIENCE_S)
        if drawn:
            await visitor.receive(PATIENCE_S)
        if leave is not None:
            leave()
            await until(lambda: not screens_of(run), PATIENCE_S)
        else:
            assert visitor._response.connection is not None
            assert visitor._response.connection.transport is not None
            # Without a word, as a browser that is killed, and with something to draw yet.
            for columns in range(200, 260):
                await visitor.send_json(["resize", {"width": columns, "height": 60}])
            visitor._response.connection.transport.abort()
    await until(lambda: not screens_of(run), PATIENCE_S)


def test_no_screen_outlives_its_visitor_or_the_page(demo: subprocess.Popen[bytes]) -> None:
    command = (sys.executable, "-m", "sattrack", "serve", "web", "--port", "0", "--json")
    for number, visits in ((signal.SIGTERM, (False, True)), (signal.SIGKILL, ())):
        with started(*command, "--run", str(demo.pid)) as server:
            assert server.stdout is not None
            url = json.loads(server.stdout.readline())["url"]
            until_s = time.monotonic() + PATIENCE_S
            while "No run is active" in fetched(url)[1]:
                assert time.monotonic() < until_s
                select.select([], [], [], 0.05)
            for drawn in visits:
                asyncio.run(visited(url, demo.pid, drawn, None))
            asyncio.run(visited(url, demo.pid, True, partial(server.send_signal, number)))
    assert demo.poll() is None


DEAF = """
import pathlib, signal, sys, threading
signal.signal(signal.SIGTERM, signal.SIG_IGN)
pathlib.Path(sys.argv[1]).touch()
threading.Event().wait()
"""


def test_a_screen_that_is_deaf_to_every_request_is_killed(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    from textual_serve.download_manager import DownloadManager

    from sattrack.servers import web as server

    monkeypatch.setattr(server, "LEAVE_WITHIN_S", 0.3)

    async def end_it() -> int | None:
        visitor = create_autospec(web.WebSocketResponse, instance=True)
        deaf = tmp_path / "deaf"
        command = f"exec {shlex.join([sys.executable, '-c', DEAF, str(deaf)])}"
        screen = server.VisitorScreen(command, visitor, DownloadManager())
        await screen.start(80, 24)
        assert screen._process is not None
        await until(deaf.exists, PATIENCE_S)
        await screen.stop()
        assert screen._task is not None
        await screen._task
        visitor.close.assert_awaited_once()
        return screen._process.returncode

    assert asyncio.run(end_it()) == -signal.SIGKILL


class Browser:
    """A browser's page, driven by its own protocol; what comes over the page's connection is kept."""

    def __init__(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        self._socket = socket
        self._count = 0
        self.drawn = b""
        self.fetched: list[str] = []
        self.columns = 0

    async def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._count += 1
        await self._socket.send_json({"id": self._count, "method": method, "params": parameters})
        while (told := await self._next()).get("id") != self._count:
            pass
        return told.get("result", {})

    async def until(self, *texts: bytes) -> None:
        """Wait until each text has been drawn since the last call."""
        until_s = time.monotonic() + PATIENCE_S
        while not all(text in (plain := ESCAPES.sub(b"", self.drawn)) for text in texts):
            assert time.monotonic() < until_s, f"{texts} did not come: {plain[-3000:]!r}"
            await self._next()
        self.drawn = b""

    async def picture(self) -> bytes:
        told = await self.call(
            "Page.captureScreenshot", clip={"x": 0, "y": 80, "width": 300, "height": 80, "scale": 1}
        )
        return base64.b64decode(told["data"])

    async def press(self, key: str, code: str, number: int) -> None:
        both = {"key": key, "code": code, "windowsVirtualKeyCode": number}
        await self.call("Input.dispatchKeyEvent", type="keyDown", text=key, **both)
        await self.call("Input.dispatchKeyEvent", type="keyUp", **both)

    async def press_arrow(self, name: str, shift: bool = False) -> None:
        """Press a key that has no text, as a browser tells of it."""
        both = {"key": name, "code": name, "windowsVirtualKeyCode": ARROWS[name], "modifiers": 8 * shift}
        await self.call("Input.dispatchKeyEvent", type="rawKeyDown", **both)
        await self.call("Input.dispatchKeyEvent", type="keyUp", **both)

    async def touch_lowest_row(self, column: int) -> None:
        """Click a cell of the terminal with the mouse."""
        told = await self.call("Runtime.evaluate", expression=WHERE, returnByValue=True)
        box = told["result"]["value"]
        at = {"x": (column + 0.5) * box["width"] / self.columns, "y": box["bottom"] - 5.0}
        for what in ("mousePressed", "mouseReleased"):
            await self.call("Input.dispatchMouseEvent", type=what, button="left", clickCount=1, **at)

    async def shows(self, picture: bool) -> dict[str, Any]:
        """Wait until the page has a picture laid over the terminal, or none; tell how it lies."""
        until_s = time.monotonic() + PATIENCE_S
        while True:
            told = await self.call("Runtime.evaluate", expression=LIES, returnByValue=True)
            lies = told["result"].get("value")
            if (lies is not None and lies["wide"] > 0) if picture else lies is None:
                return lies or {}
            assert time.monotonic() < until_s
            await asyncio.sleep(0.05)

    async def resize(self, width: int, height: int) -> None:
        """Make the window another size, in pixels."""
        window = await self.call("Browser.getWindowForTarget")
        bounds = {"width": width, "height": height}
        await self.call("Browser.setWindowBounds", windowId=window["windowId"], bounds=bounds)

    async def _next(self) -> dict[str, Any]:
        told: dict[str, Any] = await asyncio.wait_for(self._socket.receive_json(), PATIENCE_S)
        if told.get("method") == "Network.webSocketFrameReceived":
            frame = told["params"]["response"]
            if frame["opcode"] == 2:
                self.drawn += base64.b64decode(frame["payloadData"])
        if told.get("method") == "Network.requestWillBeSent":
            self.fetched.append(told["params"]["request"]["url"])
        if told.get("method") == "Network.webSocketCreated":
            size = parse_qs(urlsplit(told["params"]["url"]).query)
            self.columns = int(size["width"][0])
        return told


@contextmanager
def browsing(folder: Path, program: Callable[[str], str], size: str) -> Iterator[str]:
    """Run a browser with a window of a size; give where its debugger listens."""
    with started(
        program(CHROMIUM), "--headless=new", "--no-sandbox", "--disable-gpu", "--remote-debugging-port=0",
        f"--user-data-dir={folder / 'profile'}", f"--window-size={size}", "about:blank", told="stderr",
    ) as chromium:  # fmt: skip
        assert chromium.stderr is not None
        found = next(filter(None, (re.search(rb"ws://[^/]+", line) for line in chromium.stderr)))
        yield found[0].decode().removeprefix("ws://")


@asynccontextmanager
async def visiting(debugger: str, url: str) -> AsyncIterator[Browser]:
    """Open a page in a browser, and drive it."""
    async with aiohttp.ClientSession() as session:
        async with session.get(f"http://{debugger}/json") as answer:
            pages = await answer.json()
        where = next(each["webSocketDebuggerUrl"] for each in pages if each["type"] == "page")
        async with session.ws_connect(where, max_msg_size=0) as socket:
            browser = Browser(socket)
            await browser.call("Network.enable")
            await browser.call("Page.enable")
            await browser.call("Page.navigate", url=url)
            yield browser


async def biased(views: asyncio.StreamReader, **asked: float) -> None:
    """Wait until a run itself says that it was asked for these offsets."""
    last: deque[Any] = deque(maxlen=1)
    until_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < until_s:
        view = json.loads(await asyncio.wait_for(views.readline(), PATIENCE_S))
        last.append({one["what"]: one["total"] for one in view.get("offsets", ())})
        if all(last[-1].get(what) == pytest.approx(total) for what, total in asked.items()):
            return
    pytest.fail(f"{asked} were asked for, and not {last}")


def test_a_run_is_seen_taken_and_stopped_in_a_browser(
    tmp_path: Path, program: Callable[[str], str], demo: subprocess.Popen[bytes]
) -> None:
    with page(run=demo.pid) as url, browsing(tmp_path, program, "820,480") as debugger:
        asyncio.run(seen_and_stopped(debugger, url, demo.pid))
        assert demo.stdout is not None
        summary = json.loads(demo.stdout.read())["summary"]
        assert demo.wait(PATIENCE_S) == 0
    assert summary["ended_by"] == "operator"
    assert summary["mount_stopped"] is True


CAMERA = Path(__file__).with_name("camera_on_page.py")
BUILDERS = Path(__file__).parents[2] / "tui"
LIES = """(() => {
  const image = document.getElementById("picture"), screen = document.querySelector(".xterm-screen");
  if (getComputedStyle(image).display === "none") return null;
  const at = image.getBoundingClientRect(), all = screen.getBoundingClientRect();
  return {wide: image.naturalWidth, left: at.left - all.left, top: at.top - all.top,
          right: all.right - at.right, bottom: all.bottom - at.bottom,
          stretched: at.width / image.naturalWidth / (at.height / image.naturalHeight)};
})()"""


def test_a_cameras_picture_lies_on_the_page_while_its_screen_is_shown(
    tmp_path: Path, program: Callable[[str], str]
) -> None:
    """It is an image of the page's own, in pixels; a dialog and another page take it away."""
    with browsing(tmp_path, program, "1000,640") as debugger:
        asyncio.run(camera_seen(debugger))


async def camera_seen(debugger: str) -> None:
    from sattrack.servers.web import Visit, _serve

    told: asyncio.Future[tuple[str, ...]] = asyncio.get_running_loop().create_future()
    visit = Visit("127.0.0.1", 0, None, (sys.executable, str(CAMERA), str(BUILDERS)))
    page = asyncio.ensure_future(_serve(visit, lambda: {7: "a run"}, told.set_result))
    try:
        async with visiting(debugger, (await told)[0]) as browser:
            await browser.until(b"SPACE STOP")
            await browser.press("6", "Digit6", 54)
            lies = await browser.shows(picture=True)
            assert lies["wide"] > 300
            assert min(lies[side] for side in ("left", "top", "right", "bottom")) > 0.0
            assert lies["stretched"] == pytest.approx(1.0, abs=0.1)
            await browser.press("?", "Slash", 191)
            await browser.shows(picture=False)
            await browser.press("?", "Slash", 191)
            assert (await browser.shows(picture=True))["left"] == lies["left"]
            await browser.press("1", "Digit1", 49)
            await browser.shows(picture=False)
    finally:
        page.cancel()
        await asyncio.wait((page,))


async def seen_and_stopped(debugger: str, url: str, run: int) -> None:
    async with visiting(debugger, url) as browser:
        # Where the run was not there yet, the page looks again by itself.
        await browser.until(b"LOOKING ON", b"SPACE STOP")
        before = await browser.picture()
        while await browser.picture() == before:
            # The large figure: how far it is to the satellite yet, or the error.
            await browser.until(b"range")
        await browser.press("c", "KeyC", 67)
        await browser.until(b"IN CONTROL")
        await nudged(browser, run)
        await browser.press(" ", "Space", 32)
        await browser.until(b"the mount is at rest")
    assert all(each.startswith(url) for each in browser.fetched if each.startswith("http")), browser.fetched


async def nudged(browser: Browser, run: int) -> None:
    """Move the target by arrows and by a touch, and make the window larger."""
    command = (sys.executable, "-m", "sattrack", "attach", "--json", "--run", str(run))
    attached = await asyncio.create_subprocess_exec(*command, stdout=asyncio.subprocess.PIPE)
    views = attached.stdout
    assert views is not None
    try:
        await browser.press_arrow("ArrowRight", shift=True)
        await browser.press_arrow("ArrowDown", shift=True)
        await biased(views, along_s=1.0, cross_deg=-0.1)
        for name, asked in (
            ("ArrowRight", {"along_s": 1.1}),
            ("ArrowLeft", {"along_s": 1.0}),
            ("ArrowUp", {"cross_deg": -0.09}),
            ("ArrowDown", {"cross_deg": -0.1}),
        ):
            await browser.press_arrow(name)
            await biased(views, **asked)
        # The arrow to the right is the second character of the lowest row, behind the edge.
        await browser.touch_lowest_row(2)
        await biased(views, along_s=1.1, cross_deg=-0.1)
    finally:
        attached.kill()
        await attached.wait()
    await browser.resize(1400, 800)
    await browser.until(b"spiral", b"SPACE STOP")
