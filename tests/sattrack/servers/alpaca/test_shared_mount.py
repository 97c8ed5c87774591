"""One mount for several protocols at once, rotctld among them; and a run that clients see and stop."""

from __future__ import annotations

import contextlib
import json
import random
import subprocess
import tempfile
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import pytest
from alpaca_serving import say, serving
from alpaca_stand import BEGIN_UTC_S, PROFILE, VirtualTelescope
from antenna_harness import SITE
from indi_programs import Indi
from msgspec.structs import replace
from programs import ended, free_port, sattrack
from serving import PATIENCE_S, WHERE, call, until
from test_alpaca_satellite import follow
from test_planetarium import Line
from test_planetarium import message as new_vector

from sattrack.cli.main import run
from sattrack.core.angles import altitude_deg
from sattrack.mount.geometry import AxisGeometry
from sattrack.mount.model import (
    SIDEREAL_RATE_DEG_S,
    MountProfile,
    MoveAxes,
    PointingTerms,
    SitePlace,
    Status,
    mean_sidereal_deg,
)
from sattrack.mount.xerxes.datagrams import encode_status
from sattrack.recording.format import COMMAND, OPERATOR, Recording
from sattrack.runtime.view_server import SUPPORTED
from sattrack.safety import SafetyLimits
from sattrack.servers.alpaca.indi import ServedIndiDevice
from sattrack.servers.alpaca.lx200 import Asked, Lx200Client
from sattrack.servers.alpaca.protocol import Answered, Fault, Number
from sattrack.servers.alpaca.run_station import RunStation
from sattrack.servers.alpaca.station import TelescopeStation
from sattrack.servers.antenna.trajectory import SiteSky
from sattrack.servers.rotctld.reader import Code
from sattrack.settings import SiteSettings

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from sattrack.servers.antenna.trajectory import AzEl

EXAMPLES = Path(__file__).parents[4] / "examples"
IN_A_PASS = "2026-10-02T13:04:00Z"
ABORT = 73
"""Where a command has its flag to stop, by the protocol's table."""
PROTOCOLS = ("alpaca", "indi", "lx200", "rotctld")


WITH_GEOMETRY = replace(
    PROFILE,
    additive=False,
    geometry=AxisGeometry(0.0, SITE.latitude_deg, reports="sky"),
    stands_at=SitePlace(SITE.latitude_deg, SITE.longitude_deg),
)
"""A mount that is led to the sky, and kept on it, by rates."""


class Shared(VirtualTelescope):
    """A telescope in virtual time with a rotator beside it."""

    def make_station(self) -> Any:
        station = super().make_station()
        self.rotator = station.share(SiteSky(SITE))
        return station

    def where(self) -> AzEl:
        place = self.rotator.where(round(self.now_utc_s * 1e9))
        assert place is not None
        return place

    def ask_and_give(self, member: str, **parameters: Any) -> None:
        """Ask, and wait for no answer."""
        order = getattr(self.ask("PUT", member, **parameters), "order", None)
        if order is not None:
            self.give(order)

    def end(self) -> None:
        """End the server, and wait until it is over."""
        self.station.end(self.now_utc_s)
        until_s = self.now_utc_s + 20.0
        while not self.station.finished:
            assert self.now_utc_s < until_s
            self.run_for(0.05)
        assert self.station.mount_stopped is True

    def point(self, az_deg: float, el_deg: float) -> Code:
        return self.rotator.point(1, az_deg, el_deg, self.now_utc_s)


def test_a_rotators_position_is_reached_kept_and_let_go_by_another_protocols_stop() -> None:
    scope = Shared()
    here = scope.where()
    assert scope.point(here.az_deg - 5.0, here.el_deg + 3.0) is Code.OK
    scope.run_for(0.3)
    assert scope.get("slewing") is True
    for member, parameters in (
        ("slewtocoordinatesasync", {"RightAscension": 3.0, "Declination": 50.0}),
        ("synctocoordinates", {"RightAscension": 3.0, "Declination": 50.0}),
        ("moveaxis", {"Axis": 0, "Rate": 0.5}),
        ("park", {}),
        ("findhome", {}),
    ):
        assert scope.fault_of(member, **parameters) is Number.INVALID_OPERATION
    scope.wait_while("slewing")
    for _ in range(2):
        there = scope.where()
        assert (there.az_deg, there.el_deg) == pytest.approx((here.az_deg - 5.0, here.el_deg + 3.0), abs=0.01)
        scope.run_for(10.0)
    scope.put("abortslew")
    scope.wait_while("slewing")
    scope.run_for(2.0)
    assert scope.get("tracking") is False
    scope.put("tracking", Tracking="True")
    assert scope.point(here.az_deg, here.el_deg) is Code.OK
    scope.run_for(0.3)
    scope.wait_while("slewing")
    assert scope.where().az_deg == pytest.approx(here.az_deg, abs=0.01)


def test_a_rotators_stop_stops_what_others_began_and_its_positions_wait_for_nobody() -> None:
    scope = Shared()
    ra_h = scope.get("rightascension")
    scope.put("slewtocoordinatesasync", RightAscension=(ra_h + 1.0) % 24.0, Declination=40.0)
    scope.run_for(1.0)
    assert scope.point(200.0, 45.0) is Code.REJECTED
    assert "the mount is slewing" in scope.rotator.log_lines[-1]
    assert scope.rotator.stop() is Code.OK
    scope.run_for(0.1)
    assert scope.station.session.wanted.__class__.__name__ == "Stop"
    scope.run_for(3.0)
    before = scope.where()
    scope.run_for(5.0)
    after = scope.where()
    assert (after.az_deg, after.el_deg) == pytest.approx((before.az_deg, before.el_deg), abs=0.01)
    assert scope.rotator.path is None


@pytest.mark.parametrize(
    "own",
    [
        {"geometry": AxisGeometry(0.0, 90.0, reports="axes")},
        {"geometry": AxisGeometry(0.0, 90.0, reports="horizon")},
        {
            "pointing": PointingTerms(
                "2026-10-01T00:00:00Z", 52.1541, {"IH": (900.0, 1.0)}, 5.0, 30, signs="tpoint"
            )
        },
    ],
)
def test_clients_of_a_run_see_where_the_tube_looks_as_those_of_a_server_do(own: dict[str, Any]) -> None:
    now_s, site = 1790946000.0, SiteSettings(SITE.latitude_deg, SITE.longitude_deg)
    place = SitePlace(SITE.latitude_deg, SITE.longitude_deg)
    profile = MountProfile(stands_at=place, additive=False, **own)
    known = SimpleNamespace(profile=profile, site=site, limits=SafetyLimits())
    run_station = RunStation(cast("Any", SimpleNamespace(satellites=known)), lambda: None)
    station = TelescopeStation(profile, SafetyLimits(), SITE, "the mount", cast("Any", None))
    status = Status(
        sidereal_h=mean_sidereal_deg(now_s, SITE.longitude_deg) / 15.0 % 24.0,
        ra_h=11.0,
        dec_deg=40.0,
        altitude_deg=40.0,
        azimuth_deg=210.0,
        counter=1,
    )
    places = []
    for one in (run_station, station):
        one.receive(encode_status(status), now_s)
        state = one.state(now_s)
        places.append((state.ra_h, state.dec_deg, state.altitude_deg, state.azimuth_deg))
    assert places[0] == places[1]
    assert places[0][:2] != (status.ra_h, status.dec_deg)


@pytest.mark.parametrize("resumes", ["stops itself", "is silent"])
def test_alpacas_stop_holds_for_a_program_whose_positions_were_refused_before(resumes: str) -> None:
    scope = Shared()
    here = scope.where()
    ra_h = scope.get("rightascension")
    scope.put("slewtocoordinatesasync", RightAscension=(ra_h + 1.0) % 24.0, Declination=40.0)
    scope.run_for(1.0)
    assert scope.point(here.az_deg, here.el_deg) is Code.REJECTED
    scope.put("abortslew")
    for _ in range(12):
        scope.run_for(1.0)
        assert scope.point(here.az_deg, here.el_deg) is Code.REJECTED
    assert "the mount was stopped" in scope.rotator.log_lines[-1]
    assert scope.station.session.wanted.__class__.__name__ != "MoveAxes"
    if resumes == "stops itself":
        assert scope.rotator.stop(1) is Code.OK
        scope.run_for(3.0)
    else:
        scope.run_for(10.5)
    assert scope.point(here.az_deg, here.el_deg) is Code.OK
    scope.run_for(0.3)
    assert isinstance(scope.station.session.wanted, MoveAxes)


def test_alpacas_stop_holds_for_a_program_whose_satellite_rises_later() -> None:
    """What it sends from below the horizon is no position, but it is no silence either."""
    scope = Shared()
    here = scope.where()
    assert scope.point(here.az_deg, -5.0) is Code.INVALID
    scope.put("abortslew")
    for _ in range(12):
        scope.run_for(1.0)
        assert scope.point(here.az_deg, -5.0) is Code.INVALID
    assert scope.point(here.az_deg, here.el_deg) is Code.REJECTED
    assert "the mount was stopped" in scope.rotator.log_lines[-1]


def test_the_end_of_the_server_stops_what_a_rotator_began() -> None:
    scope = Shared()
    here = scope.where()
    scope.point(here.az_deg - 60.0, here.el_deg)
    scope.run_for(2.0)
    assert isinstance(scope.station.session.wanted, MoveAxes)
    scope.end()


@pytest.mark.parametrize("profile", [PROFILE, WITH_GEOMETRY])
def test_a_satellite_is_kept_from_a_rotators_positions(profile: MountProfile) -> None:
    scope = Shared(begin_utc_s=BEGIN_UTC_S + 130.0, profile=profile)
    place = scope.where()
    scope.put("slewtocoordinatesasync", RightAscension=scope.get("rightascension"), Declination=55.0)
    scope.wait_while("slewing")
    follow(scope, 10.0)
    assert scope.point(place.az_deg, place.el_deg) is Code.REJECTED
    assert "the mount is following" in scope.rotator.log_lines[-1]
    scope.run_for(1.0)
    scope.end()


@pytest.mark.parametrize("profile", [PROFILE, WITH_GEOMETRY])
@pytest.mark.parametrize(
    ("member", "parameters", "before"),
    [
        ("tracking", {"Tracking": "True"}, "abortslew"),
        ("findhome", {}, None),
        ("park", {}, None),
        ("slewtocoordinates", {"RightAscension": 3.0, "Declination": 50.0}, None),
    ],
)
def test_a_rotators_position_waits_for_the_end_of_what_others_began(
    profile: MountProfile, member: str, parameters: dict[str, Any], before: str | None
) -> None:
    """What was asked of the mount may be over before its end is seen: the order is answered first."""
    scope = Shared(profile=profile)
    if before is not None:
        scope.ask_and_give(before)
        scope.run_for(5.0)
    if "RightAscension" in parameters:
        parameters = {**parameters, "RightAscension": scope.get("rightascension")}
    asked: Any = scope.ask("PUT", member, **parameters)
    number, place = scope.give(asked.order, asked.waits), scope.where()
    while scope.station.console.procedure is not None:
        assert scope.point(place.az_deg + 20.0, 45.0) is Code.REJECTED
        scope.run_for(0.01)
    scope.run_for(1.0)
    # Home is not asked of a mount that rates lead.
    refused = member == "findhome" and profile.geometry is not None
    assert scope.answered(number) == Answered(number) or refused
    assert scope.get("atpark") is (member == "park")
    assert (scope.point(place.az_deg + 20.0, 45.0) is Code.OK) is (member != "park")


@pytest.mark.parametrize("driver", ["engine", "path", "console"])
@pytest.mark.parametrize("ready", ["alpaca", "rotctld", "at once"])
def test_what_safety_has_stopped_stays_until_somebody_makes_it_ready(driver: str, ready: str) -> None:
    """Whatever moved the mount, and whoever goes on to send positions."""
    scope = Shared(begin_utc_s=BEGIN_UTC_S + 130.0)
    place = scope.where()
    if driver == "engine":
        follow(scope, 25.0)
        assert scope.point(place.az_deg, place.el_deg) is Code.REJECTED
    elif driver == "path":
        assert scope.rotator.point(2, place.az_deg + 30.0, place.el_deg, scope.now_utc_s) is Code.OK
        scope.run_for(3.0)
    else:
        scope.ask_and_give("moveaxis", Axis=1, Rate=0.5)
        scope.run_for(3.0)
    scope.station.safety.tripped = "obedience"
    if ready == "at once":
        scope.run_for(0.1)
        scope.ask_and_give("abortslew")
    for _ in range(10):
        scope.run_for(0.5)
        if ready != "at once":
            assert scope.point(place.az_deg, place.el_deg) is Code.REJECTED
    if driver == "path":
        # A stop alone, such as programs send at the end of a track, makes nothing ready.
        scope.rotator.stop(2)
        scope.run_for(3.0)
    if ready != "at once":
        assert scope.station.tripped == "obedience"
        assert scope.fault_of("moveaxis", Axis=1, Rate=0.2) is Number.INVALID_OPERATION
        scope.ask_and_give("abortslew") if ready == "alpaca" else scope.rotator.reset(2)
        scope.run_for(4.0)
    assert scope.station.tripped is None
    scope.ask_and_give("moveaxis", Axis=1, Rate=0.2)
    scope.run_for(2.0)
    assert scope.truths[-1].dec_rate_deg_s == pytest.approx(0.2, abs=0.01)


@pytest.mark.parametrize("trouble", ["silence", "restart"])
def test_a_stop_that_nobody_asked_for_holds_for_a_program_that_goes_on(trouble: str) -> None:
    scope = Shared()
    place = scope.where()
    scope.ask_and_give("moveaxis", Axis=1, Rate=0.5)
    scope.run_for(1.0)
    assert scope.point(place.az_deg, place.el_deg) is Code.REJECTED
    if trouble == "silence":
        scope.silent_until_s = scope.now_utc_s + 5.0
    else:
        scope._wires.mount.restart(scope.now_utc_s)
    for _ in range(20):
        scope.run_for(1.0)
        assert scope.point(place.az_deg, place.el_deg) is not Code.OK
    assert scope.station._failure is not None


@pytest.mark.parametrize("profile", [PROFILE, WITH_GEOMETRY])
def test_a_mount_that_restarts_on_its_way_to_a_position_is_stopped_until_reset(profile: MountProfile) -> None:
    scope = Shared(profile=profile)
    place = scope.where()
    scope.point(place.az_deg - 60.0, place.el_deg)
    scope.run_for(2.0)
    scope._wires.mount.restart(scope.now_utc_s)
    scope.run_for(4.0)
    assert scope.station.tripped == "restart"
    stood = scope.where()
    assert scope.point(place.az_deg - 60.0, place.el_deg) is Code.REJECTED
    scope.run_for(10.0)
    assert scope.where().az_deg == pytest.approx(stood.az_deg, abs=0.2)
    scope.rotator.reset(1)
    scope.run_for(4.0)
    assert scope.station.tripped is None
    assert scope.point(place.az_deg - 60.0, place.el_deg) is Code.OK


def test_no_position_is_taken_while_the_server_ends() -> None:
    scope = Shared()
    place = scope.where()
    scope.point(place.az_deg - 60.0, place.el_deg)
    scope.run_for(2.0)
    scope.station.end(scope.now_utc_s)
    scope.run_for(0.1)
    assert scope.point(place.az_deg, place.el_deg) is Code.REJECTED
    assert "the server is ending" in scope.rotator.log_lines[-1]
    scope.end()
    assert scope.where().az_deg != pytest.approx(place.az_deg, abs=1.0)


def test_a_mount_at_a_rotators_position_does_not_track() -> None:
    scope = Shared()
    place = scope.where()
    scope.point(place.az_deg - 3.0, place.el_deg)
    scope.run_for(0.3)
    scope.wait_while("slewing")
    assert scope.get("tracking") is False


class Fight(Shared):
    """A mount with clients of Alpaca, LX200, INDI and rotctld that command at random, and its judge.

    The judge sees the true axes and the datagrams, and not what the program believes.
    """

    def __post_init__(self) -> None:
        self.sent: list[bytes] = []
        super().__post_init__()
        self.lx200 = Lx200Client(self.telescope, -1)
        self.indi = ServedIndiDevice(self.telescope, -2)
        self.indi.take(new_vector("Switch", "CONNECTION", CONNECT="On"), 1, self.now_utc_s)

    def make_station(self) -> Any:
        station = super().make_station()
        tick = station.tick

        def noted(now_utc_s: float) -> bytes:
            datagram: bytes = tick(now_utc_s)
            self.sent.append(datagram)
            return datagram

        station.tick = noted
        return station

    def carry_out(self, asked: object) -> None:
        """Give the orders of a client that is no Alpaca's, as their server does."""
        for order in asked.orders if isinstance(asked, Asked) else ():
            self.give(order)

    def say(self, command: str) -> None:
        """Say something in LX200's words; a refusal is no matter."""
        with contextlib.suppress(Fault):
            self.carry_out(self.lx200.answer(command, self.now_utc_s))

    def set_indi(self, kind: str, name: str, **values: str) -> None:
        """Set a property of INDI's."""
        with contextlib.suppress(Fault):
            self.carry_out(self.indi.take(new_vector(kind, name, **values), 1, self.now_utc_s))

    def command(self, chance: random.Random) -> bool:
        """Have one client command something; return whether it was a stop."""
        ra_h = (self.get("siderealtime") + chance.uniform(-2.0, 2.0)) % 24.0
        dec_deg = chance.uniform(0.0, 70.0)
        stops: list[Callable[[], object]] = [
            lambda: self.ask_and_give("abortslew"),
            self.rotator.stop,
            lambda: self.say("Q"),
            lambda: self.set_indi("Switch", "TELESCOPE_ABORT_MOTION", ABORT="On"),
        ]
        others: list[Callable[[], object]] = [
            lambda: self.point(chance.uniform(100.0, 260.0), chance.uniform(20.0, 80.0)),
            lambda: self.rotator.move(1, chance.choice(("up", "down", "left", "right")), 50, self.now_utc_s),
            lambda: self.ask_and_give("slewtocoordinatesasync", RightAscension=ra_h, Declination=dec_deg),
            lambda: self.ask_and_give(
                "moveaxis", Axis=chance.randrange(2), Rate=chance.choice((0.0, 0.2, -0.5))
            ),
            lambda: [
                self.say(one)
                for one in (
                    f"Sr{int(ra_h):02d}:{int(ra_h * 60) % 60:02d}:00",
                    f"Sd+{int(dec_deg):02d}*00",
                    "MS",
                )
            ],
            lambda: [self.say(one) for one in (chance.choice(("RC", "RM")), "M" + chance.choice("nsew"))],
            lambda: self.say("Q" + chance.choice("nsew")),
            lambda: self.say(chance.choice(("Te", "Td", "Mgn0300", "hF"))),
            lambda: self.set_indi("Number", "EQUATORIAL_EOD_COORD", RA=f"{ra_h}", DEC=f"{dec_deg}"),
            lambda: self.set_indi("Switch", "TELESCOPE_MOTION_NS", MOTION_SOUTH=chance.choice(("On", "Off"))),
        ]
        stopped = chance.random() < 0.25
        chance.choice(stops if stopped else others)()
        return stopped

    def judge_stop(self) -> None:
        """Have a stop take effect: in two datagrams, and at rest some seconds after.

        One of LX200's ends the keys' motion alone, where nothing else moves.
        """
        before = len(self.sent)
        self.run_for(0.11)
        drive = self.station._drive
        ended = drive is not None and not drive.moves
        assert ended or 0xFF in {data[ABORT] for data in self.sent[before : before + 2]} or self.rests()
        self.run_for(4.0)
        assert self.rests(), self.truths[-1]

    def rests(self) -> bool:
        """Whether the true axes stand, or follow the sky."""
        ra_deg_s, dec_deg_s = self.truths[-1].ra_rate_deg_s, self.truths[-1].dec_rate_deg_s
        return min(abs(ra_deg_s), abs(ra_deg_s - SIDEREAL_RATE_DEG_S)) < 1e-3 and abs(dec_deg_s) < 1e-3


def fight(seed: int, seconds: float, profile: MountProfile = PROFILE) -> None:
    """Have four protocols' clients command at random; the mount has one owner, and stops when told to."""
    chance, scope = random.Random(seed), Fight(profile=profile)
    ends_s = scope.now_utc_s + seconds
    while scope.now_utc_s < ends_s:
        seen = len(scope.truths)
        if scope.command(chance) and chance.random() < 0.5:
            scope.judge_stop()
        scope.run_for(chance.uniform(0.05, 4.0))
        both = scope.station.engine is not None and scope.station.shared.driver is not None
        assert not both
        if scope.station.shared.driver is not None:
            assert scope.station.console.procedure is None, "two own the motion"
        assert scope.station.tripped is None, scope.station.tripped
        for truth in scope.truths[seen:]:
            height_deg = altitude_deg(truth.hour_angle_axis_deg, truth.dec_axis_deg, SITE.latitude_deg)
            assert height_deg > scope.limits.floor_altitude_deg - 0.1, truth
        del scope.truths[:-1], scope.sent[:]


@pytest.mark.parametrize("profile", [PROFILE, WITH_GEOMETRY])
def test_clients_that_fight_leave_the_mount_with_one_owner(profile: MountProfile) -> None:
    fight(1, 40.0, profile)


@pytest.mark.parametrize("others_stop", [False, True])
def test_lx200s_stop_stops_what_another_client_turns(others_stop: bool) -> None:
    """Also where the key that it held had been stopped by somebody before."""
    scope = Fight()
    for command in ("RM", "Mw"):
        scope.say(command)
    scope.run_for(1.5)
    if others_stop:
        scope.ask_and_give("abortslew")
        scope.run_for(6.0)
    scope.ask_and_give("moveaxis", Axis=1, Rate=0.5)
    scope.run_for(1.5)
    assert scope.get("slewing") is True
    scope.say("Q")
    scope.run_for(5.0)
    assert scope.rests()


def test_a_key_of_lx200_that_another_client_stopped_sets_nothing_going_when_it_is_let_go() -> None:
    scope = Fight()
    for command in ("RM", "Mw"):
        scope.say(command)
    scope.run_for(1.5)
    scope.ask_and_give("abortslew")
    scope.run_for(4.0)
    assert scope.get("tracking") is False
    scope.say("Qw")
    scope.run_for(4.0)
    assert scope.get("tracking") is False
    scope.say("Mw")
    scope.run_for(0.2)
    scope.say("Qw")
    scope.run_for(4.0)
    assert scope.get("tracking") is True


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(24))
def test_clients_that_fight_for_a_day_leave_the_mount_with_one_owner(seed: int) -> None:
    fight(100 + seed, 3600.0)


@pytest.mark.needs("rotctl")
def test_hamlibs_client_and_alpacas_take_turns_with_one_mount() -> None:
    port = free_port()
    with serving(f"rotctld:{port}") as served, call(served.port) as line:
        say(line, "PUT", "connect")
        az_deg, el_deg = (float(word) for word in rotctl(port, "p").split())
        assert rotctl(port, "P", f"{az_deg - 3.0:.2f}", f"{el_deg:.2f}") == ""
        until(lambda: say(line, "GET", "slewing")["Value"] is True)
        refused = say(line, "PUT", "moveaxis", "Axis=0&Rate=1")
        assert refused["ErrorNumber"] == Number.INVALID_OPERATION
        assert "kept at positions of rotctld's clients" in str(refused["ErrorMessage"])
        until(lambda: say(line, "GET", "slewing")["Value"] is False)
        assert float(rotctl(port, "p").split()[0]) == pytest.approx(az_deg - 3.0, abs=0.011)
        say(line, "PUT", "abortslew")
        until(lambda: say(line, "GET", "slewing")["Value"] is False)
        until(lambda: say(line, "PUT", "moveaxis", "Axis=1&Rate=0.2")["ErrorNumber"] == 0)
        assert "rejected" in rotctl(port, "P", f"{az_deg:.2f}", f"{el_deg:.2f}")
        assert rotctl(port, "S") == ""
        until(lambda: say(line, "GET", "slewing")["Value"] is False)


def rotctl(port: int, *words: str) -> str:
    command = ["rotctl", "-m", "2", "-r", f"127.0.0.1:{port}", *words]
    done = subprocess.run(command, capture_output=True, timeout=PATIENCE_S, check=False)
    return done.stdout.decode()


@dataclass
class ServedRun:
    """A run of `track` that is served: its process, its recording, and the port of each protocol."""

    process: subprocess.Popen[str]
    record: Path
    ports: dict[str, int]

    def summary(self) -> dict[str, Any]:
        out, _ = self.process.communicate(timeout=PATIENCE_S)
        told: dict[str, Any] = json.loads(out)["summary"]
        return told


@contextmanager
def served_run(*protocols: str) -> Iterator[ServedRun]:
    with tempfile.TemporaryDirectory() as folder:
        settings, record = Path(folder) / "radio.toml", Path(folder) / "run.mcap"
        settings.write_text("[safety]\noptical = false\n")
        ports = {one: free_port() for one in protocols}
        options = [word for one, port in ports.items() for word in ("--serve", f"{one}:{port}")]
        process = sattrack(
            *("track", "25544", "--elements", str(EXAMPLES / "iss_leiden.tle"), "--mount", "sim"),
            *("--site", WHERE, "--clock", IN_A_PASS, "--config", str(settings), "--headless", "--json"),
            *("--record", str(record), *options),
        )
        with ended(process):
            assert process.stderr is not None
            for _ in protocols:
                said = []
                assert any(said.append(line) or "clients see the run" in line for line in process.stderr), (
                    said
                )
            try:
                yield ServedRun(process, record, ports)
            except OSError as error:
                raise AssertionError(process.communicate(timeout=PATIENCE_S)) from error


pytestmark = pytest.mark.skipif(not SUPPORTED, reason="abstract names are Linux's")


@pytest.mark.needs("rotctl", "indi_getprop")
def test_clients_see_a_run_may_not_move_its_mount_and_may_stop_it(program: Callable[[str], str]) -> None:
    with served_run(*PROTOCOLS) as seen, call(seen.ports["alpaca"]) as line:
        until(lambda: say(line, "PUT", "connect")["ErrorNumber"] == 0)
        until(lambda: say(line, "GET", "slewing").get("Value") is False)
        assert say(line, "GET", "tracking")["Value"] is True
        state = json.loads(str(say(line, "PUT", "action", "Action=Bias&Parameters=")["Value"]))
        assert (state["catalog_number"], state["phase"], state["acquired"]) == (25544, "tracking", True)
        indi = Indi(seen.ports["indi"], "sattrack", program)
        indi.set("CONNECTION.CONNECT=On")
        indi.until("SAT_TRACKING_STAT.SAT_TRACK", lambda value: value == "On")
        with Line(seen.ports["lx200"]) as lx200:
            places = [say(line, "GET", one)["Value"] for one in ("altitude", "azimuth")]
            az_deg, el_deg = (float(word) for word in rotctl(seen.ports["rotctld"], "p").split())
            assert (el_deg, az_deg) == pytest.approx(places, abs=1.5)
            assert lx200.ask(":D#") == b"#"
            moves = {
                "slewtocoordinatesasync": "RightAscension=3&Declination=40",
                "synctocoordinates": "RightAscension=3&Declination=40",
                "moveaxis": "Axis=0&Rate=1",
                "tracking": "Tracking=False",
                "pulseguide": "Direction=0&Duration=500",
                "action": 'Action=Bias&Parameters={"along_s": 1}',
            }
            for member, parameters in moves.items():
                refused = say(line, "PUT", member, parameters)
                assert refused["ErrorNumber"] == Number.INVALID_OPERATION, member
                assert "the mount is following ISS (ZARYA) (sattrack track)" in str(refused["ErrorMessage"])
            assert lx200.ask(":Sr03:00:00#", b"1") == b"1"
            assert lx200.ask(":Sd+40*00:00#", b"1") == b"1"
            assert lx200.ask(":MS#", b"1") == b"1"
            assert b"not synchronised: the mount is following" in lx200.ask(":CM#")
            lx200.send(b":Mn#:hP#:Mgn0500#")
        for text in ("EQUATORIAL_EOD_COORD.RA=3;DEC=40", "TELESCOPE_MOTION_NS.MOTION_NORTH=On"):
            indi.set(text)
        indi.until("EQUATORIAL_EOD_COORD._STATE", lambda value: value == "Alert")
        indi.until("TELESCOPE_MOTION_NS._STATE", lambda value: value != "Busy")
        assert "rejected" in rotctl(seen.ports["rotctld"], "P", "100", "40")
        say(line, "PUT", "abortslew")
        summary = seen.summary()
        assert summary["ended_by"] == "operator"
        assert summary["mount_stopped"] is True
        assert summary["reported_peak_arcsec"] < 30.0
        said = [entry.data for entry in Recording(seen.record).entries() if entry.topic == OPERATOR]
        assert {json.loads(data)["type"] for data in said} == {"stop"}
        entries = list(Recording(seen.record).entries())
        first = next(n for n, entry in enumerate(entries) if entry.topic == OPERATOR)
        after = [entry.data for entry in entries[first:] if entry.topic == COMMAND]
        assert 0xFF in {datagram[ABORT] for datagram in after[:2]}, "a stop takes effect within two datagrams"


@pytest.mark.needs("rotctl", "indi_setprop")
@pytest.mark.parametrize(
    "protocol", [*(pytest.param(one, marks=pytest.mark.soak) for one in ("indi", "lx200")), "rotctld"]
)
def test_a_stop_of_each_protocol_ends_the_run(protocol: str, program: Callable[[str], str]) -> None:
    with served_run("alpaca", protocol) as seen, call(seen.ports["alpaca"]) as line:
        until(lambda: say(line, "PUT", "connect")["ErrorNumber"] == 0)
        until(lambda: say(line, "GET", "slewing").get("Value") is False)
        port = seen.ports[protocol]
        if protocol == "indi":
            Indi(port, "sattrack", program).set("TELESCOPE_ABORT_MOTION.ABORT=On")
        elif protocol == "lx200":
            with Line(port) as lx200:
                lx200.send(b":Q#")
        else:
            assert rotctl(port, "S") == ""
        summary = seen.summary()
        assert (summary["ended_by"], summary["mount_stopped"]) == ("operator", True)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--serve", "web"], "web: --serve takes alpaca or indi or lx200 or rotctld or stellarium"),
        (["--serve", "alpaca:x"], "alpaca:x: write alpaca, or alpaca:PORT"),
        (["--serve", "alpaca", "--serve", "alpaca"], "alpaca: --serve takes indi or lx200"),
        (["--serve", "alpaca", "--virtual"], "--serve needs real time"),
        (["--serve", "alpaca", "--serve-allow", "nowhere"], "--allow nowhere"),
    ],
)
def test_what_cannot_be_served_is_named(
    options: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    elements = str(EXAMPLES / "iss_leiden.tle")
    fixed = ["--elements", elements, "--mount", "sim", "--site", WHERE, "--clock", IN_A_PASS, "--headless"]
    assert run(["track", "25544", *fixed, *options]) == 2
    assert words in capsys.readouterr().err
