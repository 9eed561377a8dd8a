"""Text as Markdown that shows exactly that text."""

from __future__ import annotations

import re

_SPECIAL = re.compile(r"([\\*_\[\]<>|#~$])")
_CODE = re.compile(r"(`[^`]+`)")


def text(plain: str) -> str:
    """Return a text with its special characters escaped; what stands in backticks stays code."""
    parts = _CODE.split(plain)
    return "".join(part if at % 2 else _SPECIAL.sub(r"\\\1", part) for at, part in enumerate(parts))


def code(plain: str) -> str:
    """Return a text as code within a line, also in a cell of a table."""
    fence = "``" if "`" in plain else "`"
    pad = " " if plain.startswith("`") or plain.endswith("`") else ""
    return f"{fence}{pad}{plain}{pad}{fence}".replace("|", "\\|")


def block(plain: str, language: str = "text") -> str:
    """Return lines as a block of code."""
    return f"```{language}\n{plain}\n```"
