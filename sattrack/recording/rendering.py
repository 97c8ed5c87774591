"""Reports and plots: text for a terminal, figures by matplotlib where it is installed, and HTML of both."""

from __future__ import annotations

import base64
import html
import importlib
import io
from datetime import UTC, datetime, timedelta, timezone
from typing import TYPE_CHECKING, Any

import numpy as np

from sattrack.control.stages import RunStage
from sattrack.core import local_time
from sattrack.core.angles import altitude_deg, azimuth_deg
from sattrack.core.errors import BadInputError, how_to_install
from sattrack.mount.model import whole_title
from sattrack.mount.xerxes.datagrams import DatagramError, decode_command
from sattrack.pointing.terms import frame_of
from sattrack.recording.fits import Track, smooth_track, spectrum
from sattrack.recording.report import repeating
from sattrack.views.formatting import iso_unix_s, named

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from sattrack.pointing.fit import PointingFit, Star
    from sattrack.recording.fits import BiasFit
    from sattrack.recording.replay import Output, Replay
    from sattrack.recording.report import AxisFigures, AxisMissed, BiasFigures, Report, TimeFigures
    from sattrack.recording.trace import Trace

    Array = NDArray[np.float64]

DPI = 110
SHORTEST_SHOWN_S = 1.0
UNFITTED_S = 5.0
"""Shorter times are not shown: of the run's stages, and of what was left out of fits."""
LEAST_SHARE = 0.005
MISSED = "NEVER ON TARGET"
STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; color: #1b2a41; max-width: 62rem; margin: 2rem auto;
  padding: 0 1rem }
h1 { font-size: 1.5rem } h2 { font-size: 1.1rem; margin-top: 2rem }
table { border-collapse: collapse }
td, th { padding: .15rem .9rem .15rem 0; text-align: left; vertical-align: top }
img { max-width: 100% } .what { color: #5b6b80 } .bad { color: #b3263a }
"""


def report_rows(report: Report) -> list[tuple[str, str]]:
    """Return a report as pairs of a name and a value, both text."""
    rows = [
        ("pass", f"{named(report.name, report.catalog_number)}, recorded from {_began(report)}"),
        ("mount", report.mount),
        ("followed", f"{report.followed_s:.0f} s, {report.samples} samples; {_end(report)}"),
    ]
    if (age_days := report.elements_age_days) is not None:
        rows.append(("against", f"elements {age_days:.1f} days old when the run began"))
    if not report.acquired and report.ended_by is not None:
        rows[:0] = [(MISSED, _missed(report))]
    elif not report.acquired:
        rows.append(("not on target", f"as far as the file goes: {_missed(report)}"))
    if apart := _apart(report.times):
        rows.append(("counted apart", apart))
    if report.error is not None:
        e = report.error
        rows += [
            ("error", f"{e.rms_arcsec:.3f}″ RMS, {e.peak_arcsec:.3f}″ peak, 95 % within {e.p95_arcsec:.3f}″"),
            (
                "along, across",
                f"RMS {e.rms_along_arcsec:.3f}″, {e.rms_across_arcsec:.3f}″; mean "
                f"{e.mean_along_arcsec:+.4f}″, {e.mean_across_arcsec:+.4f}″",
            ),
        ]
    if report.link is not None:
        n = report.link
        rows.append(
            (
                "link",
                f"{n.received} statuses at {n.rate_hz:.2f} a second, {n.lost} lost; "
                f"late by {n.delay_ms:.1f} ms, 99 % by {n.delay_p99_ms:.1f} ms at most",
            )
        )
    rows.append(("the satellite's biases", _bias(report.bias)))
    for title, axis in zip(report.axes, (report.ra, report.dec), strict=True):
        name = whole_title(title)
        rows += [(name, words) for words in (_axis(axis), *_untold(axis)) if words]
    return rows


def _end(report: Report) -> str:
    return f"ended by {report.ended_by}" if report.ended_by else "the file does not show its end"


def _began(report: Report) -> str:
    return local_time.instant(iso_unix_s(report.began_utc))


def _missed(report: Report) -> str:
    """Return what was seen of a mount that was never on target, as text."""
    if report.missed is None:
        held_s = sum(report.times.held_s.values())
        return f"limits held the mount for {held_s:.0f} s" if held_s else "the mount never came to follow"
    seen, (first, second) = report.missed, report.axes
    first = "right ascension" if first == "hour angle" else first
    return (
        f"in {report.times.acquiring_s:.0f} s of trying {seen.typical_arcsec:.1f}″ off typically, "
        f"{seen.largest_arcsec:.0f}″ at most; {first} {_axis_missed(seen.ra)}; "
        f"{second} {_axis_missed(seen.dec)}"
    )


def _axis_missed(axis: AxisMissed) -> str:
    limits = [
        f"{100.0 * share:.0f} % of its commands at the {name} limit"
        for name, share in (("rate", axis.at_rate_limit), ("acceleration", axis.at_acceleration_limit))
        if share >= LEAST_SHARE
    ]
    seen = f"{axis.typical_arcsec:.2f}″ and {axis.largest_arcsec:.0f}″"
    return ", ".join([seen, *(limits or ["no command at a limit"])])


def _apart(times: TimeFigures) -> str:
    """Return the time that no figure of the error counts, as text; empty for none worth reporting."""
    shown = [("before it was on target", times.acquiring_s)]
    shown += [(f"held by the {name.replace('_', ' ')} limit", held) for name, held in times.held_s.items()]
    shown += [("paused", times.paused_s), ("rejoining", times.rejoining_s)]
    words = [f"{name} {seconds:.1f} s" for name, seconds in shown if seconds >= SHORTEST_SHOWN_S]
    if times.following_s - times.fitted_s >= UNFITTED_S:
        words.append(f"following, but not steadily enough to fit {times.following_s - times.fitted_s:.1f} s")
    return "; ".join(words)


def _bias(bias: BiasFigures | None) -> str:
    if bias is None:
        return "not known: no observation in it, and a mount that follows shows nothing of the satellite"
    at = local_time.instant(iso_unix_s(bias.utc), 3)
    if bias.source == "nudge":
        return (
            f"{bias.along_s:+.3f} s along, {bias.cross_deg:+.4f}° across: the operator's last nudge, at "
            f"{at}, not measured"
        )
    along, along_sigma, cross, cross_sigma = (
        60.0 * (value or 0.0)
        for value in (
            bias.along_drift_s_s,
            bias.along_drift_sigma_s_s,
            bias.cross_drift_km_s,
            bias.cross_drift_sigma_km_s,
        )
    )
    return (
        f"{bias.along_s:+.4f} ± {bias.along_sigma_s or 0.0:.4f} s along, "
        f"{bias.cross_deg:+.5f} ± {bias.cross_sigma_deg or 0.0:.5f}° across, as of {at}; "
        f"drift {along:+.4f} ± {along_sigma:.4f} s and {cross:+.4f} ± {cross_sigma:.4f} km a minute; "
        f"from {bias.observations} observations, {bias.rejected} left out"
    )


def _axis(axis: AxisFigures) -> str:
    """Return what was fitted of an axis; empty where nothing was."""
    shown = []
    if axis.gain is not None:
        sigma = axis.gain_sigma or 0.0
        sigma_text = f"{sigma:.6f}" if sigma >= 1e-6 else f"{sigma:.0e}"
        shown.append(f"gain {axis.gain:.6f} ± {sigma_text}")
    if axis.delay_s is not None:
        sigma_ms = 1000.0 * (axis.delay_sigma_s or 0.0)
        dated = "" if axis.delay_s >= 0.0 else " by the statuses' dates, which are wrong then"
        shown.append(f"acts {axis.delay_s * 1000.0:.2f} ± {sigma_ms:.2f} ms after the tick{dated}")
    words = ", ".join(shown)
    repeating = [
        f"repeats {line.cycles_a_turn:.1f} times a turn with {line.amplitude_arcsec:.3f}″"
        for line in axis.lines
    ]
    return "; ".join([words, *repeating] if words else repeating)


def _untold(axis: AxisFigures) -> list[str]:
    return [f"not enough to tell {words}" for words in axis.untold]


def nothing_to_change(report: Report) -> str:
    """Return the text where there is no advice: "nothing" only where everything could be measured."""
    if report.acquired and not report.ra.untold and not report.dec.untold:
        return "nothing"
    return "nothing, as far as this recording shows"


def all_rows(report: Report) -> list[tuple[str, str]]:
    """Return a report for a terminal: what is wrong with the file, its rows, and what to change."""
    advice = report.advice or (nothing_to_change(report),)
    return [
        *(("wrong with the file", words) for words in report.problems),
        *report_rows(report),
        *(("to change", words) for words in advice),
    ]


TREND_HEADS = ("began", "object", "RMS ″", "peak ″", "along s", "across °", "gain HA", "gain Dec", "delay ms")


def trend_rows(reports: Sequence[Report]) -> list[tuple[str, ...]]:
    """Return one row a recording, in order of time, under TREND_HEADS."""
    rows: list[tuple[str, ...]] = []
    for one in sorted(reports, key=lambda r: r.began_utc):
        bias, error = one.bias, one.error
        label = "" if bias is None or bias.source == "observations" else " (nudge)"
        rows.append(
            (
                f"{local_time.date(iso_unix_s(one.began_utc))} {local_time.clock(iso_unix_s(one.began_utc))}",
                one.name,
                _number(None if error is None else error.rms_arcsec, 3),
                _number(None if error is None else error.peak_arcsec, 3),
                _number(None if bias is None else bias.along_s, 3) + label,
                _number(None if bias is None else bias.cross_deg, 4) + label,
                _number(one.ra.gain, 5),
                _number(one.dec.gain, 5),
                _number(None if one.ra.delay_s is None else one.ra.delay_s * 1000.0, 2),
            )
        )
    return rows


def _number(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def report_html(
    reports: Sequence[tuple[Report, Mapping[str, bytes]]], trend: bytes | None, version: str
) -> str:
    """Return one HTML file with figures and plots (PNG); nothing in it is fetched from anywhere."""
    title = "Recorded passes" if len(reports) > 1 else f"{reports[0][0].name}, {_began(reports[0][0])}"
    parts = [
        "<!doctype html>",
        '<html lang="en"><head><meta charset="utf-8">',
        f"<title>{html.escape(title)}</title><style>{STYLE}</style></head><body>",
        f"<h1>{html.escape(title)}</h1>",
    ]
    if len(reports) > 1:
        heads = "".join(f"<th>{html.escape(head)}</th>" for head in TREND_HEADS)
        parts.append(f"<h2>Trend</h2><table><tr>{heads}</tr>")
        for row in trend_rows([report for report, _ in reports]):
            cells = "".join(f"<td>{html.escape(cell)}</td>" for cell in row)
            parts.append(f"<tr>{cells}</tr>")
        parts.append("</table>")
        if trend is not None:
            parts.append(_image("Trend", trend))
    for report, plots in reports:
        if len(reports) > 1:
            parts.append(f"<h1>{html.escape(report.name)}, {html.escape(_began(report))}</h1>")
        parts += _sections(report, plots)
    parts.append(f'<p class="what">sattrack {html.escape(version)}</p></body></html>')
    return "\n".join(parts) + "\n"


def _sections(report: Report, plots: Mapping[str, bytes]) -> list[str]:
    parts = [f'<p class="bad">{html.escape("; ".join(report.problems))}</p>'] if report.problems else []
    parts.append("<table>")
    for name, value in report_rows(report):
        tone = "bad" if name == MISSED else "what"
        parts.append(f'<tr><td class="{tone}">{html.escape(name)}</td><td>{html.escape(value)}</td></tr>')
    parts.append("</table><h2>What to change</h2><ul>")
    parts += [f"<li>{html.escape(words)}</li>" for words in report.advice or (nothing_to_change(report),)]
    parts.append("</ul>")
    for title, picture in plots.items():
        parts.append(f"<h2>{html.escape(title)}</h2>{_image(title, picture)}")
    return parts


def _image(title: str, picture: bytes) -> str:
    data = base64.b64encode(picture).decode("ascii")
    return f'<img alt="{html.escape(title)}" src="data:image/png;base64,{data}">'


INK, PALE, RA, DEC, BAD, GOOD = "#1b2a41", "#8a99ad", "#1f77b4", "#e07a1f", "#d1495b", "#2a9d8f"


def new_figure(width: float, height: float) -> Any:
    """Return an empty figure, inches; raises BadInputError where matplotlib is not there."""
    try:
        module = importlib.import_module("matplotlib.figure")
    except ImportError:
        raise BadInputError(f"plots need matplotlib: {how_to_install('plot')}") from None
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
    """Have an axis of instants show the local time of day; call it when the axis has its data."""
    dates = importlib.import_module("matplotlib.dates")
    begin_s = dates.num2date(axes.get_xlim()[0]).timestamp()
    zone = timezone(timedelta(seconds=local_time.offset_s(begin_s)))
    locator = dates.AutoDateLocator(tz=zone, minticks=4, maxticks=10)
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(dates.DateFormatter("%H:%M:%S", tz=zone))
    axes.set_xlabel(local_time.zone_name(begin_s), fontsize="small", loc="right")


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
        figure.savefig(path, dpi=DPI)
    except OSError as error:
        raise BadInputError(f"{path}: cannot write the plot: {error.strerror or error}") from None
    except ValueError as error:
        raise BadInputError(f"{path}: cannot write the plot: {error}") from None


def png(figure: Any) -> bytes:
    """Return a figure as an image."""
    stream = io.BytesIO()
    figure.savefig(stream, dpi=DPI, format="png")
    return stream.getvalue()


def save_pointing(path: Path, found: PointingFit, stars: Sequence[Star], name: str) -> None:
    """Draw the residuals of pointing stars over the sky, before and after the model.

    Raises BadInputError where that cannot be.
    """
    figure = new_figure(11.0, 6.0)
    sides = figure.subplots(1, 2, subplot_kw={"projection": "polar"})
    at = np.array([(star.hour_angle_deg, star.dec_deg) for star in stars])
    latitude_deg = found.latitude_deg
    north_deg, frame = 0.0, frame_of(found.axes, latitude_deg)
    if found.axes == "altaz":
        # Azimuth and altitude are hour angle and declination where the pole is overhead.
        at, latitude_deg = at - np.array([180.0, 0.0]), 90.0
    elif frame is not None:
        at = np.stack(frame.angles(at[:, 0], at[:, 1], fn=np)[:2], axis=1)
        north_deg, latitude_deg = frame.geometry.pole_azimuth_deg, frame.horizon_latitude_deg
    zenith, azimuth = _on_chart(at, latitude_deg, north_deg)
    for axes, residuals, words in (
        (sides[0], found.before_arcsec, "as the mount reports"),
        (sides[1], found.residuals_arcsec, "with the model"),
    ):
        sky_axes(axes)
        size = np.linalg.norm(residuals, axis=1)
        middle = float(np.sqrt(np.mean(size[found.used] ** 2)))
        step = 1e-3 * residuals / np.maximum(size, 1e-9)[:, None]
        step[:, 0] /= np.cos(np.radians(at[:, 1]))
        there, turned = _on_chart(at + step, latitude_deg, north_deg)
        right = zenith * np.sin(azimuth) - there * np.sin(turned)
        up = there * np.cos(turned) - zenith * np.cos(azimuth)
        arrows = (np.stack([right, up]) / np.maximum(np.hypot(right, up), 1e-12)) * size
        axes.quiver(azimuth, zenith, *arrows, color=RA, width=0.005, scale=8.0 * max(middle, 1e-3))
        axes.scatter(azimuth, zenith, s=12.0, c=np.where(found.used, INK, BAD), zorder=3)
        unit = f"{middle:.1f}″" if middle < 100.0 else f"{middle / 60.0:.1f}′"
        axes.set_title(f"{words}: {unit} RMS", fontsize="medium")
    wrong = int((~found.used).sum())
    left_out = f", {wrong} left out (red)" if wrong else ""
    figure.suptitle(
        f"{name}: {found.stars} stars{left_out}; arrows lead from the star to where the mount reports it"
    )
    save(figure, path)


def _on_chart(places_deg: Array, latitude_deg: float, north_deg: float) -> tuple[Array, Array]:
    """Return distances from the zenith (degrees) and azimuths (radians) of hour angles and declinations.

    They are about a pole whose altitude is the latitude, and whose azimuth is `north_deg`.
    """
    alt = [altitude_deg(h, d, latitude_deg) for h, d in places_deg.tolist()]
    azimuth = [north_deg + azimuth_deg(h, d, latitude_deg) for h, d in places_deg.tolist()]
    return 90.0 - np.array(alt), np.radians(azimuth)


WIDTH, HEIGHT = 9.5, 3.4
LEAST_DELAY_MS = 1.0
"""The least span of the delays' scale: a steady link must look steady."""
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
        if len(run.sky_utc_s):
            found["Sky"] = _sky(run)
        if (repeats := _repeats(run)) is not None:
            found["What repeats with the axes' angles"] = repeats
    if len(run.utc_s) > 1:
        found["Link"] = _link(run)
    if fit is not None:
        found["Biases of the satellite"] = _biases(fit)
    return found


def pictures(run: Trace, fit: BiasFit | None) -> dict[str, bytes]:
    """Return the plots of one run as images by title; raises BadInputError where matplotlib is not there."""
    return {title: png(figure) for title, figure in figures(run, fit).items()}


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
    titles = run.engine.spec.profile.axis_titles("right ascension")
    for column, (title, colour) in enumerate(zip(titles, (RA, DEC), strict=True)):
        axes.plot(at, run.sent[:, column], color=colour, linewidth=1.0, label=whole_title(title))
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
    titles = run.engine.spec.profile.axis_titles()
    for axis, (name, colour) in enumerate(zip(titles, (RA, DEC), strict=True)):
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


MOST_UPRIGHT, MOST_LABELS = 6, 40
"""So many recordings are named side by side below a trend, and so many at all."""


def trend(reports: Sequence[Report]) -> Any | None:
    """Return how several nights went on, in order of time; None for fewer than two that followed anything."""
    followed = sorted((one for one in reports if one.error is not None), key=lambda one: one.began_utc)
    if len(followed) < 2:
        return None
    figure = new_figure(WIDTH, 6.4)
    errors, biases, gains = figure.subplots(3, 1, sharex=True)
    number = np.arange(len(followed))
    seen = [one.error for one in followed if one.error]
    errors.semilogy(number, [one.rms_arcsec for one in seen], "o-", color=RA, label="RMS")
    errors.semilogy(number, [one.peak_arcsec for one in seen], "^:", color=BAD, label="peak")
    errors.set_ylabel("error, ″")
    for source, colour, label in (("observations", GOOD, "observed, ± 2 σ"), ("nudge", PALE, "last nudge")):
        known = [(i, one.bias) for i, one in enumerate(followed) if one.bias and one.bias.source == source]
        if known:
            values, sigmas = zip(
                *((b.along_s, 2.0 * (b.along_sigma_s or 0.0)) for _, b in known), strict=True
            )
            at = [i for i, _ in known]
            biases.errorbar(at, values, yerr=sigmas, fmt="o", color=colour, label=label)
    for key, colour, name in (("ra", RA, "hour angle"), ("dec", DEC, "declination")):
        fitted = [(i, getattr(one, key).gain) for i, one in enumerate(followed)]
        fitted = [(i, gain) for i, gain in fitted if gain is not None]
        if fitted:
            gains.plot(*zip(*fitted, strict=True), "o", color=colour, label=name)
    biases.set_ylabel("along bias, s")
    gains.set_ylabel("gain")
    gains.ticklabel_format(axis="y", useOffset=False)
    upright = len(followed) <= MOST_UPRIGHT
    labels = [
        f"{local_time.date(iso_unix_s(one.began_utc))}{chr(10) if upright else '  '}{one.name}"
        for one in followed
    ]
    step = -(-len(followed) // MOST_LABELS)
    gains.set_xticks(number[::step], labels[::step], fontsize="x-small", rotation=0 if upright else 90)
    for axes in (errors, biases, gains):
        axes.grid(color="0.92")
        if axes.get_legend_handles_labels()[1]:
            axes.legend(fontsize="small", frameon=False)
    return figure
