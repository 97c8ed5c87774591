"""Who may say what to a run: one at a time has control, anybody may stop. No I/O."""

from __future__ import annotations

from sattrack.messages import Message, StopNow
from sattrack.session_messages import LeaveRunning, SessionMessage, TakeControl, YieldControl
from sattrack.session_view import STARTER, SessionView, Watcher

NAMED = 8
"""So many of those who look on are named in a view, which has to stay small."""


class Desk:
    """Hears everybody before a run, and hands on what is to be obeyed.

    `with_starter`: whoever started the run speaks to it, and has control first.
    """

    def __init__(self, with_starter: bool) -> None:
        self.controller: int | None = STARTER if with_starter else None
        self.left_running = False
        self._names: dict[int, str] = {}
        self._said: str | None = None
        self.version = 0
        """Counts what changed of the view."""

    def came(self, number: int, name: str) -> None:
        """Let somebody in, or learn the name of somebody who is there."""
        self._names[number] = name
        self.version += 1

    def gone(self, number: int) -> None:
        """See somebody off; control that they had, nobody has then, and the run goes on."""
        name = self._name(number)
        self._names.pop(number, None)
        if self.controller == number:
            self.controller = None
            self._said = f"{name} had control, and has gone"
        self.version += 1

    def hear(self, number: int, message: Message | SessionMessage) -> Message | None:
        """Return the message if the run is to obey it, None where it is about control, or by no right."""
        match message:
            case TakeControl():
                self._give(number)
            case YieldControl():
                if self.controller == number:
                    self.controller = None
                    self._said = f"{self._name(number)} gave control up"
            case LeaveRunning():
                if number == STARTER:
                    self.left_running = True
                    self.controller = None if self.controller == STARTER else self.controller
                    self._said = "left running by whoever started it"
            case StopNow():
                self._said = f"stopped from {self._name(number)}"
                self.version += 1
                return message
            case _:
                return message if number == self.controller else None
        self.version += 1
        return None

    def view(self) -> SessionView:
        """Return what everybody may see."""
        named = [Watcher(number, name) for number, name in self._names.items()]
        # Whoever has control is to be named, however many there are.
        named.sort(key=lambda one: (one.number != self.controller, one.number))
        return SessionView(
            self.controller, tuple(named[:NAMED]), len(self._names), self.left_running, self._said
        )

    def _give(self, number: int) -> None:
        if self.controller == number:
            return
        before = None if self.controller is None else self._name(self.controller)
        self.controller = number
        taken = "took control" if before is None else f"took control from {before}"
        self._said = f"{self._name(number)} {taken}"

    def _name(self, number: int) -> str:
        return "where it was started" if number == STARTER else self._names.get(number, f"watcher {number}")
