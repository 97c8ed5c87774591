"""The simulated telescope in a process of its own: `python -m sattrack.mount.simulator.alpaca [JSON]`.

The argument is a `TelescopeSettings` as JSON, with `port` beside it if one is wanted. The first line of
standard output tells the port. The process ends with its standard input, or on a signal.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import sys

import msgspec

from sattrack.mount.simulator.alpaca.server import serve
from sattrack.mount.simulator.alpaca.settings import TelescopeSettings


async def run(settings: TelescopeSettings, port: int) -> None:
    """Serve until standard input ends, or a signal comes."""
    loop, ended = asyncio.get_running_loop(), asyncio.Event()
    os.set_blocking(sys.stdin.fileno(), False)

    def heard() -> None:
        with contextlib.suppress(BlockingIOError):
            if not os.read(sys.stdin.fileno(), 64):
                ended.set()

    loop.add_reader(sys.stdin.fileno(), heard)
    loop.add_signal_handler(signal.SIGTERM, ended.set)

    def ready(port: int) -> None:
        sys.stdout.write(json.dumps({"port": port}) + "\n")
        sys.stdout.flush()

    serving = asyncio.create_task(serve(settings, port, ready))
    ending = asyncio.create_task(ended.wait())
    await asyncio.wait({serving, ending}, return_when=asyncio.FIRST_COMPLETED)
    serving.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await serving


def main() -> int:
    """Run the process; returns its exit code."""
    # Interrupting the tracker must not take the mount away before the tracker has stopped it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    told = json.loads(sys.argv[1]) if len(sys.argv) > 1 else {}
    port = int(told.pop("port", 0))
    asyncio.run(run(msgspec.convert(told, TelescopeSettings), port))
    return 0


if __name__ == "__main__":
    sys.exit(main())
