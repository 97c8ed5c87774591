"""What the controller's console shows: one immutable state of the antenna behind its interface."""

from __future__ import annotations

import msgspec

SHOWN_EXCHANGES = 10
SHOWN_REFUSALS = 4
LONGEST_SHOWN = 100
"""Characters of one line: a view has to go through a pipe in one piece."""


class ExchangeView(msgspec.Struct, frozen=True, array_like=True):
    """One line from antcn and its answer, as much of them as is shown; UTC as POSIX seconds."""

    utc_s: float
    received: str
    answered: str


class RefusalView(msgspec.Struct, frozen=True, array_like=True):
    """One line from antcn that was refused, and why, in words; UTC as POSIX seconds."""

    utc_s: float
    received: str
    why: str


class FocusView(msgspec.Struct, frozen=True, array_like=True):
    """Where the focuser's axes are, mm, None where that is not known, and whether any of them moves."""

    axes_mm: tuple[float | None, ...]
    moving: bool


class AxesView(msgspec.Struct, frozen=True, array_like=True):
    """Positions of both axes, degrees, the first with its turns."""

    first_deg: float
    second_deg: float


class AntennaView(msgspec.Struct, frozen=True):
    """One state; `commanded` and `actual` are None without a trajectory, or where the mount is not heard."""

    utc_s: float
    door: str
    caller: bool
    """Whether antcn is connected; always so on a serial line."""
    axes: str
    mount: str
    link_up: bool
    remote: bool
    doing: str
    servo: str
    outside_limits: bool
    tripped: str | None
    commanded: AxesView | None
    actual: AxesView | None
    refused: int
    exchanges: tuple[ExchangeView, ...] = ()
    """The last ones, the newest first."""
    refusals: tuple[RefusalView, ...] = ()
    """The last ones, the newest first."""
    focus: FocusView | None = None
