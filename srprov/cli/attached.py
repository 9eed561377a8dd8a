"""A command that runs elsewhere, with this process's standard streams: what `exec` and `ssh` pass on."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from srprov.cli.output import clean, err
from srprov.cli.streams import lost
from srprov.codes import Code
from srprov.errors import UsageError

if TYPE_CHECKING:
    from srprov.session import ContainerCommand

NOT_RUN = 255
_SHELLS = frozenset({"sh", "bash", "ash", "dash", "zsh", "fish"})
_PIECE = 64 * 1024


def check_terminal(wanted: bool) -> None:
    """Refuse -t where there is no terminal to lend.

    Raises:
        UsageError: Input or output is none.
    """
    if wanted and not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise UsageError(
            "-t needs a terminal", hint="leave it out where input or output is a file or a pipe", code=Code.OPTIONS
        )


def check_inventories(inventories: Sequence[str]) -> None:
    """Refuse `-it`, which other tools have for a terminal: here it is `-i t`.

    Raises:
        UsageError: So it was, and there is no inventory of that name.
    """
    if "t" in inventories and not os.path.lexists("t"):
        hint = "a terminal is -t alone: standard input is passed on by itself; -i names the inventory"
        raise UsageError("-it is the inventory 't', which is not there", hint=hint, code=Code.NO_FILE)


def in_one_word(command: Sequence[str]) -> str:
    """Return what to do about a command that was written as one word, which a shell would split; else nothing."""
    if len(command) != 1 or not {" ", "|", ";", ">", "*", "&"} & set(command[0]):
        return ""
    return "a command's words are passed on without a shell: -- sh -c '…'"


def of_no_use(command: Sequence[str], *, terminal: bool) -> str:
    """Return why a shell ends at once: it has no terminal, and nothing to read; else nothing."""
    shell = len(command) == 1 and command[0].rpartition("/")[2] in _SHELLS
    useless = shell and not terminal and sys.stdin.isatty()
    return "a shell needs -t: without it, no keys are passed on" if useless else ""


def passed_on(running: ContainerCommand, *, stdin: bool, terminal: bool) -> int | None:
    """Pass the streams on until the command ends; return its code, or None when it has none.

    It is 0 when nobody reads standard output any more.
    """
    try:
        with _passing(running, stdin=stdin, terminal=terminal):
            for stream, data in running.output():
                _print(stream, data, raw=terminal)
                if lost(sys.stdout):
                    return 0  # whoever read it has seen enough
        return running.exit_code()
    finally:
        running.close()


@contextmanager
def _passing(running: ContainerCommand, *, stdin: bool, terminal: bool) -> Iterator[None]:
    """Pass standard input on, and with a terminal all keys and its size."""
    if stdin:
        threading.Thread(target=pass_input, args=(running,), name="standard input", daemon=True).start()
    if not terminal:
        yield
        return
    from srprov.cli.raw_terminal import raw_terminal

    with raw_terminal(running.resize):
        yield


def pass_input(running: ContainerCommand) -> None:
    """Pass it on to its end, or to where it cannot be read: it may be a folder, or not want to wait."""
    try:
        while data := os.read(sys.stdin.fileno(), _PIECE):
            running.write(data)
    except OSError as error:
        err(f"warning: standard input cannot be read: {error.strerror}")
    finally:
        running.close_input()


def _print(stream: int, data: bytes, *, raw: bool) -> None:
    """Write bytes as they are; on a terminal that was not lent to the command, as any other text of robots."""
    target = sys.stdout if stream == 1 else sys.stderr
    if not raw and target.isatty():
        data = clean(data.decode("utf-8", "replace")).encode("utf-8", "replace")
    target.buffer.write(data)
    target.buffer.flush()
