"""Every reader of foreign bytes, given any: only its documented errors, and never more than a moment.

The servers' ports are fuzzed as programs where they are tested (rotctld, Alpaca, antenna), status datagrams
with the session, recordings with every byte flipped. Here are the other readers, and files.
"""

from __future__ import annotations

import contextlib
import math
import sqlite3
from datetime import UTC
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree.ElementTree import Element

import msgspec
import pytest
from fuzz_readers import EPHEMERIDES, HIPPARCOS, STARS
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from sattrack.core.errors import BadInputError, Origin
from sattrack.mount.alpaca.client import AlpacaRefusalError, NoAnswerError, value_in
from sattrack.mount.profiles import load_profile_file
from sattrack.mount.simulator.installation import parse_faults
from sattrack.mount.simulator.mount import MailboxCommand
from sattrack.network.stations import read_stations
from sattrack.pointing.files import read_stars
from sattrack.runtime.control_arbiter import QUEUED_MOST, Observers
from sattrack.runtime.mounts import mount_address
from sattrack.schedule.file import load_schedule, read_list, read_table
from sattrack.schedule.night import Run
from sattrack.schedule.night_folder import DamagedJournalError, Journal
from sattrack.servers.alpaca.indi import LONGEST_MESSAGE, MessageReader
from sattrack.servers.alpaca.lx200 import CommandReader
from sattrack.servers.alpaca.stellarium import GotoReader
from sattrack.servers.antenna.antcn import read_position
from sattrack.servers.antenna.protocol import AntennaRequest, Framer, RefusedCommand, parse
from sattrack.settings import load_settings
from sattrack.views.messages import decode_message, decode_observation, decode_order, decode_said
from tle.bodies import read_star
from tle.errors import TleError
from tle.formats.ephemerides import parse_ephemerides
from tle.horizon import HorizonMask
from tle.site import Site

if TYPE_CHECKING:
    from collections.abc import Callable

EXAMPLES = Path(__file__).parents[2] / "examples"


def refusal(read: Callable[..., object], *what: object) -> str | None:
    """Read something; return why it was refused, None where it was not."""
    try:
        read(*what)
    except (BadInputError, TleError) as error:
        return str(error)
    return None


ANY = settings(max_examples=60, deadline=2000)
FILES = settings(
    max_examples=40,
    deadline=4000,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
"""The deadlines are bounds on the time that one input takes, on a machine that does other things too.

`python bench/fuzz.py` gives them millions.
"""
XML = st.sampled_from(
    (
        b"<newNumberVector",
        b" device='",
        b"sattrack'",
        b" name='",
        b"'",
        b">",
        b"/>",
        b"</",
        b"<oneNumber",
        b"&lt;",
        b"<!DOCTYPE a [<!ENTITY b 'c'>]>",
        b"&b;",
        b"<![CDATA[",
        b"]]>",
        b"<!--",
        b"\xff\xfe",
        b"<a>",
        b"</a>",
        b"1e999",
    )
)
WORDS = st.sampled_from(
    (
        "PS",
        "SET",
        "0",
        "-1",
        "1e999",
        "NaN",
        "Infinity",
        "9" * 400,
        "0x10",
        "REMOTE",
        "\x00",
        "\u0661",
        "",
        "1_0",
        "+",
    )
)


def chunks(pieces: list[bytes]) -> list[bytes]:
    """Return bytes as they may come: in the pieces, and at once."""
    return [*pieces, b"".join(pieces)]


@ANY
@given(st.lists(XML | st.binary(max_size=40), max_size=40))
def test_indi(pieces: list[bytes]) -> None:
    reader = MessageReader()
    for data in chunks(pieces):
        found = reader.read(data)
        if found is None:
            return
        assert all(isinstance(one, Element) for one in found)


def test_indi_without_an_end_is_disconnected() -> None:
    reader = MessageReader()
    sent = 0
    while reader.read(b"<a b='c'>" if sent == 0 else b"d" * 1000) is not None:
        sent += 1000
        assert sent <= LONGEST_MESSAGE + 2000


@ANY
@given(st.lists(st.binary(max_size=60), max_size=20), st.booleans())
def test_lx200(pieces: list[bytes], noisy: bool) -> None:
    reader = CommandReader(noisy)
    for data in chunks(pieces):
        found = reader.read(data)
        if found is None:
            return
        assert all(isinstance(one, str) and len(one) < 200 for one in found)


@ANY
@given(st.lists(st.binary(max_size=60) | st.just(b"\x14\x00\x00\x00" + bytes(16)), max_size=20))
def test_stellarium(pieces: list[bytes]) -> None:
    reader = GotoReader()
    for data in chunks(pieces):
        found = reader.read(data)
        if found is None:
            return
        assert all(0.0 <= ra < 360.0 and abs(dec) <= 90.0 for ra, dec in found)


@ANY
@given(st.lists(WORDS | st.text(max_size=20), max_size=16), st.sampled_from((" ", ",", "  ")))
@example(["PS", *["0"] * 8, "9" * 400, "0", "1", "REMOTE", "IDLE"], " ")
def test_antenna_messages(words: list[str], between: str) -> None:
    text = between.join(words)
    assert isinstance(parse(text), AntennaRequest | RefusedCommand)
    try:
        position = read_position(text)
    except ValueError:
        return
    assert not math.isnan(position.epoch_s)


@ANY
@given(st.lists(st.binary(max_size=100), max_size=20))
def test_antenna_lines(pieces: list[bytes]) -> None:
    framer = Framer()
    for data in chunks(pieces):
        framer.receive(data)


@ANY
@given(
    st.binary(min_size=70, max_size=100)
    | st.binary(min_size=74, max_size=74).map(lambda b: b"\xaa\xaaUU" + bytes(4) + b)
)
def test_commands_at_the_simulated_mount(data: bytes) -> None:
    command = MailboxCommand.read(data)
    assert command is None or len(data) == 82


JSON = st.recursive(
    st.none()
    | st.booleans()
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.integers()
    | st.text(max_size=20),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(
                (
                    "type",
                    "utc",
                    "what",
                    "how",
                    "value",
                    "seconds",
                    "dx_arcsec",
                    "dy_arcsec",
                    "sigma_arcsec",
                    "x",
                )
            ),
            inner
            | st.sampled_from(
                ("nudge", "offset", "observation", "fix", "jog", "2026-10-02T13:05:24.5Z", "set")
            ),
            max_size=8,
        )
    ),
    max_leaves=12,
)


@ANY
@given(JSON.map(msgspec.json.encode) | st.binary(max_size=100))
@example(b'{"type":"\xff"}')
@example(b'{"utc":"\xff","ra_deg":1,"dec_deg":2}')
@example(b'{"type":"stop","x":' + b"[" * 2000)
def test_messages_to_a_run(line: bytes) -> None:
    for read in (decode_message, decode_said, decode_observation, decode_order):
        with contextlib.suppress(msgspec.MsgspecError):
            read(line)


@ANY
@given(st.lists(JSON.map(msgspec.json.encode) | st.binary(max_size=100), max_size=10))
@example([b'{"utc":"\xff","ra_deg":1,"dec_deg":2}'])
def test_lines_of_observers(lines: list[bytes]) -> None:
    observers = Observers()
    for line in [*lines, b"[" * 20000]:
        observers.put(line)
    while observers.observations():
        pass
    assert 1 <= observers.malformed <= len(lines) + 1


def test_a_flood_of_lines_takes_no_more_room_than_the_queue() -> None:
    observers = Observers()
    for _ in range(3 * QUEUED_MOST):
        observers.put(b"x")
    assert observers.dropped == 2 * QUEUED_MOST


FAULTS = ("loss=", "delay", "=", "5", "%", "ms", "~", "cut@", "1s", "+", "-", ",", "silent:", "1e9")


@ANY
@given(st.lists(st.sampled_from(FAULTS) | st.text(max_size=6), max_size=12).map("".join))
def test_faults(text: str) -> None:
    refusal(parse_faults, text)


@pytest.mark.parametrize("text", ["\x00", "mount\n", "a\x1bb:5", "\u2028"])
@pytest.mark.parametrize("scheme", ["xerxes", "alpaca", "antenna"])
def test_a_mounts_address_with_what_cannot_be_printed_is_refused_in_one_line(scheme: str, text: str) -> None:
    found = refusal(mount_address, f"{scheme}://{text}")
    assert found is not None
    assert found.isprintable()


def spoilt(text: str, cuts: list[tuple[float, int, str]]) -> str:
    """Return a text with pieces of it replaced: where (a share of it), how many characters, by what."""
    for share, count, piece in cuts:
        at = int(share * len(text))
        text = text[:at] + piece + text[at + count :]
    return text


CUTS = st.lists(
    st.tuples(
        st.floats(0.0, 1.0),
        st.integers(0, 30),
        st.sampled_from(
            ("", "=", "[", "]]", '"', "\n", "-1e999", "nan", "99999999999999999999", "\x00", "é", "true", ".")
        )
        | st.text(max_size=6),
    ),
    min_size=1,
    max_size=5,
)


@FILES
@given(CUTS)
@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("sattrack.toml", load_settings),
        ("night.toml", load_schedule),
        ("profiles/edge.toml", load_profile_file),
    ],
    ids=["settings", "schedule", "profile"],
)
def test_spoilt_files(
    name: str, read: Callable[[Path], object], tmp_path: Path, cuts: list[tuple[float, int, str]]
) -> None:
    text = spoilt((EXAMPLES / name).read_text(encoding="utf-8"), cuts)
    path = tmp_path / "spoilt.toml"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    assert "spoilt.toml" in (refusal(read, path) or "spoilt.toml")


LINES = st.lists(
    st.sampled_from(
        (
            "2026-10-02T19:40:10",
            "2026-10-02",
            "19:46:00",
            "99:99",
            "ISS",
            ",",
            ";",
            "start,end,satellite\n",
            "#",
            "\n",
            "2026-275/19:40",
            "\t",
            '"',
        )
    )
    | st.text(max_size=8),
    max_size=30,
).map(" ".join)


@ANY
@given(LINES)
@pytest.mark.parametrize("read", [read_list, read_table])
def test_lists_and_tables_of_passes(read: Callable[..., object], text: str) -> None:
    assert (refusal(read, text, UTC, Origin("list")) or "list").startswith("list")


@FILES
@given(st.lists(st.tuples(st.floats(0.0, 1.0), st.integers(0, 255)), max_size=30), st.floats(0.1, 1.0))
def test_spoilt_journals(tmp_path: Path, bytes_: list[tuple[float, int]], kept: float) -> None:
    path = tmp_path / "journal.sqlite3"
    for part in tmp_path.iterdir():
        part.unlink()
    journal = Journal(path, durable=False)
    journal.close()
    with sqlite3.connect(path) as base:
        base.execute("PRAGMA journal_mode = DELETE")
    base.close()
    data = bytearray(path.read_bytes())
    for share, value in bytes_:
        data[min(len(data) - 1, int(share * len(data)))] = value
    path.write_bytes(data[: int(kept * len(data))])
    try:
        journal = Journal(path, durable=False)
    except DamagedJournalError:
        return
    try:
        journal.fold(Run())
    except DamagedJournalError:
        pass
    finally:
        journal.close()


@ANY
@given(CUTS)
@example([(0.5, 4, ""), (0.375, 1, "")])
@example([(0.219, 4, "3026")])
@pytest.mark.parametrize("axes", ["equatorial", "altaz"])
def test_files_of_stars_for_a_pointing_model(axes: str, cuts: list[tuple[float, int, str]]) -> None:
    text = spoilt(STARS.decode().replace("EQUAT", "ALTAZ" if axes == "altaz" else "EQUAT"), cuts)
    assert (refusal(read_stars, text, "run.dat", axes) or "run.dat").startswith("run.dat")


@ANY
@given(
    JSON.map(msgspec.json.encode)
    | CUTS.map(lambda cuts: spoilt('{"ErrorNumber":0,"Value":1}', cuts).encode())
)
@example(b'{"ErrorNumber":Infinity}')
@example(b'{"ErrorNumber":1e999}')
@example(b"[" * 100_000)
def test_answers_of_an_alpaca_mount(body: bytes) -> None:
    with contextlib.suppress(NoAnswerError, AlpacaRefusalError):
        value_in("tracking", 200, body)


@ANY
@given(CUTS)
@pytest.mark.parametrize("text", EPHEMERIDES.values(), ids=EPHEMERIDES)
def test_spoilt_ephemerides(text: str, cuts: list[tuple[float, int, str]]) -> None:
    data = spoilt(text, cuts).encode("utf-8", "surrogatepass")
    assert (refusal(parse_ephemerides, data, "orbit", Site(52.15, 4.49)) or "orbit").startswith("orbit")


@FILES
@given(CUTS)
@pytest.mark.parametrize(
    ("name", "text", "read"),
    [
        ("horizon.txt", "0 10\n90 20\n180 15 # trees\n270,5\n", HorizonMask.read),
        ("stations.toml", (EXAMPLES / "network/stations.toml").read_text(encoding="utf-8"), read_stations),
        (
            "stations.csv",
            "name,latitude_deg,longitude_deg,height_m\nA,52.1,4.2,3\nB,-10,20,40\n",
            read_stations,
        ),
        ("hip_main.dat", HIPPARCOS.decode(), partial(read_star, 11767, "Polaris")),
    ],
    ids=["horizon", "stations", "stations as CSV", "stars"],
)
def test_spoilt_tables(
    name: str, text: str, read: Callable[[Path], object], tmp_path: Path, cuts: list[tuple[float, int, str]]
) -> None:
    path = tmp_path / name
    path.write_bytes(spoilt(text, cuts).encode("utf-8", "surrogatepass"))
    assert name in (refusal(read, path) or name)
