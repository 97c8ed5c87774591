"""Fields that a camera's frames were solved as: which count for a place, and where they are seen. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol

from tle.bodies import Body, StarPlace
from tle.instants import Utc
from tle.propagator import Propagator

if TYPE_CHECKING:
    from tle.refraction import Refraction
    from tle.site import Site

SEEN_WITHIN_S, FRAMES_A_PLACE = 25.0, 4
"""How long a frame of a place is waited for, and how many are looked at until one is solved."""
STARTS_WITHIN_S = 300.0
"""How long the camera's first frame may take: the index of stars may have to be made, beside other work.

A camera that is not there ends by itself.
"""
ALIKE_DEG = 0.5
"""How near two frames must be solved that no single one is believed for."""
CLOUDS = "no field was found among the stars: clouds, or a wrong scale?"


class Solved(NamedTuple):
    """A frame: the middle of its exposure (POSIX seconds), its length, and where it looks in the ICRS."""

    utc_s: float
    exposure_s: float
    icrs_deg: tuple[float, float] | None


class FieldCamera(Protocol):
    """A camera whose frames are solved."""

    source: str

    @property
    def ended(self) -> bool:
        """Whether no more frames will come."""

    def poll(self) -> list[Solved]:
        """Return the frames that have come since the last call; it does not wait."""


@dataclass(slots=True)
class FieldWait:
    """Waits for frames of one place after the other: those count that began after the mount stood there."""

    camera: FieldCamera
    frames: int = 0
    """How many of this place have been looked at."""
    _since_s: float = 0.0
    _waits_from_s: float = 0.0
    _heard: bool = False

    def begin(self, since_s: float) -> None:
        """Wait for frames that begin at an instant, or later."""
        self._since_s = self._waits_from_s = since_s
        self.frames = 0

    def look(self, now_utc_s: float) -> list[Solved]:
        """Return the frames of this place that have come and were solved.

        None of them began later than its length ago, however the camera's clock dates it.
        """
        began = [
            (min(frame.utc_s - 0.5 * frame.exposure_s, now_utc_s - frame.exposure_s), frame)
            for frame in self.camera.poll()
        ]
        fresh = [frame for begun_s, frame in began if begun_s >= self._since_s]
        self.frames += len(fresh)
        if fresh and not self._heard:
            # The camera has taken its time to start.
            self._heard, self._waits_from_s = True, now_utc_s
        return [frame for frame in fresh if frame.icrs_deg is not None]

    def trouble(self, now_utc_s: float) -> str | None:
        """Return why no frame of this place is waited for any more, None while one is."""
        if self.camera.ended:
            return f"{self.camera.source}: the camera ended"
        if self.frames >= FRAMES_A_PLACE:
            return CLOUDS
        if now_utc_s - self._waits_from_s > (SEEN_WITHIN_S if self._heard else STARTS_WITHIN_S):
            return CLOUDS if self.frames else "no frame came"
        return None


@dataclass(slots=True)
class FieldSky:
    """A site under whose sky solved fields are directions; without air where a mount refracts itself."""

    site: Site
    air: Refraction | None

    def seen(self, frame: Solved) -> tuple[float, float, float]:
        """Return hour angle and declination of date as the field was seen, and the apparent sidereal time.

        Degrees; both angles from the true equator. Raises TimeRangeError where the Earth's orientation is not
        known.
        """
        assert frame.icrs_deg is not None
        body = Body("here", StarPlace(*frame.icrs_deg))
        there = Propagator(body, self.site, refraction=self.air).at(Utc(frame.utc_s))
        hour_angle_deg = float(there.ha_deg)
        return hour_angle_deg, float(there.dec_deg), (float(there.ra_deg) + hour_angle_deg) % 360.0
