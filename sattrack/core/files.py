"""The user's folders, and files that other programs read while they are written."""

from __future__ import annotations

import errno
import os
import stat
import sys
import zlib
from contextlib import suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

PART = ".part"


def user_folder(variable: str, usual: str, environ: Mapping[str, str] | None = None) -> Path:
    """Return this program's folder below that of a variable, else below `usual` in the home folder.

    A variable that holds a relative path does not count ("XDG Base Directory Specification" 0.8). Of a user
    without a home, as a container may have, the home is the root folder.
    """
    base = Path((os.environ if environ is None else environ).get(variable, ""))
    if not base.is_absolute():
        try:
            base = Path.home() / usual
        except RuntimeError:
            base = Path(os.sep) / usual
    return base / "sattrack"


def shortened(name: str, longest: int) -> str:
    """Return a name of so many characters at most: of a longer one its beginning and a checksum."""
    if len(name) <= longest:
        return name
    checksum = f"~{zlib.crc32(name.encode()):08x}"
    return name[: longest - len(checksum)] + checksum


def open_regular(path: Path, *, follow_link: bool = False) -> IO[bytes]:
    """Open a file that others may have put there, for reading. Raises OSError for a pipe, a device, a folder.

    To open a pipe would wait for a writer. A link is refused too, unless the caller lets it be followed.
    """
    no_link = 0 if follow_link else getattr(os, "O_NOFOLLOW", 0)
    descriptor = os.open(path, os.O_RDONLY | no_link | getattr(os, "O_NONBLOCK", 0))
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        # A file object for a folder cannot be made: it would leave this open.
        os.close(descriptor)
        raise OSError(errno.EINVAL, "no regular file", str(path))
    return os.fdopen(descriptor, "rb")


def lock_file(file: IO[Any], *, wait: bool = True) -> None:
    """Keep an open file from other processes that ask so, until it is closed or this process ends.

    Raises OSError where another has it and this must not `wait`. Windows has no such lock: none is taken.
    """
    if sys.platform != "win32":
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)


def replace_file(path: Path, data: bytes, *, synced: bool = True) -> None:
    """Write a file that is never there half written; `synced`, not after a loss of power either.

    A process that is killed meanwhile leaves `.NAME.PID.part` behind. Raises OSError.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}{PART}")
    try:
        with part.open("wb") as stream:
            stream.write(data)
            stream.flush()
            if synced:
                os.fsync(stream.fileno())
        part.replace(path)
    except BaseException:
        with suppress(OSError):
            part.unlink()
        raise
    if synced:
        # Not every file system can do it; the file itself is whole by now.
        with suppress(OSError):
            holder = os.open(path.parent, os.O_RDONLY)
            try:
                os.fsync(holder)
            finally:
                os.close(holder)
