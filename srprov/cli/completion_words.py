"""Words that srprov itself has, for a command line that is being typed. Each list is imported when it is asked for."""

from __future__ import annotations

from collections.abc import Iterator


def permissions(_incomplete: str) -> Iterator[str]:
    """Give what --allow takes."""
    from srprov.controller.permissions import kinds

    yield from kinds()


def codes(_incomplete: str) -> Iterator[str]:
    """Give the codes of errors."""
    from srprov.codes import Code

    yield from (code.value for code in Code)


def schemas(_incomplete: str) -> Iterator[str]:
    """Give the kinds of schemas."""
    from srprov import data

    yield from data.schema_kinds()
