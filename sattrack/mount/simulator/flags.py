"""Which of a command datagram's flags the mount services: rising edges, priority, acknowledgements.

"Xerxes Mount Control Protocol", Details: "All active commands are examined and the highest priority command
is serviced and acknowledged"; the mount "only acts on the rising edge", and removes the acknowledgement when
it sees the command removed. Where the paper is silent:

* The order is abort, park, slew, sync, find home, MoveAxis (both flags as one), pulse guide.
* A flag whose turn does not come, because a higher one is up, has not been seen: if it is still up when the
  higher one has fallen, that is its rising edge.
* An acknowledgement says that the edge was received and serviced ("it knows that the command has been
  received"); where a slew, sync or pulse is ignored, because the mount is slewing, that is all it says.
* MoveAxis flags that rise during a slew are not serviced before its end.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from operator import attrgetter
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sattrack.mount.xerxes.datagrams import Command

FLAGS = ("abort", "park", "slew", "sync", "find_home", "move_ra", "move_dec", "pulse_guide")
PRIORITY = ("abort", "park", "slew", "sync", "find_home", "move", "pulse_guide")
_levels = attrgetter(*FLAGS)
_GROUPS = {"move_ra": "move", "move_dec": "move"}


@dataclass(slots=True)
class FlagWatch:
    """What the mount remembers of the flags: which are up and dealt with, and which are acknowledged."""

    seen: set[str] = field(default_factory=set)
    acknowledged: set[str] = field(default_factory=set)

    def release(self, command: Command) -> set[str]:
        """Forget the flags that are down, with their acknowledgements; return those that have just fallen."""
        if not self.seen:
            return set()
        fallen = {name for name in self.seen if not getattr(command, name)}
        self.seen -= fallen
        self.acknowledged -= fallen
        return fallen

    def rises(self, command: Command, name: str) -> bool:
        """Tell whether a flag that is serviced has risen; from then on it is seen."""
        if not getattr(command, name) or name in self.seen:
            return False
        self.seen.add(name)
        return True

    def acknowledge(self, name: str) -> None:
        """Set the acknowledgement of a flag that was serviced."""
        self.acknowledged.add(name)


def highest(command: Command) -> str | None:
    """Return the name, one of PRIORITY, of what is to be serviced in this loop; None where no flag is up."""
    levels = _levels(command)
    if True not in levels:
        return None
    name = FLAGS[levels.index(True)]
    return _GROUPS.get(name, name)
