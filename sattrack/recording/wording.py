"""What a replay found, in lines for people and as one object for scripts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

from sattrack.recording.comparison import Figures
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sattrack.recording.comparison import Difference
    from sattrack.recording.replay import Divergence, Replay

MODES = {
    "bytes": "byte for byte",
    "rounding": "to 1e-9 °/s, and the rest byte for byte",
    "figures": "by figures",
}
VERDICTS = {
    "same": "the same, to the last byte",
    "equivalent": "equivalent",
    "different": "NOT THE SAME",
}
MOST_FIELDS = 4


class FieldView(msgspec.Struct, frozen=True):
    """One field of a command that came out otherwise."""

    field: str
    expected: float
    got: float


class DivergenceView(msgspec.Struct, frozen=True):
    """The first output that the comparison does not let pass."""

    tick: int
    utc: str
    after: str
    fields: tuple[FieldView, ...]


class ReplayView(msgspec.Struct, frozen=True):
    """How a replay went, for scripts."""

    recording: str
    agrees: bool
    comparison: str
    why: str
    ticks: int
    statuses: int
    seconds: float
    differing: int
    largest_rate_difference_deg_s: float
    divergence: DivergenceView | None
    recorded: Figures
    replayed: Figures
    reasons: tuple[str, ...]
    problems: tuple[str, ...]
    faster_than_real_time: float | None = None
    verdict: str = "same"
    """"same": every command to the last byte; "equivalent": what differs is within what the comparison lets
    pass; else "different", and `agrees` is false."""


def replay_view(
    path: str, result: Replay, problems: Sequence[str], took_s: float | None = None
) -> ReplayView:
    """Return a replay's result as one object."""
    found = result.divergence
    return ReplayView(
        recording=path,
        agrees=result.agrees,
        comparison=result.choice.mode,
        why=result.choice.why,
        ticks=result.ticks,
        statuses=result.statuses,
        seconds=round(result.seconds, 3),
        differing=result.differing,
        largest_rate_difference_deg_s=result.largest_rate_deg_s,
        divergence=None if found is None else _divergence_view(found),
        recorded=result.recorded,
        replayed=result.replayed,
        reasons=tuple(result.reasons),
        problems=tuple(problems),
        faster_than_real_time=round(result.seconds / took_s, 1) if took_s else None,
        verdict=result.verdict,
    )


def _divergence_view(found: Divergence) -> DivergenceView:
    fields = tuple(FieldView(*difference) for difference in found.fields)
    return DivergenceView(found.tick, Utc(found.utc_s).isoformat("microseconds"), found.after, fields)


def replay_lines(result: Replay, took_s: float | None = None) -> list[str]:
    """Return a replay's result in lines: the verdict, the comparison and why, the first divergence."""
    told = f"{result.ticks} commands from {result.statuses} statuses in {result.seconds:.0f} s of the run"
    lines = [f"{VERDICTS[result.verdict]}{_differing(result)}: {told}"]
    lines.append(f"compared {MODES[result.choice.mode]}: {result.choice.why}")
    lines += [f"  {reason}" for reason in result.reasons]
    if result.stopped_utc_s is not None:
        at = Utc(result.stopped_utc_s).isoformat("milliseconds")
        lines.append(f"compared up to {at}: messages are missing there")
    if result.divergence is not None:
        lines.append(divergence_line(result.divergence))
    if result.verdict == "different":
        lines.append(f"largest difference of a rate: {result.largest_rate_deg_s:.3g} °/s")
    lines.append(
        f"RMS {_arcsec(result.replayed.rms_arcsec)} (recorded {_arcsec(result.recorded.rms_arcsec)}), "
        f"peak {_arcsec(result.replayed.peak_arcsec)} (recorded {_arcsec(result.recorded.peak_arcsec)})"
    )
    if took_s:
        lines.append(f"replayed in {took_s:.2f} s, {result.seconds / took_s:.0f} times as fast as it was")
    return lines


def _differing(result: Replay) -> str:
    if result.verdict != "equivalent":
        return ""
    return f", largest difference {result.largest_rate_deg_s:.3g} °/s, in {result.differing} commands"


def divergence_line(found: Divergence) -> str:
    """Return the first divergence in one line: instant, input, expected and got."""
    at = Utc(found.utc_s).isoformat("microseconds")
    fields = "; ".join(_field(difference) for difference in found.fields[:MOST_FIELDS])
    more = len(found.fields) - MOST_FIELDS
    rest = f"; {more} more fields" if more > 0 else ""
    return f"first at {at}, command {found.tick + 1}, after {found.after}: {fields}{rest}"


def _field(difference: Difference) -> str:
    return f"{difference.field} expected {difference.expected!r}, got {difference.got!r}"


def _arcsec(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}″"
