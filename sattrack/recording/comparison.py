"""How outputs of a replay are held against the recorded ones: which comparison applies, and what it finds."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Literal, NamedTuple

import msgspec

from sattrack.mount.xerxes.datagrams import COMMAND_FIELDS, DatagramError, Kind, decode_command
from sattrack.recording.environment import DATA, Environment

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sattrack.recording.format import RunHeader

Mode = Literal["bytes", "rounding", "figures"]
ROUNDING_DEG_S = 1e-9
"""By how much a command may differ where linear algebra rounds differently, degrees a second."""
RATES = ("move_ra_rate_deg_s", "move_dec_rate_deg_s")
_DOUBLES = tuple(f.name for f in COMMAND_FIELDS if f.kind is Kind.DOUBLE)
_OTHERS = tuple(f.name for f in COMMAND_FIELDS if f.kind not in {Kind.DOUBLE, Kind.UINT64})


class Choice(NamedTuple):
    """Which comparison applies, and why, in words."""

    mode: Mode
    why: str


class Difference(NamedTuple):
    """One field of a command that came out otherwise."""

    field: str
    expected: float
    got: float


class Figures(msgspec.Struct, frozen=True):
    """What a run came to, as its engine counts; None where that is not known."""

    rms_arcsec: float | None = None
    peak_arcsec: float | None = None
    samples: int | None = None
    on_target_s: float | None = None
    ended_by: str | None = None


class Tolerances(msgspec.Struct, frozen=True):
    """How far figures and commands of another version's run may be from the recorded ones.

    Figures may get worse by the larger of a share and an amount; they may always get better.
    """

    share: float = 0.05
    rms_arcsec: float = 0.02
    peak_arcsec: float = 0.2
    rate_deg_s: float = 0.02
    """Largest difference of a rate command, in all ticks but a share of `other_ticks`."""
    other_ticks: float = 0.01
    """Share of ticks whose flags or rates may differ by more: a slew that ends a tick sooner."""


def choose(header: RunHeader, code: str, here: Environment) -> Choice:
    """Return the comparison for a recording, replayed by code of a fingerprint in an environment."""
    if header.anonymous:
        return Choice("figures", "its site and its time were moved, and numbers round otherwise there")
    if header.environment is None or header.fingerprint is None:
        return Choice(
            "figures", f"a recording of format {header.format_version} does not tell what code made it"
        )
    if header.fingerprint != code:
        return Choice(
            "figures",
            f"made by sattrack {header.program_version} with code {header.fingerprint}; this is code {code}",
        )
    other = _other(header.environment, here)
    if not other:
        return Choice("bytes", "the same code, libraries and kind of processor")
    words = ", ".join(other)
    if any(name in words for name in DATA):
        return Choice("figures", f"the same code, with other data: {words}")
    return Choice("rounding", f"the same code, elsewhere: {words}")


def _other(recorded: Environment, here: Environment) -> list[str]:
    pairs = {
        "machine": (recorded.machine, here.machine),
        "processor": (recorded.processor, here.processor),
        "Python": (recorded.python, here.python),
    }
    for name in recorded.libraries | here.libraries:
        pairs[name] = (recorded.libraries.get(name, "absent"), here.libraries.get(name, "absent"))
    return [f"{name} {here}, recorded with {was}" for name, (was, here) in pairs.items() if was != here]


def differences(expected: bytes, got: bytes) -> list[Difference]:
    """Return the fields in which two command datagrams differ; what is no command differs in its length."""
    try:
        one, other = decode_command(expected), decode_command(got)
    except DatagramError:
        return [Difference("length", len(expected), len(got))]
    pairs = ((name, getattr(one, name), getattr(other, name)) for name in (*_OTHERS, *_DOUBLES))
    return [Difference(name, was, is_) for name, was, is_ in pairs if _bits(was) != _bits(is_)]


def _bits(value: float) -> bytes:
    return struct.pack("<d", value)


def beyond_rounding(found: Sequence[Difference]) -> bool:
    """Tell whether differences are more than another way of rounding."""
    return any(d.field not in _DOUBLES or not abs(d.got - d.expected) <= ROUNDING_DEG_S for d in found)


def larger_than(found: Sequence[Difference], rate_deg_s: float) -> bool:
    """Tell whether a command asks for something else, or for a rate that differs by more than this.

    The counter does not count: it tells how many datagrams went before.
    """
    for difference in found:
        if difference.field in RATES:
            if not abs(difference.got - difference.expected) <= rate_deg_s:
                return True
        elif difference.field in _OTHERS and difference.field != "counter":
            return True
    return False


def worse(recorded: Figures, replayed: Figures, allowed: Tolerances) -> list[str]:
    """Return in words which figures came out worse than they may."""
    told = []
    figures = (
        ("RMS", recorded.rms_arcsec, replayed.rms_arcsec, allowed.rms_arcsec),
        ("peak", recorded.peak_arcsec, replayed.peak_arcsec, allowed.peak_arcsec),
    )
    for name, was, is_, amount in figures:
        if was is None:
            continue
        if is_ is None or is_ - was > max(amount, allowed.share * was):
            told.append(f"{name} {'none' if is_ is None else f'{is_:.3f}″'}, recorded {was:.3f}″")
    if recorded.ended_by is not None and recorded.ended_by != replayed.ended_by:
        told.append(f"ended by {replayed.ended_by}, recorded {recorded.ended_by}")
    return told
