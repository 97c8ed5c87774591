"""What a recording says of where the satellite was: observations in it, else where the mount followed to."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

from sattrack.recording.format import OPERATOR
from sattrack.recording.tdm import Seen
from sattrack.views.messages import Observation, decode_message
from tle.instants import Utc

if TYPE_CHECKING:
    from sattrack.recording.reading import Recording
    from tle.residuals import Frame

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


def seen_in(recording: Recording, catalog_number: int) -> list[Seen]:
    """Return the observations of a run as directions."""
    return [
        Seen(float(Utc.parse(one.utc).unix_s), one.ra_deg, one.dec_deg, one.frame, one.sigma_arcsec)
        for one in observations(recording, catalog_number)
    ]
