"""Lines of observations from outside: whatever comes, broken or too much, is bounded and counted."""

from __future__ import annotations

import os
import socket
from typing import TYPE_CHECKING

import msgspec
import pytest
from programs import free_port

from sattrack.core.channel import LineReader
from sattrack.core.errors import BadInputError, SattrackError
from sattrack.runtime.control_arbiter import (
    DATAGRAMS_A_TICK,
    QUEUED_MOST,
    Observers,
    StdinInbox,
    open_observers,
    read_all,
)
from sattrack.views.messages import (
    Nudge,
    ObservationMessage,
    OffsetBy,
    SeenOffset,
    SolvedField,
    StopNow,
    decode_message,
    encode_message,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

GOOD = (
    b'{"type":"observation","utc":"2026-10-02T13:05:24.5Z","ra_deg":10.5,"dec_deg":-3.25,'
    b'"frame":"icrs","sigma_arcsec":20}'
)
SEEN = ObservationMessage("2026-10-02T13:05:24.5Z", 10.5, -3.25, "icrs", 20.0)
OFFSET = (
    b'{"type":"offset","utc":"2026-10-02T13:05:24.5Z","dx_arcsec":12.5,"dy_arcsec":-3,"sigma_arcsec":2,'
    b'"camera":"guide"}'
)
SEEN_OFFSET = SeenOffset("2026-10-02T13:05:24.5Z", 12.5, -3.0, 2.0, "guide")
BAD = (
    OFFSET.replace(b"12.5", b"NaN"),
    OFFSET.replace(b"12.5", b"1e6"),
    OFFSET.replace(b":2,", b":0,"),
    OFFSET.replace(b'"dy_arcsec":-3,', b""),
    OFFSET.replace(b'"camera"', b'"what":"along_s","camera"'),
    OFFSET.replace(b"24.5Z", b"24.5"),
    OFFSET.replace(b"dx_arcsec", b"dx_px"),
    OFFSET.replace(b'"camera"', b'"dx_px":1,"camera"'),
    OFFSET.replace(b'"camera"', b'"rotation_deg":361,"camera"'),
    OFFSET.replace(b'"camera"', b'"scale_arcsec_px":0,"camera"'),
    OFFSET.replace(b'"camera"', b'"flipped":1,"camera"'),
    OFFSET.replace(b"_arcsec", b"_px").replace(b":2,", b":NaN,"),
    b'{"type":"offset","what":"along_s","how":"add","value":0.5}',
    b"garbage",
    b"\x00\xff\xfe",
    b"[" * 100_000,
    b"{" * 5000,
    b"null",
    b'{"type":"stop"}',
    b'{"type":"nudge","along_s":1}',
    GOOD.replace(b"10.5", b"NaN"),
    GOOD.replace(b"10.5", b"1e400"),
    GOOD.replace(b"10.5", b"-1"),
    GOOD.replace(b"10.5", b'"10.5"'),
    GOOD.replace(b"-3.25", b"90.001"),
    GOOD.replace(b"icrs", b"b1950"),
    GOOD.replace(b"20}", b"0}"),
    GOOD.replace(b"20}", b"-20}"),
    GOOD.replace(b"20}", b"1e9}"),
    GOOD.replace(b"24.5Z", b"24.5"),
    GOOD.replace(b"24.5Z", b"24.5+01:00"),
    GOOD.replace(b"2026-10-02", b"2026-13-45"),
    GOOD.replace(b'"frame":"icrs",', b""),
    GOOD.replace(b'"frame"', b'"extra":1,"frame"'),
    GOOD[:40],
)


@pytest.fixture
def pipe() -> Iterator[tuple[int, int]]:
    reading, writing = os.pipe()
    yield reading, writing
    for descriptor in (reading, writing):
        try:
            os.close(descriptor)
        except OSError:
            continue


def held(*lines: bytes) -> Observers:
    observers = Observers()
    for line in lines:
        observers.put(line)
    return observers


def test_an_observation_is_read_with_or_without_its_type() -> None:
    observers = held(GOOD, GOOD.replace(b'"type":"observation",', b""), b"", b"  \r")
    assert observers.observations() == [SEEN, SEEN]
    assert observers.malformed == 0


def test_an_offset_that_a_camera_saw_comes_with_observations_and_one_that_is_ordered_does_not(
    pipe: tuple[int, int],
) -> None:
    observers = held(OFFSET, OFFSET.replace(b',"camera":"guide"', b""))
    assert observers.observations() == [SEEN_OFFSET, msgspec.structs.replace(SEEN_OFFSET, camera=None)]
    inbox = StdinInbox(observers, pipe[0])
    ordered = b'{"type":"offset","what":"along_s","how":"add","value":0.5}'
    os.write(pipe[1], OFFSET + b"\n" + ordered + b"\n")
    assert inbox.messages() == [OffsetBy("along_s", "add", 0.5)]
    assert observers.observations() == [SEEN_OFFSET]
    assert decode_message(encode_message(SEEN_OFFSET)) == SEEN_OFFSET


@pytest.mark.parametrize("name", ["field", "fix", "offset", "observation"])
def test_a_camera_may_be_called_as_a_message_is(name: str) -> None:
    seen = (
        msgspec.structs.replace(SEEN_OFFSET, camera=name),
        msgspec.structs.replace(SEEN, camera=name),
        SolvedField(SEEN.utc, 10.5, -3.25, 2.0, name),
    )
    lines = [encode_message(one) for one in seen]
    assert tuple(held(*lines).observations(3)) == seen
    assert tuple(decode_message(line) for line in lines) == seen


@pytest.mark.parametrize("line", BAD, ids=lambda line: line[:30].decode("latin-1"))
def test_a_line_that_is_none_is_counted_and_nothing_else(line: bytes) -> None:
    assert line != GOOD
    observers = held(GOOD, line, GOOD)
    assert observers.observations() == [SEEN, SEEN]
    assert observers.malformed == 1
    assert observers.complaint


def test_a_stream_that_ends_is_held_whole_however_long_it_is() -> None:
    observers = read_all([GOOD, b"none"] * 3000)
    assert observers.everything() == [SEEN] * 3000
    assert (observers.malformed, observers.dropped) == (3000, 0)


def test_an_unknown_frame_is_named() -> None:
    observers = held(GOOD.replace(b"icrs", b"b1950"))
    assert observers.observations() == []
    assert observers.complaint == "frame 'b1950' is not known: give one of icrs, j2000, of_date"


def test_a_burst_is_used_up_a_few_at_a_time_and_what_is_too_much_is_dropped() -> None:
    observers = held(*[GOOD] * 1000)
    turns = [len(observers.observations()) for _ in range(501)]
    assert turns == [2] * 500 + [0]
    observers = held(*[GOOD] * (QUEUED_MOST + 7))
    assert observers.dropped == 7


def test_a_flood_of_garbage_takes_no_turn_for_itself() -> None:
    observers = held(*[b"x"] * 1000, GOOD)
    turns = [len(observers.observations()) for _ in range(11)]
    assert sum(turns) == 1
    assert observers.malformed == 1000


def test_udp_takes_lines_from_this_machine_a_bounded_number_a_turn() -> None:
    port = free_port()
    observers = open_observers(f"udp:{port}")
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.sendto(GOOD, ("127.0.0.1", port))
            sender.sendto(GOOD + b"\n" + GOOD + b"\n", ("127.0.0.1", port))
            assert len(observers.observations(10)) == 3
            for _ in range(2000):
                sender.sendto(GOOD, ("127.0.0.1", port))
        taken = [len(observers.observations(1000)) for _ in range(60)]
        assert max(taken) <= DATAGRAMS_A_TICK
        assert 0 < sum(taken) < 2000, "the system drops what finds no room"
        with pytest.raises(SattrackError, match=f"UDP port {port} of 127.0.0.1 is not available"):
            open_observers(f"udp:{port}")
    finally:
        observers.close()


@pytest.mark.parametrize("text", ["udp:", "udp:0", "udp:65536", "udp:-1", "tcp:15000", "", "-", "udp:²"])
def test_a_source_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(BadInputError, match=r"write udp:PORT or stdin"):
        open_observers(text)


def test_the_end_of_observations_on_standard_input_means_nothing(pipe: tuple[int, int]) -> None:
    observers = Observers([LineReader(pipe[0])])
    os.write(pipe[1], GOOD + b"\n" + GOOD[:30])
    assert observers.observations() == [SEEN]
    os.write(pipe[1], GOOD[30:] + b"\n")
    os.close(pipe[1])
    assert observers.observations() == [SEEN]
    for _ in range(3):
        assert observers.observations() == []


def test_orders_are_obeyed_a_few_at_a_time_but_a_stop_at_once(pipe: tuple[int, int]) -> None:
    inbox = StdinInbox(Observers(), pipe[0])
    os.write(pipe[1], b'{"type":"nudge","along_s":0.5}\n' * 50)
    assert [len(inbox.messages()) for _ in range(4)] == [20, 20, 10, 0]
    os.write(pipe[1], b'{"type":"nudge","along_s":0.5}\n' * 50 + b'{"type":"stop"}\n')
    assert inbox.messages()[20:] == [StopNow()]


def test_orders_overtake_observations_on_the_control_channel(pipe: tuple[int, int]) -> None:
    observers = Observers()
    inbox = StdinInbox(observers, pipe[0])
    os.write(pipe[1], (GOOD + b"\n") * 100 + b'{"type":"nudge","along_s":0.5}\nnonsense\n')
    assert inbox.messages() == [Nudge(along_s=0.5)]
    assert inbox.malformed == 1
    assert len(observers.observations()) == 2
    os.close(pipe[1])
    assert inbox.messages() == [StopNow()]
