"""EDF -> Definitions: the experiment, its containers, and what of it is not built yet.

Takes a path; gives values, or every problem of the EDF and of all files that it names. Touches files, for reading. A
service whose entry breaks the schema is left out of the later checks, so that one mistake is told once.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from srprov.definitions import (
    checks,
    container,
    merging,
    paths,
    playbook,
    relations,
    schema,
    secrets,
    service,
    sharing,
    taken,
)  # fmt: skip
from srprov.definitions.container import Container
from srprov.definitions.model import Definitions, Experiment, NetworkSettings, Placement, Service, Weights
from srprov.definitions.unsupported import note_unsupported
from srprov.definitions.values import text, texts
from srprov.errors import DefinitionError, Diagnostic, Location
from srprov.yamldoc import loader, nodes
from srprov.yamldoc.allowance import allowance
from srprov.yamldoc.nodes import Findings, Map, Node, Scalar

_MOST_BYTES = 2 * 1024 * 1024
_MOST_VALUES = 30_000
"""Of an EDF with all files that it names."""
_METADATA = ("license", "doi", "notes")


def load(path: str, environ: Mapping[str, str]) -> Definitions:
    """Read one EDF and all that it names; `environ` is what a bare NAME in `environment` is looked up in.

    Raises:
        DefinitionError: With everything that is wrong, in every file.
    """
    with allowance(_MOST_BYTES, _MOST_VALUES):
        return _load(path, environ)


def _load(path: str, environ: Mapping[str, str]) -> Definitions:
    root = loader.read(path)
    if not isinstance(root, Map):
        message = "the file is empty" if root is None else f"an EDF is a map, not {nodes.kind(root)}"
        raise DefinitionError([Diagnostic(Location(path), message, hint="begin with edf: 1")])
    findings, unsupported = Findings(), Findings()
    folder = os.path.dirname(os.path.abspath(path))
    schema.check(root, "edf", findings)
    schema.check_tags(root, findings, merging.RUNTIME_MERGED)
    containers = _containers(checks.service_maps(root), folder, environ, findings)
    known = findings.copy()
    try:
        experiment = _checked(root, path, containers, environ, findings)
    except DefinitionError as error:
        within = {key: one for key, one in containers.items() if all(paths.inside(file, folder) for file in one.files)}
        if len(within) == len(containers):
            raise
        alone = functools.partial(_checked, root, path, within, environ)
        raise DefinitionError(paths.hide_merged(error.problems, alone, known, folder)) from None
    note_unsupported(root, unsupported)
    for one in containers.values():
        unsupported.extend(one.unsupported)
    return Definitions(
        experiment=experiment,
        containers=MappingProxyType({key: one.definition for key, one in sorted(containers.items())}),
        unsupported=tuple(sorted(paths.hide_outside(unsupported.problems, folder))),
        variables=taken.variables(experiment.environment, environ),
    )


def _checked(
    root: Map, path: str, containers: Mapping[str, Container], environ: Mapping[str, str], findings: Findings
) -> Experiment:
    """Return the experiment as it is with these containers.

    Raises:
        DefinitionError: The findings hold something, old or new.
    """
    folder, entries = os.path.dirname(os.path.abspath(path)), checks.service_maps(root)
    services, bare = _services(root, containers, folder, environ, findings)
    sources = secrets.sources(root, folder, findings)
    playbooks = playbook.from_experiment(root, folder, findings)
    by_service = {name: containers.get(_cdf_key(entries[name])) for name in services}
    checks.check(root, services, by_service, findings)
    if findings.problems:
        raise DefinitionError(findings.problems)
    return replace(
        _experiment(root, path, services),
        secrets=sources,
        playbooks=playbooks,
        outside=taken.outside(path, folder, services, by_service),
        environment=bare,
    )


def _services(
    root: Map, containers: Mapping[str, Container], folder: str, environ: Mapping[str, str], findings: Findings
) -> tuple[dict[str, Service], taken.Taken]:
    """Return every service whose entry fits the schema, and (service, variable) of what they take from `environ`."""
    services: dict[str, Service] = {}
    bare: list[tuple[str, str]] = []
    for name, entry in sorted(checks.service_maps(root).items()):
        if not findings.broken(("services", name)):
            container_of = containers.get(_cdf_key(entry))
            place = checks.service_key(root, name)
            built, variables = service.build(place, entry, container_of, folder, environ, findings)
            bare += [(name, variable) for variable in variables]
            services[name] = secrets.with_secrets(built, entry, root, findings)
    return services, tuple(bare)


def _cdf_key(entry: Map) -> str:
    cdf = entry.entries.get("cdf")
    return os.path.normpath(os.path.join(cdf.source.folder, cdf.text)) if isinstance(cdf, Scalar) else ""


def _containers(
    entries: Mapping[str, Map], folder: str, environ: Mapping[str, str], findings: Findings
) -> dict[str, Container]:
    """Read every CDF that a service names, each once; keys are absolute paths."""
    found: dict[str, Container] = {}
    for name in sorted(entries):
        cdf, key = entries[name].entries.get("cdf"), _cdf_key(entries[name])
        path = ("services", name, "cdf")
        if not isinstance(cdf, Scalar) or not cdf.text or nodes.is_null(cdf) or key in found:
            continue
        if "\0" in key or not os.path.isfile(key):
            what = "is a folder, not a CDF" if os.path.isdir(key) else "does not exist"
            findings.add(
                cdf,
                f"the CDF '{cdf.text}' {what}",
                path,
                f"it is looked for at {os.path.relpath(key)}" if "\0" not in key else "",
            )
            continue
        try:
            found[key] = container.load(key, folder, environ, paths.shown_beside(cdf.source.file, cdf.text))
        except DefinitionError as error:
            findings.extend(error.problems)
    return found


def _experiment(root: Map, path: str, services: Mapping[str, Service]) -> Experiment:
    get = root.entries.get
    waited_for = {name for one in services.values() for name, wanted in one.depends_on.items() if wanted == "completed"}
    absolute = os.path.abspath(path)
    return Experiment(
        name=text(get("name")),
        file=absolute,
        folder=os.path.dirname(absolute),
        services=MappingProxyType({n: service.as_job(one) if n in waited_for else one for n, one in services.items()}),
        same_robot=sharing.with_shared(checks.same_robot_groups(root), services),
        different_robot=relations.different_robot(root),
        pools=relations.pools(root),
        weights=_weights(get("weights")),
        placement=Placement(**_settings(get("placement"))),
        network=NetworkSettings(**{k: v for k, v in _settings(get("network")).items() if k in _NETWORK_FIELDS}),
        description=text(get("description")),
        authors=texts(get("authors")),
        metadata=MappingProxyType({key: text(get(key)) for key in _METADATA if key in root.entries}),
    )


_NETWORK_FIELDS = ("subnet", "mtu", "vni", "port")


def _settings(node: Node | None) -> dict[str, Any]:
    """Return a map's plain settings by name: whole numbers, numbers, booleans, else text."""
    given: dict[str, Any] = {}
    for key, value in node.entries.items() if isinstance(node, Map) else ():
        if key.startswith("x-") or not isinstance(value, Scalar):
            continue
        whole, number, flag = nodes.as_int(value), nodes.as_number(value), nodes.as_bool(value)
        options = (whole, number, flag)
        given[key] = next((option for option in options if option is not None), value.text)
    return given


def _weights(node: Node | None) -> Weights:
    given = {("memory" if key == "vram" else key): float(value) for key, value in _settings(node).items()}
    return Weights(**given)
