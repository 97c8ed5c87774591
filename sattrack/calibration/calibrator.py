"""A calibration run as one thing without I/O: datagrams and instants in, datagrams and instants out."""

from __future__ import annotations

from dataclasses import dataclass

from sattrack.calibration.guard import CalibrationEndedError, CalibrationGuard, EndKind, Surroundings
from sattrack.calibration.plan import LARGEST_DURATION_S, Plan
from sattrack.calibration.script import Observations, Script, Sender
from sattrack.control.driver import DirectStop
from sattrack.mount.model import MountProfile


@dataclass(frozen=True, slots=True)
class Ending:
    """How a run ended: `words` say why it was not done, `at_rest` whether the mount was seen to stand."""

    kind: EndKind
    words: str
    at_rest: bool | None
    """None where the run ended before anything was sent that could move the mount."""


class Calibrator:
    """One run, from the first datagram to the mount seen at rest.

    Call `receive` for each datagram, and at `due()` send what `tick` returns, then call `sent`; all instants
    are our UTC, POSIX seconds. `stop` ends the run at any moment. When `ending` is set, it is over.
    """

    def __init__(self, surroundings: Surroundings, begin_utc_s: float, plan: Plan | None = None) -> None:
        self.profile = MountProfile()
        """What is assumed of a mount of which nothing is known yet."""
        self.plan = plan or Plan()
        self.seen = Observations()
        self.ending: Ending | None = None
        self.largest_rates_deg_s: tuple[float, float] | None = None
        """What the mount tells of its largest rates, right ascension first; None where it does not."""
        self._begin_utc_s = self._now_utc_s = begin_utc_s
        self._guard = CalibrationGuard(surroundings, self.plan.fastest_deg_s, self.plan.silent_after_s)
        self._sender = Sender(begin_utc_s)
        self._script = Script(self.plan, self._sender, self.seen, self._allow)
        self._script.now_utc_s = begin_utc_s
        self._steps = self._script.steps()
        self._kind = EndKind.DONE
        self._words = ""
        self._stop: DirectStop | None = None
        """The stop at the end: what is known of the mount so far may be wrong."""
        self._allowed = False

    @property
    def phase(self) -> str:
        """What the run is doing."""
        return self._script.phase

    @property
    def part_done(self) -> float:
        """About how much of the run is done, 0 to 1."""
        return min(1.0, (self._now_utc_s - self._begin_utc_s) / self.plan.expected_s())

    def receive(self, data: bytes, arrival_utc_s: float) -> None:
        """Take a datagram from the mount."""
        heard = self.seen.log.take(data, arrival_utc_s)
        if heard is None or self.ending is not None:
            return
        if self._stop is not None:
            self._stop.receive(data, arrival_utc_s)
            return
        try:
            self._guard.watch(heard, self.seen.log)
            self._guard.watch_answer(heard, self._sender.said, self._sender.changed_utc_s)
        except CalibrationEndedError as ended:
            self._end(ended.kind, ended.words)
        self._resume(max(self._now_utc_s, arrival_utc_s))

    @property
    def finished(self) -> bool:
        """Whether the run is over."""
        return self.ending is not None

    @property
    def mount_stopped(self) -> bool | None:
        """Whether the mount was seen at rest at the end; None where nothing may have moved."""
        return None if self.ending is None else self.ending.at_rest

    def due(self) -> float:
        """Return when the next datagram is to be sent."""
        return self._sender.due()

    def tick(self, now_utc_s: float) -> bytes:
        """Return the datagram that leaves at an instant, that of `due` or as soon as can be."""
        if self._stop is None:
            try:
                self._guard.watch_link(self.seen.log, now_utc_s)
            except CalibrationEndedError as ended:
                self._end(ended.kind, ended.words)
            if now_utc_s - self._begin_utc_s > LARGEST_DURATION_S:
                self._end(EndKind.DOUBT, f"the run took longer than {LARGEST_DURATION_S:g} s")
        command = self._sender.next(now_utc_s)
        return self._guard.clear(command) if self._stop is None else self._stop.tick(now_utc_s)

    def sent(self, now_utc_s: float) -> None:
        """Let the run go on, a datagram having left: apart from `tick`, which must not be held up."""
        self._sender.left(now_utc_s)
        self._resume(now_utc_s)

    def stop(self, words: str) -> None:
        """Bring the mount to rest and end: the operator wants it."""
        self._end(EndKind.OPERATOR, words)

    def fail(self, words: str) -> None:
        """Bring the mount to rest and end: something broke outside."""
        self._end(EndKind.DOUBT, words)

    def _allow(self) -> None:
        self._guard.begin(self.seen.log, self._now_utc_s)
        self._allowed = True

    def _end(self, kind: EndKind, words: str) -> None:
        """Begin the stop at the end; a run in which nothing may have moved is over at once."""
        if self._stop is not None or self.ending is not None:
            return
        self._kind, self._words = kind, words
        self._script.phase = "stopping the mount"
        if not self._allowed:
            self.ending = Ending(kind, words, None)
            return
        self._sender.say_at_once({}, self._now_utc_s)
        self._stop = DirectStop(self.profile, self._now_utc_s, self._sender.said.counter)

    def _resume(self, now_utc_s: float) -> None:
        """Let the steps go on; what they raise turns the run into a stop."""
        self._now_utc_s = self._script.now_utc_s = now_utc_s
        if self._stop is not None:
            if self._stop.finished:
                self.ending = Ending(self._kind, self._words, bool(self._stop.mount_stopped))
            return
        if self.ending is not None:
            return
        try:
            next(self._steps)
        except StopIteration:
            self._end(EndKind.DONE, "")
        except CalibrationEndedError as ended:
            self._end(ended.kind, ended.words)
