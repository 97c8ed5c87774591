"""A data set of partitions on disk: whole files only, what is finished is known by its sum.

`_manifest.json` has the settings and versions, `_partitions.jsonl` a line for each finished file. Readers of
Parquet pass by files whose names begin with an underscore.
"""

from __future__ import annotations

import hashlib
import json
import os
from contextlib import suppress
from typing import TYPE_CHECKING, Any, NamedTuple

from sattrack.core.errors import BadInputError, SattrackError
from sattrack.core.files import PART, lock_file, replace_file
from sattrack.views.formatting import counted

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path
    from typing import Self

MANIFEST, JOURNAL = "_manifest.json", "_partitions.jsonl"
_MANY = 3


class Finished(NamedTuple):
    """A finished file: its place in the data set, passes, bytes, SHA-256."""

    path: str
    passes: int
    size: int
    sha256: str


class DataSet:
    """One folder, held by one process. Use it in a `with` statement.

    Raises BadInputError where the folder holds a data set of other settings or versions, or something else;
    SattrackError where it cannot be written, or another process writes it.
    """

    def __init__(self, folder: Path, manifest: Mapping[str, Any]) -> None:
        self.folder = folder
        self.done: dict[str, Finished] = {}
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._journal = (
                (folder / JOURNAL).open("a+b") if self._is_ours(manifest) else self._begin(manifest)
            )
        except OSError as error:
            raise self._trouble(error) from error
        try:
            lock_file(self._journal, wait=False)
        except OSError:
            self._journal.close()
            raise SattrackError(f"{folder}: another process is writing this data set") from None
        self._read()

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Let go of the folder."""
        self._journal.close()

    def _is_ours(self, manifest: Mapping[str, Any]) -> bool:
        """Return whether the data set was begun before; raises BadInputError where that was another."""
        path = self.folder / MANIFEST
        try:
            there = json.loads(path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            others = [one.name for one in self.folder.iterdir() if not one.name.endswith(PART)]
            if others and others != [JOURNAL]:
                raise BadInputError(
                    f"{self.folder}: holds {others[0]} and no data set; give an empty or a new folder"
                ) from None
            return False
        except ValueError:
            raise BadInputError(f"{path}: no manifest of a data set; give another folder") from None
        differs = list(differences(there, json.loads(json.dumps(manifest))))
        if differs:
            more = f" and {len(differs) - _MANY} more" if differs[_MANY:] else ""
            raise BadInputError(
                f"{self.folder}: was made with other settings: {'; '.join(differs[:_MANY])}{more}; "
                "give another folder"
            )
        return True

    def _begin(self, manifest: Mapping[str, Any]) -> Any:
        journal = (self.folder / JOURNAL).open("a+b")
        replace_file(self.folder / MANIFEST, json.dumps(manifest, indent=1, sort_keys=True).encode() + b"\n")
        return journal

    def _read(self) -> None:
        """Take what the journal says is finished; a line that was cut off counts for nothing."""
        self._journal.seek(0)
        for line in self._journal.read().split(b"\n"):
            with suppress(ValueError, TypeError):
                one = Finished(**json.loads(line))
                self.done[one.path] = one

    def verified(self, paths: Iterable[str]) -> dict[str, Finished]:
        """Return those of some files that are there as their sums say; what is half there is removed."""
        found = {}
        for path in paths:
            one, file = self.done.get(path), self.folder / path
            with suppress(OSError):
                for part in file.parent.glob(f".{file.name}.*{PART}"):
                    part.unlink(missing_ok=True)
                if one is not None and _sum_of(file) == one.sha256:
                    found[path] = one
        self.done = dict(found)
        return found

    def put(self, path: str, data: bytes, passes: int) -> None:
        """Write a file whole and note that it is finished. Raises SattrackError."""
        one = Finished(path, passes, len(data), hashlib.sha256(data).hexdigest())
        try:
            (self.folder / path).parent.mkdir(parents=True, exist_ok=True)
            replace_file(self.folder / path, data)
            # What was cut off in the last line must not spoil this one.
            self._journal.write(b"\n" + _line(one))
            self._journal.flush()
            os.fsync(self._journal.fileno())
        except OSError as error:
            raise self._trouble(error) from error
        self.done[path] = one

    def finish(self) -> None:
        """Put the journal in order, so that it is the same however the work went. Raises SattrackError."""
        try:
            replace_file(
                self.folder / JOURNAL, b"\n".join(_line(self.done[p]) for p in sorted(self.done)) + b"\n"
            )
        except OSError as error:
            raise self._trouble(error) from error

    def _trouble(self, error: OSError) -> SattrackError:
        return SattrackError(
            f"{self.folder}: cannot be written: {error.strerror or error}; "
            f"{counted(len(self.done), 'file')} finished and kept: the same command continues from there"
        )


def _line(one: Finished) -> bytes:
    return json.dumps(one._asdict()).encode()


def _sum_of(file: Path) -> str:
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def differences(there: Any, here: Any, name: str = "") -> Iterable[str]:
    """Yield in words where two manifests differ."""
    if isinstance(there, dict) and isinstance(here, dict):
        for key in sorted({*there, *here}):
            yield from differences(there.get(key), here.get(key), f"{name}.{key}" if name else key)
    elif there != here:
        yield f"{name} {_shown(there)} there, {_shown(here)} here"


def _shown(value: Any) -> str:
    text = "none" if value is None else json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 60 else f"{text[:57]}..."
