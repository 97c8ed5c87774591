"""What was downloaded, kept in the user's cache folder with its age; when servers were asked.

A file is one line of JSON and then the text as it came, and is put in place whole: nobody ever reads half.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import re
import tempfile
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sattrack.core.errors import SattrackError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping


@dataclass(frozen=True, slots=True)
class Kept:
    """A download: its text, and when it was complete, in POSIX seconds."""

    text: str
    fetched_unix_s: float


def user_cache_folder(environ: Mapping[str, str]) -> Path:
    """Return the folder for downloads: under XDG_CACHE_HOME where that is set, else the user's .cache."""
    base = environ.get("XDG_CACHE_HOME", "")
    home = Path(base) if Path(base).is_absolute() else Path.home() / ".cache"
    return home / "sattrack" / "elements"


class DownloadCache:
    """The files of one folder. Every method raises SattrackError where the folder cannot be used."""

    def __init__(self, folder: Path) -> None:
        """Take the folder; it is made when something is first put into it."""
        self.folder = folder

    def read(self, url: str) -> Kept | None:
        """Return what was kept of a URL; None where there is nothing, or nothing whole."""
        try:
            data = self._path(url, "elements").read_bytes()
        except OSError:
            return None
        head, _, body = data.partition(b"\n")
        try:
            facts = json.loads(head)
            if facts["url"] != url or facts["bytes"] != len(body):
                return None
            return Kept(body.decode("utf-8"), float(facts["fetched_unix_s"]))
        except (ValueError, KeyError, TypeError):
            return None

    def keep(self, url: str, text: str, fetched_unix_s: float) -> None:
        """Put a download in the place of the one before it."""
        body = text.encode("utf-8")
        facts = {"url": url, "fetched_unix_s": fetched_unix_s, "bytes": len(body)}
        self._write(self._path(url, "elements"), json.dumps(facts).encode() + b"\n" + body)

    def asked(self, name: str) -> list[float]:
        """Return when the server was asked for a URL, or a provider for anything, in POSIX seconds."""
        try:
            found = json.loads(self._path(name, "asked").read_bytes())
            return [float(unix_s) for unix_s in found]
        except (OSError, ValueError, TypeError):
            return []

    def set_asked(self, name: str, unix_s: list[float]) -> None:
        """Keep when the server was asked, in the place of what was kept before."""
        self._write(self._path(name, "asked"), json.dumps(unix_s).encode())

    @contextmanager
    def alone(self, provider: str) -> Iterator[None]:
        """Let no other process ask the same provider until this block ends: waits for one that does."""
        path = self._path(provider, "lock")
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            file = path.open("w")
        except OSError as error:
            raise self._unusable(error) from error
        with file:
            # Closing the file gives the lock back, as the end of the process does.
            fcntl.flock(file, fcntl.LOCK_EX)
            yield

    def _path(self, name: str, kind: str) -> Path:
        words = re.sub(r"[^A-Za-z0-9]+", "-", re.sub(r"^https?://", "", name)).strip("-")[-60:]
        return self.folder / f"{words}-{hashlib.sha256(name.encode()).hexdigest()[:12]}.{kind}"

    def _write(self, path: Path, data: bytes) -> None:
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            handle, temporary = tempfile.mkstemp(dir=self.folder, prefix=".part-")
            try:
                with os.fdopen(handle, "wb") as file:
                    file.write(data)
                    file.flush()
                    os.fsync(file.fileno())
                Path(temporary).replace(path)
            except BaseException:
                Path(temporary).unlink(missing_ok=True)
                raise
        except OSError as error:
            raise self._unusable(error) from error

    def _unusable(self, error: OSError) -> SattrackError:
        return SattrackError(
            f"{self.folder}: downloads cannot be kept there: {error.strerror or error}: "
            "set XDG_CACHE_HOME to a folder that can be written"
        )
