"""Coordinates as people write them, and a mount's status in words: every field with its unit, in groups."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, NamedTuple

from sattrack.core.errors import BadInputError
from sattrack.mount.model import DTICS_S_PER_DEG_S
from tle.instants import Utc

if TYPE_CHECKING:
    from sattrack.mount.model import Status
    from sattrack.views.run import ConsoleView

NOTHING = "–"
MINUS = "\N{MINUS SIGN}"
SIDEREAL_DTICS_S = 7789.0
ARCSEC_PER_SECOND = 15.041
"""How far the sky turns in a second of UTC."""
CARDINALS = ("N", "NE", "E", "SE", "S", "SW", "W", "NW")


RA_FORMS = "5h30m, 5:30:00, 5.5h or degrees as 82.5"
DEC_FORMS = "-12.5, -12:30:00 or -12d30m"

_NUMBER = r"([0-9]+(?:\.[0-9]*)?|\.[0-9]+)"
_ANGLE = re.compile(
    rf"""\s* ([+\-{MINUS}]?) \s* {_NUMBER} \s*
    (?: ([hd°:]) \s* (?: {_NUMBER} \s* (?: [m'′:] \s* (?: {_NUMBER} \s* [s"″]? \s* )? )? )? )?""",
    re.VERBOSE,
)


class Line(NamedTuple):
    """One field: its name, its value with its unit, and whether it wants attention."""

    name: str
    value: str
    loud: bool = False


class Group(NamedTuple):
    """Fields that belong together."""

    title: str
    lines: tuple[Line, ...]


def parse_ra(text: str) -> float:
    """Return a right ascension, degrees from 0 to below 360; with h or colons hours, else degrees.

    Raises BadInputError.
    """
    value, unit = _parse_angle(text, "right ascension", RA_FORMS)
    in_hours = unit in ("h", ":")
    degrees = value * 15.0 if in_hours else value
    if not 0.0 <= degrees < 360.0:
        bounds = "from 0h to below 24h" if in_hours else "from 0 to below 360 degrees (24h)"
        raise BadInputError(f"right ascension {text!r}: it runs {bounds}")
    return degrees


def parse_dec(text: str) -> float:
    """Return a declination, degrees from -90 to 90. Raises BadInputError."""
    value, unit = _parse_angle(text, "declination", DEC_FORMS)
    if unit == "h":
        raise BadInputError(f"declination {text!r}: it is in degrees, not hours; write {DEC_FORMS}")
    if not -90.0 <= value <= 90.0:
        raise BadInputError(f"declination {text!r}: it runs from -90 to 90 degrees")
    return value


def _parse_angle(text: str, what: str, forms: str) -> tuple[float, str]:
    found = _ANGLE.fullmatch(text)
    if found is None or (found[3] == ":" and found[4] is None):
        raise BadInputError(f"{what} {text!r}: write {forms}")
    sign, first, unit, minutes, seconds = found.groups()
    for number, follower, name in ((first, minutes, "minutes"), (minutes, seconds, "seconds")):
        if follower is None:
            continue
        if "." in number:
            raise BadInputError(f"{what} {text!r}: {number} is no whole number, yet {name} follow it")
        if float(follower) >= 60.0:
            raise BadInputError(f"{what} {text!r}: {follower} {name}; there are 60 of them")
    value = float(first) + float(minutes or 0.0) / 60.0 + float(seconds or 0.0) / 3600.0
    return (-value if sign in ("-", MINUS) else value), unit or ""


def number(value: float | None, decimals: int, unit: str = "", sign: bool = False) -> str:
    """Return a number with its unit, a true minus, and a dash for none."""
    if value is None:
        return NOTHING
    text = f"{value:+.{decimals}f}" if sign else f"{value:.{decimals}f}"
    if float(text) == 0.0:
        text = text.replace("-", "+" if sign else "")
    return text.replace("-", MINUS) + unit


def hours(value_h: float | None, sign: bool = False) -> str:
    """Return an angle of hours as `05h 30m 00.0s`."""
    if value_h is None:
        return NOTHING
    tenths = round(abs(value_h) * 36000.0)
    before = (MINUS if value_h < 0.0 and tenths else "+") if sign else ""
    return f"{before}{tenths // 36000:02d}h {tenths // 600 % 60:02d}m {tenths % 600 / 10.0:04.1f}s"


def degrees(value_deg: float | None) -> str:
    """Return an angle of degrees as `+12° 30′ 00″`."""
    if value_deg is None:
        return NOTHING
    whole = round(abs(value_deg) * 3600.0)
    before = MINUS if value_deg < 0.0 and whole else "+"
    return f"{before}{whole // 3600:02d}° {whole // 60 % 60:02d}′ {whole % 60:02d}″"


def yes(flag: bool) -> str:
    """Return a flag in a word."""
    return "yes" if flag else "no"


def clock_words(offset_s: float | None) -> str:
    """Return the mount's clock against ours, and what that is on the sky."""
    if offset_s is None:
        return NOTHING
    on_sky = abs(offset_s) * ARCSEC_PER_SECOND
    size = (
        f"{on_sky:.1f}″"
        if on_sky < 100.0
        else f"{on_sky / 60.0:.1f}′"
        if on_sky < 6000.0
        else f"{on_sky / 3600.0:.1f}°"
    )
    return f"{number(offset_s, 2, ' s', sign=True)} = {size}"


def pointing(view: ConsoleView, status: Status) -> Group:
    """Return where the mount points, and by which clock."""
    hour_angle = None if view.hour_angle_deg is None else view.hour_angle_deg / 15.0
    azimuth = status.azimuth_deg
    name = "" if azimuth is None else " " + CARDINALS[round(azimuth % 360.0 / 45.0) % 8]
    low = status.altitude_deg is not None and status.altitude_deg < view.floor_altitude_deg
    offset_s = view.clock_offset_s
    return Group(
        "pointing",
        (
            Line("RA", hours(status.ra_h)),
            Line("Dec", degrees(status.dec_deg)),
            Line("hour angle", hours(hour_angle, sign=True)),
            Line("altitude", number(status.altitude_deg, 2, "°"), low),
            Line("azimuth", number(azimuth, 2, "°") + name),
            Line("pier side", "beyond pole" if status.side_of_pier else "normal"),
            Line("sidereal", hours(status.sidereal_h)),
            Line("its clock", clock_words(offset_s), offset_s is not None and abs(offset_s) > 2.0),
            Line("target RA", hours(status.target_ra_h)),
            Line("target Dec", degrees(status.target_dec_deg)),
        ),
    )


def drives(view: ConsoleView, status: Status) -> Group:
    """Return what the drives do; rates in tenths of encoder tics a second, as the mount tells them."""
    del view
    return Group(
        "drives (tics/10 s)",
        (
            Line("RA rate", number(status.ra_rate_dtics_s, 0, sign=True)),
            Line("  in °/s", number(status.ra_rate_dtics_s / DTICS_S_PER_DEG_S, 4, sign=True)),
            Line("Dec rate", number(status.dec_rate_dtics_s, 0, sign=True)),
            Line("  in °/s", number(status.dec_rate_dtics_s / DTICS_S_PER_DEG_S, 4, sign=True)),
            Line("RA current", number(status.ra_current_10ma / 100.0, 2, " A")),
            Line("Dec current", number(status.dec_current_10ma / 100.0, 2, " A")),
            Line("RA guide", number(status.ra_guide_rate_dtics_s, 0)),
            Line("Dec guide", number(status.dec_guide_rate_dtics_s, 0)),
            Line("RA drive", f"status {status.ra_drive_status_1} {status.ra_drive_status_2}"),
            Line("Dec drive", f"status {status.dec_drive_status_1} {status.dec_drive_status_2}"),
        ),
    )


def state(view: ConsoleView, status: Status) -> Group:
    """Return the flags that tell what the mount does."""
    del view
    system = "0 JNow" if status.equatorial_system == 0 else str(status.equatorial_system)
    rate = "0 sidereal" if status.tracking_rate == 0 else str(status.tracking_rate)
    return Group(
        "state",
        (
            Line("slewing", yes(status.slewing)),
            Line("tracking", yes(status.tracking)),
            Line("pulse guiding", yes(status.pulse_guiding)),
            Line("at home", yes(status.at_home)),
            Line("at park", yes(status.at_park)),
            Line("connected", yes(status.connected), not status.connected),
            Line("refraction", yes(status.does_refraction)),
            Line("tracking rate", rate),
            Line("equatorial", system),
        ),
    )


def acknowledgements(view: ConsoleView, status: Status) -> Group:
    """Return which commands the mount acknowledges just now."""
    del view
    names = ("move_ra", "move_dec", "slew", "sync", "pulse_guide", "abort")
    return Group(
        "acknowledged",
        tuple(Line(name.replace("_", " "), yes(getattr(status, f"ack_{name}"))) for name in names),
    )


def place(view: ConsoleView, status: Status) -> Group:
    """Return where the mount believes it stands, and what is left of its datagram."""
    del view
    utc = " ".join(str(byte) for byte in (status.utc_1, status.utc_2, status.utc_3))
    return Group(
        "site and datagram",
        (
            Line("latitude", number(status.site_latitude_deg, 4, "°", sign=True)),
            Line("longitude", number(status.site_longitude_deg, 4, "°", sign=True)),
            Line("height", number(status.site_height_m, 0, " m")),
            Line("counter", str(status.counter)),
            Line("UTC bytes", utc),
            Line("spare", str(status.spare)),
        ),
    )


def readings(view: ConsoleView) -> Group:
    """Return how the mount reads what the protocol's paper gives two readings."""
    seen, unseen = view.readings, "only zeros so far"
    return Group(
        "read as",
        (
            Line("RA rate", seen.ra_rate_dtics_s or unseen),
            Line("Dec rate", seen.dec_rate_dtics_s or unseen),
            Line("counter", seen.counter or unseen),
            Line("RA guide", seen.ra_guide_rate_dtics_s or unseen),
            Line("Dec guide", seen.dec_guide_rate_dtics_s or unseen),
            Line("tracking", seen.tracking or "not seen slewing"),
            Line("MoveAxis", f"{view.move_axis}, by the profile"),
        ),
    )


def link(view: ConsoleView) -> Group:
    """Return how the mount is heard."""
    heard = view.link
    strangers = f"{heard.strangers}"
    if view.stranger_hosts:
        strangers += f" ({', '.join(view.stranger_hosts)})"
    return Group(
        "link",
        (
            Line("state", heard.state, heard.state in ("stale", "lost")),
            Line("rate", number(heard.rate_hz, 2, " /s")),
            Line("jitter", number(heard.jitter_ms, 2, " ms")),
            Line("age", number(heard.age_s, 2, " s")),
            Line("sent", str(heard.sent)),
            Line("heard", str(heard.received)),
            Line("lost", str(heard.lost), heard.lost > 0),
            Line("late", str(heard.late), heard.late > 0),
            Line("double", str(heard.duplicate), heard.duplicate > 0),
            Line("rejected", str(heard.rejected), heard.rejected > 0),
            Line("strangers", strangers, heard.strangers > 0),
            Line("restarts", str(heard.restarts), heard.restarts > 0),
            Line("run twice", str(heard.doubled_launches), heard.doubled_launches > 0),
            Line("foreign acks", str(heard.foreign_acks), heard.foreign_acks > 0),
        ),
    )


def is_alpaca(view: ConsoleView) -> bool:
    """Tell whether the mount is an Alpaca telescope, whose statuses are made of what its driver tells."""
    return view.mount.startswith("alpaca:")


def alpaca_groups(view: ConsoleView, status: Status) -> tuple[Group, ...]:
    """Return what an Alpaca telescope tells, and how its requests are answered."""
    not_told = {"its clock", "target RA", "target Dec"}
    here = pointing(view, status)
    rates = (status.ra_rate_dtics_s, status.dec_rate_dtics_s)
    guides = (status.ra_guide_rate_dtics_s, status.dec_guide_rate_dtics_s)
    hour_angle, dec = (number(rate / DTICS_S_PER_DEG_S, 4, " °/s", sign=True) for rate in rates)
    guide_ra, guide_dec = (
        number(rate / DTICS_S_PER_DEG_S, 4, " °/s") if rate else NOTHING for rate in guides
    )
    told = {"slewing", "tracking", "pulse guiding", "at home", "at park", "refraction"}
    site = {"latitude", "longitude", "height"}
    heard = {"state", "rate", "jitter", "age", "heard"}
    return (
        Group(here.title, tuple(line for line in here.lines if line.name not in not_told)),
        Group(
            "axes, by the places told",
            (
                Line("hour angle", hour_angle),
                Line("declination", dec),
                Line("guides RA", guide_ra),
                Line("guides Dec", guide_dec),
            ),
        ),
        Group("state", tuple(line for line in state(view, status).lines if line.name in told)),
        Group("site", tuple(line for line in place(view, status).lines if line.name in site)),
        Group("requests", tuple(line for line in link(view).lines if line.name in heard)),
    )


def status_groups(view: ConsoleView) -> tuple[Group, ...]:
    """Return every field of a status, by groups; only the link where the mount was not heard."""
    status = view.status
    if status is None:
        return (link(view),)
    if is_alpaca(view):
        return alpaca_groups(view, status)
    told = tuple(make(view, status) for make in (pointing, drives, state, acknowledgements, place))
    return (*told, readings(view), link(view))


def status_text(view: ConsoleView, *more: Group) -> str:
    """Return a status as a table to be read, with `more` groups at its beginning."""
    rows = [f"{view.mount}  {Utc(view.utc_s).isoformat('milliseconds')}  profile {view.profile}"]
    for group in (*more, *status_groups(view)):
        rows += ["", group.title]
        rows += [f"  {line.name:<14}{line.value}" for line in group.lines]
    if view.warnings:
        rows += ["", "to be looked at"]
        rows += [f"  {words}" for words in view.warnings]
    return "\n".join(rows)


def where_words(view: ConsoleView) -> str:
    """Return where the mount stands, in a line."""
    status = view.status
    if status is None:
        return "not heard"
    doing = "slewing" if status.slewing else "at rest or tracking" if view.at_rest else "moving"
    altitude = number(status.altitude_deg, 1, "°")
    return f"RA {hours(status.ra_h)}  Dec {degrees(status.dec_deg)}  alt {altitude}  {doing}"
