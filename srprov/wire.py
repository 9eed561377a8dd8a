"""What may travel to a robot, as data.

A `Query` or `EngineQuery` reads; a `Run`, `Put`, `EngineCall`, `CopyImage`, `CopyVolume` or `SendData` changes. They
are plain values, to print, compare, store and send later; `session.py` has the protocols that carry them. Every shell
word passes through `quote`.
"""

from __future__ import annotations

import base64
import shlex
from typing import Any

import msgspec
from msgspec.structs import replace

from srprov.hashing import sha256_of
from srprov.untrusted import json_or_none

_SHORT = 8 << 10
"""Bytes that are written as one word of a shell."""
STOP_MARGIN_S = 60.0
"""How much longer the answer to a stop may take than the process has to end by itself."""


def quote(word: str) -> str:
    """Return one POSIX shell word for any text.

    Raises:
        ValueError: The text holds a NUL byte, which no shell word can.
    """
    if "\0" in word:
        raise ValueError("a shell word cannot hold a NUL byte")
    return shlex.quote(word)


def printed(text: str) -> str:
    """Return the command that prints text. No here-document: bash may keep one in a file below /tmp."""
    return f"printf %s {quote(text)}"


def sh(*words: str) -> str:
    """Return one shell command of quoted words: `sh("ip", "link", "show", name)`."""
    return " ".join(quote(word) for word in words)


class Query(msgspec.Struct, frozen=True, kw_only=True):
    """A shell command that only reads; many are sent in one round trip.

    With `in_place` the robot's shell runs it itself, without a process of its own for it: a constant of ours that
    neither ends the shell, nor goes to another folder, nor changes its words and options.
    """

    command: str
    timeout_s: float = 20.0
    in_place: bool = False


class EngineQuery(msgspec.Struct, frozen=True, kw_only=True):
    """A GET to the robot's Docker Engine. `params` become the query string; dicts in it become JSON."""

    path: str
    params: tuple[tuple[str, str], ...] = ()
    timeout_s: float = 20.0
    headers: bool = False
    """The answer's headers are wanted, not its body: JSON, names in lower case."""


class Run(msgspec.Struct, frozen=True, kw_only=True):
    """A shell script that changes the robot. Every word in it went through `quote`."""

    script: str
    timeout_s: float = 60.0
    in_place: bool = False
    """As for `Query`; what it opens stays open in the robot's shell."""

    def text(self) -> str:
        """Show it as the plan does."""
        return self.script


class Put(msgspec.Struct, frozen=True, kw_only=True):
    """Write a file. `in_place` keeps the inode, so that a bind mount of the file sees the new content.

    With `secret`, the content is a placeholder: that secret's value, which only the transport's last step knows.
    """

    path: str
    content: bytes = b""
    mode: int = 0o644
    in_place: bool = False
    secret: str = ""
    timeout_s: float = 60.0

    def digest(self) -> str:
        """Return the content's sha256 in hex; of a secret there is none."""
        return "" if self.secret else sha256_of(self.content)

    def text(self) -> str:
        """Show it as the plan does: never the content, which may be long."""
        how = "rewrite" if self.in_place else "write"
        if self.secret:
            return f"{how} {self.path} (<secret {self.secret}>, mode {self.mode:04o})"
        return f"{how} {self.path} ({len(self.content)} bytes, mode {self.mode:04o}, sha256 {self.digest()[:12]})"

    def script(self, source: str = "") -> str:
        """Return the shell script that does it: by base64, of the content or of what `source` prints.

        Short text that everybody may read is written by the shell itself, which needs no process but `mv`.
        """
        target, partial = quote(self.path), quote(self.path + ".part")
        move = f"cat {partial} > {target} && rm -f {partial}" if self.in_place else f"mv -f {partial} {target}"
        mode, folder = f"chmod {self.mode:04o}", quote(self.path.rsplit("/", 1)[0] or "/")
        last = f"{mode} {partial} && {move}" + (f" && {mode} {target}" if self.in_place else "")
        begin = f"umask 077; {{ [ -d {folder} ] || mkdir -p {folder}; }}"
        if not source and self._is_plain:
            new = f"{{ [ ! -e {partial} ] || rm -f {partial}; }} && umask 022"
            return f"{begin} && {new} && {printed(self.content.decode())} > {partial} && mv -f {partial} {target}"
        source = source or printed(base64.encodebytes(self.content).decode("ascii"))
        return f"{begin} && {source} | base64 -d > {partial} && {last}"

    @property
    def _is_plain(self) -> bool:
        if self.mode != 0o644 or self.in_place or len(self.content) > _SHORT or b"\0" in self.content:
            return False
        try:
            self.content.decode()
        except UnicodeDecodeError:
            return False
        return True


class EngineCall(msgspec.Struct, frozen=True, kw_only=True):
    """A request that changes the robot's Docker Engine, addressed by name, sent through the docker SDK.

    `body` is canonical JSON text, or empty; `blob` is a raw body (a build context). `accept` lists the statuses that
    are fine. `stream` says that the answer is a progress stream of JSON lines in which an `error` line is a failure.
    """

    method: str
    path: str
    params: tuple[tuple[str, str], ...] = ()
    body: str = ""
    blob: bytes = b""
    accept: tuple[int, ...] = (200, 201, 204, 304)
    stream: bool = False
    timeout_s: float = 120.0

    def text(self) -> str:
        """Show it as the plan does."""
        query = "&".join(f"{key}={value}" for key, value in self.params)
        parts = [self.method, self.path + (f"?{query}" if query else "")]
        if self.body:
            parts.append(self.body)
        if self.blob:
            parts.append(f"<{len(self.blob)} bytes, sha256 {sha256_of(self.blob)[:12]}>")
        return " ".join(parts)

    @property
    def stop_grace_s(self) -> float | None:
        """Return the seconds that a stop gives the process to end by itself; None for any other call."""
        return self.timeout_s - STOP_MARGIN_S if self.path.endswith("/stop") else None

    def stopping_within(self, seconds: float) -> EngineCall:
        """Return a stop in which the engine kills the process after so many seconds at the latest; else itself."""
        grace = self.stop_grace_s
        if grace is None:
            return self
        least = round(max(0.0, min(grace, seconds)))
        return replace(self, params=(("t", str(least)),), timeout_s=least + STOP_MARGIN_S)


class CopyImage(msgspec.Struct, frozen=True, kw_only=True):
    """Bring an image from another robot's engine over the controller: the layers that are missing here, or all."""

    image: str
    source_host: str
    """Empty: it comes from the controller's own cache of layers, and its id is its configuration's digest."""
    id: str = ""
    """Its id on that robot; another one is not loaded. Empty: what that robot built just now."""
    way: str = ""
    """`thin`, `registry` or `whole`; empty: as the robot's store has it, and whole where that is not possible."""
    base: str = ""
    """The image that it was built on; its layers need not come from that robot where this one has it by that name."""
    runs: tuple[str, ...] = ()
    """Architectures that the robot runs: an image for another one is not loaded. Empty: any."""
    timeout_s: float = 1800.0

    def text(self) -> str:
        """Show it as the plan does."""
        how = {"thin": "the layers that are missing", "whole": "docker save | docker load",
               "registry": "pulled through a port that sshd forwards"}  # fmt: skip
        kind = how.get(self.way, "the layers that are missing, or whole")
        source, over = self.source_host or "the controller's cache", ", over the controller" * bool(self.source_host)
        return f"copy image {self.image} from {source} ({kind}{over})"


class CopyVolume(msgspec.Struct, frozen=True, kw_only=True):
    """Bring a volume's data from another robot into a volume that is here, streamed through the controller.

    It succeeds when both have the same hash: of names, contents, owners, modes, times, links and extended attributes.
    """

    volume: str
    into: str
    source_host: str
    timeout_s: float = 4 * 3600.0

    def text(self) -> str:
        """Show it as the plan does."""
        return f"copy volume {self.volume} from {self.source_host} into {self.into} (tar over the controller, sha256)"


DATA_STORE = "/var/lib/srprov/.data"
"""Where robots have data sets: `<sha256>/data`. No instance can have that name."""


class SendData(msgspec.Struct, frozen=True, kw_only=True):
    """Bring a data set to a robot, from a file of this machine that has the hash, or else from its address.

    It succeeds when the robot's own hash of what is there is the same.
    """

    sha256: str
    url: str = ""
    timeout_s: float = 8 * 3600.0

    def text(self) -> str:
        """Show it as the plan does."""
        source = f", downloaded here from {self.url}" if self.url else ""
        return f"send the data set {self.sha256} to {DATA_STORE}/{self.sha256}/data{source}"


Copy = CopyImage | CopyVolume | SendData
Command = Run | Put | EngineCall | Copy
AnyQuery = Query | EngineQuery


class Reply(msgspec.Struct, frozen=True, kw_only=True):
    """What came back. `status` is an exit code for the shell and an HTTP status for the engine (0: no engine there)."""

    status: int
    out: str = ""
    err: str = ""
    ok: bool = True

    def json(self) -> Any:  # noqa: ANN401 - JSON is any; each parser checks the shape that it needs
        """Return the body as JSON; an empty, broken or hostile one is None."""
        return json_or_none(self.out)
