"""The readers of foreign bytes, for `fuzz.py`: what each reads, its documented errors, and valid examples.

A reader imports what it tries when it is made, so that only that is instrumented.
"""

from __future__ import annotations

import functools
import gzip
import importlib
import io
import math
import sqlite3
import struct
import tempfile
from collections.abc import Callable, Iterable, Iterator
from datetime import UTC
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple
from unittest.mock import MagicMock

if TYPE_CHECKING:
    from sattrack.servers.alpaca.telescope import ServedTelescope

Read = Callable[[bytes], object]
Make = Callable[[], list[Read]]
EXAMPLES = Path(__file__).resolve().parent.parent / "examples"
FOLDER = Path(tempfile.gettempdir())
"""Of the process' own, where it reads files."""
NOW_S = 1790946324.5


class Reader(NamedTuple):
    """What is read, the errors that say what is wrong with it, who reads it, and valid examples of it."""

    reads: str
    errors: tuple[str, ...]
    make: Make
    seeds: tuple[bytes | Callable[[], bytes], ...]
    most_bytes: int = 4096


def found(where: str) -> Any:
    """Return what `module:name` names."""
    module, _, name = where.partition(":")
    return functools.reduce(getattr, name.split("."), importlib.import_module(module))


def calls(
    *where: str,
    given: Callable[[bytes], Any] = bytes,
    more: Callable[[], tuple[Any, ...]] = tuple,
) -> Make:
    """Return what makes readers of functions, with what is made of the bytes, and what else they take.

    What they give only as it is asked for is asked for.
    """

    def made(one: str) -> Read:
        read, rest = found(one), more()

        def read_whole(data: bytes) -> None:
            got = read(given(data), *rest)
            for _ in got if isinstance(got, Iterator) else ():
                pass

        return read_whole

    return lambda: [made(one) for one in where]


def text(data: bytes) -> str:
    """Return text as the command line has it."""
    return data.decode("utf-8", "surrogateescape")


def in_file(name: str) -> Callable[[bytes], Path]:
    """Return what writes bytes into a file of that name."""
    path = FOLDER / name

    def written(data: bytes) -> Path:
        path.write_bytes(data)
        return path

    return written


def leiden() -> tuple[Any]:
    return (found("tle.site:Site")(52.1541, 4.4908, 0.0),)


def stations() -> tuple[Any]:
    return (found("tle.formats.observations:Stations")({"4353": leiden()[0]}, *leiden()),)


def origin() -> tuple[Any]:
    return (found("sattrack.core.errors:Origin")("here", 1, 1),)


def statuses() -> list[Read]:
    from sattrack.mount.model import MountProfile
    from sattrack.mount.xerxes.session import Session

    def read(data: bytes) -> None:
        session = Session(MountProfile())
        for k in range(0, len(data), 160):
            session.receive(data[k : k + 160], NOW_S + k / 3200.0)
            session.compose()

    return [read, *calls("sattrack.mount.xerxes.datagrams:status_readings")()]


def antenna_lines() -> list[Read]:
    from sattrack.servers.antenna.controller import Controller
    from sattrack.servers.antenna.equipment import Antenna
    from sattrack.servers.antenna.protocol import Checksum
    from sattrack.servers.antenna.trajectory import AxisRange, SiteSky

    sky, span = SiteSky(*leiden()), AxisRange(-180.0, -200.0, 200.0, -89.9, 89.9)

    def read(check: Checksum, data: bytes) -> None:
        antenna = Antenna(sky, "hadec", span, stow=(0.0, 89.0), service=(-45.0, 10.0), check=check)
        controller = Controller(antenna)
        # As they came, and with a right check, so that the fields must stop what is wrong.
        for k, line in enumerate(data.split(b"\n")):
            for sent in (line, b"#" + line + b" " + check.of(line + b" ")):
                controller.receive(sent + b"\n", round((NOW_S + k) * 1e9))

    return [functools.partial(read, check) for check in Checksum]


def rotctld_lines() -> list[Read]:
    from sattrack.mount.model import AxesPosition
    from sattrack.servers.antenna.equipment import Feedback
    from sattrack.servers.antenna.trajectory import AxisState, SiteSky
    from sattrack.servers.rotctld.answers import Client
    from sattrack.servers.rotctld.rotator import Rotator

    class StandsStill(Feedback):
        link_up = True

        def actual(self, utc_ns: int) -> AxisState:
            return AxisState(0.0, 0.0, 0.0, 0.0)

    sky = SiteSky(*leiden())

    def read(data: bytes) -> None:
        client = Client(1, Rotator(sky, StandsStill(), AxesPosition(0.0, 60.0), False))
        for piece in (data[: len(data) // 2], data[len(data) // 2 :] + b"\n"):
            client.receive(piece)
            client.answer(round(NOW_S * 1e9), 10_000)

    return [read]


def telescope() -> ServedTelescope:
    """Return a telescope as the clients of servers see it; client 1 is connected."""
    from sattrack.mount.model import MountProfile
    from sattrack.servers.alpaca.protocol import TelescopeState
    from sattrack.servers.alpaca.telescope import Device, ServedTelescope

    served = ServedTelescope(Device(MountProfile(), *leiden(), "a test", "1", "here"))
    served.state = TelescopeState(
        utc_s=NOW_S, heard=True, ra_h=5.5, dec_deg=-5.4, altitude_deg=35.8, azimuth_deg=245.9, tracking=True
    )
    served.order("connect", 1, NOW_S)
    return served


def commands() -> list[Read]:
    from sattrack.mount.simulator.mount import MailboxCommand

    return [MailboxCommand.read, *calls("sattrack.mount.xerxes.datagrams:decode_command")()]


def images() -> list[Read]:
    from sattrack.camera.sources import decode_image

    return [functools.partial(decode_image, kind) for kind in ("application/imagebytes", "application/json")]


def alpaca_requests() -> list[Read]:
    from sattrack.servers.alpaca.telescope import Server

    def read(data: bytes) -> None:
        target, query, body = (*data.split(b"\n", 2), b"", b"")[:3]
        method, _, path = target.decode("latin-1").partition(" ")
        Server(telescope(), "here").answer(method, path, query, body, NOW_S)

    return [read]


def lx200_commands() -> list[Read]:
    from sattrack.servers.alpaca.lx200 import CommandReader, Lx200Client
    from sattrack.servers.alpaca.protocol import Fault

    def read(noisy: bool, data: bytes) -> None:
        client = Lx200Client(telescope(), -1, noisy)
        for command in CommandReader(noisy).read(data) or ():
            try:
                client.answer(command, NOW_S)
            except Fault:
                continue

    return [functools.partial(read, noisy) for noisy in (False, True)]


def indi_messages() -> list[Read]:
    from sattrack.servers.alpaca.indi import ClientView, MessageReader, ServedIndiDevice
    from sattrack.servers.alpaca.protocol import Fault

    def read(data: bytes) -> None:
        device = ServedIndiDevice(telescope(), 1)
        view = ClientView(device)
        for message in MessageReader().read(data) or ():
            try:
                if message.tag == "getProperties":
                    view.definitions(message, NOW_S)
                device.take(message, 1, NOW_S)
            except Fault as fault:
                device.refuse(message.get("name", ""), fault.message)
            view.changes(NOW_S)

    return [read]


def gotos() -> list[Read]:
    from sattrack.servers.alpaca.stellarium import GotoReader, of_date, of_j2000, position
    from tle.earth import EarthOrientation

    earth = EarthOrientation.installed()

    def read(data: bytes) -> None:
        for one in GotoReader().read(data) or ():
            there = of_date(*one, NOW_S, *leiden(), earth)
            position(NOW_S, *of_j2000(*there, NOW_S, *leiden(), earth), is_well=True)

    return [read]


def indi_answers() -> list[Read]:
    from sattrack.mount.indi.telescope import IndiTelescope

    def read(data: bytes) -> None:
        mount = IndiTelescope("Telescope Simulator")
        mount.feed(data)
        mount.facts()
        mount.value("rightascension")

    return [read]


def lines_of_observers() -> list[Read]:
    from sattrack.runtime.control_arbiter import Observers

    def read(data: bytes) -> None:
        observers = Observers()
        for line in data.split(b"\n"):
            observers.put(line)
        while observers.observations():
            pass

    names = ("decode_message", "decode_said", "decode_observation", "decode_order")
    return [read, *calls(*(f"sattrack.views.messages:{name}" for name in names))()]


def guardian_requests() -> list[Read]:
    from sattrack.runtime.guardian import Guardian, GuardianClient
    from sattrack.runtime.mounts import Owner

    def read(data: bytes) -> None:
        guardian = MagicMock(**{"task.owner": Owner(1, 0, "a run", "2026-10-02T13:02:00Z", "sim", 0)})
        Guardian._obey(guardian, GuardianClient(MagicMock(), data + b"\n"))

    return [read]


TOPICS = ("status", "command", "repeat", "operator", "view", "failure", "summary", "none")


def recordings() -> list[Read]:
    from sattrack.recording.export import TABLES, table_of
    from sattrack.recording.format import look, observations
    from sattrack.runtime.facts import open_recording

    path = FOLDER / "fuzz.mcap"

    def read(data: bytes) -> None:
        path.write_bytes(data)
        recording, _ = open_recording(path)
        look(recording)
        observations(recording)
        for table in TABLES[:-1]:
            table_of(recording, table)

    return [read]


def write_recording(stream: BinaryIO, parts: list[tuple[str, bytes]]) -> None:
    """Write a run's facts, and messages by topic, as a whole recording."""
    import msgspec

    from sattrack.recording.format import FORMAT_VERSION, RunHeader
    from sattrack.recording.recorder import Recorder

    spec = msgspec.Raw(parts[0][1] if parts else b"{}")
    recorder = Recorder(stream, spec, RunHeader(FORMAT_VERSION, "0", spec))
    for k, (topic, content) in enumerate(parts[1:]):
        recorder.write(topic, NOW_S + 0.1 * k, content)
    recorder._write_header(NOW_S)
    recorder._writer.finish()  # type: ignore[no-untyped-call]


def recorded() -> list[Read]:
    (read_file,) = recordings()

    def read(data: bytes) -> None:
        parts = []
        while len(data) > 3:
            end = 3 + int.from_bytes(data[1:3], "big")
            parts.append((TOPICS[data[0] % 7], data[3:end]))
            data = data[end:]
        stream = io.BytesIO()
        write_recording(stream, parts)
        read_file(stream.getvalue())

    return [read]


def journals() -> list[Read]:
    from sattrack.schedule.night import Run
    from sattrack.schedule.night_folder import Journal

    path = FOLDER / "journal.sqlite3"

    def read(data: bytes) -> None:
        for part in FOLDER.glob("journal*"):
            part.unlink()
        path.write_bytes(data)
        journal = Journal(path, durable=False)
        try:
            journal.fold(Run())
            journal.recordings(), journal.followed(), journal.last_heartbeat()
        finally:
            journal.close()

    return [read]


def events() -> list[Read]:
    from sattrack.schedule.night_folder import Journal

    (read_file,) = journals()
    path = FOLDER / "events.sqlite3"
    Journal(path, durable=False).close()
    base = sqlite3.connect(path, isolation_level=None)
    base.execute("PRAGMA journal_mode = DELETE")
    version = found("sattrack.schedule.night_folder:VERSION")

    def read(data: bytes) -> None:
        beat, *lines = data.decode("utf-8", "replace").split("\n")
        base.executescript("BEGIN; DELETE FROM events; DELETE FROM beat")
        base.execute("INSERT INTO beat VALUES (1, ?)", (beat,))
        for k, line in enumerate(lines, start=1):
            state, _, event = line.partition(" ")
            # An event without a checksum is one of the first layout, and is taken.
            base.execute("INSERT INTO events VALUES (?, 0, ?, ?, '', ?, NULL)", (k, event, state, version))
        base.execute("COMMIT")
        read_file(path.read_bytes())

    return [read]


def catalogue() -> list[Read]:
    from tle.bodies import read_star

    written = in_file("hip_main.dat")
    return [lambda data: read_star(11767, "Polaris", written(data))]


def weather() -> list[Read]:
    from sattrack.schedule.schema import Weather
    from sattrack.schedule.weather import WeatherSource

    written = in_file("weather")
    return [lambda data: WeatherSource(Weather(file=str(written(data))), FOLDER).ask()]


def adsb() -> list[Read]:
    from sattrack.runtime.adsb import Aircraft, beast_messages
    from tle.fixes import path_of

    def lines(data: bytes) -> None:
        aircraft = Aircraft("738065")
        for line in data.split(b"\n"):
            if (fix := aircraft.sbs(line, NOW_S)) is not None:
                path_of("x", fix)

    def frames(data: bytes) -> None:
        aircraft = Aircraft("40058B")
        found, rest = beast_messages(data[:100])
        for k, one in enumerate(found + beast_messages(rest + data[100:])[0]):
            aircraft.mode_s(one, NOW_S + k)

    return [lines, frames]


def example(name: str, most_bytes: int = 4096) -> bytes:
    return (EXAMPLES / name).read_bytes()[:most_bytes]


def as_omm(form: str) -> Callable[[], bytes]:
    """Return what writes the example's elements in a format."""

    def written() -> bytes:
        from tle.sources import read_elements, write_elements

        return write_elements(read_elements(EXAMPLES / "iss_leiden.tle"), form).encode()

    return written


def compressed(data: bytes) -> bytes:
    """Return up to 255 bytes as `compress` packs what does not repeat: codes of nine bits."""
    codes = sum(byte << 9 * k for k, byte in enumerate(data[:255]))
    return b"\x1f\x9d\x90" + codes.to_bytes(-(-9 * len(data[:255]) // 8), "little")


def of_a_run() -> list[tuple[str, bytes]]:
    """Return the facts of a recorded run, and a message of each topic."""
    from sattrack.recording.format import Recording

    recording = Recording(EXAMPLES / "passes" / "faults.mcap")
    first = {entry.topic: entry.data for entry in recording.entries() if entry.topic in TOPICS}
    return [("none", bytes(recording.header.spec)), *first.items(), ("status", first["status"])]


def in_recording() -> bytes:
    """Return a run's facts and messages as `recorded` takes them: topic, length, content of each."""
    return b"".join(bytes([TOPICS.index(t)]) + len(d).to_bytes(2, "big") + d for t, d in of_a_run())


def short_recording() -> bytes:
    """Return a file with the facts of a run and a message of each topic."""
    path = FOLDER / "seed.mcap"
    with path.open("wb") as stream:
        write_recording(stream, of_a_run())
    return path.read_bytes()


def empty_journal() -> bytes:
    from sattrack.schedule.night_folder import Journal

    path = FOLDER / "seed.sqlite3"
    Journal(path, durable=False).close()
    with sqlite3.connect(path) as base:
        base.execute("PRAGMA journal_mode = DELETE")
    base.close()
    return path.read_bytes()


RATE = math.sqrt(398600.4418 / 12270.0**3) - 7.292115e-5
"""Of a circle of 12,270 km above the equator, against the Earth, rad/s."""
CIRCLE_KM = [(12270.0 * math.cos(240.0 * RATE * k), 12270.0 * math.sin(240.0 * RATE * k)) for k in range(12)]
OEM_HEAD = {
    "OBJECT_NAME": "MADE",
    "OBJECT_ID": "1998-067-A",
    "CENTER_NAME": "EARTH",
    "REF_FRAME": "ITRF2000",
    "TIME_SYSTEM": "UTC",
    "START_TIME": "2026-10-02T00:00:00",
    "STOP_TIME": "2026-10-02T00:44:00",
}
STATES = [
    (
        f"2026-10-02T00:{4 * k:02d}:00.000",
        f"{x:.6f}",
        f"{y:.6f}",
        "0",
        f"{-RATE * y:.9f}",
        f"{RATE * x:.9f}",
        "0",
    )
    for k, (x, y) in enumerate(CIRCLE_KM)
]


def tags(names: Iterable[str], values: Iterable[str]) -> str:
    return "".join(f"<{name}>{value}</{name}>" for name, value in zip(names, values, strict=True))


EPHEMERIDES = {
    "cpf": "H1 CPF  2  ILR 2026 10  2 12 275 01 made\n"
    "H2  7603901 1155     8820 2026 10  2  0  0  0 2026 10  2  1  0  0   240 1 1 0 0 0\nH9\n"
    + "".join(
        f"10 0 61315 {240.0 * k:13.6f}  0 {1e3 * x:17.3f} {1e3 * y:17.3f} {0.0:17.3f}\n"
        for k, (x, y) in enumerate(CIRCLE_KM)
    )
    + "99\n",
    "oem-kvn": "CCSDS_OEM_VERS = 2.0\nCREATION_DATE = 2026-10-02T00:00:00\nORIGINATOR = HAND\nMETA_START\n"
    + "".join(f"{name} = {value}\n" for name, value in OEM_HEAD.items())
    + "META_STOP\n"
    + "".join(" ".join(row) + "\n" for row in STATES)
    + "COVARIANCE_START\nEPOCH = 2026-10-02T00:00:00\n1\n0 1\n0 0 1\n0 0 0 1\n0 0 0 0 1\n0 0 0 0 0 1\n"
    "COVARIANCE_STOP\n",
    "oem-xml": '<?xml version="1.0"?>\n<oem id="CCSDS_OEM_VERS" version="2.0"><header>'
    "<CREATION_DATE>2026-10-02T00:00:00</CREATION_DATE><ORIGINATOR>HAND</ORIGINATOR></header><body><segment>"
    f"<metadata>{tags(OEM_HEAD, OEM_HEAD.values())}</metadata><data>\n"
    + "".join(
        f"<stateVector>{tags(('EPOCH', 'X', 'Y', 'Z', 'X_DOT', 'Y_DOT', 'Z_DOT'), row)}</stateVector>\n"
        for row in STATES
    )
    + "</data></segment></body></oem>\n",
    "sp3": "#cP2026 10  2  0  0  0.00000000      12 ORBIT IGS20 FIT  IGS\n"
    "## 2438 432000.00000000   240.00000000 61315 0.0000000000000\n"
    "+    1   L51  0  0  0  0  0  0  0  0  0  0  0  0  0  0  0  0\n"
    "%c L  cc UTC ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc\n"
    + "".join(
        f"*  2026 10  2  0 {4 * k:2d}  0.00000000\nPL51{x:14.6f}{y:14.6f}{0.0:14.6f}999999.999999\n"
        for k, (x, y) in enumerate(CIRCLE_KM)
    )
    + "EOF\n",
    "table": "utc,az_deg,alt_deg\n"
    + "".join(f"2026-10-02T19:4{k}:00Z,{10 * k},{20 + k}\n" for k in range(9)),
}
TDM = """CCSDS_TDM_VERS = 2.0
META_START
TIME_SYSTEM = UTC
PARTICIPANT_1 = 1998-067A
PARTICIPANT_2 = LEIDEN
ANGLE_TYPE = RADEC
REFERENCE_FRAME = ICRF
META_STOP
DATA_START
ANGLE_1 = 2026-275T13:05:24.5 12.5
ANGLE_2 = 2026-275T13:05:24.5 -2.5
DATA_STOP
"""
TDM_XML = """<tdm id="CCSDS_TDM_VERS" version="2.0"><body><segment><metadata><TIME_SYSTEM>UTC</TIME_SYSTEM>
<PARTICIPANT_1>LEIDEN</PARTICIPANT_1><PARTICIPANT_2>25544</PARTICIPANT_2><ANGLE_TYPE>RADEC</ANGLE_TYPE>
<REFERENCE_FRAME>EME2000</REFERENCE_FRAME></metadata><data>
<observation><EPOCH>2026-10-02T13:05:24.5</EPOCH><ANGLE_1>12.5</ANGLE_1></observation>
<observation><EPOCH>2026-10-02T13:05:24.5</EPOCH><ANGLE_2>-2.5</ANGLE_2></observation>
</data></segment></body></tdm>
"""
OBSERVATIONS = {
    "csv": (example("iss_observations.csv"),),
    "iod": (b"25544 98 067A   4353 G 20261002130524500 17 15 1122334+112233 36 S+030 05\n",),
    "tdm": (TDM.encode(), TDM_XML.encode()),
    "jsonl": (example("iss_plate_solutions.jsonl").partition(b"\n")[0], b'{"a":' * 700),
}
STATUS = (
    b"XERXESxx"
    + struct.pack("<ddddd", 52718.04, 246.11, 15.0, 0.0, 10.7)
    + (bytes(8) + struct.pack("<dd", 10.7, 14.0) + bytes(96))
)
COMMAND = b"\xaa\xaaUU" + bytes(4) + b"\1" + bytes(73)
STARS = b"""a run
:EQUAT
:NODA
 52 09 00.0 2026 11 22 10.0 1013.0 6.0
 05 16 41.35871 +45 59 52.7693 0 0 2000.0 05 18 40.00000 +46 01 00.0000 05 30.5
END
"""
HIPPARCOS = (
    b"H|       11767| |02 31 47.1|+89 15 50.9| 1.97| |H|037.94614689|+89.26413805| |7.56|44.22|-11.74|\n"
)
SBS = b"""MSG,4,1,1,738065,1,2008/11/28,23:48:18.6,2008/11/28,23:53:19.1,,,420,179,,,0,0,0,0
MSG,3,1,1,738065,1,2008/11/28,23:48:18.6,2008/11/28,23:53:19.1,,36000,,,51.45735,1.02826,,,0,0,0,0
"""
BEAST = b"".join(
    b"\x1a3" + bytes(7) + bytes.fromhex(one)
    for one in ("8D40058B58C901375147EFD09357", "8D40058B58C904A87F402D3B8C59") * 4
)
MESSAGES = tuple(
    line.encode()
    for line in (
        '{"type":"observation","utc":"2026-10-02T13:04:42Z","ra_deg":170.0,"dec_deg":31.7,"sigma_arcsec":20}',
        '{"type":"offset","utc":"2026-10-02T13:04:42Z","dx_arcsec":1,"dy_arcsec":2}',
        '{"type":"fix","utc":"2026-10-02T13:04:42Z","lat_deg":52,"lon_deg":4,"height_m":9,"east_m_s":1}',
        '{"type":"nudge","what":"time","seconds":0.5}\n{"type":"stop"}\n{"type":"pause"}',
        '{"type":"field","utc":"2026-10-02T13:04:42Z","x":' + "[" * 2000,
        '{"type":"stop","x":' + "[" * 2000,
    )
)


def vector(kind: str, name: str, **values: str) -> bytes:
    ones = "".join(f"<one{kind} name='{key}'>{value}</one{kind}>" for key, value in values.items())
    return f"<new{kind}Vector device='sattrack' name='{name}'>{ones}</new{kind}Vector>".encode()


INDI = (
    b"<getProperties version='1.7'/>" + vector("Number", "EQUATORIAL_EOD_COORD", RA="5:30:0", DEC="-5.5"),
    vector("Number", "TELESCOPE_TIMED_GUIDE_NS", TIMED_GUIDE_N="500")
    + vector("Text", "TIME_UTC", UTC="2026"),
    vector("Number", "GEOGRAPHIC_COORD", LAT="52.1541", LONG="4.4908", ELEV="0"),
    vector("Switch", "TELESCOPE_MOTION_NS", MOTION_NORTH="On")
    + vector("Switch", "TELESCOPE_PARK", PARK="On"),
)
INDI_MOUNT = b"""<defSwitchVector device="Telescope Simulator" name="CONNECTION" state="Ok">
<defSwitch name="CONNECT">On</defSwitch></defSwitchVector>
<defNumberVector device="Telescope Simulator" name="EQUATORIAL_EOD_COORD" state="Ok">
<defNumber name="RA" min="0" max="24">5.5</defNumber><defNumber name="DEC">-5</defNumber></defNumberVector>
<defNumberVector device="Telescope Simulator" name="GEOGRAPHIC_COORD"><defNumber name="LAT">52</defNumber>
<defNumber name="LONG">4</defNumber></defNumberVector>
<defNumberVector device="Telescope Simulator" name="TELESCOPE_TRACK_RATE"><defNumber name="TRACK_RATE_RA"
 max="16000">15</defNumber></defNumberVector>
<setNumberVector device="Telescope Simulator" name="EQUATORIAL_EOD_COORD"><oneNumber name="RA">6</oneNumber>
</setNumberVector>
"""
EVENTS = b"""{"utc_s":1.0}
planning {"event":"started","utc_s":1790946000.0,"ways":{"from_utc_s":1.0,"to_utc_s":null,"noon_s":0.0}}
stopped {"event":"stop asked","utc_s":1790946001.0}"""
ANTENNA = (
    b"PS\nSTATUS\nTD -120 10 0.1 0.2 43200.5 S\nTD 10 20\nPS\nSTOP\nSTOW\nUNSTOW\nSERVICE\nRESET",
    b"RADEC DATE 10 20\nOFFSET 0.1 0.1\nFIXED 10 20\nFIXSKY 10 20\nPS\nTIME\nTIME 20728 43200\nSENSORS",
    b"SAT 25544\nFOCUS 1,,2\nFOCSWEEP 1 0.5\nFOCSTOP\nFOCPOS\n"
    + b"\n".join(b"TLE " + line for line in example("iss_leiden.tle").splitlines()[-3:]),
)
ROTCTLD = (
    b"P 120.5 45\np\nS\nK\nM 2 50\n+\\get_pos\n;p\n\\dump_state\nR 1\nv ?\nV SPEED 3\n_\n1\n?\nq\n",
    b"L 4.49 52.15 6\nl JO22\nD 1 2 3 0\nd 1.5\nE 1 2.5 0\ne 1.5\nB 4 52 5 53\nA 10\na 100\n\\pause 1\n",
    b"w stop all\n# x\nC token 1\nu LOCK\nX PARM 1\n",
)
LX200 = (
    b"\x06:GR#:GD#:GA#:GZ#:GS#:GT#:GW#:GVP#:GL#:Ga#:GC#:Gt#:Gg#:Gc#:GG#:D#:U#:P#:Gr#:Gd#",
    b":Sr05:30:00#:Sd-05*30:00#:MS#:CM#:SG-01.0#:SL21:05:24#:SC10/02/26#:St+52*09#:Sg355*31#",
    b":RS#:Mn#:Qn#:Mw#:Q#:Mgn0500#:Te#:Td#:TQ#:AP#:hP#:hC#:h?#",
)
ALPACA_REQUESTS = (
    b"GET /api/v1/telescope/0/rightascension\nClientID=1&ClientTransactionID=2",
    b"PUT /api/v1/telescope/0/slewtocoordinatesasync\n\nRightAscension=5.5&Declination=-5.4&ClientID=1",
    b'PUT /api/v1/telescope/0/action\n\nAction=Passes&Parameters={"satellite":"25544","hours":2}&ClientID=1',
    b"PUT /api/v1/telescope/0/action\n\nAction=Bias&Parameters=%7B%22along_s%22%3A1%7D&ClientID=1",
    b"PUT /api/v1/telescope/0/moveaxis\n\nAxis=0&Rate=0.5&ClientID=1",
    b"PUT /api/v1/telescope/0/siderealtime\n\nTracking=True",
    b"PUT /api/v1/telescope/0/utcdate\n\nUTCDate=2026-10-02T13:05:24Z&ClientID=1",
    b"GET /api/v1/telescope/0/destinationsideofpier\nRightAscension=5.5&Declination=-5.4&clientid=1",
    b"GET /management/v1/description\nClientID=1",
    b"GET /setup/v1/telescope/0/setup",
)
TLE_ERROR, BAD_INPUT = "tle.errors:TleError", "sattrack.core.errors:BadInputError"
BOTH = (TLE_ERROR, BAD_INPUT)
DATAGRAM = ("sattrack.mount.xerxes.datagrams:DatagramError",)
MESSAGE = ("msgspec:MsgspecError",)
ALPACA = ("sattrack.mount.alpaca.client:NoAnswerError", "sattrack.mount.alpaca.client:AlpacaRefusalError")
JOURNAL = ("sattrack.schedule.night_folder:DamagedJournalError",)
VALUE = "builtins:ValueError"
TLE = example("iss_leiden.tle")
LAUNCH = example("launch.csv")
PARSE_EPHEMERIDES = "tle.formats.ephemerides:parse_ephemerides"
ADDRESSES = (
    "sattrack.servers.antenna.serve:parse_antenna_url",
    "sattrack.servers.antenna.alpaca_focuser:parse_focuser",
    "sattrack.runtime.control_arbiter:check_source",
    "sattrack.mount.simulator.installation:parse_faults",
    "sattrack.mount.simulator.hidden:parse_hidden",
    "sattrack.core.clock:parse_clock",
    "tle.site:Site.parse",
    "tle.instants:Utc.parse",
)
READERS = {
    "elements": Reader(
        "files of elements, packed or not",
        (TLE_ERROR,),
        calls("tle.sources:load_elements", given=in_file("elements")),
        (
            TLE,
            *(as_omm(form) for form in ("csv", "json", "xml", "kvn")),
            gzip.compress(TLE, mtime=0),
            TLE.decode().encode("utf-16"),
        ),
    ),
    "tle": Reader(
        "elements: TLE, 3LE, a list of gpredict's",
        (),
        calls("tle.formats.tle:read_tle", "tle.formats.tle:read_gpredict", given=text),
        (TLE, b"[25544]\nVERSION=1.1\nNAME=ISS\nTLE1=%b\nTLE2=%b\n" % tuple(TLE.splitlines()[-2:])),
    ),
    **{
        f"omm-{form}": Reader(
            f"elements: OMM as {form.upper()}",
            (),
            calls(f"tle.formats.omm_notations:read_{form}", given=text),
            (as_omm(form),),
        )
        for form in ("csv", "json", "xml", "kvn")
    },
    **{
        f"seen-{form}": Reader(
            f"observations: {form.upper()}",
            (TLE_ERROR,),
            calls("tle.formats.observations:parse_observations", more=stations, given=text),
            seeds,
        )
        for form, seeds in OBSERVATIONS.items()
    },
    **{
        form: Reader(
            f"ephemerides: {form.upper()}",
            (TLE_ERROR,),
            calls(PARSE_EPHEMERIDES, more=lambda: ("x", *leiden())),
            (seed.encode(),),
        )
        for form, seed in EPHEMERIDES.items()
    },
    "launch": Reader(
        "ephemerides: a table of places, packed or not",
        (TLE_ERROR,),
        calls(PARSE_EPHEMERIDES, more=lambda: ("x", *leiden(), found("tle.instants:Utc")(NOW_S))),
        (LAUNCH, gzip.compress(LAUNCH, mtime=0), compressed(LAUNCH[:199])),
    ),
    "status": Reader(
        "the mount's statuses, one after another", DATAGRAM, statuses, (STATUS, 3 * STATUS), 1600
    ),
    "command": Reader("commands to the mount", DATAGRAM, commands, (COMMAND,), 200),
    "antenna": Reader("an antenna's command lines", (), antenna_lines, ANTENNA),
    "antenna-answers": Reader(
        "an antenna's answers",
        (VALUE,),
        calls("sattrack.servers.antenna.antcn:read_position", given=text),
        (
            b"PS 30 40 30 40 0 0 0.1 0.1 0 -1 43200.5 REMOTE IDLE",
            b"PS ,, ,, 30 40 ,, ,, 0 0 ,, 1 1.5 LOCAL IDLE",
        ),
    ),
    "rotctld": Reader("rotctld's lines", (), rotctld_lines, ROTCTLD),
    "lx200": Reader("LX200 commands", (), lx200_commands, LX200),
    "stellarium": Reader(
        "Stellarium's gotos", (), gotos, (b"\x14\0\0\0" + bytes(8) + b"\1\2\3\4\5\6\7\x08",)
    ),
    "indi": Reader("INDI messages of a client", (), indi_messages, INDI),
    "indi-mount": Reader("INDI messages of a mount", ALPACA, indi_answers, (INDI_MOUNT,)),
    "alpaca": Reader("Alpaca requests: target, query, body", (), alpaca_requests, ALPACA_REQUESTS),
    "alpaca-answers": Reader(
        "answers of an Alpaca mount",
        ALPACA,
        lambda: [functools.partial(found("sattrack.mount.alpaca.client:value_in"), "tracking", 200)],
        (b'{"ErrorNumber":0,"ErrorMessage":"","Value":1.5}', b"[" * 4000),
    ),
    "alpaca-image": Reader(
        "images of an Alpaca camera",
        (*ALPACA, VALUE),
        images,
        (
            b'{"ErrorNumber":0,"Value":[[1,2],[3,4]]}',
            struct.pack("<11i12x", 1, 0, 1, 1, 44, 2, 6, 2, 3, 4, 0),
        ),
    ),
    "messages": Reader("messages to a run", MESSAGE, lines_of_observers, MESSAGES),
    "guardian": Reader(
        "requests to a run's guardian",
        (),
        guardian_requests,
        tuple(b'{"ask":"%b"}' % ask for ask in (b"who", b"stop", b"watch", b"give-up")),
    ),
    "recording": Reader("recordings", BOTH, recordings, (short_recording,), 65536),
    "recorded": Reader("messages in a sound recording", BOTH, recorded, (in_recording,), 16384),
    "journal": Reader("journals of a night", JOURNAL, journals, (empty_journal,), 32768),
    "events": Reader("events in a sound journal", JOURNAL, events, (EVENTS,)),
    "settings": Reader(
        "settings",
        BOTH,
        calls("sattrack.settings:load_settings", given=in_file("sattrack.toml")),
        (example("sattrack.toml"),),
    ),
    "profile": Reader(
        "profiles",
        BOTH,
        calls("sattrack.mount.profiles:load_profile_file", given=in_file("profile.toml")),
        tuple(example(f"profiles/{name}.toml") for name in ("edge", "realistic", "reversed_absolute")),
    ),
    "schedule": Reader(
        "schedules",
        BOTH,
        calls("sattrack.schedule.file:load_schedule", given=in_file("night.toml")),
        (example("night.toml"),),
    ),
    "passes": Reader(
        "lists and tables of passes",
        BOTH,
        calls(
            "sattrack.schedule.file:read_list",
            "sattrack.schedule.file:read_table",
            more=lambda: (UTC, *origin()),
            given=text,
        ),
        (
            b"2026-10-02T19:40:10 2026-10-02 19:46:00 ISS # x\n2026.275.19:40:00 2026.275.19:46 9\n",
            b"satellite;start;end;priority;name\nISS;2026-10-02T19:40:10;2026-10-02 19:46:00;2;x\n",
        ),
    ),
    "rules": Reader(
        "rules of a schedule",
        BOTH,
        calls(
            "sattrack.schedule.schema:parse_rule",
            "sattrack.schedule.schema:parse_conditions",
            more=origin,
            given=text,
        ),
        (
            b"all of elements.tle, above 30 deg, sunlit, magnitude < 4, longer than 60 s",
            b"all, dark, above 20",
        ),
    ),
    "stars": Reader(
        "star files (pointing)",
        BOTH,
        lambda: [
            *calls("sattrack.pointing.files:read_stars", more=lambda: ("x", "equatorial"), given=text)(),
            *calls("sattrack.pointing.files:read_stars", more=lambda: ("x", "altaz"), given=text)(),
        ],
        (STARS, STARS.replace(b"EQUAT", b"ALTAZ")),
    ),
    "hipparcos": Reader("a catalogue of stars", (TLE_ERROR,), catalogue, (HIPPARCOS,)),
    "lists": Reader(
        "skylines, magnitudes, lists of observers",
        (TLE_ERROR,),
        calls(
            "tle.horizon:HorizonMask.read",
            "tle.facts:read_magnitudes",
            "tle.formats.observations:read_stations",
            given=in_file("list.txt"),
        ),
        (b"0 10\n90 20\n180 15 # trees\n270,5\n", b"25544 -1.8\n", b"4353 CB 52.15 4.49 -2 Leiden\n# x\n"),
    ),
    "stations": Reader(
        "stations of a network",
        BOTH,
        calls("sattrack.network.stations:read_stations", given=in_file("stations")),
        (
            example("network/stations.toml"),
            b"name,latitude_deg,longitude_deg,height_m\nA,52.1,4.2,3\nB,-10,20,40\n",
        ),
    ),
    "weather": Reader("a file of the weather", (), weather, (b"safe\n", b"unsafe rain\n")),
    "adsb": Reader("ADS-B: BaseStation lines, Beast frames", (), adsb, (SBS, BEAST)),
    "addresses": Reader(
        "addresses of mounts, sites, instants, faults",
        BOTH,
        lambda: [
            *calls(*ADDRESSES, given=text)(),
            *calls("sattrack.runtime.mounts:mount_address", more=lambda: (False,), given=text)(),
        ],
        (
            b"xerxes://127.0.0.1:15001?listen=15002",
            b"alpaca://127.0.0.1:11111/0?hz=10",
            b"indi://127.0.0.1:7624/Telescope%20Simulator",
            b"antenna://127.0.0.1:4000?axes=azel&check=crc&rate=5",
            b"antenna:///dev/ttyUSB0?baud=9600&timing=character",
            b"alpaca://[::1]:11111/0?step=1.5&zero=3",
            b"loss=5%,delay=20ms~5ms",
            b"2026-10-02T13:05:24.5+01:00x10",
            b"52.15,4.49,0",
            b"udp:5000",
        ),
    ),
}
"""By name."""
