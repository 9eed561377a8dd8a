"""A program: a TCP proxy that makes sshd answer as late as over a link with that round-trip time.

    python -I delay.py LISTEN_ADDRESS LISTEN_PORT TARGET_PORT TO_MS FROM_MS

What goes to sshd is late by the first, what comes from it by the second. The kernel answers a SYN at once, so the
handshake's time is paid before sshd hears of the connection: its greeting arrives two round trips
after the client began, as over a real link. Runs in the robot's network, on Python's own library
alone; latency.py starts it.
"""

from __future__ import annotations

import asyncio
import contextlib
import sys
import time
from collections.abc import Sequence

CHUNK = 64 * 1024
MOST_CHUNKS = 64
"""On their way in one direction; a sender that fills this has to wait."""


async def serve(address: str, port: int, target: int, to_s: float, from_s: float) -> None:
    """Answer until killed; waits for the address to be there."""
    busy = set[object]()  # the event loop alone does not keep tasks from being collected

    async def handle(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        busy.add(task := asyncio.current_task())
        try:
            await delayed(address, target, to_s, from_s, reader, writer)
        finally:
            busy.discard(task)

    while True:
        with contextlib.suppress(OSError):
            server = await asyncio.start_server(handle, address, port, backlog=1024)
            break
        await asyncio.sleep(0.01)
    async with server:
        await server.serve_forever()


async def delayed(
    address: str, target: int, to_s: float, from_s: float, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
) -> None:
    """Carry one connection to its end."""
    await asyncio.sleep(1.5 * (to_s + from_s))  # SYN, SYN-ACK, ACK
    try:
        far_reader, far_writer = await asyncio.open_connection(address, target)
    except OSError:
        writer.transport.abort()
        return
    try:
        await asyncio.gather(carry(reader, far_writer, to_s), carry(far_reader, writer, from_s))
    except OSError:  # one side was reset: so is the other
        writer.transport.abort()
        far_writer.transport.abort()
    finally:
        writer.close()
        far_writer.close()


async def carry(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, delay_s: float) -> None:
    """Carry one direction to its end of file, everything late by `delay_s`."""
    under_way: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue(MOST_CHUNKS)

    async def read() -> None:
        data = b"more"
        while data:
            data = await reader.read(CHUNK)
            await under_way.put((time.monotonic() + delay_s, data))

    async def write() -> None:
        while True:
            due, data = await under_way.get()
            await asyncio.sleep(max(0.0, due - time.monotonic()))
            if not data:
                break
            writer.write(data)
            await writer.drain()
        with contextlib.suppress(OSError):
            writer.write_eof()

    tasks = [asyncio.ensure_future(read()), asyncio.ensure_future(write())]
    try:
        await asyncio.gather(*tasks)
    finally:
        for task in tasks:
            task.cancel()


def main(words: Sequence[str]) -> None:
    """Run with the arguments as they were given."""
    address, port, target, to_ms, from_ms = words
    asyncio.run(serve(address, int(port), int(target), float(to_ms) / 1000, float(from_ms) / 1000))


if __name__ == "__main__":
    main(sys.argv[1:])
