"""srprov as a program that kills itself at one line of a run's journal: `python -m tests.lab.killed LINE PART WORD…`.

PART `torn`: as half of the line is in the file, so all that was done before it is done; `whole`: as it is on the disk,
so nothing that comes after it is.
"""

from __future__ import annotations

import os
import signal
import sys
from typing import Any

from srprov.cli.main import entry
from srprov.record import journal


class _Os:
    """The module `os`, whose `write` counts."""

    def __init__(self, line: int, part: str) -> None:
        self._left, self._part = line, part

    def __getattr__(self, name: str) -> Any:
        return getattr(os, name)

    def write(self, descriptor: int, data: bytes) -> int:
        self._left -= 1
        if self._left:
            return os.write(descriptor, data)
        written = os.write(descriptor, data if self._part == "whole" else data[: len(data) // 2])
        os.fsync(descriptor)
        os.kill(os.getpid(), signal.SIGKILL)
        return written


if __name__ == "__main__":
    setattr(journal, "os", _Os(int(sys.argv[1]), sys.argv[2]))  # noqa: B010 - mypy knows it as a module
    sys.argv[1:] = sys.argv[3:]
    entry()
