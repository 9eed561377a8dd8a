"""`srprov validate`: definition files only; no robot is asked."""

from __future__ import annotations

import click

from srprov.cli import options
from srprov.cli.codes import USAGE
from srprov.cli.output import err, out


@click.command()
@click.argument("files", nargs=-1, required=True, metavar="FILES...")
@options.PROFILES
@click.option(
    "--allow",
    multiple=True,
    type=click.Choice(["outside"]),
    help="Look at files that are not the experiment's own, too.",
)
@click.option(
    "--format",
    "form",
    type=click.Choice(["text", "json", "sarif", "codequality"]),
    default="text",
    show_default=True,
    help="How problems are shown; sarif and codequality are what GitHub and GitLab take.",
)
def validate(files: tuple[str, ...], profiles: tuple[str, ...], allow: tuple[str, ...], form: str) -> int:
    """Check EDFs, CDFs, Dockerfiles and inventories, and every file that they name; show everything that is wrong.

    Of a folder, all EDFs and CDFs in it and below, but for records of runs; one that has none is read as an inventory.
    Nothing is run: an inventory that is a program is refused. Files that an EDF or a CDF names outside of the
    experiment's folder are looked at with --allow outside; without, each is a warning.

    A warning is about what is allowed and may not be meant; the exit code is 0.
    """
    from srprov.cli.problems import as_codequality, as_json, as_sarif, render_problems
    from srprov.definitions import checked, remarks, with_files_below

    files = tuple(with_files_below(files))
    problems, left = checked(files, profiles, outside=bool(allow))
    warnings = [] if problems else sorted([*left, *remarks(files)])
    if form == "text":
        for found, word in ((problems, "error"), (warnings, "warning")):
            if found:
                out(render_problems(found, word))
    else:
        written = {"json": as_json, "sarif": as_sarif, "codequality": as_codequality}[form]
        out(written(problems, warnings))
    count = len(problems)
    counted = f"{len(files)} file{'s' if len(files) != 1 else ''}"
    summary = f"{count} problem{'s' if count != 1 else ''} in {counted}" if count else f"{counted} valid"
    (out if form == "text" else err)(summary)
    return USAGE if problems else 0
