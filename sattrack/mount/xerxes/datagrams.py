"""The two datagrams of the Xerxes mount control protocol, from one field table each.

Source: Van Deventer, "Xerxes Mount Control Protocol": the command table (82 bytes), the status table
(160 bytes) and Appendix A. Little-endian throughout, as Windows' BitConverter packs. A true boolean is
0xFF; any non-zero byte is taken as true.

Where the paper gives a field two types (a rate packed "as long" or "double"), the eight bytes themselves
tell which one was sent: integers below 2**53 and doubles of ordinary size share no bit pattern but zero.
"""

from __future__ import annotations

import struct
from enum import Enum
from typing import NamedTuple

import msgspec

from sattrack.mount.model import Reading, Readings, Status

COMMAND_HEADER = 0x5555AAAA
STATUS_HEADER = b"XERXESxx"
COMMAND_LENGTH = 82
STATUS_LENGTH = 160
TRUE_BYTE = 0xFF


class Kind(Enum):
    """How a field lies in the datagram; the value is its `struct` code."""

    UINT64 = "Q"
    INT64 = "q"
    INT32 = "i"
    DOUBLE = "d"
    BYTE = "B"
    FLAG = "?"
    """One byte, false 0, true 0xFF."""
    EITHER = "8s"
    """Eight bytes that the paper calls integer in one place and double in another."""
    HEADER = "8S"
    """Eight ASCII bytes."""


class Field(NamedTuple):
    """One row of a datagram's table."""

    offset: int
    name: str
    kind: Kind
    meaning: str


COMMAND_FIELDS = (
    Field(0, "header", Kind.UINT64, "0x5555AAAA, upper half zero"),
    Field(8, "counter", Kind.INT64, "rolling counter of commands sent"),
    Field(16, "target_dec_deg", Kind.DOUBLE, "target of a slew or sync, degrees, JNow"),
    Field(24, "target_ra_h", Kind.DOUBLE, "target of a slew or sync, hours 0 to 24, JNow"),
    Field(32, "move_dec_rate_deg_s", Kind.DOUBLE, "MoveAxis rate, declination"),
    Field(40, "move_ra_rate_deg_s", Kind.DOUBLE, "MoveAxis rate, right ascension axis"),
    Field(48, "dec_fine_rate_dtics_s", Kind.INT64, "fine rate, encoder tics per second x 10"),
    Field(56, "ra_fine_rate_dtics_s", Kind.INT64, "fine rate, encoder tics per second x 10"),
    Field(64, "pulse_ra_ms", Kind.INT32, "pulse guide duration, negative is east"),
    Field(68, "pulse_dec_ms", Kind.INT32, "pulse guide duration, the sign is the direction"),
    Field(72, "tracking_rate", Kind.BYTE, "0 to 3, not used by the mount"),
    Field(73, "abort", Kind.FLAG, "slow down, stop, keep the drives active"),
    Field(74, "find_home", Kind.FLAG, "move to the home position, not used by the mount"),
    Field(75, "move_ra", Kind.FLAG, "MoveAxis on the right ascension axis"),
    Field(76, "move_dec", Kind.FLAG, "MoveAxis on the declination axis"),
    Field(77, "park", Kind.FLAG, "disable the drives wherever the mount is"),
    Field(78, "pulse_guide", Kind.FLAG, "start the pulse guide timers of both axes"),
    Field(79, "slew", Kind.FLAG, "slew to the target, ignored while slewing"),
    Field(80, "sync", Kind.FLAG, "report the target as the present position"),
    Field(81, "spare", Kind.FLAG, "unused"),
)

STATUS_FIELDS = (
    Field(0, "header", Kind.HEADER, "XERXESxx"),
    Field(8, "altitude_deg", Kind.DOUBLE, "altitude"),
    Field(16, "azimuth_deg", Kind.DOUBLE, "azimuth; the paper's row says elevation"),
    Field(24, "dec_deg", Kind.DOUBLE, "declination, JNow"),
    Field(32, "dec_rate_dtics_s", Kind.EITHER, "declination drive rate, tics per second x 10"),
    Field(40, "ra_h", Kind.DOUBLE, "right ascension, hours, JNow"),
    Field(48, "ra_rate_dtics_s", Kind.EITHER, "right ascension drive rate; sidereal is 7789"),
    Field(56, "sidereal_h", Kind.DOUBLE, "local sidereal time of the mount's own clock, hours"),
    Field(64, "site_height_m", Kind.DOUBLE, "site elevation"),
    Field(72, "site_latitude_deg", Kind.DOUBLE, "site latitude"),
    Field(80, "site_longitude_deg", Kind.DOUBLE, "site longitude"),
    Field(88, "target_dec_deg", Kind.DOUBLE, "target of the last slew or sync"),
    Field(96, "target_ra_h", Kind.DOUBLE, "target of the last slew or sync, hours"),
    Field(104, "counter", Kind.EITHER, "rolling counter, one a status datagram"),
    Field(112, "dec_guide_rate_dtics_s", Kind.EITHER, "guide rate, about 3500"),
    Field(120, "ra_guide_rate_dtics_s", Kind.EITHER, "guide rate, about 3500"),
    Field(128, "dec_current_10ma", Kind.INT32, "declination drive current, 10 mA"),
    Field(132, "ra_current_10ma", Kind.INT32, "right ascension drive current, 10 mA"),
    Field(136, "at_home", Kind.FLAG, "at home, packed as 0"),
    Field(137, "at_park", Kind.FLAG, "at park, packed as 0"),
    Field(138, "connected", Kind.FLAG, "always true"),
    Field(139, "does_refraction", Kind.FLAG, "the mount applies refraction itself"),
    Field(140, "equatorial_system", Kind.BYTE, "0: JNow"),
    Field(141, "pulse_guiding", Kind.FLAG, "either pulse guide timer runs"),
    Field(142, "side_of_pier", Kind.FLAG, "beyond the pole"),
    Field(143, "slewing", Kind.FLAG, "slewing, or MoveAxis in force"),
    Field(144, "tracking", Kind.FLAG, "always true by the table, not slewing by the code"),
    Field(145, "tracking_rate", Kind.BYTE, "0: sidereal"),
    Field(146, "ack_move_dec", Kind.FLAG, "MoveAxis in declination acknowledged"),
    Field(147, "ack_move_ra", Kind.FLAG, "MoveAxis in right ascension acknowledged"),
    Field(148, "utc_1", Kind.BYTE, "future"),
    Field(149, "utc_2", Kind.BYTE, "future"),
    Field(150, "utc_3", Kind.BYTE, "future"),
    Field(151, "ra_drive_status_1", Kind.BYTE, "future"),
    Field(152, "ra_drive_status_2", Kind.BYTE, "future"),
    Field(153, "dec_drive_status_1", Kind.BYTE, "future"),
    Field(154, "dec_drive_status_2", Kind.BYTE, "future"),
    Field(155, "ack_abort", Kind.FLAG, "abort acknowledged"),
    Field(156, "ack_sync", Kind.FLAG, "sync acknowledged"),
    Field(157, "ack_pulse_guide", Kind.FLAG, "pulse guide acknowledged"),
    Field(158, "ack_slew", Kind.FLAG, "slew acknowledged"),
    Field(159, "spare", Kind.BYTE, "unused"),
)

_PACKED = {Kind.FLAG: "B", Kind.HEADER: "8s"}
_UNPACKED = {Kind.EITHER: "q", Kind.HEADER: "8s"}


def _codec(fields: tuple[Field, ...], length: int, codes: dict[Kind, str]) -> struct.Struct:
    codec = struct.Struct("<" + "".join(codes.get(f.kind, f.kind.value) for f in fields))
    if codec.size != length:
        raise AssertionError(f"the table packs to {codec.size} bytes, not {length}")
    return codec


_COMMAND = _codec(COMMAND_FIELDS, COMMAND_LENGTH, _PACKED)
_COMMAND_READ = _codec(COMMAND_FIELDS, COMMAND_LENGTH, _UNPACKED)
_STATUS = _codec(STATUS_FIELDS, STATUS_LENGTH, _PACKED)
_STATUS_READ = _codec(STATUS_FIELDS, STATUS_LENGTH, _UNPACKED)
_ABORT_AT = next(one.offset for one in COMMAND_FIELDS if one.name == "abort")
_INT64 = struct.Struct("<q")
_DOUBLE = struct.Struct("<d")
_LARGEST_INTEGER = 2**53


class DatagramError(ValueError):
    """The bytes are no such datagram: wrong length or wrong header."""


class Command(msgspec.Struct, frozen=True, gc=False):
    """What one command datagram says; names, units and meanings are those of `COMMAND_FIELDS`."""

    counter: int = 0
    target_dec_deg: float = 0.0
    target_ra_h: float = 0.0
    move_dec_rate_deg_s: float = 0.0
    move_ra_rate_deg_s: float = 0.0
    dec_fine_rate_dtics_s: int = 0
    ra_fine_rate_dtics_s: int = 0
    pulse_ra_ms: int = 0
    pulse_dec_ms: int = 0
    tracking_rate: int = 0
    abort: bool = False
    find_home: bool = False
    move_ra: bool = False
    move_dec: bool = False
    park: bool = False
    pulse_guide: bool = False
    slew: bool = False
    sync: bool = False
    spare: bool = False


def reading_of(raw: bytes) -> Reading | None:
    """Tell whether eight bytes hold an int64 or a double; None for zero, which is the same in both."""
    value = _INT64.unpack(raw)[0]
    if value == 0:
        return None
    return "int64" if -_LARGEST_INTEGER < value < _LARGEST_INTEGER else "double"


def _double_of(integer: int) -> float:
    """Return the double that the same eight bytes hold."""
    number: float = _DOUBLE.unpack(_INT64.pack(integer))[0]
    return number


def _check(data: bytes, length: int, what: str) -> None:
    if len(data) != length:
        raise DatagramError(f"a {what} datagram has {length} bytes, this one has {len(data)}")


def _check_status_header(header: bytes) -> None:
    if header != STATUS_HEADER:
        raise DatagramError(f"a status datagram begins with XERXESxx, not {header!r}")


def _indices(fields: tuple[Field, ...], kind: Kind) -> tuple[int, ...]:
    return tuple(i for i, f in enumerate(fields) if f.kind is kind)


_COMMAND_FLAGS = _indices(COMMAND_FIELDS, Kind.FLAG)
_STATUS_FLAGS = _indices(STATUS_FIELDS, Kind.FLAG)
_STATUS_EITHERS = _indices(STATUS_FIELDS, Kind.EITHER)
DOUBTFUL = tuple(STATUS_FIELDS[i].name for i in _STATUS_EITHERS)
"""The fields whose type the paper leaves open."""
APPENDIX_A = Readings("int64", "int64", "int64", "double", "double")
_COUNTER = next(i for i, f in enumerate(STATUS_FIELDS) if f.name == "counter")


def sets_going(datagram: bytes) -> bool:
    """Tell whether a command datagram has a flag up that is not an abort's."""
    return any(datagram[_ABORT_AT + 1 : COMMAND_LENGTH])


def encode_command(command: Command) -> bytes:
    """Pack a command into its 82 bytes. Raises struct.error where a value does not fit its field."""
    values = [COMMAND_HEADER, *msgspec.structs.astuple(command)]
    for i in _COMMAND_FLAGS:
        values[i] = TRUE_BYTE if values[i] else 0
    return _COMMAND.pack(*values)


def decode_command(data: bytes) -> Command:
    """Unpack 82 bytes. Raises DatagramError for a wrong length or header."""
    _check(data, COMMAND_LENGTH, "command")
    header, *values = _COMMAND_READ.unpack(data)
    if header != COMMAND_HEADER:
        raise DatagramError(f"a command datagram begins with 0x{COMMAND_HEADER:X}, not 0x{header:X}")
    return Command(*values)


def encode_status(status: Status, readings: Readings | None = None) -> bytes:
    """Pack a status into its 160 bytes, the doubtful fields by `readings` (None: Appendix A's types)."""
    values = [STATUS_HEADER, *msgspec.structs.astuple(status)]
    for i in _STATUS_FLAGS:
        values[i] = TRUE_BYTE if values[i] else 0
    for i, name in zip(_STATUS_EITHERS, DOUBTFUL, strict=True):
        if (getattr(readings, name, None) or getattr(APPENDIX_A, name)) == "double":
            values[i] = _DOUBLE.pack(values[i])
        else:
            values[i] = _INT64.pack(round(values[i]))
    return _STATUS.pack(*values)


def decode_status(data: bytes) -> Status:
    """Unpack 160 bytes; doubtful fields by what their bits say. Raises DatagramError."""
    _check(data, STATUS_LENGTH, "status")
    values = list(_STATUS_READ.unpack(data))
    _check_status_header(values[0])
    for i in _STATUS_EITHERS:
        if not -_LARGEST_INTEGER < values[i] < _LARGEST_INTEGER:
            values[i] = _double_of(values[i])
    try:
        values[_COUNTER] = int(values[_COUNTER])
    except (ValueError, OverflowError) as error:
        raise DatagramError(f"the rolling counter is no number: {error}") from error
    return Status(*values[1:])


def status_readings(data: bytes) -> Readings:
    """Tell which type each doubtful field of a status has. Raises DatagramError as decode_status does."""
    _check(data, STATUS_LENGTH, "status")
    _check_status_header(data[:8])
    offsets = (STATUS_FIELDS[i].offset for i in _STATUS_EITHERS)
    return Readings(*(reading_of(data[o : o + 8]) for o in offsets))
