"""`sattrack stop`: stop the mount from any terminal."""

from __future__ import annotations

import queue
import select
import sys
import threading
import time
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import click
import msgspec

from sattrack.cli.common import CommandContext, common_options, profile_option
from sattrack.cli.output import renew, say, tell
from sattrack.core.errors import NO_JSON, BadInputError, SattrackError
from sattrack.runtime.console import MountStop, stop_after, stop_directly, stop_session
from sattrack.runtime.mounts import (
    FORMS,
    SIMULATED,
    ask_give_up,
    is_antenna,
    mount_address,
    owner_of,
    owners,
)
from sattrack.schedule.night_stop import NightStop, begin_stops, listed_nights

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from sattrack.mount.model import MountProfile
    from sattrack.runtime.mounts import MountAddress, Owner
    from sattrack.schedule.night_stop import ListedRun

ANSWER_WITHIN_S = 10.0
"""How long the question of which mounts to stop waits, before all of them are stopped."""
SHOW_EVERY_S = 1.0
LOOK_EVERY_S = 0.1
SPECIAL_WORDS = {"": "all", "a": "all", "all": "all", "q": "none", "n": "none", "no": "none"}


class StopDocument(msgspec.Struct, frozen=True):
    """What scripts read."""

    stopped: tuple[MountStop, ...]
    errors: tuple[str, ...]
    nights: tuple[NightStop, ...] = ()


@dataclass(slots=True)
class StopProgress:
    """Says on standard error what is done, and on a terminal for how long it has been waited for."""

    monotonic: Callable[[], float] = time.monotonic
    _begun_s: float | None = None
    _shown_s: float = 0.0
    _shown: bool = False

    def begin(self, mount: str, what: str) -> None:
        """Say that a stop begins, before anything else is done."""
        self.wipe()
        tell(f"stopping {mount}{what}")
        self._begun_s = self._begun_s or self.monotonic()

    def show(self) -> None:
        """Renew the line now and then."""
        now_s = self.monotonic()
        if self._begun_s is None or now_s - self._shown_s < SHOW_EVERY_S:
            return
        self._shown, self._shown_s = True, now_s
        text = f"sent a stop {now_s - self._begun_s:.0f} s ago; waiting until the mount is seen at rest"
        renew(text)

    def wipe(self) -> None:
        """Take the line away."""
        if self._shown:
            self._shown = False
            renew()


@dataclass(frozen=True, slots=True)
class Mounts:
    """What there is to stop: mounts of sessions, that of the settings if unowned, and schedules' runs."""

    sessions: tuple[Owner, ...]
    unowned: MountAddress | None
    nights: tuple[ListedRun, ...] = ()

    def __len__(self) -> int:
        """Return how many there are; a run counts with its mount."""
        return len(self.sessions) + (self.unowned is not None) + len(self.idle)

    @property
    def idle(self) -> tuple[ListedRun, ...]:
        """The runs that go on with mounts that are none of the others.

        One whose runner has died moves nothing, and is no reason for a question.
        """
        here = None if self.unowned is None else self.unowned.name
        return tuple(
            night
            for night in self.nights
            if night.runner is not None
            and not any(_moves(night, owner) for owner in self.sessions)
            and (here is None or night.mount != here)
        )

    def lines(self) -> list[str]:
        """Return a line for each."""
        lines = [_line(each) for each in self.sessions]
        if self.unowned is not None:
            lines.append(f"{self.unowned.name}  no session owns it")
        return [*lines, *(f"{night.mount or 'sim'}  the schedule {night.schedule}" for night in self.idle)]

    def only(self, number: int) -> Mounts:
        """Return one of them, counted from 0 in the order of the lines."""
        if number < len(self.sessions):
            owner = self.sessions[number]
            return Mounts((owner,), None, tuple(night for night in self.nights if _moves(night, owner)))
        number -= len(self.sessions)
        if self.unowned is not None and number == 0:
            return Mounts((), self.unowned, self._of(self.unowned.name))
        return Mounts((), None, (self.idle[number - (self.unowned is not None)],))

    def real(self) -> Mounts:
        """Return those that are not known to be simulated."""
        sessions = tuple(each for each in self.sessions if not each.simulated)
        return Mounts(
            sessions, self.unowned, tuple(night for night in self.nights if night.mount is not None)
        )

    def _of(self, mount: str) -> tuple[ListedRun, ...]:
        return tuple(night for night in self.nights if night.mount == mount)


def _moves(night: ListedRun, owner: Owner) -> bool:
    """Tell whether a session may be one of a schedule's run; a simulated mount has no name before it runs."""
    return night.mount == owner.mount or (night.mount is None and owner.simulated)


def _line(owner: Owner) -> str:
    return f"{owner.mount}  {owner}{' (simulated)' if owner.simulated else ''}"


@click.command("stop")
@click.option(
    "--mount",
    "mount_url",
    metavar="URL",
    help=f"Only this mount: {FORMS}, or its name in the list; sim for simulated ones.",
)
@click.option("--all", "every", is_flag=True, help="Every mount of yours on this machine, without asking.")
@click.option(
    "--give-up",
    is_flag=True,
    help="Stop nothing; end the guardians that keep sending stops.",
)
@profile_option
@common_options("json", goes_on=True)
def command(
    context: CommandContext, mount_url: str | None, every: bool, give_up: bool, profile: Path | None
) -> int:
    """Stop the mount, from any terminal, wait until it is at rest, and stop its schedule.

    One mount is stopped at once: the one that a session of yours owns, or that of the settings. One real
    mount beside simulated ones is stopped at once, too. Several mounts are listed: ENTER stops all of them, a
    number stops that one, and after 10 s without an answer all are stopped. Without a terminal, nothing is
    stopped then: give --mount URL or --all.

    The session that owns a mount (track, demo, mount, serve) stops it and ends. If the session hangs, its
    guardian stops the mount. A mount that no session owns is stopped directly. A guardian keeps sending stops
    until the mount is at rest; --give-up ends that. A schedule's run ends, and even if restarted follows
    nothing more until a person gives `sattrack run FILE --resume`.

    \b
    Examples:
      sattrack stop
      sattrack stop --all
    """
    if mount_url is not None and every:
        raise BadInputError("give either --mount or --all")
    mounts = _named(mount_url)
    if mounts is None:
        mounts = _mounts(mount_url, _address(mount_url, context.settings.mount.url))
    if not sys.platform.startswith("linux"):
        # Sessions have no names to be found by.
        tell("a running session is found on Linux only: press Space or Ctrl-C in its own terminal, too")
    if not (mounts or mounts.nights):
        raise BadInputError(
            "nothing to stop: no session of yours moves a mount on this machine; "
            "--mount URL stops a real mount directly"
        )
    if give_up:
        return _give_up(context, mounts.sessions)
    if not every:
        mounts = _chosen(mounts, context.json)
    progress = StopProgress()
    # Before the mount is stopped: a runner that sees its session end must not begin it again.
    nights = begin_stops(mounts.nights)
    usual = context.profile_to_stop(profile, mount_url).mount
    done, failed = _stop_all(mounts, usual, progress)
    stopped = [night.finish(progress.show) for night in nights]
    if nights:
        later = _stop_all(_begun_since(mounts), usual, progress)
        done, failed = done + later[0], failed + later[1]
    failed += [SattrackError(night.words) for night in stopped if not night.kept]
    progress.wipe()
    _tell(done, stopped, failed, context.json)
    if failed:
        raise failed[0]
    return 0


def _named(name: str | None) -> Mounts | None:
    """Return the mounts that `--mount` names as the list does, or the simulated ones; None for none."""
    if name is None or "://" in name:
        # Each owner is asked who it is, and one that hangs takes seconds: not where an address says it all.
        return None
    if name == SIMULATED:
        sessions = [owner for owner in owners() if owner.simulated]
        nights = [night for night in listed_nights() if night.mount is None]
    else:
        owner = owner_of(name)
        sessions = [] if owner is None else [owner]
        nights = [night for night in listed_nights() if night.mount == name]
    return Mounts(tuple(sessions), None, tuple(nights)) if sessions or nights else None


def _begun_since(mounts: Mounts) -> Mounts:
    """Return sessions that a schedule's run had just begun when we looked."""
    known = {owner.pid for owner in mounts.sessions}
    begun = [owner for owner in owners() if owner.pid not in known]
    return Mounts(tuple(o for o in begun if any(_moves(night, o) for night in mounts.nights)), None)


def _mounts(mount_url: str | None, address: MountAddress | None) -> Mounts:
    """Return the mounts to stop: that of `--mount`, else every one of this user's, and the settings'."""
    sessions, nights = [], listed_nights()
    if mount_url is None:
        sessions = sorted(owners(), key=lambda owner: owner.simulated)
    else:
        nights = [night for night in nights if address is not None and night.mount == address.name]
    if address is not None and all(owner.mount != address.name for owner in sessions):
        owner = owner_of(address.name)
        sessions += [] if owner is None else [owner]
    owned = {owner.mount for owner in sessions}
    unowned = None if address is None or address.name in owned else address
    return Mounts(tuple(sessions), unowned, tuple(nights))


def _chosen(mounts: Mounts, as_json: bool) -> Mounts:
    """Return which of the mounts to stop: the only one, the only real one, else what is answered.

    Raises BadInputError where nobody can be asked, SattrackError where the answer is none.
    """
    if len(mounts) <= 1:
        return mounts
    if len(mounts.real()) == 1:
        for owner in mounts.sessions:
            if owner.simulated:
                tell(f"still runs: {_line(owner)}; `sattrack stop --all` stops it too")
        return mounts.real()
    for number, line in enumerate(mounts.lines(), start=1):
        say(f"{number}  {line}", err=True)
    if as_json or not _somebody_there():
        raise BadInputError(
            f"{len(mounts)} mounts: nothing is stopped yet; "
            "`sattrack stop --all` stops all of them, `sattrack stop --mount NAME` one, by its name above"
        )
    return _answered(mounts)


def _somebody_there() -> bool:
    return sys.stdin.isatty() and sys.stderr.isatty()


def _answered(mounts: Mounts) -> Mounts:
    """Ask which mounts to stop. Who does not answer may be at the telescope: all of them, then."""
    click.echo(
        f"ENTER stops all of them, 1-{len(mounts)} that one, q none; all in {ANSWER_WITHIN_S:.0f} s: ",
        nl=False,
        err=True,
    )
    until_s = time.monotonic() + ANSWER_WITHIN_S
    while select.select([sys.stdin], [], [], max(0.0, until_s - time.monotonic()))[0]:
        line = sys.stdin.readline()
        answer = SPECIAL_WORDS.get(line.strip().lower(), line.strip())
        if answer == "none":
            raise SattrackError("nothing was stopped")
        if answer == "all" or not line:
            return mounts
        if answer.isdecimal() and 1 <= int(answer) <= len(mounts):
            return mounts.only(int(answer) - 1)
        click.echo(f"ENTER, q, or a number from 1 to {len(mounts)}: ", nl=False, err=True)
    click.echo(err=True)
    return mounts


def _address(given: str | None, configured: str | None) -> MountAddress | None:
    """Return the mount that a URL names; None for simulated ones, which end with their sessions.

    A URL of the settings that leads to no mount keeps no session from being stopped: it is reported. Raises
    BadInputError for one that was given.
    """
    if given is not None:
        return mount_address(given)
    if is_antenna(configured):
        tell(f"{configured}: Ctrl-C in the terminal of `sattrack track` stops an antenna; looking for others")
        return None
    try:
        return None if configured is None else mount_address(configured)
    except BadInputError as error:
        tell(f"{error}; going on without that mount")
        return None


def _give_up(context: CommandContext, sessions: tuple[Owner, ...]) -> int:
    """End the guardians that go on, and tell of each."""
    ended = [(owner, was) for owner in sessions if (was := ask_give_up(owner)) is not None]
    if context.json:
        given_up = [{"mount": owner.mount, "goes_on": was} for owner, was in ended]
        click.echo(msgspec.json.encode({"given_up": given_up}).decode())
    else:
        for owner, was in ended:
            say(f"{owner.mount}: process {was.pid} gave up; {was.heard}; IT IS NOT KNOWN AT REST")
    if not ended:
        raise BadInputError("nothing to give up: no guardian is sending stops")
    return 0


def _stop_all(
    mounts: Mounts, profile: MountProfile, progress: StopProgress
) -> tuple[list[MountStop], list[SattrackError]]:
    """Stop each mount. All sessions are asked at once: one that hangs keeps no other waiting."""
    done: list[MountStop] = []
    failed: list[SattrackError] = []
    ended: queue.SimpleQueue[tuple[Owner, MountStop | SattrackError | None]] = queue.SimpleQueue()
    for owner in mounts.sessions:
        asked = owner.goes_on is None and owner.state in ("running", "stopping")
        progress.begin(owner.mount, f": asking {owner}" if asked else f": {owner}")
        threading.Thread(target=_stop_one, args=(owner, ended), name="stop", daemon=True).start()

    def keep(stop: Callable[[], MountStop]) -> None:
        try:
            done.append(stop())
        except SattrackError as error:
            failed.append(error)

    if (address := mounts.unowned) is not None:
        progress.begin(address.name, " directly: no session owns it")
        keep(partial(stop_directly, address, profile, progress.show))
    for owner, came in _as_they_come(ended, len(mounts.sessions), progress):
        if came is None:
            progress.begin(owner.mount, " directly: its session is gone")
            keep(partial(stop_after, owner, profile, progress.show))
        elif isinstance(came, SattrackError):
            failed.append(came)
        else:
            done.append(came)
    unsure = [stopped.error() for stopped in done]
    failed.extend(error for error in unsure if error is not None)
    return done, failed


def _stop_one(owner: Owner, ended: queue.SimpleQueue[tuple[Owner, MountStop | SattrackError | None]]) -> None:
    came: MountStop | SattrackError | None
    try:
        came = stop_session(owner, lambda: None)
    except SattrackError as error:
        came = error
    except (OSError, msgspec.MsgspecError, *NO_JSON) as error:
        came = SattrackError(f"{owner}: {error}")
    ended.put((owner, came))


def _as_they_come(
    ended: queue.SimpleQueue[tuple[Owner, MountStop | SattrackError | None]],
    count: int,
    progress: StopProgress,
) -> Iterator[tuple[Owner, MountStop | SattrackError | None]]:
    while count:
        try:
            came = ended.get(timeout=LOOK_EVERY_S)
        except queue.Empty:
            progress.show()
            continue
        count -= 1
        yield came


def _tell(done: list[MountStop], nights: list[NightStop], failed: list[SattrackError], as_json: bool) -> None:
    """Report what came of it; the caller reports the first error."""
    if as_json:
        document = StopDocument(tuple(done), tuple(str(error) for error in failed), tuple(nights))
        click.echo(msgspec.json.encode(document).decode())
    else:
        for stopped in done:
            if stopped.error() is None:
                say(f"{stopped.mount}: {stopped.words}")
        for night in nights:
            if night.kept:
                say(night.words)
    for other in failed[1:]:
        tell(str(other))
