"""Tables of where something is or is seen: CSV of time with az/alt, RA/Dec, or latitude/longitude/height.

The first line that is no comment names the columns, the time first: `utc` (ISO 8601) or `t_s` (seconds from
T0). Comments before it say more: `# name: Balloon 7`, `# frame: of_date` (RA/Dec are ICRS without), `# gap_s:
60`, `# sigma_m: 30`. Rows become places fixed to the Earth, with the velocities that the rows tell: degree 7
and velocities by seven rows where no step is three times another, else degree 3 by three; both without a jump
in rate. Directions hold for one site, and are of light as it arrives, without air.
"""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, NamedTuple

import erfa
import numpy as np

from tle.earth import EarthOrientation, to_tirs, turned
from tle.ephemeris import Frame, Interpolation, Segment, TableEphemeris
from tle.errors import TleError, printable
from tle.formats.rows import Lines, tai_s
from tle.instants import ARRAYS, DAY_S, MJD_JD, TT_MINUS_TAI_S, UNIX_EPOCH_MJD, Utc, leaps_s, utc_of_tai
from tle.sun import LIGHT_KM_S

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tle.site import Site

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]

_COLUMNS = {
    ("lat_deg", "lon_deg", "height_m"): (90.0, 360.0, 1e8),
    ("alt_deg", "az_deg"): (90.0, 360.0),
    ("dec_deg", "ra_deg"): (90.0, 360.0),
}
"""What rows may give, and the largest values."""
_FRAMES = ("icrs", "of_date")
# A direction has no distance. This one is short for light, and long for the rounding of places.
_NEAR_KM = 10.0
_LIGHT_TIME_S = _NEAR_KM / LIGHT_KM_S
# Directions among the stars turn with the sky against the Earth: rows are put in between, no further apart.
_STEP_S = 60.0
_GAP_STEPS = 10.0
_STENCIL = 7
_ALIKE = 3.0
_EVEN = 1e-6
# So few rows stay in the processor's cache.
_AT_ONCE = 5000
_KNOT_DAYS = 1.0 / 24.0


class _Jump(NamedTuple):
    """What rows of places (km) or directions (radians) may do."""

    aside: float
    """A row that is less far from where others lead is not judged."""
    back: tuple[float, float]
    """What goes there and back between rows is no faster a second: what is slow itself, and what is fast."""
    once: float
    """What goes from one row to the next is no faster a second, unless others about them do the like."""
    angular: bool

    def shown(self, far: float) -> str:
        """Return a distance for a reader."""
        if self.angular:
            return f"{math.degrees(2.0 * math.asin(min(0.5 * far, 1.0))):.3g}°"
        return f"{far:.3g} km" if far < 1000.0 else f"{far:.0f} km"


_PLACES = _Jump(2.0, (0.2, 1.0), 20.0, False)
_DEGREE = math.radians(1.0)
_DIRECTIONS = _Jump(5.0 * _DEGREE, (0.5 * _DEGREE, _DEGREE), 20.0 * _DEGREE, True)
# So many times what a table does most of the time is not usual. Without a wrong row those about it agree so
# much better; and what is fast only once is so many times faster than its neighbours.
_USUAL_TIMES, _AGREE, _CALM = 3.0, 0.2, 10.0


_TO_BLANKS = bytes.maketrans(b',"', b"  ")


class _Header(NamedTuple):
    line: int
    """Of the names of the columns, from 0."""
    columns: list[str]
    notes: dict[str, tuple[str, int]]
    """What comments give, with their lines."""


def recognised(lines: Lines) -> bool:
    """Tell whether a text begins as such a table does."""
    return _header(lines) is not None


def is_relative(lines: Lines) -> bool:
    """Tell whether a text is such a table, its times counted from T0."""
    header = _header(lines)
    return header is not None and header.columns[0] == "t_s"


def _header(lines: Lines) -> _Header | None:
    notes: dict[str, tuple[str, int]] = {}
    for line in range(min(len(lines), 200)):
        text = lines.text(line).removeprefix("\ufeff")
        if text.startswith("#"):
            key, _, value = text.lstrip("# ").partition(":")
            notes[key.strip().casefold()] = value.strip(), line
        elif text:
            columns = [word.strip(' "').casefold() for word in text.split(",")]
            return _Header(line, columns, notes) if columns[0] in ("utc", "t_s") else None
    return None


def parse_track(lines: Lines, site: Site | None = None, t0: Utc | None = None) -> list[TableEphemeris]:
    """Return what a table gives, as seen from a site, its T0 being `t0`. Raises EphemerisError."""
    header = _header(lines)
    assert header is not None
    kind = next((kind for kind in _COLUMNS if set(kind) <= set(header.columns)), None)
    if kind is None:
        names = "; ".join(",".join(sorted(one)) for one in _COLUMNS)
        raise lines.error(header.line, f"its columns are none of {names}: name them after utc or t_s")
    if len(kind) == 2 and site is None:
        raise lines.error(header.line, "directions hold for one site: give --site")
    relative = header.columns[0] == "t_s"
    if relative and t0 is None:
        t0 = _noted_t0(lines, header)
    if not relative and t0 is not None:
        raise lines.error(header.line, "its times are UTC: --t0 goes with a table whose first column is t_s")
    rows = np.arange(header.line + 1, lines.last + 1)
    rows = rows[(lines.first_bytes[rows] != 0) & (lines.first_bytes[rows] != ord("#"))]
    if len(rows) < 2:
        raise lines.error(header.line, "it has not two rows: nothing to interpolate")
    plain = Lines(lines.data.translate(_TO_BLANKS), lines.source)
    zero_s, since_s, values = _rows(plain, rows, header.columns, t0)
    plain.check_end(rows)
    wrong = np.flatnonzero(np.diff(since_s) <= 0.0)
    if len(wrong):
        raise lines.error(int(rows[wrong[0] + 1]), "its time is not after that of the row before it")
    chosen = [values[:, header.columns.index(name) - 1] for name in kind]
    for name, column, most in zip(kind, chosen, _COLUMNS[kind], strict=True):
        bad = np.flatnonzero(np.abs(column) > most)
        if len(bad):
            raise lines.error(int(rows[bad[0]]), f"{name} is {column[bad[0]]:g}: {most:g} is the most")
    gap_s = _noted(lines, header, "gap_s", _GAP_STEPS * float(np.median(np.diff(since_s))))
    sigma_m = _noted(lines, header, "sigma_m", 0.0)
    frame, frame_line = header.notes.get("frame", (_FRAMES[0], 0))
    frame = frame.casefold()
    if frame not in _FRAMES:
        raise lines.error(frame_line, f"frame {printable(frame)!r} is not known: icrs or of_date")
    cuts = np.flatnonzero(np.diff(since_s) > gap_s) + 1
    segments = []
    for part in np.split(np.arange(len(rows)), cuts):
        if len(part) > 1:
            track = _Track(zero_s, since_s[part], np.stack([column[part] for column in chosen]))
            segments.append(_segment(lines, rows[part], track, kind, frame, site))
    if not segments:
        raise lines.error(header.line, f"no two rows are nearer than {gap_s:g} s: say more by # gap_s")
    name = (
        header.notes.get("name", ("", 0))[0]
        or re.sub(r"\.[^.]*$", "", lines.source.rpartition("/")[2])
        or "track"
    )
    words = segments[0].interpolation.words
    found = TableEphemeris(
        printable(name),
        segments,
        f"table of {', '.join(sorted(kind))}, {words}",
        epoch=utc_of_tai(zero_s, float(since_s[0])),
        source=lines.source,
        sigma_km=sigma_m / 1000.0 or None,
    )
    found.t0 = t0
    return [found]


def _noted(lines: Lines, header: _Header, key: str, default: float) -> float:
    """Return a number that a comment gives, positive."""
    text, line = header.notes.get(key, (None, 0))
    if text is None:
        return default
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 < value < float("inf"):
        raise lines.error(line, f"# {key}: {printable(text)}: give a number above 0")
    return value


def _noted_t0(lines: Lines, header: _Header) -> Utc:
    if "t0" not in header.notes:
        raise lines.error(
            header.line,
            "its times count from T0: write # t0: UTC above this line, or give --t0 UTC (not for a schedule)",
        )
    text, line = header.notes["t0"]
    try:
        return Utc.parse(text)
    except TleError as error:
        raise lines.error(line, f"# t0: {error}") from None


def _rows(lines: Lines, rows: Index, columns: list[str], t0: Utc | None) -> tuple[float, Array, Array]:
    """Return a zero (TAI, POSIX seconds), seconds after it, and the other columns, shape (n, k)."""
    if columns[0] == "utc":
        days, seconds = lines.take_stamps(rows)
        zero_s, since_s = tai_s("UTC", days, seconds)
        return zero_s, since_s, lines.numbers(rows, len(columns) - 1, "a row")
    assert t0 is not None
    values = lines.numbers(rows, len(columns), "a row")
    unix_s = float(t0.unix_s)
    return unix_s + float(leaps_s(unix_s)), values[:, 0], values[:, 1:]


class _Track(NamedTuple):
    """Rows without a gap: seconds after a zero (TAI), shape (n,), and what they give, shape (2 or 3, n)."""

    zero_s: float
    since_s: Array
    values: Array

    def part(self, first: int, stop: int) -> _Track:
        """Return some of the rows."""
        return _Track(self.zero_s, self.since_s[first:stop], self.values[:, first:stop])

    def unix_s(self, since_s: Array) -> Array:
        """Return POSIX seconds of UTC."""
        tai = self.zero_s + since_s
        unix_s: Array = tai - leaps_s(tai - leaps_s(tai))
        return unix_s


def _segment(
    lines: Lines, rows: Index, track: _Track, kind: tuple[str, ...], frame: str, site: Site | None
) -> Segment:
    """Return rows, by their lines, as places fixed to the Earth, with velocities."""
    since_s, line = track.since_s, lines.number(int(rows[0]))
    first, second = np.radians(track.values[:2])
    if kind[0] == "lat_deg":
        places = erfa.gd2gc(1, second, first, track.values[2]) / 1000.0
        _check_jumps(lines, rows, since_s, places, _PLACES)
        return curve(track.zero_s, since_s, places, Frame("GROUND", "WGS 84"), line)
    assert site is not None
    level = np.cos(first)
    u = np.stack([level * np.sin(second), level * np.cos(second), np.sin(first)], axis=1)
    _check_jumps(lines, rows, since_s, u, _DIRECTIONS)
    if kind[0] == "dec_deg":
        return _of_the_sky(track, frame, site, line)
    places = np.array(site.itrs_km) + _NEAR_KM * u @ np.array([site.east, site.north, site.up])
    return curve(track.zero_s, since_s, places, Frame("SIGHT", "horizon"), line)


def _check_jumps(lines: Lines, rows: Index, since_s: Array, places: Array, most: _Jump) -> None:
    """Refuse a row that its neighbours leave out, and a step that nothing makes. Raises EphemerisError."""
    steps = np.diff(since_s)
    moved = np.linalg.norm(np.diff(places, axis=0), axis=1)
    rates = moved / steps
    usual = _USUAL_TIMES * float(np.quantile(rates, 0.75))
    back = float(np.clip(usual, *most.back))
    fast = (rates > back) & (moved > 0.5 * most.aside)
    k = np.flatnonzero(fast[1:] & fast[:-1]) + 1
    off = _missed(since_s, places, k - 1, k, k + 1)
    # Those about it must agree without it; where there are no two of them on a side, the other one tells.
    left = np.where(k > 1, _missed(since_s, places, np.maximum(k - 2, 0), k - 1, k + 1), 0.0)
    last = len(rows) - 1
    right = np.where(k < last - 1, _missed(since_s, places, k - 1, k + 1, np.minimum(k + 2, last)), 0.0)
    least = np.maximum(most.aside, back * np.minimum(steps[k - 1], steps[k]))
    wrong = np.flatnonzero((off > least) & (np.maximum(left, right) < _AGREE * off) & (len(rows) > 3))
    if len(wrong):
        raise lines.error(
            int(rows[k[wrong[0]]]),
            f"this row is {most.shown(float(off[wrong[0]]))} from where the rows before and after it "
            "lead: a digit, a sign or a decimal point is wrong: correct it, or leave the row out",
        )
    about = np.maximum(np.append(0.0, rates[:-1]), np.append(rates[1:], 0.0))
    wrong = np.flatnonzero((rates > np.maximum(most.once, _CALM * about)) & (moved > most.aside) & (last > 1))
    if len(wrong):
        first = int(wrong[0])
        raise lines.error(
            int(rows[first + 1]),
            f"this row is {most.shown(float(moved[first]))} from the row {steps[first]:g} s before: "
            "one of them has a wrong digit, sign or decimal point: correct it, or leave it out",
        )


def _missed(since_s: Array, places: Array, before: Index, row: Index, after: Index) -> Array:
    """Return how far rows are from the straight lines between two others, shape (n,)."""
    span = since_s[after] - since_s[before]
    share = ((since_s[row] - since_s[before]) / np.where(span > 0.0, span, 1.0))[:, None]
    missed: Array = np.linalg.norm(
        places[row] - (1.0 - share) * places[before] - share * places[after], axis=1
    )
    return missed


def curve(zero_s: float, since_s: Array, places: Array, frame: Frame, line: int) -> Segment:
    """Return rows with the velocities that they tell: no piece of the curve jumps in rate."""
    steps = np.diff(since_s)
    alike = len(since_s) >= _STENCIL and float(steps.max()) < _ALIKE * float(steps.min())
    slopes = _slopes(since_s, places, _STENCIL if alike else min(3, len(since_s)))
    interpolation = Interpolation(4 if alike else 2, True)
    use = float(since_s[0]), float(since_s[-1])
    if frame.kind == "SIGHT":
        since_s = since_s - _LIGHT_TIME_S
    return Segment(zero_s, since_s, places, slopes, frame, interpolation, use, line)


def _slopes(since_s: Array, places: Array, count: int) -> Array:
    """Return derivatives of polynomials through so many rows each, about the row but for the ends."""
    rows, middle = len(since_s), count // 2
    slopes = np.empty_like(places)
    last = rows - count
    for first in range(0, last + 1, _AT_ONCE):
        stop = min(first + _AT_ONCE, last + 1)
        slopes[first + middle : stop + middle] = _slopes_of(since_s, places, (first, stop), count, middle)
    for own in range(middle):
        slopes[own : own + 1] = _slopes_of(since_s, places, (0, 1), count, own)
    for own in range(middle + 1, count):
        slopes[last + own : last + own + 1] = _slopes_of(since_s, places, (last, last + 1), count, own)
    return slopes


def _slopes_of(since_s: Array, places: Array, firsts: tuple[int, int], count: int, own: int) -> Array:
    """Return derivatives at row `own` of polynomials through `count` rows from each of `firsts` on.

    By Lagrange's polynomials in their barycentric form.
    """
    first, stop = firsts
    at_s = [since_s[first + k : stop + k] for k in range(count)]
    away_s = [[one - other for other in at_s] for one in at_s]
    shares = [1.0 / math.prod(away_s[k][j] for j in range(count) if j != k) for k in range(count)]
    here = places[first + own : stop + own]
    slopes = np.zeros_like(here)
    for k in range(count):
        if k != own:
            weight = shares[k] / (shares[own] * away_s[own][k])
            slopes += weight[:, None] * (places[first + k : stop + k] - here)
    return slopes


def _of_the_sky(track: _Track, frame: str, site: Site, line: int) -> Segment:
    """Return right ascensions and declinations as places near the site, a row a minute at least."""
    if frame == "icrs":
        parts = [track.part(k, k + _AT_ONCE) for k in range(0, len(track.since_s), _AT_ONCE)]
        ra, dec = np.concatenate([_seen(part, site) for part in parts], axis=1)
    else:
        dec, ra = np.radians(track.values)
    u = np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)], axis=1)
    kind = Frame("GCRF", "ICRS") if frame == "icrs" else Frame("TOD", "of date")
    since_s, steps = track.since_s, np.diff(track.since_s)
    # Steps that are even but for rounding are divided alike.
    counts = np.ceil(steps / _STEP_S * (1.0 - _EVEN)).astype(np.intp)
    if counts.max() > 1:
        among_stars = curve(track.zero_s, since_s, u, kind, line)
        part = np.concatenate([np.arange(count) / count for count in counts.tolist()])
        since_s = np.append(np.repeat(since_s[:-1], counts) + part * np.repeat(steps, counts), since_s[-1])
        u = among_stars.native_many(since_s)[:3].T
    unix_s = track.unix_s(since_s)
    some = [slice(k, k + _AT_ONCE) for k in range(0, len(u), _AT_ONCE)]
    toward = np.concatenate([_to_ground(kind, unix_s[part], u[part]) for part in some])
    places = np.array(site.itrs_km) + _NEAR_KM * toward
    return curve(track.zero_s, since_s, places, Frame("SIGHT", kind.written), line)


def _to_ground(kind: Frame, unix_s: Array, u: Array) -> Array:
    """Return directions of a frame in the ITRS, shape (n, 3)."""
    earth = EarthOrientation.installed()
    x, y, z = kind.to_teme(earth, unix_s, (*u.T, *np.zeros((6, len(u)))), ARRAYS)[:3]
    theta, _, _, _, xp, yp = earth.rotation(unix_s)
    # Poles turned the other way lead from the TIRS to the ITRS.
    return np.stack(to_tirs(turned((x, y, z), -theta), -xp, -yp), axis=1)


def _seen(track: _Track, site: Site) -> tuple[Array, Array]:
    """Return directions of the ICRS as light arrives, bent by the Sun and aberrated, in the GCRS's axes."""
    unix_s = track.unix_s(track.since_s)
    earth = EarthOrientation.installed()
    days = np.floor(unix_s / DAY_S)
    tt = (unix_s - days * DAY_S + leaps_s(unix_s) + TT_MINUS_TAI_S) / DAY_S
    julian = days + UNIX_EPOCH_MJD + MJD_JD
    # Over a year the axes turn by 50″: of the site's own aberration, 0.3″, that is nothing.
    matrix = earth.celestial_matrix(Utc(0.5 * float(unix_s[0] + unix_s[-1])))
    still = [np.full(len(unix_s), k) for k in (*site.itrs_km, *np.zeros(6))]
    moving = Frame("ITRF", "ITRF").to_teme(earth, unix_s, tuple(still), ARRAYS)
    equinoxes = earth.rotation(unix_s)[2]
    c, s = np.cos(equinoxes), np.sin(equinoxes)
    pv = np.zeros(len(unix_s), dtype=erfa.dt_pv)
    for name, (x, y, z) in (("p", moving[:3]), ("v", moving[3:6])):
        of_date = np.stack([x * c - y * s, x * s + y * c, z], axis=1)
        pv[name] = of_date @ matrix * 1000.0
    from_sun, from_barycentre = _earth(julian, tt)
    astrometry = erfa.apcs(julian, tt, pv, from_barycentre, from_sun["p"])
    dec, ra = np.radians(track.values)
    seen: tuple[Array, Array] = erfa.atciqz(ra, dec, astrometry)
    return seen


def _earth(julian: Array, tt: Array) -> list[NDArray[np.void]]:
    """Return the Earth's places (au) and velocities (au/day) from the Sun and from the barycentre.

    ERFA takes 40 µs for one: many rows lie on lines between those of hours, to 1e-5″ of aberration.
    """
    days = (julian - julian[0]) + tt
    knots = np.arange(math.floor(days[0] / _KNOT_DAYS), math.ceil(days[-1] / _KNOT_DAYS) + 1) * _KNOT_DAYS
    if len(knots) > len(days):
        return list(erfa.epv00(julian, tt))
    between = []
    for pv in erfa.epv00(julian[0], knots):
        state = np.zeros(len(days), dtype=erfa.dt_pv)
        for part in ("p", "v"):
            for axis in range(3):
                state[part][:, axis] = np.interp(days, knots, pv[part][:, axis])
        between.append(state)
    return between
