"""How near a pointing model brings a mount to what it is told to point at: a stranger's mount, hidden errors.

python bench/pointing.py [--draws N] [--stars N] [--altaz | --tilted]

Each draw hides another mount (`strangers/tilted_mount.py`, rotations of vectors): polar axis up to 2° off in
any direction, cone up to 10′, flexure up to 30″, a declination axis that leans up to 2′, index errors up to
0.5°. Stars are ICRS directions whose observed places ERFA gives, refraction included; the axes are found for
each by trying, each axis shows 2″ of noise and each star is centred to 1″, one sigma an axis.
*stars*: how many a run takes until the model's own prediction over the sky is below 3″, 30 at most.
*minutes*: slews of 5°/s with 2°/s², 2 s of settling and 3 s for the frame and its solution.
*held out*: where the telescope really looks when the model's axes are set for directions all over the sky,
against the direction wanted, RMS. *within 2 sigma*: of all terms of all draws.

With `--altaz` the first axis is up to 2° off the zenith instead: the same mount at the pole, its hour angles
azimuths from the south. Its index errors are anything, up to 10° in altitude: as in a star run, the zero
points are first set by the field at which it looks when it is switched on. Directions within 5° of the zenith
are left out. With `--tilted` the first axis points anywhere, 10° to 80° high: the mount knows where but for
up to 2°, and reports the direction that its axes would point to if it had no errors. Else it is as with
`--altaz`.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import erfa
import numpy as np
from strangers.tilted_mount import NAMES, TiltedMount, Vector, apart_arcsec, local

from sattrack.core.errors import SattrackError
from sattrack.mount.geometry import AxisGeometry
from sattrack.mount.model import MountProfile, SitePlace
from sattrack.pointing.fit import Bump, PointingFit, Star, find_bump, fit
from sattrack.pointing.terms import swung
from sattrack.pointing.tour import chosen, grid_deg, slewed_deg, toured
from sattrack.runtime.star_run import aligned, seen_with, without_zeros
from tle.site import Site

if TYPE_CHECKING:
    from sattrack.pointing.terms import PointingModel

LATITUDE_DEG, LONGITUDE_DEG, HEIGHT_M = 52.15, 4.48, 6.0
UTC_JD = 2461368.3
LEAST_ALT_DEG = 20.0
ASKED_ARCSEC = 3.0
ENCODER_ARCSEC, CENTROID_ARCSEC = 2.0, 1.0
FEWEST_STARS = 12


SITE = Site(LATITUDE_DEG, LONGITUDE_DEG, HEIGHT_M)


class Draw(NamedTuple):
    """What came of one hidden mount."""

    found: PointingFit
    minutes: float
    held_out_arcsec: float
    within: list[bool]


ALTAZ_NAMES = {
    "AN": ("pole_up", -1.0),
    "AW": ("pole_west", 1.0),
    "CA": ("cone", 1.0),
    "NPAE": ("leaning", 1.0),
    "IA": ("zero_ha", 1.0),
    "IE": ("zero_dec", -1.0),
}
"""TPOINT's azimuth terms turn the other way round than hour angles of a mount at the pole."""
ZENITH_DEG = 85.0


def hidden(rng: np.random.Generator, kind: str = "equatorial") -> TiltedMount:
    """Return a mount with errors drawn at random."""
    latitude_deg, azimuth_deg = (90.0 if kind == "altaz" else LATITUDE_DEG), 0.0
    if kind == "tilted":
        latitude_deg, azimuth_deg = rng.uniform(10.0, 80.0), rng.uniform(0.0, 360.0)
    size, way = 7200.0 * math.sqrt(rng.random()), rng.uniform(0.0, 2.0 * math.pi)
    zeros = (1800.0, 1800.0) if kind == "equatorial" else (648000.0, 36000.0)
    return TiltedMount(
        latitude_deg,
        size * math.cos(way),
        size * math.sin(way),
        *(rng.uniform(-most, most) for most in (600.0, 120.0, *zeros)),
        rng.uniform(0.0, 30.0),
        azimuth_deg,
    )


def observed(ra_deg: float, dec_deg: float, seconds: float) -> tuple[float, float, float, float]:
    """Return hour angle, declination, altitude and azimuth of a star as it is seen, degrees, by ERFA."""
    azimuth, zenith, hour_angle, dec, _, _ = erfa.atco13(
        *np.radians([ra_deg, dec_deg]), 0.0, 0.0, 0.0, 0.0, UTC_JD, seconds / 86400.0, 0.05,
        math.radians(LONGITUDE_DEG), math.radians(LATITUDE_DEG), HEIGHT_M, 0.0, 0.0, 1013.0, 10.0, 0.5, 0.55,
    )  # fmt: skip
    return tuple(math.degrees(x) for x in (hour_angle, dec, math.pi / 2.0 - zenith, azimuth))


def azimuths(mount: TiltedMount) -> bool:
    """Tell whether a mount's first axis points to the zenith."""
    return mount.latitude_deg == 90.0


def profile_of(mount: TiltedMount) -> MountProfile:
    """Return what is known of a mount that is switched on."""
    if mount.latitude_deg == LATITUDE_DEG:
        return MountProfile()
    geometry = AxisGeometry(mount.pole_azimuth_deg, mount.latitude_deg)
    return MountProfile(geometry=geometry, stands_at=SitePlace(LATITUDE_DEG, LONGITUDE_DEG), additive=False)


def tilted(mount: TiltedMount) -> bool:
    """Tell whether a mount's first axis points neither to the pole nor to the zenith."""
    return profile_of(mount).own_axes not in {"equatorial", "altaz"}


def own_deg(mount: TiltedMount, h: float, d: float) -> tuple[float, float]:
    """Return the axes' angles for a direction, if the mount had no errors."""
    frame = profile_of(mount).frame
    return (h, d) if frame is None else frame.angles(h, d)[:2]


def hour_angle_and_dec(vector: Vector) -> tuple[float, float]:
    """Return hour angle and declination of a vector east, north, up."""
    x, y, z = (float(local(*one, LATITUDE_DEG) @ vector) for one in ((0.0, 0.0), (90.0, 0.0), (0.0, 90.0)))
    return math.degrees(math.atan2(y, x)), math.degrees(math.atan2(z, math.hypot(x, y)))


def look(mount: TiltedMount, place: tuple[float, float], seconds: float, rng: np.random.Generator) -> Star:
    """Return a star near a place (hour angle, declination) as the mount and its camera show it."""
    gst = math.degrees(erfa.gst06a(UTC_JD, seconds / 86400.0, UTC_JD, seconds / 86400.0))
    h, d, altitude, azimuth = observed((gst + LONGITUDE_DEG - place[0]) % 360.0, place[1], seconds)
    wanted = local(h, d, LATITUDE_DEG)
    off = rng.normal(0.0, CENTROID_ARCSEC / 206264.8, 3)
    seen = wanted + off - wanted * float(off @ wanted)
    near = place
    if azimuths(mount):
        # What the axes show there, their index errors included.
        near = azimuth - 180.0 + mount.zero_ha / 3600.0, altitude + mount.zero_dec / 3600.0
    elif tilted(mount):
        first, second = own_deg(mount, *place)
        near = first + mount.zero_ha / 3600.0, second + mount.zero_dec / 3600.0
    axes = mount.stands(seen / np.linalg.norm(seen), near)
    first, second = axes + rng.normal(0.0, ENCODER_ARCSEC / 3600.0, 2)
    if azimuths(mount):
        return Star(azimuth, altitude, float(first) + 180.0, float(second))
    if tilted(mount):
        faultless = TiltedMount(mount.latitude_deg, pole_azimuth_deg=mount.pole_azimuth_deg)
        return Star(h, d, *hour_angle_and_dec(faultless.looks(float(first), float(second))))
    return Star(h, d, float(first), float(second))


def slew_s(a: tuple[float, float], b: tuple[float, float]) -> float:
    """Return how long a slew takes, seconds."""
    way, rate, acceleration = slewed_deg(a, b), 5.0, 2.0
    ramp = rate * rate / acceleration
    return way / rate + rate / acceleration if way > ramp else 2.0 * math.sqrt(way / acceleration)


def sky(mount: TiltedMount) -> np.ndarray:
    """Return the directions that can be looked at."""
    places = grid_deg(LATITUDE_DEG)
    up = np.array([local(h, d, LATITUDE_DEG)[2] for h, d in places])
    # Beyond 90° what an azimuth mount reports is another direction's.
    told_deg = ZENITH_DEG - max(0.0, mount.zero_dec / 3600.0)
    highest = math.sin(math.radians(told_deg)) if azimuths(mount) else 1.0
    good = (up > math.sin(math.radians(LEAST_ALT_DEG))) & (up < highest)
    if tilted(mount):
        second = np.array([own_deg(mount, h, d)[1] for h, d in places])
        good &= (np.abs(second) < ZENITH_DEG) & (np.abs(second + mount.zero_dec / 3600.0) < ZENITH_DEG)
    return places[good]


def horizontal(places: np.ndarray) -> np.ndarray:
    """Return azimuths and altitudes of hour angles and declinations."""
    units = np.array([local(h, d, LATITUDE_DEG) for h, d in places])
    azimuth = np.degrees(np.arctan2(units[:, 0], units[:, 1])) % 360.0
    return np.stack([azimuth, np.degrees(np.arcsin(units[:, 2]))], axis=1)


def fitted(mount: TiltedMount, stars: list[Star]) -> PointingFit:
    """Return the model of a mount's stars."""
    return fit(stars, LATITUDE_DEG, profile_of(mount).own_axes)


def switched_on(mount: TiltedMount, rng: np.random.Generator) -> MountProfile:
    """Return the profile of a mount with the zero points of the field at which it looks."""
    if profile_of(mount).geometry is None:
        return profile_of(mount)
    places = sky(mount)
    star = look(mount, tuple(places[rng.integers(len(places))]), 0.0, rng)
    looks, told = star[:2], star[2:4]
    if azimuths(mount):
        looks, told = (swung(-azimuth, altitude, LATITUDE_DEG) for azimuth, altitude in (looks, told))
    return aligned(profile_of(mount), looks, told)


def run(
    mount: TiltedMount, most: int, rng: np.random.Generator
) -> tuple[PointingFit, float, tuple[float, float]]:
    """Return the model that a run finds, how long it took, minutes, and zero points of the axes, degrees."""
    profile = switched_on(mount, rng)
    bare = without_zeros(profile)
    places = sky(mount)
    over = horizontal(places) if azimuths(mount) else places
    places = places[chosen(places, most)]
    stands = np.array([own_deg(mount, h, d) for h, d in places]) if tilted(mount) else places
    order = toured(stands, (0.0, LATITUDE_DEG))
    stars, seconds, at = [], 0.0, (0.0, LATITUDE_DEG)
    for place, stand in zip(places[order], stands[order], strict=True):
        seconds += slew_s(at, tuple(stand)) + 5.0
        at = tuple(stand)
        star = look(mount, tuple(place), seconds, rng)
        stars.append(seen_with(star, bare, profile, SITE))
        if len(stars) >= FEWEST_STARS:
            found = fitted(mount, stars)
            if found.predicted_arcsec(over) < ASKED_ARCSEC:
                break
    own = profile.geometry
    zeros = (0.0, 0.0) if own is None else (own.first_zero_deg, own.second_zero_deg)
    return fitted(mount, stars), seconds / 60.0, zeros


def held_out(mount: TiltedMount, model: PointingModel, zeros_deg: tuple[float, float] = (0.0, 0.0)) -> float:
    """Return by how much the telescope misses directions that no star was at, RMS, arcseconds."""
    places = sky(mount) + np.array([2.0, 1.0])
    places = places[[local(h, d, LATITUDE_DEG)[2] > math.sin(math.radians(LEAST_ALT_DEG)) for h, d in places]]
    off = []
    for (h, d), (azimuth, altitude) in zip(places, horizontal(places), strict=True):
        if azimuths(mount):
            first, second = model.axes_of(-azimuth, altitude)
            stands = -float(first) - 180.0 + zeros_deg[0], float(second) + zeros_deg[1]
        elif tilted(mount):
            first, second = own_deg(mount, *model.reported(h, d))
            stands = first + zeros_deg[0], second + zeros_deg[1]
        else:
            stands = model.axes_of(h, d)
        off.append(apart_arcsec(mount.looks(*stands), local(h, d, LATITUDE_DEG)))
    return math.sqrt(sum(one * one for one in off) / len(off))


def draw(number: int, most: int, kind: str) -> Draw:
    """Return what comes of one hidden mount."""
    rng = np.random.default_rng(number)
    mount = hidden(rng, kind)
    found, minutes, zeros = run(mount, most, rng)
    known = replace(
        mount, zero_ha=mount.zero_ha - 3600.0 * zeros[0], zero_dec=mount.zero_dec - 3600.0 * zeros[1]
    )
    truth = {name: -getattr(known, error) for name, error in NAMES.items()} | {"TF": mount.sag}
    if azimuths(mount):
        truth |= {name: sign * getattr(known, field) for name, (field, sign) in ALTAZ_NAMES.items()}
    sigmas = np.sqrt(np.diag(found.covariance))
    # Index errors are angles: a turn more is none.
    within = [
        abs(math.remainder(value - truth.get(name, 0.0), 1296000.0)) <= 2.0 * sigma
        for name, value, sigma in zip(found.names, found.values, sigmas, strict=True)
    ]
    return Draw(found, minutes, held_out(mount, found.model, zeros), within)


def troubles() -> list[str]:
    """Return what becomes of runs that go wrong, one line each."""
    rng = np.random.default_rng(7)
    mount = hidden(rng)
    places = sky(mount)[chosen(sky(mount), 20)]
    good = [look(mount, tuple(place), 20.0 * k, rng) for k, place in enumerate(places)]
    three = fit(good[:3], LATITUDE_DEG)
    wrong = list(good)
    wrong[6] = wrong[6]._replace(hour_angle_deg=wrong[6].hour_angle_deg + 11.0, dec_deg=-5.0)
    robust = fit(wrong, LATITUDE_DEG)
    moved = TiltedMount(
        **{**mount.__dict__, "pole_up": mount.pole_up + 300.0, "zero_ha": mount.zero_ha + 200.0}
    )
    bumped = good[:9] + [look(moved, tuple(p), 20.0 * k, rng) for k, p in enumerate(places) if k >= 9]
    bump = find_bump(bumped, LATITUDE_DEG)
    lines = [
        f"three stars: {', '.join(three.names)}; held out {held_out(mount, three.model):.0f}″",
        f"one wrong star of 20: left out {int((~robust.used).sum())}, "
        f"held out {held_out(mount, robust.model):.1f}″",
        f"bumped before the 10th star: {bumped_text(bump)}",
        f"not bumped: {bumped_text(find_bump(good, LATITUDE_DEG))}",
    ]
    try:
        fit(
            [star._replace(dec_deg=star.dec_deg + 7.0 * (k % 2)) for k, star in enumerate(good)], LATITUDE_DEG
        )
    except SattrackError:
        lines.append("every second star wrong: refused")
    return lines


def few_stars(count: int, draws: int = 20) -> str:
    """Return what becomes of so few stars, one of them solved to be anywhere on the sphere, or none."""
    found = refused = left_out = 0
    for number in range(draws):
        rng = np.random.default_rng(10_000 + number)
        mount = hidden(rng)
        places = sky(mount)[chosen(sky(mount), count)]
        good = [look(mount, tuple(place), 20.0 * k, rng) for k, place in enumerate(places)]
        left_out += int((~fit(good, LATITUDE_DEG).used).sum())
        x, y, z = rng.standard_normal(3)
        wrong = int(rng.integers(count))
        h, d = math.degrees(math.atan2(y, x)), math.degrees(math.atan2(z, math.hypot(x, y)))
        stars = [*good[:wrong], good[wrong]._replace(hour_angle_deg=h, dec_deg=d), *good[wrong + 1 :]]
        try:
            found += np.flatnonzero(~fit(stars, LATITUDE_DEG).used).tolist() == [wrong]
        except SattrackError:
            refused += 1
    return (
        f"one wrong star of {count}, {draws} mounts: {found} found, {refused} refused; "
        f"{left_out} good ones left out where none is wrong"
    )


def bumped_text(bump: Bump | None) -> str:
    """Return in words what was found of a bump."""
    return (
        "none found" if bump is None else f"before number {bump.before_star + 1}, by {bump.moved_arcsec:.0f}″"
    )


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--stars", type=int, default=30)
    kinds = parser.add_mutually_exclusive_group()
    for kind in ("altaz", "tilted"):
        kinds.add_argument(f"--{kind}", dest="kind", action="store_const", const=kind, default="equatorial")
    options = parser.parse_args()
    draws = [draw(number, options.stars, options.kind) for number in range(options.draws)]
    print(f"{len(draws)} hidden mounts   median   95 %   worst")
    for name, values in (
        ("stars", [one.found.stars for one in draws]),
        ("minutes", [one.minutes for one in draws]),
        ("left at the stars ″", [one.found.rms_arcsec for one in draws]),
        ("cross-validated ″", [one.found.held_out_rms_arcsec or math.nan for one in draws]),
        ("held out ″", [one.held_out_arcsec for one in draws]),
    ):
        middle, most, worst = np.percentile(values, [50, 95, 100])
        print(f"{name:20} {middle:7.2f} {most:7.2f} {worst:7.2f}")
    within = [one for found in draws for one in found.within]
    print(f"terms within 2 sigma  {100.0 * sum(within) / len(within):.1f} % of {len(within)}")
    if options.kind == "equatorial":
        print("\n".join([*troubles(), *map(few_stars, range(3, 8))]))


if __name__ == "__main__":
    main()
