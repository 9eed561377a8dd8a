"""The one place that prints. Everything is stripped of secrets and of control characters on its way out.

`out`, `out_json` and `err` print, `line_of` is for files. Answers go to standard output, all else to standard error, so
that `--json` and pipes stay clean.
"""

from __future__ import annotations

import json
import os
import re
import sys
import threading
import traceback
import warnings
from typing import Any, TextIO

import click

from srprov.secret import redact, redacted

_CONTROL = re.compile(
    r"\x1b\[[0-?]*[ -/]*[@-~]|\x1b[\]PX^_][^\x07\x1b]*(?:\x07|\x1b\\)|[\x00-\x08\x0b-\x1f\x7f-\x9f]"
    r"|[\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff]|[\U000e0000-\U000e007f]"
)
"""Whole CSI and OSC sequences first, so that no `[31m` is left; then every C0 but newline and tab, DEL, and C1; then
what turns the writing around, ends a line by another name, or is a letter that nobody sees."""
_NO_CHARACTER = re.compile("[\ud800-\udfff]")
"""Halves of characters, from JSON or from a path's bytes: no terminal takes them, and Python refuses to print them."""


def clean(text: str) -> str:
    """Return text without secrets, that cannot move the cursor, change colours, retitle the terminal or run backwards.

    A control character in the middle of a secret hides it from the first look, and one in the secret from the second.
    """
    return _NO_CHARACTER.sub("\ufffd", redact(_CONTROL.sub("", redact(text))))


def out(text: str) -> None:
    """Print an answer."""
    click.echo(clean(text))


def out_json(value: object) -> None:
    """Print an answer as one JSON document. Secrets are replaced in its texts, so that it stays JSON."""
    click.echo(_CONTROL.sub("", json.dumps(redacted(value), indent=2)))


def line_of(value: object) -> str:
    """Return a value as one line of JSON for a file, without secrets."""
    return json.dumps(redacted(value)) + "\n"


def err(text: str, color: str | None = None) -> None:
    """Print progress, a note or an error; `color` is one of click's names and only srprov's own."""
    click.echo(click.style(clean(text), fg=color) if color else clean(text), err=True)


def wants_color(stream: TextIO) -> bool:
    """Return whether a stream is a terminal that may be coloured; see no-color.org."""
    return stream.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


def catch_logs() -> None:
    """Send warnings that libraries log the same way as everything else; nothing else listens to them."""
    import logging

    class ToErr(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            err(self.format(record))

    logging.lastResort = ToErr(logging.WARNING)


def catch_stray() -> None:
    """Send what Python would print by itself (from threads, finalizers, of warnings) the same way as all else."""

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
