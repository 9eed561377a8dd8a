"""`srprov init`: the files of a new experiment, or of an example."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping
from pathlib import Path

import click

from srprov import private, regular_file
from srprov.cli.output import err, out
from srprov.cli.output_options import no_link
from srprov.codes import Code
from srprov.errors import UsageError, visible
from srprov.wire import sh


@click.command()
@click.argument(
    "folder", metavar="[DIR]", default=".", type=click.Path(file_okay=False, path_type=Path), callback=no_link
)
@click.option("--example", default="", metavar="NAME", help="Instead, one of the examples that come with srprov.")
def init(folder: Path, example: str) -> int:
    """Write a new experiment into DIR (default: here): an EDF, a CDF with its script, an inventory, a .gitignore.

    Two small services that talk to each other, to be changed into yours. Nothing is overwritten: when one of the files
    is there already, none is written, and the exit code is 5. `srprov snapshot` makes an experiment of robots that run
    one already, `srprov import` of Docker Compose files.
    """
    from srprov.data import example_files
    from srprov.definitions.starter import starter

    made: Mapping[str, bytes]
    if example:
        made = example_files(example)
    else:
        made = {name: text.encode() for name, text in starter(folder.resolve().name).items()}
    _write(folder, made)
    for name in made:
        out(visible(str(folder / name)))
    err(_next(folder, made, example=bool(example)))
    return 0


def _write(folder: Path, made: Mapping[str, bytes]) -> None:
    """Write all files, or none."""
    from srprov.definitions.lockfile import lock_path

    # a folder of theirs may be there, and not as a link: a stranger's may lead to the user's own
    links = dict.fromkeys(str(one) for name in made for one in Path(name).parents if os.path.islink(folder / one))
    # and a lock would say what the new experiment's images and branches are
    taken = dict.fromkeys([*made, *(lock_path(name) for name in made if name.endswith(".edf"))])
    if there := [*links, *(name for name in taken if os.path.lexists(folder / name))]:
        names = ", ".join(str(folder / name) for name in there)
        raise UsageError(
            f"already there: {names}",
            hint="name another folder: srprov init DIR; nothing was written",
            code=Code.IN_THE_WAY,
        )
    if "inventory.yml" in made and (beside := regular_file.variables_beside(folder)):
        raise UsageError(
            f"{beside} would be read with the new inventory.yml, and may be a stranger's",
            hint="name another folder: srprov init DIR; nothing was written",
            code=Code.IN_THE_WAY,
        )
    written: list[Path] = []
    try:
        for name, content in made.items():
            path = folder / name
            private.make_folder(path.parent)
            with private.open_new(path) as stream:
                written.append(path)
                stream.write(content)
                if content.startswith(b"#!"):
                    os.fchmod(stream.fileno(), 0o700)
    except OSError as error:
        for path in written:
            with contextlib.suppress(OSError):
                path.unlink()
        raise UsageError(
            f"{error.filename or folder}: {error.strerror}", hint="no file of it was left", code=Code.CANNOT_WRITE
        ) from error


def _next(folder: Path, made: Mapping[str, bytes], *, example: bool) -> str:
    """Return what to do next, as commands."""
    lines = [] if folder == Path() else [sh("cd", str(folder))]
    if example:
        lines += ["read README.md"] if "README.md" in made else []
    else:
        lines += [
            "put the addresses of your robots into inventory.yml",
            "srprov plan experiment.edf -i inventory.yml",
            "srprov apply experiment.edf -i inventory.yml",
        ]
    lines.append("without robots, on Linux as root: srprov lab up, then -i inventory/lab.yml")
    return "\n".join(["next:", *(f"  {visible(line)}" for line in lines)])
