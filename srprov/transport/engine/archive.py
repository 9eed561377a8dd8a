"""Files of a container, over its engine's archive API: what is at a path, a path as a tar, a tar into a folder.

Takes an `Engine`; gives values and bytes. The container need not run.

Source: Docker Engine API 1.41, "Get information about files in a container" and the two after it.
"""

from __future__ import annotations

import base64
import binascii
import itertools
from collections.abc import Iterator

from srprov.container_files import InContainer
from srprov.transport.container_tar import BEGIN
from srprov.transport.engine.client import Engine, Refused
from srprov.transport.engine.link import EngineGone, WaitInAll
from srprov.untrusted import integer, json_or_none, mapping, string

_WAIT_S = 60.0
_NOT_FOUND = 404
_UNSEEN = "an engine sees files of the image, of volumes and what was written since, no tmpfs, /proc, /sys or /dev"
_FOLDER, _LINK = 1 << 31, 1 << 27
_KIND = _FOLDER | _LINK | 1 << 26 | 1 << 25 | 1 << 24 | 1 << 21 | 1 << 19
"""Bits of Go's `fs.FileMode` that a plain file has none of."""


class EngineFiles:
    """A `ContainerFiles` of one engine."""

    def __init__(self, engine: Engine) -> None:
        """Take it."""
        self._engine = engine

    def path_in(self, container: str, path: str) -> InContainer | None:
        """Say what is at a path; see `ContainerFiles.path_in`."""
        with (
            self._engine.or_error(f"{path} cannot be looked at", _UNSEEN, f"{path} cannot be looked at", _WAIT_S),
            self._engine.opened(_WAIT_S) as client,
        ):
            try:
                answer = client.send_call("HEAD", _place(container), params={"path": path})
            except Refused as refused:
                if refused.status == _NOT_FOUND:
                    return None
                raise EngineGone(refused.message or f"the engine answers with status {refused.status}") from None
            return _said(answer.headers.get("X-Docker-Container-Path-Stat", ""))

    def copy_out(self, container: str, path: str) -> Iterator[bytes]:
        """Yield a path as a tar; see `ContainerFiles.copy_out`."""
        wait = (_WAIT_S, WaitInAll(_WAIT_S))
        with (
            self._engine.or_error(f"{path} cannot be read", _UNSEEN, f"of {path} not all came", _WAIT_S),
            self._engine.opened(_WAIT_S) as client,
        ):
            client.send_call("GET", _place(container), params={"path": path}, timeout=wait)
            yield from client.pieces()

    def copy_into(self, container: str, folder: str, tar: Iterator[bytes]) -> None:
        """Unpack a tar in a folder; see `ContainerFiles.copy_into`."""
        params, headers = {"path": folder, "noOverwriteDirNonDir": "true"}, {"Content-Type": "application/x-tar"}
        wait = WaitInAll(_WAIT_S)
        with (
            self._engine.or_error(f"{folder} cannot be written", _UNSEEN, f"{folder} did not get all", _WAIT_S),
            self._engine.opened(_WAIT_S) as client,
        ):
            data = itertools.chain([BEGIN], tar)
            client.send_call("PUT", _place(container), params=params, data=data, headers=headers, timeout=wait)


def _place(container: str) -> str:
    return f"/containers/{container}/archive"


def _said(header: str) -> InContainer:
    """Read what an engine says of a path; raises EngineGone when that has no form."""
    try:
        found = mapping(json_or_none(base64.b64decode(header, validate=True).decode("utf-8")))
    except (binascii.Error, ValueError):
        found = {}
    mode = integer(found.get("mode"), low=-1, default=-1)
    if mode < 0:
        raise EngineGone("what the engine says of it has no form")
    return InContainer(
        is_folder=bool(mode & _FOLDER),
        is_file=not mode & _KIND,
        size=integer(found.get("size")),
        link=string(found.get("linkTarget")) if mode & _LINK else "",
    )
