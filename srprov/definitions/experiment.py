"""EDF -> Definitions: the experiment, its containers, and what of it was not fetched.

Takes a path; gives values, or every problem of the EDF and of all files that it names. Touches files, for reading. A
service whose entry breaks the schema is left out of the later checks, so that one mistake is told once.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

from msgspec.structs import replace

from srprov.codes import Code
from srprov.definitions import (
    cdfs,
    checks,
    hiding,
    merging,
    paths,
    playbook,
    relations,
    right_kind,
    schema,
    secrets,
    service,
    sharing,
    taken,
    trials,
    unresolved,
    volumes,
)  # fmt: skip
from srprov.definitions.container import Container
from srprov.definitions.model import Definitions, Experiment, NetworkSettings, Placement, Service, Weights
from srprov.definitions.remote import Fetch
from srprov.definitions.taken import ANYBODY
from srprov.definitions.values import scalars, text, texts
from srprov.errors import DefinitionError, Diagnostic, Location
from srprov.yamldoc import nodes
from srprov.yamldoc.allowance import Left, allowance, current
from srprov.yamldoc.nodes import Findings, Map, Node, Scalar

_MOST_BYTES = 2 * 1024 * 1024
_MOST_VALUES = 30_000
"""Of an EDF with all files that it names."""
_METADATA = ("license", "doi", "notes")


def load(path: str, environ: Mapping[str, str], fetch: Fetch | None = None, home: str = "") -> Definitions:
    """Read one EDF and all that it names; `environ` is what a bare NAME in `environment` is looked up in.

    CDFs in git repositories are fetched by `fetch`; with None they are not, and noted as what is not there. With
    `home`, the folder of the experiment's own files, so it is with others.

    Raises:
        DefinitionError: With everything that is wrong, in every file.
    """
    with allowance(_MOST_BYTES, _MOST_VALUES, home) as limits:
        return _with_left(_load(path, environ, fetch), limits.left)


def _with_left(found: Definitions, left: Sequence[Left]) -> Definitions:
    """Return definitions that ask for what was not looked at."""
    if not left:
        return found
    asked = {*found.experiment.outside, *((one.whose, taken.left(one.path)) for one in left if one.whose)}
    known = {path for _, path in asked}
    read = {taken.left(one.path) for one in left}
    experiment = replace(
        found.experiment,
        outside=tuple(sorted({*asked, *((ANYBODY, path) for path in read - known)})),
        read_outside=found.experiment.read_outside | read,
        files=tuple(sorted({*found.experiment.files, *(one.path for one in left)})),
    )
    return replace(found, experiment=experiment, unsupported=(*found.unsupported, *sorted({one.note for one in left})))


def _load(path: str, environ: Mapping[str, str], fetch: Fetch | None) -> Definitions:
    home = os.path.realpath(os.path.dirname(os.path.abspath(path)))
    root = right_kind.read(path, "edf")
    if not isinstance(root, Map):
        message = "the file is empty" if root is None else f"an EDF is a map, not {nodes.kind(root)}"
        raise DefinitionError([Diagnostic(Location(path), message, hint="begin with edf: 1", code=Code.WRONG_TYPE)])
    findings, unsupported = Findings(), Findings()
    folder = os.path.dirname(os.path.abspath(path))
    schema.check(root, "edf", findings)
    schema.check_tags(root, findings, merging.RUNTIME_MERGED)
    for name, entry in checks.service_maps(root).items():
        unresolved.check(entry, ("services", name), findings)
    read = cdfs.read(checks.service_maps(root), folder, environ, fetch, findings, unsupported)
    known = findings.copy()
    try:
        experiment = _checked(root, path, read.by_service, environ, findings)
    except DefinitionError as error:
        known_files = {
            name: one if one and all(paths.lies_open(file, folder) for file in one.files) else None
            for name, one in read.by_service.items()
        }
        if known_files == read.by_service:
            raise
        alone = functools.partial(_checked, root, path, known_files, environ)
        raise DefinitionError(hiding.hide_merged(error.problems, alone, path, folder, known)) from None
    elsewhere, files, left = taken.repositories(read.remote), _files(root, experiment, read), current.get()
    contents = {one: left.contents[one] for one in files if one in left.contents} if left else {}
    return Definitions(
        experiment=replace(
            experiment,
            remote=tuple(sorted(set(read.remote))),
            home=home,
            files=files,
            contents=MappingProxyType(contents),
            outside=tuple(
                sorted({*experiment.outside, *elsewhere, *((name, taken.left(one)) for name, one in read.left)})
            ),
            read_outside=frozenset(taken.in_words(os.path.realpath(one)) for one in files)
            & {path for _, path in experiment.outside},
        ),
        containers=MappingProxyType({key: one.definition for key, one in sorted(read.by_path.items())}),
        unsupported=tuple(sorted(hiding.hide_outside(unsupported.problems, folder))),
        variables=taken.variables(experiment.environment, environ),
    )


def _checked(
    root: Map, path: str, containers: Mapping[str, Container | None], environ: Mapping[str, str], findings: Findings
) -> Experiment:
    """Return the experiment as it is with these containers.

    Raises:
        DefinitionError: The findings hold something, old or new.
    """
    folder = os.path.dirname(os.path.abspath(path))
    services, bare = _services(root, containers, folder, environ, findings)
    whole = all(
        containers[name] is None if "cdf" not in entry.entries else bool((one := containers[name]) and one.whole)
        for name, entry in checks.service_maps(root).items()
    )
    services = volumes.seeded(root, services, folder, findings, whole=whole)
    sources = secrets.sources(root, folder, findings)
    playbooks = playbook.from_experiment(root, folder, findings)
    checks.check(root, services, containers, findings)
    trial_definitions = trials.read(root, services, findings)
    if findings.problems:
        raise DefinitionError(findings.problems)
    env_files = {name: _env_files(entry) for name, entry in checks.service_maps(root).items()}
    return replace(
        _experiment(root, path, services),
        secrets=sources,
        playbooks=playbooks,
        outside=taken.outside(path, folder, services, containers, env_files),
        environment=bare,
        variables=tuple(sorted({name for _, name in bare})),
        trials=trial_definitions,
    )


def _files(root: Map, experiment: Experiment, read: cdfs.Cdfs) -> tuple[str, ...]:
    """Return the paths of all that was read, but for what comes from git repositories."""
    found = {experiment.file, *(one.file for one in experiment.playbooks)}
    for one in read.by_path.values():
        found |= {path for path in one.files if not any(paths.inside(path, tree) for tree in one.fetched)}
    for entry in checks.service_maps(root).values():
        found |= set(_env_files(entry))
    return tuple(sorted(map(os.path.normpath, found)))


def _env_files(entry: Map) -> list[str]:
    return [paths.named(each) for each in scalars(entry.entries.get("env_file"))]


def _services(
    root: Map, containers: Mapping[str, Container | None], folder: str, environ: Mapping[str, str], findings: Findings
) -> tuple[dict[str, Service], taken.Taken]:
    """Return every service whose entry fits the schema, and (service, variable) of what they take from `environ`."""
    services: dict[str, Service] = {}
    bare: list[tuple[str, str]] = []
    for name, entry in sorted(checks.service_maps(root).items()):
        if not findings.broken(("services", name)):
            place = checks.service_key(root, name)
            built, variables = service.build(place, entry, containers[name], folder, environ, findings)
            bare += [(name, variable) for variable in variables]
            built = replace(built, by_cdf=sharing.by_cdf(built, entry))
            services[name] = secrets.with_secrets(built, entry, root, findings)
    return sharing.with_same_cdf(services), tuple(bare)


def _experiment(root: Map, path: str, services: Mapping[str, Service]) -> Experiment:
    get = root.entries.get
    waited_for = {name for one in services.values() for name, wanted in one.depends_on.items() if wanted == "completed"}
    absolute = os.path.abspath(path)
    network = _network(get("network"))
    kept = {n: service.as_job(one) if n in waited_for else one for n, one in services.items()}
    return Experiment(
        name=text(get("name")),
        file=absolute,
        folder=os.path.dirname(absolute),
        text=root.source.text,
        services=MappingProxyType({n: _encrypted(one, network) for n, one in kept.items()}),
        same_robot=sharing.with_shared(checks.same_robot_groups(root), services),
        different_robot=relations.different_robot(root),
        pools=relations.pools(root),
        weights=_weights(get("weights")),
        placement=Placement(**_settings(get("placement"))),
        network=network,
        description=text(get("description")),
        authors=texts(get("authors")),
        metadata=MappingProxyType({key: text(get(key)) for key in _METADATA if key in root.entries}),
    )


_NETWORK_FIELDS = ("subnet", "mtu", "vni", "port", "persist", "discovery", "encryption")


def _network(node: Node | None) -> NetworkSettings:
    servers = texts(node.entries.get("discovery_servers")) if isinstance(node, Map) else ()
    return NetworkSettings(
        **{key: value for key, value in _settings(node).items() if key in _NETWORK_FIELDS}, discovery_servers=servers
    )


def _encrypted(one: Service, network: NetworkSettings) -> Service:
    """Return a service that only a robot runs which can encrypt, when it has a part in an encrypted overlay."""
    if network.encryption == "none" or one.network not in ("overlay", "both"):
        return one
    return replace(one, requires=replace(one.requires, wireguard=True))


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
