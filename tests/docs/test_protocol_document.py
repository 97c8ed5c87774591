"""docs/xerxes-protocol.md against the code that it is written from, and against bytes written out by hand."""

from __future__ import annotations

import re
import shutil
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from literal_datagrams import COUNTER_AS_DOUBLE, MOVE, RATE_AS_DOUBLE, SLEW, STATUS, Frame, capture, put

if TYPE_CHECKING:
    from tool_runs import Tool

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "xerxes-protocol.md").read_text(encoding="utf-8")
GENERATED = ("docs/xerxes-protocol.md", "extras/wireshark/xerxes.lua", "docs/xerxes-slew.svg")
# The "bytes" and "Field" columns of the paper's command table.
COMMAND_ROWS = {
    "CmdHeader": "0–7",
    "rolling counter": "8–15",
    "TargetDec": "16–23",
    "TargetRA": "24–31",
    "MoveAxisRateDec": "32–39",
    "MoveAxisRateRA": "40–47",
    "DecFineRate": "48–55",
    "RAFineRate": "56–63",
    "PulseGuideRADuration": "64–67",
    "PulseGuideDecDuration": "68–71",
    "tracking rate": "72",
    "AbortSlewCmd": "73",
    "FindHomeCmd": "74",
    "MoveAxisRA": "75",
    "MoveAxisDec": "76",
    "ParkCmd": "77",
    "PulseGuideCmd": "78",
    "SlewToTargetCmd": "79",
    "SyncToTargetCmd": "80",
    "spare": "81",
}
# Those of its status table, which has three bytes of UTCDateTime.
STATUS_ROWS = {
    "Description": "0–7",
    "Altitude": "8–15",
    "Azimuth": "16–23",
    "Declination": "24–31",
    "DeclinationRate": "32–39",
    "RightAscension": "40–47",
    "RightAscensionRate": "48–55",
    "SiderealTime": "56–63",
    "SiteElevation": "64–71",
    "SiteLatitude": "72–79",
    "SiteLongitude": "80–87",
    "TargetDeclination": "88–95",
    "TargetRightAscension": "96–103",
    "Rolling Counter": "104–111",
    "GuideRateDeclination": "112–119",
    "GuideRateRA": "120–127",
    "DecRawCurrent": "128–131",
    "RARawCurrent": "132–135",
    "AtHome": "136",
    "AtPark": "137",
    "Connected": "138",
    "DoesRefraction": "139",
    "EquatorialSystem": "140",
    "IsPulseGuiding": "141",
    "SideOfPier": "142",
    "Slewing": "143",
    "Tracking": "144",
    "TrackingRate": "145",
    "AckMoveAxisDec": "146",
    "AckMoveAxisRA": "147",
    "UTCDateTime": "150",
    "RADriveStatus1": "151",
    "RADriveStatus2": "152",
    "DecDriveStatus1": "153",
    "DecDriveStatus2": "154",
    "AckAbortCmd": "155",
    "AckSyncCmd": "156",
    "AckPulseGuideCmd": "157",
    "AckSlewCmd": "158",
    "spare": "159",
}


def region(name: str) -> str:
    found = re.search(rf"<!-- BEGIN {name} -->\n(.*?)<!-- END {name} -->", PAGE, re.DOTALL)
    assert found is not None, name
    return found[1]


def rows(name: str) -> list[list[str]]:
    """Cells of a region's table, without its head."""
    lines = [line for line in region(name).splitlines() if line.startswith("|")][2:]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def dumps(name: str) -> list[dict[int, bytes]]:
    """The bytes of each hex dump of a region, by their first byte."""
    found = []
    for block in re.findall(r"```\n(.*?)```", region(name), re.DOTALL):
        dump: dict[int, bytes] = {}
        for line in block.splitlines():
            span, digits = line[:7].strip(), line[9:32].strip()
            first, _, last = span.partition("–")
            length = int(last or first) - int(first) + 1
            dump[int(first)] = bytes(length) if "…" in digits else bytes.fromhex(digits)
            assert len(dump[int(first)]) == length, line
        found.append(dump)
    return found


def patched(data: bytes, dump: dict[int, bytes]) -> bytes:
    return put(data, *((offset, raw.hex()) for offset, raw in dump.items()))


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """The generated files, to be spoilt."""
    for file in [*GENERATED, *(f"docs/{path.name}" for path in (ROOT / "docs").glob("xerxes-*-states.svg"))]:
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / file, tmp_path / file)
    return tmp_path


class TestGenerator:
    def test_document_dissector_and_pictures_are_what_the_code_says(self, tool: Tool) -> None:
        done = tool("protocol.__main__", "--check")
        assert (done.returncode, done.stdout, done.stderr) == (0, "", "")

    @pytest.mark.parametrize(
        ("file", "before", "after"),
        [
            ("docs/xerxes-protocol.md", "| 79 | boolean | `slew` |", "| 80 | boolean | `slew` |"),
            ("extras/wireshark/xerxes.lua", "offset = 79", "offset = 80"),
            ("docs/xerxes-slew.svg", "stale", "fresh"),
        ],
    )
    def test_a_difference_is_named_and_mended(
        self, tool: Tool, copy: Path, file: str, before: str, after: str
    ) -> None:
        good = (copy / file).read_text(encoding="utf-8")
        (copy / file).write_text(good.replace(before, after), encoding="utf-8")
        checked = tool("protocol.__main__", "--check", "--root", str(copy))
        assert checked.returncode == 1
        assert checked.stdout == f"{file}: differs; run `python -m tools.protocol`\n"
        assert tool("protocol.__main__", "--root", str(copy)).returncode == 0
        assert (copy / file).read_text(encoding="utf-8") == good

    def test_a_missing_region_is_named_and_nothing_is_written(self, tool: Tool, copy: Path) -> None:
        file = copy / "docs" / "xerxes-protocol.md"
        spoilt = file.read_text(encoding="utf-8").replace("<!-- END slew -->", "")
        file.write_text(spoilt, encoding="utf-8")
        done = tool("protocol.__main__", "--root", str(copy))
        assert done.returncode == 1
        assert "'slew'" in done.stderr
        assert file.read_text(encoding="utf-8") == spoilt


class TestTables:
    @pytest.mark.parametrize(
        ("name", "paper"), [("command fields", COMMAND_ROWS), ("status fields", STATUS_ROWS)]
    )
    def test_every_field_of_the_paper_has_its_bytes(self, name: str, paper: dict[str, str]) -> None:
        assert {cells[3]: cells[0] for cells in rows(name)} == paper

    def test_five_fields_have_two_types(self) -> None:
        doubtful = {cells[3] for cells in rows("status fields") if cells[1] == "int64 **or** double"}
        assert doubtful == {
            "DeclinationRate",
            "RightAscensionRate",
            "Rolling Counter",
            "GuideRateDeclination",
            "GuideRateRA",
        }

    def test_readings_are_those_of_the_bytes(self) -> None:
        found = {cells[1].strip("`"): (float(cells[2]), cells[4]) for cells in rows("readings")}
        assert found["6D 1E 00 00 00 00 00 00"] == (7789, "int64")
        assert found[RATE_AS_DOUBLE] == (0x40BE6D0000000000, "double")
        assert found["00 00 00 00 00 00 00 00"][1] == "either, it is the same"

    def test_a_handshake_goes_round_as_the_paper_tells_it(self) -> None:
        table = {
            (cells[0].split(" (")[0], cells[1]): cells[2].split(" (")[0]
            for cells in rows("handshake transitions")
        }
        state = "**idle**"
        for event in ("request", "ack up", "ack down"):
            state = table[state, event]
        assert state == "**idle**"
        assert {event for before, event in table if before in ("**releasing**", "**withdrawn**")}.isdisjoint(
            {"request"}
        )


class TestSlew:
    """The time diagram's table against the six steps of the paper's "Details"."""

    def column(self, index: int) -> list[str]:
        return [cells[index] for cells in rows("slew")]

    def test_flag_and_acknowledgement_rise_and_fall_in_the_order_of_the_paper(self) -> None:
        flag, ack = self.column(1), self.column(3)
        risen, acked = flag.index("slew **up**"), ack.index("**up**")
        fell = flag.index("", risen)
        released = ack.index("", acked)
        assert risen < acked < fell <= released
        assert "slew **up**" not in flag[fell:]

    def test_the_flag_falls_once_the_acknowledgement_is_held(self) -> None:
        held = ["ack" in words for words in self.column(5)]
        first = held.index(True)
        assert self.column(1)[first] == ""
        assert self.column(1)[first - 1] == "slew **up**"

    def test_statuses_that_are_older_than_the_request_are_stale_and_do_not_end_it(self) -> None:
        stale = [cells for cells in rows("slew") if "stale" in cells[5]]
        assert stale
        assert all(int(cells[4]) <= 0 and cells[6] == "asked" for cells in stale)
        assert self.column(6).index("done") == len(self.column(6)) - 1


class TestExamples:
    def test_the_commands_are_the_literal_bytes(self) -> None:
        slew, move = dumps("command example")
        assert patched(bytes(82), slew) == SLEW
        assert sum(len(raw) for raw in slew.values()) == 82
        assert patched(SLEW, move) == MOVE

    def test_the_statuses_are_the_literal_bytes(self) -> None:
        status, doubles = dumps("status example")
        assert patched(bytes(160), status) == STATUS
        assert sum(len(raw) for raw in status.values()) == 160
        assert patched(STATUS, doubles) == put(STATUS, (48, RATE_AS_DOUBLE), (104, COUNTER_AS_DOUBLE))
        assert set(doubles) == {48, 104}


class TestPictures:
    @pytest.mark.parametrize("name", ["handshake", "held", "link", "slew", "stop", "ticket"])
    def test_every_state_of_the_table_stands_in_its_picture(self, name: str) -> None:
        tree = ET.parse(ROOT / "docs" / f"xerxes-{name}-states.svg")
        drawn = {element.text for element in tree.iter("{http://www.w3.org/2000/svg}text")}
        told = set(re.findall(r"\*\*(.+?)\*\*", region(f"{name} transitions")))
        assert told <= drawn

    def test_what_the_page_links_to_is_there(self) -> None:
        links = re.findall(r"\]\(([^)#]+)\)", PAGE)
        assert len(links) == 8
        assert all((ROOT / "docs" / link).is_file() for link in links)


def test_wireshark_takes_the_display_filters_of_the_page(tshark: Any, tmp_path: Path) -> None:
    filters = re.search(r"Useful display filters:\n\n```\n(.*?)```", PAGE, re.DOTALL)
    assert filters is not None
    file = tmp_path / "slew.pcap"
    file.write_bytes(capture([Frame(SLEW)]))
    # Each in its parentheses: the whole is taken only where every part is.
    whole = " || ".join(f"({one})" for one in filters[1].splitlines())
    done = tshark("-r", str(file), "-Y", whole)
    assert done.returncode == 0, done.stderr
