"""The pure drawings: dots, the sky as a disc, the chart, the field; truth by closed forms and by eye."""

from __future__ import annotations

import math

import msgspec
import pytest
from tui_builders import SKY, UTC_S, changed

from sattrack.tui.figures import ExpectedField, field_of, field_picture, field_rows
from sattrack.tui.panels import DotCanvas, Layer
from sattrack.tui.sky_chart import (
    BOTH,
    LAYERS,
    MOUNT,
    SATELLITE,
    ChartedSky,
    Disc,
    SkyLayer,
    SkySpot,
    apart_deg,
    at_instant,
    chart,
    circle,
    ground,
    legend,
    notes,
    over_site,
    skyline_deg,
    spot_of,
    vector,
)
from sattrack.views.run import PassView, SkyPoint

NOW = ChartedSky(SKY, UTC_S, SkySpot(55.0, 235.0), SkySpot(20.0, 300.0))


def text_of(rows: list) -> list[str]:
    return ["".join(part if isinstance(part, str) else part[0] for part in row) for row in rows]


def drawn(sky: ChartedSky, columns: int = 22, rows: int = 11, plain: bool = False) -> list[str]:
    return text_of(chart(sky, ground(sky, columns, rows, plain)).drawn())


def told(**changes: object) -> ChartedSky:
    return ChartedSky(msgspec.structs.replace(SKY, **changes), UTC_S, NOW.satellite, NOW.mount)


def test_dots_are_braille_as_unicode_numbers_it() -> None:
    canvas = DotCanvas(3, 1, (Layer("", "a"), Layer("red", "b")))
    canvas.dot(0.0, 0.0, 0)
    canvas.dot(3.9, 3.9, 1)
    for x in (4, 5):
        for y in range(4):
            canvas.dot(x, y, 0)
    canvas.dot(-0.1, 0.0, 0)
    canvas.dot(6.0, 0.0, 0)
    assert canvas.drawn() == [[("⠁", ""), ("⢀", "red"), ("⣿", "")]]


def test_of_two_layers_in_a_cell_the_later_gives_its_look_and_characters_lie_over_both() -> None:
    for plain, expected in ((False, "⠃"), (True, "b")):
        canvas = DotCanvas(2, 1, (Layer("dim", "a"), Layer("red", "b")), plain)
        canvas.dot(0, 0, 1)
        canvas.dot(0, 1, 0)
        assert canvas.drawn() == [[(expected, "red"), (" ", "")]]
        assert canvas.write(1, 0, "x", "bold")
        assert not canvas.write(0, 0, "yz", "bold"), "one stands there already"
        assert not canvas.write(1, 0, "z", "bold")
        assert canvas.drawn() == [[(expected, "red"), ("x", "bold")]]


@pytest.mark.parametrize(
    ("spot", "place"),
    [
        (SkySpot(90.0, 0.0), (20.0, 20.0)),
        (SkySpot(0.0, 0.0), (20.0, 20.0 - 19.4)),
        (SkySpot(0.0, 90.0), (20.0 - 19.4, 20.0)),
        (SkySpot(45.0, 180.0), (20.0, 20.0 + 9.7)),
        (SkySpot(30.0, 270.0), (20.0 + 19.4 * 2.0 / 3.0, 20.0)),
        (SkySpot(-0.1, 0.0), None),
    ],
)
def test_north_is_up_and_east_to_the_left_with_heights_to_scale(
    spot: SkySpot, place: tuple[float, float] | None
) -> None:
    disc = Disc.within(20, 10)
    assert disc.place(spot) == (None if place is None else pytest.approx(place))
    if place is not None and spot.alt_deg < 90.0:
        back = disc.spot(*place)
        assert back is not None
        assert back == pytest.approx(spot, abs=1e-9)


@pytest.mark.parametrize(
    ("hour_angle_deg", "dec_deg", "latitude_deg", "spot"),
    [
        (0.0, 52.0, 52.0, SkySpot(90.0, 0.0)),
        (0.0, 10.0, 52.0, SkySpot(48.0, 180.0)),
        (90.0, 0.0, 40.0, SkySpot(0.0, 270.0)),
        (-90.0, 0.0, -30.0, SkySpot(0.0, 90.0)),
        (123.0, 90.0, 35.0, SkySpot(35.0, 0.0)),
        (0.0, -20.0, -33.0, SkySpot(77.0, 0.0)),
    ],
)
def test_a_direction_of_date_stands_where_the_sky_has_turned_it(
    hour_angle_deg: float, dec_deg: float, latitude_deg: float, spot: SkySpot
) -> None:
    # At 0 h UTC on 1 January 2000, mean sidereal time at Greenwich was 6h 39m 52.27s (Astronomical Almanac).
    utc_s, sidereal_deg = 946684800.0, (6.0 + 39.0 / 60.0 + 52.27 / 3600.0) * 15.0
    found = over_site(sidereal_deg + 10.0 - hour_angle_deg, dec_deg, utc_s, latitude_deg, 10.0)
    assert apart_deg(found, spot) < 0.001


def test_a_circle_keeps_its_distance_and_closes() -> None:
    points = list(circle(SkySpot(50.0, 10.0), 12.0, 40))
    assert [apart_deg(SkySpot(50.0, 10.0), point) for point in points] == pytest.approx([12.0] * 41)
    assert apart_deg(points[0], points[-1]) == pytest.approx(0.0, abs=1e-6)


def test_between_two_points_a_path_goes_through_north_and_over_the_zenith() -> None:
    north = (SkyPoint(0.0, 0.0, 350.0), SkyPoint(10.0, 0.0, 10.0))
    over = (SkyPoint(0.0, 80.0, 90.0), SkyPoint(10.0, 80.0, 270.0))
    middle = at_instant(north, 5.0)
    assert middle is not None
    assert math.sin(math.radians(middle.az_deg)) == pytest.approx(0.0, abs=1e-9)
    top = at_instant(over, 5.0)
    assert top is not None
    assert top.alt_deg == pytest.approx(90.0)
    assert at_instant(north, -5.0) == pytest.approx(SkySpot(0.0, 350.0))
    assert at_instant(north, 50.0) == pytest.approx(SkySpot(0.0, 10.0))
    assert at_instant((), 0.0) is None
    assert spot_of(vector(SkySpot(12.0, 345.0))) == pytest.approx(SkySpot(12.0, 345.0))


@pytest.mark.parametrize(
    ("az_deg", "height_deg"), [(0, 10), (45, 6), (90, 5), (315, 6), (359.9, 9.99), (360, 10)]
)
def test_the_skyline_is_straight_between_its_points_and_round_through_north(
    az_deg: float, height_deg: float
) -> None:
    assert skyline_deg(SKY.horizon, SKY.floor_altitude_deg, az_deg) == pytest.approx(height_deg, abs=0.01)


def test_the_whole_small_chart() -> None:
    assert drawn(NOW) == [
        "     ⣀⠤⣔⣒⡹⠭N⢝⣒⣢⠤⣀     ",
        "   ⣤⡮⠞⠉⠁   ⡀  ⠈⠉⠳⢵⣤   ",
        " ⢠⡾⠋   ⠂ ⢁⠤⠤⡈ ⠐   ⠙⢷⡄ ",
        "⢠⣻⠁ Moon ⡘⠤P⢃   ⠁⡀+⠈⣟⡄",
        "set ⡀  ⠠      ⠄  ⢀rise",
        "E⠤⢄⣠   ⠄  80° ⠠   ⡄ ⠠W",
        "⢻⡆  ⠌⠉⠐⠒⠒⠊⠁⠉⠑⠂●  ⠠  ⢰⡝",
        "⠘⣽⡀  ⠄   ⠁ ⠂⢈⣀⣀ ⠠  ⢀⣯⠃",
        " ⠘⢵⣄  ⠂ ⡀  ⡴Sun⢳  ⣠⡮⠃ ",
        "   ⠹⢷⣄⡀   ⠁⠹⠴⡤⠶⢋⣠⡾⠏   ",
        "     ⠈⠛⠽⠶⣢S⣤⣔⠶⠯⠛⠁     ",
    ]


def test_the_whole_small_chart_without_unicode() -> None:
    rows = drawn(NOW, plain=True)
    assert [row.replace("°", "d") for row in rows] == [
        "     ..%%%%N%%%..     ",
        "   %%%%%   .  %%%%%   ",
        " .%%   . oooo .   %%. ",
        ".%% Moon ooPo   ..+%%.",
        "set .  .      .  .rise",
        "E===   .  80d .   - -W",
        "%%  ==========@  .  %%",
        ".%%  .   . .*** .  %%.",
        " .%%  . .  *Sun*  %%. ",
        "   %%%%   .*****%%%   ",
        "     .%%%%S%%%%%.     ",
    ]


def test_what_is_not_there_is_not_drawn() -> None:
    bare = told(
        horizon=(),
        floor_altitude_deg=0.0,
        keyhole_deg=None,
        sun=(SkyPoint(UTC_S, -20.0, 200.0),),
        moon=(),
        path=(),
    )
    rows = drawn(bare, plain=True)
    assert not set("%*ox=-~") & set("".join(rows).replace("Moon", ""))
    for name in ("Sun", "Moon", "rise", "set", "P"):
        assert name not in "\n".join(rows)
    assert "".join(rows).count("@") == 1


def test_a_sun_that_has_just_set_still_shows_the_part_of_its_cone_that_is_up() -> None:
    low = told(sun=(SkyPoint(UTC_S, -5.0, 200.0),), horizon=(), floor_altitude_deg=0.0)
    text = "\n".join(drawn(low, plain=True))
    assert "*" in text
    assert "Sun" not in text


def test_a_cone_about_the_moon_is_drawn_where_one_is_kept() -> None:
    assert "~" not in "".join(drawn(NOW, plain=True))
    assert "~" in "".join(drawn(told(moon_cone_deg=10.0), plain=True))


def test_the_keyhole_is_as_wide_as_it_is_and_lies_about_the_pole_that_is_up() -> None:
    wide = drawn(told(keyhole_deg=20.0, moon=()), 80, 40, plain=True)
    rows = [number for number, row in enumerate(wide) if "oo" in row]
    # Through the zenith it is true to scale: 40 degrees of the 180 that 40 rows show, a row more or less.
    assert max(rows) - min(rows) == pytest.approx(40.0 / 180.0 * 40.0, abs=1.0)
    south = drawn(told(latitude_deg=-50.0), 80, 40)
    assert next(number for number, row in enumerate(south) if "pole" in row) > 20
    north = drawn(NOW, 80, 40)
    assert next(number for number, row in enumerate(north) if "pole" in row) < 20


def test_what_was_flown_is_told_from_what_is_to_come() -> None:
    def lines(utc_s: float) -> tuple[int, int]:
        text = "".join(drawn(ChartedSky(SKY, utc_s, NOW.satellite, None), plain=True))
        return text.count("-"), text.count("=")

    before, after = lines(SKY.path[0].utc_s - 1.0), lines(SKY.path[-1].utc_s + 1.0)
    assert before[0] == 0
    assert before[1] > 10
    assert after[0] > 3
    assert after[1] == 0


def test_a_mount_on_the_satellite_shares_its_mark_and_one_below_the_horizon_has_none() -> None:
    on = "".join(drawn(ChartedSky(SKY, UTC_S, NOW.satellite, NOW.satellite)))
    assert (on.count(BOTH), on.count(SATELLITE), on.count(MOUNT)) == (1, 0, 0)
    down = "".join(drawn(ChartedSky(SKY, UTC_S, NOW.satellite, SkySpot(-5.0, 100.0))))
    assert (down.count(SATELLITE), down.count(MOUNT)) == (1, 0)
    away = "".join(drawn(NOW))
    assert (away.count(SATELLITE), away.count(MOUNT)) == (1, 1)


def test_a_larger_chart_gives_the_times_of_rise_and_set() -> None:
    text = "\n".join(drawn(NOW, 38, 19))
    for label in ("rise 13:01", "set 13:08", "80°", "pole", "Sun", "Moon"):
        assert label in text
    late = "\n".join(drawn(told(rises=False, sets=False), 38, 19))
    assert "from 13:01" in late
    assert "rise" not in late
    assert "end 13:08" in late


def test_the_notes_tell_the_same_in_words() -> None:
    assert text_of(notes(NOW)) == [
        "● satellite 55.0° up SW 235°",
        "+ mount     20.0° up NW 300°",
        "  rise      10.0° up W  270° 13:01:59",
        "  highest   80.0° up S  180° 13:05:24",
        "  set       10.0° up E   90° 13:08:48",
        "  Sun       30.0° up S  201°  35° away",
        "            cone 15°: not pointed into",
        "  Moon      40.0° up NE  45°  85° away",
        "  pole      65° away, keyhole 10.0°",
        "  skyline   2° to 10°",
        "  floor     5°",
    ]


@pytest.mark.parametrize("size", [(1, 1), (4, 2), (5, 30), (80, 3)])
def test_any_size_of_a_chart_is_survived(size: tuple[int, int]) -> None:
    assert [len(row) for row in drawn(NOW, *size)] == [size[0]] * size[1]


def test_every_kind_of_line_has_its_own_character_without_unicode_but_the_two_cones_of_one_kind() -> None:
    assert len(LAYERS) == len(SkyLayer)
    assert len({layer.plain for layer in LAYERS}) == len(SkyLayer)


def expected(**changes: object) -> ExpectedField:
    found = field_of(msgspec.structs.replace(SKY, **changes), changed(bias_along_s=0.0, bias_cross_deg=0.0))
    assert found is not None
    return found


@pytest.mark.parametrize(
    ("fov_deg", "along", "across", "seen"),
    [
        (0.25, 200.0, 50.0, "inside"),
        (0.25, 224.0, 224.0, "inside"),
        (0.25, 226.0, 50.0, "partly"),
        (0.01, 200.0, 50.0, "outside"),
        (None, 200.0, 50.0, None),
    ],
)
def test_two_sigmas_are_held_against_the_field(
    fov_deg: float | None, along: float, across: float, seen: str | None
) -> None:
    assert expected(fov_deg=fov_deg, along_arcsec=along, across_arcsec=across).seen == seen


def test_offsets_carry_the_field_away_from_where_the_elements_have_it() -> None:
    view = changed(bias_along_s=0.1, bias_cross_deg=0.02)
    found = field_of(SKY, view)
    assert found is not None
    # 0.1 s at half a degree a second, and 0.02 degrees.
    assert (found.offset_along_arcsec, found.offset_across_arcsec) == pytest.approx((180.0, 72.0))
    assert found.seen == "partly"
    assert text_of(field_picture(found, 16, 8, plain=True)) == [
        "                ",
        "      ......... ",
        "     .        . ",
        "   oooooooxoo  .",
        "   oooooooooo ..",
        "     ....   ... ",
        "        ....    ",
        "                ",
    ]


def test_an_error_that_is_not_known_is_not_drawn() -> None:
    assert field_of(None, changed()) is None
    assert field_of(msgspec.structs.replace(SKY, along_arcsec=None), changed()) is None
    assert text_of(field_rows(None)) == ["no error", "known"]
    assert text_of(field_rows(expected())) == ["along", "±400″", "across", "±100″", "field", "15.0′"]
    assert text_of(field_rows(expected(fov_deg=None)))[-1] == "--fov"


def test_the_pass_told_comes_back_from_the_pipe_as_it_was() -> None:
    assert msgspec.json.decode(msgspec.json.encode(SKY), type=PassView) == SKY


@pytest.mark.parametrize("columns", range(4, 60))
def test_the_legend_is_never_cut_within_a_word(columns: int) -> None:
    (text,) = text_of([legend(columns)])

    assert len(text) <= columns
    assert text in {"", *(f" ● satellite  + mount{side}" for side in ("", "  E is left", "  east is left"))}
    assert ("east is left" in text) == (columns >= 35)
