"""The same screens on a recording: keys of the tape, what they show, and that nobody is ever spoken to."""

from __future__ import annotations

import asyncio
import os
import re
import sys
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import pytest
from tui_builders import SKY, SUMMARY, UTC_S, FakeFeed, HandClock, changed

from sattrack.cli.main import run as run_program
from sattrack.tui.feeds import News
from sattrack.tui.launch import replay_with_tui
from sattrack.tui.replay_app import NOTHING_MOVES, ReplayApp, Tape, TapeFeed
from sattrack.tui.scene import Appearance
from sattrack.views.run import PassView, TrackView

if TYPE_CHECKING:
    from collections.abc import Callable

SMALL, LARGE = (80, 24), (120, 40)
CLEAN = Path(__file__).parents[3] / "examples" / "passes" / "clean.mcap"
BLIND = "no fresh status from the mount: following by prediction"
COUNT = 1201
"""Two minutes, ten views a second."""


def recorded() -> tuple[TrackView, ...]:
    """Return two minutes of tracking that end with the set, its error growing by 0.01 arcseconds a second."""
    found = []
    for number in range(COUNT):
        utc_s = UTC_S + 0.1 * number
        error = {"utc_s": utc_s, "total_arcsec": 0.001 * number, "ra_arcsec": 0.001 * number}
        last = number == COUNT - 1
        found.append(
            changed(
                utc_s=utc_s,
                error=error,
                phase="stopping" if last else "tracking",
                ended_by="set" if last else None,
                warnings=("no fresh status from the mount: following by prediction",)
                if number > 1100
                else (),
            )
        )
    return tuple(found)


RECORDED = recorded()


def played(
    act: Callable[[ReplayApp, HandClock, Callable[..., object]], object],
    size: tuple[int, int] = SMALL,
    views: tuple[TrackView, ...] = RECORDED,
    speed: float = 1.0,
    appearance: Appearance = Appearance(),  # noqa: B008 - frozen
) -> tuple[list[str], FakeFeed, Tape]:
    """Run the screen on a recording that is read at once; return what stands there at last."""
    source, clock, tape = FakeFeed([News(views, True, SUMMARY, SKY)]), HandClock(), Tape("pass.mcap", speed)
    source.coming += [News((), True, SUMMARY, SKY)] * 500

    async def run() -> list[str]:
        app = ReplayApp(TapeFeed(source, tape, clock), clock, appearance)
        async with app.run_test(size=size) as pilot:
            await act(app, clock, pilot.press)  # type: ignore[misc]
            if not app._exit:
                for _ in range(2):
                    app.plot()
                    await pilot.pause()
                app.look()
                await pilot.pause()
            return [
                "".join(segment.text for segment in strip) for strip in app.screen._compositor.render_strips()
            ]

    return asyncio.run(run()), source, tape


def keys(*pressed: str, after_s: float = 0.0):
    """Return what lets time go by and then presses keys."""

    async def act(app: ReplayApp, clock: HandClock, press: Callable[..., object]) -> None:
        clock.now_s += after_s
        app.look()
        await press(*pressed)  # type: ignore[misc]

    return act


PRESSED: tuple[tuple[list[str], float, bool, float], ...] = (
    ([], 20.0, True, 1.0),
    (["p"], 20.0, False, 1.0),
    (["p", "p"], 20.0, True, 1.0),
    (["right"], 30.0, True, 1.0),
    (["left"], 10.0, True, 1.0),
    (["left", "left", "left"], 0.0, True, 1.0),
    (["pagedown"], 80.0, True, 1.0),
    (["pagedown", "pageup"], 20.0, True, 1.0),
    (["home"], 0.0, True, 1.0),
    (["end"], 120.0, True, 1.0),
    (["end", "p"], 0.0, True, 1.0),
    (["full_stop"], 20.1, False, 1.0),
    (["comma", "comma"], 19.8, False, 1.0),
    (["right_square_bracket"], 20.0, True, 2.0),
    (["left_square_bracket"] * 2, 20.0, True, 0.25),
    (["right_square_bracket"] * 3 + ["1"], 20.0, True, 1.0),
    (["question_mark", "p", "escape"], 20.0, True, 1.0),
    (["question_mark", "right", "question_mark", "right"], 30.0, True, 1.0),
    (["v", "t", "up", "down", "0", "s", "w", "f", "r", "m", "escape", "enter", "v"], 20.0, True, 1.0),
)
"""Keys, and where the tape then stands that played at 20 s: seconds, whether it plays, how fast."""


def test_each_key_moves_the_tape_and_says_nothing_to_anybody() -> None:
    found = []

    async def act(app: ReplayApp, clock: HandClock, press: Callable[..., object]) -> None:
        for pressed, *_ in PRESSED:
            tape = app._tape
            tape.seek(20.0)
            tape.playing, tape.speed = True, 1.0
            app.look()
            await press(*pressed)  # type: ignore[misc]
            found.append((pressed, round(tape.view.at_s, 6), tape.playing, tape.speed))

    _, source, _ = played(act)
    assert found == list(PRESSED)
    assert source.sent == []


@pytest.mark.parametrize("key", ["q", "ctrl+c"])
def test_it_is_left_at_once_and_not_by_itself(key: str) -> None:
    async def act(app: ReplayApp, clock: HandClock, press: Callable[..., object]) -> None:
        clock.now_s += 500.0
        app.look()
        app.look()
        assert not app._exit, "it stays at the end"
        await press(key)  # type: ignore[misc]
        assert app._exit
        assert app.interrupted is (key == "ctrl+c")

    assert played(act)[1].sent == []


@pytest.mark.parametrize(("size", "theme"), [(SMALL, "red"), (LARGE, "contrast")])
def test_the_screen_is_the_runs_own_with_the_tape_below(size: tuple[int, int], theme: str) -> None:
    rows, _, _ = played(keys("p", after_s=40.0), size, appearance=Appearance(theme))
    text = "\n".join(rows)

    assert [len(row) for row in rows] == [size[0]] * size[1]
    assert rows[0].startswith("  REPLAY  ISS (ZARYA)  25544   mount sim")
    assert rows[0].rstrip().endswith("2026-10-02 13:05:11 UTC")
    assert rows[1].strip() == "TRACKING  on the satellite: all is well"
    assert re.fullmatch(r"  PAUSED  ×1   0:40 of 2:00  █+·+  pass\.mcap", rows[-2].rstrip())
    done, left = rows[-2].count("█"), rows[-2].count("·")
    assert done / (done + left) == pytest.approx(1.0 / 3.0, abs=0.02)
    for figure in ("+0.050 s", "Sun", "p go on", "q leave", "±400″"):
        assert figure in text, figure
    for hint in ("behind", "ahead", "STOP", "step   0.1"):
        assert hint not in text, hint
    assert "…" not in text


def test_what_stood_beyond_a_jump_back_is_gone_from_the_plot() -> None:
    after = "\n".join(played(keys("end", after_s=0.0))[0])
    back = "\n".join(played(keys("end", "home", "right", after_s=0.0))[0])
    assert "scale ±2″" in after
    assert "scale ±2″" not in back

    def dots(text: str) -> int:
        plot = [row[:61] for row in text.splitlines() if row[9:10] in {"┃", "╋", "┫"}]
        return sum("⠁" <= cell <= "⣿" and cell != "⠒" for row in plot for cell in row)

    assert 0 < dots(back) < 0.5 * dots(after)


def test_at_the_end_it_says_how_the_run_ended_and_on_the_way_back_no_more() -> None:
    ended, _, _ = played(keys("end"))
    assert ended[1].strip() == "END  of the recording: the pass is over; q leaves"
    assert ended[-2].startswith("  AT THE END ")
    assert ended[-1].startswith(" p again ")
    back, _, _ = played(keys("end", "left"))
    assert back[1].strip().startswith("TRACKING")
    assert back[-1].startswith(" p pause " if "PLAYING" in back[-2] else " p go on ")
    cut = played(keys("end"), views=RECORDED[:700])[0]
    assert cut[1].strip() == "END  of the recording: it is cut off here; q leaves"


def test_what_was_warned_of_is_shown_without_telling_what_to_do() -> None:
    rows, _, _ = played(keys("p", after_s=115.0))
    assert rows[2].strip() == "! no fresh status from the mount: following by prediction"


@pytest.mark.parametrize("pressed", [["space"], ["question_mark", "space"]])
def test_the_stop_key_of_a_mount_neither_pauses_a_recording_nor_is_silent(pressed: list[str]) -> None:
    rows, source, tape = played(keys(*pressed, after_s=40.0))
    assert rows[2].strip() == f"! {NOTHING_MOVES}"
    assert tape.playing
    assert source.sent == []


def test_standing_still_is_no_silence() -> None:
    async def act(app: ReplayApp, clock: HandClock, press: Callable[..., object]) -> None:
        await press("p")  # type: ignore[misc]
        clock.now_s += 100.0

    assert "NO NEWS" not in "\n".join(played(act)[0])


def test_a_run_that_is_still_being_read_says_so() -> None:
    source, clock, tape = FakeFeed([News(RECORDED[:50], False, None, SKY)]), HandClock(), Tape("p", 100.0)

    async def run() -> str:
        app = ReplayApp(TapeFeed(source, tape, clock), clock)
        async with app.run_test(size=SMALL) as pilot:
            clock.now_s += 10.0
            app.look()
            await pilot.pause()
            return "".join(s.text for s in app.screen._compositor.render_strips()[-2])

    row = asyncio.run(run())
    assert " PLAYING  ×100 0:04 of 0:04, reading on" in row


def test_the_views_of_a_recording_come_all_at_once_after_what_is_told_of_the_pass(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with Path(os.devnull).open() as nobody:
        # Its end comes at once, and is heeded now and then.
        monkeypatch.setattr("sys.stdin", nobody)
        command = ["replay", str(CLEAN), "--stream", "--control", "--at-once", "--fov", "0.5"]
        assert run_program(command) == 0
    first, *middle, last = capfd.readouterr().out.splitlines()
    assert msgspec.json.decode(first, type=PassView).fov_deg == 0.5
    assert 0 < len(middle) <= 20
    assert '"summary"' in last
    views = [msgspec.json.decode(line, type=TrackView) for line in middle]
    gaps = [b.utc_s - a.utc_s for a, b in pairwise(views)]
    assert all(0.09 < gap < 0.16 for gap in gaps)


def test_a_reading_that_fails_shows_no_screen_and_gives_its_code(capfd: pytest.CaptureFixture[str]) -> None:
    shown: list[object] = []
    command = [sys.executable, "-c", "import sys; print('no such pass', file=sys.stderr); sys.exit(2)"]
    code = replay_with_tui(command, "x", 1.0, show=lambda feed: bool(shown.append(feed)))
    assert (code, shown) == (2, [])
    assert capfd.readouterr().err == "no such pass\n"


def test_leaving_before_all_is_read_ends_the_reading_and_is_no_failure() -> None:
    line = msgspec.json.encode(RECORDED[0]).decode()
    command = [
        sys.executable,
        "-c",
        f"print({line!r}, flush=True); import sys; sys.exit(len(sys.stdin.read()) + 3)",
    ]
    assert replay_with_tui(command, "x", 1.0, show=lambda feed: False) == 0
