"""Numbers that the document tells: both readings of one field, rates in both units, the client's patience."""

from __future__ import annotations

import struct

from sattrack.mount.model import DTICS_S_PER_DEG_S, SIDEREAL_RATE_DEG_S, STATUS_LOST_S, TICS_PER_TURN
from sattrack.mount.xerxes import flags, link, session, standstill, tickets
from sattrack.mount.xerxes.datagrams import reading_of

PERIOD_S = 0.05
SAMPLES = (
    ("q", 7789),
    ("d", 7789.0),
    ("q", -120),
    ("d", -120.0),
    ("q", 1),
    ("d", 1.0),
    ("d", -1e-4),
    ("q", 0),
)
SECONDS_PER_YEAR = 86400.0 * 365.25


def hex_bytes(data: bytes) -> str:
    """Return bytes as two hexadecimal digits each, apart."""
    return data.hex(" ").upper()


def readings_table() -> str:
    """Return eight-byte patterns by both readings, and which of the two is taken."""
    lines = [
        "| sent | bytes | as int64 | as double | taken for |",
        "|---|---|---:|---:|---|",
    ]
    for code, value in SAMPLES:
        raw = struct.pack("<" + code, value)
        whole, real = struct.unpack("<q", raw)[0], struct.unpack("<d", raw)[0]
        kind = "int64" if code == "q" else "double"
        taken = reading_of(raw) or "either, it is the same"
        lines.append(f"| {kind} {value:g} | `{hex_bytes(raw)}` | {whole} | {real:.6g} | {taken} |")
    years = 2**53 * PERIOD_S / SECONDS_PER_YEAR
    least = struct.unpack("<d", struct.pack("<q", 2**53))[0]
    return "\n".join(lines) + (
        f"\n\nThe border is 2^53 = {2**53}: up to there every integer is a double too. A counter\ngets there "
        f"after {years / 1e6:.0f} million years, and no double between 0 and {least:.2g} is any rate."
    )


def rates_table() -> str:
    """Return what rates are in both units."""
    rows = (
        ("one tenth of a tic a second", 1.0),
        ("guide rate of the paper", 3500.0),
        ("sidereal, the paper's figure", 7789.0),
        ("sidereal, 360° in 86164.0905 s", SIDEREAL_RATE_DEG_S * DTICS_S_PER_DEG_S),
        ("1 °/s", DTICS_S_PER_DEG_S),
    )
    lines = ["| rate | tics/s × 10 | °/s | ″/s | of sidereal |", "|---|---:|---:|---:|---:|"]
    for name, dtics_s in rows:
        deg_s = dtics_s / DTICS_S_PER_DEG_S
        share = deg_s / SIDEREAL_RATE_DEG_S
        lines.append(f"| {name} | {dtics_s:.6g} | {deg_s:.6g} | {deg_s * 3600.0:.5g} | {share:.4g} |")
    return "\n".join(lines) + f"\n\nOne tic of the {TICS_PER_TURN} is {360.0 * 3600.0 / TICS_PER_TURN:.4f}″."


def patience_table() -> str:
    """Return how long this client waits for what, from the modules that wait."""
    datagrams = (
        (session.QUIET_TICKS, "without any flag between two one-shot requests"),
        (tickets.ACK_AT_MOST, "for the acknowledgement of a sync or pulse guide"),
        (tickets.UNCONFIRMED_AFTER, "for which a flag without an acknowledgement is sent"),
        (tickets.ACK_WITHIN, "for the acknowledgement of a motion"),
        (link.DOUBLED_WITHIN, "in which an acknowledgement that rises again means a doubled edge"),
    )
    statuses = (
        (flags.QUIET_STATUSES, "without an acknowledgement: none is on its way any more"),
        (flags.ACK_WITHIN_STATUSES, "without one while a slew's flag is up: it falls, and rises again"),
        (flags.EDGE_ACK_WITHIN_STATUSES, "the same for an edge of MoveAxis"),
        (
            flags.MUTE_ACK_WITHIN_STATUSES,
            f"the same, and then for quiet, once the first {flags.MUTE_AFTER} edges went without one",
        ),
        (
            flags.MISSED_TICKS,
            "without one in a stop: the abort's flag falls for 3, then rises for twice as long as before",
        ),
        (
            flags.STILL_MOVING_STATUSES,
            "with Slewing after the end of a MoveAxis: that is asked for anew, "
            f"and after {flags.VAIN_ENDS} times an abort",
        ),
        (flags.NEVER_SEEN_AFTER, "after its acknowledgement without Slewing: a slew too short to be seen"),
        (tickets.SHOWN_WITHIN, "in which what was acknowledged must show"),
        (link.RESTART_PROOF, "in a row of another, rising count: the mount has restarted"),
        (link.TRUSTED_JUMP, "that a counter may run ahead without being taken for nonsense"),
    )
    times_s = (
        (tickets.QUEUED_AT_MOST_S, "for which a request may wait for its turn"),
        (tickets.STARTED_WITHIN_S, "for which a slew may wait for standstill"),
        (
            tickets.SLEW_WITHIN_S,
            "for a slew to end; for a slow mount half as long again as a turn takes at its `slew_rate_deg_s`",
        ),
        (tickets.REST_WITHIN_S, "for the mount to come to rest"),
        (standstill.WINDOWS_S[0], "of positions that show rest: the mount is at rest"),
        (standstill.CONTRADICTED_S, "in which positions contradict a field: it is not used"),
        (link.STALE_AFTER_S, "without a status: the link is stale"),
        (STATUS_LOST_S, "without a status: the link is lost"),
    )
    lines = ["| how many | seconds | of what |", "|---:|---:|---|"]
    lines += [f"| {n} datagrams | {n * PERIOD_S:g} | {words} |" for n, words in datagrams]
    lines += [f"| {n} statuses | {n * PERIOD_S:g} | {words} |" for n, words in statuses]
    lines += [f"| | {seconds:g} | {words} |" for seconds, words in times_s]
    return "\n".join(lines)
