"""Whether one of many texts stands in bytes, gigabytes of them; and nothing more, so that it is fast. Pure."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection

from srprov.linear_regex import any_of


def search(texts: Collection[str]) -> Callable[[bytes], bool]:
    """Return what tells whether any of the texts stands in bytes.

    What an expression can have is looked for at once; the rest, and all where they are too many for one, each alone.
    """
    plain = sorted(one for one in texts if one.isascii() and one.isprintable())
    together = any_of([re.escape(one) for one in plain]) if plain else None
    alone = [one.encode("utf-8", "surrogateescape") for one in texts if together is None or one not in plain]

    def found(data: bytes) -> bool:
        return any(one in data for one in alone) or bool(together and together(data))

    return found
