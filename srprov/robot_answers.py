"""What goes wrong with a robot's answers is that robot's failure, and nobody else's.

Whoever parses answers does so within `answers_of`. Touches nothing.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from srprov.codes import Code
from srprov.errors import SrprovError, TransportError
from srprov.untrusted import lines_of, text

MOST_LINES = 65_536
"""Of one answer. The most things of a kind are 10,000, and some have two lines; an empty line takes memory, too."""


class TooManyError(Exception):
    """A robot names more things of a kind than it is believed; the text says how many those are."""


def all_lines(out: str) -> list[str]:
    """Return the lines of an answer.

    Raises:
        TooManyError: There are more than are read: what is not read would pass for gone.
    """
    lines = lines_of(out, MOST_LINES + 1)
    if len(lines) > MOST_LINES:
        raise TooManyError(f"one of its answers has more than {MOST_LINES} lines")
    return lines


@contextlib.contextmanager
def answers_of(robot: str) -> Iterator[None]:
    """Read a robot's answers: what goes wrong with them is that robot's failure (TransportError), and nobody else's."""
    try:
        yield
    except SrprovError:
        raise
    except TooManyError as error:
        raise TransportError(
            robot, str(error), hint="remove there what is not used any more", code=Code.ANSWER
        ) from error
    except Exception as error:  # parsers do not raise; the one that does must not end the run of all others
        message = f"its answers cannot be read: {type(error).__name__}: {text(str(error))}"
        raise TransportError(robot, message, hint="report it, with what the robot answers", code=Code.ANSWER) from error
