"""One slew between this client and the simulated mount in virtual time: who raises what, and when.

Both loops run at 20 Hz with a constant delay each way, long enough for statuses older than the request to
arrive after it. How long the mount moves is left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from sattrack.mount.model import MountProfile, Slew, Stance
from sattrack.mount.simulator.mount import SimulatedMount, SimulatedSite, StartPosition
from sattrack.mount.xerxes.datagrams import decode_command, decode_status
from sattrack.mount.xerxes.flags import SlewState
from sattrack.mount.xerxes.session import Session
from sattrack.safety import Safety, SafetyLimits
from tools.protocol import svg

PERIOD_S = 0.05
DELAY_S = 0.035
MOUNT_PHASE_S = 0.020
"""How long after our loop the mount's runs."""
START_UTC_S = 1_790_000_000.0
WARM_UP = 10
SHOWN = 7
LONGEST = 2000
SITE = SimulatedSite(52.0, 4.5, 0.0)
SLEW_DEG = 4.0


class Turn(NamedTuple):
    """What is so after one turn of both loops; the number counts from the datagram that raises the flag."""

    number: int
    flag_sent: bool
    client_state: SlewState
    mount_slewing: bool
    mount_ack: bool
    """In the status packed in this turn."""
    heard: int
    """Number of the turn in which the newest status that the client has when it composes was packed."""
    heard_slewing: bool
    heard_ack: bool
    ticket: str

    @property
    def stale(self) -> bool:
        """Whether the client has a status without Slewing in hand though it has asked for a slew."""
        return not self.heard_slewing and self.client_state is SlewState.ASKED


@dataclass
class _Wires:
    """Datagrams under way to one end: when they arrive, the turn in which they were sent, their bytes."""

    under_way: list[tuple[float, int, bytes]]

    def arrived(self, now_s: float) -> list[tuple[float, int, bytes]]:
        done = [item for item in self.under_way if item[0] <= now_s]
        self.under_way = [item for item in self.under_way if item[0] > now_s]
        return done


def run() -> list[Turn]:
    """Return every turn of a slew, from the last before it to the first after it is seen to end."""
    profile = MountProfile()
    session, mount = Session(profile), SimulatedMount(profile, SITE, StartPosition(-30.0, 20.0))
    safety = Safety(profile, SafetyLimits(optical=False), SITE.latitude_deg)
    up, down, turns = _Wires([]), _Wires([]), []
    newest, ticket = -WARM_UP, None
    for number in range(-WARM_UP, LONGEST):
        send_s = START_UTC_S + number * PERIOD_S
        for arrival_s, sent_in, data in down.arrived(send_s):
            session.receive(data, arrival_s)
            newest = sent_in
        if number == 0 and session.sample is not None:
            sample = session.sample
            stance = Stance(sample.sidereal_h * 15.0, sample.ra_deg, sample.dec_deg, sample.slewing, False)
            cleared = safety.clear_request(Slew(sample.ra_deg + SLEW_DEG, sample.dec_deg), stance)
            if isinstance(cleared, str):
                raise AssertionError(cleared)
            ticket = session.submit(cleared)
        command = session.compose()
        up.under_way.append((send_s + DELAY_S, number, command))
        loop_s = send_s + MOUNT_PHASE_S
        for _, _, data in up.arrived(loop_s):
            mount.receive(data)
        packed = mount.tick(loop_s)[0]
        down.under_way.append((loop_s + DELAY_S, number, packed))
        status, heard = decode_status(packed), session.status
        turn = Turn(
            number,
            decode_command(command).slew,
            session.slew_state,
            status.slewing,
            status.ack_slew,
            newest,
            heard is not None and heard.slewing,
            heard is not None and heard.ack_slew,
            "" if ticket is None else ticket.state.value,
        )
        if number >= -1:
            turns.append(turn)
        if turn.client_state is SlewState.DONE:
            return turns
    raise AssertionError("the slew did not end")


def _shown(turns: list[Turn]) -> tuple[list[Turn], list[Turn]]:
    """Return the turns at the beginning and those at the end, without what lies between."""
    last = next(i for i in range(len(turns) - 1, 0, -1) if turns[i].mount_slewing)
    return turns[: SHOWN + 1], turns[last:]


def slew_table(turns: list[Turn]) -> str:
    """Return the slew as Markdown; at its end, turns are counted from the last in which the mount moves."""
    begin, end = _shown(turns)
    lines = [
        f"Periods of {PERIOD_S * 1000:.0f} ms; the mount's loop runs {MOUNT_PHASE_S * 1000:.0f} ms after "
        f"ours, and a datagram takes {DELAY_S * 1000:.0f} ms either way.",
        "",
        "| turn | we send | mount: Slewing | mount: ack | our newest status is of turn | it says | "
        "our view | ticket |",
        "|---:|---|---|---|---:|---|---|---|",
    ]
    lines += [_row(turn, str(turn.number), str(turn.heard)) for turn in begin]
    lines.append("| … | | **true** | | | slewing | under way | |")
    for turn in end:
        number, heard = turn.number - end[0].number, turn.heard - end[0].number
        lines.append(_row(turn, f"e{number:+d}" if number else "e", f"e{heard:+d}" if heard else "e"))
    return "\n".join(lines)


def _row(turn: Turn, number: str, heard: str) -> str:
    says = "slewing" if turn.heard_slewing else "not slewing"
    says += ", ack" if turn.heard_ack else ""
    says += " (**stale**)" if turn.stale else ""
    cells = (
        number,
        "slew **up**" if turn.flag_sent else "",
        "**true**" if turn.mount_slewing else "false",
        "**up**" if turn.mount_ack else "",
        heard,
        says,
        turn.client_state.value,
        turn.ticket,
    )
    return "| " + " | ".join(cells) + " |"


LEFT, COLUMN, LANE = 236.0, 62.0, 54.0
HIGH, LOW = 14.0, 34.0
LANES = (
    ("SlewToTargetCmd, as we send it", "flag_sent", "#1b6ca8"),
    ("AckSlewCmd, as the mount packs it", "mount_ack", "#b4500f"),
    ("Slewing, as the mount packs it", "mount_slewing", "#3f7d20"),
    ("AckSlewCmd, as we have it", "heard_ack", "#b4500f"),
    ("Slewing, as we have it", "heard_slewing", "#3f7d20"),
)


def draw(turns: list[Turn]) -> str:
    """Return the slew as a time diagram, SVG."""
    begin, end = _shown(turns)
    columns: list[Turn | None] = [*begin, None, *end]
    parts = []
    top = 46.0
    bottom = top + LANE * len(LANES)
    for i, turn in enumerate(columns):
        x = LEFT + i * COLUMN
        parts.append(svg.line([(x, top - 8), (x, bottom)], "#d9dee4", 1))
        words = "…" if turn is None else str(turn.number)
        if turn is not None and i > len(begin):
            words = f"e{turn.number - end[0].number:+d}" if turn is not end[0] else "e"
        parts.append(svg.text(x + COLUMN / 2, top - 16, words, 12))
        if turn is not None and turn.stale:
            y = top + LANE * (len(LANES) - 1)
            parts.append(
                f'<rect x="{x:g}" y="{y + HIGH - 6:g}" width="{COLUMN:g}" '
                f'height="{LOW - HIGH + 14:g}" fill="#fde8d0"/>'
            )
            parts.append(svg.text(x + COLUMN / 2, y + 25, "stale", 11))
    parts.append(svg.text(LEFT - 12, top - 16, "turn", 12, "end"))
    for lane, (words, name, colour) in enumerate(LANES):
        y = top + lane * LANE
        parts.append(svg.text(LEFT - 12, y + 28, words, 12, "end"))
        parts.append(svg.line(_wave(columns, name, y, len(begin)), colour, 2.5))
    views = [turn.client_state.value if turn is not None else "" for turn in columns]
    y = bottom + 22
    parts.append(svg.text(LEFT - 12, y, "our view of the slew", 12, "end"))
    i = 0
    while i < len(views):
        j = i
        while j + 1 < len(views) and (views[j + 1] == views[i] or not views[j + 1]):
            j += 1
        parts.append(svg.text(LEFT + (i + j + 1) * COLUMN / 2, y, views[i], 12))
        if i:
            parts.append(svg.line([(LEFT + i * COLUMN, y - 14), (LEFT + i * COLUMN, y + 6)], svg.FAINT, 1))
        i = j + 1
    return svg.picture(LEFT + COLUMN * len(columns) + 16, y + 22, "One slew, turn by turn", parts)


def _wave(columns: list[Turn | None], name: str, y: float, gap: int) -> list[tuple[float, float]]:
    points: list[tuple[float, float]] = []
    for i, turn in enumerate(columns):
        shown = columns[gap - 1] if turn is None else turn
        level = y + (HIGH if getattr(shown, name) else LOW)
        points += [(LEFT + i * COLUMN, level), (LEFT + (i + 1) * COLUMN, level)]
    return points
