"""Lines between processes: cut as they come, bounded both ways, and nobody waits."""

from __future__ import annotations

import os
import socket
from typing import TYPE_CHECKING

import msgspec
import pytest

from sattrack.core.channel import Channel

if TYPE_CHECKING:
    from collections.abc import Iterator

Ends = tuple[Channel, socket.socket]


@pytest.fixture
def ends() -> Iterator[Ends]:
    ours, theirs = socket.socketpair()
    channel = Channel(ours.detach(), longest=10, most_waiting=1 << 22)
    with theirs:
        yield channel, theirs
    channel.close()


def test_lines_come_whole_however_they_are_cut_on_the_way(ends: Ends) -> None:
    channel, other = ends
    other.send(b"one\ntw")
    assert channel.lines() == [b"one"]
    assert channel.lines() == ()
    other.send(b"o\n\nthree")
    assert channel.lines() == [b"two", b""]
    other.close()
    assert channel.lines() == []
    assert channel.ended


def test_a_line_that_is_too_long_is_dropped_and_noted(ends: Ends) -> None:
    channel, other = ends
    other.send(b"0123456789\n")
    assert channel.lines() == [b"0123456789"]
    assert not channel.overlong
    other.send(b"0123456789a\nnext\n")
    assert channel.lines() == [b"next"]
    assert channel.overlong


def test_a_line_that_never_ends_takes_no_more_room_than_one_may(ends: Ends) -> None:
    channel, other = ends
    for _ in range(100):
        other.send(b"0123456789a")
        assert channel.lines() == []
    assert channel.overlong
    other.send(b"\nnext\n")
    assert channel.lines()[-1] == b"next"


def test_a_reader_that_does_not_keep_up_is_not_waited_for_and_given_up(ends: Ends) -> None:
    channel, other = ends
    line = b"x" * (1 << 20) + b"\n"
    channel.send(line)
    assert channel.waiting
    received = 0
    while channel.waiting:
        received += len(other.recv(1 << 16))
        channel.flush()
    while received < len(line):
        received += len(other.recv(1 << 16))
    assert received == len(line)
    for _ in range(8):
        assert not channel.ended
        channel.send(line)
        if channel.ended:
            break
    assert channel.ended


def test_a_reader_that_is_gone_ends_the_channel(ends: Ends) -> None:
    channel, other = ends
    other.close()
    channel.send(b"one\n")
    assert channel.ended


def test_the_first_lines_are_waited_for_but_not_for_ever(ends: Ends) -> None:
    channel, other = ends
    assert channel.first(0.0) == ()
    assert not channel.ended
    other.send(b"1\n")
    assert channel.first(10.0) == [b"1"]
    other.close()
    assert channel.first(10.0) == []
    assert channel.ended
    assert channel.first(10.0) == ()


def test_a_pair_of_pipes_is_a_channel_and_messages_have_their_type() -> None:
    (reads, there), (here, writes) = os.pipe(), os.pipe()
    channel = Channel(reads, writes)
    os.write(there, b"1\n2\n")
    assert channel.messages(msgspec.json.Decoder(int)) == [1, 2]
    channel.send(b"3\n")
    assert os.read(here, 10) == b"3\n"
    os.write(there, b"four\n")
    with pytest.raises(msgspec.MsgspecError):
        channel.messages(msgspec.json.Decoder(int))
    channel.close()
    os.close(there)
    os.close(here)


def test_a_closed_channel_touches_no_descriptor_that_has_its_number_since(ends: Ends) -> None:
    channel, other = ends
    channel.close()
    again = os.pipe()
    channel.close()
    channel.send(b"one\n")
    assert channel.lines() == ()
    assert channel.fileno() == -1
    os.write(again[1], b"x")
    assert os.read(again[0], 10) == b"x"
    assert other.recv(10) == b""
    for descriptor in again:
        os.close(descriptor)
