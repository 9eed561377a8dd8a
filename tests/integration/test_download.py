"""Downloads of data sets, over real TLS from a server of this machine."""

from __future__ import annotations

import contextlib
import datetime
import hashlib
import http.server
import ipaddress
import ssl
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec

from srprov import datasets
from srprov.transport.data_copy import found_here
from srprov.transport.turns import OwnTurns
from srprov.wire import SendData

CONTENT = b"data" * 100_000
SHA = hashlib.sha256(CONTENT).hexdigest()
TURNS = OwnTurns()


class Handler(http.server.BaseHTTPRequestHandler):
    """Gives `/run.bag`, leads away from `/away`, and counts who asked."""

    asked = 0

    def do_GET(self) -> None:
        type(self).asked += 1
        found = self.path == "/run.bag"
        self.send_response(200 if found else 302 if self.path.startswith("/away") else 404)
        if self.path == "/away":
            self.send_header("Location", "http://127.0.0.1:1/run.bag")
        if self.path == "/away-well":
            self.send_header("Location", "/run.bag")
        self.send_header("Content-Length", str(len(CONTENT) if found else 0))
        self.end_headers()
        self.wfile.write(CONTENT if found else b"")

    def log_message(self, *_words: object) -> None:
        """Say nothing."""


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, Path]]:
    """Give a server's address and the file of its certificate."""
    folder = tmp_path_factory.mktemp("tls")
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "127.0.0.1")])
    now = datetime.datetime.now(datetime.timezone.utc)
    host = x509.SubjectAlternativeName([x509.IPAddress(ipaddress.ip_address("127.0.0.1"))])
    made = x509.CertificateBuilder().subject_name(name).issuer_name(name).public_key(key.public_key())
    made = made.serial_number(1).not_valid_before(now - datetime.timedelta(days=1))
    made = made.not_valid_after(now + datetime.timedelta(days=1)).add_extension(host, critical=False)
    made = made.add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
    (folder / "cert.pem").write_bytes(made.sign(key, hashes.SHA256()).public_bytes(serialization.Encoding.PEM))
    private = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    (folder / "key.pem").write_bytes(private)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(folder / "cert.pem", folder / "key.pem")
    here = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    here.socket = context.wrap_socket(here.socket, server_side=True)
    threading.Thread(target=here.serve_forever, daemon=True).start()
    yield f"https://127.0.0.1:{here.server_address[1]}", folder / "cert.pem"
    here.shutdown()


@pytest.fixture
def address(server: tuple[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Give the server's address to somebody who trusts it, with an empty cache."""
    monkeypatch.setenv("SSL_CERT_FILE", str(server[1]))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    Handler.asked = 0
    return server[0]


def get(url: str, sha256: str = SHA) -> Path:
    """Return where the file is, downloaded if need be."""
    return found_here(SendData(sha256=sha256, url=url), TURNS, lambda _line: None)


@pytest.mark.parametrize("path", ["/run.bag", "/away-well"])
def test_a_download_is_made_once(address: str, path: str) -> None:
    threads = [threading.Thread(target=get, args=(address + path,)) for _ in range(4)]
    for one in threads:
        one.start()
    for one in threads:
        one.join(20)
    assert get(address + path).read_bytes() == CONTENT
    assert Handler.asked == (1 if path == "/run.bag" else 2)


def test_another_content_is_not_kept(address: str) -> None:
    with pytest.raises(datasets.WrongData, match=SHA):
        get(f"{address}/run.bag", "0" * 64)
    assert list(datasets.folder().iterdir()) == []


@pytest.mark.parametrize(("path", "why"), [("/away", "which is not https"), ("/none", "404")])
def test_what_leads_elsewhere_or_is_not_there_is_an_error(address: str, path: str, why: str) -> None:
    with pytest.raises(OSError, match=why):
        get(address + path)


def test_a_server_that_nobody_vouches_for_is_refused(
    address: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "none.pem").write_text("")
    monkeypatch.setenv("SSL_CERT_FILE", str(tmp_path / "none.pem"))
    with pytest.raises(OSError, match="certificate"):
        get(f"{address}/run.bag")
    assert Handler.asked == 0


HEAD = b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n"


@pytest.mark.parametrize(
    ("first", "then", "pause_s"),
    [
        (b"HTTP/1.1 200 OK\r\n", b"x", 0.05),
        (b"", b"HTTP/1.1 100 Continue\r\n\r\n" * 100, 0.0),
        (HEAD, b"1\r\nx\r\n", 0.05),
        (HEAD + b"0\r\n", b"X: y\r\n" * 100, 0.0),
        (HEAD, b"0000", 0.01),
        (b"HTTP/1.1 302 Found\r\nLocation: /run.bag\r\nTransfer-Encoding: chunked\r\n\r\n", b"1\r\nx\r\n", 0.05),
    ],
    ids=["headers", "continue", "content", "trailers", "length of a chunk", "content of a redirection"],
)
def test_a_server_that_trickles_or_never_ends_is_left(
    address: str, monkeypatch: pytest.MonkeyPatch, first: bytes, then: bytes, pause_s: float
) -> None:
    monkeypatch.setattr("srprov.transport.download._SILENCE_S", 0.5)

    def forever(handler: Handler) -> None:
        with contextlib.suppress(OSError):
            handler.wfile.write(first)
            for _ in range(10_000):
                handler.wfile.write(then)
                time.sleep(pause_s)
        handler.close_connection = True

    plain = Handler.do_GET
    odd = "/odd"
    monkeypatch.setattr(Handler, "do_GET", lambda one: forever(one) if one.path == odd else plain(one))
    began = time.monotonic()
    if b"302" in first:
        assert get(f"{address}/odd").read_bytes() == CONTENT
    else:
        with pytest.raises(OSError, match=r"for 0\.5 s"):
            get(f"{address}/odd")
    assert time.monotonic() - began < 60
