"""What commands print, on a terminal and elsewhere, and the files that they write."""

from __future__ import annotations

import contextlib
import os
import select
import stat
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click
import msgspec

from sattrack.core.errors import SattrackError
from sattrack.core.files import replace_file
from tle.errors import printable

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from rich.table import Table
    from rich.text import Text

WRITTEN = f"{__name__}.written"
"""Where a command's context keeps the files that the command has written."""
WIDEST = 4000
"""Columns of what is printed for a pipe or a file: nothing is wrapped there."""

CANNOT_DRAW = {"dumb", "unknown"}
"""Terminals, by the name in TERM, that have no cursor to place: they get lines."""


def say(text: str, *, err: bool = False) -> None:
    """Print text for people; what commands a terminal, in the names and words of others, becomes `?`."""
    click.echo(printable(text, "\n"), err=err)


def tell(text: str) -> None:
    """Tell the user something on standard error, in one line."""
    say(f"sattrack: {text}", err=True)


def write_file(path: Path, text: str) -> None:
    """Put text into a file whole: a file that is read meanwhile, or was there, is never left half written.

    A link is followed. Pipes, devices, and files in a folder that takes no others are written as they stand.
    """
    real = Path(os.path.realpath(path))
    try:
        if path.exists() and not (path.is_file() and os.access(real.parent, os.W_OK)):
            path.write_bytes(text.encode())
        else:
            replace_file(real, text.encode())
    except OSError as error:
        raise SattrackError(f"{path}: cannot be written: {error.strerror or error}") from error
    context = click.get_current_context(silent=True)
    if context is not None:
        context.meta.setdefault(WRITTEN, set()).add(real)


def write_found(path: Path, text: str) -> None:
    """Put what took long to measure into a file; print it where that cannot be written."""
    try:
        write_file(path, text)
    except SattrackError as error:
        click.echo(text, err=True)
        raise SattrackError(f"what was found is printed above: {error}") from error


def table(*heads: str, rows: Iterable[Sequence[str]] = ()) -> Table:
    """Return a table for `show`; a head that begins with > is of numbers, empty ones are not shown.

    The last column is wrapped where a terminal is narrow.
    """
    from rich.table import Table

    made = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), show_header=any(heads), header_style="bold")
    for number, head in enumerate(heads, start=1):
        justify: Literal["left", "right"] = "right" if head.startswith(">") else "left"
        made.add_column(head.removeprefix(">"), justify=justify, no_wrap=number < len(heads))
    for row in rows:
        made.add_row(*row)
    return made


def show(*parts: str | Text | Table) -> None:
    """Print texts and tables: coloured and wrapped as a terminal can, plain and unwrapped elsewhere.

    Their styles are Rich's own; what else commands a terminal becomes `?`.
    """
    from rich.console import Console
    from rich.segment import Segment, Segments
    from rich.text import Text

    # A satellite may be called "ISS [/b]": no text of a cell is markup.
    console = Console(width=None if sys.stdout.isatty() else WIDEST, markup=False, emoji=False)
    with console.capture() as captured:
        for part in parts:
            drawn = console.render(Text(part) if isinstance(part, str) else part)
            console.print(Segments(Segment(printable(one.text, "\n"), one.style) for one in drawn), end="")
    click.echo("\n".join(line.rstrip() for line in captured.get().splitlines()))


def renew(text: str = "") -> None:
    """Write a line on standard error that the next one overwrites; no text wipes it. On a terminal only."""
    if can_draw_lines_anew():
        # A line that wraps would not be overwritten by the next.
        with contextlib.suppress(OSError, ValueError):
            text = text[: os.get_terminal_size(sys.stderr.fileno()).columns - 1]
        click.echo(f"\r\x1b[K{printable(text)}", nl=False, err=True)


def renew_at_once(text: str) -> None:
    """Renew the line unless that would wait: a terminal may be held."""
    if can_draw_lines_anew() and select.select([], [sys.stderr], [], 0.0)[1]:
        renew(text)


def share_progress(number: int = 0, count: int = 1) -> Callable[[float], None] | None:
    """Return a function that shows the share done of the work `number` of `count`; None off a terminal."""
    if not can_draw_lines_anew():
        return None
    return lambda share: renew(f"{100.0 * (number + share) / count:.0f} %")


class JsonLines:
    """Writes objects as JSON lines.

    A reader that does not keep up loses lines, so a loop that feeds a mount is never held up. Of a line that
    is longer than PIPE_BUF, a pipe may take a part: the rest is written before the next line.
    """

    def __init__(self) -> None:
        self._encoder = msgspec.json.Encoder()
        self._out = sys.stdout.fileno()
        self._rest = b""
        self._is_pipe = stat.S_ISFIFO(os.fstat(self._out).st_mode)
        if self._is_pipe:
            os.set_blocking(self._out, False)

    def write(self, item: object) -> None:
        """Write one object. Raises BrokenPipeError where the reader is gone."""
        with contextlib.suppress(BlockingIOError):
            if self._rest:
                self._rest = self._rest[os.write(self._out, self._rest) :]
            if not self._rest:
                line = self._encoder.encode(item) + b"\n"
                self._rest = line[os.write(self._out, line) :]

    def write_whole(self, item: object) -> None:
        """Write one object however long that takes: for where nothing waits for the writer."""
        self.end()
        with os.fdopen(self._out, "wb", closefd=False) as out:
            out.write(self._encoder.encode(item) + b"\n")
        if self._is_pipe:
            os.set_blocking(self._out, False)

    def end(self) -> None:
        """Let what is written by other means from now on be written whole, however long that takes."""
        os.set_blocking(self._out, True)
        rest, self._rest = self._rest, b""
        # A reader that is gone shows at the next line.
        with contextlib.suppress(BrokenPipeError), os.fdopen(self._out, "wb", closefd=False) as out:
            out.write(rest)


def can_draw_lines_anew() -> bool:
    """Tell whether what goes to standard error can be written over, as on a terminal that draws."""
    return sys.stderr.isatty() and os.environ.get("TERM") not in CANNOT_DRAW


def may_colour() -> bool | None:
    """Return what click takes as `color`: none where the user or the terminal wants none, else as it finds.

    https://no-color.org: any value of NO_COLOR but an empty one.
    """
    return False if os.environ.get("NO_COLOR") or os.environ.get("TERM") in CANNOT_DRAW else None
