"""An embedded lab for one replay: it is brought up for it, and taken down after it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import yaml

from srprov.cli import inputs
from srprov.cli.output import err
from srprov.lab import lab as labs
from srprov.lab.places import Site, robot_name
from srprov.lab.spec import ARCHITECTURES, BUILT_IN

if TYPE_CHECKING:
    from srprov.definitions.model import Inventory
    from srprov.evidence.replay import Needed, Replay

_FILE = "a robot of the bundle"
"""Where an option that the lab cannot have comes from, in a message."""


@contextmanager
def lab_for(again: Replay) -> Iterator[tuple[Inventory, dict[str, str]]]:
    """Bring up a robot for each that did something in a bundle; give the inventory, and who does whose part.

    Raises:
        LabError: It cannot be.
        DefinitionError: A robot of the bundle has what no robot of a lab can have.
    """
    asked = {name: robot_name(number) for number, name in enumerate(again.robots, start=1)}
    spec = {"count": len(asked), "robots": {asked[name]: _options(one) for name, one in again.needs.items()}}
    lab = f"replay-{os.getpid()}"
    with TemporaryDirectory(prefix="srprov-") as folder:
        try:
            _up(lab, yaml.safe_dump(spec), folder)
            yield inputs.load_inventory((str(Path(folder, Site(lab).inventory)),)), asked
        finally:
            labs.down(lab, err)


def _up(lab: str, spec: str, folder: str) -> None:
    """Bring the lab up, with its inventory in a folder: the lab writes it below where it is brought up."""
    here = os.getcwd()
    os.chdir(folder)
    try:
        labs.up(lab, labs.Wanted(None, spec, _FILE), err)
    finally:
        os.chdir(here)


def _options(one: Needed) -> dict[str, object]:
    """Return the options of a lab's robot that can do the part of one."""
    devices = [path for path in one.devices if path not in BUILT_IN]
    wanted = {"tags": list(one.tags), "devices": devices, "arch": one.arch if one.arch in ARCHITECTURES else ""}
    return {key: value for key, value in wanted.items() if value}
