"""What becomes of each field of an EDF and of a CDF in Kubernetes: the table. Pure.

Source: the Kubernetes API reference, Pod v1, Job batch/v1, Deployment apps/v1, NetworkPolicy networking.k8s.io/v1.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from srprov.exporting import classes
from srprov.exporting.classes import Table
from srprov.exporting.model import ADAPTED, DROPPED, EXACT, REFUSED

CANNOT: Mapping[str, str] = MappingProxyType(
    {
        "devices": "Kubernetes gives devices by plugins alone, which the cluster must have",
        "device_cgroup_rules": "a pod has no such field",
        "ulimits": "a pod has no such field: they are the container runtime's",
        "oom_score_adj": "the kubelet sets it",
        "cpuset": "the kubelet gives processors, by a policy of its own",
        "pids_limit": "the kubelet limits processes, for all pods alike",
    }
)
"""Field of a service -> why Kubernetes cannot do what it says."""

_CHOSEN = "it is decided: each pod has a nodeSelector"
_NO_TRIALS = "Kubernetes runs no trials"
_SECRET = "a Secret, which must be made; its value is no part of the export"  # noqa: S105 - words
_RUNTIME: Table = {
    **{name: (REFUSED, words) for name, words in CANNOT.items()},
    "command": (EXACT, "`args`"),
    "entrypoint": (EXACT, "`command`"),
    "working_dir": (EXACT, "workingDir"),
    "user": (EXACT, "runAsUser and runAsGroup; numbers alone"),
    "stop_signal": (DROPPED, "the image's own is sent: pods have such a field from Kubernetes 1.33 on"),
    "stop_grace_period": (ADAPTED, "terminationGracePeriodSeconds, in whole seconds"),
    "healthcheck": (
        ADAPTED,
        "a startup and a readiness probe, in whole seconds; an unhealthy pod is not asked any more",
    ),
    "ports": (EXACT, "hostPort"),
    "expose": (EXACT, "no port is closed within the namespace"),
    "sysctls": (ADAPTED, "the kubelet refuses those that it does not hold for safe, unless it is told otherwise"),
    "group_add": (EXACT, "supplementalGroups; numbers alone"),
    "security_opt": (EXACT, "`no-new-privileges` alone: allowPrivilegeEscalation"),
    "tty": (EXACT, ""),
    "stdin_open": (EXACT, "stdin"),
    "init": (ADAPTED, "shareProcessNamespace: the pod's own first process ends orphans"),
    "read_only": (EXACT, "readOnlyRootFilesystem"),
    "tmpfs": (ADAPTED, "an emptyDir in memory, with the size alone"),
    "hostname": (EXACT, "with a Service of that name"),
    "extra_hosts": (EXACT, "hostAliases"),
    "labels": (DROPPED, "labels of pods are Kubernetes' own means of finding them"),
    "logging": (DROPPED, "the node's container runtime keeps the logs"),
    "mem_limit": (EXACT, "resources.limits"),
    "mem_reservation": (ADAPTED, "resources.requests, which Kubernetes also counts when it places pods"),
    "cpus": (EXACT, "resources.limits"),
    "shm_size": (ADAPTED, "an emptyDir in memory at /dev/shm"),
    "ipc": (EXACT, "`host` alone: hostIPC"),
    "pid": (EXACT, "`host` alone: hostPID"),
    "gpus": (ADAPTED, "a limit of nvidia.com/gpu, for which the cluster needs that plugin"),
    "runtime": (ADAPTED, "runtimeClassName, which the cluster must have"),
    "restart": (ADAPTED, "`always`, `unless-stopped`: a Deployment; else a Pod, whose restarts are not counted"),
    "pull_policy": (EXACT, "imagePullPolicy"),
    "environment": (EXACT, ""),
    "volumes": (
        ADAPTED,
        "files of the experiment become ConfigMaps, which hold 1 MB each; a volume is a folder of its node",
    ),
    "data": (ADAPTED, "a ConfigMap, which holds 1 MB"),
    "job": (ADAPTED, "a Job"),
}

EDF: Table = MappingProxyType(
    {
        **classes.EDF,
        "edf": (DROPPED, "manifests have versions of their own"),
        "name": (EXACT, "the namespace, srprov-NAME"),
        "services.*.cdf": (
            ADAPTED,
            "`image`; build.sh builds it from its folder in build/, and the nodes must be given it",
        ),
        "services.*.cost": (DROPPED, _CHOSEN),
        "services.*.requires": (DROPPED, _CHOSEN),
        "services.*.robot": (ADAPTED, "nodeSelector"),
        "services.*.env_file": (ADAPTED, "in `env`"),
        "services.*.secrets": (ADAPTED, _SECRET),
        "services.*.depends_on": (ADAPTED, "apply.sh starts services in their order, and waits"),
        "services.*.profiles": (ADAPTED, "it was wanted when this was exported"),
        "services.*.network": (ADAPTED, "the cluster's pod network, closed to others by a NetworkPolicy"),
        "services.*.per_robot": (ADAPTED, "a pod for each robot, NAME-ROBOT"),
        "services.*.replicas": (ADAPTED, "a pod for each, NAME-1 to NAME-n"),
        **{f"services.*.{name}": rule for name, rule in _RUNTIME.items()},
        "pools": (DROPPED, _CHOSEN),
        "relations": (DROPPED, _CHOSEN),
        "weights": (DROPPED, _CHOSEN),
        "placement": (DROPPED, _CHOSEN),
        **{
            f"network.{name}": (DROPPED, "the cluster has its own")
            for name in ("subnet", "mtu", "vni", "port", "persist")
        },
        "network.encryption": (REFUSED, "whether pods' traffic is encrypted is decided by the cluster's network"),
        "network.discovery": (ADAPTED, "variables and files of the services, with names for addresses"),
        "trials": (DROPPED, _NO_TRIALS),
        "results": (DROPPED, f"{_NO_TRIALS}; what services write stays in their pods"),
        "metrics": (DROPPED, _NO_TRIALS),
        "volumes.*.seed": (REFUSED, "a folder of a node is not filled"),
        "volumes.*.user": (REFUSED, "a folder of a node is given to nobody"),
        "secrets.*.env": (ADAPTED, _SECRET),
        "secrets.*.file": (ADAPTED, _SECRET),
        "secrets.*.command": (ADAPTED, _SECRET),
        "playbooks": (DROPPED, "Kubernetes states nothing about the machine itself"),
    }
)
"""Field -> its class, and why or how."""

CDF: Table = MappingProxyType(
    {
        **classes.CDF,
        "cdf": (DROPPED, "manifests have versions of their own"),
        "name": (ADAPTED, "the name of its image, and of its folder in build/"),
        **{
            name: (DROPPED, "nothing in a manifest describes an image")
            for name in ("description", "authors", "license")
        },
        "platforms": (DROPPED, "the image is built on the machine that builds it"),
        "requires": (DROPPED, _CHOSEN),
        **_RUNTIME,
    }
)
