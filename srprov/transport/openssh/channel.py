"""What is done with one SSH channel: a command, its streams for `Shell`, sudo's question, and why it ended."""

from __future__ import annotations

import contextlib
import select
import threading
import time

import paramiko

from srprov.codes import Code
from srprov.errors import ConnectError, DeadlineError
from srprov.secret import Secret
from srprov.transport.deadline import Deadline
from srprov.transport.openssh.connection import StrictConnection
from srprov.transport.shell.frames import sudo_prompt

_CHUNK = 1 << 20
_BLOCKED_WRITE_POLL_S = 0.002
_ANSWER_POLL_S = 0.005
_LONGEST_WORDS = 256 * 1024
"""Bytes of a complaint, of which the end is shown; a question of sudo comes within them."""
MORE_SESSIONS = "raise MaxSessions to 6 or more"
_CONNECTION_ENDED = "the connection ended: run the command again once the robot is back"


def start(connection: StrictConnection, command: str, deadline: Deadline, terminal: str = "") -> paramiko.Channel:
    """Run a command on a new channel, or the user's shell when it is empty; `terminal` names the kind it gets.

    Raises:
        ConnectError: sshd opens no more channels (MaxSessions), or the connection died.
        DeadlineError: It did not answer in time.
    """
    name, transport = connection.settings.name, connection.transport
    # a request to sshd has no timeout: it would wait for its answer forever
    timer = threading.Timer(deadline.left(), transport.close)
    timer.daemon = True
    timer.start()
    try:
        channel: paramiko.Channel = transport.open_session(timeout=deadline.left(0.05))
        if terminal:
            channel.get_pty(term=terminal)
        if command:
            channel.exec_command(command)
        else:
            channel.invoke_shell()
    except (paramiko.SSHException, OSError, EOFError) as error:
        if deadline.passed and not isinstance(error, paramiko.ChannelException):
            late = f"sshd opened no session within {deadline.seconds:g} s"
            raise DeadlineError(name, late, hint="is the robot overloaded?") from None
        why = getattr(error, "text", error)
        hint = MORE_SESSIONS if transport.is_active() else _CONNECTION_ENDED
        raise ConnectError(name, f"sshd opens no session: {why}", hint=hint, code=Code.SHELL) from None
    finally:
        timer.cancel()
    return channel


class ChannelStreams:
    """The streams of a command on an SSH channel, for `Shell`."""

    def __init__(self, channel: paramiko.Channel) -> None:
        """Take a channel whose command was started."""
        self._channel = channel
        # fileno() is paramiko's public way to wait for both streams at once; it costs two descriptors per robot.
        self._poll = select.poll()
        self._poll.register(channel.fileno(), select.POLLIN)

    def write(self, data: memoryview) -> int:
        """Send what the channel's window takes; as its only writer, `send` does not block behind `send_ready`."""
        if not self._channel.send_ready():
            return 0
        try:
            return self._channel.send(bytes(data[:_CHUNK]))
        except OSError:
            return 0  # closed: `ended` says so in a moment

    def read(self) -> tuple[bytes, bytes]:
        """Return what is here of both streams."""
        channel = self._channel
        out = channel.recv(_CHUNK) if channel.recv_ready() else b""
        err = channel.recv_stderr(_CHUNK) if channel.recv_stderr_ready() else b""
        return out, err

    def wait(self, seconds: float, *, writing: bool) -> None:
        """Sleep until there is something to read; a window that opens makes no sound, so writing looks again soon."""
        with contextlib.suppress(OSError, ValueError):
            self._poll.poll(1000 * (min(seconds, _BLOCKED_WRITE_POLL_S) if writing else seconds))

    @property
    def ended(self) -> bool:
        """Tell whether the channel is at its end and empty."""
        channel = self._channel
        over = channel.eof_received or channel.closed
        return bool(over) and not channel.recv_ready() and not channel.recv_stderr_ready()

    def reason(self) -> str:
        """Say what ended it: the connection, or the command."""
        transport = self._channel.get_transport()
        if not transport.is_active():
            error = transport.get_exception()
            return (
                str(error) if error and str(error) else "the robot closed the connection, or does not answer any more"
            )
        # recv_exit_status() has no timeout, and a server need not send one.
        if self._channel.status_event.wait(0.2):
            return f"the shell ended with status {self._channel.exit_status}"
        return "the shell ended"

    def close(self) -> None:
        """Close the channel."""
        with contextlib.suppress(OSError, EOFError, paramiko.SSHException):
            self._channel.close()


def answer_sudo(channel: paramiko.Channel, nonce: str, password: Secret, deadline: Deadline) -> None:
    """Wait until sudo asks, and tell it; return at once when the command says something by itself, or ends."""
    asked = bytearray()
    while not (channel.recv_ready() or channel.eof_received or channel.closed or deadline.passed):
        if not channel.recv_stderr_ready():
            time.sleep(_ANSWER_POLL_S)
            continue
        asked += channel.recv_stderr(_CHUNK)
        if len(asked) > _LONGEST_WORDS:
            return  # whoever reads on finds no shell behind it
        if sudo_prompt(nonce) in asked:
            channel.sendall(password.reveal().encode("utf-8", "surrogateescape") + b"\n")
            return


def complaint(channel: paramiko.Channel) -> str:
    """Return what a command wrote to standard error before it died, and what it means; nothing if it wrote nothing."""
    channel.status_event.wait(0.5)  # stderr and the exit status follow the end of stdout
    said = bytearray()
    while channel.recv_stderr_ready() and len(said) < _LONGEST_WORDS:
        said += channel.recv_stderr(_CHUNK)
    text = " ".join(said.decode("utf-8", "replace").split())[-300:]
    if "not found" in text:
        return f"docker is not installed ({text})"
    if "sudo:" in text:
        return f"docker needs root, and sudo refuses ({text})"
    return text
