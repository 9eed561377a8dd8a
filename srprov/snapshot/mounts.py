"""What a container mounts, as the volumes of a service.

Takes what an engine says of a container and of its image; gives `volumes` and `tmpfs`. Pure. What volumes hold is not
captured, and noted.

Source: Docker Engine API 1.41, "Inspect a container".
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Mapping
from typing import Any

from srprov.snapshot.notes import Notes
from srprov.snapshot.settings import few
from srprov.untrusted import integer, mapping, mappings, string, string_map, text

_ANONYMOUS = re.compile(r"[0-9a-f]{64}")
_OF_PEOPLE = ("/home/", "/root/", "/opt/", "/srv/", "/mnt/", "/media/")
"""Where files of people lie, not of the system."""
_VOLUME = re.compile(r"[a-zA-Z0-9][a-zA-Z0-9_.-]{0,60}")


def mount_fields(box: Mapping[str, Any], own: Mapping[str, Any], service: str, notes: Notes) -> dict[str, Any]:
    """Return the fields of a container's mounts; `own` is its image's configuration."""
    subject = f"container {service}"
    host = mapping(box.get("HostConfig"))
    volumes: list[dict[str, Any]] = []
    of_image = mapping(own.get("Volumes"))
    for one in sorted(mappings(box.get("Mounts")), key=lambda one: string(one.get("Destination"))):
        kind, target = string(one.get("Type")), string(one.get("Destination"))
        if kind == "bind":
            volumes += _bind(one, target, subject, notes)
        elif kind == "volume":
            name = string(one.get("Name"))
            if _ANONYMOUS.fullmatch(name) and target in of_image:
                notes.lost(subject, f"what the image's own volume {text(target)} holds is not captured")
                continue
            volumes.append(_volume(one, name, target, service, notes))
        elif kind != "tmpfs":
            notes.lost(subject, f"a mount of the kind {text(kind, length=40)} at {text(target, length=100)}")
    found: dict[str, Any] = {"volumes": few(volumes, "volumes", subject, notes)} if volumes else {}
    if tmpfs := few(_tmpfs(host), "tmpfs", subject, notes):
        found["tmpfs"] = tmpfs
    return found


def volumes_there(box: Mapping[str, Any]) -> dict[str, str]:
    """Return path in a container -> what its robot calls the volume there, which may be no name of an experiment's."""
    return {string(one.get("Destination")): string(one.get("Name")) for one in mappings(box.get("Mounts"))}


def _bind(one: Mapping[str, Any], target: str, subject: str, notes: Notes) -> list[dict[str, Any]]:
    source = string(one.get("Source"))
    if not source.startswith("/"):  # in an EDF a file of the experiment: the snapshot, with what it has of other robots
        notes.lost(subject, f"{text(source, length=150)}, which it mounts, is no path of a robot")
        return []
    if string(one.get("Propagation")) not in ("", "rprivate", "private"):
        notes.lost(subject, f"how mounts below {text(target, length=100)} propagate: an EDF has no such field")
    if source.startswith(_OF_PEOPLE):
        notes.adapted(subject, f"{text(source, length=150)} is a path of the robot: what it holds is not captured")
    entry = {"type": "bind", "source": source, "target": target}
    return [entry if one.get("RW") is not False else {**entry, "read_only": True}]


def _volume(one: Mapping[str, Any], name: str, target: str, service: str, notes: Notes) -> dict[str, Any]:
    subject = f"container {service}"
    if _ANONYMOUS.fullmatch(name) or not _VOLUME.fullmatch(name):
        base = re.sub(r"[^a-z0-9]+", "-", posixpath.basename(target.rstrip("/")).lower()).strip("-")
        name = f"{service[:30]}-{base[:20] or 'data'}"
    notes.lost(subject, f"what the volume {name} holds is not captured: the new one begins empty, or with the image's")
    if string(one.get("Driver")) not in ("", "local"):
        notes.lost(subject, f"the volume {name} has the driver {text(string(one.get('Driver')), length=40)}")
    entry = {"type": "volume", "source": name, "target": target}
    return entry if one.get("RW") is not False else {**entry, "read_only": True}


def _tmpfs(host: Mapping[str, Any]) -> list[str]:
    found = [
        f"{path}:{options}" if options else path for path, options in sorted(string_map(host.get("Tmpfs")).items())
    ]
    for one in mappings(host.get("Mounts")):
        if string(one.get("Type")) == "tmpfs":
            about = mapping(one.get("TmpfsOptions"))
            size, mode = integer(about.get("SizeBytes"), high=1 << 50), integer(about.get("Mode"), high=0o7777)
            options = ",".join([f"size={size}"] * bool(size) + [f"mode={mode:o}"] * bool(mode))
            found.append(string(one.get("Target")) + (f":{options}" if options else ""))
    return found
