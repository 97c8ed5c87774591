"""Datagrams as literal bytes, from the tables of "Xerxes Mount Control Protocol", and captures of them.

A double is sign and exponent (1023 + power of two), then the bits after the leading one: 12.25 = 1.88₁₆ · 2³
is 40 28 80 00 00 00 00 00, the other way round on the wire.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

COMMAND_HEADER = "AA AA 55 55 00 00 00 00"
STATUS_HEADER = "58 45 52 58 45 53 78 78"
TRUE = "FF"

EMPTY_COMMAND = bytes.fromhex(COMMAND_HEADER) + bytes(74)
SLEW = bytes.fromhex(
    "AA AA 55 55 00 00 00 00"  # 0-7 CmdHeader
    "02 01 00 00 00 00 00 00"  # 8-15 rolling counter 258
    "00 00 00 00 00 80 28 40"  # 16-23 TargetDec 12.25
    "00 00 00 00 00 00 15 40"  # 24-31 TargetRA 5.25
    "00 00 00 00 00 00 00 00"  # 32-39 MoveAxisRateDec
    "00 00 00 00 00 00 00 00"  # 40-47 MoveAxisRateRA
    "00 00 00 00 00 00 00 00"  # 48-55 DecFineRate
    "00 00 00 00 00 00 00 00"  # 56-63 RAFineRate
    "00 00 00 00"  # 64-67 PulseGuideRADuration
    "00 00 00 00"  # 68-71 PulseGuideDecDuration
    "00 00 00 00 00 00 00"  # 72-78 tracking rate, abort, home, MoveAxis RA, MoveAxis Dec, park, pulse guide
    "FF"  # 79 SlewToTargetCmd
    "00 00"  # 80-81 SyncToTargetCmd, spare
)
MOVE = bytes.fromhex(
    "AA AA 55 55 00 00 00 00"  # 0-7 CmdHeader
    "03 01 00 00 00 00 00 00"  # 8-15 rolling counter 259
    "00 00 00 00 00 00 00 00"  # 16-23 TargetDec
    "00 00 00 00 00 00 00 00"  # 24-31 TargetRA
    "00 00 00 00 00 00 E8 BF"  # 32-39 MoveAxisRateDec -0.75
    "00 00 00 00 00 00 F4 3F"  # 40-47 MoveAxisRateRA 1.25
    "00 00 00 00 00 00 00 00"  # 48-55 DecFineRate
    "00 00 00 00 00 00 00 00"  # 56-63 RAFineRate
    "24 FA FF FF"  # 64-67 PulseGuideRADuration -1500
    "00 00 00 00"  # 68-71 PulseGuideDecDuration
    "00 00 00"  # 72-74 tracking rate, abort, home
    "FF FF"  # 75 MoveAxisRA, 76 MoveAxisDec
    "00 00 00 00 00"  # 77-81 park, pulse guide, slew, sync, spare
)
STATUS = bytes.fromhex(
    "58 45 52 58 45 53 78 78"  # 0-7 "XERXESxx"
    "00 00 00 00 00 40 4A 40"  # 8-15 Altitude 52.5
    "00 00 00 00 00 C8 68 40"  # 16-23 Azimuth 198.25
    "00 00 00 00 00 80 28 40"  # 24-31 Declination 12.25
    "88 FF FF FF FF FF FF FF"  # 32-39 DeclinationRate -120, as long
    "00 00 00 00 00 00 15 40"  # 40-47 RightAscension 5.25
    "6D 1E 00 00 00 00 00 00"  # 48-55 RightAscensionRate 7789, as long
    "00 00 00 00 00 00 19 40"  # 56-63 SiderealTime 6.25
    "00 00 00 00 00 C2 97 40"  # 64-71 SiteElevation 1520.5
    "00 00 00 00 00 10 48 40"  # 72-79 SiteLatitude 48.125
    "00 00 00 00 00 F0 5B C0"  # 80-87 SiteLongitude -111.75
    "00 00 00 00 00 80 28 40"  # 88-95 TargetDeclination 12.25
    "00 00 00 00 00 00 15 40"  # 96-103 TargetRightAscension 5.25
    "40 E2 01 00 00 00 00 00"  # 104-111 rolling counter 123456, as long
    "00 00 00 00 00 58 AB 40"  # 112-119 GuideRateDeclination 3500, as double
    "00 00 00 00 00 58 AB 40"  # 120-127 GuideRateRA 3500, as double
    "6A FF FF FF"  # 128-131 DecRawCurrent -150
    "C8 00 00 00"  # 132-135 RARawCurrent 200
    "00 00 FF 00 00 00 00"  # 136-142 home, park, connected, refraction, system, pulse guiding, side of pier
    "FF"  # 143 Slewing
    "00 00"  # 144-145 Tracking, TrackingRate
    "00 00"  # 146-147 AckMoveAxisDec, AckMoveAxisRA
    "00 00 00 00 00 00 00"  # 148-154 future
    "00 00 00"  # 155-157 AckAbortCmd, AckSyncCmd, AckPulseGuideCmd
    "FF"  # 158 AckSlewCmd
    "00"  # 159 spare
)
RATE_AS_DOUBLE = "00 00 00 00 00 6D BE 40"  # 7789 = 1.E6D₁₆ · 2¹²
COUNTER_AS_DOUBLE = "00 00 00 00 00 24 FE 40"  # 123456 = 1.E240₁₆ · 2¹⁶
NAN = "00 00 00 00 00 00 F8 7F"
MOUNT, CLIENT, STRANGER = "192.0.2.7", "192.0.2.1", "192.0.2.99"
PORT = 15001


def put(data: bytes, *changes: tuple[int, str]) -> bytes:
    """Some bytes replaced, each change by its first byte and hexadecimal digits."""
    changed = bytearray(data)
    for offset, digits in changes:
        raw = bytes.fromhex(digits)
        changed[offset : offset + len(raw)] = raw
    return bytes(changed)


class Frame(NamedTuple):
    """One datagram of a capture, when and between whom."""

    data: bytes
    src: str = CLIENT
    dst: str = MOUNT
    at_s: float = 0.0
    src_port: int = PORT
    dst_port: int = PORT


def capture(frames: list[Frame]) -> bytes:
    """A pcap file of raw IPv4 packets (link type 101), microseconds, little-endian."""
    parts = [struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 101)]
    for frame in frames:
        udp = struct.pack(">HHHH", frame.src_port, frame.dst_port, 8 + len(frame.data), 0) + frame.data
        addresses = b"".join(bytes(int(part) for part in host.split(".")) for host in (frame.src, frame.dst))
        packet = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(udp), 0, 0, 64, 17, 0) + addresses + udp
        microseconds = round(frame.at_s * 1e6)
        parts.append(
            struct.pack("<IIII", microseconds // 10**6, microseconds % 10**6, len(packet), len(packet))
            + packet
        )
    return b"".join(parts)
