"""What a way of images to robots is here: one command, after which every target runs a container of the image."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path
from typing import Any

import yaml

from benchmarks.images.fleet import Fleet
from benchmarks.provisioning.tool import Call


class Tool:
    """A contestant. `name` is what tables say."""

    name = ""

    def __init__(self, fleet: Fleet, folder: Path) -> None:
        self.fleet = fleet
        self.folder = folder

    @classmethod
    def install_once(cls) -> None:
        """Install the tool into an environment of its own; what is there stays."""

    @classmethod
    def version(cls) -> str:
        """Return what the table's head says about the tool."""
        return ""

    def begin(self) -> None:
        """Begin with nothing, as on the first day; not measured."""
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir(parents=True)

    def call(self, image: str) -> Call:
        """Write the files for an image, and give the command. Only the command is measured."""
        raise NotImplementedError

    def reported(self, out: str) -> dict[str, Any]:
        """Return what the tool says itself about the run."""
        return {}

    def end(self) -> None:
        """Undo `begin`."""


class Srprov(Tool):
    """`srprov apply --yes`, with its cache and its state in the tool's own folder."""

    name = "srprov"
    way = ""

    def call(self, image: str) -> Call:
        """Write a CDF on the image, and an EDF with a container of it for every target."""
        (self.folder / "robot.cdf").write_text(f"cdf: 1\nname: robot\nbase: {image}\n")
        services = {
            f"on-{name}": {"cdf": "robot.cdf", "robot": name, "network": "none"} for name, _ in self.fleet.targets
        }
        path = self.folder / "experiment.edf"
        path.write_text(yaml.safe_dump({"edf": 1, "name": "bench", "services": services}))
        inventory = self.fleet.inventory(self.folder / "inventory.yml")
        where = (str(path), "-i", str(inventory), "--runs", str(self.folder / "runs"))
        words = ("-m", "srprov", "apply", *where, "--yes", "--json", "--settle", "0")
        own = {"XDG_STATE_HOME": str(self.folder / "state"), "XDG_CACHE_HOME": str(self.folder / "cache")}
        return Call((sys.executable, *words, *(("--copy", self.way) if self.way else ())), own)

    def reported(self, out: str) -> dict[str, Any]:
        """Give the phases, and the seconds of the steps that bring images."""
        said = json.loads(out)
        return {"phases": said["phases"], "steps": [one for one in said["steps"] if "/image:" in one["id"]]}


class Thin(Srprov):
    """Only the layers that are missing."""

    name = "srprov, thin"
    way = "thin"


class Registry(Srprov):
    """Every engine pulls from the controller, over SSH."""

    name = "srprov, registry"
    way = "registry"


class Whole(Srprov):
    """Whole images."""

    name = "srprov, whole"
    way = "whole"
