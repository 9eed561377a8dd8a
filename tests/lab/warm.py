"""`srprov` in processes of their own, each a fork of one that has imported everything already.

The lab's tests run the command line a thousand times, and half of a processor's time went into importing it. A fork has
its own arguments, environment, folder, streams, process id and end, as a started one has. What is about starting itself
(`tests/unit/cli`), or about signals (`looks.begin`), starts the command as users do.

As a program: `python -m tests.lab.warm SOCKET` serves until who began it has ended.
"""

from __future__ import annotations

import importlib
import json
import os
import pkgutil
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO

ROOT = Path(__file__).parents[2]


class Warm:
    """The process that forks; begun with the first command, gone a second after this process."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._server: subprocess.Popen[bytes] | None = None
        self._place = ""

    def run(
        self, arguments: Sequence[str], cwd: Path, env: Mapping[str, str], stdin: str, seconds: float
    ) -> tuple[int, str, str]:
        """Run `srprov` with no terminal, and return its exit code, standard output and standard error."""
        with tempfile.TemporaryFile() as given, tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
            given.write(stdin.encode())
            given.seek(0)
            with socket.socket(socket.AF_UNIX) as line:
                line.settimeout(seconds)
                line.connect(self._started())
                request = {"arguments": list(arguments), "cwd": str(cwd), "env": dict(env)}
                socket.send_fds(line, [b"x"], [one.fileno() for one in (given, out, err)])
                line.sendall(json.dumps(request).encode() + b"\n")
                answer = line.makefile()
                pid = int(answer.readline())
                try:
                    code = int(answer.readline())
                except TimeoutError:
                    os.kill(pid, signal.SIGKILL)
                    raise subprocess.TimeoutExpired(list(arguments), seconds, _text(out), _text(err)) from None
            return code, _text(out), _text(err)

    def _started(self) -> str:
        with self._lock:
            if self._server is None or self._server.poll() is not None:
                self._place = str(Path(tempfile.mkdtemp(prefix="srprov-warm-")) / "socket")
                self._server = subprocess.Popen(
                    [sys.executable, "-m", "tests.lab.warm", self._place],
                    cwd=ROOT,
                    env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},  # a fork would lose its threads
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.PIPE,
                )
                assert self._server.stdout is not None
                assert self._server.stdout.readline() == b"ready\n", "nothing that forks came up"
            return self._place


def _text(file: IO[bytes]) -> str:
    file.seek(0)
    return file.read().decode()


def _serve(place: str) -> list[str]:
    """Answer until the parent has ended; each fork comes back from here with its arguments."""
    import srprov

    for module in pkgutil.walk_packages(srprov.__path__, "srprov."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    assert len(os.listdir("/proc/self/task")) == 1, "a fork would lose the other threads"
    listening = socket.socket(socket.AF_UNIX)
    listening.bind(place)
    listening.listen(64)
    os.write(1, b"ready\n")
    os.register_at_fork(after_in_child=listening.close)
    signal.signal(signal.SIGCHLD, lambda *_: _reap())
    parent = os.getppid()
    listening.settimeout(1.0)
    while os.getppid() == parent:
        try:
            line, _ = listening.accept()
        except TimeoutError:
            continue
        if os.fork() == 0:
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            return _act(line)
        line.close()
    shutil.rmtree(Path(place).parent)
    os._exit(0)


def _reap() -> None:
    while True:
        try:
            if os.waitpid(-1, os.WNOHANG)[0] == 0:
                return
        except ChildProcessError:
            return


def _act(line: socket.socket) -> list[str]:
    """Fork once more: one runs the command, one waits for it and says how it ended."""
    line.setblocking(True)
    _, descriptors, _, _ = socket.recv_fds(line, 1, 3)
    request = json.loads(line.makefile().readline())
    pid = os.fork()
    if pid:
        line.sendall(f"{pid}\n".encode())
        _, status = os.waitpid(pid, 0)
        line.sendall(f"{os.waitstatus_to_exitcode(status)}\n".encode())
        os._exit(0)
    line.close()
    for number, descriptor in enumerate(descriptors):
        os.dup2(descriptor, number)
        os.close(descriptor)
    os.chdir(request["cwd"])
    os.environ.clear()
    os.environ.update(request["env"])
    return [str(one) for one in request["arguments"]]


if __name__ == "__main__":
    sys.argv = ["srprov", *_serve(sys.argv[1])]
    from srprov.cli.main import entry

    entry()
