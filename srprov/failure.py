"""What a robot or its engine says of what went wrong, in one line. Pure."""

from __future__ import annotations

from srprov.wire import Reply

_LOOKED_THROUGH = 10_000
"""Characters of an answer: a robot may send megabytes of single letters, each of them a word."""


def why(reply: Reply) -> str:
    """Return the words of an answer, at most 500 characters, or its status."""
    return " ".join((reply.err or reply.out)[:_LOOKED_THROUGH].split())[:500] or f"status {reply.status}"
