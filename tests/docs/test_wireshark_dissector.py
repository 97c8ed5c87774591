"""The Wireshark dissector against literal datagrams, by tshark where it is installed."""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from literal_datagrams import (
    CLIENT,
    COUNTER_AS_DOUBLE,
    EMPTY_COMMAND,
    MOUNT,
    MOVE,
    NAN,
    RATE_AS_DOUBLE,
    SLEW,
    STATUS,
    STRANGER,
    TRUE,
    Frame,
    capture,
    put,
)

Fields = dict[str, list[str]]
Dissect = Callable[..., list[Fields]]
SCRIPT = Path(__file__).resolve().parents[2] / "extras" / "wireshark" / "xerxes.lua"
IDLE_STATUS = put(STATUS, (143, "00"), (158, "00"))
# Bytes 72 to 81 of the command table.
COMMAND_BYTES = [
    *("tracking_rate", "abort", "find_home", "move_ra"),
    *("move_dec", "park", "pulse_guide", "slew"),
    *("sync", "spare"),
]
# Bytes 136 to 159 of the status table.
STATUS_BYTES = [
    *("at_home", "at_park", "connected", "does_refraction"),
    *("equatorial_system", "pulse_guiding", "side_of_pier", "slewing"),
    *("tracking", "tracking_rate", "ack_move_dec", "ack_move_ra"),
    *("utc_1", "utc_2", "utc_3", "ra_drive_status_1"),
    *("ra_drive_status_2", "dec_drive_status_1", "dec_drive_status_2", "ack_abort"),
    *("ack_sync", "ack_pulse_guide", "ack_slew", "spare"),
]
DOUBTFUL = [
    ("dec_rate_dtics_s", 32),
    ("ra_rate_dtics_s", 48),
    ("counter", 104),
    ("dec_guide_rate_dtics_s", 112),
    ("ra_guide_rate_dtics_s", 120),
]
READINGS = [
    ("6D 1E 00 00 00 00 00 00", 7789, "int64"),
    ("93 E1 FF FF FF FF FF FF", -7789, "int64"),
    ("FF FF FF FF FF FF FF FF", -1, "int64"),
    ("FF FF FF FF FF FF 1F 00", 2**53 - 1, "int64"),
    ("01 00 00 00 00 00 E0 FF", -(2**53) + 1, "int64"),
    (RATE_AS_DOUBLE, 7789, "double"),
    ("00 00 00 00 00 6D BE C0", -7789, "double"),
    ("2D 43 1C EB E2 36 1A BF", -0.0001, "double"),
    ("00 00 00 00 00 00 00 00", 0, "zero: int64 and double alike"),
]
WRONG = [
    (put(SLEW, (0, "AB")), "a command begins with AA AA 55 55 00 00 00 00"),
    (put(SLEW, (4, "01")), "a command begins with AA AA 55 55 00 00 00 00"),
    (put(STATUS, (7, "79")), "a status begins with XERXESxx"),
    (SLEW[:-1], "a command has 82 bytes, this one 81"),
    (STATUS + b"\0", "a status has 160 bytes, this one 161"),
    (put(SLEW, (73, TRUE)), "abort, slew: the mount serves one, by its priorities"),
    (put(MOVE, (77, TRUE)), "move_ra, move_dec, park: the mount serves one, by its priorities"),
    (put(SLEW, (24, NAN)), "target_ra_h is not a finite number"),
    (put(STATUS, (48, NAN)), "ra_rate_dtics_s is not a finite number"),
    (put(SLEW, (24, "00 00 00 00 00 00 39 40")), "target_ra_h is 25; it runs from 0 to 24"),
    (put(STATUS, (40, "00 00 00 00 00 00 F0 BF")), "ra_h is -1; it runs from 0 to 24"),
    (put(STATUS, (24, "00 00 00 00 00 00 59 40")), "dec_deg is 100; it runs from -90 to 90"),
    (put(SLEW, (79, "01")), "slew is 0x01; taken as true"),
]


@pytest.fixture(scope="module")
def dissect(tshark: Any, tmp_path_factory: pytest.TempPathFactory) -> Dissect:
    """Every field of every frame, with all its values, as tshark shows them."""
    file = tmp_path_factory.mktemp("capture") / "literal.pcap"

    def dissected(frames: list[Frame], *options: str) -> list[Fields]:
        file.write_bytes(capture(frames))
        done = tshark("-r", str(file), "-T", "json", "--no-duplicate-keys", *options)
        assert done.returncode == 0, done.stderr
        assert "Lua" not in done.stderr, done.stderr
        return [flat(frame["_source"]["layers"].get("xerxes", {})) for frame in json.loads(done.stdout)]

    return dissected


def flat(tree: Any, into: Fields | None = None) -> Fields:
    found = {} if into is None else into
    for name, value in tree.items():
        for one in value if isinstance(value, list) else [value]:
            if isinstance(one, dict):
                flat(one, found)
            else:
                found.setdefault(name, []).append(one)
    return found


def values(fields: Fields, prefix: str) -> dict[str, str]:
    return {name.removeprefix(prefix): shown[0] for name, shown in fields.items() if name.startswith(prefix)}


def numbers(fields: Fields, prefix: str, names: list[str]) -> list[float]:
    shown = values(fields, prefix)
    return [float(shown[name]) for name in names]


def experts(fields: Fields) -> list[str]:
    return fields.get("_ws.expert.message", [])


@pytest.fixture
def one(dissect: Dissect) -> Any:
    """Dissect one datagram, to the mount or from it."""

    def dissected(data: bytes, *options: str) -> Fields:
        ends = (MOUNT, CLIENT) if data.startswith(b"XERXES") else (CLIENT, MOUNT)
        return dissect([Frame(data, *ends)], *options)[0]

    return dissected


def host(number: int) -> str:
    """An end of its own for each case, so that none follows from another."""
    return f"198.51.100.{number + 1}"


@pytest.fixture(scope="module")
def readings(dissect: Dissect) -> dict[tuple[int, str], Fields]:
    """A status for each doubtful field and each of its bytes, dissected."""
    cases = [(offset, digits) for _, offset in DOUBTFUL for digits, _, _ in READINGS]
    frames = [Frame(put(STATUS, case), host(i), CLIENT) for i, case in enumerate(cases)]
    return dict(zip(cases, dissect(frames), strict=True))


@pytest.fixture(scope="module")
def wrong(dissect: Dissect) -> list[Fields]:
    """Every datagram that something is wrong with, dissected."""
    frames = [Frame(data, CLIENT, host(i)) for i, (data, _) in enumerate(WRONG)]
    return dissect(frames)


class TestValues:
    def test_a_slew_is_shown_field_by_field(self, one: Any) -> None:
        shown = values(one(SLEW), "xerxes.command.")
        assert int(shown["header"], 16) == 0x5555AAAA
        assert (shown["counter"], shown["target_dec_deg"], shown["target_ra_h"]) == ("258", "12.25", "5.25")
        assert shown["target_ra_deg"] == "78.75"
        assert shown["rises"] == "slew"
        up = {name for name, value in shown.items() if value == "1" or value == "True"}
        assert up == {"slew"}

    def test_move_axis_has_its_rates_and_both_flags(self, one: Any) -> None:
        shown = values(one(MOVE), "xerxes.command.")
        assert (shown["move_dec_rate_deg_s"], shown["move_ra_rate_deg_s"]) == ("-0.75", "1.25")
        assert shown["pulse_ra_ms"] == "-1500"
        assert {name for name, value in shown.items() if value in ("1", "True")} == {"move_ra", "move_dec"}

    def test_fine_rates_are_shown_in_degrees_per_second_too(self, one: Any) -> None:
        fields = one(put(EMPTY_COMMAND, (48, "93 E1 FF FF FF FF FF FF"), (56, "6D 1E 00 00 00 00 00 00")))
        shown = numbers(fields, "xerxes.command.", ["dec_fine_rate_dtics_s", "ra_fine_rate_dtics_s"])
        assert shown == [-7789, 7789]
        degrees = numbers(fields, "xerxes.command.", ["dec_fine_rate_deg_s", "ra_fine_rate_deg_s"])
        # 2^26 tics a turn, tenths of tics.
        assert degrees == pytest.approx([-778.9 * 360 / 2**26, 778.9 * 360 / 2**26])

    def test_a_status_is_shown_field_by_field(self, one: Any) -> None:
        fields = one(STATUS)
        names = [
            *("altitude_deg", "azimuth_deg", "dec_deg", "dec_rate_dtics_s", "ra_h", "ra_rate_dtics_s"),
            *("sidereal_h", "site_height_m", "site_latitude_deg", "site_longitude_deg"),
            *("target_dec_deg", "target_ra_h", "counter", "dec_guide_rate_dtics_s", "ra_guide_rate_dtics_s"),
            *("dec_current_10ma", "ra_current_10ma", "equatorial_system", "tracking_rate"),
        ]
        assert numbers(fields, "xerxes.status.", names) == [
            *(52.5, 198.25, 12.25, -120, 5.25, 7789, 6.25, 1520.5, 48.125, -111.75),
            *(12.25, 5.25, 123456, 3500, 3500, -150, 200, 0, 0),
        ]
        shown = values(fields, "xerxes.status.")
        assert shown["header"] == "XERXESxx"
        up = {name for name, value in shown.items() if value in ("1", "True")}
        assert up == {"connected", "slewing", "ack_slew"}
        derived = numbers(
            fields, "xerxes.status.", ["ra_deg", "sidereal_deg", "ra_current_a", "ra_rate_deg_s"]
        )
        assert derived == pytest.approx([78.75, 93.75, 2.0, 778.9 * 360 / 2**26])

    def test_every_byte_of_a_command_from_72_on_has_its_own_field(self, dissect: Dissect) -> None:
        frames = [Frame(put(EMPTY_COMMAND, (offset, TRUE))) for offset in range(72, 82)]
        for name, fields in zip(COMMAND_BYTES, dissect(frames), strict=True):
            shown = values(fields, "xerxes.command.")
            assert [other for other in COMMAND_BYTES if shown[other] not in ("0", "False")] == [name]

    def test_every_byte_of_a_status_from_136_on_has_its_own_field(self, dissect: Dissect) -> None:
        nothing = STATUS[:136] + bytes(24)
        frames = [Frame(put(nothing, (offset, TRUE)), MOUNT, CLIENT) for offset in range(136, 160)]
        for name, fields in zip(STATUS_BYTES, dissect(frames), strict=True):
            shown = values(fields, "xerxes.status.")
            assert [other for other in STATUS_BYTES if shown[other] not in ("0", "False")] == [name]


class TestDoubtfulFields:
    @pytest.mark.parametrize(("digits", "value", "reading"), READINGS)
    @pytest.mark.parametrize(("name", "offset"), DOUBTFUL)
    def test_the_bytes_tell_the_type(
        self,
        readings: dict[tuple[int, str], Fields],
        name: str,
        offset: int,
        digits: str,
        value: float,
        reading: str,
    ) -> None:
        fields = readings[offset, digits]
        assert fields[f"xerxes.status.{name}.reading"] == [reading]
        assert float(fields[f"xerxes.status.{name}"][0]) == pytest.approx(value, rel=1e-14)

    def test_a_status_of_doubles_reads_the_same(self, one: Any) -> None:
        fields = one(put(STATUS, (48, RATE_AS_DOUBLE), (104, COUNTER_AS_DOUBLE)))
        shown = numbers(fields, "xerxes.status.", ["ra_rate_dtics_s", "counter", "dec_rate_dtics_s"])
        assert shown == [7789, 123456, -120]


class TestWarnings:
    def test_good_datagrams_have_none(self, dissect: Dissect) -> None:
        frames = [Frame(SLEW), Frame(STATUS, MOUNT, CLIENT, 0.02), Frame(MOVE, at_s=0.05)]
        assert [experts(fields) for fields in dissect(frames)] == [[], [], []]

    @pytest.mark.parametrize("case", range(len(WRONG)), ids=[words for _, words in WRONG])
    def test_what_is_wrong_is_told(self, wrong: list[Fields], case: int) -> None:
        assert WRONG[case][1] in experts(wrong[case])

    def test_a_capture_that_cuts_datagrams_short_is_no_error(self, tshark: Any, tmp_path: Path) -> None:
        whole = capture([Frame(SLEW)])
        # 24 bytes of file header, then the captured length at 8 of the record's header.
        cut = put(whole[:-10], (32, (len(whole) - 40 - 10).to_bytes(4, "little").hex()))
        (tmp_path / "cut.pcap").write_bytes(cut)
        done = tshark("-r", str(tmp_path / "cut.pcap"))
        assert "Cut short by the capture" in done.stdout


class TestConversation:
    def test_request_and_acknowledgement_find_each_other(self, dissect: Dissect) -> None:
        frames = [
            Frame(put(EMPTY_COMMAND, (8, "01 01")), at_s=0.0),
            Frame(SLEW, at_s=0.05),
            Frame(IDLE_STATUS, MOUNT, CLIENT, 0.06),
            Frame(put(SLEW, (8, "03")), at_s=0.10),
            Frame(put(STATUS, (104, "41")), MOUNT, CLIENT, 0.11),
        ]
        _, rising, stale, held, acknowledging = dissect(frames, "-2")
        assert rising["xerxes.command.rises"] == ["slew"]
        assert rising["xerxes.command.acknowledged_in"] == ["5"]
        assert experts(stale) == ["the slew of frame 2 is not acknowledged yet: this is not its end"]
        assert "xerxes.command.rises" not in held
        assert acknowledging["xerxes.status.request_in"] == ["2"]
        assert float(acknowledging["xerxes.status.acknowledged_after_s"][0]) == pytest.approx(0.06, abs=1e-6)

    def test_a_late_datagram_with_a_flag_up_is_a_second_rising_edge(self, dissect: Dissect) -> None:
        frames = [
            Frame(SLEW, at_s=0.0),
            Frame(STATUS, MOUNT, CLIENT, 0.02),
            Frame(put(EMPTY_COMMAND, (8, "04 01")), at_s=0.10),
            Frame(put(STATUS, (104, "42"), (158, "00")), MOUNT, CLIENT, 0.12),
            Frame(put(SLEW, (8, "03 01")), at_s=0.15),
            Frame(put(STATUS, (104, "43")), MOUNT, CLIENT, 0.17),
        ]
        shown = [experts(fields) for fields in dissect(frames)]
        assert "the counter goes back by 1: a late datagram" in shown[4]
        assert "slew: a late datagram raises it again" in shown[4]

    def test_an_acknowledgement_that_rises_twice_for_one_request_is_told(self, dissect: Dissect) -> None:
        frames = [
            Frame(SLEW, at_s=0.0),
            Frame(STATUS, MOUNT, CLIENT, 0.02),
            Frame(put(STATUS, (104, "41"), (158, "00")), MOUNT, CLIENT, 0.07),
            Frame(put(STATUS, (104, "42")), MOUNT, CLIENT, 0.12),
        ]
        last = experts(dissect(frames)[3])
        assert last == ["acknowledged a second time: a late or repeated datagram made a second rising edge"]

    def test_an_acknowledgement_without_a_request_is_told(self, one: Any) -> None:
        words = experts(one(STATUS))
        assert words == ["no request in this capture: from before its beginning, or another sender's"]

    def test_gaps_and_repeats_of_the_counter_are_told(self, dissect: Dissect) -> None:
        frames = [
            Frame(EMPTY_COMMAND),
            Frame(put(EMPTY_COMMAND, (8, "04"))),
            Frame(put(EMPTY_COMMAND, (8, "04"))),
        ]
        shown = [experts(fields) for fields in dissect(frames)]
        assert shown == [
            [],
            ["3 datagrams before this one are missing"],
            ["the counter repeats: a duplicate"],
        ]

    def test_a_second_sender_is_told(self, dissect: Dissect) -> None:
        frames = [Frame(EMPTY_COMMAND), Frame(put(EMPTY_COMMAND, (8, "01")), src=STRANGER)]
        shown = [experts(fields) for fields in dissect(frames)]
        assert shown == [[], [f"commands to this mount came from {CLIENT}:15001 before"]]

    def test_a_datagram_with_a_wrong_header_changes_nothing_of_what_follows(self, dissect: Dissect) -> None:
        frames = [Frame(put(SLEW, (0, "AB"))), Frame(SLEW, at_s=0.05)]
        shown = dissect(frames)
        assert "xerxes.command.rises" not in shown[0]
        assert shown[1]["xerxes.command.rises"] == ["slew"]
        assert experts(shown[1]) == []


class TestPorts:
    def test_good_datagrams_are_known_on_any_port(self, dissect: Dissect) -> None:
        frames = [
            Frame(SLEW, src_port=40001, dst_port=40002),
            Frame(STATUS, MOUNT, CLIENT, 0.0, 40002, 40001),
        ]
        command, status = dissect(frames)
        assert "xerxes.command.slew" in command
        assert "xerxes.status.slewing" in status

    def test_what_is_no_datagram_of_ours_is_left_alone(self, dissect: Dissect) -> None:
        frames = [
            Frame(b"hello"),
            Frame(bytes(82), src_port=40001, dst_port=40002),
            Frame(bytes(160), src_port=40001, dst_port=40002),
            Frame(SLEW[:-1], src_port=40001, dst_port=40002),
        ]
        assert dissect(frames) == [{}, {}, {}, {}]

    def test_the_preference_moves_the_ports_of_wrong_datagrams(self, dissect: Dissect) -> None:
        wrong = put(SLEW, (0, "AB"))
        frames = [Frame(wrong), Frame(wrong, src_port=16001, dst_port=16001)]
        at_default = dissect(frames)
        assert [bool(fields) for fields in at_default] == [True, False]
        moved = dissect(frames, "-o", "xerxes.ports:16000-16002")
        assert [bool(fields) for fields in moved] == [False, True]


def test_every_field_of_the_paper_stands_in_the_script() -> None:
    text = SCRIPT.read_text(encoding="utf-8")
    rows = [line for line in text.splitlines() if line.startswith("  { offset = ")]
    commands, statuses = rows[:20], rows[20:]
    spans = [
        (int(row.split("offset = ")[1].split(",")[0]), int(row.split("length = ")[1].split(",")[0]))
        for row in rows
    ]
    # The "bytes" column of the command table, and the "byte #" column of the status table.
    eights, fours = [(8 * i, 8) for i in range(8)], [(64, 4), (68, 4)]
    assert spans[: len(commands)] == [*eights, *fours, *((i, 1) for i in range(72, 82))]
    eights, fours = [(8 * i, 8) for i in range(16)], [(128, 4), (132, 4)]
    assert spans[len(commands) :] == [*eights, *fours, *((i, 1) for i in range(136, 160))]
    assert sum('kind = "either"' in row for row in statuses) == 5
    assert all(text.count(f'name = "{name}"') == 1 for name in ("slew", "ack_slew", "sidereal_h"))


def test_every_block_and_bracket_of_the_script_is_closed() -> None:
    code = re.sub(r'"(?:\\.|[^"\\\n])*"|--[^\n]*', "", SCRIPT.read_text(encoding="utf-8"))
    words = re.findall(r"\b(?:function|if|do|end)\b", code)
    assert words.count("end") == len(words) - words.count("end") > 50
    assert [code.count(one) for one in "({["] == [code.count(one) for one in ")}]"]


def test_the_script_compiles(program: Callable[[str], str]) -> None:
    compiler = program("luac|luac5.4|luac5.3|luac5.2")
    done = subprocess.run([compiler, "-p", str(SCRIPT)], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
