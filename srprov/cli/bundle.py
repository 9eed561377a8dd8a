"""`srprov bundle`: a run of trials as one file that strangers can check."""

from __future__ import annotations

from pathlib import Path

import click

from srprov.cli import options
from srprov.cli.output import err, out, out_json
from srprov.errors import UsageError


@click.command()
@click.argument("run", metavar="RUN")
@click.option(
    "-o", "--out", "target", type=click.Path(dir_okay=False, path_type=Path), required=True, metavar="FILE",
    help="The bundle, such as race.zip.",
)  # fmt: skip
@click.option(
    "--sign", type=click.Path(exists=True, dir_okay=False), default=None, metavar="KEY",
    help="Sign it with this SSH key, for `verify --signers`.",
)  # fmt: skip
@click.option(
    "--no-secret", multiple=True, metavar="NAME",
    help="A file of the bundle in which what looks like a secret is none; may be repeated.",
)  # fmt: skip
@options.JSON
def bundle(run: str, target: Path, sign: str | None, no_secret: tuple[str, ...], as_json: bool) -> int:
    """Pack a run of trials into one file: all that was measured, what it was made of, and a hash of each file.

    RUN is a name that `srprov runs` lists, or a folder. No robot is asked. Addresses, hosts and users of the lab are
    replaced; results and the experiment's files stay as they are. What looks like a secret stops it, and so does the
    value of one of the experiment's secrets, where it can be read here: variables and files are, commands are not run.
    """
    from srprov.cli.runs import homes, run_folder
    from srprov.controller.bundling import known_secrets, signer
    from srprov.evidence.make import bundle as make

    folder = run_folder(run, homes(None))
    for name in known_secrets(folder):
        err(f"note: {name} cannot be read here: nobody looks for its value")
    try:
        made = make(folder, target, sign=signer(sign, str(target)) if sign else None, no_secret=no_secret)
    except OSError as error:
        raise UsageError(f"{error.filename or target}: {error.strerror or error}", hint="name another file") from error
    if as_json:
        out_json({"bundle": str(target), "files": made.files, "bytes": made.size, "signed": made.signed})
    else:
        out(f"{target}: {made.files} files, {made.size} bytes" + (", signed" if made.signed else ""))
    return 0
