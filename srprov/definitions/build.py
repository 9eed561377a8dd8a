"""What a CDF puts into its image: a Dockerfile with its context, code repositories, files.

Takes nodes whose shape the schema has checked; gives values. Touches files, for reading; the network is not asked.
"""

from __future__ import annotations

import os
from collections.abc import Mapping

import msgspec

from srprov.codes import Code
from srprov.definitions import dockerfile, merging, paths
from srprov.definitions.containermodel import BuildFile, Repository
from srprov.definitions.own_lines import may_quote
from srprov.definitions.values import scalars, text, texts
from srprov.errors import DefinitionError, did_you_mean
from srprov.git_address import check_ref, parse_address
from srprov.yamldoc import loader, nodes
from srprov.yamldoc.nodes import Findings, Map, Node, Path, Scalar, Seq

ORIGINS = ("base", "image", "dockerfile")
BUILDING = ("packages", "repositories", "files", "run")
_PROXIES = ("http_proxy", "https_proxy", "ftp_proxy", "all_proxy", "no_proxy")
_BUILDERS_OWN = "BUILDKIT_"
"""BuildKit reads these, declared or not: `BUILDKIT_SYNTAX` names the image that reads the Dockerfile in its place."""


class Written(msgspec.Struct, frozen=True, kw_only=True):
    """A Dockerfile as it stands on the disk, and how it is built."""

    path: str = ""
    """Absolute."""
    context: str = ""
    """Absolute path of a folder; empty: the Dockerfile's own."""
    whole: str = ""
    """The Dockerfile's text."""
    text: str = ""
    """Up to the end of the stage that is built."""
    args: dict[str, str] = msgspec.field(default_factory=dict)
    target: str = ""


def written(node: Node | None, folder: str, findings: Findings) -> Written:
    """Return a CDF's Dockerfile, and check what stands in it; `folder` is the experiment's."""
    given = node.entries if isinstance(node, Map) else {}
    place = _place(node, given)
    if place is None or not (path := paths.resolve(place, folder, findings, ("dockerfile",))):
        return Written()
    context = ""
    if isinstance(node, Map):
        named = given.get("context", Scalar(node.source, node.line, node.column, "."))
        assert isinstance(named, Scalar)
        context = paths.resolve(named, folder, findings, ("dockerfile", "context"))
        if context and not paths.is_closed(context) and not os.path.isdir(context):
            findings.add(named, f"'{named.text}' is no folder", ("dockerfile", "context"), code=Code.NO_SUCH_FILE)
    if paths.is_left(place, path, ("dockerfile",)):
        return Written(path=path, context=context)
    if os.path.isdir(path):
        findings.add(place, f"'{place.text}' is a folder, not a Dockerfile", ("dockerfile",), code=Code.NO_SUCH_FILE)
        return Written(path=path)
    shown = paths.shown_beside(place.source.file, place.text)
    try:
        whole = loader.read_text(path, shown, dockerfile.MAX_BYTES, real=True, times=dockerfile.READINGS)
    except DefinitionError as error:
        findings.extend(error.problems)
        return Written(path=path)
    if wrong := dockerfile.check(whole, shown):
        findings.extend(wrong)
        return Written(path=path, context=context)
    told = may_quote(path, folder)
    args = _args(given.get("args"), dockerfile.declared(whole), findings, told=told)
    built = _built(whole, given, findings, told=told)
    return Written(path=path, context=context, whole=whole, text=built, args=args, target=text(given.get("target")))


def _place(node: Node | None, given: Mapping[str, Node]) -> Scalar | None:
    """Return the path of a Dockerfile, relative to the CDF; in the long form it starts from the context."""
    if not isinstance(node, Map):
        return node if isinstance(node, Scalar) else None
    named = given.get("dockerfile", given.get("context", node))
    path = os.path.join(text(given.get("context"), "."), text(given.get("dockerfile"), "Dockerfile"))
    return Scalar(named.source, named.line, named.column, os.path.normpath(path))


def _built(whole: str, given: Mapping[str, Node], findings: Findings, *, told: bool) -> str:
    """Return a Dockerfile's text up to the end of the stage that is built; `told`: its stages may be named."""
    target = given.get("target")
    try:
        return dockerfile.until_stage(whole, text(target))
    except ValueError as error:
        assert target is not None
        wrong = str(error) if told else f"the Dockerfile has no stage '{text(target)[:60]}'"
        findings.add(target, wrong, ("dockerfile", "target"), code=Code.DOCKERFILE)
        return whole


def _args(node: Node | None, declared: frozenset[str], findings: Findings, *, told: bool) -> dict[str, str]:
    """Read `args`, a map or a list of NAME=value; what the Dockerfile does not declare would be ignored.

    With `told`, what it does declare may be named.
    """
    found: dict[str, str] = {}
    entries = list(node.entries.items()) if isinstance(node, Map) else [(one.text, one) for one in scalars(node)]
    for given, value in entries:
        name, _, words = given.partition("=") if isinstance(node, Seq) else (given, "", text(value))
        path: Path = ("dockerfile", "args", name)
        if isinstance(node, Seq) and "=" not in given:
            findings.add(value, f"'{name[:60]}' has no value", path, f"write {name[:60]}=value", code=Code.ENVIRONMENT)
        elif name.upper().startswith(_BUILDERS_OWN):
            message = f"'{name[:60]}' is a setting of the builder itself, which may be another program by it"
            findings.add(value, message, path, "give an ARG of your own another name", code=Code.DOCKERFILE)
        elif name in found:
            findings.add(value, f"'{name[:60]}' is given twice", path, code=Code.TWICE)
        elif name not in declared:
            proxy = "a proxy is a setting of the robot's engine" if name.lower() in _PROXIES else ""
            near = did_you_mean(name, declared) if told else ""
            hint = near or proxy or f"write ARG {name[:60]} into the Dockerfile"
            findings.add(value, f"no ARG of the Dockerfile declares '{name[:60]}'", path, hint, code=Code.DOCKERFILE)
        found[name] = words
    return found


def repositories(node: Node | None, findings: Findings) -> tuple[Repository, ...]:
    """Return the code repositories of a CDF; whether they exist is not asked."""
    found = []
    for index, item in enumerate(node.items if isinstance(node, Seq) else ()):
        entries = item.entries if isinstance(item, Map) else {}
        path: Path = ("repositories", index)
        url = checked_address(entries, findings, path)
        target = text(entries.get("path"))
        if ".." in target.split("/") or target.strip("/") == "":
            findings.add(
                entries.get("path", item),
                f"'{target[:80]}' is no folder to put a repository in",
                (*path, "path"),
                code=Code.REPOSITORY,
            )
        found.append(
            Repository(url=url, ref=text(entries.get("ref")), path=target.rstrip("/"), run=texts(entries.get("run")))
        )
    for index, one in enumerate(found):
        if any(one.path == other.path for other in found[:index]):
            assert isinstance(node, Seq)
            findings.add(
                node.items[index],
                f"'{one.path}' has a repository already",
                ("repositories", index, "path"),
                code=Code.TWICE,
            )
    return tuple(found)


def checked_address(entries: Mapping[str, Node], findings: Findings, path: Path) -> str:
    """Return the address in a map with `git` and `ref`, and check both."""
    given, ref = entries.get("git"), entries.get("ref")
    if ref is not None:
        try:
            check_ref(text(ref))
        except ValueError as error:
            findings.add(ref, str(error), (*path, "ref"), code=Code.REPOSITORY)
    try:
        return parse_address(text(given)).url
    except ValueError as error:
        if given is not None:
            findings.add(given, str(error), (*path, "git"), code=Code.REPOSITORY)
        return ""


def files(node: Node | None, folder: str, findings: Findings) -> tuple[BuildFile, ...]:
    """Return the files and folders that a CDF copies into its image; `folder` is the experiment's."""
    found = []
    for index, item in enumerate(node.items if isinstance(node, Seq) else ()):
        entries = item.entries if isinstance(item, Map) else {}
        src, mode = entries.get("src"), text(entries.get("mode"))
        if isinstance(src, Scalar):
            source = paths.resolve(src, folder, findings, ("files", index, "src"), tree=True)
            found.append(BuildFile(source=source, dest=text(entries.get("dest")), mode=mode.zfill(4) if mode else ""))
    return tuple(found)


def lines(layer: Map) -> dict[str, int]:
    """Return the line of each build field that stands in this very file, not in one that it extends."""
    found: dict[str, int] = {}
    source = layer.source

    def note(node: Node, path: nodes.Path) -> None:
        if isinstance(node, Map):
            for key, value in node.entries.items():
                if node.keys[key].source is source:
                    found[nodes.dotted((*path, key))] = node.keys[key].line
                note(value, (*path, key))
        for index, item in enumerate(node.items if isinstance(node, Seq) else ()):
            if item.source is source:
                found[nodes.dotted((*path, index))] = item.line
            note(item, (*path, index))

    note(merging.select(layer, frozenset({*ORIGINS, *BUILDING, "environment", "platforms"})), ())
    return found
