"""`python -m tools.compose_matrix`: write the table of keys into docs/from-compose.md."""

from __future__ import annotations

from pathlib import Path

from srprov.conversion import matrix

PAGE = Path(__file__).resolve().parent.parent / "docs" / "from-compose.md"

if __name__ == "__main__":
    PAGE.write_text(matrix.replaced(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
