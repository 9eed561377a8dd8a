"""`--robot-map`: which file is which robot's. Takes a YAML file; gives the files of each robot, in the order named."""

from __future__ import annotations

import os
from collections.abc import Sequence

from srprov import names
from srprov.codes import Code
from srprov.errors import DefinitionError, did_you_mean
from srprov.yamldoc import loader
from srprov.yamldoc.nodes import Findings, Map, Scalar, Source


def by_robot(path: str, files: Sequence[str]) -> dict[str, list[str]]:
    """Return robot -> its files, of a map of file names or paths to robots.

    Raises:
        DefinitionError: The map cannot be read, names what is not among the files, or leaves one out.
    """
    root, findings = loader.read(path), Findings()
    entries = root.entries if isinstance(root, Map) else {}
    if not isinstance(root, Map) or not entries:
        place = root if root is not None else Scalar(Source(path), 1, 1, "")
        findings.add(place, "is no map of files to robots", hint="write compose.yaml: robot1", code=Code.COMPOSE)
        raise DefinitionError(findings.problems)
    robots: dict[str, str] = {}
    for key, value in entries.items():
        whole = [one for one in files if key in (one, os.path.normpath(one))]
        file = next(iter(whole or [one for one in files if key == os.path.basename(one)]), "")
        robot = value.text if isinstance(value, Scalar) else ""
        if not file:
            hint = did_you_mean(key, files) or f"the files are {', '.join(files)[:200]}"
            findings.add(root.keys[key], f"'{key[:80]}' is none of the files", (key,), hint, code=Code.COMPOSE)
        elif wrong := names.fault("robot", robot):
            findings.add(value, wrong, (key,), code=Code.COMPOSE)
        else:
            robots[file] = robot
    for file in files:
        if file not in robots and not findings.problems:
            findings.add(root, f"no robot is named for {file[:80]}", (), "add a line for it", code=Code.COMPOSE)
    if findings.problems:
        raise DefinitionError(findings.problems)
    return {robot: [one for one in files if robots[one] == robot] for robot in dict.fromkeys(robots.values())}
