"""docs/errors.md, made of the pages of the codes: `make errors` writes it, a test says when it is old."""

from __future__ import annotations

from pathlib import Path

from srprov.explaining import as_markdown, pages

TARGET = Path(__file__).parents[1] / "docs" / "errors.md"
_PARTS = {
    "0": "srprov itself, and its lab",
    "1": "Definitions",
    "2": "Inventory, command line and configuration",
    "3": "Reaching robots",
    "4": "Who runs what",
    "5": "Permissions, trust and plans",
    "6": "Changing robots, and looking into what runs",
    "7": "The overlay",
    "8": "Images and data sets",
    "9": "Records, trials and bundles",
}
_HEAD = """# Errors

Every error has a code, `SRP-` and three digits. The first digit is the part of srprov that it is about. A code never
changes its meaning, and one that is not used any more is not given to another kind of error. The code stands where the
error is told: `error[SRP-105]: …`, at the end of what is said of one robot of many, in `code` of
`srprov validate --format json`, as rule of SARIF and as `check_name` of Code Quality.

`srprov explain SRP-105` prints a page of this list, and `srprov explain` all titles. With a command below an example,
the page says all that is needed to try it: the wrong one gives the code, the right one none.

<!-- Made by `make errors` from srprov/explaining/*.yml. -->
"""


def text() -> str:
    """Return the page as it should be."""
    parts = [_HEAD]
    for digit, title in _PARTS.items():
        some = [page for page in pages().values() if page.code.value[4] == digit]
        parts.append(f"## {title}\n")
        parts.extend(as_markdown(page, level=3) for page in some)
    return "\n".join(parts)


if __name__ == "__main__":
    TARGET.write_text(text(), encoding="utf-8")
