"""Plots of recordings, by matplotlib where it is installed."""

from __future__ import annotations

import importlib
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np

from sattrack.control.stages import RunStage
from sattrack.core.errors import BadInputError
from sattrack.mount.xerxes.datagrams import DatagramError, decode_command
from sattrack.recording.mount_fit import spectrum
from sattrack.recording.report import repeating
from sattrack.recording.smoothing import Track, smooth_track

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from sattrack.recording.replay import Output, Replay
    from sattrack.recording.report import Report
    from sattrack.recording.smoothing import BiasFit
    from sattrack.recording.trace import Trace

    Array = NDArray[np.float64]

INK, PALE, RA, DEC, BAD, GOOD = "#1b2a41", "#8a99ad", "#1f77b4", "#e07a1f", "#d1495b", "#2a9d8f"


def new_figure(width: float, height: float) -> Any:
    """Return an empty figure, inches; raises BadInputError where matplotlib is not there."""
    try:
        module = importlib.import_module("matplotlib.figure")
    except ImportError:
        raise BadInputError("plots need matplotlib: pip install 'sattrack[plot]'") from None
    return module.Figure(figsize=(width, height), layout="constrained", facecolor="white")


def sky_axes(sky: Any) -> None:
    """Make polar axes a chart of the sky seen from below: north up, east to the left, the zenith inmost."""
    sky.set_theta_zero_location("N")
    sky.set_theta_direction(1)
    sky.set_rlim(0.0, 90.0)
    sky.set_rticks([30.0, 60.0, 90.0], ["60°", "30°", ""], color=PALE, fontsize="small")
    sky.set_xticks(np.radians(np.arange(0.0, 360.0, 45.0)), ["N", "NE", "E", "SE", "S", "SW", "W", "NW"])
    sky.grid(color="0.9")


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
        _rates_of([getattr(one, what) for one in outputs]) for what in ("recorded", "replayed")
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


def _rates_of(datagrams: Sequence[bytes]) -> NDArray[np.float64]:
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


WIDTH, HEIGHT = 9.5, 3.4
LEAST_DELAY_MS = 1.0
"""The delays' scale goes so far at least: a steady link is to look steady."""
SHOWN_SHARE = 0.999
"""Share of the samples that the errors' scale shows whole; beyond it, the peak is given as text."""


def figures(run: Trace, fit: BiasFit | None) -> dict[str, Any]:
    """Return the plots of one run by title; raises BadInputError where matplotlib is not there."""
    found: dict[str, Any] = {}
    shown = run.following if run.following.any() else run.doing == RunStage.ACQUIRING
    if shown.any():
        at = run.utc_s[shown]
        tracks = [smooth_track(at, column[shown]) for column in (run.along, run.across)]
        found["Error along and across the track"] = _errors(run, shown, tracks)
        found["Rates commanded"] = _rates(run)
    if run.following.any():
        found["Innovations of the smoothing filter"] = _innovations(at, tracks)
        found["Sky"] = _sky(run)
        if (repeats := _repeats(run)) is not None:
            found["What repeats with the axes' angles"] = repeats
    if len(run.utc_s) > 1:
        found["Link"] = _link(run)
    if fit is not None:
        found["Biases of the satellite"] = _biases(fit)
    return found


def _panel(height: float = HEIGHT, rows: int = 1, **options: Any) -> tuple[Any, Any]:
    figure = new_figure(WIDTH, height)
    axes = figure.subplots(rows, 1, sharex=True, **options)
    for one in np.atleast_1d(axes):
        one.grid(color="0.92")
        one.tick_params(labelsize="small")
    return figure, axes


def _legend(axes: Any, markerscale: float = 1.0) -> None:
    """Put the legend above the plot, where it covers nothing."""
    axes.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        borderaxespad=0.2,
        ncols=3,
        fontsize="small",
        frameon=False,
        markerscale=markerscale,
    )


def _errors(run: Trace, shown: NDArray[np.bool_], tracks: Sequence[Track]) -> Any:
    figure, panels = _panel(5.2, 2)
    at = times(run.utc_s[shown])
    for axes, track, column, name in zip(
        panels, tracks, (run.along, run.across), ("along", "across"), strict=True
    ):
        values = column[shown]
        scale = 1.15 * float(np.quantile(np.abs(values), SHOWN_SHARE)) or 1.0
        axes.plot(at, values, ".", markersize=1.2, color=PALE, label="samples")
        low, high = track.values - 2.0 * track.sigmas, track.values + 2.0 * track.sigmas
        axes.fill_between(at, low, high, color=RA, alpha=0.25, linewidth=0.0)
        axes.plot(at, track.values, color=RA, linewidth=1.0, label="smoothed, ± 2 σ")
        axes.set_ylim(-scale, scale)
        axes.set_ylabel(f"{name}, ″")
        peak = float(np.abs(values).max())
        if peak > scale:
            axes.text(
                0.995, 0.95, f"peak {peak:.2f}″", transform=axes.transAxes, ha="right", va="top", color=BAD
            )
    _legend(panels[0], markerscale=6)
    label_times(panels[1])
    return figure


def _rates(run: Trace) -> Any:
    figure, axes = _panel()
    at = times(run.sent_utc_s)
    axes.plot(at, run.sent[:, 0], color=RA, linewidth=1.0, label="right ascension axis")
    axes.plot(at, run.sent[:, 1], color=DEC, linewidth=1.0, label="declination axis")
    axes.set_ylabel("°/s")
    _legend(axes)
    label_times(axes)
    return figure


def _innovations(at: Array, tracks: Sequence[Track]) -> Any:
    figure, axes = _panel()
    for track, name, colour in zip(tracks, ("along", "across"), (RA, DEC), strict=True):
        axes.plot(times(at), track.innovations, ".", markersize=1.5, color=colour, label=name)
    axes.axhspan(-2.0, 2.0, color=GOOD, alpha=0.12, linewidth=0.0)
    axes.set_ylabel("σ")
    axes.set_ylim(-6.0, 6.0)
    _legend(axes, markerscale=5)
    label_times(axes)
    return figure


def _link(run: Trace) -> Any:
    figure, (upper, lower) = _panel(4.6, 2)
    delay_ms = (run.arrival_utc_s - run.utc_s) * 1000.0
    upper.plot(times(run.arrival_utc_s), delay_ms, ".", markersize=1.5, color=RA)
    upper.set_ylabel("status late by, ms")
    upper.set_ylim(min(0.0, 1.1 * float(delay_ms.min())), max(LEAST_DELAY_MS, 1.1 * float(delay_ms.max())))
    gaps = np.diff(run.arrival_utc_s) * 1000.0
    lower.plot(times(run.arrival_utc_s[1:]), gaps, ".", markersize=1.5, color=DEC)
    lower.set_ylabel("between statuses, ms")
    lower.set_ylim(0.0, 1.25 * float(gaps.max()))
    missing = np.diff(run.counter) > 1
    if missing.any():
        lower.plot(
            times(run.arrival_utc_s[1:][missing]), gaps[missing], "x", color=BAD, markersize=5, label="lost"
        )
        _legend(lower)
    label_times(lower)
    return figure


def _sky(run: Trace) -> Any:
    figure = new_figure(5.6, 5.2)
    sky = figure.add_subplot(projection="polar")
    sky_axes(sky)
    at = run.utc_s[run.following]
    error = np.interp(run.sky_utc_s, at, run.total[run.following])
    points = sky.scatter(
        np.radians(run.sky[:, 1]),
        90.0 - run.sky[:, 0],
        c=error,
        s=10.0,
        cmap="viridis",
        vmax=float(np.quantile(error, 0.98)) or None,
    )
    figure.colorbar(points, ax=sky, shrink=0.7, label="error, ″")
    sky.annotate(
        "begins",
        (np.radians(run.sky[0, 1]), 90.0 - run.sky[0, 0]),
        color=INK,
        fontsize="small",
        xytext=(0, -14),
        textcoords="offset points",
        ha="center",
    )
    return figure


def _repeats(run: Trace) -> Any:
    found = []
    for axis, (name, colour) in enumerate((("hour angle", RA), ("declination", DEC))):
        cycles, amplitude = spectrum(*repeating(run, axis))
        if len(cycles) > 3:
            found.append((cycles[2:], amplitude[2:], name, colour))
    if not found:
        return None
    figure, axes = _panel()
    for cycles, amplitude, name, colour in found:
        axes.loglog(cycles, amplitude, color=colour, linewidth=0.8, label=name)
    axes.set_xlabel("cycles in a turn of the axis", fontsize="small")
    axes.set_ylabel("amplitude, ″")
    _legend(axes)
    return figure


def _biases(fit: BiasFit) -> Any:
    figure, panels = _panel(4.8, 2)
    at = times(fit.utc_all_s)
    for axes, values, sigmas, label in (
        (panels[0], fit.along_all, fit.along_sigma_all, "along, s"),
        (panels[1], fit.cross_all, fit.cross_sigma_all, "across, km"),
    ):
        axes.fill_between(
            at, values - 2.0 * sigmas, values + 2.0 * sigmas, color=GOOD, alpha=0.25, linewidth=0.0
        )
        axes.plot(at, values, color=GOOD, linewidth=1.2, label="smoothed, ± 2 σ")
        axes.set_ylabel(label)
    for axes, values, sigmas in (
        (panels[0], fit.observed_along, fit.observed_along_sigma),
        (panels[1], fit.observed_cross, fit.observed_cross_sigma),
    ):
        axes.errorbar(
            at, values, yerr=sigmas, fmt=".", color=PALE, markersize=3, linewidth=0.6, label="observed"
        )
    _legend(panels[0])
    label_times(panels[1])
    return figure


def trend(reports: Sequence[Report]) -> Any | None:
    """Return how several nights went on; None for fewer than two that followed anything."""
    followed = [one for one in reports if one.error is not None]
    if len(followed) < 2:
        return None
    figure = new_figure(WIDTH, 6.4)
    errors, biases, gains = figure.subplots(3, 1, sharex=True)
    labels = [f"{one.began_utc[:10]}\n{one.name}" for one in followed]
    number = np.arange(len(followed))
    seen = [one.error for one in followed if one.error]
    errors.semilogy(number, [one.rms_arcsec for one in seen], "o-", color=RA, label="RMS")
    errors.semilogy(number, [one.peak_arcsec for one in seen], "^:", color=BAD, label="peak")
    errors.set_ylabel("error, ″")
    named: set[str] = set()
    for one, i in zip(followed, number, strict=True):
        if one.bias is not None:
            sigma = one.bias.along_sigma_s or 0.0
            colour = GOOD if one.bias.source == "observations" else PALE
            biases.errorbar([i], [one.bias.along_s], yerr=[2.0 * sigma], fmt="o", color=colour)
        for axis, colour, name in ((one.ra, RA, "hour angle"), (one.dec, DEC, "declination")):
            if axis.gain is not None:
                gains.plot([i], [axis.gain], "o", color=colour, label=None if name in named else name)
                named.add(name)
    biases.set_ylabel("along bias, s")
    gains.set_ylabel("gain")
    gains.set_xticks(number, labels, fontsize="x-small")
    for axes in (errors, biases, gains):
        axes.grid(color="0.92")
    errors.legend(fontsize="small", frameon=False)
    if named:
        gains.legend(fontsize="small", frameon=False)
    return figure
