"""SSH servers that answer as one real robot did. Runs in an environment of its own, with asyncssh.

    python fake_robots.py record OUT.json REAL_ADDRESS KEY KNOWN_HOSTS PORT
    python fake_robots.py replay OUT.json FOLDER FIRST COUNT PORT NAME ADDRESS

`record` passes everything through to a real robot and keeps, per command, what was written to it and what came back. Of
srprov's protocol one word is known here, the moment of an earlier answer: long hex words are taken for nonces, and an
answer is kept under the text that asked for it, nonces left open. `replay` serves COUNT robots on addresses of their
own, answers with the record, and puts its own name and address for those of the robot that was recorded (NAME, ADDRESS;
of equal length, so that no count of bytes changes). Host keys are written to FOLDER/FIRST.known, which is complete when
it is there.
"""

import asyncio
import contextlib
import json
import os
import re
import signal
import sys
from collections.abc import Callable

import asyncssh
from fake_names import identity

NONCE = re.compile(rb"[0-9a-f]{16,}")
MOMENT = re.compile(rb"(?<=first=)[0-9]+")
"""When a robot was asked first, which it is told when it is asked again; the doubles never wait."""


def opened(text: bytes, tokens: list[bytes]) -> bytes:
    """Leave the nonces of a text open; new ones are added to the list."""

    def place(found: re.Match[bytes]) -> bytes:
        if found[0] not in tokens:
            tokens.append(found[0])
        return b"\x00%d\x00" % tokens.index(found[0])

    return NONCE.sub(place, MOMENT.sub(b"0", text))


def without(text: bytes, tokens: list[bytes]) -> bytes:
    for index, token in enumerate(tokens):
        text = text.replace(token, b"\x00%d\x00" % index)
    return text


def filled(text: bytes, tokens: list[bytes]) -> bytes:
    return re.sub(rb"\x00(\d+)\x00", lambda found: tokens[int(found[1])], text)


class Recorder:
    """Passes through, and keeps what it heard."""

    def __init__(self, path: str) -> None:
        self.path = path
        self.kept: dict[str, dict[str, list[str]]] = {}

    def keep(self, command: bytes, request: bytes, out: bytes, err: bytes) -> None:
        tokens: list[bytes] = []
        key = opened(command, tokens).decode("latin-1")
        asked = opened(request, tokens).decode("latin-1")
        answer = [without(out, tokens).decode("latin-1"), without(err, tokens).decode("latin-1")]
        self.kept.setdefault(key, {})[asked] = answer

    def write(self) -> None:
        with open(self.path, "w", encoding="utf-8") as file:
            json.dump(self.kept, file)


class Exchange:
    """One command's talk, cut where the asker begins to speak again."""

    def __init__(self, recorder: Recorder, command: bytes) -> None:
        self.recorder, self.command = recorder, command
        self.request, self.out, self.err = b"", b"", b""

    def heard(self, data: bytes) -> None:
        if self.out or self.err:
            self.over()
        self.request += data

    def said(self, data: bytes, stream: str) -> None:
        setattr(self, stream, getattr(self, stream) + data)

    def over(self) -> None:
        if self.out or self.err:
            self.recorder.keep(self.command, self.request, self.out, self.err)
        self.request, self.out, self.err = b"", b"", b""


async def passed(source: object, sink: object, tell: object) -> None:
    with contextlib.suppress(asyncssh.Error, OSError):  # whoever hangs up ends it
        while data := await source.read(65536):
            tell(data)
            sink.write(data)
        sink.write_eof()


async def record(out: str, address: str, key: str, known: str, port: str) -> None:
    recorder = Recorder(out)
    real = await asyncssh.connect(address, username="root", client_keys=[key], known_hosts=known)

    async def serve(process: asyncssh.SSHServerProcess) -> None:
        command = process.command or ""
        inner = await real.create_process(command, encoding=None)
        talk = Exchange(recorder, command.encode())
        pumps = [
            asyncio.create_task(passed(process.stdin, inner.stdin, talk.heard)),
            asyncio.create_task(passed(inner.stdout, process.stdout, lambda data: talk.said(data, "out"))),
            asyncio.create_task(passed(inner.stderr, process.stderr, lambda data: talk.said(data, "err"))),
        ]
        try:
            await asyncio.wait(pumps[1:])
        finally:
            talk.over()
            inner.close()
            process.exit(0)

    host_key = asyncssh.generate_private_key("ssh-ed25519")
    await asyncssh.listen(
        "127.0.0.1", int(port), server_host_keys=[host_key], process_factory=serve, encoding=None,
        authorized_client_keys=f"{key}.pub",
    )  # fmt: skip
    publish(f"{out}.known", [("127.0.0.1", port, host_key)])
    stop = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, stop.set)
    await stop.wait()
    recorder.write()


def publish(path: str, keys: list) -> None:
    lines = [f"[{address}]:{port} {key.export_public_key().decode().strip()}\n" for address, port, key in keys]
    with open(path + ".part", "w", encoding="utf-8") as file:
        file.writelines(lines)
    os.rename(path + ".part", path)


def robot(kept: dict, mine: tuple[str, str], recorded: tuple[str, str]) -> Callable:
    """Return what serves one simulated robot."""
    own = [(old.encode(), new.encode()) for old, new in zip(recorded, mine, strict=True)]

    async def serve(process: asyncssh.SSHServerProcess) -> None:
        tokens: list[bytes] = []
        known = kept.get(opened((process.command or "").encode(), tokens).decode("latin-1"))
        if known is None:
            process.stderr.write(b"not in the record: " + (process.command or "").encode())
            process.exit(127)
            return

        def answer(which: str, all_tokens: list[bytes]) -> None:
            for text, stream in zip(known[which], (process.stdout, process.stderr), strict=True):
                said = text.encode("latin-1")
                for old, new in own:
                    said = said.replace(old, new)
                if said:
                    stream.write(filled(said, all_tokens))

        if "" in known:
            answer("", tokens)
        waiting = b""
        while data := await process.stdin.read(65536):
            waiting += data
            now = list(tokens)
            asked = opened(waiting, now).decode("latin-1")
            if asked in known:
                answer(asked, now)
                waiting = b""
        if waiting:
            print(f"{mine[0]}: not in the record: {waiting[:3000]!r}", file=sys.stderr, flush=True)
        process.exit(0)

    return serve


async def replay(record_file: str, folder: str, first: str, count: str, port: str, name: str, address: str) -> None:
    with open(record_file, encoding="utf-8") as file:
        kept = json.load(file)
    keys = []
    for number in range(int(first), int(first) + int(count)):
        mine = identity(number, name)
        host_key = asyncssh.generate_private_key("ssh-ed25519")
        await asyncssh.listen(
            mine[1], int(port), server_host_keys=[host_key], process_factory=robot(kept, mine, (name, address)),
            encoding=None, authorized_client_keys=f"{folder}/client.pub", login_timeout=300, backlog=16,
        )  # fmt: skip
        keys.append((mine[1], port, host_key))
    publish(f"{folder}/{first}.known", keys)
    stop = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, stop.set)
    await stop.wait()


if __name__ == "__main__":
    asyncio.run((record if sys.argv[1] == "record" else replay)(*sys.argv[2:]))
