"""`python -m tools.site.drawing`: the flow of docs/architecture.md as docs/media/flow.svg, by Graphviz (`dot`).

The page has it in the language of Mermaid, which GitHub draws with a script. The site has no scripts of others, so it
shows the picture. A test compares the words of both.
"""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "architecture.md"
PICTURE = ROOT / "docs" / "media" / "flow.svg"
_BLOCK = re.compile(r"^```mermaid\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_NODE = re.compile(r'(\w+)(?:\[\(?"([^"]+)"\)?\])?')
_ARROW = re.compile(r'\s*(<-->|-->|-\.->)(?:\|"([^"]+)"\|)?\s*')
_LOOKS = {"-->": "", "<-->": "dir=both", "-.->": "style=dashed"}


def source() -> str:
    """Return the drawing as the page has it."""
    found = _BLOCK.search(PAGE.read_text(encoding="utf-8"))
    assert found, f"{PAGE} has no drawing"
    return found[1]


def words(mermaid: str) -> set[str]:
    """Return all words of a drawing that a reader sees."""
    return {label for label in re.findall(r'"([^"]+)"', mermaid)}


def dot(mermaid: str) -> Iterator[str]:
    """Yield the drawing in the language of Graphviz."""
    yield 'digraph flow { bgcolor="white"; node [shape=box style="rounded,filled" fillcolor="#f3f6fa"];'
    yield "node [fontname=Helvetica]; edge [fontname=Helvetica fontsize=11]; rankdir=TB; nodesep=0.45;"
    for line in mermaid.splitlines()[1:]:
        line = line.strip()  # noqa: PLW2901 - indentation means nothing
        if line.startswith("subgraph "):
            name = line.split()[1]
            yield f'subgraph cluster_{name} {{ label="{name}"; fontname=Helvetica; color="#8899aa";'
        elif line == "end":
            yield "}"
        elif line:
            yield from _edges(line)
    yield "}"


def _edges(line: str) -> Iterator[str]:
    """Yield a line's nodes and arrows; it may be a chain, and several nodes may stand at an arrow's end."""
    arrows = list(_ARROW.finditer(line))
    places = [0, *(arrow.end() for arrow in arrows)]
    ends = [*(arrow.start() for arrow in arrows), len(line)]
    groups = [[node.groups() for node in _NODE.finditer(line[a:b])] for a, b in zip(places, ends, strict=True)]
    for name, label in (node for group in groups for node in group):
        if label:
            yield f'{name} [label="{label}"];'
    for arrow, tails, heads in zip(arrows, groups, groups[1:], strict=False):
        look = " ".join(filter(None, (_LOOKS[arrow[1]], f'label="{arrow[2]}"' if arrow[2] else "")))
        yield from (f"{tail} -> {head} [{look}];" for tail, _ in tails for head, _ in heads)


def main() -> None:
    text = "\n".join(dot(source()))
    drawn = subprocess.run(["dot", "-Tsvg"], input=text, capture_output=True, text=True, check=True).stdout
    PICTURE.parent.mkdir(exist_ok=True)
    PICTURE.write_text(re.sub(r"<!--.*?-->\n?", "", drawn, flags=re.DOTALL), encoding="utf-8")
    print(PICTURE)


if __name__ == "__main__":
    main()
