"""Schedule files as people write and miswrite them: each error names its place and what was meant."""

from __future__ import annotations

from pathlib import Path

import pytest

from sattrack.core.errors import BadInputError
from sattrack.schedule.file import Schedule, load_schedule
from sattrack.schedule.schema import SearchAction, SlewAction
from tle.instants import Utc

ISS = '[[passes]]\nsatellite = "ISS"\n'


def written(folder: Path, text: str, name: str = "night.toml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def loaded(folder: Path, text: str) -> Schedule:
    return load_schedule(written(folder, text))


def refusal(folder: Path, text: str) -> str:
    """Return what is said of a file, without the folder's name."""
    with pytest.raises(BadInputError) as error:
        loaded(folder, text)
    said = str(error.value)
    assert "\n" not in said
    return said.replace(f"{folder}/", "")


def utc_s(text: str) -> float:
    return float(Utc.parse(text).unix_s)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (
            "[defaults]\nprioirty = 2\n" + ISS,
            "night.toml:2:1: unknown key 'prioirty'; did you mean 'priority'?",
        ),
        ("a = 1\n", "night.toml:1:1: unknown key 'a'; there are timezone, include, "),
        ('rule = "all"\n', "night.toml:1:1: unknown key 'rule'; it belongs under [[passes]]"),
        (ISS + "keep_days = 5\n", "night.toml:3:1: unknown key 'keep_days'; it belongs under [recordings]"),
        (ISS + 'priority = "x"\n', "night.toml:3:13: priority is 'x'; give a number"),
        (ISS + "priority = 0\n", "night.toml:3:12: priority is 0; give a number above 0"),
        (ISS + "priority = nan\n", "night.toml:3:12: priority is nan; give a number above 0"),
        (ISS + "  shorten = 1\n", "night.toml:3:13: shorten is 1; give true or false"),
        (ISS + 'pier_side = "norml"\n', "night.toml:3:14: pier_side is 'norml'; did you mean 'normal'?"),
        (ISS + "if_sun_up = true\n", "night.toml:3:13: if_sun_up is true; give one of run, skip"),
        (ISS + "bias_along_s = 900\n", "night.toml:3:16: bias_along_s is 900; give -60 to 60"),
        (ISS + 'rule = "all"\n', "night.toml:1:1: give one of rule, satellite and satellites: whose passes"),
        (
            "[[passes]]\nsatellite = ISS\n",
            "night.toml:2:13: not a TOML file: Invalid value; text stands in quotes",
        ),
        ('[[passes]]\nsatellite = "ISS\n', "night.toml:2: the quote is not closed"),
        (
            '[passes]\nsatellite = "ISS"\n',
            "night.toml:1:1: passes is one table; there may be many: write [[passes]]",
        ),
        (
            ISS + 'before = { do = "slew", star = "Vega" }\n',
            "night.toml:3:10: before is one table; there may be many: write [[passes.before]]",
        ),
        (
            "from = 22:30\n" + ISS,
            "night.toml:1:10: not a TOML file: Expected newline or end of document after "
            "a statement; times stand in quotes",
        ),
        ("", "night.toml: asks for no pass: write [[passes]], [[fixed]], fixed_list or [[imports]]"),
        (ISS + 'before = [{ do = "slw" }]\n', "night.toml:3:19: do is 'slw'; did you mean 'slew'?"),
        (
            ISS + 'before = [\n  { do = "slew", star = "Vegga" },\n]\n',
            "night.toml:4:26: star is 'Vegga'; that one is not known; did you mean 'Vega'?",
        ),
        (
            ISS + 'before = [\n  { do = "slew", star = "Vega", waits = 3 },\n]\n',
            "night.toml:4:33: unknown key 'waits'; did you mean 'wait_s'?",
        ),
        (
            ISS + 'before = [{ do = "slew" }]\n',
            "night.toml:3:11: give one of star, ra_deg with dec_deg, or alt",
        ),
        (
            ISS + 'before = [{ do = "slew", alt_deg = 3 }]\n',
            "night.toml:3:36: alt_deg and az_deg go together",
        ),
        (ISS + 'before = [{ do = "search", how = "spiral" }]\n', "night.toml:3:11: spacing_deg is missing"),
        (ISS + 'after = [{ do = "command", run = [] }]\n', "night.toml:3:34: run is empty; give the program"),
        (
            ISS + 'after = [{ do = "webhook", url = "x" }]\n',
            "night.toml:3:35: url is 'x'; write https://HOST",
        ),
        ("[weather]\n" + ISS, "night.toml:1:1: give one of file, command and alpaca"),
        (
            '[weather]\nalpaca = "alpaca://x"\n' + ISS,
            "night.toml:2:11: alpaca is 'alpaca://x'; write alpaca://H",
        ),
        (
            '[[passes]]\nrule = "all of x, abve 3"\n',
            "night.toml:2:19: 'abve 3' is no condition; did you mean 'ab",
        ),
        (
            '[[passes]]\nsatellite = "ISS"\nwhere = "sunlt"\n',
            "night.toml:3:10: 'sunlt' is no condition; did you",
        ),
        ("from = 2026-10-03\nto = 2026-10-02\n" + ISS, "night.toml:2:1: to is not after from"),
        (ISS + "from = 22:00:00\n", "night.toml:3:8: from and to go together; one is missing"),
        (
            ISS + "from = 22:00:00\nto = 2026-10-02\n",
            "night.toml:4:6: from and to are two times of day, or two",
        ),
        (ISS + "from = 2026-10-03\nto = 2026-10-02\n", "night.toml:4:6: the window ends before it starts"),
        (ISS + 'from = "22:00"\nto = "25:00"\n', "night.toml:4:7: '25:00' is no time of day: hour must be"),
        (
            'timezone = "Europe/Amsterdm"\n' + ISS,
            "night.toml:1:13: timezone: there is no time zone 'Europe/Amst",
        ),
        (
            'timezone = "CET"\n' + ISS,
            "night.toml:1:13: timezone: 'CET' does not name one place's time: write UTC",
        ),
        ('timezone = "local"\n' + ISS, "night.toml:1:13: timezone: 'local' does not name one place's time"),
        ('include = ["b.toml"]\n', "night.toml:1:13: there is no file b.toml"),
        ('[[imports]]\nfile = "nigth.csv"\n', "night.toml:2:9: there is no file nigth.csv"),
        (
            '[[fixed]]\nsatellite = "ISS"\nstart = 2026-10-02 12:00:00\nend = 2026-10-02 11:00:00\n',
            "night.toml:4:7: ISS: ends before it starts; swap start and end",
        ),
        ('[[fixed]]\nsatellite = "ISS"\n', "night.toml:1:1: start is missing"),
        (ISS + f"priority = {'9' * 5000}\n", "night.toml:3: a number has too many digits; write a shorter"),
        (ISS + f"before = {'[' * 5000}\n", "night.toml:3: arrays and tables are nested too deep to be read"),
        (ISS + "before = " + "[\n" * 5000, "night.toml: arrays and tables are nested too deep to be read"),
        (f"{ISS}[{'a.' * 5000}a]\n", "night.toml:3: arrays and tables are nested too deep to be read; nest"),
    ],
)
def test_what_is_wrong_is_told_with_its_place_and_what_was_meant(
    tmp_path: Path, text: str, says: str
) -> None:
    assert refusal(tmp_path, text).startswith(says)


def test_a_file_that_is_meant_is_named(tmp_path: Path) -> None:
    written(tmp_path, "", "targets.toml")
    said = refusal(tmp_path, 'include = ["target.toml"]\n')
    assert said == "night.toml:1:13: there is no file target.toml; did you mean 'targets.toml'?"


def test_a_file_that_includes_itself_by_others_is_told_with_the_whole_ring(tmp_path: Path) -> None:
    written(tmp_path, '\ninclude = ["c.toml"]\n', "b.toml")
    written(tmp_path, 'include = ["night.toml"]\n', "c.toml")
    said = refusal(tmp_path, 'include = ["b.toml"]\n')
    assert said == (
        "c.toml:1:13: includes itself: night.toml → b.toml → c.toml → night.toml; take one include away"
    )


def test_an_included_file_does_not_speak_of_the_whole(tmp_path: Path) -> None:
    written(tmp_path, "park_at_end = false\n", "b.toml")
    said = refusal(tmp_path, 'include = ["b.toml"]\n')
    assert said.startswith("b.toml:1:1: park_at_end stands in the schedule itself")


def test_a_file_may_be_included_twice_where_no_ring_comes_of_it(tmp_path: Path) -> None:
    written(tmp_path, 'include = ["d.toml"]\n', "b.toml")
    written(tmp_path, ISS, "d.toml")
    schedule = loaded(tmp_path, 'include = ["b.toml", "d.toml"]\n')
    assert [entry.label for entry in schedule.entries] == ["ISS", "ISS"]
    assert [Path(name).name for name in schedule.files] == ["night.toml", "b.toml", "d.toml", "d.toml"]


def test_times_without_a_zone_are_of_the_files_own(tmp_path: Path) -> None:
    head = "from = 2026-10-02 12:00:00\nto = 2026-10-02T12:00:00-04:00\n" + ISS
    plain = loaded(tmp_path, head)
    assert plain.from_utc_s == utc_s("2026-10-02T12:00:00Z")
    assert plain.to_utc_s == utc_s("2026-10-02T16:00:00Z")
    zoned = loaded(tmp_path, 'timezone = "Europe/Amsterdam"\n' + head)
    assert zoned.from_utc_s == utc_s("2026-10-02T10:00:00Z")
    assert zoned.to_utc_s == plain.to_utc_s


def test_the_machines_own_zone_does_not_count(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TZ", "America/New_York")
    schedule = loaded(tmp_path, "from = 2026-10-02 12:00:00\nto = 2026-10-03\n" + ISS)
    assert schedule.from_utc_s == utc_s("2026-10-02T12:00:00Z")


def test_what_an_entry_says_goes_before_the_defaults(tmp_path: Path) -> None:
    text = """
    [defaults]
    priority = 2
    settle_s = 9
    before = [{ do = "slew", star = "Vega", wait_s = 3 }]
    if_weather_unsafe = "skip"
    [[passes]]
    satellites = ["ISS", "TDRS 3"]
    priority = 5
    [[passes]]
    rule = "all of celestrak:visual, above 30°, dark"
    before = [{ do = "search", how = "sweep", reach_s = 2, period_s = 8 }]
    [[fixed]]
    satellite = "ISS"
    start = 2026-10-02T01:00:00Z
    end = 2026-10-02T01:05:00Z
    """
    first, second, third = loaded(tmp_path, text).entries
    assert (first.satellites, first.terms.priority, first.terms.settle_s) == (("ISS", "TDRS 3"), 5.0, 9.0)
    assert first.terms.before == (SlewAction(star="Vega", wait_s=3.0),)
    assert first.terms.if_weather_unsafe == "skip"
    assert (second.source, second.terms.priority, second.terms.min_altitude_deg) == (
        "celestrak:visual",
        2.0,
        30.0,
    )
    assert second.terms.before == (SearchAction(how="sweep", reach_s=2.0, period_s=8.0),)
    assert second.terms.sun_up_deg == -6.0
    # Somebody waits for a pass by fixed times: it counts more than others, whatever their default.
    assert third.terms.priority == 100.0
    assert third.fixed == (utc_s("2026-10-02T01:00:00Z"), utc_s("2026-10-02T01:05:00Z"))


@pytest.mark.parametrize(
    ("defaults", "own", "condition", "sun_up_deg"),
    [
        ("", "", "sun below 40°", 40.0),
        ("", "", "sun below -12°", -12.0),
        ("sun_up_deg = -8", "", "sun below 40°", -8.0),
        ("sun_up_deg = -8", "sun_up_deg = 3", "sun below 40°", 3.0),
        ("sun_up_deg = -8", "sun_up_deg = 3", "dark", -6.0),
    ],
)
def test_a_condition_on_the_sun_takes_the_place_of_what_nobody_has_set(
    tmp_path: Path, defaults: str, own: str, condition: str, sun_up_deg: float
) -> None:
    text = f'[defaults]\n{defaults}\n[[passes]]\nrule = "all, {condition}"\n{own}\n'
    assert loaded(tmp_path, text).entries[0].terms.sun_up_deg == sun_up_deg


def test_paths_are_beside_the_file_that_names_them(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    written(tmp_path / "sub", '[[passes]]\nrule = "all of sky.tle, dark"\n', "b.toml")
    text = 'include = ["sub/b.toml"]\nmagnitudes = "m.txt"\nelements = ["e.tle", "celestrak:active"]\n'
    schedule = loaded(tmp_path, text + '[weather]\nfile = "w.txt"\n')
    assert schedule.entries[0].source == str(tmp_path / "sub" / "sky.tle")
    assert schedule.magnitudes == str(tmp_path / "m.txt")
    assert schedule.elements == (str(tmp_path / "e.tle"), "celestrak:active")
    assert schedule.weather is not None
    assert schedule.weather.file == str(tmp_path / "w.txt")


def test_fixed_passes_at_one_time_are_refused_unless_one_counts_more(tmp_path: Path) -> None:
    pair = """
    [[fixed]]
    satellite = "ISS"
    start = 2026-10-02T01:00:00Z
    end = 2026-10-02T01:05:00Z
    [[fixed]]
    satellite = "TDRS 3"
    start = 2026-10-02T01:04:00Z
    end = 2026-10-02T01:09:00Z
    """
    said = refusal(tmp_path, pair)
    assert said == (
        "night.toml:6:5: TDRS 3 begins 2026-10-02T01:04:00Z, before ISS of night.toml:2:5 ends, "
        "2026-10-02T01:05:00Z: move one, or give them different priorities"
    )
    assert len(loaded(tmp_path, pair + "priority = 3\n").entries) == 2


def test_a_long_fixed_pass_is_held_against_all_that_come_within_it(tmp_path: Path) -> None:
    lines = "".join(
        f"2026-10-02T0{start} 2026-10-02T0{end} {name}\n"
        for start, end, name in (("1:00", "4:00", "LONG"), ("1:30", "1:40", "A"), ("3:00", "3:10", "B"))
    )
    assert "A begins" in refusal(tmp_path, f'fixed_list = """\n{lines}"""\n')


def test_windows_come_each_day_in_the_files_zone(tmp_path: Path) -> None:
    text = 'timezone = "Europe/Amsterdam"\n' + ISS + "from = 22:00:00\nto = 04:00:00\n"
    windows = loaded(tmp_path, text).entries[0].windows
    assert windows is not None
    # Summer time ends on 25 October at 1h UTC: the night's second half is an hour longer.
    span = (utc_s("2026-10-23T12:00:00Z"), utc_s("2026-10-25T12:00:00Z"))
    assert windows(span) == [
        (utc_s("2026-10-23T20:00:00Z"), utc_s("2026-10-24T02:00:00Z")),
        (utc_s("2026-10-24T20:00:00Z"), utc_s("2026-10-25T03:00:00Z")),
    ]


@pytest.mark.parametrize(
    ("day", "times", "hours"),
    [
        # Clocks are put forward on 28 March 2027 at 1h UTC, from 2h to 3h.
        ("2027-03-27", ("02:30", "05:00"), (25.5, 27.0)),
        ("2027-03-27", ("22:00", "02:30"), (21.0, 25.5)),
        ("2027-03-27", ("02:15", "02:45"), (25.25, 25.75)),
        ("2027-03-27", ("02:30", "03:00"), None),
        # They are put back on 25 October 2026 at 1h UTC, from 3h to 2h.
        ("2026-10-24", ("02:30", "05:00"), (24.5, 28.0)),
        ("2026-10-24", ("22:00", "02:30"), (20.0, 24.5)),
        ("2026-10-23", ("02:30", "05:00"), (24.5, 27.0)),
        ("2026-10-25", ("02:30", "05:00"), (25.5, 28.0)),
    ],
)
def test_daily_times_that_a_clock_skips_or_shows_twice_cost_no_night(
    tmp_path: Path, day: str, times: tuple[str, str], hours: tuple[float, float] | None
) -> None:
    text = f'timezone = "Europe/Amsterdam"\n{ISS}from = "{times[0]}"\nto = "{times[1]}"\n'
    windows = loaded(tmp_path, text).entries[0].windows
    assert windows is not None
    midnight = utc_s(f"{day}T00:00:00Z")
    wanted = [] if hours is None else [(midnight + hours[0] * 3600.0, midnight + hours[1] * 3600.0)]
    assert windows((midnight + 43_200.0, midnight + 129_600.0)) == wanted


def test_a_daily_window_of_two_zones_ends_when_the_second_clock_shows_its_end_next(tmp_path: Path) -> None:
    # 20:00 in Tokyo is 11:00 UTC, 01:00 in Tokyo is 16:00 UTC of the day before.
    span = (utc_s("2026-06-01T10:00:00Z"), utc_s("2026-06-02T10:00:00Z"))
    for times, hours in (
        ('from = 20:00:00\nto = "12:00Z"\n', (11, 12)),
        ('from = 01:00:00\nto = "17:00Z"\n', (16, 17)),
    ):
        windows = loaded(tmp_path, 'timezone = "Asia/Tokyo"\n' + ISS + times).entries[0].windows
        assert windows is not None
        assert windows(span) == [tuple(utc_s(f"2026-06-01T{hour}:00:00Z") for hour in hours)]
