"""The custom actions: what their one text parameter says, a JSON object or, where it suffices, a name."""

from __future__ import annotations

import msgspec

from sattrack.servers.alpaca.faults import Fault, Number

ACTIONS = ("TrackSatellite", "Bias", "Passes")
MOST_HOURS = 48.0


class TrackSatellite(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Follow a satellite: the pass in progress above `min_alt_deg`, else the next."""

    satellite: str
    min_alt_deg: float | None = None


class Passes(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """List a satellite's coming passes."""

    satellite: str
    hours: float = 24.0
    min_alt_deg: float | None = None


class Bias(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Set, or with `add` change, the offsets of the satellite that is followed; nothing given: tell them."""

    along_s: float | None = None
    cross_deg: float | None = None
    add: bool = False


CustomAction = TrackSatellite | Passes | Bias
_KINDS: dict[str, type[TrackSatellite] | type[Passes] | type[Bias]] = {
    "tracksatellite": TrackSatellite,
    "passes": Passes,
    "bias": Bias,
}


def read_action(name: str, parameters: str) -> CustomAction:
    """Return what an action asks for; its name may be of any case. Raises Fault."""
    kind = _KINDS.get(name.lower())
    if kind is None:
        raise Fault(Number.ACTION_NOT_IMPLEMENTED, f"no action {name[:40]!r}: there are {', '.join(ACTIONS)}")
    text = parameters.strip()
    try:
        if text.startswith("{") or (kind is Bias and text):
            action: CustomAction = msgspec.json.decode(text, type=kind)
        else:
            action = Bias() if kind is Bias else msgspec.convert({"satellite": text}, kind)
    except (msgspec.MsgspecError, RecursionError) as error:
        raise Fault(Number.INVALID_VALUE, f"{name}: {error}") from error
    _check(name, action)
    return action


def _check(name: str, action: CustomAction) -> None:
    if isinstance(action, Bias):
        return
    if not action.satellite:
        raise Fault(Number.INVALID_VALUE, f"{name}: name a satellite, by name, number or designator")
    if action.min_alt_deg is not None and not 0.0 <= action.min_alt_deg < 90.0:
        raise Fault(Number.INVALID_VALUE, f"{name}: min_alt_deg is {action.min_alt_deg:g}; from 0 to 90")
    if isinstance(action, Passes) and not 0.0 < action.hours <= MOST_HOURS:
        raise Fault(
            Number.INVALID_VALUE, f"{name}: hours is {action.hours:g}; above 0, {MOST_HOURS:g} at most"
        )
