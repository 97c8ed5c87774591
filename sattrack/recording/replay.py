"""A recording's inputs run through today's code, and every output compared with the recorded one."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import msgspec

from sattrack.core.collector import without_collector
from sattrack.recording.comparison import (
    RATES,
    Choice,
    Difference,
    Figures,
    Tolerances,
    beyond_rounding,
    choose,
    differences,
    larger_than,
    worse,
)
from sattrack.recording.environment import fingerprint, here
from sattrack.recording.format import COMMAND, FAILURE, OPERATOR, REPEAT, STATUS, SUMMARY, VIEW, Failure
from sattrack.recording.reading import GAP, Entry, Recording
from sattrack.views.messages import decode_message

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from sattrack.control.engine import Engine

TELL_EVERY = 500


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
    """The input before it, in words."""
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
    with without_collector():
        engine = build(recording.header.spec)
        first_utc_s = None
        for number, entry in enumerate(recording.entries()):
            if entry.topic == GAP:
                run.result.stopped_utc_s = entry.utc_s
                break
            if first_utc_s is None:
                first_utc_s = entry.utc_s
            if outputs is not None and entry.topic in {COMMAND, REPEAT, SUMMARY}:
                entry = next(outputs, entry)  # noqa: PLW2901
            run.take(engine, entry)
            run.result.seconds = entry.utc_s - first_utc_s
            if watch is not None:
                watch(engine, entry)
            if progress is not None and number % TELL_EVERY == 0:
                progress(number / len(recording))
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
            self.result.ticks += 1
        elif entry.topic == REPEAT:
            self._compare(entry, engine.repeat() or b"")
        elif entry.topic == OPERATOR:
            self.after = f"the operator's {entry.data.decode('utf-8', 'replace')}"
            engine.operate(decode_message(entry.data), entry.utc_s)
        elif entry.topic == FAILURE:
            words = msgspec.json.decode(entry.data, type=Failure).words
            self.after = f"the failure {words!r}"
            if not engine.failed:
                engine.fail(words)
        elif entry.topic == VIEW:
            self.view_rms_arcsec = msgspec.json.decode(entry.data, type=_ViewFigures).rms_pass_arcsec
        elif entry.topic == SUMMARY:
            told = msgspec.json.decode(entry.data, type=_SummaryFigures)
            self.result.recorded = Figures(
                told.reported_rms_arcsec,
                told.reported_peak_arcsec,
                told.samples,
                told.on_target_s,
                told.ended_by,
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
