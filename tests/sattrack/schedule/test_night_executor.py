"""What a schedule's run does to the world: programs, addresses, weather, clocks, files, a pass in time."""

from __future__ import annotations

import json
import os
import select
import socket
import sqlite3
import subprocess
import sys
import threading
import time
from contextlib import contextmanager, suppress
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import pytest
from element_server import element_server

from sattrack.cli.common import CommandContext
from sattrack.cli.run_night import NightPlans, renewer
from sattrack.cli.run_plan import loader, within_half_a_turn
from sattrack.control.procedures import ParkThere
from sattrack.core.errors import SattrackError
from sattrack.mount.model import AxesPosition
from sattrack.mount.profiles import ProfileFile, load_profile_file
from sattrack.mount.requests import TicketState
from sattrack.runtime import demo_pass
from sattrack.safety import SafetyLimits
from sattrack.schedule.file import load_schedule
from sattrack.schedule.night import NightPass, Result
from sattrack.schedule.night_executor import ClockReadings, jump_between
from sattrack.schedule.night_folder import Journal, NightFiles, read_status
from sattrack.schedule.night_processes import (
    BackgroundTasks,
    Notifier,
    as_environment,
    facts_of,
    post,
    run_program,
)
from sattrack.schedule.night_stop import locked
from sattrack.schedule.schema import Notify, Recordings, Terms, Weather
from sattrack.schedule.virtual_executor import SimulatedStation
from sattrack.schedule.weather import WeatherReport, WeatherSource, WeatherWatch
from sattrack.settings import Settings
from tle.instants import Utc
from tle.sources import write_elements

if TYPE_CHECKING:
    from collections.abc import Iterator

BEGIN = 1_790_942_520.0
ONE = NightPass(
    key="25544@x",
    number=3,
    elements=demo_pass.elements(),
    start_utc_s=BEGIN,
    culminate_utc_s=BEGIN + 200.0,
    end_utc_s=BEGIN + 400.0,
    leave_utc_s=BEGIN - 20.0,
    max_alt_deg=81.3,
    priority=2.0,
    useful_s=400.0,
    terms=Terms(),
    asked_by="a test",
)
SHELL = ("sh", "-c")


def test_a_program_has_the_pass_in_its_environment_with_units_in_the_names(tmp_path: Path) -> None:
    result = Result("partly", "link", "it fell silent", on_target_s=120.5, recordings=("a.mcap", "b.mcap"))
    facts = facts_of(ONE, "night.toml", "after", result)
    assert run_program((*SHELL, "env > env.txt"), 10.0, tmp_path, facts) is None
    told = dict(line.split("=", 1) for line in (tmp_path / "env.txt").read_text().splitlines() if "=" in line)
    assert told["SATTRACK_NAME"] == "ISS (ZARYA)"
    assert told["SATTRACK_CATALOG_NUMBER"] == "25544"
    assert told["SATTRACK_START_UTC"] == "2026-10-02T12:02:00.000Z"
    assert told["SATTRACK_MAX_ALT_DEG"] == "81.3"
    assert told["SATTRACK_RESULT"] == "partly"
    assert told["SATTRACK_ON_TARGET_S"] == "120.5"
    assert told["SATTRACK_RECORDINGS"] == "a.mcap:b.mcap"
    assert as_environment({"a_b": None, "c": "x\0y"}) == {"SATTRACK_A_B": "", "SATTRACK_C": "xy"}


def test_a_program_that_hangs_is_ended_with_all_that_it_started(tmp_path: Path) -> None:
    hangs = "trap '' TERM; sleep 600 & echo $! > pid; wait; sleep 600"
    assert run_program((*SHELL, hangs), 3.0, tmp_path, {}) == "not done within 3 s, ended"
    child = int((tmp_path / "pid").read_text())
    assert _ends_within(child, 60.0)


def _ends_within(process_id: int, seconds: float) -> bool:
    """Tell whether a process is no more, or no more before so long; nobody need have asked for its end."""
    try:
        handle = os.pidfd_open(process_id)
    except ProcessLookupError:
        return True
    try:
        return bool(select.select([handle], [], [], seconds)[0])
    finally:
        os.close(handle)


@pytest.mark.parametrize(
    ("run", "words"),
    [
        ((*SHELL, "exit 3"), "ended with 3"),
        ((*SHELL, "kill -9 $$"), "ended by signal 9"),
        (("./no-such-program",), "cannot be run: No such file or directory"),
    ],
)
def test_what_went_wrong_with_a_program_is_said(tmp_path: Path, run: tuple[str, ...], words: str) -> None:
    assert run_program(run, 10.0, tmp_path, {}) == words


class Answers(HTTPServer):
    """Answers every request alike, and keeps what was posted."""

    code, body = 200, b"{}"

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.posted: list[Any] = []
        self.paths: list[str] = []


class Handler(BaseHTTPRequestHandler):
    server: Answers

    def do_GET(self) -> None:
        self._answer()

    def do_POST(self) -> None:
        self.server.posted.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
        self._answer()

    def _answer(self) -> None:
        self.server.paths.append(self.path)
        self.send_response(self.server.code)
        self.send_header("Content-Length", str(len(self.server.body)))
        self.end_headers()
        self.wfile.write(self.server.body)

    def log_request(self, code: Any = "-", size: Any = "-") -> None:
        pass


@contextmanager
def answering(code: int = 200, body: bytes = b"{}") -> Iterator[Answers]:
    with Answers() as server:
        server.code, server.body = code, body
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()


def test_a_webhook_is_posted_the_facts_as_json_and_its_failures_are_said() -> None:
    with answering() as server:
        url = f"http://127.0.0.1:{server.server_port}/passes"
        assert post(url, facts_of(ONE, "night.toml", "after"), 60.0) is None
        assert server.posted[0]["catalog_number"] == 25544
        assert server.posted[0]["max_alt_deg"] == 81.3
        server.code = 500
        assert post(url, {}, 60.0) == "answered 500"
    assert str(post(url, {}, 60.0)).startswith("cannot be posted to: ")
    assert str(post(f"{url}/a b", {}, 60.0)).startswith("cannot be posted to: URL can't contain")


def test_those_to_be_notified_hear_of_what_they_want_to_hear_and_nothing_else(tmp_path: Path) -> None:
    complaints: list[str] = []
    told = Notify(run=(*SHELL, "cat >> told.txt; echo $SATTRACK_NOTICE >> told.txt"), on=("lost",))
    wrong = Notify(run=("./no-such-program",), on=("morning",))
    before = set(threading.enumerate())
    notifier = Notifier((told, wrong), tmp_path, BackgroundTasks(complaints.append))
    for notice in ("pass", "lost", "morning"):
        notifier.tell(notice, f"words of {notice}", {"number": 3})
    for thread in set(threading.enumerate()) - before:
        thread.join()
    assert (tmp_path / "told.txt").read_text() == "words of lost\nlost\n"
    assert complaints == ["notify by ./no-such-program: cannot be run: No such file or directory"]


@pytest.mark.parametrize(
    ("text", "safe", "words"),
    [
        ("safe", True, None),
        ("Safe since 20:14\n", True, None),
        ("unsafe wind 22 m/s", False, "wind 22 m/s"),
        # As Windows marks its UTF-8 files.
        ("\ufeffsafe\r\n", True, None),
        ("\ufeffunsafe wind 22 m/s", False, "wind 22 m/s"),
        ("", False, "its first word must be safe or unsafe"),
        ("safely", False, "'safely': its first word must be"),
    ],
)
def test_a_weather_file_says_it_in_its_first_word(
    tmp_path: Path, text: str, safe: bool, words: str | None
) -> None:
    file = tmp_path / "weather.txt"
    file.write_text(text, encoding="utf-8", newline="")
    told = WeatherSource(Weather(file=str(file)), tmp_path).ask()
    assert told.safe is safe
    assert words is None or words in str(told.words)


def test_a_weather_file_that_is_old_or_gone_is_unsafe(tmp_path: Path) -> None:
    file = tmp_path / "weather.txt"
    assert WeatherSource(Weather(file=str(file)), tmp_path).ask().safe is False
    file.write_text("safe")
    os.utime(file, (file.stat().st_mtime - 400.0,) * 2)
    told = WeatherSource(Weather(file=str(file), oldest_s=300.0), tmp_path).ask()
    assert not told.safe
    assert "300 s are allowed" in str(told.words)


def test_a_weather_file_from_the_future_is_unsafe(tmp_path: Path) -> None:
    file = tmp_path / "weather.txt"
    file.write_text("safe")
    for ahead_s, safe in ((200.0, True), (400.0, False)):
        os.utime(file, (time.time() + ahead_s,) * 2)
        assert WeatherSource(Weather(file=str(file), oldest_s=300.0), tmp_path).ask().safe is safe


def test_a_safety_monitor_whose_host_can_be_none_is_refused() -> None:
    for host in ("weather..local", f"{'a' * 70}.local"):
        with pytest.raises(ValueError, match="write alpaca://HOST:PORT/DEVICE"):
            Weather(alpaca=f"alpaca://{host}:11111/0")


def test_a_weather_command_is_safe_where_it_ends_with_0_in_time(tmp_path: Path) -> None:
    assert WeatherSource(Weather(command=("true",)), tmp_path).ask().safe
    assert WeatherSource(Weather(command=("false",)), tmp_path).ask() == (False, "false: ended with 1")
    hangs = WeatherSource(Weather(command=("sleep", "60"), timeout_s=0.2), tmp_path).ask()
    assert hangs == (False, "no answer within 0.2 s")


def answers_within(seconds: float, source: WeatherSource, *more: Any) -> WeatherReport:
    """Ask, in a thread of its own, so that a question that hangs fails the test and no more."""
    found: list[WeatherReport] = []
    asks = threading.Thread(target=lambda: found.append(source.ask(*more)), daemon=True)
    asks.start()
    asks.join(seconds)
    assert found, f"no answer within {seconds} s"
    return found[0]


@pytest.mark.skipif(sys.platform == "win32", reason="no pipes among its files")
def test_a_weather_file_that_is_none_is_unsafe_at_once_and_nothing_stays_open(tmp_path: Path) -> None:
    pipe, folder, link, real = (tmp_path / name for name in ("pipe", "folder", "link", "real"))
    os.mkfifo(pipe)
    folder.mkdir()
    real.write_text("safe")
    link.symlink_to(real)
    assert answers_within(30.0, WeatherSource(Weather(file=str(link)), tmp_path)).safe
    descriptors = Path("/proc/self/fd")
    opened = len(list(descriptors.iterdir())) if descriptors.exists() else 0
    for path in (pipe, folder):
        told = answers_within(30.0, WeatherSource(Weather(file=str(path)), tmp_path))
        assert told == (False, f"{path}: no regular file")
    assert not descriptors.exists() or len(list(descriptors.iterdir())) <= opened
    assert not answers_within(30.0, WeatherSource(Weather(file=str(tmp_path / "a\0b")), tmp_path)).safe


@contextmanager
def hanging_disk(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Path]]:
    """Let every file hang until the end, as those of a server do that is gone; yield which were opened."""
    gone, asked = threading.Event(), []

    def hangs(path: Path, **_: Any) -> Any:
        asked.append(path)
        gone.wait(60.0)
        raise OSError(5, "Input/output error")

    monkeypatch.setattr("sattrack.schedule.weather.open_regular", hangs)
    try:
        yield asked
    finally:
        gone.set()


def test_a_weather_file_on_a_disk_that_hangs_is_unsafe_in_time_and_keeps_one_thread_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = WeatherSource(Weather(file=str(tmp_path / "weather.txt"), timeout_s=0.2, every_s=0.1), tmp_path)
    with hanging_disk(monkeypatch) as asked:
        for _ in range(3):
            assert answers_within(30.0, source) == (False, "no answer within 0.2 s")
        watch = WeatherWatch(source)
        watch._thread.join(30.0)
        assert watch.unsafe == "no answer within 0.2 s"
        assert len(asked) == 1
    # A disk that is back is believed again.
    monkeypatch.undo()
    (tmp_path / "weather.txt").write_text("safe")
    until_s = time.monotonic() + 30.0
    while not source.ask().safe and time.monotonic() < until_s:
        time.sleep(0.01)
    assert source.ask().safe


def test_whoever_must_end_does_not_wait_for_the_weather(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = WeatherSource(Weather(file=str(tmp_path / "weather.txt"), timeout_s=3600.0), tmp_path)
    with hanging_disk(monkeypatch) as asked:
        assert not answers_within(30.0, source, lambda: bool(asked)).safe
        assert not answers_within(30.0, source, lambda: True).safe
        watch = WeatherWatch(source)
        watch.close()
        watch._thread.join(30.0)
        assert not watch._thread.is_alive()
        assert watch.unsafe is None


def test_a_safety_monitor_that_drips_is_unsafe_in_time(tmp_path: Path) -> None:
    over = threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as server:

        def drip() -> None:
            connection, _ = server.accept()
            with connection, suppress(OSError):
                connection.sendall(b"HTTP/1.1 200 OK\r\nContent-Length: 4000\r\n\r\n")
                while not over.wait(0.05):
                    connection.sendall(b" ")

        drips = threading.Thread(target=drip, daemon=True)
        drips.start()
        address = f"alpaca://127.0.0.1:{server.getsockname()[1]}/0"
        told = answers_within(30.0, WeatherSource(Weather(alpaca=address, timeout_s=0.3), tmp_path))
        assert told == (False, "no answer within 0.3 s")
        over.set()
        drips.join(30.0)


def test_an_answer_counts_while_it_is_fresh_where_the_caller_says_so(tmp_path: Path) -> None:
    file = tmp_path / "weather.txt"
    source = WeatherSource(Weather(file=str(file)), tmp_path)
    file.write_text("safe")
    assert source.ask().safe
    file.write_text("unsafe rain")
    assert source.ask(lambda: False, 3600.0).safe
    assert source.ask() == (False, "rain")


@pytest.mark.parametrize(
    ("code", "body", "safe", "words"),
    [
        (200, b'{"Value": true, "ErrorNumber": 0, "ErrorMessage": ""}', True, None),
        (200, b'{"Value": false, "ErrorNumber": 0}', False, "says unsafe"),
        (200, b'{"ErrorNumber": 1031, "ErrorMessage": "Not connected"}', False, "Not connected"),
        (200, b'{"Value": "yes"}', False, "no Value that is true or false"),
        (200, b"<html>", False, "no Alpaca answer"),
        (200, b"[1]", False, "no Alpaca answer"),
        (400, b"what?", False, "issafe with HTTP status 400"),
        (404, b"<html>\n<p>no\n", False, "404: a page of a web server, which is no Alpaca server"),
    ],
)
def test_an_alpaca_safety_monitor_is_asked_whether_it_is_safe(
    tmp_path: Path, code: int, body: bytes, safe: bool, words: str | None
) -> None:
    with answering(code, body) as server:
        told = WeatherSource(Weather(alpaca=f"alpaca://127.0.0.1:{server.server_port}/2"), tmp_path).ask()
        assert server.paths[0].startswith("/api/v1/safetymonitor/2/issafe?ClientID=")
    assert told.safe is safe
    assert words is None or words in str(told.words)
    if safe:
        gone = WeatherSource(Weather(alpaca=f"alpaca://127.0.0.1:{server.server_port}/2"), tmp_path).ask()
        assert not gone.safe
        assert "nothing listens there" in str(gone.words)


def test_weather_that_turns_unsafe_is_noticed_while_something_else_goes_on(tmp_path: Path) -> None:
    (tmp_path / "asked").mkdir()
    first_safe = "mktemp asked/XXXXXX; test $(ls asked | wc -l) -lt 3"
    watch = WeatherWatch(WeatherSource(Weather(command=(*SHELL, first_safe), every_s=0.1), tmp_path))
    watch._thread.join(30.0)
    assert watch.unsafe == "sh: ended with 1"
    assert len(list((tmp_path / "asked").iterdir())) == 3
    watch.close()


def test_weather_is_asked_about_at_once_and_then_now_and_again(tmp_path: Path) -> None:
    watch = WeatherWatch(WeatherSource(Weather(command=("false",), every_s=86400.0), tmp_path))
    watch._thread.join(30.0)
    watch.close()
    assert watch.unsafe == "false: ended with 1"


def test_elements_are_renewed_before_each_pass_and_the_provider_asked_once_in_two_hours(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    (tmp_path / "night.toml").write_text('elements = ["celestrak:stations"]\n[[passes]]\nsatellite = "ISS"\n')
    schedule = load_schedule(tmp_path / "night.toml")
    old = replace(demo_pass.elements(), epoch=Utc(float(demo_pass.elements().epoch.unix_s) - 3.0 * 86400.0))
    with element_server() as server:
        monkeypatch.setenv("SATTRACK_CELESTRAK_URL", server.url)
        context = CommandContext(Settings(), "52.1541,4.4908,0", (), None, False, False)
        renew = renewer(context, lambda: schedule)
        for _ in range(5):
            renewed = renew(msgspec.structs.replace(ONE, elements=old))
            assert renewed is not None
            assert renewed.epoch.isoformat("seconds") == "2026-10-02T00:19:53Z"
        # What is no newer is left as it is.
        assert renew(ONE) is None
        assert server.asked == ["GROUP=stations&FORMAT=csv"]


def test_elements_are_renewed_for_the_same_object_from_the_schedule_in_force(tmp_path: Path) -> None:
    known = demo_pass.elements()
    later = [replace(known, epoch=Utc(float(known.epoch.unix_s) + hours * 3600.0)) for hours in (1.0, 2.0)]
    # One number, two launches: two objects.
    both = [replace(later[1], name="OTHER", designator="2024-001A"), later[0]]
    (tmp_path / "both.json").write_text(write_elements(both, "json"))
    (tmp_path / "none.json").write_text(write_elements([replace(known, catalog_number=7)], "json"))
    schedules = []
    for file in ("none.json", "both.json"):
        (tmp_path / "night.toml").write_text(f'elements = ["{file}"]\n[[passes]]\nsatellite = "ISS"\n')
        schedules.append(load_schedule(tmp_path / "night.toml"))
    context = CommandContext(Settings(), "52.1541,4.4908,0", (), None, False, False)
    renew = renewer(context, lambda: schedules[0])
    assert renew(ONE) is None
    schedules.pop(0)
    renewed = renew(ONE)
    assert renewed is not None
    assert (renewed.designator, renewed.epoch) == (known.designator, later[0].epoch)


def test_of_several_sets_of_an_object_the_nearest_to_now_is_planned_with(tmp_path: Path) -> None:
    first = demo_pass.elements()
    later = replace(first, epoch=first.epoch.plus(20.0 * 86400.0))
    (tmp_path / "sets.csv").write_text(write_elements([later, first], "csv"))
    (tmp_path / "night.toml").write_text('elements = ["sets.csv"]\n[[passes]]\nsatellite = "ISS"\n')
    schedule = load_schedule(tmp_path / "night.toml")
    for day, wanted in (("2026-10-02", first), ("2026-10-20", later)):
        context = CommandContext(Settings(), "52.1541,4.4908,0", (), f"{day}T12:00:00Z", False, False)
        (taken,) = loader(context, schedule)(None).elements
        assert taken.epoch == wanted.epoch


def plans_of(folder: Path, text: str) -> NightPlans:
    """Return what makes plans for the ISS from a schedule that says so."""
    (folder / "iss.csv").write_text(write_elements([demo_pass.elements()], "csv"))
    (folder / "night.toml").write_text(text + ISS)
    context = CommandContext(Settings(), "52.1541,4.4908,0", (), "2026-10-02T13:00:00Z", False, False)
    plans = NightPlans(context, folder / "night.toml", ProfileFile("m"), rehearse=False)
    plans.settled = load_schedule(folder / "night.toml")
    return plans


ISS = 'elements = ["iss.csv"]\n[[passes]]\nsatellite = "ISS"\nif_sun_up = "run"\n'


def test_the_schedule_of_a_plan_is_known_once_that_is_made(tmp_path: Path) -> None:
    plans = plans_of(tmp_path, "")
    assert len(plans.make(BEGIN, BEGIN + 7200.0, BEGIN).passes) == 1
    assert plans.schedule == plans.settled
    # A night that was over before its plan goes by the schedule in force, which may have been reloaded since.
    plans.make(BEGIN, BEGIN, BEGIN)
    assert plans.schedule is None
    assert len(plans.make(BEGIN, BEGIN + 7200.0, BEGIN).passes) == 1
    (tmp_path / "night.toml").write_text(ISS + 'where = "sunlt"\n')
    with pytest.raises(SattrackError, match="sunlt"):
        plans.make(BEGIN, BEGIN + 7200.0, BEGIN)
    assert plans.schedule is None


@pytest.mark.parametrize(
    ("tables", "top", "given", "keys"),
    [
        ("", "", False, None),
        ('[weather]\nfile = "w.txt"\n', "", False, None),
        ('[weather]\nfile = "w.txt"\nevery_s = 5\n', "", False, "[weather] every_s"),
        ('[wake]\nrun = ["./power"]\n', "park_at_end = false\n", False, "park_at_end, [wake] timeout_s"),
        ("", "to = 2026-10-03\n", False, "to"),
        ("", "to = 2026-10-03\n", True, None),
    ],
)
def test_what_only_a_reload_changes_is_told(
    tmp_path: Path, tables: str, top: str, given: bool, keys: str | None
) -> None:
    plans = plans_of(tmp_path, "")
    plans.to_is_given = given
    (tmp_path / "night.toml").write_text(top + ISS + tables)
    told = plans.unsettled(load_schedule(tmp_path / "night.toml"))
    assert (told is None) == (keys is None)
    assert told is None or told.endswith(f"THE OLD VALUES HOLD until {RELOAD} of what was changed: {keys}")


RELOAD = "a reload (SIGHUP, `systemctl reload`)"


@pytest.mark.parametrize(
    ("utc_s", "awake_s", "boot_s", "jump"),
    [
        (10.0, 10.0, 10.0, None),
        (10.5, 10.0, 10.0, None),
        (-3590.0, 10.0, 10.0, (-3600.0, False)),
        (3610.0, 10.0, 10.0, (3600.0, False)),
        (1810.0, 10.0, 1810.0, (1800.0, True)),
    ],
)
def test_clocks_tell_a_set_clock_from_a_sleep(
    utc_s: float, awake_s: float, boot_s: float, jump: tuple[float, bool] | None
) -> None:
    before = ClockReadings(1e9, 500.0, 700.0)
    after = ClockReadings(1e9 + utc_s, 500.0 + awake_s, 700.0 + boot_s)
    assert jump_between(before, after) == jump


def test_a_recording_never_takes_the_name_of_one_that_is_there(tmp_path: Path) -> None:
    files = NightFiles(tmp_path, "night.toml")
    first = files.recording(ONE, 1)
    assert first == "recordings/20261002T120200Z-25544-1.mcap"
    (tmp_path / first).touch()
    assert files.recording(ONE, 1) == "recordings/20261002T120200Z-25544-1-2.mcap"
    assert files.recording(ONE, 2) == "recordings/20261002T120200Z-25544-2.mcap"


def test_a_target_without_a_number_and_with_a_long_name_has_a_recording(tmp_path: Path) -> None:
    for name, part in (("N" * 300, "N" * 60), ("é" * 300, "target"), ("N" * 59 + "é" + "M" * 9, "N" * 59)):
        one = msgspec.structs.replace(
            ONE, elements=replace(demo_pass.elements(), name=name, catalog_number=0)
        )
        files = NightFiles(tmp_path, "night.toml")
        assert files.recording(one, 1) == f"recordings/20261002T120200Z-{part}-1.mcap"
        (tmp_path / files.recording(one, 1)).touch()


def test_a_recording_whose_path_the_system_refuses_is_an_error_of_ours(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuses(_: Path) -> bool:
        raise OSError(36, "File name too long")

    files = NightFiles(tmp_path, "night.toml")
    monkeypatch.setattr("pathlib.Path.exists", refuses)
    with pytest.raises(SattrackError, match=r"cannot write .*: File name too long"):
        files.recording(ONE, 1)
    monkeypatch.undo()
    # Whether an old one is there cannot be known: that costs no pass either.
    monkeypatch.setattr("pathlib.Path.is_file", refuses)
    old = [(0.0, "recordings/old.mcap")]
    assert files.make_room(old, Recordings(keep_days=1.0), BEGIN, BEGIN) == []


def test_a_status_that_is_none_is_an_error_in_one_line(tmp_path: Path) -> None:
    assert read_status(tmp_path) is None
    (tmp_path / "status.json").write_text('{"type": "schedule"}')
    with pytest.raises(SattrackError, match=r"status\.json: no status to be read"):
        read_status(tmp_path)


def test_a_journal_that_is_none_or_another_versions_is_refused(tmp_path: Path) -> None:
    garbage = tmp_path / "garbage"
    garbage.write_bytes(b"not a data base, but long enough to be taken for one" * 50)
    with pytest.raises(SattrackError, match="no journal to be used"):
        Journal(garbage)
    other = tmp_path / "other"
    with sqlite3.connect(other) as base:
        base.execute("PRAGMA user_version = 99")
    base.close()
    with pytest.raises(SattrackError, match="another version"):
        Journal(other)
    spoilt = tmp_path / "spoilt"
    Journal(spoilt).close()
    with sqlite3.connect(spoilt) as base:
        base.execute("PRAGMA journal_mode = DELETE")
    base.close()
    spoilt.write_bytes(spoilt.read_bytes().replace(b"CREATE TABLE", b"CREATE\xffTABLE"))
    with pytest.raises(SattrackError, match="no journal to be used"):
        Journal(spoilt)


def test_a_folder_is_free_again_once_its_runner_is_gone_however_it_went(tmp_path: Path) -> None:
    holds = (
        "import sys, time; from pathlib import Path; from sattrack.schedule.night_stop import locked\n"
        "with locked(Path(sys.argv[1])): print('mine', flush=True); time.sleep(600)"
    )
    process = subprocess.Popen([sys.executable, "-c", holds, str(tmp_path)], stdout=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == b"mine\n"
    with pytest.raises(SattrackError, match=f"process {process.pid} runs this schedule"), locked(tmp_path):
        pass
    process.kill()
    process.communicate()
    with locked(tmp_path):
        pass


@pytest.mark.parametrize(
    ("power_off", "state"), [(False, TicketState.COMPLETE), (True, TicketState.UNCONFIRMED)]
)
def test_a_mount_is_laid_down_at_its_park_position_with_its_drives_on_or_off(
    power_off: bool, state: TicketState
) -> None:
    profile = ProfileFile(park=AxesPosition(-20.0, 40.0))
    station = SimulatedStation(demo_pass.SITE.place(), profile, SafetyLimits(), 50.0, 15.0)
    midnight = BEGIN + 43_200.0
    outcome, ended = station.perform(ParkThere(profile.mount, power_off=power_off), midnight)
    assert outcome is not None
    assert outcome.state is state
    assert station.hour_angle_deg == pytest.approx(-20.0, abs=0.1)
    assert station.dec_deg == pytest.approx(40.0, abs=0.1)
    assert 5.0 < ended - midnight < 60.0


def test_sessions_one_after_the_other_are_kept_within_half_a_turn_of_the_hour_angle(tmp_path: Path) -> None:
    given = ProfileFile(park=AxesPosition(-20.0, 40.0), hour_angle_limit_deg=200.0, ra_rate_gain=1.01)
    kept = within_half_a_turn(given)
    assert kept.hour_angle_limit_deg == 170.0
    assert (
        within_half_a_turn(msgspec.structs.replace(given, hour_angle_limit_deg=90.0)).hour_angle_limit_deg
        == 90.0
    )
    # As the sessions read it, it is the same in all else.
    written = load_profile_file(NightFiles(tmp_path, "night.toml").profile(kept))
    assert written == kept
    assert msgspec.structs.replace(written, hour_angle_limit_deg=200.0) == given


SCHEDULE = """
from = 2026-10-02T13:01:50Z
to = 2026-10-02T13:20:00Z
[defaults]
if_sun_up = "run"
least_s = 10
settle_s = 1
before = [
    { do = "command", run = ["sh", "-c", "echo $SATTRACK_NAME >> before.txt"], timeout_s = 2 },
    { do = "search", how = "sweep", reach_s = 0.5, period_s = 8, seconds = 5 },
]
after = [{ do = "command", run = ["sh", "-c", "echo $SATTRACK_RESULT >> after.txt; exit 4"], timeout_s = 3 }]
[[notify]]
run = ["sh", "-c", "echo $SATTRACK_NOTICE >> notices.txt"]
on = ["pass", "lost", "trouble", "morning"]
[[fixed]]
satellite = "25544"
start = 2026-10-02T13:02:08Z
end = 2026-10-02T13:03:08Z
"""


def runner(folder: Path, clock: str) -> subprocess.Popen[bytes]:
    options = ["--mount", "sim", "--elements", "iss.json", "--site", "52.1541,4.4908,0", "--json"]
    command = [sys.executable, "-m", "sattrack", "run", "night.toml", *options, "--profile", "mount.toml"]
    return subprocess.Popen(
        [*command, "--clock", clock], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )


@pytest.mark.soak
def test_a_runner_killed_in_mid_pass_follows_the_rest_of_it_when_it_is_started_again(tmp_path: Path) -> None:
    (tmp_path / "night.toml").write_text(SCHEDULE)
    (tmp_path / "iss.json").write_text(write_elements([replace(demo_pass.elements(), name="ISS")], "json"))
    (tmp_path / "mount.toml").write_text('name = "m"\npark = { hour_angle_deg = 0.0, dec_deg = 30.0 }\n')
    first = runner(tmp_path, "2026-10-02T13:01:50Z")
    assert first.stdout is not None
    for line in first.stdout:
        view = json.loads(line)
        if view["state"] == "following" and (view["passes"][0]["on_target_s"] or 0.0) > 8.0:
            break
    first.kill()
    first.communicate()
    again = runner(tmp_path, "2026-10-02T13:02:50Z")
    out, err = again.communicate()
    assert again.returncode == 0, err
    last = json.loads(out.splitlines()[-1])
    (one,) = last["passes"]
    assert (last["state"], last["mount"]) == ("ended", "parked")
    # On a machine with much else to do, a session may have fallen silent and been begun again.
    assert one["parts"] >= 2
    assert len(one["recordings"]) == one["parts"]
    assert all((tmp_path / "night.run" / name).exists() for name in one["recordings"])
    assert one["on_target_s"] > 4.0
    # Neither the command before the pass nor that after it was run more than once.
    assert (tmp_path / "before.txt").read_text() == "ISS\n"
    assert (tmp_path / "after.txt").read_text() in ("done\n", "partly\n")
    assert any("ended with 4" in note for note in last["notes"])
    assert any("the runner was restarted: following on" in note for note in last["notes"])
    page = (tmp_path / "night.run" / last["summary"]).with_suffix(".html").read_text()
    assert f'href="../{one["recordings"][1]}"' in page
