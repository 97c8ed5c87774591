"""Showing and recording from threads: the loop never waits for whoever looks, nor for the disk."""

from __future__ import annotations

import io
import threading
from typing import TYPE_CHECKING, cast

import msgspec
import pytest

from sattrack.recording.recorder import QUEUED_MOST, BackgroundRecorder, Recorder
from sattrack.runtime.flight import Screen

if TYPE_CHECKING:
    from sattrack.views.run import TrackView


def numbered(number: int) -> TrackView:
    """Something to be shown; a screen looks at nothing in it."""
    return cast("TrackView", number)


def test_while_one_view_is_being_drawn_the_next_are_taken_and_the_newest_is_drawn() -> None:
    drawn: list[object] = []
    drawing, go_on = threading.Event(), threading.Event()

    def draw(view: TrackView) -> None:
        drawn.append(view)
        drawing.set()
        assert go_on.wait(30.0)

    screen = Screen(draw)
    screen.show(numbered(0))
    assert drawing.wait(30.0)
    for number in range(1, 1000):
        screen.show(numbered(number))
    go_on.set()
    screen.close()
    assert drawn == [0, 999]


def test_the_last_view_is_drawn_before_the_end() -> None:
    drawn: list[object] = []
    screen = Screen(drawn.append)
    screen.show(numbered(7))
    screen.close()
    assert drawn[-1] == 7


def test_what_drawing_raises_is_raised_to_the_loop() -> None:
    broken = threading.Event()

    def draw(view: TrackView) -> None:
        broken.set()
        raise BrokenPipeError(view)

    screen = Screen(draw)
    screen.show(numbered(0))
    assert broken.wait(30.0)
    screen.close()
    with pytest.raises(BrokenPipeError):
        screen.show(numbered(1))


class StandingDisk(io.BytesIO):
    """A disk that stands still, once told to, until it is let go on."""

    def __init__(self) -> None:
        super().__init__()
        self.stands = False
        self.asked, self.go_on = threading.Event(), threading.Event()

    def write(self, data: object) -> int:
        if self.stands:
            self.asked.set()
            assert self.go_on.wait(30.0)
        return super().write(data)  # type: ignore[arg-type]


def test_a_disk_that_stands_still_is_told_of_and_holds_nobody_up() -> None:
    disk = StandingDisk()
    recorder = BackgroundRecorder(Recorder(disk, msgspec.Raw(b"{}")))
    disk.stands = True
    recorder.command(1.0, bytes(82))
    assert disk.asked.wait(30.0)
    told = 0
    while recorder.trouble is None and told <= QUEUED_MOST:
        recorder.command(1.0, bytes(82))
        told += 1
    assert told == QUEUED_MOST + 1
    assert recorder.trouble == "the disk is too slow; the recording ends here"
    disk.go_on.set()
    recorder.close()
