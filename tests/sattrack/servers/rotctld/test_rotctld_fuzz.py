"""Lines that nobody meant: each answered with the code that it must be, nothing moved, nothing kept."""

from __future__ import annotations

import gc
import random
import string
import tracemalloc

import pytest
from rotctld_setup import NOON_NS, ask, make_rotator

from sattrack.servers.rotctld.answers import Client
from sattrack.servers.rotctld.reader import LONGEST_COMMAND

NO_NUMBERS = (
    "abc",
    "-",
    "+",
    ".",
    "e5",
    "in",
    "infi",
    "nano"[:2],
    "x1",
    "#",
    "_",
    "..1",
    "--1",
    "\xff",
)
OUTSIDE = ("450.1", "-180.1", "1e9", "-1e40", "inf", "-infinity", "nan", "99999999999999999999", "1e999")
NO_COMMANDS = "bcfghijkmnoryztFGHIJNOTWYZ023456789"
INVALID, FAILED_IO, NOT_AVAILABLE = "RPRT -1\n", "RPRT -6\n", "RPRT -11\n"


def malformed(chance: random.Random) -> tuple[str, str]:
    """Return a line, and what must be answered to it by Hamlib's rules."""
    bad, far = chance.choice(NO_NUMBERS), chance.choice(OUTSIDE)
    word = "".join(chance.choices(string.ascii_letters + string.digits, k=chance.randrange(1, 20)))
    kinds = (
        (f"P {bad} {chance.uniform(0, 90):.3f}", INVALID),
        (f"P {chance.uniform(0, 360):.3f} {bad}", INVALID),
        (f"P {far} {chance.uniform(0, 90):.3f}", INVALID),
        (f"P {chance.uniform(0, 360):.3f} {far}", INVALID),
        (f"\\set_pos {chance.uniform(0, 360):.3f} -{chance.uniform(0.001, 90):.3f}", INVALID),
        (f"M {chance.choice((0, 1, 3, 5, 6, 7, 9, 17, 32, 99, -2))} {chance.randrange(100)}", INVALID),
        (f"M {bad} 5", INVALID),
        (f"M {chance.choice(('UP', 'CW', '2', '16'))} {bad}", INVALID),
        (f"R {bad}", INVALID),
        (f"C x{word} {chance.random():.2f}", INVALID),
        (f"V x{word} 1", NOT_AVAILABLE),
        (f"U x{word} 1", NOT_AVAILABLE),
        (f"v x{word}", INVALID),
        (f"x x{word}", INVALID),
        (f"w {word}", FAILED_IO),
        (f"l 1{word}", INVALID),
        (f"A {chance.uniform(360.001, 1e6):.3f}", INVALID),
        (f"B {bad} 1 2 3", INVALID),
        (f"P {'7' * chance.randrange(128, 900)} 5", INVALID),
        (f"M 2{' ' * chance.randrange(1100, 1300)} 5", INVALID),
        ("#" + word, ""),
        (chance.choice(NO_COMMANDS), ""),
        (f"\\x{word}", ""),
    )
    line, code = chance.choice(kinds)
    if line[0] in "#" + NO_COMMANDS or len(line) > 120 or line.startswith("\\x"):
        return line + "\n", code
    mark = chance.choice(("", "", "+", ";", "|", ","))
    if not mark:
        return line + "\n", code
    letter, *words = line.split(" ")
    names = {
        "P": "set_pos",
        "\\set_pos": "set_pos",
        "M": "move",
        "R": "reset",
        "C": "set_conf",
        "V": "set_level",
    }
    names |= {"U": "set_func", "v": "get_level", "x": "get_parm", "w": "send_cmd", "l": "loc2lonlat"}
    names |= {"A": "a_sp2a_lp", "B": "qrb"}
    parted = "\n" if mark == "+" else mark
    return f"{mark}{line}\n", f"{names[letter]}: {' '.join(words)}{parted}{code}"


def hammer(lines: int, seed: int) -> int:
    """Send so many malformed lines in packets of any size; return how many bytes more are kept at the end."""
    chance = random.Random(seed)
    rotator = make_rotator()
    client = Client(1, rotator)
    gc.disable()
    tracemalloc.start()
    try:
        kept = 0
        for part in range(10):
            if part == 1:
                kept = tracemalloc.get_traced_memory()[0]
            for _ in range(lines // 10):
                line, expected = malformed(chance)
                sent = line.encode("latin-1")
                cut = chance.randrange(len(sent) + 1)
                came = ask(client, sent[:cut]) + ask(client, sent[cut:])
                # What ends the line before is passed over with it.
                assert came.decode("latin-1") == expected, line
                assert rotator.path is None
        return tracemalloc.get_traced_memory()[0] - kept
    finally:
        tracemalloc.stop()
        gc.enable()


def test_malformed_lines_are_answered_as_they_must_and_nothing_moves_or_grows() -> None:
    assert hammer(4_000, 4533) < 20_000


@pytest.mark.soak
def test_a_hundred_thousand_malformed_lines_are_answered_as_they_must_and_nothing_moves_or_grows() -> None:
    assert hammer(100_000, 45330) < 20_000


def test_no_bytes_break_a_client_or_make_it_grow() -> None:
    chance = random.Random(6)
    client = Client(1, make_rotator())
    for number in range(3000):
        size = chance.randrange(1, 300)
        data = (
            chance.randbytes(size)
            if number % 2
            else bytes(chance.choices(b"Pp+;\\ \n#w?0123456789.x", k=size))
        )
        client.receive(data.replace(b"q", b"").replace(b"Q", b"").replace(b"\x8c", b""))
        client.answer(NOON_NS + number, 10_000)
        assert len(client._reader._bytes) <= LONGEST_COMMAND + 1
