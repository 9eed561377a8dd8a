"""Whether one of many texts stands in bytes, gigabytes of them; and nothing more, so that it is fast. Pure."""

from __future__ import annotations

from collections.abc import Callable, Collection

from srprov.linear_regex import any_of

_BEGIN = 12
"""Characters of a text that are looked for first: an expression of whole keys would be larger than its memory."""
_TOGETHER = 400


def search(texts: Collection[str]) -> Callable[[bytes], bool]:
    """Return what tells whether any of the texts stands in bytes.

    The beginnings of all are looked for at once; a text with other characters than ASCII is looked for alone.
    """
    whole = [one.encode("utf-8", "surrogateescape") for one in texts]
    begins = sorted({one[:_BEGIN] for one in texts if one.isascii()})
    groups = [begins[at : at + _TOGETHER] for at in range(0, len(begins), _TOGETHER)]
    searches = [any_of([_literal(one) for one in group]) for group in groups]
    alone = [one.encode("utf-8", "surrogateescape") for one in texts if not one.isascii()]

    def found(data: bytes) -> bool:
        near = any(one is None or one(data) for one in searches)
        return any(one in data for one in (whole if near else alone))

    return found


def _literal(text: str) -> str:
    return "".join(one if one.isalnum() else f"\\x{ord(one):02x}" for one in text)
