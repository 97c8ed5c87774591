"""The two datagrams of the Xerxes mount against bytes written out by hand.

Source: Bruce Van Deventer, "Xerxes Mount Control Protocol" (Xerxes Scientific): the tables "Xerxes Mount
Command Datagram" (82 bytes) and "Mount Status Datagram" (160 bytes), and Appendix A, the packing code of
6/25/2019. Both are little-endian, doubles are IEEE 754 binary64, true is 0xFF.

Where the status table and Appendix A disagree about a type (the two rates, the rolling counter, the guide
rates) both are held to be valid and the reader has to tell them apart.

A double is worked out as sign and exponent (1023 + power of two), then the bits after the leading one:
7789 = 1.E6D₁₆ · 2¹² is 40B E6D0000000000, which on the wire reads 00 00 00 00 00 6D BE 40.
"""

import math
from typing import Any, Literal, NamedTuple

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sattrack.mount.model import Readings, Status
from sattrack.mount.xerxes.datagrams import (
    COMMAND_FIELDS,
    DOUBTFUL,
    STATUS_FIELDS,
    Command,
    DatagramError,
    decode_command,
    decode_status,
    encode_command,
    encode_status,
    sets_going,
    status_readings,
)

COMMAND_HEADER = bytes.fromhex("AA AA 55 55 00 00 00 00")  # 0x5555AAAA as UInt64
STATUS_HEADER = bytes.fromhex("58 45 52 58 45 53 78 78")  # 88 69 82 88 69 83 120 120, "XERXESxx"
EMPTY_COMMAND = COMMAND_HEADER + bytes(74)
EMPTY_STATUS = STATUS_HEADER + bytes(152)

# First byte of every field after the header, from the "bytes" column of the command table.
COMMAND_OFFSETS = {
    "counter": 8,
    "target_dec_deg": 16,
    "target_ra_h": 24,
    "move_dec_rate_deg_s": 32,
    "move_ra_rate_deg_s": 40,
    "dec_fine_rate_dtics_s": 48,
    "ra_fine_rate_dtics_s": 56,
    "pulse_ra_ms": 64,
    "pulse_dec_ms": 68,
    "tracking_rate": 72,
    "abort": 73,
    "find_home": 74,
    "move_ra": 75,
    "move_dec": 76,
    "park": 77,
    "pulse_guide": 78,
    "slew": 79,
    "sync": 80,
    "spare": 81,
}

# First byte of every field after the header, from the "byte #" column of the status table.
STATUS_OFFSETS = {
    "altitude_deg": 8,
    "azimuth_deg": 16,
    "dec_deg": 24,
    "dec_rate_dtics_s": 32,
    "ra_h": 40,
    "ra_rate_dtics_s": 48,
    "sidereal_h": 56,
    "site_height_m": 64,
    "site_latitude_deg": 72,
    "site_longitude_deg": 80,
    "target_dec_deg": 88,
    "target_ra_h": 96,
    "counter": 104,
    "dec_guide_rate_dtics_s": 112,
    "ra_guide_rate_dtics_s": 120,
    "dec_current_10ma": 128,
    "ra_current_10ma": 132,
    "at_home": 136,
    "at_park": 137,
    "connected": 138,
    "does_refraction": 139,
    "equatorial_system": 140,
    "pulse_guiding": 141,
    "side_of_pier": 142,
    "slewing": 143,
    "tracking": 144,
    "tracking_rate": 145,
    "ack_move_dec": 146,
    "ack_move_ra": 147,
    "utc_1": 148,
    "utc_2": 149,
    "utc_3": 150,
    "ra_drive_status_1": 151,
    "ra_drive_status_2": 152,
    "dec_drive_status_1": 153,
    "dec_drive_status_2": 154,
    "ack_abort": 155,
    "ack_sync": 156,
    "ack_pulse_guide": 157,
    "ack_slew": 158,
    "spare": 159,
}

COMMAND_FLAGS = (
    "abort",
    "find_home",
    "move_ra",
    "move_dec",
    "park",
    "pulse_guide",
    "slew",
    "sync",
    "spare",
)
# Appendix A packs side of pier, "enumerated" in the table, as the boolean BeyondPole.
STATUS_FLAGS = (
    "at_home",
    "at_park",
    "connected",
    "does_refraction",
    "pulse_guiding",
    "side_of_pier",
    "slewing",
    "tracking",
    "ack_move_dec",
    "ack_move_ra",
    "ack_abort",
    "ack_sync",
    "ack_pulse_guide",
    "ack_slew",
)
# The status fields whose type the paper leaves open.
OPEN_FIELDS = (
    "dec_rate_dtics_s",
    "ra_rate_dtics_s",
    "counter",
    "dec_guide_rate_dtics_s",
    "ra_guide_rate_dtics_s",
)

Reading = Literal["int64", "double"] | None

APPENDIX_A = Readings(
    dec_rate_dtics_s="int64",
    ra_rate_dtics_s="int64",
    counter="int64",
    dec_guide_rate_dtics_s="double",
    ra_guide_rate_dtics_s="double",
)
STATUS_TABLE = Readings(
    dec_rate_dtics_s="int64",
    ra_rate_dtics_s="double",
    counter="int64",
    dec_guide_rate_dtics_s="double",
    ra_guide_rate_dtics_s="double",
)
ALL_DOUBLE = Readings(
    dec_rate_dtics_s="double",
    ra_rate_dtics_s="double",
    counter="double",
    dec_guide_rate_dtics_s="double",
    ra_guide_rate_dtics_s="double",
)
ALL_INT64 = Readings(
    dec_rate_dtics_s="int64",
    ra_rate_dtics_s="int64",
    counter="int64",
    dec_guide_rate_dtics_s="int64",
    ra_guide_rate_dtics_s="int64",
)
NO_READINGS = Readings(
    dec_rate_dtics_s=None,
    ra_rate_dtics_s=None,
    counter=None,
    dec_guide_rate_dtics_s=None,
    ra_guide_rate_dtics_s=None,
)


class Row(NamedTuple):
    """One field alone: its name, its value, its first and last byte in the paper, its bytes."""

    name: str
    value: float | bool
    first: int
    last: int
    wire: str


COMMAND_ROWS = (
    Row("counter", 0x0102030405060708, 8, 15, "08 07 06 05 04 03 02 01"),
    Row("counter", 1, 8, 15, "01 00 00 00 00 00 00 00"),
    Row("target_dec_deg", -89.5, 16, 23, "00 00 00 00 00 60 56 C0"),  # 1011001.1
    Row("target_dec_deg", 1 / 3, 16, 23, "55 55 55 55 55 55 D5 3F"),
    Row("target_ra_h", 23.75, 24, 31, "00 00 00 00 00 C0 37 40"),  # 10111.11
    Row("target_ra_h", math.pi, 24, 31, "18 2D 44 54 FB 21 09 40"),
    Row("move_dec_rate_deg_s", -2.5, 32, 39, "00 00 00 00 00 00 04 C0"),  # 10.1
    Row("move_dec_rate_deg_s", 0.1, 32, 39, "9A 99 99 99 99 99 B9 3F"),
    Row("move_ra_rate_deg_s", 0.5, 40, 47, "00 00 00 00 00 00 E0 3F"),
    Row("move_ra_rate_deg_s", -0.1, 40, 47, "9A 99 99 99 99 99 B9 BF"),
    Row("dec_fine_rate_dtics_s", -7789, 48, 55, "93 E1 FF FF FF FF FF FF"),
    Row("dec_fine_rate_dtics_s", 2**63 - 1, 48, 55, "FF FF FF FF FF FF FF 7F"),
    Row("ra_fine_rate_dtics_s", 7789, 56, 63, "6D 1E 00 00 00 00 00 00"),
    Row("ra_fine_rate_dtics_s", -(2**63), 56, 63, "00 00 00 00 00 00 00 80"),
    Row("pulse_ra_ms", -1500, 64, 67, "24 FA FF FF"),
    Row("pulse_ra_ms", 0x01020304, 64, 67, "04 03 02 01"),
    Row("pulse_ra_ms", 2**31 - 1, 64, 67, "FF FF FF 7F"),
    Row("pulse_dec_ms", 250, 68, 71, "FA 00 00 00"),
    Row("pulse_dec_ms", -1, 68, 71, "FF FF FF FF"),
    Row("pulse_dec_ms", -(2**31), 68, 71, "00 00 00 80"),
    Row("tracking_rate", 1, 72, 72, "01"),
    Row("tracking_rate", 3, 72, 72, "03"),
    Row("abort", True, 73, 73, "FF"),
    Row("find_home", True, 74, 74, "FF"),
    Row("move_ra", True, 75, 75, "FF"),
    Row("move_dec", True, 76, 76, "FF"),
    Row("park", True, 77, 77, "FF"),
    Row("pulse_guide", True, 78, 78, "FF"),
    Row("slew", True, 79, 79, "FF"),
    Row("sync", True, 80, 80, "FF"),
    Row("spare", True, 81, 81, "FF"),
)

# In Appendix A's types.
STATUS_ROWS = (
    Row("altitude_deg", -2.5, 8, 15, "00 00 00 00 00 00 04 C0"),
    Row("altitude_deg", 45.125, 8, 15, "00 00 00 00 00 90 46 40"),  # 101101.001
    Row("azimuth_deg", 180.25, 16, 23, "00 00 00 00 00 88 66 40"),  # 10110100.01
    Row("dec_deg", -89.5, 24, 31, "00 00 00 00 00 60 56 C0"),
    Row("dec_deg", 1 / 3, 24, 31, "55 55 55 55 55 55 D5 3F"),
    Row("dec_rate_dtics_s", -120, 32, 39, "88 FF FF FF FF FF FF FF"),
    Row("ra_h", 23.75, 40, 47, "00 00 00 00 00 C0 37 40"),
    Row("ra_rate_dtics_s", 7789, 48, 55, "6D 1E 00 00 00 00 00 00"),
    Row("sidereal_h", math.pi, 56, 63, "18 2D 44 54 FB 21 09 40"),
    Row("site_height_m", 1520.5, 64, 71, "00 00 00 00 00 C2 97 40"),  # 10111110000.1
    Row("site_latitude_deg", 48.125, 72, 79, "00 00 00 00 00 10 48 40"),  # 110000.001
    Row("site_longitude_deg", -111.75, 80, 87, "00 00 00 00 00 F0 5B C0"),  # 1101111.11
    Row("site_longitude_deg", 248.0, 80, 87, "00 00 00 00 00 00 6F 40"),  # 11111000
    Row("target_dec_deg", -33.375, 88, 95, "00 00 00 00 00 B0 40 C0"),  # 100001.011
    Row("target_ra_h", 18.0625, 96, 103, "00 00 00 00 00 10 32 40"),  # 10010.0001
    Row("counter", 0x010203040506, 104, 111, "06 05 04 03 02 01 00 00"),
    Row("dec_guide_rate_dtics_s", 3500.0, 112, 119, "00 00 00 00 00 58 AB 40"),  # 1.B58₁₆ · 2¹¹
    Row("ra_guide_rate_dtics_s", -3500.0, 120, 127, "00 00 00 00 00 58 AB C0"),
    Row("dec_current_10ma", 0x01020304, 128, 131, "04 03 02 01"),
    Row("dec_current_10ma", -150, 128, 131, "6A FF FF FF"),
    Row("ra_current_10ma", 200, 132, 135, "C8 00 00 00"),
    Row("ra_current_10ma", -(2**31), 132, 135, "00 00 00 80"),
    Row("at_home", True, 136, 136, "FF"),
    Row("at_park", True, 137, 137, "FF"),
    Row("connected", True, 138, 138, "FF"),
    Row("does_refraction", True, 139, 139, "FF"),
    Row("equatorial_system", 2, 140, 140, "02"),
    Row("pulse_guiding", True, 141, 141, "FF"),
    Row("side_of_pier", True, 142, 142, "FF"),
    Row("slewing", True, 143, 143, "FF"),
    Row("tracking", True, 144, 144, "FF"),
    Row("tracking_rate", 3, 145, 145, "03"),
    Row("ack_move_dec", True, 146, 146, "FF"),
    Row("ack_move_ra", True, 147, 147, "FF"),
    Row("utc_1", 23, 148, 148, "17"),
    Row("utc_2", 59, 149, 149, "3B"),
    Row("utc_3", 254, 150, 150, "FE"),
    Row("ra_drive_status_1", 0x81, 151, 151, "81"),
    Row("ra_drive_status_2", 0x42, 152, 152, "42"),
    Row("dec_drive_status_1", 0x24, 153, 153, "24"),
    Row("dec_drive_status_2", 0x18, 154, 154, "18"),
    Row("ack_abort", True, 155, 155, "FF"),
    Row("ack_sync", True, 156, 156, "FF"),
    Row("ack_pulse_guide", True, 157, 157, "FF"),
    Row("ack_slew", True, 158, 158, "FF"),
    Row("spare", 0xA5, 159, 159, "A5"),
)

# One value of an open field in one type: the value, the type, the eight bytes.
OPEN_VALUES: tuple[tuple[float, Reading, str], ...] = (
    (7789, "int64", "6D 1E 00 00 00 00 00 00"),
    (-7789, "int64", "93 E1 FF FF FF FF FF FF"),
    (3500, "int64", "AC 0D 00 00 00 00 00 00"),
    (-3500, "int64", "54 F2 FF FF FF FF FF FF"),
    (1, "int64", "01 00 00 00 00 00 00 00"),
    (-1, "int64", "FF FF FF FF FF FF FF FF"),
    (123456, "int64", "40 E2 01 00 00 00 00 00"),
    (2**40, "int64", "00 00 00 00 00 01 00 00"),
    (-(2**40), "int64", "00 00 00 00 00 FF FF FF"),
    (7789.0, "double", "00 00 00 00 00 6D BE 40"),
    (-7789.0, "double", "00 00 00 00 00 6D BE C0"),
    (3500.0, "double", "00 00 00 00 00 58 AB 40"),
    (-3500.0, "double", "00 00 00 00 00 58 AB C0"),
    (1.0, "double", "00 00 00 00 00 00 F0 3F"),
    (-1.0, "double", "00 00 00 00 00 00 F0 BF"),
    (123456.0, "double", "00 00 00 00 00 24 FE 40"),  # 1.E240₁₆ · 2¹⁶
    (2.0**40, "double", "00 00 00 00 00 00 70 42"),
    (-(2.0**40), "double", "00 00 00 00 00 00 70 C2"),
)
# Values only a double can hold: the rates may be fractions, the counter may not.
FRACTIONS: tuple[tuple[float, str], ...] = (
    (0.5, "00 00 00 00 00 00 E0 3F"),
    (-0.1, "9A 99 99 99 99 99 B9 BF"),
    (7789.25, "00 00 00 00 40 6D BE 40"),
    (2.0**-40, "00 00 00 00 00 00 70 3D"),
)

SLEW = Command(counter=1, target_dec_deg=12.25, target_ra_h=5.25, slew=True)
SLEW_BYTES = bytes.fromhex(
    "AA AA 55 55 00 00 00 00"  # 0-7 CmdHeader
    "01 00 00 00 00 00 00 00"  # 8-15 rolling counter 1
    "00 00 00 00 00 80 28 40"  # 16-23 TargetDec 12.25
    "00 00 00 00 00 00 15 40"  # 24-31 TargetRA 5.25
    "00 00 00 00 00 00 00 00"  # 32-39 MoveAxisRateDec
    "00 00 00 00 00 00 00 00"  # 40-47 MoveAxisRateRA
    "00 00 00 00 00 00 00 00"  # 48-55 DecFineRate
    "00 00 00 00 00 00 00 00"  # 56-63 RAFineRate
    "00 00 00 00"  # 64-67 PulseGuideRADuration
    "00 00 00 00"  # 68-71 PulseGuideDecDuration
    "00"  # 72 tracking rate
    "00"  # 73 AbortSlewCmd
    "00"  # 74 FindHomeCmd
    "00"  # 75 MoveAxisRA
    "00"  # 76 MoveAxisDec
    "00"  # 77 ParkCmd
    "00"  # 78 PulseGuideCmd
    "FF"  # 79 SlewToTargetCmd
    "00"  # 80 SyncToTargetCmd
    "00"  # 81 spare
)
MOVE_AXIS = Command(
    counter=258,
    target_dec_deg=12.25,
    target_ra_h=5.25,
    move_dec_rate_deg_s=-0.75,
    move_ra_rate_deg_s=1.25,
    dec_fine_rate_dtics_s=-120,
    ra_fine_rate_dtics_s=7789,
    move_ra=True,
    move_dec=True,
)
MOVE_AXIS_BYTES = bytes.fromhex(
    "AA AA 55 55 00 00 00 00"  # 0-7 CmdHeader
    "02 01 00 00 00 00 00 00"  # 8-15 rolling counter 258
    "00 00 00 00 00 80 28 40"  # 16-23 TargetDec 12.25
    "00 00 00 00 00 00 15 40"  # 24-31 TargetRA 5.25
    "00 00 00 00 00 00 E8 BF"  # 32-39 MoveAxisRateDec -0.75
    "00 00 00 00 00 00 F4 3F"  # 40-47 MoveAxisRateRA 1.25
    "88 FF FF FF FF FF FF FF"  # 48-55 DecFineRate -120
    "6D 1E 00 00 00 00 00 00"  # 56-63 RAFineRate 7789
    "00 00 00 00"  # 64-67 PulseGuideRADuration
    "00 00 00 00"  # 68-71 PulseGuideDecDuration
    "00"  # 72 tracking rate
    "00"  # 73 AbortSlewCmd
    "00"  # 74 FindHomeCmd
    "FF"  # 75 MoveAxisRA
    "FF"  # 76 MoveAxisDec
    "00"  # 77 ParkCmd
    "00"  # 78 PulseGuideCmd
    "00"  # 79 SlewToTargetCmd
    "00"  # 80 SyncToTargetCmd
    "00"  # 81 spare
)
PULSE_GUIDE_EAST = Command(counter=65536, pulse_ra_ms=-1500, pulse_dec_ms=250, pulse_guide=True)
PULSE_GUIDE_EAST_BYTES = bytes.fromhex(
    "AA AA 55 55 00 00 00 00"  # 0-7 CmdHeader
    "00 00 01 00 00 00 00 00"  # 8-15 rolling counter 65536
    "00 00 00 00 00 00 00 00"  # 16-23 TargetDec
    "00 00 00 00 00 00 00 00"  # 24-31 TargetRA
    "00 00 00 00 00 00 00 00"  # 32-39 MoveAxisRateDec
    "00 00 00 00 00 00 00 00"  # 40-47 MoveAxisRateRA
    "00 00 00 00 00 00 00 00"  # 48-55 DecFineRate
    "00 00 00 00 00 00 00 00"  # 56-63 RAFineRate
    "24 FA FF FF"  # 64-67 PulseGuideRADuration -1500, east
    "FA 00 00 00"  # 68-71 PulseGuideDecDuration 250
    "00"  # 72 tracking rate
    "00"  # 73 AbortSlewCmd
    "00"  # 74 FindHomeCmd
    "00"  # 75 MoveAxisRA
    "00"  # 76 MoveAxisDec
    "00"  # 77 ParkCmd
    "FF"  # 78 PulseGuideCmd
    "00"  # 79 SlewToTargetCmd
    "00"  # 80 SyncToTargetCmd
    "00"  # 81 spare
)
ABORT = Command(counter=123456, abort=True)
ABORT_BYTES = bytes.fromhex(
    "AA AA 55 55 00 00 00 00"  # 0-7 CmdHeader
    "40 E2 01 00 00 00 00 00"  # 8-15 rolling counter 123456
    "00 00 00 00 00 00 00 00"  # 16-23 TargetDec
    "00 00 00 00 00 00 00 00"  # 24-31 TargetRA
    "00 00 00 00 00 00 00 00"  # 32-39 MoveAxisRateDec
    "00 00 00 00 00 00 00 00"  # 40-47 MoveAxisRateRA
    "00 00 00 00 00 00 00 00"  # 48-55 DecFineRate
    "00 00 00 00 00 00 00 00"  # 56-63 RAFineRate
    "00 00 00 00"  # 64-67 PulseGuideRADuration
    "00 00 00 00"  # 68-71 PulseGuideDecDuration
    "00"  # 72 tracking rate
    "FF"  # 73 AbortSlewCmd
    "00"  # 74 FindHomeCmd
    "00"  # 75 MoveAxisRA
    "00"  # 76 MoveAxisDec
    "00"  # 77 ParkCmd
    "00"  # 78 PulseGuideCmd
    "00"  # 79 SlewToTargetCmd
    "00"  # 80 SyncToTargetCmd
    "00"  # 81 spare
)

NOTHING: dict[str, Any] = dict.fromkeys(STATUS_OFFSETS, 0) | dict.fromkeys(STATUS_FLAGS, False)
ZERO_STATUS = Status(**NOTHING)
GUIDING = msgspec.structs.replace(
    ZERO_STATUS,
    altitude_deg=52.5,
    azimuth_deg=198.25,
    dec_deg=12.0,
    dec_rate_dtics_s=-120,
    ra_h=5.5,
    ra_rate_dtics_s=7789,
    sidereal_h=6.25,
    site_height_m=1520.5,
    site_latitude_deg=48.125,
    site_longitude_deg=11.5,
    target_dec_deg=12.25,
    target_ra_h=5.25,
    counter=123456,
    dec_guide_rate_dtics_s=3500,
    ra_guide_rate_dtics_s=3500,
    dec_current_10ma=75,
    ra_current_10ma=130,
    connected=True,
    pulse_guiding=True,
    tracking=True,
    ack_pulse_guide=True,
)
GUIDING_IN_APPENDIX_A = bytes.fromhex(
    "58 45 52 58 45 53 78 78"  # 0-7 "XERXESxx"
    "00 00 00 00 00 40 4A 40"  # 8-15 altitude 52.5
    "00 00 00 00 00 C8 68 40"  # 16-23 azimuth 198.25
    "00 00 00 00 00 00 28 40"  # 24-31 declination 12.0
    "88 FF FF FF FF FF FF FF"  # 32-39 declination rate -120, long
    "00 00 00 00 00 00 16 40"  # 40-47 right ascension 5.5
    "6D 1E 00 00 00 00 00 00"  # 48-55 right ascension rate 7789, long
    "00 00 00 00 00 00 19 40"  # 56-63 sidereal time 6.25
    "00 00 00 00 00 C2 97 40"  # 64-71 site height 1520.5
    "00 00 00 00 00 10 48 40"  # 72-79 site latitude 48.125
    "00 00 00 00 00 00 27 40"  # 80-87 site longitude 11.5
    "00 00 00 00 00 80 28 40"  # 88-95 target declination 12.25
    "00 00 00 00 00 00 15 40"  # 96-103 target right ascension 5.25
    "40 E2 01 00 00 00 00 00"  # 104-111 rolling counter 123456, long
    "00 00 00 00 00 58 AB 40"  # 112-119 guide rate declination 3500, double
    "00 00 00 00 00 58 AB 40"  # 120-127 guide rate right ascension 3500, double
    "4B 00 00 00"  # 128-131 declination current 0.75 A
    "82 00 00 00"  # 132-135 right ascension current 1.3 A
    "00"  # 136 AtHome
    "00"  # 137 AtPark
    "FF"  # 138 Connected
    "00"  # 139 DoesRefraction
    "00"  # 140 EquatorialSystem
    "FF"  # 141 IsPulseGuiding
    "00"  # 142 side of pier
    "00"  # 143 Slewing
    "FF"  # 144 Tracking
    "00"  # 145 TrackingRate
    "00"  # 146 AckMoveAxisDec
    "00"  # 147 AckMoveAxisRA
    "00 00 00"  # 148-150 UTCDateTime
    "00 00"  # 151-152 RADriveStatus
    "00 00"  # 153-154 DecDriveStatus
    "00"  # 155 AckAbortCmd
    "00"  # 156 AckSyncCmd
    "FF"  # 157 AckPulseGuideCmd
    "00"  # 158 AckSlewCmd
    "00"  # 159 spare
)
GUIDING_IN_STATUS_TABLE = bytes.fromhex(
    "58 45 52 58 45 53 78 78"  # 0-7 "XERXESxx"
    "00 00 00 00 00 40 4A 40"  # 8-15 altitude 52.5
    "00 00 00 00 00 C8 68 40"  # 16-23 azimuth 198.25
    "00 00 00 00 00 00 28 40"  # 24-31 declination 12.0
    "88 FF FF FF FF FF FF FF"  # 32-39 declination rate -120, long
    "00 00 00 00 00 00 16 40"  # 40-47 right ascension 5.5
    "00 00 00 00 00 6D BE 40"  # 48-55 right ascension rate 7789, double
    "00 00 00 00 00 00 19 40"  # 56-63 sidereal time 6.25
    "00 00 00 00 00 C2 97 40"  # 64-71 site height 1520.5
    "00 00 00 00 00 10 48 40"  # 72-79 site latitude 48.125
    "00 00 00 00 00 00 27 40"  # 80-87 site longitude 11.5
    "00 00 00 00 00 80 28 40"  # 88-95 target declination 12.25
    "00 00 00 00 00 00 15 40"  # 96-103 target right ascension 5.25
    "40 E2 01 00 00 00 00 00"  # 104-111 rolling counter 123456, long
    "00 00 00 00 00 58 AB 40"  # 112-119 guide rate declination 3500, double
    "00 00 00 00 00 58 AB 40"  # 120-127 guide rate right ascension 3500, double
    "4B 00 00 00 82 00 00 00"  # 128-135 currents
    "00 00 FF 00 00 FF 00 00"  # 136-143 connected, pulse guiding
    "FF 00 00 00 00 00 00 00"  # 144-151 tracking
    "00 00 00 00 00 FF 00 00"  # 152-159 acknowledged: pulse guide
)
GUIDING_IN_DOUBLES = bytes.fromhex(
    "58 45 52 58 45 53 78 78"  # 0-7 "XERXESxx"
    "00 00 00 00 00 40 4A 40"  # 8-15 altitude 52.5
    "00 00 00 00 00 C8 68 40"  # 16-23 azimuth 198.25
    "00 00 00 00 00 00 28 40"  # 24-31 declination 12.0
    "00 00 00 00 00 00 5E C0"  # 32-39 declination rate -120, double
    "00 00 00 00 00 00 16 40"  # 40-47 right ascension 5.5
    "00 00 00 00 00 6D BE 40"  # 48-55 right ascension rate 7789, double
    "00 00 00 00 00 00 19 40"  # 56-63 sidereal time 6.25
    "00 00 00 00 00 C2 97 40"  # 64-71 site height 1520.5
    "00 00 00 00 00 10 48 40"  # 72-79 site latitude 48.125
    "00 00 00 00 00 00 27 40"  # 80-87 site longitude 11.5
    "00 00 00 00 00 80 28 40"  # 88-95 target declination 12.25
    "00 00 00 00 00 00 15 40"  # 96-103 target right ascension 5.25
    "00 00 00 00 00 24 FE 40"  # 104-111 rolling counter 123456, double
    "00 00 00 00 00 58 AB 40"  # 112-119 guide rate declination 3500, double
    "00 00 00 00 00 58 AB 40"  # 120-127 guide rate right ascension 3500, double
    "4B 00 00 00 82 00 00 00"  # 128-135 currents
    "00 00 FF 00 00 FF 00 00"  # 136-143 connected, pulse guiding
    "FF 00 00 00 00 00 00 00"  # 144-151 tracking
    "00 00 00 00 00 FF 00 00"  # 152-159 acknowledged: pulse guide
)
GUIDING_IN_INT64 = bytes.fromhex(
    "58 45 52 58 45 53 78 78"  # 0-7 "XERXESxx"
    "00 00 00 00 00 40 4A 40"  # 8-15 altitude 52.5
    "00 00 00 00 00 C8 68 40"  # 16-23 azimuth 198.25
    "00 00 00 00 00 00 28 40"  # 24-31 declination 12.0
    "88 FF FF FF FF FF FF FF"  # 32-39 declination rate -120, long
    "00 00 00 00 00 00 16 40"  # 40-47 right ascension 5.5
    "6D 1E 00 00 00 00 00 00"  # 48-55 right ascension rate 7789, long
    "00 00 00 00 00 00 19 40"  # 56-63 sidereal time 6.25
    "00 00 00 00 00 C2 97 40"  # 64-71 site height 1520.5
    "00 00 00 00 00 10 48 40"  # 72-79 site latitude 48.125
    "00 00 00 00 00 00 27 40"  # 80-87 site longitude 11.5
    "00 00 00 00 00 80 28 40"  # 88-95 target declination 12.25
    "00 00 00 00 00 00 15 40"  # 96-103 target right ascension 5.25
    "40 E2 01 00 00 00 00 00"  # 104-111 rolling counter 123456, long
    "AC 0D 00 00 00 00 00 00"  # 112-119 guide rate declination 3500, long
    "AC 0D 00 00 00 00 00 00"  # 120-127 guide rate right ascension 3500, long
    "4B 00 00 00 82 00 00 00"  # 128-135 currents
    "00 00 FF 00 00 FF 00 00"  # 136-143 connected, pulse guiding
    "FF 00 00 00 00 00 00 00"  # 144-151 tracking
    "00 00 00 00 00 FF 00 00"  # 152-159 acknowledged: pulse guide
)
# Appendix A packs Tracking as the opposite of Slewing.
SLEWING = msgspec.structs.replace(
    ZERO_STATUS,
    altitude_deg=45.125,
    azimuth_deg=180.25,
    dec_deg=-2.5,
    dec_rate_dtics_s=2**20,
    ra_h=18.0625,
    ra_rate_dtics_s=-(2**20),
    sidereal_h=23.75,
    site_height_m=0.5,
    site_latitude_deg=-33.375,
    site_longitude_deg=-111.75,
    target_dec_deg=-89.5,
    target_ra_h=1.0,
    counter=1,
    dec_guide_rate_dtics_s=3500,
    ra_guide_rate_dtics_s=3500,
    dec_current_10ma=-200,
    ra_current_10ma=200,
    connected=True,
    slewing=True,
    ack_move_dec=True,
    ack_slew=True,
)
SLEWING_BYTES = bytes.fromhex(
    "58 45 52 58 45 53 78 78"  # 0-7 "XERXESxx"
    "00 00 00 00 00 90 46 40"  # 8-15 altitude 45.125
    "00 00 00 00 00 88 66 40"  # 16-23 azimuth 180.25
    "00 00 00 00 00 00 04 C0"  # 24-31 declination -2.5
    "00 00 10 00 00 00 00 00"  # 32-39 declination rate 1048576, long
    "00 00 00 00 00 10 32 40"  # 40-47 right ascension 18.0625
    "00 00 F0 FF FF FF FF FF"  # 48-55 right ascension rate -1048576, long
    "00 00 00 00 00 C0 37 40"  # 56-63 sidereal time 23.75
    "00 00 00 00 00 00 E0 3F"  # 64-71 site height 0.5
    "00 00 00 00 00 B0 40 C0"  # 72-79 site latitude -33.375
    "00 00 00 00 00 F0 5B C0"  # 80-87 site longitude -111.75
    "00 00 00 00 00 60 56 C0"  # 88-95 target declination -89.5
    "00 00 00 00 00 00 F0 3F"  # 96-103 target right ascension 1.0
    "01 00 00 00 00 00 00 00"  # 104-111 rolling counter 1, long
    "00 00 00 00 00 58 AB 40"  # 112-119 guide rate declination 3500, double
    "00 00 00 00 00 58 AB 40"  # 120-127 guide rate right ascension 3500, double
    "38 FF FF FF"  # 128-131 declination current -2 A
    "C8 00 00 00"  # 132-135 right ascension current 2 A
    "00"  # 136 AtHome
    "00"  # 137 AtPark
    "FF"  # 138 Connected
    "00"  # 139 DoesRefraction
    "00"  # 140 EquatorialSystem
    "00"  # 141 IsPulseGuiding
    "00"  # 142 side of pier
    "FF"  # 143 Slewing
    "00"  # 144 Tracking
    "00"  # 145 TrackingRate
    "FF"  # 146 AckMoveAxisDec
    "00"  # 147 AckMoveAxisRA
    "00 00 00"  # 148-150 UTCDateTime
    "00 00"  # 151-152 RADriveStatus
    "00 00"  # 153-154 DecDriveStatus
    "00"  # 155 AckAbortCmd
    "00"  # 156 AckSyncCmd
    "00"  # 157 AckPulseGuideCmd
    "FF"  # 158 AckSlewCmd
    "00"  # 159 spare
)

BAD_COMMAND_HEADERS = {
    "zero": "00 00 00 00 00 00 00 00",
    "uint64 big-endian": "00 00 00 00 55 55 AA AA",
    "halves big-endian": "55 55 AA AA 00 00 00 00",
    "bytes in words swapped": "AA 55 AA 55 00 00 00 00",
    "halves exchanged": "00 00 00 00 AA AA 55 55",
    "upper half one": "AA AA 55 55 01 00 00 00",
    "upper half top bit": "AA AA 55 55 00 00 00 80",
    "upper half all ones": "AA AA 55 55 FF FF FF FF",
    "upper half repeats": "AA AA 55 55 AA AA 55 55",
    "status header": "58 45 52 58 45 53 78 78",
}
BAD_STATUS_HEADERS = {
    "zero": "00 00 00 00 00 00 00 00",
    "reversed": "78 78 53 45 58 52 45 58",
    "words swapped": "45 58 58 52 53 45 78 78",
    "halves exchanged": "45 53 78 78 58 45 52 58",
    "lower case": "78 65 72 78 65 73 78 78",
    "upper case": "58 45 52 58 45 53 58 58",
    "command header": "AA AA 55 55 00 00 00 00",
}


def only(empty: bytes, row: Row) -> bytes:
    """Put the field of *row* into an otherwise empty datagram."""
    field = bytes.fromhex(row.wire)
    assert len(field) == row.last - row.first + 1
    return empty[: row.first] + field + empty[row.last + 1 :]


def put(empty: bytes, offset: int, wire: str) -> bytes:
    field = bytes.fromhex(wire)
    return empty[:offset] + field + empty[offset + len(field) :]


def row_id(row: Row) -> str:
    return f"{row.name}={row.wire.replace(' ', '')}"


def values(datagram: Command | Status) -> dict[str, Any]:
    return msgspec.structs.asdict(datagram)


def command_with(name: str, value: Any) -> Command:
    changes: dict[str, Any] = {name: value}
    return Command(**changes)


def status_with(name: str, value: Any) -> Status:
    changes: dict[str, Any] = {name: value}
    return msgspec.structs.replace(ZERO_STATUS, **changes)


def readings_with(name: str, reading: Reading, others: Readings = NO_READINGS) -> Readings:
    changes: dict[str, Any] = {name: reading}
    return msgspec.structs.replace(others, **changes)


@pytest.mark.parametrize("at", range(73, 82))
def test_any_flag_but_an_aborts_sets_a_mount_going(at: int) -> None:
    """Bytes 73 to 81 of the command table: AbortSlewCmd is the first, and the spare one counts."""
    command = bytearray(EMPTY_COMMAND)
    command[8:73] = b"\x01" * 65
    assert sets_going(bytes(command)) is False
    command[at] = 0xFF
    assert sets_going(bytes(command)) is (at != 73)


class TestFieldTables:
    def test_the_command_fields_are_the_papers(self) -> None:
        table = {row.name: row.offset for row in COMMAND_FIELDS if row.offset != 0}
        assert table == COMMAND_OFFSETS

    def test_the_status_fields_are_the_papers(self) -> None:
        table = {row.name: row.offset for row in STATUS_FIELDS if row.offset != 0}
        assert table == STATUS_OFFSETS

    @pytest.mark.parametrize("fields", [COMMAND_FIELDS, STATUS_FIELDS], ids=["command", "status"])
    def test_offsets_are_in_order_and_named_once(self, fields: Any) -> None:
        offsets = [row.offset for row in fields]
        names = [row.name for row in fields]
        assert offsets == sorted(set(offsets))
        assert len(names) == len(set(names))
        assert offsets[0] in (0, 8)

    def test_what_is_packed_has_the_papers_fields_in_their_order(self) -> None:
        assert list(Command.__struct_fields__) == sorted(COMMAND_OFFSETS, key=COMMAND_OFFSETS.__getitem__)
        assert list(Status.__struct_fields__) == sorted(STATUS_OFFSETS, key=STATUS_OFFSETS.__getitem__)
        assert DOUBTFUL == OPEN_FIELDS

    @pytest.mark.parametrize(
        ("rows", "offsets", "length"),
        [(COMMAND_ROWS, COMMAND_OFFSETS, 82), (STATUS_ROWS, STATUS_OFFSETS, 160)],
        ids=["command", "status"],
    )
    def test_the_rows_cover_every_byte_once(
        self, rows: tuple[Row, ...], offsets: dict[str, int], length: int
    ) -> None:
        spans = {row.name: (row.first, row.last) for row in rows}
        assert {name: first for name, (first, _) in spans.items()} == offsets
        covered = [byte for first, last in spans.values() for byte in range(first, last + 1)]
        assert covered == list(range(8, length))


class TestEmptyDatagrams:
    def test_command(self) -> None:
        assert encode_command(Command()) == EMPTY_COMMAND
        assert values(decode_command(EMPTY_COMMAND)) == dict.fromkeys(COMMAND_OFFSETS, 0)

    def test_status(self) -> None:
        assert encode_status(ZERO_STATUS, None) == EMPTY_STATUS
        assert values(decode_status(EMPTY_STATUS)) == dict.fromkeys(STATUS_OFFSETS, 0)

    @pytest.mark.parametrize("name", COMMAND_FLAGS)
    def test_command_flags_are_false(self, name: str) -> None:
        assert getattr(decode_command(EMPTY_COMMAND), name) is False

    @pytest.mark.parametrize("name", STATUS_FLAGS)
    def test_status_flags_are_false(self, name: str) -> None:
        assert getattr(decode_status(EMPTY_STATUS), name) is False


class TestOneFieldAtATime:
    @pytest.mark.parametrize("row", COMMAND_ROWS, ids=row_id)
    def test_decode_command(self, row: Row) -> None:
        decoded = decode_command(only(EMPTY_COMMAND, row))
        assert values(decoded) == dict.fromkeys(COMMAND_OFFSETS, 0) | {row.name: row.value}

    @pytest.mark.parametrize("row", COMMAND_ROWS, ids=row_id)
    def test_encode_command(self, row: Row) -> None:
        assert encode_command(command_with(row.name, row.value)) == only(EMPTY_COMMAND, row)

    @pytest.mark.parametrize("row", STATUS_ROWS, ids=row_id)
    def test_decode_status(self, row: Row) -> None:
        decoded = decode_status(only(EMPTY_STATUS, row))
        assert values(decoded) == dict.fromkeys(STATUS_OFFSETS, 0) | {row.name: row.value}

    @pytest.mark.parametrize("row", STATUS_ROWS, ids=row_id)
    def test_encode_status(self, row: Row) -> None:
        assert encode_status(status_with(row.name, row.value), None) == only(EMPTY_STATUS, row)


class TestWholeCommands:
    @pytest.mark.parametrize(
        ("command", "wire"),
        [
            (SLEW, SLEW_BYTES),
            (MOVE_AXIS, MOVE_AXIS_BYTES),
            (PULSE_GUIDE_EAST, PULSE_GUIDE_EAST_BYTES),
            (ABORT, ABORT_BYTES),
        ],
        ids=["slew", "move both axes", "pulse guide east", "abort"],
    )
    def test_byte_for_byte(self, command: Command, wire: bytes) -> None:
        assert len(wire) == 82
        assert encode_command(command) == wire
        assert decode_command(wire) == command


class TestWholeStatus:
    @pytest.mark.parametrize(
        ("status", "readings", "wire"),
        [
            (GUIDING, APPENDIX_A, GUIDING_IN_APPENDIX_A),
            (GUIDING, STATUS_TABLE, GUIDING_IN_STATUS_TABLE),
            (GUIDING, ALL_DOUBLE, GUIDING_IN_DOUBLES),
            (GUIDING, ALL_INT64, GUIDING_IN_INT64),
            (SLEWING, APPENDIX_A, SLEWING_BYTES),
        ],
        ids=["guiding, Appendix A", "guiding, table", "guiding, doubles", "guiding, int64", "slewing"],
    )
    def test_byte_for_byte(self, status: Status, readings: Readings, wire: bytes) -> None:
        assert len(wire) == 160
        assert encode_status(status, readings) == wire
        assert decode_status(wire) == status
        assert status_readings(wire) == readings

    @pytest.mark.parametrize(
        ("status", "wire"),
        [(GUIDING, GUIDING_IN_APPENDIX_A), (SLEWING, SLEWING_BYTES)],
        ids=["guiding", "slewing"],
    )
    def test_appendix_a_unless_told_otherwise(self, status: Status, wire: bytes) -> None:
        assert encode_status(status, None) == wire
        assert encode_status(status) == wire

    def test_tracking_and_slewing_are_both_carried_as_they_are(self) -> None:
        both = put(put(EMPTY_STATUS, 143, "FF"), 144, "FF")
        decoded = decode_status(both)
        assert (decoded.slewing, decoded.tracking) == (True, True)
        assert encode_status(decoded, None) == both


class TestFlags:
    @pytest.mark.parametrize("raw", ["01", "02", "7F", "80", "FE", "FF"])
    @pytest.mark.parametrize("name", COMMAND_FLAGS)
    def test_any_non_zero_byte_is_true_in_a_command(self, name: str, raw: str) -> None:
        decoded = decode_command(put(EMPTY_COMMAND, COMMAND_OFFSETS[name], raw))
        assert getattr(decoded, name) is True
        assert encode_command(decoded) == put(EMPTY_COMMAND, COMMAND_OFFSETS[name], "FF")

    @pytest.mark.parametrize("raw", ["01", "02", "7F", "80", "FE", "FF"])
    @pytest.mark.parametrize("name", STATUS_FLAGS)
    def test_any_non_zero_byte_is_true_in_a_status(self, name: str, raw: str) -> None:
        decoded = decode_status(put(EMPTY_STATUS, STATUS_OFFSETS[name], raw))
        assert getattr(decoded, name) is True
        assert encode_status(decoded, None) == put(EMPTY_STATUS, STATUS_OFFSETS[name], "FF")


class TestOpenFields:
    @pytest.mark.parametrize(("value", "reading", "wire"), OPEN_VALUES)
    @pytest.mark.parametrize("name", OPEN_FIELDS)
    def test_both_types_give_the_value(self, name: str, value: float, reading: Reading, wire: str) -> None:
        datagram = put(EMPTY_STATUS, STATUS_OFFSETS[name], wire)
        assert values(decode_status(datagram)) == dict.fromkeys(STATUS_OFFSETS, 0) | {name: value}
        assert status_readings(datagram) == readings_with(name, reading)

    @pytest.mark.parametrize(("value", "reading", "wire"), OPEN_VALUES)
    @pytest.mark.parametrize("name", OPEN_FIELDS)
    def test_both_types_are_written(self, name: str, value: float, reading: Reading, wire: str) -> None:
        readings = readings_with(name, reading, APPENDIX_A)
        expected = put(EMPTY_STATUS, STATUS_OFFSETS[name], wire)
        assert encode_status(status_with(name, value), readings) == expected

    @pytest.mark.parametrize(("value", "wire"), FRACTIONS)
    @pytest.mark.parametrize("name", [name for name in OPEN_FIELDS if name != "counter"])
    def test_a_fraction_is_a_double(self, name: str, value: float, wire: str) -> None:
        datagram = put(EMPTY_STATUS, STATUS_OFFSETS[name], wire)
        assert getattr(decode_status(datagram), name) == value
        readings = status_readings(datagram)
        assert readings == readings_with(name, "double")
        assert encode_status(status_with(name, value), readings) == datagram

    def test_zeros_tell_nothing(self) -> None:
        assert status_readings(EMPTY_STATUS) == NO_READINGS
        assert encode_status(ZERO_STATUS, NO_READINGS) == EMPTY_STATUS

    @pytest.mark.parametrize("readings", [APPENDIX_A, STATUS_TABLE, ALL_DOUBLE, ALL_INT64])
    def test_zero_is_the_same_in_both_types(self, readings: Readings) -> None:
        assert encode_status(ZERO_STATUS, readings) == EMPTY_STATUS

    @pytest.mark.parametrize("name", OPEN_FIELDS)
    def test_minus_zero_is_a_rate_of_zero(self, name: str) -> None:
        datagram = put(EMPTY_STATUS, STATUS_OFFSETS[name], "00 00 00 00 00 00 00 80")
        assert getattr(decode_status(datagram), name) == 0

    @pytest.mark.parametrize("silent", OPEN_FIELDS)
    def test_each_field_is_judged_by_itself(self, silent: str) -> None:
        datagram = put(GUIDING_IN_APPENDIX_A, STATUS_OFFSETS[silent], "00 00 00 00 00 00 00 00")
        assert status_readings(datagram) == readings_with(silent, None, APPENDIX_A)
        assert values(decode_status(datagram)) == values(GUIDING) | {silent: 0}

    @given(
        name=st.sampled_from(OPEN_FIELDS),
        value=st.integers(-(2**48), 2**48).filter(bool),
        reading=st.sampled_from(("int64", "double")),
    )
    @settings(deadline=None)
    def test_a_whole_number_comes_back_in_the_type_it_was_sent_in(
        self, name: str, value: int, reading: Reading
    ) -> None:
        datagram = encode_status(status_with(name, value), readings_with(name, reading, APPENDIX_A))
        start = STATUS_OFFSETS[name]
        as_integer = int.from_bytes(datagram[start : start + 8], "little", signed=True)
        assert (as_integer == value) is (reading == "int64")
        assert getattr(decode_status(datagram), name) == value
        assert status_readings(datagram) == readings_with(name, reading)


class TestRefusals:
    def test_the_error_is_its_own(self) -> None:
        for other in (ValueError, TypeError, IndexError, KeyError, OverflowError, AssertionError):
            assert not issubclass(other, DatagramError)

    @pytest.mark.parametrize("length", [0, 1, 7, 8, 81, 83, 160, 164])
    def test_command_length(self, length: int) -> None:
        datagram = (SLEW_BYTES + bytes(82))[:length]
        with pytest.raises(DatagramError):
            decode_command(datagram)

    @pytest.mark.parametrize("length", [0, 1, 7, 8, 82, 159, 161, 320])
    def test_status_length(self, length: int) -> None:
        datagram = (GUIDING_IN_APPENDIX_A + bytes(160))[:length]
        with pytest.raises(DatagramError):
            decode_status(datagram)
        with pytest.raises(DatagramError):
            status_readings(datagram)

    @pytest.mark.parametrize("header", BAD_COMMAND_HEADERS.values(), ids=BAD_COMMAND_HEADERS.keys())
    def test_command_header(self, header: str) -> None:
        with pytest.raises(DatagramError):
            decode_command(put(SLEW_BYTES, 0, header))

    @pytest.mark.parametrize("header", BAD_STATUS_HEADERS.values(), ids=BAD_STATUS_HEADERS.keys())
    def test_status_header(self, header: str) -> None:
        with pytest.raises(DatagramError):
            decode_status(put(GUIDING_IN_APPENDIX_A, 0, header))

    @pytest.mark.parametrize("header", BAD_STATUS_HEADERS.values(), ids=BAD_STATUS_HEADERS.keys())
    def test_status_header_before_the_readings(self, header: str) -> None:
        with pytest.raises(DatagramError):
            status_readings(put(GUIDING_IN_APPENDIX_A, 0, header))

    @pytest.mark.parametrize("bit", range(64))
    def test_one_wrong_bit_in_a_header(self, bit: int) -> None:
        command = bytearray(SLEW_BYTES)
        command[bit // 8] ^= 1 << bit % 8
        with pytest.raises(DatagramError):
            decode_command(bytes(command))
        status = bytearray(GUIDING_IN_APPENDIX_A)
        status[bit // 8] ^= 1 << bit % 8
        with pytest.raises(DatagramError):
            decode_status(bytes(status))

    def test_one_datagram_is_not_the_other(self) -> None:
        with pytest.raises(DatagramError):
            decode_command(GUIDING_IN_APPENDIX_A)
        with pytest.raises(DatagramError):
            decode_status(SLEW_BYTES)


class TestArbitraryBytes:
    @given(datagram=st.binary(max_size=400))
    @settings(deadline=None)
    def test_any_bytes_without_a_header_are_refused(self, datagram: bytes) -> None:
        if not (len(datagram) == 82 and datagram.startswith(COMMAND_HEADER)):
            with pytest.raises(DatagramError):
                decode_command(datagram)
        if not (len(datagram) == 160 and datagram.startswith(STATUS_HEADER)):
            with pytest.raises(DatagramError):
                decode_status(datagram)
            with pytest.raises(DatagramError):
                status_readings(datagram)

    @given(tail=st.binary(max_size=200))
    @settings(deadline=None)
    def test_the_right_header_with_the_wrong_length_is_refused(self, tail: bytes) -> None:
        if len(tail) != 74:
            with pytest.raises(DatagramError):
                decode_command(COMMAND_HEADER + tail)
        if len(tail) != 152:
            with pytest.raises(DatagramError):
                decode_status(STATUS_HEADER + tail)
            with pytest.raises(DatagramError):
                status_readings(STATUS_HEADER + tail)

    @given(body=st.binary(min_size=74, max_size=74))
    @settings(deadline=None)
    def test_any_body_of_a_command_decodes_or_is_refused(self, body: bytes) -> None:
        datagram = COMMAND_HEADER + body
        try:
            command = decode_command(datagram)
        except DatagramError:
            return
        assert command.counter == int.from_bytes(datagram[8:16], "little", signed=True)
        assert command.dec_fine_rate_dtics_s == int.from_bytes(datagram[48:56], "little", signed=True)
        assert command.ra_fine_rate_dtics_s == int.from_bytes(datagram[56:64], "little", signed=True)
        assert command.pulse_ra_ms == int.from_bytes(datagram[64:68], "little", signed=True)
        assert command.pulse_dec_ms == int.from_bytes(datagram[68:72], "little", signed=True)
        assert command.tracking_rate == datagram[72]
        for name in COMMAND_FLAGS:
            assert getattr(command, name) is (datagram[COMMAND_OFFSETS[name]] != 0)

    @given(body=st.binary(min_size=152, max_size=152))
    @settings(deadline=None)
    def test_any_body_of_a_status_decodes_or_is_refused(self, body: bytes) -> None:
        datagram = STATUS_HEADER + body
        try:
            readings = status_readings(datagram)
        except DatagramError:
            pass
        else:
            for name in OPEN_FIELDS:
                silent = not any(datagram[STATUS_OFFSETS[name] : STATUS_OFFSETS[name] + 8])
                assert getattr(readings, name) in ((None,) if silent else ("int64", "double"))
        try:
            status = decode_status(datagram)
        except DatagramError:
            return
        assert status.dec_current_10ma == int.from_bytes(datagram[128:132], "little", signed=True)
        assert status.ra_current_10ma == int.from_bytes(datagram[132:136], "little", signed=True)
        for name in STATUS_FLAGS:
            assert getattr(status, name) is (datagram[STATUS_OFFSETS[name]] != 0)

    @pytest.mark.parametrize("fill", [0xFF, 0x7F, 0x80, 0xF0, 0x01])
    def test_a_body_of_one_byte_decodes_or_is_refused(self, fill: int) -> None:
        for header, length, decode in (
            (COMMAND_HEADER, 82, decode_command),
            (STATUS_HEADER, 160, decode_status),
            (STATUS_HEADER, 160, status_readings),
        ):
            try:
                decode(header + bytes([fill]) * (length - 8))
            except DatagramError:
                continue

    @pytest.mark.parametrize(
        "wire",
        [
            "00 00 00 00 00 00 F0 7F",
            "00 00 00 00 00 00 F0 FF",
            "00 00 00 00 00 00 F8 7F",
            "00 00 00 00 00 00 F8 FF",
        ],
        ids=["inf", "-inf", "nan", "-nan"],
    )
    @pytest.mark.parametrize("name", OPEN_FIELDS)
    def test_no_number_in_an_open_field_decodes_or_is_refused(self, name: str, wire: str) -> None:
        datagram = put(EMPTY_STATUS, STATUS_OFFSETS[name], wire)
        for decode in (decode_status, status_readings):
            try:
                decode(datagram)
            except DatagramError:
                continue
