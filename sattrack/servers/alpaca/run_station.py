"""A run of `sattrack track` as clients of telescopes and rotators see it, and a loop that only looks on."""

from __future__ import annotations

import math
import socket
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import msgspec

from sattrack.control.aim import Aim
from sattrack.control.driver import sample_by_axes
from sattrack.core.clock import SimulatedClock, SystemClock, decode_utc, encode_utc
from sattrack.core.errors import SattrackError
from sattrack.core.local_time import stamped
from sattrack.mount.requests import Abort
from sattrack.mount.xerxes.link import LinkState
from sattrack.mount.xerxes.session import Session
from sattrack.runtime.connection import Connection
from sattrack.runtime.mounts import OverheardLink, connection_to_watch, owned_address, owners
from sattrack.runtime.system import StopRequest
from sattrack.servers.alpaca.protocol import Fault, FollowedState, Number
from sattrack.servers.alpaca.serve import AlpacaLoop, AlpacaTask, start_http_process
from sattrack.servers.alpaca.shared_rotator import SharedRotator
from sattrack.servers.alpaca.state import Answers, MountState, state_of
from sattrack.servers.antenna.trajectory import SiteSky
from sattrack.servers.rotctld.serve import RotctldServer
from sattrack.views.run import SummaryLine, TrackView

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sattrack.core.channel import Channel
    from sattrack.core.clock import Clock
    from sattrack.runtime.view_server import RunMessage, RunViews
    from sattrack.servers.alpaca.protocol import NumberedOrder, TelescopeState

ACQUIRED = ("following", "paused")


class RunServersTask(msgspec.Struct, frozen=True):
    """Whose run, how its clients are served, and what the log calls them; descriptors are inherited."""

    pid: int
    telescope: AlpacaTask
    rotctld: int | None
    program: str

    def encode(self) -> bytes:
        """Return it as one JSON line."""
        return msgspec.json.encode(self, enc_hook=encode_utc) + b"\n"


class RunStation:
    """The mount of a run as clients see it; `stop_run` asks the run for a stop. Without I/O of its own."""

    safety = None
    mount_stopped: bool | None = None
    on_trajectory = True
    turns_known_s = math.inf
    """It sends nothing: the run's own loop knows."""

    def __init__(self, task: AlpacaTask, stop_run: Callable[[], None]) -> None:
        known = task.satellites
        self.profile = known.profile
        self.session = Session(known.profile)
        self.answers = Answers()
        self.log_lines: list[str] = []
        self.finished = False
        self._stop_run = stop_run
        self._shared = SharedRotator(SiteSky(known.site.place()), known.profile, known.limits, self._why_busy)
        self.rotator = self._shared.rotator
        self._mount_state = MountState(known.profile)
        self._mount_state.moved("move")
        own = known.profile.frame is not None or known.profile.pointing is not None
        self._aim = Aim(known.profile, known.site.place()) if own else None
        """Where the telescope looks, as for `serve`; None where the mount's own coordinates are all."""
        self._view: TrackView | None = None
        self._acquired = False

    @property
    def tripped(self) -> str | None:
        """Name of the limit that has ended the run."""
        ended_by = None if self._view is None else self._view.ended_by
        return ended_by.removeprefix("limit:") if ended_by and ended_by.startswith("limit:") else None

    @property
    def link_up(self) -> bool:
        """Whether the mount is heard."""
        return self._shared.link_up

    def see(self, message: RunMessage) -> None:
        """Take a view of the run; after a summary another run may begin."""
        if isinstance(message, SummaryLine):
            self._view, self._acquired = None, False
            return
        self._view = message
        self._acquired = self._acquired or message.rms_pass_arcsec is not None

    def receive(self, data: bytes, arrival_utc_s: float) -> None:
        """Take one datagram of the mount, as the run has heard it."""
        self.session.receive(data, arrival_utc_s)
        self._shared.receive(data, arrival_utc_s)
        self._mount_state.see(self.session)

    def tick(self, now_utc_s: float) -> None:
        """Send nothing; see whether the mount is heard, and whether a rotator's client wants it stopped."""
        link = self.session.link_state(now_utc_s)
        self._shared.link_up, self._shared.tripped = link in {LinkState.UP, LinkState.STALE}, self.tripped
        self.answers.tick(True)
        self.heed_rotator()

    def heed_rotator(self) -> None:
        """Stop the run where a client of rotctld has asked for that."""
        if self.rotator.stop_asked:
            self.rotator.stop_asked = self.rotator.reset_asked = False
            self._stop_run()

    def repeat(self) -> None:
        """Send nothing."""

    def send_shift_s(self, now_utc_s: float) -> float:
        """See RealtimeLoop: periods are all the same."""
        del now_utc_s
        return 0.0

    def end(self, now_utc_s: float) -> None:
        """End; the mount is the run's."""
        del now_utc_s
        self.finished = True

    def obey(self, numbered: NumberedOrder, now_utc_s: float) -> None:
        """Stop the run, or refuse an order with its reason."""
        del now_utc_s
        if isinstance(numbered.order, Abort):
            self._stop_run()
            self.answers.done(numbered.number)
            return
        reason = f"the mount is {self._doing}; it takes nothing but a stop from here, which ends the run"
        self.answers.refused(numbered.number, Fault(Number.INVALID_OPERATION, reason))

    def state(self, now_utc_s: float) -> TelescopeState:
        """Return what clients may see, as of an instant."""
        view, following, slewing = self._view, None, False
        if view is not None:
            stage = view.stages[-1].doing if view.stages else ""
            slewing = not (self._acquired and stage in ACQUIRED)
            following = FollowedState(
                name=view.name,
                catalog_number=view.catalog_number or 0,
                phase=view.phase,
                along_s=view.bias_along_goal_s,
                cross_deg=view.bias_cross_goal_deg,
                error_arcsec=None if view.error is None else view.error.total_arcsec,
                acquired=self._acquired,
            )
        return state_of(
            self.session,
            self._mount_state,
            utc_s=now_utc_s,
            heard=self.link_up,
            slewing=slewing,
            pulsing=False,
            doing=self._doing,
            failure=None,
            tripped=self.tripped,
            following=following,
            looks_at_deg=self._looks_at_deg,
        )

    @property
    def _looks_at_deg(self) -> tuple[float, float] | None:
        sample, frame = self.session.sample, self.profile.frame
        if self._aim is None or sample is None:
            return None
        return self._aim.looks_at_deg(sample if frame is None else sample_by_axes(sample, frame))

    @property
    def _doing(self) -> str:
        if self._view is None:
            return "a run's of `sattrack track`, which has not begun or is over"
        if self._view.ended_by is not None:
            return "stopping"
        return f"following {self._view.name} (sattrack track)"

    def _why_busy(self) -> str | None:
        return f"the mount is {self._doing}"


class RunLink(OverheardLink):
    """What a run's sessions hear of their mounts, one after another, as each begins."""

    def __init__(self, pid: int, look_every_s: float) -> None:
        ours, self._silent = socket.socketpair()
        super().__init__(None, ours)  # type: ignore[arg-type]
        self._pid, self.ended = pid, True
        self._look_every_s = look_every_s
        self._next_s = 0.0

    def look(self) -> None:
        """Find the run's mount, where it is not heard."""
        now_s = time.monotonic()
        if not self.ended or now_s < self._next_s:
            return
        self._next_s = now_s + self._look_every_s
        owner = next((one for one in owners() if one.pid == self._pid), None)
        connection = None if owner is None else connection_to_watch(owner.mount)
        if owner is not None and connection is not None:
            self.close()
            OverheardLink.__init__(self, owned_address(owner), connection)


@dataclass(slots=True)
class RunLoop(AlpacaLoop):
    """Serves a run's clients until the run is over."""

    driver: RunStation  # type: ignore[assignment]
    views: RunViews = field(kw_only=True)
    starter: Channel = field(kw_only=True)

    def readers(self) -> list[Any]:
        """See RealtimeLoop."""
        return [*AlpacaLoop.readers(self), *self.views.readers()]

    def serve(self, ready: list[Any]) -> None:
        """See RealtimeLoop."""
        AlpacaLoop.serve(self, ready)
        self.driver.heed_rotator()
        for message in self.views.news():
            self.driver.see(message)

    def obey(self, now_utc_s: float) -> None:
        """Find the run and its mount; end with either the run, or the clients' process."""
        if self.server.ended:
            raise SattrackError("the process that clients talk to is gone")
        AlpacaLoop.obey(self, now_utc_s)
        self.views.look()
        self.connection.link.look()  # type: ignore[union-attr]
        self.starter.lines()
        if self.starter.ended or self.views.ended:
            self.driver.end(now_utc_s)

    def report_mount(self, way: str, ready_again: str) -> None:
        """Report nothing: the run does."""


def serve(
    line: bytes,
    starter: Channel,
    views: RunViews,
    first: Sequence[RunMessage],
    log: Callable[[str], None],
) -> None:
    """Serve until the run is over, a task of one JSON line.

    `first` are the run's first views; `log` takes lines.

    Raises SattrackError where the clients' process does not come up.
    """
    task = msgspec.json.decode(line, type=RunServersTask, dec_hook=decode_utc)
    setting = task.telescope.clock
    clock: Clock = SystemClock()
    if setting is not None:
        clock = SimulatedClock(setting.start_utc_s, setting.anchor_s, setting.speed)
    station = RunStation(task.telescope, views.stop)
    for message in first:
        station.see(message)
    server, rotctld = start_http_process(task.telescope), None
    if task.rotctld is not None:
        info = f"sattrack: {station.profile.name}"
        listener = socket.socket(fileno=task.rotctld)
        rotctld = RotctldServer(listener, task.telescope.limits(), station.rotator, info)
    connection = Connection(RunLink(task.pid, views.LOOK_EVERY_S), clock)
    try:
        RunLoop(
            connection,
            StopRequest(),
            station,
            server,
            lambda text: log(stamped(clock.utc_s(time.monotonic()), task.program, text)),
            rotctld,
            views=views,
            starter=starter,
        ).run()
    finally:
        server.close()
