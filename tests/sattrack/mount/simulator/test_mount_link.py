"""The simulated mount's timer, its wires and its faults: laws, shares, dates, and what can be written."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from simulator_bench import PERIOD_S, SIDEREAL_DEG_S, SITE, START, T0, moving

from sattrack.core.errors import BadInputError
from sattrack.mount.model import MountProfile
from sattrack.mount.simulator.installation import (
    FaultEvent,
    Faults,
    Installation,
    LoopRun,
    Timer,
    Wire,
    WireLaw,
    parse_faults,
)
from sattrack.mount.simulator.mount import SimulatedMount
from sattrack.mount.simulator.profile import SimulatorProfile
from sattrack.mount.xerxes.datagrams import Command, decode_status, encode_command

GRAIN_S = 0.015625
"""64 clock interrupts a second."""


def firings(timer: Timer, count: int = 4000) -> np.ndarray:
    times = [timer.next(0.0)]
    while len(times) < count:
        times.append(timer.next(times[-1]))
    return np.array(times)


class TestTimer:
    def test_exact_is_exact(self) -> None:
        assert firings(Timer("exact")) == pytest.approx(np.arange(4000) * 0.05, abs=1e-9)

    def test_windows_keeps_the_mean_in_whole_grains(self) -> None:
        gaps = np.diff(firings(Timer("windows", seed=4)))
        assert gaps.mean() == pytest.approx(0.05, rel=1e-3)
        grains = gaps / GRAIN_S
        assert set(np.round(grains)) == {3.0, 4.0}
        assert np.abs(grains - np.round(grains)).max() * GRAIN_S <= 0.001

    def test_rearmed_it_takes_62_5_ms(self) -> None:
        gaps = np.diff(firings(Timer("windows_rearmed", seed=4)))
        assert gaps == pytest.approx(np.full(3999, 0.0625), abs=0.001)

    @pytest.mark.parametrize("law", ["exact", "windows", "windows_rearmed"])
    def test_it_drifts_by_millionths(self, law: str) -> None:
        true, slow = (firings(Timer(law, drift_ppm=ppm, seed=4))[-1] for ppm in (0.0, 500.0))  # type: ignore[arg-type]
        assert slow / true - 1.0 == pytest.approx(500e-6, rel=1e-6)

    @pytest.mark.parametrize("law", ["exact", "windows", "windows_rearmed"])
    def test_what_was_missed_is_dropped_and_the_seed_decides(self, law: str) -> None:
        timers = [Timer(law, seed=seed) for seed in (1, 1, 2)]  # type: ignore[arg-type]
        times = [[t.next(0.0), t.next(0.1), t.next(7.3), t.next(7.3)] for t in timers]
        assert times[0] == times[1]
        assert (times[0] == times[2]) is (law == "exact")
        assert 0.1 < times[0][1] < 0.17
        assert 7.3 < times[0][2] < 7.37
        assert 0.04 < times[0][3] - times[0][2] < 0.07


class TestWire:
    DATA = bytes(range(82))

    def arrivals(self, count: int = 20000, **law: float) -> list[list[tuple[float, bytes]]]:
        wire = Wire(WireLaw(**law), "seed")
        return [wire.carry(self.DATA) for _ in range(count)]

    @pytest.mark.parametrize(("what", "copies"), [("loss", 0), ("duplicate", 2)])
    def test_shares_are_those_asked_for(self, what: str, copies: int) -> None:
        hit = sum(len(arrivals) == copies for arrivals in self.arrivals(**{what: 0.03}))
        assert hit / 20000 == pytest.approx(0.03, abs=4 * (0.03 / 20000) ** 0.5)

    def test_delays_are_uniform_within_the_jitter(self) -> None:
        delays = np.array([a[0][0] for a in self.arrivals(delay_s=0.02, jitter_s=0.005)])
        assert (delays.min(), delays.max()) == pytest.approx((0.015, 0.025), abs=1e-5)
        assert delays.std() == pytest.approx(0.005 / 3**0.5, rel=0.02)

    def test_what_is_held_back_is_overtaken(self) -> None:
        delays = [a[0][0] for a in self.arrivals(reorder=0.02)]
        arrived = [number * PERIOD_S + delay for number, delay in enumerate(delays)]
        overtaken = sum(later < earlier for earlier, later in itertools.pairwise(arrived))
        assert overtaken / 20000 == pytest.approx(0.02, abs=0.004)

    def test_corruption_turns_one_bit(self) -> None:
        spoilt = [data for [(_, data)] in self.arrivals(corrupt=0.1) if data != self.DATA]
        assert len(spoilt) / 20000 == pytest.approx(0.1, abs=0.01)
        for data in spoilt:
            bits = [(a ^ b).bit_count() for a, b in zip(data, self.DATA, strict=True)]
            assert sum(bits) == 1


class TestGrammar:
    def test_all_of_it_at_once(self) -> None:
        faults = parse_faults(
            "loss=3%,duplicate=1%, reorder-status=2%,delay-command=20ms~5ms,delay-status=.5s,corrupt=0.1%,"
            "crash@60s+5s,freeze@30s+2s,drive@90s,drive-dec@91s,clock-step@40s-0.5s,silent:20"
        )
        assert (faults.command.loss, faults.status.loss) == (0.03, 0.03)
        assert (faults.command.reorder, faults.status.reorder) == (0.0, 0.02)
        assert (faults.command.delay_s, faults.command.jitter_s) == (0.02, 0.005)
        assert (faults.status.delay_s, faults.status.jitter_s) == (0.5, 0.0)
        assert faults.command.corrupt == pytest.approx(0.001)
        assert faults.events == (
            FaultEvent("silent", 20.0),
            FaultEvent("freeze", 30.0, 2.0),
            FaultEvent("clock-step", 40.0, -0.5),
            FaultEvent("crash", 60.0, 5.0),
            FaultEvent("drive", 90.0),
            FaultEvent("drive-dec", 91.0),
        )

    @pytest.mark.parametrize("nothing", [None, "", " , "])
    def test_nothing_asked_for_is_no_fault(self, nothing: str | None) -> None:
        assert parse_faults(nothing) == Faults()

    @pytest.mark.parametrize(
        ("text", "part", "hint"),
        [
            ("loss=3%,explode", "explode", "silent:SECONDS"),
            ("loss=3", "loss=3", "loss=3%"),
            ("loss=101%", "loss=101%", "0% to 100%"),
            ("loss=-1%", "loss=-1%", "0% to 100%"),
            ("loss=nan%", "loss=nan%", "0% to 100%"),
            ("loss-up=3%", "loss-up=3%", "no fault is called 'loss-up'"),
            ("delay=20", "delay=20", "delay=20ms~5ms"),
            ("delay-status=6s", "delay-status=6s", "up to 5 s"),
            ("freeze@30s", "freeze@30s", "for how long"),
            ("freeze@30+2", "freeze@30+2", "freeze@30s+2s"),
            ("crash@1s-2s", "crash@1s-2s", "only a clock"),
            ("clock-step@1s", "clock-step@1s", "clock-step@40s+0.5s"),
            ("drive-ra@1s+2s", "drive-ra@1s+2s", "until a restart"),
            ("silent:soon", "silent:soon", "silent:SECONDS"),
            ("silent:-1", "silent:-1", "silent:SECONDS"),
            ("freeze=3%", "freeze=3%", "no fault is called"),
            ("loss@3s", "loss@3s", "no fault is called"),
        ],
    )
    def test_what_is_wrong_is_named_with_what_may_stand_there(self, text: str, part: str, hint: str) -> None:
        with pytest.raises(BadInputError) as refusal:
            parse_faults(text)
        message = str(refusal.value)
        assert message.startswith(f"--faults {part}: ")
        assert hint in message
        assert "\n" not in message


class Site:
    """An installation in virtual time, its client sending one command every period."""

    def __init__(self, faults: str, **hardware: object) -> None:
        profile = SimulatorProfile(faults=faults, **hardware)  # type: ignore[arg-type]
        self.mount = SimulatedMount(MountProfile(), SITE, START, profile)
        self.installation = Installation(self.mount)
        self.now = self.installation.next_turn_s(T0)
        self.begun = self.now
        self.turns: list[tuple[float, LoopRun]] = []

    def until(self, elapsed_s: float, **fields: object) -> None:
        while self.now - self.begun < elapsed_s - 1e-6:
            self.installation.receive(encode_command(Command(**fields)))  # type: ignore[arg-type]
            self.turns.append((self.now - self.begun, self.installation.turn(self.now)))
            self.now = self.installation.next_turn_s(self.now)

    def told(self) -> list[float]:
        return [elapsed for elapsed, turn in self.turns if turn.status is not None]

    def gaps(self) -> list[tuple[float, float]]:
        """Where more than a period passes between two statuses."""
        return [(a, b) for a, b in itertools.pairwise(self.told()) if b - a > 1.5 * PERIOD_S]

    def last(self) -> LoopRun:
        return next(turn for _, turn in reversed(self.turns) if turn.truth is not None)


class TestEvents:
    def test_a_freeze_stops_the_program_and_not_the_drives(self) -> None:
        site = Site("freeze@3s+2s")
        site.until(8.0, **moving(1.0, None))
        assert site.gaps() == [pytest.approx((2.95, 5.0), abs=1e-6)]
        counters = [decode_status(t.status).counter for _, t in site.turns if t.status is not None]
        assert counters == list(range(1, len(counters) + 1))
        truth = site.last().truth
        assert truth is not None
        assert truth.hour_angle_axis_deg + 30.0 == pytest.approx(7.9 * (1.0 + SIDEREAL_DEG_S), abs=0.1)

    @pytest.mark.parametrize("drives", ["stop", "hold"])
    def test_a_crash_begins_the_counter_anew_and_drives_do_as_set(self, drives: str) -> None:
        site = Site("crash@3s+5s", crashed_drives=drives)
        site.until(8.0, **moving(1.0, None))
        assert site.turns[-1][1] == (None, None)
        site.until(8.05)
        status, truth = site.last()
        assert status is not None
        assert truth is not None
        assert decode_status(status).counter == 1
        expected = -30.0 + (3.0 if drives == "stop" else 8.0)
        assert truth.hour_angle_axis_deg == pytest.approx(expected, abs=0.15)
        assert decode_status(status).slewing is False
        site.until(10.0)
        truth = site.last().truth
        assert truth is not None
        assert truth.ra_rate_deg_s == pytest.approx(0.0, abs=1e-9)

    def test_a_drive_fault_stops_its_axis(self) -> None:
        site = Site("drive-ra@3s")
        site.until(8.0, **moving(1.0, 1.0))
        truth = site.last().truth
        assert truth is not None
        assert truth.ra_rate_deg_s == pytest.approx(SIDEREAL_DEG_S, abs=1e-9)
        assert truth.dec_rate_deg_s == pytest.approx(1.0)

    def test_a_clock_step_shifts_sidereal_time(self) -> None:
        plain, stepped = Site(""), Site("clock-step@2s+0.5s")
        for site in (plain, stepped):
            site.until(4.0)
        sidereal = [
            [decode_status(t.status).sidereal_h * 15 for _, t in site.turns if t.status is not None]
            for site in (plain, stepped)
        ]
        ahead = np.array(sidereal[1]) - np.array(sidereal[0])
        assert ahead[:39] == pytest.approx(np.zeros(39), abs=1e-9)
        assert ahead[41:] == pytest.approx(np.full(len(ahead) - 41, 0.5 * SIDEREAL_DEG_S), abs=1e-7)

    def test_silence_is_of_statuses_alone(self) -> None:
        site = Site("silent@2s+1s,silent:5")
        site.until(8.0, **moving(None, 1.0))
        assert site.gaps() == [pytest.approx((1.95, 3.0), abs=1e-6)]
        assert max(site.told()) == pytest.approx(4.95)
        truth = site.last().truth
        assert truth is not None
        assert truth.dec_deg == pytest.approx(20.0 + 7.9, abs=0.1)

    def test_the_deaf_hear_no_end_of_a_motion_and_a_cut_link_is_deaf_and_silent(self) -> None:
        for fault, gaps in (("deaf@2s+1s", []), ("cut@2s+1s", [pytest.approx((1.95, 3.0), abs=1e-6)])):
            site = Site(fault)
            site.until(2.5, **moving(None, 1.0))
            site.until(5.0)
            assert site.gaps() == gaps
            truth = site.last().truth
            assert truth is not None
            assert truth.dec_deg == pytest.approx(20.0 + 3.0, abs=0.15)

    def test_the_same_seed_gives_the_same_run(self) -> None:
        runs = []
        for seed in (7, 7, 8):
            site = Site("loss=10%,delay=20ms~9ms", timer="windows", encoder_noise_tics=0.5, seed=seed)
            site.until(5.0, **moving(1.0, -1.0))
            arrivals = [site.installation.statuses.carry(t.status) for _, t in site.turns if t.status]
            runs.append((site.turns, arrivals))
        assert runs[0] == runs[1]
        assert runs[0] != runs[2]

    def test_delays_are_the_hardwares_own_where_it_has_any(self) -> None:
        mount = SimulatedMount(MountProfile(), SITE, START, SimulatorProfile(status_delay_s=0.03))
        installation = Installation(mount, None, 0.001, 0.002)
        assert installation.commands.carry(b"x") == [(0.001, b"x")]
        assert installation.statuses.carry(b"x") == [(0.03, b"x")]
