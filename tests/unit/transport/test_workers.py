"""The seam: sessions in worker processes are what sessions here are, whatever becomes of those processes."""

from __future__ import annotations

import contextlib
import os
import re
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import srprov
from srprov.codes import Code
from srprov.definitions.model import Host
from srprov.errors import ConnectError, DeadlineError, TransportError
from srprov.secret import Secret, Vault, forget, redact
from srprov.session import Pulse, Session
from srprov.transport import ConnectOptions
from srprov.transport.background import background
from srprov.transport.pool import Sessions
from srprov.transport.workers import link, processes
from srprov.transport.workers.counting import shard, wanted_workers
from srprov.transport.workers.far_session import FarSession
from srprov.transport.workers.program import start_words
from srprov.transport.workers.sealed import packed, unpacked
from srprov.wire import AnyQuery, EngineQuery, Put, Query, Run
from tests.unit.transport.waiting import wait_until

CANARY = "canary-4f1d9e-swordfish"
PULSE = Pulse(beat_s=1, controller_s=20, robot_s=30)
LOCK = """echo "locked $1"
while letter=$(dd bs=1 count=1 2>/dev/null) && [ "$letter" ]; do
    case $letter in b) echo b;; t) echo mine;; e) exit;; esac
done"""
as_root = pytest.mark.skipif(os.geteuid() != 0, reason="needs root, as a robot's shell is root's")


@pytest.fixture(autouse=True)
def _none_left() -> Iterator[None]:
    """Secrets are known to the whole process: no test sees those of another."""
    forget()
    yield
    forget()


def local(*names: str, **more: Any) -> dict[str, Host]:
    return {name: Host(name=name, address=name, connection="local", **more) for name in names}


@contextlib.contextmanager
def sharded(hosts: dict[str, Host], workers: int = 2, vault: Vault | None = None) -> Iterator[Sessions]:
    options = ConnectOptions(connect_timeout_s=60, warm_engine=False, vault=vault or Vault())
    with Sessions(hosts, options=options, workers=workers) as sessions:
        yield sessions


def pids(sessions: Sessions) -> list[int]:
    assert sessions._workers is not None
    return [one.program.process.pid for one in sessions._workers._workers]


def infos_of_sockets(pid: int) -> list[str]:
    """Return what the kernel tells of a process's sockets. A file that it closes meanwhile is none of them."""
    infos = []
    for one in Path(f"/proc/{pid}/fd").iterdir():
        with contextlib.suppress(FileNotFoundError):
            if str(one.readlink()).startswith("socket:"):
                infos.append(Path(f"/proc/{pid}/fdinfo/{one.name}").read_text())
    return infos


def apart(count: int = 2) -> tuple[str, str]:
    """Give the names of two robots that different workers have."""
    names = [f"r{number}" for number in range(20)]
    first = names[0]
    return first, next(name for name in names if shard(name, count) != shard(first, count))


def robot_of(sessions: Sessions, hosts: dict[str, Host], worker: int) -> str:
    return next(name for name in hosts if shard(name, len(pids(sessions))) == worker)


def ended(session: Session) -> bool:
    assert isinstance(session, FarSession)
    return session._link.over.is_set()


def runs_until_closed(session: Session) -> None:
    with contextlib.suppress(TransportError):
        session.execute(Run(script="sleep 99", timeout_s=200))


# --- a session there is a session here --------------------------------------------------------------------------------


@as_root
def test_robots_are_in_processes_by_their_names_and_all_answers_are_the_same() -> None:
    hosts = local(*(f"r{number}" for number in range(6)))
    asked: list[AnyQuery] = [
        Query(command="printf 'a\\377b'; echo err >&2; exit 3"),
        EngineQuery(path="/none"),
        Query(command="pwd"),
    ]
    with Sessions(hosts, options=ConnectOptions(warm_engine=False)) as here:
        wanted = {name: here.get(name).ask(asked) for name in hosts}
    with sharded(hosts) as there:
        assert {name: there.get(name).ask(asked) for name in hosts} == wanted
        parents = {name: int(there.get(name).ask([Query(command="echo $PPID")])[0].out) for name in hosts}
        assert parents == {name: pids(there)[shard(name, 2)] for name in hosts}
        assert set(parents.values()) == set(pids(there)), "a worker without a robot shows nothing"
        assert os.getpid() not in parents.values()
        assert there.get("r0").traffic.round_trips == 2 and there.get("r0").measure() is not None


@as_root
def test_a_change_tells_its_lines_in_order_and_before_it_ends(tmp_path: Path) -> None:
    with sharded(local("r0")) as sessions:
        session, said = sessions.get("r0"), list[str]()
        reply = session.execute(Run(script="for i in $(seq 500); do echo line $i; done"), said.append)
        assert reply.ok and said == [f"line {number}" for number in range(1, 501)]
        replies = session.execute_all([Run(script="exit 4"), Put(path=str(tmp_path / "f"), content=b"\0x")])
        assert [one.status for one in replies] == [4, 0] and (tmp_path / "f").read_bytes() == b"\0x"


@as_root
def test_who_is_slow_to_take_lines_slows_down_who_sends_them() -> None:
    """What a robot prints without end must not pile up in the memory of either process."""
    taken, go_on = list[str](), threading.Event()

    def take(line: str) -> None:
        taken.append(line)
        go_on.wait(60)

    with sharded(local("r0")) as sessions:
        session = sessions.get("r0")
        assert isinstance(session, FarSession)
        number = session._handle.number
        many = Run(script="i=0; while [ $i -lt 4000 ]; do i=$((i + 1)); echo $i; done")
        work = threading.Thread(target=session.execute, args=(many, take))
        work.start()
        wait_until(lambda: taken, "a first line")
        time.sleep(0.5)
        queues = [answers.qsize() for answers in session._link._answers.values()]
        assert max(queues) < 100, "lines are read ahead without end"
        assert session._link.call(number, "host") == "r0", "others do not wait for it"
        go_on.set()
        work.join(60)
        assert len(taken) == 4000


@as_root
def test_a_shell_of_its_own_and_a_lock_cross_the_seam() -> None:
    with sharded(local("r0")) as sessions:
        session = sessions.get("r0")
        streams = session.open_shell("echo ready; read -r word; echo got $word; echo bad >&2; exit 0")
        out = err = b""
        until, sent = time.monotonic() + 60, 0
        while not streams.ended and time.monotonic() < until:
            streams.wait(0.2, writing=False)
            some = streams.read()
            out, err = out + some[0], err + some[1]
            if out and not sent:  # before that, the shell would take it for a line of its script
                sent = streams.write(memoryview(b"it\n"))
        streams.close()
        assert (sent, out, err) == (3, b"ready\ngot it\n", b"bad\n")
        lock = session.open_lock_channel(LOCK, ["w"], PULSE)
        assert lock.first_answer.startswith("locked ") and lock.send("t") == "mine"
        lock.close()
        lock.close()


# --- errors -----------------------------------------------------------------------------------------------------------


@as_root
def test_errors_of_a_robot_are_of_the_same_kind_with_the_same_words() -> None:
    late = [Query(command="sleep 30", timeout_s=0.3)]
    said = []
    for workers in (1, 2):
        with sharded(local("r0"), workers) as sessions, pytest.raises(DeadlineError) as caught:
            sessions.get("r0").ask(late)
        said.append((caught.value.host, caught.value.message, caught.value.hint, caught.value.code))
    assert said[0] == said[1] and said[0][0] == "r0"


def test_a_robot_that_is_not_there_is_a_value_and_named_the_same() -> None:
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        port = closed.getsockname()[1]
    host = Host(name="r0", address="127.0.0.1", port=port, user="nobody", identity_file="/nonexistent")
    said = []
    for workers in (1, 2):
        with sharded({"r0": host}, workers) as sessions:
            failure = sessions.failures()["r0"]
            said.append((type(failure), failure.message, failure.hint, failure.code))
    assert said[0] == said[1] and said[0][0] is ConnectError


# --- a worker dies ----------------------------------------------------------------------------------------------------


@as_root
def test_a_killed_worker_takes_its_own_robots_with_it_and_what_ran_there_and_no_others(tmp_path: Path) -> None:
    first, second = apart()
    hosts, mark = local(first, second), tmp_path / "mark"
    with sharded(hosts) as sessions:
        session, found = sessions.get(first), list[TransportError]()
        lock = session.open_lock_channel(LOCK, ["w"], PULSE)

        def work() -> None:
            try:
                session.execute(Run(script=f"echo $$ >{mark}; sleep 90; echo again >>{mark}", timeout_s=400))
            except TransportError as error:
                found.append(error)

        running = threading.Thread(target=work)
        running.start()
        wait_until(lambda: mark.exists() and mark.read_text(), "the step runs")
        os.kill(pids(sessions)[shard(first, 2)], signal.SIGKILL)
        running.join(30)
        assert found[0].host == first and found[0].code is Code.LOST and "SIGKILL" in found[0].message
        with pytest.raises(TransportError, match="SIGKILL"):
            session.ask([Query(command="true")])
        with pytest.raises(TransportError, match="SIGKILL"):
            sessions.again(first)
        with pytest.raises(TransportError):
            lock.send("t")
        lock.close()
        session.close()
        assert session.traffic.connections in (0, 1), "a report is written all the same"
        assert sessions.get(second).ask([Query(command="echo up")])[0].out == "up\n"
        assert mark.read_text().count("\n") == 1, "nothing is begun a second time"
    os.killpg(int(mark.read_text()), signal.SIGKILL)  # a robot's script would end what ran there; this one does not


@as_root
def test_a_worker_that_answers_nothing_is_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is stopped, as by a debugger: its socket stays open, and no message comes."""
    monkeypatch.setattr(link, "BEAT_S", 0.1)
    first, second = apart()
    with sharded(local(first, second)) as sessions:
        sessions.connected()
        os.kill(pids(sessions)[shard(first, 2)], signal.SIGSTOP)
        monkeypatch.setattr(processes, "_SILENT_S", 1.0)
        asked = background(lambda: sessions.get(first).ask([Query(command="true")]))
        assert isinstance(error := asked.exception(30), TransportError) and "SIGKILL" in error.message
        monkeypatch.undo()
        assert sessions.get(second).ask([Query(command="echo up")])[0].out == "up\n"


@as_root
def test_a_worker_that_a_signal_without_a_name_ends_is_told_of_too() -> None:
    number = signal.SIGRTMIN + 3
    with sharded(local("r0", "r1"), workers=2) as sessions:
        session = sessions.get("r0")
        os.kill(pids(sessions)[shard("r0", 2)], number)
        wait_until(lambda: ended(session), "the link is over")
        with pytest.raises(TransportError, match=f"was ended by signal {number}"):
            session.ask([Query(command="true")])


@as_root
def test_no_program_that_a_worker_starts_can_keep_its_socket() -> None:
    """It would keep this process from noticing that the worker is gone."""
    with sharded(local("r0", "r1")) as sessions:
        sessions.connected()
        for pid in pids(sessions):
            flags = [re.search(r"flags:\s+0(\d+)", info) for info in infos_of_sockets(pid)]
            assert flags and all(found and int(found[1], 8) & os.O_CLOEXEC for found in flags)


def test_a_worker_imports_nothing_of_the_folder_at_hand(tmp_path: Path) -> None:
    """It is a stranger's, perhaps. Python 3.13 imports `linecache` before it looks at `-c`."""
    for name in ("linecache", "encodings", "site", "re", "os"):
        (tmp_path / f"{name}.py").write_text("open('ran', 'w')")
    words = [*start_words(99, home=False)[:-1], "import srprov.transport.workers.worker"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False)
    assert not done.stderr and not (tmp_path / "ran").exists()
    sources = (path.read_text() for path in Path(srprov.__file__).parent.rglob("*.py"))
    started = [word for text in sources for word in re.findall(r"sys\.executable,\s*(\S+)", text)]
    assert len(started) >= 3 and set(started) == {'"-I",'}


@as_root
def test_a_worker_that_dies_while_it_connects_makes_its_robots_unreachable() -> None:
    with socket.socket() as mute:
        mute.bind(("127.0.0.1", 0))
        mute.listen()
        port = mute.getsockname()[1]
        host = Host(name="r0", address="127.0.0.1", port=port, user="nobody", identity_file="/nonexistent")
        with sharded({"r0": host, **local("r1")}, 2) as sessions:
            mute.accept()
            for pid in pids(sessions):
                os.kill(pid, signal.SIGKILL)
            assert set(sessions.failures()) >= {"r0"}


@as_root
def test_a_signal_for_the_terminal_reaches_this_process_alone() -> None:
    """Ctrl-C must let running steps end: the connections they run on may not end before."""
    with sharded(local("r0")) as sessions:
        session = sessions.get("r0")
        for pid in pids(sessions):
            assert os.getsid(pid) == pid != os.getsid(0), "the kernel sends a terminal's signals to its session"
        assert session.ask([Query(command="echo up")])[0].out == "up\n"


@as_root
def test_ctrl_c_in_a_wait_leaves_the_others_alone() -> None:
    with sharded(local("r0", "r1")) as sessions:
        session = sessions.get("r0")
        threading.Timer(0.5, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
        with pytest.raises(KeyboardInterrupt):
            session.execute(Run(script="sleep 120", timeout_s=200))
        assert sessions.get("r1").ask([Query(command="echo up")])[0].out == "up\n"
        session.close()
        with pytest.raises(TransportError):
            session.ask([Query(command="true")])


@as_root
def test_workers_and_what_runs_on_their_robots_end_with_a_process_that_is_killed(tmp_path: Path) -> None:
    """It says no goodbye; the kernel closes its end of the sockets."""
    mark = tmp_path / "mark"
    program = f"""if True:
        import sys, threading
        from tests.unit.transport.test_workers import Run, local, pids, sharded
        with sharded(local("r0", "r1")) as sessions:
            print(*pids(sessions), flush=True)
            sessions.get("r0").execute(Run(script="echo $$ >{mark}; sleep 90", timeout_s=200))
    """
    run = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    assert run.stdout is not None
    with run.stdout:
        found = [int(word) for word in run.stdout.readline().split()]
        wait_until(lambda: mark.exists() and mark.read_text(), "the step runs")
        run.kill()
        run.wait(30)
    assert len(found) == 2
    for pid in (*found, int(mark.read_text())):
        wait_until(lambda pid=pid: not Path(f"/proc/{pid}").exists(), "what it started is gone")


@as_root
def test_workers_end_with_the_run_and_with_this_process() -> None:
    with sharded(local("r0", "r1")) as sessions:
        sessions.connected()
        ended = pids(sessions)
    assert not [pid for pid in ended if Path(f"/proc/{pid}").exists()]
    began = time.monotonic()
    with sharded(local("r0", "r1")) as sessions:
        session = sessions.get("r0")
        threading.Thread(target=runs_until_closed, args=(session,)).start()
    assert time.monotonic() - began < 20, "nobody waits for a step that still runs"


# --- secrets ----------------------------------------------------------------------------------------------------------


@as_root
def test_a_secret_gets_to_its_robot_and_is_nowhere_else() -> None:
    vault, late = Vault(), Path("/dev/shm") / f"srprov-{secrets.token_hex(8)}" / "secret"  # in memory, as they must be
    with sharded(local("r0", "r1", password=Secret("other-" + CANARY)), vault=vault) as sessions:
        session = sessions.get("r0")
        vault.fill(Vault({"key": Secret(CANARY)}))  # it is read when the sessions are long there
        assert session.execute(Put(path=str(late), secret="key", mode=0o600)).ok
        assert late.read_text() == CANARY
        shutil.rmtree(late.parent)
        for pid in pids(sessions):
            for file in ("cmdline", "environ"):
                assert CANARY.encode() not in Path(f"/proc/{pid}/{file}").read_bytes()
        with pytest.raises(KeyError):
            session.execute(Put(path=str(late), secret="none"))
    assert redact(f"it was {CANARY}") == "it was ***"


def test_the_other_process_hides_what_it_was_lent() -> None:
    sent = packed({"key": Secret(CANARY)})
    forget()
    assert redact(CANARY) == CANARY
    found = unpacked(sent)["key"]
    assert repr(found) == "***" and redact(CANARY) == "***"


# --- how many ---------------------------------------------------------------------------------------------------------


def test_auto_is_one_process_for_few_robots_and_one_for_each_processor_for_many() -> None:
    assert (wanted_workers("auto", 199), wanted_workers("auto", 200)) == (1, len(os.sched_getaffinity(0)))
    assert (wanted_workers("1", 500), wanted_workers("8", 3), wanted_workers("3", 500)) == (1, 3, 3)


def test_robots_are_spread_evenly_and_stay_where_they_are() -> None:
    names = [f"robot{number}" for number in range(1000)]
    sizes = [sum(shard(name, 4) == which for name in names) for which in range(4)]
    assert min(sizes) > 200 and [shard(f"robot{number}", 2) for number in range(8)] == [shard(n, 2) for n in names[:8]]


def test_one_worker_is_this_process() -> None:
    sessions = Sessions({}, workers=1)
    assert sessions._workers is None
    sessions.close()


def test_a_peer_that_the_same_worker_has_is_not_asked_over_the_seam() -> None:
    """And one of another worker is, through this process."""
    from srprov.transport.turns import OwnTurns
    from srprov.transport.workers.home import Home

    sessions: dict[str, Session] = {"own": object(), "other": object()}  # type: ignore[dict-item]
    home = Home(sessions.__getitem__, lambda host: host == "own", OwnTurns(), ConnectOptions())
    assert home.peer("own") is None and home.peer("other") is sessions["other"]


def test_turns_of_a_worker_that_died_are_given_to_the_next() -> None:
    from srprov.transport.turns import OwnTurns
    from srprov.transport.workers.home import Home

    turns, key = OwnTurns(), secrets.token_hex(4)
    dead, other = (Home(lambda _host: None, lambda _host: True, turns, ConnectOptions()) for _ in range(2))  # type: ignore[arg-type,return-value]
    dead.take_turn(key)
    waiting = threading.Thread(target=other.take_turn, args=(key,), daemon=True)
    waiting.start()
    waiting.join(0.2)
    assert waiting.is_alive()
    dead.gone()
    waiting.join(30)
    assert not waiting.is_alive()
    dead.give_turn(key)
    assert turns.turn(key).locked(), "what was given at its end is not given again, by then it is another's"


def test_who_waits_for_a_turn_in_vain_ends_with_its_worker() -> None:
    from srprov.transport.turns import OwnTurns
    from srprov.transport.workers.home import Home

    turns, key = OwnTurns(), secrets.token_hex(4)
    home = Home(lambda _host: None, lambda _host: True, turns, ConnectOptions())  # type: ignore[arg-type,return-value]
    with turns.turn(key):
        waiting = threading.Thread(target=home.take_turn, args=(key,), daemon=True)
        waiting.start()
        home.gone()
        waiting.join(30)
        assert not waiting.is_alive()
    assert not turns.turn(key).locked()
