"""What must hold in every storm, judged at every step by the true axes and by what went over the wire.

Nothing here asks the program what it believes. What it was promised (docs/safety.md, docs/link-loss.md) is:

* `limit`: the axes keep inside the limits while the mount is *in reach*: it has obeyed a datagram within the
  last `longest_fault_s` and TURNS_S, and what it obeys is no older, from the status behind it on, than
  `longest_fault_s`, the link's own delays and RESPONSE_S. Once a mount that got out of limits out of reach is
  in reach again, it goes no farther out after RECOVERS_S; it counts as inside again from AGAIN_INSIDE_DEG on.
* `stop`: from SETTLES_S after a stop was due and the mount in reach, the axes rest against standstill or the
  sky, to the end of the world.
* `stale`: no datagram changes the motion in force on knowledge older than KNOWS_S.
* `owner`: feeder and guardian never both send.
* `once`: a run ends, once, and says by what.
* `replay`: its recording, as far as it goes, replays to the last byte.
* `memory`: what the program holds does not grow with the length of the run.
* `recovery`: RECOVERED_S after the last fault the axes are where those of the same run without faults are, by
  twice the most that such a run is off the target. What the link loses by itself goes on after the storm.
"""

from __future__ import annotations

import gc
import itertools
import math
import tempfile
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sattrack.core.errors import BadInputError, SattrackError
from sattrack.mount.link_loss import STOPS_MOVING_S
from sattrack.mount.model import SIDEREAL_RATE_DEG_S
from sattrack.mount.xerxes.standstill import REST_RATE_DEG_S
from sattrack.recording.format import Recording
from sattrack.recording.replay import Choice, replay
from sattrack.runtime.facts import engine_of
from sattrack.runtime.guardian import Word
from storm.mounts import USUAL_PERIOD_S
from storm.programs import WORLDS
from storm.world import Judging, World

if TYPE_CHECKING:
    from sattrack.control.driver import Driver
    from storm.draws import Fault, Storm
    from storm.mounts import Axes
    from storm.world import Ended, Sent

RESPONSE_S = 0.25
"""Turns of the mount's loop and ours, between a status and what obeys it."""
RESPONSE_PERIODS = 4.0
"""Turns in that."""
TURNS_S = 0.1
"""One of the mount's loop and one of ours."""
RECOVERS_S = 3.0
AGAIN_INSIDE_DEG = 0.01
"""Axes that are stopped as they come back to a limit settle about where they are, perhaps just outside."""
SETTLES_S = 2.0
KNOWS_S = 2.2
"""The oldest status on which the program may move, and two periods."""
SAME_RATE_DEG_S = 0.05
RECOVERED_S = 5.0
OFF_ARCSEC = 2.0
"""What counts as on target."""
LOSSY_RUNS = 20
"""So many passes without a storm tell what the link's own losses cost."""
AT_LIMIT_DEG, AT_LIMIT_S = 2.0, 1.0
"""So near to a limit a run may be held, and so long before it would be there."""
RATE_MARGIN = 1.15
"""By how much an axis may overshoot the largest rate: a servo's and its gain's share."""
MEAN_TURNS = 20
SWINGS_S, SWINGS_TURNS, SWINGS_DEG_S = 3.0, 400, 1.0
CAUGHT_UP_TURNS = 20
"""After so many turns a mount has caught up with what its timer's stall has cost."""
KICK_DEG = 0.03
"""By so much a servo may kick when its program goes on."""
OURS = ("sattrack", "tle")
WEIGHED_SEEDS, WEIGHED_FROM_S, WEIGHED_EVERY_S = 8, 12.0, 6.0
"""In which storms the program's memory is counted, from when on, and how often."""
GROWTH_PER_S, FILLS_UP_S = 300.0, 20.0
"""Entries, of a mount of the usual period. A buffer that fills up to its bound grows by some a period, one
without a bound for ever; those of a pass that begins fill up in less than so long."""
ENDS_WITHIN_S = STOPS_MOVING_S + 10.0
FLAGS, SLEW_FLAG = slice(73, 81), 79
RATES = slice(32, 48)
NAMES = ("limit", "rate", "stop", "stale", "owner", "once", "replay", "memory", "recovery")


@dataclass
class Violation:
    """One broken promise."""

    invariant: str
    at_s: float
    text: str

    def __str__(self) -> str:
        return f"{self.invariant} at {self.at_s:.2f} s: {self.text}"


@dataclass
class Verdict:
    """What came of one storm."""

    seed: int
    violations: list[Violation] = field(default_factory=list)
    ended_by: str = ""
    seconds: float = 0.0
    standstill_s: float | None = None
    """From the stop until both axes stood, where the mount was in reach all that time."""
    left_at_rest: bool = True
    """Whether the axes rested at the very end, some time after everybody had let go of the mount."""
    recovered_arcsec: float | None = None
    replayed: bool = False
    faults: tuple[str, ...] = ()
    why: str = ""
    took_s: float = 0.0
    """Of a processor."""


def moves(data: bytes) -> bool:
    """Tell whether a datagram has MoveAxis, slew, home, park or pulse up; abort is none."""
    flags = data[FLAGS]
    return any(flags[1:])


class Watcher(Judging):
    """Judges one run."""

    def __init__(self, storm: Storm) -> None:
        self.storm = storm
        self.verdict = Verdict(storm.seed, faults=tuple(fault.kind for fault in storm.faults))
        self.path: list[Axes] = []
        self._nearest: list[float] = []
        """How near the axes were to the nearest limit at each of these, degrees."""
        self._clear = storm.judge()
        self._knowledge_s = self._waiting_s = storm.begin_s
        """Of when the status is behind the newest datagram that the mount has obeyed; and behind the newest
        that has come, which it obeys at its next turn."""
        self._obeyed_s = self._came_s = storm.begin_s
        """When the newest of them came."""
        self._unreached_s = -math.inf
        """When the mount was last out of reach."""
        self._out: dict[str, float] = {}
        """How far outside a limit the axes are that passed it out of reach."""
        self._stop_due_s: float | None = None
        self._rested_s: float | None = None
        self._last: dict[str, bytes] = {}
        self._moved_s = -math.inf
        """When the last datagram left that moves the mount."""
        self._aborted = False
        """Whether an abort left after it."""
        self._slewed = False
        """Whether it asks for a slew."""
        self._guardian_s: float | None = None
        self._ended_by: str | None = None
        self._sizes: list[tuple[float, int]] = []
        self._weighed: object = None
        """What follows: with the next one other buffers fill up."""
        self._drives_fail = any(fault.kind == "drive" for fault in storm.faults)
        self._freezes = [fault for fault in storm.faults if fault.kind == "freeze"]
        self._settled = False
        self._weighed_s = WEIGHED_FROM_S
        facts = storm.facts
        longer_s = max(0.0, facts.profile.period_s - USUAL_PERIOD_S)
        self._reach_s = (
            facts.limits.longest_fault_s
            + facts.profile.command_delay_s
            + facts.profile.status_delay_s
            + RESPONSE_S
            + RESPONSE_PERIODS * longer_s
        )
        self._silent_s = facts.limits.longest_fault_s + TURNS_S + 2.0 * longer_s
        self._knows_s = KNOWS_S + 2.0 * longer_s
        self._synced_deg = 0.0
        """By how much in all the mount's reports may be off, as somebody has synced it."""

    def violated(self, name: str, world: World, text: str) -> None:
        if not any(one.invariant == name for one in self.verdict.violations):
            self.verdict.violations.append(Violation(name, world.at_s, text))
            world.trace("VIOLATED", f"{name}: {text}")

    def nearest_deg(self, begin_s: float, end_s: float) -> float:
        """Return how near to any limit the axes came between two instants, or would have by going on."""
        pairs = zip(self.path, self._nearest, strict=True)
        ahead = (near - AT_LIMIT_S * axes.speed_deg_s for axes, near in pairs if begin_s < axes.utc_s < end_s)
        return min(ahead, default=-math.inf)

    # the axes

    def turn(self, world: World, axes: Axes) -> None:
        self.path.append(axes)
        # Whoever has let go of a mount has seen it at rest: it is not out of reach but stopped. Nobody has
        # where all that could stop it was killed.
        silent = world.now_s - self._obeyed_s > self._silent_s
        if (world.somebody_sends or world.abandoned) and (
            silent or world.now_s - self._knowledge_s > self._reach_s
        ):
            self._unreached_s = axes.utc_s
        # What has come while its program stood still is obeyed from now on.
        self._knowledge_s, self._obeyed_s = self._waiting_s, self._came_s
        self._judge_limits(world, axes)
        self._judge_rates(world, axes)
        self._judge_stop(world, axes)

    def _judge_limits(self, world: World, axes: Axes) -> None:
        found = self._clear.clearances(axes.hour_angle_deg, axes.dec_axis_deg, axes.utc_s)
        self._nearest.append(min(found.values()))
        # A mount that tracks by itself, and that nobody commands, goes on with the sky.
        left_alone = self._aborted or axes.utc_s - self._moved_s > SETTLES_S
        left_tracking = left_alone and axes.speed_deg_s <= 2.0 * REST_RATE_DEG_S
        # A slew is the mount's own: it brakes by itself, or by an abort, unless its program stands still.
        runs_on = self._slewed and self._stood_still(world)
        unreached = axes.utc_s - self._unreached_s < RECOVERS_S
        excused = self._drives_fail or left_tracking or runs_on or unreached
        for name, clearance in found.items():
            if clearance >= AGAIN_INSIDE_DEG - self._synced_deg:
                self._out.pop(name, None)
            elif clearance >= -self._synced_deg:
                continue
            elif excused:
                self._out[name] = min(clearance, self._out.get(name, 0.0))
            elif name not in self._out:
                self.violated("limit", world, f"{name} passed by {-clearance:.3f}°")
            elif abs(axes.dec_axis_deg) > 90.0:
                # It went past the pole out of reach. What it reports does not tell so: its limits are those
                # of the other side, until its rates turn out to be of the other sign.
                continue
            elif clearance < self._out[name] - 0.5 and axes.speed_deg_s > 10.0 * REST_RATE_DEG_S:
                self.violated("limit", world, f"{name}: farther out, {-clearance:.3f}°, in reach again")

    def _judge_rates(self, world: World, axes: Axes) -> None:
        if self._stood_still(world) or self._stalled():
            # A mount whose program has stood still catches up with its own plan, as fast as its drives can.
            return
        if self._swings():
            return
        most = RATE_MARGIN * (self.storm.hardware.max_rate_deg_s + 0.01)
        fastest = max(abs(axes.hour_angle_rate_deg_s), abs(axes.dec_rate_deg_s))
        if fastest > most:
            self.violated("rate", world, f"{fastest:.2f} °/s")

    def _stalled(self) -> bool:
        """Tell whether the mount's own timer has stalled of late."""
        stall_s = float(self.storm.parameters.get("stall_s", 0.0))
        late = [one.utc_s for one in self.path[-CAUGHT_UP_TURNS:]]
        return stall_s > 0.0 and any(two - one > stall_s for one, two in itertools.pairwise(late))

    def _stood_still(self, world: World) -> Fault | None:
        """Return the freeze that the mount's program was in of late, if any."""
        late = (one for one in self._freezes if one.at_s < world.at_s < one.end_s + RECOVERS_S)
        return next(late, None)

    def _judge_stop(self, world: World, axes: Axes) -> None:
        due_s = self._stop_due_s
        if due_s is None or world.abandoned:
            return
        moving = axes.speed_deg_s > 2.0 * REST_RATE_DEG_S
        if moving and self._settled:
            # A servo that hunts in its stiction stays where it is.
            moving = self._mean_of(axes).speed_deg_s > 2.0 * REST_RATE_DEG_S
        if not moving and self._rested_s is None:
            self._rested_s = axes.utc_s
            if self._unreached_s < due_s - RECOVERS_S:
                self.verdict.standstill_s = axes.utc_s - due_s
        if not moving:
            self._settled = True
        since_s = max(due_s, self._unreached_s) + self._settles_s + self._frozen_s(due_s, axes.utc_s)
        if moving and axes.utc_s > since_s and not self._excused(world, axes):
            again = ", again" if self._settled else ""
            self.violated(
                "stop", world, f"{axes.speed_deg_s:.3f} °/s{again}, {axes.utc_s - due_s:.1f} s after"
            )

    def _frozen_s(self, begin_s: float, end_s: float) -> float:
        """How long the mount's program, which alone can brake, stood still between two instants."""
        spans = ((self.storm.begin_s + one.at_s, self.storm.begin_s + one.end_s) for one in self._freezes)
        return sum(max(0.0, min(end_s, last_s) - max(begin_s, first_s)) for first_s, last_s in spans)

    def _excused(self, world: World, axes: Axes) -> bool:
        """Tell whether axes move by what no client can end."""
        return self._drives_fail or self._swings() or (self._settled and self._catches_up(world, axes))

    def _catches_up(self, world: World, axes: Axes) -> bool:
        """Tell whether axes go on by what the sky turned while the mount's program stood still."""
        freeze = self._stood_still(world)
        if freeze is None:
            return False
        begun_s = self.storm.begin_s + freeze.at_s
        then = next((one for one in reversed(self.path) if one.utc_s < begun_s), axes)
        turned_deg = SIDEREAL_RATE_DEG_S * (axes.utc_s - then.utc_s)
        on_deg = axes.hour_angle_deg - then.hour_angle_deg
        stays = abs(axes.dec_axis_deg - then.dec_axis_deg) < KICK_DEG
        return stays and -KICK_DEG < on_deg < turned_deg + KICK_DEG

    def _swings(self) -> bool:
        """Tell whether a drive swings to and fro about its plan since its program stood still.

        Nothing that a client sends ends that.
        """
        if self.storm.hardware.kind != "planner" or not self._freezes:
            return False
        late = [one for one in self.path[-SWINGS_TURNS:] if one.utc_s > self.path[-1].utc_s - SWINGS_S]
        each = [one.hour_angle_rate_deg_s for one in late], [one.dec_rate_deg_s for one in late]
        return any(min(rates) < -SWINGS_DEG_S < SWINGS_DEG_S < max(rates) for rates in each)

    def _mean_of(self, axes: Axes) -> Axes:
        """Return the axes with their mean rates over the last turns."""
        then = self.path[-min(len(self.path), MEAN_TURNS)]
        since_s = max(axes.utc_s - then.utc_s, 1e-3)
        return axes._replace(
            hour_angle_rate_deg_s=(axes.hour_angle_deg - then.hour_angle_deg) / since_s,
            dec_rate_deg_s=(axes.dec_axis_deg - then.dec_axis_deg) / since_s,
        )

    @property
    def _settles_s(self) -> float:
        hard = self.storm.hardware
        late_s = float(self.storm.parameters.get("abort_delay_s", 0.0))
        # A position servo that has fallen behind goes on to where it was to be, and brakes once more.
        brakes = 2.0 if hard.kind == "position_servo" else 1.0
        # A mount may count its delay from each abort anew; they are raised after ever longer pauses.
        return SETTLES_S + 3.0 * late_s + brakes * hard.max_rate_deg_s / hard.acceleration_deg_s2

    # the wire

    def sent(self, world: World, sent: Sent) -> None:
        if sent.who == "guardian" and self._guardian_s is None:
            self._guardian_s = sent.utc_s
            self._stop_due(sent.utc_s)
        elif sent.who == "feeder" and self._guardian_s is not None:
            self.violated("owner", world, "the feeder sends, and so does its guardian")
        if sent.who == "guardian" and moves(sent.data):
            self.violated("stop", world, "the guardian moves the mount")
        before = self._last.get(sent.who, b"")
        age_s = sent.utc_s - sent.heard_utc_s
        if moves(sent.data) and age_s > self._knows_s and self._changes(before, sent.data):
            self.violated("stale", world, f"a motion on a status heard {age_s:.2f} s before")
        self._last[sent.who] = sent.data
        if moves(sent.data):
            self._moved_s, self._aborted = sent.utc_s, False
            self._slewed = bool(sent.data[SLEW_FLAG])
        elif sent.data[FLAGS][0]:
            self._aborted = True

    def _changes(self, before: bytes, data: bytes) -> bool:
        import struct

        if before[FLAGS] != data[FLAGS]:
            return True
        was, now = struct.unpack("<2d", before[RATES]), struct.unpack("<2d", data[RATES])
        return max(abs(one - other) for one, other in zip(was, now, strict=True)) > SAME_RATE_DEG_S

    def arrived(self, world: World, sent: Sent) -> None:
        self._came_s = world.now_s
        # A stop is obeyed whatever its sender knew; a datagram without flags stops a held motion only.
        stops = bool(sent.data[FLAGS][0]) or (
            self.storm.hardware.move_axis == "held" and not moves(sent.data)
        )
        knows_s = sent.utc_s if stops else sent.knows_utc_s
        self._waiting_s = max(self._waiting_s, knows_s)

    def period(self, world: World, driver: Driver, ended_by: str | None) -> None:
        engine = getattr(driver, "engine", None)
        if engine is not self._weighed:
            self._weighed, self._weighed_s = engine, world.at_s + WEIGHED_FROM_S
            self._sizes.clear()
        if self.storm.seed % WEIGHED_SEEDS == 0 and world.at_s > self._weighed_s:
            self._weighed_s = world.at_s + WEIGHED_EVERY_S
            self._sizes.append((world.at_s, held(driver)))
        if self._ended_by is not None and ended_by != self._ended_by:
            self.violated("once", world, f"ended by {self._ended_by}, then by {ended_by}")
        if ended_by is not None and self._ended_by is None:
            self._ended_by = ended_by
            self._stop_due(world.now_s)

    def begins(self, world: World) -> None:
        self._ended_by = self._guardian_s = None
        self._weighed_s = world.at_s + WEIGHED_FROM_S
        self._sizes.clear()
        self.told(world, world.stopped_by_person_s is None)

    def stopping(self, world: World) -> None:
        self._stop_due(world.now_s)

    def told(self, world: World, moves: bool) -> None:
        del world
        if moves and self._ended_by is None:
            self._stop_due_s = self._rested_s = None
            self._settled = False

    def _stop_due(self, utc_s: float) -> None:
        if self._stop_due_s is None:
            self._stop_due_s = utc_s

    # the end

    def synced(self, deg: float) -> None:
        self._synced_deg += deg

    def ended(self, world: World, ended: Ended) -> None:
        verdict = self.verdict
        verdict.seconds = ended.over_s
        verdict.left_at_rest = self.path[-1].speed_deg_s <= 2.0 * REST_RATE_DEG_S
        if ended.killed:
            verdict.ended_by = "kill"
        elif ended.summary is not None:
            verdict.ended_by = ended.summary.ended_by
            verdict.why = ended.summary.message or ""
        elif self.storm.program != "track" and not world.page[Word.DEPOSED]:
            verdict.ended_by = world.ended_by or self._ended_by or "error"
            verdict.why = str(ended.error or "")
        elif world.page[Word.DEPOSED]:
            verdict.ended_by, verdict.why = "deposed", str(ended.error)
        else:
            verdict.ended_by = "raised"
        if verdict.ended_by == "raised" or not isinstance(ended.error, SattrackError | None):
            self.violated("once", world, f"the run ended with {ended.error!r}")
        person_s = world.stopped_by_person_s
        ran_s = world.storm.begin_s + ended.ended_s
        if person_s is not None and ran_s - person_s > ENDS_WITHIN_S + self._away_s(person_s):
            self.violated("once", world, f"it ran on for {ran_s - person_s:.0f} s after a person's stop")
        if len(self._sizes) > 1:
            (begin_s, first), (end_s, last) = self._sizes[0], self._sizes[-1]
            span_s = max(end_s - begin_s, FILLS_UP_S)
            faster = max(1.0, USUAL_PERIOD_S / self.storm.facts.profile.period_s)
            if (last - first) / span_s > GROWTH_PER_S * faster:
                grown = f"{last - first} entries more after {end_s - begin_s:.0f} s"
                self.violated("memory", world, grown)
        self._judge_recording(world, ended)

    def _away_s(self, from_s: float) -> float:
        """How long the machine slept since."""
        return sum(
            f.lasts_s
            for f in self.storm.faults
            if f.kind == "sleep" and self.storm.begin_s + f.end_s > from_s
        )

    def _judge_recording(self, world: World, ended: Ended) -> None:
        if self.storm.fault_free or not ended.recording:
            return
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "storm.mcap"
            path.write_bytes(ended.recording)
            try:
                recording = Recording(path)
            except BadInputError as error:
                if any(one.kind in {"disk", "kill"} and one.at_s < 2.0 for one in self.storm.faults):
                    return
                self.violated("replay", world, f"the recording cannot be read: {error}")
                return
            found = replay(recording, engine_of, choice=Choice("bytes", "the same code"))
        self.verdict.replayed = True
        if found.divergence is not None:
            where = found.divergence.utc_s - self.storm.begin_s
            self.violated("replay", world, f"differs {found.differing} times, first at {where:.2f} s")


def held(driver: Any) -> int:
    """Return how many things a driver's containers hold, those in containers of theirs counted."""
    seen: set[int] = set()
    waiting = list(gc.get_referents(driver))
    count = 0
    while waiting:
        one = waiting.pop()
        if id(one) in seen or isinstance(one, type):
            continue
        seen.add(id(one))
        contains = isinstance(one, dict | list | tuple | set | deque)
        count += len(one) if contains else 0
        if contains or type(one).__module__.startswith(OURS):
            waiting.extend(gc.get_referents(one))
    return count


def judged(storm: Storm, tracing: bool = False, world_of: type[World] | None = None) -> tuple[Verdict, Ended]:
    """Run a storm, and where that tells something the same one without faults; return the verdict.

    `world_of` makes the world of the first: tests put sabotage there.
    """
    watcher = Watcher(storm)
    if world_of is None:
        world_of = WORLDS[storm.program]
    world = world_of(storm, watcher, tracing)
    ended = world.run()
    if comparable(storm, ended):
        fair = Watcher(storm.fair())
        fair_ended = World(storm.fair(), fair).run()
        judge_recovery(world, watcher, fair, fair_ended)
    return watcher.verdict, ended


def comparable(storm: Storm, ended: Ended) -> bool:
    """Tell whether a run went on after its storm, and differs from a fair one by its faults only."""
    if ended.summary is None or ended.summary.ended_by != "set" or ended.summary.on_target_s == 0.0:
        return False
    # A pause takes as long as it takes to see the mount at rest, which faults prolong.
    if any(fault.kind in {"clock", "step", "drive", "sync"} for fault in storm.faults):
        # Whoever's clock was set, what is followed by it is somewhere else: nothing tells which was right.
        # So is a mount that was synced.
        # Drives without power let a mount coast; what was as fast as its satellite stays near it for long.
        return False
    return all(one.channel == "starter" and "pause" not in one.line for one in storm.people)


def judge_recovery(world: World, watcher: Watcher, fair: Watcher, fair_ended: Ended) -> None:
    """Compare the axes of both runs from RECOVERED_S after the storm to the end of the pass."""
    storm = watcher.storm
    summary = fair_ended.summary
    if summary is None or summary.ended_by != "set":
        return
    acquired_s = None if fair_ended.engine is None else fair_ended.engine.tracker.acquired_utc_s
    if acquired_s is None:
        return
    # On the way to its satellite a run is where its losses and its drives' limits put it.
    calm_s = max(storm.begin_s + storm.storm_ends_s, storm.facts.plan.start_utc_s + RECOVERED_S, acquired_s)
    begin_s = calm_s + RECOVERED_S
    end_s = storm.facts.plan.end_utc_s - 0.5
    near_deg = AT_LIMIT_DEG + (0.0 if storm.other is None else storm.other.beside_deg)
    if fair.nearest_deg(begin_s - RECOVERED_S, end_s) < near_deg:
        # What keeps a run at a limit lets it go sooner or later by where it came from.
        return
    other = [axes for axes in fair.path if begin_s - 1.0 < axes.utc_s < end_s + 1.0]
    # The link's own losses and delays last to the end: what somebody changes takes its time through them.
    changes_s = [storm.begin_s + one.at_s for one in storm.people]
    worst = 0.0
    for axes in watcher.path:
        settles = any(0.0 <= axes.utc_s - change_s < RECOVERED_S for change_s in changes_s)
        if begin_s < axes.utc_s < end_s and not settles:
            worst = max(worst, _apart_arcsec(axes, other))
    watcher.verdict.recovered_arcsec = worst
    bound = max(OFF_ARCSEC, 2.0 * (summary.reported_peak_arcsec or 0.0))
    if worst > bound and max(storm.commands.loss, storm.statuses.loss) > 0.0:
        # What the link loses by itself it goes on to lose after the storm.
        peaks = (_peak_arcsec(storm.on_its_link(1 + k)) for k in range(LOSSY_RUNS))
        bound = next((2.0 * peak for peak in peaks if 2.0 * peak >= worst), bound)
    if worst > bound:
        watcher.violated("recovery", world, f"{worst:.2f}″ off, 5 s after the storm and later")


def _peak_arcsec(storm: Storm) -> float:
    summary = World(storm, Judging()).run().summary
    return 0.0 if summary is None else summary.reported_peak_arcsec or 0.0


def _apart_arcsec(axes: Axes, path: list[Axes]) -> float:
    """Return how far axes are from where a path is at that instant, arcseconds on the sky."""
    import bisect

    at = bisect.bisect_left(path, axes.utc_s, key=lambda one: one.utc_s)
    at = min(max(at, 1), len(path) - 1)
    one, two = path[at - 1], path[at]
    # Between two turns the axes move evenly enough: rates differ by less than an arcsecond's worth.
    h = two.utc_s - one.utc_s
    s = (axes.utc_s - one.utc_s) / h
    ha, dec = (
        _hermite(p0, p1, v0 * h, v1 * h, s)
        for p0, p1, v0, v1 in (
            (one.hour_angle_deg, two.hour_angle_deg, one.hour_angle_rate_deg_s, two.hour_angle_rate_deg_s),
            (one.dec_axis_deg, two.dec_axis_deg, one.dec_rate_deg_s, two.dec_rate_deg_s),
        )
    )
    across = (axes.hour_angle_deg - ha) * math.cos(math.radians(dec))
    return 3600.0 * math.hypot(across, axes.dec_axis_deg - dec)


def _hermite(p0: float, p1: float, m0: float, m1: float, s: float) -> float:
    """Return a cubic's value between two places with their slopes."""
    return (
        (1.0 + 2.0 * s) * (1.0 - s) ** 2 * p0
        + s * (1.0 - s) ** 2 * m0
        + s * s * (3.0 - 2.0 * s) * p1
        + s * s * (s - 1.0) * m1
    )
