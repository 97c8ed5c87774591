"""State diagrams, drawn and written out, from the transition tables that the program runs by.

A new table is one more row of `DIAGRAMS`, with a place for each of its states.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, NamedTuple, TypeVar

from sattrack.mount.requests import SETTLED, TICKET_TRANSITIONS, TicketState
from sattrack.mount.xerxes.flags import (
    HANDSHAKE,
    HELD,
    SLEW,
    STOP,
    Handshake,
    HeldState,
    SlewState,
    StopState,
)
from sattrack.mount.xerxes.link import LINK, LinkState
from tools.protocol import svg

if TYPE_CHECKING:
    from collections.abc import Mapping

BOX_WIDTH, BOX_HEIGHT = 168.0, 48.0
LETTER_WIDTH = 5.9
MARGIN = 24.0
BEND = 0.16
Pair = tuple[float, float]
State = TypeVar("State", bound=Enum)
COLOURS = ("#1b6ca8", "#b4500f", "#3f7d20", "#7a3e9d")


class Step(NamedTuple):
    """One row of a transition table; no `event` where the table names none, no `before` for any state."""

    before: Enum | None
    event: str
    after: Enum


@dataclass(frozen=True)
class Diagram:
    """One picture: where the centre of each state stands, in its own coordinates, and the steps."""

    name: str
    title: str
    places: Mapping[Enum, Pair]
    steps: tuple[Step, ...]
    ends: frozenset[Enum] = frozenset()


def _steps(table: Mapping[tuple[State | None, str], State]) -> tuple[Step, ...]:
    return tuple(Step(before, event, after) for (before, event), after in table.items())


def _ticket_steps() -> tuple[Step, ...]:
    return tuple(
        Step(before, "", after)
        for before, follows in TICKET_TRANSITIONS.items()
        for after in TicketState
        if after in follows
    )


DIAGRAMS = (
    Diagram(
        "handshake",
        "A one-shot flag and its acknowledgement",
        {
            Handshake.IDLE: (160, 190),
            Handshake.RAISED: (510, 50),
            Handshake.RELEASING: (860, 190),
            Handshake.WITHDRAWN: (510, 140),
        },
        _steps(HANDSHAKE),
    ),
    Diagram(
        "link",
        "The link, by the age of the last accepted status",
        {
            LinkState.SILENT: (110, 70),
            LinkState.UP: (450, 70),
            LinkState.STALE: (790, 70),
            LinkState.LOST: (620, 190),
        },
        _steps(LINK),
    ),
    Diagram(
        "slew",
        "A slew, as the session sees it",
        {
            SlewState.NONE: (130, 190),
            SlewState.WAITING: (130, 70),
            SlewState.ASKED: (470, 70),
            SlewState.LAUNCHED: (810, 70),
            SlewState.UNDER_WAY: (640, 190),
            SlewState.DONE: (980, 190),
        },
        _steps(SLEW),
        frozenset({SlewState.DONE}),
    ),
    Diagram(
        "stop",
        "The stop in force",
        {
            StopState.ASKED: (150, 70),
            StopState.HEARD: (490, 70),
            StopState.AGAIN: (830, 70),
        },
        _steps(STOP),
    ),
    Diagram(
        "held",
        "MoveAxis on a mount that holds",
        {
            HeldState.OVER: (130, 390),
            HeldState.RAISED: (500, 60),
            HeldState.IN_FORCE: (830, 60),
            HeldState.LAPSED: (1170, 190),
            HeldState.ENDING: (470, 300),
            HeldState.RELEASING: (830, 460),
        },
        _steps(HELD),
    ),
    Diagram(
        "ticket",
        "A request, from asked for to settled",
        {
            TicketState.QUEUED: (204, 40),
            TicketState.RAISED: (474, 40),
            TicketState.ACKNOWLEDGED: (744, 40),
            TicketState.COMPLETE: (844, 210),
            TicketState.UNCONFIRMED: (659, 210),
            TicketState.TIMED_OUT: (474, 210),
            TicketState.SUPERSEDED: (289, 210),
            TicketState.FAILED: (104, 210),
        },
        _ticket_steps(),
        frozenset(SETTLED),
    ),
)


def transition_table(diagram: Diagram) -> str:
    """Return a diagram's steps as Markdown; where no event is named, the states that may follow each."""
    if any(step.event for step in diagram.steps):
        lines = ["| state | event | next state |", "|---|---|---|"]
        lines += [f"| {_name(s.before)} | {s.event} | {_name(s.after)} |" for s in diagram.steps]
        return "\n".join(lines)
    lines = ["| state | may become |", "|---|---|"]
    for state in dict.fromkeys(step.before for step in diagram.steps if step.before is not None):
        follows = ", ".join(_name(step.after) for step in diagram.steps if step.before is state)
        lines.append(f"| {_name(state)} | {follows} |")
    return "\n".join(lines)


def draw(diagram: Diagram) -> str:
    """Return a diagram as SVG, without rows for any state; raises KeyError for a state without a place."""
    places = diagram.places
    box = (max(BOX_WIDTH, *(LETTER_WIDTH * len(str(state.value)) + MARGIN for state in places)), BOX_HEIGHT)
    width = max(x for x, _ in places.values()) + box[0] / 2 + MARGIN
    height = max(y for _, y in places.values()) + box[1] / 2 + 2 * MARGIN
    events: dict[tuple[Enum, Enum], list[str]] = {}
    for step in diagram.steps:
        if step.before is not None:
            events.setdefault((step.before, step.after), []).append(step.event)
    sources = list(dict.fromkeys(before for before, _ in events))
    arrows, labels = [], []
    for (before, after), names in events.items():
        colour = COLOURS[sources.index(before) % len(COLOURS)]
        drawn, words = _edge(places[before], places[after], box, ", ".join(names), colour)
        arrows.append(drawn)
        labels.append(words)
    boxes = [_box(place, box, state, state in diagram.ends) for state, place in places.items()]
    return svg.picture(width, height, diagram.title, [*arrows, *boxes, *(words for words in labels if words)])


def _name(state: Enum | None) -> str:
    if state is None:
        return "any"
    name, words = state.name.lower().replace("_", " "), str(state.value)
    return f"**{name}**" if words == name else f"**{name}** ({words})"


def _box(place: Pair, box: Pair, state: Enum, is_end: bool) -> str:
    x, y = place[0] - box[0] / 2, place[1] - box[1] / 2
    fill = "#e4e7eb" if is_end else "#eaf4fb"
    name, words = state.name.lower().replace("_", " "), str(state.value)
    parts = [
        f'<rect x="{x:g}" y="{y:g}" width="{box[0]:g}" height="{box[1]:g}" rx="10" fill="{fill}" '
        f'stroke="{svg.INK}" stroke-width="1.5"/>'
    ]
    if words == name:
        parts.append(svg.text(place[0], place[1] + 5, name, 14, more=' font-weight="bold"'))
    else:
        parts.append(svg.text(place[0], place[1] - 4, name, 14, more=' font-weight="bold"'))
        parts.append(svg.text(place[0], place[1] + 14, words, 10.5))
    return "\n".join(parts)


def _edge(before: Pair, after: Pair, box: Pair, words: str, colour: str) -> tuple[str, str | None]:
    # Bent to its left, so that two opposite arrows part.
    dx, dy = after[0] - before[0], after[1] - before[1]
    middle = ((before[0] + after[0]) / 2 + dy * BEND, (before[1] + after[1]) / 2 - dx * BEND)
    if not words:
        middle = ((before[0] + after[0]) / 2, (before[1] + after[1]) / 2)
    start, end = _border(before, box, middle), _border(after, box, middle)
    crest = ((start[0] + 2 * middle[0] + end[0]) / 4, (start[1] + 2 * middle[1] + end[1]) / 4)
    drawn = svg.arrow(start, middle, end, colour)
    return drawn, svg.label(crest[0], crest[1] + 4, words, colour) if words else None


def _border(centre: Pair, box: Pair, towards: Pair) -> Pair:
    """Return where the way from a box's centre to a point leaves the box."""
    dx, dy = towards[0] - centre[0], towards[1] - centre[1]
    across = box[0] / 2 / abs(dx) if dx else math.inf
    along = box[1] / 2 / abs(dy) if dy else math.inf
    share = min(across, along)
    return centre[0] + dx * share, centre[1] + dy * share
