# ruff: noqa: E501 - what goes over the line is as long as it is
"""Rows of sections 3.0, 4.0 and 4.1: the line, transactions, what commands there are."""

from __future__ import annotations

from conformance_kinds import Row, Step

LINE_ROWS = (
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
        "nothing is sent but in response, whatever the antenna does meanwhile",
        (
            Step(0, b"TD 10 20 BB\n", b"TD ACK A7\n"),
            Step(5, b"P", b""),
            Step(
                10,
                b"S C3\n",
                b"PS 10.00000000 20.00000000 30.00000000 40.00000000 0.0000000000 0.0000000000 0.0000000000 0.0000000000 0 0 43210.000000 REMOTE SLEWING 2A\n",
            ),
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
            Step(0, b"FOCPS 9B\n", b"FOCPS 0.0000 0.0000 0.0000 0.0000 43200.000000 STOPPED 39\n"),
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
        "stow pins that the antenna does not have are reported as missing",
        (
            Step(0, b"PINS IN 11\n", b"PINS NAK 9 AD\n"),
            Step(0, b"PINS UP 1F\n", b"PINS NAK 5 A9\n"),
        ),
    ),
    Row(
        "4.1",
        "brakes that the antenna does not have are reported as missing",
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
)
