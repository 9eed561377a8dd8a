"""Compose projects -> one experiment, as values: the EDF, its CDFs, what is copied, and what became of each key.

Takes machines and the user's choices; gives a `Draft`. Looks at the file system; writes nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import msgspec

from srprov.codes import Code
from srprov.conversion import names_used, services
from srprov.conversion.kept import Kept
from srprov.conversion.notes import Finding, Notes
from srprov.conversion.project import Choices, Machine, Making, Project, service_name
from srprov.definitions.model import EXPORTED
from srprov.errors import UsageError
from srprov.importing.normal import Note, Variable
from srprov.importing.position import Path

MOST_SERVICES = 1000
"""What an instance has on one robot at most; each service is compared with all others."""
_NOTHING: Mapping[str, Any] = MappingProxyType({})
_PLAIN_DRIVERS = (None, "", "local")
_OWN_ADDRESS = ("macvlan", "ipvlan")


class Draft(msgspec.Struct, frozen=True):
    """An experiment that is not written yet."""

    edf: Mapping[str, Any]
    cdfs: Mapping[str, Mapping[str, Any]]
    copies: Mapping[str, str]
    """Path in the experiment -> the file or folder that is copied there."""
    texts: Mapping[str, str]
    withheld: frozenset[str]
    """Real paths of files that are never copied: they hold secrets."""
    findings: tuple[Finding, ...]
    variables: tuple[Variable, ...]
    notes: tuple[Note, ...]
    origins: Mapping[str, tuple[Notes, Path]]
    """Service of the EDF -> where it comes from."""
    home: str = ""
    """Real path of the folder of which the files may name others; empty where that is what lies beside any."""

    @property
    def refused(self) -> tuple[Finding, ...]:
        """Return what makes the import fail."""
        return tuple(one for one in self.findings if one.kept is Kept.REFUSED)


def convert(
    machines: Sequence[Machine], name: str, choices: Choices, folder: str, network: Mapping[str, Any] = _NOTHING
) -> Draft:
    """Return the experiment that some machines' projects are together.

    Args:
        machines: The projects.
        name: Of the experiment.
        choices: What the user chose.
        folder: Where it will lie.
        network: The EDF's `network`.

    Raises:
        UsageError: There are more services than an instance can have.
    """
    if (count := sum(len(one.normal.document.get("services") or ()) for one in machines)) > MOST_SERVICES:
        words = f"there are {count} services, and an experiment has at most {MOST_SERVICES}"
        raise UsageError(words, hint="import some of the files at a time", code=Code.TOO_LARGE)
    withheld = {*choices.own, *(path for one in machines for path in one.normal.secret_files)}
    making = Making(name, choices, dict(network), withheld=withheld)
    projects = [Project(one, making, one.normal.document, Notes(one.normal)) for one in machines]
    for project in projects:
        _names(project, projects)
    for project in projects:
        chosen = names_used.hostnames(project)
        for service, given in (project.document.get("services") or {}).items():
            made = services.entry(service, given, chosen.get(service, ""), project, folder)
            making.services[project.names[service]] = made
            making.origins[project.names[service]] = (project.notes, ("services", service))
        _healthchecks(project)
        _top(project)
    findings = [one for project in projects for one in project.notes.finished()]
    return Draft(
        edf=_edf(making),
        cdfs=making.cdfs,
        copies=making.copies,
        texts=making.texts,
        withheld=frozenset(making.withheld),
        findings=tuple(sorted(findings, key=lambda one: (one.at, one.key, one.message))),
        variables=tuple(one for project in projects for one in project.machine.normal.variables),
        notes=(*_together(projects), *(note for one in machines for note in one.normal.warnings)),
        origins=making.origins,
    )


def _together(projects: Sequence[Project]) -> Iterator[Note]:
    """Yield what several robots' files open to each other.

    A network of Compose's ends at its robot, and keeps out who is not on it; the overlay has all services.
    """
    some = [one for one in projects if any(map(names_used.on_overlay, (one.document.get("services") or {}).values()))]
    if len(some) > 1:
        where = some[0].machine.normal.position_of(("services",))
        message = "all robots' services reach each other at every port on the overlay, also at what is not published"
        hint = "where one of them has an engine's socket, or no password, import each robot's files by themselves"
        yield Note(where, message, hint)


def _names(project: Project, projects: Sequence[Project]) -> None:
    """Choose the names of a project's services."""
    taken = {name for other in projects for name in other.names.values()}
    for written, given in (project.document.get("services") or {}).items():
        wanted = service_name(written)
        chosen = project.making.free(wanted, project.machine.robot, taken)
        taken.add(chosen)
        project.names[written] = chosen
        project.making.known |= {chosen, *filter(None, [str(given.get("hostname") or "")])}
        if chosen != written:
            why = "an EDF cannot have that name" if wanted != written else "the name is another's already"
            project.notes.adapted(("services", written), f"the service is '{chosen}': {why}")


def _healthchecks(project: Project) -> None:
    """Give each service that is awaited to be healthy a healthcheck: without one of its own, that of its image."""
    for service in project.names.values():
        waits = project.making.services[service].get("depends_on")
        for other, wanted in waits.items() if isinstance(waits, dict) else ():
            entry = project.making.services.get(other)
            if wanted["condition"] == "healthy" and entry is not None and "healthcheck" not in entry:
                entry["healthcheck"] = {}
                notes, at = project.notes, project.making.origins[other][1] if other in project.making.origins else ()
                notes.adapted(at, "its health is awaited: it must have a healthcheck in its image")


def _top(project: Project) -> None:
    """Say what became of volumes, networks and the name."""
    for name, entry in (project.document.get("volumes") or {}).items():
        driver, external = (entry or {}).get("driver"), (entry or {}).get("external")
        if driver not in _PLAIN_DRIVERS:
            words = f"the driver '{str(driver)[:60]}' is not known here"
            project.notes.refused(("volumes", name, "driver"), words, "mount it on the robots, and bind the path")
        if external:
            words = "a volume of the experiment: what an outer one holds already is not taken over"
            project.notes.adapted(("volumes", name, "external"), words)
            project.notes.exact(("volumes", name, "name"))
    for name, entry in (project.document.get("networks") or {}).items():
        if (entry or {}).get("driver") in _OWN_ADDRESS:
            words = f"no service has an address of the robots' network by '{entry['driver']}'"
            project.notes.refused(("networks", name, "driver"), words, "take 'network_mode: host'")
        if name == "default":
            for key in entry or {}:
                project.notes.exact(("networks", name, key))
    if not project.names:
        hint = "a service whose profile is off is left out: --profile NAME"
        project.notes.refused(("services",), "there is no service", hint)
    normal = project.notes.normal
    written = str(project.document.get("name")).removeprefix(EXPORTED)
    if written == project.making.name or normal.position_of(("name",)) == normal.position_of(()):
        project.notes.exact(("name",))  # nobody wrote another
    else:
        project.notes.adapted(("name",), f"the experiment is '{project.making.name}'")


def _edf(making: Making) -> dict[str, Any]:
    found: dict[str, Any] = {"edf": 1, "name": making.name}
    slots = _slots(making)
    if slots > 1:
        found["placement"] = {"slots_per_robot": slots}
    if making.network:
        found["network"] = making.network
    if making.secrets:
        found["secrets"] = making.secrets
    if making.volumes:
        found["volumes"] = making.volumes
    found["services"] = making.services
    return found


def _slots(making: Making) -> int:
    """Return how many services a robot must take: as many as its own file has, or all of them."""
    by_robot: dict[str, int] = {}
    for one in making.services.values():
        robot = str(one.get("robot", ""))
        by_robot[robot] = by_robot.get(robot, 0) + (0 if "per_robot" in one else int(one.get("replicas", 1)))
    anywhere = by_robot.pop("", 0)
    return anywhere + max(by_robot.values(), default=0)
