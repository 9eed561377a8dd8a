"""Amounts of bytes as people read them. Pure."""

from __future__ import annotations


def size_text(number: int) -> str:
    """Return bytes in the largest unit that fits, with enough digits that unequal amounts look unequal."""
    for unit, size in (("GiB", 1 << 30), ("MiB", 1 << 20), ("KiB", 1 << 10)):
        if number >= size:
            return f"{number / size:.4g} {unit}"
    return f"{number} B"
