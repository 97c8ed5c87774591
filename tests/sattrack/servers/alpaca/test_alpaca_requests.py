"""Requests and answers to the byte: paths, the case of names, transaction numbers, HTTP's own statuses.

Literal texts are those of the "ASCOM Alpaca API Reference"; no client's library stands in between.
"""

from __future__ import annotations

import json
import uuid

import pytest
from alpaca_stand import VirtualTelescope
from antenna_harness import SITE

from sattrack.mount.model import MountProfile
from sattrack.servers.alpaca.protocol import MEMBERS
from sattrack.servers.alpaca.telescope import Device, Reply

DEVICE = "/api/v1/telescope/0/"


@pytest.fixture(scope="module")
def scope() -> VirtualTelescope:
    return VirtualTelescope()


def get(scope: VirtualTelescope, member: str, query: bytes = b"") -> Reply:
    reply = scope.asked("GET", DEVICE + member, query)
    assert isinstance(reply, Reply)
    return reply


def put(scope: VirtualTelescope, member: str, body: bytes = b"") -> Reply:
    return scope.finished(scope.asked("PUT", DEVICE + member, b"", body))


def told(reply: Reply) -> dict[str, object]:
    assert reply.status == 200, reply.body
    assert reply.kind == "application/json"
    answer: dict[str, object] = json.loads(reply.body)
    return answer


def test_an_answer_has_its_fields_and_no_others(scope: VirtualTelescope) -> None:
    read = told(get(scope, "interfaceversion", b"ClientID=65&ClientTransactionID=1001"))
    assert list(read) == [
        "Value",
        "ClientTransactionID",
        "ServerTransactionID",
        "ErrorNumber",
        "ErrorMessage",
    ]
    assert (read["Value"], read["ClientTransactionID"]) == (4, 1001)
    assert (read["ErrorNumber"], read["ErrorMessage"]) == (0, "")
    written = told(put(scope, "targetdeclination", b"TargetDeclination=5&ClientTransactionID=7"))
    assert list(written) == ["ClientTransactionID", "ServerTransactionID", "ErrorNumber", "ErrorMessage"]
    failed = told(get(scope, "focallength"))
    assert "Value" not in failed
    assert failed["ErrorNumber"] == 0x400
    assert failed["ErrorMessage"]


def test_server_transactions_are_counted_from_one_request_to_the_next(scope: VirtualTelescope) -> None:
    numbers = [told(get(scope, "name"))["ServerTransactionID"] for _ in range(3)]
    first = numbers[0]
    assert isinstance(first, int)
    assert first > 0
    assert numbers == [first, first + 1, first + 2]


@pytest.mark.parametrize("query", [b"", b"ClientID=1", b"clienttransactionid=0", b"Extra=Value"])
def test_a_client_need_not_give_its_numbers(scope: VirtualTelescope, query: bytes) -> None:
    assert told(get(scope, "name", query))["ClientTransactionID"] == 0


@pytest.mark.parametrize(
    "query",
    [
        b"ClientID=123456&ClientTransactionID=67890",
        b"clientid=123456&ClientTransactionID=67890",
        b"CLIENTID=123456&clienttransactionid=67890",
        b"ClientID=123456&CLIENTTRANSACTIONID=67890&ExtraParameter=ExtraValue",
    ],
)
def test_names_in_a_query_may_be_of_any_case(scope: VirtualTelescope, query: bytes) -> None:
    assert told(get(scope, "tracking", query))["ClientTransactionID"] == 67890


@pytest.mark.parametrize("query", [b"Axis=0", b"axis=0", b"AXIS=0", b"aXIS=0&ClientID=1"])
def test_parameters_in_a_query_may_be_of_any_case(scope: VirtualTelescope, query: bytes) -> None:
    assert told(get(scope, "canmoveaxis", query))["Value"] is True


BAD_NUMBERS = [b"", b"+++++", b"-12345", b"asdasd", b"4294967296", b"1.5", b"0x10", b"%FF", b"1%00"]


@pytest.mark.parametrize("number", BAD_NUMBERS)
@pytest.mark.parametrize("name", [b"ClientID", b"ClientTransactionID"])
def test_a_number_that_is_none_is_a_bad_request(scope: VirtualTelescope, name: bytes, number: bytes) -> None:
    other = b"ClientID" if name == b"ClientTransactionID" else b"ClientTransactionID"
    pairs = name + b"=" + number + b"&" + other + b"=5"
    for reply in (
        get(scope, "tracking", pairs),
        put(scope, "targetdeclination", b"TargetDeclination=1&" + pairs),
    ):
        assert reply.status == 400
        assert reply.kind == "text/plain"
        assert reply.body.strip()


def test_the_largest_numbers_come_back(scope: VirtualTelescope) -> None:
    reply = told(get(scope, "name", b"ClientID=4294967295&ClientTransactionID=4294967295"))
    assert reply["ClientTransactionID"] == 4294967295


# Names in a form must be as the definition writes them.
@pytest.mark.parametrize(
    ("member", "good", "bad"),
    [
        ("connected", b"Connected=True", b"cONNECTED=True"),
        ("targetdeclination", b"TargetDeclination=1.5", b"targetdeclination=1.5"),
        ("trackingrate", b"TrackingRate=0", b"trackingRate=0"),
        ("moveaxis", b"Axis=0&Rate=0.0", b"aXIS=0&Rate=0.0"),
        ("moveaxis", b"Axis=0&Rate=0.0", b"Axis=0&rATE=0.0"),
        ("slewtocoordinatesasync", b"RightAscension=30&Declination=10", b"rIGHTaSCENSION=30&Declination=10"),
        ("tracking", b"Tracking=True", b"tRACKING=True"),
        ("siteelevation", b"SiteElevation=1", b"siteelevation=1"),
        ("pulseguide", b"Direction=0&Duration=0", b"Direction=0&dURATION=0"),
        ("action", b"Action=None&Parameters=", b"action=None&Parameters="),
    ],
)
def test_names_in_a_form_must_be_of_their_own_case(
    scope: VirtualTelescope, member: str, good: bytes, bad: bytes
) -> None:
    assert put(scope, member, good).status == 200
    refused = put(scope, member, bad)
    assert refused.status == 400
    assert b"case counts" in refused.body


def test_numbers_of_another_case_in_a_form_are_not_the_clients(scope: VirtualTelescope) -> None:
    body = b"TargetDeclination=1&clientid=9&clienttransactionid=67890"
    assert told(put(scope, "targetdeclination", body))["ClientTransactionID"] == 0


@pytest.mark.parametrize(
    ("member", "body"),
    [
        ("connected", b"Connected="),
        ("connected", b"Connected=123456"),
        ("connected", b"Connected=asdqwe"),
        ("connected", b""),
        ("moveaxis", b"Axis=0"),
        ("moveaxis", b"Rate=0"),
        ("moveaxis", b"Axis=asduio6fghZZ&Rate=0"),
        ("moveaxis", b"Axis=0&Rate=asduio6fghZZ"),
        ("moveaxis", b"Axis=0.5&Rate=0"),
        ("moveaxis", b"Axis=0&Rate=nan"),
        ("moveaxis", b"Axis=0&Rate=inf"),
        ("moveaxis", b"Axis=0&Rate=1e999"),
        ("moveaxis", b"Axis=0&Rate=0,5"),
        ("moveaxis", b"Axis=0&Rate=1_0"),
        ("moveaxis", "Axis=0&Rate=١".encode()),
        ("moveaxis", b"Axis=0&Axis=1&Rate=0"),
        ("moveaxis", b"Axis=0&Rate=0&Rate=1"),
        ("moveaxis", b"\xff\xfe"),
        ("moveaxis", b"Axis=%C3%28&Rate=0"),
        ("moveaxis", b'{"Axis":0,"Rate":1}'),
        ("moveaxis", b"&" * 200),
        ("pulseguide", b"Direction=0&Duration=99999999999999999999"),
        ("targetdeclination", b"TargetDeclination=--5"),
        ("targetdeclination", b"TargetDeclination= 5"),
    ],
)
def test_a_value_that_cannot_be_read_is_a_bad_request(
    scope: VirtualTelescope, member: str, body: bytes
) -> None:
    assert put(scope, member, body).status == 400


def test_parameters_of_a_put_are_not_looked_for_in_its_query(scope: VirtualTelescope) -> None:
    reply = scope.asked("PUT", DEVICE + "moveaxis", b"Axis=0&Rate=1", b"")
    assert isinstance(reply, Reply)
    assert reply.status == 400


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        ("GET", "/apx/v1/telescope/0/description", 404),
        ("GET", "/api/1/telescope/0/description", 400),
        ("GET", "/api/v/telescope/0/description", 400),
        ("GET", "/api/V1/telescope/0/description", 400),
        ("GET", "/api/v2/telescope/0/description", 400),
        ("GET", "/api/v1/TELESCOPE/0/description", 400),
        ("GET", "/api/v1/baddevicetype/0/description", 400),
        ("GET", "/api/v1/telescope/-1/description", 400),
        ("GET", "/api/v1/telescope/99999/description", 400),
        ("GET", "/api/v1/telescope/1/description", 400),
        ("GET", "/api/v1/telescope/A/description", 400),
        ("GET", "/api/v1/telescope/0/descrip", 400),
        ("GET", "/api/v1/telescope/0/Description", 400),
        ("GET", "/api/v1/telescope/0/description/", 400),
        ("GET", "/api/v1/telescope/0/", 400),
        ("GET", "/api/v1/telescope/0/moveaxis", 400),
        ("PUT", "/api/v1/telescope/0/rightascension", 400),
        ("POST", "/api/v1/telescope/0/connected", 405),
        ("DELETE", "/api/v1/telescope/0/connected", 405),
        ("PUT", "/management/apiversions", 405),
        ("PUT", "/setup", 405),
        ("GET", "/management/v2/description", 404),
        ("GET", "/favicon.ico", 404),
    ],
)
def test_what_is_no_path_here_is_refused_by_http(
    scope: VirtualTelescope, method: str, path: str, status: int
) -> None:
    reply = scope.asked(method, path)
    assert isinstance(reply, Reply)
    assert reply.status == status


def test_the_management_interface_tells_of_the_server_and_its_telescope(scope: VirtualTelescope) -> None:
    def value(path: str) -> object:
        reply = scope.asked("GET", path, b"clientid=1&CLIENTTRANSACTIONID=3")
        assert isinstance(reply, Reply)
        answer = told(reply)
        assert answer["ClientTransactionID"] == 3
        return answer["Value"]

    assert value("/management/apiversions") == [1]
    description = value("/management/v1/description")
    assert isinstance(description, dict)
    assert set(description) == {"ServerName", "Manufacturer", "ManufacturerVersion", "Location"}
    devices = value("/management/v1/configureddevices")
    assert isinstance(devices, list)
    (device,) = devices
    assert (device["DeviceType"], device["DeviceNumber"]) == ("Telescope", 0)
    assert device["DeviceName"] == "sattrack: bench mount"
    assert uuid.UUID(device["UniqueID"]).version == 5


def test_a_telescope_keeps_its_unique_number_and_shares_it_with_no_other_mount_or_computer() -> None:
    profile = MountProfile(name="one")
    one = Device(profile, SITE, "192.0.2.7:15001", "1.0", "dome")
    same = Device(MountProfile(name="renamed"), SITE, "192.0.2.7:15001", "2.0", "dome")
    others = [
        Device(profile, SITE, "192.0.2.8:15001", "1.0", "dome"),
        Device(profile, SITE, "192.0.2.7:15001", "1.0", "shed"),
    ]
    assert one.unique_id == same.unique_id
    assert len({device.unique_id for device in (one, *others)}) == 3


@pytest.mark.parametrize("path", ["/", "/setup", "/setup/v1/telescope/0/setup"])
def test_the_setup_page_is_plain_html_without_scripts_or_anything_from_elsewhere(
    scope: VirtualTelescope, path: str
) -> None:
    reply = scope.asked("GET", path)
    assert isinstance(reply, Reply)
    page = reply.body.decode()
    assert reply.kind == "text/html"
    assert page.startswith("<!doctype html>")
    for foreign in ("<script", "http://", "https://", "src=", "<form"):
        assert foreign not in page
    assert "bench mount" in page


def test_every_member_answers_both_verbs_or_refuses_them_as_a_request(scope: VirtualTelescope) -> None:
    for member in MEMBERS:
        assert get(scope, member.path, b"ClientTransactionID=x").status == 400
        read = get(scope, member.path, b"Axis=0&RightAscension=1&Declination=1")
        assert read.status == (200 if member.read != "no" else 400), member.name
        if member.write == "no":
            assert put(scope, member.path).status == 400, member.name


def test_text_of_a_request_never_becomes_markup_or_breaks_the_answer(scope: VirtualTelescope) -> None:
    body = b"Action=%22%3Cscript%3E%0D%0AX-Evil:1&Parameters=%22"
    answer = told(put(scope, "action", body))
    assert answer["ErrorNumber"] == 0x40C
    refused = get(scope, "x" * 40)
    assert refused.status == 400
    assert refused.kind == "text/plain"
