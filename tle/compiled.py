"""The search for passes compiled by numba: the same steps as `gate` and `arcs`, object by object.

What decides (bounds, tolerances) comes from those modules as arguments; their proofs hold here too. Importing
this module needs numba. Machine code is kept in the folder of `compiled_cache`; where nothing can be written,
each process compiles anew.

Everything travels as rows of numbers, which compiled code takes fastest: an orbit is a row of the columns of
`near_earth.NearEarth`, a gate one of `gate.Gate` and whether the orbit is about round, an arc its head
(below) and the coefficients of east, north and up.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple, ParamSpec, TypeVar

import numpy as np
from numba import config, njit

from tle.compiled_cache import cache_folder
from tle.ground import EVEN_TURN_RAD_S
from tle.near_earth import RADIUS_KM, NearEarth

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

P = ParamSpec("P")
R = TypeVar("R")

_AT = {name: number for number, name in enumerate(NearEarth._fields)}
_EPOCH, _ECCO, _ARGPO, _NODEO, _MO = (_AT[k] for k in ("epoch_s", "ecco", "argpo", "nodeo", "mo"))
_BSTAR, _NO, _AO, _COSIO, _SINIO = (_AT[k] for k in ("bstar", "no", "ao", "cosio", "sinio"))
_CON41, _X1MTH2, _X7THM1 = (_AT[k] for k in ("con41", "x1mth2", "x7thm1"))
_MDOT, _ARGPDOT, _NODEDOT, _NODECF = (_AT[k] for k in ("mdot", "argpdot", "nodedot", "nodecf"))
_ETA, _CC1, _CC4, _CC5 = (_AT[k] for k in ("eta", "cc1", "cc4", "cc5"))
_D2, _D3, _D4 = (_AT[k] for k in ("d2", "d3", "d4"))
_T2, _T3, _T4, _T5 = (_AT[k] for k in ("t2cof", "t3cof", "t4cof", "t5cof"))
_OMGCOF, _XMCOF, _DELMO, _SINMAO = (_AT[k] for k in ("omgcof", "xmcof", "delmo", "sinmao"))
_XLCOF, _AYCOF = _AT["xlcof"], _AT["aycof"]
_COUNT, _STEP, _PLANE, _ROUND, _MARGIN, _BEND, _REACH, _SWAY, _IS_ROUND = range(9)
# The head of an arc's row; coefficients of three axes follow.
OBJ, WINDOW, MID, HALF, SPEED, BOW, HEAD = range(7)
_J2 = 0.001082616
# Taylor's coefficients of sin y / y - 1 and cos y - 1 in powers of y², enough up to an eighth of a turn.
_S = tuple((-1.0) ** k / math.factorial(2 * k + 1) for k in range(1, 9))
_C = tuple((-1.0) ** k / math.factorial(2 * k) for k in range(1, 9))
_EXACT_RAD, _ROUGH_RAD, _MOST_STEPS, _LONGEST_STEP_RAD = 1e-8, 5e-3, 12, 0.95


class Place(NamedTuple):
    """A site on the turning Earth, as `ground.Ground` has it.

    `knots` has rows of POSIX seconds, the Earth's turn less the even one, and the pole's x and y (rad);
    `frame` the rows place (km), east, north, up and direction; `turn_rad` is the Earth's turn at the first
    knot as a gate may take it.
    """

    knots: Array
    frame: Array
    turn_rad: float


class Fit(NamedTuple):
    """What `arcs.Basis` has, for one point and one Chebyshev coefficient after the other (rows)."""

    nodes: Array
    from_values: Array
    to_powers: Array
    slope: Array
    bend: Array


class Rules(NamedTuple):
    """The sine of the least altitude; what `arcs` allows fits (km, rad, s, times), `crossings` looks (s)."""

    sine: float
    fit_km: float
    fit_rad: float
    shortest_s: float
    halvings: float
    sure_s: float
    close_s: float


_RULES: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract"}}
_LEAF: dict[str, Any] = {**_RULES, "_nrt": False, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def leaf(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function that only other compiled ones call and that makes no arrays.

    Without numba's counting of references, which takes longer than what is done here. Whoever makes arrays
    must be a `kernel`.
    """
    made: Callable[P, R] = njit(**_LEAF)(function)
    return made


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function that is called from outside, and keep its machine code where there is a folder."""
    folder = cache_folder()
    if folder is None:
        made: Callable[P, R] = njit(**_RULES)(function)
        return made
    settings: Any = config
    others = settings.CACHE_DIR
    settings.CACHE_DIR = str(folder)
    try:
        made = njit(cache=True, **_RULES)(function)
    finally:
        settings.CACHE_DIR = others
    return made


@kernel
def grown(rows: Array) -> Array:
    """Return rows with as much room again."""
    more = np.empty((2 * rows.shape[0], rows.shape[1]))
    for k in range(rows.shape[0]):
        for n in range(rows.shape[1]):
            more[k, n] = rows[k, n]
    return more


@leaf
def _turned(x: float) -> tuple[float, float]:
    """Return cosine and sine of an angle within some 100,000 turns, to rounding."""
    quarter = math.floor(x * (2.0 / math.pi) + 0.5)
    y = (x - quarter * 1.5707963267948966) - quarter * 6.123233995736766e-17
    z = y * y
    s = _S[3] + z * (_S[4] + z * (_S[5] + z * (_S[6] + z * _S[7])))
    s = y + y * z * (_S[0] + z * (_S[1] + z * (_S[2] + z * s)))
    c = _C[4] + z * (_C[5] + z * (_C[6] + z * _C[7]))
    c = 1.0 + z * (_C[0] + z * (_C[1] + z * (_C[2] + z * (_C[3] + z * c))))
    q = int(quarter) & 3
    if q == 1:
        return -s, c
    if q == 2:
        return -c, -s
    if q == 3:
        return s, -c
    return c, s


@leaf
def _turned_little(x: float) -> tuple[float, float]:
    """Return cosine and sine of an angle of some thousandths: the next terms are below 1e-13."""
    return 1.0 - 0.5 * x * x, x * (1.0 - x * x * (1.0 / 6.0))


@leaf
def _mean_orbit(o: Array, i: int, t: float) -> tuple[float, float, float, float, float]:
    """Return semi-major axis, eccentricity vector, longitude and node; see `near_earth.mean_orbit`."""
    xmdf = o[i, _MO] + o[i, _MDOT] * t
    wobble = o[i, _OMGCOF] * t
    if o[i, _XMCOF] != 0.0:
        wobble += o[i, _XMCOF] * ((1.0 + o[i, _ETA] * _turned(xmdf)[0]) ** 3 - o[i, _DELMO])
    mean = xmdf + wobble
    argp = o[i, _ARGPO] + o[i, _ARGPDOT] * t - wobble
    tempa = 1.0 - t * (o[i, _CC1] + t * (o[i, _D2] + t * (o[i, _D3] + t * o[i, _D4])))
    em = o[i, _ECCO] - o[i, _BSTAR] * o[i, _CC4] * t
    if o[i, _CC5] != 0.0:
        em -= o[i, _BSTAR] * o[i, _CC5] * (_turned(mean)[1] - o[i, _SINMAO])
    em = max(em, 1.0e-6) if -0.001 <= em < 1.0 else math.nan
    am = o[i, _AO] * tempa * tempa
    templ = t * t * (o[i, _T2] + t * (o[i, _T3] + t * (o[i, _T4] + t * o[i, _T5])))
    cos, sin = _turned(argp)
    axn = em * cos
    temp = 1.0 / (am * (1.0 - em * em))
    ayn = em * sin + temp * o[i, _AYCOF]
    node = o[i, _NODEO] + t * (o[i, _NODEDOT] + o[i, _NODECF] * t)
    return am, axn, ayn, mean + o[i, _NO] * templ + argp + temp * o[i, _XLCOF] * axn, node


@leaf
def _in_plane(a: float, axn: float, ayn: float, u: float, enough: float) -> tuple[float, float, float]:
    """Return cos u, sin u and radius; see `near_earth.in_plane`."""
    if not abs(u) < 1e12:
        return math.nan, math.nan, math.nan
    eo = u
    c, s = _turned(eo)
    for _ in range(_MOST_STEPS):
        step = (u - ayn * c + axn * s - eo) / (1.0 - c * axn - s * ayn)
        step = min(max(step, -_LONGEST_STEP_RAD), _LONGEST_STEP_RAD)
        eo += step
        if abs(step) < 1e-3:
            cos, sin = _turned_little(step)
            c, s = c * cos - s * sin, s * cos + c * sin
        else:
            c, s = _turned(eo)
        if not abs(step) >= enough:
            break
    ecos, esin = axn * c + ayn * s, axn * s - ayn * c
    radius = a * (1.0 - ecos)
    temp = esin / (1.0 + math.sqrt(1.0 - (axn * axn + ayn * ayn)))
    scale = a / radius
    return scale * (c - axn + ayn * temp), scale * (s - ayn - axn * temp), radius


@leaf
def _east_north_up(o: Array, i: int, place: Place, unix_s: float) -> tuple[float, float, float]:
    """Return where SGP4 has an object, relative to the site, km; NaN where it fails.

    See `near_earth.teme_km` and `ground.Ground.east_north_up`.
    """
    a, axn, ayn, longitude, node = _mean_orbit(o, i, (unix_s - o[i, _EPOCH]) / 60.0)
    cosu, sinu, radius = _in_plane(a, axn, ayn, longitude, _EXACT_RAD)
    beta2 = 1.0 - (axn * axn + ayn * ayn)
    sin2u, cos2u = 2.0 * sinu * cosu, 1.0 - 2.0 * sinu * sinu
    temp = 1.0 / (a * beta2)
    temp1 = 0.5 * _J2 * temp
    temp2 = temp1 * temp
    r = radius * (1.0 - 1.5 * temp2 * math.sqrt(beta2) * o[i, _CON41]) + 0.5 * temp1 * o[i, _X1MTH2] * cos2u
    r = r * RADIUS_KM if r >= 1.0 else math.nan
    ct, st = _turned_little(-0.25 * temp2 * o[i, _X7THM1] * sin2u)
    cosu, sinu = (cosu * ct - sinu * st) * r, (sinu * ct + cosu * st) * r
    cd, sd = _turned_little(1.5 * temp2 * o[i, _COSIO] * o[i, _SINIO] * cos2u)
    across = sinu * (o[i, _COSIO] * cd - o[i, _SINIO] * sd)
    z = sinu * (o[i, _SINIO] * cd + o[i, _COSIO] * sd)
    knots, f = place.knots, place.frame
    k = 0
    while k < len(knots) - 2 and unix_s >= knots[k + 1, 0]:
        k += 1
    part = min(max((unix_s - knots[k, 0]) / (knots[k + 1, 0] - knots[k, 0]), 0.0), 1.0)
    # The node as seen from the turning Earth.
    node += 1.5 * temp2 * o[i, _COSIO] * sin2u
    node -= (unix_s - knots[0, 0]) * EVEN_TURN_RAD_S + knots[k, 1] + part * (knots[k + 1, 1] - knots[k, 1])
    cn, sn = _turned(node)
    x, y = cosu * cn - across * sn, cosu * sn + across * cn
    xp = knots[k, 2] + part * (knots[k + 1, 2] - knots[k, 2])
    yp = knots[k, 3] + part * (knots[k + 1, 3] - knots[k, 3])
    x, y, z = x + xp * z - f[0, 0], y - yp * z - f[0, 1], z - xp * x + yp * y - f[0, 2]
    return (
        x * f[1, 0] + y * f[1, 1] + z * f[1, 2],
        x * f[2, 0] + y * f[2, 1] + z * f[2, 2],
        x * f[3, 0] + y * f[3, 1] + z * f[3, 2],
    )


@leaf
def _rough_height(o: Array, i: int, place: Place, unix_s: float, sine: float) -> float:
    """Return z, km, of the mean orbit; see `gate._Rough`."""
    a, axn, ayn, longitude, node = _mean_orbit(o, i, (unix_s - o[i, _EPOCH]) / 60.0)
    cosu, sinu, radius = _in_plane(a, axn, ayn, longitude, _ROUGH_RAD)
    cn, sn = _turned(node - place.turn_rad - (unix_s - place.knots[0, 0]) * EVEN_TURN_RAD_S)
    radius *= RADIUS_KM
    cosu, sinu = cosu * radius, sinu * radius
    across = sinu * o[i, _COSIO]
    f = place.frame
    x = cosu * cn - across * sn - f[0, 0]
    y = cosu * sn + across * cn - f[0, 1]
    z = sinu * o[i, _SINIO] - f[0, 2]
    up: float = x * f[3, 0] + y * f[3, 1] + z * f[3, 2]
    return up - sine * math.sqrt(x * x + y * y + z * z)


@leaf
def may_exceed(limit: float, z0: float, z1: float, bend: float, span_s: float) -> bool:
    """Tell whether a parabola through both ends rises above a limit; see `crossings.highest_between`."""
    if z0 > limit or z1 > limit:
        return True
    bow = 0.5 * bend * span_s * span_s
    rise = z1 - z0
    if abs(rise) >= bow:
        return False
    return 0.5 * (z0 + z1) + 0.25 * bow + 0.25 * rise * rise / max(bow, 1e-300) > limit


@leaf
def _site_from(o: Array, i: int, longitude: Array, place: Place, unix_s: float) -> tuple[float, ...]:
    """Return the site's direction: along the orbit's node, 90° on, and over the plane; the mean longitude."""
    t = (unix_s - o[i, _EPOCH]) * (1.0 / 60.0)
    turn = place.turn_rad + (unix_s - place.knots[0, 0]) * EVEN_TURN_RAD_S
    cos, sin = _turned(turn - o[i, _NODEO] - t * (o[i, _NODEDOT] + o[i, _NODECF] * t))
    px, py, pz = place.frame[4, 0], place.frame[4, 1], place.frame[4, 2]
    across = px * sin + py * cos
    mean = longitude[i, 5]
    for power in range(4, -1, -1):
        mean = mean * t + longitude[i, power]
    over = o[i, _COSIO] * pz - o[i, _SINIO] * across
    return px * cos - py * sin, o[i, _COSIO] * across + o[i, _SINIO] * pz, over, mean


@leaf
def _may_be_near(o: Array, i: int, gate: Array, longitude: Array, place: Place, unix_s: float) -> bool:
    """Tell whether an object may stand near enough to the site in the stretch about an instant."""
    along, ahead, over, mean = _site_from(o, i, longitude, place, unix_s)
    if abs(over) > gate[i, _PLANE]:
        return False
    cos, sin = _turned(mean)
    near: bool = along * cos + ahead * sin >= gate[i, _ROUND]
    return near


@leaf
def _when_near(
    o: Array, i: int, gate: Array, longitude: Array, place: Place, at: tuple[float, float], rate: float
) -> tuple[float, float]:
    """Return seconds from an instant to the middle, and half the length, of the time near the site.

    `at` is the instant (POSIX) and for how many seconds about it this must hold, `rate` the mean longitude's
    in rad/s. The site is taken as at rest in the orbit's plane; as far as it may move, the time is longer.
    A negative length means never.
    """
    along, ahead, _, mean = _site_from(o, i, longitude, place, at[0])
    reach = gate[i, _REACH] + gate[i, _SWAY] * at[1]
    if reach >= math.pi / 2.0:
        return 0.0, at[1]
    nearest = math.sqrt(along * along + ahead * ahead)
    cosine = math.cos(reach)
    if nearest <= cosine:
        return 0.0, -1.0
    offset = math.atan2(ahead, along) - mean
    offset -= 2.0 * math.pi * math.floor(offset / (2.0 * math.pi) + 0.5)
    return offset / rate, math.acos(cosine / nearest) / rate


@leaf
def _round_windows(
    o: Array,
    i: int,
    gate: Array,
    longitude: Array,
    place: Place,
    span: tuple[float, float, float],
    found: Array,
    count: int,
) -> int:
    """Join to windows the times at which an object in a round orbit may be near the site; see `_joined`.

    Turn by turn: the time about the turn's middle, then more closely about that time's own middle.
    """
    start_s, span_s, _ = span
    step = gate[i, _STEP]
    for j in range(int(gate[i, _COUNT])):
        low, high = j * step, (j + 1) * step
        middle = 0.5 * (low + high)
        t = (start_s + middle - o[i, _EPOCH]) * (1.0 / 60.0)
        rate = (longitude[i, 1] + 2.0 * longitude[i, 2] * t + 3.0 * longitude[i, 3] * t * t) / 60.0
        offset, half = _when_near(o, i, gate, longitude, place, (start_s + middle, 0.5 * step), rate)
        if half < 0.0:
            continue
        # The nearest time may lie over either end of the turn, and belong to the next one too.
        for side in range(-1, 2):
            about = middle + offset + side * 2.0 * math.pi / rate
            first, last = max(about - half, low), min(about + half, high)
            if not first < last or (side and half >= 0.5 * step):
                continue
            again, less = _when_near(o, i, gate, longitude, place, (start_s + about, half), rate)
            if less < 0.0:
                continue
            first, last = max(about + again - less, first), min(about + again + less, last)
            if first < last:
                count = _joined(found, count, i, max(first, 0.0), min(last, span_s))
                if count < 0:
                    return count
    return count


@leaf
def _joined(found: Array, count: int, i: int, low: float, high: float) -> int:
    """Join a stretch to the last window or put it behind it; return how many there are, -1 without room."""
    if count and found[count - 1, 0] == i and found[count - 1, 2] >= low - 1e-6:
        found[count - 1, 2] = max(found[count - 1, 2], high)
        return count
    if count == len(found):
        return -1
    found[count, 0], found[count, 1], found[count, 2] = i, low, high
    return count + 1


@leaf
def _any_windows(  # noqa: PLR0913, PLR0917 - all is made by the caller, for this makes no arrays
    o: Array,
    i: int,
    gate: Array,
    longitude: Array,
    place: Place,
    span: tuple[float, float, float],
    z: Array,
    found: Array,
    count: int,
) -> int:
    """Join to windows the times at which an object in any orbit may be up; see `_joined`.

    `z` has room for heights at the ends of the parts that a stretch is cut into, two to some power.
    """
    start_s, span_s, sine = span
    parts = len(z) - 1
    known = False
    step, limit, bend = gate[i, _STEP], -gate[i, _MARGIN], gate[i, _BEND]
    stretches = int(gate[i, _COUNT])
    for j in range(stretches):
        if not _may_be_near(o, i, gate, longitude, place, start_s + (j + 0.5) * step):
            known = False
            continue
        low = j * step
        high = span_s if j + 1 == stretches else (j + 1) * step
        z[0] = z[parts] if known else _rough_height(o, i, place, start_s + low, sine)
        z[parts] = _rough_height(o, i, place, start_s + high, sine)
        known = True
        # Halves, quarters...: what is ruled out whole is not looked into.
        n, width = 0, parts
        while n < parts:
            a, b = low + (high - low) * n / parts, low + (high - low) * (n + width) / parts
            if width > 1 and may_exceed(limit, z[n], z[n + width], bend, b - a):
                width //= 2
                z[n + width] = _rough_height(o, i, place, start_s + 0.5 * (a + b), sine)
                continue
            if width == 1 and may_exceed(limit, z[n], z[n + 1], bend, b - a):
                count = _joined(found, count, i, a, high if n + 1 == parts else b)
                if count < 0:
                    return count
            n += width
            while width < parts and n % (2 * width) == 0:
                width *= 2
    return count


@kernel
def windows(
    o: Array, gate: Array, longitude: Array, place: Place, span: tuple[float, float, float], halvings: int
) -> Array:
    """Return rows of object, first and last second: the windows of `gate.possible_windows`.

    Round orbits have one stretch a turn, and windows by their mean longitude alone.
    `longitude` has rows of the powers of `near_earth.mean_longitude`; `span` is its first second, its length
    and the sine of the least altitude.
    """
    found = np.empty((len(gate) + 256, 3))
    z = np.empty((1 << halvings) + 1)
    count, i = 0, 0
    while i < len(gate):
        if gate[i, _IS_ROUND]:
            more = _round_windows(o, i, gate, longitude, place, span, found, count)
        else:
            more = _any_windows(o, i, gate, longitude, place, span, z, found, count)
        if more < 0:
            # Some of this object's windows may be there, and will be written again.
            found = grown(found)
        else:
            count, i = more, i + 1
    return found[:count]


@leaf
def _fit(o: Array, i: int, place: Place, fit: Fit, low: float, high: float, work: Array) -> None:
    """Write the Chebyshev coefficients, shape (3, terms), of an object's way between POSIX seconds."""
    terms = work.shape[1]
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    for term in range(terms):
        work[0, term] = work[1, term] = work[2, term] = 0.0
    for k in range(terms):
        e, n, u = _east_north_up(o, i, place, middle + half * fit.nodes[k])
        for term in range(terms):
            work[0, term] += fit.from_values[k, term] * e
        for term in range(terms):
            work[1, term] += fit.from_values[k, term] * n
        for term in range(terms):
            work[2, term] += fit.from_values[k, term] * u


@leaf
def _largest(work: Array, term: int) -> float:
    largest: float = max(abs(work[0, term]), abs(work[1, term]), abs(work[2, term]))
    return largest


@leaf
def _missed(rules: Rules, work: Array) -> float:
    """Return about what a polynomial misses; see `arcs._missed`."""
    terms = work.shape[1]
    for axis in range(3):
        if not math.isfinite(work[axis, 0]):
            return math.nan
    last = _largest(work, terms - 1) + _largest(work, terms - 2)
    before = _largest(work, terms - 3) + _largest(work, terms - 4)
    following = last * min(last / max(before, 1e-300), 1.0)
    return following / (rules.fit_km + rules.fit_rad * _largest(work, 0))


@leaf
def _write_arc(arcs: Array, k: int, fit: Fit, work: Array, low: float, high: float) -> None:
    """Write all of the row of arc k but object and window."""
    terms = work.shape[1]
    half = 0.5 * (high - low)
    speed, bend = 0.0, 0.0
    for term in range(HEAD, arcs.shape[1]):
        arcs[k, term] = 0.0
    for other in range(terms):
        e, n, u = work[0, other], work[1, other], work[2, other]
        size = math.sqrt(e * e + n * n + u * u)
        speed += size * fit.slope[other]
        bend += size * fit.bend[other]
        for term in range(other + 1):
            arcs[k, HEAD + term] += fit.to_powers[other, term] * e
        for term in range(other + 1):
            arcs[k, HEAD + terms + term] += fit.to_powers[other, term] * n
        for term in range(other + 1):
            arcs[k, HEAD + 2 * terms + term] += fit.to_powers[other, term] * u
    arcs[k, MID], arcs[k, HALF] = 0.5 * (low + high), half
    arcs[k, SPEED], arcs[k, BOW] = speed / half, bend / (half * half)


@kernel
def near_arcs(
    o: Array, place: Place, found: Array, longest_s: Array, start_s: float, fit: Fit, rules: Rules
) -> tuple[Array, Array]:
    """Return rows of arcs that cover windows, and 1 for objects that have none; see `arcs.fit_arcs`.

    `longest_s` is the longest piece of each object.
    """
    terms = len(fit.nodes)
    arcs = np.empty((len(found) + 64, HEAD + 3 * terms))
    work = np.empty((3, terms))
    stack = np.empty((64, 3))
    without = np.zeros(len(longest_s))
    count = 0
    for w in range(len(found)):
        i = int(found[w, 0])
        first, last = found[w, 1], found[w, 2]
        pieces = int(max(math.ceil((last - first) / longest_s[i]), 1.0))
        part = (last - first) / pieces
        for number in range(pieces):
            stack[0, 0] = first + number * part
            stack[0, 1] = last if number + 1 == pieces else first + (number + 1) * part
            stack[0, 2] = 0.0
            waiting = 0 if without[i] else 1
            while waiting:
                waiting -= 1
                low, high, halvings = stack[waiting, 0], stack[waiting, 1], stack[waiting, 2]
                _fit(o, i, place, fit, start_s + low, start_s + high, work)
                off = _missed(rules, work)
                if off <= 1.0:
                    if count == len(arcs):
                        arcs = grown(arcs)
                    arcs[count, OBJ], arcs[count, WINDOW] = i, w
                    _write_arc(arcs, count, fit, work, low, high)
                    count += 1
                elif not math.isfinite(off) or high - low < rules.shortest_s or halvings == rules.halvings:
                    without[i] = 1.0
                    break
                else:
                    middle = 0.5 * (low + high)
                    for half in range(2):
                        stack[waiting, 0], stack[waiting, 1] = (middle, high) if half == 0 else (low, middle)
                        stack[waiting, 2] = halvings + 1.0
                        waiting += 1
    kept = 0
    for k in range(count):
        if not without[int(arcs[k, OBJ])]:
            if kept < k:
                for term in range(arcs.shape[1]):
                    arcs[kept, term] = arcs[k, term]
            kept += 1
    return arcs[:kept], without
