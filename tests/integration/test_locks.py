"""The lock's script in real shells with a real flock, over local pipes and over a real sshd.

Each test runs with dash and with busybox's `sh` and tools (what waits for long only in `make soak`); flock is
util-linux's in both.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from srprov.definitions.model import Host
from srprov.errors import LockHeld, TransportError
from srprov.execution import locks as locks_room
from srprov.execution.lock_set import LockOptions, LockSet
from srprov.execution.locks import SCRIPT, Claim, Holder, holders, who_holds
from srprov.session import Pulse, Session
from srprov.transport import ConnectOptions, connect
from srprov.transport.shell import lock_channel as channel_file
from srprov.transport.shell.frames import FIND_CONNECTION
from srprov.wire import Query, Run

from .sshd import Sshd, usable

pytestmark = pytest.mark.skipif(
    os.geteuid() != 0 or not shutil.which("flock"), reason="root's locks need root and flock"
)

ROOT = Path(__file__).parents[2]
SHELLS = ("dash", "busybox")
# for a test that waits for seconds: with busybox it is left to `make soak`
waits = pytest.mark.parametrize("shell", ["dash", pytest.param("busybox", marks=pytest.mark.soak)], indirect=True)
APPLETS = ("sh", "timeout", "dd", "head", "tr", "date", "mkdir", "mv", "rm", "chmod", "sleep", "cat")
MARK = "0123456789abcdef0123456789abcdef"
ANNA = Claim(owner="anna@desk", pid=7, purpose="apply hello", run="4711")
BOB = Claim(owner="bob@lab", pid=8, purpose="destroy hello", run="4712")
NAPS = [str(random.randrange(10**7, 10**8)) for _ in range(12)]
"""Seconds to sleep, by which processes are known: others than those of an earlier run."""
CALM = Pulse(beat_s=0.2, controller_s=60.0, robot_s=90)
"""For all that is not about silence: a busy machine may keep a process waiting for seconds."""
SHORT = Pulse(beat_s=0.2, controller_s=3.0, robot_s=8)


@pytest.fixture(params=SHELLS, autouse=True)
def shell(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Make `sh` and its tools those of one kind, and let locks lie in the test's folder."""
    if not shutil.which(request.param):
        pytest.skip(f"{request.param} is not installed")
    tools = tmp_path / "tools"
    tools.mkdir()
    for name in APPLETS if request.param == "busybox" else ("sh",):
        (tools / name).symlink_to(str(shutil.which(request.param)))
    if request.param == "busybox":
        # with some C libraries its grep ends at a NUL byte, as the one with -F does everywhere
        (tools / "grep").write_text('#!/bin/sh\nexec busybox grep -F "$@"\n')
        (tools / "grep").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tools}:{os.environ['PATH']}")
    monkeypatch.setattr(locks_room, "PLACES", (str(tmp_path / "run"), str(tmp_path / "tmp")))
    return str(request.param)


@pytest.fixture
def opened() -> Iterator[Callable[[], Session]]:
    """Return a function that opens a session with this machine."""
    sessions: list[Session] = []

    def build() -> Session:
        sessions.append(connect(Host(name="here", address="localhost", connection="local")))
        return sessions[-1]

    yield build
    for session in sessions:
        session.close()


def taken(session: Session, claim: Claim = ANNA, pulse: Pulse = CALM, wait_s: float = 0.0) -> LockSet:
    patience = LockOptions(wait_s=wait_s, pulse=pulse)
    locks = LockSet(["here"], {"here": session}, claim, patience, threading.Event(), lambda _event: None).acquire()
    assert locks.lost == {}
    return locks


def holder(session: Session) -> Holder | None:
    held, unreachable = holders(["here"], lambda _name: session)
    assert unreachable == {}
    return held["here"]


def wait_until(holds: Callable[[], object], seconds: float) -> float:
    """Wait until it holds; give how long that took."""
    begun = time.monotonic()
    while not holds():
        assert time.monotonic() - begun < seconds, "it did not come"
        time.sleep(0.02)
    return time.monotonic() - begun


def running(*words: str) -> list[int]:
    """Return the processes whose command line holds all of these words, without this one."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            line = folder.joinpath("cmdline").read_bytes().decode("utf-8", "replace")
            if all(word in line for word in words) and int(folder.name) != os.getpid():
                found.append(int(folder.name))
    return found


def script_of(session: Session) -> int:
    """Return the process of a session's lock script; its children look the same until they run a program."""
    return min(running("flock -n 9", session._mark))  # type: ignore[attr-defined]


# --- the lock -------------------------------------------------------------------------------------------------------


def test_one_holds_and_the_other_is_told_who(opened: Callable[[], Session], tmp_path: Path) -> None:
    """A held robot refuses with owner, process, purpose and time; given back, it is free and tells of nobody."""
    first, second = opened(), opened()
    assert holder(second) is None
    locks = taken(first)
    seen = holder(second)
    assert seen is not None
    assert (seen.owner, seen.pid, seen.purpose, seen.run) == ("anna@desk", 7, "apply hello", "4711")
    assert seen.age_s is not None and seen.age_s < 5
    with pytest.raises(LockHeld, match="here is held by anna@desk, process 7: apply hello, since 20"):
        taken(second, BOB)
    locks.release()
    assert holder(second) is None
    with taken(second, BOB):
        assert (holder(first) or Holder()).owner == "bob@lab"
    assert sorted(path.name for path in (tmp_path / "run").iterdir()) == ["lock"]
    assert (tmp_path / "run/lock").stat().st_mode & 0o777 == 0o600, "who may open it, may hold it"


def test_taking_is_one_round_trip(opened: Callable[[], Session]) -> None:
    """So it is counted; the heartbeat is not."""
    session = opened()
    before = session.traffic.round_trips
    with taken(session):
        time.sleep(0.5)
        assert session.traffic.round_trips == before + 1


def test_looking_does_not_get_in_the_way(opened: Callable[[], Session]) -> None:
    """While two ask all the time who holds the robot, it is taken and given back as if nobody did."""
    taking, over = opened(), threading.Event()

    def look(session: Session) -> None:
        while not over.is_set():
            session.ask([who_holds()] * 20)

    threads = [threading.Thread(target=look, args=(opened(),), daemon=True) for _ in range(2)]
    for thread in threads:
        thread.start()
    try:
        for _ in range(20):
            with taken(taking):
                pass
    finally:
        over.set()
        for thread in threads:
            thread.join(20)


def test_waiting_gets_it_soon_after_it_is_free(opened: Callable[[], Session]) -> None:
    """--lock-wait: not before the other has given it back, and soon after."""
    first, second = opened(), opened()
    locks = taken(first)
    begun = time.monotonic()
    threading.Timer(1.5, locks.release).start()
    with taken(second, BOB, wait_s=20):
        assert 1.4 < time.monotonic() - begun < 15


def test_a_holder_file_without_a_lock_is_no_lock(opened: Callable[[], Session]) -> None:
    """A holder that was killed leaves its file; the kernel knows better, and so do we."""
    first, second = opened(), opened()
    taken(first, pulse=Pulse())
    os.kill(script_of(first), signal.SIGKILL)
    wait_until(lambda: holder(second) is None, 30)
    folder = Path(locks_room.PLACES[0])
    assert json.loads((folder / "holder").read_text())["owner"] == "anna@desk"
    with taken(second, BOB):
        assert (holder(second) or Holder()).owner == "bob@lab"


@pytest.mark.parametrize("spoil", ["file", "link", "stranger"])
def test_a_folder_that_cannot_be_trusted_is_not_used(opened: Callable[[], Session], tmp_path: Path, spoil: str) -> None:
    """Where the first folder is no folder, a link or somebody else's, the second serves; `locks` looks there too."""
    first, second = Path(locks_room.PLACES[0]), Path(locks_room.PLACES[1])
    target = tmp_path / "target"
    target.mkdir()
    if spoil == "file":
        first.write_text("")
    elif spoil == "link":
        first.symlink_to(target)
    else:
        first.mkdir()
        os.chown(first, 65534, 65534)
    session = opened()
    with taken(session):
        assert (second / "lock").exists()
        assert holder(session) is not None
    assert list(target.iterdir()) == []
    assert spoil == "file" or list(first.iterdir()) == []


def test_no_folder_and_no_flock_are_said(opened: Callable[[], Session], tmp_path: Path, shell: str) -> None:
    """A robot that cannot be locked is lost with the reason, and nothing hangs."""
    for place in locks_room.PLACES:
        Path(place).write_text("")
    patience = LockOptions(pulse=SHORT)
    locks = LockSet(["here"], {"here": opened()}, ANNA, patience, threading.Event(), lambda _event: None).acquire()
    assert "root can write to none of" in locks.lost["here"]
    done = subprocess.run(
        [str(shutil.which("sh")), "-c", SCRIPT, "hold", MARK, "2", "", "{}", str(tmp_path / "x")],
        env={"PATH": str(tmp_path / "nowhere")}, capture_output=True, text=True, timeout=20,
    )  # fmt: skip
    assert done.stdout.splitlines()[0] == "no flock is not installed on the robot"


# --- the robot's end --------------------------------------------------------------------------------------------------


class Bare:
    """The script by itself, with the processes of a session beside it, and letters sent by hand."""

    def __init__(self, folder: Path, quiet_s: int = 2, path: str = "") -> None:
        self.folder = folder
        environment = {"PATH": f"{path}:{os.environ['PATH']}" if path else os.environ["PATH"]}
        # children in process groups and sessions of their own, and one whose parent is gone: all of them are ended
        work = "sleep {1} & timeout {2} sleep {2} & setsid sleep {3} & (sleep {4} &) ; sleep {5}; echo alive".format(
            *NAPS
        )
        odd = {"A": "line\nline", "SRPROV_SESSION": MARK, **environment}
        self.work = subprocess.Popen(["sh", "-c", work], env=odd, stdout=subprocess.PIPE)
        stranger = {**odd, "SRPROV_SESSION": MARK[::-1]}
        self.stranger = subprocess.Popen(["sleep", NAPS[6]], env=stranger)
        words = ("hold", MARK, str(quiet_s), "", json.dumps({"owner": "anna"}), str(folder))
        self.script = subprocess.Popen(
            ["sh", "-c", SCRIPT, *words], env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0
        )
        assert self.answer() == "locked"
        wait_until(lambda: len(self.alive()) >= 5, 30)

    def answer(self) -> str:
        assert self.script.stdout
        return self.script.stdout.readline().decode().strip()

    def say(self, letter: str) -> str:
        assert self.script.stdin
        self.script.stdin.write(letter.encode())
        return self.answer()

    def alive(self) -> list[int]:
        return [pid for nap in NAPS[1:6] for pid in running("sleep", nap)]

    def free(self) -> bool:
        return subprocess.run(["flock", "-n", str(self.folder / "lock"), "true"]).returncode == 0

    def end(self) -> None:
        for process in (self.script, self.work, self.stranger):
            process.kill()
            process.wait()
        for pid in self.alive():
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)


@pytest.fixture
def bare(tmp_path: Path) -> Iterator[Callable[..., Bare]]:
    """Return a function that starts a script by itself."""
    made: list[Bare] = []

    def build(**more: object) -> Bare:
        made.append(Bare(tmp_path / "bare", **more))  # type: ignore[arg-type]
        return made[-1]

    yield build
    for one in made:
        one.end()


@waits
def test_without_a_word_the_work_ends_before_the_lock(bare: Callable[..., Bare]) -> None:
    """On beats all goes on; without one for its time, the script kills what the session runs, and then lets go."""
    one = bare(quiet_s=4)
    for _ in range(10):
        time.sleep(0.3)
        assert one.say("b") == "b"
    assert one.work.poll() is None and not one.free()
    silent = time.monotonic()
    one.work.wait(60)
    assert 3.8 < time.monotonic() - silent < 30
    wait_until(one.free, 30)
    assert one.alive() == []
    assert one.stranger.poll() is None, "another session's process must not be touched"
    assert one.script.wait(30) == 0
    assert not (one.folder / "holder").exists()


def test_a_closed_channel_ends_it_at_once(bare: Callable[..., Bare]) -> None:
    """What sshd does when the controller was killed: end of input, and nobody reads any more."""
    one = bare(quiet_s=60)
    assert one.script.stdin and one.script.stdout
    one.script.stdout.close()
    one.script.stdin.write(b"b")  # a beat that was on its way; its echo meets a closed pipe
    one.script.stdin.close()
    assert wait_until(one.free, 60) < 20, (
        "a fraction of a second on a machine that has nothing else to do; not after 60 s"
    )
    assert one.alive() == [] and one.work.wait(1) == -signal.SIGKILL
    assert one.stranger.poll() is None


def test_giving_back_touches_no_process(bare: Callable[..., Bare]) -> None:
    """`e` and `f` let go and nothing else."""
    one = bare(quiet_s=60)
    assert one.say("f") == "free"
    assert one.free() and len(one.alive()) >= 5
    assert one.say("t") == "locked"
    assert not one.free()
    assert one.say("e") == ""
    assert one.script.wait(30) == 0 and one.free()
    assert len(one.alive()) >= 5


def test_signals_do_not_free_the_lock_before_the_work_ended(bare: Callable[..., Bare]) -> None:
    """TERM, HUP and INT leave the script alive; only its input tells it to end."""
    one = bare(quiet_s=60)
    for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
        os.kill(one.script.pid, number)
    assert one.say("b") == "b"
    assert not one.free() and one.work.poll() is None


@waits
def test_a_clock_that_jumps_has_no_effect(bare: Callable[..., Bare], tmp_path: Path) -> None:
    """With a `date` that jumps by years at every look, on and back, it lives on beats, and ends after its time."""
    folder = tmp_path / "clock"
    folder.mkdir()
    count = folder / "count"
    count.write_text("60")
    real = shutil.which("date")
    jump = f"n=30; [ $(cat {count}) = 30 ] && n=70; echo $n >{count}"
    (folder / "date").write_text(f'#!/bin/sh\n{jump}\nexec {real} -d @$((n * 31536000)) "$@"\n')
    (folder / "date").chmod(0o755)
    one = bare(quiet_s=4, path=str(folder))
    assert count.read_text().strip() != "60", "the stand-in was not asked"
    for _ in range(8):
        time.sleep(0.4)
        assert one.say("b") == "b"
    silent = time.monotonic()
    one.work.wait(60)
    assert 3.8 < time.monotonic() - silent < 30


# --- the controller's end ---------------------------------------------------------------------------------------------


@waits
def test_a_controller_that_hears_nothing_stops(opened: Callable[[], Session]) -> None:
    """Without an echo the session is closed before the robot's end gives up: the step ends, no other begins."""
    session, pulse = opened(), SHORT
    taken(session, pulse=pulse)
    script = script_of(session)
    stopped: list[float] = []
    threading.Timer(0.5, lambda: (os.kill(script, signal.SIGSTOP), stopped.append(time.monotonic()))).start()
    with pytest.raises(TransportError, match="lost contact: no sign of life for 3 s"):
        session.execute(Run(script="sleep 30"))
    assert 0.5 < time.monotonic() - stopped[0] < pulse.robot_s
    with pytest.raises(TransportError, match="lost contact"):
        session.ask([Query(command="true")])
    with contextlib.suppress(ProcessLookupError):
        os.kill(script, signal.SIGCONT)


def test_a_script_that_is_gone_is_noticed_before_the_next_step(opened: Callable[[], Session]) -> None:
    """Nothing is done without the lock, even when the next beat is far away."""
    session = opened()
    taken(session, pulse=Pulse())
    os.kill(script_of(session), signal.SIGKILL)
    wait_until(lambda: holder(opened()) is None, 30)
    time.sleep(0.1)
    with pytest.raises(TransportError, match="lost contact"):
        session.execute(Run(script="true"))


def test_a_controller_that_slept_does_not_act(opened: Callable[[], Session], monkeypatch: pytest.MonkeyPatch) -> None:
    """A suspended laptop wakes up long after the robot let go: its time counts on, and it stops by itself."""
    session = opened()
    taken(session, pulse=Pulse())
    asleep = channel_file.now() + 3600
    monkeypatch.setattr(channel_file, "now", lambda: asleep)
    with pytest.raises(TransportError, match="no sign of life for 20 s"):
        session.execute(Run(script="true"))


def test_a_bug_ends_what_runs_before_its_lock_is_free(opened: Callable[[], Session]) -> None:
    """A run that ends by an exception may leave a step running: nobody else may get the robot then."""
    session, other = opened(), opened()
    failed: list[str] = []
    thread = threading.Thread(target=lambda: failed.append(failure_of(session, f"sleep {NAPS[11]}")))
    with pytest.raises(RuntimeError, match="a bug"), taken(session):
        thread.start()
        wait_until(lambda: running("sleep", NAPS[11]), 30)
        raise RuntimeError("a bug")
    wait_until(lambda: holder(other) is None, 30)
    assert running("sleep", NAPS[11]) == []
    thread.join(30)
    assert len(failed) == 1 and failed[0]


def test_a_jump_of_the_controllers_clock_has_no_effect(
    opened: Callable[[], Session], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Years forward and back, the lock is held and steps are done."""
    session = opened()
    with taken(session):
        for jump in (1e9, -1e9):
            monkeypatch.setattr(time, "time", lambda jump=jump: 1.8e9 + jump)
            time.sleep(0.6)
            assert session.execute(Run(script="true")).ok


CONTROLLER = """
import sys, threading
from srprov.definitions.model import Host
from srprov.execution import locks
from srprov.execution.lock_set import LockOptions, LockSet
from srprov.transport import connect
from srprov.wire import Run
locks.PLACES = tuple(sys.argv[1:3])
session = connect(Host(name="here", address="localhost", connection="local"))
never, quiet = threading.Event(), lambda _event: None
LockSet(["here"], {"here": session}, locks.claim("apply hello"), LockOptions(), never, quiet).acquire()
print("locked", flush=True)
session.execute(Run(script=f"sleep {sys.argv[3]} & sleep {sys.argv[4]}"))
"""


def test_a_killed_controller_frees_the_lock_at_once(opened: Callable[[], Session]) -> None:
    """SIGKILL in the middle of a step: within two seconds the lock is free and nothing of the step runs any more."""
    controller = subprocess.Popen(
        [sys.executable, "-c", CONTROLLER, *locks_room.PLACES, *NAPS[7:9]],
        env={**os.environ, "PYTHONPATH": str(ROOT)}, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert controller.stdout and controller.stdout.readline() == "locked\n"
    wait_until(lambda: running("sleep", NAPS[8]), 30)
    session = opened()
    assert (holder(session) or Holder()).purpose == "apply hello"
    controller.kill()
    controller.wait()
    assert wait_until(lambda: holder(session) is None, 60) < 20
    assert running("sleep", NAPS[7]) + running("sleep", NAPS[8]) == []


# --- over SSH -------------------------------------------------------------------------------------------------------


@pytest.fixture
def server(tmp_path: Path, shell: str) -> Iterator[Sshd]:
    """Return a real sshd whose shells are those of the test."""
    if not usable():
        pytest.skip("needs openssh-server")
    made = Sshd(tmp_path / "sshd", options={"SetEnv": f"PATH={os.environ['PATH']}"}).start()
    yield made
    made.stop()


def over_ssh(server: Sshd, *, warm: bool = True) -> Session:
    options = ConnectOptions(connect_timeout_s=60.0, warm_engine=False, ssh_config=Path("/dev/null"))
    session = connect(server.host(name="here"), options=options)
    if warm:
        session.engine.warm_client = lambda: None  # type: ignore[attr-defined]  # what it asks would be counted too
        session.prepare()  # type: ignore[attr-defined]  # it is a BaseSession
    return session


def failure_of(session: Session, script: str) -> str:
    """Run a step and give the error that ends it, or nothing."""
    try:
        session.execute(Run(script=script))
    except TransportError as error:
        return error.message
    return ""


@pytest.mark.parametrize("warm", [True, False])
def test_a_lock_over_ssh(server: Sshd, opened: Callable[[], Session], warm: bool) -> None:
    """As over pipes: held, told, given back; one round trip, with the shell prepared or not."""
    session, local = over_ssh(server, warm=warm), opened()
    before = session.traffic.round_trips
    with taken(session):
        assert session.traffic.round_trips == before + 1
        assert (holder(local) or Holder()).owner == "anna@desk"
        assert session.execute(Run(script="true")).ok
    assert holder(local) is None
    assert session.execute(Run(script="true")).ok
    session.close()


def test_a_connection_that_ends_frees_the_lock(server: Sshd, opened: Callable[[], Session]) -> None:
    """As when the controller is killed: sshd closes the channels, and the step that ran ends too."""
    session, local = over_ssh(server), opened()
    taken(session)
    failed: list[str] = []
    thread = threading.Thread(target=lambda: failed.append(failure_of(session, f"sleep {NAPS[9]}")))
    thread.start()
    wait_until(lambda: running("sleep", NAPS[9]), 30)
    session.connection.wire.close()  # type: ignore[attr-defined]
    assert wait_until(lambda: holder(local) is None, 60) < 20
    assert running("sleep", NAPS[9]) == []
    thread.join(5)
    assert len(failed) == 1 and "lost" in failed[0], failed


@pytest.fixture
def listening(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    """Return a socket where the robot's engine is looked for; it accepts and says nothing."""
    path = str(tmp_path / "engine.sock")
    monkeypatch.setattr("srprov.transport.ssh_session._ENGINE_SOCKET", path)
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(path)
        made.listen()
        made.settimeout(5)
        yield made


def to_engine(session: Session, listening: socket.socket) -> tuple[object, socket.socket]:
    """Let a session open the stream by which it changes the engine; give both ends."""
    session._dial_reads(5.0)  # type: ignore[attr-defined]  # what is changed is what was read
    listening.accept()[0].close()
    ours = session._dial_changes(5.0)  # type: ignore[attr-defined]
    theirs = listening.accept()[0]
    theirs.settimeout(0.0)
    return ours, theirs


def over(theirs: socket.socket) -> bool:
    """Return whether a stream has come to its end."""
    try:
        return theirs.recv(1) == b""
    except BlockingIOError:
        return False


@waits
def test_a_network_that_is_cut_frees_the_lock(
    server: Sshd, opened: Callable[[], Session], listening: socket.socket
) -> None:
    """sshd notices nothing (here it is stopped): the controller gives up first, then the robot's end.

    Streams to the engine are sshd's own, and end with its process for this connection; nobody else's does.
    """
    other, before = over_ssh(server), server.connections()
    session, local = over_ssh(server), opened()
    taken(session, pulse=SHORT)
    _ours, engine = to_engine(session, listening)
    frozen = sorted(set(server.connections()) - set(before))
    assert frozen and not over(engine)
    failed: list[str] = []
    thread = threading.Thread(target=lambda: failed.append(failure_of(session, f"sleep {NAPS[10]}")))
    thread.start()
    wait_until(lambda: running("sleep", NAPS[10]), 30)
    for pid in frozen:
        os.kill(pid, signal.SIGSTOP)
    begun = time.monotonic()
    thread.join(30)
    assert 0.5 < time.monotonic() - begun < SHORT.robot_s, "the controller stops first"
    assert failed == ["lost contact: no sign of life for 3 s"]
    assert holder(local) is not None
    took = wait_until(lambda: holder(local) is None, 60)
    assert took < 2 * SHORT.robot_s
    assert running("sleep", NAPS[10]) == []
    assert over(engine), "what is still on its way reaches no engine"
    assert not set(frozen) & set(server.connections())
    assert other.execute(Run(script="true")).ok
    over_ssh(server).close()


@pytest.mark.parametrize("known", ["no lock", "no process", "given back"])
def test_no_stream_of_sshd_changes_anything_that_a_lock_could_not_end(
    server: Sshd, listening: socket.socket, monkeypatch: pytest.MonkeyPatch, known: str
) -> None:
    """The docker client is asked for instead, whose process the lock's script finds."""
    if known == "no process":
        monkeypatch.setattr("srprov.transport.ssh_session.SshSession._find_connection", "line=; echo; ")
    session = over_ssh(server)
    session._dial_reads(5.0)  # type: ignore[attr-defined]
    listening.accept()[0].close()
    asked: list[str] = []
    monkeypatch.setattr(session, "_dial_client", lambda _deadline: asked.append("client"))
    locks = None if known == "no lock" else taken(session)
    if locks and known == "given back":
        locks.release()
    session._dial_changes(5.0)  # type: ignore[attr-defined]
    assert asked == ["client"]
    session.close()


@pytest.mark.parametrize(("between", "found"), [("sh", True), ("python", False)])
def test_sshd_is_found_through_shells_only(tmp_path: Path, between: str, found: bool) -> None:
    """Above any other program it serves somebody else's login: who works on this very machine, say."""
    (tmp_path / "sshd").symlink_to(str(shutil.which("dash")))
    (tmp_path / "find").write_text(FIND_CONNECTION)
    (tmp_path / "inner.sh").write_text(f"sh {tmp_path}/find\n:\n")
    (tmp_path / "inner.py").write_text(f"import subprocess; subprocess.run(['sh', '{tmp_path}/find'], check=True)\n")
    inner = f"sh {tmp_path}/inner.sh" if between == "sh" else f"{sys.executable} {tmp_path}/inner.py"
    (tmp_path / "outer").write_text(f"echo $$\n{inner}\n:\n")
    argv = [str(tmp_path / "sshd"), str(tmp_path / "outer")]
    done = subprocess.run(argv, capture_output=True, text=True, timeout=20, check=True)
    own, line = done.stdout.splitlines()
    assert line == (own if found else "")
