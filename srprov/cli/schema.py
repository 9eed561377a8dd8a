"""`srprov schema`: print a JSON Schema, or what makes an editor use those of EDFs and CDFs."""

from __future__ import annotations

import json

import click

from srprov.cli.editor_settings import EDITORS, editor_settings
from srprov.cli.output import out
from srprov.codes import Code
from srprov.errors import UsageError

_WIDTH = 118


@click.command()
@click.argument("kind", required=False)
@click.option(
    "--editor", type=click.Choice(EDITORS), default=None,
    help="Print settings for this editor instead, which name the schemas of this installation (docs/editors.md).",
)  # fmt: skip
def schema(kind: str | None, editor: str | None) -> int:
    """Print the JSON Schema of KIND: of a file, such as edf or cdf, or of what a verb prints with --json.

    Without KIND, list the kinds. `events` is a line of what --events writes.
    """
    from srprov import data

    if editor:
        if kind:
            raise UsageError(
                "--editor prints settings, and no schema", hint=f"leave out '{kind}', or --editor", code=Code.OPTIONS
            )
        out(editor_settings(editor, {name: data.schema_path(name).as_uri() for name in ("edf", "cdf")}).rstrip())
    elif kind:
        out(json.dumps(data.schema(kind), indent=2, ensure_ascii=False))
    else:
        listing = click.HelpFormatter(width=_WIDTH)
        listing.write_dl([(name, data.schema(name)["description"]) for name in data.schema_kinds()])
        out(listing.getvalue().rstrip())
    return 0
