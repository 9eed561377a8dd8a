"""Two sets of values -> what differs between them, as text for people. Pure.

What comes from robots is untrusted: texts are cut, and a diff is bounded in what it reads and in what it shows.
"""

from __future__ import annotations

import difflib
import hashlib
from collections.abc import Collection, Mapping, Sequence

from srprov.resource import Difference
from srprov.secret import MASK
from srprov.wire import Query, Reply, quote

HIDDEN = "secret, changed"
ELSEWHERE = "*"
"""Among the variables that a container has of the controller: a file from outside of the experiment's folder."""
MOST_READ = 64 << 10
"""Bytes of an old file that are read to show what changes in it."""
_MOST_LINES = 1500
"""Lines of a file that are compared: what a robot says must not take minutes."""
_MOST_SHOWN = 60
"""Lines of a diff."""
_LONGEST_LINE = 300
_LONGEST_VALUE = 2000
_MOST_GONE = 100
_NOT_TEXT = ("\0", "\ufffd")


def compared(old: Mapping[str, str], new: Mapping[str, str]) -> tuple[Difference, ...]:
    """Return the fields that have another value, by name; an empty value counts as none."""
    pairs = ((field, old.get(field) or None, new.get(field) or None) for field in sorted({*old, *new}))
    return tuple(
        Difference(field=field, old=_cut(before, _LONGEST_VALUE), new=_cut(after, _LONGEST_VALUE))
        for field, before, after in pairs
        if before != after
    )


def bounded(every: Sequence[Difference]) -> tuple[Difference, ...]:
    """Return differences; of values that only the robot has, which may be without end, the first hundred."""
    gone = [one for one in every if one.new is None]
    if len(gone) <= _MOST_GONE:
        return tuple(every)
    left = {one.field for one in gone[_MOST_GONE:]}
    shown = (one for one in every if one.new is not None or one.field not in left)
    return (*shown, Difference(field="container", note=f"and {len(left)} more values that are there, and go"))


def untold(every: Sequence[Difference], had: Collection[str], has: Collection[str]) -> tuple[Difference, ...]:
    """Return differences without old values that were the controller's own, which no EDF of now was allowed to have.

    What comes in their place is shown: an image may bring the label that tells of them.

    Args:
        every: Of one container.
        had: What the container that is there took, as `ContainerParams.taken` has it.
        has: What the wanted one takes: files from elsewhere were allowed to it, too.
    """
    hidden, elsewhere = {f"environment.{name}" for name in had}, ELSEWHERE in had and ELSEWHERE not in has
    return tuple(
        Difference(field=one.field, old=MASK, new=one.new)
        if one.old is not None and (elsewhere or one.field in hidden)
        else one
        for one in every
    )


def read_start(path: str) -> Query:
    """Return what to ask for the first bytes of a file, one more than are compared."""
    return Query(command=f"head -c {MOST_READ + 1} {quote(path)} 2>/dev/null; :")


def text_difference(field: str, old: Reply, new: str) -> Difference:
    """Return how the content of a file changes: a unified diff, or why there is none; `old` is from `read_start`."""
    after = f"{len(new.encode('utf-8', 'replace'))} bytes"
    if not old.ok:
        return Difference(field=field, note=f"the old content was not read; new: {after}")
    if any(mark in text for mark in _NOT_TEXT for text in (old.out, new)):
        sha256 = hashlib.sha256(new.encode("utf-8", "surrogateescape")).hexdigest()
        return Difference(field=field, note=f"no text; new: {after}, sha256 {sha256}")
    if max(len(old.out.encode()), len(new.encode("utf-8", "replace"))) > MOST_READ:
        return Difference(field=field, note=f"longer than {MOST_READ >> 10} KiB, not compared; new: {after}")
    before_lines, after_lines = old.out.splitlines(keepends=True), new.splitlines(keepends=True)
    if max(len(before_lines), len(after_lines)) > _MOST_LINES:
        return Difference(field=field, note=f"more than {_MOST_LINES} lines, not compared; new: {after}")
    return Difference(field=field, diff=_unified(before_lines, after_lines))


def whole_difference(field: str, old: Reply, new: str) -> Difference:
    """Return how the content of a file changes as `text_difference` does, but with each line of it that is new, whole.

    Of what cannot be compared in time, or is no text, or was not read, all lines are told as new ones.
    """
    read = old.ok and len(old.out.encode()) <= MOST_READ and not any(mark in old.out for mark in _NOT_TEXT)
    before, after = (text.removesuffix("\n").split("\n") for text in (old.out if read else "", new))
    if not read or max(len(before), len(after)) > _MOST_LINES:
        return Difference(field=field, diff=("@@ all of it @@", *(f"+{line}" for line in after)))
    lines = tuple(difflib.unified_diff(before, after, n=2, lineterm=""))[2:]
    return Difference(field=field, diff=lines, note="" if lines else "the end of its last line")


def line_diff(old: str, new: str) -> tuple[str, ...]:
    """Return the hunks of a unified diff of two values; nothing where neither has several lines, or one is empty."""
    before, after = ([f"{line}\n" for line in side.split("\n")] for side in (old, new))
    if not (old and new) or len(before) == len(after) == 1 or max(len(before), len(after)) > _MOST_LINES:
        return ()
    return _unified(before, after)


def _unified(before: list[str], after: list[str]) -> tuple[str, ...]:
    """Return the hunks of a unified diff; a last line without an end is said to have none, as diff(1) does."""
    lines: list[str] = []
    for line in list(difflib.unified_diff(before, after, n=2))[2:]:
        lines.append(_cut(line.rstrip("\r\n"), _LONGEST_LINE) or "")
        if not line.startswith("@@") and not line.endswith(("\n", "\r")):
            lines.append("\\ no newline at the end")
    if len(lines) > _MOST_SHOWN:
        return (*lines[:_MOST_SHOWN], f"\\ and {len(lines) - _MOST_SHOWN} more lines")
    return tuple(lines)


def _cut(text: str | None, most: int) -> str | None:
    if text is None or len(text) <= most:
        return text
    return f"{text[: most - 1]}… ({len(text)} characters)"
