"""The user's terminal, lent to a program elsewhere: it gets every key, Ctrl-C too, and the window's size."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import termios
import threading
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from srprov.errors import TransportError


@contextmanager
def raw_terminal(resized: Callable[[int, int], None]) -> Iterator[None]:
    """Hand every key on as it is, for a block; `resized` is told rows and columns, at once and when they change."""
    descriptor = sys.stdin.fileno()
    before = termios.tcgetattr(descriptor)
    changed, over = threading.Event(), threading.Event()
    changed.set()

    def tell() -> None:
        while not over.is_set():
            changed.wait()
            changed.clear()
            if not over.is_set():
                size = os.get_terminal_size(descriptor)
                with contextlib.suppress(TransportError):  # whoever reads the output is told that it is lost
                    resized(size.lines, size.columns)

    def note(_number: int, _frame: FrameType | None) -> None:
        threading.Thread(target=changed.set, daemon=True).start()  # this thread may hold its lock

    handler = signal.signal(signal.SIGWINCH, note)
    tty.setraw(descriptor)
    threading.Thread(target=tell, name="window size", daemon=True).start()
    try:
        yield
    finally:
        over.set()
        changed.set()
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)
        signal.signal(signal.SIGWINCH, handler)
