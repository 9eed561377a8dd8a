"""What a failed command said, as the lines of a message. Pure."""

from __future__ import annotations

from srprov.wire import Command, EngineCall, Reply

_MOST_BYTES = 256 * 1024
_MOST_LINES = 40
"""Of what a failed command said."""
_LONGEST_LINE = 400
"""Characters of a line in a message."""


def failure_text(command: Command, reply: Reply) -> str:
    """Return the end of what a command said, then its status and its first words: what went wrong comes first."""
    text = command.text().splitlines()[0][:160]
    # the end of a build's output says more than its error
    streamed = isinstance(command, EngineCall) and command.stream and reply.status in command.accept
    parts = (reply.out, reply.err) if streamed else (reply.err or reply.out,)
    said = [line for part in parts for line in last_lines(part, _MOST_LINES)]
    if len(said) == 1:
        what = said[0]
    elif said:
        what = "\n    ".join(["it failed\n  its last lines:", *said])
    else:
        what = "it failed, and said nothing"
    return f"{what}\n  status {reply.status} of {text}"


def last_lines(text: str, most: int) -> list[str]:
    """Return the last lines that say something, each no longer than can be read."""
    said = [line for line in text[-_MOST_BYTES:].splitlines() if line.strip()][-most:]
    return [line if len(line) <= _LONGEST_LINE else f"{line[:_LONGEST_LINE]}…" for line in said]
