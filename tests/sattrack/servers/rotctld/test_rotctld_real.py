"""Hamlib's own programs, where they are installed: its rotctld beside ours."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import pytest
from hamlib_exchanges import EXCHANGES
from rotctld_setup import ask, hamlib_says, hamlibs_own, make_rotator

from sattrack.servers.rotctld.answers import Client

if TYPE_CHECKING:
    from collections.abc import Iterator

needs_rotctld = pytest.mark.needs("rotctld")
LETTERS = {"P": 2, "S": 0, "R": 1, "M": 2, "U": 2, "u": 1, "X": 2, "x": 1, "C": 2, "L": 3, "l": 1, "D": 4}
LETTERS |= {"d": 1, "E": 3, "e": 1, "B": 4, "A": 1, "a": 1, "v": 1, "V": 2, "#": 0, "w": 1, "K": 0, "z": 0}
NAMES = {
    "set_pos": 2,
    "stop": 0,
    "move": 2,
    "reset": 1,
    "qrb": 4,
    "dec2dms": 1,
    "lonlat2loc": 3,
    "nothing": 0,
}
WORDS = [
    "0",
    "1",
    "-1",
    "2",
    "8",
    "16",
    "4",
    "12.5",
    "-0.25",
    "89.99",
    "90",
    "179.999",
    "-180",
    "180.5",
    "361",
]
WORDS += [
    "1e2",
    "1E-3",
    "1e",
    "-.5",
    "5.",
    "+7",
    "0x1F",
    "0x1.8p2",
    "007",
    "12,5",
    "3abc",
    "abc",
    "JO22",
    "jo22AX",
]
WORDS += ["UP", "DOWN", "LEFT", "cw", "CW", "CCW", "FOO", "SPEED", "timeout", "retry", "a=b", "rot_pathname"]
WORDS += ["9999999", "59.9999995", "IO91wm", "RR99", "SS00", "a", "..", "1.2.3"]


def random_line(chance: random.Random) -> bytes:
    """Return a line that may be a command, or nearly one."""
    if chance.random() < 0.8:
        letter, count = chance.choice(list(LETTERS.items()))
    else:
        name, count = chance.choice(list(NAMES.items()))
        letter = "\\" + name
    mark = chance.choice(["", "", "", "+", ";", "|", ",", "+;", "@"])
    # A word too few is made up for by the next line's, a word too many is commands of its own.
    words = [chance.choice(WORDS) for _ in range(max(0, count + chance.choice([0, 0, 0, 0, 0, 0, -1, 1])))]
    if letter == "P" and len(words) > 1:
        # Beyond the zenith Hamlib's dummy does not go.
        words[1] = chance.choice(["0", "45.5", "-1", "x", "10,5", "1e1"])
    if letter == "C" and words:
        # A number is the number of one of its dummy's own settings.
        words[0] = chance.choice(["timeout", "retry", "write_delay", "rot_pathname", "foo", "a=b"])
    blank = chance.choice([" ", " ", " ", "\t", "  "])
    line = mark + blank.join([letter, *words]) + chance.choice(["\n", "\n", "\n", "\r\n", " \n"])
    return line.encode("latin-1")


def lines_that_tell_nothing_else(chance: random.Random, count: int) -> Iterator[bytes]:
    """Give lines without what Hamlib's dummy answers by its own motion, model and magic."""
    while count:
        line = random_line(chance)
        if not any(byte in line for byte in (b"p\n", b"p\r", b"p ", b"?", b"_", b"1dump")):
            count -= 1
            yield line


def compare(port: int, seed: int, connections: int, lines: int) -> int:
    chance, compared = random.Random(seed), 0
    for _ in range(connections):
        sent = b"".join(lines_that_tell_nothing_else(chance, lines))
        # What a dump of capabilities or a position tells is Hamlib's own affair.
        ours = ask(Client(1, make_rotator()), b"V SPEED 1\n" + sent)
        if any(word in ours for word in (b"Caps dump", b"Commands (", b"sattrack", b"min_az", b"get_pos")):
            continue
        own = hamlib_says(port, b"V SPEED 1\n" + sent, ours)
        if b"MG" in own:
            continue
        assert ours == own, sent
        compared += 1
    return compared


@needs_rotctld
def test_hamlibs_own_answers_as_it_was_heard_to() -> None:
    with hamlibs_own() as port:
        for sent, answered in EXCHANGES:
            assert hamlib_says(port, sent, answered) == answered, sent


@needs_rotctld
def test_random_lines_are_answered_as_hamlibs_own_answers_them() -> None:
    with hamlibs_own() as port:
        assert compare(port, 45, 300, 6) > 100


@pytest.mark.soak
@needs_rotctld
def test_many_random_lines_are_answered_as_hamlibs_own_answers_them() -> None:
    compared = 0
    for seed in range(20):
        with hamlibs_own() as port:
            compared += compare(port, seed, 500, 5)
    assert compared > 5000
