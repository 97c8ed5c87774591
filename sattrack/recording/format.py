"""The recording's layout: an MCAP file with one channel for each kind of input and output.

Instants are UTC. MCAP counts them in integer nanoseconds of POSIX time, which is finer than the floats that
the run computes with, so every instant comes back as the same float.
"""

from __future__ import annotations

import msgspec

from sattrack.recording.environment import Environment

FORMAT_VERSION = 3
"""1: datagrams, messages, views. 2: datagrams sent once more. 3: what made it, failures, the summary."""
PROFILE = "sattrack"

RUN = "run"
STATUS = "status"
COMMAND = "command"
REPEAT = "repeat"
OPERATOR = "operator"
FAILURE = "failure"
VIEW = "view"
SUMMARY = "summary"
CHANNELS = {
    RUN: "json",
    STATUS: "xerxes-status",
    COMMAND: "xerxes-command",
    REPEAT: "xerxes-command",
    OPERATOR: "json",
    VIEW: "json",
    FAILURE: "json",
    SUMMARY: "json",
}


class RunHeader(msgspec.Struct, frozen=True):
    """The first message: everything that makes the run besides its inputs."""

    format_version: int
    program_version: str
    spec: msgspec.Raw
    """The run's own facts, see `sattrack.runtime.facts.RunFacts`."""
    fingerprint: str | None = None
    """Of the code that made the run; None before format 3."""
    environment: Environment | None = None
    anonymous: bool = False
    """Whether site and time are not where and when it was."""


class Failure(msgspec.Struct, frozen=True):
    """What broke outside what the engine computes, and turned the run into a stop."""

    words: str


def to_ns(utc_s: float) -> int:
    """Return an instant as integer nanoseconds, exact to one."""
    whole = int(utc_s // 1.0)
    return whole * 1_000_000_000 + round((utc_s - whole) * 1e9)


def from_ns(ns: int) -> float:
    """Return the float that `to_ns` was given."""
    return ns / 1_000_000_000
