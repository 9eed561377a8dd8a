"""Compose files -> a draft of an experiment: which files are one machine's, and what the experiment is called."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path as FilePath
from typing import Any

import msgspec
from msgspec.structs import replace

from srprov.conversion import discovery, robots
from srprov.conversion.experiment import Draft, convert
from srprov.conversion.project import Choices, Machine, instance_name
from srprov.conversion.withheld import refuse_read
from srprov.definitions.model import EXPORTED
from srprov.importing.named import check_named, check_root, check_together
from srprov.importing.normal import Normal
from srprov.importing.read import normalise


class Wanted(msgspec.Struct, frozen=True, kw_only=True):
    """What the user asked for."""

    files: Sequence[str]
    folder: str
    profiles: Sequence[str] = ()
    env_files: Sequence[str] = ()
    settings: Mapping[str, str] = msgspec.field(default_factory=dict)
    robot_map: str = ""
    name: str = ""
    home: str = "robot"
    root: str = ""
    """Folder of the whole project: its files may lie anywhere in it, and each may name what lies there."""
    own: Collection[str] = ()
    """Real paths of files of the user's that no project has, wherever they lie: secrets were read from them."""


def draft(wanted: Wanted) -> Draft:
    """Return the experiment that Compose files describe.

    Raises:
        Refused: A file is refused by Compose, cannot be read, lies apart, or is a link that leads elsewhere; or the
            file of a secret was read for another line.
        DefinitionError: The map of robots is wrong.
    """
    check_named([*wanted.files, *wanted.env_files, *filter(None, [wanted.robot_map])])
    if wanted.root:
        check_root(wanted.root, wanted.files)
    else:
        check_together(wanted.files)
    grouped = robots.by_robot(wanted.robot_map, wanted.files) if wanted.robot_map else {"": list(wanted.files)}
    machines = [_machine(files, robot, wanted) for robot, files in grouped.items()]
    every = [one.normal for one in machines]
    refuse_read(
        (one for normal in every for one in normal.named_files), {path for one in every for path in one.secret_files}
    )
    network: dict[str, Any] = {}
    if len(machines) == 1:
        normal, network = discovery.restored(machines[0].normal)
        machines = [replace(machines[0], normal=normal)]
    name = wanted.name or (
        os.path.basename(os.path.abspath(wanted.folder))
        if len(machines) > 1
        else str(machines[0].normal.document.get("name") or "").removeprefix(EXPORTED)
    )
    some_profiles = bool(wanted.profiles) and "*" not in wanted.profiles
    choices = Choices(home=wanted.home, chosen_profiles=some_profiles, own=wanted.own)
    made = convert(machines, instance_name(name), choices, os.path.abspath(wanted.folder), network)
    return replace(made, home=every[0].home)


def _machine(files: Sequence[str], robot: str, wanted: Wanted) -> Machine:
    root = os.path.realpath(wanted.root) if wanted.root else ""
    normal: Normal = normalise(
        [FilePath(one) for one in files],
        profiles=tuple(wanted.profiles) or ("*",),
        env_files=[FilePath(one) for one in wanted.env_files],
        settings=dict(wanted.settings),
        project=wanted.name or None,
        own=wanted.own,
        root=root,
    )
    folders = dict.fromkeys(os.path.dirname(os.path.realpath(one)) for one in files)
    return Machine(normal, (*folders, *filter(None, [root])), robot)
