"""A program: a proxy before the Docker engine of a robot that says it has another architecture than its machine.

    python -I engine_proxy.py INIT_PID MACHINE PLATFORM

It listens on the robot's /run/docker.sock and talks to the engine on /run/lab/docker.sock. It alters what the engine
says of its architecture (`/version`, `/info`), and names the platform in builds, pulls and new containers that name
none, as an engine's own default would. All else passes as it is, in both directions. It runs outside of the robot's
view of the disk, on Python's own library alone; arm64.py starts it.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import re
import sys
from collections.abc import Mapping, Sequence
from urllib.parse import parse_qsl, urlencode

SOCKET, ENGINE = "docker.sock", "lab/docker.sock"
"""Below the robot's /run."""
CHUNK = 256 * 1024
PATIENCE_S = 5.0
TOLD = re.compile(r"(/v[0-9.]+)?/(version|info)")
PLACED = re.compile(r"(/v[0-9.]+)?/(build|images/create|containers/create)")

Streams = tuple[asyncio.StreamReader, asyncio.StreamWriter]


class Head:
    """The first lines of a request or an answer."""

    def __init__(self, text: str) -> None:
        """`text` is all of it, with the empty line at its end."""
        self.first, *lines = text.split("\r\n")[:-2]
        self.lines = [line for line in lines if line]

    def get(self, name: str) -> str:
        """Give a header's value in lower case, or nothing."""
        found = (line.partition(":") for line in self.lines)
        return next((value.strip().lower() for key, _, value in found if key.strip().lower() == name), "")

    def with_length(self, length: int) -> Head:
        """Give the same head of a body that is told by its length."""
        kept = [line for line in self.lines if not re.match("(content-length|transfer-encoding):", line, re.IGNORECASE)]
        return Head("\r\n".join([self.first, *kept, f"Content-Length: {length}", "", ""]))

    def data(self) -> bytes:
        """Give it as it is sent."""
        return "\r\n".join([self.first, *self.lines, "", ""]).encode("latin-1")


async def read_head(reader: asyncio.StreamReader) -> Head:
    """Read a head; IncompleteReadError at the end of the stream."""
    return Head((await reader.readuntil(b"\r\n\r\n")).decode("latin-1"))


async def carry_body(head: Head, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Carry the body that a head tells of."""
    if head.get("transfer-encoding") == "chunked":
        size = 1
        while size:
            line = await reader.readuntil(b"\r\n")
            size = int(line.split(b";")[0], 16)
            writer.write(line)
            await carry(size + 2, reader, writer)
    else:
        await carry(int(head.get("content-length") or 0), reader, writer)


async def carry(size: int, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Carry so many bytes."""
    while size:
        data = await reader.read(min(size, CHUNK))
        if not data:
            raise EOFError
        size -= len(data)
        writer.write(data)
        await writer.drain()


async def read_body(head: Head, reader: asyncio.StreamReader) -> bytes:
    """Read the body that a head tells of."""
    if head.get("transfer-encoding") != "chunked":
        return await reader.readexactly(int(head.get("content-length") or 0))
    parts = []
    while size := int((await reader.readuntil(b"\r\n")).split(b";")[0], 16):
        parts.append((await reader.readexactly(size + 2))[:-2])
    await reader.readexactly(2)
    return b"".join(parts)


async def tunnel(one: Streams, other: Streams) -> None:
    """Carry both directions to their ends, as for an attached container."""

    async def way(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while data := await reader.read(CHUNK):
            writer.write(data)
            await writer.drain()
        with contextlib.suppress(OSError):
            writer.write_eof()

    await asyncio.gather(way(one[0], other[1]), way(other[0], one[1]))


class Proxy:
    """What is altered, and between which sockets."""

    def __init__(self, run: int, machine: str, platform: str) -> None:
        """`run` is the robot's /run, open; `machine` as `uname -m` says it, `platform` as Docker does."""
        self.run, self.machine, self.platform = f"/proc/self/fd/{run}", machine, platform
        self.busy: set[object] = set()
        """The tasks of connections: the event loop alone does not keep them from being collected."""

    async def serve(self, group: int) -> None:
        """Answer until killed."""
        os.umask(0o117)
        server = await asyncio.start_unix_server(self.handle, f"{self.run}/{SOCKET}", limit=1 << 20)
        os.chown(f"{self.run}/{SOCKET}", 0, group)
        async with server:
            await server.serve_forever()

    async def handle(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Carry one connection to its end."""
        client: Streams = reader, writer
        self.busy.add(task := asyncio.current_task())
        engine: Streams | None = None
        try:
            engine = await asyncio.open_unix_connection(f"{self.run}/{ENGINE}", limit=1 << 20)
            while await self.exchange(client, engine):
                pass
        except (OSError, EOFError, ValueError, asyncio.LimitOverrunError):  # either side has gone
            writer.transport.abort()
        finally:
            self.busy.discard(task)
            for each in (client, engine) if engine else (client,):
                each[1].close()

    async def exchange(self, client: Streams, engine: Streams) -> bool:
        """Carry one request and its answer; whether another may follow."""
        request = await read_head(client[0])
        method, target, version = request.first.split(" ")
        request.first = f"{method} {self.placed(method, target)} {version}"
        engine[1].write(request.data())
        sending = asyncio.ensure_future(carry_body(request, client[0], engine[1]))
        watching = asyncio.ensure_future(self.watch(request, client[0], engine[1]))
        try:
            answer = await self.answer(method, target, client, engine)
            if answer.first.split(" ")[1] == "101" or not is_framed(method, answer):
                await sending
                watching.cancel()
                await tunnel(client, engine)
                return False
            await asyncio.wait([sending], timeout=PATIENCE_S)  # the engine may have answered before it has all
            return sending.done() and answer.get("connection") != "close"
        finally:
            watching.cancel()
            sending.cancel()

    async def watch(self, request: Head, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Hang up on the engine when the client has: it ends what it does for a client that is gone.

        One that attaches to a container may have nothing to say, and ends its side as soon as it has asked.
        """
        while not reader.at_eof() or request.get("upgrade"):
            await asyncio.sleep(0.1)
        writer.transport.abort()

    async def answer(self, method: str, target: str, client: Streams, engine: Streams) -> Head:
        """Carry an answer; the body of one that has no end of its own is left."""
        head = await read_head(engine[0])
        while head.first.split(" ")[1] == "100":
            client[1].write(head.data())
            head = await read_head(engine[0])
        if method == "GET" and TOLD.fullmatch(target) and is_framed(method, head):
            body = self.told(await read_body(head, engine[0]))
            client[1].write(head.with_length(len(body)).data() + body)
        else:
            client[1].write(head.data())
            if method != "HEAD" and is_framed(method, head):
                await carry_body(head, engine[0], client[1])
        await client[1].drain()
        return head

    def placed(self, method: str, target: str) -> str:
        """Give a request's target with the platform, where it takes one and names none."""
        path, _, query = target.partition("?")
        words = [
            (key, value) for key, value in parse_qsl(query, keep_blank_values=True) if (key, value) != ("platform", "")
        ]
        if method != "POST" or not PLACED.fullmatch(path) or "platform" in dict(words):
            return target
        if path.endswith("/images/create") and "fromImage" not in dict(words):
            return target
        return f"{path}?{urlencode([*words, ('platform', self.platform)])}"

    def told(self, body: bytes) -> bytes:
        """Give what the engine says of itself with the other architecture."""
        said = json.loads(body)
        if "Arch" in said:
            said["Arch"] = self.platform.partition("/")[2]
        if "Architecture" in said:
            said["Architecture"] = self.machine
        for part in said.get("Components") or ():
            if isinstance(details := part.get("Details"), Mapping) and "Arch" in details:
                part["Details"] = {**details, "Arch": self.platform.partition("/")[2]}
        return json.dumps(said).encode()


def is_framed(method: str, head: Head) -> bool:
    """Whether an answer's end can be told before the connection's."""
    status = head.first.split(" ")[1]
    framed = head.get("transfer-encoding") == "chunked" or head.get("content-length") != ""
    return method == "HEAD" or status in ("204", "304") or framed


async def open_run(init: int) -> int:
    """Open the robot's /run once its engine listens: before that, this process id may still see the machine's."""
    while True:
        with contextlib.suppress(OSError):
            run = os.open(f"/proc/{init}/root/run", os.O_PATH | os.O_DIRECTORY)
            if os.path.exists(f"/proc/self/fd/{run}/{ENGINE}"):
                return run
            os.close(run)
        await asyncio.sleep(0.02)


def docker_group(init: int) -> int:
    """Give the id of the robot's group `docker`; root's if it has none."""
    with open(f"/proc/{init}/root/etc/group", encoding="utf-8") as groups:
        return next((int(line.split(":")[2]) for line in groups if line.startswith("docker:")), 0)


async def run(init: int, machine: str, platform: str) -> None:
    """Serve the robot with this PID 1."""
    folder = await open_run(init)
    await Proxy(folder, machine, platform).serve(docker_group(init))


def main(words: Sequence[str]) -> None:
    """Run with the arguments as they were given."""
    init, machine, platform = words
    asyncio.run(run(int(init), machine, platform))


if __name__ == "__main__":
    main(sys.argv[1:])
