"""Options for what a verb prints and writes: `--quiet`, `--timings`, `--events` and files for output."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, TypeVar

import click

from srprov.cli.output import err

_F = TypeVar("_F", bound=Callable[..., Any])


def _flag(name: str, *flags: str, text: str) -> Callable[[_F], _F]:
    """Return an option that `_wanted` knows about, so that no verb hands it on."""

    def remember(context: click.Context, _option: click.Parameter, wanted: bool) -> None:
        context.meta[f"srprov.{name}"] = wanted

    return click.option(*flags, is_flag=True, expose_value=False, callback=remember, help=text)


def _wanted(name: str) -> bool:
    context = click.get_current_context(silent=True)
    return bool(context and context.meta.get(f"srprov.{name}"))


TIMINGS = _flag("timings", "--timings", text="Say at the end where the time went, by phase and robot.")
QUIET = _flag(
    "quiet", "-q", "--quiet",
    text="Print only warnings, errors and the last line; the plan only before the question about it.",
)  # fmt: skip
EVENTS = click.option(
    "--events", type=click.File("w", encoding="utf-8", lazy=False), metavar="FILE",
    help="Write events to a file as they happen, one JSON per line.",
)  # fmt: skip


def wants_timings() -> bool:
    """Return whether the user wants to know where the time went."""
    return _wanted("timings")


def is_quiet() -> bool:
    """Return whether the user wants to see only warnings, errors and the last line."""
    return _wanted("quiet")


def note(text: str) -> None:
    """Print progress, unless the user wants none."""
    if not is_quiet():
        err(text)


def writable(_context: click.Context, _option: click.Parameter, path: str | None) -> str | None:
    """Return the path of a file to write, which nothing was written to yet; the callback of such an option.

    Raises:
        BadParameter: It cannot be opened, which is known so before any robot is asked.
    """
    there = path is not None and os.path.lexists(path)
    if path is None or (there and not os.path.isfile(path)):  # a pipe or a device: opened only to write
        return path
    try:
        with open(path, "ab"):
            pass
    except OSError as error:
        raise click.BadParameter(f"cannot write {path}: {error.strerror}") from None
    if not there:
        os.unlink(path)
    return path
