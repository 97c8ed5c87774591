"""Mounts: which one `--mount` or the settings name, a link to it, and the session that owns it.

A mount has one owner at a time on this machine, by a name that the kernel gives to one session only: that of
a Unix socket in Linux's abstract namespace, made of the mount's address. It is taken by binding to it, freed
by the kernel when the last process that holds the socket is gone, however that went, and leaves no file
behind that could be stale; a recycled process number means nothing to it. It counts for all users of a
machine (of a network namespace). On the same socket anybody can ask who owns the mount, ask for a stop, or
look on at the statuses that the session receives; the session's guardian answers, also where the session
hangs.

Two machines, or two containers, know nothing of one another's names: there, only acknowledgements that are
not ours show another sender (see `xerxes.link`).
"""

from __future__ import annotations

import contextlib
import select
import socket
import sys
import time
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

import msgspec

from sattrack.core import local_time
from sattrack.core.channel import LineReader, taken_names
from sattrack.core.errors import NO_JSON, BadInputError, SattrackError, meant
from sattrack.core.files import shortened
from sattrack.core.toml_text import line_of_key
from sattrack.mount.alpaca.link import AlpacaAddress, parse_alpaca
from sattrack.mount.model import MountProfile
from sattrack.mount.xerxes.client import Address, Arrival, UdpLink, parse_address
from sattrack.mount.xerxes.session import Session
from sattrack.runtime.system import is_trusted, peer_of, this_user, user_name, user_of
from tle.errors import printable

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from sattrack.mount.profiles import ProfileFile
    from sattrack.mount.xerxes.link import LinkHealth


MountAddress: TypeAlias = Address | AlpacaAddress
"""Where a real mount is; `open_link` opens a link to it, the same for all kinds."""
SIMULATED = "sim"
"""The name of the simulated mount, as `--mount` has it."""
FORMS = "xerxes://HOST:PORT?listen=PORT, alpaca://HOST:PORT/DEVICE or indi://HOST:PORT/DEVICE"
ANTENNAS = "antenna://HOST:PORT or antenna:///dev/ttyUSB0"
GATEWAYS = ("alpaca", "indi")
"""Schemes of mounts behind a gateway."""
KINDS = (SIMULATED, "xerxes", *GATEWAYS, "antenna")


def is_antenna(url: str | None) -> bool:
    """Return whether `--mount` names an antenna's controller."""
    return url is not None and url.partition(":")[0] == "antenna"


def mount_address(url: str | None, resolve: bool = True) -> MountAddress | None:
    """Read `--mount`: None for the simulated mount. Raises BadInputError.

    Without `resolve`, nobody is asked where the host is, and it stays as it was written.
    """
    if url is None:
        raise BadInputError(
            f"no mount: give --mount {FORMS}, or set [mount] url in sattrack.toml; "
            "--mount sim is a simulated one for practice; `sattrack init` asks for all that"
        )
    if not url.isprintable():
        raise BadInputError(f"--mount {url!r}: what cannot be printed is in no address; write sim, {FORMS}")
    scheme = url.partition(":")[0]
    if url == SIMULATED:
        return None
    if is_antenna(url):
        raise BadInputError(f"--mount {url}: an antenna's controller is driven by `sattrack track` alone")
    if scheme in GATEWAYS:
        return parse_alpaca(url, resolve)
    if scheme != "xerxes":
        raise BadInputError(
            f"--mount {url}: write sim, {FORMS}; for `sattrack track` also {ANTENNAS}{meant(scheme, KINDS)}"
        )
    return parse_address(url, resolve)


def check_setting(settings_file: Path, url: str | None) -> None:
    """Raise BadInputError, naming file and key, where `[mount] url` can be no mount; no host is looked up."""
    if url is None or is_antenna(url):
        return
    try:
        mount_address(url, resolve=False)
    except BadInputError as error:
        text = str(error).removeprefix("--mount ")
        line = line_of_key(settings_file, "url")
        raise BadInputError(f"{settings_file}{line}: url in [mount] is {text}") from None


def owned_address(owner: Owner) -> MountAddress:
    """Return where the mount of a session on this machine is. Raises BadInputError for no mount's name."""
    if owner.mount.partition(":")[0] in GATEWAYS:
        return parse_alpaca(owner.mount)
    host, _, port = owner.mount.rpartition(":")
    if not port.isdecimal():
        raise BadInputError(f"{owner.mount!r} is no mount's name: {owner}")
    return Address(host, int(port), owner.listen_port)


def usual_profile(url: str | None) -> MountProfile:
    """Return the profile presumed of a mount of this kind; the default for a wrong URL."""
    if url is not None and url.partition(":")[0] in GATEWAYS:
        with contextlib.suppress(BadInputError):
            return parse_alpaca(url, resolve=False).usual_profile()
    return MountProfile()


def dated_as(profile: ProfileFile, url: str | None) -> ProfileFile:
    """Return a profile with what a mount's URL says of who dates its positions."""
    ours = url is not None and url.partition(":")[0] in GATEWAYS
    offset_s = profile.clock_offset_s
    if ours and offset_s is None:
        offset_s = 0.0
    return msgspec.structs.replace(profile, dated_by_requests=ours, clock_offset_s=offset_s)


@contextmanager
def open_link(address: MountAddress, profile: MountProfile | None = None) -> Iterator[UdpLink]:
    """Give a socket towards a mount; `profile` is what it is driven by, None where that is not known.

    Raises SattrackError where the port is not available, LinkLostError where a gateway finds no telescope.
    """
    if isinstance(address, Address):
        link = UdpLink(address)
    else:
        # HTTP's modules are many; without an Alpaca telescope they are not needed.
        from sattrack.mount.alpaca.link import open_gateway

        link = open_gateway(address, profile)
    try:
        yield link
    finally:
        link.close()


@contextmanager
def open_listener(
    address: MountAddress, profile: MountProfile | None = None
) -> Iterator[UdpLink | OverheardLink]:
    """Give what to listen to a mount by: its owner's statuses, or a socket where it has no owner here.

    Raises as `open_link`.
    """
    overheard = look_on(address)
    if overheard is None:
        with open_link(address, profile) as link:
            yield link
        return
    try:
        yield overheard
    finally:
        overheard.close()


LISTEN_S = 2.0


def listen(address: MountAddress, profile: MountProfile, seconds: float = LISTEN_S) -> LinkHealth:
    """Return what was heard from a mount within some seconds, by its owner if it has one; nothing is sent.

    Raises SattrackError where the port is not available.
    """
    # The clock needs numpy, and a guardian, which imports this module, stays small.
    from sattrack.core.clock import SystemClock

    session, clock = Session(profile), SystemClock()
    with open_listener(address, profile) as link:
        end_s = time.monotonic() + seconds
        while (left_s := end_s - time.monotonic()) > 0.0:
            select.select([link], [], [], left_s)
            for arrival in link.receive():
                session.receive(arrival.data, clock.utc_s(arrival.monotonic_s))
    session.health.strangers, session.health.trouble = link.strangers, link.trouble
    return session.health


PREFIX = "sattrack-mount/"
ANSWER_WITHIN_S = 3.0
STOP_WITHIN_S = 75.0
"""Longer than stops are sent to a mount that does not come to rest."""
LONGEST_LINE = 4096
LONGEST_NAME = 108
"""Bytes of a Unix socket's name, the first one that of the abstract namespace: unix(7)."""
BACKLOG = 16
TRY_AGAIN_S = 0.02
MOST_QUESTIONS = 200
"""So many owners are asked at once: files that a process may have open are few."""
STOP_OR_GIVE_UP = "`sattrack stop` tries again, `sattrack stop --give-up` ends that"


class Owner(msgspec.Struct, frozen=True):
    """Who owns a mount: a session on this machine."""

    pid: int
    user: int
    command: str
    since_utc: str
    mount: str
    listen_port: int
    state: str = "running"
    """"running", "stopping", or what follows "it": "does not answer", "hangs, …", "ended without …"."""
    goes_on: GoesOn | None = None
    """Who goes on stopping the mount where the session has ended without seeing it at rest."""
    simulated: bool = False
    """Whether the mount is a simulated one of the session's own, which ends with it."""

    @property
    def trusted(self) -> bool:
        """Whether its word counts: it is this user's or root's. Anybody may take a mount's name."""
        return is_trusted(self.user)

    def __str__(self) -> str:
        """Return it as text."""
        if self.goes_on is not None:
            return f"`{self.command}` has ended, the mount NOT KNOWN AT REST; {self.goes_on}"
        doing = {"running": "", "stopping": "; it is stopping"}.get(self.state, f"; it {self.state}")
        whose = "" if self.trusted or self.user < 0 else f" of user {user_name(self.user)}"
        since = local_time.localised(self.since_utc)
        return f"`{self.command}`, process {self.pid}{whose}, since {since}{doing}"


class Ask(msgspec.Struct, frozen=True):
    """A request to a session."""

    ask: Literal["who", "stop", "watch", "give-up"]


class GoesOn(msgspec.Struct, frozen=True):
    """A guardian that goes on telling a mount to stop after its session has ended."""

    pid: int
    since_utc: str
    heard: str
    """What it heard last, as text."""

    def __str__(self) -> str:
        """Return it as text."""
        who = f"its guardian, process {self.pid}"
        return f"{who}, still sends it stops, since {local_time.localised(self.since_utc)}; {self.heard}"


class Stopped(msgspec.Struct, frozen=True):
    """The outcome of a stop."""

    by: Literal["session", "guardian"]
    at_rest: bool | None
    """Whether the mount was seen at rest; None where it was not heard, or nothing had been asked of it."""
    goes_on: GoesOn | None = None
    """Who goes on where it was not seen at rest."""


class GivenUp(msgspec.Struct, frozen=True):
    """Whether a guardian was asked to give up; None where it did not go on."""

    was: GoesOn | None


class Overheard(msgspec.Struct, frozen=True, array_like=True):
    """A datagram that the owner has heard from the mount, and when, by the machine's monotonic clock."""

    monotonic_s: float
    data: bytes


class Taken(SattrackError):  # noqa: N818 - the mount is
    """The mount has an owner already."""


class Claim:
    """The name of one mount, held until `close`, and by a process that inherits its descriptor."""

    def __init__(self, bound: socket.socket | None) -> None:
        self._socket = bound

    def fileno(self) -> int:
        """Return the descriptor to hand on; -1 where there are no names."""
        return -1 if self._socket is None else self._socket.fileno()

    def close(self) -> None:
        """Give the name back."""
        if self._socket is not None:
            self._socket.close()


def claim(address: MountAddress) -> Claim:
    """Take a mount's name. Raises Taken, naming the owner, where somebody has it.

    Off Linux there are no such names, and nothing is held.
    """
    if not sys.platform.startswith("linux"):
        return Claim(None)
    bound = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        bound.bind(_name(address.name))
        bound.listen(BACKLOG)
    except OSError as error:
        bound.close()
        raise Taken(_refusal(address)) from error
    bound.setblocking(False)
    return Claim(bound)


def owner_of(name: str) -> Owner | None:
    """Return who owns the mount of a name, its address'; None where no session on this machine does."""
    return next(iter(_owners([name], True)), None)


def owners() -> list[Owner]:
    """Return who owns mounts on this machine, each session once: this user's, and for root everybody's."""
    return _owners(sorted(taken_names(PREFIX)), this_user() == 0)


def _owners(mounts: list[str], others: bool) -> list[Owner]:
    """Return the owners of mounts. All are asked at once: names without an answer hold up no other."""
    found, questions = list[Owner](), list[_Question]()
    until_s = time.monotonic() + ANSWER_WITHIN_S
    while (mounts or questions) and (left_s := until_s - time.monotonic()) > 0.0:
        mounts = [mount for mount in mounts if not _ask_who(mount, others, questions)]
        wait_s = TRY_AGAIN_S if mounts else left_s if questions else 0.0
        for question in select.select(questions, [], [], wait_s)[0]:
            if question.is_answered():
                questions.remove(question)
                found.append(question.owner())
    found += [question.owner() for question in questions]
    if others:
        found += [_silent(mount, 0, -1) for mount in mounts]
    return sorted(found, key=lambda owner: owner.mount)


@dataclass(slots=True)
class _Question:
    """The question who a mount's owner is, on its way."""

    mount: str
    connection: socket.socket
    answer: bytes = b""

    def fileno(self) -> int:
        return self.connection.fileno()

    def is_answered(self) -> bool:
        """Read what has come; return whether it is all that will come."""
        try:
            more = self.connection.recv(LONGEST_LINE)
        except OSError:
            more = b""
        self.answer += more
        return not more or more.endswith(b"\n") or len(self.answer) > LONGEST_LINE

    def owner(self) -> Owner:
        """Return the owner as it says, as far as the kernel bears it out, and close the connection."""
        with self.connection:
            pid, user = peer_of(self.connection)
        try:
            said = msgspec.json.decode(self.answer, type=Owner)
        except (msgspec.MsgspecError, *NO_JSON):
            return _silent(self.mount, pid, user)
        if said.pid > 1 and user_of(said.pid) == user:
            pid = said.pid
        command, since, state = map(printable, (said.command, said.since_utc, said.state))
        # Of a long address, the socket's name has the beginning only.
        mount = printable(said.mount) if _name(said.mount) == _name(self.mount) else self.mount
        return msgspec.structs.replace(
            said, pid=pid, user=user, command=command, since_utc=since, mount=mount, state=state
        )


def _ask_who(mount: str, others: bool, questions: list[_Question]) -> bool:
    """Ask who owns a mount; return whether that is done, or there is nobody to be asked."""
    if len(questions) >= MOST_QUESTIONS:
        return False
    with contextlib.ExitStack() as closing, contextlib.suppress(OSError):
        connection = closing.enter_context(_socket())
        try:
            connection.connect(_name(mount))
        except BlockingIOError:
            return False
        if others or is_trusted(peer_of(connection)[1]):
            connection.sendall(msgspec.json.encode(Ask("who")) + b"\n")
            questions.append(_Question(mount, connection))
            closing.pop_all()
    return True


def _silent(mount: str, pid: int, user: int) -> Owner:
    """Return an owner that does not answer."""
    return Owner(pid, user, _command_of(pid), "an unknown instant", mount, 0, "does not answer")


def ask_stop(owner: Owner, waiting: Callable[[], None], within_s: float = STOP_WITHIN_S) -> Stopped | None:
    """Ask a session to stop its mount and end; `waiting` is called now and then until it has.

    None where the session is gone without an answer. Raises SattrackError where it does not answer in time.
    """
    line = _request(owner, Ask("stop"), waiting, within_s)
    return msgspec.json.decode(line, type=Stopped) if line else None


def ask_give_up(owner: Owner) -> GoesOn | None:
    """Ask a guardian to give up; return what it went on with, None for nothing. Raises SattrackError."""
    line = _request(owner, Ask("give-up"), lambda: None, ANSWER_WITHIN_S)
    return msgspec.json.decode(line, type=GivenUp).was if line else None


def _request(owner: Owner, ask: Ask, waiting: Callable[[], None], within_s: float) -> bytes | None:
    try:
        with _connected(_name(owner.mount), ANSWER_WITHIN_S) as connection:
            connection.sendall(msgspec.json.encode(ask) + b"\n")
            line = _line(connection, within_s, waiting)
    except ConnectionError:
        return None
    except TimeoutError:
        line = None
    if line is None:
        raise SattrackError(
            f"{owner} does not answer within {within_s:g} s: end it with `kill {owner.pid}`, "
            "and stop the mount by its own console"
        )
    return line


def connection_to_watch(name: str) -> socket.socket | None:
    """Return a connection on which a session sends each status that it hears; None where there is none."""
    try:
        connection = _connected(_name(name), ANSWER_WITHIN_S)
        connection.sendall(msgspec.json.encode(Ask("watch")) + b"\n")
    except OSError:
        return None
    connection.setblocking(False)
    return connection


def _name(mount: str) -> str:
    """Return the name of a mount's socket."""
    return shortened(f"\0{PREFIX}{mount}", LONGEST_NAME)


def _socket() -> socket.socket:
    """Return a socket of the kind that has names. Raises ConnectionRefusedError where there are none."""
    if not sys.platform.startswith("linux"):
        raise ConnectionRefusedError
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    connection.setblocking(False)
    return connection


def _connected(name: str, within_s: float) -> socket.socket:
    """Return a connection to a session's socket.

    Raises ConnectionError where there is none, TimeoutError where its queue is full.
    """
    until_s = time.monotonic() + within_s
    connection = _socket()
    connection.settimeout(within_s)
    while True:
        try:
            connection.connect(name)
        except BlockingIOError as error:
            if time.monotonic() > until_s:
                connection.close()
                raise TimeoutError from error
            time.sleep(TRY_AGAIN_S)
        except OSError as error:
            connection.close()
            raise ConnectionRefusedError from error
        else:
            return connection


def _line(
    connection: socket.socket, within_s: float, waiting: Callable[[], None] | None = None
) -> bytes | None:
    """Return the line that is answered, empty where the connection closes without, None where none comes."""
    until_s, data = time.monotonic() + within_s, b""
    connection.settimeout(0.2)
    while time.monotonic() < until_s and len(data) < LONGEST_LINE:
        try:
            more = connection.recv(LONGEST_LINE)
        except TimeoutError:
            if waiting is not None:
                waiting()
            continue
        data += more
        if not more or data.endswith(b"\n"):
            return data
    return None


def _refusal(address: MountAddress) -> str:
    owner = owner_of(address.name)
    if owner is None:
        return f"{address} was owned by another session until just now: ask again"
    if owner.goes_on is not None:
        return f"{address} is not known at rest: {owner}; {STOP_OR_GIVE_UP}"
    end = "`sattrack stop` ends it"
    if owner.state == "does not answer":
        end = f"end it with `kill {owner.pid}`"
    return f"{address} has an owner: {owner}; {end}"


def _command_of(pid: int) -> str:
    try:
        words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
    except OSError:
        return "a session"
    return b" ".join(words).decode(errors="replace").strip()[:200]


_OVERHEARD = msgspec.json.Decoder(Overheard)


class OverheardLink:
    """In place of a `UdpLink`: the same datagrams with the same arrivals; what is sent goes nowhere."""

    def __init__(self, address: MountAddress, connection: socket.socket) -> None:
        self.address = address
        self.strangers = self.unsent = 0
        self.stranger_hosts: list[str] = []
        self.trouble: str | None = None
        self.ended = False
        """Whether the session has ended, and nothing more will be heard."""
        self._connection = connection
        self._nobody: socket.socket | None = None
        self._reader = LineReader(connection.fileno())

    def fileno(self) -> int:
        """Return the descriptor to wait on."""
        return self._connection.fileno()

    def send(self, data: bytes) -> None:
        """Send nothing, and count it."""
        del data
        self.unsent += 1

    def receive(self) -> list[Arrival]:
        """Return what the owner has heard meanwhile, in order."""
        overheard = self._reader.messages(_OVERHEARD)
        if self._reader.ended:
            self._end()
        return [Arrival(heard.data, heard.monotonic_s) for heard in overheard]

    def close(self) -> None:
        """Look away."""
        self._connection.close()
        if self._nobody is not None:
            self._nobody.close()

    def _end(self) -> None:
        """Put a socket that stays silent in place of one that says again and again that it is closed."""
        self.ended = True
        self._connection.close()
        self._connection, self._nobody = socket.socketpair()
        self._reader = LineReader(self._connection.fileno())


def look_on(address: MountAddress) -> OverheardLink | None:
    """Return a link to look on by; None where no session on this machine owns the mount."""
    connection = connection_to_watch(address.name)
    return None if connection is None else OverheardLink(address, connection)
