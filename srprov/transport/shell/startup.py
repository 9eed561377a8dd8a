"""From a command line that was just sent to a root shell that is ready: noise, sudo's question, and what goes wrong."""

from __future__ import annotations

from typing import TYPE_CHECKING

from srprov.codes import Code
from srprov.errors import AuthError, ConnectError, DeadlineError, TransportError
from srprov.secret import Secret
from srprov.transport.deadline import Deadline
from srprov.transport.shell.frames import ready_line, sudo_prompt

if TYPE_CHECKING:
    from srprov.session import Streams

_LONGEST = 1 << 20
"""Bytes that a login may print, in banners, a `.bashrc` and complaints of sudo."""
_SUDO_HINT = (
    "allow it without a password: echo '{user} ALL=(ALL) NOPASSWD: ALL' | sudo tee /etc/sudoers.d/srprov on the robot, "
    "log in as root (ansible_user: root), or give sudo's password (--ask-become-pass, ansible_become_password)"
)


def wait_ready(
    host: str, streams: Streams, nonce: str, deadline: Deadline, *, user: str, password: Secret | None
) -> None:
    """Discard all that is printed before the shell says that it is ready; answer sudo when it asks.

    Args:
        host: The robot's name, for errors.
        streams: Of the shell; they are closed when it does not get ready.
        nonce: As given to `start_command`.
        deadline: For all of it.
        user: Who logged in.
        password: For sudo, if there is one.

    Raises:
        AuthError: sudo asks for a password, does not accept the one that there is, or is not allowed.
        ConnectError: The shell ended before it was ready, or printed too much.
        DeadlineError: It was not ready in time.
    """
    try:
        _wait(host, streams, nonce, deadline, user, password)
    except TransportError:
        streams.close()
        raise


def _wait(host: str, streams: Streams, nonce: str, deadline: Deadline, user: str, password: Secret | None) -> None:
    noise, complaints, answered = bytearray(), bytearray(), False
    while True:
        out, err = streams.read()
        noise += out
        complaints += err
        if ready_line(nonce) in noise:
            return
        if password and complaints.count(sudo_prompt(nonce)) > answered:
            if answered:  # it was wrong, and a third try might lock the account
                hint = "check ansible_become_password, or what was typed for --ask-become-pass"
                raise AuthError(host, f"sudo does not accept the password of user {user!r}", hint=hint, code=Code.SUDO)
            answered = True
            _answer(streams, password, deadline)
        if len(noise) + len(complaints) > _LONGEST:
            message = f"its login printed more than {_LONGEST >> 20} MiB before the shell was ready"
            raise ConnectError(
                host, message, hint="what does ~/.bashrc on the robot print? try: ssh -v", code=Code.SHELL
            )
        if deadline.passed:
            hint = "a slow or waiting ~/.bashrc on the robot? try: ssh -v, then: sudo -n true"
            raise DeadlineError(host, f"its shell was not ready within {deadline.seconds:g} s", hint=hint)
        if out or err:
            continue
        if streams.ended:
            raise _failure(host, user, complaints.decode("utf-8", "replace"), streams)
        streams.wait(deadline.left(), writing=False)


def _answer(streams: Streams, password: Secret, deadline: Deadline) -> None:
    """Tell sudo the password."""
    pending = memoryview(password.reveal().encode("utf-8", "surrogateescape") + b"\n")
    while pending and not streams.ended and not deadline.passed:
        pending = pending[streams.write(pending) :]
        if pending:
            streams.wait(deadline.left(), writing=True)


def _failure(host: str, user: str, complaints: str, streams: Streams) -> TransportError:
    """Return the error for a shell that ended before it was ready."""
    text = " ".join(complaints.split())[-300:]
    if "sudo" in text:
        return AuthError(
            host, f"user {user!r} cannot become root: {text}", hint=_SUDO_HINT.format(user=user), code=Code.SUDO
        )
    why = text or streams.reason()
    return ConnectError(
        host, f"its shell ended at once: {why}", hint="is the user's login shell usable?", code=Code.SHELL
    )
