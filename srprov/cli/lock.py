"""`srprov lock`: write down what tags and branches are now, and what builds ended with."""

from __future__ import annotations

import re
from collections.abc import Collection

import click

from srprov import private
from srprov.cli import inputs, options
from srprov.cli.output import counted, err, out
from srprov.cli.permitted import permitted
from srprov.codes import Code
from srprov.errors import UsageError, visible

_NOT_UTF8 = re.compile("[\ud800-\udfff]")
"""Bytes of a file's name that are no text."""


@click.command()
@click.argument("file", metavar="FILE")
@options.robots_without_json
@options.ALLOW
@click.option(
    "--update", multiple=True, metavar="NAME",
    help="Look this up again: an image, the address of a repository or its last part, or all. May be repeated.",
)  # fmt: skip
def lock(
    file: str, inventories: tuple[str, ...], forks: int, timeout: float, allow: tuple[str, ...], update: tuple[str, ...]
) -> int:
    """Write the lock of an EDF: the digest of every image, the commit of every branch, the hash of every file.

    What stands in the lock already stays, unless --update names it. `plan` and `apply` use the lock; --locked makes
    them refuse one that is out of date. Registries are asked through robots' engines. Of each image that was built
    from here and is on a robot, the packages of apt, pip and npm are recorded: a container without network lists them.
    """
    from srprov.controller import digests, locking, package_records
    from srprov.definitions.lockfile import Lock, dump, load, lock_path

    path = lock_path(file)
    old = load(path) or Lock()
    allowed = permitted(allow)[1]
    inventory = inputs.load_inventory(inventories)
    made = locking.draft(file, old, update, allowed, inventory)
    with inputs.connect(inventory, timeout, forks) as fleet, fleet.look(made.definitions.experiment) as look:

        def look_up(names: Collection[str]) -> dict[str, digests.Found]:
            if not names:
                return {}
            with_engine = [name for name, facts in look.first().facts.items() if facts.docker]
            return digests.look_up(look.ask_each, with_engine, names, allowed, lambda text: err(f"note: {text}"))

        new, records = package_records.with_records(locking.finished(made, look_up), made, look, fleet.connected())
    if strange := next(filter(_NOT_UTF8.search, new.files), ""):
        why = f"a file of the experiment has a name that is not UTF-8: {visible(strange)}"
        raise UsageError(why, hint="give it another one", code=Code.NO_FILE)
    try:
        private.write_output(path, dump(new).encode())
    except OSError as error:
        raise UsageError(f"cannot write {path}: {error.strerror}", code=Code.CANNOT_WRITE) from error
    for line in [*locking.changes(old, new), *records]:
        out(line)
    parts = counted(len(new.digests), "image"), counted(len(new.commits), "commit"), counted(len(new.files), "file")
    out(f"{path}: {', '.join(parts)}")
    return 0
