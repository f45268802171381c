"""What lies beside `docs/` becomes part of the site: README files as pages, code as pages with colours.

Links in the sources are those of a checkout (`../experiments/limit/README.md`, `../evsdr/fit.py`). What they lead to gets a page
in `made/`, and they are turned to it; a link to a folder without one becomes its text.
"""

import os
import re
from pathlib import Path

HERE = Path(__file__).parent
TOP = HERE.parent
MADE = HERE / "made"
LINK = re.compile(r"(?<!!)\[([^][]*)\]\(([^)#:\s]+)(#[^)\s]*)?\)")
IMAGE = re.compile(r"(!\[[^][]*\])\(([^):\s]+)\)")
CHILDREN = "\n```{toctree}\n:hidden:\n:glob:\n\n*/index\n```\n"
SHOWN = {
    ".py": "python",
    ".xml": "xml",
    ".c": "c",
    ".h": "c",
    ".S": "gas",
    ".cff": "yaml",
    "": "text",
    ".toml": "toml",
}


def pages() -> dict[Path, Path]:
    """Give what README files and the changelog become."""
    beside = [*TOP.glob("experiments/**/README.md"), TOP / "scenes/README.md", TOP / "firmware/README.md"]
    made = {path: MADE / path.parent.relative_to(TOP) / "index.md" for path in sorted(beside)}
    return made | {TOP / "CHANGELOG.md": MADE / "changelog.md"}


def page_of(path: Path) -> Path | None:
    """Give the page that a file or folder has or gets; None if nothing of it is shown."""
    path = path / "README.md" if path.is_dir() else path
    if path in pages():
        return pages()[path]
    if path.suffix in (".md", ".rst") and path.is_relative_to(HERE):
        return path if path.is_file() or path.is_relative_to(MADE) else None
    is_shown = path.is_file() and path.suffix in SHOWN
    return MADE / "source" / f"{path.relative_to(TOP)}.md" if is_shown else None


def turned(text: str, source: Path, page: Path, found: set[Path]) -> str:
    """Turn the links of a text that stands in `source` to what they lead to from `page`; files found are added."""

    def link(match: re.Match) -> str:
        words, target, part = match.groups()
        path = Path(os.path.normpath(source.parent / target))
        leads = page_of(path)
        if leads is None:
            return words
        if leads.is_relative_to(MADE / "source"):
            found.add(path)
        return f"[{words}]({os.path.relpath(leads, page.parent)}{part or ''})"

    def image(match: re.Match) -> str:
        path = os.path.normpath(source.parent / match[2])
        return f"{match[1]}({os.path.relpath(path, page.parent)})"

    return LINK.sub(link, IMAGE.sub(image, text))


def write(app) -> None:
    """Write the pages of what lies beside, and of the code that any page links to."""
    found: set[Path] = set()
    for source, page in pages().items():
        text = turned(source.read_text(), source, page, found)
        has_children = page.name == "index.md" and any(
            p.parent.parent == page.parent for p in pages().values()
        )
        put(page, text + CHILDREN * has_children)
    for source in HERE.glob("**/*.md"):
        if not source.is_relative_to(MADE):
            turned(source.read_text(), source, source, found)
    for path in found:
        page = MADE / "source" / f"{path.relative_to(TOP)}.md"
        at = os.path.relpath(path, page.parent)
        code = f"```{{literalinclude}} {at}\n:language: {SHOWN[path.suffix]}\n```"
        put(page, f"---\norphan: true\n---\n\n# {path.relative_to(TOP)}\n\n{code}\n")


def put(page: Path, text: str) -> None:
    """Write a page, unless it is that already: Sphinx reads anew what is newer."""
    page.parent.mkdir(parents=True, exist_ok=True)
    if not page.is_file() or page.read_text() != text:
        page.write_text(text)


def read(app, name: str, text: list[str]) -> None:
    """Turn the links of a page that is written by hand."""
    source = Path(app.env.doc2path(name))
    if source.suffix == ".md" and not source.is_relative_to(MADE):
        text[0] = turned(text[0], source, source, set())


def setup(app) -> dict:
    """Register with Sphinx."""
    app.connect("builder-inited", write)
    app.connect("source-read", read)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
