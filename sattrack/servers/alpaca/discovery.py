"""Discovery: who asks on UDP port 32227 for Alpaca devices is told the HTTP port. IPv4.

"ASCOM Alpaca API Reference", Alpaca discovery protocol. Answers are bounded, so that a storm of questions,
or a forged sender, makes little of this program.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field

import msgspec

PORT = 32227
QUESTION = b"alpacadiscovery1"
LONGEST_QUESTION = 1024
A_SECOND = 100.0
A_SECOND_EACH = 10.0
REMEMBERED = 256


@dataclass(slots=True)
class Bucket:
    """So many answers a second, as many at once after a silence."""

    rate: float
    left: float
    filled_s: float

    def take(self, now_s: float) -> bool:
        """Tell whether one more may be given at an instant."""
        self.left = min(self.rate, self.left + max(0.0, now_s - self.filled_s) * self.rate)
        self.filled_s = now_s
        if self.left < 1.0:
            return False
        self.left -= 1.0
        return True


@dataclass(slots=True)
class Discovery:
    """Answers questions for one HTTP port; instants are seconds of any clock that does not go back."""

    http_port: int
    unanswered: int = 0
    """Questions that came too fast."""
    _all: Bucket = field(default_factory=lambda: Bucket(A_SECOND, A_SECOND, 0.0))
    _each: OrderedDict[str, Bucket] = field(default_factory=OrderedDict)

    def answer(self, data: bytes, host: str, now_s: float) -> bytes | None:
        """Return what to send back, None for nothing."""
        if not data.startswith(QUESTION) or len(data) > LONGEST_QUESTION:
            return None
        each = self._each.get(host)
        if each is None:
            each = self._each[host] = Bucket(A_SECOND_EACH, A_SECOND_EACH, now_s)
            if len(self._each) > REMEMBERED:
                self._each.popitem(last=False)
        self._each.move_to_end(host)
        if not (each.take(now_s) and self._all.take(now_s)):
            self.unanswered += 1
            return None
        return msgspec.json.encode({"AlpacaPort": self.http_port})
