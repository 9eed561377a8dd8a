"""An experiment, placed on robots, as manifests for Kubernetes. Pure.

Takes the experiment with its services placed, and functions that read the controller's files; gives an `Export`: the
namespace with Services, policies and files; numbered workloads, one file for each level of starting; and the scripts.
Each pod has the selector of its robot's node: the assignment stays srprov's.
"""

from __future__ import annotations

import shlex
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from itertools import chain
from typing import Any

from msgspec.structs import replace

from srprov.codes import Code
from srprov.definitions.model import NO_REGISTRY, Experiment, Service
from srprov.errors import DefinitionError, Diagnostic
from srprov.exporting import cluster
from srprov.exporting.images import built
from srprov.exporting.kubernetes_classes import CDF, EDF
from srprov.exporting.kubernetes_files import NODE_FOLDER, Mounted, Mounting
from srprov.exporting.kubernetes_pod import (
    ENVIRONMENT,
    LABEL,
    container,
    filled,
    namespace_of,
    pod_remarks,
    pod_settings,
)
from srprov.exporting.kubernetes_policy import policies, services_of
from srprov.exporting.kubernetes_script import APPLY, BUILD, apply_script, build_script
from srprov.exporting.model import ADAPTED, EXACT, REFUSED, Export, File, Need, Remark
from srprov.exporting.readme import plain, readme
from srprov.exporting.report import fields_of, lossy, refused
from srprov.exporting.wanted import Wanted
from srprov.yamldoc import writer

_README, _NAMESPACE = "README.md", "00-namespace.yaml"
_NO_LABEL = "cannot be exported: names of Kubernetes have no '_'"
_ENDS = ("no", "on-failure")
"""Kinds of `restart` after which a container that has ended with 0 stays so."""


def export(wanted: Wanted) -> Export:
    """Return the manifests of an experiment, with all that they need.

    Raises:
        DefinitionError: A field that Kubernetes has nothing for, unless `wanted.lossy`; a name that it does not take;
            an image that cannot be; at its line.
    """
    experiment, overlay = cluster.by_name(wanted.definitions.experiment)
    services = {name: experiment.services[name] for name in sorted(wanted.placed)}
    _check_names(experiment, services.values())
    containers = wanted.definitions.containers
    images = built(containers, wanted.listing, wanted.read, wanted.checkout, wanted.open)
    tags = cluster.image_names(experiment, images)
    names = {**{key: one.image for key, one in containers.items() if one.image}, **tags}
    mounting = Mounting(wanted=wanted, experiment=experiment)
    told = {name: cluster.discovery(experiment, overlay, one) for name, one in services.items()}
    mounted = {name: mounting.mounted(one, sorted(told[name].files.items())) for name, one in services.items()}
    remarks = [*_remarks(experiment, wanted), *chain.from_iterable(one.remarks for one in mounted.values())]
    fields = fields_of(wanted.texts, wanted.edf, remarks, (EDF, CDF))
    if (problems := refused(fields)) and not wanted.lossy:
        raise DefinitionError(problems)
    levels = cluster.levels(services)
    workloads = {
        name: _workload(wanted, one, names.get(one.cdf) or one.image, told[name].environment, mounted[name])
        for name, one in services.items()
    }
    files = [_documents(_NAMESPACE, experiment, _before(experiment, services, mounted.values()))]
    for number, level in enumerate(levels):
        files.append(_documents(level_file(number), experiment, [workloads[name] for name in level]))
    used = {tags[one.cdf]: images[one.cdf].name for one in services.values() if one.cdf in tags}
    files.append(File(path=APPLY, content=apply_script(experiment, levels).encode(), mode=0o755))
    if used:
        files.append(File(path=BUILD, content=build_script(used).encode(), mode=0o755))
    needs = {*_variables(wanted, list(services.values())), *(need for one in mounted.values() for need in one.needs)}
    done = Export(
        experiment=experiment.name,
        edf=wanted.edf,
        machines=cluster.machines(wanted.placed, APPLY),
        files=tuple(sorted([*files, *cluster.builds(images)], key=lambda one: one.path)),
        fields=lossy(fields),
        needs=tuple(sorted(needs)),
        notes=(*wanted.notes, *(note for one in images.values() for note in one.moving)),
        made_by="Manifests for Kubernetes, made by `srprov export kubernetes`",
    )
    return replace(done, files=(*done.files, _readme(experiment, done, used)))


def _readme(experiment: Experiment, done: Export, used: Collection[str]) -> File:
    keeping = {
        machine.robot
        for machine in done.machines
        for name in machine.services
        if any(mount.kind == "volume" for mount in experiment.services[name].runtime.mounts)
    }
    start = _start(done, namespace_of(experiment), used, sorted(keeping))
    return File(path=_README, content=readme(experiment, done, start).encode())


def _check_names(experiment: Experiment, services: Iterable[Service]) -> None:
    problems = [
        Diagnostic(one.location, _NO_LABEL, f"services.{one.name}", code=Code.NOT_TRANSLATED)
        for one in services
        if not LABEL.fullmatch(one.name)
    ]
    if not LABEL.fullmatch(experiment.name):
        words = "cannot be exported: a namespace's name starts and ends with a letter or digit"
        problems.append(
            Diagnostic(next(iter(experiment.services.values())).location, words, "name", code=Code.NOT_TRANSLATED)
        )
    if problems:
        raise DefinitionError(problems)


def _remarks(experiment: Experiment, wanted: Wanted) -> Iterator[Remark]:
    for name in sorted(wanted.placed):
        one = experiment.services[name]
        if one.network == "both":
            words = "a pod is on the pod network or on its node's, not on both"
            yield cluster.remark(one, "network", REFUSED, words)
        elif one.network == "host":
            yield cluster.remark(one, "network", ADAPTED, "hostNetwork; no policy holds for it")
        elif one.network == "none":
            words = "a policy that denies all traffic, where the cluster's network holds to policies"
            yield cluster.remark(one, "network", ADAPTED, words)
        yield from cluster.empty_words(one)
        yield from pod_remarks(one)
        for variable, value in sorted(one.runtime.environment.items()):
            if wanted.open.stands_for(value):
                words = f"{variable} is taken from the Secret '{ENVIRONMENT}'"
                yield cluster.remark(one, "environment", ADAPTED, words)
    yield from cluster.discovery_remarks(wanted.definitions.experiment)
    if experiment.network.encryption == "none":
        yield Remark(path=("network", "encryption"), kind=EXACT, words="")


def _workload(
    wanted: Wanted, service: Service, image: str, told: Mapping[str, str], mounted: Mounted
) -> dict[str, Any]:
    """Return the Job, the Deployment or the Pod of a service."""
    run = service.runtime
    policy, _, times = run.restart.partition(":")
    ends = policy in _ENDS
    labels = filled(
        {"srprov.service": service.name, "srprov.of": service.instance_of, "srprov.network": service.network}
    )
    spec = {
        **pod_settings(service),
        "nodeSelector": {"kubernetes.io/hostname": wanted.placed[service.name]},
        "restartPolicy": "Always" if not ends else "OnFailure" if policy == "on-failure" else "Never",
        "containers": [container(service, image, {**told, **run.environment}, mounted.mounts, wanted)],
        **filled({"volumes": list(mounted.volumes)}),
    }
    meta = {"name": service.name, "labels": labels}
    template = {"metadata": {"labels": labels}, "spec": spec}
    if run.job:
        again = {"backoffLimit": int(times) if times else 0 if policy == "no" else 6}
        spec["restartPolicy"] = "Never" if policy == "no" else "OnFailure"
        return {"apiVersion": "batch/v1", "kind": "Job", "metadata": meta, "spec": {**again, "template": template}}
    if ends:
        return {"apiVersion": "v1", "kind": "Pod", "metadata": meta, "spec": spec}
    described = {
        "replicas": 1,
        # one container at a time, as elsewhere: a new one starts when the old one has ended
        "strategy": {"type": "Recreate"},
        "selector": {"matchLabels": {"srprov.service": service.name}},
        "template": template,
    }
    return {"apiVersion": "apps/v1", "kind": "Deployment", "metadata": meta, "spec": described}


def _before(
    experiment: Experiment, services: Mapping[str, Service], mounted: Collection[Mounted]
) -> Iterator[dict[str, Any]]:
    """Yield all that workloads need: the namespace, policies, Services, files."""
    yield {"apiVersion": "v1", "kind": "Namespace", "metadata": {"name": namespace_of(experiment)}}
    yield from policies(services)
    yield from services_of(services)
    maps = {one["metadata"]["name"]: one for part in mounted for one in part.maps}
    yield from (maps[name] for name in sorted(maps))


def _documents(path: str, experiment: Experiment, some: Iterable[Mapping[str, Any]]) -> File:
    """Return a file with several documents, each in the experiment's namespace and with its label."""
    texts = []
    for one in some:
        meta: dict[str, Any] = dict(one["metadata"])
        place = {} if one["kind"] == "Namespace" else {"namespace": namespace_of(experiment)}
        labels = {"srprov.instance": experiment.name, **meta.pop("labels", {})}
        texts.append(writer.document({**one, "metadata": {**meta, **place, "labels": labels}}))
    head = f"# {experiment.name}; made by srprov export kubernetes.\n"
    return File(path=path, content=(head + "---\n".join(texts)).encode())


def level_file(number: int) -> str:
    """Return the name of a level's file; levels count from 0."""
    return f"{(number + 1) * 10}-level.yaml"


def _variables(wanted: Wanted, services: Sequence[Service]) -> Iterator[Need]:
    for name in cluster.open_names(wanted, services):
        what = (
            f"Its value, in the Secret '{ENVIRONMENT}': `kubectl create secret generic {ENVIRONMENT} "
            f"-n {namespace_of(wanted.definitions.experiment)} --from-literal={shlex.quote(name)}=…`, with all such "
            "variables at once."
        )
        yield Need(kind="variable", name=name, what=what)


def _start(done: Export, namespace: str, used: Collection[str], keeping: Sequence[str]) -> Iterator[str]:
    yield from ("## Start", "")
    yield "The nodes of the cluster have the robots' names as their label `kubernetes.io/hostname`:"
    yield ""
    for machine in done.machines:
        yield f"- {plain(machine.robot)}: {', '.join(machine.services)}"
    yield ""
    if keeping:
        yield f"Volumes are folders of their node. First, as root on {plain(', '.join(keeping))}:"
        yield from ("", f"    install -d -m 0700 -o root -g root {NODE_FOLDER}", "")
        yield "A pod can leave a program in a volume that is root's whoever starts it, so no user of the node may get"
        yield "there. Pods still have their volumes, as the node mounts them as root."
        yield ""
    if used:
        yield f"Build the images with `./{BUILD}`, and give them to the nodes that run them: push them to a registry"
        yield f"that the nodes know, with its name instead of `{NO_REGISTRY}` here and in the manifests;"
        yield "or load them into a node:"
        yield from ("", "    docker save IMAGE | ssh NODE ctr -n k8s.io images import -", "")
    yield "Then"
    yield from ("", f"    ./{APPLY}", "", f"and to end it `kubectl delete namespace {namespace}`.", "")
    yield "Services start level by level: apply.sh waits until what others need is there, for five minutes each."
    yield "Policies hold where the cluster's network holds to them."
    yield ""
