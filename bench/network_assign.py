"""The assignment of made-up networks: value, proven gap, and greed, for 2,000, 10,000 and 40,000 passes.

`python bench/network_assign.py` draws nights of 20 stations: passes of one to ten minutes whose satellites
come by several times, slews by where each looks, satellites that several stations see at once. Prints the
gap of the bound, how much better than greed, and seconds. `--seconds S` (60) is the time allowed.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from sattrack.network.assign import Assignment, StationPasses, assign, greedy

STATIONS, DAY_S, VISITS = 20, 86400.0, 6


def drawn(seed: int, each: int) -> Assignment:
    rng = np.random.default_rng(seed)
    satellites = max(400, each)
    visits = rng.uniform(0.0, DAY_S, (satellites, VISITS))
    starts, ends, numbers, values, stations = [], [], [], [], []
    for k in range(STATIONS):
        number = rng.integers(0, satellites, each)
        start = visits[number, rng.integers(0, VISITS, each)] + rng.normal(0.0, 200.0, each)
        end = start + rng.uniform(60.0, 600.0, each)
        order = np.argsort(end)
        start, end, number = start[order], end[order], number[order]
        place = rng.uniform(-90.0, 90.0, each)
        slew = 10.0 + np.abs(place[:, None] - place[None, :]) / 4.0
        fits = end[:, None] + slew <= start[None, :]
        clash = ~(fits | fits.T)
        np.fill_diagonal(clash, val=False)
        stations.append(StationPasses(np.arange(each) + k * each, clash))
        high = np.sin(np.radians(rng.uniform(10.0, 90.0, each)))
        starts.append(start)
        ends.append(end)
        numbers.append(number)
        values.append((end - start) * rng.choice([1.0, 2.0, 5.0], each) * high)
    start, end, number, value = (np.concatenate(one) for one in (starts, ends, numbers, values))
    order = np.lexsort((start, number))
    together: dict[int, list[int]] = {}
    for at, one in enumerate(order.tolist()):
        for other in order[at + 1 :].tolist():
            if number[other] != number[one] or start[other] > end[one] - 60.0:
                break
            if other // each != one // each and min(end[one], end[other]) - start[other] >= 60.0:
                together.setdefault(one, []).append(other)
                together.setdefault(other, []).append(one)
    fresh = number * 4 + np.clip(start // (DAY_S / 4.0), 0, 3).astype(int)
    ties = {one: np.array(sorted(others)) for one, others in together.items()}
    return Assignment(start, value, stations, fresh, ties)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    asked = parser.parse_args()
    for each, seeds in ((100, 3), (500, 2), (2000, 3)):
        for seed in range(seeds):
            problem = drawn(seed, each)
            plain = problem.worth(greedy(problem))
            begun, spent = time.perf_counter(), time.process_time()
            found = assign(problem, asked.seconds, gap=0.001)
            print(
                f"{STATIONS} stations, {STATIONS * each} passes: gap {100.0 * found.gap:.2f} %, "
                f"{100.0 * (found.value / plain - 1.0):.1f} % better than greed, {len(found.taken)} taken, "
                f"{time.perf_counter() - begun:.1f} s ({time.process_time() - spent:.1f} s of processors)",
                flush=True,
            )


if __name__ == "__main__":
    main()
