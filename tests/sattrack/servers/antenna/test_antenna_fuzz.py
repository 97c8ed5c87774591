"""Lines that nobody meant: answered by the rules or swallowed by them; none changes what is in force."""

from __future__ import annotations

import random
import re

import pytest
from antenna_setup import NOON_NS, make_controller
from conformance_rows import ROWS

from sattrack.servers.antenna.protocol import NS

GOOD = sorted({line + b"\n" for row in ROWS for step in row.steps for line in step.sent.split(b"\n") if line})
REFUSED = re.compile(rb"(\?\?|[A-Z]+) NAK ([1-9]|1[0-5]) ")
CHANGES = (b"TD", b"STOP", b"STOW", b"UNSTOW", b"SERVICE", b"RESET", b"FIXED", b"FIXSKY", b"RADEC", b"OFFSET")
CHANGES += (b"POINTING", b"SAT", b"SATOFF")
SPICES = (b"#", b"\n", b",,", b" ", b"1e400", b"-", b"nan", b"\x00", b"\xff", b"TD", b"\r", b"9" * 40)


def spoilt(line: bytes, chance: random.Random) -> bytes:
    """Return a line with something done to it; now and then nothing."""
    data = bytearray(line)
    for _ in range(chance.choice((0, 1, 1, 1, 2, 5))):
        place = chance.randrange(len(data) + 1)
        match chance.randrange(5):
            case 0:
                data[place:place] = chance.choice(SPICES)
            case 1:
                del data[place : place + chance.randrange(1, 8)]
            case 2 if place < len(data):
                data[place] ^= 1 << chance.randrange(8)
            case 3:
                data[place:place] = chance.randbytes(chance.randrange(1, 6))
            case _:
                other = chance.choice(GOOD)
                data[place:] = other[chance.randrange(len(other)) :]
    if chance.random() < 0.3:
        # A right check under wrong words: what the check lets through, the fields must stop.
        body = bytes(data[:-1]).rstrip(b"0123456789ABCDEF") or b" "
        data = bytearray(body + b"%02X\n" % (sum(body) % 256))
    return bytes(data)


def expected_answers(stream: bytes) -> tuple[int, bytes]:
    """Return how many answers the rules demand, by a reading of their own, and what is left of a line."""
    count, rest = 0, b""
    for byte in stream:
        if byte == 0x23:
            count, rest = 0, b""
        elif byte == 0x0A:
            count, rest = count + bool(rest), b""
        else:
            rest += bytes([byte])
    return count, rest


def check_answers(answers: bytes) -> list[bytes]:
    lines = answers.split(b"\n")
    assert lines.pop() == b""
    for line in lines:
        assert line.isascii()
        assert b"%02X" % (sum(line[:-2]) % 256) == line[-2:]
    return lines


def hammer(lines: int, seed: int) -> None:
    chance = random.Random(seed)
    controller = make_controller()
    rest = b""
    for number in range(lines):
        sent = spoilt(chance.choice(GOOD), chance)
        now_ns = NOON_NS + number * NS // 10 % (40_000 * NS)
        before = controller.path
        answers, _ = controller.receive(sent, now_ns)
        count, rest = expected_answers(rest + sent)
        answered = check_answers(answers)
        assert len(answered) == count
        obeyed = [a for a in answered if a.split(b" ")[1] == b"ACK" and a.split(b" ")[0] in CHANGES]
        if not obeyed and b"#" not in sent:
            assert controller.path is before
        assert all(REFUSED.match(a) for a in answered if b" NAK " in a)
    answers, _ = controller.receive(b"#PS C3\n", NOON_NS)
    (line,) = check_answers(answers)
    assert line.startswith(b"PS ")
    assert len(line.split()) == 15


def test_every_spoilt_line_is_answered_by_the_rules_or_swallowed_by_them() -> None:
    hammer(20_000, 12)


@pytest.mark.soak
def test_a_million_spoilt_lines_are_answered_by_the_rules_or_swallowed_by_them() -> None:
    hammer(1_000_000, 2001)


def test_one_synchronisation_brings_order_after_any_garbage() -> None:
    chance = random.Random(7)
    controller = make_controller()
    for _ in range(500):
        controller.receive(chance.randbytes(chance.randrange(2000)), NOON_NS)
        answers, drop = controller.receive(b"#PS C3\n", NOON_NS)
        assert drop
        assert len(check_answers(answers)) == 1
        assert answers.startswith(b"PS ")
