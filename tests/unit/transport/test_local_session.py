"""This machine as a robot: the same shell protocol over pipes, and an engine behind a Unix socket (played here)."""

from __future__ import annotations

import contextlib
import gzip
import json
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from msgspec.structs import replace

from srprov.definitions.model import Host
from srprov.errors import DeadlineError, TransportError
from srprov.session import Exec, Session, Traffic
from srprov.transport import connect
from srprov.transport.engine.client import Engine
from srprov.transport.engine.link import EngineLink, EngineSocket
from srprov.wire import CopyImage, EngineCall, EngineQuery, Query, Run
from tests.unit.transport.archives import loadable
from tests.unit.transport.thin_world import Made

pytestmark = pytest.mark.skipif(os.geteuid() != 0, reason="needs root, as the shell is root's")
MIB = 1 << 20


@pytest.fixture
def session() -> Iterator[Session]:
    made = connect(Host(name="here", address="localhost", connection="local"))
    yield made
    made.close()


def test_shell(session: Session) -> None:
    replies = session.ask([Query(command="echo a; echo b >&2; exit 3"), Query(command="echo 'x"), Query(command="cat")])
    assert [(r.status, r.out) for r in replies] == [(3, "a\n"), (2, ""), (0, "")]


def test_both_streams_and_a_long_script(session: Session) -> None:
    size = 10 * MIB
    command = f"head -c {size} /dev/zero & head -c {size} /dev/zero >&2; wait; : {'x' * (3 * MIB)}"
    reply = session.ask([Query(command=command)])[0]
    assert (len(reply.out), len(reply.err)) == (size, size)


def test_deadline_and_death(session: Session) -> None:
    with pytest.raises(DeadlineError, match="sleep 20"):
        session.execute(Run(script="sleep 20", timeout_s=0.2))
    other = connect(Host(name="here", address="localhost", connection="local"))
    with pytest.raises(TransportError, match="status"):
        other.ask([Query(command="kill -9 $$"), Query(command="sleep 5")])
    other.close()


def test_measures(session: Session) -> None:
    found = session.measure()
    assert found and found.cpus >= 1 and 0 < found.memory_available <= found.memory_total
    assert "lo" in found.link_speed_mbit


def test_importing_the_room_is_cheap() -> None:
    heavy = "('paramiko', 'fabric', 'docker', 'requests')"
    code = f"import sys, srprov.transport, srprov.transport.pool; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


# --- an engine that is played ---------------------------------------------------------------------------------------

Answer = Callable[[str, dict[str, str], bytes], bytes]


def reply(body: bytes, status: str = "200 OK", more: str = "") -> bytes:
    return f"HTTP/1.1 {status}\r\nApi-Version: 1.41\r\nContent-Length: {len(body)}\r\n{more}\r\n".encode() + body


class PlayedEngine:
    """Speaks HTTP/1.1 with keep-alive on a Unix socket; `answer` decides what it says, b"" hangs up."""

    def __init__(self, path: Path, answer: Answer) -> None:
        self.requests: list[str] = []
        self.connections = 0
        self.hang_up_after = b""
        """The answer after which it hangs up."""
        self.trickle = (b"", 0.0)
        """An answer's head, after which bytes come one by one, so many seconds apart."""
        self.trickled = b"x"
        """What comes then, again and again for some seconds."""
        self._answer = answer
        self._server = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._server.bind(str(path))
        self._server.listen()
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        while True:
            taken, _ = self._server.accept()
            self.connections += 1
            threading.Thread(target=self._serve_one, args=(taken,), daemon=True).start()

    def _serve_one(self, sock: socket.socket) -> None:
        with contextlib.suppress(ConnectionResetError):  # a client that has enough hangs up
            self._serve(sock)

    def _serve(self, sock: socket.socket) -> None:
        stream = sock.makefile("rb")
        while line := stream.readline().decode():
            headers: dict[str, str] = {}
            while header := stream.readline().decode().strip():
                key, _, value = header.partition(": ")
                headers[key.lower()] = value
            body = stream.read(int(headers.get("content-length", 0)))
            if headers.get("transfer-encoding") == "chunked":
                while size := int(stream.readline() or b"0", 16):
                    body += stream.read(size)
                    stream.readline()
                stream.readline()
            method, path, _ = line.split(" ")
            self.requests.append(f"{method} {path}")
            answer = reply(b"OK") if path == "/_ping" else self._answer(f"{method} {path}", headers, body)
            if not answer:
                if self.hang_up_after:
                    sock.sendall(self.hang_up_after)
                with contextlib.suppress(OSError):
                    self._trickle(sock, *self.trickle)
                break
            with contextlib.suppress(BrokenPipeError):
                sock.sendall(answer)
        sock.close()

    def _trickle(self, sock: socket.socket, head: bytes, pause_s: float) -> None:
        sock.sendall(head)
        until = time.monotonic() + 20
        while head and time.monotonic() < until:
            time.sleep(pause_s)
            sock.sendall(self.trickled)


@pytest.fixture
def play(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[Answer], PlayedEngine]:
    def start(answer: Answer) -> PlayedEngine:
        path = tmp_path / "docker.sock"
        monkeypatch.setenv("DOCKER_HOST", f"unix://{path}")
        return PlayedEngine(path, answer)

    return start


def test_engine_queries_share_one_connection(session: Session, play: Callable[[Answer], PlayedEngine]) -> None:
    engine = play(lambda request, _h, _b: reply(request.encode(), "404 Not Found" if "nope" in request else "200 OK"))
    a, shell, b = session.ask(
        [
            EngineQuery(path="/images/a b/json", params=(("filters", '{"label":["x=1"]}'),)),
            Query(command="echo s"),
            EngineQuery(path="/nope"),
        ]
    )
    assert a.out == "GET /images/a%20b/json?filters=%7B%22label%22%3A%5B%22x%3D1%22%5D%7D"
    assert (shell.out, b.status, b.ok) == ("s\n", 404, False)
    assert engine.connections == 1 and len(engine.requests) == 2


def test_a_batch_of_engine_queries_is_one_round_trip(session: Session, play: Callable[[Answer], PlayedEngine]) -> None:
    """All requests are there before the first answer is read; bodies of any length are cut apart again."""
    sizes = {f"/{size}": size for size in (0, 1, 70_000, 300_000, 5)}
    play(lambda request, *_: reply(b"x" * sizes[request.split()[1]]))
    before = session.traffic.round_trips
    replies = session.ask([EngineQuery(path=path) for path in sizes])
    assert [len(one.out) for one in replies] == list(sizes.values())
    assert session.traffic.round_trips == before + 1


def test_an_engine_that_dies_in_a_batch(session: Session, play: Callable[[Answer], PlayedEngine]) -> None:
    """What it said before counts; and it is asked again, once, when it may have been an idle stream that ended."""
    engine = play(lambda request, *_: b"" if "bad" in request else reply(b"1"))
    good, bad, rest = session.ask([EngineQuery(path="/good"), EngineQuery(path="/bad"), EngineQuery(path="/fine")])
    assert good.ok and (bad.status, rest.status) == (0, 0) and bad.err
    assert session.ask([EngineQuery(path="/good")])[0].ok
    before = engine.connections
    assert session.ask([EngineQuery(path="/bad")])[0].status == 0
    assert engine.connections == before + 1


@pytest.mark.parametrize(
    "said",
    [
        b"SSH-2.0-OpenSSH\r\n",
        b"HTTP/1.1 banana\r\n\r\n",
        b"\0" * 70_000,
        b"HTTP/1.1 200 OK\r\nContent-Length: 9\r\n\r\n",
        b"HTTP/1.1 200 OK\r\nContent-Length: 99999999999999999\r\n\r\nx",
        b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\nffffffffffff\r\nx",
        b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\nno number\r\nx",
    ],
)
def test_what_is_no_engine_is_a_value(session: Session, play: Callable[[Answer], PlayedEngine], said: bytes) -> None:
    """Whatever comes instead of HTTP, or an answer that stays away, is a reply in words, and soon."""
    play(lambda *_: said)
    call = EngineCall(method="POST", path="/x", timeout_s=0.5)
    one = session.ask([EngineQuery(path="/x", timeout_s=0.5)])[0]
    for reply in (one, session.execute(call), session.execute(replace(call, stream=True))):
        late = reply is one and "did not answer within" in reply.err
        assert (reply.status, reply.ok) == (504 if late else 0, False) and reply.err
    with pytest.raises(TransportError, match="stopped giving"):
        list(session.save_image("a:1", 0.5))


@pytest.mark.parametrize("size", [b"-1", b"-5", b"-ffffffffffffffffffff"])
@pytest.mark.parametrize("status", [b"200 OK", b"201 Created", b"404 Not Found"])
def test_pieces_of_less_than_nothing_are_refused(
    session: Session, play: Callable[[Answer], PlayedEngine], size: bytes, status: bytes
) -> None:
    """Of -1 bytes, http.client keeps all that comes, gigabytes; other such sizes ended the verb for all robots."""
    play(lambda *_: b"HTTP/1.1 " + status + b"\r\nTransfer-Encoding: chunked\r\n\r\n" + size + b"\r\n" + b"x" * MIB)
    call, refused = EngineCall(method="POST", path="/x", timeout_s=5), "pieces of a length that is none"
    one = session.ask([EngineQuery(path="/x", timeout_s=5)])[0]
    for reply in (one, session.execute(call), session.execute(replace(call, stream=True, accept=(200, 201, 404)))):
        assert (reply.status, reply.ok) == (0, False) and refused in reply.err
    starts: tuple[Callable[[], object], ...] = (
        lambda: list(session.save_image("a:1", 5)),
        lambda: list(session.copy_out("a", "/x")),
        lambda: session.run_in("a", Exec(command=("true",))),
    )
    for start in starts:
        with pytest.raises(TransportError, match=refused):
            start()


def test_an_answer_that_is_too_long_is_a_value(
    session: Session, play: Callable[[Answer], PlayedEngine], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("srprov.transport.engine.reads._LONGEST_ANSWER", MIB)
    play(lambda *_: reply(b"x" * (2 * MIB)))
    one = session.ask([EngineQuery(path="/x")])[0]
    assert (one.status, one.ok) == (200, False) and "longer than 1 MiB" in one.err


def test_a_redirection_is_not_followed(session: Session, play: Callable[[Answer], PlayedEngine]) -> None:
    """A robot could send the controller to any place that the controller can reach."""
    engine = play(lambda *_: reply(b"", "302 Found", more="Location: http://127.0.0.1:1/\r\n"))
    assert session.execute(EngineCall(method="POST", path="/x")).status == 302
    with pytest.raises(TransportError):
        list(session.save_image("a:1", 5))
    assert [one.split()[1] for one in engine.requests] == ["/_ping", "/v1.41/x", "/v1.41/images/a:1/get"]


def test_nothing_of_this_machines_docker_user_goes_to_a_robot(
    session: Session, play: Callable[[Answer], PlayedEngine], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its configuration may hold passwords of registries and of proxies."""
    (tmp_path / "config.json").write_text(
        '{"HttpHeaders": {"X-Token": "hunter2"}, "auths": {"r": {"auth": "aHVudGVyMjpodW50ZXIy"}},'
        ' "proxies": {"default": {"httpProxy": "http://hunter2@proxy"}}}'
    )
    monkeypatch.setenv("DOCKER_CONFIG", str(tmp_path))
    monkeypatch.setenv("HTTP_PROXY", "http://hunter2@127.0.0.1:1")
    got: list[str] = []

    def answer(_request: str, headers: dict[str, str], _body: bytes) -> bytes:
        got.append(str(headers))
        return reply(b'{"status":"fine"}\r\n')

    play(answer)
    assert session.execute(EngineCall(method="POST", path="/images/create", stream=True)).ok
    assert list(session.save_image("a:1", 5))
    assert len(got) == 2 and "hunter2" not in "".join(got) and "aHVudGVy" not in "".join(got)


def test_a_closed_idle_connection_is_opened_again(session: Session, play: Callable[[Answer], PlayedEngine]) -> None:
    engine = play(lambda *_: reply(b"{}", more="Connection: close\r\n"))
    for _ in range(3):
        assert session.ask([EngineQuery(path="/version")])[0].ok
    assert engine.connections >= 3


def test_an_engine_that_hangs_up_or_is_silent_is_a_value(
    session: Session, play: Callable[[Answer], PlayedEngine]
) -> None:
    def answer(request: str, _headers: dict[str, str], _body: bytes) -> bytes:
        if "slow" in request:
            time.sleep(2)
        return b""

    play(answer)
    gone = session.ask([EngineQuery(path="/version")])[0]
    assert (gone.status, gone.ok) == (0, False) and gone.err
    late = session.ask([EngineQuery(path="/slow", timeout_s=0.3)])[0]
    assert (late.status, late.err) == (504, "the Docker Engine did not answer within 0.3 s")


def test_no_engine_at_all(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DOCKER_HOST", "unix:///nowhere/docker.sock")
    first, second = session.ask([EngineQuery(path="/version"), EngineQuery(path="/info")])
    assert first == second and first.status == 0
    assert "no Docker Engine at unix:///nowhere/docker.sock" in first.err
    monkeypatch.setenv("DOCKER_HOST", "ssh://elsewhere")
    assert "not supported" in session.ask([EngineQuery(path="/version")])[0].err


def test_a_stream_that_fails_gives_its_last_lines(session: Session, play: Callable[[Answer], PlayedEngine]) -> None:
    body = (
        b"".join(b'{"stream":"Step %d\\n"}\r\n' % n for n in range(20))
        + b'{"errorDetail":{"message":"code 3"},"error":"code 3"}\r\n'
    )
    play(lambda *_: reply(body))
    seen: list[str] = []
    done = session.execute(EngineCall(method="POST", path="/build", blob=b"tar", stream=True), seen.append)
    assert (done.ok, done.err, len(seen)) == (False, "code 3", 20)
    assert done.out.splitlines() == [f"Step {n}" for n in range(5, 20)]


def test_a_call_sends_its_body_and_judges_the_status(session: Session, play: Callable[[Answer], PlayedEngine]) -> None:
    got: list[tuple[str, bytes]] = []

    def answer(_request: str, headers: dict[str, str], body: bytes) -> bytes:
        got.append((headers.get("content-type", ""), body))
        return reply(b'{"message":"name in use"}', "409 Conflict")

    play(answer)
    call = EngineCall(method="POST", path="/containers/create", params=(("name", "a&b"),), body='{"Image":"ä"}')
    done = session.execute(call)
    assert (done.status, done.ok, done.err) == (409, False, "name in use")
    assert got == [("application/json", '{"Image":"ä"}'.encode())]
    assert session.execute(EngineCall(method="DELETE", path="/x", accept=(204, 409))).ok


def test_an_image_is_copied_without_being_held(play: Callable[[Answer], PlayedEngine]) -> None:
    layer = os.urandom(5 * MIB)
    made = Made(layer)
    image = made.saved(["a:1"])
    said = json.dumps({"Id": made.id, "RootFS": {"Layers": made.diff_ids}}).encode()
    loaded: list[bytes] = []

    def answer(request: str, _headers: dict[str, str], body: bytes) -> bytes:
        if "/get" in request:
            return reply(b'{"message":"no such image"}', "404 Not Found") if "nope" in request else reply(image)
        if "/json" in request or "/info" in request:
            return reply(said if "1/json" in request else b"{}")
        loaded.append(body)
        return reply(b'{"stream":"Loaded image: a:1\\n"}\r\n')

    play(answer)
    source = connect(Host(name="source", address="x", connection="local"))
    target = connect(Host(name="target", address="x", connection="local"), peers=lambda _name: source)
    seen: list[str] = []
    assert target.execute(CopyImage(image="a:1", source_host="source", way="whole"), seen.append).ok
    assert len(loaded) == 1 and layer in loaded[0] and loadable(loaded[0]) == {"a:1": layer}
    assert any("MiB copied" in line for line in seen)
    other = target.execute(CopyImage(image="a:1", source_host="source", way="whole", id=f"sha256:{'0' * 64}"))
    assert not other.ok and other.err.startswith("source: it gives another image under a:1 than the one that was built")
    failed = target.execute(CopyImage(image="nope:1", source_host="source", way="whole"))
    assert (failed.ok, failed.err) == (False, "source: its engine cannot give nope:1: no such image")
    assert target.ask([EngineQuery(path="/info")])[0].ok, "the target's engine is usable after a copy that failed"
    for _ in range(6):  # more than there are connections
        next(source.save_image("a:1", 5))
    assert len(b"".join(source.save_image("a:1", 5))) == len(image), "a copy that nobody took to its end blocks nothing"
    target.close()
    source.close()


def test_a_call_waits_for_the_connection_that_is_being_opened(
    session: Session, play: Callable[[Answer], PlayedEngine]
) -> None:
    """sshd opens few sessions (MaxSessions): one beside that which is coming might be refused."""
    played = play(lambda *_: reply(b"{}", "201 Created"))
    dialled: list[float] = []
    begun = threading.Event()

    def dial(seconds: float) -> EngineSocket:
        dialled.append(seconds)
        begun.set()
        time.sleep(0.2)
        return session._dial_changes(seconds)  # type: ignore[attr-defined]  # it is a LocalSession

    engine = Engine(EngineLink(host="here", dial=dial, alive=lambda: True, traffic=Traffic()))
    warming = threading.Thread(target=engine.warm, args=("1.41",))
    warming.start()
    assert begun.wait(10)
    assert engine.call(EngineCall(method="POST", path="/x"), lambda _line: None).ok
    warming.join(10)
    assert len(dialled) == 1
    assert played.requests == ["POST /v1.41/x"], "the version was known, so nobody asked for it"
    engine.close()
    engine.warm("1.41")  # closed: whoever asks gets the reason


def test_more_requests_than_connections_take_turns(session: Session, play: Callable[[Answer], PlayedEngine]) -> None:
    def answer(*_: object) -> bytes:
        time.sleep(0.1)
        return reply(b"{}")

    engine = play(answer)
    results: list[bool] = []
    threads = [
        threading.Thread(target=lambda: results.append(session.ask([EngineQuery(path="/x")])[0].ok)) for _ in range(10)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(10)
    assert results == [True] * 10
    assert engine.connections <= 4


def test_a_log_is_followed_line_by_line(session: Session, play: Callable[[Answer], PlayedEngine]) -> None:
    frames = b"".join(bytes([kind, 0, 0, 0, 0, 0, 0, len(text)]) + text for kind, text in [(1, b"a\nb"), (2, b"c\n")])
    engine = play(lambda *_: reply(frames))
    assert list(session.container_log("web", tail=5, follow=True)) == ["a", "bc"]
    assert engine.requests[-1] == "GET /v1.41/containers/web/logs?stdout=1&stderr=1&tail=5&follow=1"


@pytest.mark.parametrize("end", [b"0\r\n\r\n", b""])
def test_a_log_whose_connection_is_lost_is_no_end_of_the_log(
    session: Session, play: Callable[[Answer], PlayedEngine], end: bytes
) -> None:
    head = b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\nConnection: close\r\n\r\n"
    engine = play(lambda *_: b"")
    engine.hang_up_after = head + b"a\r\n\1\0\0\0\0\0\0\2a\n\r\n" + end
    log = session.container_log("web", tail=5, follow=True)
    assert next(log) == "a"
    with contextlib.nullcontext() if end else pytest.raises(TransportError, match="the log of web ended"):
        assert list(log) == []


def test_all_answers_of_a_batch_have_a_limit_together(
    session: Session, play: Callable[[Answer], PlayedEngine], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("srprov.transport.engine.reads._LONGEST_BATCH", MIB)
    play(lambda *_: reply(b'"' + b"x" * 600_000 + b'"'))
    first, second = session.ask([EngineQuery(path="/images/json"), EngineQuery(path="/networks")])
    assert first.ok and not second.ok and "answer to /networks is longer than" in second.err
    assert second.status == 200, "there is an engine, and what it has is not known"


@pytest.mark.parametrize(
    "said", ["[" + "[]," * 400_001 + "0]", "no JSON", ""], ids=["more lists than are read", "text", "nothing"]
)
def test_an_answer_that_is_not_read_is_no_empty_one(
    session: Session, play: Callable[[Answer], PlayedEngine], said: str
) -> None:
    """What it lists would pass for gone: `destroy` did nothing, and said that it was done."""
    play(lambda request, *_: reply(b"null" if "changes" in request else said.encode()))
    (one, other) = session.ask([EngineQuery(path="/containers/json"), EngineQuery(path="/containers/a/changes")])
    assert (one.ok, one.status) == (False, 200)
    assert one.err.startswith("the Docker Engine's answer to /containers/json cannot be read")
    assert other.ok, "which is JSON"


def test_a_compressed_answer_is_refused(session: Session, play: Callable[[Answer], PlayedEngine]) -> None:
    """A few bytes may become gigabytes, and nobody asked for them."""
    bomb = gzip.compress(b"x" * (64 * MIB))
    play(lambda *_: reply(bomb, more="Content-Encoding: gzip\r\n"))
    call = EngineCall(method="POST", path="/x")
    for done in (session.execute(call), session.execute(replace(call, stream=True))):
        assert not done.ok and "compressed" in done.err


def test_an_engine_is_not_listened_to_beyond_the_lines_that_were_asked_for(
    session: Session, play: Callable[[Answer], PlayedEngine]
) -> None:
    play(lambda *_: reply(b"a\n" * 50_000))
    assert list(session.container_log("web", tail=3, follow=False)) == ["a"] * 3
    assert list(session.container_log("web", tail=0, follow=False)) == []


def test_a_log_is_not_cut_because_its_reader_takes_time(
    session: Session, play: Callable[[Answer], PlayedEngine], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only silence of the engine is limited: three million lines take a terminal longer than a minute."""
    monkeypatch.setattr("srprov.transport.engine.client._LOG_TIMEOUT_S", 1.0)
    play(lambda *_: reply((b"x" * 99 + b"\n") * 20_000))
    log = session.container_log("web", tail=20_000, follow=False)
    assert next(log) == "x" * 99
    time.sleep(1.2)
    assert sum(1 for _ in log) == 19_999


def test_a_log_that_trickles_ends(
    session: Session, play: Callable[[Answer], PlayedEngine], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A byte now and then is no silence, and no log that was asked for up to its end."""
    monkeypatch.setattr("srprov.transport.engine.client._LOG_TIMEOUT_S", 0.3)
    engine = play(lambda *_: b"")
    engine.trickle = b"HTTP/1.1 200 OK\r\nConnection: close\r\n\r\n", 0.05
    began = time.monotonic()
    with pytest.raises(TransportError, match="the log of web ended: the Docker Engine did not answer within"):
        list(session.container_log("web", tail=5, follow=False))
    assert time.monotonic() - began < 30
