"""`crossings.find_crossings` over a level horizon compiled by numba: the same looks, bounds and roots.

The proof that nothing longer than half a second is missed stands in `crossings` and holds for this.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from tle.compiled import BOW, HALF, HEAD, MID, OBJ, SPEED, WINDOW, grown, kernel, leaf, may_exceed

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tle.compiled import Rules

    Array = NDArray[np.float64]

_LOOKS = 9
_MOST_ROUNDS = 60
# Newton's last step, in shares of the one that Ridders' method may end with: beside a top it halves errors.
_NEWTON_CLOSE = 0.05
_DEG = 180.0 / math.pi
_HEIGHT, _CLIMB = 0, 1
# A pass's row: object, times in seconds, azimuths and the highest altitude in degrees.
NAME, RISE, SET, TOP, RISE_AZ, SET_AZ, TOP_AZ, TOP_ALT, WIDTH = range(9)
# A look's row; _IS_TOP is 1 where the altitude is at a top.
_ARC, _X, _Z, _IS_TOP = range(4)


@leaf
def _at(arcs: Array, k: int, x: float) -> tuple[float, float, float]:
    """Return east, north, up on an arc at x."""
    terms = (arcs.shape[1] - HEAD) // 3
    e, n, u = 0.0, 0.0, 0.0
    for power in range(1, terms + 1):
        term = HEAD + terms - power
        e = e * x + arcs[k, term]
        n = n * x + arcs[k, term + terms]
        u = u * x + arcs[k, term + 2 * terms]
    return e, n, u


@leaf
def _moving(arcs: Array, k: int, x: float) -> tuple[float, float, float, float]:
    """Return east, north, up on an arc at x, and what has the sign of the altitude's rate."""
    terms = (arcs.shape[1] - HEAD) // 3
    e, n, u, ve, vn, vu = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for power in range(1, terms + 1):
        term = HEAD + terms - power
        ve, vn, vu = ve * x + e, vn * x + n, vu * x + u
        e = e * x + arcs[k, term]
        n = n * x + arcs[k, term + terms]
        u = u * x + arcs[k, term + 2 * terms]
    return e, n, u, vu * (e * e + n * n) - u * (e * ve + n * vn)


@leaf
def _height(arcs: Array, k: int, x: float, sine: float) -> float:
    """Return the height over the horizon, km."""
    e, n, u = _at(arcs, k, x)
    return u - sine * math.sqrt(e * e + n * n + u * u)


@leaf
def _sloping(arcs: Array, k: int, x: float, what: int, sine: float) -> tuple[float, float]:
    """Return the height over the horizon, or what has the sign of the altitude's rate, and its slope by x."""
    terms = (arcs.shape[1] - HEAD) // 3
    e, n, u, ve, vn, vu, ae, an, au = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for power in range(1, terms + 1):
        term = HEAD + terms - power
        # Of the second derivatives the half.
        ae, an, au = ae * x + ve, an * x + vn, au * x + vu
        ve, vn, vu = ve * x + e, vn * x + n, vu * x + u
        e = e * x + arcs[k, term]
        n = n * x + arcs[k, term + terms]
        u = u * x + arcs[k, term + 2 * terms]
    level2, outward = e * e + n * n, e * ve + n * vn
    if what == _HEIGHT:
        far = math.sqrt(level2 + u * u)
        return u - sine * far, vu - sine * (outward + u * vu) / far
    bow = ve * ve + vn * vn + 2.0 * (e * ae + n * an)
    return vu * level2 - u * outward, 2.0 * au * level2 + vu * outward - u * bow


@leaf
def _root(
    arcs: Array, k: int, ends: tuple[float, float], at_ends: tuple[float, float], what: int, rules: Rules
) -> float:
    """Return x of a root between the ends by Newton's steps, and halves where these lead out of them."""
    low, high = ends
    rising = at_ends[1] > at_ends[0]
    close = _NEWTON_CLOSE * rules.close_s / arcs[k, HALF]
    x = low + (high - low) * at_ends[0] / (at_ends[0] - at_ends[1])
    for _ in range(_MOST_ROUNDS):
        value, slope = _sloping(arcs, k, x, what, rules.sine)
        if (value > 0.0) == rising:
            high = x
        else:
            low = x
        new = x - value / slope
        if not low <= new <= high:
            new = 0.5 * (low + high)
        moved = abs(new - x)
        x = new
        if moved < close:
            break
    return x


@leaf
def _doubtful(
    arcs: Array, k: int, width: float, z: tuple[float, float], far: tuple[float, float], rules: Rules
) -> bool:
    """Tell a stretch below the horizon at both ends that may be above between; see `crossings._doubtful`."""
    span_s = width * arcs[k, HALF]
    if not span_s > rules.sure_s or max(z[0], z[1]) > 0.0:
        return False
    speed = arcs[k, SPEED]
    nearest = max(min(far[0], far[1]) - 0.5 * speed * span_s, 1e-3)
    bend = arcs[k, BOW] * (1.0 + abs(rules.sine)) + max(rules.sine, 0.0) * speed * speed / nearest
    return may_exceed(0.0, z[0], z[1], bend, span_s)


@leaf
def _put(looks: Array, count: int, k: int, x: float, z: float, is_top: float) -> int:
    """Write one look, for which there is room; return how many there are."""
    looks[count, _ARC], looks[count, _X], looks[count, _Z], looks[count, _IS_TOP] = k, x, z, is_top
    return count + 1


@leaf
def _look(arcs: Array, k: int, rules: Rules, looks: Array, count: int, todo: Array) -> int:
    """Look along arc k at even steps, tops and doubts; see `crossings._look`.

    Returns how many looks there are, -1 where there is no room for them. `todo` has room for doubtful
    stretches: x of the ends, heights and distances there.
    """
    x0, z0, far0, climb0 = -1.0, 0.0, 0.0, 0.0
    for look in range(_LOOKS):
        x1 = -1.0 + 2.0 * look / (_LOOKS - 1)
        if count + 4 > len(looks):
            return -1
        e, n, u, climb1 = _moving(arcs, k, x1)
        far1 = math.sqrt(e * e + n * n + u * u)
        z1 = u - rules.sine * far1
        if look:
            doubt = _doubtful(arcs, k, x1 - x0, (z0, z1), (far0, far1), rules)
            top_x, top_z, is_top = 2.0, 0.0, 0.0
            if (z0 > 0.0 or z1 > 0.0 or doubt) and (climb0 > 0.0) != (climb1 > 0.0):
                top_x = _root(arcs, k, (x0, x1), (climb0, climb1), _CLIMB, rules)
                top_z = _height(arcs, k, top_x, rules.sine)
                is_top = 1.0 if climb0 > 0.0 else 0.0
            waiting = 0
            if doubt:
                todo[0, 0], todo[0, 1], todo[0, 2], todo[0, 3] = x0, x1, z0, z1
                todo[0, 4], todo[0, 5] = far0, far1
                waiting = 1
            while waiting:
                waiting -= 1
                if count + 4 > len(looks):
                    return -1
                a, b, za, zb = todo[waiting, 0], todo[waiting, 1], todo[waiting, 2], todo[waiting, 3]
                fa, fb = todo[waiting, 4], todo[waiting, 5]
                if a == b:
                    # The middle of a stretch, in its turn between the two halves.
                    if top_x < a:
                        count = _put(looks, count, k, top_x, top_z, is_top)
                        top_x = 2.0
                    count = _put(looks, count, k, a, za, 0.0)
                elif _doubtful(arcs, k, b - a, (za, zb), (fa, fb), rules):
                    m = 0.5 * (a + b)
                    e, n, u = _at(arcs, k, m)
                    fm = math.sqrt(e * e + n * n + u * u)
                    zm = u - rules.sine * fm
                    for part in range(3):
                        p, zp, fp = (a, za, fa) if part == 2 else (m, zm, fm)
                        q, zq, fq = (b, zb, fb) if part == 0 else (m, zm, fm)
                        todo[waiting, 0], todo[waiting, 1], todo[waiting, 2] = p, q, zp
                        todo[waiting, 3], todo[waiting, 4], todo[waiting, 5] = zq, fp, fq
                        waiting += 1
            if top_x <= 1.0:
                count = _put(looks, count, k, top_x, top_z, is_top)
        count = _put(looks, count, k, x1, z1, 0.0)
        x0, z0, far0, climb0 = x1, z1, far1, climb1
    return count


@leaf
def _seen(arcs: Array, k: int, x: float) -> tuple[float, float, float]:
    """Return seconds since the span's start, altitude and azimuth in degrees, on arc k at x."""
    e, n, u = _at(arcs, k, x)
    alt = math.atan2(u, math.sqrt(e * e + n * n)) * _DEG
    az = math.atan2(e, n) * _DEG
    az = az + 360.0 if az < 0.0 else az
    return arcs[k, MID] + x * arcs[k, HALF], alt, 0.0 if az >= 360.0 else az


@leaf
def _border(arcs: Array, looks: Array, low: int, rules: Rules) -> tuple[float, float, float]:
    """Return seconds, altitude and azimuth where the horizon is crossed between a look and the next."""
    k, x = int(looks[low, _ARC]), looks[low, _X]
    # Looks on two arcs stand at the instant that both share.
    if looks[low + 1, _ARC] == k:
        ends = (x, looks[low + 1, _X])
        x = _root(arcs, k, ends, (looks[low, _Z], looks[low + 1, _Z]), _HEIGHT, rules)
    return _seen(arcs, k, x)


@leaf
def _better(found: Array, p: int, seen: tuple[float, float, float]) -> None:
    """Make an instant a pass's highest if it is."""
    if seen[1] > found[p, TOP_ALT]:
        found[p, TOP], found[p, TOP_ALT], found[p, TOP_AZ] = seen


@leaf
def _begin(arcs: Array, looks: Array, n: int, found: Array, p: int, rules: Rules) -> None:
    """Write what look n, the first of a pass above the horizon, tells of it."""
    arc = int(looks[n, _ARC])
    for column in range(WIDTH):
        found[p, column] = math.nan
    found[p, NAME], found[p, TOP_ALT] = arcs[arc, OBJ], -100.0
    if n:
        rise = _border(arcs, looks, n - 1, rules)
        found[p, RISE], found[p, RISE_AZ] = rise[0], rise[2]
        _better(found, p, rise)
    else:
        _better(found, p, _seen(arcs, arc, looks[n, _X]))


@leaf
def _has_ended(arcs: Array, looks: Array, n: int, count: int, found: Array, p: int, rules: Rules) -> bool:
    """Finish a pass if look n is its last, and tell whether it is."""
    if n + 1 == count:
        _better(found, p, _seen(arcs, int(looks[n, _ARC]), looks[n, _X]))
        return True
    if looks[n + 1, _Z] > 0.0:
        return False
    end = _border(arcs, looks, n, rules)
    found[p, SET], found[p, SET_AZ] = end[0], end[2]
    _better(found, p, end)
    return True


@kernel
def crossings(arcs: Array, rules: Rules) -> tuple[Array, Array]:
    """Return rows of passes (see above), and of tops of the altitude: the pass and the second."""
    found, tops = np.empty((len(arcs) + 16, WIDTH)), np.empty((len(arcs) + 16, 2))
    looks, todo = np.empty((256, 4)), np.empty((160, 6))
    passes, top_count, k = 0, 0, 0
    while k < len(arcs):
        count, window = 0, arcs[k, WINDOW]
        while k < len(arcs) and arcs[k, WINDOW] == window:
            more = _look(arcs, k, rules, looks, count, todo)
            if more < 0:
                looks = grown(looks)
            else:
                count, k = more, k + 1
        for n in range(count):
            if not looks[n, _Z] > 0.0:
                continue
            arc = int(looks[n, _ARC])
            if n == 0 or not looks[n - 1, _Z] > 0.0:
                if passes == len(found):
                    found = grown(found)
                _begin(arcs, looks, n, found, passes, rules)
            if looks[n, _IS_TOP]:
                top = _seen(arcs, arc, looks[n, _X])
                _better(found, passes, top)
                if top_count == len(tops):
                    tops = grown(tops)
                tops[top_count, 0], tops[top_count, 1] = passes, top[0]
                top_count += 1
            if _has_ended(arcs, looks, n, count, found, passes, rules):
                passes += 1
    return found[:passes], tops[:top_count]
