"""SSH servers of robots in memory, which answer and change as real ones do: `python -m …simulated FOLDER FIRST COUNT`.

Key exchange, login, channels, shells, locks and HTTP to an engine are real; behind them is `tests.fakes.FakeRobot`, one
for each address. Runs with asyncssh on its path. Host keys are written to FOLDER/FIRST.known, which is complete when it
is there; FOLDER/client.pub may log in.
"""

import asyncio
import base64
import contextlib
import json
import re
import shlex
import signal
import sys
import urllib.parse
from collections.abc import Callable

import asyncssh

from benchmarks.provisioning.fake_robots import publish
from srprov.facts.probes import PROBES
from srprov.wire import EngineCall, EngineQuery, Put, Query, Reply, Run
from tests.fakes import FakeRobot, World

PORT = 2222
READY = re.compile(r'printf "\\n%s ready\\n" ([0-9a-f]+)')
BOUNDARY = re.compile(
    rb"printf '\\n%s %s %s\\n' ([0-9a-f]+) (\w+) (\$_s|0); printf '\\n%s %s %s\\n' \1 \2 (?:\$_s|0) >&2\n"
)
WRITTEN = re.compile(r" && printf %s (.*) > (\S+)\.part && mv -f \S+ (\S+)\Z", re.DOTALL)
LONG = re.compile(r" && printf %s ([^ ]*) \| base64 -d > (\S+)\.part && .*", re.DOTALL)
ANY = tuple(range(100, 600))


def identity(number: int) -> tuple[str, str]:
    """Return name and address of a simulated robot."""
    return f"s{number:04}", f"127.2.{number // 200}.{1 + number % 200}"


def unquoted(word: str) -> str:
    """Return what `shlex.quote` made a word of; `shlex.split` looks at each character of what may be a long file."""
    return word[1:-1].replace("'\"'\"'", "'") if word.startswith("'") else shlex.split(word)[0]


class Shell:
    """One robot's answers to what its shell is told."""

    def __init__(self, robot: FakeRobot) -> None:
        self.robot = robot
        self.known: dict[str, Callable[[], str]] = {
            **{probe.command: lambda name=probe.name: robot._probe(name) for probe in PROBES},
        }

    def run(self, command: str) -> Reply:
        """Do one command: a question that robots in memory know, a file, or a script."""
        if command in self.known:
            return Reply(status=0, out=self.known[command]())
        if (put := WRITTEN.search(command)) is not None:
            content, path = unquoted(put[1]), shlex.split(put[3])[0]
            return self.robot._do(Put(path=path, content=content.encode()), half=False)
        if (put := LONG.search(command)) is not None:
            content = base64.b64decode(put[1])
            return self.robot._do(Put(path=shlex.split(put[2])[0], content=content), half=False)
        if command.startswith("umask 027; printf"):  # the line of the robot's own log
            return Reply(status=0)
        try:
            return self.robot._answer(Query(command=command))
        except AssertionError:
            return self.robot._script(Run(script=command), False)

    async def serve(self, process: asyncssh.SSHServerProcess) -> None:
        """Answer batches, or play the script of a lock."""
        waiting = b""
        while data := await process.stdin.read(1 << 16):
            waiting += data
            if waiting.startswith(b"line=") and b"exec sh -c" in waiting and waiting.endswith(b"\n"):
                process.stdout.write(b"\nlocked\n")
                await self.lock(process)
                return
            while (end := BOUNDARY.search(waiting)) is not None:
                text, waiting = waiting[: end.start()], waiting[end.end() :]
                self.answer(process, text.decode(), end[1] + b" " + end[2])

    def answer(self, process: asyncssh.SSHServerProcess, text: str, mark: bytes) -> None:
        """Write the answer to what stands before a boundary."""
        reply = Reply(status=0)
        if text:
            word = text.partition("eval ")[2].removesuffix("</dev/null; _s=$?; ").rstrip(" })").removesuffix(";")
            reply = self.run(unquoted(word))
        for stream, said in ((process.stdout, reply.out), (process.stderr, reply.err)):
            stream.write(said.encode() + b"\n%b %d\n" % (mark, reply.status))

    async def lock(self, process: asyncssh.SSHServerProcess) -> None:
        """Say yes to everything, until the end."""
        while letters := await process.stdin.read(100):
            for letter in letters.decode():
                if letter == "e":
                    return
                process.stdout.write({"t": b"locked\n", "f": b"free\n"}.get(letter, b"b\n"))


class Http:
    """One stream to a robot's engine."""

    def __init__(self, robot: FakeRobot) -> None:
        self.robot = robot

    async def serve(self, process: asyncssh.SSHServerProcess) -> None:
        """Answer requests in their order."""
        waiting = b""
        while data := await process.stdin.read(1 << 16):
            waiting += data
            while b"\r\n\r\n" in waiting:
                head, _, rest = waiting.partition(b"\r\n\r\n")
                size = re.search(rb"(?i)content-length: (\d+)", head)
                if len(rest) < (length := int(size[1]) if size else 0):
                    break
                body, waiting = rest[:length], rest[length:]
                method, target, _ = head.decode().partition("\r\n")[0].split(" ")
                process.stdout.write(self.answer(method, target, body.decode()))

    def answer(self, method: str, target: str, body: str) -> bytes:
        """Return the answer to one request."""
        parts = urllib.parse.urlsplit(target)
        path = re.sub(r"\A/v1\.\d+/", "/", urllib.parse.unquote(parts.path))
        params = tuple(urllib.parse.parse_qsl(parts.query, keep_blank_values=True))
        status, text = 200, "OK"
        if path == "/version":
            text = json.dumps({"ApiVersion": "1.41", "Version": "20.10.24"})
        elif path != "/_ping":
            reply = self.asked(method, path, params, body)
            status = reply.status
            text = reply.out or json.dumps({"message": reply.err})
        body = "" if status in (204, 304) else text
        return (
            f"HTTP/1.1 {status} said\r\nApi-Version: 1.41\r\nServer: Docker/20.10.24 (linux)\r\n"
            f"Content-Type: application/json\r\nContent-Length: {len(body.encode())}\r\n\r\n{body}"
        ).encode()

    def asked(self, method: str, path: str, params: tuple[tuple[str, str], ...], body: str) -> Reply:
        """Ask or tell the engine in memory."""
        if method == "GET":
            return self.robot.engine.query(EngineQuery(path=path, params=params))
        return self.robot.engine.call(EngineCall(method=method, path=path, params=params, body=body, accept=ANY))


def served(robot: FakeRobot) -> Callable:
    """Return what serves one robot's sessions."""

    async def serve(process: asyncssh.SSHServerProcess) -> None:
        found = READY.search(process.command or "")
        if found is None:
            process.exit(127)
            return
        process.stdout.write(b"\n%b ready\n" % found[1].encode())
        try:  # whoever hangs up ends it
            with contextlib.suppress(OSError, asyncssh.Error):
                await (Http if "dial-stdio" in process.command else Shell)(robot).serve(process)
        except Exception as error:
            print(f"{robot.host}: {type(error).__name__}: {error}"[:2000], file=sys.stderr, flush=True)
        process.exit(0)

    return serve


async def main(folder: str, first: str, count: str) -> None:
    keys = []
    for number in range(int(first), int(first) + int(count)):
        name, address = identity(number)
        robot = World().add(name, address=address).robots[name]
        robot.engine.images["busybox"] = {}
        host_key = asyncssh.generate_private_key("ssh-ed25519")
        await asyncssh.listen(
            address, PORT, server_host_keys=[host_key], process_factory=served(robot), encoding=None,
            authorized_client_keys=f"{folder}/client.pub", login_timeout=300, backlog=16,
        )  # fmt: skip
        keys.append((address, PORT, host_key))
    publish(f"{folder}/{first}.known", keys)
    stop = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, stop.set)
    await stop.wait()


if __name__ == "__main__":
    asyncio.run(main(*sys.argv[1:]))
