"""Write docs/commands.md, settings.md, json.md, api.md and the man page: `python -m tools.reference`.

They, or parts of them, are made from the code. With `--check` nothing is written; the exit code is 1 where
one differs. The wheel holds the man page, docs/sattrack.1, as share/man/man1/sattrack.1.
"""

from __future__ import annotations

import ast
import inspect
import itertools
import re
import sys
import types
import typing
from typing import TYPE_CHECKING, Any

import click
import msgspec

import tle
import tle.skyfield
from sattrack import __version__
from sattrack.cli.main import COMMANDS as SUMMARIES
from sattrack.cli.main import GROUPS, cli
from sattrack.mount.model import MountProfile
from sattrack.planning.rehearsal import RehearsalReport
from sattrack.recording.report import Report
from sattrack.settings import Settings
from sattrack.views.run import LearntView
from tools.protocol.regions import RegionError, replace_region
from tools.writing import write_or_compare

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

NAME = "python -m tools.reference"
WIDEST = 90
COMMANDS, SETTINGS, MAN = "docs/commands.md", "docs/settings.md", "docs/sattrack.1"
API, JSON = "docs/api.md", "docs/json.md"
SKYFIELD = ("from_skyfield", "to_skyfield")
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
    "mount.url": "the mount: `sim`, `xerxes://…`, `alpaca://…`, `indi://…`, `antenna://…`",
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
    "hour_angle_limit_deg": "travel of the hour angle axis either way, cables counted; 720 at most",
    "dec_axis_limits_deg": "travel of the declination axis; beyond 90° it is past the pole",
    "pier_rule": "slews that end beyond the pole: `never`; `hour_angle`: in the west; `ascom`: in the east",
    "slew_path": "`any`: each axis in its own time; `together`: a straight line",
    "solar_filter": "true while a solar filter is on the telescope; without it the Sun is not followed",
    "pier_zones": "polygons where something would touch the pier: `name`, `corners`, `side`",
    "stands_at": "`latitude_deg` and `longitude_deg` of the only site that this profile is for",
    "through_pole": "whether a pass may be followed through the celestial pole",
    "period_s": "time between commands, 0.001 to 0.5",
    "command_delay_s": "mean delay from sending to the mount",
    "status_delay_s": "shortest delay from the mount's sample to us",
    "abort_delay_s": "how much later than other commands an abort acts",
    "clock_offset_s": "the mount's sidereal clock ahead of the true one; estimated if left out",
    "dated_by_requests": "positions are dated by this computer's clock; the mount's address decides it",
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


def json_documents(root: Path) -> str:
    """Return what docs/json.md should hold. Raises RegionError, OSError."""
    text = (root / JSON).read_text(encoding="utf-8")
    text = replace_region(text, "rehearse", document_text(RehearsalReport))
    text = replace_region(text, "learnt", document_text(LearntView))
    return replace_region(text, "report", document_text(Report))


def document_text(struct: type[msgspec.Struct]) -> str:
    """Return the fields of a document and of the objects in it as Markdown tables."""
    parts, waiting, seen = [], [struct], {struct}
    while waiting:
        one = waiting.pop(0)
        hints, meanings = typing.get_type_hints(one), _meanings(one)
        if one is not struct:
            parts += [f"`{one.__name__}`: {' '.join((inspect.getdoc(one) or '').split())}", ""]
        parts += ["| field | | |", "|---|---|---|"]
        for field in msgspec.structs.fields(one):
            kind = hints[field.name]
            parts.append(f"| `{field.encode_name}` | {_json_kind(kind)} | {meanings.get(field.name, '')} |")
            inner = [each for each in dict.fromkeys(_structs(kind)) if each not in seen]
            waiting += inner
            seen.update(inner)
        parts.append("")
    return "\n".join(parts).rstrip()


def _meanings(struct: type) -> dict[str, str]:
    """Return the docstrings of a struct's fields."""
    body = ast.parse(inspect.getsource(struct)).body[0]
    assert isinstance(body, ast.ClassDef)
    found = {}
    for one, following in itertools.pairwise(body.body):
        is_field = isinstance(one, ast.AnnAssign) and isinstance(one.target, ast.Name)
        if is_field and isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant):
            found[one.target.id] = " ".join(str(following.value.value).split())  # type: ignore[union-attr]
    return found


JSON_KINDS = {str: "text", int: "number", float: "number", bool: "true or false", types.NoneType: "null"}


def _json_kind(hint: Any) -> str:
    """Return what a field is in JSON."""
    if hint in JSON_KINDS:
        return JSON_KINDS[hint]
    arguments = [one for one in typing.get_args(hint) if one is not Ellipsis]
    origin = typing.get_origin(hint)
    if origin is dict:
        return f"object by name, of {_json_kind(arguments[1])}"
    if origin in (tuple, list):
        return f"list of {' and '.join(dict.fromkeys(_json_kind(one) for one in arguments))}"
    if origin is typing.Literal:
        return " or ".join(f"`{one}`" for one in arguments)
    if arguments:
        return " or ".join(_json_kind(one) for one in arguments)
    return f"`{hint.__name__}`"


def _structs(hint: Any) -> list[type[msgspec.Struct]]:
    if isinstance(hint, type) and issubclass(hint, msgspec.Struct):
        return [hint]
    return [found for one in typing.get_args(hint) for found in _structs(one)]


def api(root: Path) -> str:
    """Return what docs/api.md should hold. Raises RegionError, OSError."""
    text = (root / API).read_text(encoding="utf-8")
    return replace_region(text, "api", api_text())


def api_text() -> str:
    """Return every public name of the library with its signature and docstring, as Markdown."""
    named = [(name, getattr(tle, name)) for name in sorted(tle.__all__, key=str.casefold)]
    named += [(f"skyfield.{name}", getattr(tle.skyfield, name)) for name in SKYFIELD]
    parts = []
    for name, one in named:
        parts += [f"## tle.{name}", "", *_described(one, name.rpartition(".")[2])]
        if inspect.isclass(one) and not _is_error(one):
            parts += _members(one)
    return "\n".join(parts).rstrip()


def _described(one: Any, name: str) -> list[str]:
    """Return a signature, if it has one of its own, and the docstring."""
    lines = [] if _is_error(one) else ["```python", f"{name}{_signature(one)}", "```", ""]
    return [*lines, inspect.getdoc(one) or "", ""]


def _is_error(one: Any) -> bool:
    return inspect.isclass(one) and issubclass(one, Exception)


def _signature(one: Any) -> str:
    """Return a signature as it stands in the code, over several lines where it is long."""
    signature = inspect.signature(one)
    parameters = [p for p in signature.parameters.values() if p.name not in ("self", "cls")]
    returns = signature.return_annotation
    if inspect.isclass(one) or returns is inspect.Signature.empty:
        returns = ""
    texts = [str(p.replace(annotation=_Plain(p.annotation))) for p in parameters]
    end = f") -> {_Plain(returns)!r}" if returns else ")"
    whole = f"({', '.join(texts)}{end}"
    return whole if len(whole) <= WIDEST else "(\n" + "".join(f"    {one},\n" for one in texts) + end


class _Plain:
    """An annotation that is shown as it is written."""

    def __init__(self, annotation: Any) -> None:
        self._text = annotation if isinstance(annotation, str) else inspect.formatannotation(annotation)

    def __repr__(self) -> str:
        return self._text


def _members(kind: type) -> list[str]:
    """Return the public attributes, properties and methods of a class as a table."""
    rows = []
    for name, value in sorted(vars(kind).items()):
        if name.startswith("_"):
            continue
        plain = value.__func__ if isinstance(value, classmethod | staticmethod) else value
        if isinstance(value, property):
            shown = f"`{name}`: `{_Plain(inspect.signature(value.fget).return_annotation)!r}`"  # type: ignore[arg-type]
        elif inspect.isfunction(plain):
            shown = f"`{name}{' '.join(_signature(plain).split())}`"
        else:
            continue
        rows.append((shown, " ".join((inspect.getdoc(value) or "").split())))
    if not rows:
        return []
    cells = [" | ".join(cell.replace("|", "\\|") for cell in row) for row in rows]
    return ["| member | |", "|---|---|", *(f"| {row} |" for row in cells), ""]


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
        write_or_compare(NAME, __doc__, API, api),
        write_or_compare(NAME, __doc__, JSON, json_documents),
    )


if __name__ == "__main__":
    sys.exit(main())
