"""The section `[safety]` of sattrack.toml, and the horizon file it names."""

from __future__ import annotations

from pathlib import Path

import msgspec

from sattrack.core.errors import BadInputError
from sattrack.safety.limits import SafetyLimits


class SafetySettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a settings file says of the limits; see `SafetyLimits`.

    `horizon` names a text file of azimuths and altitudes, degrees, as `tle.passes.HorizonMask` reads it,
    beside the settings file.
    """

    floor_altitude_deg: float = 0.0
    horizon: str | None = None
    optical: bool = True
    sun_cone_deg: float | None = None
    moon_cone_deg: float = 0.0
    longest_fault_s: float = 1.0
    clock_tolerance_s: float = 60.0

    def __post_init__(self) -> None:
        """Raise ValueError, naming the key, where the bounds contradict one another."""
        self._limits(())

    def limits(self) -> SafetyLimits:
        """Return the limits, the horizon file read; raises BadInputError, naming file and line."""
        if self.horizon is None:
            return self._limits(())
        from tle.errors import TleError
        from tle.passes import HorizonMask

        path = Path(self.horizon)
        try:
            mask = HorizonMask.read(path)
        except TleError as error:
            raise BadInputError(str(error)) from error
        try:
            return self._limits(tuple(zip(mask.azimuths_deg, mask.altitudes_deg, strict=True)))
        except ValueError as error:
            raise BadInputError(f"{path}: {error}") from error

    def _limits(self, horizon: tuple[tuple[float, float], ...]) -> SafetyLimits:
        values = {name: getattr(self, name) for name in self.__struct_fields__ if name != "horizon"}
        return SafetyLimits(horizon=horizon, **values)
