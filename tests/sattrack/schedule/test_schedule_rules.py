"""Rules in words."""

from __future__ import annotations

import pytest

from sattrack.core.errors import BadInputError, Origin
from sattrack.schedule.schema import Conditions, Rule, parse_rule

HERE = Origin("n.toml", 3, 9)


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        (
            "all of celestrak:visual, above 30°, sunlit, magnitude < 4, max 12",
            Rule("celestrak:visual", Conditions(above_deg=30.0, sunlit=True, brighter_than=4.0, most=12)),
        ),
        ("all", Rule(None, Conditions())),
        (
            "All Of my sky.tle,Above 30 deg , DARK",
            Rule("my sky.tle", Conditions(above_deg=30.0, sun_below_deg=-6.0)),
        ),
        (
            "all, culminates above 60, sun below -12.5°, rate < 1.5 °/s, longer than 2 min, named COSMOS*",
            Rule(
                None,
                Conditions(
                    culminates_deg=60.0,
                    sun_below_deg=-12.5,
                    slower_than_deg_s=1.5,
                    longer_than_s=120.0,
                    named="COSMOS*",
                ),
            ),
        ),
        (
            "all, designator 1998-067*, once a night, at most 4 an hour",
            Rule(None, Conditions(designator="1998-067*", once_a_night=True, most_an_hour=4)),
        ),
        (
            "all, launched since 2019, launched before 2024, once a run",
            Rule(None, Conditions(launched_from=2019, launched_before=2024, once_a_run=True)),
        ),
        ("all, launched 2020", Rule(None, Conditions(launched_from=2020, launched_before=2021))),
        (
            "all, magnitude<-1.5, longer than 90 s",
            Rule(None, Conditions(brighter_than=-1.5, longer_than_s=90.0)),
        ),
    ],
)
def test_a_rule_is_read_as_it_is_said(text: str, rule: Rule) -> None:
    assert parse_rule(text, HERE) == rule


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("al of x", "n.toml:3:9: 'al of x' begins no rule; did you mean 'all'?"),
        ("", "n.toml:3:9: '' begins no rule: begin with 'all'"),
        ("sunlit", "n.toml:3:9: 'sunlit' begins no rule"),
        ("all of x, abve 30", "n.toml:3:19: 'abve 30' is no condition; did you mean 'above'?"),
        ("all,   above thirty", "n.toml:3:16: 'above thirty' is not understood: write it as 'above 30°'"),
        ("all, magnitude 4", "n.toml:3:14: 'magnitude 4' is not understood: write it as 'magnitude < 4'"),
        ("all, sun above 3", "n.toml:3:14: 'sun above 3' is not understood: write it as 'sun below -12°'"),
        ("all, above 99", "n.toml:3:20: 'above 99': altitudes go from -5 to 89"),
        (
            "all, launched 2024-05-01",
            "n.toml:3:23: 'launched 2024-05-01': elements tell the year of launch alone: give a year",
        ),
        ("all, launched 1900", "n.toml:3:23: 'launched 1900': years of launch go from 1957 to 2056"),
        (
            "all, launched 2020, launched since 2001",
            "n.toml:3:44: 'launched since 2001': the launch is",
        ),
        ("all, launched late", "n.toml:3:14: 'launched late' is not understood: write it as 'launched since"),
        ("all, designator ISS", "n.toml:3:25: 'designator ISS': a designator begins with the year of launch"),
        ("all, once a week", "n.toml:3:14: 'once a week' is not understood: write it as 'once a night'"),
        ("all, once a night, once a run", "n.toml:3:28: 'once a run': given twice; keep one"),
        ("all, at most 0 an hour", "n.toml:3:22: 'at most 0 an hour': passes an hour go from 1 to 1000"),
        ("all, at most 4", "n.toml:3:14: 'at most 4' is not understood: write it as 'at most 4 an hour'"),
        ("all, max 0", "n.toml:3:18: 'max 0': numbers of passes go from 1 to 10000"),
        ("all, max 1.5", "n.toml:3:14: 'max 1.5' is not understood: write it as 'max 12'"),
        ("all, sunlit, sunlit", "n.toml:3:22: 'sunlit': given twice; keep one"),
        ("all, above 3, above 4", "n.toml:3:23: 'above 4': given twice; keep one"),
        ("all, dark, sun below 3", "n.toml:3:30: 'sun below 3': the Sun's altitude is asked twice; keep one"),
        ("all,, dark", "n.toml:3:13: nothing stands between two commas"),
        ("all, dark,", "n.toml:3:19: nothing stands between two commas, or after the last"),
        ("all, quickly", "n.toml:3:14: 'quickly' is no condition; there are above, culminates above, "),
    ],
)
def test_what_is_no_rule_is_pointed_at(text: str, says: str) -> None:
    with pytest.raises(BadInputError) as error:
        parse_rule(text, HERE)
    assert str(error.value).startswith(says)
