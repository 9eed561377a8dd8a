"""The proxy before the engine of a robot that says it has another architecture."""

from __future__ import annotations

import asyncio
import json
import os
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest

from srprov.lab.engine_proxy import ENGINE, SOCKET, Proxy

PROXY = Proxy(0, "aarch64", "linux/arm64")
Engine = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]]


@pytest.mark.parametrize(
    ("method", "target", "becomes"),
    [
        ("POST", "/v1.41/images/create?fromImage=busybox&tag=latest", "&platform=linux%2Farm64"),
        ("POST", "/v1.41/containers/create?name=x", "&platform=linux%2Farm64"),
        ("POST", "/containers/create", "?platform=linux%2Farm64"),
        ("POST", "/v1.41/build?t=x&platform=", "&platform=linux%2Farm64"),
        ("POST", "/v1.41/build?t=x&platform=linux%2Famd64", ""),
        ("POST", "/v1.41/images/create?fromSrc=-", ""),
        ("POST", "/v1.41/containers/x/start", ""),
        ("GET", "/v1.41/images/create", ""),
    ],
)
def test_a_platform_is_named_where_one_may_be_and_none_is(method: str, target: str, becomes: str) -> None:
    assert PROXY.placed(method, target) == target.removesuffix("&platform=") + becomes


def test_what_an_engine_says_of_its_architecture_is_altered_and_nothing_else() -> None:
    version = {
        "Version": "20.10",
        "Arch": "amd64",
        "Components": [{"Name": "x", "Details": {"Arch": "amd64", "Os": "l"}}],
    }
    other = {
        "Version": "20.10",
        "Arch": "arm64",
        "Components": [{"Name": "x", "Details": {"Arch": "arm64", "Os": "l"}}],
    }
    assert json.loads(PROXY.told(json.dumps(version).encode())) == other
    assert json.loads(PROXY.told(b'{"Architecture": "x86_64", "NCPU": 2}')) == {"Architecture": "aarch64", "NCPU": 2}


async def _talk(folder: Path, engine: Engine, said: bytes, *, silent: bool = False) -> bytes:
    """Say something to an engine through the proxy, and then that this is all; give all that comes back."""
    (folder / "lab").mkdir()
    run = os.open(folder, os.O_PATH)
    before = await asyncio.start_unix_server(engine, str(folder / ENGINE))
    umask = os.umask(0o022)
    serving = asyncio.ensure_future(Proxy(run, "aarch64", "linux/arm64").serve(os.getgid()))
    try:
        while not (folder / SOCKET).exists():
            await asyncio.sleep(0.01)
        reader, writer = await asyncio.open_unix_connection(str(folder / SOCKET))
        writer.write(said)
        if silent:
            writer.write_eof()
        answer = await asyncio.wait_for(reader.read(), 10)
        writer.close()
        return answer
    finally:
        os.umask(umask)
        serving.cancel()
        before.close()
        os.close(run)


def test_requests_that_do_not_wait_are_answered_in_their_order_and_bodies_pass(tmp_path: Path) -> None:
    got: list[bytes] = []

    async def engine(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        got.append(await reader.readuntil(b"\r\n\r\n"))
        writer.write(
            b'HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n10\r\n{"Arch": "amd64"\r\n1\r\n}\r\n0\r\n\r\n'
        )
        got.append(await reader.readuntil(b"0\r\n\r\n"))
        writer.write(b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n2\r\nhi\r\n0\r\n\r\n")
        got.append(await reader.readuntil(b"\r\n\r\n"))
        writer.write(b"HTTP/1.1 101 UPGRADED\r\n\r\n")
        writer.write(await reader.readexactly(4))
        writer.close()

    asks = b"GET /v1.41/version HTTP/1.1\r\n\r\n"
    sends = b"POST /v1.41/build?t=x HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\n3\r\nabc\r\n0\r\n\r\n"
    attaches = b"POST /v1.41/containers/x/attach HTTP/1.1\r\nUpgrade: tcp\r\n\r\nping"
    answer = asyncio.run(_talk(tmp_path, engine, asks + sends + attaches))
    first, second, third = answer.split(b"HTTP/1.1 ")[1:]
    assert first == b'200 OK\r\nContent-Length: 17\r\n\r\n{"Arch": "arm64"}'
    assert second.endswith(b"\r\n\r\n2\r\nhi\r\n0\r\n\r\n") and third == b"101 UPGRADED\r\n\r\nping"
    assert got[1].startswith(b"POST /v1.41/build?t=x&platform=linux%2Farm64 HTTP/1.1\r\n") and got[1].endswith(
        b"abc\r\n0\r\n\r\n"
    )


def test_an_engine_that_is_down_ends_the_connection(tmp_path: Path) -> None:
    async def engine(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.transport.abort()

    assert asyncio.run(_talk(tmp_path, engine, b"GET /_ping HTTP/1.1\r\n\r\n")) == b""


@pytest.mark.parametrize(("header", "comes"), [(b"Upgrade: tcp\r\n", b"UPGRADED\r\n\r\nout"), (b"", b"")])
def test_who_attaches_may_end_its_side_and_who_waits_for_an_answer_not(
    tmp_path: Path, header: bytes, comes: bytes
) -> None:
    async def engine(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readuntil(b"\r\n\r\n")
        await asyncio.sleep(0.5)
        writer.write(b"HTTP/1.1 101 UPGRADED\r\n\r\nout")
        writer.close()

    request = b"POST /v1.41/containers/x/attach HTTP/1.1\r\n" + header + b"\r\n"
    assert asyncio.run(_talk(tmp_path, engine, request, silent=True)).partition(b"101 ")[2] == comes
