"""Regular expressions of experiments, on lines that robots print: matched in time linear in both.

Python's `re` may take for ever on a pattern and a line that were made for it. RE2 cannot; it has no back references and
no look-around. Pure.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any

_MOST_BYTES = 8 << 20
"""Of memory that compiled patterns may take together."""
_MOST_OF_ONE = 1 << 19
"""Of memory that one may take: some 32,000 steps, with which a line of 64 KiB takes half a minute at worst."""
_STEPS, _LARGEST = 300_000, 32_000
"""Steps of a program that all patterns of an experiment have together, and what one counts as that is too large. A
number behind a word has twenty, a letter of any alphabet 1200."""


class Patterns:
    """The patterns of one experiment, which are checked one by one: a short one may take long to compile."""

    def __init__(self) -> None:
        """Begin with none."""
        self._left = _STEPS

    def check(self, pattern: str, groups: int = 0) -> None:
        """Refuse what is no pattern, has fewer groups than are wanted, or is too much with those before.

        Raises:
            ValueError: It says why.
        """
        if self.compiled(pattern).groups < groups:
            raise ValueError(f"'{pattern[:60]}' has no group; put parentheses around the number")

    def compiled(self, pattern: str) -> Any:  # noqa: ANN401 - as below
        """Return the compiled pattern, if it is one and not too much with those before.

        Raises:
            ValueError: It says why.
        """
        if self._left > 0:
            try:
                found = compiled(pattern)
            except ValueError:
                self._left -= _LARGEST
                raise
            self._left -= found.programsize
        if self._left <= 0:
            raise ValueError(f"with '{pattern[:60]}', all patterns together are too large: write them shorter")
        return found


def check_pattern(pattern: str) -> None:
    """Refuse what is no pattern.

    Raises:
        ValueError: It says why.
    """
    Patterns().check(pattern)


def compiled(pattern: str) -> Any:  # noqa: ANN401 - google-re2 is not typed; it has the interface of `re.Pattern`
    """Return the compiled pattern.

    Raises:
        ValueError: It is none.
    """
    return _compiled(pattern, _MOST_OF_ONE)


@functools.lru_cache(maxsize=512)
def _compiled(pattern: str | bytes, most: int) -> Any:  # noqa: ANN401 - as above
    import re2

    options = re2.Options()
    options.max_mem, options.log_errors = most, False
    if isinstance(pattern, bytes):
        options.encoding = re2.Options.Encoding.LATIN1
    try:
        return re2.compile(pattern, options)
    except re2.error as error:
        said = error.args[0].decode("utf-8", "replace") if isinstance(error.args[0], bytes) else str(error)
        raise ValueError(f"'{pattern[:60]!s}' is no regular expression of RE2: {said}") from None


def any_literal(some: Sequence[bytes]) -> Callable[[bytes, int], int]:
    """Return what gives the first place from another one on where any of these bytes stand; -1 for none.

    It takes as long for all bytes in which none does, whatever is like the beginning of one.
    """
    every = b"|".join(b"".join(b"\\x%02x" % byte for byte in one) for one in some)
    search = _compiled(every, _MOST_BYTES).search

    def find(data: bytes, start: int) -> int:
        match = search(data, start)
        return match.start() if match else -1

    return find


def any_of(patterns: Sequence[str]) -> Callable[[bytes], object] | None:
    """Return a search that finds something where any of these patterns does; None where each must be tried itself."""
    return _any_of(tuple(patterns))


@functools.lru_cache(maxsize=64)
def _any_of(patterns: tuple[str, ...]) -> Callable[[bytes], object] | None:
    """Return it; that there is none is known for the next time, too."""
    if any("\\Q" in one for one in patterns):  # it may quote the parenthesis that ends its pattern here
        return None
    try:
        every = "|".join(f"(?:{one})" for one in patterns)
        search: Callable[[bytes], object] = _compiled(every, _MOST_BYTES).search
    except ValueError:  # all together are too large
        return None
    return search
