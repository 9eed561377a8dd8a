"""A program on a terminal: what a user of 40, 80 or 120 columns sees, and can scroll back to, by `pyte`."""

from __future__ import annotations

import fcntl
import os
import pty
import select
import struct
import subprocess
import termios
import time

import pyte

_LIMIT_S = 60.0
ROWS = 24


class Terminal:
    """A terminal with one program on it."""

    def __init__(self, *words: str, columns: int) -> None:
        """Start a program whose three standard streams are the terminal."""
        self.columns = columns
        self.screen = pyte.HistoryScreen(columns, ROWS, history=100_000, ratio=0.5)
        self.stream = pyte.ByteStream(self.screen)
        self.master, slave = pty.openpty()
        self._size(columns)
        env = {key: value for key, value in os.environ.items() if key not in ("NO_COLOR", "COLUMNS", "LINES")}
        self.process = subprocess.Popen(
            words, stdin=slave, stdout=slave, stderr=slave, env={**env, "TERM": "xterm-256color"}
        )
        os.close(slave)

    def _size(self, columns: int) -> None:
        fcntl.ioctl(self.master, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, columns, 0, 0))

    def resize(self, columns: int) -> None:
        """Make the terminal wider or narrower."""
        self._size(columns)
        self.screen.resize(columns=columns)
        self.columns = columns

    def type(self, text: str) -> None:
        os.write(self.master, text.encode())

    def read_until(self, text: str = "") -> None:
        """Show what the program prints, until a text is on the screen; without one, until it ends.

        Raises:
            TimeoutError: It took too long.
        """
        end = time.monotonic() + _LIMIT_S
        while not text or not any(text in line for line in self.screen.display):
            if time.monotonic() > end:
                self.process.kill()
                raise TimeoutError(f"'{text}' did not come within {_LIMIT_S:g} s")
            if not self._read(1.0):
                break

    def read_for(self, seconds: float) -> None:
        """Show what the program prints in the next seconds."""
        end = time.monotonic() + seconds
        while time.monotonic() < end and self._read(0.05):
            pass

    def _read(self, wait_s: float) -> bool:
        """Show what there is; False when the program has closed the terminal."""
        ready, _, _ = select.select([self.master], [], [], wait_s)
        if ready:
            try:
                data = os.read(self.master, 65536)
            except OSError:
                return False
            self.stream.feed(data)
        return True

    def hang_up(self) -> None:
        """Close the terminal; the program is not told by a signal, as it does not lead its session."""
        os.close(self.master)
        self.master = -1

    def close(self) -> int:
        """Wait for the program's end and return its exit code."""
        try:
            return self.process.wait(_LIMIT_S)
        finally:
            self.process.kill()
            if self.master >= 0:
                os.close(self.master)

    def rows(self) -> Rows:
        """Return all rows, those that were scrolled away first, without blanks at their ends."""
        gone = [
            "".join(line[column].data for column in range(max(line, default=-1) + 1))
            for line in self.screen.history.top
        ]
        return Rows([line.rstrip() for line in (*gone, *self.screen.display)])


def folded(line: str, columns: int) -> list[str]:
    """Return a line as the rows that a terminal makes of it."""
    return [line[at : at + columns].rstrip() for at in range(0, len(line), columns)]


class Rows:
    """Rows of a terminal, in which many lines are looked for."""

    def __init__(self, rows: list[str]) -> None:
        self.rows = rows
        self.places: dict[str, list[int]] = {}
        for at, row in enumerate(rows):
            self.places.setdefault(row, []).append(at)

    def count(self, line: str, columns: int) -> int:
        """Count how often a line stands there, whole."""
        parts = folded(line, columns)
        return sum(self.rows[at : at + len(parts)] == parts for at in self.places.get(parts[0], ()))
