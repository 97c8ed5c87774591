"""A recording's inputs run through today's code, and every output compared with the recorded one."""

from __future__ import annotations

import struct
from array import array
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, NamedTuple

import msgspec

from sattrack.core.errors import NO_JSON
from sattrack.core.process import gc_paused
from sattrack.mount.xerxes.datagrams import COMMAND_FIELDS, DatagramError, Kind, decode_command
from sattrack.recording.format import (
    COMMAND,
    DATA,
    FAILURE,
    GAP,
    OPERATOR,
    REPEAT,
    STATUS,
    SUMMARY,
    VIEW,
    Entry,
    Environment,
    Failure,
    Recording,
    fingerprint,
    here,
    lasted_s,
)
from sattrack.views.formatting import counted
from sattrack.views.messages import decode_message
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from sattrack.control.engine import Engine
    from sattrack.recording.format import RunHeader

Mode = Literal["bytes", "rounding", "figures"]
ROUNDING_DEG_S = 1e-9
"""By how much a command may differ where linear algebra rounds differently, degrees a second."""
RATES = ("move_ra_rate_deg_s", "move_dec_rate_deg_s")
_DOUBLES = tuple(f.name for f in COMMAND_FIELDS if f.kind is Kind.DOUBLE)
_OTHERS = tuple(f.name for f in COMMAND_FIELDS if f.kind not in {Kind.DOUBLE, Kind.UINT64})


class Choice(NamedTuple):
    """Which comparison applies, and why."""

    mode: Mode
    why: str


class Difference(msgspec.Struct, frozen=True):
    """One field of a command that came out otherwise."""

    field: str
    expected: float
    got: float


class Figures(msgspec.Struct, frozen=True):
    """What a run came to, as its engine counts; None where that is not known."""

    rms_arcsec: float | None = None
    peak_arcsec: float | None = None
    samples: int | None = None
    on_target_s: float | None = None
    ended_by: str | None = None


class Tolerances(msgspec.Struct, frozen=True):
    """How far figures and commands of another version's run may be from the recorded ones.

    Figures may get worse by the larger of a share and an amount; they may always get better.
    """

    share: float = 0.05
    rms_arcsec: float = 0.02
    peak_arcsec: float = 0.2
    rate_deg_s: float = 0.02
    """Largest difference of a rate command, in all ticks but a share of `other_ticks`."""
    other_ticks: float = 0.01
    """Share of ticks whose flags or rates may differ by more: a slew that ends a tick sooner."""


def choose(header: RunHeader, code: str, here: Environment) -> Choice:
    """Return the comparison for a recording, replayed by code of a fingerprint in an environment."""
    if header.anonymous:
        return Choice("figures", "its site and its time were moved, and numbers round otherwise there")
    if header.environment is None or header.fingerprint is None:
        return Choice(
            "figures", f"a recording of format {header.format_version} does not say what code made it"
        )
    if header.fingerprint != code:
        return Choice(
            "figures",
            f"made by sattrack {header.program_version} with code {header.fingerprint}; this is code {code}",
        )
    other = _other(header.environment, here)
    if not other:
        return Choice("bytes", "the same code, libraries and kind of processor")
    changes = ", ".join(other)
    if any(name in changes for name in DATA):
        return Choice("figures", f"the same code, with other data: {changes}")
    return Choice("rounding", f"the same code, elsewhere: {changes}")


def _other(recorded: Environment, here: Environment) -> list[str]:
    pairs = {
        "machine": (recorded.machine, here.machine),
        "processor": (recorded.processor, here.processor),
        "Python": (recorded.python, here.python),
    }
    for name in recorded.libraries | here.libraries:
        pairs[name] = (recorded.libraries.get(name, "absent"), here.libraries.get(name, "absent"))
    return [f"{name} {here}, recorded with {was}" for name, (was, here) in pairs.items() if was != here]


def differences(expected: bytes, got: bytes) -> list[Difference]:
    """Return the fields in which two command datagrams differ; what is no command differs in its length."""
    try:
        one, other = decode_command(expected), decode_command(got)
    except DatagramError:
        return [Difference("length", len(expected), len(got))]
    pairs = ((name, getattr(one, name), getattr(other, name)) for name in (*_OTHERS, *_DOUBLES))
    return [Difference(name, was, is_) for name, was, is_ in pairs if _bits(was) != _bits(is_)]


def _bits(value: float) -> bytes:
    return struct.pack("<d", value)


def beyond_rounding(found: Sequence[Difference]) -> bool:
    """Return whether differences are more than another way of rounding."""
    return any(d.field not in _DOUBLES or not abs(d.got - d.expected) <= ROUNDING_DEG_S for d in found)


def larger_than(found: Sequence[Difference], rate_deg_s: float) -> bool:
    """Return whether a command asks for something else, or for a rate that differs by more than this.

    The counter is left out: it depends on how many datagrams went before.
    """
    for difference in found:
        if difference.field in RATES:
            if not abs(difference.got - difference.expected) <= rate_deg_s:
                return True
        elif difference.field in _OTHERS and difference.field != "counter":
            return True
    return False


def worse(recorded: Figures, replayed: Figures, allowed: Tolerances) -> list[str]:
    """Return which figures came out worse than they may, as text."""
    found = []
    figures = (
        ("RMS", recorded.rms_arcsec, replayed.rms_arcsec, allowed.rms_arcsec),
        ("peak", recorded.peak_arcsec, replayed.peak_arcsec, allowed.peak_arcsec),
    )
    for name, was, is_, amount in figures:
        if was is None:
            continue
        if is_ is None or is_ - was > max(amount, allowed.share * was):
            found.append(f"{name} {'none' if is_ is None else f'{is_:.3f}″'}, recorded {was:.3f}″")
    if recorded.ended_by is not None and recorded.ended_by != replayed.ended_by:
        found.append(f"ended by {replayed.ended_by}, recorded {recorded.ended_by}")
    return found


REPORT_EVERY = 500


class Output(NamedTuple):
    """One output of a run: its topic, its instant, the recorded datagram and today's."""

    topic: str
    utc_s: float
    recorded: bytes
    replayed: bytes


class Divergence(NamedTuple):
    """The first output that came out otherwise: which tick, when, after which input, and both datagrams."""

    tick: int
    utc_s: float
    recorded: bytes
    replayed: bytes
    after: str
    """The input before it, as text."""
    fields: tuple[Difference, ...]


@dataclass(slots=True)
class Replay:
    """How a replay went.

    `divergence` is the first output that the comparison does not let pass. `largest_rate_deg_s` is the
    largest difference of a rate command, `other_ticks` counts ticks that differ by more than the tolerances
    let. `broke` says what today's code raised, and `stopped_utc_s` where a gap ended the comparison.
    """

    choice: Choice
    ticks: int = 0
    statuses: int = 0
    seconds: float = 0.0
    differing: int = 0
    divergence: Divergence | None = None
    largest_rate_deg_s: float = 0.0
    other_ticks: int = 0
    recorded: Figures = field(default_factory=Figures)
    replayed: Figures = field(default_factory=Figures)
    broke: str | None = None
    stopped_utc_s: float | None = None
    cut_off: bool = False
    reasons: list[str] = field(default_factory=list)
    """Why the run is not the recorded one; empty where it is."""

    @property
    def agrees(self) -> bool:
        """Whether today's run is the recorded one, by the comparison that applies."""
        return not self.reasons

    @property
    def verdict(self) -> str:
        """One word: "same" to the last byte, "equivalent" by the comparison that applies, or "different"."""
        if self.reasons:
            return "different"
        return "equivalent" if self.differing else "same"


def replay(
    recording: Recording,
    build: Callable[[msgspec.Raw], Engine],
    *,
    tolerances: Tolerances | None = None,
    choice: Choice | None = None,
    watch: Callable[[Engine, Entry], None] | None = None,
    progress: Callable[[float], None] | None = None,
    expected: Recording | None = None,
    keep: list[Output] | None = None,
) -> Replay:
    """Run a recording's inputs through the engine that `build` makes of its facts; compare what comes out.

    The comparison is `choice`, or else the one that the recording's header calls for. `watch` is called after
    each input and each output with the engine and the entry, `progress` now and then with the share done.
    `expected` gives the outputs to compare with, instead of the recorded ones; `keep` takes all outputs.
    """
    judge = expected or recording
    chosen = choice or choose(judge.header, fingerprint(), here())
    run = _Run(Replay(chosen, cut_off=recording.cut_off), tolerances or Tolerances(), keep)
    outputs = None if expected is None else _outputs(expected)
    with gc_paused():
        engine = build(recording.header.spec)
        instants = array("d")
        for number, entry in enumerate(recording.entries()):
            if entry.topic == GAP:
                run.result.stopped_utc_s = entry.utc_s
                break
            instants.append(entry.utc_s)
            if outputs is not None and entry.topic in {COMMAND, REPEAT, SUMMARY}:
                entry = next(outputs, entry)  # noqa: PLW2901
            run.take(engine, entry)
            if watch is not None:
                watch(engine, entry)
            if progress is not None and number % REPORT_EVERY == 0:
                progress(number / len(recording))
        run.result.seconds = lasted_s(instants)
    return run.judged(engine)


def _outputs(expected: Recording) -> Iterator[Entry]:
    return (entry for entry in expected.entries() if entry.topic in {COMMAND, REPEAT, SUMMARY})


@dataclass(slots=True)
class _Run:
    """One replay in progress."""

    result: Replay
    allowed: Tolerances
    keep: list[Output] | None
    after: str = "the start"
    view_rms_arcsec: float | None = None

    def take(self, engine: Engine, entry: Entry) -> None:
        """Hand one entry to the engine; what breaks turns the run into a stop, as it does in a run."""
        try:
            self._hand(engine, entry)
        except Exception as error:  # noqa: BLE001 - a defect of today's code is a finding, not an end
            if self.result.broke is None:
                self.result.broke = f"{type(error).__name__}: {error}"
                engine.fail(str(error))
            if entry.topic in {COMMAND, REPEAT}:
                self._compare(entry, b"")

    def _hand(self, engine: Engine, entry: Entry) -> None:
        if entry.topic == STATUS:
            self.result.statuses += 1
            self.after = f"status {self.result.statuses}"
            engine.receive(entry.data, entry.utc_s)
        elif entry.topic == COMMAND:
            self._compare(entry, engine.tick(entry.utc_s))
            engine.prepare(entry.utc_s)
            self.result.ticks += 1
        elif entry.topic == REPEAT:
            self._compare(entry, engine.repeat() or b"")
        elif entry.topic == OPERATOR:
            self.after = f"the operator's {entry.data.decode('utf-8', 'replace')}"
            engine.operate(decode_message(entry.data), entry.utc_s)
        elif entry.topic == FAILURE:
            text = msgspec.json.decode(entry.data, type=Failure).words
            self.after = f"the failure {text!r}"
            if not engine.failed:
                engine.fail(text)
        elif entry.topic == VIEW:
            # Of a version whose views are others, the rest can still be compared.
            with suppress(msgspec.MsgspecError, *NO_JSON):
                self.view_rms_arcsec = msgspec.json.decode(entry.data, type=_ViewFigures).rms_pass_arcsec
        elif entry.topic == SUMMARY:
            kept = msgspec.json.decode(entry.data, type=_SummaryFigures)
            self.result.recorded = Figures(
                kept.reported_rms_arcsec,
                kept.reported_peak_arcsec,
                kept.samples,
                kept.on_target_s,
                kept.ended_by,
            )

    def _compare(self, entry: Entry, replayed: bytes) -> None:
        if self.keep is not None:
            self.keep.append(Output(entry.topic, entry.utc_s, entry.data, replayed))
        if replayed == entry.data:
            return
        result = self.result
        result.differing += 1
        found = differences(entry.data, replayed)
        rates = (abs(d.got - d.expected) for d in found if d.field in RATES)
        result.largest_rate_deg_s = max(result.largest_rate_deg_s, *rates, 0.0)
        larger = larger_than(found, self.allowed.rate_deg_s)
        result.other_ticks += larger
        mode = result.choice.mode
        lets_pass = (mode == "rounding" and not beyond_rounding(found)) or (mode == "figures" and not larger)
        if result.divergence is None and not lets_pass:
            result.divergence = Divergence(
                result.ticks, entry.utc_s, entry.data, replayed, self.after, tuple(found)
            )

    def judged(self, engine: Engine) -> Replay:
        """Return the result with its verdict."""
        result = self.result
        reported = engine.reported
        if result.recorded == Figures():
            result.recorded = Figures(rms_arcsec=self.view_rms_arcsec)
        result.replayed = Figures(
            reported.rms_arcsec,
            reported.peak_arcsec,
            reported.count,
            round(engine.on_target_s, 3),
            engine.tracker.ended_by,
        )
        if result.broke is not None:
            result.reasons.append(f"today's code broke: {result.broke}")
        if result.choice.mode == "figures":
            if result.stopped_utc_s is None:
                result.reasons += worse(result.recorded, result.replayed, self.allowed)
            if result.other_ticks > self.allowed.other_ticks * max(1, result.ticks):
                result.reasons.append(
                    f"{result.other_ticks} of {result.ticks} commands differ by more than "
                    f"{self.allowed.rate_deg_s:g} °/s, or in what they ask for"
                )
        elif result.divergence is not None:
            result.reasons.append(f"{result.differing} of {result.ticks} commands differ")
        return result


class _ViewFigures(msgspec.Struct):
    rms_pass_arcsec: float | None = None


class _SummaryFigures(msgspec.Struct):
    reported_rms_arcsec: float | None = None
    reported_peak_arcsec: float | None = None
    samples: int | None = None
    on_target_s: float | None = None
    ended_by: str | None = None


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


class DivergenceView(msgspec.Struct, frozen=True):
    """The first output that the comparison does not let pass."""

    tick: int
    utc: str
    after: str
    fields: tuple[Difference, ...]


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
    return DivergenceView(found.tick, Utc(found.utc_s).isoformat("microseconds"), found.after, found.fields)


def replay_lines(result: Replay, took_s: float | None = None) -> list[str]:
    """Return a replay's result in lines: the verdict, the comparison and why, the first divergence."""
    counts = f"{result.ticks} commands from {result.statuses} statuses in {result.seconds:.0f} s of the run"
    lines = [f"{VERDICTS[result.verdict]}{_differing(result)}: {counts}"]
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
    return (
        f", largest difference {result.largest_rate_deg_s:.3g} °/s, in {counted(result.differing, 'command')}"
    )


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
