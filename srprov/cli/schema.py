"""`srprov schema`: print a JSON Schema, for editors and other tools."""

from __future__ import annotations

import json

import click

from srprov.cli.output import out


@click.command()
@click.argument("kind")
def schema(kind: str) -> int:
    """Print the JSON Schema of KIND: of a file, such as edf or cdf, or of what a verb prints with --json."""
    from srprov import data

    out(json.dumps(data.schema(kind), indent=2, ensure_ascii=False))
    return 0
