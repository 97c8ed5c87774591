"""Write docs/commands.md, docs/settings.md and the man page from the code: `python -m tools.reference`.

With `--check` nothing is written; the exit code is 1 where one of them differs from the code. The wheel holds
the man page, docs/sattrack.1, as share/man/man1/sattrack.1.
"""

from __future__ import annotations

import re
import sys
import types
import typing
from typing import TYPE_CHECKING, Any

import click
import msgspec

from sattrack import __version__
from sattrack.cli.main import COMMANDS as SUMMARIES
from sattrack.cli.main import GROUPS, cli
from sattrack.mount.model import MountProfile
from sattrack.settings import Settings
from tools.protocol.regions import RegionError, replace_region
from tools.writing import write_or_compare

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

NAME = "python -m tools.reference"
COMMANDS, SETTINGS, MAN = "docs/commands.md", "docs/settings.md", "docs/sattrack.1"
EXAMPLES = "Examples:"
COMMON = {"--config", "--site", "--elements", "--clock", "--json", "--debug", "--utc"}
UNITS = {
    "_deg": "°",
    "_deg_s": "°/s",
    "_deg_s2": "°/s²",
    "_s": "s",
    "_m": "m",
    "_a": "A",
    "limits_deg": "°",
}
MEANINGS = {
    "site.latitude_deg": "north is positive",
    "site.longitude_deg": "east is positive",
    "site.height_m": "above the WGS 84 ellipsoid, -500 to 8900",
    "elements": "files, folders, URLs, `celestrak:GROUP`; see [elements](elements.md#sources)",
    "mount.url": "the mount: `sim`, `xerxes://…`, `alpaca://…`, `antenna://…`",
    "mount.profile": "the file that describes the mount, beside the settings",
    "min_altitude_deg": "follow above this altitude",
    "fetch_by_name": "fetch a named satellite from CelesTrak when no elements are set",
    "zone": "time zone in which times are shown, such as `Europe/Amsterdam`; the system's if left out",
    "stars": "a file of the Hipparcos catalogue (`hip_main.dat` of CDS I/239), for fainter stars than 6.5",
    "safety.floor_altitude_deg": "lowest altitude in every direction",
    "safety.horizon": "file of the skyline: azimuth and altitude on each line, sorted, at most 90° apart",
    "safety.optical": "whether the telescope has optics; `false` switches the Sun's cone off",
    "safety.sun_cone_deg": "half angle of the forbidden cone about the Sun; 15 with optics",
    "safety.moon_cone_deg": "the same about the Moon; 0 for none",
    "safety.longest_fault_s": "longest loss of the link that must not pass a limit; 10 at most",
    "safety.clock_tolerance_s": "how far the mount's sidereal clock may differ from this computer's",
    "camera.fov_deg": "diameter of the field of view",
    "camera.scale_arcsec_px": "arcseconds in a pixel, for offsets in pixels",
    "camera.rotation_deg": "position angle of the image's up, from north through east (from the tube's up "
    "where the field rotates); 0 if left out",
    "camera.flipped": "whether the image is mirrored; not if left out",
    "camera.kind": "`coarse`: it finds the target; `fine`: the target is centred in it",
    "cameras": "tables `[cameras.NAME]` with the keys of `camera`, for offsets of the camera of that name",
    "screen.theme": "`night`, `red` or `contrast`",
    "screen.ascii": "draw with ASCII characters only",
    "name": "the mount's name",
    "ra.max_rate_deg_s": "largest rate of the hour angle axis",
    "ra.max_acceleration_deg_s2": "its largest acceleration",
    "ra.slew_rate_deg_s": "how fast it slews",
    "ra.max_current_a": "drive current above which the mount is stopped; not watched if left out",
    "ra.lag_s": "mean delay of the axis' rate behind the command",
    "dec.max_rate_deg_s": "the same for the declination axis",
    "dec.max_acceleration_deg_s2": "",
    "dec.slew_rate_deg_s": "",
    "dec.max_current_a": "",
    "dec.lag_s": "",
    "ra_rate_sign": "1: a positive rate increases the hour angle; -1: the opposite",
    "dec_rate_sign": "1: a positive rate goes north; -1: the opposite",
    "ra_rate_sign_beyond_pole": "the same on the other side of the pier; like the first if left out",
    "dec_rate_sign_beyond_pole": "",
    "ra_rate_gain": "rate that results, divided by the rate commanded",
    "dec_rate_gain": "",
    "additive": "whether commanded rates add to sidereal tracking",
    "move_axis": "`held`: rates act while the flag is up; `edge`: from its rise until the next or an abort",
    "hour_angle_limit_deg": "travel of the hour angle axis either way of the meridian, cables counted",
    "dec_axis_limits_deg": "travel of the declination axis; beyond 90° it is past the pole",
    "pier_rule": "on which side a slew ends: `never` beyond the pole, or by `hour_angle`",
    "slew_path": "`any`: each axis in its own time; `together`: a straight line",
    "solar_filter": "true while a solar filter is on the telescope; without it the Sun is not followed",
    "pier_zones": "polygons where something would touch the pier: `name`, `corners`, `side`",
    "stands_at": "`latitude_deg` and `longitude_deg` of the only site that this profile is for",
    "through_pole": "whether a pass may be followed through the celestial pole",
    "period_s": "time between commands",
    "command_delay_s": "mean delay from sending to the mount",
    "status_delay_s": "shortest delay from the mount's sample to us",
    "abort_delay_s": "how much later than other commands an abort acts",
    "clock_offset_s": "the mount's sidereal clock ahead of the true one; estimated if left out",
    "encoder_tics": "encoder counts in a turn",
    "watchdog_s": "silence after which the mount stops by itself; left out: it never does",
    "repeat_rates": "send rates twice a period: `never`, `when_lossy`, `always`",
    "park": "`hour_angle_deg` and `dec_deg` of the park position",
    "home": "the same of the home position",
    "readings": "types of the status fields that the protocol leaves open; written by a calibration",
    "calibration": "what a calibration measured; written by it",
    "geometry": "how the axes lie; left out: equatorial. See [Axes that are not equatorial](geometry.md)",
    "sky": "what cameras have shown of the mount and of themselves; written by `--learn-profile`",
    "pointing": "the pointing model, date and residuals; written by `sattrack star-run`",
    "periodic": "errors of the axes that repeat in a turn; written by `sattrack report --learn-profile`",
}


def settings_table(struct: type[msgspec.Struct]) -> str:
    """Return the settings of a struct as a Markdown table, sections inlined. Raises RegionError where one
    is not explained here."""
    lines = ["| key | default | unit | meaning |", "|---|---|---|---|"]
    for key, default in _fields(struct, ""):
        if key not in MEANINGS:
            raise RegionError(f"{key} has no meaning in tools/reference.py")
        unit = next((one for suffix, one in UNITS.items() if key.endswith(suffix)), "")
        lines.append(f"| `{key}` | {default} | {unit} | {MEANINGS[key] or 'the same'} |")
    return "\n".join(lines)


def _fields(struct: type[msgspec.Struct], prefix: str) -> Iterator[tuple[str, str]]:
    """Yield each key with its default; of a section, those of its fields."""
    hints = typing.get_type_hints(struct)
    for field in msgspec.structs.fields(struct):
        inner = _section(hints[field.name], field)
        if inner is not None:
            yield from _fields(inner, f"{prefix}{field.name}.")
        else:
            yield prefix + field.name, _default(field)


def _section(hint: Any, field: msgspec.structs.FieldInfo) -> type[msgspec.Struct] | None:
    """Return the struct of a section that always has a value or belongs to every file; else None."""
    one = next((part for part in typing.get_args(hint) if part is not types.NoneType), hint)
    inlined = isinstance(field.default, msgspec.Struct) or field.name == "site"
    return one if inlined and isinstance(one, type) and issubclass(one, msgspec.Struct) else None


def _default(field: msgspec.structs.FieldInfo) -> str:
    if field.default is msgspec.NODEFAULT:
        return "required" if field.default_factory is msgspec.NODEFAULT else "none"
    if field.default is None or field.default == ():
        return "none"
    if isinstance(field.default, bool):
        return str(field.default).lower()
    if isinstance(field.default, tuple):
        return f"[{', '.join(f'{one:g}' for one in field.default)}]"
    return f"{field.default:g}" if isinstance(field.default, float) else f"{field.default}"


def commands_text() -> str:
    """Return every command with its help and options as Markdown."""
    parts = []
    for name, command in _commands(cli, "sattrack"):
        context = click.Context(command, info_name=name)
        arguments = " ".join(command.collect_usage_pieces(context))
        own = [option for option in _options(command) if COMMON.isdisjoint(option.opts)]
        parts += [f"## {name}", "", f"`{name} {arguments}`", "", _help(command), ""]
        if own:
            parts += ["| option | default | meaning |", "|---|---|---|"]
            parts += [_row(option, context) for option in own]
            parts.append("")
        shared = [option.opts[0] for option in _options(command) if not COMMON.isdisjoint(option.opts)]
        parts += [f"Common options: {', '.join(f'`{one}`' for one in shared)}.", ""]
    return "\n".join(parts).rstrip()


def common_table() -> str:
    """Return the options that commands share."""
    track = next(command for name, command in _commands(cli, "sattrack") if name == "sattrack track")
    context = click.Context(track, info_name="track")
    shared = [option for option in _options(track) if not COMMON.isdisjoint(option.opts)]
    return "\n".join(["| option | default | meaning |", "|---|---|---|", *(_row(o, context) for o in shared)])


def _commands(command: click.Command, name: str) -> Iterator[tuple[str, click.Command]]:
    if not isinstance(command, click.Group):
        yield name, command
        return
    context = click.Context(command, info_name=name)
    for one in command.list_commands(context):
        found = command.get_command(context, one)
        assert found is not None
        yield from _commands(found, f"{name} {one}")


def _options(command: click.Command) -> list[click.Option]:
    return [one for one in command.params if isinstance(one, click.Option) and not one.hidden]


def _help(command: click.Command) -> str:
    """Return the help as Markdown; paragraphs that click leaves as they are become code."""
    paragraphs = []
    for one in (command.help or "").split("\n\n"):
        lines = one.strip("\n").splitlines()
        if lines and lines[0].strip() == "\b":
            shown = [line.strip() for line in lines[1:] if line.strip()]
            if shown[0] == EXAMPLES:
                paragraphs.append("\n".join(["```sh", *shown[1:], "```"]))
            else:
                paragraphs.append("\n".join(["```text", *shown, "```"]))
        else:
            paragraphs.append(" ".join(one.split()))
    return "\n\n".join(paragraphs)


def _row(option: click.Option, context: click.Context) -> str:
    record = option.get_help_record(context)
    words = record[1] if record else ""
    default = option.default if option.show_default and option.default not in (None, ()) else ""
    words = words.partition("  [default:")[0].partition("[default:")[0].strip()
    cells = (f"`{record[0] if record else option.opts[0]}`", str(default), words)
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def commands(root: Path) -> str:
    """Return what docs/commands.md should hold. Raises RegionError, OSError."""
    text = (root / COMMANDS).read_text(encoding="utf-8")
    return replace_region(replace_region(text, "common", common_table()), "commands", commands_text())


def settings(root: Path) -> str:
    """Return what docs/settings.md should hold. Raises RegionError, OSError."""
    text = (root / SETTINGS).read_text(encoding="utf-8")
    text = replace_region(text, "settings", settings_table(Settings))
    return replace_region(text, "profile", settings_table(MountProfile))


def man_page(root: Path) -> str:
    """Return the man page of all commands, as roff; its exit codes are those of docs/commands.md."""
    exit_codes = re.findall(
        r"^\| (\d+) \| (.*) \|$", (root / COMMANDS).read_text(encoding="utf-8"), re.MULTILINE
    )
    lines = [
        f'.TH SATTRACK 1 "" "sattrack {__version__}" "User Commands"',
        ".SH NAME",
        "sattrack \\- make a telescope mount follow satellites",
        ".SH SYNOPSIS",
        "sattrack COMMAND [OPTIONS] [ARGUMENTS]",
        ".SH DESCRIPTION",
        *_man_help(cli),
    ]
    for title, names in GROUPS.items():
        lines.append(f".SS {_roff(title)}")
        for name in names:
            lines += [".TP", f".B {_roff(name)}", _roff(SUMMARIES[name])]
    lines.append(".SH COMMANDS")
    for name, command in _commands(cli, "sattrack"):
        context = click.Context(command, info_name=name)
        arguments = _roff(" ".join(command.collect_usage_pieces(context)))
        lines += [f".SS {_roff(name)} {arguments}", *_man_help(command)]
        for option in _options(command):
            record = option.get_help_record(context)
            if record is not None:
                lines += [".TP", f".B {_roff(record[0])}", _roff(record[1] or "See the documentation.")]
    lines += [".SH EXIT STATUS"]
    for code, meaning in exit_codes:
        lines += [".TP", f".B {code}", _roff(meaning)]
    return "\n".join(lines) + "\n"


def _man_help(command: click.Command) -> list[str]:
    """Return the help as roff; paragraphs that click leaves as they are become displays."""
    lines = []
    for one in (command.help or "").strip().split("\n\n"):
        first, *rest = one.strip("\n").splitlines()
        if first.strip() == "\b":
            lines += [".PP", ".nf", *(_roff(line) for line in rest), ".fi"]
        else:
            lines += [".PP", _roff(" ".join(one.split()))]
    return lines


def _roff(text: str) -> str:
    """Return text for a line of roff: its first character is no request, its hyphens are typed ones."""
    plain = text.replace("\\", "\\e").replace("-", "\\-")
    return f"\\&{plain}" if plain.startswith((".", "'")) else plain


def main() -> int:
    """Write or compare; return the exit code."""
    return max(
        write_or_compare(NAME, __doc__, MAN, man_page),
        write_or_compare(NAME, __doc__, COMMANDS, commands),
        write_or_compare(NAME, __doc__, SETTINGS, settings),
    )


if __name__ == "__main__":
    sys.exit(main())
