"""The two datagrams packed and unpacked from the paper alone, offset by offset; nothing of the codec is used.

Source: Van Deventer, "Xerxes Mount Control Protocol": the command table (82 bytes), the status table (160
bytes) and Appendix A, `PackDatagram` of 6/25/2019. `BitConverter.GetBytes` of a Double, Long and Int32 is
`struct`'s "<d", "<q" and "<i". Names are those of the paper's tables and of Appendix A's variables.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import Literal

TRUE = 0xFF
"""`Convert.ToByte(&HFF)`; the command table says "0=false, true = FF"."""
COMMAND_LENGTH = 82
STATUS_LENGTH = 160
DOUBTFUL = ("CurrentDecSpeed", "CurrentRASpeed", "MasterTicCount", "GuideRateDec", "GuideRateRA")
"""Variables whose type the table and the code tell differently, or only in a remark."""
IN_THE_CODE: dict[str, Literal["long", "double"]] = {
    "CurrentDecSpeed": "long",
    "CurrentRASpeed": "long",
    "MasterTicCount": "double",
    "GuideRateDec": "double",
    "GuideRateRA": "double",
}
"""What Appendix A's remarks and the table's rows say of them."""


@dataclass
class MountGlobals:
    """What Appendix A packs: "packs globals into a byte array and sends it"."""

    Alt: float = 0.0
    Az: float = 0.0
    CurrentDec: float = 0.0
    CurrentDecSpeed: float = 0
    CurrentRA: float = 0.0
    CurrentRASpeed: float = 0
    CurLST: float = 0.0
    Height: float = 0.0
    Latitude: float = 0.0
    Longitude: float = 0.0
    TargetDec: float = 0.0
    TargetRA: float = 0.0
    MasterTicCount: float = 0
    GuideRateDec: float = 0.0
    GuideRateRA: float = 0.0
    DecRawCurrent: int = 0
    RARawCurrent: int = 0
    IsRAPulseGuiding: bool = False
    IsDecPulseGuiding: bool = False
    BeyondPole: bool = False
    RASlewInProgress: bool = False
    DecSlewInProgress: bool = False
    AckMoveAxisDecCmd: bool = False
    AckMoveAxisRACmd: bool = False
    AckAbortCmd: bool = False
    AckSyncCmd: bool = False
    AckPulseGuideCmd: bool = False
    AckSlewCmd: bool = False
    types: dict[str, Literal["long", "double"]] = field(default_factory=lambda: dict(IN_THE_CODE))


def get_bytes(value: float, kind: Literal["long", "double"]) -> bytes:
    """`BitConverter.GetBytes` of a Long or a Double."""
    return struct.pack("<q", int(value)) if kind == "long" else struct.pack("<d", value)


def pack_datagram(g: MountGlobals) -> bytes:
    """Appendix A, statement by statement."""
    big = bytearray(160)
    big[0] = 88
    big[1] = 69
    big[2] = 82
    big[3] = 88
    big[4] = 69
    big[5] = 83
    big[6] = 120
    big[7] = 120
    big[8:16] = struct.pack("<d", g.Alt)
    big[16:24] = struct.pack("<d", g.Az)
    big[24:32] = struct.pack("<d", g.CurrentDec)
    big[32:40] = get_bytes(g.CurrentDecSpeed, g.types["CurrentDecSpeed"])
    big[40:48] = struct.pack("<d", g.CurrentRA)
    big[48:56] = get_bytes(g.CurrentRASpeed, g.types["CurrentRASpeed"])
    big[56:64] = struct.pack("<d", g.CurLST)
    big[64:72] = struct.pack("<d", g.Height)
    big[72:80] = struct.pack("<d", g.Latitude)
    big[80:88] = struct.pack("<d", g.Longitude)
    big[88:96] = struct.pack("<d", g.TargetDec)
    big[96:104] = struct.pack("<d", g.TargetRA)
    big[104:112] = get_bytes(g.MasterTicCount, g.types["MasterTicCount"])
    big[112:120] = get_bytes(g.GuideRateDec, g.types["GuideRateDec"])
    big[120:128] = get_bytes(g.GuideRateRA, g.types["GuideRateRA"])
    big[128:132] = struct.pack("<i", g.DecRawCurrent)
    big[132:136] = struct.pack("<i", g.RARawCurrent)
    big[136] = 0
    big[137] = 0
    big[138] = 0xFF
    big[139] = 0
    big[140] = 0
    big[141] = 0xFF if g.IsRAPulseGuiding or g.IsDecPulseGuiding else 0
    big[142] = 0xFF if g.BeyondPole else 0
    if g.RASlewInProgress or g.DecSlewInProgress:
        big[143] = 0xFF
        big[144] = 0
    else:
        big[143] = 0
        big[144] = 0xFF
    big[145] = 0
    big[146] = 0xFF if g.AckMoveAxisDecCmd else 0
    big[147] = 0xFF if g.AckMoveAxisRACmd else 0
    big[155] = 0xFF if g.AckAbortCmd else 0
    big[156] = 0xFF if g.AckSyncCmd else 0
    big[157] = 0xFF if g.AckPulseGuideCmd else 0
    big[158] = 0xFF if g.AckSlewCmd else 0
    return bytes(big)


@dataclass
class CommandRow:
    """What the command table holds, in its own names and units."""

    counter: int = 0
    TargetDec: float = 0.0
    TargetRA: float = 0.0
    MoveAxisRateDec: float = 0.0
    MoveAxisRateRA: float = 0.0
    DecFineRate: int = 0
    RAFineRate: int = 0
    PulseGuideRADuration: int = 0
    PulseGuideDecDuration: int = 0
    tracking_rate: int = 0
    AbortSlewCmd: bool = False
    FindHomeCmd: bool = False
    MoveAxisRA: bool = False
    MoveAxisDec: bool = False
    ParkCmd: bool = False
    PulseGuideCmd: bool = False
    SlewToTargetCmd: bool = False
    SyncToTargetCmd: bool = False
    spare: bool = False

    def up(self) -> frozenset[str]:
        """Names of the flags that are up."""
        return frozenset([name for name in FLAG_BYTES if getattr(self, name)])


FLAG_BYTES = {
    "AbortSlewCmd": 73,
    "FindHomeCmd": 74,
    "MoveAxisRA": 75,
    "MoveAxisDec": 76,
    "ParkCmd": 77,
    "PulseGuideCmd": 78,
    "SlewToTargetCmd": 79,
    "SyncToTargetCmd": 80,
    "spare": 81,
}


COMMAND_TABLE = struct.Struct("<QqddddqqiiB9B")
"""Header, then the rows as `CommandRow` has them: longs, doubles, two integers of 4 bytes, and bytes."""


def pack_command(row: CommandRow) -> bytes:
    """The command table, row by row."""
    data = bytearray(82)
    data[0:8] = struct.pack("<Q", 0x5555AAAA)
    data[8:16] = struct.pack("<q", row.counter)
    data[16:24] = struct.pack("<d", row.TargetDec)
    data[24:32] = struct.pack("<d", row.TargetRA)
    data[32:40] = struct.pack("<d", row.MoveAxisRateDec)
    data[40:48] = struct.pack("<d", row.MoveAxisRateRA)
    data[48:56] = struct.pack("<q", row.DecFineRate)
    data[56:64] = struct.pack("<q", row.RAFineRate)
    data[64:68] = struct.pack("<i", row.PulseGuideRADuration)
    data[68:72] = struct.pack("<i", row.PulseGuideDecDuration)
    data[72] = row.tracking_rate
    for name, offset in FLAG_BYTES.items():
        data[offset] = TRUE if getattr(row, name) else 0
    return bytes(data)


def unpack_command(data: bytes) -> CommandRow:
    """The command table read back; a datagram of another length or header raises ValueError."""
    if len(data) != COMMAND_LENGTH or struct.unpack_from("<Q", data, 0)[0] != 0x5555AAAA:
        raise ValueError("no command datagram")
    _, *values = COMMAND_TABLE.unpack(data)
    return CommandRow(*values[:10], *(byte != 0 for byte in values[10:]))
