"""Fly a prepared run, in real or in virtual time, from its first datagram to the mount at rest."""

from __future__ import annotations

from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING

import msgspec

from sattrack.mount.simulator.mount import SimulatedMount, SimulatedSite
from sattrack.mount.simulator.settings import simulator_profile
from sattrack.recording.recorder import BackgroundRecorder, NoRecording, Recorder, Sink, create
from sattrack.runtime import practice
from sattrack.runtime.console import Connection
from sattrack.runtime.embedded import EmbeddedMount, simulator_config, start_embedded
from sattrack.runtime.facts import build_engine, encode_facts
from sattrack.runtime.guard import owned
from sattrack.runtime.live import LiveLoop, Screen
from sattrack.runtime.observers import QUEUED_MOST
from sattrack.runtime.outcome import summarise
from sattrack.runtime.remembering import keep
from sattrack.runtime.signals import stopping
from sattrack.runtime.virtual import VirtualRun
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from sattrack.runtime.facts import RunFacts
    from sattrack.runtime.live import Inbox
    from sattrack.runtime.mounts import MountAddress
    from sattrack.runtime.observers import Observers
    from sattrack.runtime.prepare import Prepared
    from sattrack.runtime.signals import StopRequest
    from sattrack.views.messages import Message, Observation, SeenOffset
    from sattrack.views.run import Summary, TrackView


def fly_virtual(
    prepared: Prepared,
    progress: Callable[[TrackView], None] | None = None,
    messages: tuple[tuple[float, Message], ...] = (),
    observers: Observers | None = None,
) -> Summary:
    """Run in virtual time with a simulated mount, as fast as it goes; observations come at their instants."""
    facts = prepared.facts
    with ExitStack() as stack:
        sink = stack.enter_context(_recording(facts, background=False))
        hardware = simulator_profile(prepared.simulator)
        mount = SimulatedMount(facts.profile, _simulated_site(facts), practice.START, hardware)
        engine = build_engine(facts)
        if observers is not None:
            messages += tuple(_dated(seen, facts) for seen in observers.observations(QUEUED_MOST))
            engine.malformed, engine.dropped = observers.malformed, observers.dropped
        run = VirtualRun(engine, mount, facts.started_utc_s, sink, messages, progress)
        ended_utc_s = run.run()
        summary = summarise(run.engine, run.statistics, ended_utc_s)
        kept = keep(run.engine, facts, ended_utc_s, prepared.memory)
        summary = msgspec.structs.replace(summary, bias_memory=kept)
        sink.summary(ended_utc_s, summary)
    return msgspec.structs.replace(summary, recording_trouble=sink.trouble)


def fly_live(
    prepared: Prepared,
    show: Callable[[TrackView], None],
    stop: StopRequest,
    inbox: Inbox | None = None,
    deadline_s: float = float("inf"),
    observers: Observers | None = None,
) -> Summary:
    """Run in real time, over UDP; the simulated mount is started beside it where there is no other.

    Raises SattrackError where the mount has an owner, or a port or the simulated mount is not available.
    """
    facts = in_run_time(prepared.facts, prepared.clock.speed)
    with ExitStack() as stack:
        simulated: EmbeddedMount | None = None
        address: MountAddress | None = prepared.address
        if address is None:
            profile, site = prepared.facts.profile, facts.site.place()
            simulated = start_embedded(simulator_config(profile, prepared.simulator, site, prepared.clock))
            stack.callback(simulated.close)
            address = simulated.address
        link, guard = stack.enter_context(
            owned(address, prepared.facts.profile, prepared.clock.speed, facts.mount_name)
        )
        sink = stack.enter_context(_recording(facts, background=True))
        screen = Screen(show)
        stack.callback(screen.close)
        engine = build_engine(facts)
        connection = Connection(link, prepared.clock, simulated, guard)
        loop = LiveLoop(connection, stop, engine, sink, screen, inbox, deadline_s, observers)
        if observers is not None:
            engine.expect_observations()
        stack.enter_context(stopping(stop))
        ended_utc_s = loop.run()
        summary = summarise(engine, loop.statistics, ended_utc_s)
        if summary.message is not None and link.trouble is not None:
            summary = msgspec.structs.replace(summary, message=f"{summary.message}; {link.trouble}")
        kept = keep(engine, facts, ended_utc_s, prepared.memory)
        summary = msgspec.structs.replace(summary, bias_memory=kept)
        if guard.deposed:
            summary = msgspec.structs.replace(summary, mount_stopped=guard.mount_stopped)
        sink.summary(ended_utc_s, summary)
    realtime = loop.grant is not None and loop.grant.realtime
    return msgspec.structs.replace(summary, recording_trouble=sink.trouble, realtime_priority=realtime)


def _dated(seen: Observation | SeenOffset, facts: RunFacts) -> tuple[float, Message]:
    return max(facts.started_utc_s, float(Utc.parse(seen.utc).unix_s)), seen


def in_run_time(facts: RunFacts, speed: float) -> RunFacts:
    """Return the facts for a clock that runs at `speed`: real delays last longer by it."""
    if speed == 1.0:
        return facts
    profile = msgspec.structs.replace(
        facts.profile,
        command_delay_s=facts.profile.command_delay_s * speed,
        status_delay_s=facts.profile.status_delay_s * speed,
    )
    return msgspec.structs.replace(facts, profile=profile)


def _simulated_site(facts: RunFacts) -> SimulatedSite:
    return SimulatedSite(facts.site.latitude_deg, facts.site.longitude_deg, facts.site.height_m)


@contextmanager
def _recording(facts: RunFacts, background: bool) -> Iterator[Sink]:
    if facts.recording is None:
        yield NoRecording()
        return
    from pathlib import Path

    recorder = Recorder(create(Path(facts.recording)), msgspec.Raw(encode_facts(facts)))
    sink: Recorder | BackgroundRecorder = BackgroundRecorder(recorder) if background else recorder
    try:
        yield sink
    finally:
        sink.close()
