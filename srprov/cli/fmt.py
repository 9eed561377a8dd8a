"""`srprov fmt`: EDFs and CDFs in one form."""

from __future__ import annotations

import difflib
import os
import sys
from typing import TYPE_CHECKING

import click

from srprov import private, regular_file
from srprov.cli.codes import DIFFERENCES, USAGE
from srprov.cli.output import counted, err, out
from srprov.codes import Code
from srprov.errors import DefinitionError, Diagnostic, UsageError, visible

if TYPE_CHECKING:
    from srprov.definitions.formatting import Formatted

_MOST_BYTES = 2 << 20
_MOST_LINES = 4000
"""Of a file that is compared line by line, which may take a time that grows with the square of them."""


@click.command()
@click.argument("paths", metavar="FILE|DIR...", nargs=-1, required=True)
@click.option("--check", is_flag=True, help="Change nothing; end with 2 when a file is not in its form.")
@click.option("--diff", is_flag=True, help="Change nothing; show what would change.")
def fmt(paths: tuple[str, ...], check: bool, diff: bool) -> int:
    """Bring EDFs and CDFs into one form: indentation, quotes, short lists in one line, the order of keys.

    Comments stay, and so does the meaning: what was made is read again and compared, or the file is left as it is. Of a
    DIR, all files that end in .edf or .cdf, also before .yml, but for hidden folders, links, and records of runs. `-`
    is standard input, which comes back on standard output.

    Exits with 0; with 2 when --check or --diff found a file that is not in its form; with 5 when one could not be read.
    """
    if paths == ("-",):
        return _standard_input(check, diff)
    from srprov.definitions.formatting import definition_files, formatted

    changed, problems, count, left = 0, list[Diagnostic](), 0, list[str]()
    for place in definition_files(paths, lambda path, why: left.append(f"{visible(path)} is left as it is: {why}")):
        count += 1
        try:
            one = formatted(place)
        except DefinitionError as error:
            problems += error.problems
            continue
        changed += one.changed
        if one.changed:
            _handle(one, write=not (check or diff), diff=diff)
    for line in left:
        err(line)
    if not count and not left:
        raise UsageError(
            f"there is no EDF or CDF in {', '.join(paths)}", hint="they end in .edf and .cdf", code=Code.NO_FILE
        )
    if problems:
        from srprov.cli.problems import render_problems

        err(render_problems(problems))
    verb = "would change" if check or diff else "changed"
    err(f"{counted(count, 'file')}, {changed} {verb}")
    return USAGE if problems else DIFFERENCES if changed and (check or diff) else 0


def _handle(one: Formatted, *, write: bool, diff: bool) -> None:
    """Show or write one file that is not in its form."""
    if diff:
        out(_difference(one.before, one.after, one.path))
        return
    if write:
        try:
            above, name = os.path.split(one.real)
            with regular_file.real_folder(above) as folder:
                private.rewrite(name, one.after.encode(), folder)
        except OSError as error:
            raise UsageError(
                f"{one.path}: {error.strerror}", hint="it is as it was before", code=Code.CANNOT_WRITE
            ) from error
    out(visible(one.path))


def _difference(before: str, after: str, name: str) -> str:
    old, new, name = before.splitlines(), after.splitlines(), visible(name)
    if max(len(old), len(new)) > _MOST_LINES:
        return f"{name}: it would change; a file of more than {_MOST_LINES} lines is not shown"
    return "\n".join(difflib.unified_diff(old, new, name, f"{name} (formatted)", lineterm=""))


def _standard_input(check: bool, diff: bool) -> int:
    from srprov.definitions.formatting import formatted_text

    data = sys.stdin.buffer.read(_MOST_BYTES + 1)
    if len(data) > _MOST_BYTES:
        raise UsageError(f"standard input is larger than {_MOST_BYTES >> 20} MiB", code=Code.UNREADABLE)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise UsageError("standard input is not UTF-8 text", code=Code.UNREADABLE) from None
    made = formatted_text(text, "standard input")
    if diff and made != text:
        out(_difference(text, made, "standard input"))
    elif not (check or diff):
        click.echo(made, nl=False)
    return DIFFERENCES if (check or diff) and made != text else 0
