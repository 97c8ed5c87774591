"""The mounts in examples/profiles, each read and run, and the server that puts a mount on UDP."""

from __future__ import annotations

import itertools
import math
import socket
import time
from pathlib import Path

import pytest
from simulator_bench import PERIOD_S, SIDEREAL_DEG_S, SITE, START, T0, moving

from sattrack.core.clock import SimulatedClock
from sattrack.core.errors import BadInputError, SattrackError
from sattrack.mount.model import MountProfile, Status
from sattrack.mount.profiles import load_profile_file
from sattrack.mount.simulator.installation import Installation
from sattrack.mount.simulator.mount import SimulatedMount, Truth
from sattrack.mount.simulator.process import MOST_UNDER_WAY, SimulatorServer, UnderWay
from sattrack.mount.simulator.profile import SimulatorProfile, simulator_profile
from sattrack.mount.xerxes.datagrams import Command, decode_status, encode_command, status_readings

PROFILES = Path(__file__).parents[4] / "examples" / "profiles"
NAMES = sorted(path.name for path in PROFILES.glob("*.toml"))


def mount(name: str) -> SimulatedMount:
    described = load_profile_file(PROFILES / name)
    return SimulatedMount(described.mount, SITE, START, simulator_profile(described.simulator, name))


def flown(installation: Installation, seconds: float, **fields: object) -> list[tuple[Status, Truth]]:
    """What an installation shows to a client that sends the same all the time."""
    now = installation.next_turn_s(T0)
    seen = []
    while now < T0 + seconds:
        for _, data in installation.commands.carry(encode_command(Command(**fields))):  # type: ignore[arg-type]
            installation.receive(data)
        status, truth = installation.turn(now)
        assert status is not None
        assert truth is not None
        seen.append((decode_status(status), truth))
        now = installation.next_turn_s(now)
    return seen


def test_four_mounts_are_there() -> None:
    assert NAMES == ["edge.toml", "ideal.toml", "realistic.toml", "reversed_absolute.toml"]


@pytest.mark.parametrize("name", NAMES)
def test_each_tracks_the_sky_and_moves_as_its_file_says(name: str) -> None:
    simulated = mount(name)
    profile = simulated.profile
    seen = flown(Installation(simulated), 6.0, **moving(1.0, 0.5))
    truth = seen[-1][1]
    sign_ra, sign_dec = profile.signs(truth.beyond_pole)
    ra = sign_ra * profile.ra_rate_gain + (SIDEREAL_DEG_S if profile.additive else 0.0)
    # Ripple and noise are of real drives.
    room = 0.02 if name == "realistic.toml" else 1e-9
    assert SIDEREAL_DEG_S - truth.ra_rate_deg_s == pytest.approx(ra, abs=room)
    assert truth.dec_rate_deg_s == pytest.approx(sign_dec * 0.5 * profile.dec_rate_gain, abs=room)


def test_the_realistic_one_keeps_to_the_sky_within_a_fifth_of_an_arcsecond() -> None:
    seen = flown(Installation(mount("realistic.toml")), 60.0)
    settled = [truth for _, truth in seen if truth.utc_s > T0 + 5.0]
    spread = [
        max(values) - min(values) for values in zip(*((t.ra_deg, t.dec_deg) for t in settled), strict=True)
    ]
    assert max(spread) * 3600 < 0.2
    # And its encoders tell so to a few tics: one is 0.019 arcseconds.
    assert max(abs(status.dec_deg - truth.dec_deg) for status, truth in seen) * 3600 < 0.1
    gaps = {round((b.utc_s - a.utc_s) / 0.015625) for a, b in itertools.pairwise(settled)}
    assert gaps == {3, 4}


def test_the_edge_one_packs_doubles() -> None:
    data, _ = mount("edge.toml").tick(T0)
    readings = status_readings(data)
    assert (readings.counter, readings.ra_rate_dtics_s) == ("double", "double")


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"timer": "sundial"}, "timer"),
        ({"clock_drift_ppm": math.inf}, "clock_drift_ppm"),
        ({"servo": {"bandwidth_hz": 0.0}}, "bandwidth_hz is 0"),
        ({"command_delay_s": 9.0}, "command_delay_s is 9"),
        ({"no_such_thing": 1}, "no_such_thing"),
        ({"clock_offset_s": math.nan}, "clock_offset_s is nan"),
        ({"encoder_noise_tics": -1.0}, "encoder_noise_tics is -1"),
    ],
)
def test_a_table_that_says_what_cannot_be_is_refused_by_key(table: dict[str, object], words: str) -> None:
    with pytest.raises(BadInputError, match=words) as refusal:
        simulator_profile(table, "my.toml")
    assert str(refusal.value).startswith("my.toml, [simulator]: ")


class Served:
    """A mount behind a socket at twenty times its speed; `clients` send between its turns."""

    def __init__(self, faults: str = "", **profile: object) -> None:
        self.mount = SimulatedMount(MountProfile(**profile), SITE, START, SimulatorProfile(faults=faults))  # type: ignore[arg-type]
        clock = SimulatedClock(T0, time.monotonic(), 20.0)
        self.server = SimulatorServer(Installation(self.mount), clock, "127.0.0.1", 0, None)
        self.clients = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
        self.truths: list[Truth] = []
        for client in self.clients:
            client.bind(("127.0.0.1", 0))
            client.settimeout(60.0)

    def run(self, turns: int, *datagrams: bytes) -> None:
        end = len(self.truths) + turns
        asked = -1

        def going() -> bool:
            nonlocal asked
            if len(self.truths) != asked:
                asked = len(self.truths)
                for client, data in zip(self.clients, datagrams, strict=False):
                    client.sendto(data, ("127.0.0.1", self.server.port))
            return len(self.truths) < end

        self.server.run(going, self.truths.append, [])

    def close(self) -> None:
        self.server.close()
        for client in self.clients:
            client.close()


@pytest.fixture
def served() -> object:
    served = Served()
    yield served
    served.close()


def test_of_two_clients_the_last_datagram_wins(served: Served) -> None:
    first, second = (encode_command(Command(**moving(rate, None))) for rate in (1.0, -2.0))
    served.run(40, first, second)
    assert served.truths[-1].ra_rate_deg_s == pytest.approx(2.0, abs=1e-6)
    # Statuses go to whoever spoke last.
    assert decode_status(served.clients[1].recv(2048)).ack_move_ra


def test_garbage_from_the_network_is_counted_and_moves_nothing(served: Served) -> None:
    served.run(40, b"garbage", bytes(82))
    assert served.mount.refused >= 40
    assert served.truths[-1].ra_rate_deg_s == pytest.approx(0.0, abs=1e-9)


def test_delayed_datagrams_arrive_all_the_same() -> None:
    served = Served("delay=60ms~20ms")
    try:
        served.run(60, encode_command(Command(**moving(None, 1.0))))
        assert served.truths[-1].dec_rate_deg_s == pytest.approx(1.0)
        counters = [decode_status(served.clients[0].recv(2048)).counter for _ in range(10)]
        assert len(set(counters)) == 10
    finally:
        served.close()


def test_a_flood_of_delayed_datagrams_is_dropped() -> None:
    under_way = UnderWay()
    for number in range(2 * MOST_UNDER_WAY):
        under_way.put(float(-number), b"x", ("127.0.0.1", 1))
    assert len(under_way.take(1.0)) == MOST_UNDER_WAY
    assert under_way.next_s == math.inf


def test_a_port_in_use_is_named() -> None:
    served = Served()
    try:
        clock = SimulatedClock(T0, 0.0)
        with pytest.raises(SattrackError, match=f"port {served.server.port} on 127.0.0.1 is not available"):
            SimulatorServer(Installation(served.mount), clock, "127.0.0.1", served.server.port, None)
    finally:
        served.close()


def test_period_s_is_the_timers() -> None:
    simulated = SimulatedMount(MountProfile(period_s=0.1), SITE, START)
    installation = Installation(simulated)
    assert installation.next_turn_s(T0) == T0
    assert installation.next_turn_s(T0) == pytest.approx(T0 + 2 * PERIOD_S)
