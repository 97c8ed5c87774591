"""One HTTP request in, its answer out, or what has to be done before there is one. No I/O.

Source: "ASCOM Alpaca API Reference": paths, transaction numbers, HTTP statuses, the management interface.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import msgspec

from sattrack.servers.alpaca.device import MAKER
from sattrack.servers.alpaca.members import LARGEST_ID, Form, read_form
from sattrack.servers.alpaca.messages import ACTIONS, BadRequest, Fault, Number
from tle.instants import Utc

if TYPE_CHECKING:
    from sattrack.servers.alpaca.messages import CustomAction, Order
    from sattrack.servers.alpaca.telescope import Telescope

PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta http-equiv="refresh" content="5"><title>{title}</title>
<style>body{{font:16px sans-serif;margin:2em;max-width:44em}}th{{text-align:left;padding-right:2em}}</style>
</head><body><h1>{title}</h1>
<table>{rows}</table>
<p>Nothing is set here. The mount, its profile, the site, the safety limits and the elements of satellites are
told to <code>sattrack serve alpaca</code> by its options and by <code>sattrack.toml</code>;
<code>sattrack serve alpaca --help</code> has them all.</p>
<p>The protocol has no authentication: whoever reaches this port moves the mount.</p>
</body></html>
"""
JSON, TEXT, HTML = "application/json", "text/plain", "text/html"
DEVICE = "/api/v1/telescope/0/"
NOTHING = object()
"""No value: what a PUT gives back that gives nothing."""
_MEMBER = re.compile(r"[a-z]{1,40}")


def setup_page(telescope: Telescope, place: str, now_utc_s: float) -> str:
    """Return the page as of an instant."""
    device, state = telescope.device, telescope.state
    rows = [
        ("Program", device.info),
        ("Mount", f"{device.profile.name}, {device.mount}"),
        ("Site", place),
        ("Telescope number", "0"),
        ("Clients connected", str(telescope.clients)),
        ("Actions", ", ".join(ACTIONS)),
        ("Now", Utc(now_utc_s).isoformat("seconds")),
    ]
    if state is None or not state.heard:
        rows.append(("State", "the mount is not heard"))
    else:
        rows += [
            ("State", "parked" if state.at_park else state.doing),
            ("Right ascension", f"{state.ra_h:.5f} h of date"),
            ("Declination", f"{state.dec_deg:+.4f}°"),
            ("Side of the pier", "beyond the pole" if state.beyond_pole else "normal"),
        ]
        if state.tripped is not None:
            rows.append(("Stopped by safety", f"{state.tripped}; AbortSlew makes it ready again"))
    lines = (f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in rows)
    return PAGE.format(title=escape(device.name), rows="\n".join(lines))


@dataclass(frozen=True, slots=True)
class Reply:
    """An HTTP answer."""

    status: int
    kind: str
    body: bytes


@dataclass(frozen=True, slots=True)
class Transaction:
    """One request's numbers: the client's, 0 where it gave none, and the server's own."""

    client: int
    theirs: int
    ours: int


@dataclass(frozen=True, slots=True)
class Pending:
    """A request that is answered when something is done; `Server.finish` makes the answer."""

    order: Order | CustomAction
    transaction: Transaction


class Server:
    """An Alpaca device with one telescope, number 0; `place` is its site as text."""

    def __init__(self, telescope: Telescope, place: str) -> None:
        self.telescope = telescope
        self._place = place
        self._count = 0

    def answer(self, method: str, path: str, query: bytes, body: bytes, now_utc_s: float) -> Reply | Pending:
        """Return the answer to a request, or what it waits for."""
        try:
            if method not in ("GET", "PUT"):
                raise BadRequest(f"{method[:10]} is not used here: GET and PUT are", 405)
            if path.startswith("/api/"):
                return self._device(method, path, query, body, now_utc_s)
            if path.startswith("/management/"):
                return self._management(method, path, query)
            return self._page(method, path, now_utc_s)
        except BadRequest as bad:
            return Reply(bad.status, TEXT, bad.words.encode("utf-8", "replace") + b"\n")

    def finish(self, pending: Pending, value: Any = NOTHING, fault: Fault | None = None) -> Reply:
        """Return the answer to a request that had to wait."""
        return _json(pending.transaction, value, fault)

    def _device(self, method: str, path: str, query: bytes, body: bytes, now_utc_s: float) -> Reply | Pending:
        member = path.removeprefix(DEVICE)
        if member == path or not _MEMBER.fullmatch(member):
            raise BadRequest(f"no such device or member: paths begin with {DEVICE}, in lower case")
        form = read_form(query, any_case=True) if method == "GET" else read_form(body, any_case=False)
        transaction = self._begin(form)
        telescope = self.telescope
        try:
            if method == "GET":
                value = telescope.get(member, form, transaction.client, now_utc_s)
                return _json(transaction, value)
            order = telescope.put(member, form, transaction.client, now_utc_s)
        except Fault as fault:
            return _json(transaction, fault=fault)
        return _json(transaction) if order is None else Pending(order, transaction)

    def _begin(self, form: Form) -> Transaction:
        client, theirs = form.id_of("ClientID"), form.id_of("ClientTransactionID")
        self._count = self._count % LARGEST_ID + 1
        return Transaction(client, theirs, self._count)

    def _management(self, method: str, path: str, query: bytes) -> Reply:
        device = self.telescope.device
        told: dict[str, Any] = {
            "/management/apiversions": [1],
            "/management/v1/description": {
                "ServerName": f"{MAKER}, {device.host}",
                "Manufacturer": MAKER,
                "ManufacturerVersion": device.version,
                "Location": self._place,
            },
            "/management/v1/configureddevices": [
                {
                    "DeviceName": device.name,
                    "DeviceType": "Telescope",
                    "DeviceNumber": 0,
                    "UniqueID": device.unique_id,
                }
            ],
        }
        if path not in told:
            raise BadRequest(f"no {path[:60]!r}: there are {', '.join(told)}", 404)
        if method != "GET":
            raise BadRequest(f"{path} has no {method}", 405)
        return _json(self._begin(read_form(query, any_case=True)), told[path])

    def _page(self, method: str, path: str, now_utc_s: float) -> Reply:
        if path not in ("/", "/setup", "/setup/v1/telescope/0/setup"):
            raise BadRequest(f"no {path[:60]!r}: /setup is the page for people", 404)
        if method != "GET":
            raise BadRequest(f"{path} has no {method}", 405)
        page = setup_page(self.telescope, self._place, now_utc_s)
        return Reply(200, HTML, page.encode())


def _json(transaction: Transaction, value: Any = NOTHING, fault: Fault | None = None) -> Reply:
    answer: dict[str, Any] = {} if value is NOTHING or fault is not None else {"Value": value}
    answer |= {
        "ClientTransactionID": transaction.theirs,
        "ServerTransactionID": transaction.ours,
        "ErrorNumber": int(Number.OK if fault is None else fault.number),
        "ErrorMessage": "" if fault is None else fault.words,
    }
    return Reply(200, JSON, msgspec.json.encode(answer))
