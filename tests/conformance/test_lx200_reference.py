"""LX200 beside another server: `indi_skysafari`, INDI's middleware between SkySafari and any mount.

It is given the same mount, by INDI: both servers must give the same bytes of it.
"""

from __future__ import annotations

import time
from contextlib import ExitStack
from typing import TYPE_CHECKING

import pytest
from indi_programs import Indi, indi_server
from programs import free_port
from serving import PATIENCE_S, call, serving_program

from sattrack.mount.model import MountProfile
from sattrack.servers.alpaca.lx200 import Asked, Lx200Client
from sattrack.servers.alpaca.protocol import TelescopeState
from sattrack.servers.alpaca.telescope import Device, ServedTelescope
from tle.site import Site

if TYPE_CHECKING:
    import socket
    from collections.abc import Callable

ROUNDS = 25
AT_UTC_S = 1790946000.0
RECORDED = (
    (":GR#", b"14:41:41#"),
    (":Sr14:30:00#", b"1"),
    (":Sd+40*30:00#", b"1"),
    (":MS#", b"0"),
    (":Q#", b""),
    (":RS#", b""),
    (":RC#", b""),
    (":Mn#", b""),
    (":Qn#", b""),
    (":St+52*09#", b"1"),
    (":Sg355*31#", b"1"),
    (":SG+00#", b"1"),
)
"""What INDI's middleware answered of a mount at 14:41:41. Its declinations have colons where Meade's have `*`
and `'`; its answers to SC and CM are others. Ours are as Meade's document has them."""


def test_answers_are_those_of_indis_middleware() -> None:
    telescope = ServedTelescope(Device(MountProfile(), Site(52.1541, 4.4908, 0.0), "a test", "1.2", "here"))
    ra_h = 14.0 + 41.0 / 60.0 + 41.0 / 3600.0
    telescope.state = TelescopeState(utc_s=AT_UTC_S, heard=True, ra_h=ra_h, dec_deg=15.0, tracking=True)
    client = Lx200Client(telescope, -1)
    for command, answer in RECORDED:
        asked = client.answer(command[1:-1], AT_UTC_S)
        assert (asked.done if isinstance(asked, Asked) else asked) == answer, command


def ask(line: socket.socket, command: str, length: int) -> bytes:
    """Return the answer to a command, of so many bytes."""
    line.sendall(command.encode())
    answer = b""
    while len(answer) < length:
        data = line.recv(length - len(answer))
        assert data, "hung up on"
        answer += data
    return answer


@pytest.mark.soak
@pytest.mark.needs("indiserver", "indi_skysafari", "indi_getprop")
def test_a_hundred_exchanges_are_those_of_indis_middleware(
    program: Callable[[str], str],
) -> None:
    lx200, theirs = free_port(), free_port()
    with ExitStack() as closing:
        served = closing.enter_context(serving_program("indi", f"lx200:{lx200}"))
        mount = f"sattrack@127.0.0.1:{served.port}"
        port = closing.enter_context(indi_server(program, program("indi_skysafari"), mount))
        middleware, device = Indi(port, "SkySafari", program), Indi(port, "sattrack", program)
        for one in (middleware, device):
            one.until("CONNECTION.CONNECT", bool)
        device.set("CONNECTION.CONNECT=On")
        for setting in (
            f"SKYSAFARI_SETTINGS.SKYSAFARI_PORT={theirs}",
            f"SKYSAFARI_SETTINGS.INDISERVER_PORT={port}",
            "ACTIVE_DEVICES.ACTIVE_TELESCOPE=sattrack",
            "CONNECTION.CONNECT=On",
        ):
            middleware.set(setting)
        middleware.until("CONNECTION._STATE", lambda state: state == "Ok")
        lines = [closing.enter_context(call(at)) for at in (lx200, theirs)]
        for line in lines:
            line.settimeout(PATIENCE_S)
        first = ask(lines[0], ":GR#", 9)
        begins_s = sum(
            int(part) * scale for part, scale in zip(first[:8].split(b":"), (3600, 60, 1), strict=True)
        )
        equal = 0
        for number in range(ROUNDS):
            seconds = (begins_s + 7 * (number + 1)) % 86400
            minutes = 15 * 60 + 3 * number
            said = f"{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}"
            for command in (f":Sr{said}#", f":Sd+{minutes // 60:02d}*{minutes % 60:02d}:00#", ":St+52*09#"):
                answers = [ask(line, command, 1) for line in lines]
                assert answers[0] == answers[1] == b"1"
                equal += 1
            assert ask(lines[0], ":CM#", 33).endswith(b"#")
            until_s = time.monotonic() + PATIENCE_S
            while (heard := [ask(line, ":GR#", 9) for line in lines])[1] != f"{said}#".encode():
                assert time.monotonic() < until_s, heard
            assert heard[0] == heard[1]
            equal += 1
        assert equal == 4 * ROUNDS
