"""One entry of an EDF's `services` -> Service: its own fields over its CDF's.

Takes the entry's map and the container; gives the Service with everything merged. Touches files, for looking and for
`env_file`.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from types import MappingProxyType

from msgspec.structs import replace

from srprov.codes import Code
from srprov.definitions import envfile, images, merging, paths, requirements, runtime, taken
from srprov.definitions.container import Container
from srprov.definitions.containermodel import Requirements
from srprov.definitions.model import Service
from srprov.definitions.values import scalars, text, texts
from srprov.errors import DefinitionError
from srprov.yamldoc import loader, nodes
from srprov.yamldoc.nodes import Findings, Map, Node, Path, Scalar, Seq

_CONDITIONS = {
    "service_started": "started",
    "service_healthy": "healthy",
    "service_completed_successfully": "completed",
}


def build(
    key: Scalar, node: Map, container: Container | None, folder: str, environ: Mapping[str, str], findings: Findings
) -> tuple[Service, tuple[str, ...]]:
    """Merge one service; `node` passed the schema, `container` is None for an image (or a CDF that is wrong).

    Returns:
        The service, and the names of the variables that it takes from `environ`.
    """
    name = key.text
    path: Path = ("services", name)
    own = merging.normalise(merging.select(node, runtime.RUNTIME_FIELDS), environ, findings, path)
    below: Map = container.layer if container is not None else Map(node.source, node.line, node.column)
    images.check(node.entries.get("image"), findings, (*path, "image"))
    files = _env_files(node.entries.get("env_file"), folder, environ, findings, (*path, "env_file"))
    merged = merging.merge(merging.merge(below, files), own) if files.entries else merging.merge(below, own)
    assert isinstance(merged, Map)
    built = Service(
        name=name,
        cdf=container.definition.file if container is not None else "",
        image=text(node.entries.get("image")),
        cost=_number(node, "cost", 10.0),
        requires=_requires(node, container, findings, path),
        runtime=runtime.parse(merged, folder, findings, path, init=_runs_init(container)),
        network=text(node.entries.get("network"), "overlay"),
        depends_on=MappingProxyType(depends_on(node.entries.get("depends_on"))),
        robot=text(node.entries.get("robot")),
        replicas=int(_number(node, "replicas", 1)),
        per_robot=_per_robot(node.entries.get("per_robot")),
        profiles=texts(node.entries.get("profiles")),
        location=nodes.location(key),
    )
    if built.runtime.pull_policy == "build" and (built.image or (container and container.definition.image)):
        place, hint = merged.entries["pull_policy"], "a CDF with base or dockerfile is built"
        findings.add(
            place,
            "'pull_policy: build' builds nothing: the image is a ready one",
            (*path, "pull_policy"),
            hint,
            code=Code.EXCLUSIVE,
        )
    # what is built into the image is taken as well, whatever the service says of that variable
    into_image = container.layer if container is not None and container.definition.build_environment else None
    return built, tuple(sorted({*taken.environment(merged), *taken.environment(into_image)}))


def depends_on(node: Node | None) -> dict[str, str]:
    """Read `depends_on`, in name order, as service -> `started`, `healthy` or `completed`."""
    conditions = {item.text: "started" for item in scalars(node)} if isinstance(node, Seq) else {}
    if isinstance(node, Map):
        for name, wanted in node.entries.items():
            condition = text(wanted.entries.get("condition"), "started") if isinstance(wanted, Map) else "started"
            conditions[name] = _CONDITIONS.get(condition, condition)
    return dict(sorted(conditions.items()))


def as_job(service: Service) -> Service:
    """Mark a service as a job: another one waits for its end."""
    return replace(service, runtime=replace(service.runtime, job=True))


def _runs_init(container: Container | None) -> bool | None:
    """Return whether an init process runs first where nothing is said of it: in images that srprov builds it does.

    A process with the id 1 ignores signals that it does not handle, so that a plain program takes all of its grace.
    """
    return True if container is not None and container.definition.base else None


def _per_robot(node: Node | None) -> tuple[str, ...] | None:
    return texts(node.entries.get("tags")) if isinstance(node, Map) else None


def _number(node: Map, key: str, default: float) -> float:
    found = nodes.as_number(node.entries[key]) if key in node.entries else None
    return default if found is None else found


def _requires(node: Map, container: Container | None, findings: Findings, path: Path) -> Requirements:
    own = requirements.read(node.entries.get("requires"), findings, (*path, "requires"))
    if container is None:
        return own
    try:
        return requirements.combined(container.definition.requires, own)
    except ValueError as error:
        where = nodes.find(node, ("requires", "arch"))
        findings.add(where, str(error), (*path, "requires", "arch"), code=Code.WRONG_VALUE)
        return own


def _env_files(node: Node | None, folder: str, environ: Mapping[str, str], findings: Findings, path: Path) -> Map:
    """Read every env_file into a layer with nothing but `environment`."""
    given = scalars(node)
    if not given:
        return Map(nodes.Source(""), 1, 1)
    entries: dict[str, Node] = {}
    for item in given:
        real = paths.resolve(item, folder, findings, path)
        if not real:
            continue
        if paths.is_left(item, real, path):
            continue
        if os.path.isdir(real):
            findings.add(item, f"'{item.text}' is a folder, not a file", path, code=Code.NO_SUCH_FILE)
            continue
        try:
            shown = paths.shown_beside(item.source.file, item.text)
            words = loader.read_text(real, shown, envfile.MAX_BYTES, real=True, known_as=paths.named(item))
            found, bare, problems = envfile.parse(words, shown, environ)
        except DefinitionError as error:
            found, bare, problems = {}, set(), list(error.problems)
        findings.extend(map(nodes.without_secrets, problems))
        for name, value in found.items():
            tag = merging.FROM_CONTROLLER if name in bare else ""
            entries[name] = Scalar(item.source, item.line, item.column, value, plain=False, tag=tag)
    first = given[0]
    keys = {key: Scalar(first.source, value.line, value.column, key) for key, value in entries.items()}
    variables = Map(first.source, first.line, first.column, entries, keys)
    key = Scalar(first.source, first.line, first.column, "environment")
    return Map(first.source, first.line, first.column, {"environment": variables}, {"environment": key})
