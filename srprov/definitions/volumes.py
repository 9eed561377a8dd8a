"""`volumes` of an EDF: what named volumes hold when they are made.

Takes the root and the services as they were built; gives the services with the seeds of their volumes, or adds to
`Findings`. Touches the file system for looking: a seed is a folder of the experiment's, as what is shipped.
"""

from __future__ import annotations

import os
from collections.abc import Mapping

from msgspec.structs import replace

from srprov.codes import Code
from srprov.definitions import paths
from srprov.definitions.containermodel import Mount, Seed
from srprov.definitions.model import Service
from srprov.definitions.values import text
from srprov.errors import did_you_mean
from srprov.yamldoc.nodes import Findings, Map, Scalar


def seeded(
    root: Map, services: Mapping[str, Service], folder: str, findings: Findings, *, whole: bool
) -> dict[str, Service]:
    """Return the services with the seeds of the volumes that they mount; `whole`: all they are made from is known."""
    seeds = _seeds(root, folder, findings)
    mounted = {one.source for service in services.values() for one in service.runtime.mounts if one.kind == "volume"}
    given = root.entries.get("volumes")
    for name in sorted(seeds.keys() - mounted) if whole and not findings.broken(("services",)) else ():
        assert isinstance(given, Map)
        hint = did_you_mean(name, mounted)
        findings.add(
            given.keys[name],
            f"no service mounts the volume '{name[:60]}'",
            ("volumes", name),
            hint,
            code=Code.NO_SUCH_NAME,
        )
    return {name: _with_seeds(one, seeds) for name, one in services.items()}


def _seeds(root: Map, folder: str, findings: Findings) -> dict[str, Seed]:
    given = root.entries.get("volumes")
    found: dict[str, Seed] = {}
    for name, entry in given.entries.items() if isinstance(given, Map) else ():
        path = ("volumes", name, "seed")
        source = entry.entries.get("seed") if isinstance(entry, Map) else None
        if not isinstance(entry, Map) or not isinstance(source, Scalar) or findings.broken(("volumes", name)):
            continue
        real = paths.resolve(source, folder, findings, path, tree=True)
        if real and not paths.is_closed(real) and not os.path.isdir(real):
            findings.add(source, f"'{source.text[:80]}' is a file; a volume is a folder", path, code=Code.VOLUME)
        found[name] = Seed(path=real, user=text(entry.entries.get("user")))
    return found


def _with_seeds(service: Service, seeds: Mapping[str, Seed]) -> Service:
    mounts = tuple(_with_seed(one, seeds) for one in service.runtime.mounts)
    return replace(service, runtime=replace(service.runtime, mounts=mounts))


def _with_seed(mount: Mount, seeds: Mapping[str, Seed]) -> Mount:
    return replace(mount, seed=seeds[mount.source]) if mount.kind == "volume" and mount.source in seeds else mount
