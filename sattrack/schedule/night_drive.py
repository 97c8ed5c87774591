"""A schedule's run, driven: what the machine orders is carried out, what comes of it kept and told."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from msgspec import structs

from sattrack.schedule import machine
from sattrack.schedule.night import End, Started
from sattrack.schedule.night_journal import go_name

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.schedule.night import Doing, Happening, Run, Ways
    from sattrack.schedule.night_files import TakenUp
    from sattrack.schedule.night_journal import Beat


class Hands(Protocol):
    """Whoever carries orders out, with a real mount or with a simulated one."""

    def begin(self, beat: Beat | None) -> float:
        """Take up where the last sign of life was; return the instant that is now, POSIX seconds of UTC."""

    def perform(self, doing: Doing, run: Run) -> Happening | None:
        """Carry out an order; return the event that it ended with.

        None where the system ends the runner in the midst of it: a restart begins with it again.
        """


def drive(
    taken: TakenUp, hands: Hands, ways: Ways, told: Callable[[Run, Happening, Doing], None]
) -> tuple[Run, End | None]:
    """Run, or run on, until nothing is left to do; return what is known then, and why it ended.

    None where the system ended the runner. `told` hears of every event once it is kept.
    """
    journal, run = taken.journal, taken.run
    beat = journal.last_beat()
    event: Happening | None
    event = Started(utc_s=hands.begin(beat), ways=ways, recovered=taken.recovered, words=taken.words)
    if beat is not None:
        event = structs.replace(event, last_utc_s=beat.utc_s)
        if run.at is not None and beat.go == go_name(run.at, run.part):
            event = structs.replace(event, on_target_s=beat.on_target_s, recording=beat.recording)
    while event is not None:
        run, doing = machine.step(run, event)
        journal.append(event, run, doing)
        told(run, event, doing)
        if isinstance(doing, End):
            return run, doing
        event = hands.perform(doing, run)
    return run, None
