"""GitHub and GitLab as far as tools/ci needs them, on this machine: comments in pages, SARIF, and who may write."""

from __future__ import annotations

import json
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from typing import Any
from urllib.parse import parse_qs, urlsplit

TOKEN = "a-token-of-some-length"
BOT = "github-actions[bot]"
BOT_NUMBER = 77


class FakeForge:
    """A server with the comments of one request; a context manager."""

    def __init__(self) -> None:
        self.comments: list[dict[str, Any]] = []
        self.sarif: list[dict[str, Any]] = []
        self.asked: list[tuple[str, str]] = []
        self.strangers = 0
        """Requests without the token."""
        self.may_write = True
        self.elsewhere = ""
        """Where every request is sent on to, when it is set."""
        forge = self

        class Handler(BaseHTTPRequestHandler):
            def _answer(self) -> None:
                forge.answer(self)

            do_GET = do_POST = do_PATCH = do_PUT = _answer

            def log_message(self, *_about: object) -> None:
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.address = f"http://127.0.0.1:{self._server.server_port}"
        self._thread = Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True)

    def __enter__(self) -> FakeForge:
        self._thread.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def add(self, login: str, body: str, number: int = 0) -> dict[str, Any]:
        """Add a comment, as both forges have it."""
        about = {"login": login, "id": number}
        self.comments.append({"id": len(self.comments) + 1000, "user": about, "author": about, "body": body})
        return self.comments[-1]

    def bodies(self, login: str = BOT) -> list[str]:
        """Return what somebody's comments say."""
        return [one["body"] for one in self.comments if one["user"]["login"] == login]

    def answer(self, request: BaseHTTPRequestHandler) -> None:
        """Answer one request."""
        sent = request.rfile.read(int(request.headers.get("Content-Length") or 0))
        path = urlsplit(request.path)
        self.asked.append((request.command, path.path))
        if TOKEN not in (request.headers.get("PRIVATE-TOKEN"), (request.headers.get("Authorization") or "")[7:]):
            self.strangers += 1
            self._send(request, 401, {})
        elif self.elsewhere:
            self._send(request, 302, {}, Location=self.elsewhere + request.path)
        elif request.command == "GET" and path.path.endswith("/user"):
            self._send(request, 200, {"id": BOT_NUMBER})
        elif request.command == "GET":
            query = parse_qs(path.query)
            size, page = int(query["per_page"][0]), int(query["page"][0])
            self._send(request, 200, self.comments[(page - 1) * size : page * size])
        elif not self.may_write:
            self._send(request, 403, {"message": "Resource not accessible by integration"})
        elif path.path.endswith("/sarifs"):
            self.sarif.append(json.loads(sent))
            self._send(request, 202, {})
        elif request.command == "POST":
            self._send(request, 201, self.add(BOT, json.loads(sent)["body"], BOT_NUMBER))
        else:
            (one,) = (each for each in self.comments if str(each["id"]) == path.path.rpartition("/")[2])
            one["body"] = json.loads(sent)["body"]
            self._send(request, 200, one)

    def _send(self, request: BaseHTTPRequestHandler, status: int, value: object, **headers: str) -> None:
        data = json.dumps(value).encode()
        request.send_response(status)
        for name, text in {**headers, "Content-Length": str(len(data))}.items():
            request.send_header(name, text)
        request.end_headers()
        request.wfile.write(data)
