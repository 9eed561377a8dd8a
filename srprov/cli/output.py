"""The one place that prints. Everything is stripped of secrets and of control characters on its way out.

`out`, `out_json` and `err` print, `line_of` is for files. Answers go to standard output, all else to standard error, so
that `--json` and pipes stay clean.
"""

from __future__ import annotations

import enum
import json
import os
import re
import sys
import threading
import traceback
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, TextIO

import click

from srprov.cli.codes import UNREACHABLE
from srprov.secret import redact, redacted

_CONTROL = re.compile(
    r"\x1b\[[0-?]*[ -/]*[@-~]|\x1b[\]PX^_][^\x07\x1b\n]*(?:\x07|\x1b\\)|[\x00-\x08\x0b-\x1f\x7f-\x9f]"
    r"|[\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff]|[\U000e0000-\U000e007f]"
)
"""Whole CSI and OSC sequences first, so that no `[31m` is left; then C0 except newline and tab, DEL and C1; then what
changes the direction of the text, other line separators, and characters that are invisible."""
_NO_CHARACTER = re.compile("[\ud800-\udfff]")
"""Lone surrogates, from JSON or from the bytes of a path: Python refuses to encode them."""


class Answer(enum.Enum):
    """What it means when standard output cannot be written."""

    TEXT = "the answer is lost, unless its reader went away: `srprov status | head` is fine"
    WHOLE = "the answer is lost: a part of a JSON document is none"
    ASIDE = "nothing: what counts was done on the robots"


expected = Answer.TEXT


def expect(answer: Answer) -> None:
    """Say what this run's standard output is for."""
    global expected  # noqa: PLW0603 - there is one standard output
    expected = answer


def clean(text: str) -> str:
    """Return text without secrets that cannot move the cursor, change colors, retitle the terminal or run backwards.

    A control character in the middle of a secret hides it from the first look, and one in the secret from the second.
    """
    return printable(redact(_CONTROL.sub("", redact(text, for_people=True)), for_people=True))


def printable(text: str) -> str:
    """Return text as `clean` does, with whatever looks like a secret: for what says the same whatever a secret is.

    What an experiment asks for is such: a stranger chooses what his secrets are, and could hide it otherwise.
    """
    return _NO_CHARACTER.sub("\ufffd", _CONTROL.sub("", text))


def out(text: str) -> None:
    """Print an answer."""
    click.echo(clean(text))


def out_whole(text: str, paint: Callable[[str], str] = str) -> None:
    """Print an answer that is without secrets where it may hold one, as it is; on a terminal `paint` adds colors."""
    shown = printable(text)
    click.echo(paint(shown) if wants_color(sys.stdout) else shown)


def out_anew(text: str) -> None:
    """Print an answer in the place of the one before it on a terminal, elsewhere below it, after an empty line."""
    if sys.stdout.isatty():
        click.clear()
    else:
        click.echo()
    out(text)


def out_labelled(label: str, text: str, color: str | None) -> None:
    """Print a line of a stream after its label; `color` is one of click's names, and only the label's."""
    click.echo((click.style(clean(label), fg=color) if color else clean(label)) + clean(text))


def out_json_line(value: object) -> None:
    """Print one JSON document of a stream of them, in one line."""
    click.echo(_CONTROL.sub("", json.dumps(redacted(value))))


def out_json(value: object) -> None:
    """Print an answer as one JSON document. Secrets are replaced in its texts, so that it stays JSON."""
    _out_json(redacted(value))


def out_json_whole(value: Mapping[str, object], whole: Collection[str]) -> None:
    """Print a JSON document of which some keys hold what `printable` is for."""
    _out_json({key: one if key in whole else redacted(one) for key, one in value.items()})


def _out_json(value: object) -> None:
    expect(Answer.WHOLE)
    click.echo(_CONTROL.sub("", json.dumps(value, indent=2)))


def line_of(value: object) -> str:
    """Return a value as one line of JSON for a file, without secrets."""
    return json.dumps(redacted(value)) + "\n"


def err(text: str, color: str | None = None) -> None:
    """Print progress, a note or an error; `color` is one of click's names and only srprov's own."""
    _print_err(clean(text), color)


def err_whole(text: str) -> None:
    """Print an error that says what `printable` is for."""
    _print_err(printable(text), None)


def _echo_err(text: str, color: str | None) -> None:
    click.echo(click.style(text, fg=color) if color else text, err=True)


_print_err: Callable[[str, str | None], None] = _echo_err


@contextmanager
def printed_by(printer: Callable[[str, str | None], None]) -> Iterator[None]:
    """Let another function print what `err` is given, for a block; it takes clean text and a color or None."""
    global _print_err  # noqa: PLW0603 - there is one standard error
    before, _print_err = _print_err, printer
    try:
        yield
    finally:
        _print_err = before


def below(message: str) -> str:
    """Return an error's message as it stands above its hint: further lines are deeper than that, whoever's words."""
    return message.replace("\n", "\n  ")


def tell_unreachable(unreachable: Mapping[str, str]) -> int:
    """Print a line for every robot that could not be reached, and return the exit code that follows from them."""
    for host, reason in sorted(unreachable.items()):
        err(f"unreachable: {host}: {reason}")
    return UNREACHABLE if unreachable else 0


def wants_color(stream: TextIO) -> bool:
    """Return whether a stream is a terminal that may be coloured; see no-color.org."""
    return is_terminal(stream) and not os.environ.get("NO_COLOR")


def is_terminal(stream: TextIO) -> bool:
    """Return whether a stream is a terminal on which a line can be drawn again."""
    return stream.isatty() and os.environ.get("TERM") != "dumb"


def catch_logs() -> None:
    """Print warnings that libraries log through `err`; nothing else listens to them."""
    import logging

    class ToErr(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            err(self.format(record))

    logging.lastResort = ToErr(logging.WARNING)


def print_uncaught() -> None:
    """Print errors of threads and finalizers, warnings, and what nobody caught through `err`, not as Python does."""

    def thread(args: threading.ExceptHookArgs) -> None:
        if args.exc_type is not SystemExit:
            err("".join(traceback.format_exception(args.exc_type, args.exc_value, args.exc_traceback)))

    def stray(args: Any) -> None:  # noqa: ANN401 - sys.UnraisableHookArgs, which exists for type checkers only
        err("".join(traceback.format_exception(args.exc_type, args.exc_value, args.exc_traceback)))

    def warn(
        message: Warning | str, category: type[Warning], filename: str, lineno: int,
        file: TextIO | None = None, line: str | None = None,
    ) -> None:  # fmt: skip
        err(f"{filename}:{lineno}: {category.__name__}: {message}")

    threading.excepthook, sys.unraisablehook = thread, stray
    warnings.showwarning = warn
    sys.excepthook = lambda kind, value, trace: err("".join(traceback.format_exception(kind, value, trace)))


def counted(number: int, noun: str) -> str:
    """Return a number of things, such as `1 image` or `2 images`."""
    return f"{number} {noun}{'s' * (number != 1)}"
