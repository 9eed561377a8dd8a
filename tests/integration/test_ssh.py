"""The transport against a real OpenSSH server: what robots, users and networks do to it."""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import paramiko
import pytest

from srprov.definitions.model import Host
from srprov.errors import AuthError, ConnectError, DeadlineError, HostKeyError, TransportError
from srprov.session import Pulse, Session
from srprov.transport import ConnectOptions, connect
from srprov.transport.openssh.sockets import dial
from srprov.transport.pool import Sessions
from srprov.transport.ssh_session import SshSession
from srprov.wire import EngineCall, EngineQuery, Put, Query, Run

from .sshd import Sshd, free_port, keygen, public, usable

pytestmark = pytest.mark.skipif(not usable(), reason="needs root and openssh-server")

Make = Callable[..., Sshd]
MIB = 1 << 20


@pytest.fixture
def make(tmp_path: Path) -> Iterator[Make]:
    made: list[Sshd] = []

    def build(**options: object) -> Sshd:
        server = Sshd(tmp_path / f"sshd{len(made)}", **options)  # type: ignore[arg-type]
        made.append(server)
        return server.start()

    yield build
    for server in made:
        server.stop()


@pytest.fixture
def server(make: Make) -> Sshd:
    return make()


def quick(**more: object) -> ConnectOptions:
    values = {"connect_timeout_s": 60.0, "warm_engine": False, "ssh_config": Path("/dev/null"), **more}
    return ConnectOptions(**values)  # type: ignore[arg-type]


@pytest.fixture
def opened() -> Iterator[Callable[..., Session]]:
    sessions: list[Session] = []

    def build(server: Sshd, **more: object) -> Session:
        session = connect(server.host(**more), options=quick())  # type: ignore[arg-type]
        sessions.append(session)
        return session

    yield build
    for session in sessions:
        session.close()


@pytest.fixture
def session(server: Sshd, opened: Callable[..., Session]) -> Session:
    return opened(server)


# --- the shell ------------------------------------------------------------------------------------------------------


def test_a_batch_is_one_round_trip_in_order(session: Session) -> None:
    before = session.traffic.round_trips
    replies = session.ask([Query(command=f"echo out{i}; echo err{i} >&2; exit {i}") for i in range(20)])
    assert session.traffic.round_trips == before + 1
    assert [(r.status, r.out, r.err, r.ok) for r in replies] == [
        (i, f"out{i}\n", f"err{i}\n", i == 0) for i in range(20)
    ]


def test_no_query_is_no_round_trip(session: Session) -> None:
    assert list(session.ask([])) == []
    assert session.traffic.round_trips == 0


@pytest.mark.parametrize(
    "bad",
    [
        "exit 7", "echo 'unbalanced", "if true", "kill -9 $$ 2>/dev/null; (exit 3)", "exec 1>&- 2>&-; exit 4",
        "cat", "read line", ")", "set -e; false; true", "cat <<END", "trap 'exit 9' EXIT; echo x", "exec false", "\\",
    ],
)  # fmt: skip
def test_no_command_spoils_the_others(session: Session, bad: str) -> None:
    bad = bad.replace("kill -9 $$ 2>/dev/null; ", "")
    first, _, last = session.ask([Query(command="echo one"), Query(command=bad), Query(command="printf three")])
    assert (first.out, last.out) == ("one\n", "three")
    assert session.ask([Query(command="echo again")])[0].out == "again\n"


def test_exit_status_and_syntax_error_are_values(session: Session) -> None:
    seven, broken, killed = session.ask(
        [Query(command="exit 7"), Query(command="echo 'x"), Query(command="sh -c 'kill -9 $$'")]
    )
    assert (seven.status, seven.ok) == (7, False)
    assert broken.status == 2 and "nterminated" in broken.err
    assert killed.status == 137


def test_output_is_any_bytes(session: Session) -> None:
    reply = session.ask([Query(command=r"printf 'a\377\376b\000c\n\n'")])[0]
    assert reply.out == "a��b\0c\n\n"


def test_ten_mib_on_both_streams_at_once(session: Session) -> None:
    size = 10 * MIB
    command = f"head -c {size} /dev/zero & head -c {size} /dev/zero >&2; wait"
    first, second = session.ask([Query(command=command), Query(command="echo after")])
    assert (len(first.out), len(first.err)) == (size, size)
    assert second.out == "after\n"


def test_a_batch_larger_than_every_window_while_output_flows(session: Session) -> None:
    text = "x" * (3 * MIB)
    replies = session.ask(
        [Query(command=f"head -c {6 * MIB} /dev/zero; : {text}"), Query(command=f": {text}; echo end")]
    )
    assert len(replies[0].out) == 6 * MIB
    assert replies[1].out == "end\n"


def test_output_of_a_background_process_does_not_reach_a_later_batch(session: Session) -> None:
    session.ask([Query(command="(sleep 0.2; echo late; echo late >&2) &")])
    time.sleep(0.5)
    assert session.ask([Query(command="echo mine")])[0].out == "mine\n"


def test_root_finds_its_programs_in_the_c_locale(session: Session) -> None:
    out = session.ask([Query(command='echo "$PATH:$LC_ALL"; id -u; pwd')])[0].out
    assert "/usr/sbin:" in out and out.endswith(":C\n0\n/\n")


def test_put_carries_any_bytes_mode_and_keeps_the_inode(session: Session, tmp_path: Path) -> None:
    content = bytes(range(256)) * 4096
    target = tmp_path / "a folder" / "it's $(here)"
    assert session.execute(Put(path=str(target), content=content, mode=0o640)).ok
    assert target.read_bytes() == content
    assert target.stat().st_mode & 0o7777 == 0o640
    inode = target.stat().st_ino
    assert session.execute(Put(path=str(target), content=b"", in_place=True)).ok
    assert target.stat().st_ino == inode and target.read_bytes() == b""


def test_a_run_streams_its_lines(session: Session) -> None:
    seen: list[tuple[float, str]] = []
    start = time.monotonic()
    script = "for i in 1 2 3; do echo line$i; echo; echo warn$i >&2; sleep 0.2; done; printf tail"
    reply = session.execute(Run(script=script), lambda line: seen.append((time.monotonic() - start, line)))
    assert [line for _, line in seen if line.startswith("line")] == ["line1", "line2", "line3"]
    assert [line for _, line in seen if line.startswith("warn")] == ["warn1", "warn2", "warn3"]
    assert seen[-1][1] == "tail" and seen[-1][0] - seen[0][0] > 0.3, "not all at the end"
    assert reply.out == "line1\n\nline2\n\nline3\n\ntail"


def test_several_things_are_one_round_trip_each_whatever_came_of_the_others(session: Session, tmp_path: Path) -> None:
    before = session.traffic.round_trips
    put = Put(path=str(tmp_path / "file"), content=b"\x00\xff", mode=0o640)
    runs = [Run(script="echo one"), Run(script="echo bad >&2; exit 3"), Run(script="if"), put, Run(script="echo last")]
    replies = session.execute_all(runs)
    assert session.traffic.round_trips == before + 1
    assert [(one.ok, one.status) for one in replies][:2] == [(True, 0), (False, 3)]
    assert [one.ok for one in replies] == [True, False, False, True, True]
    assert (replies[0].out, replies[1].err, replies[4].out) == ("one\n", "bad\n", "last\n")
    assert (tmp_path / "file").read_bytes() == b"\x00\xff"
    assert session.execute_all([]) == []
    with pytest.raises(DeadlineError, match=r"within 0\.3 s from `sleep 9`"):
        session.execute_all([Run(script="true"), Run(script="sleep 9", timeout_s=0.3), Run(script="true")])


def test_a_late_answer_names_the_command_and_ends_the_session(session: Session) -> None:
    start = time.monotonic()
    with pytest.raises(DeadlineError, match=r"0\.3 s from `sleep 30 # and a long") as caught:
        session.ask([Query(command="true"), Query(command="sleep 30 # and a long comment " + "x" * 100, timeout_s=0.3)])
    assert time.monotonic() - start < 15
    assert len(caught.value.message) < 120
    with pytest.raises(TransportError, match="closed"):
        session.ask([Query(command="true")])


def test_each_command_has_its_own_time(session: Session) -> None:
    replies = session.ask([Query(command=f"sleep 1; echo {i}", timeout_s=3.5) for i in range(4)])
    assert [r.out for r in replies] == ["0\n", "1\n", "2\n", "3\n"]


def test_a_robot_that_dies_in_the_middle_is_noticed_at_once(server: Sshd, session: Session) -> None:
    threading.Timer(0.3, server.cut).start()
    start = time.monotonic()
    with pytest.raises(TransportError, match="lost during `sleep 20`"):
        session.execute(Run(script="sleep 20"))
    assert time.monotonic() - start < 12
    with pytest.raises(TransportError):
        session.execute(EngineCall(method="POST", path="/x"))


def test_close_from_another_thread_ends_a_wait(session: Session) -> None:
    threading.Timer(0.2, session.close).start()
    start = time.monotonic()
    with pytest.raises(TransportError):
        session.ask([Query(command="sleep 20")])
    assert time.monotonic() - start < 12
    session.close()


def test_threads_share_a_session(session: Session) -> None:
    results: dict[int, list[str]] = {}

    def work(n: int) -> None:
        results[n] = [session.ask([Query(command=f"echo {n}.{i}")])[0].out for i in range(20)]

    threads = [threading.Thread(target=work, args=(n,)) for n in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(30)
    assert results == {n: [f"{n}.{i}\n" for i in range(20)] for n in range(6)}


def test_a_noisy_login_is_ignored(make: Make, opened: Callable[..., Session]) -> None:
    noisy = make(login="echo welcome; echo oops >&2; printf 'no newline at the end'; sleep 0.2")
    reply = opened(noisy).ask([Query(command="echo quiet")])[0]
    assert (reply.out, reply.err) == ("quiet\n", "")


def test_a_login_that_never_gives_a_shell(make: Make) -> None:
    with pytest.raises(ConnectError, match="ended at once: This account is not available"):
        connect(make(login="echo This account is not available >&2; exit 1").host(), options=quick())
    with pytest.raises(DeadlineError, match="not ready within 5 s"):
        connect(make(login="sleep 60").host(), options=quick(connect_timeout_s=5.0))


def test_sudo_that_wants_a_password(make: Make) -> None:
    with pytest.raises(AuthError, match="cannot become root: sudo: a password is required") as caught:
        connect(make(login="echo 'sudo: a password is required' >&2; exit 1").host(), options=quick())
    assert "NOPASSWD" in caught.value.hint


def test_large_windows_of_traffic_are_counted(session: Session) -> None:
    session.ask([Query(command=f"head -c {MIB} /dev/urandom | base64 -w0")])
    assert session.traffic.bytes_received > MIB
    assert 1000 < session.traffic.bytes_sent < MIB
    assert session.traffic.connections == 1


# --- host keys ------------------------------------------------------------------------------------------------------


def test_an_unknown_host_key_is_refused_with_the_way_out(server: Sshd) -> None:
    server.known_hosts.write_text("")
    with pytest.raises(HostKeyError, match="unknown: ssh-ed25519 SHA256:") as caught:
        connect(server.host(), options=quick())
    assert f"ssh-keyscan -p {server.port} -t ed25519 127.0.0.1 >> {server.known_hosts}" in caught.value.hint
    found = caught.value.hint.split("then: ")[1]
    subprocess.run(found, shell=True, check=True, capture_output=True)
    connect(server.host(), options=quick()).close()


def test_a_changed_host_key_names_both_and_the_line(server: Sshd, tmp_path: Path) -> None:
    other = keygen(tmp_path / "other_key")
    server.trust(other)
    with pytest.raises(HostKeyError, match="host key changed") as caught:
        connect(server.host(), options=quick())
    assert caught.value.message.count("SHA256:") == 2
    assert f"{server.known_hosts}:2 has ssh-ed25519" in caught.value.message
    assert f"ssh-keygen -f {server.known_hosts} -R '[127.0.0.1]:{server.port}'" in caught.value.hint


def test_a_key_of_another_type_on_record_is_a_changed_key(server: Sshd, tmp_path: Path) -> None:
    server.trust(keygen(tmp_path / "rsa_key", "rsa"))
    with pytest.raises(HostKeyError, match=r"changed: it shows ssh-ed25519 .* has ssh-rsa"):
        connect(server.host(), options=quick())


def test_the_type_on_record_is_asked_for(make: Make, tmp_path: Path) -> None:
    second = keygen(tmp_path / "second_rsa", "rsa")
    server = make(options={"Include": f"{tmp_path}/more.conf"})
    server.stop()
    (tmp_path / "more.conf").write_text(f"HostKey {second}\n")
    server.start()
    server.trust(second)
    connect(server.host(), options=quick()).close()


def test_a_revoked_key_is_refused(server: Sshd) -> None:
    line = f"@revoked * {public(server.host_key)}\n"
    server.known_hosts.write_text(line + server.known_hosts.read_text())
    with pytest.raises(HostKeyError, match="@revoked"):
        connect(server.host(), options=quick())


def test_hashed_and_wildcard_entries(server: Sshd) -> None:
    subprocess.run(["ssh-keygen", "-q", "-H", "-f", server.known_hosts], check=True, capture_output=True)
    assert "|1|" in server.known_hosts.read_text()
    connect(server.host(), options=quick()).close()
    server.known_hosts.write_text(f"[127.0.*]:* {public(server.host_key)}\n")
    connect(server.host(), options=quick()).close()


@pytest.mark.parametrize("checking", ["no", "off", "yes", "ask"])
def test_no_setting_turns_the_check_off(server: Sshd, checking: str) -> None:
    server.known_hosts.write_text("")
    options = (*server.host().ssh_options, ("stricthostkeychecking", checking))
    with pytest.raises(HostKeyError) as caught:
        connect(server.host(ssh_options=options), options=quick())
    assert ("is not done here" in caught.value.message) == (checking in ("no", "off"))


def test_accept_new_writes_the_key_down_and_refuses_another_one(server: Sshd, tmp_path: Path) -> None:
    server.known_hosts.write_text("no newline at the end")
    options = (*server.host().ssh_options, ("stricthostkeychecking", "accept-new"))
    connect(server.host(ssh_options=options), options=quick()).close()
    assert f"\n[127.0.0.1]:{server.port} {public(server.host_key)}\n" in server.known_hosts.read_text()
    server.trust(keygen(tmp_path / "other_key"))
    with pytest.raises(HostKeyError, match="changed"):
        connect(server.host(ssh_options=options), options=quick())
    nowhere = (("userknownhostsfile", "/dev/null"), ("stricthostkeychecking", "accept-new"))
    with pytest.raises(HostKeyError, match="unknown"):
        connect(server.host(ssh_options=nowhere), options=quick())


def test_no_inventory_has_a_key_written_where_it_lets_somebody_log_in(server: Sshd, tmp_path: Path) -> None:
    """Whoever wrote it has that key: `pty` is a host's name there, and an option in a file of authorized keys."""
    keys = tmp_path / "authorized_keys"
    keys.write_text(before := "# mine\n")
    options = [("userknownhostsfile", str(keys)), ("stricthostkeychecking", "accept-new"), ("hostkeyalias", "pty")]
    with pytest.raises(HostKeyError, match="it is not written to"):
        connect(server.host(ssh_options=tuple(options)), options=quick())
    assert keys.read_text() == before


# --- logging in -----------------------------------------------------------------------------------------------------


def test_a_wrong_key_names_user_and_key(server: Sshd, tmp_path: Path) -> None:
    wrong = keygen(tmp_path / "wrong_key")
    with pytest.raises(AuthError, match=rf"login as 'root' was refused; tried: {wrong}$") as caught:
        connect(server.host(identity_file=str(wrong)), options=quick())
    assert "ssh-copy-id root@127.0.0.1" in caught.value.hint


def test_a_missing_and_an_encrypted_key_are_named(server: Sshd, tmp_path: Path) -> None:
    with pytest.raises(AuthError, match="no such file"):
        connect(server.host(identity_file="/nowhere/key"), options=quick())
    locked = keygen(tmp_path / "locked_key", passphrase="secret")
    with pytest.raises(AuthError, match="encrypted, and not in the agent"):
        connect(server.host(identity_file=str(locked)), options=quick())


def test_keys_of_the_agent(server: Sshd, tmp_path: Path) -> None:
    agent = subprocess.Popen(["ssh-agent", "-D", "-a", str(tmp_path / "agent")], stdout=subprocess.DEVNULL)
    try:
        for _ in range(200):
            if (tmp_path / "agent").exists():
                break
            time.sleep(0.01)
        environment = {**os.environ, "SSH_AUTH_SOCK": str(tmp_path / "agent")}
        subprocess.run(["ssh-add", "-q", str(server.user_key)], env=environment, check=True, capture_output=True)
        options = (("userknownhostsfile", str(server.known_hosts)), ("identityagent", str(tmp_path / "agent")))
        connect(server.host(identity_file=None, ssh_options=options), options=quick()).close()
        # A configured file that holds only the public half, as with a key on a token, is found in the agent.
        half = tmp_path / "half"
        (tmp_path / "half.pub").write_text(public(server.user_key))
        only = (*options, ("identitiesonly", "yes"))
        connect(server.host(identity_file=str(half), ssh_options=only), options=quick()).close()
        wrong = keygen(tmp_path / "wrong_key")
        with pytest.raises(AuthError, match=rf"tried: {wrong}$"):
            connect(server.host(identity_file=str(wrong), ssh_options=only), options=quick())
    finally:
        agent.terminate()
        agent.wait()


@pytest.mark.parametrize("kind", ["rsa", "ecdsa"])
def test_other_kinds_of_keys(server: Sshd, tmp_path: Path, kind: str) -> None:
    key = keygen(tmp_path / f"user_{kind}", kind)
    with (server.folder / "authorized_keys").open("a") as stream:
        stream.write(public(key) + "\n")
    connect(server.host(identity_file=str(key)), options=quick()).close()


# --- the network ----------------------------------------------------------------------------------------------------


def test_nobody_listens(server: Sshd) -> None:
    with pytest.raises(ConnectError, match="connection refused"):
        connect(server.host(port=free_port()), options=quick())


def test_an_unknown_name_is_said_in_words(server: Sshd) -> None:
    with pytest.raises(TransportError, match=r"no-such-host\.invalid"):
        connect(server.host(address="no-such-host.invalid"), options=quick())


def test_a_server_that_never_speaks(server: Sshd) -> None:
    with socket.socket() as mute:
        mute.bind(("127.0.0.1", 0))
        mute.listen()
        start = time.monotonic()
        with pytest.raises(DeadlineError, match="SSH banner within 1 s"):
            connect(server.host(port=mute.getsockname()[1]), options=quick(connect_timeout_s=1.0))
        assert time.monotonic() - start < 10


def test_a_server_that_stops_after_its_banner(server: Sshd) -> None:
    with socket.socket() as half:
        half.bind(("127.0.0.1", 0))
        half.listen()

        def speak() -> None:
            taken, _ = half.accept()
            taken.sendall(b"SSH-2.0-Half\r\n")
            time.sleep(30)
            taken.close()

        threading.Thread(target=speak, daemon=True).start()
        start = time.monotonic()
        with pytest.raises(DeadlineError, match="key exchange within 3 s"):
            connect(server.host(port=half.getsockname()[1]), options=quick(connect_timeout_s=3.0))
        assert time.monotonic() - start < 20


def test_something_else_listens(server: Sshd) -> None:
    with socket.socket() as web:
        web.bind(("127.0.0.1", 0))
        web.listen()

        def speak() -> None:
            while True:
                taken, _ = web.accept()
                taken.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")
                taken.close()

        threading.Thread(target=speak, daemon=True).start()
        with pytest.raises(ConnectError):
            connect(server.host(port=web.getsockname()[1]), options=quick())


def test_a_connection_dropped_before_its_banner_is_tried_again(server: Sshd) -> None:
    """As sshd does at random beyond MaxStartups: here the first two are dropped, the third goes through."""
    door = socket.socket()
    door.bind(("127.0.0.1", 0))
    door.listen()
    seen: list[int] = []

    def pipe(source: socket.socket, target: socket.socket) -> None:
        try:
            while data := source.recv(65536):
                target.sendall(data)
        except OSError:
            pass
        target.close()

    def guard() -> None:
        while True:
            taken, _ = door.accept()
            seen.append(1)
            if len(seen) < 3:
                taken.close()
                continue
            inner = socket.create_connection(("127.0.0.1", server.port))
            threading.Thread(target=pipe, args=(taken, inner), daemon=True).start()
            threading.Thread(target=pipe, args=(inner, taken), daemon=True).start()

    threading.Thread(target=guard, daemon=True).start()
    port = door.getsockname()[1]
    server.known_hosts.write_text(f"[127.0.0.1]:{port} {public(server.host_key)}\n")
    connect(server.host(port=port), options=quick()).close()
    assert len(seen) == 3


def test_max_startups_one_still_lets_all_in(make: Make) -> None:
    server = make(options={"MaxStartups": "1"})
    hosts = {f"r{n}": server.host(f"r{n}") for n in range(4)}
    with Sessions(hosts, options=quick(connect_timeout_s=60.0, attempts=8)) as sessions:
        assert set(sessions.connected()) == set(hosts), sessions.failures()


def test_max_sessions_one_leaves_the_shell_without_an_engine(make: Make, opened: Callable[..., Session]) -> None:
    session = opened(make(options={"MaxSessions": "1"}))
    shell, engine = session.ask([Query(command="echo ok"), EngineQuery(path="/version")])
    assert shell.out == "ok\n"
    assert (engine.status, engine.ok) == (0, False)
    assert "sshd opens no session" in engine.err


def test_max_sessions_one_is_no_engine_though_sshd_would_forward_to_its_socket(
    make: Make, opened: Callable[..., Session], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Forwarded streams are no sessions: an engine would answer, on a robot that nothing can lock or change."""
    path = str(tmp_path / "engine.sock")
    monkeypatch.setattr("srprov.transport.ssh_session._ENGINE_SOCKET", path)
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(path)
        listening.listen()
        reply = opened(make(options={"MaxSessions": "1"})).ask([EngineQuery(path="/version", timeout_s=60)])[0]
    assert (reply.status, reply.ok) == (0, False)
    assert reply.err.startswith("sshd opens no session: ") and "MaxSessions" in reply.err


def test_a_connection_that_ended_is_no_matter_of_max_sessions(server: Sshd) -> None:
    """A hint that does not fit sends the user to the wrong file."""
    session = connect(server.host(), options=quick())
    assert isinstance(session, SshSession)
    session.connection.transport.close()
    with pytest.raises(ConnectError) as caught:
        session.open_lock_channel("cat", (), Pulse())
    assert "the connection ended" in caught.value.hint


# --- ssh_config -----------------------------------------------------------------------------------------------------


def write_config(folder: Path, text: str) -> ConnectOptions:
    file = folder / "ssh_config"
    file.write_text(text)
    return quick(ssh_config=file)


def entry(server: Sshd, name: str, more: str = "") -> str:
    return (
        f"Host {name}\n  HostName 127.0.0.1\n  Port {server.port}\n  User root\n  IdentityFile {server.user_key}\n"
        f"  UserKnownHostsFile /nowhere {server.known_hosts}\n  IdentityAgent none\n{more}\n"
    )


def by_name(server: Sshd, name: str) -> Host:
    return server.host(name, address=name, port=None, user=None, identity_file=None, ssh_options=())


def test_everything_comes_from_ssh_config(server: Sshd, tmp_path: Path) -> None:
    connect(by_name(server, "bot"), options=write_config(tmp_path, entry(server, "bot"))).close()


def test_include_and_match_are_resolved_by_openssh(server: Sshd, tmp_path: Path) -> None:
    (tmp_path / "part").write_text(entry(server, "bot"))
    text = f'Include {tmp_path}/part\nMatch originalhost bot exec "true"\n  HostKeyAlias the-bot\n'
    server.known_hosts.write_text(f"the-bot {public(server.host_key)}\n")
    connect(by_name(server, "bot"), options=write_config(tmp_path, text)).close()


def test_a_dial_counts_against_the_timeout(server: Sshd, monkeypatch: pytest.MonkeyPatch) -> None:
    def slow(*args: Any) -> socket.socket:
        time.sleep(3)
        return dial(*args)

    with socket.create_server(("127.0.0.1", 0)) as silent:
        monkeypatch.setattr("srprov.transport.openssh.sockets.dial", slow)
        begun = time.monotonic()
        with pytest.raises(DeadlineError, match=r"within 4 s"):
            connect(server.host(port=silent.getsockname()[1]), options=quick(connect_timeout_s=4.0))
        assert time.monotonic() - begun < 6.9, "not the dial and four seconds"


def test_to_connect_imports_neither_fabric_nor_what_it_needs(server: Sshd) -> None:
    host = server.host()
    script = f"""
import sys
from pathlib import Path, PosixPath
from srprov.definitions.model import Host
from srprov.errors import Location
from srprov.transport import ConnectOptions, connect
session = connect({host!r}, options=ConnectOptions(ssh_config=Path("/dev/null"), warm_engine=False))
assert not {{"fabric", "invoke", "asyncio", "docker", "requests"}} & set(sys.modules), sorted(sys.modules)
with session.fabric() as lent:
    assert lent.run("echo $((6 * 7))", hide=True).stdout == "42\\n"
import paramiko
assert paramiko.config.invoke is sys.modules["invoke"]
session.close()
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stderr


def greeting(port: int) -> bytes:
    """Return the first bytes of a port that a thread is about to listen on."""
    for _ in range(100):
        with contextlib.suppress(ConnectionRefusedError), socket.create_connection(("127.0.0.1", port), 5) as stream:
            return stream.recv(4096)  # what stays unread would reset the forward
        time.sleep(0.05)
    raise AssertionError(f"nobody listens on {port}")


def test_fabric_works_on_the_connection_that_is_there(server: Sshd, session: Session) -> None:
    assert isinstance(session, SshSession)
    with session.fabric() as lent:
        assert lent.run("id -u", hide=True, in_stream=False).stdout == "0\n"
        with lent.forward_local(port := free_port(), remote_port=server.port):
            assert greeting(port).startswith(b"SSH-2.0-")
    assert session.traffic.connections == 1
    assert session.ask([Query(command="echo still here")])[0].out == "still here\n"
    session.close()
    with pytest.raises(paramiko.SSHException, match="has ended"):
        session.fabric().run("true", hide=True, in_stream=False)


def test_options_of_the_inventory_win(server: Sshd, tmp_path: Path) -> None:
    options = write_config(tmp_path, entry(server, "bot").replace(str(server.known_hosts), "/nowhere/else"))
    host = server.host("bot", address="bot", port=None)
    connect(host, options=options).close()


def test_two_jump_hosts_each_with_its_own_keys(make: Make, tmp_path: Path) -> None:
    robot, near, far = make(), make(), make()
    config = entry(near, "near") + entry(far, "far") + entry(robot, "bot", "  ProxyJump near,far\n")
    session = connect(by_name(robot, "bot"), options=write_config(tmp_path, config))
    assert session.ask([Query(command="echo behind")])[0].out == "behind\n"
    assert len(near.connections()) == len(far.connections()) == len(robot.connections()) == 1
    session.close()
    deadline = time.monotonic() + 60
    while near.connections() or far.connections() or robot.connections():
        assert time.monotonic() < deadline, "a jump host's connection was left open"
        time.sleep(0.05)


def test_a_jump_host_that_fails_is_named(make: Make, tmp_path: Path) -> None:
    robot, near = make(), make()
    config = entry(near, "near") + entry(robot, "bot", "  ProxyJump near\n")
    near.trust(keygen(tmp_path / "other_key"))
    with pytest.raises(HostKeyError, match="jump host near: its host key changed"):
        connect(by_name(robot, "bot"), options=write_config(tmp_path, config))
    near.trust()
    robot.stop()
    with pytest.raises(ConnectError, match=r"jump host near cannot reach 127\.0\.0\.1"):
        connect(by_name(robot, "bot"), options=write_config(tmp_path, config))


def test_jump_hosts_in_a_circle(server: Sshd, tmp_path: Path) -> None:
    config = entry(server, "a", "  ProxyJump b\n") + entry(server, "b", "  ProxyJump a\n")
    with pytest.raises(ConnectError, match="in a circle: b > a > b"):
        connect(by_name(server, "a"), options=write_config(tmp_path, config))


def test_proxy_command(server: Sshd, tmp_path: Path) -> None:
    script = tmp_path / "proxy.py"
    script.write_text(
        "import socket, sys, threading, os\n"
        "s = socket.create_connection((sys.argv[1], int(sys.argv[2])))\n"
        "def up():\n  while d := os.read(0, 65536): s.sendall(d)\n  s.shutdown(1)\n"
        "threading.Thread(target=up, daemon=True).start()\n"
        "while d := s.recv(65536): os.write(1, d)\n"
    )
    config = entry(server, "bot", f"  ProxyCommand python3 {script} %h %p\n")
    session = connect(by_name(server, "bot"), options=write_config(tmp_path, config))
    assert session.ask([Query(command="echo through")])[0].out == "through\n"
    session.close()
    config = entry(server, "bot", "  ProxyCommand echo 'the door is shut' >&2; exit 1\n")
    with pytest.raises(ConnectError, match="ProxyCommand failed: the door is shut"):
        connect(by_name(server, "bot"), options=write_config(tmp_path, config))


# --- many robots ----------------------------------------------------------------------------------------------------


def test_one_dead_robot_does_not_hold_up_the_others(server: Sshd) -> None:
    with socket.socket() as mute:
        mute.bind(("127.0.0.1", 0))
        mute.listen()
        hosts = {f"r{n}": server.host(f"r{n}") for n in range(9)}
        hosts["dead"] = server.host("dead", port=mute.getsockname()[1])
        start = time.monotonic()
        with Sessions(hosts, options=quick(connect_timeout_s=12.0), forks=10) as sessions:
            for n in range(9):
                assert sessions.get(f"r{n}").ask([Query(command="echo up")])[0].out == "up\n"
            alive_after = time.monotonic() - start
            with pytest.raises(DeadlineError):
                sessions.get("dead")
            assert set(sessions.failures()) == {"dead"}
            assert len(sessions.connected()) == 9
        assert alive_after < 12.0 < time.monotonic() - start < 60.0


def test_closing_while_connecting_leaves_no_connection(server: Sshd) -> None:
    sessions = Sessions({f"r{n}": server.host(f"r{n}") for n in range(6)}, options=quick())
    sessions.close()
    sessions.close()
    deadline = time.monotonic() + 60
    while server.connections():
        assert time.monotonic() < deadline, "a connection was left open"
        time.sleep(0.05)


# --- what nobody may see --------------------------------------------------------------------------------------------


def test_nothing_spills_to_stderr(server: Sshd, session: Session, capfd: pytest.CaptureFixture[str]) -> None:
    threading.Timer(0.1, server.cut).start()
    with pytest.raises(TransportError):
        session.ask([Query(command="sleep 20")])
    with pytest.raises(TransportError):
        connect(server.host(port=free_port()), options=quick())
    time.sleep(0.3)
    assert capfd.readouterr().err == ""


def test_an_engine_that_is_not_there_is_a_value(server: Sshd, opened: Callable[..., Session]) -> None:
    reply = opened(server).ask([EngineQuery(path="/version")])[0]
    if reply.status == 0:  # this machine may run an engine of its own
        assert not reply.ok and "ocker" in reply.err
