"""Settings that change while a command runs: it keeps those with which it began, and says so at its end."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.core.errors import SattrackError
from sattrack.settings import find_settings_file, load_settings

if TYPE_CHECKING:
    from pathlib import Path


class SettingsWatch:
    """Remembers how the files stand from which settings came."""

    def __init__(self, config: Path | None, named: list[Path]) -> None:
        found = find_settings_file(config)
        self._config = config
        self._before = {path: _stamp(path) for path in ([found] if found else []) + named}

    def words(self) -> str | None:
        """Return what to tell where a file is not as it was, and None where all are."""
        changed = [path for path, stamp in self._before.items() if _stamp(path) != stamp]
        if not changed:
            return None
        names = ", ".join(str(path) for path in changed)
        kept = f"{names} changed meanwhile: what ran kept the settings with which it began"
        try:
            load_settings(self._config).safety.limits()
        except SattrackError as error:
            return f"{kept}; the next command will refuse them: {error}"
        return f"{kept}; the next command takes them"


def _stamp(path: Path) -> tuple[int, int] | None:
    try:
        stat = path.stat()
    except OSError:
        return None
    return stat.st_mtime_ns, stat.st_size
