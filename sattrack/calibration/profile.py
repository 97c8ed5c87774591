"""Findings as a mount profile, and as a table for the operator."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

import msgspec

from sattrack.mount import AxisLimits, CalibrationRecord, MountProfile
from tle.instants import Utc

if TYPE_CHECKING:
    from sattrack.calibration.findings import Findings, Interval
    from sattrack.calibration.motion import AxisResponse


Profile = TypeVar("Profile", bound=MountProfile)


def calibrated(base: MountProfile, found: Findings, name: str | None, program: str) -> MountProfile:
    """Return a profile with what was found put in place of what it said; the rest is the base's.

    Signs are those of the side of the pier on which the mount stood. Where the base was measured on the other
    side, that side's signs stay; where nothing was measured, both sides take these until the other is.
    """
    delays = found.delays
    changes: dict[str, Any] = {
        "name": name or base.name,
        "ra": _limits(base.ra, found.ra),
        "dec": _limits(base.dec, found.dec),
        **_signs(base, found),
        "ra_rate_gain": found.ra.gain,
        "dec_rate_gain": found.dec.gain,
        "additive": found.additive,
        "move_axis": found.move_axis,
        "command_delay_s": delays.best_command_s,
        "status_delay_s": delays.best_status_s,
        "clock_offset_s": delays.clock_reading_s,
        "readings": {**base.readings, **found.readings},
        "calibration": _record(base, found, program),
    }
    return msgspec.structs.replace(base, **changes)


def bounded(profile: Profile, largest_deg_s: tuple[float, float] | None) -> Profile:
    """Return a profile with the largest rates that the mount tells of, right ascension first."""
    if largest_deg_s is None:
        return profile
    ra, dec = (
        msgspec.structs.replace(limits, max_rate_deg_s=largest)
        for limits, largest in zip((profile.ra, profile.dec), largest_deg_s, strict=True)
    )
    return msgspec.structs.replace(profile, ra=ra, dec=dec)


def _signs(base: MountProfile, found: Findings) -> dict[str, Any]:
    beyond: dict[str, Any] = {
        "ra_rate_sign_beyond_pole": found.ra.sign,
        "dec_rate_sign_beyond_pole": found.dec.sign,
    }
    normal: dict[str, Any] = {"ra_rate_sign": found.ra.sign, "dec_rate_sign": found.dec.sign}
    if not found.beyond_pole:
        return normal
    return beyond if _measured(base, "normal") else {**normal, **beyond}


def _measured(base: MountProfile, side: str) -> bool:
    record = base.calibration
    return record is not None and (record.side_of_pier == side or record.both_sides)


def _record(base: MountProfile, found: Findings, program: str) -> CalibrationRecord:
    delays = found.delays
    return CalibrationRecord(
        utc=Utc(found.utc_s).isoformat("seconds"),
        program=program,
        side_of_pier="beyond_pole" if found.beyond_pole else "normal",
        ra_gain_sigma=found.ra.gain_sigma,
        dec_gain_sigma=found.dec.gain_sigma,
        round_trip_s=delays.round_trip.seconds,
        round_trip_sigma_s=delays.round_trip.sigma_s,
        command_delay_interval_s=delays.command_s,
        status_delay_interval_s=delays.status_s,
        clock_offset_interval_s=delays.clock_offset_s,
        clock_drift_ppm=found.clock.drift_ppm,
        clock_drift_sigma_ppm=found.clock.slope_sigma * 1e6,
        status_period_s=found.period.mean_s,
        status_period_jitter_s=found.period.jitter_s,
        both_sides=_measured(base, "normal" if found.beyond_pole else "beyond_pole"),
        ra_acceleration_sigma_deg_s2=found.ra.acceleration_sigma_deg_s2,
        dec_acceleration_sigma_deg_s2=found.dec.acceleration_sigma_deg_s2,
    )


def _limits(base: AxisLimits, found: AxisResponse) -> AxisLimits:
    if found.acceleration_deg_s2 is None:
        return base
    return msgspec.structs.replace(base, max_acceleration_deg_s2=found.acceleration_deg_s2)


def table(found: Findings) -> list[tuple[str, str]]:
    """Return rows of name and value, each value with its uncertainty, for the operator."""
    delays, trip = found.delays, found.delays.round_trip
    rows = [
        ("side of the pier", "beyond the pole" if found.beyond_pole else "normal"),
        ("MoveAxis", f"{found.move_axis}{_zero_words(found)}"),
        ("MoveAxis in right ascension", "additive to sidereal" if found.additive else "absolute"),
    ]
    for words, axis in (("right ascension", found.ra), ("declination", found.dec)):
        rows.append((f"{words}, sign", "as commanded" if axis.sign > 0 else "turned"))
        rows.append((f"{words}, gain", f"{axis.gain:.7f} ± {axis.gain_sigma:.7f}"))
        rows.append((f"{words}, acceleration limit", _acceleration_words(axis)))
    rows += [
        ("round trip", f"{trip.seconds * 1e3:.2f} ± {trip.sigma_s * 1e3:.2f} ms"),
        ("command delay", f"{_ms(delays.command_s)}, {_split_words(found)}"),
        ("status delay", f"{_ms(delays.status_s)}, {_split_words(found)}"),
        ("mount's clock ahead", f"{delays.clock_offset_s[0]:.4f} to {delays.clock_offset_s[1]:.4f} s"),
        (
            "mount's clock drift",
            f"{found.clock.drift_ppm:+.3f} ± {found.clock.slope_sigma * 1e6:.3f} millionths",
        ),
        (
            "status period",
            f"{found.period.mean_s * 1e3:.3f} ms, single ones ± {found.period.jitter_s * 1e3:.2f} ms",
        ),
        ("lateness of statuses", f"{found.clock.jitter_s * 1e3:.2f} ms in the mean after the fastest"),
        ("statuses", f"{found.statuses} heard, {found.lost} lost, in {found.seconds:.0f} s"),
    ]
    for name in sorted(found.readings):
        rows.append((f"field {name}", found.readings[name]))
    return rows


def _zero_words(found: Findings) -> str:
    if found.zero_ends is None:
        return ""
    return (
        ", ended by a rate of 0" if found.zero_ends else ", not ended by a rate of 0: only an abort ends it"
    )


def _acceleration_words(axis: AxisResponse) -> str:
    if axis.acceleration_deg_s2 is None or axis.acceleration_sigma_deg_s2 is None:
        return "too high to be seen; left as it was"
    return f"{axis.acceleration_deg_s2:.3f} ± {axis.acceleration_sigma_deg_s2:.3f} °/s²"


def _split_words(found: Findings) -> str:
    if found.delays.clock_reading is not None:
        return f"by the mount's clock ({found.delays.clock_reading})"
    return "together the round trip"


def _ms(interval: Interval) -> str:
    return f"{interval[0] * 1e3:.1f} to {interval[1] * 1e3:.1f} ms"
