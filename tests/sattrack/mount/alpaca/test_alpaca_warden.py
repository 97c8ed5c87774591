"""The warden's stop: sent whatever the telescope answers, believed when the telescope is seen at rest."""

from __future__ import annotations

from typing import Any

import pytest

from sattrack.mount.alpaca import warden
from sattrack.mount.alpaca.client import PARKED, AlpacaRefusalError, NoAnswerError


class Telescope:
    """Stands at one place; `refuses` are errors by member, each raised once or, where it is last, always."""

    def __init__(self, **refuses: list[Exception]) -> None:
        self.refuses = refuses
        self.moves: list[dict[str, str]] = []

    def get(self, member: str) -> Any:
        self._refuse(member)
        return {"rightascension": 5.0, "declination": 20.0, "slewing": False}[member]

    def put(self, member: str, **fields: str) -> None:
        if member == "moveaxis":
            self.moves.append(fields)
        self._refuse(member)

    def _refuse(self, member: str) -> None:
        errors = self.refuses.get(member, [])
        if errors:
            raise errors[0] if len(errors) == 1 else errors.pop(0)


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warden, "AGAIN_S", 0.01)
    monkeypatch.setattr(warden, "STOPS_SENT_S", 0.1)
    monkeypatch.setattr(warden, "STOPS_MOVING_S", 0.2)


def stopped(**refuses: list[Exception]) -> tuple[bool | None, list[dict[str, str]]]:
    telescope = Telescope(**refuses)
    return warden.stop(telescope), telescope.moves  # type: ignore[arg-type]


BOTH_AXES = [{"Axis": "0", "Rate": "0"}, {"Axis": "1", "Rate": "0"}]


def test_a_telescope_that_obeys_is_seen_at_rest() -> None:
    assert stopped() == (True, BOTH_AXES)


@pytest.mark.parametrize(
    "error", [AlpacaRefusalError(0x500, "busy"), NoAnswerError("HTTP status 500", 500)], ids=str
)
def test_both_axes_are_stopped_where_it_cannot_abort(error: Exception) -> None:
    assert stopped(abortslew=[error]) == (True, BOTH_AXES)


def test_a_parked_telescope_rests() -> None:
    assert stopped(moveaxis=[AlpacaRefusalError(PARKED, "parked")])[0] is True


def test_an_axis_that_refuses_is_stopped_again() -> None:
    at_rest, moves = stopped(
        moveaxis=[AlpacaRefusalError(0x500, "busy"), AlpacaRefusalError(PARKED, "parked")]
    )
    assert at_rest is True
    assert moves == BOTH_AXES * 2


@pytest.mark.parametrize("member", ["rightascension", "declination"])
def test_a_telescope_that_does_not_report_its_place_is_stopped_again_and_not_believed(member: str) -> None:
    at_rest, moves = stopped(**{member: [AlpacaRefusalError(0x500, "busy")]})
    assert at_rest is False
    assert len(moves) > len(BOTH_AXES)


def test_a_telescope_that_is_not_heard_is_not_said_to_be_stopped() -> None:
    assert stopped(abortslew=[NoAnswerError("nothing listens there")]) == (None, [])
