"""Robots -> the files of an experiment: an EDF, a CDF for each host, patches.

Takes what was read of the robots; gives names and texts of files, and documents that can be taken apart again when a
definition does not take a part of them. Pure.
"""

from __future__ import annotations

import posixpath
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec

from srprov.snapshot.containers import Service
from srprov.snapshot.debian import Package
from srprov.snapshot.host import Host
from srprov.snapshot.notes import Notes
from srprov.snapshot.python import PipPackage, is_own
from srprov.snapshot.repositories import Repository, fetchable
from srprov.wire import quote
from srprov.yamldoc.writer import Commented

EDF_NAME = "experiment.edf"
PROFILE = "host"
"""Of the services that stand for hosts: they run only when it is named."""
_PATCHES = "/usr/src/srprov-snapshot"
_PIP_SOURCES = "/usr/src/srprov-pip"
_MOST_LISTED = 900
"""Entries of a list; a definition takes 1000."""
_LONGEST_LINE = 40_000
"""Characters of the names in one command."""
_KERNELS = (
    "linux-image-",
    "linux-headers-",
    "linux-modules-",
    "grub-",
    "shim-",
    "raspberrypi-kernel",
    "linux-firmware",
)
_NO_TERMINAL = "DEBIAN_FRONTEND=noninteractive"


class Robot(msgspec.Struct, frozen=True, kw_only=True):
    """Everything that was read of one robot."""

    name: str
    short: str
    """Its name as a service and a file can have it."""
    host: Host
    repositories: tuple[Repository, ...] = ()
    services: tuple[Service, ...] = ()
    notes: Notes = msgspec.field(default_factory=Notes)


class Definition(msgspec.Struct, frozen=True, kw_only=True):
    """A CDF: its values, and the files that it takes by their names below the experiment's folder."""

    file: str
    values: dict[str, Any]
    files: Mapping[str, bytes] = msgspec.field(default_factory=dict)


def definition_of(robot: Robot) -> Definition | None:
    """Return the CDF of a robot's host; None where no image is known for it."""
    host, notes = robot.host, robot.notes
    if not host.base:
        return None
    values: dict[str, Any] = {"cdf": 1, "name": robot.short, "description": f"The host {robot.name}, as it was found"}
    if host.arch:
        values["requires"] = {"arch": [host.arch]}
    values["base"] = host.base
    run: list[Any] = []
    if packages := _packages(robot, run):
        values["packages"] = packages
    files = {
        f"{robot.short}/patches/{index}.patch": one.patch for index, one in enumerate(robot.repositories) if one.patch
    }
    if places := [*map(_repository, robot.repositories), *_from_git(host.pip, notes)]:
        values["repositories"] = places
    copied = [{"src": name, "dest": f"{_PATCHES}/{posixpath.basename(name)}", "mode": "0644"} for name in files]
    if lines := [one.line() for one in host.sources if host.elsewhere]:
        name = f"{robot.short}/sources.list"
        files[name] = ("\n".join(lines) + "\n").encode("utf-8")
        copied.append({"src": name, "dest": "/etc/apt/sources.list.d/srprov-snapshot.list", "mode": "0644"})
        for index, (path, content) in enumerate(sorted(host.keys.items())):
            files[f"{robot.short}/keys/{index}"] = content
            copied.append({"src": f"{robot.short}/keys/{index}", "dest": path, "mode": "0644"})
    if copied:
        values["files"] = copied
    if run := [*run, *_patched(robot)]:
        values["run"] = run
    for folder, kind in host.workspaces:
        notes.adapted(f"workspace {folder}", f"of {kind}: its repositories are in the image, and it is not built there")
    values["command"] = ["sleep", "infinity"]
    return Definition(file=f"{robot.short}.cdf", values=values, files=files)


def _packages(robot: Robot, run: list[Any]) -> dict[str, Any]:
    """Return `packages`, and add what cannot be among them to `run`."""
    host = robot.host
    left = host.gone | host.elsewhere
    listed = [Commented(one.name, _beside(one, "")) for one in host.chosen.by_hand if one.name not in left]
    listed += [
        Commented(one.name, _beside(one, "came with others")) for one in host.chosen.others if one.name not in left
    ]
    found: dict[str, Any] = {}
    for index, some in enumerate(_pieces(listed)):
        if index:
            run.append(_install([one.value for one in some]))
        else:
            found["apt"] = some
    if host.elsewhere:
        run.append(_install(sorted(host.elsewhere)))
        _note_keys(robot)
    for one in (*host.chosen.by_hand, *host.chosen.others):
        if one.name.startswith(_KERNELS):
            robot.notes.adapted(
                f"package {one.name}", "belongs to the robot's kernel or start: an image does not need it"
            )
    pip = [one for one in host.pip if not one.git]
    if pip:
        found["pip"] = [f"{one.name}=={one.version}" for one in pip if "+" not in one.version and not is_own(one.name)]
    for each in pip:
        subject = f"pip package {each.name}"
        if "+" in each.version:
            robot.notes.lost(subject, f"{each.version} is a version that the public index does not have")
        elif is_own(each.name):
            robot.notes.adapted(subject, f"{each.version}: the image has that of its own system")
    return {key: value for key, value in found.items() if value}


def _note_keys(robot: Robot) -> None:
    host = robot.host
    words = f"{len(host.elsewhere)} packages are of archives beside the distribution's, with the keys of the robot"
    robot.notes.adapted("apt sources", words)
    missing = sorted({one.key for one in host.sources if one.key} - host.keys.keys())
    if missing:
        robot.notes.lost(
            "apt sources", f"keys that could not be read: {', '.join(missing)}; without them nothing is built"
        )


def _pieces(listed: Sequence[Commented]) -> list[list[Commented]]:
    """Return packages in pieces that a line of a Dockerfile takes."""
    pieces: list[list[Commented]] = []
    size = 0
    for one in listed:
        size += len(one.value) + 1
        if not pieces or len(pieces[-1]) >= _MOST_LISTED or size > _LONGEST_LINE:
            pieces.append([])
            size = len(one.value) + 1
        pieces[-1].append(one)
    return pieces


def _beside(package: Package, words: str) -> str:
    return f"{package.version}; {words}" if words else package.version


def _install(names: Sequence[str]) -> str:
    install = f"{_NO_TERMINAL} apt-get install -y --no-install-recommends {' '.join(map(quote, names))}"
    return f"apt-get update\n{install}\nrm -rf /var/lib/apt/lists/*"


def _repository(one: Repository) -> dict[str, Any]:
    return {"git": one.url, "ref": one.commit, "path": one.folder}


def _from_git(packages: Sequence[PipPackage], notes: Notes) -> list[dict[str, Any]]:
    """Return the repositories that pip installed from, each with the command that does it again."""
    found = []
    for one in packages:
        if not one.git:
            continue
        url = fetchable(one.git, f"pip package {one.name}", notes)
        if url:
            below = f"./{one.subfolder}" if one.subfolder else "."
            install = f"PIP_BREAK_SYSTEM_PACKAGES=1 python3 -m pip install --no-cache-dir --no-deps {quote(below)}"
            found.append({"git": url, "ref": one.commit, "path": f"{_PIP_SOURCES}/{one.name}", "run": [install]})
    return found


def _patched(robot: Robot) -> list[str]:
    """Return the commands that apply patches."""
    return [
        f"cd {quote(one.folder)}\ngit apply --whitespace=nowarn {_PATCHES}/{index}.patch"
        for index, one in enumerate(robot.repositories)
        if one.patch
    ]


def experiment_of(name: str, robots: Sequence[Robot], definitions: Mapping[str, Definition]) -> dict[str, Any]:
    """Return the EDF: containers pinned to their robots, and a service with a profile for each host."""
    services: dict[str, Any] = {}
    secrets: dict[str, Any] = {}
    most = 1
    for robot in robots:
        own = {one.name: {**one.fields, "robot": robot.name} for one in robot.services}
        if robot.name in definitions:
            own[host_service(robot)] = {"cdf": definitions[robot.name].file, "robot": robot.name, "profiles": [PROFILE],
                                        "network": "none"}  # fmt: skip
        services |= own
        most = max(most, len(own))
        for one in robot.services:
            secrets |= {secret: {"env": variable} for secret, variable in one.secrets.items()}
    values: dict[str, Any] = {"edf": 1, "name": name, "services": services}
    if most > 1:
        values["placement"] = {"slots_per_robot": min(most, 1000)}
    if secrets:
        values["secrets"] = Commented(dict(sorted(secrets.items())), "Values are not here: set these variables.")
    return values


def host_service(robot: Robot) -> str:
    """Return the name of the service that stands for a host."""
    return f"{robot.short}-host"
