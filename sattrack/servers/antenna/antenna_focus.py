"""The antenna's focuser behind ASCOM Alpaca: a process for each axis, and what comes of them."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import select
import subprocess
from dataclasses import dataclass, field
from typing import TYPE_CHECKING
from urllib.parse import parse_qs, urlsplit

import msgspec

from sattrack.core.errors import BadInputError, SattrackError
from sattrack.core.own_program import own_program
from sattrack.runtime.embedded import LineReader
from sattrack.servers.antenna.alpaca_focuser import FocuserConfig
from sattrack.servers.antenna.remote_focus import FocusNews, RemoteAxis, RemoteFocuser

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

FORM = "alpaca://HOST:PORT/DEVICE, with ?step=MICROMETRES or &zero=STEP"
START_WITHIN_S = 20.0
END_WITHIN_S = 12.0
"""A focuser that does not answer keeps its process for two requests' time."""
_NEWS: msgspec.json.Decoder[FocusNews] = msgspec.json.Decoder(FocusNews)


def parse_focuser(url: str) -> FocuserConfig:
    """Read one focuser's address. Raises BadInputError, naming what is wrong."""
    try:
        parts = urlsplit(url)
        options = parse_qs(parts.query, keep_blank_values=True, strict_parsing=bool(parts.query))
        port, device = parts.port, int(parts.path.removeprefix("/"))
        unknown = [
            name for name, values in options.items() if name not in {"step", "zero"} or len(values) > 1
        ]
        if parts.scheme != "alpaca" or not parts.hostname or port is None or device < 0 or unknown:
            raise ValueError("that is no focuser's address")
        step_um = float(options["step"][0]) if "step" in options else None
        if step_um is not None and not 0.0 < step_um < 1e6:
            raise ValueError("step is out of range")
        zero_step = int(options["zero"][0]) if "zero" in options else 0
    except ValueError as error:
        raise BadInputError(f"--focus {url}: {error}; write a number, or {FORM}") from error
    host = f"[{parts.hostname}]" if ":" in parts.hostname else parts.hostname
    return FocuserConfig(f"{host}:{port}", device, step_um, zero_step)


@dataclass(slots=True)
class FocusAxisProcess:
    """One axis' process, and the axis as the controller has it."""

    config: FocuserConfig
    process: subprocess.Popen[bytes]
    reader: LineReader
    axis: RemoteAxis
    trouble: str = ""

    @property
    def name(self) -> str:
        """The focuser in words."""
        return f"the focuser at {self.config.address}, device {self.config.device}"

    def exchange(self, to_ns: Callable[[float], int]) -> str | None:
        """Take in what has come, hand out orders; return what is worth telling."""
        news = [_NEWS.decode(line) for line in self.reader.lines()]
        for one in news:
            self.axis.hear(one, to_ns(one.monotonic_s))
        orders, self.axis.orders = self.axis.orders, []
        assert self.process.stdin is not None
        for order in orders:
            # A process that is gone is seen by its silence.
            with contextlib.suppress(OSError):
                os.write(self.process.stdin.fileno(), msgspec.json.encode(order) + b"\n")
        trouble = "it has ended" if self.reader.ended else news[-1].trouble if news else self.trouble
        if trouble == self.trouble:
            return None
        self.trouble = trouble
        return f"{self.name}: {trouble or 'is heard again'}"

    def close(self) -> None:
        """End it: it stops its focuser first."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.close()
        try:
            self.process.wait(END_WITHIN_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.process.stdout.close()


@dataclass(slots=True)
class FocusProcesses:
    """All axes of one antenna's focuser."""

    parts: Sequence[FocusAxisProcess]
    focuser: RemoteFocuser = field(init=False)

    def __post_init__(self) -> None:
        """Make of them what the controller knows."""
        self.focuser = RemoteFocuser([part.axis for part in self.parts])

    def exchange(self, to_ns: Callable[[float], int]) -> list[str]:
        """Take in what has come, hand out orders; never waits. `to_ns` dates monotonic seconds."""
        told = [part.exchange(to_ns) for part in self.parts]
        return [words for words in told if words is not None]

    def close(self) -> None:
        """Stop and end all of them."""
        for part in self.parts:
            part.close()


def start_focusers(configs: Sequence[FocuserConfig]) -> FocusProcesses:
    """Start a process for each axis. Raises SattrackError where one of them is not there, or is of no use."""
    if importlib.util.find_spec("alpaca") is None:
        raise BadInputError("Alpaca focusers need alpyca: install it with `pip install 'sattrack[alpaca]'`")
    started: list[FocusAxisProcess] = []
    try:
        for config in configs:
            started.append(_start(config))
    except SattrackError:
        FocusProcesses(started).close()
        raise
    return FocusProcesses(started)


def _start(config: FocuserConfig) -> FocusAxisProcess:
    process = subprocess.Popen(
        [*own_program("sattrack.servers.antenna.alpaca_focuser"), msgspec.json.encode(config).decode()],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        # A Ctrl-C for the antenna is not one for its focuser: that ends with its standard input.
        start_new_session=True,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    os.set_blocking(process.stdin.fileno(), False)
    part = FocusAxisProcess(config, process, LineReader(process.stdout.fileno()), RemoteAxis(0.0, 0.0))
    lines: Sequence[bytes] = ()
    while not lines and not part.reader.ended and select.select([part.reader], [], [], START_WITHIN_S)[0]:
        lines = part.reader.lines()
    first = _NEWS.decode(lines[0]) if lines else None
    if first is None or first.mm is None:
        part.close()
        raise SattrackError(f"{part.name}: {first.trouble if first is not None else 'it does not answer'}")
    part.axis = RemoteAxis(first.least_mm, first.most_mm)
    return part
