"""What is in a recording, and what is remarkable about it: for people before they use it."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import msgspec

from sattrack.mount.model import SIDEREAL_RATE_DEG_S
from sattrack.mount.xerxes.datagrams import DatagramError, decode_status
from sattrack.recording.environment import Environment
from sattrack.recording.format import COMMAND, REPEAT, STATUS, SUMMARY
from tle.instants import Utc

if TYPE_CHECKING:
    from sattrack.recording.reading import Recording

STEP_S = 0.5
"""A clock that gains or loses this much from one status to the next was set."""


class Step(msgspec.Struct, frozen=True):
    """Where one of the clocks was set: ours against the mount's own, positive where ours jumped ahead."""

    utc: str
    ahead_s: float


class RecordingView(msgspec.Struct, frozen=True):
    """What a recording holds; times ISO 8601 UTC, null where nothing tells."""

    recording: str
    format_version: int
    program_version: str
    fingerprint: str | None
    environment: Environment | None
    began_utc: str | None
    ended_utc: str | None
    seconds: float
    bytes: int
    messages: dict[str, int]
    whole: bool
    ended_properly: bool
    clock_steps: tuple[Step, ...]
    problems: tuple[str, ...]
    summary: msgspec.Raw | None


def look(recording: Recording) -> RecordingView:
    """Return what a recording holds."""
    steps = clock_steps(recording)
    problems = list(recording.problems)
    problems += [f"a clock was set at {step.utc}, by {step.ahead_s:+.3f} s" for step in steps]
    instants = [e.utc_s for e in recording.entries() if e.topic in {STATUS, COMMAND, REPEAT}]
    first, last = (min(instants), max(instants)) if instants else (None, None)
    summary = next((e.data for e in recording.entries() if e.topic == SUMMARY), None)
    header = recording.header
    return RecordingView(
        recording=str(recording.path),
        format_version=header.format_version,
        program_version=header.program_version,
        fingerprint=header.fingerprint,
        environment=header.environment,
        began_utc=_iso(first),
        ended_utc=_iso(last),
        seconds=0.0 if first is None or last is None else round(last - first, 3),
        bytes=recording.path.stat().st_size,
        messages=dict(Counter(entry.topic for entry in recording.entries())),
        whole=recording.whole,
        ended_properly=not recording.cut_off,
        clock_steps=tuple(steps),
        problems=tuple(problems),
        summary=None if summary is None else msgspec.Raw(summary),
    )


def clock_steps(recording: Recording) -> list[Step]:
    """Return where our clock jumped against the mount's sidereal one, from status to status."""
    found: list[Step] = []
    before: tuple[float, float] | None = None
    for entry in recording.entries():
        if entry.topic != STATUS:
            continue
        try:
            sidereal_h = decode_status(entry.data).sidereal_h
        except DatagramError:
            continue
        if before is not None:
            turned_deg = (sidereal_h - before[1]) * 15.0
            passed_s = entry.utc_s - before[0]
            # The mount's clock tells time within a day; the difference is taken the short way round.
            off_deg = (passed_s * SIDEREAL_RATE_DEG_S - turned_deg + 180.0) % 360.0 - 180.0
            if abs(off_deg) > STEP_S * SIDEREAL_RATE_DEG_S:
                found.append(Step(Utc(entry.utc_s).isoformat("milliseconds"), off_deg / SIDEREAL_RATE_DEG_S))
        before = entry.utc_s, sidereal_h
    return found


def _iso(utc_s: float | None) -> str | None:
    return None if utc_s is None else Utc(utc_s).isoformat("milliseconds")
