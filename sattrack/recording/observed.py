"""The observations in a recording, and observed directions as a CCSDS Tracking Data Message."""

from __future__ import annotations

from itertools import groupby
from typing import TYPE_CHECKING, NamedTuple

import msgspec

from sattrack import __version__
from sattrack.recording.format import OPERATOR
from sattrack.views.messages import Observation, decode_message
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sattrack.recording.reading import Recording
    from tle.bias import Frame
    from tle.elements import Elements
    from tle.site import Site

CCSDS_FRAMES = {"icrs": "ICRF", "j2000": "EME2000", "of_date": "TOD"}
STATION = "SATTRACK"


class SeenDirection(NamedTuple):
    """One observed direction, degrees in `frame` (icrs, j2000, of_date), with one sigma on the sky."""

    utc_s: float
    ra_deg: float
    dec_deg: float
    frame: str
    sigma_arcsec: float | None = None


def tdm_text(
    seen: Sequence[SeenDirection], elements: Elements, site: Site, created_utc_s: float, what: str
) -> str:
    """Return a message; `what` says in a comment what the directions are.

    Directions of one frame that follow one another with one sigma are a segment. The standard has no keyword
    for the uncertainty of angles: a comment in the segment's metadata says it, SIGMA_ARCSEC, and
    `tle.formats.observations` reads it.

    Times are UTC of reception, angles degrees. The site is in a comment, as the standard has no place
    for it.
    """
    created = Utc(created_utc_s).isoformat("seconds").removesuffix("Z")
    lines = ["CCSDS_TDM_VERS = 2.0", f"CREATION_DATE = {created}", f"ORIGINATOR = SATTRACK {__version__}"]
    for frame in CCSDS_FRAMES:
        of_frame = sorted((one for one in seen if one.frame == frame), key=lambda one: one.utc_s)
        for _, part in groupby(of_frame, key=lambda one: one.sigma_arcsec):
            lines += _segment(list(part), elements, site, frame, what)
    return "\n".join(lines) + "\n"


def _segment(
    part: Sequence[SeenDirection], elements: Elements, site: Site, frame: str, what: str
) -> list[str]:
    sigma = part[0].sigma_arcsec
    comments = [] if sigma is None else ["COMMENT one sigma on the sky", f"COMMENT SIGMA_ARCSEC = {sigma!r}"]
    where = f"{site.latitude_deg:.6f} {site.longitude_deg:.6f} deg, {site.height_m:.1f} m, WGS 84"
    lines = [
        "",
        "META_START",
        f"COMMENT {what}",
        f"COMMENT station at {where}",
        *comments,
        "TIME_SYSTEM = UTC",
        f"START_TIME = {_time(part[0].utc_s)}",
        f"STOP_TIME = {_time(part[-1].utc_s)}",
        f"PARTICIPANT_1 = {STATION}",
        f"PARTICIPANT_2 = {elements.designator or elements.catalog_number}",
        "MODE = SEQUENTIAL",
        "PATH = 2,1",
        "TIMETAG_REF = RECEIVE",
        "ANGLE_TYPE = RADEC",
        f"REFERENCE_FRAME = {CCSDS_FRAMES[frame]}",
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


FRAMES: dict[str, Frame] = {"icrs": "icrf", "j2000": "j2000", "of_date": "of_date"}
"""What `tle` calls the frames of observations."""


def observations(recording: Recording, catalog_number: int | None = None) -> list[Observation]:
    """Return the observations that came in during a run, in the order in which they came.

    With a catalogue number, those that are of another object are left out.
    """
    found = []
    for entry in recording.entries():
        if entry.topic != OPERATOR:
            continue
        try:
            message = decode_message(entry.data)
        except msgspec.MsgspecError:
            continue
        if isinstance(message, Observation) and message.catalog_number in {None, catalog_number}:
            found.append(message)
    return found


def seen_in(recording: Recording, catalog_number: int) -> list[SeenDirection]:
    """Return the observations of a run as directions."""
    return [
        SeenDirection(float(Utc.parse(one.utc).unix_s), one.ra_deg, one.dec_deg, one.frame, one.sigma_arcsec)
        for one in observations(recording, catalog_number)
    ]
