"""A focuser on loopback that speaks ASCOM Alpaca, written from the Alpaca API reference and IFocuser."""

from __future__ import annotations

import json
import threading
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qsl, urlsplit

if TYPE_CHECKING:
    from collections.abc import Callable

NOT_IMPLEMENTED, INVALID_VALUE, NOT_CONNECTED = 0x400, 0x401, 0x407


class AscomError(Exception):
    def __init__(self, number: int, message: str) -> None:
        super().__init__(message)
        self.number = number


@dataclass
class StandInFocuser:
    """Moves at a uniform rate by a clock that the test keeps."""

    clock: Callable[[], float]
    steps_a_second: float = 1000.0
    max_step: int = 10_000
    max_increment: int = 10_000
    step_size: float | None = 2.0
    absolute: bool = True
    halts: bool = True
    connected: bool = False
    moves: list[int] = field(default_factory=list)
    _from: float = 5000.0
    _to: float = 5000.0
    _since_s: float = 0.0

    def where(self) -> float:
        way = self._to - self._from
        gone = min(abs(way), self.steps_a_second * (self.clock() - self._since_s))
        return self._from + (gone if way > 0 else -gone)

    def get(self, name: str) -> Any:
        if name == "connected":
            return self.connected
        if not self.connected:
            raise AscomError(NOT_CONNECTED, "not connected")
        if name == "stepsize" and self.step_size is None:
            raise AscomError(NOT_IMPLEMENTED, "StepSize is not implemented")
        values = {
            "absolute": self.absolute,
            "ismoving": self.where() != self._to,
            "position": round(self.where()),
            "maxstep": self.max_step,
            "maxincrement": self.max_increment,
            "stepsize": self.step_size,
        }
        return values[name]

    def put(self, name: str, given: dict[str, str]) -> None:
        if name == "connected":
            self.connected = {"True": True, "False": False}[given["connected"]]
        elif name == "move":
            step = int(given["position"])
            if not 0 <= step <= self.max_step or abs(step - self.where()) > self.max_increment + 1:
                raise AscomError(INVALID_VALUE, f"Position {step} is out of range")
            self.moves.append(step)
            self._begin(step)
        elif name == "halt":
            if not self.halts:
                raise AscomError(NOT_IMPLEMENTED, "Halt is not implemented")
            self._begin(self.where())
        else:
            raise KeyError(name)

    def _begin(self, to: float) -> None:
        self._from, self._since_s, self._to = self.where(), self.clock(), to


class StandIn:
    """An Alpaca device with one focuser, numbered 0; `address` is what a client is given."""

    def __init__(self, focuser: StandInFocuser) -> None:
        self.focuser = focuser
        self.transactions = 0
        stand_in = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"
            # Headers and body in one packet: in two, the second waits for an acknowledgement.
            wbufsize = -1

            def log_message(self, *_: object) -> None:
                pass

            def do_GET(self) -> None:
                self._answer(dict(parse_qsl(urlsplit(self.path).query)))

            def do_PUT(self) -> None:
                body = self.rfile.read(int(self.headers["Content-Length"])).decode()
                self._answer(dict(parse_qsl(body)))

            def _answer(self, given: dict[str, str]) -> None:
                code, body = stand_in.answer(self.command, urlsplit(self.path).path, given)
                self.send_response(code)
                self.send_header("Content-Type", "application/json" if code == 200 else "text/plain")
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._server.daemon_threads = True
        self.port = self._server.server_address[1]
        self.address = f"127.0.0.1:{self.port}"
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.01,), daemon=True)
        self._thread.start()

    def answer(self, method: str, path: str, given: dict[str, str]) -> tuple[int, bytes]:
        # Parameters may be in any case, paths may not.
        given = {name.lower(): value for name, value in given.items()}
        parts = path.split("/")
        if parts[:5] != ["", "api", "v1", "focuser", "0"] or len(parts) != 6:
            return 400, b"no such device"
        self.transactions += 1
        answer: dict[str, Any] = {
            "ClientTransactionID": int(given.get("clienttransactionid", "0")),
            "ServerTransactionID": self.transactions,
            "ErrorNumber": 0,
            "ErrorMessage": "",
        }
        try:
            if method == "GET":
                answer["Value"] = self.focuser.get(parts[5])
            else:
                self.focuser.put(parts[5], given)
        except AscomError as error:
            answer |= {"ErrorNumber": error.number, "ErrorMessage": str(error)}
        except (KeyError, ValueError) as error:
            return 400, f"bad request: {error}".encode()
        return 200, json.dumps(answer).encode()

    def close(self) -> None:
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()
