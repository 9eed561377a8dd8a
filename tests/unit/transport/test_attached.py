"""A command in a container, over an engine that is played: what is sent to it, and what it may answer."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from srprov.definitions.model import Host
from srprov.errors import TransportError
from srprov.session import Exec, Session
from srprov.transport import connect
from tests.unit.transport.test_local_session import Answer, PlayedEngine, pytestmark, reply

__all__ = ["pytestmark"]

ID = "e" * 64
WHAT = Exec(command=("sh", "-c", "it's $(reboot)"), environment=("A=b c",), user="1000", folder="/tmp", stdin=True)
UPGRADED = b"HTTP/1.1 101 UPGRADED\r\nConnection: Upgrade\r\nUpgrade: tcp\r\n\r\n"


def frame(stream: int, data: bytes) -> bytes:
    """Return output as an engine frames it."""
    return bytes([stream, 0, 0, 0]) + len(data).to_bytes(4, "big") + data


@pytest.fixture
def play(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[Answer], PlayedEngine]:
    """Give a function that plays an engine, which this machine is asked for then."""

    def begin(answer: Answer) -> PlayedEngine:
        monkeypatch.setenv("DOCKER_HOST", f"unix://{tmp_path}/engine.sock")
        return PlayedEngine(tmp_path / "engine.sock", answer)

    return begin


@pytest.fixture
def session() -> Iterator[Session]:
    """Give this machine as a robot."""
    made = connect(Host(name="here", address="localhost", connection="local"))
    yield made
    made.close()


class Commands:
    """An engine's answers to a command."""

    def __init__(self, output: bytes, ended: object) -> None:
        self.output, self.ended, self.told = output, ended, b""

    def __call__(self, request: str, headers: dict[str, str], body: bytes) -> bytes:
        if request.endswith("/exec"):
            self.told = body
            return reply(json.dumps({"Id": ID}).encode(), "201 Created")
        if request.endswith(f"/exec/{ID}/start"):
            assert (headers["upgrade"], json.loads(body)) == ("tcp", {"Detach": False, "Tty": False})
            return UPGRADED + self.output
        return reply(json.dumps(self.ended).encode())


def test_a_command_travels_as_json_and_its_streams_come_apart(
    session: Session, play: Callable[[Answer], PlayedEngine]
) -> None:
    """On one connection of its own; nothing of it passes a shell."""
    answers = Commands(
        frame(1, b"one\x00") + frame(2, b"two") + frame(1, b"x" * 100_000), {"Running": False, "ExitCode": 3, "Pid": 9}
    )
    engine = play(answers)
    engine.trickle = (b"", 0.0)
    running = session.run_in("srprov.a.b", WHAT)
    got: list[tuple[int, bytes]] = []
    for stream, data in running.output():
        got.append((stream, data))
        if sum(len(one) for _, one in got) == 100_007:
            break
    assert got[:2] == [(1, b"one\x00"), (2, b"two")]
    assert running.exit_code() == 3
    running.close()
    assert engine.requests[:2] == ["POST /containers/srprov.a.b/exec", f"POST /exec/{ID}/start"]
    assert json.loads(answers.told) == {
        "AttachStdin": True, "AttachStdout": True, "AttachStderr": True, "Tty": False, "Env": ["A=b c"],
        "Cmd": ["sh", "-c", "it's $(reboot)"], "User": "1000", "WorkingDir": "/tmp",
    }  # fmt: skip


def test_what_the_engine_refuses_is_said_in_its_words(session: Session, play: Callable[[Answer], PlayedEngine]) -> None:
    play(lambda request, headers, body: reply(b'{"message":"container is not running"}', "409 Conflict"))
    with pytest.raises(
        TransportError, match=r"no command can be run in srprov\.a\.b: container is not running"
    ) as caught:
        session.run_in("srprov.a.b", WHAT)
    assert caught.value.hint == "srprov logs says what it printed, srprov start starts it again"


@pytest.mark.parametrize(
    "answer",
    [
        reply(b'{"Id":"../../images/x"}', "201 Created"),
        reply(b'{"Id":7}', "201 Created"),
        reply(b"[" * 100_000, "201 Created"),
        b"SSH-2.0-x\r\n\r\n",
        b"HTTP/1.1 201 Created\r\nContent-Length: 4\r\n\r\n{}",
    ],
)
def test_what_is_no_answer_of_an_engine_is_refused(
    session: Session, play: Callable[[Answer], PlayedEngine], answer: bytes
) -> None:
    engine = play(lambda request, headers, body: b"")
    engine.hang_up_after = answer
    with pytest.raises(TransportError, match="no command can be run"):
        session.run_in("srprov.a.b", WHAT)


@pytest.mark.parametrize(
    ("ended", "code"),
    [
        ({"Running": False, "ExitCode": 0, "Pid": 9}, 0),
        ({"Running": False, "ExitCode": 127, "Pid": 9}, 127),
        ({"Running": False, "ExitCode": 127, "Pid": 0}, None),
        ({"Running": False, "ExitCode": 1 << 40, "Pid": 9}, 255),
        ({"Running": False, "ExitCode": "x", "Pid": 9}, 255),
        ({"Running": False, "Pid": []}, None),
    ],
)
def test_a_code_is_a_commands_own_only_where_it_was_run(
    session: Session, play: Callable[[Answer], PlayedEngine], ended: object, code: int | None
) -> None:
    play(Commands(b"", ended))
    running = session.run_in("srprov.a.b", WHAT)
    assert running.exit_code() == code
    running.close()


def test_output_of_no_form_is_no_output(session: Session, play: Callable[[Answer], PlayedEngine]) -> None:
    play(Commands(b"HTTP/1.1 200 OK\r\n\r\n", {}))
    running = session.run_in("srprov.a.b", WHAT)
    with pytest.raises(TransportError, match="what it sends of a command has no form"):
        list(running.output())
    running.close()
