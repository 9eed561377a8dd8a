"""Ctrl-C or SIGTERM during a run: the first one asks for a soft end, the second one leaves at once.

A soft end is bounded, too: `execution/ending.py`.

A KeyboardInterrupt may be raised at any line of the main thread, and would take the report of what was done with it.
So while robots are changed, the first one only sets an event. Anywhere else SIGTERM is a KeyboardInterrupt too, so that
connections are closed and locks are free when the program is gone. In the middle of an import neither is raised at
once: importlib would be left with its lock held, and all threads that import anything would hang. Nor is it in a line
of paramiko's, which takes locks in one line and sees to their release in the next: to close the connection would wait
for ever. There it waits for half a second at most. Raised where nothing can be raised to, as in a destructor, it is
sent again.

CPython runs handlers in the main thread only, and a signal that comes just before that thread goes to sleep, or that
another thread receives, does not wake it: the handler would run when the wait is over, perhaps a minute later. So a
thread reads the interpreter's wakeup descriptor, which is written at once, and wakes the main thread.
"""

from __future__ import annotations

import _thread
import contextlib
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_SAID = b"\ninterrupted: running steps have 10 s to end, no new one begins; once more to leave at once\n"
_SIGNALS = (signal.SIGINT, signal.SIGTERM)


_AGAIN_S = 0.01
_MOST_AGAIN = 50
_again: list[int] = []
"""Signals that were put off for a lock since one was raised."""
_LOCKS = f"{os.sep}paramiko{os.sep}"
_WAKE = signal.SIGURG  # ignored by default, so it cannot end a child process that has not set its own handlers yet
_WAKE_AFTER_S = (0.02, 0.1, 0.5)  # the first may come too early as well


def as_interrupt() -> None:
    """Let SIGTERM end the program as Ctrl-C does; elsewhere than in the main thread, do nothing."""
    if threading.current_thread() is threading.main_thread():
        for number in _SIGNALS:
            signal.signal(number, _leave)
        sys.unraisablehook = _raise_again
        signal.signal(_WAKE, lambda number, frame: None)
        woken, wakes = os.pipe()
        os.set_blocking(wakes, False)
        signal.set_wakeup_fd(wakes, warn_on_full_buffer=False)
        threading.Thread(target=_wake_main_thread, args=(woken,), name="signals", daemon=True).start()


def _wake_main_thread(woken: int) -> None:
    main = threading.main_thread().ident
    while received := os.read(woken, 1):
        if main is not None and received[0] in _SIGNALS:
            for pause in _WAKE_AFTER_S:
                time.sleep(pause)
                signal.pthread_kill(main, _WAKE)


def _leave(number: int, frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt, as soon as no import is under way in the main thread, and no lock half taken."""
    if _locking(frame) and len(_again) < _MOST_AGAIN:
        _again.append(number)
    elif not _importing(frame):
        _again.clear()
        raise KeyboardInterrupt
    _thread.start_new_thread(_send_again, (number,))


def _locking(frame: FrameType | None) -> bool:
    return frame is not None and _LOCKS in frame.f_code.co_filename


def _raise_again(lost: sys.UnraisableHookArgs) -> None:
    if lost.exc_type is KeyboardInterrupt:
        _thread.start_new_thread(_send_again, (signal.SIGINT,))
    else:
        sys.__unraisablehook__(lost)


def _importing(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False


def _send_again(number: int) -> None:
    time.sleep(_AGAIN_S)
    os.kill(os.getpid(), number)


@contextmanager
def soft_interrupt(stop: threading.Event, said: bytes = _SAID) -> Iterator[None]:
    """Set `stop` at the first signal, raise KeyboardInterrupt at the second; elsewhere than in main, do nothing."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    asked: list[int] = []

    def ask(number: int, frame: FrameType | None) -> None:
        if asked or stop.is_set():
            _leave(number, frame)
            return
        asked.append(number)
        # This thread may be inside `stop.wait()` and hold its lock, or start a thread: to set it here would hang then.
        _thread.start_new_thread(stop.set, ())
        with contextlib.suppress(OSError):  # nobody may be there to read it any more
            os.write(2, said)  # the signal may have come in the middle of a print, which allows no other

    before = {number: signal.signal(number, ask) for number in _SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
