"""`srprov bundle`: a run of trials as one file that strangers can check."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import click

from srprov import private
from srprov.cli import fork_options, inputs, options, output_options
from srprov.cli.output import err, out, out_json
from srprov.cli.output_options import no_way_above
from srprov.codes import Code
from srprov.errors import UsageError, visible

_EVERY_S = 3.0
if TYPE_CHECKING:
    from srprov.evidence.make_images import Wish


@click.command()
@click.argument("run", metavar="RUN")
@click.option(
    "-o", "--out", "target", type=click.Path(dir_okay=False, path_type=Path), required=True, metavar="FILE",
    callback=no_way_above, help="The bundle, such as race.zip.",
)  # fmt: skip
@click.option(
    "--with-images", "way", type=click.Choice(["none", "ours", "all"]), default="none", show_default=True,
    help="Also the images: those that srprov built (ours), or all; with a list of the packages in each.",
)  # fmt: skip
@click.option(
    "-i", "--inventory", "inventories", multiple=True, metavar="FILE",
    help="With --with-images: robots that have the images, such as those that ran it; without it, this machine's "
    "engine is asked.",
)  # fmt: skip
@options.TIMEOUT
@fork_options.FORKS
@options.ASK_BECOME
@click.option(
    "--sign", type=click.Path(exists=True, dir_okay=False), default=None, metavar="KEY",
    help="Sign it with this SSH key, for `verify --signers`.",
)  # fmt: skip
@click.option(
    "--no-secret", multiple=True, metavar="NAME",
    help="A file of the bundle in which what looks like a secret is none; may be repeated.",
)  # fmt: skip
@options.JSON
def bundle(
    run: str, target: Path, way: str, inventories: tuple[str, ...], timeout: float, forks: int, sign: str | None,
    no_secret: tuple[str, ...], as_json: bool,
) -> int:  # fmt: skip
    """Pack a run of trials into one file: all that was measured, what it was made of, and a hash of each file.

    RUN is a name that `srprov runs` lists, or a folder. No robot is asked, but for images. Addresses, hosts and users
    of the lab are replaced; results, the experiment's files and images stay as they are. What looks like a secret stops
    it, and so does the value of one of the experiment's secrets, where it can be read here: variables are that this
    machine gave to the run, and files that were allowed on this machine; commands are not run.
    """
    from srprov.cli.runs import homes, run_folder
    from srprov.controller.bundling import known_secrets, signer
    from srprov.evidence.files import of_run
    from srprov.evidence.make import bundle as make

    folder = run_folder(run, homes(None))
    try:
        files = of_run(folder)
        left = known_secrets(files.path, files.sizes)
        for name in left.names:
            err(f"note: {name} cannot be read here: nobody looks for its value")
        if left.variables:
            named = ", ".join(left.variables)
            err(f"note: nobody looks for values of variables that this machine did not give to this run: {named}")
        with _wish(folder, way, inventories, timeout, forks) as images:
            made = make(
                folder, target, sign=signer(sign, str(target)) if sign else None, no_secret=no_secret, images=images
            )
    except OSError as error:
        raise UsageError(
            f"{error.filename or target}: {error.strerror or error}", hint="name another file", code=Code.CANNOT_WRITE
        ) from error
    if as_json:
        out_json({"bundle": str(target), "files": made.files, "bytes": made.size, "signed": made.signed,
                  "images": made.images})  # fmt: skip
    else:
        there = f", {made.images} images" if way != "none" else ""
        out(f"{target}: {made.files} files, {made.size} bytes{there}" + (", signed" if made.signed else ""))
    return 0


@contextmanager
def _wish(folder: Path, way: str, inventories: tuple[str, ...], timeout: float, forks: int) -> Iterator[Wish | None]:
    """Return which images are wanted, and connect to whoever may have them."""
    if way == "none":
        yield None
        return
    from srprov.controller.bundle_images import Engines, own_engine
    from srprov.controller.trial_images import ran
    from srprov.evidence.make_images import Wish

    asked = inputs.connect(inputs.load_inventory(inventories), timeout, forks) if inventories else own_engine(timeout)
    private.make_folder(private.cache_folder())
    with asked as fleet, TemporaryDirectory(prefix="bundle-", dir=private.cache_folder()) as apart:
        yield Wish(way=way, giver=Engines(fleet, Path(apart), ran(folder)), say=_Slowly().say)


class _Slowly:
    """Says how far it is, but not each time that it is told."""

    def __init__(self) -> None:
        self._said, self._first = 0.0, ""

    def say(self, text: str) -> None:
        """Say it, if it is of another image, or some time has passed."""
        now, first = time.monotonic(), text.partition(",")[0]
        if first != self._first or now - self._said >= _EVERY_S:
            self._said, self._first = now, first
            output_options.note(visible(text))
