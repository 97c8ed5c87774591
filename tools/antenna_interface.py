"""Write the tables and examples of docs/antenna-interface.md: `python -m tools.antenna_interface`.

With `--check` nothing is written; the exit code is 1 where the page differs from the code.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from sattrack.servers.antenna.controller import Controller
from sattrack.servers.antenna.equipment import Antenna, Feedback, Focuser, SimulatedFocusAxis
from sattrack.servers.antenna.protocol import COMMANDS, NAK_MEANINGS, NS, AntennaCommand, CommandField, encode
from sattrack.servers.antenna.trajectory import AxisRange, AxisState, SiteSky
from tle.instants import Utc
from tle.site import Site
from tools.protocol.regions import replace_region
from tools.writing import write_or_compare

if TYPE_CHECKING:
    from pathlib import Path

PAGE = "docs/antenna-interface.md"
COMMAND = "python -m tools.antenna_interface"
NOON_NS = int(Utc.parse("2026-10-02T12:00:00Z").unix_s) * NS
LINE_1 = "1 25544U 98067A   26275.01380287  .00003738  00000+0  76743-4 0  9992"
LINE_2 = "2 25544  51.6312 131.4121 0006946 211.9293 148.1275 15.48707684588318"
DIALOGUE = (
    (0.0, "PS"),
    (0.1, "TD 30.004 40.001 0.004178075 0.001 43201.0 S"),
    (0.5, "PS"),
    (0.6, "TD 30 x"),
    (0.7, "STATUS"),
    (0.8, "TIME"),
    (0.9, "FIXED -45 10"),
    (1.0, "SERVICE"),
    (1.1, "STOW"),
    (1.2, "TD 30 40"),
    (1.3, "UNSTOW"),
    (1.4, "PINS IN"),
    (1.5, "BRAKES SET"),
    (1.6, "SENSORS"),
    (1.7, "FOCUS 5 ,,"),
    (2.7, "FOCPS"),
    (2.8, "FOCSWEEP 2 1.5"),
    (2.9, "FOCSTOP"),
    (3.0, "RADEC J2000 187.70593 12.39112"),
    (3.1, "OFFSET AZEL 0.1 0"),
    (3.2, "FIXSKY DATE 187.70593 12.39112 43200"),
    (3.3, "POINTING 0.01 -0.02 0 0 0.003 0"),
    (3.35, "SKY"),
    (3.4, "TLE 0 25544 ISS (ZARYA)"),
    (3.5, f"TLE 1 25544 {LINE_1}"),
    (3.6, f"TLE 2 25544 {LINE_2}"),
    (3.7, "SAT 25544"),
    (3.8, "SATOFF 1.5 -0.25 TRACK"),
    (3.9, "OMM 25544 EPOCH 2026-10-02T00:19:52.567968"),
    (4.0, "STOP"),
    (4.1, "RESET"),
    (4.2, "TIME 20728 43204.25"),
)


class StandsStill(Feedback):
    """An antenna that stands at 30° and 40°."""

    link_up = True

    def actual(self, utc_ns: int) -> AxisState:
        """Return that, at any instant."""
        del utc_ns
        return AxisState(30.0, 40.0, 0.0, 0.0)


def field_words(field: CommandField) -> str:
    """Return a field as the table has it."""
    words = f"`{field.name}` {field.meaning}".rstrip()
    if field.kind == "number":
        words += f" ({field.least:.10g} to {field.most:.10g})"
    elif field.kind == "word" and field.name not in {"wrap"}:
        words += " (" + ", ".join(f"`{word}`" for word in field.words) + ")"
    return f"[{words}]" if field.optional else words


def command_table() -> str:
    """Return the table of all commands."""
    rows = ["| command | fields, in order | what it does | answer |", "|---|---|---|---|"]
    rows += [_row(command) for command in COMMANDS]
    return "\n".join(rows)


def _row(command: AntennaCommand) -> str:
    fields = "; ".join(field_words(field) for field in command.fields) or "none"
    local = "" if command.commands_antenna else " Answered in local too."
    return f"| `{command.word}` | {fields} | {command.meaning}.{local} | {command.answer} |"


def refusal_table() -> str:
    """Return the table of the numbers after NAK."""
    rows = ["| number | why |", "|---|---|"]
    return "\n".join(rows + [f"| {nak.value} | {words} |" for nak, words in NAK_MEANINGS.items()])


def dialogue() -> str:
    """Return an example of every command, with what is answered, as bytes."""
    antenna = Antenna(
        SiteSky(Site(52.1541, 4.4908, 0.0)),
        "hadec",
        AxisRange(-180.0, -200.0, 200.0, -89.9, 89.9),
        stow=(0.0, 80.0),
        service=(-45.0, 10.0),
        focuser=Focuser((SimulatedFocusAxis(), SimulatedFocusAxis())),
    )
    controller = Controller(antenna, StandsStill())
    lines = []
    for at_s, message in DIALOGUE:
        sent = encode(message)
        answer, _ = controller.receive(sent, NOON_NS + round(at_s * NS))
        lines += [f"> {_shown(sent)}", f"< {_shown(answer)}"]
    return "\n".join(["```", *lines, "```"])


def _shown(data: bytes) -> str:
    return data.decode("ascii").replace("\n", "\\n")


def page(root: Path) -> str:
    """Return what the page should hold. Raises RegionError, OSError."""
    text = (root / PAGE).read_text(encoding="utf-8")
    for name, body in (
        ("commands", command_table()),
        ("refusals", refusal_table()),
        ("dialogue", dialogue()),
    ):
        text = replace_region(text, name, body)
    return text


def main() -> int:
    """Write or compare; returns the exit code."""
    return write_or_compare(COMMAND, __doc__, PAGE, page)


if __name__ == "__main__":
    sys.exit(main())
