"""A function in a thread of its own."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import TypeVar

_T = TypeVar("_T")


def background(function: Callable[[], _T]) -> Future[_T]:
    """Start a function in a daemon thread: an executor's threads would be waited for at exit."""
    future: Future[_T] = Future()

    def run() -> None:
        try:
            future.set_result(function())
        except BaseException as error:  # raised where somebody waits
            future.set_exception(error)

    threading.Thread(target=run, name="background", daemon=True).start()
    return future
