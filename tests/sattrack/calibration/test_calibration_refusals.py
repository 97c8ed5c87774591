"""When a calibration does not begin, when it stops, and how it leaves the mount."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from calibration import Network
from calibration_builders import BEGIN, CLEAR, SHORT, run
from ramp_mount import RampMount

from sattrack.calibration.findings import slewing_field
from sattrack.calibration.guard import CalibrationEndedError, CalibrationGuard, EndKind
from sattrack.core.angles import separation_deg
from sattrack.mount.model import MountProfile
from sattrack.mount.xerxes.datagrams import Command
from sattrack.runtime.calibrate import surroundings
from sattrack.safety.limits import SafetyLimits
from tle.site import Site

if TYPE_CHECKING:
    from sattrack.calibration.calibrator import Calibrator
    from sattrack.mount.model import PierRule

ABORT, MOVE_RA, MOVE_DEC = 73, 75, 76
FLAGS = range(73, 82)


def flags(data: bytes) -> set[int]:
    return {i for i in FLAGS if data[i]}


def ended(mount: RampMount, **changes: Any) -> Calibrator:
    calibrator = run(mount, plan=SHORT, **changes).calibrator
    assert calibrator.ending is not None
    return calibrator


@dataclass
class Slewing(RampMount):
    def begin(self, t: float) -> None:
        super().begin(t)
        self.dec.go(t, 0.5)


class TestItDoesNotBegin:
    @pytest.mark.parametrize(
        ("mount", "around", "kind", "words"),
        [
            (RampMount(declination=-15.0), CLEAR, EndKind.LIMIT, "altitude falls to"),
            (
                RampMount(),
                replace(CLEAR, floor_altitude_deg=75.0),
                EndKind.LIMIT,
                "at least 75° is needed",
            ),
            (RampMount(declination=86.0), CLEAR, EndKind.LIMIT, "too near the pole"),
            (RampMount(), replace(CLEAR, hour_angle_limit_deg=22.0), EndKind.LIMIT, "limit of 22°"),
            (
                RampMount(),
                replace(CLEAR, sun_hour_angle_deg=-3.0, sun_dec_deg=20.0),
                EndKind.LIMIT,
                "slew away from the Sun",
            ),
            (Slewing(slewing=True), CLEAR, EndKind.REFUSED, "it is slewing"),
            (RampMount(parked=True), CLEAR, EndKind.REFUSED, "it is parked"),
            (RampMount(clock_ahead=4000.0), CLEAR, EndKind.REFUSED, "4000 s from that of the site"),
            (RampMount(longitude_told=5.5), CLEAR, EndKind.REFUSED, "believes it stands at 52.00, 5.50"),
        ],
    )
    def test_and_says_why_and_sends_no_flag(
        self, mount: RampMount, around: Any, kind: EndKind, words: str
    ) -> None:
        mount = replace(mount)
        done = run(mount, around=around, plan=SHORT)
        ending = done.calibrator.ending
        assert ending is not None
        assert (ending.kind, ending.at_rest) == (kind, None)
        assert words in ending.words
        assert "\n" not in ending.words
        assert all(flags(data) == set() for _, data in done.run.commands)

    @pytest.mark.parametrize("pier_rule", ["hour_angle", "ascom"])
    @pytest.mark.parametrize("hour_angle_limit_deg", [133.0, 200.0])
    def test_beyond_the_pole_by_where_the_first_axis_stands(
        self, pier_rule: PierRule, hour_angle_limit_deg: float
    ) -> None:
        west = pier_rule == "hour_angle"
        mount = RampMount(hour_angle=50.0 if west else -50.0, beyond_pole=True)
        profile = MountProfile(
            pier_rule=pier_rule,
            hour_angle_limit_deg=hour_angle_limit_deg,
            dec_axis_limits_deg=(-270.0, 270.0),
        )
        site = Site(mount.latitude, mount.longitude, 0.0)
        around = surroundings(site, profile, BEGIN, SafetyLimits(optical=False))
        around = replace(CLEAR, bounds=around.bounds, first_axis_middle_deg=around.first_axis_middle_deg)
        ending = run(mount, around=around, plan=SHORT).calibrator.ending
        assert ending is not None
        # It stands at -130° or 130°, and may come 4.2° farther either way.
        kind = EndKind.LIMIT if hour_angle_limit_deg < 134.2 else EndKind.DONE
        assert ending.kind is kind, ending.words
        assert ("its hour_angle limit" in ending.words) == (kind is EndKind.LIMIT)

    def test_without_a_status(self) -> None:
        ending = ended(RampMount(), cut=(0.0, math.inf)).ending
        assert ending is not None
        assert ending.kind is EndKind.LINK
        assert "no status from the mount" in ending.words

    def test_while_the_mount_moves_by_itself(self) -> None:
        @dataclass
        class Wandering(RampMount):
            def begin(self, t: float) -> None:
                super().begin(t)
                self.dec.go(t, 0.1)

        ending = ended(Wandering()).ending
        assert ending is not None
        assert "moves by itself" in ending.words

    def test_while_another_program_has_a_flag_up(self) -> None:
        mount = RampMount(deaf=True)
        mailbox = bytearray(82)
        mailbox[MOVE_DEC] = 255
        mount.mailbox = bytes(mailbox)
        ending = ended(mount).ending
        assert ending is not None
        assert ending.kind is EndKind.REFUSED
        assert "another program" in ending.words


class TestItStops:
    def check_rest(self, mount: RampMount, at: float) -> None:
        assert mount.ra.at(at)[1] == 0.0
        assert mount.dec.at(at)[1] == 0.0

    @pytest.mark.parametrize("edge", [False, True])
    @pytest.mark.parametrize("after_s", [0.5, 2.5, 4.0, 7.03, 9.5, 11.0, 13.7, 19.3, 20.1, 22.0])
    def test_on_a_key_at_any_moment_within_two_datagrams(self, after_s: float, edge: bool) -> None:
        mount = RampMount(edge=edge)

        def press(now: float, calibrator: Calibrator) -> None:
            if now - BEGIN >= after_s:
                calibrator.stop("stopped by a key")

        done = run(mount, Network(0.03, 0.02), plan=SHORT, watch=press)
        ending = done.calibrator.ending
        assert ending is not None
        assert (ending.kind, ending.words) == (EndKind.OPERATOR, "stopped by a key")
        since = [data for at, data in done.run.commands if at >= BEGIN + after_s]
        if after_s < 2.0:
            assert ending.at_rest is None
            return
        assert ending.at_rest is True
        assert all(not flags(data) & {MOVE_RA, MOVE_DEC} for data in since)
        first = next(i for i, data in enumerate(since) if data[ABORT])
        before = done.run.commands[-len(since) - 1][1]
        # Where an abort is up already, it must fall before it can rise again.
        assert first <= (5 if before[ABORT] else 1)
        assert flags(done.run.commands[-1][1]) == set()
        self.check_rest(mount, done.run.now_utc_s)

    def test_where_the_mount_falls_silent_while_it_moves(self) -> None:
        mount = RampMount()
        done = run(mount, plan=SHORT, cut=(8.0, 9e9))
        ending = done.calibrator.ending
        assert ending is not None
        assert (ending.kind, ending.at_rest) == (EndKind.LINK, False)
        assert "fell silent" in ending.words
        self.check_rest(mount, done.run.now_utc_s)

    def test_and_sees_the_rest_where_the_statuses_come_back(self) -> None:
        ending = ended(RampMount(), cut=(8.0, 10.0)).ending
        assert ending is not None
        assert (ending.kind, ending.at_rest) == (EndKind.LINK, True)

    @pytest.mark.parametrize(
        ("mount", "words"),
        [
            (RampMount(deaf=True), "did not acknowledge an abort"),
            (RampMount(stuck=True), "does not move"),
            (RampMount(dec_gain=2.5), "times as fast"),
            (RampMount(ra_gain=2.5), "times as fast"),
            (RampMount(ra_gain=0.1), "does not move"),
        ],
    )
    def test_where_the_mount_does_not_obey(self, mount: RampMount, words: str) -> None:
        mount = replace(mount)
        done = run(mount, plan=SHORT)
        ending = done.calibrator.ending
        assert ending is not None
        assert ending.kind is EndKind.DOUBT
        assert words in ending.words
        if not mount.deaf:
            assert ending.at_rest
            self.check_rest(mount, done.run.now_utc_s)

    def test_where_an_axis_runs_away(self) -> None:
        @dataclass
        class Runaway(RampMount):
            def _speeds(self, t: float, ra: float, dec: float) -> None:
                super()._speeds(t, ra, -1.4 if dec < -0.3 else dec)

        done = run(Runaway(), plan=replace(SHORT, legs=(replace(SHORT.legs[0], seconds=4.0), SHORT.legs[1])))
        ending = done.calibrator.ending
        assert ending is not None
        assert ending.kind is EndKind.LIMIT
        assert "declination axis came 3" in ending.words
        assert ending.at_rest

    def test_where_the_side_of_the_pier_changes(self) -> None:
        mount = RampMount()

        def flip(now: float, _: object) -> None:
            mount.beyond_pole = now - BEGIN > 8.0

        ending = ended(mount, watch=flip).ending
        assert ending is not None
        assert "other side of the pier" in ending.words

    def test_where_the_mount_starts_again(self) -> None:
        mount = RampMount()

        def restart(now: float, _: object) -> None:
            if 8.0 < now - BEGIN < 8.06:
                mount.counter = 0

        ending = ended(mount, watch=restart).ending
        assert ending is not None
        assert "started again" in ending.words

    def test_where_the_mount_is_synced_elsewhere(self) -> None:
        @dataclass
        class Synced(RampMount):
            def tick(self, t: float) -> bytes:
                data = bytearray(super().tick(t))
                if t - BEGIN > 8.0:
                    struct.pack_into("<d", data, 24, struct.unpack_from("<d", data, 24)[0] + 1.0)
                return bytes(data)

        ending = ended(Synced()).ending
        assert ending is not None
        assert "jumped by" in ending.words

    def test_where_another_program_sends_too(self) -> None:
        @dataclass
        class Shared(RampMount):
            """Somebody else's flag-free datagrams come in between, from the tenth second on."""

            def tick(self, t: float) -> bytes:
                if t - BEGIN > 9.0 and self.counter % 2:
                    self.mailbox = b"\xaa\xaa\x55\x55" + bytes(78)
                return super().tick(t)

        done = run(Shared(), plan=SHORT)
        ending = done.calibrator.ending
        assert ending is not None
        assert ending.kind is EndKind.DOUBT
        assert "another program commands it" in ending.words

    def test_where_a_status_says_that_the_mount_slews_for_another(self) -> None:
        @dataclass
        class Slewed(RampMount):
            def tick(self, t: float) -> bytes:
                data = bytearray(super().tick(t))
                data[158] = 255 if t - BEGIN > 8.0 else 0
                return bytes(data)

        ending = ended(Slewed()).ending
        assert ending is not None
        assert "not ours" in ending.words

    def test_a_mount_that_does_not_come_to_rest_is_told_of(self) -> None:
        @dataclass
        class Drifting(RampMount):
            broken: bool = field(default=False)

            def _speeds(self, t: float, ra: float, dec: float) -> None:
                super()._speeds(t, ra, 0.02 if self.broken else dec)

        mount = Drifting()

        def break_it(now: float, calibrator: Calibrator) -> None:
            if now - BEGIN > 8.0:
                mount.broken = True
                calibrator.stop("stopped by a key")

        ending = ended(mount, watch=break_it).ending
        assert ending is not None
        assert ending.at_rest is False

    def test_rubbish_and_late_datagrams_change_nothing(self) -> None:
        plain = run(RampMount(), Network(0.02, 0.02), plan=SHORT)

        def disturb(now: float, calibrator: Calibrator) -> None:
            calibrator.receive(b"rubbish", now)
            calibrator.receive(bytes(160), now)
            if calibrator.seen.log.heard:
                calibrator.receive(old, now)

        before = RampMount()
        before.begin(BEGIN)
        old = before.tick(BEGIN)
        disturbed = run(RampMount(), Network(0.02, 0.02), plan=SHORT, watch=disturb)
        assert disturbed.run.commands == plain.run.commands
        assert disturbed.calibrator.seen.log.rejected > 100


class TestTheGuardLetsOut:
    @pytest.mark.parametrize(
        "command",
        [
            Command(slew=True),
            Command(sync=True),
            Command(park=True),
            Command(pulse_guide=True),
            Command(find_home=True),
            Command(move_dec=True, move_dec_rate_deg_s=0.1),
            Command(move_ra_rate_deg_s=1.1),
            Command(move_dec_rate_deg_s=math.nan),
        ],
    )
    def test_nothing_but_aborts_and_bounded_motions(self, command: Command) -> None:
        with pytest.raises(CalibrationEndedError, match="a defect"):
            CalibrationGuard(CLEAR, 1.0).clear(command)

    def test_an_abort_as_the_paper_packs_it(self) -> None:
        data = CalibrationGuard(CLEAR, 1.0).clear(Command(counter=7, abort=True))
        assert data[:16] == bytes.fromhex("aaaa5555000000000700000000000000")
        assert flags(data) == {ABORT}


def test_separations_are_those_of_vectors() -> None:
    rng = np.random.default_rng(3)
    for ha_1, dec_1, ha_2, dec_2 in rng.uniform(-89, 89, (50, 4)):
        one, other = (
            np.array([math.cos(d) * math.cos(h), math.cos(d) * math.sin(h), math.sin(d)])
            for h, d in ((math.radians(ha_1), math.radians(dec_1)), (math.radians(ha_2), math.radians(dec_2)))
        )
        angle = math.degrees(math.acos(max(-1.0, min(1.0, float(one @ other)))))
        assert separation_deg(ha_1, dec_1, ha_2, dec_2) == pytest.approx(angle, abs=1e-5)


def test_a_mount_at_rest_from_the_start_is_calibrated_as_well() -> None:
    @dataclass
    class Resting(RampMount):
        def begin(self, t: float) -> None:
            super().begin(t)
            self.ra.go(t, 0.0)

    mount = Resting()
    ending = ended(mount).ending
    assert ending is not None
    assert ending.kind is EndKind.DONE


def test_a_mount_at_rest_whose_slewing_is_always_up_is_calibrated_as_well() -> None:
    done = run(RampMount(slewing=True), plan=SHORT)
    assert done.calibrator.ending is not None
    assert done.calibrator.ending.kind is EndKind.DONE
    assert slewing_field(done.calibrator.seen) == "meaningless"
