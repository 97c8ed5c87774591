"""A camera's picture for screens, and who gets it: messages of cameras, view server and screens. No logic.

A picture never passes the feeder. A client of the view server asks for pictures in its hello
(`{"type":"hello","name":"","pictures":160}`). A camera announces there that it has some (`"shows":true`); the
view server answers how large they must be, and it sends none while that is 0.
"""

from __future__ import annotations

import msgspec

LEAST_SIDE, MOST_SIDE = 16, 320
"""Pixels of a picture's longer side."""
MOST_STARS_SHOWN = 60
MOST_PICTURE_BYTES = 160_000
"""Of one picture's line, above what MOST_SIDE squared comes to in base64."""
PICTURES_A_SECOND = 3.0
ON_PAGE = "picture"
"""The type of a message to a browser's page about the picture over its cells."""


class PicturesWanted(msgspec.Struct, frozen=True, tag="pictures_wanted"):
    """What a camera must send: pictures with so many pixels on the longer side; 0 for none."""

    side: int


class StarView(msgspec.Struct, frozen=True, array_like=True):
    """A star in a frame: pixels from the middle, right and up; its share of the brightest one's light."""

    right_px: float
    up_px: float
    share: float


class PictureView(msgspec.Struct, frozen=True, tag="picture"):
    """One frame of a camera, reduced, and what was seen in it. Places are pixels of the whole frame."""

    camera: str
    utc: str
    """The middle of the exposure, as the camera dates it."""
    exposure_s: float
    width: int
    height: int
    """Of the frame."""
    columns: int
    rows: int
    """Of the reduced picture."""
    pixels: bytes
    """`columns` times `rows` levels, 0 dark to 255, in rows from the top."""
    kind: str
    """What the satellite was seen as: "point", "streak", or "none"."""
    right_px: float | None = None
    """Where it was seen, from the middle."""
    up_px: float | None = None
    sigma_px: float | None = None
    snr: float | None = None
    why: str | None = None
    """Why nothing was seen."""
    scale_arcsec_px: float | None = None
    rotation_deg: float | None = None
    flipped: bool | None = None
    stars: tuple[StarView, ...] = ()
    """The brightest ones."""
    solved: bool = False
    """Whether the field was found among the stars."""
    gain: float | None = None
