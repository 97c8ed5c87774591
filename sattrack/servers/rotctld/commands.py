"""The commands of rotctld: one table for the reader, the answers and the help.

Hamlib 4.5.4: `rotctld(1)`, and what its `??` tells. Each has a letter, or a byte that no keyboard has, and a
long name.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Command:
    """One command: its byte, its long name, what it takes, and the labels of what it gives.

    `gives` are those of extended responses; `answers` tells whether there is an answer beside RPRT, after
    which a success is not told. `whole_line` is of a command whose one argument is the rest of the line.
    """

    byte: int
    name: str
    takes: tuple[str, ...] = ()
    gives: tuple[str, ...] = ()
    answers: bool = False
    whole_line: bool = False


def _asks(letter: str, name: str, takes: tuple[str, ...], gives: tuple[str, ...]) -> Command:
    return Command(ord(letter), name, takes, gives, answers=True)


def _tells(letter: str, name: str, *takes: str) -> Command:
    return Command(ord(letter), name, takes)


DUMP_STATE_BYTE = 0x8F
PAUSE_BYTE = 0x8C
COMMANDS = (
    _tells("P", "set_pos", "Azimuth", "Elevation"),
    _asks("p", "get_pos", (), ("Azimuth", "Elevation")),
    _tells("K", "park"),
    _tells("S", "stop"),
    _tells("R", "reset", "Reset"),
    _tells("M", "move", "Direction", "Speed"),
    _tells("V", "set_level", "Level", "Level Value"),
    _asks("v", "get_level", ("Level",), ("Level Value",)),
    _tells("U", "set_func", "Func", "Func Status"),
    _asks("u", "get_func", ("Func",), ("Func Status",)),
    _tells("X", "set_parm", "Parm", "Parm Value"),
    _asks("x", "get_parm", ("Parm",), ("Parm Value",)),
    _tells("C", "set_conf", "Token", "Value"),
    _asks("_", "get_info", (), ("Info",)),
    _asks("s", "get_status", (), ("Status flags",)),
    Command(ord("w"), "send_cmd", ("Cmd",), ("Reply",), answers=True, whole_line=True),
    _tells("1", "dump_caps"),
    Command(DUMP_STATE_BYTE, "dump_state", answers=True),
    _asks("L", "lonlat2loc", ("Longitude", "Latitude", "Loc Len [2-12]"), ("Locator",)),
    _asks("l", "loc2lonlat", ("Locator",), ("Longitude", "Latitude")),
    _asks("D", "dms2dec", ("Degrees", "Minutes", "Seconds", "S/W"), ("Dec Degrees",)),
    _asks("d", "dec2dms", ("Dec Degrees",), ("Degrees", "Minutes", "Seconds", "S/W")),
    _asks("E", "dmmm2dec", ("Degrees", "Dec Minutes", "S/W"), ("Dec Deg",)),
    _asks("e", "dec2dmmm", ("Dec Deg",), ("Degrees", "Dec Minutes", "S/W")),
    _asks("B", "qrb", ("Lon 1", "Lat 1", "Lon 2", "Lat 2"), ("QRB Distance", "QRB Azimuth")),
    _asks("A", "a_sp2a_lp", ("Short Path Deg",), ("Long Path Deg",)),
    _asks("a", "d_sp2d_lp", ("Short Path km",), ("Long Path km",)),
    Command(PAUSE_BYTE, "pause", ("Seconds",)),
)
"""All of them, in the order in which Hamlib lists them."""

BY_BYTE = {command.byte: command for command in COMMANDS}
BY_NAME = {command.name: command for command in COMMANDS}
MOST_TAKEN = 4


def usage() -> str:
    """Return the help that a question mark asks for."""
    lines = ["Commands (some may not be available for this rotator):"]
    for command in COMMANDS:
        letter = chr(command.byte) if 0x20 <= command.byte < 0x7F else "?"
        lines.append(f"{letter}: {command.name:<12}({', '.join(command.takes)})")
    lines += [
        "",
        "",
        "In interactive mode prefix long command names with '\\', e.g. '\\dump_state'",
        "",
        "The special command '-' is used to read further commands from standard input",
        "Commands and arguments read from standard input must be white space separated,",
        "comments are allowed, comments start with the # character and continue to the",
        "end of the line.",
    ]
    return "\n".join(lines) + "\n"
