"""What pods mount: ConfigMaps for files of the experiment, folders of their node, memory, Secrets. Pure."""

from __future__ import annotations

import base64
import hashlib
import posixpath
import re
from collections.abc import Sequence
from typing import Any

import msgspec

from srprov.definitions.containermodel import Mount
from srprov.definitions.model import Experiment, Service
from srprov.exporting import cluster
from srprov.exporting.kubernetes_pod import namespace_of
from srprov.exporting.model import REFUSED, Need, Remark
from srprov.exporting.wanted import Wanted
from srprov.network.discovery import FOLDER

_LIMIT = 1_000_000
"""Bytes that a ConfigMap holds, a little less than the 1 MiB of its store."""
NODE_FOLDER = "/var/lib/srprov-kubernetes"
"""Of each node, with the volumes; the kubelet would make it one that anybody passes."""
_UNITS = {"": "", "k": "Ki", "m": "Mi", "g": "Gi"}


class Mounted(msgspec.Struct, frozen=True, kw_only=True):
    """What a pod mounts."""

    volumes: tuple[dict[str, Any], ...] = ()
    mounts: tuple[dict[str, Any], ...] = ()
    maps: tuple[dict[str, Any], ...] = ()
    """ConfigMaps."""
    remarks: tuple[Remark, ...] = ()
    needs: tuple[Need, ...] = ()


class Mounting(msgspec.Struct, frozen=True, kw_only=True):
    """What turns mounts into volumes of pods."""

    wanted: Wanted
    experiment: Experiment

    def mounted(self, service: Service, files: Sequence[tuple[str, str]]) -> Mounted:
        """Return all that a service mounts; `files` are (name, text) of its discovery."""
        parts = [self._one(service, mount) for mount in service.runtime.mounts]
        told = tuple(
            cluster.Shipped(target=f"{FOLDER}/{name}", content=text.encode(), mode=0o444) for name, text in files
        )
        parts += [self._map(FOLDER, told)] if told else []
        parts += [_memory("/dev/shm", str(size))] if (size := service.runtime.shm_size) else []  # noqa: S108 - inside
        parts += [self._secret(use.source, use.target, int(use.mode, 8)) for use in service.secrets]
        volumes = {one["name"]: one for part in parts for one in part.volumes}
        return Mounted(
            volumes=tuple(volumes.values()),
            mounts=tuple(one for part in parts for one in part.mounts),
            maps=tuple(one for part in parts for one in part.maps),
            remarks=tuple(one for part in parts for one in part.remarks),
            needs=tuple(one for part in parts for one in part.needs),
        )

    def _one(self, service: Service, mount: Mount) -> Mounted:
        if mount.kind == "tmpfs":
            size = cluster.tmpfs_size(mount)
            return _memory(mount.target, f"{size[0]}{_UNITS[size[1]]}" if size else "")
        if mount.kind == "volume":
            path = f"{NODE_FOLDER}/{self.experiment.name}/{mount.source}"
            return _folder(path, "DirectoryOrCreate", mount)
        if mount.kind == "bind":
            why = f"where the home of '{mount.home_of}' is on its node is not known here" if mount.home_of else ""
            said = (cluster.remark(service, "volumes", REFUSED, why),) if why else ()
            made = _folder(mount.source, "DirectoryOrCreate" if mount.create_host_path else "", mount)
            return msgspec.structs.replace(made, remarks=said)
        try:
            files = cluster.shipped(self.wanted, mount, _LIMIT, "a ConfigMap")
        except cluster.CannotShip as cannot:
            return Mounted(remarks=(cluster.remark(service, cluster.field_of(mount), REFUSED, str(cannot)),))
        if sum(len(one.content) for one in files) > _LIMIT:
            why = f"its files have more than the {_LIMIT // 1000} kB that a ConfigMap holds"
            return Mounted(remarks=(cluster.remark(service, cluster.field_of(mount), REFUSED, why),))
        return self._map(mount.target, files)

    def _map(self, target: str, files: Sequence[cluster.Shipped]) -> Mounted:
        """Return a ConfigMap whose name changes with what is in it, and how it is mounted."""
        text: dict[str, str] = {}
        binary: dict[str, str] = {}
        items: list[dict[str, Any]] = []
        for number, one in enumerate(files):
            key = f"file-{number}"
            try:
                text[key] = one.content.decode()
            except UnicodeDecodeError:
                binary[key] = base64.b64encode(one.content).decode()
            path = posixpath.relpath(one.target, target)
            items.append({"key": key, "path": path, "mode": one.mode})
        alone = len(files) == 1 and files[0].target == target
        if alone:
            items[0]["path"] = posixpath.basename(target)
        said = repr((sorted(text.items()), sorted(binary.items()), items))
        name = f"files-{hashed(said)}"
        made = {
            "apiVersion": "v1",
            "kind": "ConfigMap",
            "metadata": {"name": name},
            **({"data": text} if text else {}),
            **({"binaryData": binary} if binary else {}),
        }
        only = {"subPath": posixpath.basename(target)} if alone else {}
        return Mounted(
            volumes=({"name": name, "configMap": {"name": name, "items": items}},),
            mounts=({"name": name, "mountPath": target, **only, "readOnly": True},),
            maps=(made,),
        )

    def _secret(self, source: str, target: str, mode: int) -> Mounted:
        name = _name("secret", target)
        last = posixpath.basename(target)
        what = (
            f"`kubectl create secret generic {secret_name(source)} -n {namespace_of(self.experiment)} "
            "--from-file=value=FILE`, after the namespace."
        )
        items = [{"key": "value", "path": last, "mode": mode}]
        return Mounted(
            volumes=({"name": name, "secret": {"secretName": secret_name(source), "items": items}},),
            mounts=({"name": name, "mountPath": target, "subPath": last, "readOnly": True},),
            needs=(Need(kind="secret", name=secret_name(source), what=what),),
        )


def secret_name(source: str) -> str:
    """Return the name of a Secret: names of the EDF may have letters that Kubernetes does not take."""
    plain = re.sub(r"[^a-z0-9-]", "-", source.lower()).strip("-")
    same = plain == source
    return f"secret-{plain}" if same else f"secret-{plain}-{hashed(source)}"


def _folder(path: str, kind: str, mount: Mount) -> Mounted:
    name = _name("node", path)
    source = {"path": path, **({"type": kind} if kind else {})}
    read_only = {"readOnly": True} if mount.read_only else {}
    return Mounted(
        volumes=({"name": name, "hostPath": source},),
        mounts=({"name": name, "mountPath": mount.target, **read_only},),
    )


def _memory(target: str, size: str) -> Mounted:
    name = _name("memory", target)
    limit = {"sizeLimit": size} if size else {}
    return Mounted(
        volumes=({"name": name, "emptyDir": {"medium": "Memory", **limit}},),
        mounts=({"name": name, "mountPath": target},),
    )


def _name(kind: str, of: str) -> str:
    """Return the name of a pod's volume: a DNS label."""
    return f"{kind}-{hashed(of)}"


def hashed(text: str) -> str:
    """Return 128 bits: with fewer, who writes an EDF finds two paths of one name, and one is mounted for the other."""
    return hashlib.sha256(text.encode()).hexdigest()[:32]
