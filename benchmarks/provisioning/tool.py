"""What a contestant is: how it is set up, and the one command that does the job. Here: the floor and srprov."""

from __future__ import annotations

import compileall
import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any

import yaml

from benchmarks.provisioning.job import Job, edf, floor_script
from benchmarks.provisioning.robots import KEY, KNOWN_HOSTS, Lab
from srprov import __version__

BIN = Path(sys.executable).parent
HERE = Path(__file__).parent


@dataclass(frozen=True)
class Call:
    """One command."""

    argv: tuple[str, ...]
    env: Mapping[str, str] = field(default_factory=dict)
    stdin: str = ""


class Tool:
    """A contestant. `name` is what tables say."""

    name = ""
    vxlan = True
    """False: the tool brings an overlay of its own."""

    def __init__(self, lab: Lab, folder: Path) -> None:
        self.lab = lab
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)

    @classmethod
    def install_once(cls) -> None:
        """Install the tool into an environment of its own; what is there stays."""

    @classmethod
    def version(cls) -> str:
        """Return what the table's head says about the tool."""
        return ""

    def prepare_robots(self) -> None:
        """Give fresh robots what the tool needs there; once per lab, not measured."""

    def begin(self) -> None:
        """Set up on the robots what isn't part of the job; not measured with it."""

    def call(self, job: Job, variant: str) -> Call:
        """Write the job's files, named by `variant`, and give the command. Only the command is measured."""
        raise NotImplementedError

    def reported(self, out: str) -> dict[str, Any]:
        """Return what the tool says itself about the run."""
        return {}

    def end(self) -> None:
        """Undo `begin`."""


class Floor(Tool):
    """One compiled script per robot over parallel paramiko connections."""

    name = "floor"

    @classmethod
    def version(cls) -> str:
        """Return paramiko's version."""
        return f"paramiko {metadata.version('paramiko')}"

    def call(self, job: Job, variant: str) -> Call:
        """Compile."""
        robots = {
            member.robot: {"address": member.underlay, "user": "root", "script": floor_script(job, member)}
            for member in job.members
        }
        plan = self.folder / f"{variant}.json"
        plan.write_text(json.dumps({"key": str(KEY), "known_hosts": str(KNOWN_HOSTS), "robots": robots}))
        return Call((sys.executable, str(HERE / "floor.py"), "up", str(plan)))


class Srprov(Tool):
    """`srprov apply --yes` with its defaults."""

    name = "srprov"
    options: tuple[str, ...] = ()

    @classmethod
    def install_once(cls) -> None:
        """Compile its modules, as pip does for all others when it installs them."""
        compileall.compile_dir(str(HERE.parents[1] / "srprov"), quiet=1)

    @classmethod
    def version(cls) -> str:
        """Return its version."""
        return __version__

    def call(self, job: Job, variant: str) -> Call:
        """Write the EDF: one file for all variants, as a user edits it."""
        path = self.folder / "experiment.edf"
        path.write_text(yaml.safe_dump(edf(job), sort_keys=False))
        where = (str(path), "-i", str(self.lab.inventory), "--runs", str(self.folder / "runs"))
        words = ("apply", *where, "--yes", "--json")
        return Call((str(BIN / "srprov"), *words, *self.options))

    def reported(self, out: str) -> dict[str, Any]:
        """Add up what `--json` says about robots, and give the phases."""
        said = json.loads(out)
        names = ("connections", "round_trips", "bytes_sent", "bytes_received")
        sums = {name: sum(robot[name] for robot in said["robots"].values()) for name in names}
        return {**sums, "phases": said["phases"], "duration_s": said["duration_s"]}


class SrprovAtOnce(Srprov):
    """The same without the two seconds in which srprov watches that services stay up; no other tool does that."""

    name = "srprov --settle 0"
    options = ("--settle", "0")
