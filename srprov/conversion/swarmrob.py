"""SwarmRob's definitions -> a draft of an experiment: what SwarmRob reads is converted as of Compose files."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence

from msgspec.structs import replace

from srprov.conversion.experiment import Draft, convert
from srprov.conversion.kept import Kept
from srprov.conversion.notes import Finding
from srprov.conversion.project import Choices, Machine, instance_name
from srprov.importing import swarmrob
from srprov.importing.named import check_named


def draft(
    files: Sequence[str], folder: str, settings: Mapping[str, str], name: str = "", own: Collection[str] = ()
) -> Draft:
    """Return the experiment that a definition of SwarmRob, with its Dockerfiles, describes, without the files `own`.

    Raises:
        Refused: With everything that is wrong.
    """
    check_named(files)
    found = swarmrob.read(files, settings, name)
    machine = Machine(found.normal, found.folders)
    called = instance_name(str(found.normal.document["name"]))
    made = convert([machine], called, Choices(own=own), os.path.abspath(folder))
    more = [
        Finding(found.normal.position_of(path), ".".join(map(str, path)), Kept.DROPPED, message)
        for path, message in found.passed_over
    ]
    findings = sorted((*made.findings, *more), key=lambda one: (one.at, one.key, one.message))
    return replace(made, findings=tuple(findings))
