"""Options for what a verb prints and writes: `--quiet`, `--timings`, `--events` and files for output."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable
from typing import Any, TextIO, TypeVar

import click

from srprov import private, regular_file
from srprov.cli.output import err
from srprov.codes import Code
from srprov.errors import UsageError

_F = TypeVar("_F", bound=Callable[..., Any])
_T = TypeVar("_T")


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


class _Output(click.File):
    """A text file that is begun anew in the place of what is there; `-` is standard output."""

    name = "filename"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:  # noqa: ANN401 - as click has it
        if not isinstance(value, str) or value == "-":
            return super().convert(value, param, ctx)
        _check_way(os.path.dirname(value))
        try:
            stream = private.open_output(value)
        except OSError as error:
            self.fail(f"cannot write {value}: {error.strerror}", param, ctx)
        if ctx is not None:
            ctx.call_on_close(lambda: _close(stream))
        return stream


def _close(stream: TextIO) -> None:
    with contextlib.suppress(OSError):  # a full disk was told of when something was written
        stream.close()


EVENTS = click.option(
    "--events", type=_Output("w", encoding="utf-8", lazy=False), metavar="FILE",
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
    try:
        if path is not None:
            private.check_output(path)
    except OSError as error:
        raise click.BadParameter(f"cannot write {path}: {error.strerror}") from None
    return path


def no_link(_context: click.Context, _option: click.Parameter, folder: _T) -> _T:
    """Refuse a link in the place of a folder that is filled: with a project that was cloned come links of a stranger's.

    However it is written: `DIR/` and `DIR/.` are what the link leads to for the kernel. Of a relative path, a folder
    above that is named in it may be such a link, too.
    """
    path = str(folder)
    if link := folder if os.path.islink(os.path.abspath(path)) else next(regular_file.links_in(path), ""):
        hint = "name the folder itself, or a new one: its whole path is taken as it is"
        why = f"{link} is a link, and nothing is written by way of it"
        raise UsageError(why, hint=hint, code=Code.STRANGE_FILE)
    return folder


def no_way_out(_context: click.Context, _option: click.Parameter, folder: _T) -> _T:
    """Refuse a folder that is kept, of a relative path in which a link leads out: a project may have brought it.

    One that stays is the project's own matter, and a whole path the user's.
    """
    if folder is not None:
        _check_way(str(folder))
    return folder


def no_link_in(_context: click.Context, _option: click.Parameter, file: str) -> str:
    """Refuse what is passed on, of a relative path with a link in it."""
    from srprov.definitions import refuse_link

    refuse_link(file)
    return file


def no_way_above(_context: click.Context, _option: click.Parameter, file: _T) -> _T:
    """Refuse a file to write that lies in such a folder; what has its own name is replaced, also where it is a link."""
    if file is not None:
        _check_way(os.path.dirname(str(file)))
    return file


def written(context: click.Context, option: click.Parameter, path: str | None) -> str | None:
    """Return the path of a file that is written once all is known: no link leads it out, and it can be written."""
    return writable(context, option, no_way_above(context, option, path))


def _check_way(folder: str) -> None:
    from srprov.definitions import refuse_link_out

    refuse_link_out(folder)
