"""What a schedule has done before and after a pass, and whom it asks about the weather, as its file says."""

from __future__ import annotations

import math
from typing import Literal
from urllib.parse import urlsplit

import msgspec

from sattrack.core.origin import meant
from sattrack.schedule.stars import STARS, find_star

LONGEST_S = 86_400.0
OnFailure = Literal["go_on", "skip"]


class SlewAction(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="do", tag="slew"):
    """Slew to a star by name, to a fixed place among the stars (ICRS), or to an altitude and azimuth; wait.

    Degrees, azimuth from north through east. Raises ValueError for none of the three, or more than one.
    """

    star: str | None = None
    ra_deg: float | None = None
    dec_deg: float | None = None
    alt_deg: float | None = None
    az_deg: float | None = None
    wait_s: float = 0.0

    def __post_init__(self) -> None:
        """Check the direction and the wait."""
        given = [self.star is not None, self._pair("ra_deg", "dec_deg"), self._pair("alt_deg", "az_deg")]
        if sum(given) != 1:
            raise ValueError("give one of star, ra_deg with dec_deg, or alt_deg with az_deg to slew to")
        if self.star is not None and find_star(self.star) is None:
            hint = meant(self.star, STARS) or "; give ra_deg and dec_deg"
            raise ValueError(f"star is {self.star!r}; that one is not known{hint}")
        between("ra_deg", self.ra_deg, 0.0, 360.0)
        between("dec_deg", self.dec_deg, -90.0, 90.0)
        between("alt_deg", self.alt_deg, 0.0, 90.0)
        between("az_deg", self.az_deg, -360.0, 360.0)
        between("wait_s", self.wait_s, 0.0, LONGEST_S)

    def _pair(self, one: str, other: str) -> bool:
        there = [getattr(self, name) is not None for name in (one, other)]
        if any(there) and not all(there):
            raise ValueError(f"{one} and {other} go together; one is missing")
        return all(there)

    @property
    def words(self) -> str:
        """Say it in a few words."""
        if self.star is not None:
            place = self.star
        elif self.ra_deg is not None:
            place = f"RA {self.ra_deg:g}° Dec {self.dec_deg:g}°"
        else:
            place = f"alt {self.alt_deg:g}° az {self.az_deg:g}°"
        return f"slew to {place}" + (f", wait {self.wait_s:g} s" if self.wait_s else "")


class SearchAction(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="do", tag="search"):
    """Search about the satellite once it is followed: a spiral, or a sweep along the track.

    As in a run: `spacing_deg` and `speed_deg_s` of a spiral, `reach_s` and `period_s` of a sweep; for
    `seconds`, then back to the centre. Raises ValueError.
    """

    how: Literal["spiral", "sweep"]
    spacing_deg: float | None = None
    speed_deg_s: float | None = None
    reach_s: float | None = None
    period_s: float | None = None
    seconds: float = 60.0

    def __post_init__(self) -> None:
        """Check that what the pattern needs is there, and nothing else."""
        needs = {"spiral": ("spacing_deg", "speed_deg_s"), "sweep": ("reach_s", "period_s")}
        for how, names in needs.items():
            for name in names:
                value = getattr(self, name)
                if (value is not None) != (how == self.how):
                    there = (
                        "is missing; it goes with" if value is None else f"is {value:g}; it does not go with"
                    )
                    raise ValueError(f"{name} {there} a {self.how}")
                if value is not None and not (math.isfinite(value) and value > 0.0):
                    raise ValueError(f"{name} is {value:g}; it must be above 0")
        between("seconds", self.seconds, 1.0, LONGEST_S)

    @property
    def words(self) -> str:
        """Say it in a few words."""
        return f"search by a {self.how} for {self.seconds:g} s"


class CommandAction(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="do", tag="command"):
    """Run a program, without a shell, with the pass' facts in its environment.

    With `wait` the schedule waits for its end, `timeout_s` at most, then ends it. Raises ValueError.
    """

    run: tuple[str, ...]
    timeout_s: float = 30.0
    wait: bool = True
    if_it_fails: OnFailure = "go_on"

    def __post_init__(self) -> None:
        """Check that there is a program, and for how long."""
        if not self.run or not self.run[0].strip():
            raise ValueError('run is empty; give the program and its arguments, as ["./dome", "open"]')
        between("timeout_s", self.timeout_s, 0.1, LONGEST_S)

    @property
    def words(self) -> str:
        """Say it in a few words."""
        return f"run {' '.join(self.run)}" + (
            f", {self.timeout_s:g} s at most" if self.wait else ", not waited for"
        )


class WebhookAction(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="do", tag="webhook"):
    """Post the pass' facts as JSON to an address; nobody waits for it. Raises ValueError."""

    url: str
    timeout_s: float = 10.0

    def __post_init__(self) -> None:
        """Check the address."""
        check_http("url", self.url)
        between("timeout_s", self.timeout_s, 0.1, LONGEST_S)

    @property
    def words(self) -> str:
        """Say it in a few words."""
        return f"post to {urlsplit(self.url).hostname}"


Action = SlewAction | SearchAction | CommandAction | WebhookAction


class Weather(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Who tells whether the weather is safe: one of a file, a command, an Alpaca SafetyMonitor.

    The file's first word is `safe` or `unsafe`, and it is no older than `oldest_s`; the command ends with 0
    where it is safe, within `timeout_s`; the monitor is `alpaca://HOST:PORT/DEVICE`. What cannot be asked is
    unsafe. Raises ValueError.
    """

    file: str | None = None
    command: tuple[str, ...] | None = None
    alpaca: str | None = None
    every_s: float = 30.0
    timeout_s: float = 10.0
    oldest_s: float = 300.0

    def __post_init__(self) -> None:
        """Check that there is one source, and its form."""
        if sum(one is not None for one in (self.file, self.command, self.alpaca)) != 1:
            raise ValueError("give one of file, command and alpaca to ask about the weather")
        if self.command is not None and not (self.command and self.command[0].strip()):
            raise ValueError('command is empty; give the program and its arguments, as ["./weather"]')
        if self.alpaca is not None:
            _check_alpaca(self.alpaca)
        for name in ("every_s", "timeout_s", "oldest_s"):
            between(name, getattr(self, name), 0.1, LONGEST_S)

    @property
    def words(self) -> str:
        """Say who is asked."""
        if self.file is not None:
            return f"the file {self.file}"
        return " ".join(self.command) if self.command is not None else str(self.alpaca)


NOTICES = ("pass", "lost", "trouble", "morning")
Notice = Literal["pass", "lost", "trouble", "morning"]


class Notify(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Who is told of what: a program that is run, or an address to which JSON is posted.

    `on`: "pass" (one was followed), "lost" (one was not), "trouble" (whatever else is worth telling),
    "morning" (the night's summary). Nobody waits for it. Raises ValueError.
    """

    run: tuple[str, ...] | None = None
    url: str | None = None
    on: tuple[Notice, ...] = ("lost", "trouble", "morning")
    timeout_s: float = 30.0

    def __post_init__(self) -> None:
        """Check that there is one of the two."""
        if (self.run is None) == (self.url is None):
            raise ValueError("give one of run and url to notify by")
        if self.run is not None and not (self.run and self.run[0].strip()):
            raise ValueError('run is empty; give the program and its arguments, as ["./tell-me"]')
        if self.url is not None:
            check_http("url", self.url)
        between("timeout_s", self.timeout_s, 0.1, LONGEST_S)


class Wake(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The program that gives the drives their power back after they were parked; done when it ends with 0."""

    run: tuple[str, ...]
    timeout_s: float = 60.0

    def __post_init__(self) -> None:
        """Check that there is a program, and for how long."""
        if not self.run or not self.run[0].strip():
            raise ValueError('run is empty; give the program and its arguments, as ["./power", "on"]')
        between("timeout_s", self.timeout_s, 0.1, 3600.0)


class Recordings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How long recordings are kept: so many days, and so much of the disk free. Raises ValueError."""

    keep_days: float | None = None
    keep_free_gb: float | None = None

    def __post_init__(self) -> None:
        """Check the numbers."""
        between("keep_days", self.keep_days, 1.0, 36_500.0)
        between("keep_free_gb", self.keep_free_gb, 0.0, 1e6)


def _check_alpaca(address: str) -> None:
    try:
        parts = urlsplit(address)
        good = parts.scheme == "alpaca" and parts.hostname and parts.port and parts.path[1:].isdecimal()
    except ValueError:
        good = False
    if not good:
        raise ValueError(
            f"alpaca is {address!r}; write alpaca://HOST:PORT/DEVICE, as alpaca://192.0.2.7:11111/0"
        )


def check_http(name: str, url: str) -> None:
    """Raise ValueError where a text is no http address, or holds a password."""
    try:
        parts = urlsplit(url)
        host, _ = parts.hostname, parts.port
    except ValueError:
        host, parts = None, urlsplit("")
    if parts.scheme not in ("http", "https") or not host:
        raise ValueError(f"{name} is {url!r}; write https://HOST/PATH")
    if parts.username is not None or parts.password is not None:
        # Not shown again: it holds a password.
        raise ValueError(f"{name} is an address with a name or password; others can read schedules")


def between(name: str, value: float | None, low: float, high: float) -> None:
    """Raise ValueError where a number is outside its bounds; None is inside."""
    if value is not None and not low <= value <= high:
        raise ValueError(f"{name} is {value:g}; give {low:g} to {high:g}")
