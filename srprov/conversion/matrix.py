"""The table of keys as docs/from-compose.md shows it. Takes nothing; gives Markdown. Pure."""

from __future__ import annotations

from collections.abc import Iterator

from srprov.conversion.kept import Kept, Row
from srprov.conversion.table import TABLE

BEGIN, END = "<!-- matrix: written from srprov/conversion/table.py -->", "<!-- end of matrix -->"
_PARTS = (
    ("Top level", ("",)),
    ("A service", ("services.*.",)),
    ("`build`", ("services.*.build.",)),
    ("`deploy`", ("services.*.deploy.",)),
    ("`volumes` and `networks` of a service", ("services.*.volumes.", "services.*.networks.")),
)


def as_markdown() -> str:
    """Return a table for each part of a Compose file, one row for each key."""
    lines: list[str] = []
    for title, starts in _PARTS:
        rows = [row for path, row in TABLE.items() if path and _part(path) == starts]
        lines += [f"### {title}", "", "| key | is | in the experiment | otherwise |", "|---|---|---|---|"]
        lines += [f"| {_key(row, starts)} | {row.kept.value} | {_said(row)} | {'; '.join(_but(row))} |" for row in rows]
        lines.append("")
    return "\n".join(lines)


def replaced(page: str) -> str:
    """Return a page with the table of now between its two marks."""
    before, _, rest = page.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n\n{as_markdown()}\n{END}{after}"


def _part(path: str) -> tuple[str, ...]:
    """Return the beginnings of the longest part that a key lies in."""
    fitting = [starts for _, starts in _PARTS if any(path.startswith(one) for one in starts)]
    return max(fitting, key=lambda starts: max(len(one) for one in starts if path.startswith(one)))


def _key(row: Row, starts: tuple[str, ...]) -> str:
    short = row.path.removeprefix(starts[0] if len(starts) == 1 else "services.*.")
    return f"`{short}`" + (" and all below" if row.whole and row.kept is not Kept.EXACT else "")


def _said(row: Row) -> str:
    return ": ".join(part for part in (row.to, row.why) if part)


def _but(row: Row) -> Iterator[str]:
    for kept, when in row.but:
        if when:
            yield f"{kept.value}: {when}"
