"""What becomes of each field of an EDF and of a CDF in Compose: the table that the report and the documentation show.

`*` stands for any name in a map. A line holds for all that is below it, but for what has a line of its own. Where it
depends on the experiment, a `Remark` says more; tests hold the table to the schemas. Pure.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from srprov.exporting.model import ADAPTED, DROPPED, EXACT, Path

Table = Mapping[str, tuple[str, str]]
"""Field -> its class, and why or how."""

_README = "in the README"
_NO_TRIALS = "Compose runs no trials"
_CHOSEN = "Compose chooses no robot: the file is for one machine"
_BUILT = "in the Dockerfile of its folder in build/"
_DOCKERFILE = "the Dockerfile as it is built, with its build context, in its folder in build/"

_RUNTIME: Table = {
    **dict.fromkeys(
        (
            *("command", "entrypoint", "working_dir", "user", "stop_signal", "stop_grace_period", "healthcheck"),
            *("devices", "ports", "expose", "ulimits", "cap_add", "cap_drop", "privileged", "sysctls", "group_add"),
            *("security_opt", "device_cgroup_rules", "tty", "stdin_open", "init", "read_only", "tmpfs", "hostname"),
            *("extra_hosts", "labels", "logging", "mem_reservation", "oom_score_adj", "cpus", "cpuset", "pids_limit"),
            *("shm_size", "ipc", "pid", "runtime", "restart", "pull_policy", "environment"),
        ),
        (EXACT, ""),
    ),
    "mem_limit": (EXACT, "with memswap_limit, as srprov gives no swap beside it"),
    "gpus": (EXACT, "deploy.resources.reservations.devices"),
    "volumes": (EXACT, "relative paths are copied into files/"),
    "data": (ADAPTED, "a copy of the file, mounted read-only"),
    "job": (DROPPED, "Compose does not tell whether a container was meant to end"),
}
_REQUIRES = (DROPPED, _CHOSEN)
_ABOUT = dict.fromkeys(("description", "authors", "license"), (ADAPTED, _README))

EDF: Table = MappingProxyType(
    {
        "edf": (DROPPED, "a Compose file has no version"),
        "name": (EXACT, "the project's name, srprov-NAME"),
        **_ABOUT,
        **dict.fromkeys(("doi", "notes"), (ADAPTED, _README)),
        "services.*.cdf": (ADAPTED, "`build`, with a folder in build/; or the image that the CDF names"),
        "services.*.image": (EXACT, ""),
        "services.*.cost": (DROPPED, _CHOSEN),
        "services.*.requires": _REQUIRES,
        "services.*.env_file": (EXACT, "a file in env/, with what the EDF's files say and nothing else replaces"),
        "services.*.secrets": (ADAPTED, "the value is no part of the export; the file's own mode holds, not `mode`"),
        "services.*.network": (EXACT, ""),
        "services.*.depends_on": (EXACT, ""),
        "services.*.robot": (DROPPED, _CHOSEN),
        "services.*.profiles": (EXACT, ""),
        "services.*.replicas": (ADAPTED, "a service for each, NAME-1 to NAME-n"),
        "services.*.per_robot": (ADAPTED, "a service for each robot, NAME-ROBOT; NAME on a single PC"),
        **{f"services.*.{name}": rule for name, rule in _RUNTIME.items()},
        "pools": (DROPPED, _CHOSEN),
        "relations": (DROPPED, _CHOSEN),
        "weights": (DROPPED, _CHOSEN),
        "placement": (DROPPED, _CHOSEN),
        "network.subnet": (EXACT, ""),
        **{
            f"network.{name}": (DROPPED, "there is no overlay: it is the overlay's")
            for name in ("mtu", "vni", "port", "persist", "encryption")
        },
        "network.discovery": (ADAPTED, "variables and files of the services, with the addresses that they have here"),
        "network.discovery_servers": (ADAPTED, "variables and files of the services"),
        "parameters": (ADAPTED, "variables with the first value of each, as `apply` does"),
        "trials": (DROPPED, _NO_TRIALS),
        "results": (DROPPED, f"{_NO_TRIALS}; what services write stays in their containers"),
        "metrics": (DROPPED, _NO_TRIALS),
        "volumes.*.seed": (ADAPTED, "a writable folder that holds it; Compose fills no volume from a folder"),
        "volumes.*.user": (ADAPTED, "the README says whom the folder must be given to"),
        "secrets.*.env": (EXACT, "`environment`"),
        "secrets.*.file": (ADAPTED, "a file in secrets/ that the reader puts there"),
        "secrets.*.command": (ADAPTED, "a file in secrets/ that the reader puts there"),
        "playbooks": (DROPPED, "Compose states nothing about the machine itself"),
    }
)
"""Field -> its class, and why or how."""

CDF: Table = MappingProxyType(
    {
        "cdf": (DROPPED, "a Compose file has no version"),
        "name": (ADAPTED, "the name of its folder in build/"),
        **{name: (DROPPED, "nothing in a Compose file describes an image") for name in _ABOUT},
        "extends": (ADAPTED, "both CDFs as one"),
        "base": (EXACT, _BUILT),
        "image": (EXACT, ""),
        "dockerfile": (EXACT, _DOCKERFILE),
        "platforms": (ADAPTED, "`platform`, where there is one; several are not said"),
        "packages": (EXACT, _BUILT),
        "repositories": (ADAPTED, "the files of the commit that it is now, in its folder in build/"),
        "files": (EXACT, _BUILT),
        "run": (EXACT, _BUILT),
        "requires": _REQUIRES,
        **_RUNTIME,
    }
)


def rule_of(table: Table, path: Path) -> tuple[str, tuple[str, str]] | None:
    """Return the line of a table for a field, with its key; None for one above all lines, such as `services`."""
    for length in range(len(path), 0, -1):
        for key in _keys(path[:length]):
            if key in table:
                return key, table[key]
    return None


def has_finer(table: Table, path: Path) -> bool:
    """Return whether lines of the table stand below a field."""
    starts = tuple(f"{key}." for key in _keys(path))
    return any(key.startswith(starts) for key in table)


def has_names(table: Table, path: Path) -> bool:
    """Return whether the keys of a field are names that its author chose."""
    return bool(path) and any(key.startswith(f"{'.'.join(path)}.*.") for key in table)


def _keys(path: Path) -> tuple[str, ...]:
    """Return the ways to write a path in the table: the second part is a name in those maps that have names."""
    plain = ".".join(path)
    return (plain, ".".join((path[0], "*", *path[2:]))) if len(path) > 1 else (plain,)
