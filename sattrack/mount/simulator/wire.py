"""One way of the link between client and mount, as a pure object: what arrives of a datagram, and when."""

from __future__ import annotations

import random
from dataclasses import dataclass, field

HELD_BACK_S = 0.08
"""How much longer a reordered datagram takes: longer than the 50 ms after which the next one follows."""
DOUBLED_WITHIN_S = 0.02


@dataclass(frozen=True, slots=True)
class WireLaw:
    """How one way treats datagrams: delay and jitter in seconds, shares from 0 to 1.

    The delay of each is uniform within `jitter_s` either way of `delay_s`, never below 0.
    """

    delay_s: float = 0.0
    jitter_s: float = 0.0
    loss: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    corrupt: float = 0.0


@dataclass(slots=True)
class Wire:
    """One way, with a random stream of its own: the same seed and datagrams give the same arrivals."""

    law: WireLaw
    seed: str = ""
    lost: int = 0
    _random: random.Random = field(init=False)
    _troubled: bool = field(init=False)

    def __post_init__(self) -> None:
        """Begin the stream."""
        self._random = random.Random(self.seed)
        law = self.law
        self._troubled = bool(law.jitter_s or law.loss or law.duplicate or law.reorder or law.corrupt)

    @property
    def delays(self) -> bool:
        """Whether datagrams may take longer than the real way does."""
        return bool(self.law.delay_s or self.law.jitter_s or self.law.reorder or self.law.duplicate)

    def carry(self, data: bytes) -> list[tuple[float, bytes]]:
        """Return what arrives of one datagram: none, one or two of (seconds after it was sent, bytes)."""
        law, rng = self.law, self._random
        if not self._troubled:
            return [(law.delay_s, data)]
        if law.loss and rng.random() < law.loss:
            self.lost += 1
            return []
        delay_s = law.delay_s
        if law.jitter_s:
            delay_s = max(0.0, delay_s + rng.uniform(-law.jitter_s, law.jitter_s))
        if law.reorder and rng.random() < law.reorder:
            delay_s += HELD_BACK_S
        arrivals = [(delay_s, self._corrupted(data))]
        if law.duplicate and rng.random() < law.duplicate:
            arrivals.append((delay_s + rng.uniform(0.0, DOUBLED_WITHIN_S), data))
        return arrivals

    def _corrupted(self, data: bytes) -> bytes:
        if not data or not self.law.corrupt or self._random.random() >= self.law.corrupt:
            return data
        spoilt = bytearray(data)
        spoilt[self._random.randrange(len(data))] ^= 1 << self._random.randrange(8)
        return bytes(spoilt)
