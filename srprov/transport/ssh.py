"""A robot over SSH: one connection for everything, its shell and its Docker Engine.

Takes a `Host`, gives a `Session`. The connection is a `StrictConnection` (`connection.py`); the shell runs on one
channel of it, the engine on up to four more.
"""

from __future__ import annotations

import secrets
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

import paramiko

from srprov.definitions.model import Host
from srprov.errors import ConnectError, DeadlineError, TransportError
from srprov.transport.background import Background
from srprov.transport.channel import ChannelStreams, answer_sudo, complaint
from srprov.transport.connection import StrictConnection, guard, open_connection
from srprov.transport.deadline import Deadline
from srprov.transport.frames import FIND_LINE, ready_line, start_command
from srprov.transport.options import settle
from srprov.transport.session import BaseSession
from srprov.transport.shell import Shell
from srprov.wire import Traffic

if TYPE_CHECKING:
    from srprov.transport import ConnectOptions, Peers
    from srprov.transport.ahead import Dialled
    from srprov.transport.engine_stream import EngineSocket
    from srprov.transport.scripting import OpenConnection

_BESIDE_S = 20.0
_ENGINE_SOCKET = "/var/run/docker.sock"
_MORE_SESSIONS = "raise MaxSessions to 6 or more"


def start(connection: StrictConnection, command: str, deadline: Deadline) -> paramiko.Channel:
    """Run a command on a new channel.

    Raises:
        ConnectError: sshd opens no more channels (MaxSessions), or the connection died.
        DeadlineError: It did not answer in time.
    """
    name = connection.settings.name
    timer = guard(connection.transport, deadline)
    try:
        channel: paramiko.Channel = connection.transport.open_session(timeout=deadline.left(0.05))
        channel.exec_command(command)
    except paramiko.ChannelException as error:
        raise ConnectError(name, f"sshd opens no session: {error.text}", hint=_MORE_SESSIONS) from None
    except (paramiko.SSHException, OSError, EOFError) as error:
        if deadline.passed:
            raise DeadlineError(
                name, f"sshd opened no session within {deadline.seconds:g} s", hint="is the robot overloaded?"
            ) from None
        raise ConnectError(name, f"sshd opens no session: {error}", hint=_MORE_SESSIONS) from None
    finally:
        timer.cancel()
    return channel


class SshSession(BaseSession):
    """A `Session` over one SSH connection."""

    _find_line = FIND_LINE

    def __init__(
        self, host: str, connection: StrictConnection, shell: Shell, traffic: Traffic, peers: Peers | None, mark: str
    ) -> None:
        """Take what `open` made."""
        super().__init__(host, shell, traffic, peers, mark)
        self.connection = connection
        self._spare: Background[ChannelStreams] | None = None
        self._has_room = False
        self._where = ""

    @classmethod
    def open(
        cls, host: Host, options: ConnectOptions, peers: Peers | None = None, ahead: Dialled | None = None
    ) -> SshSession:
        """Connect and start the shell.

        Raises:
            TransportError: As `srprov.transport.connect`.
        """
        traffic = Traffic()
        settings = settle(host, ssh_config=options.ssh_config)
        dialled = ahead.fitting(settings) if ahead else None
        seconds = settings.connect_timeout_s or options.connect_timeout_s
        deadline = ahead.deadline if ahead and dialled else Deadline(seconds)
        connection = open_connection(settings, deadline, traffic, options.attempts, dialled)
        try:
            nonce, mark = secrets.token_hex(16), secrets.token_hex(16)
            become = host.become_password
            command = start_command(nonce, "sh", root=settings.user == "root", mark=mark, ask=become is not None)
            channel = start(connection, command, deadline)
            shell = Shell(host.name, ChannelStreams(channel), traffic, user=settings.user, password=become)
            session = cls(host.name, connection, shell, traffic, peers, mark)
            session._become = become
            if options.warm_engine:
                threading.Thread(target=session.reader.warm, name="warm engine", daemon=True).start()
            shell.wait_ready(nonce, deadline)
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
        """Give a `fabric.Connection` over this connection, for scripts: commands, files, port forwards."""
        from srprov.transport.scripting import OpenConnection

        return OpenConnection(self.connection)

    def prepare(self) -> None:
        """Start the hold's shell too, so that the hold costs one round trip when it is needed."""
        if not self._prepared and self._hold is None:
            self._spare = Background(self._second_shell)
        super().prepare()

    def _dial_reads(self, seconds: float) -> EngineSocket:
        """Let sshd itself connect to the engine's socket: the docker CLI takes 15 ms of a desktop's CPU to start.

        A user who may not open the socket, an sshd that does not forward streams, or an engine elsewhere:
        `docker system dial-stdio` finds its way.
        """
        from srprov.transport.engine_stream import EngineGone

        deadline = Deadline(seconds)
        room = Background(lambda: self._room(seconds)) if not self._has_room else None
        try:
            channel = self.connection.transport.open_local_stream(_ENGINE_SOCKET, seconds)
            refused = room.result() if room else ""
        except paramiko.SSHException as error:
            raise EngineGone(f"sshd opens no stream to the engine: {error}") from error
        if refused:
            if channel is not None:
                channel.close()
            raise EngineGone(refused)
        self._has_room = True
        if channel is None:
            return self._dial_client(deadline)
        self._where = f"-H unix://{_ENGINE_SOCKET} "  # what is changed is what was read, whatever DOCKER_HOST says
        return _stream(channel, lambda: "")

    def _room(self, seconds: float) -> str:
        """Say why sshd opens no session beside the shell's, or nothing: streams do not count, but a lock's shell does.

        Without this a robot that can be looked at, and not be changed, would be given services.
        """
        try:
            self.connection.transport.open_session(timeout=seconds).close()
        except paramiko.SSHException as error:
            if not self.alive:
                raise
            # a ChannelException, unless the thread that opens the stream was given paramiko's only reason
            return f"sshd opens no session: {getattr(error, 'text', error)}; {_MORE_SESSIONS}"
        return ""

    def _dial_engine(self, seconds: float) -> EngineSocket:
        """Open a stream that may change something, which must end with the session's lock.

        Beside a hold, whose script ends processes, it may be sshd's own, if sshd's process was found; else it gets one.
        """
        from srprov.transport.engine_stream import EngineGone

        deadline = Deadline(seconds)
        if self._where and self._hold is not None and self._hold.line:
            try:
                channel = self.connection.transport.open_local_stream(_ENGINE_SOCKET, seconds)
            except paramiko.SSHException as error:
                raise EngineGone(f"sshd opens no stream to the engine: {error}") from error
            if channel is not None:
                return _stream(channel, lambda: "")
        return self._dial_client(deadline)

    def _dial_client(self, deadline: Deadline) -> EngineSocket:
        """Start `docker system dial-stdio` on a channel of its own, and skip what a `.bashrc` prints before it."""
        from srprov.transport.engine_stream import EngineGone

        nonce = secrets.token_hex(16)
        root = self.connection.settings.user == "root"
        ask = self._become is not None
        command = start_command(nonce, f"docker {self._where}system dial-stdio", root=root, mark=self._mark, ask=ask)
        try:
            channel = start(self.connection, command, deadline)
        except TransportError as error:
            raise EngineGone(f"{error.message}; {error.hint}") from error
        seen, mark = bytearray(), ready_line(nonce)
        try:
            if self._become:
                answer_sudo(channel, nonce, self._become, deadline)
            while not seen.endswith(mark):
                channel.settimeout(deadline.left(0.001))
                # The engine speaks only when spoken to, so nothing can follow the mark.
                if not (piece := channel.recv(4096)):
                    raise EngineGone(complaint(channel) or "no way to run docker on the robot")
                seen += piece
        except BaseException:
            channel.close()
            raise

        return _stream(channel, lambda: complaint(channel))

    def _beside(self) -> ChannelStreams:
        """Give the spare shell, or start one."""
        spare, self._spare = self._spare, None
        return spare.result() if spare else self._second_shell()

    def _second_shell(self) -> ChannelStreams:
        """Start `sh` on a channel of its own."""
        settings, deadline, nonce = self.connection.settings, Deadline(_BESIDE_S), secrets.token_hex(16)
        command = start_command(nonce, "sh", root=settings.user == "root", ask=self._become is not None)
        streams = ChannelStreams(start(self.connection, command, deadline))
        shell = Shell(self._host, streams, self._traffic, user=settings.user, password=self._become)
        shell.wait_ready(nonce, deadline)
        return streams

    def _close_connection(self) -> None:
        """End the SSH connection."""
        self.connection.close()


def _stream(channel: paramiko.Channel, reason: Callable[[], str]) -> EngineSocket:
    """Give a channel to an engine as HTTP wants it."""
    from srprov.transport.engine_stream import EngineSocket

    def waiting() -> bool:
        return bool(channel.recv_ready() or channel.eof_received or channel.closed)

    return EngineSocket(channel, reason, waiting)
