"""The data sets of an experiment as the playbooks see them: which content, and where it lies on robots.

Takes mounts; gives plain values. Reads files to hash them, each once for as long as it does not change.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from srprov import datasets
from srprov.codes import Code
from srprov.definitions.containermodel import Mount
from srprov.definitions.model import Service
from srprov.errors import RefusedError, UsageError
from srprov.modules.dataset import DataParams
from srprov.modules.module import STATE_ROOT
from srprov.resource import Resource


def data_set(instance: str, mount: Mount) -> dict[str, Any]:
    """Return a data set: where the robot notes that it is used, its sha256, its size (0: not known) and its address.

    Raises:
        UsageError: Its file cannot be read, is too large, or has another hash than the definition says.
    """
    sha256, size = _shipped(mount) if mount.source else (mount.sha256, 0)
    return {"path": f"{STATE_ROOT}/{instance}/data/{sha256}", "sha256": sha256, "size": size, "url": mount.url}


def _shipped(mount: Mount) -> tuple[str, int]:
    """Return the sha256 and the size of a file of this machine."""
    try:
        sha256, size = datasets.digest(mount.source)
    except OSError as error:
        raise UsageError(f"{mount.source} cannot be shipped: {error.strerror}", code=Code.DATA_SET) from error
    if mount.sha256 not in ("", sha256):
        raise UsageError(
            f"{mount.source} has the sha256 {sha256}, not {mount.sha256}",
            hint="take the file that was meant",
            code=Code.DATA_SET,
        )
    if size > datasets.MOST_BYTES:
        raise UsageError(f"{mount.source} is larger than {datasets.MOST_BYTES >> 30} GiB", code=Code.DATA_SET)
    return sha256, size


def used_data(data: Mapping[Mount, Mapping[str, Any]], services: Iterable[Service]) -> list[Mapping[str, Any]]:
    """Return the data sets of some services, each once, by path."""
    used = {data[m]["path"]: data[m] for one in services for m in one.runtime.mounts if m.kind == "data"}
    return [used[path] for path in sorted(used)]


def refuse_files(wants: Iterable[Resource]) -> None:
    """Refuse to send files of this machine for a plan that was not written here: it would only have to name a hash.

    Raises:
        RefusedError: Names the data sets.
    """
    named = sorted(
        {want.params.sha256 for want in wants if isinstance(want.params, DataParams) and not want.params.url}
    )
    if named:
        raise RefusedError(
            f"this plan was not written on this controller, and uses data sets from files: {', '.join(named)}",
            hint="plan its EDF here",
            code=Code.STRANGE_PLAN,
        )
