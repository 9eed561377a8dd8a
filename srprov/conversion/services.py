"""One service of Compose -> one entry of an EDF's `services`, its fields in the order in which people read them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from srprov.conversion import builds, deploy, fields, granted, mounts, network
from srprov.conversion.project import Project
from srprov.importing.position import Path

_ORDER = (
    *("cdf", "image", "pull_policy", "robot", "requires", "replicas", "per_robot", "job", "profiles", "command"),
    *("entrypoint", "working_dir", "user", "network", "hostname", "ports", "expose", "extra_hosts", "depends_on"),
    *("environment", "secrets", "volumes", "tmpfs", "devices", "gpus", "runtime", "privileged"),
)


def entry(name: str, given: Mapping[str, Any], hostname: str, project: Project, folder: str) -> dict[str, Any]:
    """Return a service as an EDF has it; `folder` is where the experiment will lie."""
    at: Path = ("services", name)
    built = given.get("build") is not None
    found: dict[str, Any] = {
        **fields.same(given, project, at),
        **fields.environment(given, project, at),
        **fields.namespaces(given, project, at),
        **fields.various(given, project, at),
        **fields.profiles(given, project, at),
        **fields.gpus(given, project, at),
        **network.network(given, project, at),
        **network.extra_hosts(given, project, at),
        **network.depends_on(given, project, at),
        **network.healthcheck(given, project, at),
        **network.ports(given, project, at),
        **deploy.placement(given, project, at, built=built),
    }
    found = {**deploy.resources(given, project, at), **found}
    if built:
        found.pop("image", None)
        found["cdf"] = builds.cdf(given, name, project, at)
    if hostname:
        found["hostname"] = hostname
    if devices := _devices(given, project, at):
        found["devices"] = devices
    shipped, uses = granted.configs(given, project, at, folder)
    for key, values in (
        ("volumes", [*mounts.volumes(given, name, project, at), *shipped]),
        ("secrets", [*granted.secrets(given, project, at, folder), *uses]),
    ):
        if values:
            found[key] = values
    order = {key: index for index, key in enumerate(_ORDER)}
    return dict(sorted(found.items(), key=lambda one: (order.get(one[0], len(order)), one[0])))


def _devices(given: Mapping[str, Any], project: Project, at: Path) -> list[str]:
    found = []
    for index, one in enumerate(given.get("devices") or ()):
        source, target = str(one["source"]), str(one.get("target") or one["source"])
        rights = str(one.get("permissions") or "rwm")
        if not source.startswith("/"):
            words = f"'{source[:60]}' is no path of a device"
            project.notes.refused((*at, "devices", index), words, "name the device's path, or take 'gpus'")
            continue
        short = source if target == source else f"{source}:{target}"
        found.append(short if rights == "rwm" else f"{source}:{target}:{rights}")
    return found
