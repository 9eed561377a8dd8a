"""The document `results.md`: figures of each part first, then each turn. A part that is not run keeps what it has."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

PARTS = ("moments", "faults", "races")
HEAD = """\
# Soak

Written by `make soak`: figures first, then each turn. A part that is not run again keeps what it has. Minutes are
those in which a part had the lab.
"""
MINUTES = re.compile(r"^- took ([0-9.]+) min", re.MULTILINE)


@dataclass(frozen=True)
class Result:
    """What one part has to say; as far as it has come, while it runs."""

    part: str
    about: str
    """What was done, in a sentence."""
    figures: list[str]
    table: list[str]
    seconds: float
    left: int
    """Turns that were not made (yet)."""
    wrong: int
    """Turns that did not end as they should."""

    @property
    def fine(self) -> bool:
        return bool(self.table) and self.left == self.wrong == 0


def write(path: Path, result: Result) -> None:
    """Put a part's result into the document; what the others have in it stays."""
    sections = _sections(path.read_text(encoding="utf-8")) if path.exists() else {}
    told = [f"- {figure}" for figure in result.figures]
    if result.left:
        told.insert(0, f"- **ended early: {result.left} turns were not made**")
    told.append(f"- took {result.seconds / 60:.1f} min")
    sections[result.part] = "\n".join([result.about, "", *told])
    sections[f"{result.part}, each"] = "\n".join(result.table)
    minutes = [float(found[1]) for part in PARTS if (found := MINUTES.search(sections.get(part, "")))]
    sections["total"] = f"{len(minutes)} of {len(PARTS)} parts, {sum(minutes):.0f} min"
    order = ["total", *PARTS, *(f"{part}, each" for part in PARTS)]
    text = [f"## {title}\n\n{sections[title]}\n" for title in order if title in sections]
    path.write_text("\n".join([HEAD, *text]), encoding="utf-8")


def _sections(text: str) -> dict[str, str]:
    """Return title -> text."""
    parts = [part.partition("\n") for part in re.split(r"^## ", text, flags=re.MULTILINE)[1:]]
    return {title.strip(): rest.strip() for title, _, rest in parts}
