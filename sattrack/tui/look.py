"""Colours and layout. Restrained and dark; every state that has a colour has a word as well."""

from __future__ import annotations

from textual.theme import Theme

from sattrack.tui.scene import Tone

RA_LINE = "#5fb8c4"
DEC_LINE = "#c9929f"
ZERO_LINE = "#454e58"
DIM = "#87919b"
INK = "#0c0f12"

NIGHT = Theme(
    name="night",
    primary="#7f9fb8",
    secondary="#3c4651",
    success="#7fb685",
    warning="#d9a94f",
    error="#e0625a",
    foreground="#d0d6dc",
    background=INK,
    surface="#12161b",
    panel="#1a2027",
    dark=True,
)

SPOKEN = {
    Tone.GOOD: f"bold {NIGHT.success}",
    Tone.CALM: f"bold {NIGHT.primary}",
    Tone.NOTICE: f"bold {NIGHT.warning}",
    Tone.BAD: f"bold {NIGHT.error}",
}
PLATE = {
    Tone.GOOD: f"bold {INK} on {NIGHT.success}",
    Tone.CALM: f"bold {INK} on {NIGHT.primary}",
    Tone.NOTICE: f"bold {INK} on {NIGHT.warning}",
    Tone.BAD: f"bold {INK} on {NIGHT.error}",
}

WIDTHS = [(0, "-narrow"), (110, "-wide")]
HEIGHTS = [(0, "-short"), (32, "-tall")]
"""Style classes of the screen, each from so many columns or rows on."""

TITLES = {
    "ErrorBox": "error",
    "#axes": "error by direction",
    "#where": "satellite",
    "#wide-times": "pass",
    "ErrorPanel": "error of the last minutes",
    "#link": "link",
    "#mount": "mount",
    "#bias": "bias",
    "#run": "run",
}
"""Titles of the panels that have a border where there is room for one."""

CSS = """
Screen { background: $background; color: $foreground; }

Panel { height: 1; text-wrap: nowrap; text-overflow: ellipsis; padding: 0 1; }
TitleBar, HeadlineBar, KeyBar { background: $panel; }
Cautions { height: auto; max-height: 4; text-wrap: wrap; background: $surface; }

#state { height: 5; }
ErrorBox { width: 30; height: 5; }
ErrorBox #digits-row { height: 3; padding: 0 1; }
ErrorBox Digits { width: auto; height: 3; text-style: bold; color: $foreground; }
ErrorBox #unit { width: 2; height: 3; text-style: bold; color: $foreground; }
ErrorBox.good Digits, ErrorBox.good #unit { color: $success; }
ErrorBox.notice Digits, ErrorBox.notice #unit { color: $warning; }
ErrorBox.bad Digits, ErrorBox.bad #unit { color: $error; }
#axes { width: 23; height: 5; }
#where { width: 1fr; height: 5; }

ErrorPanel { height: 1fr; min-height: 5; }
ErrorPlot { height: 1fr; }
ErrorPlot > .plot--axis { color: #4a545f; }
ErrorPlot > .plot--tick { color: #a3adb7; text-style: none; }

#below { height: auto; }
#bias { height: 2; }
#wide-times { display: none; }

.-wide.-tall {
    Panel, ErrorBox, ErrorPanel { border-title-color: $primary; }
    #state { height: 8; }
    ErrorBox { width: 32; height: 8; border: round $secondary; padding: 1 0 0 0; }
    #axes { width: 26; height: 8; border: round $secondary; }
    #where { width: 1fr; height: 8; border: round $secondary; }
    #wide-times { display: block; width: 1.25fr; height: 8; border: round $secondary; }
    #narrow-times { display: none; }
    ErrorPanel { border: round $secondary; }
    #below { height: 8; layout: horizontal; }
    #below > Panel { width: 1fr; height: 8; border: round $secondary; }
    #below > #bias { width: 39; }
    #below > #link { width: 29; }
    #below > #mount { width: 30; }
}

HelpScreen { align: center middle; background: $background 70%; }
HelpScreen > VerticalScroll {
    width: 76; max-width: 100%; height: auto; max-height: 100%;
    background: $surface; border: round $primary; padding: 0 2;
}
HelpScreen Static { height: auto; }
"""
