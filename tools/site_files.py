"""Files of the repository that pages link to, as files of the site: a hook of `mkdocs.yml`.

Pages link to `../examples/night.toml` or `../CONTRIBUTING.md`, as they are in the repository. The site holds
copies below its own root.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from mkdocs.structure.files import File

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files
    from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
_LINK = re.compile(r"\]\((?P<path>[^)#:\s]+)(?P<rest>#[^)]*)?\)")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add every file of the repository outside docs/ that a page links to."""
    found = {ROOT / "CONTRIBUTING.md"}
    for page in [*DOCS.rglob("*.md"), ROOT / "CONTRIBUTING.md"]:
        for link in _LINK.finditer(page.read_text(encoding="utf-8")):
            path = (page.parent / link["path"]).resolve()
            if path.is_file() and path.is_relative_to(ROOT) and not path.is_relative_to(DOCS):
                found.add(path)
    for path in sorted(found):
        files.append(File.generated(config, path.relative_to(ROOT).as_posix(), abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Return the page with its links to such files as the site has them."""
    del config, files
    inside = page.file.src_uri.count("/")
    here = ROOT if page.file.src_uri == "CONTRIBUTING.md" else DOCS / Path(page.file.src_uri).parent

    def link(found: re.Match[str]) -> str:
        path = (here / found["path"]).resolve()
        if not path.exists() or (path.is_relative_to(DOCS) and here != ROOT):
            return found[0]
        top = DOCS if path.is_relative_to(DOCS) else ROOT
        return f"]({'../' * inside}{path.relative_to(top).as_posix()}{found['rest'] or ''})"

    return _LINK.sub(link, markdown)
