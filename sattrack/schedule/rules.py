"""Rules in words: "all of celestrak:visual, above 30°, sunlit, magnitude < 4, max 12".

rule      = what *("," condition)
what      = "all" ["of" SOURCE]              SOURCE as --elements takes it; without one, all elements
condition = "above" N ["°"]                  followed while so high
          | "culminates above" N ["°"]       only passes that get so high
          | "sunlit"                         only while the satellite sees the whole Sun: counts those seconds
          | "dark"                           the Sun 6° or more below the horizon at culmination
          | "sun below" N ["°"]              the same for any altitude of the Sun
          | "magnitude <" N                  only passes that get as bright
          | "rate <" N ["°/s"]               neither hour angle nor declination ever turns faster
          | "longer than" N ("s" | "min")    only passes with as many useful seconds
          | "named" GLOB                     only satellites whose names match
          | "designator" GLOB                only those whose international designator matches: 1998-067*
          | "launched" ["since" | "before"] YEAR   only those launched in, from or before a year
          | "once a" ("night" | "run")       each satellite once
          | "at most" N "an hour"            so many passes culminate within any 60 minutes, no more
          | "max" N                          no more than so many passes in the plan
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sattrack.core.errors import meant

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.core.errors import BadInputError, Origin

    _Take = Callable[[re.Match[str]], dict[str, Any]]

DARK_SUN_DEG = -6.0
_NUMBER = r"([+\-]?\d+(?:\.\d*)?|[+\-]?\.\d+)"
_DEG = r"\s*(?:°|deg|degrees)?"
_WORDS = ("above", "culminates above", "sunlit", "dark", "sun below", "magnitude <", "rate <", "longer than")
_ONCE = ("once a night", "once a run")
KNOWN = (*_WORDS, "named", "designator", "launched", *_ONCE, "at most", "max")
_BEGIN = ": begin with 'all' or 'all of SOURCE', as all of celestrak:visual"
_EXAMPLES = {
    "above": "above 30°",
    "culminates above": "culminates above 60°",
    "culminates": "culminates above 60°",
    "sunlit": "sunlit",
    "dark": "dark",
    "sun below": "sun below -12°",
    "sun": "sun below -12°",
    "magnitude <": "magnitude < 4",
    "magnitude": "magnitude < 4",
    "rate <": "rate < 1.5 °/s",
    "rate": "rate < 1.5 °/s",
    "longer than": "longer than 90 s",
    "longer": "longer than 90 s",
    "named": "named STARLINK*",
    "designator": "designator 1998-067*",
    "launched": "launched since 2024",
    "launched since": "launched since 2024",
    "launched before": "launched before 2000",
    "once": "once a night",
    "once a": "once a night",
    "once per": "once a night",
    "at": "at most 4 an hour",
    "at most": "at most 4 an hour",
    "max": "max 12",
}


@dataclass(frozen=True, slots=True)
class Conditions:
    """What passes must meet; degrees, seconds. None, and no text, for what is not asked."""

    above_deg: float | None = None
    culminates_deg: float | None = None
    sunlit: bool = False
    sun_below_deg: float | None = None
    brighter_than: float | None = None
    slower_than_deg_s: float | None = None
    longer_than_s: float | None = None
    named: str = ""
    most: int | None = None
    designator: str = ""
    launched_from: int | None = None
    launched_before: int | None = None
    once_a_night: bool = False
    once_a_run: bool = False
    most_an_hour: int | None = None


NO_CONDITIONS = Conditions()


@dataclass(frozen=True, slots=True)
class Rule:
    """A rule: whose passes (`source` None for all elements that are loaded), and which of them."""

    source: str | None
    conditions: Conditions


def parse_rule(text: str, origin: Origin) -> Rule:
    """Return the rule that a text says; `origin` is where its first character stands.

    Raises BadInputError.
    """
    parts = _parts(text)
    at, what = parts[0]
    match = re.fullmatch(r"all(?:\s+of\s+(\S(?:.*\S)?))?", what, re.IGNORECASE)
    if match is None:
        first = what.split()[0] if what.split() else ""
        hint = (meant(first, ["all"]) if first else "") or _BEGIN
        raise origin.moved(at).wrong(f"{what!r} begins no rule{hint}")
    return Rule(match.group(1), _conditions(parts[1:], origin))


def parse_conditions(text: str, origin: Origin) -> Conditions:
    """Return conditions alone, as `where` has them for satellites by name. Raises BadInputError."""
    return _conditions(_parts(text), origin)


def _parts(text: str) -> list[tuple[int, str]]:
    """Return what stands between commas, each with the column from 0 at which it begins."""
    parts, at = [], 0
    for piece in text.split(","):
        parts.append((at + len(piece) - len(piece.lstrip()), piece.strip()))
        at += len(piece) + 1
    return parts


def _conditions(parts: list[tuple[int, str]], origin: Origin) -> Conditions:
    found: dict[str, Any] = {}
    seen: set[str] = set()
    for at, words in parts:
        here = origin.moved(at)
        if not words:
            raise here.wrong("nothing stands between two commas, or after the last: take one away")
        for pattern, take in _GRAMMAR:
            match = re.fullmatch(pattern, words, re.IGNORECASE)
            if match is None:
                continue
            try:
                said = take(match)
                twice = next((_TWICE[name] for name in said if name in _TWICE and name in found), None)
                if twice is not None:
                    raise ValueError(twice)
            except ValueError as error:
                raise here.moved(match.start(1)).wrong(f"{words!r}: {error}") from None
            if pattern in seen:
                raise here.wrong(f"{words!r}: that is said twice; keep one")
            seen.add(pattern)
            found |= said
            break
        else:
            raise _unknown(words, here)
    return Conditions(**found)


def _unknown(words: str, here: Origin) -> BadInputError:
    """Return the error for what is no condition, with what was meant."""
    first = re.split(r"[\s<>=]", words, maxsplit=1)[0].lower()
    two = " ".join(words.lower().split()[:2])
    for known in (two, first):
        if known in _EXAMPLES:
            return here.wrong(f"{words!r} is not understood: write it as {_EXAMPLES[known]!r}")
    near = meant(first, [word.split()[0] for word in KNOWN]) or f"; there are {', '.join(KNOWN)}"
    return here.wrong(f"{words!r} is no condition{near}")


def _within(text: str, low: float, high: float, what: str) -> float:
    value = float(text)
    if not (math.isfinite(value) and low <= value <= high):
        raise ValueError(f"{what} go from {low:g} to {high:g}")
    return value


def _year(text: str) -> int:
    if not text.isdigit():
        raise ValueError("elements tell the year of launch alone: give a year, as launched since 2024")
    return int(_within(text, 1957.0, 2056.0, "years of launch"))


def _designator(text: str) -> str:
    if not re.match(r"\d{4}-|\d{0,4}[*?\[]", text):
        raise ValueError("a designator begins with the year of launch, as 1998-067A or 2024-*")
    return text


def _seconds(m: re.Match[str]) -> float:
    return (60.0 if m[2].lower().startswith("m") else 1.0) * _within(m[1], 0.0, 86400.0, "durations")


_TWICE = {
    "sun_below_deg": "the Sun's altitude is asked twice; keep one",
    "launched_from": "the launch is asked twice; keep one",
    "launched_before": "the launch is asked twice; keep one",
}
"""Fields that more than one form sets."""
_GRAMMAR: tuple[tuple[str, _Take], ...] = (
    (rf"above\s+{_NUMBER}{_DEG}", lambda m: {"above_deg": _within(m[1], -5.0, 89.0, "altitudes")}),
    (
        rf"culminates\s+above\s+{_NUMBER}{_DEG}",
        lambda m: {"culminates_deg": _within(m[1], -5.0, 90.0, "altitudes")},
    ),
    (r"(sunlit)", lambda _: {"sunlit": True}),
    (r"(dark)", lambda _: {"sun_below_deg": DARK_SUN_DEG}),
    (
        rf"sun\s+below\s+{_NUMBER}{_DEG}",
        lambda m: {"sun_below_deg": _within(m[1], -90.0, 90.0, "altitudes of the Sun")},
    ),
    (rf"magnitude\s*<\s*{_NUMBER}", lambda m: {"brighter_than": _within(m[1], -30.0, 30.0, "magnitudes")}),
    (
        rf"rate\s*<\s*{_NUMBER}\s*(?:°/s|deg/s)?",
        lambda m: {"slower_than_deg_s": _within(m[1], 1e-4, 1000.0, "rates in degrees a second")},
    ),
    (rf"longer\s+than\s+{_NUMBER}\s*(s|sec|seconds|min|minutes)", lambda m: {"longer_than_s": _seconds(m)}),
    (r"named\s+(\S(?:.*\S)?)", lambda m: {"named": m[1]}),
    (r"max\s+(\d+)", lambda m: {"most": int(_within(m[1], 1.0, 10_000.0, "numbers of passes"))}),
    (r"designator\s+(\S+)", lambda m: {"designator": _designator(m[1])}),
    (
        r"launched\s+(\d[\d-]*)",
        lambda m: {"launched_from": _year(m[1]), "launched_before": _year(m[1]) + 1},
    ),
    (r"launched\s+since\s+(\d[\d-]*)", lambda m: {"launched_from": _year(m[1])}),
    (r"launched\s+before\s+(\d[\d-]*)", lambda m: {"launched_before": _year(m[1])}),
    (r"once\s+a\s+(night|run)", lambda m: {f"once_a_{m[1].lower()}": True}),
    (
        r"at\s+most\s+(\d+)\s+an\s+hour",
        lambda m: {"most_an_hour": int(_within(m[1], 1.0, 1000.0, "passes an hour"))},
    ),
)
