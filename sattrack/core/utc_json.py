"""Instants in JSON: POSIX seconds of UTC, for msgspec's hooks."""

from __future__ import annotations

from typing import Any

from tle.instants import Utc


def encode_utc(value: Any) -> Any:
    """Return an instant as its number; raises NotImplementedError for anything else."""
    if isinstance(value, Utc):
        return float(value.unix_s)
    raise NotImplementedError(type(value))


def decode_utc(kind: type, value: Any) -> Any:
    """Return the instant of a number; raises NotImplementedError for anything else."""
    if kind is Utc:
        return Utc(float(value))
    raise NotImplementedError(kind)
