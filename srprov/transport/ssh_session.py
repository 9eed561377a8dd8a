"""A robot over SSH: one connection for everything, its shell and its Docker Engine.

Takes a `Host`, returns a `Session`. The connection is a `StrictConnection` (`openssh/connection.py`); the shell runs on
one channel of it, the engine on up to four more.
"""

from __future__ import annotations

import secrets
import threading
from typing import TYPE_CHECKING

import paramiko

from srprov.definitions.model import Host
from srprov.errors import TransportError
from srprov.secret import Secret
from srprov.session import Traffic
from srprov.transport.background import background
from srprov.transport.deadline import Deadline
from srprov.transport.engine.link import EngineGone, EngineSocket
from srprov.transport.openssh.channel import MORE_SESSIONS, ChannelStreams, answer_sudo, complaint, start
from srprov.transport.openssh.connection import StrictConnection, open_connection
from srprov.transport.openssh.host_keys import fingerprint
from srprov.transport.session import BaseSession
from srprov.transport.shell.frames import FIND_CONNECTION, ready_line, start_command
from srprov.transport.shell.shell import Shell
from srprov.transport.shell.startup import wait_ready

if TYPE_CHECKING:
    from collections.abc import Callable
    from concurrent.futures import Future

    from srprov.transport.openssh.scripting import OpenConnection
    from srprov.transport.openssh.way import Way
    from srprov.transport.options import ConnectOptions, Peers

_SECOND_SHELL_S = 20.0
_LONGEST_NOISE = 1 << 20
_ENGINE_SOCKET = "/var/run/docker.sock"


class SshSession(BaseSession):
    """A `Session` over one SSH connection."""

    _find_connection = FIND_CONNECTION

    def __init__(
        self,
        host: Host,
        options: ConnectOptions,
        peers: Peers | None,
        shell: Shell,
        mark: str,
        connection: StrictConnection,
    ) -> None:
        """Take what `open` made."""
        super().__init__(host, options, peers, shell, mark)
        self.connection = connection
        self._proof = fingerprint(connection.transport.get_remote_server_key().asbytes())
        self._spare: Future[ChannelStreams] | None = None
        self._has_room = False
        self._docker_options = ""

    @classmethod
    def open(cls, host: Host, way: Way, options: ConnectOptions, peers: Peers | None = None) -> SshSession:
        """Connect by the way that was begun, and start the shell.

        Raises:
            TransportError: As `srprov.transport.connect`.
        """
        settings, deadline, traffic = way.settings, way.deadline, Traffic()
        connection = open_connection(way, traffic, options.attempts)
        try:
            mark = secrets.token_hex(16)
            channel, nonce = _start(connection, host, "sh", deadline, mark)
            streams = ChannelStreams(channel)
            session = cls(host, options, peers, Shell(host.name, streams, traffic), mark, connection)
            if options.warm_engine:
                threading.Thread(target=session.engine.reader.warm, name="warm engine", daemon=True).start()
            wait_ready(
                host.name, streams, nonce, deadline, user=settings.user, password=_sudo_password(connection, host)
            )
            traffic.connect_s = deadline.seconds - deadline.left()
        except BaseException:
            connection.close()
            raise
        return session

    @property
    def alive(self) -> bool:
        """Tell whether the connection still stands."""
        return self.connection.transport.is_active()

    def fabric(self) -> OpenConnection:
        """Return a `fabric.Connection` over this connection, for scripts: commands, files, port forwards."""
        from srprov.transport.openssh.scripting import OpenConnection

        return OpenConnection(self.connection)

    def prepare(self) -> None:
        """Start the lock's shell too, so that the lock costs one round trip when it is needed."""
        if not self._prepared and self._lock_channel is None:
            self._spare = background(self._start_shell)
        super().prepare()

    def _dial_reads(self, seconds: float) -> EngineSocket:
        """Let sshd itself connect to the engine's socket: the docker CLI takes 15 ms of a desktop's CPU to start.

        A user who may not open the socket, an sshd that does not forward streams, or an engine elsewhere:
        `docker system dial-stdio` finds its way.
        """
        deadline = Deadline(seconds)
        room = background(lambda: self._room(seconds)) if not self._has_room else None
        stream = self._open_stream(seconds)
        if refused := room.result() if room else "":
            if stream is not None:
                stream.abort()
            raise EngineGone(refused)
        self._has_room = True
        if stream is not None:
            self._docker_options = f"-H unix://{_ENGINE_SOCKET} "  # what was read is changed, whatever DOCKER_HOST says
        return stream or self._dial_client(deadline)

    def _dial_changes(self, seconds: float) -> EngineSocket:
        """Open a stream that may change something, which must end with the session's lock.

        The lock's script ends processes. So the stream may be sshd's own where sshd's process was found; otherwise it
        needs a process.
        """
        deadline = Deadline(seconds)
        ended_by_lock = self._docker_options and self._lock_channel is not None and self._lock_channel.sshd_pid
        return (self._open_stream(seconds) if ended_by_lock else None) or self._dial_client(deadline)

    def _open_stream(self, seconds: float) -> EngineSocket | None:
        """Let sshd connect to the engine's socket; None when it does not."""
        try:
            channel = self.connection.transport.open_local_stream(_ENGINE_SOCKET, seconds)
        except paramiko.SSHException as error:
            raise EngineGone(f"sshd opens no stream to the engine: {error}") from error
        return None if channel is None else _engine_socket(channel, lambda: "")

    def _room(self, seconds: float) -> str:
        """Say why sshd opens no second session, or nothing: streams do not count, but a lock's shell does.

        Without this a robot that can be looked at, and not be changed, would be given services.
        """
        try:
            self.connection.transport.open_session(timeout=seconds).close()
        except paramiko.SSHException as error:
            # a ChannelException, unless the thread that opens the stream was given paramiko's only reason
            return f"sshd opens no session: {getattr(error, 'text', error)}; {MORE_SESSIONS}"
        return ""

    def _dial_client(self, deadline: Deadline) -> EngineSocket:
        """Start `docker system dial-stdio` on a channel of its own, and skip what a `.bashrc` prints before it."""
        command = f"docker {self._docker_options}system dial-stdio"
        try:
            channel, nonce = _start(self.connection, self._robot, command, deadline, self._mark)
        except TransportError as error:
            raise EngineGone(f"{error.message}; {error.hint}") from error
        try:
            if password := _sudo_password(self.connection, self._robot):
                answer_sudo(channel, nonce, password, deadline)
            seen = bytearray()
            while not seen.endswith(ready_line(nonce)):
                channel.settimeout(deadline.left(0.001))
                # The engine speaks only when spoken to, so nothing can follow the mark.
                if not (piece := channel.recv(4096)):
                    raise EngineGone(complaint(channel) or "no way to run docker on the robot")
                seen += piece
                if len(seen) > _LONGEST_NOISE:
                    raise EngineGone(f"the login printed more than {_LONGEST_NOISE >> 10} KiB before docker began")
        except BaseException:
            channel.close()
            raise
        return _engine_socket(channel, lambda: complaint(channel))

    def _second_shell(self) -> ChannelStreams:
        """Return the spare shell, or start one."""
        spare, self._spare = self._spare, None
        return spare.result() if spare else self._start_shell()

    def _start_shell(self) -> ChannelStreams:
        """Start `sh` on a channel of its own."""
        deadline = Deadline(_SECOND_SHELL_S)
        channel, nonce = _start(self.connection, self._robot, "sh", deadline)
        streams = ChannelStreams(channel)
        user, password = self.connection.settings.user, _sudo_password(self.connection, self._robot)
        wait_ready(self.host, streams, nonce, deadline, user=user, password=password)
        return streams

    def _close_connection(self) -> None:
        """End the SSH connection."""
        self.connection.close()


def _start(
    connection: StrictConnection, host: Host, then: str, deadline: Deadline, mark: str = ""
) -> tuple[paramiko.Channel, str]:
    """Start a command as root; return its channel and the nonce that tells when it is ready."""
    nonce = secrets.token_hex(16)
    root, ask = _is_root(connection), _sudo_password(connection, host) is not None
    return start(connection, start_command(nonce, then, root=root, mark=mark, ask=ask), deadline), nonce


def _is_root(connection: StrictConnection) -> bool:
    return connection.settings.user == "root"


def _sudo_password(connection: StrictConnection, host: Host) -> Secret | None:
    """Return what sudo is told. Root needs none: what asks there is not sudo, and the password is another robot's."""
    return None if _is_root(connection) else host.become_password


def _engine_socket(channel: paramiko.Channel, reason: Callable[[], str]) -> EngineSocket:
    """Return a channel to an engine as HTTP wants it."""

    def waiting() -> bool:
        return bool(channel.recv_ready() or channel.eof_received or channel.closed)

    return EngineSocket(channel, reason, waiting)
