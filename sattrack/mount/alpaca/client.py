"""Requests to one Alpaca telescope over HTTP, and what it can do.

aiohttp and not alpyca: requests for both axes go out at once on connections that stay open, so that the
middle of a request is when the telescope was asked. alpyca waits for each and opens a connection for every
request, whose handshake is then half of what is measured.
"""

from __future__ import annotations

import asyncio
import json
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import aiohttp

from sattrack.mount.alpaca.device import DeviceFacts, spans_of

if TYPE_CHECKING:
    from sattrack.mount.alpaca.address import AlpacaAddress

ANSWER_WITHIN_S = 2.0
MOST_BYTES = 200_000
NOT_CONNECTED = 0x407
CONNECTED_WITHIN_S = 10.0
LOOK_AGAIN_S = 0.2
CLIENT_ID = 4021


class Refusal(Exception):  # noqa: N818 - it is what the telescope says
    """The telescope refuses a request: the standard's number, and its words."""

    def __init__(self, number: int, words: str) -> None:
        super().__init__(f"{words} (0x{number:X})")
        self.number = number


class Unheard(Exception):  # noqa: N818 - it is said of the link
    """No answer came, or none that is Alpaca's."""


@dataclass(slots=True)
class AlpacaClient:
    """One telescope; to be used as an asynchronous context."""

    address: AlpacaAddress
    _session: aiohttp.ClientSession = field(init=False)
    _transaction: int = 0

    async def __aenter__(self) -> AlpacaClient:
        """Open."""
        timeout = aiohttp.ClientTimeout(total=ANSWER_WITHIN_S)
        connector = aiohttp.TCPConnector(limit=8, keepalive_timeout=60.0)
        self._session = aiohttp.ClientSession(timeout=timeout, connector=connector)
        return self

    async def __aexit__(self, *_: object) -> None:
        """Close."""
        await self._session.close()

    async def get(self, member: str, **fields: str) -> Any:
        """Return a member's value. Raises Refusal, Unheard."""
        return (await self._ask("GET", member, fields)).get("Value")

    async def put(self, member: str, *fields: tuple[str, str]) -> None:
        """Tell a member something. Raises Refusal, Unheard."""
        await self._ask("PUT", member, dict(fields))

    async def _ask(self, method: str, member: str, fields: dict[str, str]) -> dict[str, Any]:
        self._transaction += 1
        ids = {"ClientID": str(CLIENT_ID), "ClientTransactionID": str(self._transaction)}
        given = {**fields, **ids}
        host, port, device = self.address.host, self.address.port, self.address.device
        url = f"http://{host}:{port}/api/v1/telescope/{device}/{member}"
        where: dict[str, Any] = {"params": given} if method == "GET" else {"data": given}
        try:
            async with self._session.request(method, url, **where) as response:
                text = (await response.content.read(MOST_BYTES)).decode(errors="replace")
                status = response.status
        except TimeoutError as error:
            raise Unheard(f"it did not answer within {ANSWER_WITHIN_S:g} s") from error
        except (aiohttp.ClientError, OSError) as error:
            raise Unheard(_reason(error)) from error
        if status != 200:
            raise Unheard(f"it answered {member} with HTTP status {status}: {text.strip()[:120]}")
        return _body(member, text)

    async def connect(self) -> None:
        """Have the server connect to its telescope, where it is not. Raises Refusal, Unheard."""
        if await self.get("connected") is True:
            return
        await self.put("connected", ("Connected", "true"))
        until_s = time.monotonic() + CONNECTED_WITHIN_S
        while await self.get("connected") is not True:
            if time.monotonic() > until_s:
                raise Unheard(f"its driver did not connect to the telescope within {CONNECTED_WITHIN_S:g} s")
            await asyncio.sleep(LOOK_AGAIN_S)

    async def facts(self) -> DeviceFacts:
        """Return what the telescope can do. Raises Refusal where it cannot say, Unheard."""
        version = int(await self._perhaps("interfaceversion", 3))
        alignment = await self._perhaps("alignmentmode", None)
        rates = []
        for axis in ("0", "1"):
            can = await self._perhaps("canmoveaxis", False, Axis=axis)
            rates.append(spans_of(await self._perhaps("axisrates", [], Axis=axis)) if can else ())
        latitude, longitude = [await self._perhaps(m, None) for m in ("sitelatitude", "sitelongitude")]
        can_pulse_guide = bool(await self._perhaps("canpulseguide", False))
        has_state = version >= 4 and isinstance(await self._perhaps("devicestate", None), list)
        return DeviceFacts(
            name=str(await self._perhaps("name", "telescope"))[:80],
            interface_version=version,
            equatorial_system=int(await self._perhaps("equatorialsystem", 1)),
            alignment_mode=alignment if type(alignment) is int else None,
            does_refraction=bool(await self._perhaps("doesrefraction", False)),
            latitude_deg=latitude if isinstance(latitude, float | int) else None,
            longitude_deg=longitude if isinstance(longitude, float | int) else None,
            height_m=float(await self._perhaps("siteelevation", 0.0)),
            can_set_tracking=bool(await self._perhaps("cansettracking", False)),
            can_slew=bool(await self._perhaps("canslewasync", False)),
            can_sync=bool(await self._perhaps("cansync", False)),
            can_pulse_guide=can_pulse_guide,
            guide_rates_deg_s=await self._guide_rates() if can_pulse_guide else None,
            has_device_state=has_state,
            primary_rates=rates[0],
            secondary_rates=rates[1],
        )

    async def _guide_rates(self) -> tuple[float, float] | None:
        """Return the guide rates in right ascension and declination, degrees a second; None for none."""
        told = [await self._perhaps(f"guiderate{axis}", None) for axis in ("rightascension", "declination")]
        numbers = [float(one) for one in told if isinstance(one, int | float)]
        return (numbers[0], numbers[1]) if len(numbers) == len(told) else None

    async def _perhaps(self, member: str, otherwise: Any, **fields: str) -> Any:
        """Return a member's value, or something else where the driver has none to give."""
        try:
            return await self.get(member, **fields)
        except Refusal:
            return otherwise
        except Unheard as error:
            if "HTTP status 4" in str(error):
                return otherwise
            raise


def _body(member: str, text: str) -> dict[str, Any]:
    try:
        body = json.loads(text)
        number = int(body.get("ErrorNumber") or 0)
    except (ValueError, TypeError, AttributeError) as error:
        raise Unheard(f"what it answered {member} with is not Alpaca's") from error
    if number:
        raise Refusal(number, str(body.get("ErrorMessage") or "no words")[:200])
    answered: dict[str, Any] = body
    return answered


def _reason(error: Exception) -> str:
    if isinstance(error, aiohttp.ClientConnectorError):
        refused = isinstance(error.os_error, ConnectionRefusedError)
        return "nothing listens there" if refused else str(error.os_error.strerror or error.os_error)
    return f"the connection broke ({type(error).__name__})"
