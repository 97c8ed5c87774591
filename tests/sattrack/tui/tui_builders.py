"""Views made by hand, and a feed that remembers what it was told."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeVar

import msgspec

from sattrack.mount.model import LinkView
from sattrack.tui.app import TrackApp
from sattrack.tui.feeds import News
from sattrack.views.run import DatagramsView, ErrorView, PassView, PathPoint, SkyPoint, Summary, TrackView

if TYPE_CHECKING:
    from collections.abc import Callable

    from textual.app import App

    from sattrack.views.messages import Message

AppT = TypeVar("AppT", bound="App[None]")
UTC_S = 1790946271.4
LINK = LinkView("up", 0.03, 1234, 1233, 0, 0, 0, 0, 20.0)
ERROR = ErrorView(UTC_S, 0.42, 0.31, -0.28, 0.4, -0.12)
VIEW = TrackView(
    utc_s=UTC_S,
    phase="tracking",
    name="ISS (ZARYA)",
    catalog_number=25544,
    mount="sim",
    start_utc_s=UTC_S - 152.0,
    culminate_utc_s=UTC_S + 53.0,
    end_utc_s=UTC_S + 257.0,
    max_alt_deg=81.27,
    elements_age_s=45900.0,
    target_ra_deg=212.9,
    target_dec_deg=-43.4417,
    target_alt_deg=45.32,
    target_az_deg=261.44,
    range_km=611.6,
    mount_ra_deg=212.9001,
    mount_dec_deg=-43.4416,
    error=ERROR,
    rms_10s_arcsec=0.44,
    rms_pass_arcsec=0.51,
    ra_rate_deg_s=1.2346,
    dec_rate_deg_s=-0.0812,
    max_ra_rate_deg_s=6.0,
    max_dec_rate_deg_s=6.0,
    bias_along_s=0.05,
    bias_cross_deg=-0.01,
    bias_along_goal_s=0.1,
    bias_cross_goal_deg=-0.02,
    link=LINK,
    recording="pass.mcap",
    ended_by=None,
)
SUMMARY = Summary(
    name="ISS (ZARYA)",
    catalog_number=25544,
    mount="sim",
    started_utc="2026-10-02T13:01:50.475Z",
    ended_utc="2026-10-02T13:08:48.900Z",
    ended_by="set",
    samples=8000,
    on_target_s=400.0,
    acquired_after_s=0.7,
    reported_rms_arcsec=0.02,
    reported_peak_arcsec=0.3,
    true_rms_arcsec=None,
    true_peak_arcsec=None,
    period_ms=None,
    datagrams=DatagramsView(100, 99, 1, 0, 0, 0),
    bias_along_s=0.1,
    bias_cross_deg=0.0,
    recording=None,
    mount_stopped=True,
)


def _climb(begin_utc_s: float, end_utc_s: float) -> tuple[PathPoint, ...]:
    """Return a path from 10° in the west through 80° in the south to 10° in the east, made by hand."""
    points = ((10, 270), (30, 262), (60, 240), (80, 180), (60, 120), (30, 98), (10, 90))
    step_s = (end_utc_s - begin_utc_s) / (len(points) - 1)
    rows = enumerate(points)
    return tuple(PathPoint(begin_utc_s + step_s * n, float(alt), float(az), 0.5) for n, (alt, az) in rows)


SKY = PassView(
    latitude_deg=50.0,
    longitude_deg=10.0,
    path=_climb(UTC_S - 152.0, UTC_S + 257.0),
    rises=True,
    sets=True,
    culminate_utc_s=UTC_S + 53.0,
    sun=(SkyPoint(UTC_S - 152.0, 30.0, 200.0), SkyPoint(UTC_S + 257.0, 30.0, 202.0)),
    moon=(SkyPoint(UTC_S, 40.0, 45.0),),
    sun_cone_deg=15.0,
    moon_cone_deg=0.0,
    floor_altitude_deg=5.0,
    horizon=((0.0, 10.0), (90.0, 2.0), (180.0, 2.0), (270.0, 2.0)),
    keyhole_deg=10.0,
    command_delay_s=0.0003,
    delays_measured=False,
    along_arcsec=200.0,
    across_arcsec=50.0,
    fov_deg=0.25,
)


def changed(view: TrackView = VIEW, **changes: Any) -> TrackView:
    """Return a view with some fields different; `link` and `error` may be given as their own changes."""
    for name in ("link", "error"):
        if isinstance(changes.get(name), dict):
            changes[name] = msgspec.structs.replace(getattr(view, name), **changes[name])
    return msgspec.structs.replace(view, **changes)


@dataclass
class FakeFeed:
    """Hands out what a test puts in, and keeps what it is told."""

    coming: list[News] = field(default_factory=list)
    sent: list[Message] = field(default_factory=list)

    def news(self) -> News:
        return self.coming.pop(0) if self.coming else News()

    def send(self, message: Message) -> bool:
        self.sent.append(message)
        return True


@dataclass
class HandClock:
    """A monotonic clock that stands still until it is moved."""

    now_s: float = 100.0

    def __call__(self) -> float:
        return self.now_s


def press(feed: FakeFeed, *keys: str) -> TrackApp:
    """Run the screen at 80 × 24, press keys, and return the app as it then stood."""
    return pressed(lambda: TrackApp(feed, monotonic=HandClock()), *keys)


def pressed(make: Callable[[], AppT], *keys: str) -> AppT:
    """Run an app at 80 × 24, press keys, and return it as it then stood."""

    async def run() -> AppT:
        app = make()
        async with app.run_test(size=(80, 24)) as pilot:
            await pilot.press(*keys)
            await pilot.pause()
        return app

    return asyncio.run(run())
