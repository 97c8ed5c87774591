"""Run the notebooks in `examples/notebooks` and keep what they print and draw: `python -m tools.notebooks`.

A notebook is run as one script in its own folder, as Jupyter does, with no notebook server.
"""

from __future__ import annotations

import base64
import contextlib
import io
import json
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "examples" / "notebooks"
DPI = 80


def cells(path: Path) -> list[dict[str, Any]]:
    """Return the cells of a notebook, in their order."""
    found: list[dict[str, Any]] = json.loads(path.read_text(encoding="utf-8"))["cells"]
    return found


def printed(cell: dict[str, Any]) -> str:
    """Return what a code cell is kept to print."""
    streams = [output["text"] for output in cell["outputs"] if output["output_type"] == "stream"]
    return "".join(line for text in streams for line in text)


def outputs(path: Path) -> list[list[dict[str, Any]]]:
    """Run a notebook; return the outputs of each code cell: its text, then its pictures (PNG)."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    names: dict[str, Any] = {}
    found = []
    for cell in cells(path):
        if cell["cell_type"] != "code":
            continue
        with contextlib.chdir(path.parent), contextlib.redirect_stdout(io.StringIO()) as text:
            exec(compile("".join(cell["source"]), path.name, "exec"), names)
        made: list[dict[str, Any]] = []
        if text.getvalue():
            lines = text.getvalue().splitlines(keepends=True)
            made.append({"output_type": "stream", "name": "stdout", "text": lines})
        for number in pyplot.get_fignums():
            picture = io.BytesIO()
            pyplot.figure(number).savefig(picture, format="png", dpi=DPI, metadata={"Software": None})
            data = {"image/png": base64.b64encode(picture.getvalue()).decode()}
            made.append({"output_type": "display_data", "data": data, "metadata": {}})
        pyplot.close("all")
        found.append(made)
    return found


def run() -> None:
    """Write the outputs of every notebook into it."""
    for path in sorted(FOLDER.glob("*.ipynb")):
        notebook = json.loads(path.read_text(encoding="utf-8"))
        code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
        for number, (cell, made) in enumerate(zip(code, outputs(path), strict=True), 1):
            cell["outputs"], cell["execution_count"] = made, number
        path.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    run()
