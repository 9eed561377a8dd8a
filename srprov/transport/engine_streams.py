"""What a session passes on to its robot's engine as it is: images, commands, logs and files of containers.

`BaseSession` (`session.py`) is made of it. Each method is explained in `srprov.session.Session`.
"""

from __future__ import annotations

import abc
from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from srprov.container_files import ContainerFiles, InContainer
    from srprov.session import ContainerCommand, Exec, Streams
    from srprov.transport.engine import EngineAccess
    from srprov.wire import AnyQuery, Reply


class EngineStreams(abc.ABC):
    """The part of a session that needs little but its engine."""

    engine: EngineAccess

    @property
    @abc.abstractmethod
    def host(self) -> str:
        """The robot's name in the inventory."""

    @property
    @abc.abstractmethod
    def holds_lock(self) -> bool:
        """Whether this session holds the robot's lock."""

    @abc.abstractmethod
    def ask(self, queries: Sequence[AnyQuery]) -> Sequence[Reply]:
        """Ask shell and engine; see `session.Reader`."""

    @abc.abstractmethod
    def open_shell(self, script: str) -> Streams:
        """Run a script in a shell of its own; see `session.Session`."""

    def save_image(self, image: str, timeout_s: float) -> Iterator[bytes]:
        """Stream the image as `docker save` writes it.

        Raises:
            TransportError: The engine does not have it, or went away.
        """
        return self.engine.client.save(image, timeout_s)

    def run_in(self, container: str, what: Exec) -> ContainerCommand:
        """Start a command in a running container."""
        return self.engine.attach(container, what)

    def container_log(
        self, container: str, *, tail: int, follow: bool, times: bool = False, since: str = ""
    ) -> Iterator[str]:
        """Return a container's log line by line.

        Raises:
            TransportError: The engine or the robot cannot be talked to any more.
        """
        return self.engine.client.log(container, tail=tail, follow=follow, times=times, since=since)

    def path_in(self, container: str, path: str) -> InContainer | None:
        """Say what is at a path of a container."""
        return self._files(container).path_in(container, path)

    def copy_out(self, container: str, path: str) -> Iterator[bytes]:
        """Yield a path of a container as a tar."""
        return self._files(container).copy_out(container, path)

    def copy_into(self, container: str, folder: str, tar: Iterator[bytes]) -> None:
        """Unpack a tar in a folder of a container."""
        from srprov.transport.container_tar import begun

        # whoever makes the tar may take his time, and the container be started meanwhile: its way is chosen after that
        tar = begun(tar)
        self._files(container).copy_into(container, folder, tar)

    def _files(self, container: str) -> ContainerFiles:
        """Return the way to a container's files that no container turns."""
        from srprov.transport.container_folders import files_of
        from srprov.transport.engine.archive import EngineFiles

        return files_of(self, container, EngineFiles(self.engine.client))
