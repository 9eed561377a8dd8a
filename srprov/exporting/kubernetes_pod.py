"""One service of an experiment as a pod of Kubernetes: container, probes, security, resources. Pure.

`$(NAME)` means a variable in commands and values of Kubernetes, `$$` one dollar, and neither does in an EDF: each such
dollar is doubled. Source: k8s.io/kubernetes/third_party/forked/golang/expansion.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from srprov.definitions.containermodel import EVERYWHERE, HealthCheck, Runtime
from srprov.definitions.model import EXPORTED, Experiment, Service
from srprov.exporting import cluster
from srprov.exporting.kubernetes_classes import CANNOT
from srprov.exporting.model import REFUSED, Remark
from srprov.exporting.wanted import Wanted

ENVIRONMENT = "environment"
"""The Secret with the variables that an EDF only names."""
_PULL = {"missing": "IfNotPresent", "always": "Always", "never": "Never", "build": "IfNotPresent"}
_NO_NEW = ("no-new-privileges", "no-new-privileges:true", "no-new-privileges=true")
_GPU = "nvidia.com/gpu"
_ID = re.compile(r"[0-9]{1,18}")
_MEANS = re.compile(r"\$(?=[$(])")
_NO_FIELD = "a pod has no such field, but for"
LABEL = re.compile(r"[a-z0-9]([a-z0-9-]{0,61}[a-z0-9])?")
"""What names of pods, Services, hosts and namespaces may be: a DNS label, RFC 1123."""


def namespace_of(experiment: Experiment) -> str:
    """Return the namespace of an experiment, in which nobody looks for anything else.

    Pods of a whole cluster look for `github.com` as the Service `github` of a namespace `com` first, and a stranger's
    experiment is called as he likes.
    """
    return f"{EXPORTED}{experiment.name}"


def container(
    service: Service, image: str, environment: Mapping[str, str], mounts: Sequence[Mapping[str, Any]], wanted: Wanted
) -> dict[str, Any]:
    """Return the container of a pod.

    Args:
        service: The service.
        image: Its image's name.
        environment: What it is told.
        mounts: Its volumeMounts.
        wanted: Which values stand for variables of whoever applies it.
    """
    run = service.runtime
    return filled({
        "name": service.name,
        "image": image,
        "imagePullPolicy": _PULL[run.pull_policy],
        "command": [literal(word) for word in run.entrypoint or ()],
        "args": [literal(word) for word in run.command or ()],
        "workingDir": run.working_dir,
        "env": [_variable(name, value, wanted) for name, value in sorted(environment.items())],
        "ports": [] if service.network == "host" else _ports(run),
        "resources": _resources(run),
        "securityContext": _security(run),
        "stdin": run.stdin_open,
        "tty": run.tty,
        "volumeMounts": list(mounts),
        **_probes(run.healthcheck),
    })  # fmt: skip


def pod_settings(service: Service) -> dict[str, Any]:
    """Return what a pod's spec says beside containers, volumes, its node and its restarts."""
    run = service.runtime
    host = service.network == "host"
    user, _, group = run.user.partition(":")
    sysctls = {name: one for name, one in run.sysctls.items() if not (host and name.startswith("net."))}
    hosts: dict[str, list[str]] = {}
    for name, address in run.extra_hosts:
        hosts.setdefault(address, []).append(name)
    return {"automountServiceAccountToken": False} | filled({
        "hostname": (run.hostname or service.name) if not host else "",
        "hostNetwork": host,
        "dnsPolicy": "ClusterFirstWithHostNet" if host else "",
        "hostPID": run.pid == "host",
        "hostIPC": run.ipc == "host",
        "shareProcessNamespace": bool(run.init) and run.pid != "host",
        "runtimeClassName": run.runtime,
        "terminationGracePeriodSeconds": math.ceil(run.stop_grace_s),
        "hostAliases": [{"ip": address, "hostnames": names} for address, names in hosts.items()],
        "securityContext": filled({
            "sysctls": [{"name": name, "value": value} for name, value in sorted(sysctls.items())],
            "supplementalGroups": [int(one) for one in run.group_add if _is_number(one)],
            **({"runAsUser": int(user)} if _is_number(user) else {}),
            **({"runAsGroup": int(group)} if _is_number(group) else {}),
        }),
    })  # fmt: skip


def pod_remarks(service: Service) -> Iterator[Remark]:
    """Yield what is refused of a service's run-time fields."""
    run = service.runtime
    yield from cluster.refusals(service, CANNOT)
    check = run.healthcheck
    wrong = {
        "user": (not _numeric(run.user), "names of users are known in the image alone: give numbers"),
        "group_add": (not all(map(_is_number, run.group_add)), "names of groups are known in the image alone"),
        "security_opt": (bool({*run.security_opt} - {*_NO_NEW}), f"{_NO_FIELD} `no-new-privileges`"),
        "ipc": (run.ipc not in ("", "host", "private"), f"{_NO_FIELD} `host`"),
        "pid": (run.pid not in ("", "host"), f"{_NO_FIELD} `host`"),
        "gpus": (run.gpus == "all", "Kubernetes counts GPUs: give a number"),
        "hostname": (not LABEL.fullmatch(run.hostname or service.name), "it is no DNS label"),
        "extra_hosts": ("host-gateway" in dict(run.extra_hosts).values(), "Kubernetes knows no `host-gateway`"),
        "healthcheck": (check is not None and not check.test, "Kubernetes does not read health checks of images"),
    }
    for field, (is_wrong, why) in wrong.items():
        if is_wrong:
            yield cluster.remark(service, field, REFUSED, why)


def literal(text: str) -> str:
    """Return a text in which Kubernetes replaces nothing."""
    return _MEANS.sub("$$", text)


def filled(given: Mapping[str, Any]) -> dict[str, Any]:
    """Leave out what says nothing: no text, no list, false, nothing in it; a zero says something."""
    return {key: value for key, value in given.items() if value or (value == 0 and not isinstance(value, bool))}


def _variable(name: str, value: str, wanted: Wanted) -> dict[str, Any]:
    if taken := wanted.open.stands_for(value):
        return {"name": name, "valueFrom": {"secretKeyRef": {"name": ENVIRONMENT, "key": taken}}}
    return {"name": name, "value": literal(value)}


def _ports(run: Runtime) -> list[dict[str, Any]]:
    return [
        {
            "containerPort": inside,
            "hostPort": published,
            **({"hostIP": address} if address not in EVERYWHERE else {}),
            "protocol": protocol.upper(),
        }
        for address, published, inside, protocol in run.ports
    ]


def _resources(run: Runtime) -> dict[str, Any]:
    """Return limits and requests; a request that is not given would be the limit's, and keep a pod from its node."""
    gpus = run.gpus if run.gpus.isdecimal() else ""
    limits = filled({"cpu": f"{run.cpus:g}" if run.cpus else "", "memory": str(run.mem_limit or ""), _GPU: gpus})
    requests = {
        **({"cpu": "0"} if run.cpus else {}),
        **({"memory": str(run.mem_reservation)} if run.mem_limit or run.mem_reservation else {}),
    }
    return filled({"limits": limits, "requests": requests})


def _security(run: Runtime) -> dict[str, Any]:
    no_new = any(one in _NO_NEW for one in run.security_opt)
    added = [one.removeprefix("CAP_") for one in run.cap_add]
    dropped = [one.removeprefix("CAP_") for one in run.cap_drop]
    return {
        **filled({
            "privileged": run.privileged,
            "readOnlyRootFilesystem": run.read_only,
            "capabilities": filled({"add": added, "drop": dropped}),
        }),
        **({"allowPrivilegeEscalation": False} if no_new else {}),
    }  # fmt: skip


def _probes(check: HealthCheck | None) -> dict[str, Any]:
    if check is None or not check.test or check.test == ("NONE",):
        return {}
    kind, *words = check.test
    command = ["/bin/sh", "-c", *words] if kind == "CMD-SHELL" else words
    every = max(1, math.ceil(check.interval_s))
    probe = {
        "exec": {"command": [literal(word) for word in command]},
        "periodSeconds": every,
        "timeoutSeconds": max(1, math.ceil(check.timeout_s)),
    }
    patience = max(1, check.retries) + math.ceil(check.start_period_s / every)
    return {
        "startupProbe": {**probe, "failureThreshold": patience},
        "readinessProbe": {**probe, "failureThreshold": max(1, check.retries)},
    }


def _numeric(user: str) -> bool:
    """Return whether a user is empty, a number, or two with a colon between."""
    return not user or all(map(_is_number, user.split(":")))


def _is_number(text: str) -> bool:
    """Return whether it is a number that Linux can have; of thousands of digits Python makes none."""
    return _ID.fullmatch(text) is not None and int(text) < 2**32
