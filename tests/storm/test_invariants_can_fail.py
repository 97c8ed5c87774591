"""Each invariant of the storms with a world or a driver that breaks it: none of them is blind."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

import msgspec
import pytest
from storm.draws import Fault, Person, Storm, draw
from storm.invariants import Watcher, judged
from storm.night import NightWorld, Session
from storm.programs import ServedLoop, ServedWorld
from storm.world import Guard, Sent, World

from sattrack.control.engine import Engine
from sattrack.mount.xerxes.datagrams import Command, encode_command
from sattrack.recording.recorder import Recorder
from sattrack.runtime.facts import build_engine
from sattrack.safety import SafetyLimits
from sattrack.schedule.night_executor import drive
from sattrack.schedule.night_stop import NightRequests
from sattrack.views.messages import Nudge

if TYPE_CHECKING:
    from sattrack.runtime.facts import RunFacts
    from sattrack.schedule.night import End, PassAttempt, Run

SEED = 8
"""Divisible by whatever invariants look at some seeds only; a quiet run of a velocity servo."""
LASTS_S, BRIEF_S = 21.0, 8.0
MOVES = encode_command(
    Command(5, move_ra=True, move_dec=True, move_ra_rate_deg_s=0.5, move_dec_rate_deg_s=0.5)
)


def quiet(*faults: Fault, lasts_s: float = LASTS_S) -> Storm:
    """Return a run with these faults and nobody about."""
    fair = draw(SEED).fair()
    plan = msgspec.structs.replace(fair.facts.plan, end_utc_s=fair.begin_s + lasts_s)
    facts = msgspec.structs.replace(fair.facts, plan=plan)
    return replace(fair, facts=facts, faults=faults, people=(), fault_free=False)


def violated(storm: Storm, world_of: type[World] | None = None) -> set[str]:
    verdict, _ = judged(storm, world_of=world_of)
    return {one.invariant for one in verdict.violations}


def violated_alone(storm: Storm, world_of: type[World]) -> set[str]:
    """Return what a run breaks, without another one with which to compare its recovery."""
    watcher = Watcher(storm)
    world_of(storm, watcher).run()
    return {one.invariant for one in watcher.verdict.violations}


def test_the_quiet_run_breaks_nothing() -> None:
    assert violated(quiet()) == set()


class WithEngine(World):
    """A world whose program has another driver."""

    def engine(self) -> Engine:
        engine = build_engine(self.facts)
        engine.__class__ = self.driver
        return engine

    driver: type[Engine] = Engine

    @property
    def facts(self) -> RunFacts:
        return self.storm.facts


def test_limit() -> None:
    class Blind(WithEngine):
        @property
        def facts(self) -> RunFacts:
            return msgspec.structs.replace(self.storm.facts, limits=SafetyLimits(optical=False))

    storm = quiet(lasts_s=BRIEF_S)
    strict = msgspec.structs.replace(storm.facts, limits=SafetyLimits(floor_altitude_deg=89.0, optical=False))
    assert "limit" in violated(replace(storm, facts=strict), Blind)


def test_rate() -> None:
    class Unclamped(WithEngine):
        class driver(Engine):  # noqa: N801 - it overrides an attribute
            def tick(self, now_utc_s: float) -> bytes:
                datagram = super().tick(now_utc_s)
                if self.tracker.ended_by is not None:
                    return datagram
                command = Command(9, move_ra=True, move_ra_rate_deg_s=5.0, move_dec=True)
                return encode_command(command)

    storm = quiet(lasts_s=BRIEF_S)
    slower = replace(storm.hardware, max_rate_deg_s=1.0)
    watcher = Watcher(replace(storm, hardware=slower))
    Unclamped(storm, watcher).run()
    assert "rate" in {one.invariant for one in watcher.verdict.violations}


def test_stop() -> None:
    class Afterwards(World):
        def _linger(self) -> None:
            self.leave(Sent(self.now_s, "stranger", MOVES, self.now_s, self.now_s))
            super()._linger()

    assert violated_alone(quiet(), Afterwards) == {"stop"}


def test_stale() -> None:
    class Reckless(WithEngine):
        class driver(Engine):  # noqa: N801 - it overrides an attribute
            def tick(self, now_utc_s: float) -> bytes:
                datagram = super().tick(now_utc_s)
                age_s = self.session.health.age_s(now_utc_s)
                if age_s is None or age_s < 1.0:
                    return datagram
                rate = math.sin(20.0 * now_utc_s)
                return encode_command(Command(7, move_ra=True, move_ra_rate_deg_s=rate))

    assert "stale" in violated(quiet(Fault(10.0, "silent", 5.0)), Reckless)


def test_owner() -> None:
    class Deaf(Guard):
        deposed = False  # type: ignore[assignment]

        def beat(self, *what: Any) -> bool:
            super().beat(*what)
            return True

    with patch("storm.world.Guard", Deaf):
        assert "owner" in violated(quiet(Fault(10.0, "stall", 3.0)))


def test_once() -> None:
    class Fickle(WithEngine):
        class driver(Engine):  # noqa: N801 - it overrides an attribute
            def tick(self, now_utc_s: float) -> bytes:
                if self.tracker.ended_by == "set" and self.session.health.sent % 3 == 0:
                    self.tracker.ended_by = "operator"
                return super().tick(now_utc_s)

    assert violated_alone(quiet(), Fickle) == {"once"}


def test_once_where_a_server_does_not_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is ended, and not served for ever."""
    monkeypatch.setattr("storm.world.ENDLESS_S", 90.0)

    monkeypatch.setattr(ServedLoop, "interrupt", lambda *of: None)
    storm = next(one for one in map(draw, range(5000)) if one.program == "rotctld").fair()
    people = (Person(8.0, "", "stop"),)
    assert "once" in violated_alone(replace(storm, people=people, fault_free=False), ServedWorld)


def test_replay(monkeypatch: pytest.MonkeyPatch) -> None:
    write = Recorder.status

    def forgetful(self: Recorder, utc_s: float, data: bytes) -> None:
        if data[104] % 16:
            write(self, utc_s, data)

    monkeypatch.setattr(Recorder, "status", forgetful)
    assert violated_alone(quiet(lasts_s=BRIEF_S), World) == {"replay"}


def test_memory() -> None:
    class Hoarder(WithEngine):
        class driver(Engine):  # noqa: N801 - it overrides an attribute
            def tick(self, now_utc_s: float) -> bytes:
                self.held_s |= {f"{now_utc_s} {k}": 0.0 for k in range(20)}
                return super().tick(now_utc_s)

    assert "memory" in violated_alone(quiet(lasts_s=1.5 * LASTS_S), Hoarder)


class TestNights:
    NIGHT = 300_003

    def night(self, *people: Person) -> Storm:
        return replace(draw(self.NIGHT).fair(), people=people, fault_free=False)

    def test_a_quiet_one_breaks_nothing(self) -> None:
        assert violated_alone(self.night(), NightWorld) == set()
        assert violated_alone(self.night(Person(8.0, "", "stop")), NightWorld) == set()

    def test_a_pass_that_comes_to_no_end(self) -> None:
        def loses(*given: Any) -> tuple[Run, End | None]:
            run, end = drive(*given)
            return msgspec.structs.replace(run, results=run.results[:-1]), end

        with patch("storm.night.drive", loses):
            assert violated_alone(self.night(), NightWorld) == {"once", "replay"}

    def test_an_end_that_nobody_asked_for(self) -> None:
        with patch.object(NightRequests, "asked", True):
            assert violated_alone(self.night(), NightWorld) == {"once"}

    def test_a_stop_that_ends_the_session_only(self) -> None:
        follow = Session.run

        def forgets(self: Session) -> PassAttempt:
            attempt = follow(self)
            return attempt if attempt.ended_by != "operator" else replace_ended(attempt, "link")

        class Forgetful(NightWorld):
            def _ask_stop(self) -> None:
                World._ask_stop(self)
                self.judge.stopping(self)

        with patch.object(Session, "run", forgets):
            assert "stop" in violated_alone(self.night(Person(8.0, "", "stop")), Forgetful)


def replace_ended(attempt: PassAttempt, ended_by: str) -> PassAttempt:
    return msgspec.structs.replace(attempt, ended_by=ended_by)


@pytest.mark.parametrize("loss", [0.0, 0.05])
def test_recovery(loss: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also on a link that loses by itself: what that costs is measured, not excused."""
    monkeypatch.setattr("storm.invariants.LOSSY_RUNS", 2)

    class Astray(WithEngine):
        class driver(Engine):  # noqa: N801 - it overrides an attribute
            def tick(self, now_utc_s: float) -> bytes:
                if self.session.health.sent == 220:
                    self.operate(Nudge(along_s=0.1), now_utc_s)
                return super().tick(now_utc_s)

    # What is judged begins 10 s after the run; the offset comes a second before its end.
    storm = quiet(Fault(3.0, "cut", 0.1), lasts_s=12.0)
    storm = replace(storm, statuses=replace(storm.statuses, loss=loss))
    assert "recovery" in violated(storm, Astray)
