"""What is answered, byte for byte as Hamlib's rotctld was heard to answer; and where it is not."""

from __future__ import annotations

import math

import pytest
from hamlib_exchanges import EXCHANGES
from rotctld_setup import NOON_NS, StandsStill, ask, make_rotator

from sattrack.servers.antenna.protocol import NS
from sattrack.servers.antenna.trajectory import AxisState
from sattrack.servers.rotctld.answers import Client

P_OF_STANDING = b"0.00\n0.00\n"


@pytest.mark.parametrize(("sent", "answered"), EXCHANGES)
def test_whatever_was_heard_of_hamlibs_own_is_answered_to_the_byte(sent: bytes, answered: bytes) -> None:
    assert ask(Client(1, make_rotator()), sent) == answered


def test_bytes_that_come_one_by_one_are_answered_like_those_that_come_at_once() -> None:
    for sent, answered in EXCHANGES:
        client = Client(1, make_rotator())
        assert b"".join(ask(client, bytes([byte])) for byte in sent) == answered, sent


def test_everything_in_one_packet_is_answered_in_order() -> None:
    # An x is a command that takes the next word, wherever that is.
    whole = [(sent, answered) for sent, answered in EXCHANGES if sent[-1:] == b"\n" and b"x" not in sent]
    whole = [(sent, answered) for sent, answered in whole if answered and not sent.startswith(b"w")]
    told = ask(Client(1, make_rotator()), b"".join(sent for sent, _ in whole))
    assert told == b"".join(answered for _, answered in whole)


@pytest.mark.parametrize("sent", [b"q\n", b"Q\n", b"p\nq\n", b"+q\n"])
def test_a_client_that_quits_is_hung_up_on_without_a_word(sent: bytes) -> None:
    client = Client(1, make_rotator())
    assert ask(client, sent + b"p\n").count(b"\n") == 2 * sent.count(b"p")
    assert client.left


def test_the_state_is_told_as_hamlibs_clients_read_it() -> None:
    """Hamlib 4.5.4 `rotctld -m 1`, but for the limits; `+` as it labels them."""
    assert ask(Client(1, make_rotator()), b"\\dump_state\n") == (
        b"1\n1\nmin_az=-180.000000\nmax_az=450.000000\nmin_el=0.000000\nmax_el=180.000000\n"
        b"south_zero=0\nrot_type=AzEl\ndone\n"
    )
    assert ask(Client(1, make_rotator()), b"|\\dump_state\n") == (
        b"dump_state:|rotctld Protocol Ver: 1|Rotor Model: 1|Minimum Azimuth: -180.000000|"
        b"Maximum Azimuth: 450.000000|Minimum Elevation: 0.000000|Maximum Elevation: 180.000000|"
        b"South Zero: 0|rot_type=AzEl|done|RPRT 0\n"
    )
    assert ask(Client(1, make_rotator()), b"\x8f") == ask(Client(1, make_rotator()), b"\\dump_state\n")


def test_what_the_mount_can_do_is_told_at_length_and_ends_with_a_report() -> None:
    told = ask(Client(1, make_rotator(), "sattrack 1: mine"), b"1\n")
    assert told.startswith(b"Caps dump for model:\t1\nModel name:\t\tsattrack 1: mine\n")
    assert told.endswith(b"\nRPRT 0\n")
    assert b"Can Park:\t\tY\n" in told


def test_help_names_every_command_as_hamlib_does() -> None:
    """`??` of Hamlib 4.5.4: the first mark asks for an extended response, the second for help."""
    told = ask(Client(1, make_rotator()), b"??\n")
    assert told.startswith(
        b"Commands (some may not be available for this rotator):\n"
        b"P: set_pos     (Azimuth, Elevation)\np: get_pos     ()\nK: park        ()\nS: stop        ()\n"
        b"R: reset       (Reset)\nM: move        (Direction, Speed)\nV: set_level   (Level, Level Value)\n"
    )
    assert b"\nL: lonlat2loc  (Longitude, Latitude, Loc Len [2-12])\n" in told
    assert b"\n?: pause       (Seconds)\n\n\nIn interactive mode prefix" in told


@pytest.mark.parametrize(
    ("sent", "answered"),
    [
        # Hamlib's takes a position that is no number, and any text for a limit; neither moves a telescope.
        (b"P nan 10\n", b"RPRT -1\n"),
        (b"P 10 nan\n", b"RPRT -1\n"),
        (b"C max_az x\n", b"RPRT -1\n"),
        # Azimuths are counted from north here, whatever is wished.
        (b"C south_zero 1\n", b"RPRT -1\n"),
        (b"L nan 2 4\n", b"RPRT -1\n"),
        # What Hamlib's overruns its arrays with.
        (b"P " + b"1" * 128 + b" 5\np\n", b"RPRT -1\n" + P_OF_STANDING),
        (b"w " + b"x" * 400 + b"\np\n", b"RPRT -1\n" + P_OF_STANDING),
        (b"P 1 " + b" " * 2000 + b"2\np\n", b"RPRT -1\n" + P_OF_STANDING),
    ],
)
def test_where_hamlibs_own_is_not_followed(sent: bytes, answered: bytes) -> None:
    rotator = make_rotator()
    assert ask(Client(1, rotator), sent) == answered
    assert rotator.path is None


def test_levels_are_told_and_kept_for_all_clients() -> None:
    rotator = make_rotator()
    assert ask(Client(1, rotator), b"V SPEED 3\n") == b"RPRT 0\n"
    assert ask(Client(2, rotator), b"v SPEED\nv ?\nV ?\n") == b"3\nSPEED \nSPEED \nRPRT 0\n"


def test_limits_that_a_client_sets_are_kept_to_and_never_widened() -> None:
    rotator = make_rotator()
    client = Client(1, rotator)
    assert ask(client, b"C min_el 10\nC max_az 9999\nP 0 9.9\nP 0 10\n") == (
        b"RPRT 0\nRPRT 0\nRPRT -1\nRPRT 0\n"
    )
    assert b"min_el=10.000000\n" in ask(client, b"\\dump_state\n")
    assert b"max_az=450.000000\n" in ask(client, b"\\dump_state\n")


def test_a_pause_holds_up_the_client_that_asked_for_it_and_no_other() -> None:
    rotator = make_rotator()
    sleepy, other = Client(1, rotator), Client(2, rotator)
    assert ask(sleepy, b"\\pause 2\np\n") == b""
    assert ask(other, b"p\n", at_s=1.0) == P_OF_STANDING
    assert ask(sleepy, b"", at_s=1.9) == b""
    assert ask(sleepy, b"", at_s=2.0) == b"RPRT 0\n" + P_OF_STANDING


class Unheard(StandsStill):
    link_up = False

    def actual(self, utc_ns: int) -> None:
        return None


class Tripped(StandsStill):
    tripped = "sun"


def test_a_mount_that_is_not_heard_is_an_input_output_error() -> None:
    client = Client(1, make_rotator(Unheard()))
    assert ask(client, b"p\ns\nP 1 2\nM 2 5\nK\n") == b"RPRT -6\n" * 5
    assert ask(client, b"+p\nS\n") == b"get_pos:\nRPRT -6\nRPRT 0\n"


def test_a_mount_that_safety_has_stopped_rejects_all_but_stop_and_reset() -> None:
    rotator = make_rotator(Tripped())
    assert ask(Client(1, rotator), b"P 1 2\nM 2 5\nK\nS\nR 1\np\n") == (
        b"RPRT -9\n" * 3 + b"RPRT 0\n" * 2 + P_OF_STANDING
    )
    assert rotator.reset_asked


def test_a_profile_without_a_park_position_has_no_park() -> None:
    rotator = make_rotator()
    rotator.park = None
    assert ask(Client(1, rotator), b"K\n") == b"RPRT -11\n"


class PointsWest(StandsStill):
    def actual(self, utc_ns: int) -> AxisState:
        return AxisState(270.0, 30.0, -0.5, 0.25)


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        (b"", b"270.00\n30.00\n"),
        (b"P 265 30\n", b"270.00\n30.00\n"),
        (b"P -95 30\n", b"-90.00\n30.00\n"),
        (b"P -170 30\n", b"-90.00\n30.00\n"),
        (b"P 440 30\n", b"270.00\n30.00\n"),
        (b"P 90 150\n", b"90.00\n150.00\n"),
        (b"P 449 150\n", b"450.00\n150.00\n"),
    ],
)
def test_azimuths_are_told_on_the_turn_they_were_asked_for_on(asked: bytes, told: bytes) -> None:
    client = Client(1, make_rotator(PointsWest()))
    ask(client, asked)
    assert ask(client, b"p\n") == told


def test_what_the_mount_does_is_told_in_hamlibs_words() -> None:
    client = Client(1, make_rotator(PointsWest()))
    assert ask(client, b"s\n") == b"MOVING MOVING_AZ MOVING_LEFT MOVING_EL MOVING_UP \n"


def test_a_move_goes_its_way_for_ten_seconds_and_not_past_the_horizon_or_the_zenith() -> None:
    rotator = make_rotator(PointsWest())
    client = Client(1, rotator)
    expected = {b"M 8 50\n": (260.0, 30.0), b"M CW 100\n": (290.0, 30.0), b"M DOWN 100\n": (270.0, 10.0)}
    for sent, there in expected.items():
        assert ask(client, sent) == b"RPRT 0\n"
        for seconds in (10.0, 60.0):
            state = rotator.commanded(NOON_NS + round(seconds * NS))
            assert state is not None
            assert state[:2] == pytest.approx(there)
            assert state[2:] == (0.0, 0.0)
    for sent, end_deg in ((b"M 4 100\n", 10.0), (b"M 2 1000000\n", 50.0)):
        ask(client, sent)
        state = rotator.commanded(NOON_NS + 3600 * NS)
        assert state is not None
        assert state.second_deg == pytest.approx(end_deg)


def test_a_speed_below_zero_is_that_of_the_level() -> None:
    rotator = make_rotator(PointsWest())
    client = Client(1, rotator)
    for level, rate in ((b"1", 0.5), (b"4", 2.0), (b"9", 2.0), (b"-7", 0.5)):
        ask(client, b"V SPEED " + level + b"\nM 16 -1\n")
        state = rotator.commanded(NOON_NS + NS)
        assert state is not None
        assert state.first_rate_deg_s == pytest.approx(rate)


def test_every_client_may_command_and_the_last_one_is_obeyed() -> None:
    rotator = make_rotator()
    first, second = Client(1, rotator), Client(2, rotator)
    assert ask(first, b"P 10 20\n") == b"RPRT 0\n"
    assert ask(second, b"P 30 40\n", at_s=1.0) == b"RPRT 0\n"
    state = rotator.commanded(NOON_NS + NS)
    assert state is not None
    assert state[:2] == pytest.approx((30.0, 40.0))
    assert rotator.commander == 2


def test_steps_of_two_clients_are_no_track() -> None:
    rotator = make_rotator()
    clients = (Client(1, rotator), Client(2, rotator))
    for second in range(12):
        ask(clients[second % 2], f"P {100 + second} 40\n".encode(), at_s=second)
        state = rotator.commanded(NOON_NS + second * NS + NS // 2)
        assert state is not None
        assert state[:2] == pytest.approx((100.0 + second, 40.0))


def test_where_one_commands_the_others_wait_until_it_is_silent_or_gone_or_stops() -> None:
    rotator = make_rotator(one_at_a_time=True)
    first, second = Client(1, rotator), Client(2, rotator)
    assert ask(first, b"P 10 20\n") == b"RPRT 0\n"
    assert ask(second, b"P 30 40\nM 2 5\nK\np\n", at_s=5.0) == b"RPRT -9\n" * 3 + P_OF_STANDING
    assert ask(first, b"p\n", at_s=9.0) == P_OF_STANDING
    assert ask(second, b"P 30 40\n", at_s=18.0) == b"RPRT -9\n"
    assert ask(second, b"P 30 40\n", at_s=20.0) == b"RPRT 0\n"
    assert ask(first, b"P 10 20\n", at_s=21.0) == b"RPRT -9\n"
    assert ask(first, b"S\nP 10 20\n", at_s=22.0) == b"RPRT 0\n" * 2
    assert ask(second, b"P 30 40\n", at_s=23.0) == b"RPRT -9\n"
    rotator.hang_up(1)
    assert ask(second, b"P 30 40\n", at_s=23.0) == b"RPRT 0\n"


def test_a_program_that_goes_on_sending_positions_does_not_undo_the_stop_of_another() -> None:
    rotator = make_rotator()
    program, person = Client(1, rotator), Client(2, rotator)
    assert ask(program, b"P 10 20\n") == b"RPRT 0\n"
    assert ask(person, b"S\n", at_s=0.5) == b"RPRT 0\n"
    for second in range(1, 30):
        assert ask(program, b"P 10 20\n", at_s=float(second)) == b"RPRT -9\n"
    assert rotator.path is None
    assert ask(program, b"P 10 20\n", at_s=40.0) == b"RPRT 0\n"
    rotator.stop()
    assert ask(program, b"P 10 20\n", at_s=41.0) == b"RPRT -9\n"
    assert ask(program, b"S\nP 10 20\n", at_s=42.0) == b"RPRT 0\n" * 2
    rotator.stop()
    assert ask(Client(3, rotator), b"P 10 20\n", at_s=43.0) == b"RPRT 0\n"


def test_a_client_that_asks_for_many_things_waits_its_turn() -> None:
    client = Client(1, make_rotator())
    client.receive(b"p\n" * 10)
    answers, count = client.answer(NOON_NS, 4)
    assert (answers, count) == (P_OF_STANDING * 4, 4)
    total = 4
    while (more := client.answer(NOON_NS, 4))[1]:
        total += more[0].count(b"\n") // 2
    assert total == 10


def test_the_park_position_is_an_hour_angle_and_a_declination() -> None:
    """On the meridian, zenith distance is latitude less declination: 60° is 7.85° north of 52.15°."""
    rotator = make_rotator()
    ask(Client(1, rotator), b"K\n")
    state = rotator.commanded(NOON_NS)
    assert state is not None
    assert math.remainder(state.first_deg, 360.0) == pytest.approx(0.0, abs=0.01)
    assert state.second_deg == pytest.approx(90.0 - (60.0 - 52.1541), abs=0.001)
