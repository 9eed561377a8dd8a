"""Where texts stand in bytes, and whether one of many stands in gigabytes of them. Pure.

A text is looked for as a whole, or by a head that nobody guesses. So bytes in which none stands take as long whatever
is in them: who sees that time learns nothing of a guess at how a text begins.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator

from srprov.linear_regex import any_literal

HEAD = 128
"""Bytes of a text that are looked for first; in some forms a letter takes eight."""
_TOGETHER = 32 << 10
"""Bytes of the heads that are looked for at once: an expression of whole keys would be larger than its memory."""
_OTHERS = (b"\xfe\xff" * 16, b"\xff\xfe" * 16)
"""Are looked for with all heads: where all of an expression begin alike, RE2 is quicker where nothing does."""


def search(texts: Collection[str]) -> Callable[[bytes], bool]:
    """Return what tells whether any of the texts stands in bytes."""
    whole = [one.encode("utf-8", "surrogateescape") for one in texts]
    near = places(whole)
    return lambda data: any(True for _ in near(data)) and any(one in data for one in whole)


def places(some: Collection[bytes]) -> Callable[[bytes], Iterator[int]]:
    """Return what gives all places in bytes where one of these may stand: its head does."""
    heads = sorted({one[:HEAD] for one in some})
    searches = [any_literal([*group, *_OTHERS]) for group in _groups(heads)]

    def found(data: bytes) -> Iterator[int]:
        for find in searches:
            at = -1
            while (at := find(data, at + 1)) >= 0:
                yield at

    return found


def _groups(heads: Collection[bytes]) -> Iterator[list[bytes]]:
    group, size = list[bytes](), 0
    for one in heads:
        if size + len(one) > _TOGETHER:
            yield group
            group, size = [], 0
        group.append(one)
        size += len(one)
    if group:
        yield group
