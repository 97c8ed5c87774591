"""What the stations have seen: one data set of observations, and the biases and elements that follow.

Each station delivers its files into a folder of its name: recordings, and observations in any format that
`sattrack bias` reads. A direction that comes twice counts once.
"""

from __future__ import annotations

import io
import json
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from sattrack.core.errors import BadInputError, SattrackError
from sattrack.core.files import replace_file
from sattrack.network.search import parquet_modules
from sattrack.recording.export import knowing, seen_in
from sattrack.runtime.facts import engine_of, open_recording
from tle.errors import AmbiguousSatelliteError, ObservationError, SatelliteNotFoundError, TleError
from tle.formats.observations import Observation, Stations, read_observations
from tle.formats.omm_notations import covariance_kvn, write_kvn
from tle.instants import Utc
from tle.orbit_fit import fit_observations
from tle.sources import find, key_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from sattrack.network.stations import Station
    from tle.elements import Elements
    from tle.orbit_fit import ObservedFit


@dataclass(slots=True)
class Collected:
    """What came of a collection: observations by station, each with its satellite's elements, and fits."""

    by_station: dict[str, list[tuple[Observation, Elements]]] = field(default_factory=dict)
    fits: dict[Elements, ObservedFit] = field(default_factory=dict)

    @property
    def observations(self) -> int:
        """How many observations there are."""
        return sum(len(rows) for rows in self.by_station.values())


def collect(
    folder: Path, stations: Sequence[Station], elements: Sequence[Elements], tell: Callable[[str], None]
) -> Collected:
    """Read what all stations delivered, and fit each satellite's orbit to it.

    What is unreadable, or of an unknown satellite, is reported and left out, and so are satellites whose
    elements do not reach to what was seen. Raises BadInputError where no station delivered anything.
    """
    found = Collected()
    sites = Stations({one.name: one.site for one in stations})
    for station in stations:
        rows: dict[tuple[Any, ...], tuple[Observation, Elements]] = {}
        for file in sorted((folder / station.name).glob("*")):
            try:
                for one, of in _read(file, Stations(sites.by_name, station.site), elements):
                    key = (of, one.utc.isoformat("microseconds"), one.ra_deg, one.dec_deg, one.frame)
                    rows.setdefault(key, (one, of))
            except (SattrackError, TleError) as error:
                tell(f"left out: {error}")
        if rows:
            found.by_station[station.name] = sorted(rows.values(), key=lambda row: float(row[0].utc.unix_s))
    if not found.by_station:
        names = ", ".join(one.name for one in stations[:3])
        raise BadInputError(f"{folder}: no station has delivered anything; it needs folders {names}, ...")
    by_satellite: dict[Elements, list[Observation]] = {}
    for delivered in found.by_station.values():
        for one, of in delivered:
            by_satellite.setdefault(of, []).append(one)
    for of, seen in sorted(by_satellite.items(), key=lambda row: (row[0].catalog_number, row[0].label)):
        seen.sort(key=lambda one: float(one.utc.unix_s))
        try:
            fit = fit_observations(of, seen)
        except TleError as error:
            tell(f"{error}; its elements stay")
            continue
        if fit is None:
            tell(
                f"{key_of(of)}: its {len(seen)} observations agree on no orbit near its elements, which stay"
            )
        else:
            found.fits[of] = fit
    return found


def _read(
    file: Path, sites: Stations, elements: Sequence[Elements]
) -> Iterator[tuple[Observation, Elements]]:
    """Yield the observations in a file, each with its satellite. Raises SattrackError, TleError."""
    if file.suffix.lower() != ".mcap":
        for one in read_observations(file, sites):
            yield one, _found(one.object_key, elements, file)
        return
    recording, facts = open_recording(file)
    if facts.elements is None:
        raise SattrackError(f"{file}: its target has no elements")
    key = key_of(facts.elements)
    for seen in seen_in(recording, knowing(recording, engine_of)):
        at = Utc(seen.utc_s)
        place, sigma = facts.site.place(), seen.sigma_arcsec
        frame: Any = "icrf" if seen.frame == "icrs" else seen.frame
        yield (
            Observation(
                utc=at,
                ra_deg=seen.ra_deg,
                dec_deg=seen.dec_deg,
                frame=frame,
                site=place,
                object_key=key,
                sigma_arcsec=sigma,
                source=str(file),
            ),
            _found(key, elements, file),
        )


def _found(key: str, elements: Sequence[Elements], file: Path) -> Elements:
    if not key:
        raise ObservationError(f"{file}: names no satellite")
    try:
        return find(elements, key)
    except (SatelliteNotFoundError, AmbiguousSatelliteError) as error:
        raise ObservationError(f"{file}: {error}") from None


def write_collected(folder: Path, found: Collected, elements: Sequence[Elements]) -> None:
    """Write observations (Parquet by station), biases (JSON) and the network's elements (OMM, KVN).

    Raises SattrackError where that cannot be.
    """
    try:
        for name, rows in found.by_station.items():
            place = folder / "observations" / f"station={name}"
            place.mkdir(parents=True, exist_ok=True)
            replace_file(place / "observations.parquet", _parquet(rows, found))
        biases = json.dumps([_bias(fit) for fit in found.fits.values()], indent=1, allow_nan=False)
        replace_file(folder / "biases.json", biases.encode() + b"\n")
        replace_file(folder / "elements.kvn", _elements_text(found, elements).encode())
    except OSError as error:
        raise SattrackError(f"{folder}: cannot be written: {error.strerror or error}") from error


def _elements_text(found: Collected, elements: Sequence[Elements]) -> str:
    """Return all elements, the refined ones with the covariance of their state in place of the old."""
    parts = []
    for one in elements:
        fit = found.fits.get(one)
        # The instant of the elements: the same observations give the same file.
        created = one.epoch.isoformat("seconds")
        if fit is None:
            parts.append(write_kvn([one], created, "SATTRACK"))
        else:
            refined = write_kvn([fit.fit.elements], created, "SATTRACK")
            parts.append(refined + covariance_kvn(fit.fit.state_covariance_km2()))
    return "\n".join(parts)


def _bias(found: ObservedFit) -> dict[str, Any]:
    elements = found.elements
    return {"catalog_number": elements.catalog_number, "name": elements.name, **found.document()}


def _parquet(rows: Sequence[tuple[Observation, Elements]], found: Collected) -> bytes:
    pyarrow, parquet = parquet_modules()
    fitted: dict[int, tuple[tuple[float, float] | None, bool]] = {
        id(one): (alone, bool(used))
        for fit in found.fits.values()
        for one, alone, used in zip(fit.observations, fit.alone, fit.fit.used, strict=True)
    }
    columns: dict[str, list[Any]] = {name: [] for name in _COLUMNS}
    for one, of in rows:
        alone, used = fitted.get(id(one), (None, False))
        along_s, cross_arcsec = (None, None) if alone is None else alone
        values = (
            of.catalog_number,
            round(float(one.utc.unix_s) * 1e6),
            one.ra_deg,
            one.dec_deg,
            one.frame,
            one.sigma_arcsec,
            along_s,
            cross_arcsec,
            used,
        )
        for name, value in zip(_COLUMNS, values, strict=True):
            columns[name].append(value)
    kinds = {
        "catalog_number": pyarrow.int32(),
        "utc": pyarrow.timestamp("us", tz="UTC"),
        "frame": pyarrow.string(),
        "used": pyarrow.bool_(),
    }
    arrays = {name: pyarrow.array(c, type=kinds.get(name, pyarrow.float64())) for name, c in columns.items()}
    out = io.BytesIO()
    parquet.write_table(pyarrow.table(arrays), out, compression="zstd")
    return out.getvalue()


_COLUMNS = (
    "catalog_number",
    "utc",
    "ra_deg",
    "dec_deg",
    "frame",
    "sigma_arcsec",
    "along_s",
    "cross_arcsec",
    "used",
)
