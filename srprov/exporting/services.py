"""One service of an experiment as one of Compose. Pure.

Takes a service with what is around it (its machine's network, what is shipped, the folders that images are built from);
gives the keys of a Compose service, the files that it needs and what is to be said of its fields.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import msgspec

from srprov.definitions.model import Experiment, Service
from srprov.exporting.images import Built, image_name
from srprov.exporting.model import ADAPTED, DROPPED, File, Machine, Part, Remark
from srprov.exporting.mounts import Shipping
from srprov.exporting.reach import Reach
from srprov.exporting.runtime import port_documents, runtime_document
from srprov.exporting.variables import Open
from srprov.network.discovery import FOLDER, discovery_of

_OWN_KEYS = ("environment", "labels", "sysctls")
"""Maps for which Compose has a list of NAME=value too."""
_CONDITIONS = {
    "started": "service_started",
    "healthy": "service_healthy",
    "completed": "service_completed_successfully",
}


class Surroundings(msgspec.Struct, frozen=True, kw_only=True):
    """What the services of one machine have in common."""

    experiment: Experiment
    machine: Machine
    reach: Reach
    shipping: Shipping
    images: Mapping[str, str]
    """Service of an image CDF -> the image, as CDFs say it."""
    built: Mapping[str, Built]
    open: Open
    env_files: Mapping[str, Mapping[str, str]]
    """Service in the EDF -> what its env_files say."""
    profiles: bool
    """Whether profiles are still to be chosen."""
    platforms: Mapping[str, tuple[str, ...]]
    """CDF's key -> the platforms that it is for."""

    def part(self, service: Service) -> Part:
        """Return a service, its files and what is to be said of it."""
        mounts = self.shipping.mounts(service)
        found = discovery_of(self.experiment, self.reach.overlay, service)
        told, listed = self._environment(service, {**found.made_with, **found.environment})
        peers = tuple(self._discovery_files(service, found.files))
        volumes = [*mounts.document["volumes"], *(_read_only(file, self.machine) for file in peers)]  # type: ignore[misc]
        run = runtime_document(service.runtime)
        if self.reach.modes[service.name] == "host":
            run = _on_robots_network(run)
        else:
            run |= {"ports": port_documents(service.runtime.ports)}
        document: dict[str, Any] = {
            **self._image(service),
            "profiles": list(service.profiles) if self.profiles else [],
            "depends_on": self._depends_on(service),
            **self.reach.service(service, self.experiment),
            **run,
            "environment": told,
            "env_file": [f"./env/{service.name}.env"] if listed else [],
            "volumes": volumes,
            "tmpfs": mounts.document["tmpfs"],
            "secrets": [{"source": use.source, "target": use.target, "mode": use.mode} for use in service.secrets],
        }
        env = (File(path=f"{self.machine.folder}env/{service.name}.env", content=listed.encode(), mode=0o600),)
        return Part(
            document={key: _pairs(key, value) for key, value in document.items() if _says(key, value)},
            files=(*mounts.files, *peers, *(env if listed else ())),
            remarks=(*mounts.remarks, *self._remarks(service), *_variables(service, document)),
            needs=mounts.needs,
            lent=mounts.lent,
        )

    def _image(self, service: Service) -> dict[str, Any]:
        one = self.built.get(service.cdf)
        if one is None:
            return {"image": service.image or self.images[service.cdf]}
        platforms = self.platforms.get(service.cdf, ())
        only = {"platform": platforms[0]} if len(platforms) == 1 else {}
        args = {"args": list(one.variables)} if one.variables else {}
        # Compose's own name, PROJECT-SERVICE, is that of another project and service with the '-' elsewhere, too; and
        # where services share a name that they build, all but one fail on an engine with containerd's store
        image = image_name(self.experiment.name, service.name, one)
        return {"image": image, "build": {"context": f"./build/{one.name}", **args}, **only}

    def _environment(self, service: Service, more: Mapping[str, str]) -> tuple[dict[str, str | None], str]:
        """Return `environment`, and the text of the env_file: what the EDF's files say, as far as it still holds."""
        whole = {**more, **service.runtime.environment}
        listed = self.env_files.get(service.instance_of or service.name, {})
        lines = {name: _line(name, listed[name]) for name in listed if whole.get(name) == listed[name]}
        kept = {name: line for name, line in lines.items() if line and not self.open.stands_for(listed[name])}
        told: dict[str, str | None] = {}
        for name, value in sorted(whole.items()):
            if name not in kept:
                told[name] = None if self.open.stands_for(value) else value
        return told, "".join(f"{line}\n" for line in kept.values())

    def _depends_on(self, service: Service) -> dict[str, Any]:
        return {
            other: {"condition": _CONDITIONS[condition]}
            for other, condition in service.depends_on.items()
            if other in self.machine.services
        }

    def _discovery_files(self, service: Service, files: Mapping[str, str]) -> Iterator[File]:
        for name, text in files.items():
            yield File(path=f"{self.machine.folder}discovery/{service.name}/{name}", content=text.encode())

    def _remarks(self, service: Service) -> Iterator[Remark]:
        at = ("services", service.instance_of or service.name)
        for other in sorted(service.depends_on.keys() - set(self.machine.services)):
            why = f"'{other}' is on another machine, and Compose waits for nothing there"
            yield Remark(path=(*at, "depends_on"), kind=DROPPED, words=why)
        if self.machine.robot and service.robot:
            yield Remark(path=(*at, "robot"), kind=ADAPTED, words=f"it is in the file of {self.machine.robot}")
        if service.profiles and not self.profiles:
            yield Remark(path=(*at, "profiles"), kind=ADAPTED, words="it was wanted when this was exported")


def _variables(service: Service, document: Mapping[str, Any]) -> Iterator[Remark]:
    """Yield what Compose takes of its environment for a service, or for its image: as it is written, whoever says so.

    A variable that a CDF names goes into the image also where the EDF has a value for the container.
    """
    at = ("services", service.instance_of or service.name, "environment")
    taken = {name: "" for name, value in document["environment"].items() if value is None}
    taken |= {name: ", into the image" for name in document.get("build", {}).get("args", ())}
    for name, where in sorted(taken.items()):
        words = f"{name} is taken from the environment of whoever runs Compose{where}"
        yield Remark(path=at, kind=ADAPTED, words=words)


def _line(name: str, value: str) -> str:
    """Return a line of an env_file that every reader takes for this value, or nothing where there is none.

    podman-compose's puts variables of whoever runs it in the place of `${NAME}`, between single quotes, too.
    """
    return f"{name}='{value}'" if value.isprintable() and not set("'\\$") & set(value) else ""


def _read_only(file: File, machine: Machine) -> dict[str, Any]:
    source = f"./{file.path.removeprefix(machine.folder)}"
    target = f"{FOLDER}/{file.path.rpartition('/')[2]}"
    return {"type": "bind", "source": source, "target": target, "read_only": True, "bind": {"create_host_path": False}}


def _on_robots_network(run: dict[str, Any]) -> dict[str, Any]:
    """Leave out what the engine refuses beside the machine's own network; published ports it would ignore."""
    kept = {name: value for name, value in run.get("sysctls", {}).items() if not name.startswith("net.")}
    return {**run, "sysctls": kept}


def _pairs(key: str, value: Any) -> Any:  # noqa: ANN401 - whatever a key has
    """Return a map whose keys are the user's own as a list, where Compose would take one for an extension `x-…`."""
    if key not in _OWN_KEYS or not isinstance(value, dict) or not any(name.startswith("x-") for name in value):
        return value
    return [name if one is None else f"{name}={one}" for name, one in value.items()]


def _says(key: str, value: object) -> bool:
    """Return whether a key is to be written: an empty command takes the image's away, everything else empty is none."""
    return key in ("command", "entrypoint", "init") or bool(value)
