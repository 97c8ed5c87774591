"""The view server: a small process from which any number of people look on at a run, and send messages.

`ViewServerLink` is the feeder's end: it starts the process and gives it its task in one packet on the
descriptor that is its only argument. Each message between the two is one packet over a pair of sockets. The
feeder never waits for the server, nor it for any client: who reads too slowly loses views, who sends too much
is ignored, and a stop goes before everything else. The server ends with the feeder.
`RunViews` is the end of a program that looks on.
"""

from __future__ import annotations

import contextlib
import errno
import os
import re
import select
import socket
import subprocess
import sys
import threading
import time
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import msgspec

from sattrack.core.channel import Channel, start_process, taken_names
from sattrack.core.errors import NO_JSON, SattrackError
from sattrack.runtime.callers import Bucket
from sattrack.runtime.system import (
    is_trusted,
    outlive,
    peer_of,
    this_command,
    this_user,
    user_of,
    utc_now,
)
from sattrack.views.picture import (
    LEAST_SIDE,
    MOST_PICTURE_BYTES,
    MOST_SIDE,
    PICTURES_A_SECOND,
    PicturesWanted,
)
from sattrack.views.run import Farewell, SummaryLine, TrackView, Welcome

if TYPE_CHECKING:
    from sattrack.runtime.facts import RunFacts
    from sattrack.views.run import SessionView, Summary


PREFIX = "sattrack-run/"
"""Of the name, in Linux's abstract namespace, at which a run's view server is found; its process follows."""
FACTS, VIEW, SESSION, SUMMARY = b"F", b"V", b"C", b"E"
"""What a packet for the view server begins with; the rest is one JSON object."""
SUPPORTED = sys.platform.startswith("linux")
PACKET_BYTES = 262144
MOST_CLIENTS = 64
LONGEST_LINE = 4096
MOST_WAITING_FOR_VIEWS = 65536
"""Bytes that wait for a client, beyond which views are left out."""
MOST_WAITING = 4_000_000
"""Bytes that wait for a client, beyond which it is disconnected."""
REMEMBERED_S = 180.0
REMEMBERED_EVERY_S = 0.5
MOST_CHANGES = 200
"""How many older views are remembered, those at which something began that a log shows."""
LINES_A_SECOND = 40.0
MOST_AT_ONCE = 40.0
MOST_UNSENT = 200
"""Messages that wait for the feeder, beyond which no new client is let in, and only stops are taken."""
LAST_LINES_WITHIN_S = 2.0
LONGEST_NAME = 40
ANNOUNCED_AFTER_S = 0.2
"""How long a client may take to say who it is, before the run learns that somebody came."""


class ViewServerTask(msgspec.Struct, frozen=True):
    """The task of a view server: its descriptors, and whose run it shows."""

    listener: int
    user: int
    pid: int
    command: str
    since_utc: str
    mount: str
    name: str


class ViewClientEvent(msgspec.Struct, frozen=True, array_like=True):
    """What a client did: it came (`text` is its name), went, or sent a line."""

    number: int
    what: Literal["came", "gone", "sent"]
    text: str = ""


class _Line(msgspec.Struct, frozen=True):
    """As much of a message as the view server has to know."""

    type: str
    name: str = ""
    pictures: int = 0
    """In a hello: how large pictures are wanted; who asks for them gets nothing else."""
    shows: bool = False
    """In a hello: whether a camera has pictures."""


class _Link(msgspec.Struct, frozen=True):
    state: str


class _State(msgspec.Struct, frozen=True):
    """What of a view a log shows, without the figures in warnings."""

    phase: str
    link: _Link
    ended_by: str | None
    warnings: tuple[str, ...] = ()

    def key(self) -> tuple[object, ...]:
        """Return what two views have in common that are the same for a log."""
        return self.phase, self.link, self.ended_by, tuple(_FIGURES.sub("", each) for each in self.warnings)


_FIGURES = re.compile(r"[0-9.]+")


@dataclass(slots=True, eq=False)
class ViewClient:
    """A client that looks on."""

    connection: socket.socket
    number: int
    channel: Channel
    budget: Bucket
    since_s: float = 0.0
    announced: bool = False
    """Whether the run knows of it; who only gets pictures is not announced."""
    side: int = 0
    """How large the pictures are that it wants; 0 for none."""
    pictures: Bucket | None = None
    """What a camera may still send."""


def _state_in(line: bytes) -> tuple[object, ...]:
    try:
        return msgspec.json.decode(line, type=_State).key()
    except (msgspec.MsgspecError, *NO_JSON):
        return ()


class ViewServer:
    """Shows one run to its clients, until the feeder ends."""

    def __init__(self, task: ViewServerTask, feeder: socket.socket, listener: socket.socket) -> None:
        self._task, self._feeder, self._listener = task, feeder, listener
        self._clients: list[ViewClient] = []
        self._count = 0
        self._kept: dict[bytes, bytes] = {}
        """The last of what newcomers get at once."""
        self._views: deque[tuple[float, bytes]] = deque()
        self._changes: deque[tuple[float, bytes]] = deque(maxlen=MOST_CHANGES)
        self._last_state: tuple[object, ...] = ()
        self._newest = b""
        self._unsent: deque[ViewClientEvent] = deque()
        self._ended_s: float | None = None

    def run(self) -> None:
        """Show the run to its end."""
        while not self._over():
            self._turn()
        for client in self._clients:
            client.connection.close()

    def _over(self) -> bool:
        if self._ended_s is None:
            return False
        waiting = any(client.channel.waiting for client in self._clients)
        return not waiting or time.monotonic() - self._ended_s > LAST_LINES_WITHIN_S

    def _turn(self) -> None:
        reads: list[socket.socket] = [client.connection for client in self._clients]
        writes = [client.connection for client in self._clients if client.channel.waiting]
        if self._ended_s is None:
            reads.append(self._feeder)
            if len(self._unsent) < MOST_UNSENT:
                reads.append(self._listener)
            if self._unsent:
                writes.append(self._feeder)
        silent = [one for one in self._clients if not one.announced and not one.side]
        readable, writable, _ = select.select(reads, writes, [], ANNOUNCED_AFTER_S if silent else 0.5)
        if self._feeder in readable:
            self._take_news()
        if self._listener in readable:
            self._admit()
        for client in [one for one in self._clients if one.connection in readable]:
            self._receive(client)
        for client in [one for one in self._clients if one.connection in writable]:
            self._send_to(client, b"")
        for client in silent:
            if time.monotonic() - client.since_s > ANNOUNCED_AFTER_S:
                self._announce(client)
        self._send_to_feeder()

    def _take_news(self) -> None:
        try:
            packet = self._feeder.recv(PACKET_BYTES)
        except BlockingIOError:
            return
        except OSError:
            packet = b""
        if not packet:
            self._ended_s = time.monotonic()
            return
        kind, line = packet[:1], packet[1:] + b"\n"
        if kind == VIEW:
            self._remember(line)
        else:
            self._kept[kind] = line
        if kind == FACTS:
            # Another run: what was seen of the one before is over.
            self._views.clear()
            self._changes.clear()
            self._last_state = ()
            self._newest = b""
            self._kept.pop(SUMMARY, None)
        for client in list(self._clients):
            slow = kind == VIEW and len(client.channel.waiting) >= MOST_WAITING_FOR_VIEWS
            if not (slow or client.side):
                self._send_to(client, line)

    def _remember(self, line: bytes) -> None:
        now_s = time.monotonic()
        self._newest = line
        state = _state_in(line)
        if state != self._last_state:
            self._last_state = state
            self._changes.append((now_s, line))
        if not self._views or now_s - self._views[-1][0] >= REMEMBERED_EVERY_S:
            self._views.append((now_s, line))
        while now_s - self._views[0][0] > REMEMBERED_S:
            self._views.popleft()

    def _admit(self) -> None:
        with contextlib.suppress(OSError):
            connection, _ = self._listener.accept()
            _, user = peer_of(connection)
            channel = Channel(connection.fileno(), longest=LONGEST_LINE, most_waiting=MOST_WAITING)
            client = ViewClient(
                connection,
                self._count + 1,
                channel,
                Bucket(LINES_A_SECOND, MOST_AT_ONCE, time.monotonic()),
                time.monotonic(),
            )
            refusal = self._refusal(user)
            if refusal is not None:
                channel.send(msgspec.json.encode(Farewell(refusal)) + b"\n")
                connection.close()
                return
            self._count += 1
            self._clients.append(client)
            self._welcome(client)

    def _announce(self, client: ViewClient) -> None:
        """Tell the run that a client came, once."""
        if client.announced or client.side:
            return
        client.announced = True
        with contextlib.suppress(OSError):
            pid, _ = peer_of(client.connection)
            self._unsent.append(ViewClientEvent(client.number, "came", f"process {pid}"))

    def _refusal(self, user: int) -> str | None:
        if user not in (0, self._task.user):
            return "this run is another user's"
        if len(self._clients) >= MOST_CLIENTS:
            return f"{MOST_CLIENTS} look on already, and there is no more room"
        return None

    def _welcome(self, client: ViewClient) -> None:
        task = self._task
        welcome = Welcome(client.number, task.pid, task.command, task.since_utc, task.mount, task.name)
        first = [msgspec.json.encode(welcome) + b"\n"]
        first += [self._kept[kind] for kind in (FACTS, SESSION) if kind in self._kept]
        oldest_s = self._views[0][0] if self._views else float("inf")
        first += [line for then_s, line in self._changes if then_s < oldest_s]
        first += [line for _, line in self._views]
        first.append(self._newest)
        if SUMMARY in self._kept:
            first.append(self._kept[SUMMARY])
        self._send_to(client, b"".join(first))

    def _receive(self, client: ViewClient) -> None:
        for line in client.channel.lines():
            self._take_line(client, line)
        if client.channel.ended or client.channel.overlong:
            self._dismiss(client)

    def _take_line(self, client: ViewClient, line: bytes) -> None:
        try:
            message = msgspec.json.decode(line, type=_Line)
            text = line.decode()
        except (msgspec.MsgspecError, *NO_JSON):
            return
        if message.type == "picture":
            self._pass_on(client, line)
            return
        if message.type == "hello" and (message.pictures or client.side):
            client.side = max(LEAST_SIDE, min(MOST_SIDE, message.pictures))
            self._tell_cameras()
            return
        self._announce(client)
        if message.type == "stop":
            stop = ViewClientEvent(client.number, "sent", text)
            if stop not in self._unsent:
                self._unsent.appendleft(stop)
            return
        if len(self._unsent) >= MOST_UNSENT or not client.budget.take(time.monotonic()):
            return
        if message.type == "hello":
            name = "".join(each for each in message.name if each.isprintable())[:LONGEST_NAME]
            self._unsent.append(ViewClientEvent(client.number, "came", name or f"watcher {client.number}"))
            if message.shows:
                client.pictures = Bucket(PICTURES_A_SECOND, PICTURES_A_SECOND, time.monotonic())
                client.channel.longest = MOST_PICTURE_BYTES
                self._tell_cameras()
            return
        self._unsent.append(ViewClientEvent(client.number, "sent", text))

    def _tell_cameras(self) -> None:
        """Tell cameras how large pictures must be: as the one who wants the largest asks."""
        side = max((one.side for one in self._clients), default=0)
        wanted = msgspec.json.encode(PicturesWanted(side)) + b"\n"
        for client in [one for one in self._clients if one.pictures is not None]:
            self._send_to(client, wanted)

    def _pass_on(self, camera: ViewClient, line: bytes) -> None:
        """Send a picture to those who want pictures; who has not taken the last one yet misses it."""
        if camera.pictures is None or not camera.pictures.take(time.monotonic()):
            return
        for client in [one for one in self._clients if one.side and not one.channel.waiting]:
            self._send_to(client, line + b"\n")

    def _send_to_feeder(self) -> None:
        while self._unsent and self._ended_s is None:
            try:
                self._feeder.send(msgspec.json.encode(self._unsent[0]))
            except BlockingIOError:
                return
            except OSError:
                self._unsent.clear()
                return
            self._unsent.popleft()

    def _send_to(self, client: ViewClient, line: bytes) -> None:
        client.channel.send(line)
        if client.channel.ended:
            self._dismiss(client)

    def _dismiss(self, client: ViewClient) -> None:
        client.connection.close()
        if client in self._clients:
            self._clients.remove(client)
            if client.announced:
                self._unsent.append(ViewClientEvent(client.number, "gone"))
            if client.side:
                self._tell_cameras()


def name_for(pid: int) -> str:
    """Return the socket's name of a feeder's view server."""
    return f"\0{PREFIX}{pid}"


def check_run_of(connection: socket.socket, pid: int) -> None:
    """Raise ConnectionRefusedError where a connection leads to no run of that process that is ours to see.

    Anybody may take its name. Root looks at the runs of all.
    """
    _, user = peer_of(connection)
    if user_of(pid) not in (user, None) or not (is_trusted(user) or this_user() == 0):
        raise ConnectionRefusedError


def feeders() -> list[int]:
    """Return the processes on this machine whose runs can be looked at, as the kernel lists their names."""
    return sorted(int(name) for name in taken_names(PREFIX) if name.isdecimal())


def started_by(pid: int) -> int | None:
    """Return the process that started another one, and is there yet; None where that is not to be known."""
    try:
        # The program's name, in brackets, may hold anything.
        words = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace").rpartition(")")[2]
    except OSError:
        return None
    return int(words.split()[1])


BACKLOG = 128
HEARD_AT_ONCE = 20
END_WITHIN_S = 3.0
SUMMARY_WITHIN_S = 0.5
EVENT_BYTES = 65536


class ViewServerLink:
    """A view server at work. Where it dies, the run goes on without clients."""

    def __init__(self, facts: RunFacts) -> None:
        """Start the process. Raises OSError where it cannot start, or the name is taken."""
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs, socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener:
            try:
                listener.bind(name_for(os.getpid()))
                listener.listen(BACKLOG)
                listener.setblocking(False)
                self._process = start_process(
                    "sattrack.runtime.view_server",
                    str(theirs.fileno()),
                    inherits=(theirs.fileno(), listener.fileno()),
                )
            except OSError:
                self._socket.close()
                raise
            task = ViewServerTask(
                listener=listener.fileno(),
                user=this_user(),
                pid=os.getpid(),
                command=this_command(),
                since_utc=utc_now(),
                mount=facts.mount_name,
                name=facts.target.label,
            )
        self._socket.setblocking(False)
        self._gone = False
        self._send(msgspec.json.encode(task))
        self._send(_facts_packet(facts))
        self._decoder = msgspec.json.Decoder(ViewClientEvent)

    @property
    def pid(self) -> int:
        """The view server's process number."""
        return self._process.pid

    def begin(self, facts: RunFacts) -> None:
        """Show another run from now on."""
        self._send(_facts_packet(facts))

    def show(self, view: TrackView) -> None:
        """Show a view; where the view server does not keep up, it is lost."""
        self._send(VIEW + msgspec.json.encode(view))

    def tell(self, session: SessionView) -> bool:
        """Show who has control; return whether that was sent."""
        return self._send(SESSION + msgspec.json.encode(session))

    def tell_end(self, summary: Summary) -> None:
        """Send the summary, when the run's loop is over."""
        with contextlib.suppress(OSError):
            self._socket.settimeout(SUMMARY_WITHIN_S)
            self._socket.send(SUMMARY + msgspec.json.encode(SummaryLine(summary)))
        self._socket.setblocking(False)

    def heard(self) -> list[ViewClientEvent]:
        """Return what clients sent, and who came and went, a bounded part of it, without waiting."""
        found: list[ViewClientEvent] = []
        while len(found) < HEARD_AT_ONCE and not self._gone:
            try:
                packet = self._socket.recv(EVENT_BYTES)
            except BlockingIOError:
                break
            except OSError:
                packet = b""
            if not packet:
                self._gone = True
                break
            found.append(self._decoder.decode(packet))
        return found

    def close(self) -> None:
        """Let go; the view server ends once everybody has heard the last."""
        self._socket.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(END_WITHIN_S)

    def _send(self, packet: bytes) -> bool:
        if self._gone:
            return False
        try:
            self._socket.send(packet)
        except BlockingIOError:
            return False
        except OSError as error:
            self._gone = error.errno != errno.EMSGSIZE
            return False
        return True


LONGEST_VIEW = 1 << 28
STOP = b'{"type":"stop"}\n'
STOP_WITHIN_S = 0.5
"""How long a stop may take to show, before it is sent by the mount's guardian as well."""
RunMessage = TrackView | SummaryLine


class RunViews:
    """A run's view server, to a program that looks on: views come, and stops go."""

    LOOK_EVERY_S: ClassVar[float] = 0.25

    def __init__(self, pid: int, name: str) -> None:
        self._pid, self._name = pid, name
        self._next_s = 0.0
        self._channel: Channel | None = None
        self._decoders = msgspec.json.Decoder(TrackView), msgspec.json.Decoder(SummaryLine)
        self._stopping = threading.Event()
        """Set while the run is seen to be ending."""

    @property
    def ended(self) -> bool:
        """Whether the run is over, and no other follows it."""
        return self._channel is not None and self._channel.ended

    def readers(self) -> list[Any]:
        """Return what to wait for."""
        return [] if self._channel is None or self.ended else [self._channel]

    def look(self) -> None:
        """Connect, where that is not done."""
        now_s = time.monotonic()
        if self._channel is not None or now_s < self._next_s:
            return
        self._next_s = now_s + self.LOOK_EVERY_S
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            connection.connect(name_for(self._pid))
            check_run_of(connection, self._pid)
        except OSError:
            connection.close()
            return
        self._channel = Channel(connection.detach(), longest=LONGEST_VIEW)
        self._channel.send(msgspec.json.encode({"type": "hello", "name": self._name}) + b"\n")

    def news(self) -> list[RunMessage]:
        """Return the newest view that has come, and summaries."""
        found: list[RunMessage] = []
        for line in [] if self._channel is None else self._channel.lines():
            for decoder in self._decoders:
                with contextlib.suppress(msgspec.MsgspecError, *NO_JSON):
                    found.append(decoder.decode(line))
                    break
        for message in found:
            if isinstance(message, TrackView) and message.ended_by is not None:
                self._stopping.set()
            else:
                # Another run of the same process begins.
                self._stopping.clear()
        return found

    def stop(self) -> None:
        """Ask the run for a stop; where that does not show, ask the mount's guardian."""
        if self._channel is not None:
            self._channel.send(STOP)
        threading.Thread(target=self._see_stop_through, name="stop", daemon=True).start()

    def _see_stop_through(self) -> None:
        if self._stopping.wait(STOP_WITHIN_S):
            return
        from sattrack.runtime.mounts import ask_stop, owners

        with contextlib.suppress(SattrackError, OSError):
            for owner in owners():
                if owner.pid == self._pid:
                    ask_stop(owner, lambda: None)

    def wait(self, starter: Channel) -> list[RunMessage]:
        """Wait for the first views; return none where the run is over before, or its process is gone."""
        while not (self.ended or starter.ended):
            self.look()
            if found := self.news():
                return found
            waited = [one for one in (*self.readers(), starter) if one is not None]
            if starter in select.select(waited, [], [], self.LOOK_EVERY_S)[0]:
                starter.lines()
        return []


def _facts_packet(facts: RunFacts) -> bytes:
    # The server itself must start without all that a run needs.
    from sattrack.runtime.facts import encode_facts

    return FACTS + encode_facts(facts)


def open_view_server(facts: RunFacts) -> ViewServerLink | None:
    """Start a view server; None where there are no such names, or it cannot be started."""
    if not SUPPORTED:
        return None
    try:
        return ViewServerLink(facts)
    except OSError:
        return None


def main() -> int:
    """Run the process; returns its exit code."""
    outlive()
    feeder = socket.socket(fileno=int(sys.argv[1]))
    feeder.settimeout(10.0)
    task = msgspec.json.decode(feeder.recv(PACKET_BYTES), type=ViewServerTask)
    feeder.setblocking(False)
    ViewServer(task, feeder, socket.socket(fileno=task.listener)).run()
    return 0


if __name__ == "__main__":
    sys.exit(main())
