"""Run the conformance checks against `sattrack serve`: `python tests/conformance/report.py`.

Starts the servers with a simulated mount, in real time: some eight minutes. Writes the tables of
docs/conformance.md; the exit code is 1 where a check does not hold that the page has as holding.
"""

from __future__ import annotations

import argparse
import re
import shutil
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING

ROOT = Path(__file__).resolve().parents[2]
for folder in ("tests/sattrack/servers/alpaca", "tests/sattrack", "bench", "."):
    sys.path.insert(0, str(ROOT / folder))

import alpaca_requests  # noqa: E402 - found beside this file
import alpaca_serving  # noqa: E402
import conformu_checks  # noqa: E402
import indi_interface  # noqa: E402
from alpaca.telescope import Telescope  # noqa: E402
from conformu_checks import Bench, Finding  # noqa: E402
from indi_programs import indi_server  # noqa: E402
from serving import serving_program  # noqa: E402

from tools.protocol.regions import replace_region  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

PAGE = ROOT / "docs" / "conformance.md"
GERMAN = 'pier_rule = "hour_angle"\n[simulator]\nflip = "hour_angle"\n'
Checks = tuple["Callable[[Bench], None]", ...]
GROUPS: dict[str, Checks] = {
    "properties": conformu_checks.QUICK,
    "methods": (*conformu_checks.METHODS, *conformu_checks.AFTER_EVERYTHING),
    "German mount": conformu_checks.OF_A_GERMAN_MOUNT,
    **{
        f"offset rates {at:+g} h": (conformu_checks.offset_motion(at),)
        for at in conformu_checks.HOUR_ANGLES_H
    },
    "pulses": tuple(conformu_checks.pulse_motion(at) for at in conformu_checks.HOUR_ANGLES_H),
}


def of_telescope(name: str) -> list[Finding]:
    """Return what a group of checks finds of a telescope of its own."""
    with tempfile.TemporaryDirectory() as folder:
        profile = Path(folder) / "mount.toml"
        profile.write_text(alpaca_serving.PROFILE + (GERMAN if name == "German mount" else ""))
        with serving_program("alpaca", "--profile", str(profile), "--no-discovery") as served:
            bench = Bench(Telescope(f"127.0.0.1:{served.port}", 0))
            bench.scope.Connect()
            for check in GROUPS[name]:
                check(bench)
            bench.scope.rqs.close()
    return bench.findings


def of_protocol() -> list[tuple[str, str, list[str], list[str]]]:
    """Return for each request its names, and what ConformU objects to, tolerant and strict."""
    found = []
    with alpaca_serving.serving() as served:
        client = alpaca_requests.Client(served.port)
        client.ask(alpaca_requests.member("PUT", "Connect", ""))
        for request in alpaca_requests.all_requests(client):
            answer = client.ask(request)
            while request.verb == "PUT" and (client.value("Slewing") or client.value("IsPulseGuiding")):
                time.sleep(0.02)
            both = [alpaca_requests.objections(request, *answer, strict) for strict in (False, True)]
            found.append((request.test, request.name, *both))
    return found


def of_indi() -> tuple[list[Finding], list[Finding]]:
    """Return what is declared, and what states properties end in, beside INDI's simulator."""

    def program(name: str) -> str:
        return shutil.which(name) or sys.exit(f"{name} is not installed: Debian's indi-bin has it")

    states = []
    with tempfile.TemporaryDirectory() as folder:
        profile = Path(folder) / "mount.toml"
        profile.write_text(alpaca_serving.PROFILE)
        with (
            serving_program("indi", "--profile", str(profile)) as served,
            indi_server(program, program("indi_simulator_telescope")) as port,
        ):
            devices = {indi_interface.DEVICE: served.port, indi_interface.REFERENCE: port}
            watched = [indi_interface.Watched(at, name, program) for name, at in devices.items()]
            first = indi_interface.Action("CONNECTION", "CONNECT=On")
            for one in watched:
                one.states_after(first)
            declared = [indi_interface.declared(at, name) for name, at in devices.items()]
            ra_h = watched[0].number("EQUATORIAL_EOD_COORD.RA")
            for action in indi_interface.actions((ra_h + 0.4) % 24.0):
                ended = [one.states_after(action) for one in watched]
                states.append(indi_interface.compare_states(action, *ended))
    return list(indi_interface.compare_declared(*declared)), states


def rows(findings: Iterable[Finding]) -> str:
    """Return a table with a line for each test: whether all of it holds, and what does not."""
    tests: dict[str, list[Finding]] = {}
    for one in findings:
        tests.setdefault(one.test, []).append(one)
    lines = ["| test | checks | holds | |", "|---|---|---|---|"]
    for test, found in tests.items():
        failed = [one.words for one in found if not one.holds]
        words = "; ".join(dict.fromkeys(failed or (one.words for one in found)))
        lines.append(
            f"| {test} | {len(found)} | {'**no**' if failed else 'yes'} | {words.replace('|', '/')} |"
        )
    return "\n".join(lines)


def protocol_rows(found: Iterable[tuple[str, str, list[str], list[str]]]) -> str:
    """Return a table with a line for each of ConformU's protocol tests."""
    sent, holds, strictly = Counter[str](), Counter[str](), Counter[str]()
    why: dict[str, dict[str, None]] = {}
    for test, name, tolerant, strict in found:
        sent[test] += 1
        holds[test] += not tolerant
        strictly[test] += not strict
        if tolerant or strict:
            said = [one if one.startswith("no Value") else f"{name}: {one}" for one in tolerant or strict]
            why.setdefault(test, {}).update(dict.fromkeys(said))
    lines = ["| test | requests | hold | hold if strict | |", "|---|---|---|---|---|"]
    for test, count in sent.items():
        words = "; ".join(why.get(test, ()))
        lines.append(f"| {test} | {count} | {holds[test]} | {strictly[test]} | {words} |")
    totals = f"{sum(sent.values())} | {sum(holds.values())} | {sum(strictly.values())}"
    return "\n".join([*lines, f"| all | {totals} | |"])


def main() -> int:
    """Run the chosen parts, print and write their tables; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("part", nargs="*", choices=["protocol", "telescope", "indi", []], help="all, if none")
    parser.add_argument("--jobs", type=int, default=4, help="telescopes at the same time")
    parser.add_argument("--check", action="store_true", help="write nothing")
    options = parser.parse_args()
    parts = options.part or ["protocol", "telescope", "indi"]
    tables: dict[str, str] = {}
    if "protocol" in parts:
        tables["protocol"] = protocol_rows(of_protocol())
    if "telescope" in parts:
        with ThreadPoolExecutor(options.jobs) as pool:
            found = [one for group in pool.map(of_telescope, GROUPS) for one in group]
        tables["telescope"] = rows(found)
    if "indi" in parts:
        declared, states = of_indi()
        tables |= {"indi-properties": rows(declared), "indi-states": rows(states)}
    before = text = PAGE.read_text(encoding="utf-8")
    for name, table in tables.items():
        text = replace_region(text, name, table)
    if not options.check:
        PAGE.write_text(text, encoding="utf-8")
    worse = set(re.findall(r"^\| ([^|]+) \|[^|]+\| \*\*no\*\*", text, re.M)) - set(
        re.findall(r"^\| ([^|]+) \|[^|]+\| \*\*no\*\*", before, re.M)
    )
    for test in sorted(worse):
        sys.stderr.write(f"does not hold: {test}\n")
    return 1 if worse else 0


if __name__ == "__main__":
    sys.exit(main())
