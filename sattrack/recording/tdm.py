"""Observed directions as a CCSDS Tracking Data Message (CCSDS 503.0-B-2), in keyword notation."""

from __future__ import annotations

from itertools import groupby
from typing import TYPE_CHECKING, NamedTuple

from sattrack import __version__
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tle.elements import Elements
    from tle.site import Site

FRAMES = {"icrs": "ICRF", "j2000": "EME2000", "of_date": "TOD"}
STATION = "SATTRACK"


class Seen(NamedTuple):
    """One observed direction, degrees in `frame` (icrs, j2000, of_date), with one sigma on the sky."""

    utc_s: float
    ra_deg: float
    dec_deg: float
    frame: str
    sigma_arcsec: float | None = None


def tdm_text(seen: Sequence[Seen], elements: Elements, site: Site, created_utc_s: float, what: str) -> str:
    """Return a message; `what` says in a comment what the directions are.

    Directions of one frame that follow one another with one sigma are a segment. The standard has no keyword
    for the uncertainty of angles: a comment in the segment's metadata says it, SIGMA_ARCSEC, and
    `tle.observations` reads it.

    Times are UTC of reception, angles degrees. The site is told in a comment, as the standard has no place
    for it.
    """
    created = Utc(created_utc_s).isoformat("seconds").removesuffix("Z")
    lines = ["CCSDS_TDM_VERS = 2.0", f"CREATION_DATE = {created}", f"ORIGINATOR = SATTRACK {__version__}"]
    for frame in FRAMES:
        of_frame = sorted((one for one in seen if one.frame == frame), key=lambda one: one.utc_s)
        for _, part in groupby(of_frame, key=lambda one: one.sigma_arcsec):
            lines += _segment(list(part), elements, site, frame, what)
    return "\n".join(lines) + "\n"


def _segment(part: Sequence[Seen], elements: Elements, site: Site, frame: str, what: str) -> list[str]:
    sigma = part[0].sigma_arcsec
    told = [] if sigma is None else ["COMMENT one sigma on the sky", f"COMMENT SIGMA_ARCSEC = {sigma!r}"]
    where = f"{site.latitude_deg:.6f} {site.longitude_deg:.6f} deg, {site.height_m:.1f} m, WGS 84"
    lines = [
        "",
        "META_START",
        f"COMMENT {what}",
        f"COMMENT station at {where}",
        *told,
        "TIME_SYSTEM = UTC",
        f"START_TIME = {_time(part[0].utc_s)}",
        f"STOP_TIME = {_time(part[-1].utc_s)}",
        f"PARTICIPANT_1 = {STATION}",
        f"PARTICIPANT_2 = {elements.designator or elements.catalog_number}",
        "MODE = SEQUENTIAL",
        "PATH = 2,1",
        "TIMETAG_REF = RECEIVE",
        "ANGLE_TYPE = RADEC",
        f"REFERENCE_FRAME = {FRAMES[frame]}",
        "META_STOP",
        "",
        "DATA_START",
    ]
    for one in part:
        at = _time(one.utc_s)
        lines += [f"ANGLE_1 = {at} {one.ra_deg % 360.0:.12f}", f"ANGLE_2 = {at} {one.dec_deg:.12f}"]
    return [*lines, "DATA_STOP"]


def _time(utc_s: float) -> str:
    return Utc(utc_s).isoformat("microseconds").removesuffix("Z")
