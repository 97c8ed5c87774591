from __future__ import annotations

import numpy as np
import pytest
from tui_builders import UTC_S, changed

from sattrack.tui.error_plot import ErrorHistory, Scale


def filled(*points: tuple[float, float], phase: str = "tracking") -> ErrorHistory:
    history = ErrorHistory()
    for seconds, ra_arcsec in points:
        error = {"utc_s": UTC_S + seconds, "ra_arcsec": ra_arcsec, "dec_arcsec": 0.0}
        history.add(changed(phase=phase, utc_s=UTC_S + seconds, error=error))
    return history


def test_a_slew_is_no_error() -> None:
    assert filled((0.0, 5.0), phase="slewing").traces(UTC_S, 100) == []
    assert filled((0.0, 5.0), phase="slewing").need_arcsec() is None


def test_the_same_status_counts_once_and_old_ones_go() -> None:
    history = filled((-200.0, 9.0), (-1.0, 1.0), (0.0, 2.0), (0.0, 3.0))

    (trace,) = history.traces(UTC_S, 10_000)
    assert trace.ra_arcsec.tolist() == [1.0, 1.0, 2.0, 2.0]


def test_after_a_clock_was_set_back_the_error_is_drawn_at_once() -> None:
    history = filled((0.0, 9.0), (0.5, 9.0), (-3600.0, 1.0), (-3599.5, 2.0))

    (trace,) = history.traces(UTC_S - 3599.5, 10_000)
    assert sorted(set(trace.ra_arcsec)) == [1.0, 2.0]
    assert history.need_arcsec() == 2.0


def test_a_gap_parts_the_line() -> None:
    traces = filled((-10.0, 1.0), (-9.5, 1.0), (-2.0, 2.0), (-1.5, 2.0)).traces(UTC_S, 1000)

    assert [sorted(set(trace.ra_arcsec)) for trace in traces] == [[1.0], [2.0]]
    assert traces[0].ago_s.tolist() == pytest.approx([-10.0, -10.0, -9.5, -9.5])


def test_thinning_keeps_a_spike_of_one_sample() -> None:
    points = [(0.1 * i, 0.01) for i in range(1700)]
    points[800] = (80.0, -7.0)
    (trace,) = filled(*points).traces(UTC_S + 170.0, 70)

    assert len(trace.ra_arcsec) <= 2 * 71
    assert trace.ra_arcsec.min() == -7.0
    assert np.all(np.diff(trace.ago_s) >= 0.0)


def test_the_scale_need_is_the_typical_error_and_the_last_moments() -> None:
    steady = [(0.5 * i, 0.1) for i in range(200)]
    assert filled(*steady).need_arcsec() == pytest.approx(0.1)
    assert filled(*steady, (100.0, 4.0)).need_arcsec() == pytest.approx(4.0)
    once = [*steady[:50], (25.0, 4.0), *[(25.5 + 0.5 * i, 0.1) for i in range(200)]]
    assert filled(*once).need_arcsec() == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("need", "range_arcsec"),
    [
        (0.0, 0.05),
        (0.05, 0.1),
        (0.1, 0.2),
        (0.9, 1.0),
        (0.95, 2.0),
        (3.0, 5.0),
        (700.0, 1000.0),
        (1e9, 5000.0),
    ],
)
def test_the_scale_goes_in_steps_of_1_2_5(need: float, range_arcsec: float) -> None:
    assert Scale().fit(need, 0.0) == range_arcsec


def test_the_scale_grows_at_once_and_shrinks_after_a_while() -> None:
    scale = Scale()
    assert [scale.fit(need, at) for at, need in ((0, 0.3), (1, 30.0), (2, 0.3), (6, 0.3))] == [
        0.5,
        50,
        50,
        50,
    ]
    assert scale.fit(0.3, 7.0) == 0.5


def test_a_scale_that_is_needed_again_does_not_shrink() -> None:
    scale = Scale()
    ranges = [scale.fit(4.0 if second % 4 == 0 else 0.3, float(second)) for second in range(40)]
    assert set(ranges) == {5.0}
