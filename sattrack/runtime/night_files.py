"""The folder of a schedule's run: the status for whoever looks, summaries, recordings, elements."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import tomli_w

from sattrack.errors import SattrackError
from sattrack.runtime.night_journal import holder
from sattrack.schedule.summary import page, summary_name, text_lines
from sattrack.schedule_view import ScheduleView
from tle.formats.registry import write_elements
from tle.instants import Utc

if TYPE_CHECKING:
    from sattrack.profiles import ProfileFile
    from sattrack.schedule.night import NightPass, Run

STATUS, PROFILE = "status.json", "mount.toml"
SUMMARIES, RECORDINGS, ELEMENTS = "summaries", "recordings", "elements"


class NightFiles:
    """The files of one folder; every method raises SattrackError where they cannot be written."""

    def __init__(self, folder: Path, schedule: str) -> None:
        """Take the folder, and the schedule's name for people."""
        self.folder, self.schedule = folder, schedule

    def tell(self, view: ScheduleView) -> None:
        """Put the status in the place of the last one: nobody ever reads half."""
        self._write(STATUS, msgspec.json.encode(view) + b"\n")

    def sum_up(self, run: Run) -> str:
        """Write a night's summary as text and as HTML; return the text's name in the folder."""
        name = f"{SUMMARIES}/{summary_name(run)}"
        text = "\n".join(text_lines(run, self.schedule)) + "\n"
        self._write(f"{name}.html", page(run, self.schedule, "../").encode())
        self._write(f"{name}.txt", text.encode())
        return f"{name}.txt"

    def recording(self, one: NightPass, part: int) -> str:
        """Return the name in the folder of a new recording of a go at a pass."""
        start = Utc(one.start_utc_s).isoformat("seconds").translate({ord(c): None for c in "-:"})
        stem = f"{RECORDINGS}/{start}-{one.elements.catalog_number}"
        (self.folder / RECORDINGS).mkdir(parents=True, exist_ok=True)
        name, count = f"{stem}-{part}.mcap", 1
        while (self.folder / name).exists():
            count += 1
            name = f"{stem}-{part}-{count}.mcap"
        return name

    def elements(self, one: NightPass) -> Path:
        """Write the elements that a pass is followed by; return where."""
        name = f"{ELEMENTS}/{one.elements.catalog_number}.json"
        self._write(name, write_elements([one.elements], "json").encode())
        return self.folder / name

    def profile(self, profile: ProfileFile) -> Path:
        """Write the mount's profile as sessions are to have it; return where."""
        said = {name: value for name, value in msgspec.to_builtins(profile).items() if value is not None}
        self._write(PROFILE, tomli_w.dumps(_without_none(said)).encode())
        return self.folder / PROFILE

    def _write(self, name: str, data: bytes) -> None:
        path = self.folder / name
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=".part-")
            with os.fdopen(handle, "wb") as file:
                file.write(data)
            Path(temporary).chmod(0o644)
            Path(temporary).replace(path)
        except OSError as error:
            raise SattrackError(f"cannot write {path}: {error.strerror}") from None


def _without_none(value: Any) -> Any:
    """Return plain data without what is None, which TOML cannot say."""
    if isinstance(value, dict):
        return {key: _without_none(each) for key, each in value.items() if each is not None}
    return [_without_none(each) for each in value] if isinstance(value, list | tuple) else value


def read_status(folder: Path) -> ScheduleView | None:
    """Return the last status of a folder, its `running` and `pid` as they are; None where there is none.

    Raises SattrackError where it is none.
    """
    try:
        data = (folder / STATUS).read_bytes()
        view = msgspec.json.decode(data, type=ScheduleView)
    except FileNotFoundError:
        return None
    except (OSError, msgspec.MsgspecError) as error:
        raise SattrackError(f"{folder / STATUS}: no status to be read: {error}") from None
    pid = holder(folder)
    return msgspec.structs.replace(view, running=pid is not None, pid=pid)
