"""Faults that a simulated mount shows on demand."""

from __future__ import annotations

from dataclasses import dataclass

from sattrack.errors import BadInputError


@dataclass(frozen=True, slots=True)
class Faults:
    """`silent_after_s`: from then on no status is sent, while commands are still obeyed."""

    silent_after_s: float | None = None

    def silent(self, elapsed_s: float) -> bool:
        """Tell whether the mount is silent so many seconds after its start."""
        return self.silent_after_s is not None and elapsed_s >= self.silent_after_s


def parse_faults(text: str | None) -> Faults:
    """Read `silent:SECONDS`; raises BadInputError."""
    if not text:
        return Faults()
    name, _, value = text.partition(":")
    try:
        seconds = float(value)
    except ValueError:
        seconds = -1.0
    if name != "silent" or not 0.0 <= seconds < float("inf"):
        raise BadInputError(f"--faults {text}: write silent:SECONDS")
    return Faults(silent_after_s=seconds)
