"""A console's view made by hand, and a feed that remembers what it was told."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import msgspec

from sattrack.mount.model import LinkView, Readings, Status
from sattrack.tui.feeds import Latest
from sattrack.views.run import AskedView, ConsoleView

if TYPE_CHECKING:
    from sattrack.views.messages import ConsoleMessage

UTC_S = 1790946271.4
GUIDE_DEG_S = 350.0 * 360.0 / 2**26
LINK = LinkView("up", 0.03, 1234, 1233, 0, 0, 0, 0, 20.0, 0.41)
STATUS = Status(
    altitude_deg=45.32,
    azimuth_deg=261.44,
    dec_deg=12.5,
    dec_rate_dtics_s=0,
    ra_h=5.5,
    ra_rate_dtics_s=7789,
    sidereal_h=8.25,
    site_height_m=2635.0,
    site_latitude_deg=-24.6275,
    site_longitude_deg=-121.4042,
    target_dec_deg=12.5,
    target_ra_h=5.5,
    counter=1720000,
    dec_guide_rate_dtics_s=3500.0,
    ra_guide_rate_dtics_s=3500.0,
    dec_current_10ma=-51,
    ra_current_10ma=123,
    at_home=False,
    at_park=False,
    connected=True,
    does_refraction=False,
    equatorial_system=0,
    pulse_guiding=False,
    side_of_pier=True,
    slewing=False,
    tracking=True,
    tracking_rate=0,
    ack_move_dec=False,
    ack_move_ra=False,
    utc_1=1,
    utc_2=2,
    utc_3=3,
    ra_drive_status_1=4,
    ra_drive_status_2=5,
    dec_drive_status_1=6,
    dec_drive_status_2=7,
    ack_abort=False,
    ack_sync=False,
    ack_pulse_guide=False,
    ack_slew=True,
    spare=9,
)
ASKED = (
    AskedView(1, "slew to RA 05h 30m 00.0s Dec +12° 30′ 00″", "complete", True, True, None, UTC_S - 60.0),
    AskedView(2, "park", "sent, unconfirmed", False, True, "no acknowledgement", UTC_S - 20.0),
)
VIEW = ConsoleView(
    utc_s=UTC_S,
    mount="xerxes://192.0.2.7:15001",
    profile="hill",
    move_axis="held",
    doing="idle",
    motion="none",
    at_rest=True,
    status=STATUS,
    readings=Readings("int64", "int64", "double", "double", "double", "the opposite of slewing"),
    hour_angle_deg=41.25,
    clock_offset_s=-0.35,
    ra_rate_deg_s=0.0,
    dec_rate_deg_s=0.0,
    max_ra_rate_deg_s=6.0,
    max_dec_rate_deg_s=4.0,
    guide_rate_deg_s=GUIDE_DEG_S,
    floor_altitude_deg=0.0,
    can_park=True,
    link=LINK,
    stranger_hosts=(),
    asked=ASKED,
    refusal=None,
    tripped=None,
    warnings=(),
)


def console_view(**changes: Any) -> ConsoleView:
    """Return the view with some fields different; `link` and `status` may be given as their own changes."""
    for name in ("link", "status"):
        if isinstance(changes.get(name), dict):
            changes[name] = msgspec.structs.replace(getattr(VIEW, name), **changes[name])
    return msgspec.structs.replace(VIEW, **changes)


@dataclass
class FakeConsole:
    """Hands out what a test puts in, and keeps what it is told."""

    coming: list[Latest] = field(default_factory=lambda: [Latest(VIEW)])
    told: list[ConsoleMessage] = field(default_factory=list)

    def latest(self) -> Latest:
        return self.coming.pop(0) if self.coming else Latest()

    def tell(self, order: ConsoleMessage) -> bool:
        self.told.append(order)
        return True
