"""Pictures of recordings, by matplotlib where it is there."""

from __future__ import annotations

import importlib
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np

from sattrack.core.errors import BadInputError
from sattrack.mount.xerxes.datagrams import DatagramError, decode_command

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from sattrack.recording.replay import Output, Replay

INK, PALE, RA, DEC, BAD, GOOD = "#1b2a41", "#8a99ad", "#1f77b4", "#e07a1f", "#d1495b", "#2a9d8f"


def new_figure(width: float, height: float) -> Any:
    """Return an empty figure, inches; raises BadInputError where matplotlib is not there."""
    try:
        module = importlib.import_module("matplotlib.figure")
    except ImportError:
        raise BadInputError("plots need matplotlib: pip install 'sattrack[plot]'") from None
    return module.Figure(figsize=(width, height), layout="constrained", facecolor="white")


def times(utc_s: Sequence[float] | NDArray[np.float64]) -> list[datetime]:
    """Return instants, POSIX seconds, as matplotlib takes them."""
    return [datetime.fromtimestamp(float(t), UTC) for t in utc_s]


def label_times(axes: Any) -> None:
    """Have an axis of instants show the time of day, UTC."""
    dates = importlib.import_module("matplotlib.dates")
    locator = dates.AutoDateLocator(minticks=4, maxticks=10)
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(dates.DateFormatter("%H:%M:%S", tz=UTC))
    axes.set_xlabel("UTC", fontsize="small", loc="right")


def save_divergence(path: Path, name: str, outputs: Sequence[Output], result: Replay) -> None:
    """Draw recorded and replayed rates and their difference; raises BadInputError where that cannot be."""
    recorded, replayed = (
        _rates([getattr(one, what) for one in outputs]) for what in ("recorded", "replayed")
    )
    figure = new_figure(11.0, 7.0)
    upper, lower = figure.subplots(2, 1, sharex=True)
    at = times([one.utc_s for one in outputs])
    for column, (axis, colour) in enumerate((("right ascension", RA), ("declination", DEC))):
        upper.plot(at, recorded[:, column], color=colour, linewidth=1.0, label=f"{axis}, recorded")
        upper.plot(
            at, replayed[:, column], color=colour, linewidth=1.0, linestyle=":", label=f"{axis}, today"
        )
        lower.plot(at, replayed[:, column] - recorded[:, column], color=colour, linewidth=1.0, label=axis)
    upper.set_ylabel("rate commanded, °/s")
    lower.set_ylabel("today minus recorded, °/s")
    if result.divergence is not None:
        for axes in (upper, lower):
            axes.axvline(times([result.divergence.utc_s])[0], color=BAD, linewidth=1.0)
    for axes in (upper, lower):
        axes.grid(color="0.92")
        axes.legend(fontsize="small", frameon=False)
    label_times(lower)
    figure.suptitle(f"{name}: {result.differing} of {result.ticks} commands differ", color=INK)
    save(figure, path)


def _rates(datagrams: Sequence[bytes]) -> NDArray[np.float64]:
    found = np.full((len(datagrams), 2), np.nan)
    for number, data in enumerate(datagrams):
        try:
            command = decode_command(data)
        except DatagramError:
            continue
        if command.move_ra or command.move_dec:
            found[number] = command.move_ra_rate_deg_s, command.move_dec_rate_deg_s
    return found


def save(figure: Any, path: Path) -> None:
    """Write a figure; raises BadInputError where that cannot be."""
    try:
        figure.savefig(path, dpi=110)
    except (OSError, ValueError) as error:
        raise BadInputError(f"{path}: cannot write the plot: {error}") from None
