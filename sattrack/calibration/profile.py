"""Findings as a mount profile, and as a table for the operator."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

import msgspec

from sattrack.control.estimate import begun_anew
from sattrack.mount.alpaca.device import GERMAN
from sattrack.mount.model import (
    GERMAN_TRAVEL_DEG,
    USUAL_TRAVEL_DEG,
    AxisLimits,
    CalibrationRecord,
    MeasuredMotion,
    MountProfile,
)
from sattrack.mount.profiles import profile_text
from sattrack.pointing.periodic import wave_text
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sattrack.calibration.findings import Findings, Interval, RateFields, SlewingField
    from sattrack.calibration.motion import AxisMotion, AxisResponse
    from sattrack.calibration.servo import Measured
    from sattrack.pointing.learn import HeldOut, Learnt
    from sattrack.views.run import LearntView


RATE_FIELDS_WORDS: dict[RateFields | None, str] = {
    None: "not looked at",
    "true": "follow the axes",
    "meaningless": "do not tell what the axes do",
}
SLEWING_WORDS: dict[SlewingField | None, str] = {
    None: "not looked at",
    "true": "up while an axis moves",
    "quiet": "falls before the axes are at rest",
    "meaningless": "does not tell whether an axis moves",
}
LEARNT_LAG_SIGMA_S, LEARNT_GAIN_SIGMA = 0.012, 0.003
"""How well a pass must have taught a lag and a gain for them to be written, one sigma."""
LEAST_LAG_S = 0.0005
"""What a lag of nought, or below, is written as: 0 would say that nothing is known of it."""
Profile = TypeVar("Profile", bound=MountProfile)


def calibrated(base: MountProfile, found: Findings, name: str | None, program: str) -> MountProfile:
    """Return a profile with what was found put in place of what it said; the rest is the base's.

    Signs are those of the side of the pier on which the mount stood. Where the base was measured on the other
    side, that side's signs stay; where nothing was measured, both sides take these until the other is.
    """
    delays = found.delays
    changes: dict[str, Any] = {
        "name": name or base.name,
        "ra": _limits(base.ra, found.ra, found.ra_motion),
        "dec": _limits(base.dec, found.dec, found.dec_motion),
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


def german(profile: Profile, alignment_mode: int | None) -> Profile:
    """Return a profile with the rule by which a German telescope behind ASCOM changes its pier's side.

    That is one whose AlignmentMode says so, and of which the profile knows no rule.
    """
    if alignment_mode != GERMAN or profile.pier_rule != "never" or profile.geometry is not None:
        return profile
    limits = profile.dec_axis_limits_deg
    limits = GERMAN_TRAVEL_DEG if limits == USUAL_TRAVEL_DEG else limits
    return msgspec.structs.replace(profile, pier_rule="ascom", dec_axis_limits_deg=limits)


def with_learnt(base: Profile, learnt: LearntView, name: str) -> tuple[Profile, list[str]]:
    """Return a profile with what a pass has taught well enough, and what was changed, in words."""
    changes: dict[str, Any] = {"name": name}
    sigmas: dict[str, float] = {}
    lines = []
    for axis, words in (("ra", "right ascension"), ("dec", "declination")):
        found_s, lag_sigma_s = getattr(learnt, f"{axis}_lag_s"), getattr(learnt, f"{axis}_lag_sigma_s")
        if lag_sigma_s <= LEARNT_LAG_SIGMA_S and learnt.restarts == 0:
            lag_s = max(LEAST_LAG_S, round(found_s, 4))
            changes[axis] = msgspec.structs.replace(getattr(base, axis), lag_s=lag_s)
            sigmas[f"{axis}_lag_sigma_s"] = lag_sigma_s
            lines.append(f"lag in {words} {found_s * 1e3:.1f} ± {lag_sigma_s * 1e3:.1f} ms")
        gain, gain_sigma = getattr(learnt, f"{axis}_gain"), getattr(learnt, f"{axis}_gain_sigma")
        if gain is not None and gain_sigma <= LEARNT_GAIN_SIGMA:
            changes[f"{axis}_rate_gain"] = round(gain, 6)
            sigmas[f"{axis}_gain_sigma"] = gain_sigma
            lines.append(f"gain in {words} {gain:.5f} ± {gain_sigma:.5f}")
    delay_s, sigma_s = learnt.command_delay_s, learnt.command_delay_sigma_s
    if abs(delay_s - base.command_delay_s) > sigma_s:
        changes["command_delay_s"] = round(max(0.0, delay_s), 5)
        lines.append(f"command delay {max(0.0, delay_s) * 1e3:.1f} ± {sigma_s * 1e3:.1f} ms")
    if delay_s < -sigma_s:
        # Commands seem to act before they are sent: samples are dated too early by that.
        changes["status_delay_s"] = round(max(0.0, base.status_delay_s + delay_s), 5)
        lines.append(f"status delay {changes['status_delay_s'] * 1e3:.1f} ± {sigma_s * 1e3:.1f} ms")
    if base.calibration is not None:
        changes["calibration"] = msgspec.structs.replace(base.calibration, **sigmas)
    if learnt.sky is not None:
        changes["sky"] = learnt.sky
        delay_s, sigma_s = learnt.sky.mount["delay_s"]
        named = ", ".join(name or "without a name" for name in learnt.sky.cameras)
        lines.append(f"delay split {delay_s * 1e3:+.1f} ± {sigma_s * 1e3:.1f} ms, pointing, camera {named}")
    return msgspec.structs.replace(base, **changes), lines


def with_passes(base: Profile, found: Learnt, passes: int, name: str) -> Profile:
    """Return a profile with what cameras showed at recorded passes."""
    pointing, sky = base.pointing, base.sky
    if pointing is not None and found.terms is not None:
        terms = {
            term: (round(value + found.terms[term][0], 3), round(found.terms[term][1], 3))
            for term, (value, _) in pointing.terms.items()
        }
        utc = found.terms_held_out[-1].utc
        pointing = msgspec.structs.replace(pointing, utc=utc, terms=terms, passes=pointing.passes + passes)
        sky = begun_anew(sky, utc, pointing.held_out_rms_arcsec or pointing.rms_arcsec)
    return msgspec.structs.replace(base, name=name, periodic=found.periodic, pointing=pointing, sky=sky)


def passes_lines(found: Learnt) -> list[str]:
    """Return what recorded passes have taught, in words."""
    lines = []
    if found.periodic is not None:
        for words, waves in (("first", found.periodic.first), ("second", found.periodic.second)):
            if waves:
                lines.append(f"errors of the {words} axis: {', '.join(wave_text(wave) for wave in waves)}")
        lines.append(_held_out_text("these errors", found.held_out))
    if found.terms is not None:
        changes = (f"{name} {value:+.1f} ± {sigma:.1f}″" for name, (value, sigma) in found.terms.items())
        lines.append(f"pointing model: {', '.join(changes)}")
        lines.append(_held_out_text("that", found.terms_held_out))
    return [*lines, *found.notes]


def _held_out_text(what: str, outcome: Sequence[HeldOut]) -> str:
    parts = (f"{one.without_arcsec:.2f}″ to {one.with_arcsec:.2f}″" for one in outcome)
    return f"{what} bring each pass, held out of the fit, from {', '.join(parts)}"


def learnt_text(profile: MountProfile, lines: list[str], base_name: str, when: str) -> str:
    """Return a learnt profile as TOML, with what it is at its top; `when` names the pass."""
    lines = [
        f"Learnt while following {when}, from one pass: not calibrated.",
        f"What is not named here is of the profile {base_name!r}. Sigmas are the filters' own:",
        *lines,
    ]
    return "".join(f"# {line}\n" for line in lines) + "\n" + profile_text(profile)


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
        rate_fields=found.rate_fields,
        slewing_field=found.slewing_field,
        **_of_axis("ra", found.ra, found.ra_motion),
        **_of_axis("dec", found.dec, found.dec_motion),
    )


def _of_axis(name: str, response: AxisResponse, motion: AxisMotion) -> dict[str, Any]:
    """Return an axis' fields of the record, by name."""
    braking, lag = motion.braking, motion.lag
    values = {
        "acceleration_sigma_deg_s2": braking.acceleration_sigma_deg_s2 if braking else None,
        "limit_reached": braking.limited if braking else None,
        "starting": _motion(motion.starting),
        "braking": _motion(braking.stop) if braking else None,
        "lag_sigma_s": lag.sigma_s if lag else None,
        "fastest_deg_s": response.fastest_deg_s,
        "rate_limit_reached": response.rate_limit_reached,
    }
    return {f"{name}_{field}": value for field, value in values.items()}


def _motion(found: Measured | None) -> MeasuredMotion | None:
    if found is None:
        return None
    return MeasuredMotion(found.rate_deg_s, found.seconds, found.seconds_sigma, found.deg, found.deg_sigma)


def _limits(base: AxisLimits, found: AxisResponse, motion: AxisMotion) -> AxisLimits:
    changes: dict[str, float] = {}
    if motion.braking is not None and motion.braking.acceleration_deg_s2 is not None:
        changes["max_acceleration_deg_s2"] = motion.braking.acceleration_deg_s2
    if found.rate_limit_reached:
        changes["max_rate_deg_s"] = found.fastest_deg_s
    if motion.lag is not None:
        changes["lag_s"] = max(LEAST_LAG_S, motion.lag.seconds)
    return msgspec.structs.replace(base, **changes)


def found_rows(found: Findings) -> list[tuple[str, str]]:
    """Return rows of name and value, each value with its uncertainty, for the operator."""
    delays, trip = found.delays, found.delays.round_trip
    rows = [
        ("side of the pier", "beyond the pole" if found.beyond_pole else "normal"),
        ("MoveAxis", f"{found.move_axis}{_zero_text(found)}"),
        ("MoveAxis in right ascension", "additive to sidereal" if found.additive else "absolute"),
    ]
    axes = (("right ascension", found.ra, found.ra_motion), ("declination", found.dec, found.dec_motion))
    for words, axis, motion in axes:
        rows.append((f"{words}, sign", "as commanded" if axis.sign > 0 else "turned"))
        rows.append((f"{words}, gain", f"{axis.gain:.7f} ± {axis.gain_sigma:.7f}"))
        rows += [(f"{words}, {name}", value) for name, value in _motion_rows(axis, motion)]
    rows += [
        ("round trip", f"{trip.seconds * 1e3:.2f} ± {trip.sigma_s * 1e3:.2f} ms"),
        ("command delay", f"{_ms(delays.command_s)}, {_split_text(found)}"),
        ("status delay", f"{_ms(delays.status_s)}, {_split_text(found)}"),
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
    rows += [
        ("RightAscensionRate and DeclinationRate", RATE_FIELDS_WORDS[found.rate_fields]),
        ("Slewing", SLEWING_WORDS[found.slewing_field]),
    ]
    for name in sorted(found.readings):
        rows.append((f"field {name}", found.readings[name]))
    return rows


def _zero_text(found: Findings) -> str:
    if found.zero_ends is None:
        return ""
    return (
        ", ended by a rate of 0" if found.zero_ends else ", not ended by a rate of 0: only an abort ends it"
    )


def _motion_rows(axis: AxisResponse, motion: AxisMotion) -> list[tuple[str, str]]:
    limit = f"{axis.fastest_deg_s:.3f} °/s"
    return [
        ("rate limit", limit if axis.rate_limit_reached else f"at least {limit}"),
        ("acceleration", _acceleration_text(motion)),
        ("start", _motion_text(motion.starting)),
        ("stop", _motion_text(motion.braking.stop if motion.braking else None)),
        ("lag", _lag_text(motion)),
    ]


def _acceleration_text(motion: AxisMotion) -> str:
    found = motion.braking
    if found is None or found.acceleration_deg_s2 is None or found.acceleration_sigma_deg_s2 is None:
        return "too high to be seen; left as it was"
    value = f"{found.acceleration_deg_s2:.3f} ± {found.acceleration_sigma_deg_s2:.3f} °/s²"
    return value if found.limited else f"{value} by the whole stop; the axis' limit was not reached"


def _motion_text(found: Measured | None) -> str:
    if found is None:
        return "not seen"
    return (
        f"{found.seconds:.3f} ± {found.seconds_sigma:.3f} s and {found.deg:.4f} ± {found.deg_sigma:.4f}° "
        f"at {found.rate_deg_s:.3f} °/s"
    )


def _lag_text(motion: AxisMotion) -> str:
    if motion.lag is None:
        return "could not be measured; left as it was"
    return f"{motion.lag.seconds * 1e3:.1f} ± {motion.lag.sigma_s * 1e3:.1f} ms"


def _split_text(found: Findings) -> str:
    if found.delays.clock_reading is not None:
        return f"by the mount's clock ({found.delays.clock_reading})"
    return "together the round trip"


def _ms(interval: Interval) -> str:
    return f"{interval[0] * 1e3:.1f} to {interval[1] * 1e3:.1f} ms"
