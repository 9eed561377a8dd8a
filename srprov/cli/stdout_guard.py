"""Standard output for answers alone: what libraries print by themselves goes to standard error.

Changes the process's file descriptors for the time of a block.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

_OUT, _ERR = 1, 2


@contextmanager
def answers_only() -> Iterator[None]:
    """Point file descriptor 1 at standard error for a block; solvers in C++ sometimes print a line to it."""
    try:
        saved = os.dup(_OUT)
    except OSError:  # it is closed: nothing can be printed to it
        yield
        return
    sys.stdout.flush()
    os.dup2(_ERR, _OUT)
    try:
        yield
    finally:
        if "ortools" in sys.modules:
            import ctypes

            ctypes.CDLL(None).fflush(None)  # what C still holds back
        os.dup2(saved, _OUT)
        os.close(saved)
