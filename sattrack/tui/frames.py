"""What the arrow keys move the target by: along its track, on the sky, by the axes, or in the camera."""

from __future__ import annotations

from typing import NamedTuple


class Move(NamedTuple):
    """One pair of arrows: the offset that they change, its label, and what each arrow does in a word."""

    what: str
    label: str
    minus: str
    plus: str


class Frame(NamedTuple):
    """A frame: its name, and what left and right, down and up change."""

    name: str
    across: Move
    upward: Move


FRAMES = (
    Frame(
        "track",
        Move("along_s", "along", "behind", "ahead"),
        Move("cross_deg", "across", "right of motion", "left"),
    ),
    Frame("sky", Move("ra_cos_dec_deg", "RA sky", "west", "east"), Move("dec_deg", "Dec", "south", "north")),
    Frame(
        "axes",
        Move("ra_axis_deg", "RA axis", "less", "more"),
        Move("dec_axis_deg", "Dec axis", "less", "more"),
    ),
    Frame(
        "camera", Move("camera_x_deg", "cam x", "less", "more"), Move("camera_y_deg", "cam y", "less", "more")
    ),
)
TRACK = FRAMES[0]
LABELS = {move.what: move.label for frame in FRAMES for move in (frame.across, frame.upward)}
