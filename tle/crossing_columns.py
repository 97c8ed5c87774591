"""Crossings put together, chosen from and renamed: the columns behind the passes of a catalogue."""

from __future__ import annotations

import math
from dataclasses import fields
from typing import TYPE_CHECKING

import numpy as np

from tle.crossings import Crossings

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from tle.passes import Pass

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]


def crossings_of(passes: Sequence[Pass], obj: int, start_s: float) -> Crossings:
    """Return passes of one object as columns."""

    def column(name: str) -> Array:
        values = [getattr(p, name) for p in passes]
        return np.array(
            [math.nan if v is None else getattr(v, "unix_s", v) for v in values], dtype=np.float64
        )

    tops = [(k, t.unix_s - start_s) for k, p in enumerate(passes) for t in p.culminations_utc]
    return Crossings(
        obj=np.full(len(passes), obj, dtype=np.intp),
        rise_s=column("rise_utc") - start_s,
        set_s=column("set_utc") - start_s,
        culminate_s=column("culminate_utc") - start_s,
        rise_az_deg=column("rise_az_deg"),
        set_az_deg=column("set_az_deg"),
        culminate_az_deg=column("culminate_az_deg"),
        max_alt_deg=column("max_alt_deg"),
        peak_run=np.array([k for k, _ in tops], dtype=np.intp),
        peak_s=np.array([s for _, s in tops], dtype=np.float64),
    )


def joined(pieces: Sequence[Crossings]) -> Crossings:
    """Return crossings put together, in order of object and time."""
    pieces = [p for p in pieces if len(p.obj)] or list(pieces[:1])
    if not pieces:
        none, no = np.empty(0), np.empty(0, dtype=np.intp)
        return Crossings(no, none, none, none, none, none, none, none, no, none)
    columns = {f.name: np.concatenate([getattr(p, f.name) for p in pieces]) for f in fields(Crossings)}
    starts = np.cumsum([0, *(len(p.obj) for p in pieces[:-1])])
    columns["peak_run"] = np.concatenate([p.peak_run + s for p, s in zip(pieces, starts, strict=True)])
    whole = Crossings(**columns)
    return select(whole, np.lexsort((whole.culminate_s, whole.obj)))


def select(found: Crossings, index: Index) -> Crossings:
    """Return the crossings of these indices, in their order."""
    position = np.full(len(found.obj), -1, dtype=np.intp)
    position[index] = np.arange(len(index))
    owner = position[found.peak_run]
    kept = np.flatnonzero(owner >= 0)
    kept = kept[np.argsort(owner[kept], kind="stable")]
    columns = {f.name: getattr(found, f.name)[index] for f in fields(found)[:-2]}
    return Crossings(**columns, peak_run=owner[kept], peak_s=found.peak_s[kept])
