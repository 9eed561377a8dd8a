"""What `grep -sHa` printed of files of /proc and /sys -> the lines of each; and sums over them. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from srprov.untrusted import integer, lines_of

_MOST_LINES = 20_000
_LONGEST_LINE = 4096
MOST = 1 << 62
"""No counter that is believed is larger."""

Files = Mapping[str, Sequence[str]]
"""Path -> its lines; a file that is not there, or cannot be read, is missing."""


def by_file(out: str) -> Files:
    """Return the lines of each file; those of a path that has a colon are not told apart from its name."""
    found: dict[str, list[str]] = {}
    for line in lines_of(out, _MOST_LINES):
        path, colon, rest = line.partition(":")
        if colon and path.startswith("/"):
            found.setdefault(path, []).append(rest[:_LONGEST_LINE])
    return found


def number(text: str) -> int | None:
    """Return a whole number that is not negative; None for anything else."""
    value = integer(text, low=-1, high=MOST, default=-1)
    return None if value < 0 else value


def first(files: Files, path: str) -> int | None:
    """Return the number that a file begins with."""
    return number(files.get(path, ("",))[0])


def value_of(files: Files, path: str, key: str) -> int | None:
    """Return the number after a word at the begin of a line, as in `usage_usec 123`."""
    for line in files.get(path, ()):
        word, _, rest = line.partition(" ")
        if word == key:
            return number(rest)
    return None


def total(numbers: Iterable[int | None]) -> int | None:
    """Return the sum of those that are known; None without any."""
    known = [one for one in numbers if one is not None]
    return sum(known) if known else None


def links(lines: Sequence[str]) -> Mapping[str, tuple[int | None, int | None]]:
    """Return what stands in /proc/net/dev: interface -> bytes that it received, and that it sent."""
    found = {}
    for line in lines:
        name, colon, rest = line.partition(":")
        words = rest.split()
        if colon and len(words) >= _SENT + 1:
            found[name.strip()] = (number(words[0]), number(words[_SENT]))
    return found


_SENT = 8
"""The column of /proc/net/dev with the bytes that were sent."""
