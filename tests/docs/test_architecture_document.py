"""docs/architecture.md: its picture is what the code says, and every file and name in it is there.

Files form no circles of imports; those for type checking and those inside functions count.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Container

    from tool_runs import Tool

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")


def test_the_picture_is_drawn_from_the_code(tool: Tool, tmp_path: Path) -> None:
    assert tool("architecture", "--check").returncode == 0
    drawn = (ROOT / "docs" / "architecture.svg").read_text(encoding="utf-8")
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "architecture.svg").write_text(drawn.replace("sattrack/safety", "sattrack/x"))
    assert tool("architecture", "--check", "--root", str(tmp_path)).returncode == 1


def test_every_file_that_the_page_names_is_there() -> None:
    named = re.findall(r"`((?:\w+/)+(?:\w+\.py)?)`", PAGE)
    assert len(named) > 20
    made = [name for name in named if "NAME" not in name]
    gone = [name for name in made if not any((top / name).exists() for top in (ROOT, ROOT / "sattrack"))]
    assert gone == []


def test_every_class_and_method_of_the_control_step_is_there() -> None:
    steps = PAGE.partition("## One control step")[2].partition("## Extension points")[0]
    defined = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "sattrack").rglob("*.py"))
    for name in re.findall(r"`([A-Z]\w+)(?:\.(\w+))?`", steps):
        assert re.search(rf"^class {name[0]}\b", defined, re.MULTILINE), name
        assert not name[1] or re.search(rf"^    def {name[1]}\b", defined, re.MULTILINE), name


def files_by_module() -> dict[str, Path]:
    """Return the files of packages, tools and bench by the names under which they are imported."""
    found = {}
    for path in sorted(
        file for top in ("tle", "sattrack", "tools", "bench") for file in (ROOT / top).rglob("*.py")
    ):
        parts = path.relative_to(ROOT).with_suffix("").parts
        # The bench's own folder is on the path of its programs.
        parts = parts[1:] if parts[0] == "bench" else parts
        found[".".join(parts).removesuffix(".__init__")] = path
    return found


IMPORT = re.compile(r"^[ \t]*(?:from ([\w.]+) )?import (\([^)]*\)|.*)", re.MULTILINE)
BY_CALL = re.compile(r"import_module\([\"']([\w.]+)")


def imported(text: str, known: Container[str]) -> set[str]:
    """Return the known modules that a text imports, in functions and for type checking too.

    By its lines: to parse every file takes ten times as long.
    """
    found = set(BY_CALL.findall(text))
    for module, names in IMPORT.findall(text):
        assert not module.startswith("."), "imports are absolute"
        for name in re.sub(r"#.*|[()]", "", names).split(","):
            inner = f"{module}.{name.split()[0]}" if name.strip() else ""
            found |= {inner.removeprefix(".")} if inner in known or not module else {module}
    return {name for name in found if name in known}


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Return the circles of a graph: each set of nodes that all lead to one another."""
    reached = {}
    for start in graph:
        seen: set[str] = set()
        ahead = [start]
        while ahead:
            fresh = graph[ahead.pop()] - seen
            seen |= fresh
            ahead += fresh
        reached[start] = seen
    closed = {
        start: sorted(node for node in seen if start in reached[node]) for start, seen in reached.items()
    }
    return [nodes for start, nodes in closed.items() if nodes and nodes[0] == start]


def test_no_files_import_one_another_in_a_circle() -> None:
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": {"d", "a"}}) == [["b", "c"], ["d"]]
    lazy = "if TYPE_CHECKING:\n    from a.b import C\ndef f():\n    import a.d\n    from a import e, g\n"
    lazy += "    import_module('h')"
    assert imported(lazy, {"a", "a.b", "a.d", "a.e", "h"}) == {"a.b", "a.d", "a.e", "a", "h"}
    files = files_by_module()
    assert len(files) > 300
    graph = {name: imported(path.read_text(encoding="utf-8"), files) - {name} for name, path in files.items()}
    assert sum(map(len, graph.values())) > 2000
    # What reads two lines is made of elements; `Elements.from_tle` asks it when it is called.
    graph["tle.elements"].remove("tle.formats.tle")
    assert circles(graph) == []
