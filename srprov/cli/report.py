"""`srprov report`: a run, a plan or a bundle as one HTML page."""

from __future__ import annotations

import codecs
import os
from pathlib import Path
from typing import TYPE_CHECKING

import click

from srprov import private, regular_file
from srprov.cli import options, output_options
from srprov.cli.output import clean, err, out, out_json
from srprov.cli.runs import homes, run_folder
from srprov.codes import Code
from srprov.errors import UsageError, visible

if TYPE_CHECKING:
    from srprov.report.material import Material

_MOST_PAGE = 192 * regular_file.MIB
"""Of one whose data is taken out: what is in it has at most 128 MiB, and is packed."""
_PIECE = 1 << 20


@click.command()
@click.argument("source", metavar="RUN|PLAN|BUNDLE")
@click.option("-o", "--out", "target", metavar="FILE", default=None, callback=output_options.written,
              help="The page, such as page.html.")  # fmt: skip
@click.option("--extract", is_flag=True, help="Print the data inside a page that was made before.")
@options.RUNS
@options.JSON
def report(source: str, target: str | None, extract: bool, runs: Path | None, as_json: bool) -> int:
    """Write a run, a plan or a bundle as one HTML page.

    RUN is a name that `srprov runs` lists, or a folder; PLAN a file of `plan -o`; BUNDLE one of `bundle -o`. No robot
    is asked. The page is one file that loads nothing and runs nothing: what came of it, what is lost, who runs what and
    why, what changed, when, the network, the trials with plots, and what could not be seen. The data that it is about
    is inside, and `srprov report page.html --extract` prints it.

    A page names robots, users and addresses as the record does. A bundle has others in their place.
    """
    if extract:
        return _extract(Path(source), target)
    if target is None:
        raise UsageError("where the page goes is missing", hint="srprov report RUN -o page.html", code=Code.OPTIONS)
    from srprov.report.page import page

    found = _material(source, runs)
    text = page(found).encode()
    _write(target, text)
    if as_json:
        out_json({"page": target, "kind": found.kind, "bytes": len(text), "missing": list(found.missing)})
        return 0
    for one in found.missing:
        err(f"note: {one}")
    err(f"{target}: {len(text)} bytes")
    return 0


def _material(source: str, runs: Path | None) -> Material:
    """Return what a page is made of, whatever kind of thing it is."""
    from srprov.record.runs import is_trials
    from srprov.report.read import MOST_PLAN, of_plan, of_run
    from srprov.report.trials_read import of_bundle, of_trials

    path = run_folder(source, homes(runs))
    try:
        if path.is_dir():
            return of_trials(path) if is_trials(path) else of_run(path)
        if regular_file.has_further_names(os.stat(path)):
            raise ValueError("it has another name (a hard link); copy it, if it is your own")
        if regular_file.beginning(path, 4).startswith(b"PK"):
            return of_bundle(path)
        return of_plan(path, regular_file.read(path, MOST_PLAN))
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        hint = "`srprov runs` lists runs; a plan is made by `srprov plan -o`, a bundle by `srprov bundle`"
        raise UsageError(f"{source}: {visible(str(why))}", hint=hint, code=Code.NO_FILE) from None


def _write(target: str, content: bytes) -> None:
    try:
        private.write_output(target, content)
    except OSError as error:
        raise UsageError(
            f"cannot write {target}: {error.strerror}", hint="name another file with -o", code=Code.CANNOT_WRITE
        ) from None


def _extract(page: Path, target: str | None) -> int:
    """Print the data inside a page, or write it into a file, as it was put in."""
    from srprov.report.embed import extracted

    try:
        data = extracted(regular_file.read(page, _MOST_PAGE))
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise UsageError(
            f"{page}: {visible(str(why))}", hint="name a page that `srprov report` made", code=Code.RECORD
        ) from None
    if target is not None:
        _write(target, data)
    else:
        _print(data.rstrip(b"\n"))
    return 0


def _print(data: bytes) -> None:
    """Print data in pieces: a text of many MiB that is cleaned at once takes many times its size."""
    decoder = codecs.getincrementaldecoder("utf-8")("replace")
    for at in range(0, len(data), _PIECE):
        click.echo(clean(decoder.decode(data[at : at + _PIECE])), nl=False)
    out(decoder.decode(b"", final=True))
