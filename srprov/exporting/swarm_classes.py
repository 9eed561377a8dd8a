"""What becomes of each field of an EDF and of a CDF in a stack of Docker Swarm: the table. Pure.

Where it differs from Compose's table only; `docker stack deploy` takes no notice of some of Compose's keys, so what
they say is refused here. Source: Docker's "docker stack deploy" and "Compose file version 3 reference".
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from srprov.exporting import classes
from srprov.exporting.classes import Table
from srprov.exporting.model import ADAPTED, DROPPED, EXACT, REFUSED

_NO_KEY = "a service of Swarm has no such key"
_IGNORED = "`docker stack deploy` takes no notice of it"
CANNOT: Mapping[str, str] = MappingProxyType(
    {
        **dict.fromkeys(("devices", "privileged", "security_opt", "ipc", "pid"), _IGNORED),
        **dict.fromkeys(("device_cgroup_rules", "oom_score_adj", "cpuset", "group_add", "runtime"), _NO_KEY),
        "gpus": "Swarm counts only devices that each engine's own configuration names",
    }
)
"""Field of a service -> why Swarm cannot do what it says."""

_CHOSEN = "it is decided: the stack pins each service to its robot"
_NO_TRIALS = "Swarm runs no trials"
_RUNTIME: Table = {
    **{name: (REFUSED, words) for name, words in CANNOT.items()},
    "mem_limit": (EXACT, "deploy.resources.limits"),
    "cpus": (EXACT, "deploy.resources.limits"),
    "pids_limit": (EXACT, "deploy.resources.limits"),
    "mem_reservation": (ADAPTED, "deploy.resources.reservations, which Swarm also counts when it places services"),
    "shm_size": (ADAPTED, "a tmpfs of that size at /dev/shm"),
    "tmpfs": (ADAPTED, "with the size alone"),
    "restart": (ADAPTED, "deploy.restart_policy: the same container is not started again, a new one is made"),
    "job": (ADAPTED, "it is not started again; deploy.sh waits until it has ended with 0 where another needs that"),
    "pull_policy": (DROPPED, "Swarm pulls what a robot does not have"),
    "volumes": (ADAPTED, "files of the experiment become configs, which hold 500 kB each"),
    "data": (ADAPTED, "a config, which holds 500 kB"),
    "ports": (EXACT, "published on its robot alone: `mode: host`"),
}

EDF: Table = MappingProxyType(
    {
        **classes.EDF,
        "edf": (DROPPED, "a stack has no version of its own"),
        "name": (EXACT, "the stack's name, as deploy.sh gives it"),
        "services.*.cdf": (ADAPTED, "`image`; build.sh builds it from its folder in build/"),
        "services.*.cost": (DROPPED, _CHOSEN),
        "services.*.requires": (DROPPED, _CHOSEN),
        "services.*.robot": (ADAPTED, "deploy.placement.constraints"),
        "services.*.env_file": (ADAPTED, "in `environment`"),
        "services.*.secrets": (ADAPTED, "a secret of Swarm's, which must be made; its value is no part of the export"),
        "services.*.depends_on": (ADAPTED, "deploy.sh starts services in their order, and waits"),
        "services.*.profiles": (ADAPTED, "it was wanted when this was exported"),
        "services.*.network": (ADAPTED, "the stack's own overlay, with names of the services"),
        "services.*.per_robot": (ADAPTED, "a service for each robot, NAME-ROBOT"),
        **{f"services.*.{name}": rule for name, rule in _RUNTIME.items()},
        "pools": (DROPPED, _CHOSEN),
        "relations": (DROPPED, _CHOSEN),
        "weights": (DROPPED, _CHOSEN),
        "placement": (DROPPED, _CHOSEN),
        "network.mtu": (EXACT, "an option of the network's driver"),
        **{f"network.{name}": (DROPPED, "Swarm has its own") for name in ("vni", "port", "persist")},
        "network.encryption": (ADAPTED, "Swarm's own: IPsec between the robots"),
        "network.discovery": (ADAPTED, "variables and files of the services, with names for addresses"),
        "trials": (DROPPED, _NO_TRIALS),
        "results": (DROPPED, f"{_NO_TRIALS}; what services write stays in their containers"),
        "metrics": (DROPPED, _NO_TRIALS),
        "volumes.*.seed": (REFUSED, "Swarm fills no volume from a folder"),
        "volumes.*.user": (REFUSED, "Swarm gives no volume to a user"),
        "secrets.*.env": (ADAPTED, "a secret of Swarm's, which must be made"),
        "secrets.*.file": (ADAPTED, "a secret of Swarm's, which must be made"),
        "secrets.*.command": (ADAPTED, "a secret of Swarm's, which must be made"),
        "playbooks": (DROPPED, "Swarm states nothing about the machine itself"),
    }
)
"""Field -> its class, and why or how."""

CDF: Table = MappingProxyType(
    {
        **classes.CDF,
        "cdf": (DROPPED, "a stack has no version of its own"),
        "name": (ADAPTED, "the name of its image, and of its folder in build/"),
        **{name: (DROPPED, "nothing in a stack describes an image") for name in ("description", "authors", "license")},
        "platforms": (DROPPED, "the image is built on the robot that runs it"),
        "requires": (DROPPED, _CHOSEN),
        **_RUNTIME,
    }
)
