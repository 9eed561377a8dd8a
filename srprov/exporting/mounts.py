"""What containers mount, as Compose's `volumes`, and the files that are shipped for it. Pure: the caller's `tar` reads.

A relative path of the EDF is copied into the export and mounted read-only, as srprov ships it. A volume with a seed
becomes a folder of the export that holds the seed and is writable; Compose can fill no volume from a folder.

`files/` is laid out as the experiment's folder is, so that one place is nested in another only where its source is: a
link that was copied for one mount is never on the way of another one, which an engine would follow on its machine.
"""

from __future__ import annotations

import errno
import os
import posixpath
from collections.abc import Callable, Sequence
from shlex import quote
from typing import Any

import msgspec
from msgspec.structs import replace

from srprov.codes import Code
from srprov.definitions.containermodel import Mount, Seed
from srprov.definitions.model import VERSION_CONTROL, Experiment, Service
from srprov.errors import UsageError
from srprov.exporting.model import ADAPTED, File, Lent, Machine, Need, Part, Remark
from srprov.exporting.text import Raw
from srprov.plain_tar import Member

Shipped = Callable[[str], Sequence[Member]]
"""Absolute path -> what is there, below one top entry, as srprov would ship it; raises OSError."""


class Shipping(msgspec.Struct, frozen=True, kw_only=True):
    """What turns mounts into files of the export."""

    experiment: Experiment
    machine: Machine
    shipped: Shipped
    copied: dict[str, str] = msgspec.field(default_factory=dict)
    """Place in the export -> the path that was copied there."""

    def mounts(self, service: Service) -> Part:
        """Return `volumes` and `tmpfs` of a service, and the files behind them."""
        parts = [self._one(service, mount) for mount in service.runtime.mounts]
        volumes = [part.document["volume"] for part in parts if "volume" in part.document]
        tmpfs = [part.document["tmpfs"] for part in parts if "tmpfs" in part.document]
        return Part(
            document={"volumes": volumes, "tmpfs": tmpfs},
            files=tuple(file for part in parts for file in part.files),
            remarks=tuple(remark for part in parts for remark in part.remarks),
            needs=tuple(need for part in parts for need in part.needs),
            lent=tuple(one for part in parts for one in part.lent),
        )

    def _one(self, service: Service, mount: Mount) -> Part:
        if mount.kind == "tmpfs":
            return Part(document={"tmpfs": f"{mount.target}:{mount.options}".rstrip(":")})
        if mount.kind == "volume" and mount.seed is None:
            return volume(service, mount, _long("volume", mount.source, mount))
        if mount.seed is not None:
            return self._seeded(service, mount, mount.seed)
        if mount.kind == "bind":
            return self._bind(service, mount)
        return self._shipped(service, mount)

    def _of_export(self, service: Service, place: str, mount: Mount) -> Part:
        """Return the mount of a place in the export, which whoever runs the file lends where it can be written to.

        All mounts of what is in the export are made here: none can be written to that is not told.
        """
        lent = Lent(place=place, service=service.instance_of or service.name)
        return Part(
            document={"volume": _long("bind", f"./{place.removeprefix(self.machine.folder)}", mount)},
            lent=() if mount.read_only else (lent,),
        )

    def _seeded(self, service: Service, mount: Mount, seed: Seed) -> Part:
        place = self._place(f"volumes/{mount.source}", seed.path)
        name = mount.source
        words = [f"a writable folder, {place}, which holds the seed; Compose fills no volume from a folder"]
        words += [f"its files need the owner {seed.user}: see the README"] if seed.user else []
        owner = f"`chown -R {seed.user} {place}`, as root: the EDF gives the volume to that user"
        own = (Need(kind="file", name=place, what=owner),) if seed.user else ()
        return replace(
            self._of_export(service, place, mount),
            files=self._copied(place, seed.path) or (),
            remarks=(Remark(path=("volumes", name, "seed"), kind=ADAPTED, words="; ".join(words)),),
            needs=own,
        )

    def _bind(self, service: Service, mount: Mount) -> Part:
        if not mount.home_of:
            return Part(document={"volume": _long("bind", mount.source, mount)})
        home = "/root" if mount.home_of == "root" else f"/home/{mount.home_of}"
        variable = f"HOME_OF_{mount.home_of.upper().replace('-', '_').replace('.', '_')}"
        below = mount.source.removeprefix(f"~{mount.home_of}").replace("$", "$$")
        words = f"the home of '{mount.home_of}' is ${{{variable}}}, by default {home}"
        what = f"The home of the user '{mount.home_of}', where that is not {home}."
        return Part(
            document={"volume": _long("bind", Raw(f"${{{variable}:-{home}}}{below}"), mount)},
            remarks=(Remark(path=_field(service, "volumes"), kind=ADAPTED, words=words),),
            needs=(Need(kind="variable", name=variable, what=what),),
        )

    def _downloaded(self, service: Service, mount: Mount) -> Part:
        name = mount.target.rpartition("/")[2]
        place = self._place(f"data/{mount.sha256[:12]}-{name}", mount.url)
        what = f"Download it; its sha256 is {mount.sha256}."
        # an address may hold what ends a command for a shell, such as `&`
        command = f"curl --create-dirs --fail --globoff --location --output {quote(place)} {quote(mount.url)}"
        words = f"{place} is not in the export: the README says where to download it"
        return replace(
            self._of_export(service, place, mount),
            remarks=(Remark(path=_field(service, "data"), kind=ADAPTED, words=words),),
            needs=(Need(kind="file", name=place, what=what, command=command),),
        )

    def _shipped(self, service: Service, mount: Mount) -> Part:
        if mount.url:
            return self._downloaded(service, mount)
        place = self._place(self._wanted(mount.source), mount.source)
        mounted = self._of_export(service, place, replace(mount, read_only=True))
        if (files := self._copied(place, mount.source, may_be_large=mount.kind == "data")) is not None:
            return replace(mounted, files=files)
        words = f"{place} is too large to be copied into the export: the README says what to put there"
        hashed = f" Its sha256 is {mount.sha256}." if mount.sha256 else ""
        what = f"Copy {os.path.relpath(mount.source, self.experiment.folder)} of the experiment's folder there.{hashed}"
        return replace(
            mounted,
            remarks=(Remark(path=_field(service, "data"), kind=ADAPTED, words=words),),
            needs=(Need(kind="file", name=place, what=what),),
        )

    def _wanted(self, path: str) -> str:
        """Return the place of a path as it lies in the experiment's folder; of one elsewhere, a name beside it."""
        relative = os.path.relpath(path, os.path.realpath(self.experiment.folder))
        parts = relative.split("/")
        # what a folder is shipped without is mounted by who named it alone, and not by who mounts the folder
        if parts[0] == ".." or not VERSION_CONTROL.isdisjoint(parts):
            return f"outside/{os.path.basename(path) or 'root'}"
        return posixpath.normpath(f"files/{relative}")

    def _place(self, wanted: str, source: str) -> str:
        """Return the place of something in the export: the wanted one, or where that is taken, one like it."""
        place, number = f"{self.machine.folder}{wanted}", 1
        while self.copied.setdefault(place, source) != source:
            number += 1
            place = f"{self.machine.folder}{wanted}-{number}"
        return place

    def _copied(self, place: str, source: str, *, may_be_large: bool = False) -> tuple[File, ...] | None:
        """Return the files of a path at their place in the export; None for a file that is too large to be copied.

        Raises:
            UsageError: It cannot be read, or is too large and may not be.
        """
        try:
            members = self.shipped(source)
        except OSError as error:
            if may_be_large and error.errno == errno.EFBIG:
                return None
            raise UsageError(
                f"{error.filename or source} cannot be copied: {error.strerror}", code=Code.NO_FILE
            ) from error
        return tuple(
            File(
                path=posixpath.join(place, *member.path.split("/")[1:]),
                content=member.content or b"",
                mode=member.mode,
                link=member.link,
                is_folder=member.is_folder,
            )
            for member in members
        )


def volume(service: Service, mount: Mount, entry: dict[str, Any]) -> Part:
    """Return a mount of a named volume, which no image fills.

    An engine would: the image's files are for those who may write there, and a container that runs with an empty volume
    leads the engine elsewhere by links while it is filled for another one. Compose and Swarm make the next container of
    a service while the one before it runs.
    """
    words = f"'{mount.source}': it begins empty: an image fills it for `apply` alone"
    said = (Remark(path=_field(service, "volumes"), kind=ADAPTED, words=words),)
    return Part(document={"volume": {**entry, "volume": {"nocopy": True}}}, remarks=() if mount.read_only else said)


def _field(service: Service, name: str) -> tuple[str, ...]:
    return ("services", service.instance_of or service.name, name)


def _long(kind: str, source: str, mount: Mount) -> dict[str, Any]:
    """Return the long form; without `create_host_path`, nothing is made where srprov would make nothing."""
    found: dict[str, Any] = {"type": kind, "source": source, "target": mount.target}
    if mount.read_only:
        found["read_only"] = True
    if kind == "bind":
        found["bind"] = {"create_host_path": mount.create_host_path}
    return found
