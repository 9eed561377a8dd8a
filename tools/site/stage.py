"""The folder that Sphinx reads: the repository's Markdown files where they lie, and what they link to."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

from tools.site import fields, verbs
from tools.site.pages import HOME, arranged, is_result

PATTERNS = ("*.md", "docs/*.md", "inventory/*.md", "examples/*/*.md", "benchmarks/**/*.md")
_LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^()\s]+)\)")
_FENCE = re.compile(r"^(`{3,}|~{3,})")
_MERMAID = re.compile(r"^```mermaid$", re.MULTILINE)
"""A drawing that forges draw by a script; the site has no such script, and shows its text."""
_OUTSIDE = ("http:", "https:", "mailto:", "#")
_COMMENT = re.compile(r"^<!--.*?-->\n", re.MULTILINE | re.DOTALL)


def sources(root: Path) -> list[str]:
    """Return the repository's own pages, as paths relative to it."""
    found = {path.relative_to(root).as_posix() for pattern in PATTERNS for path in root.glob(pattern)}
    return sorted(found)


def stage(root: Path, folder: Path) -> list[str]:
    """Write all that Sphinx reads into an empty folder, and return the pages.

    Raises:
        FileNotFoundError: A page links to a file that is not there.
    """
    own = {name: (root / name).read_text(encoding="utf-8") for name in sources(root)}
    made = {**verbs.pages(), **fields.pages(root / "schemas")}
    groups = arranged({name.removesuffix(".md") for name in (*own, *made)})
    for name, markdown in own.items():
        titled = _titled(name, _MERMAID.sub("```text", _COMMENT.sub("", markdown)))
        text = "".join(_linked(root, folder, name, titled))
        _write(folder / name, text + (_navigation(groups) if name == f"{HOME}.md" else ""))
    for name, markdown in made.items():
        _write(folder / name, markdown)
    return [*own, *made]


def links(markdown: str) -> Iterator[str]:
    """Yield what a page links to, outside of blocks of code."""
    for line, is_code in _lines(markdown):
        if not is_code:
            yield from (match[3] for match in _LINK.finditer(_without_code(line)))


def _linked(root: Path, folder: Path, name: str, markdown: str) -> Iterator[str]:
    """Yield a page's lines; a link to a folder leads to its README, and files that are no pages are copied."""

    def follow(match: re.Match[str]) -> str:
        mark, label, target = match.groups()
        if target.startswith(_OUTSIDE):
            return match[0]
        path, _, anchor = target.partition("#")
        where = os.path.normpath(os.path.join(os.path.dirname(name), path))
        if (root / where).is_dir():
            if not (root / where / "README.md").exists():
                return label
            path, where = f"{path.rstrip('/')}/README.md", f"{where}/README.md"
        if not where.endswith(".md"):
            (folder / where).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(root / where, folder / where)
        elif not (root / where).exists():
            raise FileNotFoundError(f"{name}: {target} is not there")
        return f"{mark}[{label}]({path}{'#' if anchor else ''}{anchor})"

    for line, is_code in _lines(markdown):
        yield line if is_code else _LINK.sub(follow, line)


def _titled(name: str, markdown: str) -> str:
    """Return a page with a heading, and without a place in the navigation when it has none of its own: a result.

    Programs write those tables; pages that quote them lead there.
    """
    if not is_result(name.removesuffix(".md")):
        return markdown
    return f"---\norphan: true\n---\n\n# Results: {Path(name).stem}\n\n{markdown}"


def _lines(markdown: str) -> Iterator[tuple[str, bool]]:
    """Yield each line, and whether it is part of a block of code."""
    fence = ""
    for line in markdown.splitlines(keepends=True):
        found = _FENCE.match(line.lstrip())
        if fence:
            yield line, True
            fence = "" if found and line.strip() == fence else fence
        else:
            fence = found[1] if found else ""
            yield line, bool(found)


def _without_code(line: str) -> str:
    return re.sub(r"`[^`]*`", "``", line)


def _navigation(groups: dict[str, list[str]]) -> str:
    """Return the trees of the navigation, which the first page has and does not show."""
    trees = [
        "\n".join(["```{toctree}", ":hidden:", f":caption: {title}", "", *pages, "```", ""])
        for title, pages in groups.items()
        if pages
    ]
    return "\n" + "\n".join(trees)


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
