"""The offsets in force and asked for, what the arrow keys change, the search and the estimate."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.tui import words
from sattrack.tui.frames import LABELS, TRACK
from sattrack.tui.look import DIM
from sattrack.tui.panels import Panel, Part, Row, labelled

if TYPE_CHECKING:
    from sattrack.tui.frames import Move
    from sattrack.tui.scene import Scene

CELLS = 8


class BiasPanel(Panel):
    """What is added to the satellite's direction, and which key moves it which way."""

    def full(self, scene: Scene) -> list[Row]:
        """Return the biases, the frame that the arrows move in, and what searches and observes, in rows."""
        along, across = _track_values(scene)
        rows = [labelled("along", *along, cells=CELLS), labelled("across", *across, cells=CELLS)]
        if scene.tape is not None or not scene.in_control:
            return [*rows, _others(scene), _news(scene)[:1]]
        for move, keys in _moves(scene):
            hint = "  ".join(keys)
            if scene.frame is TRACK:
                rows.append(labelled("", hint, cells=CELLS))
                continue
            value = _values(scene, move)
            if len(value) == 1:
                value.append((f"  {hint}", DIM))
            rows.append(labelled(move.label, *value, cells=CELLS))
        step: Row = [f"{scene.step.along_s:g} s", (" and ", DIM), f"{scene.step.cross_deg:g}°"]
        rows.append(labelled("step", *step, ("  f ", DIM), scene.frame.name, cells=CELLS))
        rows.append(_news(scene) or _others(scene))
        return rows

    def compact(self, scene: Scene) -> list[Row]:
        """Return two rows: the track's, or beside them in few words what is more to the point."""
        along, across = _track_values(scene)
        news = _news(scene)
        if scene.tape is not None or not scene.in_control:
            return [labelled("along", *along, "   ", *news[:1]), labelled("across", *across)]
        if scene.frame is TRACK:
            rows = [labelled("along", *along), labelled("across", *across)]
            hints: list[Row] = [
                [("   ← behind  → ahead on track by ", DIM), f"{scene.step.along_s:g} s"],
                [("   ↑ left  ↓ right of motion by ", DIM), f"{scene.step.cross_deg:g}°"],
            ]
            if news:
                hints[1] = [("   ", DIM), *news]
        else:
            rows = [labelled(move.label, *_values(scene, move)) for move, _ in _moves(scene)]
            by: Row = [(" by ", DIM), f"{scene.step.cross_deg:g}°"]
            hints = [[(f"   {'  '.join(keys)}", DIM), *by] for _, keys in _moves(scene)]
            if news:
                hints[1] = [("   ", DIM), *news]
        return [row + hint for row, hint in zip(rows, hints, strict=True)]


def _moves(scene: Scene) -> list[tuple[Move, tuple[str, str]]]:
    """Return what the arrows change, and what each of the two does."""
    across, upward = scene.frame.across, scene.frame.upward
    return [
        (across, (f"← {across.minus}", f"→ {across.plus}")),
        (upward, (f"↑ {upward.plus}", f"↓ {upward.minus}")),
    ]


def _track_values(scene: Scene) -> tuple[Row, Row]:
    view = scene.view
    along: Row = [
        (f"{words.signed(view.bias_along_s, 3)} s", "bold"),
        *_asked(scene, TRACK.across.what, f"{words.signed(view.bias_along_goal_s, 3)} s"),
    ]
    across: Row = [
        (f"{words.signed(view.bias_cross_deg, 4)}°", "bold"),
        *_asked(scene, TRACK.upward.what, f"{words.signed(view.bias_cross_goal_deg, 4)}°"),
    ]
    return along, across


def _asked(scene: Scene, what: str, goal: str) -> Row:
    """Return what was asked for; where that changes gradually, by how much a second."""
    rate = next((one.rate for one in scene.view.offsets if one.what == what), 0.0)
    if rate == 0.0:
        return [("  asked ", DIM), goal]
    return [("  by ", DIM), f"{words.signed(rate, 5)}/s"]


def _values(scene: Scene, move: Move) -> Row:
    one = next((one for one in scene.view.offsets if one.what == move.what), None)
    applied, total = (0.0, 0.0) if one is None else (one.applied, one.total)
    value: Row = [(f"{words.signed(applied, 4)}°", "bold")]
    if round(applied, 4) != round(total, 4):
        value += [("  asked ", DIM), f"{words.signed(total, 4)}°"]
    return value


def _news(scene: Scene) -> Row:
    """Return what searches, else what was estimated, else what was remembered; nothing where nothing is."""
    search, estimate = scene.view.search, scene.view.estimate
    if search is not None:
        return [(f"{search.how} {search.elapsed_s:.0f} s", "bold"), ("   s keep  Esc cancel", DIM)]
    if estimate is None:
        return _remembered(scene)
    counts: Part = f"{estimate.accepted} seen"
    if estimate.rejected or estimate.refused:
        counts = f"{estimate.accepted} of {estimate.accepted + estimate.rejected + estimate.refused} seen"
    if estimate.along_sigma_s is None or estimate.cross_sigma_deg is None:
        return [counts]
    sigmas = (f"{estimate.along_sigma_s:.4f} s", f"{estimate.cross_sigma_deg:.4f}°")
    return [counts, (f" {' '.join(words.within(text, scene.plain) for text in sigmas)}", DIM)]


def _remembered(scene: Scene) -> Row:
    """Return the bias that an earlier pass left, as long as it is in force."""
    known = scene.view.remembered
    if known is None or known.state != "in force":
        return []
    hours = (scene.view.utc_s - known.utc_s) / 3600.0
    if known.along_sigma_s is None:
        return [(f"{hours:.1f} h old nudge", "bold"), ("   m drop", DIM)]
    return [
        (f"{hours:.1f} h old {words.within(f'{known.along_sigma_s:.3f} s', scene.plain)}", "bold"),
        ("   m drop", DIM),
    ]


def _others(scene: Scene) -> Row:
    """Return the offsets of other frames that are not nothing."""
    shown = {scene.frame.across.what, scene.frame.upward.what, TRACK.across.what, TRACK.upward.what}
    others = [LABELS.get(one.what, one.what) for one in scene.view.offsets if one.what not in shown]
    return [("also ", DIM), ", ".join(others)] if others else []
