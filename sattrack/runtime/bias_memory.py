"""Biases found at a pass, kept for the next one of the same object with the same elements, in SQLite.

Two kinds are kept, and never mixed up: what was fitted to observations, with its uncertainty, and the
operator's last nudge, which may have made up for the mount as well as for the satellite and is kept as that.
Nothing here delays following: a file that cannot be used is reported in one line.
"""

from __future__ import annotations

import hashlib
import math
import sqlite3
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, NamedTuple

import msgspec

from sattrack.core import local_time
from sattrack.core.errors import SattrackError
from sattrack.core.files import user_folder
from sattrack.views.run import RememberedView
from tle.elements import Elements
from tle.instants import DAY_S, Utc

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from sattrack.control.engine import Engine, RunSpec
    from sattrack.recording.fits import BiasFit

MemoryMode = Literal["auto", "on", "nudge", "off"]
SAME_S, SAME_DEG = 1e-6, 1e-6


class Recalled(NamedTuple):
    """The bias to begin with, if there is one, and notes about the memory."""

    bias: RememberedView | None
    notes: tuple[str, ...]


def uses_memory(mode: MemoryMode, simulated: bool) -> bool:
    """Return whether a run uses the memory: one of a simulated mount only on request."""
    return mode in {"on", "nudge"} or (mode == "auto" and not simulated)


def recall(elements: Elements, at_utc_s: float, mode: MemoryMode, given: bool) -> Recalled:
    """Return what earlier passes found, for a pass about an instant; UTC as POSIX seconds.

    A fit is what the run begins with; a nudge only with the mode "nudge", and else a note. Where `given`,
    the user gave a bias, which is taken instead.
    """
    memory = BiasMemory(memory_file())
    try:
        fit = memory.recall(elements, at_utc_s, "observations")
        nudge = memory.recall(elements, at_utc_s, "nudge")
    except SattrackError as error:
        return Recalled(None, (f"{error}; nothing is recalled",))
    if mode == "nudge" and nudge is not None and (fit is None or nudge.utc_s > fit.utc_s):
        fit = nudge
    if fit is not None and given:
        return Recalled(
            None, (f"a remembered bias is left aside for the one given: {describe(fit, at_utc_s)}",)
        )
    if fit is not None:
        note = f"begins with the bias remembered: {describe(fit, at_utc_s)}; --bias-memory off leaves it out"
        return Recalled(_view(fit), (note,))
    if nudge is not None and not given:
        note = f"remembered, but not used: {describe(nudge, at_utc_s)}; --bias-memory nudge begins with it"
        return Recalled(None, (note,))
    return Recalled(None, ())


def _view(bias: KeptBias) -> RememberedView:
    return RememberedView(
        source=bias.source,
        utc_s=bias.utc_s,
        along_s=bias.along_s,
        along_sigma_s=bias.along_sigma_s,
        cross_km=bias.cross_km,
        cross_sigma_km=bias.cross_sigma_km,
        cross_deg=bias.cross_deg,
        observations=bias.observations,
        entry=bias.entry,
    )


def keep(engine: Engine, ended_utc_s: float, mode: MemoryMode) -> str | None:
    """Leave in the memory what a run found, drop there what was dropped; return what was done, as text."""
    spec, elements = engine.spec, engine.spec.propagator.elements
    if not isinstance(elements, Elements) or not uses_memory(mode, spec.simulated):
        return None
    memory, notes = BiasMemory(memory_file()), []
    try:
        remembered = engine.tracker.steering.remembered
        if remembered is not None and remembered.state == "dropped" and memory.drop(remembered.entry):
            notes.append("the bias that was dropped is not offered again")
        found = _found(engine, ended_utc_s)
        if found is not None and worth_keeping(found):
            memory.keep(found, elements, run_name(spec))
            notes.append(f"kept for these elements: {describe(found, ended_utc_s)}")
    except SattrackError as error:
        notes.append(f"{error}; the bias of this pass is not kept")
    return "; ".join(notes) or None


def keep_fit(fit: BiasFit, spec: RunSpec, mode: MemoryMode) -> str | None:
    """Keep what a report fitted to the observations of a run; return what was done, as text."""
    elements = spec.propagator.elements
    if not isinstance(elements, Elements) or not uses_memory(mode, spec.simulated):
        return None
    found = KeptBias(
        source="observations",
        utc_s=fit.utc_s,
        along_s=fit.along.value,
        along_sigma_s=fit.along.sigma,
        cross_km=fit.cross.value,
        cross_sigma_km=fit.cross.sigma,
        observations=fit.taken,
        made_by="report",
        mount=spec.mount_name,
    )
    if not worth_keeping(found):
        return None
    try:
        BiasMemory(memory_file()).keep(found, elements, run_name(spec))
    except SattrackError as error:
        return f"{error}; the fit is not kept"
    return f"kept for these elements: {describe(found, fit.utc_s)}"


def run_name(spec: RunSpec) -> str:
    """Return the name of a run: its mount and its beginning."""
    return f"{spec.mount_name} {spec.started_utc_s!r}"


def _found(engine: Engine, ended_utc_s: float) -> KeptBias | None:
    """Return what observations said, else the operator's nudges as they stood in the end, or None."""
    spec, steering = engine.spec, engine.tracker.steering
    seen_utc_s = steering.estimator.last_utc_s
    known = None if seen_utc_s is None else steering.estimator.reading(seen_utc_s, steering.biases.course)
    if known is not None and seen_utc_s is not None:
        return KeptBias(
            source="observations",
            utc_s=seen_utc_s,
            along_s=known.along_s,
            along_sigma_s=known.along_sigma_s,
            cross_km=known.cross_km,
            cross_sigma_km=known.cross_sigma_km,
            observations=steering.estimator.accepted,
            mount=spec.mount_name,
        )
    # Brings astronomy, which a list of the memory does not need.
    from sattrack.control.biases import ALONG, CROSS

    offsets = (steering.biases.offsets[what].total_at(ended_utc_s) for what in (ALONG, CROSS))
    began = (spec.bias.along_s, spec.bias.cross_deg)
    moved = [abs(one - first) for one, first in zip(offsets, began, strict=True)]
    if moved[0] < SAME_S and moved[1] < SAME_DEG:
        return None
    along_s, cross_deg = steering.biases.totals(ended_utc_s)
    if abs(along_s) < SAME_S and abs(cross_deg) < SAME_DEG:
        return None
    return KeptBias(
        source="nudge",
        utc_s=ended_utc_s,
        along_s=along_s,
        cross_deg=cross_deg,
        mount=spec.mount_name,
    )


Source = Literal["observations", "nudge"]
FILE_NAME = "biases.sqlite3"
LAYOUT = 1
"""Version of the tables, as SQLite's `user_version`."""
PATIENCE_S = 2.0
"""How long another session may hold the file."""
GROWTH_ALONG_S_DAY = 0.4
"""Growth of the uncertainty along the track with age: elements of low orbits are taken to go astray by 3 km
a day, at 7.5 km/s. An assumption on the safe side, and no measurement."""
GROWTH_CROSS_KM_DAY = 0.1
OFFERED_FOR_S = 7.0 * DAY_S
LEAST_OBSERVATIONS = 3
MOST_ALONG_SIGMA_S = 2.0
"""A fit that is less certain, or of fewer observations, is not kept."""
_TABLE = """
CREATE TABLE IF NOT EXISTS biases (
    entry INTEGER PRIMARY KEY,
    orbit TEXT NOT NULL,
    run TEXT NOT NULL,
    source TEXT NOT NULL,
    made_by TEXT NOT NULL,
    catalog_number INTEGER NOT NULL,
    name TEXT NOT NULL,
    elements_epoch_utc_s REAL NOT NULL,
    mount TEXT NOT NULL,
    utc_s REAL NOT NULL,
    along_s REAL NOT NULL,
    along_sigma_s REAL,
    cross_km REAL,
    cross_sigma_km REAL,
    cross_deg REAL,
    observations INTEGER NOT NULL,
    dropped INTEGER NOT NULL DEFAULT 0,
    UNIQUE (orbit, run, source)
)
"""


class KeptBias(msgspec.Struct, frozen=True):
    """One entry: biases as of `utc_s` (UTC, POSIX seconds) with the signs of `tle.bias`, and their sigmas.

    A fit has the distance across the track in km and both sigmas; a nudge has the angle in degrees instead,
    and no sigma: nobody knows how good it was.
    """

    source: Source
    utc_s: float
    along_s: float
    along_sigma_s: float | None = None
    cross_km: float | None = None
    cross_sigma_km: float | None = None
    cross_deg: float | None = None
    observations: int = 0
    entry: int = 0
    """Its number in the file; 0 before it is in one."""
    made_by: Literal["pass", "report"] = "pass"
    catalog_number: int = 0
    name: str = ""
    elements_epoch_utc_s: float = 0.0
    mount: str = ""
    dropped: bool = False

    def aged(self, at_utc_s: float) -> KeptBias:
        """Return the same bias with its uncertainty grown by the time from its own instant to another."""
        if self.along_sigma_s is None or self.cross_sigma_km is None:
            return self
        days = abs(at_utc_s - self.utc_s) / DAY_S
        return msgspec.structs.replace(
            self,
            along_sigma_s=math.hypot(self.along_sigma_s, GROWTH_ALONG_S_DAY * days),
            cross_sigma_km=math.hypot(self.cross_sigma_km, GROWTH_CROSS_KM_DAY * days),
        )


def worth_keeping(bias: KeptBias) -> bool:
    """Return whether a bias is certain enough to be kept: a nudge always is, as what it is."""
    if bias.source == "nudge":
        return True
    numbers = (bias.along_s, bias.along_sigma_s, bias.cross_km, bias.cross_sigma_km)
    if any(number is None or not math.isfinite(number) for number in numbers):
        return False
    return bias.observations >= LEAST_OBSERVATIONS and (bias.along_sigma_s or 0.0) <= MOST_ALONG_SIGMA_S


def memory_file() -> Path:
    """Return the user's own file: under XDG_DATA_HOME where that is set, else .local/share at home."""
    return user_folder("XDG_DATA_HOME", ".local/share") / FILE_NAME


def orbit_of(elements: Elements) -> str:
    """Return a digest of object, epoch and mean elements, 16 hexadecimal digits: the name plays no part."""
    numbers = (
        elements.catalog_number,
        float(elements.epoch.unix_s),
        elements.inclination_deg,
        elements.raan_deg,
        elements.eccentricity,
        elements.arg_perigee_deg,
        elements.mean_anomaly_deg,
        elements.mean_motion_rev_day,
        elements.bstar_per_earth_radius,
    )
    return hashlib.sha256(repr(numbers).encode()).hexdigest()[:16]


@dataclass(frozen=True, slots=True)
class BiasMemory:
    """The file at a path. Each method raises SattrackError, in one line, where the file cannot be used."""

    path: Path

    def recall(self, elements: Elements, at_utc_s: float, source: Source) -> KeptBias | None:
        """Return the newest bias of a kind for these very elements, aged to an instant; None without one.

        What was dropped, or is older than OFFERED_FOR_S, is not returned.
        """
        found = self._read(
            "orbit = ? AND source = ? AND NOT dropped AND abs(utc_s - ?) <= ? ORDER BY utc_s DESC LIMIT 1",
            (orbit_of(elements), source, at_utc_s, OFFERED_FOR_S),
        )
        return found[0].aged(at_utc_s) if found else None

    def entries(self) -> list[KeptBias]:
        """Return everything that is kept, the newest first, as it was found: nothing is aged."""
        return self._read("1 ORDER BY utc_s DESC", ())

    def keep(self, bias: KeptBias, elements: Elements, run: str) -> None:
        """Keep what a run found; of one run and kind there is one entry, the last that was kept.

        A report, which sees all observations at once, has the last word over the pass itself; what was
        dropped stays dropped then.
        """
        names = (
            "orbit, run, source, made_by, catalog_number, name, elements_epoch_utc_s, mount, utc_s, along_s, "
            "along_sigma_s, cross_km, cross_sigma_km, cross_deg, observations"
        )
        values = (
            *(orbit_of(elements), run, bias.source, bias.made_by, elements.catalog_number, elements.name),
            *(float(elements.epoch.unix_s), bias.mount, bias.utc_s, bias.along_s, bias.along_sigma_s),
            *(bias.cross_km, bias.cross_sigma_km, bias.cross_deg, bias.observations),
        )
        marks = ", ".join("?" * len(values))
        updates = ", ".join(f"{name} = excluded.{name}" for name in names.split(", ")[3:])
        if bias.made_by == "pass":
            updates += ", dropped = 0"
        with self._open(create=True) as connection:
            connection.execute(
                f"INSERT INTO biases ({names}) VALUES ({marks}) "
                f"ON CONFLICT (orbit, run, source) DO UPDATE SET {updates}",
                values,
            )

    def drop(self, entry: int) -> bool:
        """Offer an entry no more; return whether there was one of that number."""
        if not self._exists():
            return False
        with self._open(create=True) as connection:
            done = connection.execute("UPDATE biases SET dropped = 1 WHERE entry = ?", (entry,))
            return done.rowcount > 0

    def _read(self, condition: str, values: tuple[object, ...]) -> list[KeptBias]:
        if not self._exists():
            return []
        fields = KeptBias.__struct_fields__
        with self._open(create=False) as connection:
            # Who is killed while it makes the file leaves one without a table.
            if connection.execute("SELECT 1 FROM sqlite_master WHERE name = 'biases'").fetchone() is None:
                return []
            query = f"SELECT {', '.join(fields)} FROM biases WHERE {condition}"
            rows = connection.execute(query, values).fetchall()
        try:
            return [
                msgspec.convert(dict(zip(fields, row, strict=True)), KeptBias, strict=False) for row in rows
            ]
        except msgspec.ValidationError as error:
            raise SattrackError(f"the bias memory {self.path} holds what is no bias: {error}") from error

    def _exists(self) -> bool:
        try:
            return self.path.exists()
        except OSError as error:
            raise SattrackError(f"the bias memory {self.path} cannot be used: {_trouble(error)}") from error

    @contextmanager
    def _open(self, create: bool) -> Iterator[sqlite3.Connection]:
        """Open the file for one transaction; SQLite's own errors become SattrackError."""
        try:
            if create:
                self.path.parent.mkdir(parents=True, exist_ok=True)
            mode = "rwc" if create else "ro"
            uri = f"{self.path.absolute().as_uri()}?mode={mode}"
            connection = sqlite3.connect(uri, uri=True, timeout=PATIENCE_S, isolation_level=None)
            try:
                self._check_layout(connection, create)
                yield connection
                if connection.in_transaction:
                    connection.execute("COMMIT")
            finally:
                connection.close()
        except (sqlite3.Error, OSError) as error:
            raise SattrackError(f"the bias memory {self.path} cannot be used: {_trouble(error)}") from error

    def _check_layout(self, connection: sqlite3.Connection, create: bool) -> None:
        if create:
            connection.execute("BEGIN IMMEDIATE")
        layout: int = connection.execute("PRAGMA user_version").fetchone()[0]
        if layout > LAYOUT:
            raise SattrackError(
                f"the bias memory {self.path} is of a newer sattrack: layout {layout}, {LAYOUT} is known here"
            )
        if create and layout < LAYOUT:
            connection.execute(_TABLE)
            connection.execute(f"PRAGMA user_version = {LAYOUT}")


def _trouble(error: sqlite3.Error | OSError) -> str:
    """Return what went wrong, and what to do."""
    if isinstance(error, OSError):
        return str(error.strerror or error)
    text = str(error)
    if "locked" in text:
        return f"{text}: another program holds it"
    if isinstance(error, sqlite3.OperationalError):
        return text
    return f"{text}: move it away, and a new one is begun"


def describe(bias: KeptBias, at_utc_s: float) -> str:
    """Return a bias as text, with the time from its own instant to another."""
    when = local_time.duration(at_utc_s - bias.utc_s) + (" before" if bias.utc_s <= at_utc_s else " later")
    if bias.source == "nudge":
        return f"{bias.along_s:+.3f} s along, {bias.cross_deg or 0.0:+.4f}° across, nudged {when}"
    return (
        f"{bias.along_s:+.3f} ± {bias.along_sigma_s or 0.0:.3f} s along, "
        f"{bias.cross_km or 0.0:+.2f} ± {bias.cross_sigma_km or 0.0:.2f} km across, "
        f"from {bias.observations} observations {when} ({Utc(bias.utc_s).isoformat('seconds')})"
    )
