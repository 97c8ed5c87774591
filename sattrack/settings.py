"""`sattrack.toml` to frozen settings; every error names file, line and key."""

from __future__ import annotations

import os
import re
import stat
import sys
from contextlib import suppress
from pathlib import Path
from typing import Literal

import msgspec

from sattrack.core.errors import BadInputError
from sattrack.core.files import user_folder
from sattrack.core.local_time import is_zone
from sattrack.core.toml_text import UnknownKeyError, line_of_key, read_toml
from sattrack.safety.limits import SafetyLimits, SiteLimits
from tle.errors import SiteError
from tle.site import Site


class SafetySettings(SiteLimits, frozen=True, forbid_unknown_fields=True):
    """What a settings file says of the limits.

    `horizon` names a text file of azimuths and altitudes, degrees, as `tle.passes.HorizonMask` reads it,
    beside the settings file.
    """

    horizon: str | None = None

    def limits(self) -> SafetyLimits:
        """Return the limits, the horizon file read; raises BadInputError, naming file and line."""
        bounds = {name: getattr(self, name) for name in SiteLimits.__struct_fields__}
        if self.horizon is None:
            return SafetyLimits(**bounds)
        from tle.errors import TleError
        from tle.horizon import HorizonMask

        path = Path(self.horizon)
        try:
            mask = HorizonMask.read(path)
        except TleError as error:
            raise BadInputError(str(error)) from error
        try:
            skyline = tuple(zip(mask.azimuths_deg, mask.altitudes_deg, strict=True))
            return SafetyLimits(horizon=skyline, **bounds)
        except ValueError as error:
            raise BadInputError(f"{path}: {error}") from error


class SiteSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Where the mount stands: WGS 84 geodetic degrees, metres above the ellipsoid."""

    latitude_deg: float
    longitude_deg: float
    height_m: float = 0.0

    def __post_init__(self) -> None:
        """Raise ValueError where a number is out of range."""
        try:
            self.place()
        except SiteError as error:
            raise ValueError(f"{error.field}: {error}") from None

    def place(self) -> Site:
        """Return the site; raises SiteError where a number is out of range."""
        return Site(self.latitude_deg, self.longitude_deg, self.height_m).on_ground()


class MountSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Which mount to drive: `url` is what `--mount` takes, `profile` the file that describes it."""

    url: str | None = None
    profile: str | None = None


class CameraSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What looks through the telescope: its field of view, and how its image lies on the sky.

    `rotation_deg` is the position angle of up, from north through east; `flipped` tells that the image is
    mirrored; `kind` whether the camera finds the target (coarse) or the target is centred in it (fine).
    """

    fov_deg: float | None = None
    scale_arcsec_px: float | None = None
    rotation_deg: float | None = None
    flipped: bool | None = None
    kind: Literal["coarse", "fine"] = "fine"

    def __post_init__(self) -> None:
        """Raise ValueError where a number cannot be one of a camera."""
        if self.fov_deg is not None and not 0.0 < self.fov_deg <= 180.0:
            raise ValueError(f"fov_deg is {self.fov_deg:g}; give the field's diameter, above 0 to 180°")
        if self.scale_arcsec_px is not None and not 0.0 < self.scale_arcsec_px <= 3600.0:
            raise ValueError(
                f"scale_arcsec_px is {self.scale_arcsec_px:g}; give arcseconds in a pixel, above 0 to 3600"
            )
        if self.rotation_deg is not None and not abs(self.rotation_deg) <= 360.0:
            raise ValueError(f"rotation_deg is {self.rotation_deg:g}; give degrees, -360 to 360")


class ScreenSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the terminal's screen looks: `theme` is what `--theme` takes, `ascii` for no other characters."""

    theme: Literal["night", "red", "contrast"] = "night"
    ascii: bool = False


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All that a settings file can say; absent means the built-in value."""

    site: SiteSettings | None = None
    elements: tuple[str, ...] = ()
    fetch_by_name: bool = True
    """Whether CelesTrak may be asked for a satellite that is named where no elements are set."""
    zone: str | None = None
    """The time zone in which people read times, as Europe/Amsterdam; None for the system's."""
    stars: str | None = None
    """A file of the Hipparcos catalogue, for targets such as Vega and HIP 91262."""
    mount: MountSettings = MountSettings()
    min_altitude_deg: float = 10.0
    safety: SafetySettings = SafetySettings()
    camera: CameraSettings = CameraSettings()
    cameras: dict[str, CameraSettings] = {}
    """Cameras by the names that their offsets bear; what one leaves out, `camera` says."""
    screen: ScreenSettings = ScreenSettings()


FILE_NAME = "sattrack.toml"
NO_SITE = "no site: give --site LAT,LON,HEIGHT, or run `sattrack init`"
NO_ELEMENTS = "no elements: give --elements FILE or celestrak:GROUP, or run `sattrack init`"


def user_settings_file() -> Path:
    """Return the path of the user's own settings file, whether or not it exists."""
    return user_folder("XDG_CONFIG_HOME", ".config") / FILE_NAME


class UnseenSettingsError(BadInputError):
    """Nobody can see whether there are settings: their folder is not open to this user."""


def find_settings_file(explicit: Path | None) -> Path | None:
    """Return the file to read: the one named, else the current folder's, else the user's, else none.

    Raises UnseenSettingsError.
    """
    if explicit is not None:
        return explicit
    for candidate in (Path(FILE_NAME), user_settings_file()):
        try:
            if candidate.is_file():
                return candidate
        except OSError as error:
            raise UnseenSettingsError(
                f"{candidate.absolute()}: cannot be looked for: {error.strerror}; give --config FILE, or set "
                "XDG_CONFIG_HOME to a folder of yours"
            ) from error
    return None


def whose_settings(path: Path) -> str | None:
    """Return whose a file is, in words, where others than this user and root may write it; else None.

    Windows has neither such owners nor such modes.
    """
    if sys.platform == "win32":
        return None
    try:
        found = path.stat()
    except OSError:
        return None
    for_all = found.st_mode & stat.S_IWOTH
    if found.st_uid in (0, os.geteuid()) and not for_all:
        return None
    owner = f"user {found.st_uid}"
    with suppress(OSError, KeyError, NotImplementedError):
        owner = path.owner()
    return f"belongs to {owner}{', and everybody may write to it' if for_all else ''}"


def load_settings(explicit: Path | None = None) -> Settings:
    """Read the settings in force.

    Raises BadInputError, naming file, line and key, where the file is missing, is no TOML, or says
    something that is no setting.
    """
    path = find_settings_file(explicit)
    if path is None:
        return Settings()
    try:
        settings = read_toml(path, Settings, "the settings")
    except UnknownKeyError as error:
        raise _of_profile(error) from None
    if settings.zone is not None and not is_zone(settings.zone):
        raise BadInputError(
            f"{path}{line_of_key(path, 'zone')}: zone {settings.zone!r} is no time zone: "
            "write it as Europe/Amsterdam, or UTC"
        )
    if not -90.0 <= settings.min_altitude_deg <= 90.0:
        raise BadInputError(
            f"{path}{line_of_key(path, 'min_altitude_deg')}: min_altitude_deg is "
            f"{settings.min_altitude_deg:g}; give degrees above the horizon, 90 at most"
        )
    here = path.parent
    elements = tuple(s if s == "-" or _names_a_provider(s) else str(here / s) for s in settings.elements)
    stars = None if settings.stars is None else str(here / settings.stars)
    mount = settings.mount
    if mount.profile is not None:
        mount = msgspec.structs.replace(mount, profile=str(here / mount.profile))
    safety = settings.safety
    if settings.min_altitude_deg < safety.floor_altitude_deg:
        line = line_of_key(path, "floor_altitude_deg") or line_of_key(path, "min_altitude_deg")
        raise BadInputError(
            f"{path}{line}: safety.floor_altitude_deg is {safety.floor_altitude_deg:g}, above "
            f"min_altitude_deg, {settings.min_altitude_deg:g}: nothing is followed below the floor; "
            "raise min_altitude_deg, or lower the floor"
        )
    if safety.horizon is not None:
        safety = msgspec.structs.replace(safety, horizon=str(here / safety.horizon))
        try:
            safety.limits()
        except BadInputError as error:
            raise BadInputError(f"{path}{line_of_key(path, 'horizon')}: horizon: {error}") from None
    return msgspec.structs.replace(settings, elements=elements, stars=stars, mount=mount, safety=safety)


def _of_profile(error: UnknownKeyError) -> BadInputError:
    """Return the error; of a key that the mount's profile has, with where it belongs."""
    from sattrack.mount.model import MountProfile

    *table, key = error.path
    if table not in ([], ["mount"]) or key not in MountProfile.__struct_fields__:
        return error
    return BadInputError(f"{error.said}; it belongs into the file that `profile` in [mount] names")


def _names_a_provider(source: str) -> bool:
    """Tell a URL or a provider's short name, such as celestrak:active, from a path."""
    return re.match(r"[A-Za-z][A-Za-z0-9+.-]+:", source) is not None
