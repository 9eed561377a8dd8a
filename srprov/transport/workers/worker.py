"""The other process: it has connections with robots, and does what srprov calls it for.

Started by `processes.py` with one end of a socket pair. It decides nothing, prints nothing and reads no file but those
of SSH and the cache of layers. It ends when the other end of the pair does, however that came, and its connections
with it; the robots then end what ran there and free their locks. A signal for a terminal's programs does not reach it.
"""

from __future__ import annotations

import contextlib
import gc
import logging
import os
import socket
import sys
import threading
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, TextIO

from srprov.secret import Secret, Vault
from srprov.transport import ConnectOptions, connect, preload_ssh
from srprov.transport.blobs import Blobs
from srprov.transport.image_source import ImageSources
from srprov.transport.shell.lock_channel import HeartbeatChannel
from srprov.transport.workers.counting import CROWDED_S
from srprov.transport.workers.far_session import FarSession
from srprov.transport.workers.home_files import LinkedFiles
from srprov.transport.workers.link import ROOT, Link
from srprov.transport.workers.post import Post
from srprov.transport.workers.served import act

if TYPE_CHECKING:
    from srprov.definitions.model import Host
    from srprov.session import Session

_ALONE_S = 30.0
"""Without a word for so long a worker with locks ends: the other process is stopped, and holds robots for nothing."""
_CLOSING_S = 5.0


class Robots:
    """What the other process may call: the robots of this one."""

    def __init__(self, link: Callable[[Robots], Link], *, home: bool) -> None:
        """Begin without a connection; with `home`, what is not from a robot is on the other process's machine."""
        self.link = link(self)
        self.sessions: dict[str, Session] = {}
        self._vault = Vault()
        turns = _HomeTurns(self.link)
        blobs = Blobs(turns=turns)
        files = LinkedFiles(self.link, blobs, turns) if home else None
        self._shared = ConnectOptions(vault=self._vault, turns=turns, image_sources=ImageSources(blobs), home=files)

    def connect(self, host: Host, options: Mapping[str, Any]) -> Session:
        """Connect to a robot, also anew; see `srprov.transport.connect`."""
        from msgspec.structs import replace

        session = connect(host, options=replace(self._shared, **options), peers=self.peer)
        self.sessions[host.name] = session
        return session

    def lend(self, secrets: Mapping[str, Secret]) -> None:
        """Take secrets that a command will write."""
        self._vault.fill(Vault(secrets))

    def peer(self, host: str) -> Session:
        """Return the session of any robot; the other process knows who has it, and waits until it is connected."""
        handle = self.link.call(ROOT, "peer", host)
        return self.sessions[host] if handle is None else FarSession(self.link, handle, host)

    def alone(self, seconds: float) -> None:
        """End, when nothing was heard for so long and locks are held."""
        if seconds >= _ALONE_S and any(isinstance(one, HeartbeatChannel) for one in self.link.offered()):
            self.link.end("the other process is silent")

    def close(self) -> None:
        """End every connection."""
        for session in list(self.sessions.values()):
            session.close()


class _HomeTurns:
    """Turns that the other process gives, among all of its workers."""

    def __init__(self, link: Link) -> None:
        self._link = link

    @contextlib.contextmanager
    def turn(self, key: str) -> Iterator[None]:
        """Wait until nobody else gets this content."""
        self._link.call(ROOT, "take_turn", key)
        try:
            yield
        finally:
            self._link.call(ROOT, "give_turn", key)


def main(descriptor: int, *, home: bool) -> None:
    """Serve until the other process is gone, and end; `home` is as for `Robots`."""
    gc.set_threshold(100_000, 50, 100)  # as the program itself does
    sys.setswitchinterval(CROWDED_S)
    os.set_inheritable(descriptor, False)  # no program that is started here outlives this one with the socket
    post = Post(socket.socket(fileno=descriptor))
    robots = Robots(lambda root: Link(post, root, act, lambda _text: None), home=home)
    link = robots.link
    _log_there(link)
    for work in (preload_ssh, link.beat, lambda: link.watch(robots.alone)):
        threading.Thread(target=work, daemon=True).start()
    code = 1
    try:
        link.run()
        code = 0
    except Exception:
        link.tell_log(traceback.format_exc())
        post.flush(_CLOSING_S)
    finally:
        link.end("the other process is gone")
        closing = threading.Thread(target=robots.close, daemon=True)
        closing.start()
        closing.join(_CLOSING_S)
        os._exit(code)  # threads may wait for robots; their connections end here


def _log_there(link: Link) -> None:
    """Let warnings and what nobody caught be printed by the other process, which knows all secrets."""

    class There(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            link.tell_log(self.format(record))

    def uncaught(args: threading.ExceptHookArgs | sys.UnraisableHookArgs) -> None:
        link.tell_log("".join(traceback.format_exception(args.exc_type, args.exc_value, args.exc_traceback)))

    def warn(
        message: Warning | str, category: type[Warning], filename: str, lineno: int,
        file: TextIO | None = None, line: str | None = None,
    ) -> None:  # fmt: skip
        link.tell_log(f"{filename}:{lineno}: {category.__name__}: {message}")

    logging.lastResort = There(logging.WARNING)
    threading.excepthook = sys.unraisablehook = uncaught
    warnings.showwarning = warn
