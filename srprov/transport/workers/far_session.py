"""A session whose robot another process is connected to: each call goes there and back.

What it raises is what a session here would raise; when the other process is gone, that is a TransportError, as when a
connection is.
"""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Iterator, Sequence
from typing import Any, cast

from srprov.container_files import InContainer
from srprov.errors import TransportError
from srprov.secret import Vault
from srprov.session import Exec, Measures, Progress, Pulse, Traffic, no_progress
from srprov.transport.workers.far import QUICK_S, Far, FarCommand, FarItems, FarLockChannel, FarStreams, lost
from srprov.transport.workers.flow import Flow
from srprov.transport.workers.link import ROOT, Link, LinkLost
from srprov.transport.workers.sealed import Handle
from srprov.wire import AnyQuery, Command, Put, Reply, Run


class FarSession(Far):
    """A `Session` whose connection another process has."""

    def __init__(self, link: Link, handle: Handle, host: str, vault: Vault | None = None) -> None:
        """Take where it is, and the secrets that are written there."""
        super().__init__(link, handle, host)
        self._vault, self._traffic = vault or Vault(), Traffic()

    @property
    def host(self) -> str:
        """The robot's name in the inventory."""
        return self._host

    @functools.cached_property
    def identity(self) -> str:
        """Its name, and what it proved to be to the other process."""
        return cast(str, self._call("identity"))

    @property
    def traffic(self) -> Traffic:
        """What was used so far; what was known last, once the other process is gone."""
        with contextlib.suppress(TransportError):
            self._traffic = self._call("traffic")
        return self._traffic

    def ask(self, queries: Sequence[AnyQuery]) -> Sequence[Reply]:
        """Ask shell and engine at the same time, each in one round trip."""
        return cast("Sequence[Reply]", self._call("ask", queries))

    def measure(self) -> Measures | None:
        """Return load and memory when that needs no shell, else None."""
        return cast("Measures | None", self._call("measure"))

    def execute(self, command: Command, progress: Progress = no_progress) -> Reply:
        """Do one thing and wait for its end."""
        self._lend([command])
        return cast(Reply, self._call("execute", command, progress=progress))

    def execute_all(self, commands: Sequence[Run | Put]) -> Sequence[Reply]:
        """Do several short things in one round trip."""
        self._lend(commands)
        return cast("Sequence[Reply]", self._call("execute_all", commands))

    def open_lock_channel(self, script: str, words: Sequence[str], pulse: Pulse) -> FarLockChannel:
        """Run a script in a second shell, and keep it alive by a heartbeat."""
        handle, first = self._call("open_lock_channel", script, words, pulse)
        return FarLockChannel(self._link, handle, self._host, first)

    def save_image(self, image: str, timeout_s: float) -> Iterator[bytes]:
        """Stream the image as `docker save` writes it."""
        return self._items("save_image", image, timeout_s)

    def open_shell(self, script: str) -> FarStreams:
        """Run a script in a shell of its own."""
        return FarStreams(self._link, self._call("open_shell", script), self._host)

    def run_in(self, container: str, what: Exec) -> FarCommand:
        """Start a command in a running container."""
        return FarCommand(self._link, self._call("run_in", container, what), self._host)

    def container_log(
        self, container: str, *, tail: int, follow: bool, times: bool = False, since: str = ""
    ) -> Iterator[str]:
        """Return a container's log line by line."""
        return self._items("container_log", container, tail=tail, follow=follow, times=times, since=since)

    def path_in(self, container: str, path: str) -> InContainer | None:
        """Say what is at a path of a container."""
        return cast("InContainer | None", self._call("path_in", container, path))

    def copy_out(self, container: str, path: str) -> Iterator[bytes]:
        """Yield a path of a container as a tar."""
        return self._items("copy_out", container, path)

    def copy_into(self, container: str, folder: str, tar: Iterator[bytes]) -> None:
        """Unpack a tar in a folder of a container."""
        given = self._link.export(Flow(tar))
        try:
            self._call("copy_into", container, folder, given)
        finally:
            self._link.forget(given)

    def prepare(self) -> None:
        """Get ready to change something; who uses a session that is gone is told so then."""
        with contextlib.suppress(TransportError):
            self._call("prepare")

    def close(self) -> None:
        """End the connection; safe to call twice."""
        with contextlib.suppress(TransportError):
            self._call("close")

    def _items(self, method: str, *words: Any, **named: Any) -> Iterator[Any]:  # noqa: ANN401 - of any method
        return iter(FarItems(self._link, self._call(method, *words, **named), self._host))

    def _lend(self, commands: Sequence[Command]) -> None:
        """Give the other process the secrets that these commands write, and no others."""
        names = {one.secret for one in commands if isinstance(one, Put) and one.secret in self._vault}
        if names:
            try:
                self._link.call(ROOT, "lend", {name: self._vault[name] for name in sorted(names)}, limit_s=QUICK_S)
            except LinkLost as error:
                raise lost(self._host, error) from None
