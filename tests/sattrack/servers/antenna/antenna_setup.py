"""An antenna that stands still at 30° and 40°, for tests of what its controller says."""

from __future__ import annotations

from sattrack.servers.antenna.controller import Controller
from sattrack.servers.antenna.equipment import Antenna, Feedback, Focuser, SimulatedFocusAxis
from sattrack.servers.antenna.protocol import NS
from sattrack.servers.antenna.trajectory import AxisRange, AxisState, SiteSky
from tle.instants import Utc
from tle.site import Site

NOON_NS = int(Utc.parse("2026-10-02T12:00:00Z").unix_s) * NS
SITE = Site(52.1541, 4.4908, 0.0)
RANGE = AxisRange(-180.0, -200.0, 200.0, -89.9, 89.9)


class StandsStill(Feedback):
    link_up = True

    def __init__(self) -> None:
        self.controller: Controller | None = None

    @property
    def on_trajectory(self) -> bool:  # type: ignore[override]
        path = None if self.controller is None else self.controller.path
        return path is not None and path.at(NOON_NS)[:2] == (30.0, 40.0)

    def actual(self, utc_ns: int) -> AxisState:
        return AxisState(30.0, 40.0, 0.0, 0.0)


def make_controller(axes: str = "hadec", sky: SiteSky | None = None) -> Controller:
    antenna = Antenna(
        sky or SiteSky(SITE),
        axes,
        RANGE,
        stow=(0.0, 89.0),
        service=(-45.0, 10.0),
        focuser=Focuser((SimulatedFocusAxis(), SimulatedFocusAxis())),
    )
    feedback = StandsStill()
    feedback.controller = Controller(antenna, feedback)
    return feedback.controller


def exchange(controller: Controller, sent: bytes, at_s: float = 0.0) -> bytes:
    return controller.receive(sent, NOON_NS + round(at_s * NS))[0]
