"""Text for people: numbers, instants, coordinates in and out, the status of a mount, the summary of a run."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, NamedTuple

from sattrack.core import local_time
from sattrack.core.errors import BadInputError
from sattrack.mount.model import DTICS_S_PER_DEG_S
from tle.instants import Utc

if TYPE_CHECKING:
    from sattrack.mount.model import Status
    from sattrack.views.run import (
        CameraSummary,
        ClockView,
        ConsoleView,
        LearntView,
        LoopView,
        Summary,
        TrackView,
    )


NOTHING = "–"
MINUS = "\N{MINUS SIGN}"
SIDEREAL_DTICS_S = 7789.0
ARCSEC_PER_SECOND = 15.041
"""How far the sky turns in a second of UTC."""
CARDINALS = ("N", "NE", "E", "SE", "S", "SW", "W", "NW")
ARCSEC_PER_DEG = 3600.0
STANDING_DEG_S = 0.01
"""A mount whose axes move by less does not slew; one that tracks turns by 0.0042 degrees a second."""
HOUR_S = 3600.0
DAY_S = 86400.0


def arcsec_parts(arcsec: float) -> tuple[str, str]:
    """Return an unsigned angle as digits and the unit that fits: arcseconds, minutes or degrees."""
    size = abs(arcsec)
    if size < 9.995:
        return f"{size:.2f}", "″"
    if size < 99.95:
        return f"{size:.1f}", "″"
    if size < 599.5:
        return f"{size:.0f}", "″"
    if size < ARCSEC_PER_DEG:
        return f"{size / 60.0:.1f}", "′"
    return f"{size / ARCSEC_PER_DEG:.1f}", "°"


def arcsec(value: float | None, sign: bool = False) -> str:
    """Return an angle of arcseconds with its unit; a dash for none."""
    if value is None:
        return NOTHING
    digits, unit = arcsec_parts(value)
    if not sign:
        return digits + unit
    below = value < 0.0 and float(digits) != 0.0
    return (MINUS if below else "+") + digits + unit


def clock(utc_s: float) -> str:
    """Return the local time of day that it is now, to the second that has begun."""
    return local_time.clock(math.floor(utc_s))


def phase_text(view: TrackView) -> str:
    """Return the phase of a run; a mount that stands where the satellite will come by waits."""
    rates = view.ra_rate_reached_deg_s, view.dec_rate_reached_deg_s
    stands = all(rate is not None and abs(rate) < STANDING_DEG_S for rate in rates)
    return "waiting" if view.phase == "slewing" and stands else view.phase


def date(utc_s: float) -> str:
    """Return the local date of an instant."""
    return local_time.date(math.floor(utc_s))


def span(seconds: float) -> str:
    """Return a length of time: `0:07`, `12:34`, `3:05:12`, `2 d 4 h`."""
    whole = math.floor(abs(seconds))
    if whole < HOUR_S:
        return f"{whole // 60}:{whole % 60:02d}"
    minutes = whole // 60
    if whole < DAY_S:
        return f"{minutes // 60}:{minutes % 60:02d}:{whole % 60:02d}"
    return f"{minutes // 1440} d {minutes // 60 % 24} h"


def age(seconds: float) -> str:
    """Return an age as text; a negative one, of something that lies ahead, says so."""
    size = abs(seconds)
    if size < HOUR_S:
        text = f"{size / 60.0:.0f} min"
    elif size < 2.0 * DAY_S:
        text = f"{size / HOUR_S:.1f} h"
    else:
        days = size / DAY_S
        text = f"{days:.1f} days" if days < 99.95 else f"{days:.0f} days"
    return text if seconds >= 0.0 else f"{text} ahead"


def old(seconds: float) -> str:
    """Return an age as `12.8 h old`; of something that lies ahead as `56.5 days ahead`."""
    return f"{age(seconds)} old" if seconds >= 0.0 else age(seconds)


def length(metres: float) -> str:
    """Return a length to three digits, in metres, or in kilometres from one on."""
    if metres < 999.5:
        return f"{metres:.3g} m"
    return f"{metres / 1000.0:.3g} km" if metres < 999_500.0 else f"{metres / 1000.0:.0f} km"


def source_error(error_m: float | None) -> str:
    """Return `error 17.3 m` of a source that misses its object by so much, typically; it may not state it."""
    return "error not stated" if error_m is None else f"error {length(error_m)}"


def file_error(sigma_km: float | None) -> str:
    """Return what a file states of the error of its places, `1σ 17.3 m by the file`, or that it does not."""
    return "error not stated" if sigma_km is None else f"1σ {length(1000.0 * sigma_km)} by the file"


def right_ascension(degrees: float) -> str:
    """Return a right ascension as `12h 34m 56.7s`."""
    return hours(degrees / 15.0)


def azimuth(degrees: float) -> str:
    """Return an azimuth with the name of the direction."""
    return f"{round(degrees, 1) % 360.0:.1f}° {cardinal(degrees)}"


def cardinal(azimuth_deg: float) -> str:
    """Return the nearest of the eight directions of the compass."""
    return CARDINALS[round(azimuth_deg % 360.0 / 45.0) % 8]


def gauge(share: float, cells: int, mark: float | None = None) -> str:
    """Return a bar of a share between 0 and 1; `mark` is a share at which a stroke stands across it."""
    full = min(cells, max(0, round(abs(share) * cells)))
    bar = "█" * full + "·" * (cells - full)
    if full == 0 and share != 0.0:
        bar = "▏" + bar[1:]
    if mark is None:
        return bar
    at = min(cells - 1, max(0, round(abs(mark) * cells)))
    return f"{bar[:at]}┃{bar[at + 1 :]}"


def iso_unix_s(utc: str) -> float:
    """Return an instant in ISO 8601 as POSIX seconds."""
    return float(Utc.parse(utc).unix_s)


def iso_clock(utc: str | None) -> str:
    """Return the time of day of an event, to the nearest second as lists show it; a dash for none."""
    return NOTHING if utc is None else local_time.clock(iso_unix_s(utc))


def within(text: str, plain: bool = False) -> str:
    """Return a size as one either way; ASCII needs two characters for that."""
    return f"+-{text}" if plain else f"±{text}"


RA_FORMS = "5h30m, 5:30:00, 5.5h or degrees as 82.5"
DEC_FORMS = "-12.5, -12:30:00 or -12d30m"

_NUMBER = r"([0-9]+(?:\.[0-9]*)?|\.[0-9]+)"
_ANGLE = re.compile(
    rf"""\s* ([+\-{MINUS}]?) \s* {_NUMBER} \s*
    (?: ([hd°:]) \s* (?: {_NUMBER} \s* (?: [m'′:] \s* (?: {_NUMBER} \s* [s"″]? \s* )? )? )? )?""",
    re.VERBOSE,
)


class StatusLine(NamedTuple):
    """One field: its name, its value with its unit, and whether it wants attention."""

    name: str
    value: str
    loud: bool = False


class Group(NamedTuple):
    """Fields that belong together."""

    title: str
    lines: tuple[StatusLine, ...]


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
            raise BadInputError(f"{what} {text!r}: {number} must be a whole number, as {name} follow it")
        if float(follower) >= 60.0:
            raise BadInputError(f"{what} {text!r}: {follower} {name}: must be below 60")
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
    """Return an angle of hours as `05h 30m 00.0s`; without a sign, one below 24h."""
    if value_h is None:
        return NOTHING
    tenths = round(abs(value_h) * 36000.0) if sign else round(value_h * 36000.0) % 864000
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


def clock_text(offset_s: float | None) -> str:
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
    name = "" if azimuth is None else " " + cardinal(azimuth)
    low = status.altitude_deg is not None and status.altitude_deg < view.floor_altitude_deg
    offset_s = view.clock_offset_s
    own: tuple[StatusLine, ...] = ()
    if view.looks_at_deg is not None:
        ra_deg, dec_deg = view.looks_at_deg
        own = (StatusLine("looks at RA", hours(ra_deg / 15.0)), StatusLine("looks at Dec", degrees(dec_deg)))
    return Group(
        "pointing",
        (
            *own,
            StatusLine("RA", hours(status.ra_h)),
            StatusLine("Dec", degrees(status.dec_deg)),
            StatusLine("hour angle", hours(hour_angle, sign=True)),
            StatusLine("altitude", number(status.altitude_deg, 2, "°"), low),
            StatusLine("azimuth", number(azimuth, 2, "°") + name),
            StatusLine("pier side", "beyond pole" if status.side_of_pier else "normal"),
            StatusLine("sidereal", hours(status.sidereal_h)),
            StatusLine("its clock", clock_text(offset_s), offset_s is not None and abs(offset_s) > 2.0),
            StatusLine("target RA", hours(status.target_ra_h)),
            StatusLine("target Dec", degrees(status.target_dec_deg)),
        ),
    )


def drives(view: ConsoleView, status: Status) -> Group:
    """Return what the drives do; rates in tenths of encoder tics a second, as the mount tells them."""
    del view
    return Group(
        "drives (tics/10 s)",
        (
            StatusLine("RA rate", number(status.ra_rate_dtics_s, 0, sign=True)),
            StatusLine("  in °/s", number(status.ra_rate_dtics_s / DTICS_S_PER_DEG_S, 4, sign=True)),
            StatusLine("Dec rate", number(status.dec_rate_dtics_s, 0, sign=True)),
            StatusLine("  in °/s", number(status.dec_rate_dtics_s / DTICS_S_PER_DEG_S, 4, sign=True)),
            StatusLine("RA current", number(status.ra_current_10ma / 100.0, 2, " A")),
            StatusLine("Dec current", number(status.dec_current_10ma / 100.0, 2, " A")),
            StatusLine("RA guide", number(status.ra_guide_rate_dtics_s, 0)),
            StatusLine("Dec guide", number(status.dec_guide_rate_dtics_s, 0)),
            StatusLine("RA drive", f"status {status.ra_drive_status_1} {status.ra_drive_status_2}"),
            StatusLine("Dec drive", f"status {status.dec_drive_status_1} {status.dec_drive_status_2}"),
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
            StatusLine("slewing", yes(status.slewing)),
            StatusLine("tracking", yes(status.tracking)),
            StatusLine("pulse guiding", yes(status.pulse_guiding)),
            StatusLine("at home", yes(status.at_home)),
            StatusLine("at park", yes(status.at_park)),
            StatusLine("connected", yes(status.connected), not status.connected),
            StatusLine("refraction", yes(status.does_refraction)),
            StatusLine("tracking rate", rate),
            StatusLine("equatorial", system),
        ),
    )


def acknowledgements(view: ConsoleView, status: Status) -> Group:
    """Return which commands the mount acknowledges just now."""
    del view
    names = ("move_ra", "move_dec", "slew", "sync", "pulse_guide", "abort")
    return Group(
        "acknowledged",
        tuple(StatusLine(name.replace("_", " "), yes(getattr(status, f"ack_{name}"))) for name in names),
    )


def place(view: ConsoleView, status: Status) -> Group:
    """Return where the mount believes it stands, and what is left of its datagram."""
    del view
    utc = " ".join(str(byte) for byte in (status.utc_1, status.utc_2, status.utc_3))
    return Group(
        "site and datagram",
        (
            StatusLine("latitude", number(status.site_latitude_deg, 4, "°", sign=True)),
            StatusLine("longitude", number(status.site_longitude_deg, 4, "°", sign=True)),
            StatusLine("height", number(status.site_height_m, 0, " m")),
            StatusLine("counter", str(status.counter)),
            StatusLine("UTC bytes", utc),
            StatusLine("spare", str(status.spare)),
        ),
    )


def readings(view: ConsoleView) -> Group:
    """Return how the mount reads what the protocol's paper gives two readings."""
    seen, unseen = view.readings, "only zeros so far"
    return Group(
        "read as",
        (
            StatusLine("RA rate", seen.ra_rate_dtics_s or unseen),
            StatusLine("Dec rate", seen.dec_rate_dtics_s or unseen),
            StatusLine("counter", seen.counter or unseen),
            StatusLine("RA guide", seen.ra_guide_rate_dtics_s or unseen),
            StatusLine("Dec guide", seen.dec_guide_rate_dtics_s or unseen),
            StatusLine("tracking", seen.tracking or "not seen slewing"),
            StatusLine("MoveAxis", f"{view.move_axis}, by the profile"),
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
            StatusLine("state", heard.state, heard.state in ("stale", "lost")),
            StatusLine("rate", number(heard.rate_hz, 2, " /s")),
            StatusLine("jitter", number(heard.jitter_ms, 2, " ms")),
            StatusLine("age", number(heard.age_s, 2, " s")),
            StatusLine("sent", str(heard.sent)),
            StatusLine("heard", str(heard.received)),
            StatusLine("lost", str(heard.lost), heard.lost > 0),
            StatusLine("late", str(heard.late), heard.late > 0),
            StatusLine("double", str(heard.duplicate), heard.duplicate > 0),
            StatusLine("rejected", str(heard.rejected), heard.rejected > 0),
            StatusLine("strangers", strangers, heard.strangers > 0),
            StatusLine("restarts", str(heard.restarts), heard.restarts > 0),
            StatusLine("run twice", str(heard.doubled_launches), heard.doubled_launches > 0),
            StatusLine("foreign acks", str(heard.foreign_acks), heard.foreign_acks > 0),
        ),
    )


def is_alpaca(view: ConsoleView) -> bool:
    """Tell whether the mount is an Alpaca telescope, whose statuses are made of what its driver tells."""
    return view.mount.startswith(("alpaca:", "indi:"))


def alpaca_groups(view: ConsoleView, status: Status) -> tuple[Group, ...]:
    """Return what an Alpaca telescope tells, and how its requests are answered."""
    not_reported = {"its clock", "target RA", "target Dec"}
    here = pointing(view, status)
    rates = (status.ra_rate_dtics_s, status.dec_rate_dtics_s)
    guides = (status.ra_guide_rate_dtics_s, status.dec_guide_rate_dtics_s)
    hour_angle, dec = (number(rate / DTICS_S_PER_DEG_S, 4, " °/s", sign=True) for rate in rates)
    guide_ra, guide_dec = (
        number(rate / DTICS_S_PER_DEG_S, 4, " °/s") if rate else NOTHING for rate in guides
    )
    reported = {"slewing", "tracking", "pulse guiding", "at home", "at park", "refraction"}
    site = {"latitude", "longitude", "height"}
    heard = {"state", "rate", "jitter", "age", "heard"}
    return (
        Group(here.title, tuple(line for line in here.lines if line.name not in not_reported)),
        Group(
            "axes, from positions",
            (
                StatusLine("hour angle", hour_angle),
                StatusLine("declination", dec),
                StatusLine("guides RA", guide_ra),
                StatusLine("guides Dec", guide_dec),
            ),
        ),
        Group("state", tuple(line for line in state(view, status).lines if line.name in reported)),
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
    groups = tuple(make(view, status) for make in (pointing, drives, state, acknowledgements, place))
    return (*groups, readings(view), link(view))


def status_text(view: ConsoleView, *more: Group) -> str:
    """Return a status as a table to be read, with `more` groups at its beginning."""
    rows = [f"{view.mount}  {local_time.instant(view.utc_s, 3)}  profile {view.profile}"]
    for group in (*more, *status_groups(view)):
        rows += ["", group.title]
        rows += [f"  {line.name:<14}{line.value}" for line in group.lines]
    if view.warnings:
        rows += ["", "warnings"]
        rows += [f"  {text}" for text in view.warnings]
    return "\n".join(rows)


def pointing_text(view: ConsoleView) -> str:
    """Return where the mount stands, in a line."""
    status = view.status
    if status is None:
        return "not heard"
    doing = "slewing" if status.slewing else "moving"
    if view.at_rest:
        doing = "at rest or tracking"
    elif status.at_park and not status.slewing:
        # Drives that lose their power end the tracking of the sky: that is a motion, to its positions.
        doing = "at park, as it reports"
    altitude = number(status.altitude_deg, 1, "°")
    ra_deg, dec_deg = view.looks_at_deg or (15.0 * status.ra_h, status.dec_deg)
    return f"RA {hours(ra_deg / 15.0)}  Dec {degrees(dec_deg)}  alt {altitude}  {doing}"


ALONG_AND_ACROSS = ("along_s", "cross_deg")
NO_PRIORITY = ", without real-time priority (`sattrack doctor` says how to grant it)"


OLD_ELEMENTS_DAYS = 3.0
"""From here on an element set of a low orbit is off by arcminutes along its track."""


EQUATORIAL = ("hour angle", "declination")


def limit_title(limit: str, axes: tuple[str, str] = EQUATORIAL) -> str:
    """Return what a limit is called where the mount's axes are called so."""
    return {"hour_angle": axes[0], "declination": axes[1]}.get(limit, limit.replace("_", " "))


def named(name: str, catalog_number: int | None) -> str:
    """Return an object's name, with its catalogue number where it has one."""
    return name if catalog_number is None else f"{name} ({catalog_number})"


def summary_lines(summary: Summary) -> list[str]:
    """Return the summary for people."""
    uncalibrated = ", uncalibrated" if summary.calibrated is False and summary.mount != "sim" else ""
    times = local_time.span(iso_unix_s(summary.started_utc), iso_unix_s(summary.ended_utc))
    lines = [
        f"{named(summary.name, summary.catalog_number)} with {summary.mount}{uncalibrated}: "
        f"ended by {summary.ended_by}",
        f"  {times}, on target {summary.on_target_s:.1f} s",
    ]
    lines.extend(_source_lines(summary))
    if summary.acquired_after_s is not None:
        lines.append(f"  acquired {summary.acquired_after_s:.1f} s after it could be followed")
    for word, rms, peak in (
        ("reported", summary.reported_rms_arcsec, summary.reported_peak_arcsec),
        ("true", summary.true_rms_arcsec, summary.true_peak_arcsec),
    ):
        if rms is not None and peak is not None:
            lines.append(f"  {word} error {rms:.3f}″ RMS, {peak:.3f}″ peak")
    for name, seconds in summary.held_s.items():
        lines.append(f"  held {seconds:.1f} s at the {name} limit")
    if summary.paused_s:
        lines.append(f"  paused for {summary.paused_s:.1f} s")
    if summary.rejoining_s:
        off = f", up to {arcsec(summary.lost_peak_arcsec)} off" if summary.lost_peak_arcsec else ""
        lines.append(f"  returning to the target {summary.rejoining_s:.1f} s{off}: not in the error")
    counts = summary.datagrams
    lines.append(
        f"  datagrams: {counts.sent} sent, {counts.received} received, {counts.lost} lost, "
        f"{counts.late} late, {counts.rejected} rejected"
    )
    if summary.period_ms is not None:
        plain = "" if summary.realtime_priority is not False else NO_PRIORITY
        lines.append(
            f"  period {summary.period_ms.p50:.2f} ms median, {summary.period_ms.p99:.2f} ms p99{plain}"
        )
    if summary.bias_along_s or summary.bias_cross_deg:
        lines.append(f"  bias {summary.bias_along_s:+.3f} s along, {summary.bias_cross_deg:+.4f}° across")
    if summary.camera is not None:
        lines.append(_camera_line(summary.camera))
    lines.extend(_bias_lines(summary))
    if summary.why_not_acquired is not None and summary.why_not_acquired not in (summary.message or ""):
        lines.append(f"  never on target: {summary.why_not_acquired}")
    if summary.learnt is not None:
        lines.append(f"  learnt about the mount: {learnt_line(summary.learnt)}")
    if summary.recording is not None:
        trouble = "" if summary.recording_trouble is None else f": {summary.recording_trouble}"
        lines.append(f"  recorded in {summary.recording}{trouble}")
    return lines


def _camera_line(camera: CameraSummary) -> str:
    line = f"  cameras: {counted(camera.frames, 'frame')}, the satellite found in {camera.detected}"
    if camera.frames and not camera.detected:
        line += ": it was out of the field, or too faint; try a wider camera, or --bias-along"
    return line


def _source_lines(summary: Summary) -> list[str]:
    age_days, age_s = summary.elements_age_days, summary.source_age_s
    if age_days is not None:
        if abs(age_days) < OLD_ELEMENTS_DAYS:
            return []
        return [f"  against elements {abs(age_days):.0f} days {'old' if age_days > 0.0 else 'ahead'}"]
    if summary.source is None or age_s is None:
        return []
    file = "" if summary.source_file is None else f"{summary.source_file}: "
    return [f"  by {file}{summary.source}, {old(age_s)}, {source_error(summary.expected_error_m)}"]


def _bias_lines(summary: Summary) -> list[str]:
    others = [one for one in summary.offsets if one.what not in ALONG_AND_ACROSS]
    lines = [f"  offset {one.what}: {one.total:+.4f}" for one in others]
    if summary.remembered is not None:
        known = summary.remembered
        lines.append(f"  started with a remembered bias ({known.source}): {known.state}")
    if summary.bias_memory is not None:
        lines.append(f"  bias memory: {summary.bias_memory}")
    clocks = () if summary.loop is None else summary.loop.clocks
    lines += [f"  camera {one.camera}: {camera_clock_text(one)}" for one in clocks]
    estimate = summary.estimate
    if estimate is None:
        return lines
    counts = f"{estimate.accepted} taken, {estimate.rejected} rejected, {estimate.refused} refused"
    if estimate.begun_anew:
        counts += f"; restarted {times_text(estimate.begun_anew)}"
    if estimate.rejected and not estimate.accepted:
        counts += (
            ": none fits the elements; check satellite, site and clock (sattrack bias fits larger errors)"
        )
    lines.append(f"  observations: {counts}")
    if estimate.along_s is not None and estimate.cross_deg is not None:
        lines.append(
            f"  estimated {estimate.along_s:+.4f} ± {estimate.along_sigma_s or 0.0:.4f} s along, "
            f"{estimate.cross_deg:+.5f} ± {estimate.cross_sigma_deg or 0.0:.5f}° across"
        )
    return lines


def loop_text(loop: LoopView, plain: bool = False) -> str:
    """Return what closes the loop on the sky, in a few words."""
    size = loop.sigma_arcsec
    mark = '"' if plain else "″"
    sigma = "" if size is None else f" {within(f'{size:.3g}', plain)}{mark}"
    if loop.state == "lost":
        return f"lost, predicted {loop.predicted_s or 0.0:.0f} s{sigma}"
    return "elements only" if loop.state == "elements" else f"camera{sigma}"


def camera_clock_text(clock: ClockView) -> str:
    """Return what the stars say of a camera's clock, in a few words."""
    side = "ahead" if clock.clock_s > 0.0 else "behind"
    done = ", its dates are corrected" if clock.corrected_s else ""
    return f"its clock is {abs(clock.clock_s):.3f} ± {clock.sigma_s:.3f} s {side} by the stars{done}"


def learnt_line(learnt: LearntView) -> str:
    """Return what was learnt of a mount in a line. Rates that hardly vary tell of an axis neither."""
    ra = _lag(learnt.ra_lag_s, learnt.ra_lag_sigma_s, learnt.ra_gain)
    dec = _lag(learnt.dec_lag_s, learnt.dec_lag_sigma_s, learnt.dec_gain)
    gains = f"gain RA {_gain(learnt.ra_gain)}, Dec {_gain(learnt.dec_gain)}"
    delay_s, sigma_s = learnt.command_delay_s, learnt.command_delay_sigma_s
    delay = f"command delay {1e3 * delay_s:.1f}±{1e3 * sigma_s:.1f} ms"
    if delay_s < -2.0 * sigma_s:
        delay += " (status_delay_s is too large)"
    anew = f", filters restarted {times_text(learnt.restarts)}" if learnt.restarts else ""
    return f"lag RA {ra}, Dec {dec}; {gains}; {delay}; settling {learnt.settling_s:.2f} s{anew}"


def counted(count: int, one: str, many: str | None = None) -> str:
    """Return how many of something there are, as text; `many` where its plural is not made with an s."""
    return f"1 {one}" if count == 1 else f"{count} {many or f'{one}s'}"


def times_text(count: int) -> str:
    """Return how often something happened, as text."""
    return "once" if count == 1 else f"{count} times"


def _lag(lag_s: float, sigma_s: float, gain: float | None) -> str:
    return "not known" if gain is None else f"{1e3 * lag_s:.0f}±{1e3 * sigma_s:.0f} ms"


def _gain(gain: float | None) -> str:
    return "not known" if gain is None else f"{gain:.4f}"
