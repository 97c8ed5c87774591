"""Malformed requests: each ends in the right error, nothing moves, nothing stays behind."""

from __future__ import annotations

import gc
import random
import tracemalloc
from urllib.parse import quote_from_bytes, urlencode

import pytest
from alpaca_stand import VirtualTelescope

from sattrack.servers.alpaca.protocol import MEMBERS
from sattrack.servers.alpaca.telescope import Reply

DEVICE = "/api/v1/telescope/0/"
# Each way to spoil a request, with the HTTP status that it must end in, or the error numbers with status 200.
NUMBERS_THAT_ARE_NONE = (
    "",
    " ",
    "nan",
    "inf",
    "-inf",
    "1e400",
    "0x1",
    "1,5",
    "--1",
    "1 2",
    "one",
    "١",
    "1_0",
    "+",
)
Case = tuple[str, str, bytes, bytes, set[int], set[int]]
"""Method, path, query, body; HTTP statuses and, for 200, error numbers that are right."""
WRITES = [member for member in MEMBERS if member.write == "yes" and member.takes and member.name != "Action"]
ABSENT = [member for member in MEMBERS if member.write == "absent"]


def noise(chance: random.Random, most: int = 60) -> bytes:
    return bytes(chance.randrange(256) for _ in range(chance.randrange(1, most)))


def malformed(chance: random.Random) -> Case:
    """Return a request that cannot be done, by a kind that is chosen, and what it must end in."""
    kind = chance.randrange(9)
    member = chance.choice(WRITES)
    good = {one.name: "0" if one.kind != "bool" else "True" for one in member.takes}
    if kind == 0:
        path = "/" + noise(chance).decode("latin-1")
        return chance.choice(["GET", "PUT"]), path, noise(chance), noise(chance), {400, 404, 405}, set()
    if kind == 1:
        path = DEVICE + noise(chance).decode("latin-1")
        return chance.choice(["GET", "PUT"]), path, b"", b"", {400}, set()
    if kind == 2:
        return noise(chance, 8).decode("latin-1") + "X", DEVICE + member.path, b"", b"", {405}, set()
    if kind == 3:
        name = chance.choice(list(good))
        good[name] = chance.choice(NUMBERS_THAT_ARE_NONE)
        body = "&".join(f"{key}={value}" for key, value in good.items()).encode()
        return "PUT", DEVICE + member.path, b"", body, {400}, set()
    if kind == 4:
        name = chance.choice(list(good))
        body = "&".join(
            f"{key.swapcase() if key == name else key}={value}" for key, value in good.items()
        ).encode()
        return "PUT", DEVICE + member.path, b"", body, {400}, set()
    if kind == 5:
        out = {
            one.name: str(chance.choice([-1, 1]) * 10.0 ** chance.randrange(3, 18))
            if one.kind == "float"
            else str(chance.choice([-1, 1]) * chance.randrange(10, 10**12))
            for one in member.takes
        }
        if any(one.kind == "bool" for one in member.takes):
            return "PUT", DEVICE + member.path, b"", b"Connected=perhaps", {400}, set()
        return "PUT", DEVICE + member.path, b"", urlencode(out).encode(), {200}, {0x401}
    if kind == 6:
        number = quote_from_bytes(noise(chance, 12)) + "x"
        name = chance.choice(["ClientID", "ClientTransactionID"])
        return "GET", DEVICE + "rightascension", f"{name}={number}".encode(), b"", {400}, set()
    if kind == 7:
        body = noise(chance, 300)
        return "PUT", DEVICE + "slewtocoordinates", b"", body, {400}, set()
    absent = chance.choice(ABSENT)
    body = "&".join(f"{one.name}={'True' if one.kind == 'bool' else 0}" for one in absent.takes).encode()
    return "PUT", DEVICE + absent.path, b"", body, {200}, {0x400}


def hammer(requests: int, seed: int) -> None:
    chance, scope = random.Random(seed), VirtualTelescope()
    before = scope.get("rightascension"), scope.get("declination")
    scope.station.console.asked.clear()
    for done in range(requests):
        method, path, query, body, statuses, numbers = malformed(chance)
        answer = scope.asked(method, path, query, body)
        assert isinstance(answer, Reply), (method, path, body)
        assert answer.status in statuses, (method, path, query, body, answer.body)
        if answer.status == 200:
            number = int(answer.body.partition(b'"ErrorNumber":')[2].split(b",")[0])
            assert number in numbers, (path, body, answer.body)
        if done % 500 == 0:
            scope.run_for(0.5)
    assert (scope.get("rightascension"), scope.get("declination")) == pytest.approx(before, abs=1e-5)
    assert scope.get("slewing") is False
    assert not scope.station.console.asked
    assert not scope.station.had_orders


def test_malformed_requests_end_in_the_right_error_and_move_nothing() -> None:
    hammer(2000, 1)


@pytest.mark.soak
def test_a_hundred_thousand_malformed_requests_move_nothing_and_leave_nothing_behind() -> None:
    hammer(2000, 2)
    tracemalloc.start()
    before, _ = tracemalloc.get_traced_memory()
    hammer(100_000, 3)
    gc.collect()
    after, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert after - before < 300_000
