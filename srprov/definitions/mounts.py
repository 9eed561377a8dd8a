"""`volumes`, `tmpfs` and `data` -> Mounts, in Compose's short and long form.

Takes the merged lists and the folder of the experiment; gives Mounts in the order written. Touches the file
system for looking: what a relative source names must exist below the experiment's folder. A CDF's volume gives way to
the EDF's at the same target; the same target twice in one file is a problem.
"""

from __future__ import annotations

import os
import posixpath
import re
from collections.abc import Iterator

from msgspec.structs import replace

from srprov import names
from srprov.codes import Code
from srprov.definitions import paths
from srprov.definitions.containermodel import TMPFS_OPTIONS, Mount
from srprov.definitions.values import scalars, text
from srprov.yamldoc import nodes
from srprov.yamldoc.fields import size_in_bytes
from srprov.yamldoc.nodes import Findings, Map, Node, Path, Scalar, Seq

_Read = tuple[Node, "Mount | None", Path]
"""Where it is written, what it says, and the way to it."""
_VOLUME_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*", re.ASCII)


def parse(
    volumes: Node | None, tmpfs: Node | None, data: Node | None, folder: str, findings: Findings, path: Path
) -> tuple[Mount, ...]:
    """Read every mount; what is wrong with one is added to the findings and leaves it out."""
    by_target: dict[str, tuple[Node, Mount]] = {}
    every = (
        *_volumes(volumes, folder, findings, path),
        *_tmpfs(tmpfs, findings, path),
        *_data(data, folder, findings, path),
    )
    for item, mount, at in every:
        if mount is None:
            continue
        earlier = by_target.pop(mount.target, None)
        if earlier is not None and earlier[0].source is item.source:
            first = earlier[0].line
            findings.add(item, f"'{mount.target}' is mounted twice; already on line {first}", at, code=Code.TWICE)
        by_target[mount.target] = (item, mount)
    return tuple(mount for _, mount in by_target.values())


def _volumes(node: Node | None, folder: str, findings: Findings, path: Path) -> Iterator[_Read]:
    path = (*path, "volumes")
    for item in node.items if isinstance(node, Seq) else ():
        mount = _long(item, folder, findings, path) if isinstance(item, Map) else _short(item, folder, findings, path)
        yield item, mount, path


def _tmpfs(node: Node | None, findings: Findings, path: Path) -> Iterator[_Read]:
    """Read `target[:options]`."""
    path = (*path, "tmpfs")
    for item in scalars(node):
        target, _, options = item.text.partition(":")
        mount = Mount(kind="tmpfs", source="", target=_target(item, target, findings, path), options=options)
        if not TMPFS_OPTIONS.fullmatch(options):
            findings.add(
                item,
                f"'{options[:60]}' are no options of a tmpfs",
                path,
                "such as size=64m,mode=1777",
                code=Code.VOLUME,
            )
        yield item, mount, path


def _data(node: Node | None, folder: str, findings: Findings, path: Path) -> Iterator[_Read]:
    """Read data sets: a file, or what is downloaded; a folder is shipped as a relative source of a volume is."""
    path = (*path, "data")
    for item in node.items if isinstance(node, Seq) else ():
        if not isinstance(item, Map):
            continue
        source, url, sha256 = item.entries.get("path"), text(item.entries.get("url")), text(item.entries.get("sha256"))
        target = _target(item, text(item.entries.get("target")), findings, path)
        if isinstance(source, Scalar) == bool(url):
            findings.add(item, "a data set has either 'path' or 'url'", path, code=Code.VOLUME)
        elif url and not sha256:
            findings.add(item, "what is downloaded needs its 'sha256'", path, code=Code.VOLUME)
        elif url:
            yield item, Mount(kind="data", source="", target=target, read_only=True, sha256=sha256, url=url), path
        elif isinstance(source, Scalar) and (real := paths.resolve(source, folder, findings, path)):
            if paths.is_closed(real):
                yield item, Mount(kind="tree", source=real, target=target, read_only=True), path
            elif os.path.isdir(real) and sha256:
                findings.add(
                    item,
                    f"'{source.text}' is a folder, and a sha256 is that of a file",
                    path,
                    "pack it, e.g. by tar",
                    code=Code.VOLUME,
                )
            elif os.path.isdir(real) and (real := paths.resolve(source, folder, findings, path, tree=True)):
                yield item, Mount(kind="tree", source=real, target=target, read_only=True), path
            elif not os.path.isdir(real):
                yield item, Mount(kind="data", source=real, target=target, read_only=True, sha256=sha256), path


def _short(item: Node, folder: str, findings: Findings, path: Path) -> Mount | None:
    parts = text(item).split(":")
    if len(parts) not in (2, 3) or not all(parts[:2]):
        findings.add(
            item,
            f"'{text(item)[:80]}' is not source:target[:ro]",
            path,
            "a volume needs a source and a target",
            code=Code.VOLUME,
        )
        return None
    modes = set(parts[2].split(",")) if len(parts) == 3 else set()
    if modes - {"ro", "rw"} or modes == {"ro", "rw"}:
        findings.add(item, f"'{parts[2][:40]}' is not a volume's mode", path, "known: ro, rw", code=Code.VOLUME)
        return None
    assert isinstance(item, Scalar)
    source = Scalar(item.source, item.line, item.column, parts[0])
    return _mount(source, parts[1], modes, folder, findings, path)


def _long(item: Map, folder: str, findings: Findings, path: Path) -> Mount | None:
    kind, target = text(item.entries.get("type")), text(item.entries.get("target"))
    source = item.entries.get("source")
    read_only = nodes.as_bool(item.entries["read_only"]) if "read_only" in item.entries else None
    modes = set() if read_only is None else {"ro" if read_only else "rw"}
    if kind == "tmpfs":
        if source is not None:
            findings.add(source, "a tmpfs has no source", path, code=Code.VOLUME)
        written = [*_tmpfs_options(item.entries.get("tmpfs"), findings, path), *(["ro"] if "ro" in modes else [])]
        where = _target(item, target, findings, path)
        return Mount(kind="tmpfs", source="", target=where, options=",".join(written))
    if "tmpfs" in item.entries:
        findings.add(item.keys["tmpfs"], "'tmpfs' is for a volume of that type", path, code=Code.VOLUME)
    if not isinstance(source, Scalar):
        findings.add(item, "the key 'source' is missing", path, code=Code.VOLUME)
        return None
    if kind == "bind" and "/" not in source.text:  # Compose reads a bind's source as a path in any case
        source = Scalar(source.source, source.line, source.column, f"./{source.text}")
    mount = _mount(source, target, modes, folder, findings, path)
    if mount is not None and (kind == "volume") != (mount.kind == "volume") and kind:
        findings.add(item, f"'{source.text}' is not the source of a {kind}", path, code=Code.VOLUME)
    options = item.entries.get("bind")
    if isinstance(options, Map):
        if mount is not None and mount.kind != "bind":
            findings.add(item.keys["bind"], "'bind' is for an absolute path of the robot", path, code=Code.VOLUME)
        make = options.entries.get("create_host_path")
        if mount is not None and isinstance(make, Scalar) and nodes.as_bool(make):
            mount = replace(mount, create_host_path=True)
    return mount


def _tmpfs_options(node: Node | None, findings: Findings, path: Path) -> Iterator[str]:
    """Return the long form's options as mount(8) writes them."""
    if not isinstance(node, Map):
        return
    if size := node.entries.get("size"):
        try:
            yield f"size={size_in_bytes(text(size))}"
        except ValueError as error:
            findings.add(size, str(error), (*path, "tmpfs", "size"), code=Code.VOLUME)
    if mode := text(node.entries.get("mode")):
        yield f"mode={mode}"


def _mount(source: Scalar, target: str, modes: set[str], folder: str, findings: Findings, path: Path) -> Mount | None:
    name, target = source.text, _target(source, target, findings, path)
    if name.startswith("/"):
        clean = posixpath.normpath("/" + name.lstrip("/"))  # POSIX keeps two slashes at the beginning
        return Mount(kind="bind", source=clean, target=target, read_only="ro" in modes)
    if name.startswith("~"):
        at_home = _at_home(source, findings, path)
        return Mount(kind="bind", source=at_home, target=target, read_only="ro" in modes) if at_home else None
    if "/" not in name and name not in (".", ".."):
        if not _VOLUME_NAME.fullmatch(name):
            findings.add(
                source,
                f"'{name[:60]}' is not a volume's name",
                path,
                "letters, digits, '.', '_' and '-'; or ./path",
                code=Code.VOLUME,
            )
        return Mount(kind="volume", source=name, target=target, read_only="ro" in modes)
    if "rw" in modes:
        findings.add(
            source,
            f"'{name}' is shipped to the robot and cannot be writable",
            path,
            "use a named volume for what is written",
            code=Code.VOLUME,
        )
    real = paths.resolve(source, folder, findings, path, tree=True)
    return Mount(kind="tree", source=real, target=target, read_only=True) if real else None


def _at_home(source: Scalar, findings: Findings, path: Path) -> str:
    """Return `~USER/…` in one spelling; whose home it is, is asked for where the robot is known."""
    user, _, below = source.text[1:].partition("/")
    if not names.valid("user", user):
        hint = "name the robot's user, as in ~robot/maps, or write an absolute path"
        findings.add(source, "a robot's home differs from the controller's", path, hint, code=Code.VOLUME)
        return ""
    if ".." in below.split("/"):
        findings.add(source, f"'{source.text[:80]}' leaves the home", path, "write an absolute path", code=Code.VOLUME)
        return ""
    return f"~{user}{posixpath.normpath('/' + below.lstrip('/')).rstrip('/')}"


def _target(node: Node, target: str, findings: Findings, path: Path) -> str:
    clean = "/" + posixpath.normpath(target).lstrip("/")
    if not target.startswith("/") or clean == "/":
        findings.add(node, f"'{target[:60]}' is not an absolute path below /", path, code=Code.VOLUME)
    return clean
