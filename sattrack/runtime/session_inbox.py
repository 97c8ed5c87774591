"""What everybody before a run says to it: whoever started it, on a channel, and those who look on."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

from sattrack.views.messages import Observation
from sattrack.views.session import STARTER
from sattrack.views.session_messages import decode_said

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sattrack.runtime.channel import StdinInbox
    from sattrack.runtime.desk import Desk
    from sattrack.runtime.gallery_link import GalleryLink
    from sattrack.views.messages import Message


class SessionInbox:
    """Messages that the run is to obey, of whoever may say them. `stdin` None: nobody speaks directly."""

    def __init__(self, desk: Desk, stdin: StdinInbox | None, gallery: GalleryLink | None) -> None:
        self._desk, self._stdin, self._gallery = desk, stdin, gallery
        self._strange = 0

    @property
    def malformed(self) -> int:
        """How many lines were none."""
        return self._strange + (0 if self._stdin is None else self._stdin.malformed)

    @property
    def ended(self) -> bool:
        """Whether whoever speaks directly has gone."""
        return self._stdin is None or self._stdin.ended

    def messages(self) -> Sequence[Message]:
        """Return what has come, without waiting."""
        obeyed: list[Message] = []
        if self._stdin is not None:
            for message in self._stdin.said():
                obeyed += self._heard(STARTER, message)
            self._stdin.stops_at_end = not self._desk.left_running
        for heard in () if self._gallery is None else self._gallery.heard():
            if heard.what == "came":
                self._desk.came(heard.number, heard.text)
            elif heard.what == "gone":
                self._desk.gone(heard.number)
            else:
                obeyed += self._read(heard.number, heard.text)
        return obeyed

    def _read(self, number: int, line: str) -> list[Message]:
        try:
            message = decode_said(line)
        except (msgspec.MsgspecError, RecursionError):
            self._strange += 1
            return []
        # Observations take longer than a turn has; they have a door of their own.
        return [] if isinstance(message, Observation) else self._heard(number, message)

    def _heard(self, number: int, message: object) -> list[Message]:
        obeyed = self._desk.hear(number, message)  # type: ignore[arg-type]
        return [] if obeyed is None else [obeyed]
