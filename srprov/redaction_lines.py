"""A stream's lines without secrets: as many as came, none later than a moment, and no secret shown that lines break.

Who prints a line may be a robot that wants to know another one's password. So what becomes of a line, and how long that
takes, follows from whole secrets alone, never from how one begins: lines wait for those that come next whatever is in
them, and a line in which no secret stands is looked at twice at most.
"""

from __future__ import annotations

import threading
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from itertools import accumulate

from srprov.redaction import MASK, Known

_TOGETHER = 64 * 1024
"""Characters that are looked at together."""
_WAITING = 16 * 1024
"""Characters at the end of these that wait for what comes next: a secret may go on there."""
_MOST = _TOGETHER + _WAITING
"""Characters that wait at most: of secrets without end, one behind the other, what is hidden stays so."""
_MOMENT_S = 0.1
"""In which lines that are shown as they come are gathered."""


def lines_without(known: Known, batches: Iterable[Sequence[str]]) -> Iterator[str]:
    """Return lines without secrets; behind an empty batch none of those before it waits any more."""
    waiting: list[str] = []
    try:
        for batch in batches:
            shown, waiting = _shown(known, waiting, batch)
            yield from shown
    except Exception:  # the stream broke: what came before is shown first
        yield from _shown(known, waiting, ())[0]
        raise
    yield from _shown(known, waiting, ())[0]


def _shown(known: Known, waiting: Sequence[str], new: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return lines that need not wait any longer, without secrets, and those that wait, if they may as they are."""
    every = [*waiting, *new]
    text = "\n".join(every)
    starts = [0, *accumulate(len(line) + 1 for line in every)]
    first = max(len(waiting), bisect_right(starts, max(0, len(text) - _WAITING), hi=len(every)) - 1)
    if not new:
        first = len(every)
    spans, cut = known.masks(text), first
    for start, stop in reversed(spans):  # what is shown of a secret is not looked at again
        if start < starts[first] < stop:
            first = bisect_right(starts, start) - 1
    parts, end = list[str](), 0
    for start, stop in spans:
        parts += [text[end:start], "\n".join([MASK] * (text.count("\n", start, stop) + 1))]
        end = stop
    clean = "".join([*parts, text[end:]]).split("\n") if every else []
    return (clean[:cut], clean[cut:]) if len(text) - starts[first] > _MOST else (clean[:first], every[first:])


def together(lines: Iterable[str]) -> Iterator[list[str]]:
    """Return lines in batches of some size."""
    batch, size = list[str](), 0
    try:
        for line in lines:
            batch.append(line)
            size += len(line) + 1
            if size >= _TOGETHER:
                yield batch
                batch, size = [], 0
    except Exception:
        if batch:
            yield batch
        raise
    if batch:
        yield batch


def as_they_come(lines: Iterable[str]) -> Iterator[list[str]]:
    """Return lines in batches, each of a moment, and an empty one when nothing came for a moment."""
    inflow = _Inflow(lines)
    try:
        yield from inflow.batches()
    finally:
        inflow.over.set()
        inflow.taken()


class _Inflow:
    """Lines that a thread takes, as many as have room here."""

    def __init__(self, lines: Iterable[str]) -> None:
        self.over = threading.Event()
        self._changed = threading.Condition()
        self._lines: list[str] = []
        self._size = 0
        self._ended = False
        self._error: Exception | None = None
        threading.Thread(target=self._take, args=(lines,), name="lines", daemon=True).start()

    def taken(self) -> list[str]:
        """Return what is here, and let more come."""
        with self._changed:
            lines, self._lines, self._size = self._lines, [], 0
            self._changed.notify_all()
            return lines

    def batches(self) -> Iterator[list[str]]:
        """Return them, moment by moment."""
        waiting = False
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._lines or self._ended, _MOMENT_S if waiting else None)
                if self._lines:
                    self._changed.wait_for(self._is_full, _MOMENT_S)
            batch = self.taken()
            if batch or waiting:
                yield batch
            elif self._ended:
                break
            waiting = bool(batch)
        if self._error is not None:
            raise self._error

    def _is_full(self) -> bool:
        return self._ended or self.over.is_set() or self._size >= _TOGETHER

    def _take(self, lines: Iterable[str]) -> None:
        try:
            for line in lines:
                with self._changed:
                    self._changed.wait_for(lambda: self.over.is_set() or self._size < _TOGETHER)
                    self._lines.append(line)
                    self._size += len(line) + 1
                    self._changed.notify_all()
                if self.over.is_set():
                    return
        except Exception as error:  # whoever takes the lines is told, behind them
            self._error = error
        finally:
            with self._changed:
                self._ended = True
                self._changed.notify_all()
