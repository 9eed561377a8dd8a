"""`srprov man`: print the manual page, for `man -l -` or a folder below MANPATH."""

from __future__ import annotations

import click

from srprov.cli.output import out


@click.command()
def man() -> int:
    """Print the manual page of srprov: every verb with its options, exit codes, files and variables.

    \b
    srprov man | man -l -
    srprov man >~/.local/share/man/man1/srprov.1
    """  # noqa: D301 - click's own mark, a backspace
    from srprov.cli.manual import page

    root = click.get_current_context().find_root().command
    assert isinstance(root, click.Group)
    out(page(root).rstrip("\n"))
    return 0
