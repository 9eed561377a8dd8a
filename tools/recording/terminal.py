"""A program on a terminal, and what stands on its screen over time."""

from __future__ import annotations

import fcntl
import os
import pty
import select
import struct
import subprocess
import termios
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pyte

TYPING_S = 0.03
"""How long a character of a command takes to be typed."""
PAUSE_S = 1.5
"""How long what a command printed is looked at."""
LONGEST_S = 1.5
"""So much of a time in which nothing is printed is shown."""
SHORTEST_S = 0.2
"""Screens that stand for less are left out."""
PROGRESS_S = 5.0
"""So much of a time in which only one row changes is shown, such as a line that tells how far a build has come."""


@dataclass(frozen=True)
class Span:
    """A text in one colour."""

    text: str
    color: str
    bold: bool


Row = tuple[Span, ...]
Frame = tuple[float, tuple[Row, ...]]
"""A second, and the rows that stand on the screen from then on."""


@dataclass
class Recording:
    """Screens with the second at which each appeared."""

    columns: int
    rows: int
    frames: list[Frame] = field(default_factory=list)
    now: float = 0.0

    def __post_init__(self) -> None:
        """Begin with an empty terminal."""
        self.screen = pyte.Screen(self.columns, self.rows)
        self.stream = pyte.ByteStream(self.screen)

    def run(
        self, command: str, folder: Path, environment: Mapping[str, str], shell: Sequence[str] = ("bash", "-c")
    ) -> int:
        """Type a command, run it in a shell, show what it prints, and return its exit code."""
        self._show(b"\x1b[32m$\x1b[0m ")
        for letter in command:
            self.now += TYPING_S
            self._show(letter.encode())
        self._show(b"\r\n")
        code = self._play([*shell, command], folder, environment)
        self.now += PAUSE_S
        return code

    def shown(self) -> list[Frame]:
        """Return the frames; each time in which only one row changes is run through in PROGRESS_S at most."""
        found: list[Frame] = []
        cut, begin = 0.0, 0
        for end in range(1, len(self.frames) + 1):
            if end < len(self.frames) and _is_progress(self.frames[end - 1][1], self.frames[end][1]):
                continue
            first, last = self.frames[begin][0], self.frames[end - 1][0]
            pace = min(1.0, PROGRESS_S / (last - first)) if last > first else 1.0
            for at, rows in self.frames[begin:end]:
                now = first - cut + (at - first) * pace
                if not found or now - found[-1][0] >= SHORTEST_S or at == last:
                    found.append((now, rows))
            cut, begin = cut + (last - first) * (1 - pace), end
        return found

    def _play(self, words: Sequence[str], folder: Path, environment: Mapping[str, str]) -> int:
        master, slave = pty.openpty()
        fcntl.ioctl(master, termios.TIOCSWINSZ, struct.pack("HHHH", self.rows, self.columns, 0, 0))
        program = subprocess.Popen(words, stdin=slave, stdout=slave, stderr=slave, cwd=folder, env=environment)
        os.close(slave)
        last = time.monotonic()
        while data := _read(master):
            now = time.monotonic()
            self.now += min(now - last, LONGEST_S)
            last = now
            self._show(data)
        os.close(master)
        return program.wait()

    def _show(self, data: bytes) -> None:
        self.stream.feed(data)
        rows = tuple(_row(self.screen, at) for at in range(self.rows))
        if self.frames and self.now - self.frames[-1][0] < SHORTEST_S:
            rows_at = self.frames.pop()[0]
            self.frames.append((rows_at, rows))
        elif not self.frames or self.frames[-1][1] != rows:
            self.frames.append((self.now, rows))


def _is_progress(before: tuple[Row, ...], after: tuple[Row, ...]) -> bool:
    return sum(old != new for old, new in zip(before, after, strict=True)) == 1


def _read(master: int) -> bytes:
    """Return what a program printed; nothing when it has closed the terminal."""
    select.select([master], [], [])
    try:
        return os.read(master, 65536)
    except OSError:
        return b""


def _row(screen: pyte.Screen, at: int) -> Row:
    """Return a row of the screen as texts of one colour each, without blanks at its end."""
    spans: list[Span] = []
    for column in range(screen.columns):
        cell = screen.buffer[at][column]
        span = Span(cell.data, cell.fg, cell.bold)
        if spans and (spans[-1].color, spans[-1].bold) == (span.color, span.bold):
            spans[-1] = Span(spans[-1].text + span.text, span.color, span.bold)
        else:
            spans.append(span)
    while spans and not spans[-1].text.rstrip():
        spans.pop()
    if spans:
        spans[-1] = Span(spans[-1].text.rstrip(), spans[-1].color, spans[-1].bold)
    return tuple(spans)
