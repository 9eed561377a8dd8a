"""What a running shell is to whoever talks to it."""

from __future__ import annotations

from typing import Protocol


class Streams(Protocol):
    """The three streams of a running shell, none of which blocks."""

    def write(self, data: memoryview) -> int:
        """Send what fits now; 0 when nothing does."""

    def read(self) -> tuple[bytes, bytes]:
        """Return what is here of standard output and of standard error."""

    def wait(self, seconds: float, *, writing: bool) -> None:
        """Sleep until something can be read, or written when `writing`, or the seconds are over."""

    @property
    def ended(self) -> bool:
        """Tell whether nothing will come any more and all of it was read."""

    def reason(self) -> str:
        """Say why it ended."""

    def close(self) -> None:
        """End the shell; safe to call twice and from any thread."""
