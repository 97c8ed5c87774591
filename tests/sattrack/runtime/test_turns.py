"""Mounts that move while nobody hears them: when their turns are lost, who notes it, and how to go on."""

from __future__ import annotations

import os
import re
import signal
import socket
import threading
import time
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import msgspec
import pytest

from sattrack.cli.main import run
from sattrack.mount.geometry import AxisGeometry
from sattrack.mount.model import Hold, MountProfile, Seen, SitePlace, StatusSample
from sattrack.mount.xerxes.client import Address
from sattrack.mount.xerxes.datagrams import Command, encode_command
from sattrack.runtime import demo_pass, guardian, turns
from sattrack.runtime.connection import LONGEST_KNOWN_S, owned
from sattrack.runtime.facts import RunRequest, build_engine, decode_facts, encode_facts, prepare
from sattrack.runtime.guardian import SIZE, Guardian, GuardianTask, Release, Word, angle_word
from sattrack.runtime.mounts import Owner
from sattrack.runtime.turns import (
    UNREADABLE,
    LeftAtRest,
    LeftMoving,
    folder,
    followed_axis_deg,
    left_moving,
    note,
)

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

HOURS_11 = 39_600.0
NOW, MOUNT = 1_790_000_000.0, "192.0.2.1:7624"
MOVES = encode_command(Command(7, move_ra=True, move_ra_rate_deg_s=1.0))
STOPS = encode_command(Command(8, abort=True))


@pytest.fixture(autouse=True)
def _state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))


class TestWhatIsLeft:
    @pytest.mark.parametrize("unheard_s", [-4.9, 0.0, 99.0])
    def test_for_as_long_as_the_turns_are_known_a_session_may_begin(self, unheard_s: float) -> None:
        assert LeftMoving(NOW, 100.0).trouble(NOW + unheard_s) is None

    @pytest.mark.parametrize(
        ("left", "unheard_s"),
        [
            (LeftMoving(NOW, 100.0), 101.0),
            # A clock that lost its battery says nothing.
            (LeftMoving(NOW, 100.0), -3600.0),
            (LeftMoving(NOW, 100.0, lost=True), 1.0),
            (UNREADABLE, 0.0),
        ],
    )
    def test_from_then_on_it_is_told_what_to_do(self, left: LeftMoving, unheard_s: float) -> None:
        words = left.trouble(NOW + unheard_s)
        assert words is not None
        assert "may have gone half round since: look at its cables" in words
        assert "`sattrack mount unwound`" in words

    def test_whoever_looks_while_a_note_is_written_reads_a_whole_one(self) -> None:
        done = threading.Event()

        def write() -> None:
            for number in range(400):
                note(MOUNT, LeftMoving(NOW + number, 100.0))
            done.set()

        note(MOUNT, LeftMoving(NOW, 100.0))
        writer = threading.Thread(target=write)
        writer.start()
        seen = []
        while not done.is_set():
            seen.append(left_moving(MOUNT))
        writer.join()
        assert UNREADABLE not in seen
        assert None not in seen
        note(MOUNT, None)

    def test_a_mount_with_a_long_address_has_a_note_of_its_own(self) -> None:
        one, other = (f"indi://192.0.2.1:7624/{'%E6%9C%9B' * 21}{end}" for end in "xy")
        assert left_moving(one) is None
        note(one, LeftMoving(NOW, 100.0))
        assert left_moving(one) == LeftMoving(NOW, 100.0)
        assert left_moving(other) is None
        note(one, None)
        assert left_moving(one) is None

    def test_what_was_written_in_part_counts_as_lost(self) -> None:
        note(MOUNT, LeftMoving(NOW, 100.0))
        assert left_moving(MOUNT) == LeftMoving(NOW, 100.0)
        assert left_moving("192.0.2.2:7624") is None
        (path,) = folder().iterdir()
        path.write_bytes(b"")
        assert left_moving(MOUNT) == UNREADABLE
        note(MOUNT, None)
        assert left_moving(MOUNT) is None


def test_a_disk_that_does_not_answer_holds_up_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    hangs, kept = threading.Event(), []

    def stuck(mount: str, moving: LeftMoving | None) -> None:
        hangs.wait(30.0)
        kept.append((mount, moving))

    monkeypatch.setattr(turns, "note", stuck)
    monkeypatch.setattr(turns, "KEPT_WITHIN_S", 0.01)
    keeper = turns.NoteKeeper()
    for moving in (LeftMoving(NOW, 1.0), None):
        keeper.note(MOUNT, moving)
    keeper.close()
    assert kept == []
    hangs.set()
    keeper._thread.join(30.0)
    # Once it answers, all is kept in its order.
    assert kept == [(MOUNT, LeftMoving(NOW, 1.0)), (MOUNT, None)]


class Watched:
    """A guardian without processes, and the clocks that it reads."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.words = memoryview(bytearray(SIZE)).cast("Q")
        self.words[Word.ARMED] = 1
        self.now_s = 500.0
        monkeypatch.setattr(guardian, "seconds_since_boot", lambda: self.now_s)
        monkeypatch.setattr("sattrack.runtime.guardian.time", self)
        self.begins()

    def begins(self, noted: LeftMoving | None = None, profile: MountProfile | None = None) -> None:
        owner = Owner(1, 1, "track", "now", MOUNT, 7625)
        profile = profile or MountProfile()
        task = GuardianTask(0, 0, -1, Address("192.0.2.1", 7624, 7625), profile, 1.0, 1.0, owner)
        nothing: Any = None
        self.guardian = Guardian(task, nothing, self.words, nothing, None, None, noted=noted)

    def time(self) -> float:
        return NOW + self.now_s

    def look(self, after_s: float, heard: bool = False) -> LeftMoving | None:
        """Look again after some time, in which the mount was heard or not; return what is noted then."""
        self.now_s += after_s
        self.words[Word.HEARD] += heard
        self.guardian._follow_turns(self.now_s)
        return left_moving(MOUNT)

    @property
    def lost(self) -> bool:
        return self.words[Word.TURNS_LOST] == 1


@pytest.fixture
def watched(monkeypatch: pytest.MonkeyPatch) -> Watched:
    return Watched(monkeypatch)


class TestTheGuardian:
    def test_a_mount_that_moves_is_noted_once_a_second_and_forgotten_at_rest(self, watched: Watched) -> None:
        watched.words[Word.TURNS_KNOWN_MS] = 60_000
        assert watched.look(0.1, heard=True) == LeftMoving(NOW + 500.1, 60.0)
        assert watched.look(0.5, heard=True) == LeftMoving(NOW + 500.1, 60.0)
        assert watched.look(0.6, heard=True) == LeftMoving(NOW + 501.2, 60.0)
        # Unheard, the note says since when.
        assert watched.look(2.0) == LeftMoving(NOW + 501.2, 60.0)
        watched.words[Word.TURNS_KNOWN_MS] = 0
        assert watched.look(0.1, heard=True) is None
        assert not watched.lost

    @pytest.mark.parametrize("first_deg", [205.0, -170.5])
    def test_at_rest_it_is_noted_how_far_the_cables_are_wound(
        self, watched: Watched, first_deg: float
    ) -> None:
        watched.words[Word.TURNS_KNOWN_MS] = 60_000
        watched.words[Word.FIRST_AXIS] = angle_word(first_deg)
        assert watched.look(0.1, heard=True) == LeftMoving(NOW + 500.1, 60.0, first_axis_deg=first_deg)
        watched.words[Word.TURNS_KNOWN_MS] = 0
        watched.words[Word.RELEASED] = Release.AT_REST
        assert watched.look(1.1, heard=True) == LeftMoving(NOW + 501.2, HOURS_11, first_axis_deg=first_deg)
        assert not watched.lost

    @pytest.mark.parametrize(
        ("first_deg", "wound"), [(185.0, False), (-5.0, False), (265.0, True), (-85.0, True)]
    )
    def test_a_german_mount_at_rest_past_the_meridian_has_no_cables_wound(
        self, watched: Watched, first_deg: float, wound: bool
    ) -> None:
        watched.begins(profile=MountProfile(pier_rule="ascom"))
        watched.words[Word.FIRST_AXIS] = angle_word(first_deg)
        watched.words[Word.RELEASED] = Release.AT_REST
        assert (watched.look(1.1, heard=True) is not None) is wound

    def test_another_session_keeps_it_until_it_knows_where_the_axis_is(self, watched: Watched) -> None:
        left = LeftMoving(NOW, HOURS_11, first_axis_deg=205.0)
        watched.begins(left)
        note(MOUNT, left)
        assert watched.look(9.0) == left
        assert watched.look(0.1, heard=True) == left
        # It moves the mount before it is known where the axis is, and is killed.
        watched.words[Word.TURNS_KNOWN_MS] = 60_000
        assert watched.look(1.1, heard=True) == LeftMoving(NOW + 510.2, 60.0, first_axis_deg=205.0)
        # Back within half a turn nothing is left to note.
        watched.words[Word.FIRST_AXIS] = angle_word(169.0)
        assert watched.look(1.1, heard=True) == LeftMoving(NOW + 511.3, 60.0)
        watched.words[Word.TURNS_KNOWN_MS] = 0
        assert watched.look(0.1, heard=True) is None
        assert not watched.lost

    def test_after_half_a_turn_of_the_sky_somebody_must_look(self, watched: Watched) -> None:
        left = LeftMoving(NOW + 500.0, HOURS_11, first_axis_deg=205.0)
        watched.begins(left)
        watched.look(HOURS_11 + 1.0)
        assert watched.lost
        told = left.trouble(NOW + 500.0 + HOURS_11 + 1.0)
        assert told is not None
        assert re.match(
            r"was left \w+ .* with its first axis at 205°, and may have .* `sattrack mount unwound`", told
        )
        assert left.trouble(NOW + 500.0 + HOURS_11 - 1.0) is None
        note(MOUNT, None)

    def test_a_sleep_of_the_machine_loses_the_turns_for_good(self, watched: Watched) -> None:
        watched.words[Word.TURNS_KNOWN_MS] = 60_000
        watched.look(0.1, heard=True)
        # It wakes and hears the mount before the guardian looks.
        assert watched.look(61.0, heard=True) == LeftMoving(NOW + 500.1, 60.0, lost=True)
        assert watched.lost
        watched.words[Word.TURNS_KNOWN_MS] = 0
        watched.words[Word.RELEASED] = Release.AT_REST
        assert watched.look(1.0, heard=True) == LeftMoving(NOW + 500.1, 60.0, lost=True)

    @pytest.mark.parametrize("reads", [1, 2, 3])
    def test_a_mount_is_set_going_while_the_guardian_looks(self, watched: Watched, reads: int) -> None:
        """The feeder writes for how long its turns are known after so many reads of the shared words."""

        class Shared(list[int]):
            left = reads

            def __getitem__(self, word: Any) -> Any:
                self.left -= 1
                if self.left == 0:
                    self[Word.TURNS_KNOWN_MS] = 60_000
                return super().__getitem__(word)

        watched.look(0.1, heard=True)
        watched.guardian.words = watched.words = Shared(watched.words)  # type: ignore[assignment]
        watched.look(0.1)
        assert not watched.lost
        assert watched.look(1.1, heard=True) == LeftMoving(NOW + 501.3, 60.0)

    def test_a_mount_at_rest_may_be_unheard_for_as_long_as_it_likes(self, watched: Watched) -> None:
        watched.look(0.1, heard=True)
        assert watched.look(1e6) is None
        watched.words[Word.TURNS_KNOWN_MS] = 60_000
        watched.words[Word.RELEASED] = Release.AT_REST
        assert watched.look(1e6) is None
        assert not watched.lost

    @pytest.mark.parametrize("beyond_pole", [False, True])
    def test_what_an_axis_turns_while_its_guardian_stops_it_counts(
        self, watched: Watched, beyond_pole: bool
    ) -> None:
        watched.words[Word.TURNS_KNOWN_MS] = 60_000
        watched.words[Word.FIRST_AXIS] = angle_word(165.0)
        assert watched.look(0.1, heard=True) == LeftMoving(NOW + 500.1, 60.0)
        stop: Any = SimpleNamespace(mount_stopped=False)
        watched.guardian._stop = stop
        for axis_deg in (165.0, 172.0, 179.0, 186.0, 193.0):
            told_deg = axis_deg - (180.0 if beyond_pole else 0.0)
            sample = StatusSample(
                1, NOW, 2.0, (30.0 - told_deg) % 360.0, 40.0, True, False, 6.0, 0.0, beyond_pole
            )
            watched.guardian._count_turns(sample)
        stop.mount_stopped = True
        assert watched.look(1.1, heard=True) == LeftMoving(NOW + 501.2, HOURS_11, first_axis_deg=193.0)

    @pytest.mark.parametrize(("simulated", "noted"), [(False, LeftMoving(NOW + 500.1, 60.0)), (True, None)])
    def test_a_telescope_whose_gateway_has_ended_may_move_on(
        self, watched: Watched, simulated: bool, noted: LeftMoving | None
    ) -> None:
        watched.words[Word.TURNS_KNOWN_MS] = 60_000
        watched.look(0.1, heard=True)
        watched.words[Word.RELEASED] = Release.NOT_CONFIRMED
        one = watched.guardian
        one.task = msgspec.structs.replace(one.task, local=True, simulated=simulated)
        one._stop = SimpleNamespace(mount_stopped=False)  # type: ignore[assignment]
        one._concluded = True
        watched.look(20.0)
        assert one.noted == noted

    def test_what_a_session_before_left_counts_until_the_mount_is_heard(self, watched: Watched) -> None:
        left = LeftMoving(NOW + 500.0 - 90.0, 100.0)
        watched.begins(left)
        note(MOUNT, left)
        watched.look(9.0)
        assert not watched.lost
        watched.look(2.0)
        assert watched.lost
        note(MOUNT, None)

    def test_heard_in_time_it_is_known_again(self, watched: Watched) -> None:
        watched.begins(LeftMoving(NOW + 500.0 - 90.0, 100.0))
        watched.look(9.0, heard=True)
        assert watched.look(20.0) is None
        assert not watched.lost


class TestLeftAtRest:
    """Within half a turn: an equatorial mount may go on with the sky, 15.0411° an hour."""

    @pytest.mark.parametrize(
        ("hours", "axis_deg"), [(0.0, 100.0), (6.0, 190.2466), (21.9, 429.4), (22.1, None), (-0.1, None)]
    )
    def test_it_is_known_for_a_day_where_the_sky_has_led_it(
        self, hours: float, axis_deg: float | None
    ) -> None:
        note(MOUNT, LeftAtRest(NOW, 100.0))
        found = followed_axis_deg(MOUNT, NOW + 3600.0 * hours)
        assert found == (None if axis_deg is None else pytest.approx(axis_deg, abs=1e-3))
        assert left_moving(MOUNT) is None
        note(MOUNT, None)
        assert followed_axis_deg(MOUNT, NOW) is None

    def test_what_is_known_better_counts_more_and_what_cannot_be_read_not_at_all(self) -> None:
        note(MOUNT, LeftAtRest(NOW, 100.0))
        note(MOUNT, LeftMoving(NOW, HOURS_11, first_axis_deg=205.0))
        assert followed_axis_deg(MOUNT, NOW) is None
        note(MOUNT, None)
        note(MOUNT, LeftAtRest(NOW, 100.0))
        (path,) = folder().iterdir()
        path.write_bytes(b"{")
        assert followed_axis_deg(MOUNT, NOW) is None

    def test_notes_that_tell_nothing_any_more_are_removed(self) -> None:
        for name in ("old", "young"):
            note(name, LeftAtRest(NOW, 100.0))
        for name, hours in (("old", 22.5), ("young", 21.5)):
            (path,) = folder().glob(f"{name}*")
            changed_s = path.stat().st_mtime - 3600.0 * hours
            os.utime(path, (changed_s, changed_s))
        note(MOUNT, LeftMoving(NOW, HOURS_11))
        assert len([*folder().iterdir()]) == 3
        note(MOUNT, LeftAtRest(NOW, 100.0))
        assert len([*folder().iterdir()]) == 3
        assert not [*folder().glob("old*")]

    def test_a_guardian_notes_it_as_it_was_heard_last(self, watched: Watched) -> None:
        watched.guardian.note_left(watched.now_s)
        assert followed_axis_deg(MOUNT, watched.time()) is None
        watched.words[Word.FIRST_AXIS] = angle_word(100.0)
        watched.look(0.1, heard=True)
        watched.look(7200.0)
        watched.guardian.note_left(watched.now_s)
        assert followed_axis_deg(MOUNT, watched.time()) == pytest.approx(130.0822, abs=1e-3)

    def test_a_run_begins_with_it_and_its_recording_too(self) -> None:
        request = RunRequest(
            satellite=demo_pass.NAME,
            mount_url="sim",
            elements=None,
            site=None,
            clock_option=demo_pass.BEFORE_PASS,
            min_alt_deg=10.0,
        )
        facts = msgspec.structs.replace(prepare(request).facts, followed_deg=190.25)
        again = decode_facts(encode_facts(facts))
        for reported_deg, axis_deg in ((-170.0, 190.0), (-165.0, -165.0)):
            safety = build_engine(again).safety
            safety.watch(Seen(NOW, 100.0, 100.0 - reported_deg, 40.0), Hold())
            assert safety.first_axis_deg == pytest.approx(axis_deg)

    @pytest.mark.parametrize("what", ["wound", "lost", "simulated", "geometry"])
    def test_it_notes_none_of_others(self, watched: Watched, what: str) -> None:
        one = watched.guardian
        watched.words[Word.FIRST_AXIS] = angle_word(205.0 if what == "wound" else 100.0)
        watched.words[Word.TURNS_LOST] = what == "lost"
        if what == "geometry":
            profile = MountProfile(geometry=AxisGeometry(0.0, 90.0), stands_at=SitePlace(52.0, 4.5))
            one.task = msgspec.structs.replace(one.task, profile=profile)
        one.task = msgspec.structs.replace(one.task, simulated=what == "simulated")
        watched.look(0.1, heard=True)
        one.note_left(watched.now_s)
        assert not list(folder().glob("*.rest"))


@pytest.fixture
def mount_socket() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        yield listener


class TestWithProcesses:
    """Real guardians, and a mount that never says anything."""

    def test_after_it_moved_unheard_nothing_is_set_going_until_a_person_confirms(
        self,
        mount_socket: socket.socket,
        capsys: pytest.CaptureFixture[str],
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        # A machine that is busy must not make a session that stands still of this one.
        monkeypatch.setattr("sattrack.runtime.connection.HANG_AFTER_S", 3600.0)
        address = Address("127.0.0.1", mount_socket.getsockname()[1], 0)
        url = f"xerxes://127.0.0.1:{address.port}?listen={address.port + 1}"
        with owned(address, MountProfile()) as (_, guard):
            assert guard.beat(MOVES, 0.2)
            until_s = time.monotonic() + 30.0
            while guard.beat(MOVES, 0.2) and time.monotonic() < until_s:
                # The guardian looks ten times a second.
                time.sleep(0.02)
            assert guard.beat(STOPS, 0.2)
            trouble = guard.trouble
            guard.release(True)
        assert trouble is not None
        assert trouble.endswith("then say `sattrack mount unwound`")
        # Another session is told the same, and may stop it.
        with owned(address, MountProfile()) as (_, guard):
            assert not guard.beat(MOVES)
            assert guard.trouble is not None
            assert "was last heard in motion" in guard.trouble
            assert guard.beat(STOPS)
            assert run(["mount", "unwound", "--mount", url]) == 2
            guard.release(True)
        assert "has an owner" in capsys.readouterr().err
        assert run(["doctor", "--mount", url]) == 1
        assert "look at its cables" in capsys.readouterr().out
        assert run(["mount", "unwound", "--mount", url]) == 0
        assert "confirmed" in capsys.readouterr().out
        with owned(address, MountProfile()) as (_, guard):
            assert guard.beat(MOVES)
            assert guard.trouble is None
            guard.release(True)
        assert run(["mount", "unwound", "--mount", url, "--json"]) == 0
        assert '"was":null' in capsys.readouterr().out

    def test_the_next_session_learns_where_a_mount_at_rest_was_left(
        self, mount_socket: socket.socket
    ) -> None:
        address = Address("127.0.0.1", mount_socket.getsockname()[1], 0)
        with owned(address, MountProfile()) as (_, guard):
            assert guard.followed_deg is None
            guard.beat(STOPS, first_axis_deg=100.0)
            guard.release(True)
        with owned(address, MountProfile()) as (_, guard):
            assert guard.first_axis_deg is None
            assert guard.followed_deg == pytest.approx(100.0, abs=0.5)
            guard.release(None)
        # It was not heard meanwhile: what is known stays.
        assert followed_axis_deg(address.name, time.time()) == pytest.approx(100.0, abs=0.5)

    def test_whoever_turns_an_axis_back_by_hand_says_so(self, capsys: pytest.CaptureFixture[str]) -> None:
        """Nothing is wrong before; but what is noted of the cables holds no more."""
        address = Address("127.0.0.1", 9, 0)
        note(address.name, LeftMoving(time.time(), HOURS_11, first_axis_deg=205.4))
        assert run(["mount", "unwound", "--mount", "xerxes://127.0.0.1:9"]) == 0
        assert "it was left with its first axis at 205°" in capsys.readouterr().out
        assert left_moving(address.name) is None

    def test_where_nothing_can_be_noted_that_is_said_and_what_to_do(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        """A file stands where the folder of notes should be."""
        (tmp_path / "file").write_text("", encoding="utf-8")
        monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file"))
        words = left_moving("127.0.0.1:9")
        assert words is not None
        assert "or its note in " in (words.trouble(time.time()) or "")
        assert run(["mount", "unwound", "--mount", "xerxes://127.0.0.1:9"]) == 1
        assert "Not a directory: set XDG_STATE_HOME to a folder" in capsys.readouterr().err

    def test_turns_that_are_known_for_long_need_no_note(self, mount_socket: socket.socket) -> None:
        address = Address("127.0.0.1", mount_socket.getsockname()[1], 0)
        with owned(address, MountProfile()) as (_, guard):
            guard.beat(MOVES, LONGEST_KNOWN_S)
            assert guard._words[Word.TURNS_KNOWN_MS] == 0
            guard.beat(MOVES, 2.5)
            assert guard._words[Word.TURNS_KNOWN_MS] == 2500
            guard.release(True)

    def test_process_and_guardian_killed_leave_the_note(self, mount_socket: socket.socket) -> None:
        address = Address("127.0.0.1", mount_socket.getsockname()[1], 0)
        with owned(address, MountProfile()) as (_, guard):
            guard.beat(MOVES, 100.0)
            until_s = time.monotonic() + 30.0
            while (left := left_moving(address.name)) is None and time.monotonic() < until_s:
                """The guardian notes it at its next look."""
            os.kill(guard.pid, signal.SIGKILL)
        assert left is not None
        assert left.known_for_s == pytest.approx(100.0)
        assert left.trouble(time.time()) is None
        assert left.trouble(left.heard_utc_s + 101.0) is not None
