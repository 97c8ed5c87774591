from __future__ import annotations

import copy
import pickle
from datetime import UTC, datetime, timedelta, timezone
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tle.errors import NaiveTimeError, TimeFormatError, TimeRangeError
from tle.instants import Utc, as_utc

# 2026-10-02T13:05:24 UTC: 20728 days of 86400 s since 1970, and 13:05:24.
CULMINATION_S = 20728 * 86400 + 13 * 3600 + 5 * 60 + 24


@pytest.mark.parametrize(
    ("text", "unix_s"),
    [
        ("2026-10-02T13:05:24Z", CULMINATION_S),
        ("2026-10-02 13:05:24", CULMINATION_S),
        ("2026-10-02T13:05:24.5Z", CULMINATION_S + 0.5),
        ("2026-10-02T13:05:24,250z", CULMINATION_S + 0.25),
        # As many decimals as Orekit writes of a double.
        ("2026-10-02T13:05:24.250000000000000", CULMINATION_S + 0.25),
        ("2026-10-02T15:05:24+02:00", CULMINATION_S),
        ("2026-10-02T07:35:24-0530", CULMINATION_S),
        ("2026-10-02T13:05Z", CULMINATION_S - 24),
        ("2026-10-02", 20728 * 86400),
        ("2026-275T13:05:24Z", CULMINATION_S),
        ("2026-275", 20728 * 86400),
        ("2024-366T23:59:59.5Z", 20089 * 86400 - 0.5),
        (" 1970-01-01T00:00:00.000000Z ", 0.0),
        ("1969-12-31T23:59:59.5Z", -0.5),
        ("2016-12-31T23:59:60Z", 1483228800.0),
        ("2016-12-31T23:59:60.25Z", 1483228800.25),
    ],
)
def test_reads_iso_8601(text, unix_s):
    assert Utc.parse(text).unix_s == unix_s


@pytest.mark.parametrize(
    "text",
    [
        "",
        "now",
        "2026-13-01",
        "2026-02-30T00:00:00Z",
        "2026-366T00:00:00Z",
        "2026-000",
        "0001-000",
        "9999-366",
        "2026-00-10",
        "2026-10-02T24:00:00Z",
        "2026-10-02T13:05:61Z",
        "2026-10-02T12:00:60Z",
        "20",
        "2026-10-02T13:05:24+25:00",
        "٢٠٢٦-10-02",
        "2026-10-02T13:05:24ZZ",
    ],
)
def test_refuses_what_is_no_time(text):
    with pytest.raises(TimeFormatError, match="is no time"):
        Utc.parse(text)


def test_datetimes_need_a_zone():
    assert Utc.from_datetime(datetime(2026, 10, 2, 13, 5, 24, tzinfo=UTC)).unix_s == CULMINATION_S
    cest = timezone(timedelta(hours=2))
    assert Utc.from_datetime(datetime(2026, 10, 2, 15, 5, 24, tzinfo=cest)).unix_s == CULMINATION_S
    with pytest.raises(NaiveTimeError, match="no time zone"):
        Utc.from_datetime(datetime(2026, 10, 2, 13, 5, 24))  # noqa: DTZ001 - the point of the test


def test_writes_iso_8601():
    t = Utc.of(CULMINATION_S + 0.9996)
    assert t.isoformat() == "2026-10-02T13:05:24.999600Z"
    assert t.isoformat("milliseconds") == "2026-10-02T13:05:25.000Z"
    assert t.isoformat("seconds") == "2026-10-02T13:05:25Z"
    assert t.datetime() == datetime(2026, 10, 2, 13, 5, 24, 999600, tzinfo=UTC)


@given(st.datetimes(min_value=datetime(1957, 1, 1), max_value=datetime(2056, 12, 31)))  # noqa: DTZ001
def test_reads_what_it_writes_to_the_microsecond(moment):
    t = Utc.from_datetime(moment.replace(tzinfo=UTC))
    assert t.datetime() == moment.replace(tzinfo=UTC)
    assert Utc.parse(t.isoformat()) == t


@given(st.floats(min_value=-4e8, max_value=2.7e9))
def test_split_keeps_the_full_precision(unix_s):
    jd, fraction = Utc.of(unix_s).split()
    assert jd % 1.0 == 0.5
    assert 0.0 <= fraction <= 1.0
    exact = (Fraction(unix_s) / 86400) + Fraction("2440587.5")
    # 1e-15 day is 0.1 ns; the instant itself is a float with steps of up to 0.5 µs.
    assert abs(Fraction(jd) + Fraction(fraction) - exact) < Fraction("1e-15")


def test_ranges_hold_both_ends():
    start = Utc.of(1000.0)
    times = Utc.range(start, Utc.of(1001.0), 0.1)
    assert len(times) == 11
    assert times[0] == start
    assert times[10].unix_s == pytest.approx(1001.0, abs=1e-9)
    assert len(Utc.range(start, start, 5.0)) == 1
    for stop, step in ((999.0, 1.0), (1001.0, 0.0), (1001.0, -1.0), (1001.0, float("nan")), (1e10, 1e-3)):
        with pytest.raises(TimeRangeError):
            Utc.range(start, Utc.of(stop), step)


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), [0.0, float("nan")]])
def test_instants_are_finite(bad):
    with pytest.raises(TimeRangeError, match="not a finite number"):
        Utc.of(bad)


def test_arrays_of_instants():
    times = Utc.of([0.0, 1.0, 86400.0])
    assert times.is_array
    assert len(times) == 3
    assert times[2].isoformat("seconds") == "1970-01-02T00:00:00Z"
    jd, fraction = times.split()
    assert jd.tolist() == [2440587.5, 2440587.5, 2440588.5]
    assert fraction.tolist() == [0.0, 1.0 / 86400.0, 0.0]
    assert (times - Utc.of(1.0)).tolist() == [-1.0, 0.0, 86399.0]
    with pytest.raises(TimeRangeError, match="array"):
        times.datetime()
    assert bool(Utc.of(np.array([])))
    with pytest.raises(TimeRangeError, match="one dimension"):
        Utc.of([[0.0, 1.0]])


def test_instants_are_values():
    t = Utc.of(5.0)
    with pytest.raises(AttributeError, match="cannot be changed"):
        t.unix_s = 6.0
    assert t == Utc(5.0) == copy.deepcopy(t) == pickle.loads(pickle.dumps(t))
    assert hash(t) == hash(Utc(5.0))
    assert t != 5.0
    assert t < t.plus(0.001)
    assert t <= Utc(5.0)
    assert not t < Utc(5.0)
    assert t.plus(2.5) - t == 2.5


def test_instants_are_shown_as_a_reader_writes_them():
    t = Utc.parse("2026-10-02T13:05:24.25Z")
    assert (str(t), repr(t)) == ("2026-10-02T13:05:24.25Z", "<Utc 2026-10-02T13:05:24.25Z>")
    assert str(Utc(0.0)) == "1970-01-01T00:00:00Z"
    assert str(Utc(1e15)) == "1000000000000000.0 s since 1970"
    assert str(Utc(float("nan"))) == "nan s since 1970"
    shown = "<Utc, 2 instants from 1970-01-01T00:00:01Z to 1970-01-02T00:00:00.5Z>"
    assert repr(Utc.of([1.0, 86400.5])) == str(Utc.of([1.0, 86400.5])) == shown
    assert repr(Utc.of([])) == "<Utc, no instants>"


def test_now_is_the_computers_clock():
    before = datetime.now(UTC)
    now = Utc.now().datetime()
    assert before <= now <= datetime.now(UTC)


def test_nothing_but_scripts_asks_for_now():
    # `--clock` and replays set the time: code that read the computer's own would not follow.
    root = Path(__file__).resolve().parents[2]
    modules = [path for folder in ("tle", "sattrack") for path in (root / folder).rglob("*.py")]
    assert len(modules) > 100
    assert [path for path in modules if "Utc.now" in path.read_text(encoding="utf-8")] == []


def test_what_names_an_instant_is_taken_as_one():
    moment = datetime(2026, 10, 2, 15, 5, 24, 250000, tzinfo=timezone(timedelta(hours=2)))
    assert as_utc(moment) == Utc.parse("2026-10-02T13:05:24.25Z")
    t = Utc(5.0)
    assert as_utc(t) is t
    assert as_utc([moment, moment + timedelta(seconds=2.5)]) - as_utc(moment) == pytest.approx([0.0, 2.5])
    assert Utc.range(moment, moment, 1.0)[0] == as_utc(moment)
    with pytest.raises(NaiveTimeError, match="no time zone"):
        as_utc(datetime(2026, 10, 2))  # noqa: DTZ001
    for other in (5.0, "2026-10-02", None):
        with pytest.raises(TimeFormatError, match="is no instant: give a Utc"):
            as_utc(other)


def test_far_from_the_calendar_is_named():
    with pytest.raises(TimeRangeError, match="outside the calendar"):
        Utc.of(1e15).datetime()


@given(st.lists(st.floats(-1e9, 2.7e9) | st.integers(0, 2**31).map(lambda k: k / 128.0), max_size=20))
def test_many_instants_are_written_as_each_one_is(unix_s):
    many = Utc(np.array(unix_s, dtype=np.float64))
    for timespec in ("microseconds", "seconds"):
        assert many.isoformats(timespec) == [Utc(s).isoformat(timespec) for s in unix_s]
