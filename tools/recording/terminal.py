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
from collections.abc import Mapping
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


@dataclass(frozen=True)
class Span:
    """A text in one colour."""

    text: str
    color: str
    bold: bool


Row = tuple[Span, ...]


@dataclass
class Recording:
    """Screens with the second at which each appeared."""

    columns: int
    rows: int
    frames: list[tuple[float, tuple[Row, ...]]] = field(default_factory=list)
    now: float = 0.0

    def __post_init__(self) -> None:
        """Begin with an empty terminal."""
        self.screen = pyte.Screen(self.columns, self.rows)
        self.stream = pyte.ByteStream(self.screen)

    def run(self, command: str, folder: Path, environment: Mapping[str, str]) -> int:
        """Type a command, run it in a shell, show what it prints, and return its exit code."""
        self._show(b"\x1b[32m$\x1b[0m ")
        for letter in command:
            self.now += TYPING_S
            self._show(letter.encode())
        self._show(b"\r\n")
        code = self._play(command, folder, environment)
        self.now += PAUSE_S
        return code

    def _play(self, command: str, folder: Path, environment: Mapping[str, str]) -> int:
        master, slave = pty.openpty()
        fcntl.ioctl(master, termios.TIOCSWINSZ, struct.pack("HHHH", self.rows, self.columns, 0, 0))
        program = subprocess.Popen(
            ["bash", "-c", command], stdin=slave, stdout=slave, stderr=slave, cwd=folder, env=environment
        )
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
