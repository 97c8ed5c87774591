"""Signals that would end a program ask for a stop of the mount first."""

from __future__ import annotations

import signal

import pytest

from sattrack.runtime.system import StopRequest, stopping


@pytest.mark.parametrize(
    ("number", "before", "asks"),
    [
        (signal.SIGHUP, signal.SIG_DFL, True),
        # Begun by nohup, a program outlives its terminal.
        (signal.SIGHUP, signal.SIG_IGN, False),
        (signal.SIGINT, signal.SIG_IGN, True),
        (signal.SIGTERM, signal.SIG_DFL, True),
    ],
)
def test_a_signal_asks_for_a_stop_unless_it_is_one_to_be_outlived(
    number: signal.Signals, before: signal.Handlers, asks: bool
) -> None:
    usual = signal.signal(number, before)
    stop = StopRequest()
    try:
        with stopping(stop):
            signal.raise_signal(number)
        assert stop.asked is asks
        assert signal.getsignal(number) == before
    finally:
        signal.signal(number, usual)
