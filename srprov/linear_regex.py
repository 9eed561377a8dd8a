"""Regular expressions of experiments, on lines that robots print: matched in time linear in both.

Python's `re` may take for ever on a pattern and a line that were made for it. RE2 cannot; it has no back references and
no look-around. Pure.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any

_MOST_BYTES = 8 << 20
"""Of memory that a compiled pattern may take."""


def check_pattern(pattern: str, groups: int = 0) -> None:
    """Refuse what is no pattern, or has fewer groups than are wanted.

    Raises:
        ValueError: It says why.
    """
    if compiled(pattern).groups < groups:
        raise ValueError(f"'{pattern[:60]}' has no group; put parentheses around the number")


@functools.lru_cache(maxsize=256)
def compiled(pattern: str) -> Any:  # noqa: ANN401 - google-re2 is not typed; it has the interface of `re.Pattern`
    """Return the compiled pattern.

    Raises:
        ValueError: It is none.
    """
    import re2

    options = re2.Options()
    options.max_mem, options.log_errors = _MOST_BYTES, False
    try:
        return re2.compile(pattern, options)
    except re2.error as error:
        said = error.args[0].decode("utf-8", "replace") if isinstance(error.args[0], bytes) else str(error)
        raise ValueError(f"'{pattern[:60]}' is no regular expression of RE2: {said}") from None


def any_of(patterns: Sequence[str]) -> Callable[[bytes], object] | None:
    """Return a search that finds something where any of these patterns does; None where each must be tried itself."""
    if any("\\Q" in one for one in patterns):  # it may quote the parenthesis that ends its pattern here
        return None
    try:
        search: Callable[[bytes], object] = compiled("|".join(f"(?:{one})" for one in patterns)).search
    except ValueError:  # all together are too large
        return None
    return search
