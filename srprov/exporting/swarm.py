"""An experiment, placed on robots, as a stack for Docker Swarm. Pure.

Takes the experiment with its services placed, and functions that read the controller's files; gives an `Export`:
numbered stack files, one for each level of starting, the scripts that build images and deploy, and what is built.
Each service is pinned to its robot: the assignment stays srprov's.

Source: Docker, "Compose file version 3 reference" and "docker stack deploy".
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import chain
from typing import Any

from msgspec.structs import replace

from srprov.codes import Code
from srprov.definitions.model import Experiment
from srprov.errors import DefinitionError, UsageError
from srprov.exporting import cluster
from srprov.exporting.images import built
from srprov.exporting.model import ADAPTED, EXACT, REFUSED, Export, File, Need, Part, Remark
from srprov.exporting.readme import plain, readme
from srprov.exporting.report import fields_of, lossy, refused
from srprov.exporting.swarm_classes import CDF, EDF
from srprov.exporting.swarm_script import BUILD, DEPLOY, build_script, deploy_script
from srprov.exporting.swarm_service import Stack, own_name
from srprov.exporting.text import dump
from srprov.exporting.wanted import Wanted
from srprov.network.layout import ON_OVERLAY

_README = "README.md"
_LONGEST = 64
"""Letters of a secret's name: swarmkit refuses more."""
_VERSION = "3.9"
"""Of the Compose file format: without it, `docker stack deploy` of older engines takes a file for version 1."""
_CANNOT = {
    "both": "a service of Swarm is on the overlay or on its robot's network, not on both",
    "none": "a service of Swarm has a network",
}


def export(wanted: Wanted) -> Export:
    """Return the stack of an experiment, with all that it needs.

    Raises:
        DefinitionError: A field that Swarm would ignore or take for something else, unless `wanted.lossy`; an image
            that cannot be; at its line.
        UsageError: A robot's address is needed and not known.
    """
    experiment, overlay = cluster.by_name(wanted.definitions.experiment)
    services = [experiment.services[name] for name in sorted(wanted.placed)]
    images = built(wanted.definitions.containers, wanted.listing, wanted.read, wanted.checkout, wanted.open)
    tags = cluster.image_names(experiment, images)
    stack = Stack(
        wanted=wanted, experiment=experiment, overlay=overlay,
        images={
            **{key: one.image for key, one in wanted.definitions.containers.items() if one.image},
            **tags,
        },
        addresses=_addresses(wanted, experiment),
    )  # fmt: skip
    parts = {one.name: stack.part(one) for one in services}
    remarks = [*_remarks(wanted), *chain.from_iterable(part.remarks for part in parts.values())]
    fields = fields_of(wanted.texts, wanted.edf, remarks, (EDF, CDF))
    if (problems := refused(fields)) and not wanted.lossy:
        raise DefinitionError(problems)
    levels = cluster.levels({one.name: one for one in services})
    files = [_level(experiment, number, {name: parts[name] for name in names}) for number, names in enumerate(levels)]
    used = {tags[one.cdf]: images[one.cdf].name for one in services if one.cdf in tags}
    scripts = [File(path=DEPLOY, content=deploy_script(experiment, levels).encode(), mode=0o755)]
    if used:
        scripts.append(File(path=BUILD, content=build_script(used).encode(), mode=0o755))
    done = Export(
        experiment=experiment.name,
        edf=wanted.edf,
        machines=cluster.machines(wanted.placed, DEPLOY),
        files=tuple(sorted(_once([*files, *scripts, *cluster.builds(images), *chain.from_iterable(
            part.files for part in parts.values())]), key=lambda one: one.path)),
        fields=lossy(fields),
        needs=tuple(sorted({*_variables(wanted), *chain.from_iterable(part.needs for part in parts.values())})),
        notes=(*wanted.notes, *(note for one in images.values() for note in one.moving)),
        made_by="A stack for Docker Swarm, made by `srprov export swarm`",
    )  # fmt: skip
    text = readme(experiment, done, _start(done, wanted, used))
    return replace(done, files=(*done.files, File(path=_README, content=text.encode())))


def _addresses(wanted: Wanted, experiment: Experiment) -> dict[str, str]:
    """Return service on its robot's own network -> that robot's address, where services of the overlay are told of it.

    Raises:
        UsageError: An address is not known.
    """
    services = {name: experiment.services[name] for name in wanted.placed}
    if not any(one.network in ON_OVERLAY for one in services.values()):
        return {}
    shared = {name: wanted.placed[name] for name, one in services.items() if one.network == "host"}
    if missing := sorted(robot for robot in shared.values() if not wanted.robots.get(robot)):
        hint = "services on a robot's own network are told by its address: give -i INVENTORY"
        raise UsageError(f"the address of {missing[0]} is not known", hint=hint, code=Code.UNDERLAY)
    return {name: wanted.robots[robot] for name, robot in shared.items()}


def _remarks(wanted: Wanted) -> Iterator[Remark]:
    experiment = wanted.definitions.experiment
    for name in wanted.placed:
        one = experiment.services[name]
        if one.network in _CANNOT:
            yield cluster.remark(one, "network", REFUSED, _CANNOT[one.network])
        elif one.network == "host":
            words = "its robot's own network; it does not know the names of services on the overlay"
            yield cluster.remark(one, "network", ADAPTED, words)
        if long := next((use.source for use in one.secrets if len(own_name(experiment, use.source)) > _LONGEST), ""):
            words = (
                f"{own_name(experiment, long)} has more letters than the {_LONGEST} that a secret of Swarm's may have"
            )
            yield cluster.remark(one, "secrets", REFUSED, words)
        yield from cluster.empty_words(one)
    yield from cluster.discovery_remarks(experiment)
    if experiment.network.subnet:
        yield Remark(path=("network", "subnet"), kind=EXACT, words="")


def _level(experiment: Experiment, number: int, parts: Mapping[str, Part]) -> File:
    """Return the stack file of the services that start together."""
    configs: dict[str, Any] = {}
    for part in parts.values():
        configs |= {one.path.rpartition("/")[2]: {"file": f"./{one.path}"} for one in part.files if not one.is_folder}
    secrets = sorted({use["source"] for part in parts.values() for use in _used(part)})
    volumes = sorted({
        mount["source"] for part in parts.values() for mount in _mounts(part) if mount["type"] == "volume"
    })  # fmt: skip
    networks = {name for part in parts.values() for name in part.document.get("networks", ())}  # type: ignore[attr-defined]
    document = {
        "version": _VERSION,
        "services": {name: part.document for name, part in parts.items()},
        "networks": {name: _network(experiment, name) for name in sorted(networks)},
        "volumes": {name: {"name": own_name(experiment, name)} for name in volumes},
        "configs": dict(sorted(configs.items())),
        "secrets": {name: {"external": True, "name": own_name(experiment, name)} for name in secrets},
    }
    comment = f"{experiment.name}, level {number + 1} of its start; made by srprov export swarm."
    text = dump({key: value for key, value in document.items() if value}, comment)
    return File(path=stack_file(number), content=text.encode())


def stack_file(number: int) -> str:
    """Return the name of a level's file; levels count from 0."""
    return f"{number + 1:02}-stack.yml"


def _used(part: Part) -> Sequence[Mapping[str, Any]]:
    found: Any = part.document.get("secrets", ())
    return found  # type: ignore[no-any-return]


def _mounts(part: Part) -> Sequence[Mapping[str, Any]]:
    found: Any = part.document.get("volumes", ())
    return found  # type: ignore[no-any-return]


def _network(experiment: Experiment, name: str) -> dict[str, Any]:
    if name != "default":
        return {"external": True, "name": name}
    settings = experiment.network
    options = {"encrypted": "true"} if settings.encryption != "none" else {}
    options |= {"com.docker.network.driver.mtu": str(settings.mtu)} if settings.mtu else {}
    return {
        "driver": "overlay",
        **({"driver_opts": options} if options else {}),
        **({"ipam": {"config": [{"subnet": settings.subnet}]}} if settings.subnet else {}),
    }


def _variables(wanted: Wanted) -> Iterator[Need]:
    services = [wanted.definitions.experiment.services[name] for name in wanted.placed]
    for name in cluster.open_names(wanted, services):
        yield Need(kind="variable", name=name, what="Its value, where deploy.sh is started: the EDF only names it.")


def _once(files: Sequence[File]) -> list[File]:
    return list({one.path: one for one in files}.values())


def _start(done: Export, wanted: Wanted, used: Collection[str]) -> Iterator[str]:
    yield from ("## Start", "")
    yield "The nodes of the swarm have the robots' names (`docker node ls`):"
    yield ""
    for machine in done.machines:
        yield f"- {plain(machine.robot)}: {', '.join(machine.services)}"
    yield ""
    if used:
        yield "On each of these robots, in a copy of this folder, build the images that it runs, or all of them:"
        yield from ("", f"    ./{BUILD}", "")
    yield "Then on a manager:"
    yield from ("", f"    ./{DEPLOY}", "", f"and to end it `docker stack rm {done.experiment}`.", "")
    if any(wanted.definitions.experiment.services[name].depends_on for name in wanted.placed):
        yield "Services start level by level: deploy.sh waits until what others need is there, for five minutes each."
        yield ""
