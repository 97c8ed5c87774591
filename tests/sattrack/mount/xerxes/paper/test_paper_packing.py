"""The codec against the paper's own packing code, on values drawn at random and at the ends of every type.

Source: Van Deventer, "Xerxes Mount Control Protocol", the command table, the status table and Appendix A, as
`paper_packing` transcribes them. Bytes written out by hand are in test_datagrams.py.
"""

from __future__ import annotations

import itertools
import math
import struct
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from paper_packing import (
    DOUBTFUL,
    FLAG_BYTES,
    IN_THE_CODE,
    CommandRow,
    MountGlobals,
    pack_command,
    pack_datagram,
    unpack_command,
)

from sattrack.mount.model import Readings, Status
from sattrack.mount.xerxes.datagrams import (
    Command,
    DatagramError,
    decode_command,
    decode_status,
    encode_command,
    encode_status,
    status_readings,
)

IN_THE_STATUS = {
    "Alt": "altitude_deg",
    "Az": "azimuth_deg",
    "CurrentDec": "dec_deg",
    "CurrentDecSpeed": "dec_rate_dtics_s",
    "CurrentRA": "ra_h",
    "CurrentRASpeed": "ra_rate_dtics_s",
    "CurLST": "sidereal_h",
    "Height": "site_height_m",
    "Latitude": "site_latitude_deg",
    "Longitude": "site_longitude_deg",
    "TargetDec": "target_dec_deg",
    "TargetRA": "target_ra_h",
    "MasterTicCount": "counter",
    "GuideRateDec": "dec_guide_rate_dtics_s",
    "GuideRateRA": "ra_guide_rate_dtics_s",
    "DecRawCurrent": "dec_current_10ma",
    "RARawCurrent": "ra_current_10ma",
    "BeyondPole": "side_of_pier",
    "AckMoveAxisDecCmd": "ack_move_dec",
    "AckMoveAxisRACmd": "ack_move_ra",
    "AckAbortCmd": "ack_abort",
    "AckSyncCmd": "ack_sync",
    "AckPulseGuideCmd": "ack_pulse_guide",
    "AckSlewCmd": "ack_slew",
}
"""Appendix A's variables and the fields that carry them."""
IN_THE_COMMAND = {
    "counter": "counter",
    "TargetDec": "target_dec_deg",
    "TargetRA": "target_ra_h",
    "MoveAxisRateDec": "move_dec_rate_deg_s",
    "MoveAxisRateRA": "move_ra_rate_deg_s",
    "DecFineRate": "dec_fine_rate_dtics_s",
    "RAFineRate": "ra_fine_rate_dtics_s",
    "PulseGuideRADuration": "pulse_ra_ms",
    "PulseGuideDecDuration": "pulse_dec_ms",
    "tracking_rate": "tracking_rate",
    "AbortSlewCmd": "abort",
    "FindHomeCmd": "find_home",
    "MoveAxisRA": "move_ra",
    "MoveAxisDec": "move_dec",
    "ParkCmd": "park",
    "PulseGuideCmd": "pulse_guide",
    "SlewToTargetCmd": "slew",
    "SyncToTargetCmd": "sync",
    "spare": "spare",
}
DOUBLES = ("Alt", "Az", "CurrentDec", "CurrentRA", "CurLST", "Height", "Latitude", "Longitude")
DOUBLES_TOO = ("TargetDec", "TargetRA")
TYPES = ("long", "double")
TYPE_NAMES = {"long": "int64", "double": "double"}
SMALLEST_DOUBLE = 5e-324
LARGEST_DOUBLE = 1.7976931348623157e308
EXTREME_DOUBLES = (0.0, -0.0, SMALLEST_DOUBLE, -LARGEST_DOUBLE, LARGEST_DOUBLE, 1.0 + 2.0**-52, -1e-300)
BLANK = CommandRow()
LARGEST_EXACT = 2**53 - 1
"""Whole numbers up to here are the same as a long and as a double."""

finite = st.floats(allow_nan=False, allow_infinity=False)
int32 = st.integers(-(2**31), 2**31 - 1)
int64 = st.integers(-(2**63), 2**63 - 1)
whole = st.one_of(st.integers(-LARGEST_EXACT, LARGEST_EXACT), st.sampled_from((7789, -7789, 3500, 1, -1)))


@st.composite
def mount_globals(draw: st.DrawFn) -> MountGlobals:
    values: dict[str, Any] = {name: draw(finite) for name in DOUBLES + DOUBLES_TOO}
    values |= {name: draw(whole) for name in DOUBTFUL if name != "MasterTicCount"}
    values["MasterTicCount"] = draw(st.integers(0, LARGEST_EXACT))
    values |= {name: draw(int32) for name in ("DecRawCurrent", "RARawCurrent")}
    flags = [name for name, kind in MountGlobals.__annotations__.items() if kind == "bool"]
    values |= {name: draw(st.booleans()) for name in flags}
    return MountGlobals(**values, types={name: draw(st.sampled_from(TYPES)) for name in DOUBTFUL})


@st.composite
def command_rows(draw: st.DrawFn) -> CommandRow:
    values: dict[str, Any] = {}
    for name in ("TargetDec", "TargetRA", "MoveAxisRateDec", "MoveAxisRateRA"):
        values[name] = draw(finite)
    for name in ("counter", "DecFineRate", "RAFineRate"):
        values[name] = draw(int64)
    for name in ("PulseGuideRADuration", "PulseGuideDecDuration"):
        values[name] = draw(int32)
    values["tracking_rate"] = draw(st.integers(0, 255))
    values |= {name: draw(st.booleans()) for name in FLAG_BYTES}
    return CommandRow(**values)


def readings(g: MountGlobals) -> Readings:
    return Readings(**{IN_THE_STATUS[name]: TYPE_NAMES[g.types[name]] for name in DOUBTFUL})


def status(g: MountGlobals) -> Status:
    """What a mount with these variables reports, what Appendix A packs as constants included."""
    slewing = g.RASlewInProgress or g.DecSlewInProgress
    return Status(
        **{ours: getattr(g, theirs) for theirs, ours in IN_THE_STATUS.items()},
        connected=True,
        pulse_guiding=g.IsRAPulseGuiding or g.IsDecPulseGuiding,
        slewing=slewing,
        tracking=not slewing,
    )


def command(row: CommandRow) -> Command:
    return Command(**{ours: getattr(row, theirs) for theirs, ours in IN_THE_COMMAND.items()})


def bits(value: float) -> bytes:
    """A number with the sign of its zero."""
    return struct.pack("<d", value) if isinstance(value, float) else repr(value).encode()


class TestAppendixA:
    @given(g=mount_globals())
    @settings(deadline=None, max_examples=100)
    def test_a_status_is_packed_as_its_code_packs_it(self, g: MountGlobals) -> None:
        assert encode_status(status(g), readings(g)) == pack_datagram(g)

    @given(g=mount_globals())
    @settings(deadline=None, max_examples=100)
    def test_what_its_code_packs_is_read_back(self, g: MountGlobals) -> None:
        got = decode_status(pack_datagram(g))
        for name in DOUBLES + DOUBLES_TOO:
            assert bits(getattr(got, IN_THE_STATUS[name])) == bits(getattr(g, name)), name
        for name in set(IN_THE_STATUS) - set(DOUBLES + DOUBLES_TOO):
            assert getattr(got, IN_THE_STATUS[name]) == getattr(g, name), name
        assert got == status(g)

    @given(g=mount_globals())
    @settings(deadline=None, max_examples=100)
    def test_the_types_it_was_packed_in_are_told(self, g: MountGlobals) -> None:
        told = status_readings(pack_datagram(g))
        for name in DOUBTFUL:
            expected = None if getattr(g, name) == 0 else TYPE_NAMES[g.types[name]]
            assert getattr(told, IN_THE_STATUS[name]) == expected, name

    @pytest.mark.parametrize("types", list(itertools.product(TYPES, repeat=5)), ids="-".join)
    def test_every_mixture_of_types_reads_the_same(self, types: tuple[Any, ...]) -> None:
        g = MountGlobals(
            CurrentDecSpeed=-7789,
            CurrentRASpeed=7789,
            MasterTicCount=123456,
            GuideRateDec=3500,
            GuideRateRA=-3500,
            types=dict(zip(DOUBTFUL, types, strict=True)),
        )
        got = decode_status(pack_datagram(g))
        assert (got.dec_rate_dtics_s, got.ra_rate_dtics_s, got.counter) == (-7789, 7789, 123456)
        assert (got.dec_guide_rate_dtics_s, got.ra_guide_rate_dtics_s) == (3500, -3500)
        assert status_readings(pack_datagram(g)) == readings(g)

    def test_a_counter_that_rolls_through_its_first_counts_is_told_from_the_second_on(self) -> None:
        for kind in TYPES:
            counts = []
            for count in range(100):
                g = MountGlobals(MasterTicCount=count, types=IN_THE_CODE | {"MasterTicCount": kind})
                counts.append(decode_status(pack_datagram(g)).counter)
                told = status_readings(pack_datagram(g)).counter
                assert told == (None if count == 0 else TYPE_NAMES[kind])
            assert counts == list(range(100))

    @pytest.mark.parametrize("value", EXTREME_DOUBLES)
    @pytest.mark.parametrize("name", DOUBLES + DOUBLES_TOO)
    def test_doubles_at_the_ends_of_their_range(self, name: str, value: float) -> None:
        g = MountGlobals(**{name: value})
        assert encode_status(status(g), readings(g)) == pack_datagram(g)
        assert bits(getattr(decode_status(pack_datagram(g)), IN_THE_STATUS[name])) == bits(value)

    @pytest.mark.parametrize("value", [math.inf, -math.inf, math.nan])
    @pytest.mark.parametrize("name", DOUBLES + DOUBLES_TOO)
    def test_no_number_comes_through_as_none_or_is_refused(self, name: str, value: float) -> None:
        try:
            got = decode_status(pack_datagram(MountGlobals(**{name: value})))
        except DatagramError:
            return
        assert bits(getattr(got, IN_THE_STATUS[name])) == bits(value)

    @pytest.mark.parametrize("value", [-(2**31), -1, 0, 1, 50, 200, 2**31 - 1])
    @pytest.mark.parametrize("name", ["DecRawCurrent", "RARawCurrent"])
    def test_currents_at_the_ends_of_their_range(self, name: str, value: int) -> None:
        g = MountGlobals(**{name: value})
        assert encode_status(status(g), readings(g)) == pack_datagram(g)
        assert getattr(decode_status(pack_datagram(g)), IN_THE_STATUS[name]) == value

    @pytest.mark.parametrize("unpacked", [*range(148, 155), 159])
    def test_bytes_that_its_code_never_writes_stay_zero(self, unpacked: int) -> None:
        g = MountGlobals(AckAbortCmd=True, AckMoveAxisRACmd=True, CurrentRASpeed=7789)
        assert encode_status(status(g), readings(g))[unpacked] == 0

    @pytest.mark.parametrize("ra", [False, True])
    @pytest.mark.parametrize("dec", [False, True])
    def test_either_axis_makes_it_slewing_and_either_timer_pulse_guiding(self, ra: bool, dec: bool) -> None:
        slewing = decode_status(pack_datagram(MountGlobals(RASlewInProgress=ra, DecSlewInProgress=dec)))
        assert (slewing.slewing, slewing.tracking) == (ra or dec, not (ra or dec))
        guiding = decode_status(pack_datagram(MountGlobals(IsRAPulseGuiding=ra, IsDecPulseGuiding=dec)))
        assert guiding.pulse_guiding == (ra or dec)


class TestCommandTable:
    @given(row=command_rows())
    @settings(deadline=None, max_examples=100)
    def test_a_command_is_packed_as_the_table_says(self, row: CommandRow) -> None:
        assert encode_command(command(row)) == pack_command(row)

    @given(row=command_rows())
    @settings(deadline=None, max_examples=100)
    def test_what_the_table_packs_is_read_back(self, row: CommandRow) -> None:
        got = decode_command(pack_command(row))
        for theirs, ours in IN_THE_COMMAND.items():
            assert bits(getattr(got, ours)) == bits(getattr(row, theirs)), theirs

    @pytest.mark.parametrize("value", EXTREME_DOUBLES)
    @pytest.mark.parametrize("name", ["TargetDec", "TargetRA", "MoveAxisRateDec", "MoveAxisRateRA"])
    def test_doubles_at_the_ends_of_their_range(self, name: str, value: float) -> None:
        row = CommandRow(**{name: value})
        assert encode_command(command(row)) == pack_command(row)
        assert bits(getattr(decode_command(pack_command(row)), IN_THE_COMMAND[name])) == bits(value)

    @pytest.mark.parametrize("name", ["counter", "DecFineRate", "RAFineRate"])
    def test_what_does_not_fit_64_bits_is_not_sent_as_something_else(self, name: str) -> None:
        for value in (2**63, -(2**63) - 1):
            with pytest.raises((DatagramError, ValueError, struct.error)):
                encode_command(command(CommandRow(**{name: value})))

    @pytest.mark.parametrize("name", ["PulseGuideRADuration", "PulseGuideDecDuration"])
    def test_what_does_not_fit_32_bits_is_not_sent_as_something_else(self, name: str) -> None:
        for value in (2**31, -(2**31) - 1):
            with pytest.raises((DatagramError, ValueError, struct.error)):
                encode_command(command(CommandRow(**{name: value})))

    @pytest.mark.parametrize("offset", range(8, 82))
    def test_every_byte_belongs_to_the_table_s_row_alone(self, offset: int) -> None:
        data = bytearray(pack_command(CommandRow()))
        data[offset] ^= 0xFF
        row, got = unpack_command(bytes(data)), decode_command(bytes(data))
        theirs = [
            IN_THE_COMMAND[n] for n in IN_THE_COMMAND if bits(getattr(row, n)) != bits(getattr(BLANK, n))
        ]
        ours = [n for n in IN_THE_COMMAND.values() if bits(getattr(got, n)) != bits(getattr(Command(), n))]
        assert len(ours) == 1
        assert ours == theirs
