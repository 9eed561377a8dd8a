"""Experiments in a folder, exported for clusters."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml
from msgspec.structs import replace

from srprov.controller import compose
from srprov.definitions.expand import expand
from srprov.definitions.model import Experiment
from srprov.exporting.model import Export


def on_cluster(
    tool: str,
    edf: Path,
    placed: Mapping[str, str] | None = None,
    *allowed: str,
    lossy: bool = False,
    profile: str = "*",
) -> Export:
    """Export for a cluster; without `placed` all services on one robot."""
    source = compose.read(str(edf), frozenset(allowed), (profile,), placed=True)
    source = replace(source, tool=tool, lossy=lossy)
    where = placed or dict.fromkeys(_instances(source.definitions.experiment), "r1")
    robots = {robot: f"192.0.2.{number}" for number, robot in enumerate(sorted(set(where.values())), 1)}
    return compose.on_robots(source, expand(source.definitions.experiment, {}, where), where, robots)


def _instances(experiment: Experiment) -> Iterator[str]:
    """Yield the names of what runs when there is one robot."""
    for name, one in experiment.services.items():
        if one.per_robot is not None:
            yield f"{name}-r1"
        elif one.replicas > 1:
            yield from (f"{name}-{number}" for number in range(1, one.replicas + 1))
        else:
            yield name


def documents(export: Export, path: str) -> list[dict[str, Any]]:
    """Return the documents of a file, as YAML reads them."""
    text = next(file.content.decode() for file in export.files if file.path == path)
    return list(yaml.safe_load_all(text))


def workload(export: Export, name: str) -> dict[str, Any]:
    """Return the Pod, Job or Deployment of that name."""
    every = [one for file in export.files if file.path.endswith("level.yaml") for one in documents(export, file.path)]
    return next(one for one in every if one["metadata"]["name"] == name)


def pod(export: Export, name: str) -> dict[str, Any]:
    """Return the spec of a service's pod."""
    spec = workload(export, name)["spec"]
    found: dict[str, Any] = spec["template"]["spec"] if "template" in spec else spec
    return found
