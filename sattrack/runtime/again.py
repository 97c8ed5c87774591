"""A recorded run made again: its facts read, its engine built."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

from sattrack.core.errors import BadInputError
from sattrack.recording.reading import Recording
from sattrack.runtime.facts import RunFacts, build_engine, decode_facts
from tle.errors import TleError

if TYPE_CHECKING:
    from pathlib import Path

    from sattrack.control.engine import Engine


def open_recording(path: Path, part: int = 1) -> tuple[Recording, RunFacts]:
    """Return a recording and the facts of its run.

    Raises BadInputError where the file is none, or its facts cannot be read by this version.
    """
    recording = Recording(path, part)
    try:
        facts = decode_facts(recording.header.spec)
    except (msgspec.MsgspecError, TleError) as error:
        raise BadInputError(
            f"{path}: the run's facts, written by sattrack {recording.header.program_version}, "
            f"cannot be read: {error}"
        ) from error
    return recording, facts


def engine_of(spec: msgspec.Raw) -> Engine:
    """Return a new engine for the facts that a recording holds; raises msgspec.MsgspecError, TleError."""
    return build_engine(decode_facts(spec))
