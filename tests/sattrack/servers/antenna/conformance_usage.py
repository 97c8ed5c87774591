# ruff: noqa: E501 - what goes over the line is as long as it is
"""Rows of sections 5.0 to 8.0: usage, focus, the alternative method, elements."""

from __future__ import annotations

from conformance_kinds import Row, Step

USAGE_ROWS = (
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
        "status in detail tells why something was refused last",
        (
            Step(0, b"TD 99 x E2\n", b"TD NAK 5 07\n"),
            Step(0, b"STATUS 04\n", b"STATUS REMOTE IDLE LINK-UP OK 0 5 AD\n"),
            Step(0, b"SENSORS 4D\n", b"SENSORS NAK 9 A0\n"),
            Step(0, b"STATUS 04\n", b"STATUS REMOTE IDLE LINK-UP OK 0 9 B1\n"),
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
        "sensors that the antenna does not have are reported as missing",
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
        "a place that the focus does not reach is refused, and no axis moves",
        (
            Step(0, b"FOCUS 60 0 76\n", b"FOCUS NAK 6 F0\n"),
            Step(0, b"FOCUS 5 -50.1 06\n", b"FOCUS NAK 6 F0\n"),
            Step(1, b"FOCPS 9B\n", b"FOCPS 0.0000 0.0000 0.0000 0.0000 43201.000000 STOPPED 3A\n"),
            Step(2, b"FOCUS 50 -50 D7\n", b"FOCUS ACK 8F\n"),
        ),
    ),
    Row(
        "6.0",
        "an axis of the focus that is not there is reported as missing",
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
        "in local, time is sent and not set",
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
        "a value of the elements is refused as it comes, where it is none",
        (
            Step(0, b"OMM 25544 MEAN_MOTION 15.48707684 03\n", b"OMM ACK F8\n"),
            Step(0, b"OMM 25544 MEAN_MOTION nan 00\n", b"OMM NAK 5 58\n"),
            Step(0, b"OMM 25544 EPOCH tomorrow 65\n", b"OMM NAK 5 58\n"),
            Step(0, b"OMM 25544 INCLINATION 200 37\n", b"OMM NAK 6 59\n"),
            Step(0, b"OMM 25544 COLOUR red 7C\n", b"OMM NAK 5 58\n"),
            Step(0, b"OMM 25544 NORAD_CAT_ID 25545 09\n", b"OMM NAK 12 86\n"),
            Step(0, b"OMM 25544.5 MEAN_MOTION 15 8C\n", b"OMM NAK 5 58\n"),
            Step(0, b"SAT 25544.5 8F\n", b"SAT NAK 5 57\n"),
            Step(0, b"SAT 25544 2C\n", b"SAT NAK 15 88\n"),
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
