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
from srprov.definitions import build, dockerfile, hiding, images, merging, paths, requirements, runtime, schema
from srprov.definitions.containermodel import ContainerDefinition
from srprov.definitions.extends import ExtendsReader
from srprov.definitions.remote import Fetch
from srprov.definitions.values import text, texts
from srprov.errors import DefinitionError, Diagnostic
from srprov.yamldoc import nodes
from srprov.yamldoc.allowance import allowance
from srprov.yamldoc.nodes import Findings, Map


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
    left: tuple[str, ...] = ()
    """Paths of what it names and nobody may look at yet."""

    @property
    def whole(self) -> bool:
        """Return whether all that it is made from was read."""
        return not self.unsupported and not self.left

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
    with allowance(schema.MOST_BYTES, schema.MOST_VALUES) as limits:
        known = len(limits.left)
        reader = ExtendsReader(environ, findings, unsupported, fetch)
        layer = reader.read(absolute, shown, ())
        if findings.problems or layer is None:
            raise DefinitionError(findings.problems)
        definition = _whole(layer, absolute, shown, folder, reader)
    return Container(
        definition=definition,
        layer=merging.select(layer, runtime.RUNTIME_FIELDS),
        files=tuple(reader.files),
        unsupported=tuple(unsupported.problems),
        remote=tuple(reader.remote),
        fetched=tuple(reader.fetched),
        left=tuple(one.path for one in limits.left[known:]),
    )


def _whole(layer: Map, path: str, shown: str, folder: str, reader: ExtendsReader) -> ContainerDefinition:
    """Return what a merged layer says.

    Raises:
        DefinitionError: With everything that is wrong, of files elsewhere nothing but that something is.
    """
    findings = Findings()
    try:
        _check_origin(layer, findings, unknown_parent=reader.unknown)
        definition = _definition(layer, path, folder, findings)
        if findings.problems:
            raise DefinitionError(findings.problems)
    except DefinitionError as error:
        if (own := reader.own) is None or all(paths.lies_open(file, folder) for file in reader.files):
            raise
        hidden = hiding.hide_merged(error.problems, lambda f: _definition(own, path, folder, f), shown, folder)
        raise DefinitionError(hidden) from None
    return definition


def _check_origin(layer: Map, findings: Findings, *, unknown_parent: bool) -> None:
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
