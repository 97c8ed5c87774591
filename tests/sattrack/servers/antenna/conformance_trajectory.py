# ruff: noqa: E501 - what goes over the line is as long as it is
"""Rows of sections 4.1.1 and 4.1.2: trajectory designate and position status."""

from __future__ import annotations

from conformance_kinds import Row, Step

TRAJECTORY_ROWS = (
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
        "the shortest way stays within the limits: 205 is nearer, but beyond them; -155 is not",
        (
            Step(0, b"TD 205 20 F1\n", b"TD ACK A7\n"),
            Step(
                0,
                b"PS C3\n",
                b"PS -155.00000000 20.00000000 30.00000000 40.00000000 0.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 43200.000000 REMOTE SLEWING 90\n",
            ),
        ),
    ),
    Row(
        "4.1.1",
        "the shortest way leads to where the trajectory is by now, not at its epoch",
        (
            Step(0, b"TD 219 20 0.1 0 43400 10\n", b"TD ACK A7\n"),
            Step(
                0,
                b"PS C3\n",
                b"PS -161.00000000 20.00000000 30.00000000 40.00000000 0.1000000000 0.0000000000 0.0000000000 0.0000000000 1 0 43200.000000 REMOTE SLEWING 8F\n",
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
            Step(43101, b"TD 10 20 0.1 0 99 4C\n", b"TD ACK A7\n"),
            Step(
                43101,
                b"PS C3\n",
                b"PS -9.80000000 20.00000000 30.00000000 40.00000000 0.1000000000 0.0000000000 0.0000000000 0.0000000000 0 0 86301.000000 REMOTE SLEWING 40\n",
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
            Step(43299, b"TD 10 20 0.1 0 86301 DC\n", b"TD ACK A7\n"),
            Step(
                43299,
                b"PS C3\n",
                b"PS 29.80000000 20.00000000 30.00000000 40.00000000 0.1000000000 0.0000000000 0.0000000000 0.0000000000 0 0 99.000000 REMOTE SLEWING B5\n",
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
        "commanded is the trajectory at the epoch given",
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
)
