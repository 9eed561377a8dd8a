"""`srprov cp`: files and folders from a service's container to here, and the other way."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import click

from srprov.cli import inputs, options
from srprov.cli.codes import FAILED
from srprov.cli.output import Answer, counted, err, expect, is_terminal, wants_color
from srprov.cli.streams import lost
from srprov.codes import Code
from srprov.errors import UsageError, visible

if TYPE_CHECKING:
    from srprov.controller.copied import Copied
    from srprov.controller.copied_in import Owner
    from srprov.controller.copying import InService
    from srprov.controller.located import Located
    from srprov.definitions.model import Experiment
    from srprov.session import Session

_PIECE = 1 << 20
_OWNER = re.compile(r"([0-9]{1,10})(?::([0-9]{1,10}))?")


def _owner(_context: click.Context, _option: click.Parameter, text: str) -> tuple[int, int]:
    found = _OWNER.fullmatch(text)
    if found is None:
        raise click.BadParameter(f"{text[:60]!r} is not UID or UID:GID.")
    return int(found[1]), int(found[2] or found[1])


@click.command()
@click.argument("file", metavar="FILE")
@click.argument("source", metavar="SOURCE", type=click.Path())
@click.argument("destination", metavar="TARGET", type=click.Path())
@options.robots_without_json
@options.INSTANCE
@click.option("-p", "--preserve", is_flag=True,
              help="From a container: keep permissions and times; else files are yours alone.")  # fmt: skip
@click.option("--owner", callback=_owner, default="0:0", show_default=True, metavar="UID[:GID]",
              help="Into a container: whose the files are there.")  # fmt: skip
def cp(
    file: str, source: str, destination: str, inventories: tuple[str, ...], forks: int, timeout: float, instance: str,
    preserve: bool, owner: tuple[int, int],
) -> int:  # fmt: skip
    """Copy a file or folder from a service's container (SERVICE:/path) to here, or from here into one.

    SERVICE is a name of the EDF that runs once, a replica, or SERVICE@ROBOT; its container need not run. The rules are
    those of cp -r: what is there is replaced, into a folder that is there the copy goes under its own name, and DIR/.
    is the content of a folder, which does not go where you work. `-` is a tar, on standard output or from standard
    input.

    What is copied into a container is no part of the experiment: it is gone when apply makes the container anew, and
    plan does not show it. Volumes keep it.

    From a container, a link comes as a file of its own, and one to a folder of the copy not at all. Exits with 0; with
    3 when something is missing: links to what did not come, devices, pipes, sockets, repositories; with 4 when the
    robot is lost; with 7 when somebody else holds the robot, and the container does not run; with 9 for what a Docker
    Engine before 29.5.1 cannot be asked safely (docs/daily-use.md).
    """
    from srprov.controller.copying import place

    here, there = place(source), place(destination)
    service = here if not isinstance(here, str) else there
    if isinstance(service, str) or not (isinstance(here, str) or isinstance(there, str)):
        hint = "e.g. navigator:/out/result.json . ; between two containers: cp A:/x - into cp - B:/y"
        raise UsageError("one of SOURCE and TARGET is SERVICE:/path, the other is here", hint=hint, code=Code.OPTIONS)
    if destination == "-" and sys.stdout.isatty():
        raise UsageError(
            "a tar is nothing for a terminal", hint="let it go into a file or a program: | tar t", code=Code.OPTIONS
        )
    experiment = inputs.experiment_if_valid(file)
    with _located(file, service.service, inventories, forks, timeout, instance, experiment) as (session, where):
        container = where.container
        if isinstance(there, str):
            assert not isinstance(here, str)
            believed = (file, *inventories, *_made_from(file))
            return _out(session, container, here, there, preserve=preserve, believed=believed)
        assert isinstance(here, str)
        from srprov.controller.copied_in import Owner

        return _into(session, container, here, there, Owner(*owner))


def _made_from(file: str) -> Collection[str]:
    """Return what an EDF is made from; of one that is not valid, which may name any file there, its whole folder."""
    from srprov.controller.made_from import files_of

    if own := files_of(file):
        return own
    err(f"note: {visible(file)} is not valid, so nothing is copied into its folder, until `srprov validate` takes it")
    return (os.path.dirname(file) or os.curdir,)


@contextmanager
def _located(
    file: str, service: str, inventories: tuple[str, ...], forks: int, timeout: float, instance: str,
    experiment: Experiment | None,
) -> Iterator[tuple[Session, Located]]:  # fmt: skip
    """Find the one container that is meant, and give the session with its robot."""
    from srprov.controller.located import locate
    from srprov.controller.sent_to import trusted
    from srprov.controller.standing_still import standing_still
    from srprov.controller.turned import refuse_turned
    from srprov.facts.gather import Detail

    inventory = inputs.load_inventory(inventories)
    name, source = inputs.named_instance(file, instance)
    with inputs.connect(inventory, timeout, forks) as fleet:
        where = trusted(locate(fleet.gather(Detail.BASIC), name, experiment), service, source)
        session = fleet.sessions.get(where.host)  # of a robot that is out of reach nothing was found
        if where.found is None:
            raise UsageError(
                f"{where.where}: its container is not there", hint="`srprov apply` makes it", code=Code.NOTHING_RUNS
            )
        refuse_turned(session, where.container)
        with standing_still(session, where.container):
            yield session, where


def _out(
    session: Session, container: str, source: InService, target: str, *, preserve: bool, believed: Collection[str]
) -> int:
    from srprov.controller.copied import Copied
    from srprov.controller.copying import copy_out, raw_out

    copied = Copied()
    if target == "-":
        for piece in raw_out(session, container, source, copied):
            sys.stdout.buffer.write(piece)
            if lost(sys.stdout):
                break  # main says so, unless the reader has seen enough
        sys.stdout.buffer.flush()
        return _left_out(copied)
    with _shown(copied), _in_words():
        copy_out(session, container, source, target, copied, preserve=preserve, believed=believed)
    return _told(copied)


def _into(session: Session, container: str, source: str, target: InService, owner: Owner) -> int:
    from srprov.controller.copied import Copied
    from srprov.controller.copying import copy_into, raw_into

    copied = Copied()
    with _shown(copied):
        if source == "-":
            raw_into(session, container, _standard_input(copied), target)
        else:
            copy_into(session, container, source, target, owner, copied)
    return _told(copied) if source != "-" else 0


def _standard_input(copied: Copied) -> Iterator[bytes]:
    try:
        while piece := os.read(sys.stdin.fileno(), _PIECE):
            copied.bytes += len(piece)
            yield piece
    except OSError as error:
        raise UsageError(f"standard input cannot be read: {error.strerror}", code=Code.NO_FILE) from error


@contextmanager
def _in_words() -> Iterator[None]:
    """Say which file of this machine cannot be written."""
    try:
        yield
    except OSError as error:
        hint = "files that were copied before are whole"
        where = f"{visible(error.filename)}: " if isinstance(error.filename, str) else ""
        raise UsageError(f"{where}{error.strerror or error}", hint=hint, code=Code.CANNOT_WRITE) from error


@contextmanager
def _shown(copied: Copied) -> Iterator[None]:
    """Say on a terminal how much was copied so far."""
    expect(Answer.ASIDE)
    if not is_terminal(sys.stderr):
        yield
        return
    from srprov.cli.status_line import status_line

    with status_line(lambda: f"{_amount(copied)} copied", color=wants_color(sys.stderr)):
        yield


def _told(copied: Copied) -> int:
    code = _left_out(copied)
    err(f"{_amount(copied)} copied")
    return code


def _left_out(copied: Copied) -> int:
    for line in copied.left_out:
        err(f"left out: {line}")
    if copied.more_left_out:
        err(f"left out: {copied.more_left_out} more")
    return FAILED if copied.lost else 0


def _amount(copied: Copied) -> str:
    size = copied.bytes
    words = f"{size} bytes" if size < 1 << 20 else f"{size / (1 << 20):.1f} MiB"
    return f"{counted(copied.files, 'file')}, {words}"
