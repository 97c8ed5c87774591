"""Pages and help texts keep to the words of docs/style.md."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import CodeType
from typing import TYPE_CHECKING

import click
import pytest

from sattrack.cli.main import COMMANDS, cli

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).resolve().parents[2]
STYLE = ROOT / "docs" / "style.md"
PAGES = sorted({ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")} - {STYLE})
NEWCOMERS = [
    ROOT / "README.md",
    ROOT / "docs" / "index.md",
    ROOT / "docs" / "tutorial.md",
    *sorted((ROOT / "docs" / "howto").glob("*.md")),
]
FOREIGN = (
    r"\b(?:is|are|was|were|be|not) (?:not )?to be (?:had|found out|had at)\b",
    r"\bbe had\b",
    r"\b(?:is|are|was|were) to be\b",
    r"\bhad better\b",
    r"\bwhat becomes of\b",
    r"\bwhat became of\b",
    r"\b(?:is|are|was|were) told\b",
    r"\btold (?:of|by|with|in|at|on)\b",
    r"\bis said\b",
    r"\bwhosever\b",
    r"\bwhichever way\b",
    r"\bforetell|\bforetold\b",
    r"\breckon",
    r"\bnobody here\b",
    r"\bpass always\b",
    r"\bso it is on\b",
    r"\bwhat is the matter\b",
    r"\bdoes? not bear\b",
    r"\bbears? no\b",
    r"\bof a second become\b",
    r"\bthan could otherwise\b",
    r"\bhung up on\b",
    r"\bas near as (?!possible)",
    r"\bthe way (?:there|here) is\b",
    r"\bmuch to do as\b",
    r"\bof its own motion\b",
    r"\bby turns\b",
    r"\bgoes round\b",
    r"\bbe it\b",
    r"\blest\b",
    r"\bthereof\b",
    r"\bwhereof\b",
    r"\bwherewith\b",
    r"\bhenceforth\b",
)
BOUNDARY = r"\b"
UNUSED_RULES = ("typography", "lexical_illusions", "dates_times", "spelling")
"""Rules of proselint that tables, terminals' output and options such as `--from` break on every page."""
HEADLINE = re.compile(
    r"^#+ (?:What (?:it|becomes|makes|is (?:not|known|kept|run|remembered))"
    r"|How (?:near|well it|soon|far|it) |Who may$)"
)
# The first boundary stands before all of them: within words nothing is tried, which takes most of the time.
PATTERN = re.compile(rf"\b(?:{'|'.join(one.removeprefix(BOUNDARY) for one in FOREIGN)})", re.IGNORECASE)
DOCSTRING = re.compile(r'"""(.*?)"""', re.DOTALL)
GENERATED = re.compile(
    r"<!-- BEGIN .*?<!-- END [^\n]*-->|^```.*?^```$|`[^`\n]*`|\"[^\"\n]*\"", re.MULTILINE | re.DOTALL
)


def found_in(text: str) -> list[str]:
    """The words of a page that are not of the house, with their lines' text; code is left out."""
    prose = GENERATED.sub(lambda code: re.sub(r"[^\n]", " ", code[0]), text)
    joined = re.sub(r"(?<!\n)\n(?!\n)", " ", prose)
    return [joined[max(0, hit.start() - 30) : hit.end() + 20] for hit in PATTERN.finditer(joined)]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_pages_are_in_plain_words(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert found_in(text) == []
    prose = GENERATED.sub("", text)
    assert [line for line in prose.splitlines() if HEADLINE.match(line)] == []


def sentences(text: str) -> list[str]:
    """The sentences of a page; code, tables and headlines are left out."""
    text = re.sub(r"^```.*?^```$|<!--.*?-->", "\n\n", text, flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r"^(?:\||#|!\[).*$", "\n", text, flags=re.MULTILINE)
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)
    blocks = re.split(r"\n\s*\n|\n(?=\s*(?:[*>]|\d+\.) )", text)
    return [
        one for block in blocks for one in re.split(r"(?<=[.!?:;])[*]*\s+", " ".join(block.split())) if one
    ]


@pytest.mark.parametrize("page", NEWCOMERS, ids=lambda page: str(page.relative_to(ROOT)))
def test_newcomers_read_short_sentences(page: Path) -> None:
    lengths = [len(one.split()) for one in sentences(page.read_text(encoding="utf-8"))]
    assert len(lengths) > 5
    assert sum(lengths) / len(lengths) < 12.0
    assert max(lengths) <= 26


def helps(command: click.Command, name: str) -> list[tuple[str, str]]:
    """The help of a command and its options, and of those below it."""
    own = [(name, command.help or "")]
    own += [
        (f"{name} {one.opts[0]}", one.help or "") for one in command.params if isinstance(one, click.Option)
    ]
    if isinstance(command, click.Group):
        context = click.Context(command)
        for verb in command.list_commands(context):
            found = command.get_command(context, verb)
            assert found is not None
            own += helps(found, f"{name} {verb}")
    return own


def test_help_is_in_plain_words() -> None:
    texts = [*helps(cli, "sattrack"), *COMMANDS.items()]
    assert len(texts) > 200
    assert [(name, found) for name, text in texts if (found := found_in(text))] == []


def strings_of(code: CodeType) -> Iterator[tuple[int, str]]:
    """Yield each string of compiled code, and of the functions and classes in it, with their first line.

    A single word is left out: the names of a call's arguments and of fields are kept so.
    """
    waiting: list[object] = list(code.co_consts)
    while waiting:
        one = waiting.pop()
        if isinstance(one, str):
            if not one.isidentifier():
                yield code.co_firstlineno, one
        elif isinstance(one, tuple | frozenset):
            waiting.extend(one)
        elif isinstance(one, CodeType):
            yield from strings_of(one)


def test_messages_and_docstrings_are_in_plain_words() -> None:
    # From the compiled modules, which are kept: to parse all of them takes seconds. The docstrings of
    # attributes are not in these.
    texts = [
        (f"{path.relative_to(ROOT)}:{line}", text)
        for folder in ("sattrack", "tle")
        for path in sorted((ROOT / folder).rglob("*.py"))
        for line, text in (
            *strings_of(SourceFileLoader(path.stem, str(path)).get_code(path.stem)),
            *((0, text) for text in DOCSTRING.findall(path.read_text(encoding="utf-8"))),
        )
    ]
    assert len(texts) > 20_000
    assert [(place, found) for place, text in texts if (found := found_in(text))] == []


def test_a_foreign_word_shows_and_code_does_not_count() -> None:
    text = 'def f(x):\n    "One."\n    return g(f"three {x}", "is " "told", ("at last", h(y=1)))'
    code = compile(text, "f", "exec")
    assert {"One.", "three ", "is told", "at last"} <= {text for _, text in strings_of(code)}
    assert found_in("No way is to be had.")
    assert found_in("They are\ntold of it.")
    assert not found_in("```\nit is to be had\n```\nand `is told`.")
    assert HEADLINE.match("## What becomes of a link that is lost")
    assert not HEADLINE.match("## What happens if the link is lost")


def proselint(*files: Path) -> list[str]:
    """Return what proselint says of files, by the rules that are used."""
    said = subprocess.run(
        [str(Path(sys.executable).with_name("proselint")), "check", *map(str, files)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert said.stderr == ""
    lines = [line for line in said.stdout.splitlines() if re.match(r".+?:\d+:\d+: ", line)]
    return [line for line in lines if not line.split(": ")[1].startswith(UNUSED_RULES)]


def test_proselint_has_nothing_to_say(tmp_path):
    poor = tmp_path / "poor.md"
    poor.write_text("It waits for ever.\n")
    (said,) = proselint(*PAGES, ROOT / "CHANGELOG.md", poor)
    assert "poor.md:1:" in said
