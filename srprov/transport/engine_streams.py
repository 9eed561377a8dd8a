"""What a session passes on to its robot's engine as it is: images, commands, logs and files of containers.

`BaseSession` (`session.py`) is made of it. Each method is explained in `srprov.session.Session`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from srprov.container_files import InContainer
    from srprov.session import ContainerCommand, Exec
    from srprov.transport.engine import EngineAccess


class EngineStreams:
    """The part of a session that needs nothing but its engine."""

    engine: EngineAccess

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
        from srprov.transport.engine import archive

        return archive.path_in(self.engine.client, container, path)

    def copy_out(self, container: str, path: str) -> Iterator[bytes]:
        """Yield a path of a container as a tar."""
        from srprov.transport.engine import archive

        return archive.copy_out(self.engine.client, container, path)

    def copy_into(self, container: str, folder: str, tar: Iterator[bytes]) -> None:
        """Unpack a tar in a folder of a container."""
        from srprov.transport.engine import archive

        archive.copy_into(self.engine.client, container, folder, tar)
