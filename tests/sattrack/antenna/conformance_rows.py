# ruff: noqa: E501 - what goes over the line is as long as it is
"""The paper's sections as rows: what is sent when, and what comes back, in literal bytes.

Each row states in our words what a sentence of "Ideal Field System Antenna Interface" asks for, or what
docs/antenna-interface.md makes of it. Instants are seconds after 2026-10-02T12:00:00Z. The antenna stands
still at 30° and 40°; its first axis turns from -200° to 200°.
"""

from __future__ import annotations

from typing import NamedTuple


class Step(NamedTuple):
    at_s: float
    sent: bytes
    received: bytes


class Row(NamedTuple):
    section: str
    claim: str
    steps: tuple[Step, ...]
    local: bool = False
    on_a_line: bool = True
    """False where only bytes that come at once can show it."""


ROWS = (
    Row(
        "3.0",
        "a message ends in a blank, two hexadecimal digits of its sum, and a line-feed",
        (
            Step(
                0,
                b"PS C3\n",
                b"PS ,, ,, 30.00000000 40.00000000 ,, ,, 0.0000000000 0.0000000000 ,, 0 43200.000000 REMOTE IDLE 1B\n",
            ),
        ),
    ),
    Row(
        "3.0",
        "the digits may be in lower case",
        (
            Step(
                0,
                b"PS c3\n",
                b"PS ,, ,, 30.00000000 40.00000000 ,, ,, 0.0000000000 0.0000000000 ,, 0 43200.000000 REMOTE IDLE 1B\n",
            ),
        ),
    ),
    Row(
        "3.0",
        "a wrong check is refused",
        (Step(0, b"PS C4\n", b"PS NAK 1 0E\n"),),
    ),
    Row(
        "3.0",
        "the trailing blank belongs to the message",
        (Step(0, b"PSA3\n", b"?? NAK 1 E9\n"),),
    ),
    Row(
        "3.0",
        "only printable characters are in a message",
        (Step(0, b"P\x07S CA\n", b"?? NAK 1 E9\n"),),
    ),
    Row(
        "3.0",
        "there is no software handshake: X-off is one more unprintable character",
        (
            Step(0, b"PS \x13D6\n", b"PS NAK 1 0E\n"),
            Step(
                0,
                b"PS C3\n",
                b"PS ,, ,, 30.00000000 40.00000000 ,, ,, 0.0000000000 0.0000000000 ,, 0 43200.000000 REMOTE IDLE 1B\n",
            ),
        ),
    ),
    Row(
        "3.0",
        "a parity error, which the port hands on as a zero byte, is a transmission error",
        (Step(0, b"T\x00 12.5 45.25 4F\n", b"?? NAK 1 E9\n"),),
    ),
    Row(
        "3.0",
        "synchronisation flushes what has come of a line",
        (
            Step(
                0,
                b"TD 1 2 3#PS C3\n",
                b"PS ,, ,, 30.00000000 40.00000000 ,, ,, 0.0000000000 0.0000000000 ,, 0 43200.000000 REMOTE IDLE 1B\n",
            ),
        ),
    ),
    Row(
        "3.0",
        "one synchronisation suffices after any garbage",
        (
            Step(
                0,
                b"\xff\x00garbage\r ,,,TD TD 99\xff\x00garbage\r ,,,TD TD 99\xff\x00garbage\r ,,,TD TD 99\xff\x00garbage\r ,,,TD TD 99\xff\x00garbage\r ,,,TD TD 99\xff\x00garbage\r ,,,TD TD 99\xff\x00garbage\r ,,,TD TD 99\xff\x00garbage\r ,,,TD TD 99\xff\x00garbage\r ,,,TD TD 99#PS C3\n",
                b"PS ,, ,, 30.00000000 40.00000000 ,, ,, 0.0000000000 0.0000000000 ,, 0 43200.000000 REMOTE IDLE 1B\n",
            ),
        ),
    ),
    Row(
        "3.0",
        "synchronisation stops output that has been generated",
        (Step(0, b"PS C3\n#", b""),),
        on_a_line=False,
    ),
    Row(
        "3.0",
        "synchronisation itself is not answered: the controller waits for the next character",
        (Step(0, b"#", b""),),
    ),
    Row(
        "3.0",
        "nothing is echoed",
        (Step(0, b"TD 12", b""),),
    ),
    Row(
        "4.0",
        "nothing is sent but in response",
        (
            Step(0, b"", b""),
            Step(5, b"", b""),
        ),
    ),
    Row(
        "4.0",
        "each command has one response, in order",
        (
            Step(
                0,
                b"PS C3\nTIME 4F\nPS C3\n",
                b"PS ,, ,, 30.00000000 40.00000000 ,, ,, 0.0000000000 0.0000000000 ,, 0 43200.000000 REMOTE IDLE 1B\nTIME 20728 43200.000000 D9\nPS ,, ,, 30.00000000 40.00000000 ,, ,, 0.0000000000 0.0000000000 ,, 0 43200.000000 REMOTE IDLE 1B\n",
            ),
        ),
    ),
    Row(
        "4.0",
        "an empty line is no command",
        (Step(0, b"\n\n\n", b""),),
    ),
    Row(
        "4.0",
        "the response does not wait for the action",
        (
            Step(0, b"TD -120 10 19\n", b"TD ACK A7\n"),
            Step(
                0,
                b"PS C3\n",
                b"PS -120.00000000 10.00000000 30.00000000 40.00000000 0.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 43200.000000 REMOTE SLEWING 87\n",
            ),
        ),
    ),
    Row(
        "4.0",
        "a command that is not known is refused",
        (Step(0, b"FLY 1 2 AE\n", b"?? NAK 3 EB\n"),),
    ),
    Row(
        "4.0",
        "commands are in upper case",
        (Step(0, b"td 10 20 FB\n", b"?? NAK 3 EB\n"),),
    ),
    Row(
        "4.0",
        "in local, commands to the antenna are not acted on",
        (
            Step(0, b"TD 10 20 BB\n", b"TD NAK 8 0A\n"),
            Step(
                0,
                b"PS C3\n",
                b"PS ,, ,, 30.00000000 40.00000000 ,, ,, 0.0000000000 0.0000000000 ,, 0 43200.000000 LOCAL IDLE BA\n",
            ),
        ),
        local=True,
    ),
    Row(
        "4.0",
        "in local, STOP is refused",
        (Step(0, b"STOP 66\n", b"STOP NAK 8 B8\n"),),
        local=True,
    ),
    Row(
        "4.0",
        "in local, STOW is refused",
        (Step(0, b"STOW 6D\n", b"STOW NAK 8 BF\n"),),
        local=True,
    ),
    Row(
        "4.0",
        "in local, UNSTOW is refused",
        (Step(0, b"UNSTOW 10\n", b"UNSTOW NAK 8 62\n"),),
        local=True,
    ),
    Row(
        "4.0",
        "in local, SERVICE is refused",
        (Step(0, b"SERVICE 31\n", b"SERVICE NAK 8 83\n"),),
        local=True,
    ),
    Row(
        "4.0",
        "in local, RESET is refused",
        (Step(0, b"RESET A3\n", b"RESET NAK 8 F5\n"),),
        local=True,
    ),
    Row(
        "4.0",
        "in local, FIXED is refused",
        (Step(0, b"FIXED 1 2 33\n", b"FIXED NAK 8 E2\n"),),
        local=True,
    ),
    Row(
        "4.0",
        "in local, RADEC is refused",
        (Step(0, b"RADEC DATE 10 20 C0\n", b"RADEC NAK 8 D1\n"),),
        local=True,
    ),
    Row(
        "4.0",
        "in local, FIXSKY is refused",
        (Step(0, b"FIXSKY J2000 10 20 2D\n", b"FIXSKY NAK 8 50\n"),),
        local=True,
    ),
    Row(
        "4.0",
        "in local, OFFSET is refused",
        (Step(0, b"OFFSET AZEL 1 1 D5\n", b"OFFSET NAK 8 39\n"),),
        local=True,
    ),
    Row(
        "4.0",
        "in local, SAT is refused",
        (Step(0, b"SAT 25544 2C\n", b"SAT NAK 8 5A\n"),),
        local=True,
    ),
    Row(
        "4.0",
        "in local, SATOFF is refused",
        (Step(0, b"SATOFF 1 0 84\n", b"SATOFF NAK 8 35\n"),),
        local=True,
    ),
    Row(
        "4.0",
        "in local, FOCUS is refused",
        (Step(0, b"FOCUS 1 F1\n", b"FOCUS NAK 8 F2\n"),),
        local=True,
    ),
    Row(
        "4.0",
        "in local, FOCSTOP is refused",
        (Step(0, b"FOCSTOP 3E\n", b"FOCSTOP NAK 8 90\n"),),
        local=True,
    ),
    Row(
        "4.0",
        "in local, FOCSWEEP is refused",
        (Step(0, b"FOCSWEEP 1 1 1E\n", b"FOCSWEEP NAK 8 CE\n"),),
        local=True,
    ),
    Row(
        "4.0",
        "in local, POINTING is refused",
        (Step(0, b"POINTING 0 0 0 0 0 0 68\n", b"POINTING NAK 8 DA\n"),),
        local=True,
    ),
    Row(
        "4.0",
        "in local, PINS is refused",
        (Step(0, b"PINS IN 11\n", b"PINS NAK 8 AC\n"),),
        local=True,
    ),
    Row(
        "4.0",
        "in local, BRAKES is refused",
        (Step(0, b"BRAKES SET E4\n", b"BRAKES NAK 8 2A\n"),),
        local=True,
    ),
    Row(
        "4.0",
        "in local, what merely asks is answered",
        (
            Step(0, b"STATUS 04\n", b"STATUS LOCAL IDLE LINK-UP OK 0 0 47\n"),
            Step(0, b"TIME 4F\n", b"TIME 20728 43200.000000 D9\n"),
        ),
        local=True,
    ),
    Row(
        "4.1",
        "there are commands to stow and unstow",
        (
            Step(0, b"STOW 6D\n", b"STOW ACK 5C\n"),
            Step(
                1,
                b"PS C3\n",
                b"PS 0.00000000 89.00000000 30.00000000 40.00000000 0.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 43201.000000 REMOTE SLEWING 08\n",
            ),
            Step(2, b"STATUS 04\n", b"STATUS REMOTE STOW LINK-UP OK 0 0 D7\n"),
            Step(2, b"TD 1 2 5B\n", b"TD NAK 10 33\n"),
            Step(3, b"UNSTOW 10\n", b"UNSTOW ACK FF\n"),
            Step(4, b"TD 1 2 5B\n", b"TD ACK A7\n"),
        ),
    ),
    Row(
        "4.1",
        "there is a command for a service position",
        (
            Step(0, b"SERVICE 31\n", b"SERVICE ACK 20\n"),
            Step(
                1,
                b"PS C3\n",
                b"PS -45.00000000 10.00000000 30.00000000 40.00000000 0.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 43201.000000 REMOTE SLEWING 5E\n",
            ),
        ),
    ),
    Row(
        "4.1",
        "stow pins that the antenna does not have are told of",
        (
            Step(0, b"PINS IN 11\n", b"PINS NAK 9 AD\n"),
            Step(0, b"PINS UP 1F\n", b"PINS NAK 5 A9\n"),
        ),
    ),
    Row(
        "4.1",
        "brakes that the antenna does not have are told of",
        (Step(0, b"BRAKES RELEASE F9\n", b"BRAKES NAK 9 2B\n"),),
    ),
    Row(
        "4.1",
        "there is a stop",
        (
            Step(0, b"TD 1 2 5B\n", b"TD ACK A7\n"),
            Step(1, b"STOP 66\n", b"STOP ACK 55\n"),
            Step(
                2,
                b"PS C3\n",
                b"PS ,, ,, 30.00000000 40.00000000 ,, ,, 0.0000000000 0.0000000000 ,, 0 43202.000000 REMOTE IDLE 1D\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "a designation has two positions, two rates and an epoch",
        (
            Step(0, b"TD 12.5 45.25 0.004178075 -0.001 43200.5 C2\n", b"TD ACK A7\n"),
            Step(
                4,
                b"PS C3\n",
                b"PS 12.51462326 45.24650000 30.00000000 40.00000000 0.0041780750 -0.0010000000 0.0000000000 0.0000000000 0 0 43204.000000 REMOTE SLEWING B2\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "fields are separated by one or more blanks",
        (
            Step(0, b"TD   12.5    45.25  0.01 5B\n", b"TD ACK A7\n"),
            Step(
                10,
                b"PS C3\n",
                b"PS 12.60000000 45.25000000 30.00000000 40.00000000 0.0100000000 0.0000000000 0.0000000000 0.0000000000 0 0 43210.000000 REMOTE SLEWING 41\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "a field that is left out is two commas",
        (
            Step(0, b"TD 12.5 45.25 ,, 0.002 43200 ,, D5\n", b"TD ACK A7\n"),
            Step(
                10,
                b"PS C3\n",
                b"PS 12.50000000 45.27000000 30.00000000 40.00000000 0.0000000000 0.0020000000 0.0000000000 0.0000000000 0 0 43210.000000 REMOTE SLEWING 43\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "a position is not to be left out",
        (
            Step(0, b"TD 12.5 ,, 16\n", b"TD NAK 4 06\n"),
            Step(0, b"TD 12.5 9E\n", b"TD NAK 4 06\n"),
        ),
    ),
    Row(
        "4.1.1",
        "positions are degrees, and finer than an encoder of 2^26 tics",
        (
            Step(0, b"TD 12.50000536 45.25000537 49\n", b"TD ACK A7\n"),
            Step(
                0,
                b"PS C3\n",
                b"PS 12.50000536 45.25000537 30.00000000 40.00000000 0.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 43200.000000 REMOTE SLEWING 5B\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "sixteen digits are taken, and carried",
        (
            Step(0, b"TD 12.34567890123456 45.25 0.0041780123456789 0 43200 8E\n", b"TD ACK A7\n"),
            Step(
                1000,
                b"PS C3\n",
                b"PS 16.52369125 45.25000000 30.00000000 40.00000000 0.0041780123 0.0000000000 0.0000000000 0.0000000000 0 0 44200.000000 REMOTE SLEWING 79\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "rates extrapolate to times before the epoch too",
        (
            Step(0, b"TD 12.5 45.25 0.01 0 43210 05\n", b"TD ACK A7\n"),
            Step(
                0,
                b"PS C3\n",
                b"PS 12.40000000 45.25000000 30.00000000 40.00000000 0.0100000000 0.0000000000 0.0000000000 0.0000000000 0 0 43200.000000 REMOTE SLEWING 3E\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "an epoch counts to a microsecond",
        (
            Step(0, b"TD 12.5 45.25 1.0 0 43200.000001 23\n", b"TD ACK A7\n"),
            Step(
                1,
                b"PS C3\n",
                b"PS 13.49999900 45.25000000 30.00000000 40.00000000 1.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 43201.000000 REMOTE SLEWING 6D\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "a wrap may be commanded",
        (
            Step(0, b"TD -175 20 ,, ,, ,, 1 DD\n", b"TD ACK A7\n"),
            Step(
                0,
                b"PS C3\n",
                b"PS -175.00000000 20.00000000 30.00000000 40.00000000 0.0000000000 0.0000000000 0.0000000000 0.0000000000 1 0 43200.000000 REMOTE SLEWING 93\n",
            ),
            Step(1, b"TD -175 20 ,, ,, ,, 0 DC\n", b"TD ACK A7\n"),
            Step(
                1,
                b"PS C3\n",
                b"PS -175.00000000 20.00000000 30.00000000 40.00000000 0.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 43201.000000 REMOTE SLEWING 93\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "the wrap of the shortest motion may be asked for: from 30, 185 is nearer than -175",
        (
            Step(0, b"TD -175 20 ,, ,, ,, S FF\n", b"TD ACK A7\n"),
            Step(
                0,
                b"PS C3\n",
                b"PS -175.00000000 20.00000000 30.00000000 40.00000000 0.0000000000 0.0000000000 0.0000000000 0.0000000000 1 0 43200.000000 REMOTE SLEWING 93\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "the shortest way stays within the limits: 210 is beyond them, -150 is not",
        (
            Step(0, b"TD 210 20 ED\n", b"TD ACK A7\n"),
            Step(
                0,
                b"PS C3\n",
                b"PS -150.00000000 20.00000000 30.00000000 40.00000000 0.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 43200.000000 REMOTE SLEWING 8B\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "a plunged position is one beyond 90",
        (
            Step(0, b"TD 10 95.5 2A\n", b"TD ACK A7\n"),
            Step(
                0,
                b"PS C3\n",
                b"PS 10.00000000 95.50000000 30.00000000 40.00000000 0.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 43200.000000 REMOTE SLEWING 3A\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "in the last 100 s of a day, its first 100 s are those of the next",
        (
            Step(43150, b"TD 10 20 1.0 0 40 3E\n", b"TD ACK A7\n"),
            Step(
                43150,
                b"PS C3\n",
                b"PS -80.00000000 20.00000000 30.00000000 40.00000000 1.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 86350.000000 REMOTE SLEWING 6B\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "in the first 100 s of a day, its last 100 s are those of the one before",
        (
            Step(43250, b"TD 10 20 1.0 0 86390 E4\n", b"TD ACK A7\n"),
            Step(
                43250,
                b"PS C3\n",
                b"PS 70.00000000 20.00000000 30.00000000 40.00000000 1.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 50.000000 REMOTE SLEWING 9C\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "outside of that window an epoch is of this day, and one a day off is refused",
        (
            Step(43301, b"TD 10 20 1.0 0 86390 E4\n", b"TD NAK 7 09\n"),
            Step(43099, b"TD 10 20 1.0 0 40 3E\n", b"TD NAK 7 09\n"),
        ),
    ),
    Row(
        "4.1.1",
        "without an epoch the line-feed's arrival is it",
        (
            Step(7.25, b"TD 10 20 0.5 0 BE\n", b"TD ACK A7\n"),
            Step(
                9.25,
                b"PS C3\n",
                b"PS 11.00000000 20.00000000 30.00000000 40.00000000 0.5000000000 0.0000000000 0.0000000000 0.0000000000 0 0 43209.250000 REMOTE SLEWING 3F\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "what is accepted is in force at once, and what was before is ignored",
        (
            Step(0, b"TD 10 20 0.5 0 BE\n", b"TD ACK A7\n"),
            Step(1, b"TD 20 30 BD\n", b"TD ACK A7\n"),
            Step(
                1,
                b"PS C3\n",
                b"PS 20.00000000 30.00000000 30.00000000 40.00000000 0.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 43201.000000 REMOTE SLEWING 2C\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "what is refused says why, and leaves the last correct one in force: too many fields",
        (
            Step(0, b"TD 10 20 BB\n", b"TD ACK A7\n"),
            Step(1, b"TD 99 88 0.1 0 43200 S 1 B6\n", b"TD NAK 4 06\n"),
            Step(
                1,
                b"PS C3\n",
                b"PS 10.00000000 20.00000000 30.00000000 40.00000000 0.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 43201.000000 REMOTE SLEWING 2A\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "what is refused says why, and leaves the last correct one in force: a word for a number",
        (
            Step(0, b"TD 10 20 BB\n", b"TD ACK A7\n"),
            Step(1, b"TD 99 x E2\n", b"TD NAK 5 07\n"),
            Step(
                1,
                b"PS C3\n",
                b"PS 10.00000000 20.00000000 30.00000000 40.00000000 0.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 43201.000000 REMOTE SLEWING 2A\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "what is refused says why, and leaves the last correct one in force: a number too great",
        (
            Step(0, b"TD 10 20 BB\n", b"TD ACK A7\n"),
            Step(1, b"TD 99 1e400 94\n", b"TD NAK 6 08\n"),
            Step(
                1,
                b"PS C3\n",
                b"PS 10.00000000 20.00000000 30.00000000 40.00000000 0.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 43201.000000 REMOTE SLEWING 2A\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "what is refused says why, and leaves the last correct one in force: not a number",
        (
            Step(0, b"TD 10 20 BB\n", b"TD ACK A7\n"),
            Step(1, b"TD 99 nan A7\n", b"TD NAK 5 07\n"),
            Step(
                1,
                b"PS C3\n",
                b"PS 10.00000000 20.00000000 30.00000000 40.00000000 0.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 43201.000000 REMOTE SLEWING 2A\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "what is refused says why, and leaves the last correct one in force: infinity",
        (
            Step(0, b"TD 10 20 BB\n", b"TD ACK A7\n"),
            Step(1, b"TD 99 inf A7\n", b"TD NAK 5 07\n"),
            Step(
                1,
                b"PS C3\n",
                b"PS 10.00000000 20.00000000 30.00000000 40.00000000 0.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 43201.000000 REMOTE SLEWING 2A\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "what is refused says why, and leaves the last correct one in force: another base",
        (
            Step(0, b"TD 10 20 BB\n", b"TD ACK A7\n"),
            Step(1, b"TD 99 0x10 73\n", b"TD NAK 5 07\n"),
            Step(
                1,
                b"PS C3\n",
                b"PS 10.00000000 20.00000000 30.00000000 40.00000000 0.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 43201.000000 REMOTE SLEWING 2A\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "what is refused says why, and leaves the last correct one in force: an underscore",
        (
            Step(0, b"TD 10 20 BB\n", b"TD ACK A7\n"),
            Step(1, b"TD 99 1_0 2A\n", b"TD NAK 5 07\n"),
            Step(
                1,
                b"PS C3\n",
                b"PS 10.00000000 20.00000000 30.00000000 40.00000000 0.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 43201.000000 REMOTE SLEWING 2A\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "what is refused says why, and leaves the last correct one in force: no second of a day",
        (
            Step(0, b"TD 10 20 BB\n", b"TD ACK A7\n"),
            Step(1, b"TD 99 88 0.1 0 86401.5 5F\n", b"TD NAK 6 08\n"),
            Step(
                1,
                b"PS C3\n",
                b"PS 10.00000000 20.00000000 30.00000000 40.00000000 0.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 43201.000000 REMOTE SLEWING 2A\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "what is refused says why, and leaves the last correct one in force: an epoch before midnight",
        (
            Step(0, b"TD 10 20 BB\n", b"TD ACK A7\n"),
            Step(1, b"TD 99 88 0.1 0 -1 57\n", b"TD NAK 6 08\n"),
            Step(
                1,
                b"PS C3\n",
                b"PS 10.00000000 20.00000000 30.00000000 40.00000000 0.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 43201.000000 REMOTE SLEWING 2A\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "what is refused says why, and leaves the last correct one in force: no wrap",
        (
            Step(0, b"TD 10 20 BB\n", b"TD ACK A7\n"),
            Step(1, b"TD 99 88 ,, ,, ,, T B6\n", b"TD NAK 5 07\n"),
            Step(
                1,
                b"PS C3\n",
                b"PS 10.00000000 20.00000000 30.00000000 40.00000000 0.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 43201.000000 REMOTE SLEWING 2A\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "what is refused says why, and leaves the last correct one in force: part of a wrap",
        (
            Step(0, b"TD 10 20 BB\n", b"TD ACK A7\n"),
            Step(1, b"TD 99 88 ,, ,, ,, 1.5 F6\n", b"TD NAK 5 07\n"),
            Step(
                1,
                b"PS C3\n",
                b"PS 10.00000000 20.00000000 30.00000000 40.00000000 0.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 43201.000000 REMOTE SLEWING 2A\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "what is refused says why, and leaves the last correct one in force: an epoch hours off",
        (
            Step(0, b"TD 10 20 BB\n", b"TD ACK A7\n"),
            Step(1, b"TD 99 88 0.1 0 30000 EC\n", b"TD NAK 7 09\n"),
            Step(
                1,
                b"PS C3\n",
                b"PS 10.00000000 20.00000000 30.00000000 40.00000000 0.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 43201.000000 REMOTE SLEWING 2A\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "what is refused says why, and leaves the last correct one in force: a rate out of range",
        (
            Step(0, b"TD 10 20 BB\n", b"TD ACK A7\n"),
            Step(1, b"TD 99 88 101 8C\n", b"TD NAK 6 08\n"),
            Step(
                1,
                b"PS C3\n",
                b"PS 10.00000000 20.00000000 30.00000000 40.00000000 0.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 43201.000000 REMOTE SLEWING 2A\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "what is refused says why, and leaves the last correct one in force: a comma for a blank",
        (
            Step(0, b"TD 10 20 BB\n", b"TD ACK A7\n"),
            Step(1, b"TD 99,88 E6\n", b"TD NAK 5 07\n"),
            Step(
                1,
                b"PS C3\n",
                b"PS 10.00000000 20.00000000 30.00000000 40.00000000 0.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 43201.000000 REMOTE SLEWING 2A\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "a transmission error leaves the last correct one in force",
        (
            Step(0, b"TD 10 20 BB\n", b"TD ACK A7\n"),
            Step(1, b"TD 10 20.5 00\n", b"TD NAK 1 03\n"),
            Step(
                1,
                b"PS C3\n",
                b"PS 10.00000000 20.00000000 30.00000000 40.00000000 0.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 43201.000000 REMOTE SLEWING 2A\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "a line too long is refused",
        (
            Step(
                0,
                b"TD 1000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000 00\n",
                b"TD NAK 2 04\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "a trajectory outside the limits is no reason to refuse",
        (
            Step(0, b"TD 10 -80 EE\n", b"TD ACK A7\n"),
            Step(
                0,
                b"PS C3\n",
                b"PS 10.00000000 -80.00000000 30.00000000 40.00000000 0.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 43200.000000 REMOTE SLEWING 5C\n",
            ),
        ),
    ),
    Row(
        "4.1.2",
        "position status has commanded and actual position, epoch, mode and servo",
        (
            Step(0, b"TD 30 40 BF\n", b"TD ACK A7\n"),
            Step(
                0.5,
                b"PS C3\n",
                b"PS 30.00000000 40.00000000 30.00000000 40.00000000 0.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 43200.500000 REMOTE TRACKING 6C\n",
            ),
        ),
    ),
    Row(
        "4.1.2",
        "commanded is the trajectory at the epoch told",
        (
            Step(0, b"TD 10 20 0.25 -0.125 43200 FC\n", b"TD ACK A7\n"),
            Step(
                3.123456,
                b"PS C3\n",
                b"PS 10.78086400 19.60956800 30.00000000 40.00000000 0.2500000000 -0.1250000000 0.0000000000 0.0000000000 0 0 43203.123456 REMOTE SLEWING C8\n",
            ),
        ),
    ),
    Row(
        "4.1.2",
        "without a trajectory the commanded fields are left out",
        (
            Step(
                0,
                b"PS C3\n",
                b"PS ,, ,, 30.00000000 40.00000000 ,, ,, 0.0000000000 0.0000000000 ,, 0 43200.000000 REMOTE IDLE 1B\n",
            ),
        ),
    ),
    Row(
        "5.0",
        "monitoring alone commands nothing",
        (
            Step(
                0,
                b"PS C3\n",
                b"PS ,, ,, 30.00000000 40.00000000 ,, ,, 0.0000000000 0.0000000000 ,, 0 43200.000000 REMOTE IDLE 1B\n",
            ),
            Step(
                1,
                b"PS C3\n",
                b"PS ,, ,, 30.00000000 40.00000000 ,, ,, 0.0000000000 0.0000000000 ,, 0 43201.000000 REMOTE IDLE 1C\n",
            ),
            Step(
                2,
                b"PS C3\n",
                b"PS ,, ,, 30.00000000 40.00000000 ,, ,, 0.0000000000 0.0000000000 ,, 0 43202.000000 REMOTE IDLE 1D\n",
            ),
            Step(
                3,
                b"PS C3\n",
                b"PS ,, ,, 30.00000000 40.00000000 ,, ,, 0.0000000000 0.0000000000 ,, 0 43203.000000 REMOTE IDLE 1E\n",
            ),
        ),
    ),
    Row(
        "5.0",
        "successive designations make one trajectory",
        (
            Step(0, b"TD 10 20 0.004 0 43200 36\n", b"TD ACK A7\n"),
            Step(
                0,
                b"PS C3\n",
                b"PS 10.00000000 20.00000000 30.00000000 40.00000000 0.0040000000 0.0000000000 0.0000000000 0.0000000000 0 0 43200.000000 REMOTE SLEWING 2D\n",
            ),
            Step(1, b"TD 10.004 20.0001 0.0041 0 43201 19\n", b"TD ACK A7\n"),
            Step(
                1,
                b"PS C3\n",
                b"PS 10.00400000 20.00010000 30.00000000 40.00000000 0.0041000000 0.0000000000 0.0000000000 0.0000000000 0 0 43201.000000 REMOTE SLEWING 34\n",
            ),
        ),
    ),
    Row(
        "5.0",
        "a new source is designated like any other",
        (
            Step(0, b"TD 10 20 0.004 0 43200 36\n", b"TD ACK A7\n"),
            Step(1, b"TD -60 50 0.004 0 43201 6C\n", b"TD ACK A7\n"),
            Step(
                2,
                b"PS C3\n",
                b"PS -59.99600000 50.00000000 30.00000000 40.00000000 0.0040000000 0.0000000000 0.0000000000 0.0000000000 0 0 43202.000000 REMOTE SLEWING 84\n",
            ),
        ),
    ),
    Row(
        "5.0",
        "a fixed direction has rates of zero",
        (
            Step(0, b"TD 10 20 0 0 43200 74\n", b"TD ACK A7\n"),
            Step(
                600,
                b"PS C3\n",
                b"PS 10.00000000 20.00000000 30.00000000 40.00000000 0.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 43800.000000 REMOTE SLEWING 2F\n",
            ),
        ),
    ),
    Row(
        "5.0",
        "other commands come in between",
        (
            Step(0, b"TD 10 20 BB\n", b"TD ACK A7\n"),
            Step(0, b"STATUS 04\n", b"STATUS REMOTE FOLLOWING LINK-UP OK 0 0 3B\n"),
            Step(
                1,
                b"PS C3\n",
                b"PS 10.00000000 20.00000000 30.00000000 40.00000000 0.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 43201.000000 REMOTE SLEWING 2A\n",
            ),
        ),
    ),
    Row(
        "5.0",
        "sensors that the antenna does not have are told of",
        (Step(0, b"SENSORS 4D\n", b"SENSORS NAK 9 A0\n"),),
    ),
    Row(
        "6.0",
        "the focus is commanded in mm, without epoch or rate",
        (
            Step(0, b"FOCUS 5 ,, 6D\n", b"FOCUS ACK 8F\n"),
            Step(1, b"FOCPS 9B\n", b"FOCPS 5.0000 2.0000 0.0000 0.0000 43201.000000 MOVING F2\n"),
        ),
    ),
    Row(
        "6.0",
        "a flag tells that the focus has arrived",
        (
            Step(0, b"FOCUS ,, -3 98\n", b"FOCUS ACK 8F\n"),
            Step(10, b"FOCPS 9B\n", b"FOCPS 0.0000 0.0000 -3.0000 -3.0000 43210.000000 STOPPED 9A\n"),
        ),
    ),
    Row(
        "6.0",
        "the focus sweeps from limit to limit and back at a uniform rate",
        (
            Step(0, b"FOCSWEEP 1 10 4E\n", b"FOCSWEEP ACK 6B\n"),
            Step(3, b"FOCPS 9B\n", b"FOCPS ,, 30.0000 0.0000 0.0000 43203.000000 MOVING 5A\n"),
            Step(7, b"FOCPS 9B\n", b"FOCPS ,, 30.0000 0.0000 0.0000 43207.000000 MOVING 5E\n"),
            Step(16, b"FOCPS 9B\n", b"FOCPS ,, -40.0000 0.0000 0.0000 43216.000000 MOVING 8C\n"),
            Step(17, b"FOCSTOP 3E\n", b"FOCSTOP ACK 2D\n"),
            Step(30, b"FOCPS 9B\n", b"FOCPS -30.0000 -30.0000 0.0000 0.0000 43230.000000 STOPPED FC\n"),
        ),
    ),
    Row(
        "6.0",
        "an axis of the focus that is not there is told of",
        (
            Step(0, b"FOCUS 1 1 1 93\n", b"FOCUS NAK 9 F3\n"),
            Step(0, b"FOCSWEEP 3 1 20\n", b"FOCSWEEP NAK 9 CF\n"),
        ),
    ),
    Row(
        "7.0",
        "a fixed direction has a command of its own",
        (
            Step(0, b"FIXED 15 25 9D\n", b"FIXED ACK 7F\n"),
            Step(
                600,
                b"PS C3\n",
                b"PS 15.00000000 25.00000000 30.00000000 40.00000000 0.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 43800.000000 REMOTE SLEWING 39\n",
            ),
        ),
    ),
    Row(
        "7.0",
        "the controller tells its time, latched",
        (Step(1.5, b"TIME 4F\n", b"TIME 20728 43201.500000 DF\n"),),
    ),
    Row(
        "7.0",
        "time may be sent to the controller, while nothing is followed",
        (
            Step(0, b"TIME 20728 43200.25 20\n", b"TIME ACK 3E\n"),
            Step(0, b"TIME 20728 72\n", b"TIME NAK 4 9D\n"),
            Step(0, b"TIME 20727.5 43200 ED\n", b"TIME NAK 5 9E\n"),
            Step(0, b"TIME 20700 43200 81\n", b"TIME NAK 6 9F\n"),
            Step(0, b"TD 10 20 BB\n", b"TD ACK A7\n"),
            Step(0, b"TIME 20728 43200.25 20\n", b"TIME NAK 10 CA\n"),
        ),
    ),
    Row(
        "7.0",
        "in local, time is told and not set",
        (
            Step(0, b"TIME 4F\n", b"TIME 20728 43200.000000 D9\n"),
            Step(0, b"TIME 20728 43200.25 20\n", b"TIME NAK 8 A1\n"),
        ),
        local=True,
    ),
    Row(
        "7.0",
        "sources are commanded by coordinates of date or of J2000",
        (
            Step(0, b"RADEC DATE 200 20 F1\n", b"RADEC ACK 6E\n"),
            Step(0, b"RADEC J2000 200 20 DF\n", b"RADEC ACK 6E\n"),
            Step(0, b"RADEC B1950 200 20 E4\n", b"RADEC NAK 5 CE\n"),
            Step(0, b"RADEC DATE 200 95 FD\n", b"RADEC NAK 6 CF\n"),
        ),
    ),
    Row(
        "7.0",
        "offsets are commanded in three kinds of coordinates",
        (
            Step(0, b"OFFSET AZEL 0.1 0.1 91\n", b"OFFSET ACK D6\n"),
            Step(0, b"OFFSET HADEC 0.1 0.1 BA\n", b"OFFSET ACK D6\n"),
            Step(0, b"OFFSET RADEC 0.1 0.1 C4\n", b"OFFSET ACK D6\n"),
            Step(0, b"OFFSET XY 0.1 0.1 16\n", b"OFFSET NAK 5 36\n"),
        ),
    ),
    Row(
        "7.0",
        "a pointing model is sent",
        (
            Step(0, b"POINTING 0.1 0.1 0 0 0 0 26\n", b"POINTING ACK 77\n"),
            Step(0, b"POINTING 0.1 37\n", b"POINTING NAK 4 D6\n"),
        ),
    ),
    Row(
        "8.0",
        "elements come as lines, and are followed",
        (
            Step(0, b"TLE 0 25544 ISS (ZARYA) 80\n", b"TLE ACK F4\n"),
            Step(
                0,
                b"TLE 1 25544 1 25544U 98067A   26275.01380287  .00003738  00000+0  76743-4 0  9992 8B\n",
                b"TLE ACK F4\n",
            ),
            Step(
                0,
                b"TLE 2 25544 2 25544  51.6312 131.4121 0006946 211.9293 148.1275 15.48707684588318 D9\n",
                b"TLE ACK F4\n",
            ),
            Step(0, b"SAT 25544 2C\n", b"SAT ACK F7\n"),
        ),
    ),
    Row(
        "8.0",
        "a line with another number is refused",
        (
            Step(
                0,
                b"TLE 2 25544 1 25544U 98067A   26275.01380287  .00003738  00000+0  76743-4 0  9992 8C\n",
                b"TLE NAK 11 81\n",
            ),
        ),
    ),
    Row(
        "8.0",
        "a line of another satellite is refused",
        (
            Step(
                0,
                b"TLE 1 25545 1 25544U 98067A   26275.01380287  .00003738  00000+0  76743-4 0  9992 8C\n",
                b"TLE NAK 12 82\n",
            ),
        ),
    ),
    Row(
        "8.0",
        "a line whose own check-sum is wrong is refused",
        (
            Step(
                0,
                b"TLE 1 25544 1 25544U 98067A   26275.01380287  .00003738  00000+0  76743-4 0  9993 8C\n",
                b"TLE NAK 13 83\n",
            ),
            Step(
                0,
                b"TLE 1 25544 1 25544U 98067A   26275.01380287  .00003738  00000+0  76743-4 0  9 E7\n",
                b"TLE NAK 13 83\n",
            ),
        ),
    ),
    Row(
        "8.0",
        "no satellite without its elements",
        (
            Step(0, b"SAT 25544 2C\n", b"SAT NAK 15 88\n"),
            Step(
                0,
                b"TLE 1 25544 1 25544U 98067A   26275.01380287  .00003738  00000+0  76743-4 0  9992 8B\n",
                b"TLE ACK F4\n",
            ),
            Step(0, b"SAT 25544 2C\n", b"SAT NAK 15 88\n"),
            Step(
                0,
                b"TLE 2 25544 2 25544  51.6312 131.4121 0006946 211.9293 148.1275 15.48707684588318 D9\n",
                b"TLE ACK F4\n",
            ),
            Step(0, b"SAT 25545 2D\n", b"SAT NAK 12 85\n"),
        ),
    ),
    Row(
        "8.0",
        "biases are a separate command",
        (
            Step(0, b"SATOFF 1.5 -0.25 A9\n", b"SATOFF ACK D2\n"),
            Step(0, b"SATOFF 1.5 -0.25 HOLD F0\n", b"SATOFF ACK D2\n"),
            Step(0, b"SATOFF 1.5 97\n", b"SATOFF NAK 4 31\n"),
            Step(0, b"SATOFF 1.5 0 PARK 35\n", b"SATOFF NAK 5 32\n"),
        ),
    ),
)
