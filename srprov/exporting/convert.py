"""An experiment -> Compose files, one per machine, with all that they need and the report.

Takes the experiment with its services placed, and functions that read the controller's files; gives an `Export`, or
every reason why there is none. Writes nothing.
"""

from __future__ import annotations

import shlex
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from itertools import chain

from msgspec.structs import replace

from srprov.codes import Code
from srprov.definitions.model import EXPORTED, Experiment, Service
from srprov.errors import DefinitionError, UsageError
from srprov.exporting.images import Built, built
from srprov.exporting.model import Export, File, Lent, Machine, Need, Part
from srprov.exporting.mounts import Shipping
from srprov.exporting.reach import Reach, reaches
from srprov.exporting.readme import readme
from srprov.exporting.report import fields_of, refused
from srprov.exporting.services import Surroundings
from srprov.exporting.text import dump
from srprov.exporting.wanted import Wanted
from srprov.network.discovery import discovery_of
from srprov.own_records import KEPT_OUT

COMPOSE, README = "compose.yml", "README.md"


def export(wanted: Wanted) -> Export:
    """Return the Compose files of an experiment, with all that they need.

    Raises:
        DefinitionError: A field that would mean something else in Compose, or an image that cannot be; at its line.
        UsageError: A file cannot be copied, or a robot's address is not known.
    """
    experiment, containers = wanted.definitions.experiment, wanted.definitions.containers
    machines = tuple(_machines(experiment, wanted.placed))
    reach = reaches(experiment, machines, wanted.robots)
    remarks = list(chain.from_iterable(one.remarks for one in reach.values()))
    fields = fields_of(wanted.texts, wanted.edf, remarks)
    if problems := refused(fields):
        raise DefinitionError(problems)
    images = built(containers, wanted.listing, wanted.read, wanted.checkout, wanted.open)
    parts = [_machine(wanted, one, reach[one.robot], images) for one in machines]
    remarks += chain.from_iterable(part.remarks for part in parts)
    lent = tuple(sorted(set(chain.from_iterable(part.lent for part in parts))))
    done = Export(
        experiment=experiment.name,
        edf=wanted.edf,
        machines=machines,
        files=_unique(chain.from_iterable(part.files for part in parts)),
        fields=fields_of(wanted.texts, wanted.edf, remarks),
        needs=tuple(sorted(set(chain.from_iterable(part.needs for part in parts)))),
        lent=lent,
        notes=(*wanted.notes, *map(_lent, lent), *(note for one in images.values() for note in one.moving)),
    )
    return replace(done, files=(*done.files, File(path=README, content=readme(experiment, done).encode())))


def _lent(one: Lent) -> str:
    return f"{one.service} gets more than its container, and Compose asks nobody: host-path ({one.what})"


def _machines(experiment: Experiment, placed: Mapping[str, str]) -> Iterator[Machine]:
    if not placed:
        yield Machine(robot="", services=tuple(sorted(experiment.services)))
    for robot in sorted(set(placed.values())):
        yield Machine(robot=robot, services=tuple(sorted(name for name, at in placed.items() if at == robot)))


def _machine(wanted: Wanted, machine: Machine, reach: Reach, images: Mapping[str, Built]) -> Part:
    """Return one machine's Compose file with all that belongs to it."""
    experiment, containers = wanted.definitions.experiment, wanted.definitions.containers
    around = Surroundings(
        experiment=experiment, machine=machine, reach=reach, open=wanted.open, env_files=wanted.env_files,
        shipping=Shipping(experiment=experiment, machine=machine, shipped=wanted.shipped),
        images={key: one.image for key, one in containers.items() if one.image}, built=images,
        profiles=wanted.profiles, platforms={key: one.platforms for key, one in containers.items()},
    )  # fmt: skip
    services = [experiment.services[name] for name in machine.services]
    parts = {one.name: around.part(one) for one in services}
    secrets = _secrets(experiment, machine)
    mounts = [mount for one in services for mount in one.runtime.mounts]
    volumes: dict[str, object] = {mount.source: {} for mount in mounts if mount.kind == "volume" and not mount.seed}
    document = {
        "name": f"{EXPORTED}{experiment.name}",
        "services": {name: part.document for name, part in parts.items()},
        "x-srprov": _for_imports(experiment, reach, services),
        "networks": {"default": dict(reach.network)} if reach.network else {},
        "volumes": dict(sorted(volumes.items())),
        "secrets": secrets.document,
    }
    whose = f"{experiment.name}, {f'the services of {machine.robot}' if machine.robot else 'all services'}"
    text = dump({key: value for key, value in document.items() if value}, f"{whose}; made by srprov export compose.")
    return Part(
        files=(
            File(path=f"{machine.folder}{COMPOSE}", content=text.encode()),
            *_builds(images, {one.cdf for one in services}, machine), *secrets.files,
            *chain.from_iterable(part.files for part in parts.values()),
        ),
        remarks=tuple(chain.from_iterable(part.remarks for part in parts.values())),
        needs=(*secrets.needs, *chain.from_iterable(part.needs for part in parts.values())),
        lent=tuple(chain.from_iterable(part.lent for part in parts.values())),
    )  # fmt: skip


def _for_imports(experiment: Experiment, reach: Reach, services: Sequence[Service]) -> dict[str, object]:
    """Return how services find each other, for `import compose`: addresses that they are told are Compose's."""
    settings = experiment.network
    bridged = [one for one in services if reach.modes[one.name] == "bridge"]
    if settings.discovery == "multicast" or not bridged:
        return {}
    told = {one.name: discovery_of(experiment, reach.overlay, one) for one in bridged}
    servers = set(settings.discovery_servers)
    names = sorted(one.name for one in services if {one.name, one.instance_of} & servers)
    return {
        "discovery": settings.discovery,
        **({"discovery_servers": names} if names else {}),
        "told": {name: sorted({*found.made_with, *found.environment}) for name, found in told.items()},
    }


def _builds(images: Mapping[str, Built], needed: Collection[str], machine: Machine) -> Iterator[File]:
    for key, image in images.items():
        for file in image.files if key in needed else ():
            yield replace(file, path=f"{machine.folder}build/{image.name}/{file.path}")


def _secrets(experiment: Experiment, machine: Machine) -> Part:
    """Return the secrets that a machine's services use: where Compose finds them, never what they are."""
    used = {use.source for name in machine.services for use in experiment.services[name].secrets}
    document: dict[str, dict[str, str]] = {}
    needs: list[Need] = []
    for name in sorted(used):
        source = experiment.secrets[name]
        if source.env:
            document[name] = {"environment": source.env}
            what = f"The value of the secret '{name}', where Compose is started."
            needs.append(Need(kind="variable", name=source.env, what=what))
            continue
        place = f"{machine.folder}secrets/{name}"
        document[name] = {"file": f"./secrets/{name}"}
        said = f"what `{shlex.join(source.command)}` prints" if source.command else "its file"
        what = f"The value of the secret '{name}': in the EDF it is {said}. Only its reader should be able to read it."
        needs.append(Need(kind="file", name=place, what=what))
    keep_out = File(path=f"{machine.folder}secrets/.gitignore", content=KEPT_OUT.encode())
    files = (keep_out,) if any(one.kind == "file" for one in needs) else ()
    return Part(document=document, files=files, needs=tuple(needs))


def _unique(files: Iterable[File]) -> tuple[File, ...]:
    """Return each file once, in the order of their paths; what is shipped to two services is one file.

    Raises:
        UsageError: Two that differ have one path; the one that were left would be mounted in the other's place.
    """
    found: dict[str, File] = {}
    for one in files:
        if found.setdefault(one.path, one) != one:
            raise UsageError(f"{one.path} cannot be copied: it changed while it was read", code=Code.NO_FILE)
    return tuple(found[path] for path in sorted(found))
