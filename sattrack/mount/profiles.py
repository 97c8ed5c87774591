"""Mount profile files: one TOML file describes one mount, to the tracker and to the simulator alike."""

from __future__ import annotations

import re
import tomllib
from collections.abc import MutableMapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import msgspec

from sattrack.core.errors import BadInputError
from sattrack.core.toml_text import read_toml
from sattrack.mount.model import MountProfile

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


OF_SETTINGS = re.compile("unknown key '(elements|site|mount|min_altitude_deg|safety|camera|screen|zone)'")
"""What is wrong with a settings file that is given for a profile."""


class ProfileFile(MountProfile, frozen=True, forbid_unknown_fields=True):
    """A profile as it stands in a file; the table `[simulator]` says what only a simulated mount needs."""

    simulator: dict[str, Any] = msgspec.field(default_factory=dict)

    @property
    def mount(self) -> MountProfile:
        """The part that is true of real mounts too."""
        return MountProfile(**{name: getattr(self, name) for name in MountProfile.__struct_fields__})


def profile_file(profile: MountProfile) -> ProfileFile:
    """Return a profile as it would stand in a file."""
    return ProfileFile(**{name: getattr(profile, name) for name in MountProfile.__struct_fields__})


def load_profile_file(path: Path) -> ProfileFile:
    """Return what a profile file says. Raises BadInputError, naming file, line and key."""
    with no_settings(path, "not a mount's profile; `profile` in its [mount] names one"):
        return read_toml(path, ProfileFile, "the mount profile")


@contextmanager
def no_settings(path: Path, but: str) -> Iterator[None]:
    """Raise BadInputError that says so where what is read turns out to be a settings file; `but` ends it."""
    try:
        yield
    except BadInputError as error:
        if OF_SETTINGS.search(str(error)) is None:
            raise
        raise BadInputError(f"{path}: this is a settings file, {but}") from None


def profile_text(profile: MountProfile, file: Path | None = None, loaded: MountProfile | None = None) -> str:
    """Return a profile as TOML; what is not known, or empty, is left out.

    With the file that it replaces, comments, order and what has not changed stay as they are written there.
    `loaded` is what the file said when work on the profile began: what somebody wrote there since stays, too,
    as far as the work has not changed it. Raises BadInputError where that is no profile.
    """
    import tomlkit

    values = _plain(profile)
    if file is None:
        return tomlkit.dumps(values)
    before = _plain(load_profile_file(file))
    if loaded is not None:
        merged = _merged(before, _plain(loaded), values)
        # Where both do not go together, such as a place to park beyond a new limit, the work counts.
        values = merged if _read(tomlkit.dumps(merged)) is not None else values
    document = tomlkit.parse(file.read_text(encoding="utf-8-sig"))
    _update(document, before, values)
    updated, plain = document.as_string(), tomlkit.dumps(values)
    # Better without its comments than with another meaning, such as by tables that stand apart.
    return updated if _read(updated) == _read(plain) else plain


def _plain(profile: MountProfile) -> dict[str, Any]:
    found: dict[str, Any] = _without_nothing(msgspec.to_builtins(profile))
    return found


def _merged(now: dict[str, Any], then: dict[str, Any], values: dict[str, Any]) -> dict[str, Any]:
    """Return `values` where they differ from those of `then`, and those of `now` elsewhere.

    A table is one value, as half of a model is none; but the axes' limits count each.
    """
    found: dict[str, Any] = {}
    for key in (*values, *(now.keys() - values.keys())):
        present, past, value = now.get(key), then.get(key), values.get(key)
        if key in {"ra", "dec"}:
            found[key] = _merged(present or {}, past or {}, value or {})
        else:
            found[key] = present if value == past else value
    return {key: value for key, value in found.items() if value is not None and value != {}}


def _update(table: MutableMapping[str, Any], before: dict[str, Any], values: dict[str, Any]) -> None:
    """Bring a table of a document from its values before to others; what is equal is not touched."""
    for key in before.keys() - values.keys() & table.keys():
        del table[key]
    for key, value in values.items():
        earlier, held = before.get(key), table.get(key)
        if isinstance(held, MutableMapping) and isinstance(earlier, dict) and isinstance(value, dict):
            _update(held, earlier, value)
        elif value != earlier:
            table[key] = value


def _read(text: str) -> ProfileFile | None:
    try:
        return msgspec.convert(tomllib.loads(text), ProfileFile)
    except (msgspec.ValidationError, tomllib.TOMLDecodeError):
        return None


def _without_nothing(value: Any) -> Any:
    """Return plain data without what is None, which TOML cannot hold, and without empty tables."""
    if isinstance(value, dict):
        kept = {name: _without_nothing(one) for name, one in value.items()}
        return {name: one for name, one in kept.items() if one is not None and one != {}}
    return [_without_nothing(one) for one in value] if isinstance(value, list | tuple) else value
