"""A calibration run without I/O: datagrams and instants in, datagrams and instants out.

Its steps are generators, each resumed whenever something has happened. Nothing here concludes: what was
sent when, and which status answered, is kept for `findings`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from msgspec.structs import replace

from sattrack.calibration.clocks import Bracket, HeardStatus, RoundTripEstimate, StatusLog, TurnForecast
from sattrack.calibration.guard import (
    CENTRED_WITHIN_DEG,
    FIRST_RATE_DEG_S,
    LARGEST_DURATION_S,
    LARGEST_GAIN,
    SECOND_RATE_DEG_S,
    SEMANTICS_PART_S,
    STEP_PART_S,
    STEP_RATES_DEG_S,
    CalibrationEndedError,
    CalibrationGuard,
    EndKind,
    Plan,
    Surroundings,
)
from sattrack.control.driver import DirectStop
from sattrack.core.errors import UNHEARD
from sattrack.mount.model import MountProfile
from sattrack.mount.xerxes.datagrams import Command

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Mapping

    Steps = Generator[None, None, None]


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
        self.alignment_mode: int | None = None
        """ASCOM's AlignmentMode of a telescope, None where it is not told."""
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

    @property
    def safety(self) -> None:
        """Nothing counts the turns of the first axis: motions are small."""

    @property
    def turns_known_s(self) -> float:
        """For how long the mount may go on unheard at the run's largest rate, its axes' turns still known."""
        return 180.0 / self.plan.fastest_deg_s

    def due(self) -> float:
        """Return when the next datagram must be sent."""
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


PERIOD_S = 0.05
QUIET_S = 0.03
"""Nothing leaves so long before a change whose instant matters: a late datagram would undo it."""
SOON_S = 0.002


class Sender:
    """The next command, and when it is due."""

    def __init__(self, begin_utc_s: float) -> None:
        self.said = Command()
        """What the last datagram said."""
        self.changed_utc_s = begin_utc_s
        """When a datagram last said something new."""
        self._to_say = Command()
        self._aimed: tuple[float, Command] | None = None
        self._last_utc_s: float | None = None
        self._due_utc_s = begin_utc_s
        self._counter = 0
        self._changes = False

    @property
    def waiting(self) -> bool:
        """Whether something new has been asked for and not left yet."""
        return self._aimed is not None or self._to_say != replace(self.said, counter=self._to_say.counter)

    def say(self, fields: Mapping[str, Any]) -> None:
        """Say this, and nothing else, with the next datagram."""
        self._aimed = None
        self._to_say = Command(**fields)

    def say_at_once(self, fields: Mapping[str, Any], now_utc_s: float) -> None:
        """Say this with a datagram that is due at once."""
        self.say(fields)
        self._due_utc_s = now_utc_s

    def say_at(self, instant_utc_s: float, fields: Mapping[str, Any]) -> None:
        """Say this, and nothing else, from an instant on."""
        self._aimed = (instant_utc_s, Command(**fields))

    def earliest(self, now_utc_s: float) -> float:
        """Return the earliest instant that a change can be aimed at."""
        last = now_utc_s if self._last_utc_s is None else self._last_utc_s
        return max(now_utc_s + SOON_S, last + QUIET_S)

    def due(self) -> float:
        """Return when the next datagram is to leave, our UTC."""
        if self._aimed is None:
            return self._due_utc_s
        instant = self._aimed[0]
        return self._due_utc_s if self._due_utc_s < instant - QUIET_S else instant

    def left(self, now_utc_s: float) -> None:
        """Note when it has left indeed."""
        self._last_utc_s = now_utc_s
        if self._changes:
            self.changed_utc_s = now_utc_s

    def next(self, now_utc_s: float) -> Command:
        """Return what leaves now."""
        if self._aimed is not None and self.due() == self._aimed[0]:
            self._to_say = self._aimed[1]
            self._aimed = None
        self._counter += 1
        command = replace(self._to_say, counter=self._counter)
        self._changes = replace(command, counter=self.said.counter) != self.said
        self.said = command
        self.left(now_utc_s)
        self._due_utc_s = max(self._due_utc_s, now_utc_s - PERIOD_S) + PERIOD_S
        if self._due_utc_s < now_utc_s + QUIET_S:
            self._due_utc_s = now_utc_s + PERIOD_S
        return command


LISTEN_S = 2.0
LISTEN_ON_S = 6.0
"""How much longer it is listened to a mount that tells something, but rarely."""
FEWEST_STATUSES = 15
ANSWER_WITHIN_S = 2.0
REST_WITHIN_S = 12.0
LATELY = 300
"""Statuses of the last 15 seconds or so."""
FORECAST_FROM = 60
GOOD_SIGMA_S = 0.00025
SPREAD_S = 0.001
QUIET_BEFORE_LEG_S = 0.45
RATE_OVER_S = 0.6
ZERO_SEEN_S = 0.4
SETTLES_OVER_S = 0.35
SETTLES_WITHIN = 0.02
MOVES_AT_LEAST = 0.25
FOLLOWS_WITHIN = 0.15
AxisName = Literal["ra", "dec"]
AXIS_WORDS: dict[AxisName, str] = {"ra": "right ascension", "dec": "declination"}


@dataclass(frozen=True, slots=True)
class Edge:
    """A flag changed: when that left, and the statuses before and at which it showed, by place in the log."""

    sent_utc_s: float
    before: int
    after: int


@dataclass(frozen=True, slots=True)
class LegHeard:
    """One steady motion: places in the log of its first acknowledged status and of the one after its last.

    `rested` is the place of the first status of what came after the axis had been seen at rest.
    """

    axis: AxisName
    rate_deg_s: float
    first: int
    end: int
    rested: int


@dataclass(frozen=True, slots=True)
class StepHeard:
    """A small change of the rate of a moving axis.

    `first` is the place in the log of the first status of the new rate where that was acknowledged. Where it
    was not, it is None, and the round trip since `sent_utc_s`, when the rate left, tells which status it was.
    """

    axis: AxisName
    rate_deg_s: float
    sent_utc_s: float
    after: int
    """Place of the first status heard after it left."""
    first: int | None
    end: int
    """Place of the status after the last of this rate."""


@dataclass(frozen=True, slots=True)
class SemanticsHeard:
    """What an axis did: its rates under the first command, under the second, and with the flag down."""

    axis: AxisName
    first_deg_s: float
    second_deg_s: float
    after_deg_s: float
    zero_ends: bool | None
    """Whether an edge of rate 0 ended the motion; None where the motion had ended with the flag."""

    @property
    def follows(self) -> bool | None:
        """Whether a new rate acts while the flag is up; None for something in between."""
        ratio = self.second_deg_s / self.first_deg_s
        if abs(ratio - SECOND_RATE_DEG_S / FIRST_RATE_DEG_S) < FOLLOWS_WITHIN:
            return True
        return False if abs(ratio - 1.0) < FOLLOWS_WITHIN else None

    @property
    def goes_on(self) -> bool:
        """Whether motion goes on when the flag has fallen."""
        return abs(self.after_deg_s) > 0.4 * abs(self.first_deg_s)


@dataclass(slots=True)
class Observations:
    """Everything a run has seen."""

    log: StatusLog = field(default_factory=StatusLog)
    edges: list[Edge] = field(default_factory=list)
    legs: list[LegHeard] = field(default_factory=list)
    steps: list[list[StepHeard]] = field(default_factory=list)
    """Each a motion whose rate changed by small steps; its first element is how it began."""
    semantics: list[SemanticsHeard] = field(default_factory=list)


class Script:
    """The run's steps; `now_utc_s` is set by whoever resumes them."""

    def __init__(self, plan: Plan, sender: Sender, seen: Observations, begin: Callable[[], None]) -> None:
        self._plan = plan
        self._sender = sender
        self._seen = seen
        self._begin = begin
        self._estimate = RoundTripEstimate()
        self.now_utc_s = 0.0
        self.phase = "listening"

    def steps(self) -> Steps:
        """Run it all; raises CalibrationEndedError where something is not as it must be."""
        yield from self._listen()
        self._begin()
        self.phase = "stopping the mount"
        yield from self._rest()
        self.phase = "measuring the round trip"
        for count in range(self._plan.most_toggles):
            yield from self._toggle()
            if count + 1 >= self._plan.toggles and self._estimate.result().sigma_s < GOOD_SIGMA_S:
                break
        for axis in ("dec", "ra"):
            began = self._angle(axis)
            yield from self._semantics(axis)
            yield from self._centre(axis, began)
            for leg in self._plan.legs:
                if self._settles(axis, leg.seconds):
                    self.phase = f"moving in {AXIS_WORDS[axis]}, {leg.rate_deg_s:+g} °/s"
                    yield from self._leg(axis, leg.rate_deg_s, leg.seconds)
            for sense in (1.0, -1.0) if self._plan.steps else ():
                self.phase = f"changing the rate in {AXIS_WORDS[axis]} by small steps"
                yield from self._small_steps(axis, sense)
        self.phase = "measuring the round trip again"
        for _ in range(self._plan.toggles_after):
            yield from self._toggle()

    def _wait(self, seconds: float) -> Steps:
        until = self.now_utc_s + seconds
        while self.now_utc_s < until:
            yield

    def _until(self, holds: Callable[[HeardStatus], bool], within_s: float, otherwise: str) -> Steps:
        """Wait for a status of which something holds; raises CalibrationEndedError with `otherwise`."""
        until = self.now_utc_s + within_s
        while self._seen.log.last is None or not holds(self._seen.log.last):
            if self.now_utc_s > until:
                raise CalibrationEndedError(EndKind.DOUBT, otherwise)
            yield

    def _say(self, **fields: Any) -> Steps:
        """Say something new and wait until it has left."""
        self._sender.say(fields)
        while self._sender.waiting:
            yield

    def _listen(self) -> Steps:
        yield from self._wait(LISTEN_S)
        began = self.now_utc_s
        while 0 < len(self._seen.log.heard) < FEWEST_STATUSES and self.now_utc_s < began + LISTEN_ON_S:
            yield
        if len(self._seen.log.heard) < FEWEST_STATUSES:
            heard = len(self._seen.log.heard)
            words = f"{heard} statuses from the mount in {LISTEN_S + LISTEN_ON_S:g} s"
            if heard == 0:
                words = f"no status from the mount within {LISTEN_S:g} s"
            raise CalibrationEndedError(EndKind.LINK, f"{words}; {UNHEARD}")

    def _toggle(self) -> Steps:
        """Raise the abort flag and lower it, at instants that tell the most; the axes stand all the while."""
        for up in (True, False):
            place = len(self._seen.log.heard)
            self._sender.say_at(self._aimed_instant(), {"abort": True} if up else {})
            while self._sender.waiting:
                yield
            sent = self._sender.changed_utc_s
            verb = "acknowledge an abort" if up else "take back the acknowledgement of an abort"

            def shows(heard: HeardStatus, wanted: bool = up) -> bool:
                return heard.status.ack_abort == wanted

            yield from self._until(shows, ANSWER_WITHIN_S, f"the mount did not {verb} within 2 s")
            self._note_edge(sent, max(1, place), up)

    def _note_edge(self, sent_utc_s: float, place: int, up: bool) -> None:
        heard = self._seen.log.heard
        while place < len(heard) and heard[place].status.ack_abort != up:
            place += 1
        if place == len(heard) or heard[place - 1].status.ack_abort == up:
            return
        self._seen.edges.append(Edge(sent_utc_s, place - 1, place))
        offset = self._fastest_offset_s()
        above, within = (heard[i].mount_s + offset - sent_utc_s for i in (place - 1, place))
        self._estimate.add(Bracket(above, within))

    def _fastest_offset_s(self) -> float:
        """Return the fastest arrival lately against the mount's clock."""
        return min(h.arrival_utc_s - h.mount_s for h in self._seen.log.heard[-LATELY:])

    def _aimed_instant(self) -> float:
        """Return an instant at which a command is as likely seen by one turn of the loop as by the next.

        A little before and after as well: only what is seen too soon or late tells how much delays scatter.
        """
        turns = TurnForecast(self._seen.log.heard[-FORECAST_FROM:])
        result = self._estimate.result()
        aside = (0.0, 1.0, 0.0, -1.0)[len(self._seen.edges) // 2 % 4]
        spread = SPREAD_S + 2.0 * min(max(result.sigma_s, turns.scatter_s), SPREAD_S)
        return self._instant_of_turn(turns, max(0.0, result.seconds + aside * spread))

    def _surest_instant(self) -> float:
        """Return an instant at which a command comes in the middle between two turns of the loop."""
        turns = TurnForecast(self._seen.log.heard[-FORECAST_FROM:])
        trip = max(0.0, self._estimate.result().seconds - 0.5 * turns.mean_s)
        return self._instant_of_turn(turns, trip)

    def _instant_of_turn(self, turns: TurnForecast, trip_s: float) -> float:
        """Return the next instant of sending that is so long before a turn's status is here."""
        offset = self._fastest_offset_s()
        earliest = self._sender.earliest(self.now_utc_s)
        return turns.next_after(earliest + trip_s - offset) + offset - trip_s

    def _flag(self, axis: AxisName, rate_deg_s: float) -> dict[str, Any]:
        return {f"move_{axis}": True, f"move_{axis}_rate_deg_s": rate_deg_s}

    def _raise(self, axis: AxisName, rate_deg_s: float) -> Steps:
        yield from self._say(**self._flag(axis, rate_deg_s))
        yield from self._until(
            lambda heard: bool(getattr(heard.status, f"ack_move_{axis}")),
            ANSWER_WITHIN_S,
            f"the mount did not acknowledge MoveAxis in {AXIS_WORDS[axis]} within 2 s: is it parked?",
        )

    def _lower(self, axis: AxisName) -> Steps:
        yield from self._say()
        yield from self._until(
            lambda heard: not getattr(heard.status, f"ack_move_{axis}"),
            ANSWER_WITHIN_S,
            f"the mount did not take back its acknowledgement of MoveAxis in {AXIS_WORDS[axis]}",
        )

    def _rest(self) -> Steps:
        """Bring both axes to rest and see them there."""
        yield from self._say(abort=True)
        yield from self._until(
            lambda heard: heard.status.ack_abort,
            ANSWER_WITHIN_S,
            "the mount did not acknowledge an abort within 2 s: does another program command it?",
        )
        yield from self._until(
            lambda _: self._seen.log.still(),
            REST_WITHIN_S,
            f"the mount was not seen at rest within {REST_WITHIN_S:g} s of an abort",
        )
        yield from self._say()
        yield from self._until(
            lambda heard: not heard.status.ack_abort,
            ANSWER_WITHIN_S,
            "the mount did not take back its acknowledgement of an abort",
        )

    def _semantics(self, axis: AxisName) -> Steps:
        """Find out what a change of rate, and the fall of the flag, do to a motion."""
        self.phase = f"held or edge, in {AXIS_WORDS[axis]}"
        yield from self._raise(axis, FIRST_RATE_DEG_S)
        yield from self._wait(SEMANTICS_PART_S)
        first = self._rate(axis)
        self._check_moves(axis, first)
        yield from self._say(**self._flag(axis, SECOND_RATE_DEG_S))
        yield from self._wait(SEMANTICS_PART_S)
        second = self._rate(axis)
        yield from self._lower(axis)
        yield from self._wait(SEMANTICS_PART_S)
        after = self._rate(axis)
        heard = SemanticsHeard(axis, first, second, after, None)
        if heard.goes_on:
            yield from self._say(**self._flag(axis, 0.0))
            # Whether an ended MoveAxis is acknowledged, the protocol does not say.
            yield from self._wait(ZERO_SEEN_S)
            yield from self._lower(axis)
            yield from self._wait(SEMANTICS_PART_S)
            ended = abs(self._rate(axis)) < 0.1 * FIRST_RATE_DEG_S
            heard = SemanticsHeard(axis, first, second, after, ended)
        self._seen.semantics.append(heard)
        yield from self._rest()

    def _check_moves(self, axis: AxisName, rate_deg_s: float) -> None:
        part = abs(rate_deg_s) / FIRST_RATE_DEG_S
        words = None
        if part < MOVES_AT_LEAST:
            words = "acknowledges MoveAxis but does not move: are the drives on?"
        elif part > LARGEST_GAIN:
            words = f"moves {part:.1f} times as fast as commanded"
        if words is not None:
            raise CalibrationEndedError(EndKind.DOUBT, f"the {AXIS_WORDS[axis]} axis {words}")

    def _rate(self, axis: AxisName) -> float:
        """Return an axis' rate over the last RATE_OVER_S, degrees a second of the mount's clock."""
        last = self._seen.log.heard[-1].mount_s
        newest = [h for h in self._seen.log.heard[-60:] if h.mount_s > last - RATE_OVER_S]
        if len(newest) < 3:
            raise CalibrationEndedError(EndKind.LINK, "too few statuses came while an axis moved")
        angles = [h.dec_deg if axis == "dec" else h.hour_angle_deg for h in newest]
        return float(np.polyfit([h.mount_s - last for h in newest], angles, 1)[0])

    def _angle(self, axis: AxisName) -> float:
        last = self._seen.log.heard[-1]
        return last.dec_deg if axis == "dec" else last.hour_angle_deg

    def _centre(self, axis: AxisName, angle_deg: float) -> Steps:
        """Bring an axis back to where it was before, by the sign that it has shown."""
        off = angle_deg - self._angle(axis)
        if abs(off) < CENTRED_WITHIN_DEG:
            return
        shown = self._seen.semantics[-1].first_deg_s
        yield from self._raise(axis, math.copysign(FIRST_RATE_DEG_S, off * shown))
        # The ways there and back add to the motion, and so does a turn of the loop.
        yield from self._wait(max(0.0, abs(off / shown) - self._estimate.median_s - PERIOD_S))
        yield from self._rest()

    def _leg(self, axis: AxisName, rate_deg_s: float, seconds: float) -> Steps:
        yield from self._wait(QUIET_BEFORE_LEG_S)
        log = self._seen.log
        place = len(log.heard)
        yield from self._raise(axis, rate_deg_s)
        yield from self._wait(seconds)
        flag = f"ack_move_{axis}"
        first = next(i for i in range(place, len(log.heard)) if getattr(log.heard[i].status, flag))
        place = len(log.heard)
        yield from self._rest()
        end = next(i for i in range(place, len(log.heard)) if log.heard[i].status.ack_abort)
        self._seen.legs.append(LegHeard(axis, rate_deg_s, first, end, len(log.heard)))

    def _settles(self, axis: AxisName, seconds: float) -> bool:
        """Tell whether the axis comes to a steady rate in so many seconds, as far as it has shown."""
        shown = [leg for leg in self._seen.legs if leg.axis == axis]
        if not shown:
            return True
        leg, heard = shown[0], self._seen.log.heard
        began_s, ended_s = heard[leg.first].mount_s, heard[leg.end].mount_s
        late = self._rate_between(axis, leg, ended_s - 2.0 * SETTLES_OVER_S, ended_s)
        soon = self._rate_between(axis, leg, began_s + seconds - SETTLES_OVER_S, began_s + seconds)
        return late is None or soon is None or abs(soon - late) < SETTLES_WITHIN * abs(late)

    def _rate_between(self, axis: AxisName, leg: LegHeard, from_s: float, to_s: float) -> float | None:
        some = [h for h in self._seen.log.heard[leg.first : leg.end] if from_s <= h.mount_s <= to_s]
        if len(some) < 3:
            return None
        angles = [h.dec_deg if axis == "dec" else h.hour_angle_deg for h in some]
        return float(np.polyfit([h.mount_s - from_s for h in some], angles, 1)[0])

    def _small_steps(self, axis: AxisName, sense: float) -> Steps:
        """Change the rate of a motion by steps that no limit of the axis is met in."""
        yield from self._wait(QUIET_BEFORE_LEG_S)
        edge = self._seen.semantics[-1].goes_on
        steps: list[StepHeard] = []
        log = self._seen.log
        for rate in (sense * r for r in STEP_RATES_DEG_S):
            if steps and edge:
                yield from self._lower(axis)
            after = len(log.heard)
            first = None
            if steps and not edge:
                self._sender.say_at(self._surest_instant(), self._flag(axis, rate))
                while self._sender.waiting:
                    yield
            else:
                yield from self._raise(axis, rate)
                flag = f"ack_move_{axis}"
                first = next(i for i in range(after, len(log.heard)) if getattr(log.heard[i].status, flag))
            sent_utc_s = self._sender.changed_utc_s
            yield from self._wait(STEP_PART_S)
            steps.append(StepHeard(axis, rate, sent_utc_s, after, first, len(log.heard)))
        yield from self._rest()
        self._seen.steps.append(steps)
