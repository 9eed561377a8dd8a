"""A client of yaml-language-server over stdio, as an editor is one: it opens files, and asks about places in them."""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path
from queue import Queue
from threading import Thread
from types import TracebackType
from typing import Any

_LONGEST_S = 60.0


class LanguageServer:
    """One that runs; a context manager. `settings` are those that the editor has for `yaml`."""

    def __init__(self, command: Sequence[str], folder: Path, settings: dict[str, Any]) -> None:
        self._settings = settings
        self._process = subprocess.Popen(
            list(command), cwd=folder, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        )
        self._came: Queue[dict[str, Any]] = Queue()
        self._problems: dict[str, list[dict[str, Any]]] = {}
        self._number = 0
        self._reader = Thread(target=self._read, daemon=True)
        self._reader.start()
        about = {"processId": None, "rootUri": folder.as_uri(), "capabilities": {"workspace": {"configuration": True}}}
        self.ask("initialize", about)
        self._send({"method": "initialized", "params": {}})
        self._send({"method": "workspace/didChangeConfiguration", "params": {"settings": {"yaml": settings}}})

    def __enter__(self) -> LanguageServer:
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self._process.kill()
        self._process.wait()
        self._reader.join()

    def open(self, path: Path, text: str) -> list[dict[str, Any]]:
        """Open a file that was not opened before, with a text; return what the server finds wrong with it."""
        address = path.as_uri()
        document = {"uri": address, "languageId": "yaml", "version": 1, "text": text}
        self._send({"method": "textDocument/didOpen", "params": {"textDocument": document}})
        deadline = time.monotonic() + _LONGEST_S
        while address not in self._problems:
            assert time.monotonic() < deadline, f"the server says nothing of {path}"
            self._take(self._came.get(timeout=_LONGEST_S))
        return self._problems[address]

    def at(self, what: str, path: Path, line: int, character: int) -> Any:
        """Ask for `hover` or `completion` at a place, both counted from 0."""
        place = {"textDocument": {"uri": path.as_uri()}, "position": {"line": line, "character": character}}
        return self.ask(f"textDocument/{what}", place)

    def ask(self, method: str, parameters: dict[str, Any]) -> Any:
        """Ask something, and return the answer."""
        self._number += 1
        self._send({"id": self._number, "method": method, "params": parameters})
        while True:
            message = self._came.get(timeout=_LONGEST_S)
            if message.get("id") == self._number and "method" not in message:
                assert "error" not in message, message
                return message["result"]
            self._take(message)

    def _take(self, message: dict[str, Any]) -> None:
        """Do what the server asks for, and keep what it tells."""
        if message.get("method") == "textDocument/publishDiagnostics":
            told = message["params"]
            self._problems[told["uri"]] = told["diagnostics"]
        elif message.get("method") == "workspace/configuration":
            asked = [self._settings if one.get("section") == "yaml" else None for one in message["params"]["items"]]
            self._send({"id": message["id"], "result": asked})
        elif "method" in message and "id" in message:
            self._send({"id": message["id"], "result": None})

    def _send(self, message: dict[str, Any]) -> None:
        data = json.dumps({"jsonrpc": "2.0", **message}).encode()
        assert self._process.stdin is not None
        self._process.stdin.write(b"Content-Length: %d\r\n\r\n%s" % (len(data), data))
        self._process.stdin.flush()

    def _read(self) -> None:
        stream = self._process.stdout
        assert stream is not None
        while line := stream.readline():
            length = int(line.split(b":")[1]) if line.lower().startswith(b"content-length:") else 0
            while stream.readline().strip():
                pass
            self._came.put(json.loads(stream.read(length)))
