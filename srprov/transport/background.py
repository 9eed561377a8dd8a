"""A function's value, or its error, from a thread of its own."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

_T = TypeVar("_T")


class Background(Generic[_T]):
    """A function that runs in a thread; `result()` gives its value or raises its error."""

    def __init__(self, function: Callable[[], _T]) -> None:
        """Start it."""
        self._values: list[_T] = []
        self._error: BaseException | None = None
        self._function = function
        self._thread = threading.Thread(target=self._run, name="background", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            self._values.append(self._function())
        except BaseException as error:  # handed to whoever waits
            self._error = error

    def result(self) -> _T:
        """Wait for the end."""
        self._thread.join()
        if self._error is not None:
            raise self._error
        return self._values[0]
