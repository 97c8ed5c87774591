"""ConformU's requests without a network, the page with the outcomes; as soak, all with real programs."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote, urlencode

import conformu_checks
import pytest
from alpaca_requests import READ, Client, Request, all_requests, objections
from alpaca_stand import VirtualTelescope
from indi_interface import Action, Declared, compare_declared, compare_states

from sattrack.servers.alpaca.telescope import Reply

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "conformance.md").read_text(encoding="utf-8")
ROWS = dict(re.findall(r"^\| ([^|]+?) \| \d+ \| (yes|\*\*no\*\*) \|", PAGE, re.MULTILINE))
COUNTS = {
    test: (int(sent), int(holds))
    for test, sent, holds in re.findall(r"^\| ((?:GET|PUT|POST|DELETE) \w+) \| (\d+) \| (\d+) \|", PAGE, re.M)
}


class Within(Client):
    """The same requests, of a telescope in virtual time."""

    def __init__(self) -> None:
        self._scope = VirtualTelescope()

    def ask(self, request: Request) -> tuple[int, bytes]:
        words = urlencode(request.fields, quote_via=quote).encode()
        query, body = (words, b"") if request.verb == "GET" else (b"", words)
        asked = self._scope.asked(request.verb, request.path, query, body)
        reply = asked if isinstance(asked, Reply) else self._scope.finished(asked)
        return reply.status, reply.body

    def rest(self) -> None:
        for member in ("slewing", "ispulseguiding"):
            self._scope.wait_while(member)


def outcomes() -> Iterator[tuple[Request, list[str]]]:
    client = Within()
    for request in all_requests(client):
        yield request, objections(request, *client.ask(request), strict=False)
        if request.verb == "PUT":
            client.rest()


def test_every_request_of_conformu_is_answered_as_it_wants() -> None:
    found = list(outcomes())
    assert [(one.test, one.name, said) for one, said in found if said] == []
    assert {name for name in READ if f"GET {name}" not in {one.test for one, _ in found}} == set()
    sent: dict[str, int] = {}
    for one, _ in found:
        sent[one.test] = sent.get(one.test, 0) + 1
    assert {test: (count, count) for test, count in sent.items()} == COUNTS


GOOD = {
    "ClientTransactionID": 67890,
    "ServerTransactionID": 1,
    "ErrorNumber": 0,
    "ErrorMessage": "",
    "Value": 1,
}


@pytest.mark.parametrize(
    ("status", "told", "said"),
    [
        (200, GOOD, []),
        (200, GOOD | {"ClientTransactionID": 1}, ["transaction 1"]),
        (200, GOOD | {"ServerTransactionID": 0}, ["no number of the server's"]),
        (200, {name: GOOD[name] for name in GOOD if name != "Value"}, ["no Value beside an error number"]),
        (400, {}, ["HTTP status 400"]),
    ],
)
def test_a_bad_answer_is_objected_to(status: int, told: dict[str, object], said: list[str]) -> None:
    request = Request("GET Altitude", "good", "GET", "/api/v1/telescope/0/altitude")
    assert objections(request, status, json.dumps(told).encode(), strict=False) == said


def test_a_property_that_differs_from_the_simulators_is_found() -> None:
    there = Declared("Switch", "rw", "OneOfMany", "Main Control", ("CONNECT", "DISCONNECT"))
    for here in (there._replace(permission="ro"), there._replace(elements=("DISCONNECT", "CONNECT"))):
        (found,) = compare_declared({"CONNECTION": here}, {"CONNECTION": there})
        assert not found.holds
    assert not compare_states(Action("CONNECTION", "CONNECT=On"), ["Busy"], ["Busy", "Ok"]).holds


def test_what_does_not_hold_is_what_the_page_says_and_no_more() -> None:
    assert {test for test, holds in ROWS.items() if holds != "yes"} == {
        "DestinationSideofPier",
        "SideofPier",
        "GUIDE_RATE",
        "TELESCOPE_INFO",
        "TELESCOPE_PARK_OPTION",
        "TELESCOPE_PARK_POSITION",
        "TELESCOPE_REVERSE_MOTION",
        "TELESCOPE_TRACK_MODE",
        "TELESCOPE_TRACK_RATE",
        "TELESCOPE_MOTION_NS MOTION_NORTH",
        "TELESCOPE_MOTION_WE MOTION_WEST",
    }
    assert set(conformu_checks.CANS) <= set(ROWS)


@pytest.mark.soak
@pytest.mark.needs("indiserver", "indi_getprop", "indi_simulator_telescope")
def test_all_checks_hold_that_the_page_has_as_holding() -> None:
    command = [sys.executable, "tests/conformance/report.py", "--check"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
