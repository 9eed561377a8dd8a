"""CDF -> ContainerDefinition.

Takes a path (a CDF, or a Dockerfile, which is a CDF too); gives the definition after `extends` was merged, with the
merged layer that services are laid over. Touches files, for reading. Everything wrong in any file of the chain is
reported at once.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from types import MappingProxyType

import msgspec

from srprov.codes import Code
from srprov.definitions import (
    build,
    dockerfile,
    images,
    merging,
    paths,
    remote,
    requirements,
    right_kind,
    runtime,
    schema,
    unresolved,
)  # fmt: skip
from srprov.definitions.containermodel import ContainerDefinition
from srprov.definitions.remote import Fetch
from srprov.definitions.values import text, texts
from srprov.errors import DefinitionError, Diagnostic, Location
from srprov.yamldoc import loader, nodes
from srprov.yamldoc.allowance import allowance
from srprov.yamldoc.nodes import Findings, Map, Node, Scalar, Source

_LONGEST_CHAIN = 10
_MERGED_TAGS = merging.RUNTIME_MERGED | merging.BUILD_MERGED | {"requires"}


class Container(msgspec.Struct, frozen=True, kw_only=True):
    """A CDF as services use it: the definition, and the run-time layer that they are laid over."""

    definition: ContainerDefinition
    layer: Map
    files: tuple[str, ...] = ()
    """Absolute paths of the CDF and of those that it extends."""
    unsupported: tuple[Diagnostic, ...] = ()
    remote: tuple[tuple[str, str], ...] = ()
    """(address, branch, tag or commit) of the CDFs in git repositories that it extends."""
    fetched: tuple[str, ...] = ()
    """Folders that were fetched for it."""

    @property
    def image_has_healthcheck(self) -> bool:
        """Return whether the Dockerfile sets one; that of an image is not known."""
        text = self.definition.dockerfile_text
        return bool(text) and dockerfile.has_healthcheck(dockerfile.until_stage(text, self.definition.target))


def load(path: str, folder: str, environ: Mapping[str, str], shown: str = "", fetch: Fetch | None = None) -> Container:
    """Read one CDF; `folder` is the experiment's, `environ` what a bare NAME in `environment` is looked up in.

    What it extends in git repositories is fetched by `fetch`; with None it is not, and noted.

    Raises:
        DefinitionError: With everything that is wrong in the file and in those that it extends.
    """
    absolute, shown = os.path.abspath(path), shown or path
    findings, unsupported = Findings(), Findings()
    with allowance(schema.MOST_BYTES, schema.MOST_VALUES):
        reader = _ExtendsReader(environ, findings, unsupported, fetch)
        layer = reader.read(absolute, shown, ())
    if findings.problems or layer is None:
        raise DefinitionError(findings.problems)
    try:
        _check_origin(layer, findings, bool(unsupported.problems))
        definition = _definition(layer, absolute, folder, findings)
        if findings.problems:
            raise DefinitionError(findings.problems)
    except DefinitionError as error:
        if (own := reader.own) is None or all(paths.lies_open(file, folder) for file in reader.files):
            raise
        hidden = paths.hide_merged(error.problems, lambda f: _definition(own, absolute, folder, f), shown, folder)
        raise DefinitionError(hidden) from None
    return Container(
        definition=definition,
        layer=merging.select(layer, runtime.RUNTIME_FIELDS),
        files=tuple(reader.files),
        unsupported=tuple(unsupported.problems),
        remote=tuple(reader.remote),
        fetched=tuple(reader.fetched),
    )


class _ExtendsReader:
    """Reads a CDF and what it extends, each file once; `trail` holds the files on the way here."""

    def __init__(
        self, environ: Mapping[str, str], findings: Findings, unsupported: Findings, fetch: Fetch | None
    ) -> None:
        self.fetch = fetch
        self.remote: list[tuple[str, str]] = []
        self.fetched: list[str] = []
        self.environ = environ
        self.findings = findings
        self.unsupported = unsupported
        self.files: list[str] = []
        self.own: Map | None = None  # the first file's layer, with nothing merged

    def read(self, path: str, shown: str, trail: tuple[str, ...]) -> Map | None:
        """Return the merged layer, or None when something is wrong (it is in the findings)."""
        own = Findings()
        self.files.append(path)
        try:
            if dockerfile.is_dockerfile(path):
                return _as_layer(path, shown)
            root = right_kind.read(path, "cdf", shown)
        except DefinitionError as error:
            self.findings.extend(error.problems)
            return None
        if not isinstance(root, Map):
            message = "the file is empty" if root is None else f"a CDF is a map, not {nodes.kind(root)}"
            self.findings.extend([Diagnostic(Location(shown), message, hint="begin with cdf: 1", code=Code.WRONG_TYPE)])
            return None
        schema.check(root, "cdf", own)
        schema.check_tags(root, own, _MERGED_TAGS)
        unresolved.check(root, (), own)
        layer = merging.normalise(root, self.environ, own, ()) if not own.problems else root
        self.own = self.own or layer
        parent = self._parent(root, path, shown, trail, own)
        self.findings.extend(own.problems)
        if own.problems or parent is None:
            # what a CDF that was not fetched says is not known; without it, what is here must still fit together
            unknown = self.fetch is None and isinstance(root.entries.get("extends"), Map)
            return layer if not own.problems and ("extends" not in root.entries or unknown) else None
        return _overlay(parent, layer)

    def _parent(self, root: Map, path: str, shown: str, trail: tuple[str, ...], own: Findings) -> Map | None:
        extends = root.entries.get("extends")
        if extends is None or own.broken(("extends",)):
            return None
        target, name = self._target(extends, path, shown, own)
        if not target:
            return None
        if target in (*trail, path):
            steps = [*trail, path]
            circle = [*steps[steps.index(target) :], target]
            message = f"extends itself: {' -> '.join(os.path.basename(step) for step in circle)}"
            own.add(extends, message, ("extends",), code=Code.DEPENDENCY)
            return None
        if len(trail) >= _LONGEST_CHAIN:
            own.add(extends, f"more than {_LONGEST_CHAIN} CDFs extend each other", ("extends",), code=Code.TOO_LARGE)
            return None
        return self.read(target, name, (*trail, path))

    def _target(self, extends: Node, path: str, shown: str, own: Findings) -> tuple[str, str]:
        """Return the path of the CDF that is extended, and its name for messages; empty where there is none."""
        if isinstance(extends, Map):
            self.remote.append((text(extends.entries.get("git")), text(extends.entries.get("ref"))))
            folder, target = remote.located(extends, self.fetch, own, self.unsupported, ("extends",))
            self.fetched += [folder] if folder else []
            return target, target
        if not isinstance(extends, Scalar) or not extends.text:
            return "", ""
        target = os.path.normpath(os.path.join(os.path.dirname(path), extends.text))
        if "\0" in target or not os.path.isfile(target):
            message, hint = f"there is no CDF '{extends.text}'", f"it is looked for at {target}"
            own.add(extends, message, ("extends",), hint, code=Code.NO_SUCH_FILE)
            return "", ""
        return target, paths.shown_beside(shown, extends.text)


def _as_layer(path: str, shown: str) -> Map:
    """Return a Dockerfile as the CDF that it stands for.

    Raises:
        DefinitionError: It cannot be read.
    """
    source = Source(shown, tuple(loader.read_text(path, shown, dockerfile.MAX_BYTES).split("\n")))
    key = Scalar(source, 1, 1, "dockerfile")
    return Map(source, 1, 1, {"dockerfile": Scalar(source, 1, 1, os.path.basename(path))}, {"dockerfile": key})


def _overlay(parent: Map, child: Map) -> Map:
    """Lay a CDF over the one that it extends; name, version and origin are its own."""
    inherited = {"name", "cdf", "extends"}
    if any(origin in child.entries for origin in build.ORIGINS):
        inherited |= set(build.ORIGINS)
    merged = merging.merge(merging.select(parent, frozenset(parent.entries) - inherited), child)
    assert isinstance(merged, Map)
    return merged


def _check_origin(layer: Map, findings: Findings, unknown_parent: bool) -> None:
    given = [origin for origin in build.ORIGINS if origin in layer.entries]
    for extra in given[1:]:
        findings.add(layer.keys[extra], f"'{given[0]}' and '{extra}' exclude each other", (extra,), code=Code.ORIGIN)
    if not given and not unknown_parent:
        findings.add(layer, "needs one of base, image, dockerfile", code=Code.ORIGIN)
    for key in build.BUILDING:
        if given and given[0] != "base" and key in layer.entries:
            message = f"'{key}' would be built into the image, but '{given[0]}' is taken as it is"
            hint = "start from 'base', or put it into the Dockerfile"
            findings.add(layer.keys[key], message, (key,), hint, code=Code.ORIGIN)


def _definition(layer: Map, path: str, folder: str, findings: Findings) -> ContainerDefinition:
    get = layer.entries.get
    for key in ("base", "image"):
        images.check(get(key), findings, (key,))
    packages = get("packages")
    packed = packages.entries if isinstance(packages, Map) else {}
    run_time = runtime.parse(layer, folder, findings, (), init="base" in layer.entries or None)
    written = build.written(get("dockerfile"), folder, findings)
    named = tuple(name for key in ("base", "image") if (name := text(get(key))) not in ("", "scratch"))
    return ContainerDefinition(
        name=text(get("name")) or _stem(path),
        file=path,
        folder=os.path.dirname(path),
        text=layer.source.text,
        base=text(get("base")),
        image=text(get("image")),
        dockerfile=written.path,
        dockerfile_text=written.whole,
        context=written.context,
        build_args=MappingProxyType(written.args),
        target=written.target,
        images=named + dockerfile.images_of(written.text),
        fetches=dockerfile.fetches(written.text),
        description=text(get("description")),
        platforms=texts(get("platforms")),
        apt=texts(packed.get("apt")),
        pip=texts(packed.get("pip")),
        npm=texts(packed.get("npm")),
        repositories=build.repositories(get("repositories"), findings),
        files=build.files(get("files"), folder, findings),
        run=texts(get("run")),
        build_environment=MappingProxyType(dict(run_time.environment) if "base" in layer.entries else {}),
        runtime=run_time,
        requires=requirements.read(get("requires"), findings, ("requires",)),
        location=nodes.location(layer),
        lines=MappingProxyType(build.lines(layer)),
    )


def _stem(path: str) -> str:
    name = os.path.basename(path)
    return os.path.basename(os.path.dirname(path)) if name == "Dockerfile" else name.rsplit(".", 1)[0]
