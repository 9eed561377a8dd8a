"""A container's parameters, back to what an EDF says of its service.

A plan file may state any container. What it asks for beyond itself is said by the function that says it for an EDF, so
its mounts are read back from the engine's form; whether they are such as srprov writes is said by `is_own`. Pure.
"""

from __future__ import annotations

import json
import posixpath
import re
from collections.abc import Iterator, Mapping
from typing import Any

from msgspec.structs import replace

from srprov.definitions.containermodel import TMPFS_OPTIONS, Mount
from srprov.definitions.model import Service
from srprov.definitions.secretmodel import SecretUse
from srprov.modules.container_params import ContainerParams
from srprov.modules.module import DISCOVERY_FILE, MEMORY_ROOT, STATE_ROOT, Names, canonical
from srprov.wire import DATA_STORE

WORD = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")
"""A name that is one part of a path, and neither `.` nor `..`."""
_SECRET = re.compile(rf"({WORD.pattern})(?:@([0-7]{{4}}))?")
_DATA = re.compile(rf"{re.escape(DATA_STORE)}/([0-9a-f]{{64}})/data")
_HOSTS = re.compile(rf"hosts(-{WORD.pattern})?|{DISCOVERY_FILE}")
_OWN_FILE = re.compile(rf"^{re.escape(STATE_ROOT)}/[^/]+/(?:{_HOSTS.pattern})\Z")
_PLAIN = re.compile(r"[^\s,;\"]+")
_TREE = re.compile(r"trees/[0-9a-f]{24}/(?!\.{1,2}\Z)[^/\0]+", re.DOTALL)


def service_of(want: ContainerParams) -> Service:
    """Return the service as an EDF would state it; mounts that no EDF leads to are left out."""
    read = [_mount(want.instance, mount) for mount in want.mounts]
    mounts = tuple(one for one in read if isinstance(one, Mount))
    uses = tuple(one for one in read if isinstance(one, SecretUse))
    runtime = replace(want.run, mounts=mounts)
    return Service(name=want.service, image=want.image, runtime=runtime, network=want.network.mode, secrets=uses)


def is_own(want: ContainerParams, names: Names) -> bool:
    """Return whether the service, its owner, its network and the form of every mount are such as srprov writes."""
    return (
        WORD.fullmatch(want.service) is not None
        and (want.instance, want.source) == (names.instance, names.source)
        and want.network.name in (None, names.network)
        and all(_mount(want.instance, mount) is not None for mount in want.mounts)
    )


def told(want: ContainerParams) -> str:
    """Return what a plan says whole of a container that is made: what it runs, publishes and mounts.

    And by which name others find it beside its service's: an engine answers to it whoever asks on the same robot.
    """
    hostname = "" if want.hostname in ("", want.service) else f"; hostname {_word(want.hostname)}"
    return f"image {want.image}{hostname}{want.publishes()}{shown_mounts(want)}"


def shown_mounts(want: ContainerParams) -> str:
    """Return what it mounts of volumes, files and secrets, such as `; mounts volume log at /log`, or nothing.

    What srprov itself puts into every container is left out, and memory, which holds nothing of anybody. What no EDF
    leads to, as of a plan file, is shown as an engine is told it.
    """
    service = service_of(want)
    shown = [_shown(mount) for mount in service.runtime.mounts if _is_told(mount)]
    shown += [f"secret {use.source} at {_word(use.target)}" for use in service.secrets]
    shown += [canonical(dict(mount)) for mount in want.mounts if _mount(want.instance, mount) is None]
    return f"; mounts {', '.join(shown)}" if shown else ""


def stands_on(want: ContainerParams) -> Iterator[tuple[str, str]]:
    """Yield kind and name of the resources that put there what a container mounts of srprov's own.

    An EDF that leads to such a mount leads to the resource too, and that is where it is asked whose the content is. A
    volume that nothing states is made by the engine: it says of nobody whose it is, and stands in no plan.
    """
    kept = f"{STATE_ROOT}/{want.instance}"
    for mount in want.mounts:
        source = str(mount.get("Source"))
        below = source.removeprefix(f"{kept}/")
        if mount.get("Type") == "volume":
            if "Source" in mount:  # one for results has none, and goes with its container
                yield "volume", source
        elif data := _DATA.fullmatch(source):
            yield "data", f"{kept}/data/{data[1]}"
        elif below != source and _TREE.fullmatch(below):
            yield "tree", source.rpartition("/")[0]
        elif below != source and _HOSTS.fullmatch(below):
            yield "file", source
        elif source.startswith(f"{MEMORY_ROOT}/{want.instance}/secrets/"):
            yield "secret", source


def _is_told(mount: Mount) -> bool:
    return mount.kind != "tmpfs" and not (mount.kind == "tree" and _OWN_FILE.search(mount.source))


def _shown(mount: Mount) -> str:
    name = posixpath.basename(mount.source) if mount.kind == "tree" else mount.source
    words = {
        "volume": f"volume {name}",
        "tree": _word(name),
        "data": "data",
        "bind": f"the robot's {_word(name)}",
    }[mount.kind]
    # of shipped files and data everything is, and says nothing
    only_read = " (read-only)" * (mount.read_only and mount.kind in ("volume", "bind"))
    return f"{words} at {_word(mount.target)}{only_read}"


def _word(path: str) -> str:
    """Return a path as one word of a line; what could be misread is in quotes, as JSON has it."""
    return path if _PLAIN.fullmatch(path) else json.dumps(path, ensure_ascii=False)


def _mount(instance: str, mount: Mapping[str, Any]) -> Mount | SecretUse | None:
    """Return a mount as an EDF states it; None for one that `controller.services` does not write."""
    kind, target = mount.get("Type"), str(mount.get("Target"))
    if kind == "tmpfs":
        return _tmpfs(mount, target)
    if mount == {"Type": "volume", "Target": target}:  # for results: as fresh as memory, and nobody else's
        return Mount(kind="tmpfs", source="", target=target)
    source, read_only = str(mount.get("Source")), mount.get("ReadOnly") is True
    make = kind == "bind" and mount.get("BindOptions") == {"CreateMountpoint": True}
    options = {"BindOptions": {"CreateMountpoint": True}} if make else {}
    # nothing else may stand in it: a volume's driver options could name any folder of the robot
    if mount != {"Type": kind, "Source": source, "Target": target, "ReadOnly": read_only, **options}:
        return None
    if kind == "volume":
        name = source.removeprefix(f"srprov.{instance}.")
        is_ours = name != source and WORD.fullmatch(name)
        return Mount(kind="volume", source=name, target=target, read_only=read_only) if is_ours else None
    if kind != "bind":
        return None
    if source != posixpath.normpath(f"/{source.lstrip('/')}"):
        # an engine takes `..` out of the text, a shell goes by what is there: what was looked at were another path
        return None
    own = None if make else _shipped(instance, source, target, read_only)
    return own or Mount(kind="bind", source=source, target=target, read_only=read_only, create_host_path=make)


def _tmpfs(mount: Mapping[str, Any], target: str) -> Mount | None:
    options = mount.get("Options", "")
    if not isinstance(options, str) or not TMPFS_OPTIONS.fullmatch(options):
        return None
    written = {"Type": "tmpfs", "Target": target, **({"Options": options} if options else {})}
    return Mount(kind="tmpfs", source="", target=target, options=options) if mount == written else None


def _shipped(instance: str, source: str, target: str, read_only: bool) -> Mount | SecretUse | None:
    """Return what a bind of something that srprov itself put there is to an EDF; None for any other path."""
    kept, memory = f"{STATE_ROOT}/{instance}/", f"{MEMORY_ROOT}/{instance}/secrets/"
    if not read_only:
        return None
    if source.startswith(kept) and (_HOSTS.fullmatch(source[len(kept) :]) or _TREE.fullmatch(source[len(kept) :])):
        return Mount(kind="tree", source=source, target=target)
    if _DATA.fullmatch(source):
        return Mount(kind="data", source=source, target=target, read_only=True)
    secret = _SECRET.fullmatch(source[len(memory) :]) if source.startswith(memory) else None
    return SecretUse(source=secret[1], target=target, mode=secret[2] or "0400") if secret else None
