"""What goes wrong around a schedule's run: damaged journals, full disks, sessions that hang, a watchdog."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import socket
import sqlite3
import sys
import time
from random import Random
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast
from unittest.mock import ANY

import msgspec
import pytest
from msgspec.structs import replace
from night_draws import BEGIN, World, drawn_passes, settings
from schedule_night import Plan, rows

from sattrack.cli.main import run
from sattrack.schedule import machine, night_processes
from sattrack.schedule.night import (
    Due,
    End,
    Follow,
    Followed,
    MakePlan,
    Mount,
    NightPass,
    Parked,
    ParkMount,
    PassAttempt,
    Planned,
    Reread,
    Result,
    Run,
    RunSettings,
    RunState,
    Started,
    StopAsked,
    Wait,
    WeatherReported,
)
from sattrack.schedule.night_executor import LiveExecutor, drive
from sattrack.schedule.night_folder import (
    FILE_NAME,
    Heartbeat,
    Journal,
    NightFiles,
    OpenedRun,
    encoded,
    open_run,
    parts_of,
    read_status,
)
from sattrack.schedule.night_processes import PassSession, Service
from sattrack.schedule.night_stop import NightRequests, keep_stop, stop_of
from sattrack.schedule.schema import Recordings
from sattrack.schedule.summary import view_of
from tle.sources import write_elements

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from sattrack.schedule.night import Event, Order
    from sattrack.schedule.night_executor import NightContext

NIGHTS = 1.0


class WorldExecutor:
    """Executor of a world that answers at random, until so many events have happened."""

    def __init__(self, world: World, events: int) -> None:
        self.world, self.left = world, events

    def begin(self, beat: Heartbeat | None) -> float:
        del beat
        return self.world.now

    def perform(self, order: Order, at: Run) -> Event | None:
        self.left -= 1
        return self.world.answer(order, at) if self.left > 0 else None


def kept_run(folder: Path, events: int = 40, seed: int = 3, file: Journal | None = None) -> Run:
    """Run a night for so many events, with its journal and status in a folder; return what is known."""
    taken = OpenedRun(file or Journal(folder / FILE_NAME, durable=False), Run())
    files = NightFiles(folder, "night.toml")

    def told(at: Run, event: Event, order: Order) -> None:
        view = view_of(at, order, event.utc_s, "night.toml", str(folder))
        files.tell(replace(view, events=taken.journal.count))

    at, _ = drive(taken, WorldExecutor(World(seed, harm=0.1), events), settings(NIGHTS), told)
    taken.journal.close()
    return at


def harmed(folder: Path, into: Path, harm: Any) -> tuple[OpenedRun, list[str]]:
    """Copy a run's folder, do harm to its journal, take it up; return that, and the files' names."""
    shutil.copytree(folder, into)
    data = bytearray((into / FILE_NAME).read_bytes())
    (into / FILE_NAME).write_bytes(harm(data))
    taken = open_run(into, BEGIN, durable=False)
    taken.journal.close()
    return taken, sorted(one.name for one in into.iterdir())


@pytest.fixture(scope="module")
def night(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Run]:
    folder = tmp_path_factory.mktemp("night")
    at = kept_run(folder)
    assert at.passes
    assert at.results
    keep_stop(folder, "x")
    return folder, at


def check_taken(taken: OpenedRun, names: list[str], at: Run) -> str:
    """Check that nothing which is over can come again, whatever was harmed; return how it was taken up."""
    if taken.words is None:
        assert taken.run in (at, taken.run)
        assert len(taken.run.results) >= len(at.results) - 1
        return "as it was" if taken.run == at else "without the last event"
    assert taken.run == Run()
    (aside,) = [name for name in names if ".damaged-" in name and not name.endswith(("-wal", "-shm"))]
    assert aside in taken.words
    event = Started(
        utc_s=BEGIN + 60.0, settings=settings(NIGHTS), recovered=taken.recovered, words=taken.words
    )
    again, order = machine.step(Run(), event)
    assert isinstance(order, MakePlan)
    assert (again.night, again.mount) == (at.night, Mount.UNKNOWN if at.state in BUSY else at.mount)
    again, _ = machine.step(again, Planned(utc_s=BEGIN + 61.0, passes=at.passes))
    assert [one.key for one in again.passes] == [one.key for one in at.passes[len(at.results) :]]
    return "set aside"


BUSY = (RunState.READYING, RunState.FOLLOWING, RunState.FINISHING, RunState.PARKING)


def test_a_journal_with_any_byte_changed_is_taken_up_or_set_aside_and_nothing_comes_twice(
    night: tuple[Path, Run], tmp_path: Path
) -> None:
    folder, at = night
    size, random = (folder / FILE_NAME).stat().st_size, Random(1)
    found = set()
    for number, place in enumerate(sorted(random.sample(range(size), 150)) + list(range(0, 100, 7))):
        bit = 1 << random.randrange(8)

        def harm(data: bytearray, place: int = place, bit: int = bit) -> bytes:
            data[place] ^= bit
            return bytes(data)

        into = tmp_path / str(number)
        taken, names = harmed(folder, into, harm)
        found.add(check_taken(taken, names, at))
        assert stop_of(into) is not None
        shutil.rmtree(into)
    assert {"set aside", "as it was"} <= found


def test_a_journal_cut_off_anywhere_is_taken_up_or_set_aside(night: tuple[Path, Run], tmp_path: Path) -> None:
    folder, at = night
    size, random = (folder / FILE_NAME).stat().st_size, Random(2)
    for number, length in enumerate([0, 1, 100, 4096, size - 1, *random.sample(range(size), 40)]):
        into = tmp_path / str(number)
        taken, names = harmed(folder, into, lambda data, length=length: bytes(data[:length]))
        assert check_taken(taken, names, at) == "set aside"
        shutil.rmtree(into)


@pytest.mark.parametrize("column", ["event", "state", "doing", "utc_s"])
def test_an_event_that_was_changed_is_seen_by_its_checksum(
    night: tuple[Path, Run], tmp_path: Path, column: str
) -> None:
    into = tmp_path / "run"
    shutil.copytree(night[0], into)
    with sqlite3.connect(into / FILE_NAME) as base:
        value = 5.0 if column == "utc_s" else base.execute(f"SELECT {column} FROM events").fetchone()[0]
        changed = value if column == "utc_s" else value.replace("1", "2")
        base.execute(f"UPDATE events SET {column} = ? WHERE number = 3", (changed,))
    base.close()
    assert "event 3 was changed" in str(open_run(into, BEGIN).words)


def test_a_last_event_that_is_cut_off_is_left_out_and_the_run_goes_on(
    night: tuple[Path, Run], tmp_path: Path
) -> None:
    into = tmp_path / "run"
    shutil.copytree(night[0], into)
    (into / "status.json").unlink()
    with sqlite3.connect(into / FILE_NAME) as base:
        (last,) = base.execute("SELECT max(number) FROM events").fetchone()
        base.execute("UPDATE events SET event = substr(event, 1, 20) WHERE number = ?", (last,))
    base.close()
    taken = open_run(into, BEGIN)
    assert taken.words is None
    assert taken.journal.count == last - 1
    taken.journal.append(StopAsked(utc_s=BEGIN), taken.run, End(why="x"))
    taken.journal.close()
    assert [row[0] for row in rows(into / FILE_NAME)] == list(range(1, last + 1))


def test_a_journal_of_the_layout_before_is_taken_up_as_it_is(night: tuple[Path, Run], tmp_path: Path) -> None:
    into = tmp_path / "run"
    shutil.copytree(night[0], into)
    with sqlite3.connect(into / FILE_NAME) as base:
        base.execute("ALTER TABLE events DROP COLUMN version")
        base.execute("ALTER TABLE events DROP COLUMN checksum")
        base.execute("PRAGMA user_version = 1")
    base.close()
    taken = open_run(into, BEGIN)
    assert (taken.words, taken.run) == (None, night[1])
    event = StopAsked(utc_s=BEGIN)
    taken.journal.append(event, *machine.step(taken.run, event))
    taken.journal.close()
    again = open_run(into, BEGIN)
    assert (again.words, again.run.state) == (None, RunState.STOPPED)
    assert again.journal.count == taken.journal.count


@pytest.mark.parametrize(
    ("kept", "names"),
    [
        (Started(utc_s=BEGIN, settings=RunSettings(BEGIN, None, 0.0)), {"event": "started", "ways": ANY}),
        (Reread(utc_s=BEGIN, settings=RunSettings(BEGIN, None, 0.0)), {"event": "reread", "ways": ANY}),
        (WeatherReported(utc_s=BEGIN, safe=True), {"event": "weather", "safe": True}),
        (Followed(utc_s=BEGIN, attempt=PassAttempt("set", BEGIN)), {"event": "followed", "go": ANY}),
        (Parked(utc_s=BEGIN, mount=Mount.PARKED), {"event": "laid", "mount": "parked"}),
        (ParkMount(power_off=True), {"order": "lay down", "power_off": True}),
        (Heartbeat(BEGIN, attempt="key#1"), {"go": "key#1"}),
    ],
)
def test_what_is_kept_has_the_names_of_older_journals(kept: Any, names: dict[str, Any]) -> None:
    stored = json.loads(encoded(kept))
    assert {name: value for name, value in stored.items() if name in names} == names


def test_a_journal_of_a_later_version_is_set_aside_with_its_name_told(
    night: tuple[Path, Run], tmp_path: Path
) -> None:
    into = tmp_path / "run"
    shutil.copytree(night[0], into)
    with sqlite3.connect(into / FILE_NAME) as base:
        base.execute("PRAGMA user_version = 99")
    base.close()
    first = open_run(into, BEGIN)
    assert "another version of sattrack; it was set aside as journal.sqlite3.damaged-" in str(first.words)
    first.journal.close()
    # A second one in the same second has a name of its own.
    (into / FILE_NAME).write_bytes(b"no journal" * 1000)
    second = open_run(into, BEGIN)
    assert str(second.words).partition(" as ")[2].startswith(f"{FILE_NAME}.damaged-20261002T120000Z-2")


def test_an_event_of_a_later_version_is_not_guessed_at(night: tuple[Path, Run], tmp_path: Path) -> None:
    into = tmp_path / "run"
    shutil.copytree(night[0], into)
    with sqlite3.connect(into / FILE_NAME) as base:
        base.execute("UPDATE events SET version = 2, checksum = NULL WHERE number = 5")
    base.close()
    assert "event 5 is of version 2, not 1" in str(open_run(into, BEGIN).words)


def test_a_journal_that_is_older_than_the_status_is_not_gone_by(
    night: tuple[Path, Run], tmp_path: Path
) -> None:
    into = tmp_path / "run"
    shutil.copytree(night[0], into)
    with sqlite3.connect(into / FILE_NAME) as base:
        base.execute("DELETE FROM events WHERE number > 20")
    base.close()
    taken = open_run(into, BEGIN)
    assert f"holds 20 events, and status.json was written after {len(rows(night[0] / FILE_NAME))}" in str(
        taken.words
    )
    assert taken.recovered is not None
    assert len(taken.recovered.over) == len(night[1].results)


def test_a_journal_says_what_was_followed(night: tuple[Path, Run], tmp_path: Path) -> None:
    shutil.copytree(night[0], tmp_path / "run")
    taken = open_run(tmp_path / "run", BEGIN)
    pairs = zip(night[1].passes, night[1].results, strict=False)
    wanted = [
        (one.elements.catalog_number, one.culminate_utc_s, one.asked_by)
        for one, result in pairs
        if result.on_target_s > 0.0
    ]
    assert wanted
    assert list(taken.journal.followed()) == sorted(wanted, key=lambda one: one[1])


def test_without_a_status_too_a_damaged_journal_begins_the_night_anew(tmp_path: Path) -> None:
    (tmp_path / FILE_NAME).write_bytes(b"no journal" * 1000)
    (tmp_path / "status.json").write_bytes(b'{"type":')
    taken = open_run(tmp_path, BEGIN)
    assert "the night starts again" in str(taken.words)
    assert (taken.run, taken.recovered) == (Run(), None)


def test_a_run_with_a_damaged_journal_goes_on_as_users_see_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = Plan(tmp_path, nights=1, satellites=14, most=1, longest_s=12.0, least_s=10.0)
    plan.write()
    assert plan.run() == 0
    journal = plan.journal()
    journal.write_bytes(journal.read_bytes()[:5000])
    capsys.readouterr()
    assert run(plan.arguments("run")) == 0
    err = capsys.readouterr().err
    assert "it was set aside as journal.sqlite3.damaged-" in err
    assert "defect" not in err
    # The night was over: what was followed is not followed again.
    assert not [row for row in rows(journal) if '"event":"followed"' in row[2]]


def failing(journal: Journal, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Have the journal's disk be full until the generator is advanced."""
    base = journal._base

    class Full:
        def execute(self, *_: Any) -> None:
            raise sqlite3.OperationalError("database or disk is full")

        def close(self) -> None:
            pass

    monkeypatch.setattr(journal, "_base", Full())
    yield
    monkeypatch.setattr(journal, "_base", base)
    yield


def test_a_full_disk_ends_no_run_and_what_happened_meanwhile_is_kept_when_there_is_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    journal = Journal(tmp_path / FILE_NAME, durable=False)
    disk = failing(journal, monkeypatch)
    event: Event = Started(utc_s=BEGIN, settings=settings(NIGHTS))
    at, order = machine.step(Run(), event)
    journal.append(event, at, order)
    next(disk)
    world, troubles = World(3), []
    for _ in range(20):
        event = world.answer(order, at)
        at, order = machine.step(at, event)
        journal.append(event, at, order)
        journal.beat(Heartbeat(world.now))
        troubles.append(journal.trouble)
    assert all("the run continues without it" in str(trouble) for trouble in troubles)
    next(disk)
    journal.beat(Heartbeat(world.now))
    assert journal.trouble is None
    journal.close()
    again = Journal(tmp_path / FILE_NAME)
    assert again.fold(Run()) == at
    assert again.count == 21


def test_a_run_that_starts_on_a_full_disk_goes_on_by_its_journal(
    night: tuple[Path, Run], monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = Journal._opened

    def full(self: Journal, file: Path) -> sqlite3.Connection:
        if file.parent == night[0]:
            error = sqlite3.OperationalError("database or disk is full")
            error.sqlite_errorcode = sqlite3.SQLITE_FULL
            raise error
        return opened(self, file)

    monkeypatch.setattr(Journal, "_opened", full)
    before = [part.name for part in parts_of(night[0] / FILE_NAME)]
    taken = open_run(night[0], BEGIN)
    assert (taken.words, taken.run) == (None, night[1])
    assert "the run continues without it" in str(taken.journal.trouble)
    taken.journal.append(StopAsked(utc_s=BEGIN), taken.run, End(why="x"))
    assert [part.name for part in parts_of(night[0] / FILE_NAME)] == before


def test_a_status_on_a_full_disk_takes_the_place_of_the_last_and_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    at = kept_run(tmp_path, 20)
    view = replace(view_of(at, None, BEGIN, "night.toml"), troubles=("the disk is full",), notes=())
    names = sorted(one.name for one in tmp_path.iterdir())

    def full(*_: Any, **__: Any) -> Any:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pathlib.Path.replace", full)
    with pytest.raises(Exception, match="No space left on device"):
        NightFiles(tmp_path, "night.toml").tell(view)
    monkeypatch.undo()
    assert sorted(one.name for one in tmp_path.iterdir()) == names
    told = read_status(tmp_path)
    assert told is not None
    assert told.troubles == ("the disk is full",)


DAY_S = 86400.0


def recordings(folder: Path, days: list[float]) -> list[tuple[float, str]]:
    """Make recordings of so many days ago; return them as a journal has them."""
    (folder / "recordings").mkdir(parents=True, exist_ok=True)
    made = []
    for k, day in enumerate(days):
        name = f"recordings/{k}.mcap"
        (folder / name).write_bytes(b"x")
        made.append((BEGIN - day * DAY_S, name))
    return made


def test_old_recordings_are_deleted_by_their_age_but_never_tonights_nor_anything_else(tmp_path: Path) -> None:
    made = recordings(tmp_path, [30.0, 10.0, 2.0, 0.01])
    (tmp_path / "recordings" / "mine.mcap").write_bytes(b"x")
    (tmp_path / "outside.mcap").write_bytes(b"x")
    (tmp_path / "recordings" / "link.mcap").symlink_to(tmp_path / "outside.mcap")
    made += [(BEGIN - 99 * DAY_S, name) for name in ("outside.mcap", "recordings/link.mcap", "../x", "")]
    files = NightFiles(tmp_path, "n", free=lambda _: 0.0)
    gone = files.make_room(made, Recordings(keep_days=5), BEGIN, BEGIN - 0.1 * DAY_S)
    assert gone == ["recordings/0.mcap", "recordings/1.mcap"]
    assert files.make_room(made, Recordings(), BEGIN, BEGIN) == []
    left = sorted(one.name for one in (tmp_path / "recordings").iterdir())
    assert left == ["2.mcap", "3.mcap", "link.mcap", "mine.mcap"]
    assert (tmp_path / "outside.mcap").exists()


def test_a_clock_that_is_far_ahead_deletes_only_what_is_old_beside_the_nights_before(tmp_path: Path) -> None:
    made = recordings(tmp_path, [40.0, 31.0, 29.0, 10.0, 1.0, 0.0])
    files, rule = NightFiles(tmp_path, "n"), Recordings(keep_days=30)
    ahead = BEGIN + 60.0 * DAY_S
    made[-1] = (ahead, made[-1][1])
    # The clock was set in the night, or before it; it has recorded a pass already.
    assert files.make_room(made[1:], rule, ahead + 600.0, BEGIN - 600.0) == ["recordings/1.mcap"]
    assert files.make_room(made, rule, ahead + 600.0, ahead - 600.0) == ["recordings/0.mcap"]
    # It is right again: what it recorded meanwhile counts for no night before this one.
    assert files.make_room(made, rule, BEGIN + 600.0, BEGIN) == []
    made.append((BEGIN + 700.0, "recordings/6.mcap"))
    assert files.make_room(made, rule, BEGIN + 1.5 * DAY_S, BEGIN + DAY_S) == ["recordings/2.mcap"]


def test_after_weeks_without_a_night_the_second_one_deletes_what_is_old(tmp_path: Path) -> None:
    made = recordings(tmp_path, [75.0, 60.0, 41.0, 40.0, 0.0])
    files, rule = NightFiles(tmp_path, "n"), Recordings(keep_days=30)
    assert files.make_room(made, rule, BEGIN + 600.0, BEGIN - 600.0) == ["recordings/0.mcap"]
    gone = files.make_room(made, rule, BEGIN + DAY_S, BEGIN + DAY_S - 600.0)
    assert gone == [f"recordings/{k}.mcap" for k in (1, 2, 3)]


def test_recordings_are_deleted_oldest_first_until_enough_is_free(tmp_path: Path) -> None:
    made = recordings(tmp_path, [1.0, 30.0, 10.0, 2.0, 0.01])
    free = iter([1e9, 2.5e9, 3.1e9, 3.1e9])
    files = NightFiles(tmp_path, "n", free=lambda _: next(free))
    gone = files.make_room(made, Recordings(keep_free_gb=3.0), BEGIN, BEGIN - 0.1 * DAY_S)
    assert gone == ["recordings/1.mcap", "recordings/2.mcap"]


def test_tonights_recordings_stay_where_the_disk_is_full_of_them_and_passes_go_unrecorded(
    tmp_path: Path,
) -> None:
    made = recordings(tmp_path, [0.01, 0.02])
    files = NightFiles(tmp_path, "n", free=lambda _: 1e6)
    assert files.make_room(made, Recordings(1.0, 10.0), BEGIN, BEGIN - 0.1 * DAY_S) == []
    assert "the disk has 1 MB left, 50 are needed: passes go unrecorded" in str(files.no_room())
    assert NightFiles(tmp_path, "n", free=lambda _: 1e9).no_room() is None


def test_a_journal_knows_the_recordings_that_its_run_made(tmp_path: Path) -> None:
    journal = Journal(tmp_path / FILE_NAME, durable=False)
    attempt = PassAttempt("set", BEGIN, recording="recordings/a.mcap")
    for event in (
        Started(utc_s=BEGIN, settings=settings(1.0), recording="recordings/b.mcap"),
        Followed(utc_s=BEGIN + 5.0, attempt=attempt),
        Followed(utc_s=BEGIN + 6.0, attempt=PassAttempt("set", BEGIN)),
    ):
        journal.append(event, Run(), End(why="x"))
    assert journal.recordings() == [(BEGIN, "recordings/b.mcap"), (BEGIN + 5.0, "recordings/a.mcap")]
    journal.close()


def executor_of(folder: Path) -> tuple[LiveExecutor, NightRequests]:
    """Return an executor that has nothing to work with but what is asked from outside."""
    requests = NightRequests(folder)
    context = SimpleNamespace(requests=requests, report_trouble=lambda *_: None, now=lambda: BEGIN)
    journal = Journal(folder / FILE_NAME, durable=False)
    return LiveExecutor(cast("NightContext", context), NightFiles(folder, "n"), journal), requests


def test_while_a_stop_stands_nothing_is_begun_and_the_journal_has_the_stop(tmp_path: Path) -> None:
    executor, requests = executor_of(tmp_path)
    keep_stop(tmp_path, "x")
    requests.terminated = True
    found = executor.perform(Follow(index=0, part=1, from_utc_s=BEGIN), Run())
    assert isinstance(found, StopAsked)
    assert found.words.startswith("stopped by an operator (x)")


def test_a_runner_that_is_terminated_begins_nothing_and_keeps_no_event_of_what_it_cut_off(
    tmp_path: Path,
) -> None:
    executor, requests = executor_of(tmp_path)
    requests.terminated = True
    assert executor.perform(Follow(index=0, part=1, from_utc_s=BEGIN), Run()) is None
    requests.interrupted = True
    assert executor.perform(Wait(until_utc_s=BEGIN), Run()) == StopAsked(utc_s=BEGIN)


def test_a_stop_at_a_sessions_screen_is_an_operators_and_an_end_by_a_limit_is_none(tmp_path: Path) -> None:
    executor, _ = executor_of(tmp_path)
    executor._keep_end(PassAttempt("limit:sun", BEGIN))
    assert stop_of(tmp_path) is None
    executor._keep_end(PassAttempt("operator", BEGIN))
    assert stop_of(tmp_path) is not None


def test_how_far_a_pass_had_come_is_kept_when_the_runner_is_terminated(tmp_path: Path) -> None:
    executor, _ = executor_of(tmp_path)
    executor._attempt, executor._recording = "key#1", "recordings/a.mcap"
    executor._keep_end(PassAttempt("stopped", BEGIN, on_target_s=12.0))
    beat = executor.journal.last_heartbeat()
    assert beat is not None
    assert (beat.attempt, beat.on_target_s, beat.recording) == ("key#1", 12.0, "recordings/a.mcap")


VIEW = '{"type": "view", "utc_s": 1, "phase": "tracking", "target_alt_deg": 30.0, "warnings": [%s]}'


class Listener:
    """Hears how a session goes."""

    def __init__(self, why: str | None = None, words: str | None = None) -> None:
        self.why, self.words = why, words
        self.lines, self.troubles = [], []  # type: ignore[var-annotated]

    def now_utc_s(self) -> float:
        return BEGIN

    def end_reason(self) -> str | None:
        return self.why

    def weather_words(self) -> str | None:
        return self.words

    def report_progress(self, utc_s: float, on_target_s: float, line: str, silent_s: float = 0.0) -> None:
        del utc_s, on_target_s
        self.lines.append((line, silent_s))

    def report_trouble(self, words: str | None) -> None:
        self.troubles.append(words)


def one_pass() -> NightPass:
    (first, *_) = drawn_passes(Random(1), 1, BEGIN + 3000.0, BEGIN + 80000.0)
    return first


def session(folder: Path, script: str, listener: Listener) -> PassSession:
    command = [sys.executable, "-c", script]
    return PassSession(command, one_pass(), "recordings/a.mcap", folder / "sessions.log", listener)


def hanging(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(night_processes, "OLD_AFTER_S", 0.3)
    monkeypatch.setattr(night_processes, "HANGS_AFTER_S", 1.0)


def ends_when_told(summary: dict[str, Any]) -> str:
    """Return a session that goes on until it is told to stop, and has no summary where none is given."""
    last = f"print({json.dumps({'summary': summary})!r}, flush=True)"
    if not summary:
        last = "sys.exit('killed from outside')"
    return f"import sys; print({VIEW % ''!r}, flush=True); sys.stdin.read(1); {last}"


@pytest.mark.parametrize(
    ("why", "words", "summary", "told"),
    [
        ("weather", "rain", {"ended_by": "operator"}, "rain"),
        (
            "weather",
            "rain",
            {"ended_by": "operator", "mount_stopped": False},
            "rain; THE MOUNT DID NOT CONFIRM THE STOP",
        ),
        ("weather", "rain", {}, "rain; killed from outside"),
        ("stopped", "rain", {"ended_by": "operator"}, None),
        ("stopped", "rain", {}, "killed from outside"),
    ],
)
def test_why_the_weather_ended_a_pass_is_kept(
    tmp_path: Path, why: str, words: str, summary: dict[str, Any], told: str | None
) -> None:
    attempt = session(tmp_path, ends_when_told(summary), Listener(why, words)).run()
    assert (attempt.ended_by, attempt.words) == (why, told)


STANDS_STILL = f"import os, signal; print({VIEW % ''!r}, flush=True); os.kill(os.getpid(), signal.SIGSTOP)"


def test_a_session_that_stands_still_is_told_of_and_ended_so_that_another_can_follow_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hanging(monkeypatch)
    listener = Listener()
    attempt = session(tmp_path, STANDS_STILL, listener).run()
    assert (attempt.ended_by, attempt.words) == ("hang", "the session said nothing for 1 s, and was ended")
    silent = [(line, silent_s) for line, silent_s in listener.lines if silent_s > 0.0]
    assert silent
    assert all("NO NEWS for " in line and "before that tracking" in line for line, _ in silent)
    at = machine.step(Run(), Started(utc_s=BEGIN, settings=settings(1.0)))[0]
    one = one_pass()
    at = replace(at, state=RunState.FOLLOWING, passes=(one,), part=1)
    at, order = machine.step(at, Followed(utc_s=one.start_utc_s + 5.0, attempt=attempt))
    assert isinstance(order, Follow)
    assert order.part == 2


def test_a_session_that_stands_still_before_its_first_line_does_not_hold_up_a_stop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hanging(monkeypatch)
    began_s = time.monotonic()
    mute = "import os, signal; os.kill(os.getpid(), signal.SIGSTOP)"
    assert session(tmp_path, mute, Listener("operator")).run().ended_by == "operator"
    assert time.monotonic() - began_s < 0.5 * night_processes.BEGINS_WITHIN_S


def test_a_stop_by_an_operator_is_what_ended_a_session_that_was_killed_for_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hanging(monkeypatch)
    killed = f"import os; print({VIEW % ''!r}, flush=True); os.kill(os.getpid(), 9)"
    assert session(tmp_path, killed, Listener()).run().ended_by == "crash"
    assert session(tmp_path, killed, Listener("operator")).run().ended_by == "operator"
    assert session(tmp_path, STANDS_STILL, Listener("operator")).run().ended_by == "operator"


def test_a_session_whose_log_cannot_be_written_is_run_and_its_recordings_trouble_is_heard(
    tmp_path: Path,
) -> None:
    words = "the recording cannot be written: No space left on device; it ends here"
    listener = Listener()
    script = f"print({VIEW % json.dumps(words)!r}); print({VIEW % ''!r}); print('{{\"summary\": {{}}}}')"
    made = session(tmp_path / "no such folder", script, listener)
    assert made.run().ended_by == "None"
    assert listener.troubles == [words, None]


def test_a_view_older_than_three_seconds_is_shown_as_old(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "night.run"
    folder.mkdir()
    kept_run(folder, 20)
    from sattrack.schedule.night_stop import locked

    def shown() -> tuple[str, dict[str, Any]]:
        assert run(["run", str(tmp_path / "night.toml"), "--status"]) == 0
        text = capsys.readouterr().out
        assert run(["run", str(tmp_path / "night.toml"), "--status", "--json"]) == 0
        return text, json.loads(capsys.readouterr().out)

    status = folder / "status.json"
    made_s = status.stat().st_mtime
    with locked(folder):
        os.utime(status, (made_s + 3600.0,) * 2)
        text, view = shown()
        assert "OLD" not in text
        assert view["old"] is False
        os.utime(status, (made_s - 40.0,) * 2)
        text, view = shown()
        assert ", OLD: nothing was heard for 4" in text
        assert view["old"] is True
        assert 40.0 <= view["age_s"] < 60.0
    # Nobody runs it: what it said last is no news that is late.
    assert shown()[1]["old"] is False


def test_a_schedule_that_was_read_again_is_planned_anew_for_what_is_not_over() -> None:
    passes = drawn_passes(Random(1), 1, BEGIN + 3000.0, BEGIN + 80000.0)
    at, _ = machine.step(Run(), Started(utc_s=BEGIN, settings=settings(1.0)))
    at, _ = machine.step(at, Planned(utc_s=BEGIN, passes=passes))
    at = replace(at, results=(Result("done"),))
    again = replace(settings(2.0), park=False)
    at, order = machine.step(at, Reread(utc_s=BEGIN + 5000.0, settings=again))
    assert isinstance(order, MakePlan)
    assert at.settings == again
    at, order = machine.step(at, Planned(utc_s=BEGIN + 5001.0, passes=(passes[0], *passes[2:])))
    assert isinstance(order, Wait)
    assert [one.key for one in at.passes] == [passes[0].key, *(one.key for one in passes[2:])]
    assert [one.number for one in at.passes] == list(range(1, len(at.passes) + 1))
    assert at.results == (Result("done"),)


def test_a_run_stopped_by_day_waits_for_its_night_when_it_is_resumed() -> None:
    at, _ = machine.step(Run(), Started(utc_s=BEGIN, settings=settings(3.0)))
    at = replace(at, night=2, night_from_utc_s=BEGIN + 40_000.0, state=RunState.RESTING)
    at, order = machine.step(at, StopAsked(utc_s=BEGIN + 10.0))
    assert isinstance(order, End)
    at, order = machine.step(at, Started(utc_s=BEGIN + 20.0, settings=settings(3.0)))
    assert order == Wait(until_utc_s=BEGIN + 40_000.0)
    assert at.state is RunState.RESTING


def test_a_recovered_night_that_is_over_is_followed_by_the_next(tmp_path: Path) -> None:
    kept_run(tmp_path)
    (tmp_path / FILE_NAME).write_bytes(b"no journal" * 1000)
    taken = open_run(tmp_path, BEGIN)
    assert taken.recovered is not None
    late = taken.recovered.night_to_utc_s + 100.0
    at, _ = machine.step(
        Run(), Started(utc_s=late, settings=settings(3.0), recovered=taken.recovered, words="x")
    )
    assert at.night == taken.recovered.night + 1
    assert at.night_from_utc_s <= late < at.night_to_utc_s
    assert at.over == ()
    at, order = machine.step(at, Planned(utc_s=late, passes=()))
    at, order = machine.step(at, Due(utc_s=late))
    assert isinstance(order, ParkMount)


def heard(listener: socket.socket) -> list[str]:
    return listener.recv(4096).decode().split("\n")


@pytest.mark.parametrize("abstract", [False, True])
def test_a_service_manager_hears_by_its_socket(tmp_path: Path, abstract: bool) -> None:
    name = f"@sattrack-test-{os.getpid()}" if abstract else str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind("\0" + name[1:] if abstract else name)
        listener.settimeout(60.0)
        service = Service({"NOTIFY_SOCKET": name})
        service.tell("READY=1", "STATUS=up")
        assert heard(listener) == ["READY=1", "STATUS=up"]
        service.status("waiting\nfor more")
        service.status("waiting\nfor more")
        service.tell("STOPPING=1")
        assert heard(listener) == ["STATUS=waiting"]
        assert heard(listener) == ["STOPPING=1"]
        service.close()
    service.tell("READY=1")


def test_a_watchdog_is_fed_only_while_the_main_thread_has_promised_to_come_back(tmp_path: Path) -> None:
    name = str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(name)
        listener.settimeout(60.0)
        service = Service({"NOTIFY_SOCKET": name, "WATCHDOG_USEC": "30000", "WATCHDOG_PID": str(os.getpid())})
        service.promise(3600.0)
        assert [heard(listener) for _ in range(3)] == [["WATCHDOG=1"]] * 3
        service.promise(-1.0)
        listener.settimeout(0.3)
        with contextlib.suppress(TimeoutError):
            for _ in range(5):
                heard(listener)
        with pytest.raises(TimeoutError):
            heard(listener)
        service.promise(3600.0)
        listener.settimeout(60.0)
        assert heard(listener) == ["WATCHDOG=1"]
        service.close()


@pytest.mark.parametrize(
    "given", [{}, {"WATCHDOG_USEC": "x"}, {"WATCHDOG_USEC": "30000", "WATCHDOG_PID": "1"}]
)
def test_no_watchdog_is_fed_that_is_not_ours(tmp_path: Path, given: dict[str, str]) -> None:
    service = Service({"NOTIFY_SOCKET": str(tmp_path / "notify"), **given})
    service.promise(3600.0)
    assert service._thread is None
    service.close()


def test_a_run_tells_its_service_manager_that_it_is_up_what_it_does_and_that_it_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = Plan(tmp_path, nights=1, satellites=14, most=1, longest_s=35.0)
    plan.write()
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(tmp_path / "notify"))
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        assert plan.run() == 0
        listener.setblocking(False)
        said = []
        while True:
            try:
                said += heard(listener)
            except BlockingIOError:
                break
    assert said[0] == "READY=1"
    assert "STOPPING=1" in said
    assert any(line.startswith("STATUS=following 1") for line in said)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), "night.toml: 1 entry, mount sim: can be run"),
        (("--elements", "no.tle"), "no.tle: cannot read elements"),
        (("--mount", "xerxes://"), "xerxes://"),
        (("--profile", "no.toml"), "no.toml: cannot read the mount profile"),
        (("--config", "no.toml"), "no.toml"),
    ],
)
def test_a_check_reads_all_that_a_run_needs_and_moves_and_writes_nothing(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    options: tuple[str, ...],
    words: str,
) -> None:
    from sattrack.runtime import demo_pass

    monkeypatch.chdir(tmp_path)
    (tmp_path / "night.toml").write_text('park_at_end = false\n[[passes]]\nsatellite = "25544"\n')
    (tmp_path / "iss.json").write_text(write_elements([demo_pass.elements()], "json"))
    site = ("--site", "52.1541,4.4908,0", "--mount", "sim", "--elements", "iss.json")
    code = run(["run", "night.toml", "--check", *site, *options])
    out, err = capsys.readouterr()
    assert words in (err if options else out)
    assert code == (2 if options else 0)
    assert (out + err).count("\n") == 1
    assert sorted(one.name for one in tmp_path.iterdir()) == ["iss.json", "night.toml"]


def test_a_check_with_json_prints_a_document_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from sattrack.runtime import demo_pass

    monkeypatch.chdir(tmp_path)
    (tmp_path / "night.toml").write_text('park_at_end = false\n[[passes]]\nsatellite = "25544"\n')
    (tmp_path / "iss.json").write_text(write_elements([demo_pass.elements()], "json"))
    site = ("--site", "52.1541,4.4908,0", "--mount", "sim", "--elements", "iss.json")
    assert run(["run", "night.toml", "--check", "--json", *site]) == 0
    assert json.loads(capsys.readouterr().out) == {"schedule": "night.toml", "entries": 1, "mount": "sim"}


def test_a_check_names_file_line_and_column_of_what_is_wrong(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "night.toml").write_text('[recordings]\nkeep_days = -3\n[[passes]]\nsatellite = "25544"\n')
    assert run(["run", str(tmp_path / "night.toml"), "--check", "--mount", "sim"]) == 2
    assert "night.toml:2:1" in capsys.readouterr().err


@pytest.mark.usefixtures("hang_ups")
def test_a_hang_up_reloads_without_a_terminal_and_is_no_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from sattrack.schedule.night_stop import NightRequests, handling_signals

    requests = NightRequests(tmp_path)
    monkeypatch.setattr(os, "isatty", lambda _: False)
    with handling_signals(requests):
        signal.raise_signal(signal.SIGHUP)
        assert (requests.reload, requests.asked) == (True, False)
        signal.raise_signal(signal.SIGTERM)
        assert (requests.asked, requests.restarts) == (True, True)
        signal.raise_signal(signal.SIGINT)
        assert not requests.restarts
    assert msgspec.json.encode(requests.words) == b'"interrupted"'
