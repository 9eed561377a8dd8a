"""Repositories behind https, with git's own server on loopback: fetched by commit, and never from another address."""

from __future__ import annotations

import http.server
import os
import ssl
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from srprov.git import cache, program
from srprov.git.program import GitError
from srprov.git_address import Address, parse_address
from tests.integration.test_git import MOST, Server


class Handler(http.server.BaseHTTPRequestHandler):
    """Hands requests to `git http-backend`, redirects, asks for a password, or never ends."""

    root: Path
    protocol_version = "HTTP/1.1"

    def do_GET(self) -> None:
        self._answer(b"")

    def do_POST(self) -> None:
        self._answer(self.rfile.read(int(self.headers["Content-Length"])))

    def log_message(self, format: str, *args: object) -> None:
        pass

    def _answer(self, body: bytes) -> None:
        path, _, query = self.path.partition("?")
        if path.startswith("/moved"):
            self.send_response(302)
            self.send_header("Location", self.path.replace("/moved", "/server"))
            self.send_header("Content-Length", "0")
            self.end_headers()
        elif path.startswith("/private"):
            self.send_response(401)
            self.send_header("WWW-Authenticate", "Basic")
            self.send_header("Content-Length", "0")
            self.end_headers()
        elif path.startswith("/endless"):
            self.send_response(200)
            self.send_header("Content-Type", "application/x-git-upload-pack-advertisement")
            self.end_headers()
            time.sleep(5)
        else:
            self._backend(path, query, body)

    def _backend(self, path: str, query: str, body: bytes) -> None:
        environ = {
            **{"GIT_PROJECT_ROOT": str(self.root), "GIT_HTTP_EXPORT_ALL": "1", "PATH": os.environ["PATH"]},
            **{"PATH_INFO": path, "QUERY_STRING": query, "REQUEST_METHOD": self.command},
            "CONTENT_TYPE": self.headers.get("Content-Type", ""),
            "CONTENT_LENGTH": str(len(body)),
            "HTTP_CONTENT_ENCODING": self.headers.get("Content-Encoding", ""),
            "GIT_PROTOCOL": self.headers.get("Git-Protocol", ""),
        }
        done = subprocess.run(["git", "http-backend"], input=body, env=environ, capture_output=True, check=False)
        head, _, content = done.stdout.partition(b"\r\n\r\n")
        fields = dict(line.decode().split(": ", 1) for line in head.split(b"\r\n"))
        self.send_response(int(fields.pop("Status", "200")[:3]))
        for name, value in {**fields, "Content-Length": str(len(content))}.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(content)


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Server, int]]:
    """Serve the folder; its certificate is the only one that git trusts."""
    key, certificate = tmp_path / "key", tmp_path / "certificate"
    words = f"req -x509 -newkey rsa:2048 -nodes -keyout {key} -out {certificate} -days 2 -subj /CN=localhost"
    subprocess.run(
        ["openssl", *words.split(), "-addext", "subjectAltName=DNS:localhost"], check=True, capture_output=True
    )
    for name in ("https_proxy", "HTTPS_PROXY", "all_proxy", "ALL_PROXY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("GIT_SSL_CAINFO", str(certificate))
    handler = type("Own", (Handler,), {"root": tmp_path})
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as served:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(certificate, key)
        served.socket = context.wrap_socket(served.socket, server_side=True)
        served.daemon_threads = True
        threading.Thread(target=served.serve_forever, daemon=True).start()
        yield Server(tmp_path / "server"), served.server_address[1]
        served.shutdown()


def test_a_commit_behind_a_branch_is_fetched_alone(site: tuple[Server, int], tmp_path: Path) -> None:
    server, port = site
    old = server.commit(a="1")
    new = server.commit(a="2")
    address = parse_address(f"https://localhost:{port}/server/.git")
    assert cache.resolve(address, "main") == new
    found = cache.files(address, old, MOST, folder=tmp_path / "cache")
    assert [(one.path, one.content) for one in found] == [("a", b"1")]
    (kept,) = (tmp_path / "cache").glob("*.git")
    with pytest.raises(GitError):
        program.run([f"--git-dir={kept}", "cat-file", "-e", new], most=10, seconds=10)


@pytest.mark.parametrize(
    ("path", "why"),
    [
        ("/moved/.git", "302|redirect"),
        ("/private/.git", "Authentication failed|could not read|prompts disabled"),
        ("/endless/.git", "not done after 2 s"),
    ],
)
def test_an_address_that_leads_elsewhere_asks_or_never_ends_fails(
    site: tuple[Server, int], monkeypatch: pytest.MonkeyPatch, path: str, why: str
) -> None:
    """Nothing is asked on a terminal, and no credential of the user's is looked up."""
    site[0].commit(a="1")
    monkeypatch.setattr(cache, "LOOK_S", 2.0)
    with pytest.raises(GitError, match=why):
        cache.resolve(Address(f"https://localhost:{site[1]}{path}", "https"), "main")


def test_a_certificate_that_nobody_vouches_for_is_refused(
    site: tuple[Server, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GIT_SSL_CAINFO", "/etc/ssl/certs/ca-certificates.crt")
    with pytest.raises(GitError, match="certificate"):
        cache.resolve(parse_address(f"https://localhost:{site[1]}/server/.git"), "main")
